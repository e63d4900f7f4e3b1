//! Comparison: models against flight logs, channel by channel, and where, when and how much they disagree.
//!
//! ```text
//! FlightLog ┐                 ┌▶ channels: chi², whiteness, correlation with inputs      (statistics)
//!           ├▶ Predictor ─▶ residuals ─▶ conditions: binned means with bands             (conditions)
//! model     ┘   nuisances     ├▶ groups: error in mN, mN·m, mV against the noise         (evaluate)
//!                             └▶ open loop: error after 0.1, 0.5, 1, 5 s                 (open_loop)
//!                                        └▶ verdict, tables, Parquet, report.html
//! ```
//! Rotor biases and charge at take-off are properties of a flight and are fitted to it first ([`crate::estimation`]);
//! everything else is the model as it is.
//!
//! "Agrees" means: no channel has a low-frequency error (0.25 s) beyond 1.5 times the noise variance (4 times in the
//! kinematic channels, see `evaluate`) and beyond chance, nor a
//! whole error beyond 1.25 times. Smaller disagreement is what diagnosis is for, which knows what to look for.
//!
//! Limits: the noise is estimated from the log, so an error that looks like white sensor noise cannot be detected; bins
//! hide a simultaneous dependence on two conditions.

pub mod conditions;
pub mod evaluate;
pub mod files;
pub mod open_loop;
pub mod report;
pub mod statistics;

use serde::Serialize;
use utoipa::ToSchema;

pub use evaluate::{ChannelResult, ChannelVerdict, Evaluated, GroupError, ModelOnLog, WorstMoment};
pub use open_loop::OpenLoopError;

use crate::log::FlightLog;
use crate::model::{LogReference, ModelVersion};
use crate::predict::{NoiseModel, PerChannel, PredictError, Predictor};
use conditions::Condition;

/// A model under the name that the tables show.
#[derive(Debug, Clone)]
pub struct NamedModel {
    /// `f550@v1`, or a file.
    pub label: String,
    /// The version.
    pub version: ModelVersion,
}

/// What was fitted to a log before the comparison.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct NuisanceValues {
    /// Constant error of each rotor's lift, N.
    pub rotor_bias_n: Vec<f64>,
    /// Charge at the start of the log, fraction.
    pub charge_at_start: f64,
    /// Wind of the flight, north and east, m/s; absent unless the model gives each flight one of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wind_m_s: Option<[f64; 2]>,
}

/// An interval of a log that counts for no channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Excluded {
    /// s.
    pub start_s: f64,
    /// s.
    pub end_s: f64,
}

/// All models on one log.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct LogComparison {
    /// Which log.
    pub log: LogReference,
    /// s.
    pub duration_s: f64,
    /// Hz, after resampling.
    pub rate_hz: f64,
    /// What was resampled, what is missing, and what cannot be tested without it.
    pub notes: Vec<String>,
    /// Noise of the readings, estimated from the log.
    pub noise: NoiseModel,
    /// Intervals that do not count: start and end, on the ground.
    pub excluded: Vec<Excluded>,
    /// One entry per model, in the caller's order.
    pub models: Vec<ModelOnLog>,
}

/// Models compared with logs.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct Comparison {
    /// Program and version.
    pub tool: &'static str,
    /// One sentence for the last model.
    pub verdict: String,
    /// Labels and hashes of the models, in order.
    pub models: Vec<ModelReference>,
    /// One entry per log.
    pub logs: Vec<LogComparison>,
}

/// A model, by label and content.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct ModelReference {
    /// Label of the model.
    pub label: String,
    /// Content hash.
    pub hash: String,
    /// Number of effects.
    pub effects: Vec<String>,
}

/// Series of one log that tables of numbers and pictures are made from.
pub struct LogSeries {
    /// Time of each sample, s.
    pub time_s: Vec<f64>,
    /// Measured side of the channels.
    pub measured: PerChannel,
    /// Flight conditions.
    pub conditions: Vec<Condition>,
    /// Per model: residuals.
    pub models: Vec<crate::predict::ChannelResiduals>,
}

/// Holds each model against each log.
///
/// # Errors
/// One sentence: a log or a model that cannot be used.
pub fn compare(logs: &[FlightLog], models: &[NamedModel]) -> Result<(Comparison, Vec<LogSeries>), PredictError> {
    let (mut compared, mut drawn) = (Vec::new(), Vec::new());
    for log in logs {
        let mut entry: Option<LogComparison> = None;
        let mut series: Option<LogSeries> = None;
        for model in models {
            let documents = model.version.documents();
            let catalogue = model.version.catalogue()?;
            let predictor = Predictor::new(&documents, &model.version.instances(), &catalogue, log)?
                .with_own_wind(model.version.wind_of_each_flight);
            let grid = predictor.series();
            let into = series.get_or_insert_with(|| LogSeries {
                time_s: (0..grid.len).map(|k| grid.time(k)).collect(),
                measured: crate::predict::pass::measured(grid),
                conditions: conditions::of(grid),
                models: Vec::new(),
            });
            let evaluated = evaluate::evaluate(&model.label, &predictor, &into.conditions)?;
            let entry = entry.get_or_insert_with(|| LogComparison {
                log: LogReference {
                    name: log.name.clone(),
                    hash: log.source.content_hash.clone(),
                },
                duration_s: grid.len as f64 * grid.step_s,
                rate_hz: 1.0 / grid.step_s,
                notes: predictor.notes(),
                noise: *predictor.noise(),
                excluded: excluded(&into.time_s, &evaluated.residuals.mask),
                models: Vec::new(),
            });
            entry.notes.extend(model.version.guesses());
            entry.models.push(evaluated.result);
            into.models.push(evaluated.residuals);
        }
        compared.extend(entry);
        drawn.extend(series);
    }
    let references = models
        .iter()
        .map(|model| ModelReference {
            label: model.label.clone(),
            hash: model.version.hash(),
            effects: model.version.effect.iter().map(|effect| effect.label()).collect(),
        })
        .collect();
    let verdict = verdict(&compared);
    Ok((
        Comparison {
            tool: crate::model::TOOL,
            verdict,
            models: references,
            logs: compared,
        },
        drawn,
    ))
}

/// Stretches in which no channel counts.
fn excluded(time_s: &[f64], mask: &[Vec<bool>]) -> Vec<Excluded> {
    let counts = |k: usize| mask.iter().any(|mask| mask.get(k).copied().unwrap_or(false));
    let mut found = Vec::new();
    let mut from = None;
    for k in 0..=time_s.len() {
        let out = k < time_s.len() && !counts(k);
        match (from, out) {
            (None, true) => from = Some(k),
            (Some(start), false) => {
                found.push(Excluded {
                    start_s: time_s[start],
                    end_s: time_s[k - 1],
                });
                from = None;
            }
            _ => {}
        }
    }
    found
}

/// What the last model comes to, in a sentence.
fn verdict(logs: &[LogComparison]) -> String {
    let mut sentences = Vec::new();
    for log in logs {
        let Some(model) = log.models.last() else { continue };
        sentences.push(format!("{}: {}", log.log.name, model.sentence()));
    }
    sentences.join(" ")
}

impl ModelOnLog {
    /// What this model comes to on its log.
    pub fn sentence(&self) -> String {
        let name = &self.model;
        let tested = self
            .channels
            .iter()
            .filter(|c| c.verdict != ChannelVerdict::NotTestable)
            .count();
        if tested == 0 {
            return format!("nothing of {name} can be tested with this log.");
        }
        if self.agrees {
            let share = if tested == self.channels.len() {
                "all 16".to_owned()
            } else {
                format!("the {tested} testable")
            };
            return format!(
                "{name} agrees with this flight: {share} channels are at their noise (chi²/N {:.2}).",
                self.chi2
            );
        }
        let mut failing: Vec<&ChannelResult> = self
            .channels
            .iter()
            .filter(|c| c.verdict == ChannelVerdict::Fails)
            .collect();
        failing.sort_by(|a, b| b.low_frequency.total_cmp(&a.low_frequency));
        let parts: Vec<String> = failing.iter().take(4).map(|c| c.clause()).collect();
        let more = failing.len().saturating_sub(4);
        let more = if more > 0 {
            format!("; and {more} more")
        } else {
            String::new()
        };
        format!("{name} fails in {}{more}.", parts.join("; "))
    }

    /// Error of a quantity, if it is testable.
    pub fn error_of(&self, quantity: &str) -> Option<&GroupError> {
        self.errors.iter().find(|error| error.quantity == quantity)
    }
}

impl ChannelResult {
    /// `fx with forward speed (error 12 × noise, 93 % of it by forward speed)`.
    fn clause(&self) -> String {
        let ratio = self.smoothed_rms / self.smoothed_noise;
        match self.conditions.first().filter(|dependence| dependence.explained > 0.3) {
            Some(dependence) => format!(
                "{} with {} (error {ratio:.1} × noise, {:.0} % of it explained)",
                self.channel,
                dependence.title,
                100.0 * dependence.explained
            ),
            None => format!("{} (error {ratio:.1} × noise)", self.channel),
        }
    }
}
