//! Improvement: the whole loop from a model that fails to one that agrees, version by version, on the logs that it is
//! fitted to and on held-out logs.
//!
//! ```text
//! version 0 ─▶ compare ─▶ diagnose ─▶ the best effect as a proposal ─ accepted ─▶ version 1 ─▶ compare ─▶ …
//!                            └─ agrees · log at fault · cannot tell · nothing that unseen blocks prove · declined ─▶ end, with the reason
//! ```
//! * If a diagnosis names several effects, they are added one at a time, so that each has a row of its own.
//! * The values of a row are those of the joint fit ([`refit`]): all effects and the nuisances of every fitted log together,
//!   without clutter. The deviations are those of the diagnosis, which has the clutter in them, and so are the values
//!   where the joint fit leaves them by more than three deviations: it then absorbs what is unexplained.
//! * What makes an error of a held-out log larger is not added. If it is a wind, each flight gets one of its own first, fitted to its log
//!   with its other nuisances.
//! * The oracle is a model with the truth; no fit can beat its row except by chance.
//!
//! Limits: what a diagnosis calls a fault of the log is never put into a model. Where a part of the error stays
//! unexplained, an effect is added only if held-out blocks confirm its part. The same holds for the proposal of a
//! regression ([`crate::propose`]): a correlation with a dimension, reported as such.

pub mod from_diagnosis;
mod proposals;
pub mod refit;
pub mod report;
pub mod truth;

use rotortwin_plant::effects::EffectDocument;
use serde::Serialize;
use utoipa::ToSchema;

use crate::compare::{self, GroupError, NamedModel, OpenLoopError};
use crate::diagnose::{self, Diagnosis, Finding, Verdict, diagnose};
use crate::estimation::parameters::FittedParameter;
use crate::estimation::parameters::QUANTILE_95;
use crate::log::FlightLog;
use crate::model::{LogReference, ModelEffect, ModelVersion, Provenance, Source, TOOL};
use crate::predict::PredictError;
use proposals::Proposals;

/// Maximum number of diagnoses: a vehicle that still lacks something after that needs a human.
const MOST_ROUNDS: usize = 4;
/// Growth of an error of a held-out log, in noise, above which a row remarks on it.
const WORSE: f64 = 0.1;

/// A parameter as a row shows it.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = ImprovementValue)]
pub struct ParameterValue {
    /// Key in documents.
    pub name: String,
    /// Letter.
    pub symbol: String,
    /// Unit.
    pub unit: String,
    /// Value.
    #[schema(value_type = Option<f64>)]
    pub value: f64,
    /// Half width of the 95 % interval.
    #[schema(value_type = Option<f64>)]
    pub interval_95: f64,
}

/// One version on one log.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = ImprovementOnLog)]
pub struct OnLog {
    /// Log.
    pub log: String,
    /// True if no fit has seen it.
    pub held_out: bool,
    /// Result of the comparison.
    pub agrees: bool,
    /// Mean chi² of the tested channels.
    #[schema(value_type = Option<f64>)]
    pub chi2: f64,
    /// Errors by quantity, with the level of pure noise.
    pub errors: Vec<GroupError>,
    /// Open-loop prediction.
    pub open_loop: Vec<OpenLoopError>,
}

/// One step of the waterfall chart.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = ImprovementRow)]
pub struct Row {
    /// `f550@v1`, or `oracle`.
    pub version: String,
    /// Content hash.
    pub hash: String,
    /// What this version adds to the previous one.
    pub added: Option<String>,
    /// Its parameters.
    pub parameters: Vec<ParameterValue>,
    /// ln of the Bayes factor of the addition.
    pub ln_bayes_factor: Option<f64>,
    /// True for the row of the true model.
    pub oracle: bool,
    /// On each log, fitted ones first.
    pub logs: Vec<OnLog>,
    /// Anything unusual about this step.
    pub remarks: Vec<String>,
}

/// Why the loop ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
#[schema(as = ImprovementEnd)]
pub enum End {
    /// Nothing is missing that would show.
    Agrees,
    /// Sensors or clocks of a log are at fault.
    LogFault,
    /// Constants of the vehicle are guesses that the flights contradict.
    CalibrateFirst,
    /// The error is real and not in the catalogue.
    OutsideCatalogue,
    /// Nothing explains the flights together; each alone is explained.
    FlightsDiffer,
    /// These flights cannot tell.
    CannotTell,
    /// The logs hold nothing to test.
    NothingTestable,
    /// What was found makes an error of a held-out log larger, so it is not added.
    HeldOutRises,
    /// A step was declined.
    Declined,
    /// Something is still missing after the last round.
    MostRounds,
}

/// Result of the improvement loop.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct Improvement {
    /// Program and version.
    pub tool: &'static str,
    /// Why it ended.
    pub end: End,
    /// Reason in one sentence.
    pub reason: String,
    /// Versions, in order; the oracle last.
    pub rows: Vec<Row>,
    /// Fitted logs.
    pub fitted: Vec<LogReference>,
    /// Logs that no fit has seen.
    pub held_out: Vec<LogReference>,
    /// The last diagnosis.
    pub diagnosis: Option<Diagnosis>,
    /// The last version.
    #[serde(skip)]
    pub model: ModelVersion,
    /// What to fly next, if known.
    pub next_flight: Option<String>,
}

/// Asked before each step. An error ends the loop.
pub trait Guide {
    /// A version was compared: continue with a diagnosis?
    ///
    /// # Errors
    /// The guide cannot continue.
    fn compared(&mut self, row: &Row) -> Result<bool, String>;
    /// An effect is proposed: `next` is the version with it. The label of the kept version, or `None` if it is declined.
    ///
    /// # Errors
    /// The version cannot be kept.
    fn proposed(
        &mut self,
        before: &ModelVersion,
        next: &ModelVersion,
        finding: &Finding,
        diagnosis: &Diagnosis,
    ) -> Result<Option<String>, String>;
}

/// Takes every step without asking and keeps no version: for use without a user.
#[derive(Debug, Default)]
pub struct Unasked {
    versions: u32,
}

impl Guide for Unasked {
    fn compared(&mut self, _: &Row) -> Result<bool, String> {
        Ok(true)
    }

    fn proposed(
        &mut self,
        before: &ModelVersion,
        _: &ModelVersion,
        _: &Finding,
        _: &Diagnosis,
    ) -> Result<Option<String>, String> {
        self.versions += 1;
        Ok(Some(format!("{}@v{}", before.name, self.versions)))
    }
}

/// Inputs of the loop.
#[derive(Debug, Clone, Copy)]
pub struct Request<'a> {
    /// Version to begin with.
    pub model: &'a NamedModel,
    /// Logs to fit.
    pub fitted: &'a [FlightLog],
    /// Logs that no fit sees.
    pub held_out: &'a [FlightLog],
    /// The truth, if it is known.
    pub oracle: Option<&'a ModelVersion>,
}

/// Why the loop failed.
#[derive(Debug, thiserror::Error)]
pub enum ImproveError {
    /// A log or a model cannot be used.
    #[error(transparent)]
    Input(#[from] PredictError),
    /// The guide could not continue.
    #[error("{0}")]
    Guide(String),
}

/// Runs the loop.
///
/// # Errors
/// A log that cannot be compared with the model, or a guide that cannot continue.
pub fn improve(
    request: &Request<'_>,
    options: &diagnose::Options<'_>,
    guide: &mut dyn Guide,
) -> Result<Improvement, ImproveError> {
    let mut now = request.model.clone();
    let mut rows = vec![row(request, &now, None)?];
    let mut last = None;
    let mut end = None;
    let mut asked = guide.compared(&rows[0]).map_err(ImproveError::Guide)?;
    'rounds: for _ in 0..MOST_ROUNDS {
        if !asked {
            end = Some(End::Declined);
            break;
        }
        let diagnosis = last.insert(diagnose(request.fitted, &now.version, options)?);
        end = match &diagnosis.verdict {
            Verdict::Agrees => Some(End::Agrees),
            Verdict::LogFault { .. } => Some(End::LogFault),
            Verdict::CalibrateFirst { .. } => Some(End::CalibrateFirst),
            Verdict::OutsideCatalogue if proposed(diagnosis).is_some() => None,
            Verdict::OutsideCatalogue => Some(End::OutsideCatalogue),
            Verdict::FlightsDiffer { .. } => Some(End::FlightsDiffer),
            Verdict::CannotTell { .. } => Some(End::CannotTell),
            Verdict::NothingTestable => Some(End::NothingTestable),
            Verdict::Missing { .. } | Verdict::PartlyMissing { .. } => None,
        };
        if end.is_some() {
            break;
        }
        if let (Verdict::OutsideCatalogue, Some(part)) = (&diagnosis.verdict, proposed(diagnosis)) {
            // A part that no fit of its blocks has seen and that is not in the catalogue is a step like any other.
            let next = with_proposal(&now.version, &part, request.fitted);
            let kept = guide
                .proposed(&now.version, &next, &part.finding, diagnosis)
                .map_err(ImproveError::Guide)?;
            let Some(label) = kept else {
                end = Some(End::Declined);
                break;
            };
            now = NamedModel { label, version: next };
            let mut next_row = row(request, &now, Some(&part.finding))?;
            if let Some(before) = rows.last() {
                next_row.remarks = remarks(before, &next_row);
            }
            asked = guide.compared(&next_row).map_err(ImproveError::Guide)?;
            rows.push(next_row);
            continue;
        }
        let Some(trial) = accepted(request, &now.version, diagnosis, options)? else {
            end = Some(End::HeldOutRises);
            break;
        };
        for finding in &trial.proposals.findings {
            let mut next = trial.proposals.added(&now.version, finding, request.fitted);
            for effect in &mut next.effect {
                if let Some(fitted) = trial.version.effect.iter().find(|other| other.is_same_term(effect)) {
                    effect.parameters.clone_from(&fitted.parameters);
                }
            }
            let kept = guide
                .proposed(&now.version, &next, finding, diagnosis)
                .map_err(ImproveError::Guide)?;
            let Some(label) = kept else {
                end = Some(End::Declined);
                break 'rounds;
            };
            now = NamedModel { label, version: next };
            let mut next_row = row(request, &now, Some(finding))?;
            if let Some(before) = rows.last() {
                next_row.remarks = remarks(before, &next_row);
            }
            asked = guide.compared(&next_row).map_err(ImproveError::Guide)?;
            rows.push(next_row);
            if !asked {
                end = Some(End::Declined);
                break 'rounds;
            }
        }
    }
    if let Some(oracle) = request.oracle {
        let named = NamedModel {
            label: "oracle".to_owned(),
            version: oracle.clone(),
        };
        let mut oracle = row(request, &named, None)?;
        oracle.oracle = true;
        oracle.added = Some(
            named
                .version
                .effect
                .iter()
                .map(ModelEffect::label)
                .collect::<Vec<_>>()
                .join(", "),
        );
        rows.push(oracle);
    }
    let end = end.unwrap_or(End::MostRounds);
    Ok(Improvement {
        tool: TOOL,
        end,
        reason: reason(end, &now.label, last.as_ref()),
        rows,
        fitted: references(request.fitted),
        held_out: references(request.held_out),
        diagnosis: last,
        model: now.version,
        next_flight: None,
    })
}

/// What a diagnosis wants added, fitted together; `None` if an error of a held-out log grows with it.
fn accepted(
    request: &Request<'_>,
    version: &ModelVersion,
    diagnosis: &Diagnosis,
    options: &diagnose::Options<'_>,
) -> Result<Option<Trial>, PredictError> {
    let catalogue = version.with_documents(&options.effects).catalogue()?;
    let found = Trial::of(Proposals::of(diagnosis, version, &catalogue), request, version)?;
    // A wind of the fitted flights need not be that of the held-out ones.
    if !request.held_out.is_empty()
        && let Some(own) = found.proposals.in_winds_of_their_own(&catalogue)
    {
        let own = Trial::of(own, request, version)?;
        let is_better = !remarks(&own.after, &found.after).is_empty();
        if is_better && !own.raises_an_error() {
            return Ok(Some(own));
        }
    }
    Ok((!found.raises_an_error()).then_some(found))
}

/// Proposals that were fitted, and the held-out logs without and with them.
struct Trial {
    proposals: Proposals,
    version: ModelVersion,
    before: Row,
    after: Row,
}

impl Trial {
    fn of(proposals: Proposals, request: &Request<'_>, version: &ModelVersion) -> Result<Self, PredictError> {
        let fitted = proposals.fitted_to(version, request.fitted)?;
        Ok(Self {
            // The winds of held-out flights are no merit of what is added with them.
            before: unseen(request, &proposals.with_winds_alone(version))?,
            after: unseen(request, &fitted)?,
            proposals,
            version: fitted,
        })
    }

    fn raises_an_error(&self) -> bool {
        !remarks(&self.before, &self.after).is_empty()
    }
}

/// A version on the held-out logs.
fn unseen(request: &Request<'_>, version: &ModelVersion) -> Result<Row, PredictError> {
    let named = NamedModel {
        label: version.name.clone(),
        version: version.clone(),
    };
    let unseen = Request {
        fitted: &[],
        ..*request
    };
    row(&unseen, &named, None)
}

fn references(logs: &[FlightLog]) -> Vec<LogReference> {
    logs.iter()
        .map(|log| LogReference {
            name: log.name.clone(),
            hash: log.source.content_hash.clone(),
        })
        .collect()
}

/// A proposal that was proved, as a step.
struct Part {
    document: EffectDocument,
    finding: Finding,
}

/// The proposal of a diagnosis for an error that is not in the catalogue, if blocks that no fit has seen confirm it.
fn proposed(diagnosis: &Diagnosis) -> Option<Part> {
    let proposal = diagnosis.proposal.as_ref()?;
    let document = proposal.document.clone()?;
    let acts: Vec<String> = proposal.terms.iter().map(|term| term.acts.join(", ")).collect();
    let parameters = proposal
        .terms
        .iter()
        .map(|term| FittedParameter {
            name: term.parameter.clone(),
            symbol: term.parameter.clone(),
            unit: term.unit.clone(),
            value: term.factor,
            deviation: term.deviation,
            interval_95: QUANTILE_95 * term.deviation,
            plausible: true,
        })
        .collect();
    // A regression computes no evidence; what supports it is the error on unseen blocks.
    let finding = Finding::without_evidence(
        proposal.instance()?,
        format!("Proposed: {}", acts.join("; ")),
        proposal.sentence(),
        parameters,
        proposal.sentence(),
    );
    Some(Part { document, finding })
}

/// The version with a proposal.
fn with_proposal(version: &ModelVersion, part: &Part, logs: &[FlightLog]) -> ModelVersion {
    let of = |value: fn(&FittedParameter) -> f64| {
        let parameters = part.finding.parameters.iter();
        parameters.map(|p| (p.name.clone(), value(p))).collect()
    };
    let effect = ModelEffect {
        effect: part.document.id.clone(),
        rotor: None,
        onset_s: None,
        parameters: of(|p| p.value),
        deviations: of(|p| p.deviation),
        provenance: Provenance {
            source: Source::Diagnosis,
            tool: TOOL.to_owned(),
            ln_bayes_factor: None,
            posterior: None,
            log: references(logs),
            held_out: Vec::new(),
        },
    };
    version
        .with_effects([effect], "improve: a proposal of the regression")
        .with_documents(std::slice::from_ref(&part.document))
}

/// The version with the values of a finding.
fn with_finding(version: &ModelVersion, finding: &Finding, logs: &[FlightLog]) -> ModelVersion {
    let effect = ModelEffect {
        effect: finding.instance.effect.clone(),
        rotor: finding.instance.rotor,
        onset_s: finding.onset_s,
        parameters: finding.parameters.iter().map(|p| (p.name.clone(), p.value)).collect(),
        deviations: finding
            .parameters
            .iter()
            .map(|p| (p.name.clone(), p.deviation))
            .collect(),
        provenance: Provenance {
            source: Source::Diagnosis,
            tool: TOOL.to_owned(),
            ln_bayes_factor: Some(finding.ln_bayes_factor),
            posterior: Some(finding.posterior),
            log: references(logs),
            held_out: Vec::new(),
        },
    };
    // A finding without a value is no effect: the winds of the flights.
    version.with_effects(
        (!finding.parameters.is_empty()).then_some(effect),
        format!("improve: {}", crate::diagnose::in_sentence(&finding.label)),
    )
}

fn row(request: &Request<'_>, model: &NamedModel, finding: Option<&Finding>) -> Result<Row, PredictError> {
    let mut logs = Vec::new();
    for (held_out, group) in [(false, request.fitted), (true, request.held_out)] {
        let (comparison, _) = compare::compare(group, std::slice::from_ref(model))?;
        for log in comparison.logs {
            for result in log.models {
                logs.push(OnLog {
                    log: log.log.name.clone(),
                    held_out,
                    agrees: result.agrees,
                    chi2: result.chi2,
                    errors: result.errors,
                    open_loop: result.open_loop,
                });
            }
        }
    }
    let added = finding.and_then(|finding| effect_of(&model.version, finding));
    let value = |p: &FittedParameter| {
        let fitted = added.and_then(|effect| effect.parameters.get(&p.name));
        ParameterValue {
            name: p.name.clone(),
            symbol: p.symbol.clone(),
            unit: p.unit.clone(),
            value: fitted.copied().unwrap_or(p.value),
            interval_95: p.interval_95,
        }
    };
    Ok(Row {
        version: model.label.clone(),
        hash: model.version.hash(),
        added: finding.map(|f| f.label.clone()),
        parameters: finding.map_or_else(Vec::new, |f| f.parameters.iter().map(value).collect()),
        ln_bayes_factor: finding.map(|f| f.ln_bayes_factor).filter(|value| value.is_finite()),
        oracle: false,
        logs,
        remarks: Vec::new(),
    })
}

/// The effect of a version that a finding is of.
fn effect_of<'a>(version: &'a ModelVersion, finding: &Finding) -> Option<&'a ModelEffect> {
    let wanted = &finding.instance;
    let same = |effect: &&ModelEffect| effect.effect == wanted.effect && effect.rotor == wanted.rotor;
    version.effect.iter().find(same)
}

/// Whether the values of a joint fit without clutter are those of the findings within three deviations. Where something
/// is left unexplained, such a fit absorbs it, in values that belong to no finding.
fn stays_within(refitted: &ModelVersion, findings: &[Finding]) -> bool {
    /// Deviations, and the least share of a value that counts as a difference.
    const FAR: f64 = 3.0;
    const SHARE: f64 = 0.02;
    findings.iter().all(|finding| {
        let Some(effect) = effect_of(refitted, finding) else {
            return true;
        };
        finding.parameters.iter().all(|p| {
            let fitted = effect.parameters.get(&p.name).copied().unwrap_or(p.value);
            (fitted - p.value).abs() <= (FAR * p.deviation).max(SHARE * p.value.abs())
        })
    })
}

/// Errors of held-out logs that grew.
fn remarks(before: &Row, after: &Row) -> Vec<String> {
    let mut found = Vec::new();
    let [before, after] = [before, after].map(|row| row.logs.iter().filter(|log| log.held_out));
    for (old, new) in before.zip(after) {
        for (a, b) in old.errors.iter().zip(&new.errors) {
            if b.error > a.error + WORSE * b.noise {
                found.push(format!(
                    "{}: the {} error grew from {:.3} to {:.3} {}: this effect may belong to the fitted flight alone",
                    new.log, b.quantity, a.error, b.error, b.unit
                ));
            }
        }
    }
    found
}

fn reason(end: End, label: &str, diagnosis: Option<&Diagnosis>) -> String {
    let sentence = diagnosis.map_or("", |d| d.sentence.as_str());
    match end {
        End::Agrees => {
            let small = diagnosis.map_or_else(String::new, diagnose::small_errors);
            format!("{label} agrees: no effect of the catalogue is missing at a size that would show.{small}")
        }
        End::LogFault => format!("Ended: fix the log, not the model. {sentence}"),
        End::OutsideCatalogue => {
            let proposal = diagnosis.and_then(|d| d.proposal.as_ref());
            let proposal = proposal.map_or_else(String::new, |p| format!(" {}", p.sentence()));
            format!("Ended at {label}, nothing is added to it. {sentence}{proposal}")
        }
        End::HeldOutRises => format!(
            "Ended at {label}, nothing is added to it: with what was found an error of a held-out log grows, so it belongs to the fitted flights alone. {sentence}"
        ),
        End::FlightsDiffer => {
            format!("Ended at {label}, nothing is added to it: improve it by flights that are alike. {sentence}")
        }
        End::CannotTell | End::CalibrateFirst => format!("Ended at {label}, nothing is added to it. {sentence}"),
        End::NothingTestable => format!("Ended. {sentence}"),
        End::Declined => format!("Ended at {label}: the next step was declined."),
        End::MostRounds => {
            format!("Ended at {label} after {MOST_ROUNDS} rounds with something still missing. {sentence}")
        }
    }
}

impl Improvement {
    /// The row of the last version.
    pub fn last(&self) -> &Row {
        let own = self.rows.iter().rev().find(|row| !row.oracle);
        own.expect("the loop begins with a row")
    }

    /// The row of the truth.
    pub fn oracle(&self) -> Option<&Row> {
        self.rows.iter().find(|row| row.oracle)
    }
}

impl OnLog {
    /// Error of a quantity.
    pub fn error_of(&self, quantity: &str) -> Option<&GroupError> {
        self.errors.iter().find(|error| error.quantity == quantity)
    }
}
