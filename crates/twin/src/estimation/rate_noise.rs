//! The noise of the measured rates, estimated together with the parameters.
//!
//! A controller commands −K times the gyro's reading, including its noise. The angular acceleration that follows from
//! differences of the same readings contains that noise, too, so that command and acceleration correlate by K σ²/Δt
//! even with a complete model. Using only past readings does not remove this; innovations of a filter with the correct
//! gain do, because no earlier reading predicts them. The gain is that of the most likely noise
//! ([`RateNoise::most_likely`]): of the readings, of a white torque and of a drifting one, axis by axis.
//!
//! Noise and parameters are estimated alternately: noise from the residual with wide priors on all parameters,
//! parameters with that noise. When an effect is named, the possible exchange between the two is taken into account
//! ([`shift`]).
//!
//! Limits: only rates are filtered. Where the controller is fed an attitude with more information about the rate than
//! the gyro has, it predicts the innovations.

use std::sync::Arc;

use rayon::prelude::*;

use super::normal::Posterior;
use super::posterior::posterior_of;
use super::problem::{Problem, fitted_residual};
use crate::predict::channels::M;
use crate::predict::{RateNoise, Whitener};

/// Most turns of noise and parameters.
const TURNS: usize = 4;
/// Change of ln likelihood, summed over logs and axes, from which another turn is taken.
const LEAST_GAIN: f64 = 0.5;

/// Residual of the rate about each axis, h r, rad/s, NaN where masked; empty where there is none.
fn rates(problem: &Problem, log: usize, mean: &[f64]) -> [Vec<f64>; 3] {
    let predictor = &problem.logs[log].predictor;
    let step_s = predictor.series().step_s;
    let mut residual = fitted_residual(problem, log, mean);
    std::array::from_fn(|axis| {
        let Some(whitener) = predictor.whitener(M + axis) else {
            return Vec::new();
        };
        let mut own = std::mem::take(&mut residual[M + axis]);
        whitener.undo(&mut own);
        own.iter_mut().for_each(|r| *r *= step_s);
        own
    })
}

/// The most likely noise of every log about every axis, and its gain in ln likelihood over the present one.
fn most_likely(problem: &Problem, mean: &[f64]) -> Vec<([RateNoise; 3], f64)> {
    (0..problem.logs.len())
        .into_par_iter()
        .map(|log| {
            let rates = rates(problem, log, mean);
            let axes: Vec<(RateNoise, f64)> = rates
                .par_iter()
                .enumerate()
                .map(|(axis, rates)| {
                    let now = problem.logs[log].predictor.rate_noise(axis);
                    if rates.is_empty() {
                        return (now, 0.0);
                    }
                    let best = now.most_likely(rates);
                    (best, best.log_likelihood(rates).0 - now.log_likelihood(rates).0)
                })
                .collect();
            let gain = axes.iter().map(|(_, gain)| gain).sum();
            ([0, 1, 2].map(|axis| axes[axis].0), gain)
        })
        .collect()
}

/// Estimates the noise of the rates, and whitens the angular accelerations anew.
pub(crate) fn tune(problem: &mut Problem) {
    // First the most likely noise without any effect: a vehicle that lacks nothing reaches its noise immediately.
    let Ok((spikes, _)) = posterior_of(problem) else {
        return;
    };
    let mut mean = spikes.mean;
    for _ in 0..TURNS {
        let found = most_likely(problem, &mean);
        let gain: f64 = found.iter().map(|(_, gain)| gain).sum();
        if gain < LEAST_GAIN {
            return;
        }
        for (log, (noise, _)) in found.into_iter().enumerate() {
            whiten_anew(problem, log, noise);
        }
        let wide = vec![1.0; problem.size()];
        let Some(posterior) = Posterior::new(&problem.normal(|_| true), &wide) else {
            return;
        };
        mean = posterior.mean;
    }
}

/// The linearised angular accelerations of a log with other noise.
fn whiten_anew(problem: &mut Problem, log: usize, noise: [RateNoise; 3]) {
    let state = &mut problem.logs[log];
    let old: [Option<Whitener>; 3] = std::array::from_fn(|axis| state.predictor.whitener(M + axis).cloned());
    for (axis, noise) in noise.into_iter().enumerate() {
        state.predictor.tune(axis, noise);
    }
    let linear = Arc::make_mut(&mut problem.linear[log]);
    let predictor = &problem.logs[log].predictor;
    let anew = |axis: usize, whitened: &mut [f64]| {
        if let (Some(old), Some(new)) = (&old[axis], predictor.whitener(M + axis)) {
            old.undo(whitened);
            new.apply(whitened);
        }
    };
    for axis in 0..3 {
        anew(axis, &mut linear.residual[M + axis]);
    }
    linear.columns.par_iter_mut().for_each(|column| {
        if (0..3).all(|axis| column[M + axis].is_none()) {
            return;
        }
        let column = Arc::make_mut(column);
        for axis in 0..3 {
            if let Some(own) = &mut column[M + axis] {
                let mut wide: Vec<f64> = own.iter().map(|&x| f64::from(x)).collect();
                anew(axis, &mut wide);
                own.iter_mut().zip(&wide).for_each(|(x, &w)| *x = w as f32);
            }
        }
    });
    for axis in 0..3 {
        linear.blocks[M + axis] = problem.logs[log].channel_blocks(M + axis, &linear.columns, &linear.residual);
    }
}

/// What the present noise gives to an effect too much, nats: how much more the model without it (`without`) gains from noise of its own than
/// the model with it (`with`) does; posterior means about the present point. Never less than nothing.
pub(crate) fn shift(problem: &Problem, without: &[f64], with: &[f64]) -> f64 {
    let gain = |mean: &[f64]| -> f64 {
        let all = most_likely(problem, mean);
        let trust = |log: usize| (0..3).map(|axis| problem.weights[log][M + axis]).fold(1.0, f64::min);
        all.iter().enumerate().map(|(log, (_, gain))| trust(log) * gain).sum()
    };
    (gain(without) - gain(with)).max(0.0)
}
