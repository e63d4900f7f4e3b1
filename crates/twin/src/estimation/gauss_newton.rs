//! Gauss–Newton fit of a problem: nuisances and open effects move within their limits, every other parameter follows linearly.
//!
//! The re-ranking keeps the spikes: nuisances and open effects move non-linearly, every other parameter of the library follows
//! linearly. Without the spikes a refined candidate could win by explaining its neighbours' clutter.

use rayon::prelude::*;

use super::columns::{Active, Column, LogState, in_order, instances};
use super::gram::{column_product, residual_product};
use super::normal::not_finite;
use super::normal::{Normal, Posterior};
use super::problem::{Problem, in_pairs, position_of};
use crate::predict::{Nuisances, PredictError};

/// Most Gauss–Newton steps.
const STEPS: usize = 8;

/// A step shorter than this, in posterior deviations, ends the iteration.
const SETTLED: f64 = 0.05;

/// So does one that gains or loses less than this, nats: the columns of the linear parameters are not taken anew, so that steps go on
/// about a maximum that they do not hit, and no decision depends on so little.
const LEAST_GAIN: f64 = 0.1;

/// Most halvings of a step.
const MOST_HALVINGS: i32 = 3;

/// Prior deviation of a parameter that is held at its value.
const HELD: f64 = 1e-6;

/// Prior deviations by which a step must leave a bound to be held there.
const NEAR: f64 = 1e-9;

/// A fitted point.
#[derive(Debug, Clone)]
pub(crate) struct Fitted {
    pub(crate) active: Vec<Active>,
    pub(crate) nuisances: Vec<Nuisances>,
    pub(crate) log_evidence: f64,
    /// Normal matrix at this point without the priors, and where it is.
    normal: Normal,
    position: Vec<f64>,
    /// Posterior deviations of the library's columns, in plausible sizes.
    pub(crate) deviations: Vec<f64>,
}

/// Products of the columns that are taken anew at a point, with all columns of their log and with the residual.
struct Moved {
    /// Of the nuisances that are bent.
    bent: Vec<Vec<f64>>,
    free: Vec<Vec<f64>>,
    gradient: Vec<f64>,
    square_sum: f64,
}

/// The best point of an iteration, and the step that leads away from it.
struct Point {
    /// ln evidence with nuisances and open effects held where they are.
    arrived: f64,
    logs: Vec<LogState>,
    fitted: Fitted,
    step: Vec<f64>,
}

impl Problem {
    /// Fits nuisances and `open` effects; starts at the values of `open`.
    pub(crate) fn fit(&self, open: &[Active]) -> Result<Fitted, PredictError> {
        self.fit_from(open, None)
    }

    /// The same, from another charge of the first log.
    pub(crate) fn fit_from(&self, open: &[Active], charge: Option<f64>) -> Result<Fitted, PredictError> {
        let prior = self.deviations(open);
        let start = self.normal(|_| true);
        let mut logs = self.logs.clone();
        if let (Some(charge), Some(log)) = (charge, logs.first_mut()) {
            log.nuisances.charge = charge;
        }
        let mut active = open.to_vec();
        let free: Vec<usize> = (0..self.library.columns.len())
            .filter(|&j| open.iter().any(|a| a.candidate == self.library.columns[j].candidate))
            .collect();
        let nuisances = self.nuisances();
        let mut held = prior.clone();
        for i in (0..nuisances).chain(free.iter().map(|j| nuisances + j)) {
            held[i] = HELD;
        }
        let mut best: Option<Point> = None;
        let mut shorter = 0;
        for _ in 0..STEPS {
            let position = position_of(&self.library, &logs, &active);
            let normal = match self.moved(&start, &logs, &active, &free) {
                Ok(normal) => normal,
                Err(refused) => {
                    // The step left the range of valid vehicles: take half of it.
                    let Some((from_logs, from_active, step)) = shortened(&best, &mut shorter) else {
                        if best.is_some() {
                            break;
                        }
                        // Nor does the start itself: half way to where the effect does nothing.
                        let Some(last) = active.last_mut().filter(|_| shorter <= MOST_HALVINGS) else {
                            return Err(refused);
                        };
                        let neutral = self.library.candidates[last.candidate].neutral();
                        for (value, neutral) in last.values.iter_mut().zip(neutral) {
                            *value = 0.5 * (*value + neutral);
                        }
                        continue;
                    };
                    (logs, active) = (from_logs, from_active);
                    self.step(&mut logs, &mut active, &free, &step);
                    continue;
                }
            };
            // The prior pulls towards the neutral value, not towards the point of linearisation.
            let shifted = normal.clone().pulled(&position, &prior);
            // Whether a step was good is evaluated at its end, with only the linear parameters following: the evidence
            // about a point promises what the next step may not deliver.
            let weighed = Posterior::new(&shifted, &prior).zip(Posterior::log_evidence_of(&shifted, &held));
            let Some((mut posterior, arrived)) = weighed else {
                match shortened(&best, &mut shorter) {
                    Some((from_logs, from_active, step)) => {
                        (logs, active) = (from_logs, from_active);
                        self.step(&mut logs, &mut active, &free, &step);
                        continue;
                    }
                    None if best.is_some() => break,
                    None => return Err(not_finite()),
                }
            };
            let arrived = arrived - 0.5 * shifted.square_sum;
            let gain = best.as_ref().map_or(f64::INFINITY, |best| arrived - best.arrived);
            let better = gain > 0.0;
            let (base_logs, base_active, step) = if better {
                shorter = 0;
                let evidence = posterior.log_evidence - 0.5 * shifted.square_sum;
                // A parameter that is pushed beyond its limits explains nothing: it is treated as not free.
                let mut pinned = hold_nuisances(&mut posterior, &logs);
                let open = free.iter().map(|&j| (j, nuisances + j));
                pinned.extend(
                    open.filter(|&(j, at)| self.pinned(&active, j, posterior.mean[at]))
                        .map(|(_, at)| at),
                );
                let evidence = if pinned.is_empty() {
                    evidence
                } else {
                    let mut fixed = prior.clone();
                    for &at in &pinned {
                        fixed[at] = HELD;
                    }
                    Posterior::log_evidence_of(&shifted, &fixed).ok_or_else(not_finite)? - 0.5 * shifted.square_sum
                };
                let fitted = Fitted {
                    active: active.clone(),
                    nuisances: logs.iter().map(|log| log.nuisances).collect(),
                    log_evidence: evidence,
                    normal,
                    position,
                    deviations: (0..self.library.columns.len())
                        .map(|j| posterior.covariance.at(nuisances + j, nuisances + j).max(0.0).sqrt())
                        .collect(),
                };
                // What is held has no deviation, and where it stands no step.
                let moved = |i: usize| posterior.mean[i].abs() / posterior.covariance.at(i, i).max(HELD * HELD).sqrt();
                let longest = (0..nuisances)
                    .chain(free.iter().map(|j| nuisances + j))
                    .map(moved)
                    .fold(0.0, f64::max);
                best = Some(Point {
                    arrived,
                    logs: logs.clone(),
                    fitted,
                    step: posterior.mean.clone(),
                });
                if longest < SETTLED || gain < LEAST_GAIN {
                    break;
                }
                (logs.clone(), active.clone(), posterior.mean)
            } else if gain > -LEAST_GAIN {
                break;
            } else {
                match shortened(&best, &mut shorter) {
                    Some(again) => again,
                    None => break,
                }
            };
            (logs, active) = (base_logs, base_active);
            self.step(&mut logs, &mut active, &free, &step);
        }
        best.map(|best| best.fitted)
            .ok_or_else(|| PredictError("the fit made no step".into()))
    }

    /// True if an open parameter is at a limit and is pushed further by a step of its plausible size.
    fn pinned(&self, active: &[Active], column: usize, step: f64) -> bool {
        let column = &self.library.columns[column];
        let entry = &self.library.candidates[column.candidate];
        let Some(one) = active.iter().find(|a| a.candidate == column.candidate) else {
            return false;
        };
        let (low, high) = entry.limits[column.parameter];
        let value = one.values[column.parameter];
        let near = 1e-9 * column.size;
        (value <= low + near && step < 0.0) || (value >= high - near && step > 0.0)
    }

    /// Moves nuisances and the `free` columns.
    fn step(&self, logs: &mut [LogState], active: &mut [Active], free: &[usize], step: &[f64]) {
        let mut at = 0;
        for log in logs {
            for i in 0..log.nuisance_count() {
                log.move_nuisance(i, step[at]);
                at += 1;
            }
        }
        for &j in free {
            let column = &self.library.columns[j];
            for a in active.iter_mut().filter(|a| a.candidate == column.candidate) {
                let value = a.values[column.parameter] + step[at + j] * column.size;
                a.values[column.parameter] = self.library.candidates[a.candidate].clamped(column.parameter, value);
            }
        }
    }

    /// The normal matrix with the free columns and the residual taken anew at a point.
    fn moved(
        &self,
        start: &Normal,
        logs: &[LogState],
        active: &[Active],
        free: &[usize],
    ) -> Result<Normal, PredictError> {
        let mut normal = start.clone();
        normal.gradient.fill(0.0);
        normal.square_sum = 0.0;
        let offset = self.nuisances();
        for &j in free {
            for i in 0..normal.matrix.size() {
                *normal.matrix.at_mut(offset + j, i) = 0.0;
                *normal.matrix.at_mut(i, offset + j) = 0.0;
            }
        }
        let parts = in_pairs(logs, |l, log| self.moved_log(l, log, active, free));
        for (l, part) in parts.into_iter().enumerate() {
            let part = part?;
            let own = logs[l].nuisance_count();
            let bent = logs[l].bent_nuisances();
            for place in bent.clone().map(|which| self.global(l, which)) {
                for i in 0..normal.matrix.size() {
                    *normal.matrix.at_mut(place, i) = 0.0;
                    *normal.matrix.at_mut(i, place) = 0.0;
                }
            }
            for (which, products) in bent.clone().zip(&part.bent) {
                let place = self.global(l, which);
                for (i, product) in products.iter().enumerate() {
                    let b = self.global(l, i);
                    *normal.matrix.at_mut(place, b) = *product;
                    *normal.matrix.at_mut(b, place) = *product;
                }
            }
            for (&j, products) in free.iter().zip(&part.free) {
                for (i, product) in products.iter().enumerate().filter(|(i, _)| !bent.contains(i)) {
                    let (a, b) = (offset + j, self.global(l, i));
                    let twice = i >= own && free.contains(&(i - own));
                    *normal.matrix.at_mut(a, b) += product;
                    if !twice {
                        *normal.matrix.at_mut(b, a) += product;
                    }
                }
            }
            for (i, product) in part.gradient.iter().enumerate() {
                normal.gradient[self.global(l, i)] += product;
            }
            normal.square_sum += part.square_sum;
        }
        Ok(normal)
    }

    /// What one log gives to [`Self::moved`].
    fn moved_log(&self, l: usize, log: &LogState, active: &[Active], free: &[usize]) -> Result<Moved, PredictError> {
        let own = log.nuisance_count();
        let weights = &self.weights[l];
        let bent = log.bent_nuisances();
        let moved: Vec<usize> = bent.clone().chain(free.iter().map(|j| own + j)).collect();
        let effects = instances(&self.library, active);
        let anew = || {
            let base = log.base(&effects)?;
            let column = |&place: &usize| match place.checked_sub(own) {
                None => log.nuisance_column(&effects, &base, place),
                Some(j) => {
                    let column = &self.library.columns[j];
                    log.parameter_column(&self.library, active, &base, column.candidate, column.parameter)
                }
            };
            in_order(moved.par_iter().map(column))
        };
        let (anew, residual) = rayon::join(anew, || log.residual(&effects));
        let (anew, residual) = (anew?, residual?);
        let mut columns: Vec<Column> = self.linear[l].columns.clone();
        for (&place, column) in moved.iter().zip(anew) {
            columns[place] = column;
        }
        let products = |one: &Column| {
            columns
                .iter()
                .map(|other| column_product(one, other, weights))
                .collect()
        };
        Ok(Moved {
            bent: bent.map(|which| products(&columns[which])).collect(),
            free: free.iter().map(|&j| products(&columns[own + j])).collect(),
            gradient: columns
                .iter()
                .map(|column| residual_product(column, &residual, weights))
                .collect(),
            square_sum: residual
                .iter()
                .zip(weights)
                .map(|(r, weight)| weight * r.iter().map(|x| x * x).sum::<f64>())
                .sum(),
        })
    }

    /// Takes the fitted point as the new point of linearisation.
    pub(crate) fn accept(&mut self, fitted: &Fitted) {
        self.active.clone_from(&fitted.active);
        for (log, nuisances) in self.logs.iter_mut().zip(&fitted.nuisances) {
            log.nuisances = *nuisances;
        }
    }
}

impl Fitted {
    /// ln evidence with the last of the open effects as clutter, by the linearisation at this point.
    pub(crate) fn log_evidence_as_clutter(&self, problem: &Problem) -> Result<f64, PredictError> {
        let prior = problem.deviations(&self.active[..self.active.len().saturating_sub(1)]);
        let shifted = self.normal.clone().pulled(&self.position, &prior);
        let evidence = Posterior::log_evidence_of(&shifted, &prior).ok_or_else(not_finite)?;
        Ok(evidence - 0.5 * shifted.square_sum)
    }
}

/// Holds the nuisances that a step would take out of their bounds at these, the others following; their places. In each round those that
/// leave furthest go first: others may stay within once these are held.
fn hold_nuisances(posterior: &mut Posterior, logs: &[LogState]) -> Vec<usize> {
    let mut held: Vec<usize> = Vec::new();
    loop {
        let mut at = 0;
        let mut furthest: Option<(usize, f64, f64)> = None;
        for log in logs {
            for which in 0..log.nuisance_count() {
                let to = log.nuisance_step(which, posterior.mean[at]);
                let beyond = (posterior.mean[at] - to).abs();
                if beyond > NEAR && !held.contains(&at) && furthest.is_none_or(|(_, _, most)| beyond > most) {
                    furthest = Some((at, to, beyond));
                }
                at += 1;
            }
        }
        let Some((place, to, _)) = furthest else {
            return held;
        };
        posterior.hold(place, to);
        held.push(place);
    }
}

/// The best point again with a shorter step from it; `None` once it is short enough.
fn shortened(best: &Option<Point>, shorter: &mut i32) -> Option<(Vec<LogState>, Vec<Active>, Vec<f64>)> {
    *shorter += 1;
    let best = best.as_ref().filter(|_| *shorter <= MOST_HALVINGS)?;
    let factor = 0.5_f64.powi(*shorter);
    let step = best.step.iter().map(|m| m * factor).collect();
    Some((best.logs.clone(), best.fitted.active.clone(), step))
}
