//! A log and its results, as in JSON and pages.

use super::truth::Truth;
use rotortwin_campaign::study::log_score::LogScore;
use rotortwin_twin::baseline::{Outcome, Trim};
use rotortwin_twin::over_time::OverTime;
use rotortwin_verdicts::log::LogReport;

/// Commanded thrust of the rotors of a flight compared with healthy flights of the same vehicle: damage that is there
/// from the beginning on, which counts as healthy within the flight.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub(super) struct AgainstHealthy {
    /// `None`: not compared.
    pub(super) outcome: Option<Outcome>,
    /// In words; or why they are not compared.
    pub(super) sentence: String,
}

impl AgainstHealthy {
    pub(super) fn of(trim: &Trim) -> Self {
        Self {
            outcome: Some(trim.outcome()),
            sentence: trim.sentence.clone(),
        }
    }

    pub(super) fn not_compared(reason: impl std::fmt::Display) -> Self {
        Self {
            outcome: None,
            sentence: format!("not compared with the healthy flights: {reason}"),
        }
    }

    /// In two words.
    pub(super) fn word(&self) -> &'static str {
        match self.outcome {
            Some(Outcome::NoChange) => "no change",
            Some(Outcome::ProbablyChanged) => "probably changed",
            Some(Outcome::Changed) => "changed",
            None => "not compared",
        }
    }

    /// Whether the vehicle is no longer, or probably no longer, that of the healthy flights.
    pub(super) fn is_changed(&self) -> bool {
        matches!(self.outcome, Some(Outcome::ProbablyChanged | Outcome::Changed))
    }
}

/// A report alone, with the comparison with healthy flights where there is one.
#[derive(serde::Serialize)]
pub(super) struct ReportAlone<'a> {
    #[serde(flatten)]
    pub(super) report: &'a LogReport,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) against_healthy: Option<&'a AgainstHealthy>,
}

/// One log, with its results.
#[derive(serde::Serialize)]
pub(super) struct JudgedLog {
    /// As named.
    pub(super) file: String,
    /// With enough healthy flights.
    #[serde(rename = "against_healthy", skip_serializing_if = "Option::is_none")]
    pub(super) against: Option<AgainstHealthy>,
    /// With all its windows, if needed.
    pub(super) report: LogReport,
    /// The flight, for a page.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) over_time: Option<OverTime>,
    /// If the truth is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) score: Option<LogScore>,
    /// If known.
    #[serde(skip)]
    pub(super) truth: Option<Truth>,
}
