//! A log and its results, as in JSON and pages.

use super::truth::Truth;
use rotortwin_campaign::study::log_score::LogScore;
use rotortwin_twin::baseline::{Outcome, Trim};
use rotortwin_twin::over_time::OverTime;
use rotortwin_verdicts::log::{LogReport, NotJudgedView};
use rotortwin_verdicts::view::Obstruction;

/// Reasons that are listed for a log of which nothing was judged.
const MOST_REASONS: usize = 3;

/// Commanded thrust of the rotors of a flight compared with healthy flights of the same vehicle: damage that is there
/// from the beginning on, which counts as healthy within the flight.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct AgainstHealthy {
    /// `None`: not compared.
    pub outcome: Option<Outcome>,
    /// In words; or why they are not compared.
    pub sentence: String,
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
    pub fn word(&self) -> &'static str {
        match self.outcome {
            Some(Outcome::NoChange) => "no change",
            Some(Outcome::ProbablyChanged) => "probably changed",
            Some(Outcome::Changed) => "changed",
            None => "not compared",
        }
    }

    /// Whether the vehicle is no longer, or probably no longer, that of the healthy flights.
    pub fn is_changed(&self) -> bool {
        matches!(self.outcome, Some(Outcome::ProbablyChanged | Outcome::Changed))
    }
}

/// A report alone, with the comparison with healthy flights where there is one.
#[derive(serde::Serialize)]
struct ReportAlone<'a> {
    #[serde(flatten)]
    report: &'a LogReport,
    #[serde(skip_serializing_if = "Option::is_none")]
    against_healthy: Option<&'a AgainstHealthy>,
}

/// A single log without a score as its report alone, otherwise objects.
///
/// # Errors
/// None: text and finite numbers are JSON.
pub fn json_of(logs: &[JudgedLog]) -> serde_json::Result<String> {
    match logs {
        [log] if log.score.is_none() => serde_json::to_string_pretty(&ReportAlone {
            report: &log.report,
            against_healthy: log.against.as_ref(),
        }),
        [log] => serde_json::to_string_pretty(log),
        several => serde_json::to_string_pretty(several),
    }
}

/// One log, with its results.
#[derive(serde::Serialize)]
pub struct JudgedLog {
    /// As named.
    pub file: String,
    /// With enough healthy flights.
    #[serde(rename = "against_healthy", skip_serializing_if = "Option::is_none")]
    pub against: Option<AgainstHealthy>,
    /// With all its windows, if needed.
    pub report: LogReport,
    /// The flight, for a page.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub over_time: Option<OverTime>,
    /// If the truth is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub score: Option<LogScore>,
    /// If known.
    #[serde(skip)]
    pub truth: Option<Truth>,
}

impl JudgedLog {
    /// Why no detector can evaluate it; `None`: they could.
    pub fn refusal(&self) -> Option<String> {
        let (file, report) = (&self.file, &self.report);
        if let Some(lack) = report.lacks.iter().find(|lack| lack.prevents_verdicts) {
            return Some(format!(
                "{file}: the log lacks {}, which rules out {}",
                lack.columns.join(", "),
                lack.rules_out
            ));
        }
        let complete = |time: &NotJudgedView| time.obstacle.reason != Obstruction::Gap;
        (report.final_window.is_none() && !report.not_judged.iter().any(complete)).then(|| {
        format!(
            "{file}: no step has a value in every channel that the detectors need; expected rows that hold velocity and attitude (or specific force), \
             body rates, duties and voltage together"
        )
    })
    }

    /// That no window of it has a verdict, and why.
    pub fn unjudged(&self) -> Option<String> {
        let (file, report) = (&self.file, &self.report);
        if !report.stretches.is_empty() {
            return None;
        }
        let mut reasons: Vec<(&str, f64)> = Vec::new();
        for time in &report.not_judged {
            let (why, lasts_s) = (time.obstacle.why.as_str(), time.to_s - time.from_s);
            match reasons.iter_mut().find(|(known, _)| *known == why) {
                Some((_, sum_s)) => *sum_s += lasts_s,
                None => reasons.push((why, lasts_s)),
            }
        }
        reasons.sort_by(|a, b| b.1.total_cmp(&a.1));
        let listed: Vec<String> = reasons
            .iter()
            .take(MOST_REASONS)
            .map(|(why, sum_s)| format!("{sum_s:.1} s ({why})"))
            .collect();
        let listed = if listed.is_empty() {
            "the log is shorter than a window".to_owned()
        } else {
            listed.join(", ")
        };
        Some(format!(
            "{file}: nothing could be judged in {:.1} s: {listed}; expected more than the {} s of the calibration in the air without a gap, in a flight \
         that the model explains",
            report.log.duration_s, report.detectors.calibration_end_s
        ))
    }
}
