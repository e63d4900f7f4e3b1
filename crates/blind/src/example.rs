//! Examples for a first visit: a log with something hidden in it, or with nothing.

use crate::catalogue;
use crate::draw::draw_effect;
use crate::error::{BlindError, Result};
use crate::hidden::Hidden;
use crate::random::Stream;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Kinds that a one-minute excitation flight shows and distinguishes from all others: the bench finds each of them by
/// its name.
pub const SHOWN: [&str; 6] = [
    "rotor-drag",
    "quadratic-drag",
    "translational-lift",
    "centre-of-mass",
    "motor-time-constant",
    "inertia-roll",
];
/// Loss of thrust of a damaged blade, fraction.
const LOSS: [f64; 2] = [0.04, 0.12];
/// Share of the flight after which the fault sets in: detectors learn the healthy state before, and both states are
/// visible long enough.
const BREAKS_AFTER: [f64; 2] = [0.35, 0.6];

/// Length of the flight of an example, s: long enough for a diagnosis, soon flown.
pub const SHOWN_S: f64 = 60.0;

/// Purpose of an example.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema, clap::ValueEnum)]
#[schema(as = LogExampleKind)]
#[serde(rename_all = "kebab-case")]
pub enum Example {
    /// One effect that the vehicle's model lacks
    HiddenEffect,
    /// One rotor that loses some of its thrust in mid-flight
    DamagedBlade,
    /// A vehicle that agrees with its model
    Healthy,
}

impl Example {
    /// As an argument has it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::HiddenEffect => "hidden-effect",
            Self::DamagedBlade => "damaged-blade",
            Self::Healthy => "healthy",
        }
    }

    /// Seeds that a first visit is shown, each flown through the whole loop with the f550 for [`SHOWN_S`]: what is hidden is named, with its
    /// rotor and time, and the model with it agrees by comparison and by diagnosis; of a healthy flight both say so at once.
    ///
    /// Another seed may end with a remainder that no effect explains. How often the diagnosis is right is for the blind bench to say, whose
    /// seeds nobody chooses.
    pub const fn seeds(self) -> &'static [u64] {
        match self {
            // One to three of each of [`SHOWN`].
            Self::HiddenEffect => &[
                665_845, 438_336, 438_298, 884_241, 172_962, 723_273, 226_507, 192_498, 847_096, 497_703, 831_136,
                553_174,
            ],
            Self::DamagedBlade => &[21, 29, 35, 38, 40, 43, 172_962, 6],
            Self::Healthy => &[
                362_581, 172_962, 438_298, 723_273, 438_336, 665_845, 294_919, 502_373, 884_241, 226_507, 831_136,
                497_703,
            ],
        }
    }

    /// What is hidden in a flight of `duration_s`, drawn by the seed.
    pub fn effects(self, rotors: usize, duration_s: f64, seed: u64) -> Vec<Hidden> {
        let mut random = Stream::new(seed, "example");
        match self {
            Self::HiddenEffect => {
                let id = SHOWN[random.below(SHOWN.len())];
                let kind = catalogue::kind(id);
                kind.map_or_else(Vec::new, |kind| draw_effect(kind, 1.0, rotors, &mut random))
            }
            Self::DamagedBlade => {
                let rotor = 1 + random.below(rotors);
                let share = -random.between(LOSS[0], LOSS[1]);
                let kind = catalogue::kind("rotor-thrust-scale");
                let effect = kind.map(|kind| {
                    let mut effect = Hidden::typical(kind, Some(rotor));
                    effect.parameters.insert("share".to_owned(), share);
                    // To a tenth of a second: people read it.
                    let breaks = duration_s * random.between(BREAKS_AFTER[0], BREAKS_AFTER[1]);
                    effect.onset_s = Some((10.0 * breaks).round() / 10.0);
                    effect
                });
                effect.into_iter().collect()
            }
            Self::Healthy => Vec::new(),
        }
    }
}

/// An effect by its id alone, with a size and a rotor drawn from the seed, or `id:parameter=value,…` as given.
///
/// # Errors
/// The id does not exist, or the effect has no such parameter.
pub fn effect(text: &str, rotors: usize, seed: u64) -> Result<Vec<Hidden>> {
    match catalogue::kind(text) {
        Some(kind) => Ok(draw_effect(kind, 1.0, rotors, &mut Stream::new(seed, "example"))),
        None => {
            let effect = Hidden::parse(text)?;
            effect.check(rotors)?;
            let kind = catalogue::kind(&effect.id);
            match kind.and_then(|kind| kind.companion) {
                Some(companion) => Err(BlindError::input(
                    format!("effect {text}"),
                    format!("it has no effect without {companion}; expected its id alone, which adds both"),
                )),
                None => Ok(vec![effect]),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_examples_repeat_and_are_what_they_are_called() {
        for seed in 0..40 {
            for rotors in [4, 6, 8] {
                for example in [Example::HiddenEffect, Example::DamagedBlade, Example::Healthy] {
                    let effects = example.effects(rotors, 60.0, seed);
                    assert_eq!(effects, example.effects(rotors, 60.0, seed));
                    assert_eq!(effects.len(), usize::from(example != Example::Healthy));
                    assert!(effects.iter().all(|effect| effect.check(rotors).is_ok()));
                }
                let blade = &Example::DamagedBlade.effects(rotors, 60.0, seed)[0];
                assert!((-LOSS[1]..=-LOSS[0]).contains(&blade.parameters["share"]));
                assert!(blade.onset_s.is_some_and(|onset| (21.0..=36.0).contains(&onset)));
            }
        }
        let drawn: std::collections::BTreeSet<String> = (0..100)
            .map(|seed| Example::HiddenEffect.effects(6, 60.0, seed)[0].id.clone())
            .collect();
        assert_eq!(drawn.len(), SHOWN.len(), "every kind is drawn: {drawn:?}");
        for id in SHOWN {
            let of_kind = |seed: &&u64| Example::HiddenEffect.effects(6, SHOWN_S, **seed)[0].id == id;
            let count = Example::HiddenEffect.seeds().iter().filter(of_kind).count();
            assert!((1..=3).contains(&count), "{id}: {count}");
        }
    }

    #[test]
    fn val_an_effect_by_name_or_in_full() {
        assert_eq!(effect("wind", 6, 3).unwrap().len(), 2, "with its companion");
        let given = effect("rotor-thrust-scale:rotor=2,share=-0.1", 6, 3).unwrap();
        assert_eq!((given[0].rotor, given[0].parameters["share"]), (Some(2), -0.1));
        for (bad, words) in [
            ("none", "unknown effect `none`"),
            ("rotor-thrust-scale:rotor=7", "from 1 to 6"),
            ("rotor-drag:x=1", "no parameter"),
            ("wind:north_m_s=2", "rotor-drag"),
        ] {
            let error = effect(bad, 6, 3).unwrap_err().to_string();
            assert!(error.contains(words), "{bad}: {error}");
        }
    }
}
