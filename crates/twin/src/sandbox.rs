//! What an effect does to the channels of a flight, over time and over the flight condition that excites it: a plot for
//! people who look up an effect, computed with the effect itself.
//!
//! With r₀ the residual of the model on a simulated flight and r₁ that of the model with the effect, the effect
//! contributes r₀ − r₁ to the channel ([`crate::diagnose::Picture`] is the same on a measured flight). A random effect
//! has no such value: the flight is flown with it, and the residual of the model without it is shown.
//!
//! Means over 0.25 s; not linearised: the effect is evaluated at the given parameters.

use rotortwin_page::rounded;
use rotortwin_plant::effects::{Catalogue, EffectInstance};
use serde::Serialize;
use utoipa::ToSchema;

use crate::compare::conditions::{self, dependence};
use crate::compare::evaluate::BLOCK_S;
use crate::compare::statistics::block_means;
use crate::log::FlightLog;
use crate::model::ModelVersion;
use crate::predict::{CHANNELS, ChannelResiduals, NAMES, Nuisances, PerChannel, PredictError, Predictor, UNITS};

/// Maximum number of channels of an answer: those that the effect moves most.
const MOST_CHANNELS: usize = 3;
/// Conditions of a channel, at most: those that explain most.
const MOST_CONDITIONS: usize = 3;
/// Below this share of its noise a channel is not moved.
const LEAST_SHARE: f64 = 0.01;

/// Changes that an effect makes to one flight.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct EffectPicture {
    /// Id in the catalogue.
    pub effect: String,
    /// Rotor, from 1, of an effect of one rotor.
    pub rotor: Option<usize>,
    /// Values, by name.
    pub parameters: std::collections::BTreeMap<String, f64>,
    /// What else must be in the model for the effect to act, such as drag for wind.
    pub together_with: Vec<String>,
    /// True if the effect is random: then this is the residual of one flight with it, not a mean.
    pub random: bool,
    /// Name of the manoeuvre.
    pub flight: String,
    /// In words.
    pub description: String,
    /// s.
    pub duration_s: f64,
    /// Most affected first; empty if the effect is not visible in the flight.
    pub channels: Vec<MovedChannel>,
}

/// Change that an effect makes to one channel.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct MovedChannel {
    /// Channel, as in comparisons.
    pub channel: String,
    /// Unit of all values.
    pub unit: String,
    /// Root mean square.
    pub rms: f64,
    /// Standard deviation of a mean of pure noise.
    pub noise: f64,
    /// Middle of each mean, s.
    pub time_s: Vec<f64>,
    /// Contribution of the effect; `null`: no sample counts.
    pub does: Vec<Option<f64>>,
    /// Best explained first.
    pub conditions: Vec<OverCondition>,
}

/// Change that an effect makes to a channel over a flight condition.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct OverCondition {
    /// Key, as in comparisons.
    pub condition: String,
    /// Readable name.
    pub title: String,
    /// Unit of the condition.
    pub unit: String,
    /// Fraction of the variance of the means that lies between the bins, 0 to 1.
    pub explained: f64,
    /// Mean of the condition in each bin, increasing.
    pub at: Vec<f64>,
    /// Mean contribution of the effect there.
    pub does: Vec<f64>,
}

/// The influence of `effect` on the channels of a flight without it: most moved first.
///
/// # Errors
/// The effect yields an invalid vehicle, or the flight cannot be compared with the model.
pub fn moved(
    log: &FlightLog,
    model: &ModelVersion,
    catalogue: &Catalogue,
    effect: &EffectInstance,
) -> Result<Vec<MovedChannel>, PredictError> {
    let predictor = Predictor::new(&model.documents(), &model.instances(), catalogue, log)?;
    let nuisances = Nuisances::default();
    let without = predictor.residuals(&nuisances, &[])?;
    let with = predictor.residuals(&nuisances, std::slice::from_ref(effect))?;
    let does = std::array::from_fn(|channel| {
        let both = without.raw[channel].iter().zip(&with.raw[channel]);
        both.map(|(without, with)| without - with).collect()
    });
    Ok(ranked(&predictor, &does, &with))
}

/// What is left of the channels of a flight that was flown with a random effect, by a model without it.
///
/// # Errors
/// The flight cannot be compared with the model.
pub fn left(log: &FlightLog, model: &ModelVersion, catalogue: &Catalogue) -> Result<Vec<MovedChannel>, PredictError> {
    let predictor = Predictor::new(&model.documents(), &model.instances(), catalogue, log)?;
    let residuals = predictor.residuals(&Nuisances::default(), &[])?;
    Ok(ranked(&predictor, &residuals.raw, &residuals))
}

fn ranked(predictor: &Predictor, does: &PerChannel, counted: &ChannelResiduals) -> Vec<MovedChannel> {
    let series = predictor.series();
    let length = ((BLOCK_S / series.step_s).round() as usize).max(1);
    let all = conditions::of(series);
    let every = vec![true; series.len];
    let blocks = |values: &[f64]| block_means(values, &every, length);
    let means: Vec<Vec<f64>> = all.iter().map(|condition| blocks(&condition.values)).collect();
    let covariances = predictor.noise().covariances(series.step_s);
    let mut found: Vec<MovedChannel> = (0..CHANNELS)
        .filter(|channel| predictor.has(*channel) && !does[*channel].is_empty())
        .filter_map(|channel| {
            let moved = block_means(&does[channel], &counted.mask[channel], length);
            let known: Vec<f64> = moved.iter().copied().filter(|value| value.is_finite()).collect();
            let rms = (known.iter().map(|value| value * value).sum::<f64>() / known.len() as f64).sqrt();
            let noise = covariances[channel].deviation_of_mean(length);
            // Not a number where nothing counts.
            if rms.partial_cmp(&(LEAST_SHARE * noise)) != Some(std::cmp::Ordering::Greater) {
                return None;
            }
            let mut over: Vec<OverCondition> = all
                .iter()
                .zip(&means)
                .filter_map(|(condition, at)| dependence(condition, at, &moved, noise))
                .map(|found| OverCondition {
                    condition: found.condition.to_owned(),
                    title: found.title.to_owned(),
                    unit: found.unit.to_owned(),
                    explained: found.explained,
                    at: found.bins.iter().map(|bin| bin.at).collect(),
                    does: found.bins.iter().map(|bin| bin.mean).collect(),
                })
                .collect();
            over.sort_by(|a, b| b.explained.total_cmp(&a.explained));
            over.truncate(MOST_CONDITIONS);
            Some(MovedChannel {
                channel: NAMES[channel].to_owned(),
                unit: UNITS[channel].to_owned(),
                rms,
                noise,
                time_s: (0..moved.len())
                    .map(|block| series.time(block * length) + 0.5 * BLOCK_S)
                    .collect(),
                does: moved.into_iter().map(rounded).collect(),
                conditions: over,
            })
        })
        .collect();
    found.sort_by(|a, b| (b.rms / b.noise).total_cmp(&(a.rms / a.noise)));
    found.truncate(MOST_CHANNELS);
    found
}
