//! Errors on blocks that the fit did not see: fitted on the even blocks of 5 s, tested on the odd ones, smoothed over 0.1 s.

use super::fit::Problem;
use super::linear::{Active, instances};
use super::result::HeldOutError;
use super::settle::pulled;
use crate::predict::channels::{F, M, V};
use crate::predict::{CHANNELS, ChannelResiduals, Nuisances, PredictError, Series};

/// Length of the smoothing mean, s.
const SMOOTH_S: f64 = 0.1;

/// The parameters fitted on even blocks only: one more step from the fit on all blocks, which forgets where it starts.
fn even_fit(problem: &Problem) -> Result<(Vec<Active>, Vec<Nuisances>), PredictError> {
    let normal = problem.normal(|b| b % 2 == 0);
    // Clutter stays at 0: the model that is handed on has none.
    const FIXED: f64 = 1e-9;
    let mut prior = problem.deviations(&problem.active);
    for d in &mut prior {
        if *d < 1.0 {
            *d = FIXED;
        }
    }
    let posterior = pulled(problem, normal, &prior)
        .ok_or_else(|| PredictError("the fit on half the blocks met numbers that are not finite".into()))?;
    let mut even = problem.clone();
    even.advance(&posterior.mean);
    Ok((even.active, even.logs.iter().map(|log| log.nuisances).collect()))
}

/// Mean squares on the odd blocks of force (N), torque (N·m) and voltage (V), with their counts.
fn squares(problem: &Problem, log: usize, residuals: &ChannelResiduals) -> [(f64, f64); 3] {
    let state = &problem.logs[log];
    let series: &Series = state.predictor.series();
    let c = &state.predictor.nominal;
    let rows = (SMOOTH_S / series.step_s).round().max(1.0) as usize;
    let mut sums = [(0.0, 0.0); 3];
    for channel in 0..CHANNELS {
        let (kind, scale) = match channel {
            F..3 => (0, c.mass_kg),
            M..9 => (1, c.inertia_body_kg_m2[channel - M][channel - M]),
            V => (2, 1.0),
            _ => continue,
        };
        let (raw, mask) = (&residuals.raw[channel], &residuals.mask[channel]);
        if raw.is_empty() {
            continue;
        }
        for b in (1..state.block_count()).step_by(2) {
            let range = state.block_range(b);
            for start in range.clone().step_by(rows) {
                let end = start + rows;
                if end > range.end || !mask[start..end].iter().all(|&m| m) {
                    continue;
                }
                let mean = scale * raw[start..end].iter().sum::<f64>() / rows as f64;
                sums[kind].0 += mean * mean;
                sums[kind].1 += 1.0;
            }
        }
    }
    sums
}

/// Errors before (`plain`: the nuisances of the given model) and after.
pub(crate) fn errors(problem: &Problem, plain: &[Nuisances]) -> Result<Vec<HeldOutError>, PredictError> {
    let (active, nuisances) = even_fit(problem)?;
    let effects = instances(&problem.library, &active);
    let (mut before, mut after) = ([(0.0, 0.0); 3], [(0.0, 0.0); 3]);
    for l in 0..problem.logs.len() {
        let predictor = &problem.logs[l].predictor;
        for (sums, residuals) in [
            (&mut before, predictor.residuals(&plain[l], &[])?),
            (&mut after, predictor.residuals(&nuisances[l], &effects)?),
        ] {
            for (sum, own) in sums.iter_mut().zip(squares(problem, l, &residuals)) {
                sum.0 += own.0;
                sum.1 += own.1;
            }
        }
    }
    let root = |(square, count): (f64, f64)| (square / count).sqrt();
    Ok([("force", "N"), ("torque", "N·m"), ("voltage", "V")]
        .iter()
        .enumerate()
        .filter(|(kind, _)| before[*kind].1 > 0.0)
        .map(|(kind, (quantity, unit))| HeldOutError {
            quantity: (*quantity).to_owned(),
            unit: (*unit).to_owned(),
            before: root(before[kind]),
            after: root(after[kind]),
        })
        .collect())
}
