//! What the detectors say of a log: its parts, and the answer in words, for commands, API, page and Python.

use crate::view::{
    ChangeView, DetectorsView, LoadView, ObstacleView, Obstruction, SequentialView, VerdictKind, WindowView,
};
use rotortwin_twin::flight_picture::FlightPicture;
use serde::Serialize;
use utoipa::ToSchema;

/// Time without a clear explanation after which the last verdict is not that of the end, s.
const LONG_UNJUDGED_S: f64 = 5.0;

/// A group of channels that the log lacks, and what cannot be judged without it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct Lack {
    /// Its columns.
    pub columns: Vec<String>,
    /// What cannot be judged.
    pub rules_out: String,
    /// True if no detector can run without it.
    pub prevents_verdicts: bool,
}

/// What the import found suspicious.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct Suspicion {
    /// One sentence.
    pub finding: String,
    /// Verdicts are meaningless until it is resolved.
    pub blocks: bool,
}

/// The log as it was read.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct LogView {
    /// Hash (XXH3-128) of the file.
    pub content_hash: String,
    /// Rows.
    pub rows: usize,
    /// First row, s of the log's time: not 0 for a part of a log. All other times are relative to it.
    pub start_s: f64,
    /// From the first row to the last, s.
    pub duration_s: f64,
    /// Median rate, Hz.
    pub rate_hz: f64,
    /// Intervals without rows.
    pub gaps: usize,
}

/// Verdicts of one detector over the log, counted in windows.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct DetectorCount {
    /// `t_test`, `network`, `sequential` or `network_over_time`, which is absent with a classifier that does not calibrate itself.
    pub detector: String,
    /// Windows with a verdict.
    pub decided: u64,
    /// Windows with the verdict healthy.
    pub healthy: u64,
    /// Windows with a verdict other than healthy.
    pub alarmed: u64,
    /// Number of alarms, counted at their start: on a healthy flight, false alarms.
    pub alarms: u64,
    /// End of the first window with an alarm, s since the log's first row.
    pub first_alarm_s: Option<f64>,
}

/// What was judged after one calibration.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct StretchView {
    /// Start of the first window with a verdict, s since the log's first row.
    pub from_s: f64,
    /// End of the last window with a verdict, s since the log's first row.
    pub to_s: f64,
    /// The last verdict of the sequential detector in it.
    pub sequential: SequentialView,
}

/// A time interval without a verdict of the sequential detector.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct NotJudgedView {
    /// s since the log's first row.
    pub from_s: f64,
    /// s since the log's first row.
    pub to_s: f64,
    /// Why.
    #[serde(flatten)]
    pub obstacle: ObstacleView,
}

/// Result of the detectors on a log.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct LogReport {
    /// The log.
    pub log: LogView,
    /// The detectors in effect.
    pub detectors: DetectorsView,
    /// Rate at which the detectors ran, Hz: the log's own, from 32 to 400 Hz.
    pub judged_rate_hz: f64,
    /// True if the log's rate is outside this range and it was resampled.
    pub resampled: bool,
    /// Number of steps processed by the detectors, at the rate at which they ran.
    pub steps: u64,
    /// Number of steps at which a channel had no value.
    pub lost_steps: u64,
    /// Number of steps with impossible values.
    pub rejected_steps: u64,
    /// Time for which the sequential detector had a verdict, s; false alarms are to be related to it.
    pub decided_s: f64,
    /// The answer: the last verdict of each stretch, the first alarm, and what would not have been seen.
    pub sentence: String,
    /// Smallest losses that would have been seen within 10 s at the end; absent without a window.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detectable: Option<String>,
    /// What was judged, in chronological order; damage that exists before an interval begins counts as healthy in it.
    pub stretches: Vec<StretchView>,
    /// The rest, in chronological order, with the reasons why it was not judged.
    pub not_judged: Vec<NotJudgedView>,
    /// Number of such intervals that are not listed.
    pub not_judged_left_out: u64,
    /// The last window with a verdict, otherwise the last window; absent if there is none.
    pub final_window: Option<WindowView>,
    /// Changes of the sequential detector's verdict, times since the log's first row.
    pub timeline: Vec<ChangeView>,
    /// Number of changes that are not listed.
    pub timeline_left_out: u64,
    /// Loads that were dropped or picked up, times since the log's first row.
    pub loads: Vec<LoadView>,
    /// Every window of all detectors, times since the log's first row; only on request (`fdi-log --windows`).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub windows: Vec<WindowView>,
    /// Verdicts of each detector, counted.
    pub counts: Vec<DetectorCount>,
    /// What the log lacks.
    pub lacks: Vec<Lack>,
    /// What looks wrong about the log.
    pub suspicions: Vec<Suspicion>,
    /// Further notes for the reader.
    pub notes: Vec<String>,
    /// The flight, for plotting; only on request (`fdi-log --flight`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flight: Option<FlightPicture>,
}

impl LogReport {
    /// With its words: the answer, what would have been seen, and a note where the T-test contradicts.
    pub(crate) fn said(mut self) -> Self {
        self.sentence = answer(&self);
        let smallest = self.final_window.as_ref().map(|window| window.smallest_loss.as_slice());
        self.detectable = smallest.and_then(smallest_text);
        self.notes.extend(contradicted(&self));
        self
    }

    /// The time without a verdict with which a stretch ends, if what the detectors found in the air had no clear explanation
    /// for [`LONG_UNJUDGED_S`]: then the last verdict is not that of the end.
    pub fn unjudged_after(&self, stretch: &StretchView) -> Option<&NotJudgedView> {
        let is_found = |time: &&NotJudgedView| {
            matches!(
                time.obstacle.reason,
                Obstruction::Unexplained
                    | Obstruction::LoadChanged
                    | Obstruction::Unclear
                    | Obstruction::ImpossibleLoss
            )
        };
        let next = self.stretches.iter().map(|other| other.from_s);
        let next_s = next
            .filter(|from_s| *from_s > stretch.to_s)
            .fold(f64::INFINITY, f64::min);
        let mut after = self
            .not_judged
            .iter()
            .filter(|time| time.from_s > stretch.to_s - 0.5 && time.from_s < next_s);
        let all_s: f64 = after.clone().filter(is_found).map(|time| time.to_s - time.from_s).sum();
        (all_s >= LONG_UNJUDGED_S).then(|| after.find(is_found))?
    }
}

/// The answer in one sentence: its last verdict in each stretch, and its first alarm.
fn answer(report: &LogReport) -> String {
    let probability = |view: &SequentialView| match view.verdict.verdict {
        VerdictKind::NotReady | VerdictKind::CannotJudge => String::new(),
        VerdictKind::Healthy if view.is_unclear() => format!(" (healthy: probability {:.3})", view.probability),
        _ => format!(" (probability {:.3})", view.probability),
    };
    let said = |stretch: &StretchView| {
        let view = &stretch.sequential;
        let last = format!("{}{}", view.sentence, probability(view));
        match report.unjudged_after(stretch) {
            Some(after) => format!(
                "none from {:.1} s on: {}; before that, {last}",
                after.from_s, after.obstacle.why
            ),
            None => last,
        }
    };
    let is_healthy = |one: &StretchView| is_healthy(&one.sequential) && report.unjudged_after(one).is_none();
    let verdicts = match report.stretches.as_slice() {
        [] => return "none: nothing could be judged; the reasons are under \"not judged\"".to_owned(),
        [only] => said(only),
        several if several.iter().all(is_healthy) => {
            format!("healthy at the end of each of {} stretches", several.len())
        }
        several => several
            .iter()
            .map(|one| format!("{:.0}–{:.0} s: {}", one.from_s, one.to_s, said(one)))
            .collect::<Vec<_>>()
            .join("; "),
    };
    let crash = report
        .not_judged
        .iter()
        .find(|time| time.obstacle.reason == Obstruction::Crash);
    let crash = crash.map_or_else(String::new, |time| {
        format!("; the crash from {:.2} s on is not judged", time.from_s)
    });
    let smallest = report
        .final_window
        .as_ref()
        .map(|window| window.smallest_loss.as_slice());
    let sequential = report.counts.iter().find(|count| count.detector == "sequential");
    match sequential.and_then(|count| count.first_alarm_s) {
        Some(time_s) => format!("{verdicts}; first alarm at {time_s:.2} s{crash}"),
        None if smallest.is_some_and(hides_all) => {
            format!(
                "nothing can be said of the rotors, as not even the loss of a whole one would be seen ({verdicts}; no alarm){crash}"
            )
        }
        None if smallest.is_some_and(hides_most) => {
            let most = smallest.into_iter().flatten().copied().fold(0.0, f32::max);
            format!(
                "only the loss of {:.0} % of a rotor's thrust or more would be seen at the end, and none was ({verdicts}; no alarm){crash}",
                100.0 * most
            )
        }
        None => format!("{verdicts}; no alarm{crash}"),
    }
}

/// Why the T-test alarms most of the time where the sequential detector does not.
fn contradicted(report: &LogReport) -> Option<String> {
    let count = |detector: &str| report.counts.iter().find(|count| count.detector == detector);
    let (t_test, sequential) = (count("t_test")?, count("sequential")?);
    (sequential.alarmed == 0 && sequential.decided > 0 && 2 * t_test.alarmed > t_test.decided).then(|| {
        format!(
            "the T-test alarms in {} of {} windows, as it takes every lasting deviation from the model for a fault, also of a model that does not \
             fit; the sequential detector's verdict is the one to act on",
            t_test.alarmed, t_test.decided
        )
    })
}

/// Whether not even the loss of a whole rotor would be seen, of any.
fn hides_all(smallest: &[f32]) -> bool {
    !smallest.is_empty() && smallest.iter().all(|loss| *loss >= 1.0)
}

/// Whether the loss of a quarter of a rotor would not be seen, of some.
fn hides_most(smallest: &[f32]) -> bool {
    smallest.iter().any(|loss| *loss > 0.25)
}

/// Smallest detectable loss at the end of the log.
fn smallest_text(smallest: &[f32]) -> Option<String> {
    let of = |sign: f32| (0..smallest.len()).max_by(|a, b| (sign * smallest[*a]).total_cmp(&(sign * smallest[*b])));
    let (least, most) = (of(-1.0)?, of(1.0)?);
    if hides_all(smallest) {
        return Some(
            "nothing: at the end even the loss of a whole rotor would be hidden by what the model does not explain"
                .to_owned(),
        );
    }
    let [from, to] = [least, most].map(|rotor| format!("{:.1} %", 100.0 * smallest[rotor]));
    Some(if from == to {
        format!("losses from {from} of the thrust, of any rotor, within 10 s, at the end")
    } else {
        let [least, most] = [least + 1, most + 1];
        format!("losses from {from} of the thrust (rotor {least}) to {to} (rotor {most}), within 10 s, at the end")
    })
}

fn is_healthy(view: &SequentialView) -> bool {
    view.verdict.verdict == VerdictKind::Healthy && !view.is_unclear()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// "healthy (probability 1.000)" was the first line of a flight in which no damage could have been seen.
    #[test]
    fn regress_a_flight_that_hides_the_loss_of_a_rotor_is_told_by_its_smallest_losses() {
        assert!(hides_all(&[1.0, 1.2, 1.0, 1.0]));
        assert!(!hides_all(&[0.4, 1.2, 1.0, 1.0]) && !hides_all(&[]));
        assert!(
            hides_most(&[0.4, 1.2, 1.0, 1.0])
                && hides_most(&[0.1, 0.4])
                && !hides_most(&[0.1, 0.2])
                && !hides_most(&[])
        );
        assert!(smallest_text(&[1.0; 4]).is_some_and(|text| text.contains("nothing")));
    }
}
