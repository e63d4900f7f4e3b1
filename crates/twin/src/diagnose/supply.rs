//! A supply that is not in the log: if neither voltage nor rotor speed was logged, a discharging battery shows as
//! decreasing thrust.

use super::result::Goodness;
use crate::estimation::columns::{LogState, instances};
use crate::estimation::problem::Problem;
use crate::predict::channels::F;
use crate::predict::{Drive, NAMES, PredictError};

/// Length of the means in which a decline is detected, s: longer than a vehicle's own motion.
const MEAN_S: f64 = 1.0;
/// Standard deviations of a slope from which it counts. Means of a second are correlated, by up to 2.6 deviations of an independent one.
const CERTAIN: f64 = 10.0;
/// Smallest decline of the thrust over a log that is reported.
const LEAST_FALL: f64 = 0.005;

/// True if duties drive the rotors at a voltage that was not measured.
pub(crate) fn is_unknown(log: &LogState) -> bool {
    let series = log.predictor.series();
    series.drive == Drive::Duty && !series.available.voltage
}

/// Reports an unexplained force that declines over time, as with a supply that empties.
///
/// # Errors
/// The effects together yield an invalid vehicle.
pub(crate) fn tell(problem: &Problem, goodness: &mut Goodness) -> Result<(), PredictError> {
    let down = F + 2;
    if !goodness
        .unexplained
        .iter()
        .any(|channel| channel.starts_with(NAMES[down]))
    {
        return Ok(());
    }
    for log in problem
        .logs
        .iter()
        .filter(|log| is_unknown(log) && log.predictor.has(down))
    {
        let residuals = log
            .predictor
            .residuals(&log.nuisances, &instances(&problem.library, &problem.active))?;
        let (series, measured) = (log.predictor.series(), log.predictor.measured(down));
        let rows = (MEAN_S / series.step_s).round().max(1.0) as usize;
        // Means of time, of the measured force, and of the share of it that the model has too much.
        let means: Vec<[f64; 3]> = (0..series.len.saturating_sub(rows))
            .step_by(rows)
            .filter(|start| residuals.mask[down][*start..start + rows].iter().all(|counts| *counts))
            .map(|start| {
                let mean = |x: &[f64]| x[start..start + rows].iter().sum::<f64>() / rows as f64;
                let force = mean(&measured);
                [series.time(start), force, -mean(&residuals.raw[down]) / force]
            })
            .filter(|mean| mean[1] < 0.0)
            .collect();
        let Some((slope, deviation)) = slope(&means) else {
            continue;
        };
        let fall = slope * means.len() as f64 * MEAN_S;
        if fall > LEAST_FALL && slope > CERTAIN * deviation {
            goodness.unexplained.push(format!(
                "a thrust that falls by {:.1} % in the {:.0} s judged (most likely the supply, which this log does not hold)",
                100.0 * fall,
                means.len() as f64 * MEAN_S
            ));
        }
    }
    Ok(())
}

/// Slope of the last over the first by least squares, and its deviation; `None` of too few.
fn slope(means: &[[f64; 3]]) -> Option<(f64, f64)> {
    let count = means.len() as f64;
    if count < 8.0 {
        return None;
    }
    let mean = |i: usize| means.iter().map(|m| m[i]).sum::<f64>() / count;
    let (time, share) = (mean(0), mean(2));
    let spread: f64 = means.iter().map(|m| (m[0] - time).powi(2)).sum();
    let slope = means.iter().map(|m| (m[0] - time) * (m[2] - share)).sum::<f64>() / spread;
    let left: f64 = means
        .iter()
        .map(|m| (m[2] - share - slope * (m[0] - time)).powi(2))
        .sum();
    Some((slope, (left / (count - 2.0) / spread).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_slope_is_found_with_its_deviation() {
        let means: Vec<[f64; 3]> = (0..40)
            .map(|k| {
                let t = f64::from(k);
                [t, -9.8, 0.001 * t + if k % 2 == 0 { 0.002 } else { -0.002 }]
            })
            .collect();
        let (found, deviation) = slope(&means).expect("enough means");
        // σ/√Σ(t − t̄)²: 0.002/√5330.
        assert!((found - 0.001).abs() < 3.0 * deviation, "{found} {deviation}");
        assert!(
            (deviation / (0.002 / 5330.0_f64.sqrt()) - 1.0).abs() < 0.1,
            "{deviation}"
        );
        assert!(slope(&means[..5]).is_none());
    }
}
