//! Accuracy of the detectors on a log with known truth, as JSON: printed by `rotortwin fdi-log --truth` and returned by
//! `POST /api/v1/fdi/scores`. Definitions: docs/campaigns.md.

use rotortwin_plant::STEP_S;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// How right the detectors were on one log.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LogScore {
    /// First damage, s of the log's time.
    pub onset_s: Option<f64>,
    /// Each detector.
    pub detectors: Vec<ScoreOfDetector>,
    /// Windows of the sequential detector that name the rotors rightly, while the loss stands still, with each loss inside its 95 % interval.
    pub inside: u64,
    /// Of so many.
    pub inside_of: u64,
}

/// Counts of one detector, by the definitions of campaigns.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ScoreOfDetector {
    /// `t_test`, `network` or `sequential`.
    pub detector: String,
    /// Steps of a window, 2.5 ms each.
    pub window_steps: u64,
    /// Windows with a verdict.
    pub windows: u64,
    /// With the right one.
    pub right: u64,
    /// Faulty windows called healthy.
    pub missed: u64,
    /// Faulty windows that name a healthy rotor.
    pub wrong_rotor: u64,
    /// Faulty windows that are neither right nor missed, and name no healthy rotor.
    pub unclear: u64,
    /// Windows without a fault.
    pub healthy_windows: u64,
    /// Of these, with a verdict other than healthy.
    pub false_alarm_windows: u64,
    /// Rows of them.
    pub false_alarm_events: u64,
    /// Steps from the onset to the end of the first window with any verdict but healthy.
    pub detected_after_steps: Option<u64>,
    /// To the end of the first right window.
    pub isolated_after_steps: Option<u64>,
    /// To the end of the window from which on all are right.
    pub settled_after_steps: Option<u64>,
    /// Verdict of the last window; −2 if it was never ready.
    pub final_verdict: i32,
    /// Truth, verdict, windows.
    pub confusion: Vec<(i32, i32, u64)>,
    /// Bin of severity, faulty windows, of these right; empty where a loss is of unknown size.
    pub by_severity: Vec<(usize, u64, u64)>,
}

impl ScoreOfDetector {
    /// Time without a fault in which the detector was ready, s.
    pub fn healthy_s(&self) -> f64 {
        (self.healthy_windows * self.window_steps) as f64 * STEP_S
    }

    /// From the onset to the end of the first right window, s.
    pub fn isolated_after_s(&self) -> Option<f64> {
        self.isolated_after_steps.map(|steps| steps as f64 * STEP_S)
    }

    /// To the end of the window from which on all are right, s.
    pub fn settled_after_s(&self) -> Option<f64> {
        self.settled_after_steps.map(|steps| steps as f64 * STEP_S)
    }
}
