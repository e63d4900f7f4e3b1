//! The result of a diagnosis: the structure behind JSON, terminal output and report.

use rotortwin_plant::effects::{ChannelGroup, EffectClass, EffectInstance};
use serde::Serialize;
use std::collections::BTreeMap;
use utoipa::ToSchema;

pub use super::described::{Follows, FrequencyBand, Line, Remainder, RemainderOnset};
use super::named::Quantity;
use crate::baseline::Trim;
use crate::estimation::parameters::FittedParameter;
pub use crate::estimation::unseen::HeldOutError;
use crate::model::constants::Source;
use crate::propose::Proposal;
use crate::schema;

/// Verdict in one word.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
#[schema(as = DiagnosisVerdict)]
pub enum Verdict {
    /// The model agrees with the flight.
    Agrees,
    /// Physics is missing, and named.
    Missing {
        /// Ids of the effects.
        effects: Vec<String>,
    },
    /// Physics is missing, and this flight cannot distinguish the effects of a group.
    CannotTell {
        /// Ids of the effects, best first.
        group: Vec<String>,
    },
    /// Physics is missing and explains a part of the error on blocks that no fit has seen; the rest is not in the catalogue.
    PartlyMissing {
        /// Ids of the effects.
        effects: Vec<String>,
    },
    /// Constants of the vehicle were guessed, and the flights indicate other values: nothing is called missing before they are known.
    CalibrateFirst {
        /// Keys of the constants.
        constants: Vec<String>,
    },
    /// The error is real and not, or only partly, explained by the catalogue.
    OutsideCatalogue,
    /// Nothing explains the flights together, and each alone is explained (`apart`).
    FlightsDiffer {
        /// True if the vehicle or its sensors changed between them: what one flight has would have shown in another that has not.
        changed: bool,
    },
    /// Sensors or clocks of the log are at fault; the physics agrees.
    LogFault {
        /// Ids of the faults.
        effects: Vec<String>,
    },
    /// No channel of the log can be compared with the model.
    NothingTestable,
}

/// A rival that explains the data nearly as well, or why it was rejected.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = RivalEffect)]
pub struct Rival {
    /// Id in the catalogue.
    pub effect: String,
    /// Rotor, from 1.
    pub rotor: Option<usize>,
    /// Readable name.
    pub label: String,
    /// ln of the Bayes factor of the finding against it.
    pub evidence_gap: f64,
    /// Why it was rejected, or that it was not.
    pub reason: String,
    /// The result of the test; `reason` is that in words.
    #[serde(skip)]
    pub(crate) outcome: Outcome,
}

/// The result of a rival compared with the named effect.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Outcome {
    /// The flight fits it nearly as well.
    AsGood,
    /// The named effect is too small to be distinguished from it.
    TooSmallToTell,
    /// It needs a size that real vehicles do not have.
    Implausible(Quantity),
    /// It leaves the error where it is in these groups of channels.
    Leaves(Vec<ChannelGroup>),
    /// It shows in the same channels, with another shape over the flight; manoeuvres that excite the named one
    /// distinguish them.
    OtherShape(&'static str),
}

/// A residual against the contribution of an effect to its channel.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = FindingPicture)]
pub struct Picture {
    /// Log in which the effect is largest.
    pub log: String,
    /// Channel.
    pub channel: String,
    /// Unit of all numbers.
    pub unit: String,
    /// By increasing contribution of the effect.
    pub bins: Vec<PictureBin>,
}

/// Means over blocks with similar contributions of the effect.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct PictureBin {
    /// Mean contribution of the effect.
    pub at: f64,
    /// Mean residual without the effect.
    pub before: f64,
    /// Mean residual with the effect.
    pub after: f64,
    /// Half width of the band that contains 95 % of the means of pure noise.
    pub band_95: f64,
    /// Number of blocks of 0.25 s.
    pub blocks: usize,
}

/// An effect that was found.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Finding {
    /// Effect, as named in documents.
    #[schema(value_type = schema::EffectInstance)]
    pub instance: EffectInstance,
    /// Readable name.
    pub label: String,
    /// Physics, sensor fault or timing fault.
    #[schema(value_type = schema::EffectClass)]
    pub class: EffectClass,
    /// Equation.
    pub equation: String,
    /// Parameters with intervals.
    pub parameters: Vec<FittedParameter>,
    /// ln of the Bayes factor against clutter.
    #[schema(value_type = Option<f64>)]
    pub ln_bayes_factor: f64,
    /// Posterior probability within the catalogue, with equal prior odds.
    pub posterior: f64,
    /// Channels in which the effect is most visible, strongest first.
    pub channels: Vec<String>,
    /// Rivals with an evidence gap below 10.
    pub also_compatible: Vec<Rival>,
    /// Rivals that were fitted and rejected.
    pub lost: Vec<Rival>,
    /// Onset, if not from the start.
    pub onset_s: Option<f64>,
    /// Explanation in plain words.
    pub reason: String,
    /// Smallest detectable size of the first parameter, in its unit; `None` where that means nothing.
    #[serde(skip)]
    pub(crate) seen_from: Option<f64>,
    /// The constant whose error this is, and what it should be; the sentence names it.
    #[serde(skip)]
    pub(crate) constant: Option<ConstantWanted>,
    /// The residual against the contribution of the effect, without and with it; absent if there is nothing to plot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub picture: Option<Picture>,
}

impl Finding {
    /// Physics that no evidence was computed for.
    pub(crate) fn without_evidence(
        instance: EffectInstance,
        label: String,
        equation: String,
        parameters: Vec<FittedParameter>,
        reason: String,
    ) -> Self {
        Self {
            instance,
            label,
            class: EffectClass::Physics,
            equation,
            parameters,
            ln_bayes_factor: f64::NAN,
            posterior: f64::NAN,
            channels: Vec::new(),
            also_compatible: Vec::new(),
            lost: Vec::new(),
            onset_s: None,
            reason,
            seen_from: None,
            constant: None,
            picture: None,
        }
    }
}

/// A constant of the vehicle that an effect is the error of.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ConstantWanted {
    /// In words.
    pub(crate) name: String,
    pub(crate) unit: String,
    /// Value in the vehicle document.
    pub(crate) value: f64,
    /// With the error that was found.
    pub(crate) wanted: f64,
    /// Half width of its 95 % interval.
    pub(crate) interval_95: f64,
}

/// One row of the ranking on the given model.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Ranked {
    /// Id in the catalogue.
    pub effect: String,
    /// Rotor, from 1.
    pub rotor: Option<usize>,
    /// Readable name.
    pub label: String,
    /// Equation.
    pub equation: String,
    /// Class.
    #[schema(value_type = schema::EffectClass)]
    pub class: EffectClass,
    /// Parameters from the linear fit.
    pub parameters: Vec<FittedParameter>,
    /// ln of the Bayes factor against clutter.
    #[schema(value_type = Option<f64>)]
    pub ln_bayes_factor: f64,
    /// Change of chi² on the held-out blocks, in both directions; negative is better.
    #[schema(value_type = Option<f64>)]
    pub held_out_chi2_change: f64,
}

impl Ranked {
    /// A vehicle can have all of its sizes.
    pub fn can_be(&self) -> bool {
        self.parameters.iter().all(|parameter| parameter.plausible)
    }
}

/// An effect that is undetectable in this flight at its plausible size.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct NotTestable {
    /// Id in the catalogue.
    pub effect: String,
    /// Rotor, from 1.
    pub rotor: Option<usize>,
    /// Readable name.
    pub label: String,
    /// Parameter.
    pub parameter: String,
    /// Unit.
    pub unit: String,
    /// Plausible size.
    pub plausible_size: f64,
    /// Smallest size with an expected ln Bayes factor equal to the threshold; absent if the flight contains no
    /// information on it.
    pub minimum_size: Option<f64>,
    /// What would excite it.
    pub excited_by: String,
}

/// An effect of the catalogue that could not be considered.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct NotConsidered {
    /// Id in the catalogue.
    pub effect: String,
    /// Readable name.
    pub label: String,
    /// Columns of a log that would make it testable; none of the logs has any of them.
    pub columns: Vec<String>,
    /// What in the model or in the flight would make it testable, if not a column.
    pub setting: Option<String>,
    /// Why, in plain words.
    pub reason: String,
    /// Why; `reason` is that in words.
    #[serde(skip)]
    pub(crate) why: Reason,
}

/// Why an effect was not considered.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Reason {
    /// The logs lack these columns.
    Columns(Vec<String>),
    /// Commands are sampled further apart than the rotors' lag.
    SlowCommand {
        /// Samples per second of the fastest log, Hz.
        hz: f64,
        /// The lag, s.
        lag_s: f64,
        /// How to have more of them.
        faster: &'static str,
    },
    /// The model has it already.
    InTheModel,
    /// Nothing through which it acts is at work: one of these effects would be needed.
    NothingToActThrough(&'static [&'static str]),
    /// It is only looked for beside an effect that was named, and none was.
    NothingNamed,
    /// The covariance of this effect is nearly the same.
    CovarianceOf(&'static str),
    /// A flight determines it only against constants that are guesses, those of these effects.
    Guessed(&'static [&'static str]),
}

/// How well the model fits, before and after.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ChannelGoodness {
    /// Log.
    pub log: String,
    /// Channel.
    pub channel: String,
    /// chi² per sample of the given model, with nuisance parameters fitted.
    #[schema(value_type = Option<f64>)]
    pub chi2_before: f64,
    /// chi² per sample with the effects found.
    #[schema(value_type = Option<f64>)]
    pub chi2_after: f64,
    /// Variance of 0.25 s means over that of white noise, with the effects found.
    #[schema(value_type = Option<f64>)]
    pub block_variance: f64,
    /// The same as a normal score: above 6 the channel is not explained.
    #[schema(value_type = Option<f64>)]
    pub whiteness_score: f64,
}

/// Absolute goodness of fit.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Goodness {
    /// Fraction of the excess low-frequency error (0.25 s means) explained by the effects found; absent if there is
    /// no excess.
    pub explained_share: Option<f64>,
    /// By channel.
    pub channels: Vec<ChannelGoodness>,
    /// Channels with an unexplained error.
    pub unexplained: Vec<String>,
}

/// Seconds that parts of the diagnosis took.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Timing {
    /// Until the ranking stood, s.
    pub ranked_s: f64,
    /// In all, s.
    pub total_s: f64,
}

/// The model that a diagnosis was made on.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct DiagnosedModel {
    /// Its name.
    pub name: String,
    /// Content hash of its version.
    pub hash: String,
}

/// Result of a diagnosis.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Diagnosis {
    /// The model that the logs were compared with; the findings apply to no other one.
    pub model: DiagnosedModel,
    /// The answer.
    pub verdict: Verdict,
    /// The verdict in a sentence.
    pub sentence: String,
    /// Missing physics, in the order in which it was found.
    pub effects: Vec<Finding>,
    /// Faults of sensors and clocks of the log.
    pub sensor_or_timing: Vec<Finding>,
    /// Guessed constants of the vehicle for which the flights indicate another value.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub calibrate: Vec<Calibration>,
    /// All candidates, ranked on the given model, best first.
    pub ranking: Vec<Ranked>,
    /// What this flight cannot show.
    pub not_testable: Vec<NotTestable>,
    /// What could not be considered, with the column or setting that would make it testable.
    pub not_considered: Vec<NotConsidered>,
    /// The smallest detectable size of each effect.
    pub detectable: Vec<NotTestable>,
    /// Absolute goodness of fit.
    pub goodness: Goodness,
    /// What is left in each channel that stays unexplained, strongest first: frequencies, onset, the signal that it follows.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub remainder: Vec<Remainder>,
    /// Errors on held-out blocks.
    pub held_out: Vec<HeldOutError>,
    /// For an error that is not in the catalogue: terms that would explain it, as a user-defined effect.
    pub proposal: Option<Proposal>,
    /// Changes with respect to healthy flights, if any were given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trim: Option<Trim>,
    /// Wind of each flight, where the model gives each one of its own or the flights have no explanation in one wind.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub winds: Vec<FlightWind>,
    /// What each flight has, or each group of flights with the same answer, where nothing explains them all together.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub apart: Vec<FlightsApart>,
    /// Logs.
    pub logs: Vec<String>,
    /// What was left out or assumed.
    pub notes: Vec<String>,
    /// Threshold on the ln Bayes factor.
    pub threshold: f64,
    /// How exact the constants of the model are taken to be, half widths of 95 % intervals: `mass 0.39 %; inertia, roll 0.59 %; …`.
    /// `NAME.intervals.toml` beside the vehicle says otherwise.
    pub assumed: String,
    /// Seconds; absent from results that must not depend on the machine.
    #[serde(skip)]
    pub timing: Timing,
    /// Limit at which the search was stopped, s.
    #[serde(skip)]
    pub(crate) stopped_at_s: Option<f64>,
}

/// The answer of some of the flights, which the others contradict.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct FlightsApart {
    /// The logs.
    pub logs: Vec<String>,
    /// The answer.
    pub verdict: Verdict,
    /// The answer in a sentence.
    pub sentence: String,
    /// Missing physics.
    pub effects: Vec<Finding>,
    /// Faults of sensors and clocks.
    pub sensor_or_timing: Vec<Finding>,
    /// Errors on held-out blocks.
    pub held_out: Vec<HeldOutError>,
}

/// The steady wind of a flight, fitted with its rotor biases and its charge.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct FlightWind {
    /// The log.
    pub log: String,
    /// Where the air moves to, north and east, m/s.
    pub parameters: Vec<FittedParameter>,
    /// False if the flight turns too little to distinguish its wind from sensors that are off in this flight alone: a bias of the
    /// accelerometer, a tilted mounting.
    pub distinguished: bool,
}

/// A guessed constant of the vehicle, and the value that the flights indicate.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = ConstantToCalibrate)]
pub struct Calibration {
    /// Key of the vehicle document, or a name of its own.
    pub key: String,
    /// In words.
    pub name: String,
    /// SI unit; empty for a ratio.
    pub unit: String,
    /// Value in the vehicle document.
    pub value: f64,
    /// Lower end of the 95 % interval of the guess.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Whether the value comes from the size class alone or was narrowed by a log.
    pub source: Source,
    /// Value that the flights indicate.
    pub wanted: f64,
    /// Half width of its 95 % interval, everything else unchanged.
    pub wanted_interval_95: f64,
    /// ln of the Bayes factor against the present value.
    pub ln_bayes_factor: f64,
    /// True if nothing can be called missing before the constant is known; false if the guess is plausible for the
    /// size class and the flights only refine it.
    pub blocking: bool,
    /// Why it was guessed.
    pub how: String,
    /// How to improve it.
    pub better: String,
    /// The effect that corrects it in a model.
    pub correction: Correction,
}

/// The effect that represents the error of a constant, with the values that the flights indicate: with it, the
/// model behaves as if the constant had its indicated value.
#[derive(Debug, Clone, Default, PartialEq, Serialize, ToSchema)]
#[schema(as = ConstantCorrection)]
pub struct Correction {
    /// Id in the catalogue.
    pub effect: String,
    /// Rotor, from 1, of an effect of one rotor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotor: Option<usize>,
    /// Values by name.
    pub parameters: BTreeMap<String, f64>,
    /// Standard deviations by name.
    pub deviations: BTreeMap<String, f64>,
}
