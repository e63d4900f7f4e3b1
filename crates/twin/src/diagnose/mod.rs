//! Diagnosis: which effect of the catalogue the model lacks on these flights, with evidence; or that none is missing; or that the
//! error is real and not in the catalogue.
//!
//! ```text
//! logs ─▶ nuisances fitted ─▶ linearised about the model: residual, Jacobian of the whole library, normal matrices of 5 s blocks
//!      ─▶ evidence of every candidate (spike and slab) ─▶ the leading few refined by Gauss–Newton ─▶ the best is added
//!      └──────────────────────────────── again, until none passes ln BF 10 ◀──────────────────────────┘
//!      ─▶ absolute goodness of fit ─▶ verdict
//! ```
//! * Candidates are all effects of the catalogue on all rotors; each parameter of the library that is not the candidate's stays in
//!   the model as clutter of 2 % of its plausible size.
//! * An effect is named if its ln Bayes factor exceeds the threshold, its size is at least the smallest detectable one,
//!   and its values are plausible. A flight with hardly any motion needs a ln Bayes factor of 20.
//!
//! * Effects that a ranking about zero cannot reach have starts of their own: wind with a drag, unknown shapes (a wall,
//!   a rope), delays of several samples, a battery at another charge, effects that set in late, swapped or reversed
//!   rotors.
//! * An effect that a later one has made superfluous is removed; three that are easily confused with one another are
//!   not accepted.
//!
//! Gusts are noise, not a column: where forces stay unexplained despite a drag, their covariance is tried
//! (`strategies/covariance.rs`).

mod air;
mod apart;
mod calibration;
mod considered;
mod described;
mod findings;
mod named;
mod passes;
mod picture;
mod ranking;
mod remainder;
mod result;
mod search;
mod several;
mod state;
mod strategies;
mod supply;
mod words;

pub use result::{
    Calibration, ChannelGoodness, DiagnosedModel, Diagnosis, Finding, FlightWind, FlightsApart, Follows, FrequencyBand,
    Goodness, HeldOutError, Line, NotConsidered, NotTestable, Picture, PictureBin, Ranked, Remainder, RemainderOnset,
    Rival, Timing, Verdict,
};
pub use words::in_sentence;
pub(crate) use words::small_errors;

use rotortwin_plant::effects::EffectDocument;

use crate::log::FlightLog;
use crate::model::{ModelVersion, constants};
use crate::predict::{PredictError, Predictor};
use crate::{baseline, propose};

/// Threshold on the ln Bayes factor.
pub const THRESHOLD: f64 = 10.0;
/// The same for a flight that hardly moves.
pub const THRESHOLD_AT_REST: f64 = 20.0;

/// How to diagnose.
pub struct Options<'a> {
    /// Effects of users that may be named besides those of the catalogue and of the model.
    pub effects: Vec<EffectDocument>,
    /// Healthy flights of the same vehicle: changes of the logs relative to them are reported as well. None: no such
    /// answer.
    pub baseline: Vec<FlightLog>,
    /// Most effects that are looked for one after the other.
    pub most_effects: usize,
    /// Receives what is being done and what share of it, 0 to 1.
    pub progress: &'a (dyn Fn(&str, f64) + Sync),
    /// Seconds since some moment; the library reads no clock.
    pub clock: &'a dyn Fn() -> f64,
    /// Seconds on that clock after which the search begins nothing further, and answers with what it has confirmed by
    /// then.
    pub time_limit_s: f64,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self {
            effects: Vec::new(),
            baseline: Vec::new(),
            most_effects: 3,
            progress: &|_, _| (),
            clock: &|| 0.0,
            time_limit_s: f64::INFINITY,
        }
    }
}

impl Options<'_> {
    /// True if a search that began then has used up its time.
    fn is_over(&self, began_s: f64) -> bool {
        (self.clock)() - began_s > self.time_limit_s
    }
}

impl std::fmt::Debug for Options<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Options")
            .field("most_effects", &self.most_effects)
            .finish_non_exhaustive()
    }
}

/// Compares the model with the logs and reports what is missing. Several logs share the vehicle; each has its own
/// nuisances, and if nothing explains them in one wind, a wind of its own; and if that explains them neither, what each
/// has alone is the answer.
///
/// # Errors
/// One sentence: a log cannot be compared with the model, or the model's effects are not valid.
pub fn diagnose(logs: &[FlightLog], model: &ModelVersion, options: &Options<'_>) -> Result<Diagnosis, PredictError> {
    if logs.is_empty() {
        return Err(PredictError("expected at least one log, got none".into()));
    }
    let start = (options.clock)();
    let changed = if options.baseline.is_empty() {
        None
    } else {
        Some(baseline::trim(logs, &options.baseline, model)?)
    };
    let mut diagnosis = several::diagnose_flights(logs, model, options)?;
    let guesses = model.guesses();
    let makes_up_for_guesses = model.lacks_intervals() && diagnosis.verdict != Verdict::Agrees;
    if let (true, Some(warning)) = (makes_up_for_guesses, &guesses) {
        diagnosis.sentence = format!("{warning}. Put it there first. {}", diagnosis.sentence);
    }
    if model.constant.is_empty() {
        diagnosis.sentence.push_str(&words::as_exact_as_the_file(&diagnosis));
    }
    diagnosis.notes.extend(guesses);
    if diagnosis.verdict == Verdict::OutsideCatalogue {
        (options.progress)("what the error looks like", 0.995);
        let proposal = propose::propose(logs, model)?;
        diagnosis.proposal = Some(proposal);
    }
    diagnosis.trim = changed;
    diagnosis.model = DiagnosedModel {
        name: model.name.clone(),
        hash: model.hash(),
    };
    diagnosis.timing.total_s = (options.clock)() - start;
    (options.progress)("done", 1.0);
    Ok(diagnosis)
}

/// The search by this model.
fn search_by(logs: &[&FlightLog], model: &ModelVersion, options: &Options<'_>) -> Result<Diagnosis, PredictError> {
    let start = (options.clock)();
    (options.progress)("reading", 0.0);
    let (documents, instances) = (model.documents(), model.instances());
    let catalogue = model.with_documents(&options.effects).catalogue()?;
    let predictors = logs
        .iter()
        .map(|log| {
            let predictor = Predictor::new(&documents, &instances, &catalogue, log)?;
            Ok(predictor
                .with_chart(model.guesses_its_chart())
                .with_own_wind(model.wind_of_each_flight))
        })
        .collect::<Result<Vec<_>, PredictError>>()?;
    let constants = constants::with_exact(&model.vehicle, &model.constant);
    search::search(predictors, &catalogue, &instances, &constants, options, start)
}
