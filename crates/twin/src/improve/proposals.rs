//! What one round of the loop adds: the findings of a diagnosis, fitted together, and a wind for each flight where one for all does not
//! do.

use rotortwin_plant::effects::{Catalogue, EffectInstance};

use super::{refit, stays_within, with_finding};
use crate::diagnose::{Diagnosis, Finding};
use crate::log::FlightLog;
use crate::model::{ModelVersion, steady_wind};
use crate::predict::PredictError;

/// What a diagnosis wants added in a round.
pub(super) struct Proposals {
    pub(super) findings: Vec<Finding>,
    /// Each flight gets a wind of its own, with the first finding.
    own_winds: bool,
}

/// Added to the label of the step that brings the winds.
const AND_WINDS: &str = " and the wind of each flight";

impl Proposals {
    pub(super) fn of(diagnosis: &Diagnosis, version: &ModelVersion, catalogue: &Catalogue) -> Self {
        let findings = diagnosis.effects.clone();
        if diagnosis.winds.is_empty() || version.wind_of_each_flight {
            return Self {
                findings,
                own_winds: false,
            };
        }
        Self::with_winds(findings, catalogue)
    }

    fn with_winds(mut findings: Vec<Finding>, catalogue: &Catalogue) -> Self {
        match findings.first_mut() {
            Some(first) => first.label += AND_WINDS,
            // The model has the drag already.
            None => findings.extend(winds_alone(catalogue)),
        }
        Self {
            findings,
            own_winds: true,
        }
    }

    /// The same with a wind for each flight in place of one for all; `None` if there is none for all.
    pub(super) fn in_winds_of_their_own(&self, catalogue: &Catalogue) -> Option<Self> {
        let is_wind = |finding: &&Finding| {
            let declared = catalogue.find(&finding.instance.effect);
            declared.is_some_and(|declared| declared.search.is_steady_wind)
        };
        let others: Vec<Finding> = self.findings.iter().filter(|one| !is_wind(one)).cloned().collect();
        (!self.own_winds && others.len() < self.findings.len()).then(|| Self::with_winds(others, catalogue))
    }

    /// The version with the winds that come with the findings, without these.
    pub(super) fn with_winds_alone(&self, version: &ModelVersion) -> ModelVersion {
        if self.own_winds {
            version.with_own_winds()
        } else {
            version.clone()
        }
    }

    /// The version with one of the findings.
    pub(super) fn added(&self, version: &ModelVersion, finding: &Finding, logs: &[FlightLog]) -> ModelVersion {
        let next = with_finding(version, finding, logs);
        if self.own_winds { next.with_own_winds() } else { next }
    }

    /// The version with all of them, fitted together: one alone would absorb the others.
    pub(super) fn fitted_to(&self, version: &ModelVersion, logs: &[FlightLog]) -> Result<ModelVersion, PredictError> {
        let add = |version: ModelVersion, finding| self.added(&version, finding, logs);
        let full = self.findings.iter().fold(version.clone(), add);
        let refitted = refit::refit(&full, logs)?;
        Ok(if stays_within(&refitted, &self.findings) {
            refitted
        } else {
            full
        })
    }
}

/// The winds of the flights as a step of their own.
fn winds_alone(catalogue: &Catalogue) -> Option<Finding> {
    let wind = steady_wind(catalogue)?;
    let instance = EffectInstance {
        effect: wind.id.to_owned(),
        rotor: None,
        onset_s: None,
        parameters: Default::default(),
    };
    Some(Finding::without_evidence(
        instance,
        "Wind of each flight".to_owned(),
        wind.equation.to_owned(),
        Vec::new(),
        "no wind of all flights explains them".to_owned(),
    ))
}
