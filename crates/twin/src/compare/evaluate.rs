//! One model on one log: every channel tested, and the errors in physical units.

use rotortwin_plant::effects::ChannelGroup;
use serde::Serialize;
use utoipa::ToSchema;

use super::NuisanceValues;
use super::conditions::{self, Condition, Dependence};
use super::open_loop::{self, OpenLoopError};
use super::statistics::{InputTest, LjungBox, block_means, mean_square, standardised_blocks};
use crate::estimation::columns::LogState;
use crate::estimation::nuisances::{self, Reach};
use crate::predict::channels::{F, M, group};
use crate::predict::{CHANNELS, ChannelResiduals, Covariance, NAMES, Nuisances, PredictError, Predictor, UNITS};

/// Block of the heat strip, s.
pub const STRIP_BLOCK_S: f64 = 5.0;
/// Block of the whiteness test and of the conditions, s.
pub const BLOCK_S: f64 = 0.25;
/// Window of the smoothed errors, s.
pub const SMOOTH_S: f64 = 0.1;
/// Block of the correlation with inputs, s.
const INPUT_BLOCK_S: f64 = 0.05;
/// Lags of the correlation with inputs: up to 0.5 s.
const INPUT_LAGS: usize = 10;
/// Window of a worst moment, s.
const MOMENT_S: f64 = 0.5;
/// Worst moments listed.
const MOMENTS: usize = 6;

/// A channel fails where the low-frequency error exceeds this multiple of the noise (variances) …
pub const LOW_FREQUENCY_LIMIT: f64 = 1.5;
/// … or this one in the channels of kinematics. The noise of a difference all but cancels over 0.25 s, so that there the step's
/// trapezoidal rule shows in fast motion: up to 2.3 on healthy flights at 400 Hz. A latency or a misaligned sensor gives hundreds.
pub const KINEMATIC_LIMIT: f64 = 4.0;
/// … and where that is this many deviations beyond chance: 16 channels a log, one false failure in 10⁵ logs for white noise.
const CHANCE_LIMIT: f64 = 5.0;
/// Or where the whole error, noise included, exceeds this multiple of the noise (variances).
pub const CHI2_LIMIT: f64 = 1.25;

/// Result of the test of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ChannelVerdict {
    /// Nothing but noise.
    Agrees,
    /// More than noise.
    Fails,
    /// The log lacks a column, or the vehicle never flew.
    NotTestable,
}

/// One channel of one model on one log.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct ChannelResult {
    /// Short name: `fx`.
    pub channel: &'static str,
    /// F, M, KV, KA, KP, V.
    pub group: &'static str,
    /// Unit of the errors below.
    pub unit: &'static str,
    /// The result.
    pub verdict: ChannelVerdict,
    /// Number of samples that count.
    pub samples: usize,
    /// Root mean square of the residual.
    #[schema(value_type = Option<f64>)]
    pub rms: f64,
    /// Standard deviation of a sample of pure noise.
    #[schema(value_type = Option<f64>)]
    pub noise: f64,
    /// Root mean square of means over 0.1 s.
    #[schema(value_type = Option<f64>)]
    pub smoothed_rms: f64,
    /// Value of pure noise there.
    #[schema(value_type = Option<f64>)]
    pub smoothed_noise: f64,
    /// Mean square of the whitened residual: 1 for pure noise.
    #[schema(value_type = Option<f64>)]
    pub chi2: f64,
    /// Mean square of the standardised sums over 0.25 s: 1 for white noise.
    #[schema(value_type = Option<f64>)]
    pub low_frequency: f64,
    /// Standard deviation of `low_frequency` by chance.
    #[schema(value_type = Option<f64>)]
    pub low_frequency_chance: f64,
    /// Whiteness of the samples.
    pub ljung_box: Option<LjungBox>,
    /// Inputs that the residual correlates with, those outside their 99 % band first.
    pub inputs: Vec<InputTest>,
    /// Dependence on the flight conditions, strongest first.
    pub conditions: Vec<Dependence>,
    /// chi² per sample in blocks of 5 s; absent where less than half of a block counts.
    pub strip: Vec<Option<f64>>,
}

/// The interval with the largest error of a channel that fails.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct WorstMoment {
    /// Start, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// Channel.
    pub channel: &'static str,
    /// Mean residual.
    #[schema(value_type = Option<f64>)]
    pub error: f64,
    /// Its unit.
    pub unit: &'static str,
    /// In standard deviations of such a mean due to noise.
    #[schema(value_type = Option<f64>)]
    pub deviations: f64,
    /// Conditions at that time: title, value, unit.
    #[schema(value_type = Vec<Vec<serde_json::Value>>)]
    pub conditions: Vec<(&'static str, f64, &'static str)>,
}

/// Error of a group of channels in physical units: the height of one step of the waterfall chart.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct GroupError {
    /// `force`, `torque`, `voltage`, `acceleration`, `attitude rate`, `velocity`.
    pub quantity: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Root mean square over the group's channels of means over 0.1 s.
    #[schema(value_type = Option<f64>)]
    pub error: f64,
    /// Value of pure noise.
    #[schema(value_type = Option<f64>)]
    pub noise: f64,
}

/// One model on one log.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct ModelOnLog {
    /// Label of the model.
    pub model: String,
    /// True if no channel fails and at least one can be tested.
    pub agrees: bool,
    /// All 16 channels.
    pub channels: Vec<ChannelResult>,
    /// Errors by group.
    pub errors: Vec<GroupError>,
    /// Mean of the tested channels' chi².
    #[schema(value_type = Option<f64>)]
    pub chi2: f64,
    /// Open-loop prediction.
    pub open_loop: Vec<OpenLoopError>,
    /// Intervals with the largest errors, worst first.
    pub worst: Vec<WorstMoment>,
    /// What was fitted to the log before the comparison.
    pub nuisances: NuisanceValues,
}

/// The result with the numbers that the report draws.
pub struct Evaluated {
    /// The result.
    pub result: ModelOnLog,
    /// Residuals of all channels.
    pub residuals: ChannelResiduals,
}

/// Compares the model of `predictor` with its log.
///
/// # Errors
/// The model's effects together yield an invalid vehicle.
pub fn evaluate(model: &str, predictor: &Predictor, conditions: &[Condition]) -> Result<Evaluated, PredictError> {
    let fitted = nuisances::fit(&LogState::new(predictor.clone()), &[], Reach::Plausible)?;
    let residuals = predictor.residuals(&fitted, &[])?;
    let step = predictor.series().step_s;
    let covariances = predictor.noise().covariances(step);
    let channels: Vec<ChannelResult> = (0..CHANNELS)
        .map(|channel| test(predictor, &residuals, channel, covariances[channel], conditions))
        .collect();
    let tested: Vec<&ChannelResult> = channels
        .iter()
        .filter(|c| c.verdict != ChannelVerdict::NotTestable)
        .collect();
    let samples: usize = tested.iter().map(|c| c.samples).sum();
    let chi2 = tested.iter().map(|c| c.chi2 * c.samples as f64).sum::<f64>() / samples.max(1) as f64;
    let result = ModelOnLog {
        model: model.to_owned(),
        agrees: !tested.is_empty() && tested.iter().all(|c| c.verdict == ChannelVerdict::Agrees),
        errors: group_errors(predictor, &channels),
        chi2,
        open_loop: open_loop::errors(predictor, &fitted)?,
        worst: worst_moments(predictor, &residuals, &channels, &covariances, conditions),
        nuisances: nuisance_values(predictor, &fitted),
        channels,
    };
    Ok(Evaluated { result, residuals })
}

fn nuisance_values(predictor: &Predictor, fitted: &Nuisances) -> NuisanceValues {
    NuisanceValues {
        rotor_bias_n: fitted.rotor_bias_n[..predictor.series().rotors].to_vec(),
        charge_at_start: predictor.plant.charge + fitted.charge,
        wind_m_s: predictor.has_own_wind().then_some(fitted.wind_m_s),
    }
}

/// Samples of a stretch, at least one.
fn samples(length_s: f64, step_s: f64) -> usize {
    ((length_s / step_s).round() as usize).max(1)
}

fn test(
    predictor: &Predictor,
    residuals: &ChannelResiduals,
    channel: usize,
    covariance: Covariance,
    conditions: &[Condition],
) -> ChannelResult {
    let mut result = ChannelResult {
        channel: NAMES[channel],
        group: group(channel).symbol(),
        unit: UNITS[channel],
        verdict: ChannelVerdict::NotTestable,
        samples: 0,
        rms: f64::NAN,
        noise: covariance.variance.sqrt(),
        smoothed_rms: f64::NAN,
        smoothed_noise: f64::NAN,
        chi2: f64::NAN,
        low_frequency: f64::NAN,
        low_frequency_chance: f64::NAN,
        ljung_box: None,
        inputs: Vec::new(),
        conditions: Vec::new(),
        strip: Vec::new(),
    };
    if !predictor.has(channel) {
        return result;
    }
    let step = predictor.series().step_s;
    let (raw, whitened, mask) = (
        &residuals.raw[channel],
        &residuals.whitened[channel],
        &residuals.mask[channel],
    );
    result.samples = mask.iter().filter(|&&m| m).count();
    let count = result.samples as f64;
    let masked = |values: &[f64]| {
        values
            .iter()
            .zip(mask)
            .filter(|&(_, &m)| m)
            .map(|(v, _)| v * v)
            .sum::<f64>()
            / count
    };
    result.rms = masked(raw).sqrt();
    result.chi2 = masked(whitened);
    let smooth = samples(SMOOTH_S, step);
    result.smoothed_rms = mean_square(&block_means(raw, mask, smooth)).0.sqrt();
    result.smoothed_noise = covariance.deviation_of_mean(smooth);
    let block = samples(BLOCK_S, step);
    let (level, blocks) = mean_square(&standardised_blocks(whitened, mask, block));
    result.low_frequency = level;
    result.low_frequency_chance = (2.0 / blocks.max(1) as f64).sqrt();
    result.ljung_box = Some(LjungBox::of(whitened));
    let input_block = samples(INPUT_BLOCK_S, step);
    let coarse = standardised_blocks(whitened, mask, input_block);
    result.inputs = conditions
        .iter()
        .filter_map(|condition| {
            let values = block_means(&condition.values, mask, input_block);
            InputTest::of(condition.title, &coarse, &values, INPUT_LAGS, input_block as f64 * step)
        })
        .collect();
    result.inputs.sort_by(|a, b| {
        (b.correlation / b.band_99)
            .abs()
            .total_cmp(&(a.correlation / a.band_99).abs())
    });
    let means = block_means(raw, mask, block);
    let deviation = covariance.deviation_of_mean(block);
    result.conditions = conditions
        .iter()
        .filter_map(|condition| {
            conditions::dependence(
                condition,
                &block_means(&condition.values, mask, block),
                &means,
                deviation,
            )
        })
        .collect();
    result.conditions.sort_by(|a, b| b.explained.total_cmp(&a.explained));
    let strip = samples(STRIP_BLOCK_S, step);
    result.strip = whitened
        .chunks(strip)
        .zip(mask.chunks(strip))
        .map(|(values, mask)| {
            let counted = mask.iter().filter(|&&m| m).count();
            (2 * counted >= strip).then(|| values.iter().map(|w| w * w).sum::<f64>() / counted as f64)
        })
        .collect();
    let beyond_chance = level > 1.0 + CHANCE_LIMIT * result.low_frequency_chance;
    let limit = match group(channel) {
        ChannelGroup::Force | ChannelGroup::Moment | ChannelGroup::Voltage => LOW_FREQUENCY_LIMIT,
        ChannelGroup::VelocityKinematics | ChannelGroup::AttitudeKinematics | ChannelGroup::PositionKinematics => {
            KINEMATIC_LIMIT
        }
    };
    let fails = (level > limit && beyond_chance) || result.chi2 > CHI2_LIMIT;
    result.verdict = if fails {
        ChannelVerdict::Fails
    } else {
        ChannelVerdict::Agrees
    };
    result
}

/// Names, units and factors of the groups, in the order of the waterfall.
fn group_errors(predictor: &Predictor, channels: &[ChannelResult]) -> Vec<GroupError> {
    let c = &predictor.nominal;
    let groups: [(ChannelGroup, &str, &str); 6] = [
        (ChannelGroup::Force, "force", "mN"),
        (ChannelGroup::Moment, "torque", "mN·m"),
        (ChannelGroup::Voltage, "voltage", "mV"),
        (ChannelGroup::VelocityKinematics, "acceleration", "m/s²"),
        (ChannelGroup::AttitudeKinematics, "attitude rate", "mrad/s"),
        (ChannelGroup::PositionKinematics, "velocity", "mm/s"),
    ];
    let factor = |channel: usize, wanted: ChannelGroup| match wanted {
        ChannelGroup::Force => 1e3 * c.mass_kg,
        ChannelGroup::Moment => 1e3 * c.inertia_body_kg_m2[channel - M][channel - M],
        ChannelGroup::VelocityKinematics => 1.0,
        ChannelGroup::Voltage | ChannelGroup::AttitudeKinematics | ChannelGroup::PositionKinematics => 1e3,
    };
    debug_assert_eq!(F, 0, "the groups follow the order of the channels");
    groups
        .into_iter()
        .filter_map(|(wanted, quantity, unit)| {
            let members: Vec<(f64, f64)> = channels
                .iter()
                .enumerate()
                .filter(|(channel, result)| group(*channel) == wanted && result.verdict != ChannelVerdict::NotTestable)
                .map(|(channel, result)| {
                    let factor = factor(channel, wanted);
                    (factor * result.smoothed_rms, factor * result.smoothed_noise)
                })
                .collect();
            let root = |value: fn(&(f64, f64)) -> f64| {
                (members.iter().map(|m| value(m) * value(m)).sum::<f64>() / members.len() as f64).sqrt()
            };
            (!members.is_empty()).then(|| GroupError {
                quantity,
                unit,
                error: root(|m| m.0),
                noise: root(|m| m.1),
            })
        })
        .collect()
}

fn worst_moments(
    predictor: &Predictor,
    residuals: &ChannelResiduals,
    tested: &[ChannelResult],
    covariances: &[Covariance; CHANNELS],
    conditions: &[Condition],
) -> Vec<WorstMoment> {
    let series = predictor.series();
    let length = samples(MOMENT_S, series.step_s);
    let mut found = Vec::new();
    for channel in 0..CHANNELS {
        if tested[channel].verdict != ChannelVerdict::Fails {
            continue;
        }
        let mask = &residuals.mask[channel];
        let levels = standardised_blocks(&residuals.whitened[channel], mask, length);
        let means = block_means(&residuals.raw[channel], mask, length);
        // Means of pure noise do not appear, however many blocks there are.
        let limit = super::statistics::two_sided_quantile(1e-3 / levels.len().max(1) as f64);
        let worst = (0..levels.len())
            .filter(|&b| levels[b].is_finite() && levels[b].abs() > limit)
            .max_by(|&a, &b| levels[a].abs().total_cmp(&levels[b].abs()));
        if let Some(block) = worst {
            let from = block * length;
            let to = (from + length).min(series.len) - 1;
            let at =
                |condition: &Condition| super::statistics::finite_mean(condition.values[from..=to].iter().copied()).0;
            found.push(WorstMoment {
                start_s: series.time(from),
                end_s: series.time(to),
                channel: NAMES[channel],
                error: means[block],
                unit: UNITS[channel],
                deviations: means[block].abs() / covariances[channel].deviation_of_mean(length),
                conditions: conditions.iter().map(|c| (c.title, at(c), c.unit)).collect(),
            });
        }
    }
    found.sort_by(|a, b| b.deviations.total_cmp(&a.deviations));
    found.truncate(MOMENTS);
    found
}
