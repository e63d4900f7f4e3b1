//! Starts of fits of the battery voltage: charge at the start and a battery effect together.
//!
//! The open-circuit voltage is a chart with kinks, so a fit that starts at the wrong charge stays there and others than the true
//! effect patch what is left. The voltage depends on nothing else that is unknown (the thrust is that of the measured voltage), and it
//! is slow: on means of 0.1 s, every charge is tried with the effect fitted to it.

use rotortwin_plant::effects::ParameterKind;

use super::evidence::{Posterior, open};
use super::fit::{Problem, fitted_residual};
use super::goodness::{UNEXPLAINED_SCORE, channel_fits};
use super::linear::{Active, instances};
use super::ranking::{Scored, priors};
use super::trials::Trial;
use crate::predict::{Source, channels::V};

/// Length of a mean, s.
const MEAN_S: f64 = 0.1;
/// Charges tried.
const CHARGES: usize = 25;
/// Loss of ln likelihood against the best effect up to which an effect is still fitted.
const WORTH: f64 = 200.0;
/// Most effects that are fitted.
const MOST_STARTS: usize = 3;
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
    let hint = scored.iter().any(|s| {
        EFFECTS.contains(&problem.library.candidates[s.candidate].declaration.id)
            && s.opened.log_bayes_factor > threshold
    });
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
    let Some(rest) = posterior_without_voltage(problem) else {
        return Vec::new();
    };
    let mut found: Vec<Trial> = (0..problem.library.candidates.len())
        .filter(|&c| EFFECTS.contains(&problem.library.candidates[c].declaration.id))
        .filter(|&c| problem.active.iter().all(|a| a.candidate != c))
        .filter_map(|c| scan(problem, c, &rest))
        .collect();
    found.sort_by(|a, b| b.log_bayes_factor.total_cmp(&a.log_bayes_factor));
    let best = found.first().map_or(0.0, |t| t.log_bayes_factor);
    found.retain(|t| t.log_bayes_factor > best - WORTH);
    let of_sensor = |t: &Trial| {
        let id = problem.library.candidates[t.open[0].candidate].declaration.id;
        id.starts_with("voltage-")
    };
    // Gain and offset of the sensor differ by little; the fit decides between them.
    let sensor = found[..found.len().min(MOST_STARTS)].iter().any(of_sensor);
    let mut rank = 0;
    found.retain(|t| {
        rank += 1;
        rank <= MOST_STARTS || (sensor && of_sensor(t))
    });
    found
}

/// What all other channels say.
fn posterior_without_voltage(problem: &Problem) -> Option<Posterior> {
    let mut deaf = problem.weights.clone();
    for weights in &mut deaf {
        weights[V] = 0.0;
    }
    let normal = problem.normal_with(&deaf, |_| true);
    Posterior::new(&normal, &problem.deviations(&problem.active))
}

fn scan(problem: &Problem, candidate: usize, rest: &Posterior) -> Option<Trial> {
    let log = &problem.logs[0];
    let entry = &problem.library.candidates[candidate];
    let (places, spikes, slabs) = priors(problem, candidate);
    let others = open(rest, &places, &spikes, &spikes, &slabs, &vec![0.0; places.len()])?;
    let prior = others.covariance.cholesky()?.inverse();
    let columns = problem.library.columns_of(candidate);
    // A wrong reading of the voltage acts through Eq. 19 on the thrust, and through that on the current: taken where the other
    // channels put it.
    let mut at_work = problem.active.clone();
    at_work.push(Active {
        candidate,
        values: columns
            .iter()
            .zip(&others.estimate)
            .fold(entry.neutral(), |mut values, (&j, e)| {
                let column = &problem.library.columns[j];
                let value = values[column.parameter] + e * column.size;
                values[column.parameter] = entry.clamped(column.parameter, value);
                values
            }),
        onset_s: None,
    });
    let base_set = log
        .predictor
        .effect_set(&log.nuisances, &instances(&problem.library, &at_work))
        .ok()?;
    let base = log.predictor.predict(&base_set, Source::Smooth, None);
    let coarse = log.predictor.coarse_voltage(&base, MEAN_S);
    let weight = coarse.weight * problem.weights[0][V];
    let predict = |charge: f64, theta: &[f64]| -> Option<Vec<f64>> {
        let mut nuisances = log.nuisances;
        nuisances.charge = charge;
        let mut values = entry.neutral();
        for (a, &j) in columns.iter().enumerate() {
            let column = &problem.library.columns[j];
            values[column.parameter] =
                entry.clamped(column.parameter, values[column.parameter] + theta[a] * column.size);
        }
        let mut active = problem.active.clone();
        active.push(Active {
            candidate,
            values,
            onset_s: None,
        });
        let set = log
            .predictor
            .effect_set(&nuisances, &instances(&problem.library, &active))
            .ok()?;
        Some(log.predictor.coarse_prediction(&set, &base, &coarse))
    };
    let k = columns.len();
    let mut best: Option<(f64, f64, Vec<f64>)> = None;
    for i in 0..CHARGES {
        let target = (i as f64 + 0.5) / CHARGES as f64;
        let charge = target - log.predictor.initial_charge();
        let mut theta = others.estimate.clone();
        for (t, &j) in theta.iter_mut().zip(&columns) {
            // Without information of their own the sizes start at a tenth: neutral shapes would have no column.
            let column = &problem.library.columns[j];
            let size = entry.parameters[column.parameter].kind == ParameterKind::Size;
            if size && t.abs() < 0.02 {
                *t = 0.1;
            }
        }
        let mut at = charge;
        let mut objective = f64::INFINITY;
        for _ in 0..4 {
            let now = predict(at, &theta)?;
            let residual: Vec<f64> = coarse.measured.iter().zip(&now).map(|(m, p)| m - p).collect();
            // Unknowns: charge within its cell, then the effect's.
            let mut jacobian = Vec::with_capacity(k + 1);
            let step = 1e-3;
            let moved = predict(at + step, &theta)?;
            jacobian.push(
                moved
                    .iter()
                    .zip(&now)
                    .map(|(a, b)| (a - b) / step)
                    .collect::<Vec<f64>>(),
            );
            for a in 0..k {
                let mut next = theta.clone();
                next[a] += 0.01;
                let moved = predict(at, &next)?;
                jacobian.push(moved.iter().zip(&now).map(|(a, b)| (a - b) / 0.01).collect());
            }
            let mut h = super::dense::Matrix::zero(k + 1);
            let mut g = vec![0.0; k + 1];
            let dot = |a: &[f64], b: &[f64]| weight * a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            for a in 0..=k {
                g[a] = dot(&jacobian[a], &residual);
                for b in 0..=k {
                    *h.at_mut(a, b) = dot(&jacobian[a], &jacobian[b]);
                }
            }
            let off: Vec<f64> = theta.iter().zip(&others.estimate).map(|(t, e)| t - e).collect();
            let pull = prior.times(&off);
            for a in 0..k {
                g[a + 1] -= pull[a];
                for b in 0..k {
                    *h.at_mut(a + 1, b + 1) += prior.at(a, b);
                }
            }
            // The charge: plausible as declared, and here at most one cell from its grid point.
            *h.at_mut(0, 0) += 1.0 / (0.25 * 0.25);
            g[0] -= at / (0.25 * 0.25);
            let value = 0.5 * dot(&residual, &residual)
                + 0.5 * off.iter().zip(&pull).map(|(o, p)| o * p).sum::<f64>()
                + 0.5 * (at / 0.25) * (at / 0.25);
            if value < objective {
                objective = value;
                if best.as_ref().is_none_or(|b| value < b.0) {
                    best = Some((value, at, theta.clone()));
                }
            }
            let Some(factor) = h.cholesky() else { break };
            let move_by = factor.solve(&g);
            let half = 1.0 / CHARGES as f64;
            at = (at + move_by[0]).clamp(charge - half, charge + half);
            for (t, m) in theta.iter_mut().zip(&move_by[1..]) {
                *t = (*t + m.clamp(-1.0, 1.0)).clamp(-4.0, 4.0);
            }
        }
    }
    let (objective, charge, theta) = best?;
    let mut values = entry.neutral();
    for (a, &j) in columns.iter().enumerate() {
        let column = &problem.library.columns[j];
        values[column.parameter] = entry.clamped(column.parameter, values[column.parameter] + theta[a] * column.size);
    }
    Some(Trial {
        open: vec![Active {
            candidate,
            values,
            onset_s: None,
        }],
        // Comparable among these trials only.
        log_bayes_factor: others.log_bayes_factor - objective,
        charge: Some(charge),
    })
}
