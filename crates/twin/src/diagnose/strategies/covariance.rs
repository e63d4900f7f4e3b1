//! Gusts: wind that changes at random and acts through a drag that is already known. No column can represent it, but
//! its covariance can.
//!
//! A Kalman filter ([`super::gust_filter`]) gives the likelihood of σ and T; they are named if that beats no gusts, and if
//! * the innovations are white: those of a pendulum or a sloshing tank are not;
//! * no function of velocity and position explains them instead: a tether or another drag law is a force of its own,
//!   not weather.
//!
//! With gusts in the model the drag itself is refitted: their correlation would otherwise make it seem too well known.
//!
//! Limits: the sensitivities are those of a steady wind, so gusts faster than about 0.2 s are underestimated; σ and T
//! are common to all logs.

use rayon::prelude::*;
use rotortwin_plant::effects::{Catalogue, EffectDeclaration, Place, Strategy};

use super::gust_filter::{Filtered, Log, MEAN_S, Mean, SEEN, filter};
use crate::diagnose::considered::holds;
use crate::estimation::clutter::with_clutter;
use crate::estimation::columns::{Active, Column, LogState, instances};
use crate::estimation::dense::dot;
use crate::estimation::normal::{Normal, Posterior};
use crate::estimation::posterior::pulled;
use crate::estimation::problem::{Problem, fitted_residual};
use crate::estimation::whiteness::{self, ChannelFit, UNEXPLAINED_SCORE};
use crate::predict::channels::{F, KV, M};
use crate::predict::noise::white_deviation;
use crate::predict::vectors::{rotation, to_body};
use crate::predict::{CHANNELS, PredictError, Series};

/// The entry of a catalogue whose covariance is tried.
pub(crate) fn declared(catalogue: &Catalogue) -> Option<&'static EffectDeclaration> {
    let mut entries = catalogue.entries().iter().copied();
    entries.find(|entry| entry.search.strategy == Strategy::Covariance)
}

/// The same of the catalogue of a problem.
fn declared_of(problem: &Problem) -> Option<&'static EffectDeclaration> {
    declared(problem.logs.first()?.predictor.catalogue())
}

/// Means that are joined for the test of whiteness.
const JOINED: usize = 3;

/// Least noise level of a whitened channel.
const LEAST_LEVEL: f64 = 0.5;

/// σ in m/s and T in s that are tried.
const RMS_M_S: (f64, f64) = (0.05, 6.0);

const CORRELATION_S: (f64, f64) = (0.15, 20.0);

/// Points of the grid per axis.
const GRID: usize = 10;

/// Evidence over the price of two parameters that gusts must have.
const LEAST_GAIN: f64 = 20.0;

/// Evidence of functions of velocity and place, in addition to the gusts, above which those are not gusts.
const LAW_GAIN: f64 = 15.0;

/// Part of the slow excess of forces and torques that gusts must take away.
const LEAST_SHARE: f64 = 0.9;

/// σ below which air is calm, m/s: a rest of that size is the error of something else (0.07 m/s were named with a wrong
/// model of the yaw).
const CALM_M_S: f64 = 0.1;

/// Gusts that were found.
#[derive(Debug, Clone)]
pub(crate) struct Gusts {
    /// σ, m/s.
    pub(crate) rms_m_s: f64,
    /// T, s.
    pub(crate) correlation_s: f64,
    /// Deviations of both.
    pub(crate) deviations: [f64; 2],
    /// Gain of ln likelihood, less the price of two parameters.
    pub(crate) gain: f64,
    /// Evidence of functions of velocity and place in addition to them.
    law: f64,
    /// Fits of the channels with the gusts in the noise.
    pub(crate) fits: Vec<[Option<ChannelFit>; CHANNELS]>,
    /// Posterior of all linear parameters with the gusts in the noise.
    pub(crate) posterior: Posterior,
}

fn channel_of(seen: usize) -> usize {
    if seen < 3 { F + seen } else { M + seen - 3 }
}

/// The influence of a steady wind along each axis, in addition to some effects.
fn wind_columns(problem: &Problem, log: &LogState, active: &[Active]) -> Result<Vec<Column>, PredictError> {
    let base = log.base(&instances(&problem.library, active))?;
    (0..3)
        .map(|axis| log.wind_column(&problem.library, active, &base, axis))
        .collect()
}

/// The influence of a steady wind in addition to the active effects and the clutter at its mean: columns along each
/// axis, to be summed with their factors; `alone` are those with the active effects only.
fn winds(problem: &Problem, log: &LogState, mean: &[f64], alone: Vec<Column>) -> Vec<(f64, Vec<Column>)> {
    // A gust acts through small errors, too (an inflow that would never be named).
    let acts = |place: &Place| matches!(place, Place::RotorThrust | Place::Force | Place::Torque);
    let (plain, mirrored) = with_clutter(problem, mean, |declared| declared.places.iter().any(acts));
    let Ok(first) = wind_columns(problem, log, &plain) else {
        return vec![(1.0, alone)];
    };
    let mut all = vec![(1.0, first)];
    if let Some(Ok(columns)) = mirrored.map(|active| wind_columns(problem, log, &active)) {
        // Small errors add up: the change due to the mirrored ones is subtracted.
        all.extend([(-1.0, columns), (1.0, alone)]);
    }
    all
}

/// The logs as means, with the wind's sensitivities; `None` where wind does nothing.
fn means(problem: &Problem, mean: &[f64]) -> Result<Option<Vec<Log>>, PredictError> {
    let mut logs = Vec::new();
    for (l, state) in problem.logs.iter().enumerate() {
        let alone = wind_columns(problem, state, &problem.active)?;
        if alone.iter().all(|column| (F..KV).all(|c| column[c].is_none())) {
            return Ok(None);
        }
        let winds = winds(problem, state, mean, alone);
        let residual = fitted_residual(problem, l, mean);
        let series = state.predictor.series();
        let rows = (MEAN_S / series.step_s).round().max(1.0) as usize;
        let laws = laws(state.predictor.series());
        let columns = &problem.linear[l].columns;
        let mut made = Vec::new();
        for start in (0..series.len).step_by(rows) {
            let range = start..(start + rows).min(series.len);
            let mut one = Mean {
                count: [0.0; SEEN],
                wind: [[0.0; 3]; SEEN],
                signals: vec![[0.0; SEEN]; 1 + columns.len() + laws.len()],
            };
            for seen in 0..SEEN {
                let channel = channel_of(seen);
                let Some(whitener) = state.predictor.whitener(channel) else {
                    continue;
                };
                let count = range.clone().filter(|&k| whitener.counts(k)).count();
                // A part of a mean at an edge would need a noise of its own.
                if count < range.len() {
                    continue;
                }
                let per = 1.0 / count as f64;
                let of = |column: &Column| {
                    let values = column[channel].as_ref();
                    values.map_or(0.0, |v| {
                        per * v[range.clone()].iter().map(|&x| f64::from(x)).sum::<f64>()
                    })
                };
                one.count[seen] = count as f64;
                one.wind[seen] =
                    [0, 1, 2].map(|axis| winds.iter().map(|(factor, columns)| factor * of(&columns[axis])).sum());
                one.signals[0][seen] = per * residual[channel][range.clone()].iter().sum::<f64>();
                for (j, column) in columns.iter().enumerate() {
                    one.signals[1 + j][seen] = of(column);
                }
                if seen < 3 {
                    for (j, law) in laws.iter().enumerate() {
                        one.signals[1 + columns.len() + j][seen] =
                            per * law[range.clone()].iter().map(|v| v[seen]).sum::<f64>();
                    }
                }
            }
            made.push(one);
        }
        logs.push(Log {
            means: made,
            // From high differences: the median of the residual itself would take the gusts for noise of the sensor.
            level: std::array::from_fn(|seen| white_deviation(&residual[channel_of(seen)]).max(LEAST_LEVEL)),
        });
    }
    Ok(Some(logs))
}

/// Forces (body axes) that depend on velocity and place: building blocks of a law that is not in the catalogue.
fn laws(series: &Series) -> Vec<Vec<[f64; 3]>> {
    let (v, p, attitude) = (
        &series.smooth.velocity,
        &series.smooth.position,
        &series.smooth.attitude,
    );
    let turned: Vec<[[f64; 3]; 3]> = attitude.iter().map(|&a| rotation(a)).collect();
    let speed = |v: [f64; 3]| dot(&v, &v).sqrt();
    let mut laws: Vec<Vec<[f64; 3]>> = Vec::new();
    for axis in 0..3 {
        let along = |x: f64| {
            let mut force = [0.0; 3];
            force[axis] = x;
            force
        };
        // Drag of any power, of either body axis.
        for power in 0..3 {
            laws.push(
                (0..series.len)
                    .map(|k| along(to_body(&turned[k], v[k])[axis] * speed(v[k]).powi(power)))
                    .collect(),
            );
        }
        // A force along an axis of the world: constant, or a spring.
        laws.push((0..series.len).map(|k| to_body(&turned[k], along(1.0))).collect());
        laws.push(
            (0..series.len)
                .map(|k| to_body(&turned[k], along(p[k][axis])))
                .collect(),
        );
    }
    // A line to the start that grows stiff.
    laws.push(
        (0..series.len)
            .map(|k| to_body(&turned[k], p[k].map(|x| x * speed(p[k]))))
            .collect(),
    );
    laws
}

/// Normal equations of signals `which` against the residual, after the filter; `channels` says which count.
fn normal_of(filtered: &[Filtered], which: std::ops::Range<usize>, channels: std::ops::Range<usize>) -> Normal {
    let n = which.len();
    let mut normal = Normal::zero(n);
    for one in filtered.iter().flat_map(|f| &f.innovations) {
        for c in channels.clone() {
            let r = one[0][c];
            let row: Vec<(usize, f64)> = which
                .clone()
                .map(|s| one[s][c])
                .enumerate()
                .filter(|(_, x)| *x != 0.0)
                .collect();
            for &(i, x) in &row {
                for &(j, y) in &row {
                    *normal.matrix.at_mut(i, j) += x * y;
                }
                normal.gradient[i] += x * r;
            }
            normal.square_sum += r * r;
            normal.samples += 1.0;
        }
    }
    normal
}

/// Gain of ln evidence by the laws in addition to the gusts; each law is scaled to the size of what the gusts explain.
fn law_gain(filtered: &[Filtered], laws: std::ops::Range<usize>) -> f64 {
    let mut normal = normal_of(filtered, laws, 0..3);
    let scale: Vec<f64> = (0..normal.gradient.len())
        .map(|i| (normal.samples / normal.matrix.at(i, i).max(1e-300)).sqrt())
        .collect();
    for (i, a) in scale.iter().enumerate() {
        normal.gradient[i] *= a;
        for (j, b) in scale.iter().enumerate() {
            *normal.matrix.at_mut(i, j) *= a * b;
        }
    }
    Posterior::log_evidence_of(&normal, &vec![1.0; scale.len()]).unwrap_or(0.0)
}

/// Fits of F and M with the gusts in the noise, the others as they are.
fn fits_of(problem: &Problem, mean: &[f64], filtered: &[Filtered]) -> Vec<[Option<ChannelFit>; CHANNELS]> {
    let mut fits = whiteness::fits(problem, mean);
    for (own, filtered) in fits.iter_mut().zip(filtered) {
        for seen in 0..SEEN {
            let Some(fit) = &mut own[channel_of(seen)] else {
                continue;
            };
            let (mut squares, mut count) = (0.0, 0.0);
            for group in filtered.innovations.chunks(JOINED) {
                let sum: f64 = group.iter().map(|one| one[0][seen]).sum();
                squares += sum * sum / group.len() as f64;
                count += if sum == 0.0 { 0.0 } else { 1.0 };
            }
            // Never worse than without the gusts: M is only tested, its slow noise is not that of a mean.
            let slow = fit.means * squares / f64::max(count, 1.0);
            fit.slow = fit.slow.min(slow);
        }
    }
    fits
}

/// Gusts in the remaining residual, if that is what it is: see the top of this file.
pub(crate) fn find(problem: &Problem, posterior: &Posterior) -> Result<Option<Gusts>, PredictError> {
    // Without the velocity the vehicle's own motion through the air passes for wind.
    let held = declared_of(problem).is_some_and(|gusts| {
        let mut logs = problem.logs.iter();
        logs.all(|log| gusts.search.requires.iter().all(|&what| holds(&log.predictor, what)))
    });
    if !held {
        return Ok(None);
    }
    // The drag was fitted as if the gusts were white: once more with them.
    let Some(first) = fitted(problem, posterior)? else {
        return Ok(None);
    };
    let second = fitted(problem, &first.posterior)?;
    Ok(second.filter(|gusts| gusts.is_weather(problem, posterior)))
}

impl Gusts {
    /// Whether it is weather: white innovations, no law of velocity and place in them, and little left.
    fn is_weather(&self, problem: &Problem, posterior: &Posterior) -> bool {
        let before = whiteness::fits(problem, &posterior.mean);
        let excess = |fits: &[[Option<ChannelFit>; CHANNELS]]| -> f64 {
            let all = fits.iter().flat_map(|own| (F..KV).filter_map(|c| own[c]));
            all.map(|fit| fit.slow - fit.means).sum()
        };
        let share = 1.0 - excess(&self.fits) / excess(&before);
        let coloured = self
            .fits
            .iter()
            .any(|own| (F..KV).any(|c| own[c].is_some_and(|fit| fit.score() > 2.0 * UNEXPLAINED_SCORE)));
        self.rms_m_s > CALM_M_S && self.law < LAW_GAIN && share > LEAST_SHARE && !coloured
    }
}

/// The most likely gusts about a mean of the linear parameters, and these fitted anew with them.
fn fitted(problem: &Problem, posterior: &Posterior) -> Result<Option<Gusts>, PredictError> {
    let Some(logs) = means(problem, &posterior.mean)? else {
        return Ok(None);
    };
    let likelihood = |at: [f64; 2]| -> f64 {
        logs.iter()
            .map(|log| filter(log, at[0].exp(), at[1].exp(), false).log_likelihood)
            .sum()
    };
    let none: f64 = logs.iter().map(|log| filter(log, 0.0, 1.0, false).log_likelihood).sum();
    let between = |(low, high): (f64, f64), i: usize| f64::ln(low) + f64::ln(high / low) * i as f64 / (GRID - 1) as f64;
    let best_of = |best: ([f64; 2], f64), points: Vec<[f64; 2]>| {
        let values: Vec<f64> = points.par_iter().map(|&at| likelihood(at)).collect();
        let all = points.into_iter().zip(values);
        all.fold(best, |best, one| if one.1 > best.1 { one } else { best })
    };
    let grid = (0..GRID).flat_map(|i| (0..GRID).map(move |j| [between(RMS_M_S, i), between(CORRELATION_S, j)]));
    let mut best = best_of(([0.0; 2], f64::NEG_INFINITY), grid.collect());
    // Pattern search: the grid is coarse, the peak is round.
    let mut step = 0.25;
    while step > 2e-3 {
        let (at, value) = best;
        let around = [[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]];
        best = best_of(best, around.map(|by| [at[0] + by[0], at[1] + by[1]]).to_vec());
        if best.1 <= value {
            step *= 0.5;
        }
    }
    let (at, value) = best;
    let means: usize = logs.iter().map(|log| log.means.len()).sum();
    let gain = value - none - (means as f64).ln();
    let inside = |x: f64, (low, high): (f64, f64)| x > f64::ln(low) + 0.1 && x < f64::ln(high) - 0.1;
    if gain < LEAST_GAIN || !inside(at[0], RMS_M_S) || !inside(at[1], CORRELATION_S) {
        return Ok(None);
    }
    let filtered: Vec<Filtered> = logs
        .iter()
        .map(|log| filter(log, at[0].exp(), at[1].exp(), true))
        .collect();
    let columns = 1 + problem.linear[0].columns.len();
    let laws = columns..logs[0].means.first().map_or(columns, |m| m.signals.len());
    let law = law_gain(&filtered, laws);
    let fits = fits_of(problem, &posterior.mean, &filtered);
    let Some(posterior) = posterior_with(problem, &filtered, posterior) else {
        return Ok(None);
    };
    let curvature = |a: usize, b: usize| {
        let h = 0.05;
        let moved = |x: f64, y: f64| {
            let mut next = at;
            next[a] += x;
            next[b] += y;
            likelihood(next)
        };
        -(moved(h, h) - moved(h, -h) - moved(-h, h) + moved(-h, -h)) / (4.0 * h * h)
    };
    let (aa, bb, ab) = (curvature(0, 0), curvature(1, 1), curvature(0, 1));
    let determinant = (aa * bb - ab * ab).max(1e-12);
    let (rms_m_s, correlation_s) = (at[0].exp(), at[1].exp());
    Ok(Some(Gusts {
        rms_m_s,
        correlation_s,
        deviations: [
            rms_m_s * (bb / determinant).sqrt(),
            correlation_s * (aa / determinant).sqrt(),
        ],
        gain,
        law,
        fits,
        posterior,
    }))
}

/// All linear parameters fitted anew with the gusts in the noise of the forces; the other channels count as before.
fn posterior_with(problem: &Problem, filtered: &[Filtered], old: &Posterior) -> Option<Posterior> {
    let mut without_forces = problem.weights.clone();
    for weights in &mut without_forces {
        weights[F..KV].fill(0.0);
    }
    let mut normal = problem.normal_with(&without_forces, |_| true);
    for (l, filtered) in filtered.iter().enumerate() {
        let own = problem.linear[l].columns.len();
        let forces = normal_of(std::slice::from_ref(filtered), 1..1 + own, 0..3);
        // The filter saw the residual with the old mean taken off: put it back.
        let mean: Vec<f64> = (0..own).map(|i| old.mean[problem.global(l, i)]).collect();
        let back = forces.matrix.times(&mean);
        for i in 0..own {
            let a = problem.global(l, i);
            normal.gradient[a] += forces.gradient[i] + back[i];
            for j in 0..own {
                *normal.matrix.at_mut(a, problem.global(l, j)) += forces.matrix.at(i, j);
            }
        }
    }
    pulled(problem, normal, &problem.deviations(&problem.active))
}
