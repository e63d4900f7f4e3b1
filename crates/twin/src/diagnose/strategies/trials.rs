//! Starts of the non-linear fits where the linear ranking about zero does not reach: effects whose shape is unknown, delays of several
//! samples, and effects that act only through another one.
//!
//! * A delay of several samples of a noisy command is not its derivative: a secant over the delay is its column. The
//!   same holds for a limit of the duty, which acts on more samples the lower it is.
//! * Wind does nothing without drag. Drag and wind together are bilinear, thus linear in (k, k w): the columns of the wind are taken
//!   where the drag is at its typical size.

use rayon::prelude::*;
use rotortwin_plant::effects::Strategy;

use super::along;
use super::shapes::{SECANT, shapes, sharpen};
use super::start::Trial;
use super::variants::{Evidence, Variant, size_places, values_at, weighed};
use crate::estimation::columns::Active;
use crate::estimation::normal::{Posterior, detectable_size};
use crate::estimation::problem::{Problem, fitted_residual};
use crate::estimation::whiteness::channel_fits;
use crate::predict::channels::{F, KA, KV, M};

/// Trials of this round, and the smallest size that shows whatever the shape is, by candidate.
#[derive(Debug, Default)]
pub(crate) struct Trials {
    pub(crate) starts: Vec<Trial>,
    pub(crate) worst_minimum: Vec<(usize, f64)>,
}

/// Normal score of a channel from which the shapes of its effects are searched.
const SEARCHED_SCORE: f64 = 3.0;

/// Largest normal score of the force and torque channels with the mean of the clutter.
fn searched(problem: &Problem, posterior: &Posterior) -> bool {
    problem.logs.iter().enumerate().any(|(l, log)| {
        let fits = channel_fits(&log.predictor, &fitted_residual(problem, l, &posterior.mean));
        (F..KV)
            .chain(M..KA)
            .any(|c| fits[c].is_some_and(|fit| fit.score() > SEARCHED_SCORE))
    })
}

/// What is tried with a candidate: its shapes or delays, and, if it does nothing alone, each effect through which it can act.
fn variants(problem: &Problem, candidate: usize, all: bool) -> Vec<Variant> {
    let entry = &problem.library.candidates[candidate];
    let variant = |(values, step)| Variant {
        candidate,
        values,
        step,
        companion: None,
    };
    let mut found: Vec<Variant> = match entry.declaration.search.strategy {
        Strategy::Secants(steps) => steps.iter().map(|&step| variant((entry.neutral(), step))).collect(),
        Strategy::Shapes(covered) => {
            let shapes = shapes(problem, candidate, covered, all).into_iter();
            shapes.map(|values| variant((values, SECANT))).collect()
        }
        _ => Vec::new(),
    };
    let silent = problem.linear.iter().zip(&problem.logs).all(|(linear, log)| {
        let own = log.nuisance_count();
        let mut columns = problem.library.columns_of(candidate).into_iter();
        columns.all(|j| linear.columns[own + j].iter().all(Option::is_none))
    });
    if entry.declaration.search.strategy == Strategy::OfAnother {
        return found;
    }
    let needs = entry.declaration.needs;
    let others = problem.library.candidates.iter().enumerate();
    for (companion, other) in others.filter(|(_, other)| silent && needs.contains(&other.declaration.id)) {
        let mut typical = other.neutral();
        for i in size_places(problem, companion) {
            typical[i] = other.parameters[i].size;
        }
        found.push(Variant {
            companion: Some(Active {
                candidate: companion,
                values: typical,
                onset_s: None,
            }),
            ..variant((entry.neutral(), SECANT))
        });
    }
    found
}

/// All trials of a round.
pub(crate) fn trials(problem: &Problem, posterior: &Posterior, threshold: f64) -> Trials {
    let all = searched(problem, posterior);
    let variants: Vec<Variant> = (0..problem.library.candidates.len())
        .filter(|&c| problem.active.iter().all(|a| a.candidate != c) && !size_places(problem, c).is_empty())
        .flat_map(|c| variants(problem, c, all))
        .collect();
    let mut trials = Trials::default();
    for (variant, found) in variants.iter().zip(weighed(problem, posterior, &variants)) {
        if let Some(found) = found {
            trials.add(problem, variant, &found, threshold);
        }
    }
    trials.starts.extend(along::starts(problem, posterior));
    trials
        .starts
        .par_iter_mut()
        .filter(|start| start.log_bayes_factor > threshold)
        .for_each(|start| sharpen(problem, posterior, start));
    trials
        .starts
        .sort_by(|a, b| b.log_bayes_factor.total_cmp(&a.log_bayes_factor));
    trials
}

impl Trials {
    /// Keeps the best of a candidate's shapes, and each companion.
    fn add(&mut self, problem: &Problem, variant: &Variant, found: &Evidence, threshold: f64) {
        let candidate = variant.candidate;
        let at = |of: usize, values: &[f64], estimate: &[f64]| Active {
            candidate: of,
            values: values_at(problem, of, values, estimate),
            onset_s: None,
        };
        let trial = |open| Trial {
            open,
            log_bayes_factor: found.log_bayes_factor,
            charge: None,
            moved: Vec::new(),
        };
        if let Some(companion) = &variant.companion {
            let other = companion.candidate;
            let (a, b) = found.estimate.split_at(size_places(problem, other).len());
            // k = a k_typical, k w = b k_typical w_size.
            let scale = if a[0].abs() > 0.05 { 1.0 / a[0] } else { 0.0 };
            let b: Vec<f64> = b.iter().map(|b| b * scale).collect();
            let neutral = problem.library.candidates[other].neutral();
            self.starts
                .push(trial(vec![at(other, &neutral, a), at(candidate, &variant.values, &b)]));
            return;
        }
        let shown = detectable_size(found.information, 0.02, threshold);
        let strategy = problem.library.candidates[candidate].declaration.search.strategy;
        if matches!(strategy, Strategy::Shapes(shapes) if shapes.is_surface()) && shown > 0.0 {
            match self.worst_minimum.iter_mut().find(|(of, _)| *of == candidate) {
                Some((_, worst)) => *worst = worst.max(shown),
                None => self.worst_minimum.push((candidate, shown)),
            }
        }
        let one = trial(vec![at(candidate, &variant.values, &found.estimate)]);
        let same = |t: &&mut Trial| matches!(t.open.as_slice(), [only] if only.candidate == candidate);
        match self.starts.iter_mut().find(same) {
            Some(best) if one.log_bayes_factor > best.log_bayes_factor => *best = one,
            Some(_) => {}
            None => self.starts.push(one),
        }
    }
}
