//! A log and what was found in it, as JSON and pages hold it.

use super::truth::Truth;
use rotortwin_campaign::study::log_score::LogScore;
use rotortwin_twin::over_time::OverTime;
use rotortwin_verdicts::log::LogReport;

/// One log, and what was found.
#[derive(serde::Serialize)]
pub(super) struct JudgedLog {
    /// As it was named.
    pub(super) file: String,
    /// With all its windows, where they were needed.
    pub(super) report: LogReport,
    /// The flight, for a page.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) over_time: Option<OverTime>,
    /// Where the truth is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) score: Option<LogScore>,
    /// Where it is known.
    #[serde(skip)]
    pub(super) truth: Option<Truth>,
}
