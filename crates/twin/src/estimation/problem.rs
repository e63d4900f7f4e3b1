//! The problem of a diagnosis: several logs with their nuisances, effects with open priors, all others as clutter.

use std::sync::Arc;

use rayon::prelude::*;

use super::candidates::Library;
use super::columns::{Active, LogState, instances};
use super::linearisation::{Linear, accumulate};
use super::normal::Normal;
use super::nuisances::{self, Reach};
use crate::predict::{CHANNELS, PerChannel, PredictError};

/// Everything that a fit needs.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    pub(crate) library: Library,
    pub(crate) logs: Vec<LogState>,
    /// Shared: a copy of a problem starts from the same linearisation.
    pub(crate) linear: Vec<Arc<Linear>>,
    pub(crate) active: Vec<Active>,
    /// Trust in each channel of each log: 1 unless its noise is larger or slower than assumed.
    pub(crate) weights: Vec<[f64; CHANNELS]>,
}

impl Problem {
    /// Nuisances of all logs come first.
    pub(crate) fn nuisances(&self) -> usize {
        self.logs.iter().map(LogState::nuisance_count).sum()
    }

    /// Place of a log's own column in the whole problem.
    pub(crate) fn global(&self, log: usize, column: usize) -> usize {
        let own = self.logs[log].nuisance_count();
        if column < own {
            log * own + column
        } else {
            self.nuisances() + column - own
        }
    }

    /// Number of unknowns.
    pub(crate) fn size(&self) -> usize {
        self.nuisances() + self.library.columns.len()
    }

    /// Normal matrix of the blocks taken.
    pub(crate) fn normal(&self, take: impl Fn(usize) -> bool) -> Normal {
        self.normal_with(&self.weights, take)
    }

    /// The same with other weights.
    pub(crate) fn normal_with(&self, weights: &[[f64; CHANNELS]], take: impl Fn(usize) -> bool) -> Normal {
        let mut normal = Normal::zero(self.size());
        for (log, linear) in self.linear.iter().enumerate() {
            accumulate(
                &mut normal,
                linear,
                &weights[log],
                |column| self.global(log, column),
                &take,
            );
        }
        normal
    }

    /// Prior deviations: nuisances 1, open effects 1, the rest at their spikes.
    pub(crate) fn deviations(&self, open: &[Active]) -> Vec<f64> {
        let mut deviations = vec![1.0; self.nuisances()];
        for column in &self.library.columns {
            let is_open = open.iter().any(|a| a.candidate == column.candidate);
            deviations.push(if is_open { 1.0 } else { column.spike });
        }
        deviations
    }

    /// Linearises every log about the present point, one after the other: each takes all cores for its columns.
    pub(crate) fn linearise(&mut self, progress: &(dyn Fn(f64) + Sync)) -> Result<(), PredictError> {
        // The columns of ten logs are a GiB: the old ones go before the new ones come.
        self.linear = Vec::new();
        let count = self.logs.len() as f64;
        let logs = self.logs.iter().enumerate();
        self.linear = logs
            .map(|(l, log)| {
                let part = |share: f64| progress((l as f64 + share) / count);
                log.linearise(&self.library, &self.active, &part).map(Arc::new)
            })
            .collect::<Result<_, _>>()?;
        Ok(())
    }

    /// The nuisances alone, log by log, under the effects at work.
    pub(crate) fn fit_nuisances(&mut self, reach: Reach) -> Result<(), PredictError> {
        let effects = instances(&self.library, &self.active);
        let fitted = in_pairs(&self.logs, |_, log| nuisances::fit(log, &effects, reach));
        for (log, own) in self.logs.iter_mut().zip(fitted) {
            log.nuisances = own?;
        }
        Ok(())
    }

    /// Moves nuisances and effects by a mean of the linear parameters, within their limits.
    pub(crate) fn advance(&mut self, mean: &[f64]) {
        let mut at = 0;
        for log in &mut self.logs {
            for i in 0..log.nuisance_count() {
                log.move_nuisance(i, mean[at]);
                at += 1;
            }
        }
        for a in &mut self.active {
            for &j in &self.library.columns_of(a.candidate) {
                let column = &self.library.columns[j];
                let value = a.values[column.parameter] + mean[at + j] * column.size;
                a.values[column.parameter] = self.library.candidates[a.candidate].clamped(column.parameter, value);
            }
        }
    }
}

/// Does something for every log, two at a time because of the memory needed; the results are in the order of the logs.
pub(crate) fn in_pairs<T: Send>(logs: &[LogState], each: impl Fn(usize, &LogState) -> T + Sync) -> Vec<T> {
    let mut all = Vec::with_capacity(logs.len());
    for (p, pair) in logs.chunks(2).enumerate() {
        all.par_extend(pair.par_iter().enumerate().map(|(i, log)| each(2 * p + i, log)));
    }
    all
}

/// Where the open parameters stand, in plausible sizes; shapes are counted from their typical value.
pub(crate) fn position_of(library: &Library, logs: &[LogState], open: &[Active]) -> Vec<f64> {
    let mut position = Vec::new();
    for log in logs {
        position.extend(log.position());
    }
    for column in &library.columns {
        let value = open.iter().find(|a| a.candidate == column.candidate).map_or(0.0, |a| {
            let declared = &library.candidates[column.candidate].parameters[column.parameter];
            (a.values[column.parameter] - declared.default_value()) / column.size
        });
        position.push(value);
    }
    position
}

/// Residual of one log after the linear parameters took their posterior mean.
pub(crate) fn fitted_residual(problem: &Problem, log: usize, mean: &[f64]) -> PerChannel {
    let linear = &problem.linear[log];
    let mut residual = linear.residual.clone();
    for (i, column) in linear.columns.iter().enumerate() {
        let amount = mean[problem.global(log, i)];
        if amount == 0.0 {
            continue;
        }
        for (r, c) in residual.iter_mut().zip(Arc::as_ref(column)) {
            if let Some(c) = c {
                for (r, &c) in r.iter_mut().zip(c) {
                    *r -= amount * f64::from(c);
                }
            }
        }
    }
    residual
}
