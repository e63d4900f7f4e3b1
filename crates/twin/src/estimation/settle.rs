//! The point of a diagnosis: moving it to a fit, which channels to trust there, and the posterior about it.

use super::columns::Active;
use super::gauss_newton::Fitted;
use super::normal::Posterior;
use super::posterior::posterior_of;
use super::problem::{Problem, fitted_residual, position_of};
use super::rate_noise;
use super::whiteness::{channel_fits, weights};
use crate::predict::{CHANNELS, PredictError};

/// Scales of the clutter over which the final values are averaged.
const CLUTTER_SCALES: [f64; 5] = [0.1, 0.2, 0.4, 0.7, 1.0];

/// Step in posterior deviations from which a point is fitted anew, and how often.
const SETTLED_DEVIATIONS: f64 = 1.5;

const MOST_SETTLINGS: usize = 2;

/// Accepts a fit, linearises about it, and reassesses which channels to trust.
pub(crate) fn move_to(problem: &mut Problem, fitted: &Fitted) -> Result<(), PredictError> {
    problem.accept(fitted);
    problem.linearise(&|_| ())?;
    trust(problem);
    Ok(())
}

/// Lowers the trust in channels that even the whole library with wide priors leaves coloured, once the noise of the rates is known.
pub(crate) fn trust(problem: &mut Problem) {
    rate_noise::tune(problem);
    for one in &mut problem.weights {
        *one = [1.0; CHANNELS];
    }
    let normal = problem.normal(|_| true);
    let wide = vec![1.0; problem.size()];
    if let Some(posterior) = Posterior::new(&normal, &wide) {
        for l in 0..problem.logs.len() {
            let fits = channel_fits(
                &problem.logs[l].predictor,
                &fitted_residual(problem, l, &posterior.mean),
            );
            problem.weights[l] = weights(&fits);
        }
    }
}

/// Posterior about a converged point: if the linearisation moves the effects or the nuisances further than their
/// deviation, they are fitted and linearised anew.
pub(crate) fn settled(problem: &mut Problem) -> Result<(Posterior, Vec<f64>), PredictError> {
    for _ in 0..MOST_SETTLINGS {
        let (posterior, deviations) = posterior_of(problem)?;
        let offset = problem.nuisances();
        let active = problem.library.columns.iter().enumerate().filter(|(_, column)| {
            let of = |a: &Active| a.candidate == column.candidate;
            problem.active.iter().any(of)
        });
        let beyond =
            |i: usize, step: f64| step.abs() > SETTLED_DEVIATIONS * posterior.covariance.at(i, i).max(0.0).sqrt();
        // A nuisance at its bound moves no further, whatever the gradient.
        let nuisances = problem
            .logs
            .iter()
            .flat_map(|log| (0..log.nuisance_count()).map(move |which| (log, which)));
        let far = nuisances
            .enumerate()
            .any(|(i, (log, which))| beyond(i, log.nuisance_step(which, posterior.mean[i])))
            || active.map(|(j, _)| offset + j).any(|i| beyond(i, posterior.mean[i]));
        if !far || problem.active.is_empty() {
            return Ok((posterior, deviations));
        }
        let fitted = problem.fit(&problem.active)?;
        move_to(problem, &fitted)?;
    }
    posterior_of(problem)
}

/// Posterior averaged over how far real vehicles are off their nominal values: the clutter's prior times [`CLUTTER_SCALES`], each by
/// its evidence. Where the flight shows no clutter, a finding is known better than where it does. Errors of the file's constants keep
/// their prior: a flight tells little about them, so that its evidence would take a file for exact that nobody wrote exactly.
pub(crate) fn averaged(problem: &Problem) -> Option<Posterior> {
    let mut normal = problem.normal(|_| true);
    let prior = problem.deviations(&problem.active);
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    let plain = normal.gradient.clone();
    // An effect may really be absent; no file has its constants exactly.
    let offset = problem.nuisances();
    let is_constant = |i: usize| {
        i.checked_sub(offset).is_some_and(|j| {
            let column = &problem.library.columns[j];
            let candidate = &problem.library.candidates[column.candidate];
            candidate.parameters[column.parameter].corrects.is_some()
        })
    };
    let mut all: Vec<(f64, Posterior)> = Vec::new();
    for scale in CLUTTER_SCALES {
        let shrinks = |(i, d): (usize, &f64)| if *d < 1.0 && !is_constant(i) { d * scale } else { *d };
        let scaled: Vec<f64> = prior.iter().enumerate().map(shrinks).collect();
        for (i, g) in normal.gradient.iter_mut().enumerate() {
            *g = plain[i] - position[i] / (scaled[i] * scaled[i]);
        }
        // The evidence is that about the point, so that the pull towards 0 counts there, too.
        let penalty: f64 = position.iter().zip(&scaled).map(|(x, d)| (x / d) * (x / d)).sum();
        let posterior = Posterior::new(&normal, &scaled)?;
        all.push((posterior.log_evidence - 0.5 * penalty, posterior));
    }
    let best = all.iter().map(|(e, _)| *e).fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = all.iter().map(|(e, _)| (e - best).exp()).collect();
    let total: f64 = weights.iter().sum();
    let (_, mut mixed) = all[0].clone();
    for (i, mean) in mixed.mean.iter_mut().enumerate() {
        *mean = all.iter().zip(&weights).map(|((_, p), w)| w * p.mean[i]).sum::<f64>() / total;
    }
    for i in 0..mixed.mean.len() {
        for j in 0..mixed.mean.len() {
            let of = |(_, p): &(f64, Posterior)| {
                p.covariance.at(i, j) + (p.mean[i] - mixed.mean[i]) * (p.mean[j] - mixed.mean[j])
            };
            let value = all.iter().zip(&weights).map(|(one, w)| w * of(one)).sum::<f64>() / total;
            *mixed.covariance.at_mut(i, j) = value;
        }
    }
    Some(mixed)
}
