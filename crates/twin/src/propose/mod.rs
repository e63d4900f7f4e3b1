//! Proposal for an error that is real and in no catalogue: sparse regression over terms whose dimensions fit, written as an effect of
//! a user.
//!
//! ```text
//! residual of the model, means of 0.1 s ─┐
//! each term as an effect with factor c ──┴▶ gain on blocks that its fit did not see ─▶ the best, again, until none gains
//! ```
//! Each candidate ([`terms`]) is an effect like a user effect, so its unit is checked in the same way, and the
//! predictor computes its contribution to every channel: a force shows in the accelerometer, a gyro error in two
//! channels. Terms on several axes may share one factor, as in a drag.
//!
//! Limits: still air; a term is an instantaneous function of the motion or of time, so a pendulum or a backlash is at
//! best hinted at. A proposal is a correlation with a dimension, not yet physics. Only terms that improve the model's
//! prediction of held-out blocks are proposed ([`proof`]), constant offsets of thrust and torque first.

mod candidate;
mod proof;
mod regression;
mod terms;

use rotortwin_plant::effects::{Catalogue, EffectDocument, EffectInstance, ParameterEntry, TermEntry};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::Z95;
use crate::estimation::parameters::number;
use crate::estimation::unseen::HeldOutError;
use crate::log::FlightLog;
use crate::model::ModelVersion;
use crate::predict::{PredictError, Predictor};
use candidate::Candidate;
use proof::Proof;
use regression::{Gram, Regression};

/// Id of a proposed effect; the next ones of a model are numbered.
const ID: &str = "proposed-effect";
/// Factor by which a value may grow before it counts as implausible.
const RANGE: f64 = 3.0;

/// One proposed term: what acts, where, and the evidence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProposedTerm {
    /// Channels and what acts on them: `force_x: air_velocity_x * airspeed^2`.
    pub acts: Vec<String>,
    /// Name of the factor.
    pub parameter: String,
    /// Fitted to all data.
    #[schema(value_type = Option<f64>)]
    pub factor: f64,
    /// Standard deviation by a jackknife over 5 s blocks.
    #[schema(value_type = Option<f64>)]
    pub deviation: f64,
    /// Unit.
    pub unit: String,
    /// Correlation of the residual, before any term is added, with the term.
    #[schema(value_type = Option<f64>)]
    pub correlation: f64,
    /// Fraction of the excess error, in the channels that it acts on, that this and the previous terms remove on
    /// unseen blocks.
    #[schema(value_type = Option<f64>)]
    pub held_out_share: f64,
}

/// The candidate with which a channel's residual correlates most.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Correlate {
    /// Channel: `fx`.
    pub channel: String,
    /// Regressor: `force_x: air_velocity_x`.
    pub regressor: String,
    /// Correlation coefficient.
    #[schema(value_type = Option<f64>)]
    pub correlation: f64,
}

/// A proposal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Proposal {
    /// The terms as an effect document, as `effect_files` of a scenario takes it; absent if no term explains any
    /// unseen data.
    #[schema(value_type = Option<serde_json::Value>)]
    pub document: Option<EffectDocument>,
    /// Its terms, in the order in which they were added.
    pub terms: Vec<ProposedTerm>,
    /// For each channel that fails, the input with which its residual correlates most.
    pub correlates: Vec<Correlate>,
    /// Errors of the quantities on blocks that the fit did not see, without and with the terms.
    #[serde(skip)]
    pub held_out: Vec<HeldOutError>,
}

impl Proposal {
    /// The effect with its fitted values.
    pub fn instance(&self) -> Option<EffectInstance> {
        let document = self.document.as_ref()?;
        let values: Vec<(&str, f64)> = self
            .terms
            .iter()
            .map(|term| (term.parameter.as_str(), term.factor))
            .collect();
        Some(EffectInstance::new(&document.id, &values))
    }

    /// In a sentence or two.
    pub fn sentence(&self) -> String {
        if self.terms.is_empty() {
            let follows: Vec<String> = self
                .correlates
                .iter()
                .map(|c| {
                    format!(
                        "{} follows {} most (correlation {:.2})",
                        c.channel, c.regressor, c.correlation
                    )
                })
                .collect();
            let clauses: Vec<String> =
                std::iter::once("No term of the motion explains it on blocks that the fit did not see".to_owned())
                    .chain(follows)
                    .collect();
            return clauses.join("; ") + ".";
        }
        let terms: Vec<String> = self
            .terms
            .iter()
            .map(|term| {
                let meaning = gloss(term).map_or(String::new(), |words| format!(", {words}"));
                format!(
                    "{} times {} = {}{meaning} (correlation {:.2}; up to here {:.0} % of the error in its channels is explained on unseen blocks)",
                    term.acts.join(", "),
                    term.parameter,
                    value(term),
                    term.correlation,
                    100.0 * term.held_out_share
                )
            })
            .collect();
        let errors: Vec<String> = self
            .held_out
            .iter()
            .filter(|error| error.is_smaller())
            .map(|error| {
                let digits = |x: f64| number(1e3 * x);
                format!(
                    "{} error {} → {} m{}",
                    error.quantity,
                    digits(error.before),
                    digits(error.after),
                    error.unit
                )
            })
            .collect();
        let proof = if errors.is_empty() {
            String::new()
        } else {
            format!(
                " With it, on blocks that the fit did not see: {}; no error rises.",
                errors.join(", ")
            )
        };
        let clock = if self.holds_for_its_flight_alone() {
            OF_ITS_FLIGHT
        } else {
            ""
        };
        format!("It looks like {}.{proof}{clock}", terms.join("; and "))
    }

    /// True if a term is a function of the log's clock, which starts anew with every flight.
    pub fn holds_for_its_flight_alone(&self) -> bool {
        let of_the_clock = |act: &String| act.split(|c: char| !c.is_alphanumeric()).any(|word| word == "time");
        self.terms.iter().any(|term| term.acts.iter().any(of_the_clock))
    }
}

/// What is said of a function of the log's clock.
const OF_ITS_FLIGHT: &str =
    " It is a function of this log's clock: a description of this flight, which predicts no other.";

/// The most likely meaning of a term, in words, if there is one.
fn gloss(term: &ProposedTerm) -> Option<String> {
    let [only] = term.acts.as_slice() else {
        let damps = term
            .acts
            .iter()
            .all(|act| act.starts_with("torque_") && act.ends_with("_rate"));
        return damps.then(|| {
            if term.factor < 0.0 {
                "a damping of the rotation".to_owned()
            } else {
                "less damping than the model has".to_owned()
            }
        });
    };
    match only.as_str() {
        "force_z: thrust" => {
            let (share, word) = (
                100.0 * term.factor.abs(),
                if term.factor > 0.0 { "less" } else { "more" },
            );
            return Some(format!("{share:.1} % {word} thrust than the model has"));
        }
        "torque_x: thrust" | "torque_y: thrust" => {
            let side = match (only.starts_with("torque_x"), term.factor > 0.0) {
                (true, true) => "to the left of",
                (true, false) => "to the right of",
                (false, true) => "ahead of",
                (false, false) => "behind",
            };
            return Some(format!(
                "the thrust acts {:.2} mm {side} the model's centre of mass: its place, or rotors that differ",
                1e3 * term.factor.abs()
            ));
        }
        "torque_z: thrust" => {
            return Some(
                "rotors of one sense turn the vehicle more than those of the other: they differ, or a motor is tilted"
                    .to_owned(),
            );
        }
        _ => {}
    }
    let linear = only.starts_with("force_z: thrust * (time - ") && only.ends_with("[s])");
    // Down is positive: a force that acts downwards reduces the upward thrust.
    linear.then(|| {
        let share = 100.0 * term.factor.abs();
        if term.factor > 0.0 {
            format!("a thrust that falls by {share:.2} % a second, most likely a supply that empties")
        } else {
            format!("a thrust that rises by {share:.2} % a second, most likely mass that leaves")
        }
    })
}

/// `0.0298 ± 0.0002 N·m`, 95 %.
fn value(term: &ProposedTerm) -> String {
    let interval = Z95 * term.deviation;
    let unit = if term.unit.is_empty() {
        String::new()
    } else {
        format!(" {}", term.unit)
    };
    let size = term.factor.abs();
    if interval <= 0.0 || !(1e-3..1e5).contains(&size) {
        return format!("{:.3e} ± {interval:.0e}{unit}", term.factor);
    }
    let digits = (1 - interval.log10().floor() as i32).clamp(0, 8) as usize;
    format!("{:.digits$} ± {interval:.digits$}{unit}", term.factor)
}

/// The effect document as a file, with a warning on top.
pub fn to_toml(document: &EffectDocument) -> String {
    let body = toml::to_string(document).expect("texts and numbers are TOML");
    format!("# Proposed by regression of a residual: a correlation with a dimension, not yet physics.\n{body}")
}

/// What would explain the error of `model` on these logs, best term first.
///
/// # Errors
/// A log cannot be compared with the model.
pub fn propose(logs: &[FlightLog], model: &ModelVersion) -> Result<Proposal, PredictError> {
    let mut regressions = Vec::new();
    let mut failing = Vec::new();
    for log in logs {
        let predictor = Predictor::new(&model.documents(), &model.instances(), &model.catalogue()?, log)?
            .with_chart(model.guesses_its_chart())
            .with_own_wind(model.wind_of_each_flight);
        let regression = Regression::new(predictor)?;
        failing.extend(regression.failing());
        regressions.push(regression);
    }
    failing.sort_unstable();
    failing.dedup();
    let middles: Vec<f64> = regressions.iter().filter_map(Regression::middle_s).collect();
    let middle_s = middles.iter().sum::<f64>() / middles.len().max(1) as f64;
    let mut candidates = terms::candidates(&failing, middle_s);
    candidates.extend(terms::periodic(&regressions, &failing));
    let documents: Vec<EffectDocument> = candidates.iter().map(Candidate::alone).collect();
    // The model may hold effects of a user itself, such as an earlier proposal.
    let all: Vec<EffectDocument> = documents.iter().chain(&model.effect_document).cloned().collect();
    let catalogue = Catalogue::with_documents(&all)?;
    let mut gram = Gram::new(candidates.len());
    for regression in &regressions {
        regression.add_to(&mut gram, &candidates, &documents, &catalogue)?;
    }
    let levels: Vec<usize> = (0..candidates.len()).filter(|&i| candidates[i].is_level()).collect();
    let proof = Proof {
        regressions: &regressions,
        gram: &gram,
        documents: &documents,
        catalogue: &catalogue,
        levels: &levels,
    };
    let proved = proof.run()?;
    let chosen = gram.fitted(&proved.kept, proof.offsets(&proved.kept));
    let id = (1..)
        .map(|n| if n == 1 { ID.to_owned() } else { format!("{ID}-{n}") })
        .find(|id| model.effect_document.iter().all(|known| known.id != *id))
        .expect("a model has finitely many effects");
    let terms: Vec<ProposedTerm> = chosen
        .iter()
        .enumerate()
        .map(|(place, found)| {
            let candidate = &candidates[found.candidate];
            ProposedTerm {
                acts: candidate.acts(),
                parameter: format!("c_{}", place + 1),
                factor: found.factor,
                deviation: found.deviation,
                unit: candidate.unit(),
                correlation: gram.correlation(found.candidate),
                held_out_share: proved.shares[place],
            }
        })
        .collect();
    let document = (!terms.is_empty()).then(|| {
        let chosen: Vec<&Candidate> = chosen.iter().map(|found| &candidates[found.candidate]).collect();
        joint(id, &chosen, &terms)
    });
    if let Some(document) = &document {
        document.declaration()?;
    }
    let correlates = failing
        .iter()
        .filter_map(|&channel| {
            let (best, correlation) = gram.best_correlate(channel, |i| candidates[i].acts_on(channel))?;
            Some(Correlate {
                channel: crate::predict::NAMES[channel].to_owned(),
                regressor: candidates[best].acts().join(", "),
                correlation,
            })
        })
        .collect();
    Ok(Proposal {
        document,
        terms,
        correlates,
        held_out: proved.held_out,
    })
}

/// The terms as one effect.
fn joint(id: String, chosen: &[&Candidate], terms: &[ProposedTerm]) -> EffectDocument {
    let parameter = terms
        .iter()
        .map(|term| ParameterEntry {
            name: term.parameter.clone(),
            unit: term.unit.clone(),
            meaning: format!("factor of {}", term.acts.join(", ")),
            shape: false,
            low: -RANGE * term.factor.abs(),
            high: RANGE * term.factor.abs(),
            size: Some(term.factor.abs()),
            typical: term.factor,
        })
        .collect();
    let term = chosen
        .iter()
        .zip(terms)
        .flat_map(|(candidate, term)| candidate.entries(&term.parameter))
        .collect::<Vec<TermEntry>>();
    EffectDocument {
        id,
        name: "Proposed by regression".to_owned(),
        excited_by: String::new(),
        confused_with: Vec::new(),
        source: "regression of a residual".to_owned(),
        per_rotor: false,
        parameter,
        term,
    }
}
