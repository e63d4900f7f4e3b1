//! A log and its results, as in JSON and pages.

use super::truth::Truth;
use rotortwin_campaign::study::log_score::LogScore;
use rotortwin_twin::over_time::OverTime;
use rotortwin_verdicts::log::LogReport;

/// One log, with its results.
#[derive(serde::Serialize)]
pub(super) struct JudgedLog {
    /// As named.
    pub(super) file: String,
    /// Commanded thrust of its rotors compared with healthy flights.
    #[serde(skip)]
    pub(super) against: Option<String>,
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
