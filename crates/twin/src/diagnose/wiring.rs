//! Gross errors of the build: two motors swapped, a rotor that turns the other way.
//!
//! They are no small deviations: a linear ranking patches them with tilts and scales. There are few of them, so that each is simply
//! tried; one is taken where it removes nearly all of a large error of forces and torques.

use rotortwin_plant::effects::EffectDeclaration;

use super::fit::Problem;
use super::library::Candidate;
use super::linear::{Active, instances};
use super::trials::Trial;
use crate::predict::channels::{F, KA, KV, M};
use crate::predict::{Nuisances, Prediction, Source, Stages};

/// Mean chi² of the torque channels from which a gross error is looked for.
const LARGE_CHI2: f64 = 1.5;
/// Share of the excess chi² that the right wiring leaves at most.
const LEFT_SHARE: f64 = 0.25;
/// Mean chi² of the torque channels that the right wiring leaves at most: rotor biases, not fitted here, make about 1.4 of it. A
/// centre of mass off the middle looks like swapped rotors on a flight that hardly turns, but only to a quarter of its error.
const LEFT_CHI2: f64 = 3.0;

/// The gross error that explains the flights, and half of the chi² that it removes.
pub(crate) fn find(problem: &Problem) -> Option<(Active, f64)> {
    let (before, samples, torque) = excess(problem, &[], None)?;
    if torque < LARGE_CHI2 {
        return None;
    }
    let (active, after, left) = likeliest(problem)?;
    // Noise alone scatters by √(2 n).
    let scatter = 6.0 * (2.0 * samples).sqrt();
    let right = left < LEFT_CHI2 && after < (LEFT_SHARE * before).max(scatter) && before > 4.0 * scatter;
    right.then_some((active, 0.5 * (before - after)))
}

/// The gross error that leaves least, with the excess of chi² and the chi² of the torques that it leaves.
fn likeliest(problem: &Problem) -> Option<(Active, f64, f64)> {
    let bases = problem
        .logs
        .iter()
        .map(|log| {
            let set = log.predictor.effect_set(&Nuisances::default(), &[]).ok()?;
            Some(log.predictor.predict(&set, Source::Raw, None))
        })
        .collect::<Option<Vec<Prediction>>>()?;
    let mut best: Option<(Active, f64, f64)> = None;
    for (candidate, entry) in problem.library.candidates.iter().enumerate() {
        if !entry.columns.iter().all(Option::is_none) {
            continue;
        }
        for active in variants(problem, candidate) {
            let Some((after, _, left)) = excess(problem, std::slice::from_ref(&active), Some(&bases)) else {
                continue;
            };
            if best.as_ref().is_none_or(|(_, least, _)| after < *least) {
                best = Some((active, after, left));
            }
        }
    }
    best
}

/// The likeliest gross error as a start of a fit, where the leading candidates are such that it is taken for: on a flight that
/// hardly turns two swapped motors make a small error, and only the evidence tells.
pub(crate) fn guess(problem: &Problem, leading: &[&'static EffectDeclaration]) -> Option<Trial> {
    let taken_for = |entry: &Candidate| {
        let of = |d: &&EffectDeclaration| d.per_rotor || entry.declaration.confused_with.contains(&d.id);
        entry.columns.iter().all(Option::is_none) && leading.iter().any(of)
    };
    if !problem.active.is_empty() || !problem.library.candidates.iter().any(taken_for) {
        return None;
    }
    let (before, samples, _) = excess(problem, &[], None)?;
    let (active, after, _) = likeliest(problem)?;
    // Noise alone scatters by √(2 n).
    (after < before - 6.0 * (2.0 * samples).sqrt()).then(|| Trial {
        open: vec![active],
        log_bayes_factor: 0.5 * (before - after),
        charge: None,
        moved: Vec::new(),
    })
}

/// Every way to have this error.
fn variants(problem: &Problem, candidate: usize) -> Vec<Active> {
    let entry = &problem.library.candidates[candidate];
    let rotors = problem.logs[0].predictor.series().rotors;
    let one = |values: Vec<f64>| Active {
        candidate,
        values,
        onset_s: None,
    };
    match entry.declaration.parameter_index("partner") {
        None => vec![one(vec![1.0; entry.parameters.len()])],
        Some(place) => (entry.rotor.unwrap_or(rotors) + 1..=rotors)
            .map(|partner| {
                let mut values = vec![1.0; entry.parameters.len()];
                values[place] = partner as f64;
                one(values)
            })
            .collect(),
    }
}

/// Excess of chi² in forces and torques, its samples, and chi² per sample of the torques.
fn excess(problem: &Problem, active: &[Active], bases: Option<&[Prediction]>) -> Option<(f64, f64, f64)> {
    let (mut sum, mut samples, mut torque, mut torque_samples) = (0.0, 0.0, 0.0, 0.0);
    for (l, log) in problem.logs.iter().enumerate() {
        let predictor = &log.predictor;
        let set = predictor
            .effect_set(&Nuisances::default(), &instances(&problem.library, active))
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
        for channel in (F..KV).chain(M..KA) {
            let Some(whitener) = predictor.whitener(channel) else {
                continue;
            };
            let count = (0..whitener.len()).filter(|&k| whitener.counts(k)).count() as f64;
            let squares: f64 = predictor
                .whitened_channel(channel, &prediction)
                .iter()
                .map(|x| x * x)
                .sum();
            sum += squares - count;
            samples += count;
            if channel >= M {
                torque += squares;
                torque_samples += count;
            }
        }
    }
    (torque_samples > 0.0).then(|| (sum, samples, torque / torque_samples))
}
