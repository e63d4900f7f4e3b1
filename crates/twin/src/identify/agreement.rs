//! Whether the two halves of a flight, and the class, are consistent with the interval of a value.
//!
//! The interval of a fit is based on its own errors and on the scatter of short parts about one linearisation. Neither
//! covers what fits of the halves alone can show: for a real quadrotor the roll gain was 4.6 times larger in the second
//! half, although the interval of the whole was ± 29 %.

use super::held_out::Score;
use crate::Z95;
use crate::model::constants::Source;

/// How many of their deviations halves that agree lie apart at most: one value in 400 by chance.
const APART: f64 = 3.0;
/// R² by which what was learnt may, by chance, predict unseen seconds worse than the class does.
const WORSE: f64 = 0.05;

/// A value as it was found in the whole flight, in each half, and of the class, all on the same scale.
pub(super) struct Compared<'a> {
    pub(super) name: &'a str,
    pub(super) whole: f64,
    pub(super) class: f64,
    /// Value and deviation by half, if both determine it.
    pub(super) halves: Option<[(f64, f64); 2]>,
    /// Value and deviation by flight, of those that determine it, if there are several.
    pub(super) flights: Vec<(f64, f64)>,
    /// What one half gives, if that cannot be.
    pub(super) impossible: Option<f64>,
    /// How each half predicts the other in the channel that the value shows in.
    pub(super) score: Option<&'a Score>,
    /// Deviation of the class.
    pub(super) class_deviation: f64,
    /// A number on that scale, for people.
    pub(super) shown: &'a dyn Fn(f64) -> String,
}

impl Compared<'_> {
    /// Deviation and source, if nothing contradicts them; otherwise a deviation that covers the contradiction, with a
    /// note.
    pub(super) fn checked(&self, (mut deviation, mut source): (f64, Source), notes: &mut Vec<String>) -> (f64, Source) {
        if source == Source::Class {
            return (deviation, source);
        }
        if let Some([(first, _), (second, _)]) = self.halves.filter(halves_differ) {
            let cover = (first - self.whole).abs().max((second - self.whole).abs()) / Z95;
            if cover > deviation {
                deviation = cover;
                source = Source::LogAndClass;
                notes.push(format!(
                    "{}: the first half of the flight gives {}, the second {}, farther apart than their errors: the interval covers both",
                    self.name,
                    (self.shown)(first),
                    (self.shown)(second)
                ));
            }
        }
        if self.flights_differ() {
            let cover = self
                .flights
                .iter()
                .map(|(value, _)| (value - self.whole).abs())
                .fold(0.0, f64::max)
                / Z95;
            if cover > deviation {
                deviation = cover;
                source = Source::LogAndClass;
                let each: Vec<String> = self.flights.iter().map(|(value, _)| (self.shown)(*value)).collect();
                notes.push(format!(
                    "{}: the flights, each by itself, give {}, farther apart than their errors: the interval covers them",
                    self.name,
                    each.join(", ")
                ));
            }
        }
        if let Some(impossible) = self.impossible {
            let all = self.halves.iter().flatten().map(|(value, _)| *value);
            let others = all.filter(|value| *value != impossible).chain([self.class]);
            let cover = others.map(|value| (value - self.whole).abs()).fold(0.0, f64::max) / Z95;
            deviation = deviation.max(cover);
            source = Source::LogAndClass;
            notes.push(format!(
                "{}: half of the flight, fitted by itself, gives {}, which is impossible: the interval covers the other half and the class default",
                self.name,
                (self.shown)(impossible)
            ));
        }
        if let Some(score) = self
            .score
            .filter(|score| score.calibrated < score.class_default - WORSE)
        {
            deviation = deviation.max((self.whole - self.class).abs() / Z95);
            source = Source::LogAndClass;
            notes.push(format!(
                "{}: {} in seconds that were not fitted is predicted worse with the flight's value than with the class default (R² {:.2} against \
                 {:.2}): the interval covers both",
                self.name, score.channel, score.calibrated, score.class_default
            ));
        }
        if let Some(score) = self.score.filter(|score| score.calibrated < 0.0) {
            let cover = self.class_deviation.max((self.whole - self.class).abs() / Z95);
            if cover > deviation {
                deviation = cover;
                source = Source::LogAndClass;
                notes.push(format!(
                    "{}: {} in seconds that were not fitted is predicted worse than by its mean (R² {:.2}): the value is known no better than by the \
                     class",
                    self.name, score.channel, score.calibrated
                ));
            }
        }
        (deviation, source)
    }

    fn flights_differ(&self) -> bool {
        let apart = |[first, second]: [&(f64, f64); 2]| halves_differ(&[*first, *second]);
        let mut firsts = self.flights.iter().enumerate();
        firsts.any(|(k, first)| self.flights[k + 1..].iter().any(|second| apart([first, second])))
    }
}

fn halves_differ([(first, its), (second, other)]: &[(f64, f64); 2]) -> bool {
    (first - second).abs() > APART * its.hypot(*other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::Band;

    fn compared<'a>(halves: [(f64, f64); 2], score: Option<&'a Score>) -> Compared<'a> {
        Compared {
            name: "inertia, roll",
            whole: 0.0,
            class: -1.0,
            halves: Some(halves),
            impossible: None,
            flights: Vec::new(),
            score,
            class_deviation: 0.3,
            shown: &|value| format!("{value:.2}"),
        }
    }

    /// n = 1.27, 0.86, 1.12 and 0.83 of four flights of one vehicle, each with an interval that excluded the others.
    #[test]
    fn regress_flights_that_differ_widen_the_interval() {
        let mut notes = Vec::new();
        let mut found = |flights: &[(f64, f64)]| {
            let one = Compared {
                flights: flights.to_vec(),
                ..compared([(0.0, 0.1), (0.0, 0.1)], None)
            };
            one.checked((0.05, Source::Log), &mut notes)
        };
        assert_eq!(found(&[(0.03, 0.02), (-0.03, 0.02)]), (0.05, Source::Log));
        let (deviation, source) = found(&[(0.3, 0.05), (-0.15, 0.05), (0.1, 0.05)]);
        assert!((deviation * Z95 - 0.3).abs() < 1e-12 && source == Source::LogAndClass);
        assert!(notes[0].contains("give 0.30, -0.15, 0.10, farther apart"), "{notes:?}");
    }

    #[test]
    fn regress_what_predicts_worse_than_the_mean_is_known_no_better_than_by_the_class() {
        let nothing = Score {
            channel: "the same without drift",
            band: Band {
                low_hz: 0.1,
                high_hz: 10.0,
            },
            class_default: -1.34,
            calibrated: -0.46,
        };
        let mut notes = Vec::new();
        let one = compared([(0.0, 0.1), (0.0, 0.1)], Some(&nothing));
        let (deviation, source) = one.checked((0.05, Source::Log), &mut notes);
        assert!(deviation * Z95 >= 1.0 && source == Source::LogAndClass, "{notes:?}");
        let same_as_class = Compared { class: 0.01, ..one };
        let (deviation, source) = same_as_class.checked((0.05, Source::Log), &mut notes);
        assert!(deviation == 0.3 && source == Source::LogAndClass, "{notes:?}");
    }

    #[test]
    fn regress_halves_that_differ_widen_the_interval() {
        let mut notes = Vec::new();
        let found = |halves, notes: &mut Vec<String>| compared(halves, None).checked((0.05, Source::Log), notes);
        assert_eq!(found([(-0.1, 0.1), (0.1, 0.1)], &mut notes), (0.05, Source::Log));
        // A half that hardly determines it does not contradict the other.
        assert_eq!(found([(-1.5, 0.6), (0.0, 0.05)], &mut notes), (0.05, Source::Log));
        assert!(notes.is_empty());
        let (deviation, source) = found([(-0.7, 0.1), (0.8, 0.1)], &mut notes);
        assert!((deviation * Z95 - 0.8).abs() < 1e-12 && source == Source::LogAndClass);
        assert!(
            notes[0].contains("the first half of the flight gives -0.70, the second 0.80"),
            "{notes:?}"
        );
    }

    /// "inertia, roll 0.0273 ± 29 % (log)" of a flight whose halves gave 0.050, which is impossible, and 0.011.
    #[test]
    fn regress_a_half_that_is_impossible_leaves_no_value_of_the_log() {
        let mut notes = Vec::new();
        let one = Compared {
            impossible: Some(0.6),
            ..compared([(0.6, 1.0), (-0.9, 0.3)], None)
        };
        let (deviation, source) = one.checked((0.13, Source::Log), &mut notes);
        assert!(
            (deviation * Z95 - 1.0).abs() < 1e-12 && source == Source::LogAndClass,
            "{notes:?}"
        );
    }

    #[test]
    fn regress_what_predicts_worse_than_the_class_does_not_exclude_it() {
        let score = |calibrated| Score {
            channel: "roll acceleration",
            band: Band {
                low_hz: 0.5,
                high_hz: 10.0,
            },
            class_default: 0.6,
            calibrated,
        };
        let mut notes = Vec::new();
        let same = [(0.0, 0.1), (0.0, 0.1)];
        let fair = score(0.59);
        assert_eq!(
            compared(same, Some(&fair)).checked((0.05, Source::Log), &mut notes).1,
            Source::Log
        );
        let poor = score(0.1);
        let (deviation, source) = compared(same, Some(&poor)).checked((0.05, Source::Log), &mut notes);
        assert!(deviation * Z95 >= 1.0 && source == Source::LogAndClass);
        assert_eq!(
            compared(same, Some(&poor)).checked((0.3, Source::Class), &mut notes),
            (0.3, Source::Class)
        );
    }
}
