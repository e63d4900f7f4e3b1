//! Starts of the non-linear fits where the linear ranking about zero does not reach: effects whose shape is unknown, delays of several
//! samples, and effects that act only through another one.
//!
//! * A shape (where a wall stands, how long a rope is) has no column while its effect has no size. Its range is searched on a grid;
//!   each point has a column of its own.
//! * A delay of several samples of a noisy command is not its derivative: a secant over the delay is its column. Nor is a limit of the
//!   duty, which acts on the more samples the lower it is.
//! * Wind does nothing without drag. Drag and wind together are bilinear, thus linear in (k, k w): the columns of the wind are taken
//!   where the drag is at its typical size.
//!
//! The evidence of such columns A on top of the library X with posterior (m, C) under spikes is that of h = AᵀA − AᵀX C XᵀA and
//! g = Aᵀ(r − X m) with slabs of 1.

use rayon::prelude::*;
use rotortwin_plant::effects::ParameterKind;

use super::compass;
use super::dense::Matrix;
use super::evidence::{Posterior, sure_size};
use super::fit::{Problem, fitted_residual, in_pairs};
use super::goodness::channel_fits;
use super::linear::{Active, Base, Column, LogState, column_product, residual_product};
use super::ranking::Scored;
use crate::predict::channels::{F, KA, KV, M};

/// A start of a fit.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    /// Effects that it opens, a companion first.
    pub(crate) open: Vec<Active>,
    /// ln Bayes factor by linear algebra.
    pub(crate) log_bayes_factor: f64,
    /// Charge offset at the start, if not the present one.
    pub(crate) charge: Option<f64>,
    /// The active effects, if they start elsewhere than where they stand.
    pub(crate) moved: Vec<Active>,
}

impl Trial {
    /// What is at work at the start of the fit.
    pub(crate) fn beside(&self, active: &[Active]) -> Vec<Active> {
        let before = if self.moved.is_empty() { active } else { &self.moved };
        before.iter().chain(&self.open).cloned().collect()
    }
}

/// Trials of this round, and the smallest size that shows whatever the shape is, by candidate.
#[derive(Debug, Default)]
pub(crate) struct Trials {
    pub(crate) starts: Vec<Trial>,
    pub(crate) worst_minimum: Vec<(usize, f64)>,
}

/// Gaps between the flight and a wall or ceiling that are tried, m; the last alone says what would show.
const GAPS_M: [f64; 4] = [0.05, 0.3, 0.8, 2.5];
/// Lengths of the secants of a delay and of a limit, plausible sizes.
const DELAYS: [f64; 3] = [0.5, 1.0, 1.5];
const LIMITS: [f64; 3] = [0.5, 1.0, 2.0];
/// Length of the secant of a shape, plausible sizes.
pub(super) const SECANT: f64 = 0.1;
/// Normal score of a channel from which the shapes of its effects are searched.
const SEARCHED_SCORE: f64 = 3.0;

/// How far the flights went along a direction, m.
fn farthest(problem: &Problem, along: impl Fn(&[f64; 3]) -> f64) -> f64 {
    let positions = problem
        .logs
        .iter()
        .flat_map(|log| log.predictor.series().smooth.position.iter());
    positions.map(along).fold(0.0, f64::max)
}

/// How far they went towards a wall at an azimuth, m.
pub(super) fn reach(problem: &Problem, azimuth: f64) -> f64 {
    let (sin, cos) = libm::sincos(azimuth);
    farthest(problem, |p| cos * p[0] + sin * p[1])
}

/// Shapes of a candidate that are tried. With `all` false only those that say what would show.
fn shapes(problem: &Problem, candidate: usize, all: bool) -> Vec<Vec<f64>> {
    let entry = &problem.library.candidates[candidate];
    let base = entry.neutral();
    let place = |name: &str| entry.declaration.parameter_index(name);
    let gaps = if all { &GAPS_M[..] } else { &GAPS_M[3..] };
    let mut found = Vec::new();
    match entry.declaration.id {
        "ceiling-effect" => {
            let Some(height) = place("height_m") else { return found };
            let top = farthest(problem, |p| -p[2]);
            for gap in gaps {
                let mut values = base.clone();
                values[height] = entry.clamped(height, top + gap);
                found.push(values);
            }
        }
        "wall-effect" => {
            let (Some(distance), Some(azimuth)) = (place("distance_m"), place("azimuth_rad")) else {
                return found;
            };
            let directions = if all { 8 } else { 4 };
            for i in 0..directions {
                let angle = -3.0 + std::f64::consts::TAU * f64::from(i) / f64::from(directions);
                let reach = reach(problem, angle);
                for gap in gaps {
                    let mut values = base.clone();
                    values[azimuth] = angle;
                    values[distance] = entry.clamped(distance, reach + gap);
                    found.push(values);
                }
            }
        }
        _ => {
            let shape = |name: &str| place(name).map(|i| (i, entry.parameters[i]));
            for (i, p) in ["length_m", "frequency_hz"].iter().filter_map(|name| shape(name)) {
                if !all {
                    continue;
                }
                let ratio = p.plausible_high / p.plausible_low;
                for step in 0..5 {
                    let mut values = base.clone();
                    values[i] = p.plausible_low * libm::pow(ratio, (f64::from(step) + 0.5) / 5.0);
                    found.push(values);
                }
            }
        }
    }
    found
}

/// Largest normal score of the force and torque channels with the mean of the clutter.
fn searched(problem: &Problem, posterior: &Posterior) -> bool {
    problem.logs.iter().enumerate().any(|(l, log)| {
        let fits = channel_fits(&log.predictor, &fitted_residual(problem, l, &posterior.mean));
        (F..KV)
            .chain(M..KA)
            .any(|c| fits[c].is_some_and(|fit| fit.score() > SEARCHED_SCORE))
    })
}

/// What is tried: a candidate about `values` by a secant of `step` plausible sizes, alone or beside a companion through which it acts.
pub(super) struct Variant {
    pub(super) candidate: usize,
    pub(super) values: Vec<f64>,
    pub(super) step: f64,
    /// At its typical size.
    pub(super) companion: Option<Active>,
}

/// Products of a variant's columns with each other, the residual and the library.
struct Products {
    own: Matrix,
    residual: Vec<f64>,
    library: Vec<Vec<f64>>,
}

/// Evidence of a variant.
pub(super) struct Evidence {
    pub(super) log_bayes_factor: f64,
    pub(super) estimate: Vec<f64>,
    information: f64,
}

impl Products {
    fn of(problem: &Problem, l: usize, columns: &[Column]) -> Self {
        let (linear, weights) = (&problem.linear[l], &problem.weights[l]);
        let mut products = Self {
            own: Matrix::zero(columns.len()),
            residual: Vec::with_capacity(columns.len()),
            library: vec![vec![0.0; problem.size()]; columns.len()],
        };
        for (a, column) in columns.iter().enumerate() {
            products
                .residual
                .push(residual_product(column, &linear.residual, weights));
            for (b, other) in columns.iter().enumerate() {
                *products.own.at_mut(a, b) = column_product(column, other, weights);
            }
            for (i, other) in linear.columns.iter().enumerate() {
                products.library[a][problem.global(l, i)] = column_product(column, other, weights);
            }
        }
        products
    }

    fn add(&mut self, other: &Self) {
        let sum = |own: &mut [f64], more: &[f64]| own.iter_mut().zip(more).for_each(|(own, more)| *own += more);
        sum(&mut self.own.entries, &other.own.entries);
        sum(&mut self.residual, &other.residual);
        for (own, more) in self.library.iter_mut().zip(&other.library) {
            sum(own, more);
        }
    }

    /// See the top of this file.
    fn evidence(mut self, posterior: &Posterior) -> Option<Evidence> {
        let k = self.residual.len();
        let (h, g) = (&mut self.own, &mut self.residual);
        for a in 0..k {
            let row = &self.library[a];
            g[a] -= row.iter().zip(&posterior.mean).map(|(c, m)| c * m).sum::<f64>();
            let spread = posterior.covariance.times(row);
            for b in 0..k {
                *h.at_mut(a, b) -= self.library[b].iter().zip(&spread).map(|(c, s)| c * s).sum::<f64>();
            }
        }
        for a in 0..k {
            let diagonal = h.at_mut(a, a);
            *diagonal = diagonal.max(0.0);
        }
        let factor = h.clone().plus_diagonal(&vec![1.0; k]).cholesky()?;
        let estimate = factor.solve(g);
        let fit: f64 = estimate.iter().zip(g.iter()).map(|(m, g)| m * g).sum();
        Some(Evidence {
            log_bayes_factor: 0.5 * fit - 0.5 * factor.log_determinant(),
            estimate,
            information: h.at(0, 0),
        })
    }
}

/// Products of every variant in one log; `None` where it makes no vehicle. Log by log, because the predictions that secants start from
/// are large.
fn products_in(problem: &Problem, l: usize, log: &LogState, variants: &[Variant]) -> Vec<Option<Products>> {
    let Ok(present) = log.base(&problem.library, &problem.active) else {
        return variants.iter().map(|_| None).collect();
    };
    let mut companions: Vec<&Active> = variants.iter().filter_map(|v| v.companion.as_ref()).collect();
    companions.sort_by_key(|one| one.candidate);
    companions.dedup_by_key(|one| one.candidate);
    let beside: Vec<(usize, Option<Base>)> = companions
        .into_par_iter()
        .map(|one| {
            let mut active = problem.active.clone();
            active.push(one.clone());
            (one.candidate, log.base(&problem.library, &active).ok())
        })
        .collect();
    variants
        .par_iter()
        .map(|variant| {
            let Some(companion) = &variant.companion else {
                let own = columns(problem, log, &present, None, variant)?;
                return Some(Products::of(problem, l, &own));
            };
            let base = beside.iter().find(|(of, _)| *of == companion.candidate)?.1.as_ref()?;
            let alone = Variant {
                candidate: companion.candidate,
                values: problem.library.candidates[companion.candidate].neutral(),
                step: variant.step,
                companion: None,
            };
            let mut own = columns(problem, log, &present, None, &alone)?;
            own.extend(columns(problem, log, base, Some(companion), variant)?);
            Some(Products::of(problem, l, &own))
        })
        .collect()
}

/// Columns of the sizes of a variant's candidate by secants about its values, beside the active effects and `with`.
fn columns(
    problem: &Problem,
    log: &LogState,
    base: &Base,
    with: Option<&Active>,
    variant: &Variant,
) -> Option<Vec<Column>> {
    let parameters = &problem.library.candidates[variant.candidate].parameters;
    let mut active = problem.active.clone();
    active.extend(with.cloned());
    size_places(problem, variant.candidate)
        .into_iter()
        .map(|i| {
            let p = &parameters[i];
            let (low, high) = p.accepted();
            let mut change = variant.step * p.size;
            if change > high || change < low {
                change = -change;
            }
            let mut values = variant.values.clone();
            values[i] += change;
            let mut active = active.clone();
            active.push(Active {
                candidate: variant.candidate,
                values,
                onset_s: None,
            });
            log.secant(&problem.library, &active, base, p.size / change).ok()
        })
        .collect()
}

fn size_places(problem: &Problem, candidate: usize) -> Vec<usize> {
    let entry = &problem.library.candidates[candidate];
    (0..entry.columns.len())
        .filter(|&i| entry.columns[i].is_some() && entry.parameters[i].kind == ParameterKind::Size)
        .collect()
}

/// Values of a candidate at the estimate (in plausible sizes) of its sizes.
pub(super) fn values_at(problem: &Problem, candidate: usize, base: &[f64], estimate: &[f64]) -> Vec<f64> {
    let entry = &problem.library.candidates[candidate];
    let mut values = base.to_vec();
    for (&i, e) in size_places(problem, candidate).iter().zip(estimate) {
        let size = entry.parameters[i].size;
        values[i] = entry.clamped(i, values[i] + e * size);
    }
    values
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
    let secants = |steps: &[f64]| steps.iter().map(|&step| variant((entry.neutral(), step))).collect();
    let mut found: Vec<Variant> = match entry.declaration.id {
        "command-delay" | "imu-latency" => secants(&DELAYS),
        "saturation" => secants(&LIMITS),
        _ => {
            let shapes = shapes(problem, candidate, all).into_iter();
            shapes.map(|values| variant((values, SECANT))).collect()
        }
    };
    let silent = problem.linear.iter().zip(&problem.logs).all(|(linear, log)| {
        let own = log.nuisance_count();
        let mut columns = problem.library.columns_of(candidate).into_iter();
        columns.all(|j| linear.columns[own + j].iter().all(Option::is_none))
    });
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
    trials
        .starts
        .par_iter_mut()
        .filter(|start| start.log_bayes_factor > threshold)
        .for_each(|start| compass::sharpen(problem, posterior, start));
    trials
        .starts
        .sort_by(|a, b| b.log_bayes_factor.total_cmp(&a.log_bayes_factor));
    trials
}

/// Evidence of each variant over all logs; `None` where one of them makes no vehicle.
pub(super) fn weighed(problem: &Problem, posterior: &Posterior, variants: &[Variant]) -> Vec<Option<Evidence>> {
    let mut logs = in_pairs(&problem.logs, |l, log| products_in(problem, l, log, variants)).into_iter();
    let mut sums = logs.next().unwrap_or_default();
    for log in logs {
        for (sum, more) in sums.iter_mut().zip(log) {
            match (sum.as_mut(), more) {
                (Some(sum), Some(more)) => sum.add(&more),
                _ => *sum = None,
            }
        }
    }
    sums.into_iter()
        .map(|products| products.and_then(|products| products.evidence(posterior)))
        .collect()
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
        let shown = sure_size(found.information, 0.02, threshold);
        let id = problem.library.candidates[candidate].declaration.id;
        if matches!(id, "ceiling-effect" | "wall-effect") && shown > 0.0 {
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

/// The plain trial of a candidate at its linear estimate.
pub(crate) fn plain(problem: &Problem, one: &Scored) -> Trial {
    Trial {
        open: vec![active_at(problem, one.candidate, &one.opened.estimate)],
        log_bayes_factor: one.opened.log_bayes_factor,
        charge: None,
        moved: Vec::new(),
    }
}

/// A candidate with all its columns at an estimate, in plausible sizes from where it does nothing.
pub(crate) fn active_at(problem: &Problem, candidate: usize, estimate: &[f64]) -> Active {
    let entry = &problem.library.candidates[candidate];
    let mut values = entry.neutral();
    for (&j, e) in problem.library.columns_of(candidate).iter().zip(estimate) {
        let column = &problem.library.columns[j];
        let value = values[column.parameter] + e * column.size;
        values[column.parameter] = entry.clamped(column.parameter, value);
    }
    Active {
        candidate,
        values,
        onset_s: None,
    }
}
