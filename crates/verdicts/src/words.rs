//! Verdicts in words, with sizes and 95 % intervals: the same for commands, the API, the page and Python.

use crate::view::{ExplanationView, ExplanationWord, IntervalView, LossView, SequentialView, VerdictKind};
use rotortwin_fdi_session::{ExplanationKind, Interval, Motion, words};

/// A verdict as one line.
pub(crate) fn verdict(view: &SequentialView) -> String {
    match view.verdict.verdict {
        VerdictKind::NotReady => "calibrating".to_owned(),
        VerdictKind::Healthy if view.is_unclear() => {
            "unclear: more than health explains, and no rotor stands out".to_owned()
        }
        VerdictKind::Healthy => "healthy".to_owned(),
        VerdictKind::Unknown => "unknown fault".to_owned(),
        VerdictKind::CannotJudge => "cannot judge".to_owned(),
        VerdictKind::Ambiguous if view.explanations.is_empty() => {
            let sets: Vec<String> = view
                .hypotheses
                .iter()
                .map(|set| set.iter().map(u32::to_string).collect::<Vec<_>>().join("+"))
                .collect();
            format!("ambiguous: rotors {}", sets.join(" or "))
        }
        VerdictKind::Ambiguous => {
            let explanations: Vec<String> = view.explanations.iter().map(explanation).collect();
            match explanations.as_slice() {
                // No code is of a gain, or of three rotors.
                [only] => only.clone(),
                several => format!("ambiguous: {}", several.join(" or ")),
            }
        }
        VerdictKind::Faulty | VerdictKind::FaultyPair => {
            let losses: Vec<String> = view
                .thrust_loss
                .iter()
                .map(|one| loss(one, &view.explanations))
                .collect();
            losses.join(", ")
        }
    }
}

/// `rotor 3 lost 10.0 % [9.8, 10.2]`, with what else is known of it.
fn loss(loss: &LossView, explanations: &[ExplanationView]) -> String {
    let share = Interval {
        value: loss.share,
        low: loss.share_low,
        high: loss.share_high,
    };
    let motion = loss.motion.map(|motion| Motion {
        moves: motion.moves,
        rate_1_s: interval(&motion.rate_1_s),
    });
    // Likelier than not: the blade drags.
    let first = explanations.iter().find(|one| one.rotors == [loss.rotor]);
    let drag = first.and_then(|one| one.drag.as_ref()).map(interval);
    words::loss(loss.rotor, &share, motion.as_ref(), drag.as_ref())
}

/// One of several explanations.
fn explanation(one: &ExplanationView) -> String {
    let kind = match one.kind {
        ExplanationWord::Loss => ExplanationKind::Loss,
        ExplanationWord::LossWithDrag => ExplanationKind::LossWithDrag,
        ExplanationWord::Gain => ExplanationKind::Gain,
        ExplanationWord::Load => ExplanationKind::Load,
    };
    let shares: Vec<Interval> = one.shares.iter().map(interval).collect();
    let sizes = (one.drag.as_ref().map(interval), one.mass_kg.as_ref().map(interval));
    words::explanation(kind, &one.rotors, &shares, sizes, one.probability)
}

fn interval(view: &IntervalView) -> Interval {
    let IntervalView { value, low, high } = *view;
    Interval { value, low, high }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The page said "ambiguous; rotors in question: 2" of a rotor that gives more.
    #[test]
    fn regress_a_single_explanation_is_said_though_no_code_is_of_its_kind() {
        let size = IntervalView {
            value: 0.081,
            low: 0.076,
            high: 0.086,
        };
        let gain = ExplanationView {
            kind: ExplanationWord::Gain,
            rotors: vec![2],
            probability: 0.999,
            shares: vec![size],
            drag: None,
            mass_kg: None,
        };
        let mut view = SequentialView::cannot_judge();
        view.verdict.verdict = VerdictKind::Ambiguous;
        view.explanations = vec![gain.clone()];
        assert_eq!(verdict(&view), "rotor 2 gives 8.1 % [7.6, 8.6] more (1.00)");
        view.explanations.push(ExplanationView {
            kind: ExplanationWord::Loss,
            rotors: vec![5],
            probability: 0.4,
            ..gain
        });
        let said = verdict(&view);
        assert!(
            said.starts_with("ambiguous: rotor 2 gives") && said.contains(" or rotor 5 lost "),
            "{said}"
        );
    }
}
