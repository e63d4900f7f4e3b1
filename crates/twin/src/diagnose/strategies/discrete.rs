//! Gross errors of the build: two motors swapped, a rotor that turns the other way.
//!
//! They are not small deviations: a linear ranking patches them with tilts and scales. There are so few that each is
//! simply tried; one is accepted where it removes nearly all of a large error of forces and torques.

use rayon::prelude::*;
use rotortwin_plant::effects::{EffectDeclaration, Strategy, Wiring};

use super::start::Trial;
use crate::estimation::candidates::Candidate;
use crate::estimation::columns::{Active, instances};
use crate::estimation::nuisances::Reach;
use crate::estimation::problem::Problem;
use crate::predict::channels::{F, KA, KV, M};
use crate::predict::{Nuisances, Prediction, Source, Stages};

/// Gross errors of which the nuisances are fitted, after a first look without.
const FITTED: usize = 4;

/// Largest mean chi² of the torque channels with the right wiring. On a flight that hardly turns, a displaced centre of
/// mass or the moment of a steady wind looks like swapped rotors, but only down to a quarter of its error.
const LEFT_CHI2: f64 = 3.0;

/// Time constant, s, that separates slow causes, such as the moment of a wind, from a controller's commands to single
/// rotors.
const CHANGE_S: f64 = 0.25;

/// How well a wiring explains the flights.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Explained {
    /// Excess of chi² in forces and torques about their means, and the cost of the rotors' biases by their prior: in
    /// hover these would explain the effect of a wrong wiring.
    pub(crate) cost: f64,
    /// Samples of forces and torques.
    samples: f64,
    /// chi² per sample of the torques.
    pub(crate) torque: f64,
    /// Mean over the torque channels of the signed squared correlation of their changes over [`CHANGE_S`], predicted and measured.
    changes: f64,
}

impl Explained {
    /// Whether it leaves as little of the torques unexplained as the right wiring does.
    pub(crate) fn fits(&self) -> bool {
        self.torque < LEFT_CHI2
    }

    /// Whether it follows the changes of the torques better than another. A wrong wiring responds wrongly to every
    /// command; the moment of a steady wind is slow, and an exchange of motors that imitates it misses the changes. A
    /// correlation is used, because with a gain that is off by some tens of per cent the squares of correct changes are
    /// larger than those of none.
    pub(crate) fn moves_better_than(&self, other: &Self) -> bool {
        self.changes > other.changes
    }

    /// What noise alone may do to the cost: it scatters by √(2 n).
    pub(crate) fn scatter(&self) -> f64 {
        6.0 * (2.0 * self.samples).sqrt()
    }
}

/// The gross error that costs least.
pub(crate) fn likeliest(problem: &Problem) -> Option<(Active, Explained)> {
    let plain = without_nuisances(problem);
    let bases = plain
        .logs
        .iter()
        .map(|log| {
            let set = log.predictor.effect_set(&log.nuisances, &[]).ok()?;
            Some(log.predictor.predict(&set, Source::Raw, None))
        })
        .collect::<Option<Vec<Prediction>>>()?;
    let candidates = &problem.library.candidates;
    let wirings: Vec<Active> = (0..candidates.len()).flat_map(|c| variants(problem, c)).collect();
    let mut all: Vec<(Active, Explained)> = wirings
        .into_par_iter()
        .filter_map(|active| {
            let explained = excess(&plain, std::slice::from_ref(&active), Some(&bases))?;
            Some((active, explained))
        })
        .collect();
    all.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
    all.truncate(FITTED);
    let all: Vec<(Active, Explained)> = all
        .into_par_iter()
        .filter_map(|(active, _)| {
            let explained = fitted(problem, std::slice::from_ref(&active))?;
            Some((active, explained))
        })
        .collect();
    all.into_iter().min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
}

/// The likeliest gross error as a start of a fit, if the leading candidates are ones it is mistaken for: on a flight
/// that hardly turns two swapped motors make a small error, and only the evidence decides. A wiring that leaves much of
/// the error is excluded: a constant (the moment of a steady wind, a displaced centre of mass) has the same sign as
/// some exchange of a front and a rear motor.
pub(crate) fn guess(problem: &Problem, leading: &[&'static EffectDeclaration]) -> Option<Trial> {
    let taken_for = |entry: &Candidate| {
        let of = |d: &&EffectDeclaration| d.per_rotor || entry.declaration.confused_with.contains(&d.id);
        matches!(entry.declaration.search.strategy, Strategy::Wiring(_)) && leading.iter().any(of)
    };
    if !problem.active.is_empty() || !problem.library.candidates.iter().any(taken_for) {
        return None;
    }
    let before = fitted(problem, &[])?;
    let (active, after) = likeliest(problem)?;
    (after.fits() && after.moves_better_than(&before) && after.cost < before.cost - before.scatter()).then(|| Trial {
        open: vec![active],
        log_bayes_factor: 0.5 * (before.cost - after.cost),
        charge: None,
        moved: Vec::new(),
    })
}

/// The nuisances as the model has them: fitted to one wiring, they hide another one.
pub(crate) fn without_nuisances(problem: &Problem) -> Problem {
    let mut plain = problem.clone();
    for log in &mut plain.logs {
        log.nuisances = Nuisances::default();
    }
    plain
}

/// A wiring with the nuisances fitted to it.
pub(crate) fn fitted(problem: &Problem, active: &[Active]) -> Option<Explained> {
    let mut wired = problem.clone();
    wired.active = active.to_vec();
    wired.fit_nuisances(Reach::Anywhere).ok()?;
    let mut explained = excess(&wired, active, None)?;
    for log in &wired.logs {
        let rotors = 0..log.predictor.series().rotors;
        explained.cost += rotors
            .map(|i| (log.nuisance(i) / log.nuisance_size(i)).powi(2))
            .sum::<f64>();
    }
    Some(explained)
}

/// Every form of this error; none for an effect that is not a gross error.
fn variants(problem: &Problem, candidate: usize) -> Vec<Active> {
    let entry = &problem.library.candidates[candidate];
    let rotors = problem.logs[0].predictor.series().rotors;
    let one = |values: Vec<f64>| Active {
        candidate,
        values,
        onset_s: None,
    };
    let whole = || vec![1.0; entry.parameters.len()];
    match entry.declaration.search.strategy {
        Strategy::Wiring(Wiring::Single) => vec![one(whole())],
        Strategy::Wiring(Wiring::Pair { partner }) => {
            let Some(place) = entry.declaration.parameter_index(partner) else {
                return Vec::new();
            };
            (entry.rotor.unwrap_or(rotors) + 1..=rotors)
                .map(|partner| {
                    let mut values = whole();
                    values[place] = partner as f64;
                    one(values)
                })
                .collect()
        }
        _ => Vec::new(),
    }
}

/// A wiring with the nuisances unchanged, without their cost.
pub(crate) fn excess(problem: &Problem, active: &[Active], bases: Option<&[Prediction]>) -> Option<Explained> {
    let (mut sum, mut samples, mut torque, mut torque_samples) = (0.0, 0.0, 0.0, 0.0);
    let (mut changes, mut channels) = (0.0, 0.0);
    for (l, log) in problem.logs.iter().enumerate() {
        let predictor = &log.predictor;
        let set = predictor
            .effect_set(&log.nuisances, &instances(&problem.library, active))
            .ok()?;
        // Wiring acts on thrusts and their wrench alone.
        let stages = Stages {
            actuators: true,
            motion: false,
            body: true,
            gravity: false,
            battery: false,
        };
        let prediction = predictor.predict(&set, Source::Raw, bases.map(|bases| (&bases[l], stages)));
        let apart = ((CHANGE_S / predictor.series().step_s).round() as usize).max(1);
        for channel in (F..KV).chain(M..KA) {
            let Some(whitener) = predictor.whitener(channel) else {
                continue;
            };
            let count = (0..whitener.len()).filter(|&k| whitener.counts(k)).count() as f64;
            // What is constant may be the rotors' biases.
            let whitened = predictor.whitened_channel(channel, &prediction);
            let total: f64 = whitened.iter().sum();
            let squares = whitened.iter().map(|x| x * x).sum::<f64>() - total * total / count.max(1.0);
            sum += squares - count;
            samples += count;
            if channel >= M {
                torque += squares;
                torque_samples += count;
                let measured = predictor.measured(channel);
                let correlation = of_changes(apart, &prediction.channels[channel], &measured);
                changes += correlation * correlation.abs();
                channels += 1.0;
            }
        }
    }
    (torque_samples > 0.0).then(|| Explained {
        cost: sum,
        samples,
        torque: torque / torque_samples,
        changes: changes / f64::max(channels, 1.0),
    })
}

/// Correlation of the changes of two signals over this many samples; 0 if one of them is constant.
fn of_changes(apart: usize, a: &[f64], b: &[f64]) -> f64 {
    let (mut both, mut of_a, mut of_b) = (0.0, 0.0, 0.0);
    for (a, b) in a.windows(apart + 1).zip(b.windows(apart + 1)) {
        let (a, b) = (a[apart] - a[0], b[apart] - b[0]);
        if a.is_finite() && b.is_finite() {
            both += a * b;
            of_a += a * a;
            of_b += b * b;
        }
    }
    if of_a > 0.0 && of_b > 0.0 {
        both / (of_a * of_b).sqrt()
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::of_changes;

    #[test]
    fn val_changes_count_and_neither_what_is_constant_nor_the_gain() {
        let a: Vec<f64> = (0..400).map(|k| (0.3 * f64::from(k)).sin()).collect();
        let b: Vec<f64> = a.iter().map(|a| 5.0 + 3.0 * a).collect();
        assert!((of_changes(5, &a, &b) - 1.0).abs() < 1e-12);
        let turned: Vec<f64> = a.iter().map(|a| 2.0 - a).collect();
        assert!((of_changes(5, &a, &turned) + 1.0).abs() < 1e-12);
        let gap: Vec<f64> = b
            .iter()
            .enumerate()
            .map(|(k, b)| if k == 7 { f64::NAN } else { *b })
            .collect();
        assert!((of_changes(5, &a, &gap) - 1.0).abs() < 1e-12);
        assert!(of_changes(5, &a, &vec![1.0; 400]).abs() < 1e-12);
    }
}
