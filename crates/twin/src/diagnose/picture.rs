//! The decisive plot: the residual of the channel in which an effect shows most, over the effect's contribution to that
//! channel, without the effect and with it.
//!
//! With r₀ the residual of the model with everything that was found except this effect, and r₁ that with it, the effect
//! contributes x = r₀ − r₁ to the channel. Binned means over 0.25 s of r₀ over x lie on the line through the origin
//! with slope 1 if the effect is there as fitted, those of r₁ on zero (a component-plus-residual plot, Wood 1973). The
//! band contains 95 % of such means of pure noise.

use rotortwin_plant::effects::{EffectClass, EffectInstance};

use super::result::{Finding, Picture, PictureBin};
use crate::compare::conditions::{Condition, dependence};
use crate::compare::evaluate::BLOCK_S;
use crate::compare::statistics::block_means;
use crate::estimation::problem::Problem;
use crate::predict::{NAMES, PredictError, UNITS};

/// Plots each finding of physics, a sensor or a clock.
///
/// # Errors
/// The effects without one of them yield an invalid vehicle.
pub(super) fn draw(problem: &Problem, findings: &mut [&mut Finding]) -> Result<(), PredictError> {
    // Gusts are a covariance: they contribute no value.
    let all: Vec<EffectInstance> = findings
        .iter()
        .filter(|finding| finding.class != EffectClass::Noise)
        .map(|finding| finding.instance.clone())
        .collect();
    for finding in findings.iter_mut() {
        if finding.class != EffectClass::Noise {
            finding.picture = of_finding(problem, &all, finding)?;
        }
    }
    Ok(())
}

fn of_finding(problem: &Problem, all: &[EffectInstance], finding: &Finding) -> Result<Option<Picture>, PredictError> {
    let Some(channel) = finding
        .channels
        .first()
        .and_then(|name| NAMES.iter().position(|known| known == name))
    else {
        return Ok(None);
    };
    let others: Vec<EffectInstance> = all
        .iter()
        .filter(|instance| **instance != finding.instance)
        .cloned()
        .collect();
    let mut best: Option<(f64, Picture)> = None;
    for state in &problem.logs {
        let predictor = &state.predictor;
        if !predictor.has(channel) {
            continue;
        }
        // Without this effect the others may yield an invalid vehicle, as two swapped rotors of which one is left: then
        // there is no picture.
        let Ok(before) = predictor.residuals(&state.nuisances, &others) else {
            continue;
        };
        let after = predictor.residuals(&state.nuisances, all)?;
        let (mask, step) = (&after.mask[channel], predictor.series().step_s);
        let length = ((BLOCK_S / step).round() as usize).max(1);
        let does: Vec<f64> = before.raw[channel]
            .iter()
            .zip(&after.raw[channel])
            .map(|(before, after)| before - after)
            .collect();
        let does = block_means(&does, mask, length);
        let deviation = predictor.noise().covariances(step)[channel].deviation_of_mean(length);
        let axis = Condition {
            name: "contribution",
            title: "contribution of the effect",
            unit: UNITS[channel],
            values: Vec::new(),
        };
        let binned = |raw: &[f64]| dependence(&axis, &does, &block_means(raw, mask, length), deviation);
        let (Some(before), Some(after)) = (binned(&before.raw[channel]), binned(&after.raw[channel])) else {
            continue;
        };
        let bins: Vec<PictureBin> = before
            .bins
            .iter()
            .zip(&after.bins)
            .map(|(before, after)| PictureBin {
                at: before.at,
                before: before.mean,
                after: after.mean,
                band_95: before.band_95,
                blocks: before.blocks,
            })
            .collect();
        let reach = bins.last().map_or(0.0, |last| last.at) - bins.first().map_or(0.0, |first| first.at);
        if best.as_ref().is_none_or(|(most, _)| reach > *most) {
            let picture = Picture {
                log: predictor.name.clone(),
                channel: NAMES[channel].to_owned(),
                unit: UNITS[channel].to_owned(),
                bins,
            };
            best = Some((reach, picture));
        }
    }
    Ok(best.map(|(_, picture)| picture))
}
