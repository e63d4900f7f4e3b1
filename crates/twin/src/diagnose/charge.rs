//! Starts of fits of the battery voltage: charge at the start and all effects that show in the voltage together.
//!
//! The open-circuit voltage is a chart with kinks, so a fit that starts at the wrong charge stays there and others than the true
//! effect patch what is left. The voltage is slow: on means of 0.1 s, every charge is tried with the effects fitted to it. What changes
//! the thrust acts by the slope of the rotors' power, taken once.

use rayon::prelude::*;
use rotortwin_plant::effects::{ChannelGroup, ParameterKind};

use super::dense::{Matrix, dot};
use super::evidence::{Posterior, open};
use super::fit::{Fitted, Problem, fitted_residual, position_of};
use super::goodness::{UNEXPLAINED_SCORE, channel_fits};
use super::linear::{Active, instances};
use super::ranking::{Scored, priors};
use super::settle::{move_to, pulled};
use super::trials::{Trial, active_at};
use crate::predict::{PredictError, Prediction, Source, channels::V};

/// Length of a mean, s.
const MEAN_S: f64 = 0.1;
/// Charges tried.
const CHARGES: usize = 25;
/// Deviation of the charge at the start from the one that the first voltage suggests.
const CHARGE_DEVIATION: f64 = 0.25;
/// Most Gauss–Newton steps of a fit, and how many of these move the effect alone.
const MOST_STEPS: usize = 12;
const STEPS_ALONE: usize = 1;
/// Minima that are searched over the charge, most steps of the effect at each charge, and sections of the interval.
const SEARCHED: usize = 3;
const STEPS_AT_CHARGE: usize = 3;
const SECTIONS: usize = 10;
/// Least part of a step that is tried, and least gain of ln posterior for which a fit goes on.
const LEAST_SHARE: f64 = 0.04;
const LEAST_GAIN: f64 = 0.1;
/// Step of the differences in an effect's parameters, plausible sizes.
const EFFECT_STEP: f64 = 0.01;
/// Loss of ln likelihood against the best effect up to which an effect is still fitted.
const WORTH: f64 = 200.0;
/// Most effects that are fitted.
const MOST_EFFECTS: usize = 3;
/// Where the slow voltage has two minima this close, nats, and further apart than a cell, the whole log decides between them.
const MINIMA_GAP: f64 = 30.0;
/// Gain of ln evidence for which the charge moves once all is named.
const LEAST_GAIN_AGAIN: f64 = 1.0;
/// Effects of the battery and of its sensor.
const EFFECTS: [&str; 6] = [
    "voltage-gain",
    "voltage-offset",
    "internal-resistance",
    "battery-rc",
    "battery-capacity",
    "cold-battery",
];

/// True if the voltage is not explained, or an effect of the battery would explain a part of it.
pub(crate) fn wanted(problem: &Problem, posterior: &Posterior, scored: &[Scored], threshold: f64) -> bool {
    let [log] = problem.logs.as_slice() else {
        return false;
    };
    if !log.predictor.has(V) {
        return false;
    }
    let hint = scored
        .iter()
        .any(|s| of_battery(problem, s.candidate) && s.opened.log_bayes_factor > threshold);
    // What scales the thrust may be a wrong voltage in Eq. 19: at the right charge the voltage itself tells.
    let scales = scored
        .iter()
        .filter(|s| s.opened.log_bayes_factor > threshold)
        .any(|s| {
            let declared = problem.library.candidates[s.candidate].declaration;
            declared.confused_with.iter().any(|other| EFFECTS.contains(other))
        });
    if hint || scales {
        return true;
    }
    let residual = fitted_residual(problem, 0, &posterior.mean);
    channel_fits(&log.predictor, &residual)[V].is_some_and(|fit| fit.score() > UNEXPLAINED_SCORE)
}

/// Best charge for each effect of the battery, best effects first. Empty for several logs and where no voltage is tested.
pub(crate) fn starts(problem: &Problem) -> Vec<Trial> {
    let [log] = problem.logs.as_slice() else {
        return Vec::new();
    };
    if !log.predictor.has(V) {
        return Vec::new();
    }
    let Some(rest) = posterior_without_voltage(problem, &[]) else {
        return Vec::new();
    };
    let mut found: Vec<Trial> = (0..problem.library.candidates.len())
        .filter(|&c| of_battery(problem, c))
        .filter(|&c| problem.active.iter().all(|a| a.candidate != c))
        .collect::<Vec<_>>()
        .into_par_iter()
        .filter_map(|c| scan(problem, Some(c), &rest))
        .flatten_iter()
        .collect();
    found.sort_by(|a, b| b.log_bayes_factor.total_cmp(&a.log_bayes_factor));
    let best = found.first().map_or(0.0, |t| t.log_bayes_factor);
    found.retain(|t| t.log_bayes_factor > best - WORTH);
    let mut effects: Vec<usize> = Vec::new();
    for one in &found {
        if !effects.contains(&one.open[0].candidate) {
            effects.push(one.open[0].candidate);
        }
    }
    let of_sensor = |t: &Trial| of_sensor(problem, t.open[0].candidate);
    // Gain and offset of the sensor differ by little; the fit decides between them.
    let leading = &effects[..effects.len().min(MOST_EFFECTS)];
    let leads = |t: &Trial| leading.contains(&t.open[0].candidate);
    let sensor = found.iter().any(|t| leads(t) && of_sensor(t));
    found.retain(|t| leads(t) || (sensor && of_sensor(t)));
    found
}

/// The active effects fitted, from where they stand and from where a search over all charges finds them: what was named one after the
/// other stands where the first of them left the charge, and what is named next must not be but a mend of that.
pub(crate) fn fit_anywhere(problem: &Problem) -> Result<Fitted, PredictError> {
    let here = problem.fit(&problem.active)?;
    Ok(match elsewhere(problem)? {
        Some(there) if there.log_evidence > here.log_evidence => there,
        _ => here,
    })
}

/// Moves to where a search over all charges finds a clearly better fit. Returns true if there is one.
pub(crate) fn look_again(problem: &mut Problem) -> Result<bool, PredictError> {
    let Some(there) = elsewhere(problem)? else {
        return Ok(false);
    };
    let better = there.log_evidence > problem.fit(&problem.active)?.log_evidence + LEAST_GAIN_AGAIN;
    if better {
        move_to(problem, &there)?;
    }
    Ok(better)
}

/// The best fit from a start of a search over all charges; `None` where no effect of the battery was named or its charge is not known
/// from one log.
fn elsewhere(problem: &Problem) -> Result<Option<Fitted>, PredictError> {
    if !may_stand_elsewhere(problem) {
        return Ok(None);
    }
    let rest = posterior_without_voltage(problem, &[]);
    let trials = rest.and_then(|rest| scan(problem, None, &rest)).unwrap_or_default();
    let fits = trials
        .iter()
        .filter_map(|trial| problem.fit_from(&trial.moved, trial.charge).ok());
    Ok(fits.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence)))
}

/// True if an effect of the battery was named and its charge can be searched.
pub(super) fn may_stand_elsewhere(problem: &Problem) -> bool {
    let one_log = problem.logs.len() == 1 && problem.logs[0].predictor.has(V);
    one_log && problem.active.iter().any(|a| of_battery(problem, a.candidate))
}

/// Effects of the battery and of its sensor.
fn of_battery(problem: &Problem, candidate: usize) -> bool {
    EFFECTS.contains(&problem.library.candidates[candidate].declaration.id)
}

/// Errors of the voltage's sensor, of one parameter each.
fn of_sensor(problem: &Problem, candidate: usize) -> bool {
    problem.library.candidates[candidate]
        .declaration
        .id
        .starts_with("voltage-")
}

/// What all other channels say, with the parameters at `opened` as free as the open effects. The priors' pull counts: at the present
/// point biases of the rotors may stand in for the effect in question.
fn posterior_without_voltage(problem: &Problem, opened: &[usize]) -> Option<Posterior> {
    let mut deaf = problem.weights.clone();
    for weights in &mut deaf {
        weights[V] = 0.0;
    }
    let normal = problem.normal_with(&deaf, |_| true);
    let mut prior = problem.deviations(&problem.active);
    for &i in opened {
        prior[i] = 1.0;
    }
    pulled(problem, normal, &prior)
}

/// Effects that a search over the charge moves: the active ones that show in the voltage, and a further one.
fn moving(problem: &Problem, further: Option<usize>) -> Vec<usize> {
    let active = problem.active.iter().map(|a| a.candidate);
    active
        .filter(|&c| shows_in(problem, c, ChannelGroup::Voltage) && !problem.library.columns_of(c).is_empty())
        .chain(further)
        .collect()
}

fn shows_in(problem: &Problem, candidate: usize, channel: ChannelGroup) -> bool {
    let declared = problem.library.candidates[candidate].declaration;
    declared.channels.contains(&channel)
}

/// The active effects with the moving ones at `theta`, plausible sizes from where they do nothing.
fn with_moved(problem: &Problem, moving: &[usize], theta: &[f64]) -> Vec<Active> {
    let mut active = problem.active.clone();
    let mut rest = theta;
    for &candidate in moving {
        let own;
        (own, rest) = rest.split_at(problem.library.columns_of(candidate).len());
        let moved = active_at(problem, candidate, own);
        match active.iter_mut().find(|a| a.candidate == candidate) {
            Some(one) => one.values = moved.values,
            None => active.push(moved),
        }
    }
    active
}

/// The best charge for a further effect, or for the active ones alone, and a second one that is nearly as good.
fn scan(problem: &Problem, further: Option<usize>, rest: &Posterior) -> Option<Vec<Trial>> {
    let log = &problem.logs[0];
    let moving = moving(problem, further);
    let (mut gain, mut places) = (0.0, Vec::new());
    if let Some(further) = further {
        let (own, spikes, slabs) = priors(problem, further);
        gain = open(rest, &own, &spikes, &spikes, &slabs, &vec![0.0; own.len()])?.log_bayes_factor;
        places = own;
    }
    let opened = posterior_without_voltage(problem, &places)?;
    let columns: Vec<usize> = moving.iter().flat_map(|&c| problem.library.columns_of(c)).collect();
    let places: Vec<usize> = columns.iter().map(|j| problem.nuisances() + j).collect();
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    let estimate: Vec<f64> = places.iter().map(|&i| position[i] + opened.mean[i]).collect();
    let prior = opened.covariance.part(&places).cholesky()?.inverse();
    let mut nuisances = log.nuisances;
    for (i, bias) in nuisances
        .rotor_bias_n
        .iter_mut()
        .enumerate()
        .take(log.predictor.series().rotors)
    {
        *bias += opened.mean[problem.global(0, i)] * log.nuisance_size(i);
    }
    let base_at = |theta: &[f64]| -> Option<Prediction> {
        let at_work = with_moved(problem, &moving, theta);
        let set = log
            .predictor
            .effect_set(&nuisances, &instances(&problem.library, &at_work))
            .ok()?;
        Some(log.predictor.predict(&set, Source::Smooth, None))
    };
    let base = base_at(&estimate)?;
    let mut coarse = log.predictor.coarse_voltage(&base, MEAN_S);
    // What changes the thrust changes the current; a wrong reading of the voltage does so through Eq. 19.
    let on_thrust = |j: usize| shows_in(problem, problem.library.columns[j].candidate, ChannelGroup::Force);
    for (place, _) in columns.iter().enumerate().filter(|(_, j)| on_thrust(**j)) {
        let mut next = estimate.clone();
        next[place] += EFFECT_STEP;
        let moved = log.predictor.coarse_voltage(&base_at(&next)?, MEAN_S);
        coarse.slope_towards(&moved, place, 1.0 / EFFECT_STEP);
    }
    let weight = coarse.weight * problem.weights[0][V];
    let predict = |charge: f64, theta: &[f64]| -> Option<Vec<f64>> {
        let mut nuisances = nuisances;
        nuisances.charge = charge;
        let active = with_moved(problem, &moving, theta);
        let set = log
            .predictor
            .effect_set(&nuisances, &instances(&problem.library, &active))
            .ok()?;
        let shift: Vec<f64> = theta.iter().zip(&estimate).map(|(t, e)| t - e).collect();
        Some(log.predictor.coarse_prediction(&set, &base, &coarse, &shift))
    };
    let fit = Fit {
        predict: &predict,
        measured: &coarse.measured,
        weight,
        estimate: &estimate,
        prior: &prior,
    };
    let start: Vec<f64> = columns
        .iter()
        .zip(&places)
        .zip(&estimate)
        .map(|((&j, &place), &estimate)| {
            let column = &problem.library.columns[j];
            if Some(column.candidate) != further {
                return position[place];
            }
            // Without information of their own the sizes start at a tenth: neutral shapes would have no column.
            let declared = &problem.library.candidates[column.candidate].parameters[column.parameter];
            if declared.kind == ParameterKind::Size && estimate.abs() < 0.02 {
                0.1
            } else {
                estimate
            }
        })
        .collect();
    let mut minima = Vec::with_capacity(CHARGES);
    for i in 0..CHARGES {
        let target = (i as f64 + 0.5) / CHARGES as f64;
        let charge = target - log.predictor.initial_charge();
        minima.push(fit.descend(charge, start.clone())?);
    }
    minima.sort_by(|a, b| a.value.total_cmp(&b.value));
    for minimum in minima.iter_mut().take(SEARCHED) {
        if let Some(lower) = fit.searched(minimum).filter(|lower| lower.value < minimum.value) {
            *minimum = lower;
        }
    }
    minima.sort_by(|a, b| a.value.total_cmp(&b.value));
    let first = minima.first()?;
    let second = minima[1..].iter().find(|m| {
        let apart = (m.charge - first.charge).abs() > 1.0 / CHARGES as f64;
        apart && m.value < first.value + MINIMA_GAP
    });
    let trial = |minimum: &Point| {
        let (open, moved) = with_moved(problem, &moving, &minimum.theta)
            .into_iter()
            .partition(|a| Some(a.candidate) == further);
        Trial {
            open,
            moved,
            // Comparable among these trials only.
            log_bayes_factor: gain - minimum.value,
            charge: Some(minimum.charge),
        }
    };
    Some(std::iter::once(first).chain(second).map(trial).collect())
}

/// Means of the voltage at a charge and sizes of the effect; `None` where these make no vehicle.
type Predict<'a> = dyn Fn(f64, &[f64]) -> Option<Vec<f64>> + 'a;

/// Fit of the slow voltage: charge, and the parameters of the moving effects.
struct Fit<'a> {
    predict: &'a Predict<'a>,
    measured: &'a [f64],
    weight: f64,
    /// What the other channels say of the effects: their mean, and the inverse of its covariance.
    estimate: &'a [f64],
    prior: &'a Matrix,
}

/// A point of a fit.
struct Point {
    charge: f64,
    theta: Vec<f64>,
    /// Negative ln posterior.
    value: f64,
    predicted: Vec<f64>,
}

impl Fit<'_> {
    fn at(&self, charge: f64, theta: Vec<f64>) -> Option<Point> {
        let predicted = (self.predict)(charge, &theta)?;
        let misfit: f64 = self
            .measured
            .iter()
            .zip(&predicted)
            .map(|(m, p)| (m - p) * (m - p))
            .sum();
        let off = self.off(&theta);
        let value =
            0.5 * (self.weight * misfit + dot(&off, &self.prior.times(&off)) + (charge / CHARGE_DEVIATION).powi(2));
        Some(Point {
            charge,
            theta,
            value,
            predicted,
        })
    }

    fn off(&self, theta: &[f64]) -> Vec<f64> {
        theta.iter().zip(self.estimate).map(|(t, e)| t - e).collect()
    }

    /// The lowest point within one cell of `charge`: the effect alone first, then both.
    fn descend(&self, charge: f64, theta: Vec<f64>) -> Option<Point> {
        let cell = 1.0 / CHARGES as f64;
        let mut point = self.at(charge, theta)?;
        for iteration in 0..MOST_STEPS {
            let alone = iteration < STEPS_ALONE;
            let Some(move_by) = self.step(&point, alone)? else {
                break;
            };
            // The chart has kinks: where a step overshoots one, a part of it descends.
            let mut share = 1.0;
            let next = loop {
                let at = (point.charge + share * move_by[0]).clamp(charge - cell, charge + cell);
                let mut theta = point.theta.clone();
                for (t, m) in theta.iter_mut().zip(&move_by[1..]) {
                    *t = (*t + share * m.clamp(-1.0, 1.0)).clamp(-4.0, 4.0);
                }
                let next = self.at(at, theta)?;
                if next.value < point.value {
                    break Some(next);
                }
                share *= 0.35;
                if share < LEAST_SHARE {
                    break None;
                }
            };
            let Some(next) = next else {
                if alone {
                    continue;
                }
                break;
            };
            let gain = point.value - next.value;
            point = next;
            if gain < LEAST_GAIN && !alone {
                break;
            }
        }
        Some(point)
    }

    /// The lowest point at a charge, from an effect nearby.
    fn at_charge(&self, charge: f64, theta: &[f64]) -> Option<Point> {
        let mut point = self.at(charge, theta.to_vec())?;
        for _ in 0..STEPS_AT_CHARGE {
            let Some(move_by) = self.step(&point, true)? else { break };
            let theta = point.theta.iter().zip(&move_by[1..]);
            let next = self.at(
                charge,
                theta.map(|(t, m)| (t + m.clamp(-1.0, 1.0)).clamp(-4.0, 4.0)).collect(),
            )?;
            let gain = point.value - next.value;
            if gain <= 0.0 {
                break;
            }
            point = next;
            if gain < LEAST_GAIN {
                break;
            }
        }
        Some(point)
    }

    /// The lowest point about a minimum, searched over the charge: a descent along both stops at a kink of the chart that lies across its
    /// valley. Every quarter of a cell, then a golden section, then a descent again.
    fn searched(&self, about: &Point) -> Option<Point> {
        let quarter = 0.25 / CHARGES as f64;
        let mut best = self.at_charge(about.charge, &about.theta)?;
        for side in [-1.0, 1.0] {
            let mut theta = about.theta.clone();
            for i in 1..=4 {
                let point = self.at_charge(about.charge + side * quarter * f64::from(i), &theta)?;
                theta.clone_from(&point.theta);
                if point.value < best.value {
                    best = point;
                }
            }
        }
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        let (mut low, mut high) = (best.charge - quarter, best.charge + quarter);
        let inner = |low: f64, high: f64| (high - golden * (high - low), low + golden * (high - low));
        let (a, b) = inner(low, high);
        let (mut left, mut right) = (self.at_charge(a, &best.theta)?, self.at_charge(b, &best.theta)?);
        for _ in 0..SECTIONS {
            if left.value < right.value {
                high = right.charge;
                right = left;
                left = self.at_charge(inner(low, high).0, &right.theta)?;
            } else {
                low = left.charge;
                left = right;
                right = self.at_charge(inner(low, high).1, &left.theta)?;
            }
        }
        for point in [left, right] {
            if point.value < best.value {
                best = point;
            }
        }
        self.descend(best.charge, best.theta)
    }

    /// The Gauss–Newton step from a point, charge first; `alone` leaves the charge where it is.
    fn step(&self, point: &Point, alone: bool) -> Option<Option<Vec<f64>>> {
        const CHARGE_STEP: f64 = 1e-3;
        let slope = |high: &[f64], low: &[f64], by: f64| -> Vec<f64> {
            high.iter().zip(low).map(|(h, l)| (h - l) / by).collect()
        };
        // Both sides of where the charge is, which may be a kink.
        let mut jacobian = vec![if alone {
            vec![0.0; point.predicted.len()]
        } else {
            slope(
                &(self.predict)(point.charge + CHARGE_STEP, &point.theta)?,
                &(self.predict)(point.charge - CHARGE_STEP, &point.theta)?,
                2.0 * CHARGE_STEP,
            )
        }];
        for a in 0..point.theta.len() {
            let mut next = point.theta.clone();
            next[a] += EFFECT_STEP;
            jacobian.push(slope(
                &(self.predict)(point.charge, &next)?,
                &point.predicted,
                EFFECT_STEP,
            ));
        }
        let residual: Vec<f64> = self.measured.iter().zip(&point.predicted).map(|(m, p)| m - p).collect();
        let size = jacobian.len();
        let mut h = Matrix::zero(size);
        let mut g = vec![0.0; size];
        for a in 0..size {
            g[a] = self.weight * dot(&jacobian[a], &residual);
            for b in 0..size {
                *h.at_mut(a, b) = self.weight * dot(&jacobian[a], &jacobian[b]);
            }
        }
        let pull = self.prior.times(&self.off(&point.theta));
        for a in 1..size {
            g[a] -= pull[a - 1];
            for b in 1..size {
                *h.at_mut(a, b) += self.prior.at(a - 1, b - 1);
            }
        }
        let stiffness = CHARGE_DEVIATION.powi(-2);
        *h.at_mut(0, 0) += stiffness;
        g[0] -= point.charge * stiffness;
        if alone {
            g[0] = 0.0;
        }
        Some(h.cholesky().map(|factor| factor.solve(&g)))
    }
}
