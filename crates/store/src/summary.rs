//! `summary.json`: what a run was, how it ended and its results, for people and programs.
//!
//! The caller provides the facts (scenario, seed, status, hashes, wall time); the statistics of the flight are computed from the spool by
//! [`analysis`](crate::analysis), so that the command line, the report and other programs all show the same values.
//!
//! A number that is not finite (a flight that diverged) is `null` in the file and NaN in the type.
//!
//! Times are seconds of simulated time since the start of the run, unless the name says `wall`.

use crate::error::{Result, StoreError, io};
use crate::files::{SPOOL_FILE, SUMMARY_FILE};
use rotortwin_flight_core::fdi::FaultVerdict;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use utoipa::ToSchema;

/// Format version of `summary.json`; increased whenever a field changes its meaning or is removed.
pub const SUMMARY_VERSION: u32 = 1;

/// JSON represents NaN as `null`.
fn number<'de, D: Deserializer<'de>>(deserializer: D) -> std::result::Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// As [`number`], for three of them.
fn triple<'de, D: Deserializer<'de>>(deserializer: D) -> std::result::Result<[f64; 3], D::Error> {
    let values: [Option<f64>; 3] = Deserialize::deserialize(deserializer)?;
    Ok(values.map(|value| value.unwrap_or(f64::NAN)))
}

/// As [`number`], for a table.
fn table<'de, D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Vec<[f64; 3]>, D::Error> {
    let rows: Vec<[Option<f64>; 3]> = Deserialize::deserialize(deserializer)?;
    Ok(rows
        .into_iter()
        .map(|row| row.map(|value| value.unwrap_or(f64::NAN)))
        .collect())
}

/// How a run ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[schema(as = FlightStatus)]
pub enum Status {
    /// All steps were executed.
    #[default]
    Done,
    /// It ended early; [`Summary::failure`] says why.
    Failed,
    /// Somebody stopped it.
    Canceled,
}

impl Status {
    /// As it stands in the file.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Canceled => "canceled",
        }
    }
}

/// Cause of the failure of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = FlightFailure)]
pub struct Failure {
    /// Process that failed: `controller`, `fdi`, `plant`, or the program itself.
    pub peer: String,
    /// Last complete step; 0 also if there is none.
    pub step: u64,
    /// How long the peer had been silent, ms of wall time; 0 if silence was not the cause.
    pub silence_ms: u64,
    /// A process of the run died, stopped responding or never joined; another attempt may succeed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub lost: bool,
    /// Summary in one sentence.
    pub sentence: String,
}

/// The scenario as flown.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ScenarioRecord {
    /// Its name.
    pub name: String,
    /// File it was read from, as named on the command line.
    pub path: String,
    /// Name of the vehicle.
    #[serde(default)]
    pub vehicle: String,
    /// The effective configuration (TOML), including defaults and the command line: enough to fly it again.
    pub text: String,
}

/// Controller that flew.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ControllerRecord {
    /// Program or peer, e.g. "rotortwin-controller" or "ArduPilot at 127.0.0.1:40112".
    pub peer: String,
    /// Version that it reports; absent if it reports none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
    /// It replies to each step before the next one begins, so that the same seed gives the same flight.
    pub lockstep: bool,
}

/// How well a run kept to the wall clock.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RealTime {
    /// Length of a step, ms.
    pub period_ms: f64,
    /// Median lateness of a step against the wall clock, µs.
    #[schema(value_type = Option<f64>)]
    pub jitter_us_p50: f64,
    /// 99 % of the steps were less late than this, µs.
    #[schema(value_type = Option<f64>)]
    pub jitter_us_p99: f64,
    /// Worst lateness, µs.
    #[schema(value_type = Option<f64>)]
    pub jitter_us_max: f64,
    /// Steps whose reply came after the next step was due.
    pub deadline_misses: u64,
    /// Worst lateness of a reply, ms; absent in files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overrun_ms_max: Option<f64>,
    /// Real-time priority (with locked memory) of all started processes, 1 to 99; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub priority: Option<u8>,
    /// Missed deadlines and late reports by process and cause, most frequent first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub late: Vec<LateSteps>,
}

/// Late steps with one cause, from kernel statistics: what took most of the time since the previous command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LateSteps {
    /// `plant` (with everything that runs in its process), `controller`, or `fdi`, whose reports have no deadline:
    /// they came later than one period after their step.
    pub who: String,
    /// `scheduler`: ready to run, but waiting for a CPU used by other processes; `computing`; `unknown`: neither, or
    /// the kernel provides no statistics.
    pub why: String,
    /// How many.
    pub steps: u64,
    /// Worst lateness, ms.
    pub worst_ms: f64,
}

/// How well the flight followed its setpoints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Tracking {
    /// Root mean square of the distance between true and reference position, m.
    #[serde(deserialize_with = "number")]
    #[schema(value_type = Option<f64>)]
    pub position_rms_m: f64,
    /// Largest distance, m.
    #[serde(deserialize_with = "number")]
    #[schema(value_type = Option<f64>)]
    pub position_max_m: f64,
    /// Root mean square per axis (north, east, down), m.
    #[serde(deserialize_with = "triple")]
    #[schema(value_type = Vec<Option<f64>>)]
    pub position_rms_ned_m: [f64; 3],
    /// Root mean square of true roll and pitch against their setpoints and of true yaw against its reference, rad.
    #[serde(deserialize_with = "triple")]
    #[schema(value_type = Vec<Option<f64>>)]
    pub attitude_rms_rad: [f64; 3],
}

/// Energy and charge that the flight took from the battery.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BatteryUse {
    /// State of charge at the first step, fraction.
    #[serde(deserialize_with = "number")]
    #[schema(value_type = Option<f64>)]
    pub state_of_charge_start: f64,
    /// State of charge at the last step, fraction.
    #[serde(deserialize_with = "number")]
    #[schema(value_type = Option<f64>)]
    pub state_of_charge_end: f64,
    /// True terminal voltage at the first step, V.
    #[serde(deserialize_with = "number")]
    #[schema(value_type = Option<f64>)]
    pub voltage_start_v: f64,
    /// True terminal voltage at the last step, V.
    #[serde(deserialize_with = "number")]
    #[schema(value_type = Option<f64>)]
    pub voltage_end_v: f64,
    /// Lowest true terminal voltage, V.
    #[serde(deserialize_with = "number")]
    #[schema(value_type = Option<f64>)]
    pub voltage_min_v: f64,
    /// Charge drawn, A h.
    #[serde(deserialize_with = "number")]
    #[schema(value_type = Option<f64>)]
    pub charge_ah: f64,
}

/// Who gives a verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Evaluator {
    /// §5.3.
    TTest,
    /// Sequential detector.
    Sequential,
    /// §5.2.
    Network,
}

impl Evaluator {
    /// All of them, in the order of every table.
    pub const ALL: [Self; 3] = [Self::TTest, Self::Sequential, Self::Network];

    /// Readable name.
    pub const fn title(self) -> &'static str {
        match self {
            Self::TTest => "T-test",
            Self::Sequential => "Sequential detector",
            Self::Network => "Neural network",
        }
    }

    /// Its column in the telemetry.
    pub const fn column(self) -> &'static str {
        match self {
            Self::TTest => "verdict_t_test",
            Self::Sequential => "verdict_sequential",
            Self::Network => "verdict_network",
        }
    }
}

/// Verdicts of one evaluator in one interval; counts are evaluation windows that end in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = DetectorScore)]
pub struct Score {
    /// Windows without a verdict yet.
    pub not_ready: u64,
    /// Windows with the expected verdict.
    pub right: u64,
    /// `right` over the windows with a verdict; absent if there is none.
    pub share_right: Option<f64>,
    /// Windows with the verdict "healthy".
    pub healthy: u64,
    /// Windows with the verdict "unknown fault".
    pub unknown: u64,
    /// Windows that name a rotor that is not the one faulty rotor.
    pub other_rotor: u64,
    /// From the start of the interval to the end of the last step of the first window with the correct verdict, s;
    /// absent if there is none, and in intervals without a fault.
    pub isolated_after_s: Option<f64>,
    /// From the start of the interval to the end of the last step of the first window with a fault verdict, correct
    /// or not, s; absent if there is none, and in intervals without a fault.
    #[serde(default)]
    pub detected_after_s: Option<f64>,
    /// Windows with a fault verdict although no rotor is faulty.
    pub false_alarm_windows: u64,
    /// Uninterrupted sequences of such windows.
    pub false_alarm_events: u64,
    /// Code of the verdict in force at the end of the interval.
    pub verdict_at_end: i32,
    /// Whether that verdict is correct.
    #[serde(default)]
    pub right_at_end: bool,
}

/// Estimated losses of thrust of the rotors that the sequential detector names, and the rotors between which it
/// cannot decide.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = LossSeverity)]
pub struct Severity {
    /// Rotors that are or may be faulty, from 1.
    pub suspect_rotors: Vec<u32>,
    /// Sets of rotors between which an ambiguous verdict cannot decide.
    pub hypothesis_count: u32,
    /// One for each rotor named.
    pub losses: Vec<LossRecord>,
}

/// Estimated loss of thrust of one rotor with its 95 % interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LossRecord {
    /// From 1.
    pub rotor: u32,
    /// At hover, N.
    #[serde(deserialize_with = "number")]
    #[schema(value_type = Option<f64>)]
    pub loss_n: f64,
    /// Ends of its interval, N.
    #[schema(value_type = Vec<Option<f64>>)]
    pub interval_n: [f64; 2],
    /// Share of the rotor's nominal thrust at hover, fraction.
    #[serde(deserialize_with = "number")]
    #[schema(value_type = Option<f64>)]
    pub share: f64,
    /// Ends of its interval, fraction.
    #[schema(value_type = Vec<Option<f64>>)]
    pub interval_share: [f64; 2],
}

impl Severity {
    /// For people: "0.088 N [0.085, 0.092], 3.5 % [3.4, 3.6]" for each rotor named, or the rotors in question.
    pub fn text(&self) -> Option<String> {
        let list = |rotors: &[u32]| {
            let names: Vec<String> = rotors.iter().map(u32::to_string).collect();
            names.join(", ")
        };
        if self.losses.is_empty() {
            let open = self.suspect_rotors.as_slice();
            return (!open.is_empty())
                .then(|| format!("{} sets of rotors {} are possible", self.hypothesis_count, list(open)));
        }
        let several = self.losses.len() > 1;
        let texts: Vec<String> = self
            .losses
            .iter()
            .map(|loss| {
                let who = if several {
                    format!("rotor {}: ", loss.rotor)
                } else {
                    String::new()
                };
                format!(
                    "{who}{:.1} % [{:.1}, {:.1}], {:.3} N [{:.3}, {:.3}]",
                    100.0 * loss.share,
                    100.0 * loss.interval_share[0],
                    100.0 * loss.interval_share[1],
                    loss.loss_n,
                    loss.interval_n[0],
                    loss.interval_n[1]
                )
            })
            .collect();
        Some(texts.join("; "))
    }
}

/// One [`Score`] per evaluator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = DetectorScores)]
pub struct Scores {
    /// Of the T-test.
    pub t_test: Score,
    /// Of the sequential detector.
    pub sequential: Score,
    /// Of the trained network.
    pub network: Score,
}

impl Scores {
    /// The score of one evaluator.
    pub const fn of(&self, evaluator: Evaluator) -> &Score {
        match evaluator {
            Evaluator::TTest => &self.t_test,
            Evaluator::Sequential => &self.sequential,
            Evaluator::Network => &self.network,
        }
    }

    pub(crate) const fn of_mut(&mut self, evaluator: Evaluator) -> &mut Score {
        match evaluator {
            Evaluator::TTest => &mut self.t_test,
            Evaluator::Sequential => &mut self.sequential,
            Evaluator::Network => &mut self.network,
        }
    }
}

/// A user's own detector that judged the run after its flight: [`judge`](crate::own_detector::judge).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OwnDetector {
    /// Its name in every table.
    pub name: String,
    /// Its column in the telemetry.
    pub column: String,
    /// One score for each interval of the run.
    pub scores: Vec<Score>,
    /// What it says at the end of each interval beyond its verdict; absent: nothing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub statements: Vec<Statement>,
}

/// What a detector says beyond the code of its verdict.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = DetectorStatement)]
pub struct Statement {
    /// Rotors that are or may be faulty, and the sizes of what those that it names have lost.
    pub severity: Severity,
    /// In plain words, with sizes; empty: the verdict says all.
    pub text: String,
}

impl OwnDetector {
    /// True if it never gave a verdict.
    pub fn is_absent(&self, intervals: &[Interval]) -> bool {
        let mut both = self.scores.iter().zip(intervals);
        both.all(|(score, interval)| score.not_ready == interval.windows)
    }
}

/// The longest interval of the flight in which the condition of all rotors and sensors stays the same.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = FlightInterval)]
pub struct Interval {
    /// First step, s.
    pub start_s: f64,
    /// End of its last step, s.
    pub end_s: f64,
    /// 0 no rotor faulty, i rotor i, −1 several.
    pub fault_label: i32,
    /// Numbers of the faulty rotors, from 1.
    pub faulty_rotors: Vec<u32>,
    /// In words: "healthy", "rotor 3: blade b".
    pub description: String,
    /// Names of the active sensor faults.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sensor_faults: Vec<String>,
    /// The correct verdict here: equal to the fault label (several faulty rotors match no single one: "unknown
    /// fault"). With two faulty rotors, naming both is also correct; with several, so is an ambiguous verdict that
    /// includes them.
    pub expected_verdict: i32,
    /// Estimated losses of the rotors named by the sequential detector at the end of the interval.
    #[serde(default)]
    pub severity: Severity,
    /// Evaluation windows that end here, including one that began earlier.
    pub windows: u64,
    /// Verdicts of the evaluators.
    pub scores: Scores,
    /// Root mean square of the distance between true and reference position, m.
    #[serde(deserialize_with = "number")]
    #[schema(value_type = Option<f64>)]
    pub position_rms_m: f64,
    /// Start of the time span used for the residual statistics: in intervals longer than two seconds, the first
    /// second is left out, while the observers settle.
    pub residuals_from_s: f64,
    /// Mean of each residual (rotors × arm, lever, yaw), N m s.
    #[serde(deserialize_with = "table")]
    #[schema(value_type = Vec<Vec<Option<f64>>>)]
    pub residual_means_nms: Vec<[f64; 3]>,
    /// Standard deviation of each residual sample, N m s.
    #[serde(deserialize_with = "table")]
    #[schema(value_type = Vec<Vec<Option<f64>>>)]
    pub residual_deviations_nms: Vec<[f64; 3]>,
}

/// The content of `summary.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = RunSummary)]
pub struct Summary {
    /// [`SUMMARY_VERSION`]; set by [`finalise`](crate::run_folder::finalise).
    pub schema_version: u32,
    /// Name of the run, by default that of its folder.
    pub run: String,
    /// How it ended.
    pub status: Status,
    /// Why it failed; present only if it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<Failure>,
    /// Hash over all samples of the run: equal for equal scenario, seed and program, whatever the link and pace.
    pub run_hash: String,
    /// Content hash of the vehicle model that was flown.
    pub model_hash: String,
    /// Program and version, e.g. "rotortwin 0.1.0".
    pub program_version: String,
    /// What was flown.
    pub scenario: ScenarioRecord,
    /// Seed of all noise.
    pub seed: u64,
    /// How the processes were connected: `in-process`, `iceoryx2`, `zenoh`.
    pub link: String,
    /// Controller that flew; absent if none joined, or in files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub controller: Option<ControllerRecord>,
    /// `fast` or `real-time`.
    pub pace: String,
    /// When the run started, RFC 3339; empty if not recorded.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub started_at: String,
    /// Wall time of the run, s.
    pub wall_s: f64,
    /// How well it kept to the wall clock; absent at pace `fast`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub real_time: Option<RealTime>,

    /// Number of steps executed and recorded. This and all fields below are computed from the telemetry.
    pub steps: u64,
    /// Simulated time, s.
    pub simulated_s: f64,
    /// `steps / wall_s`.
    pub steps_per_s: f64,
    /// Rotors of the vehicle.
    pub rotor_count: usize,
    /// Meaning of the codes in `rotor_condition_i`.
    #[serde(default)]
    #[schema(value_type = BTreeMap<String, String>)]
    pub conditions: BTreeMap<i32, String>,
    /// How well the flight followed its reference; absent if there is no step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracking: Option<Tracking>,
    /// Energy and charge taken from the battery; absent if there is no step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub battery: Option<BatteryUse>,
    /// The fault schedule as flown, with the verdicts of the evaluators.
    #[serde(default)]
    pub intervals: Vec<Interval>,
    /// The user's own detectors that judged the run after its flight.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub own_detectors: Vec<OwnDetector>,
}

impl Summary {
    /// False alarms (events) of one evaluator over the whole run.
    pub fn false_alarm_events(&self, evaluator: Evaluator) -> u64 {
        self.intervals
            .iter()
            .map(|interval| interval.scores.of(evaluator).false_alarm_events)
            .sum()
    }

    /// True if the evaluator never gave a verdict, e.g. because no network is loaded.
    pub fn is_absent(&self, evaluator: Evaluator) -> bool {
        self.intervals
            .iter()
            .all(|interval| interval.scores.of(evaluator).not_ready == interval.windows)
    }

    /// As it stands in the file.
    pub fn to_json(&self) -> String {
        let mut json = serde_json::to_string_pretty(self).expect("a summary of strings and numbers is JSON");
        json.push('\n');
        json
    }
}

/// A verdict code in words.
pub fn verdict_text(code: i32) -> String {
    match FaultVerdict::of_code(code) {
        Some(FaultVerdict::NotReady) => "not ready".to_owned(),
        Some(FaultVerdict::Unknown) => "unknown fault".to_owned(),
        Some(FaultVerdict::Healthy) => "healthy".to_owned(),
        Some(FaultVerdict::Ambiguous) => "ambiguous".to_owned(),
        Some(FaultVerdict::Faulty { rotor }) => format!("rotor {}", u32::from(rotor) + 1),
        Some(FaultVerdict::FaultyPair { first, second }) => {
            format!("rotors {} and {}", u32::from(first) + 1, u32::from(second) + 1)
        }
        None => format!("verdict {code}"),
    }
}

/// Reads the summary of a run: `path` is its folder or the file itself.
pub fn load_summary(path: &Path) -> Result<Summary> {
    let is_folder = path.is_dir();
    let file = if is_folder {
        path.join(SUMMARY_FILE)
    } else {
        path.to_path_buf()
    };
    let text = match std::fs::read_to_string(&file) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let interrupted = is_folder && path.join(SPOOL_FILE).exists();
            return Err(if interrupted {
                StoreError::Interrupted {
                    path: path.to_path_buf(),
                }
            } else {
                StoreError::NoRun {
                    path: path.to_path_buf(),
                    expected: SUMMARY_FILE,
                }
            });
        }
        other => other.map_err(io(&file, "cannot read the summary"))?,
    };
    let bad = |source| StoreError::Summary {
        path: file.clone(),
        source,
    };
    // Check the version first: a summary in another format would otherwise be reported as having a missing field.
    let value: serde_json::Value = serde_json::from_str(&text).map_err(bad)?;
    if let Some(found) = value.get("schema_version").and_then(serde_json::Value::as_u64)
        && found != u64::from(SUMMARY_VERSION)
    {
        return Err(StoreError::SummaryVersion {
            path: file,
            found,
            expected: SUMMARY_VERSION,
        });
    }
    serde_json::from_value(value).map_err(bad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_summary_round_trip() {
        let folder = tempfile::tempdir().unwrap();
        let summary = Summary {
            schema_version: SUMMARY_VERSION,
            seed: u64::MAX,
            status: Status::Failed,
            failure: Some(Failure {
                peer: "fdi".into(),
                step: 7,
                silence_ms: 900,
                lost: true,
                sentence: "fdi fell silent".into(),
            }),
            conditions: BTreeMap::from([(1, "blade b".to_owned())]),
            intervals: vec![Interval {
                start_s: 0.1,
                residual_means_nms: vec![[0.1, 0.2, 0.3]; 6],
                ..Interval::default()
            }],
            ..Summary::default()
        };
        std::fs::write(folder.path().join(SUMMARY_FILE), summary.to_json()).unwrap();
        assert_eq!(load_summary(folder.path()).unwrap(), summary);
        assert_eq!(load_summary(&folder.path().join(SUMMARY_FILE)).unwrap(), summary);
    }

    #[test]
    fn val_numbers_that_are_not_finite_come_back_as_nan() {
        let folder = tempfile::tempdir().unwrap();
        let interval = Interval {
            position_rms_m: f64::INFINITY,
            residual_means_nms: vec![[f64::NAN, 1.0, 2.0]],
            ..Interval::default()
        };
        let tracking = Tracking {
            position_rms_ned_m: [f64::NAN, 1.0, 2.0],
            ..Tracking::default()
        };
        let summary = Summary {
            schema_version: SUMMARY_VERSION,
            tracking: Some(tracking),
            intervals: vec![interval],
            ..Summary::default()
        };
        std::fs::write(folder.path().join(SUMMARY_FILE), summary.to_json()).unwrap();
        let read = load_summary(folder.path()).unwrap();
        assert!(read.intervals[0].position_rms_m.is_nan());
        assert!(read.intervals[0].residual_means_nms[0][0].is_nan());
        assert_eq!(read.intervals[0].residual_means_nms[0][1..], [1.0, 2.0]);
        assert!(read.tracking.unwrap().position_rms_ned_m[0].is_nan());
    }

    #[test]
    fn val_what_is_no_summary_is_refused_with_a_reason() {
        let folder = tempfile::tempdir().unwrap();
        let message = |folder: &Path| load_summary(folder).unwrap_err().to_string();
        assert!(message(folder.path()).contains("no run here"));
        std::fs::write(folder.path().join(SPOOL_FILE), "").unwrap();
        assert!(message(folder.path()).contains("interrupted"));
        let file = folder.path().join(SUMMARY_FILE);
        std::fs::write(&file, "{\"schema_version\": 99}").unwrap();
        assert!(message(folder.path()).contains("format 99"));
        std::fs::write(&file, "{").unwrap();
        assert!(message(folder.path()).contains("not a summary"));
    }
}
