//! Verdicts in plain words, with sizes, as tables and logs print them.

use crate::second_look::{ExplanationKind, Interval, Motion};
use crate::session::Window;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::verdict_code::{AMBIGUOUS, HEALTHY, NOT_READY, UNKNOWN, named_rotors};

/// `10.0 % [9.8, 10.2]` of a fraction.
pub fn percent(share: &Interval) -> String {
    format!(
        "{:.1} % [{:.1}, {:.1}]",
        100.0 * share.value,
        100.0 * share.low,
        100.0 * share.high
    )
}

/// `rotor 3 lost 10.0 % [9.8, 10.2]`, with what else is known of it.
///
/// * `rotor`: from 1
/// * `share`: of its thrust in hover
/// * `drag`: of its blade relative to its lift, where that is likelier than a loss alone
pub fn loss(rotor: u32, share: &Interval, motion: Option<&Motion>, drag: Option<&Interval>) -> String {
    let mut text = format!("rotor {rotor} lost {}", percent(share));
    if let Some(motion) = motion.filter(|motion| motion.moves) {
        let Interval { value, low, high } = motion.rate_1_s;
        let (word, rate) = if value > 0.0 {
            ("growing", Interval { value, low, high })
        } else {
            // −0 would be shown.
            let [value, low, high] = [-value, -high, -low].map(|x| x + 0.0);
            ("shrinking", Interval { value, low, high })
        };
        text += &format!(", {word} by {} a second", percent(&rate));
    }
    if let Some(drag) = drag {
        text += &format!(", its blade drags {} more for its lift", percent(drag));
    }
    text
}

/// One of several explanations, with its probability: `rotor 3 gives 4.9 % [4.7, 5.1] more (0.99)`.
///
/// * `rotors`: from 1; `shares`: one for each
/// * `drag`: of a loss with drag
/// * `mass_kg`: of a load
pub fn explanation(
    kind: ExplanationKind,
    rotors: &[u32],
    shares: &[Interval],
    (drag, mass_kg): (Option<Interval>, Option<Interval>),
    probability: f32,
) -> String {
    let each = |word: &str, more: &str| {
        let both = rotors.iter().zip(shares);
        let texts: Vec<String> = both
            .map(|(rotor, share)| format!("rotor {rotor} {word} {}{more}", percent(share)))
            .collect();
        texts.join(" and ")
    };
    let what = match kind {
        ExplanationKind::Loss => each("lost", ""),
        ExplanationKind::LossWithDrag => {
            let drag = drag.as_ref().map(percent).unwrap_or_default();
            format!("{} with a blade that drags {drag} more", each("lost", ""))
        }
        ExplanationKind::Gain => each("gives", " more"),
        ExplanationKind::Load => {
            let mass = mass_kg.unwrap_or_default();
            format!("a load of {:.2} kg [{:.2}, {:.2}]", mass.value, mass.low, mass.high)
        }
    };
    format!("{what} ({probability:.2})")
}

/// The verdict of a window after the second look; the reason where there is none.
pub fn verdict(window: &Window) -> String {
    if let Some(obstacle) = &window.obstacle {
        return format!("cannot judge: {obstacle}");
    }
    let (report, details) = (&window.report, &window.details);
    match report.sequential {
        NOT_READY => "calibrating".to_owned(),
        HEALTHY => "healthy".to_owned(),
        UNKNOWN => "unknown fault".to_owned(),
        AMBIGUOUS => {
            let all: Vec<String> = details
                .explanations
                .iter()
                .map(|one| {
                    let sizes = (one.drag, one.mass_kg);
                    explanation(one.kind, &rotors_of(one.rotors), &one.shares, sizes, one.probability)
                })
                .collect();
            match all.as_slice() {
                [] => "ambiguous".to_owned(),
                // No code is of a gain, or of three rotors.
                [only] => only.clone(),
                several => format!("ambiguous: {}", several.join(" or ")),
            }
        }
        code => {
            let losses = [&report.thrust_loss, &report.second_thrust_loss];
            let texts: Vec<String> = named_rotors(code)
                .zip(losses)
                .enumerate()
                .map(|(place, (rotor, size))| {
                    let [_, _, _, value, low, high] = size.values();
                    let first = details.explanations.iter().find(|one| rotors_of(one.rotors) == [rotor]);
                    let drag = first.and_then(|one| one.drag.as_ref());
                    loss(rotor, &Interval { value, low, high }, details.motion.get(place), drag)
                })
                .collect();
            texts.join(", ")
        }
    }
}

/// Numbers, from 1, of the rotors in a mask.
pub fn rotors_of(mask: u32) -> Vec<u32> {
    (0..MAX_ROTORS as u32)
        .filter(|bit| mask >> bit & 1 == 1)
        .map(|bit| bit + 1)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHARE: Interval = Interval {
        value: 0.049,
        low: 0.047,
        high: 0.051,
    };

    #[test]
    fn val_a_loss_in_words() {
        assert_eq!(loss(3, &SHARE, None, None), "rotor 3 lost 4.9 % [4.7, 5.1]");
        let shrinks = Motion {
            moves: true,
            rate_1_s: Interval {
                value: -0.01,
                low: -0.02,
                high: 0.0,
            },
        };
        assert_eq!(
            loss(3, &SHARE, Some(&shrinks), Some(&SHARE)),
            "rotor 3 lost 4.9 % [4.7, 5.1], shrinking by 1.0 % [0.0, 2.0] a second, its blade drags 4.9 % [4.7, 5.1] more for its lift"
        );
    }

    #[test]
    fn val_rotors_of_a_mask() {
        assert_eq!(rotors_of(0b10_0001), [1, 6]);
    }

    #[test]
    fn val_explanations_in_words() {
        let said = |kind, rotors: &[u32], sizes| explanation(kind, rotors, &[SHARE; 2][..rotors.len()], sizes, 0.987);
        assert_eq!(
            said(ExplanationKind::Gain, &[3], (None, None)),
            "rotor 3 gives 4.9 % [4.7, 5.1] more (0.99)"
        );
        assert_eq!(
            said(ExplanationKind::Loss, &[1, 4], (None, None)),
            "rotor 1 lost 4.9 % [4.7, 5.1] and rotor 4 lost 4.9 % [4.7, 5.1] (0.99)"
        );
        assert_eq!(
            said(ExplanationKind::LossWithDrag, &[1], (Some(SHARE), None)),
            "rotor 1 lost 4.9 % [4.7, 5.1] with a blade that drags 4.9 % [4.7, 5.1] more (0.99)"
        );
        assert_eq!(
            said(ExplanationKind::Load, &[], (None, Some(SHARE))),
            "a load of 0.05 kg [0.05, 0.05] (0.99)"
        );
    }
}
