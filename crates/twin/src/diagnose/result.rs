//! What a diagnosis says: the structure that JSON, terminal and report share.

use rotortwin_plant::effects::{EffectClass, EffectInstance};
use serde::Serialize;

use crate::propose::Proposal;
use crate::trim::Trim;

/// The answer in one word.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Verdict {
    /// The model agrees with the flight.
    Agrees,
    /// Physics is missing, and named.
    Missing {
        /// Ids of the effects.
        effects: Vec<String>,
    },
    /// Physics is missing, and this flight cannot tell which of a group.
    CannotTell {
        /// Ids of the effects, best first.
        group: Vec<String>,
    },
    /// The error is real and not, or not wholly, explained by the catalogue.
    OutsideCatalogue,
    /// Sensors or clocks of the log are at fault; the physics agrees.
    LogFault {
        /// Ids of the faults.
        effects: Vec<String>,
    },
    /// Nothing of the log can be held against the model.
    NothingTestable,
}

/// A parameter with its interval.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FittedParameter {
    /// Key in documents.
    pub name: String,
    /// Letter.
    pub symbol: String,
    /// Unit.
    pub unit: String,
    /// Value.
    pub value: f64,
    /// Standard deviation.
    pub deviation: f64,
    /// Half width of the 95 % interval.
    pub interval_95: f64,
    /// False outside the plausible range.
    pub plausible: bool,
}

/// Error on blocks that the fit did not see, smoothed over 0.1 s.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HeldOutError {
    /// `force`, `torque` or `voltage`.
    pub quantity: String,
    /// Unit.
    pub unit: String,
    /// Without the effects found.
    pub before: f64,
    /// With them.
    pub after: f64,
}

/// A rival that explains the data nearly as well, or why it lost.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rival {
    /// Id in the catalogue.
    pub effect: String,
    /// Rotor, from 1.
    pub rotor: Option<usize>,
    /// Name shown.
    pub label: String,
    /// ln of the Bayes factor of the finding against it.
    pub evidence_gap: f64,
    /// Why it lost, or that it did not.
    pub reason: String,
}

/// An effect that was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// As documents name it.
    pub instance: EffectInstance,
    /// Name shown.
    pub label: String,
    /// Physics, sensor fault or timing fault.
    pub class: EffectClass,
    /// Equation.
    pub equation: String,
    /// Parameters with intervals.
    pub parameters: Vec<FittedParameter>,
    /// ln of the Bayes factor against clutter.
    pub ln_bayes_factor: f64,
    /// Posterior probability among the library with equal prior odds.
    pub posterior: f64,
    /// Channels in which the effect shows most, strongest first.
    pub channels: Vec<String>,
    /// Rivals with an evidence gap below 5.
    pub also_compatible: Vec<Rival>,
    /// Rivals that were tried and lost.
    pub lost: Vec<Rival>,
    /// When it sets in, if not from the start.
    pub onset_s: Option<f64>,
    /// In plain words.
    pub reason: String,
}

/// One row of the ranking about the given model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ranked {
    /// Id in the catalogue.
    pub effect: String,
    /// Rotor, from 1.
    pub rotor: Option<usize>,
    /// Name shown.
    pub label: String,
    /// Equation.
    pub equation: String,
    /// Class.
    pub class: EffectClass,
    /// Parameters by the linear fit.
    pub parameters: Vec<FittedParameter>,
    /// ln of the Bayes factor against clutter.
    pub ln_bayes_factor: f64,
    /// Change of chi² on the held-out blocks, both ways; negative is better.
    pub held_out_chi2_change: f64,
}

/// An effect that this flight cannot show at its plausible size.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NotTestable {
    /// Id in the catalogue.
    pub effect: String,
    /// Rotor, from 1.
    pub rotor: Option<usize>,
    /// Name shown.
    pub label: String,
    /// Parameter.
    pub parameter: String,
    /// Unit.
    pub unit: String,
    /// Plausible size.
    pub plausible_size: f64,
    /// Smallest size with an expected ln Bayes factor of the threshold; absent where the flight says nothing at all.
    pub minimum_size: Option<f64>,
    /// What would excite it.
    pub excited_by: String,
}

/// How well the model fits, before and after.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChannelGoodness {
    /// Log.
    pub log: String,
    /// Channel.
    pub channel: String,
    /// chi² per sample of the given model, nuisances fitted.
    pub chi2_before: f64,
    /// chi² per sample with the effects found.
    pub chi2_after: f64,
    /// Variance of 0.25 s means over that of white noise, with the effects found.
    pub block_variance: f64,
    /// The same as a normal score: above 6 the channel is not explained.
    pub whiteness_score: f64,
}

/// Absolute goodness of fit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Goodness {
    /// Share of the slow excess error (0.25 s means) that the effects found explain; absent if there is no excess.
    pub explained_share: Option<f64>,
    /// By channel.
    pub channels: Vec<ChannelGoodness>,
    /// Channels with an error that nothing explains.
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

/// What a diagnosis says.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diagnosis {
    /// The answer.
    pub verdict: Verdict,
    /// The answer in a sentence.
    pub sentence: String,
    /// Missing physics, in the order in which it was found.
    pub effects: Vec<Finding>,
    /// Faults of sensors and clocks of the log.
    pub sensor_or_timing: Vec<Finding>,
    /// All candidates about the given model, best first.
    pub ranking: Vec<Ranked>,
    /// What this flight cannot show.
    pub not_testable: Vec<NotTestable>,
    /// The smallest size of each effect that would have been seen.
    pub detectable: Vec<NotTestable>,
    /// Absolute goodness of fit.
    pub goodness: Goodness,
    /// Errors on held-out blocks.
    pub held_out: Vec<HeldOutError>,
    /// Where the error is not in the catalogue: terms that would explain it, as an effect of a user.
    pub proposal: Option<Proposal>,
    /// What the logs have changed against healthy flights, if any were given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trim: Option<Trim>,
    /// Logs.
    pub logs: Vec<String>,
    /// What was left out or assumed.
    pub notes: Vec<String>,
    /// Threshold on the ln Bayes factor.
    pub threshold: f64,
    /// Seconds; absent from results that must not depend on the machine.
    #[serde(skip)]
    pub timing: Timing,
}
