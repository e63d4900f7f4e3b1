//! One row of a campaign: a flight's parameters, how it ended, and the results of every detector.
//!
//! A campaign resumes from its records, so they contain everything that the totals need, and no wall-clock times.

use super::cell::Cell;
use super::plan::Axis;
use super::score::DetectorScore;
use crate::table_file::{TableFile, Values};
use serde::{Deserialize, Serialize};

/// How a flight of a campaign ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = CampaignFlightStatus)]
#[serde(rename_all = "kebab-case")]
pub enum FlightStatus {
    /// All steps were flown.
    Done,
    /// It ended early: the vehicle was lost, or a state was not a number. What was flown is scored.
    Failed,
    /// It cannot be flown, e.g. because this vehicle cannot hover with this charge. Nothing is scored.
    Refused,
}

impl FlightStatus {
    /// Name in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Refused => "refused",
        }
    }
}

/// The three detectors, in the order of every table.
pub const DETECTORS: [&str; 3] = ["sequential", "network", "t_test"];

/// One flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FlightRecord {
    /// Number of the flight, from 0.
    pub flight: u64,
    /// Seed of its noise.
    pub seed: u64,
    /// Axis and value, in the order of the axes.
    pub parameters: Vec<(String, Cell)>,
    /// How it ended.
    pub status: FlightStatus,
    /// Why it was not flown to its end; empty if it was.
    pub reason: String,
    /// Hash over all samples; that of the run folder of the same flight.
    pub run_hash: String,
    /// Steps flown.
    pub steps: u64,
    /// Rotors of the vehicle; 0 if it was refused.
    pub rotor_count: u32,
    /// First onset of a fault, s; absent if no rotor was faulty at any time.
    pub fault_onset_s: Option<f64>,
    /// Rotors that were ever faulty: bit 0 is rotor 1.
    pub faulty_rotors: u32,
    /// Share of its hover thrust that the worst rotor loses by the first fault, once that is fully there.
    pub onset_loss_share: Option<f64>,
    /// The same at the end of the flight.
    pub final_loss_share: Option<f64>,
    /// Loss that the sequential detector estimates at the end, N at hover; absent unless it names one rotor.
    pub thrust_loss_n: Option<f64>,
    /// Lower end of its interval of 95 %, N.
    pub thrust_loss_low_n: Option<f64>,
    /// Upper end, N.
    pub thrust_loss_high_n: Option<f64>,
    /// The true loss of the worst rotor at the end, N at hover.
    pub true_thrust_loss_n: Option<f64>,
    /// In the order of [`DETECTORS`].
    pub detectors: Vec<DetectorScore>,
    /// One for each level of the operating curve.
    pub curve: Vec<DetectorScore>,
}

/// The loss of thrust that a detector names at the end of a flight, with its interval of 95 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LossAtEnd {
    /// At hover, N.
    pub loss_n: f64,
    /// Ends of its interval, N.
    pub interval_n: [f64; 2],
}

impl FlightRecord {
    /// What the sequential detector names at the end.
    pub fn loss_at_end(&self) -> Option<LossAtEnd> {
        let loss_n = self.thrust_loss_n?;
        let end = |end: Option<f64>| end.unwrap_or(loss_n);
        Some(LossAtEnd {
            loss_n,
            interval_n: [end(self.thrust_loss_low_n), end(self.thrust_loss_high_n)],
        })
    }

    /// Lossless JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("a record of numbers and texts is JSON")
    }
}

/// Records of a campaign with these axes and levels as the columns of `campaign.parquet`.
pub fn columns(records: &[FlightRecord], axes: &[Axis], levels: &[f32]) -> TableFile {
    let mut table = TableFile::default();
    let integer = |value: &dyn Fn(&FlightRecord) -> i64| Values::Integer(records.iter().map(value).collect());
    let double = |value: &dyn Fn(&FlightRecord) -> Option<f64>| {
        Values::Double(records.iter().map(|r| value(r).unwrap_or(f64::NAN)).collect())
    };
    let text = |value: &dyn Fn(&FlightRecord) -> String| Values::Text(records.iter().map(value).collect());
    table
        .column("flight", integer(&|r| r.flight as i64))
        .column("seed", integer(&|r| r.seed as i64))
        .column("status", text(&|r| r.status.as_str().to_owned()))
        .column("reason", text(&|r| r.reason.clone()));
    for (place, axis) in axes.iter().enumerate() {
        let cell = |r: &FlightRecord| r.parameters.get(place).map(|(_, cell)| cell.clone());
        let values = if axis.is_numeric() {
            double(&|r| cell(r).and_then(|cell| cell.number()))
        } else {
            text(&|r| cell(r).map_or_else(String::new, |cell| cell.to_string()))
        };
        table.column(&axis.name, values);
    }
    table
        .column("run_hash", text(&|r| r.run_hash.clone()))
        .column("steps", integer(&|r| r.steps as i64))
        .column("rotor_count", integer(&|r| i64::from(r.rotor_count)))
        .column("fault_onset_s", double(&|r| r.fault_onset_s))
        .column("faulty_rotors", integer(&|r| i64::from(r.faulty_rotors)))
        .column("onset_loss_share", double(&|r| r.onset_loss_share))
        .column("final_loss_share", double(&|r| r.final_loss_share))
        .column("thrust_loss_n", double(&|r| r.thrust_loss_n))
        .column("thrust_loss_low_n", double(&|r| r.thrust_loss_low_n))
        .column("thrust_loss_high_n", double(&|r| r.thrust_loss_high_n))
        .column("true_thrust_loss_n", double(&|r| r.true_thrust_loss_n));
    for (place, detector) in DETECTORS.into_iter().enumerate() {
        score_columns(&mut table, records, detector, &|r| r.detectors.get(place));
    }
    for (place, level) in levels.iter().enumerate() {
        score_columns(&mut table, records, &format!("sequential_at_{level}"), &|r| {
            r.curve.get(place)
        });
    }
    table
}

/// Columns of one score a flight, each with the prefix; a flight without a score has counts of 0 and no times.
pub(super) fn score_columns<'a>(
    table: &mut TableFile,
    records: &'a [FlightRecord],
    prefix: &str,
    score: &dyn Fn(&'a FlightRecord) -> Option<&'a DetectorScore>,
) {
    let count = |value: &dyn Fn(&DetectorScore) -> u64| {
        Values::Integer(
            records
                .iter()
                .map(|r| score(r).map_or(0, |s| value(s) as i64))
                .collect(),
        )
    };
    let seconds = |value: &dyn Fn(&DetectorScore) -> Option<f64>| {
        Values::Double(
            records
                .iter()
                .map(|r| score(r).and_then(value).unwrap_or(f64::NAN))
                .collect(),
        )
    };
    let verdict = Values::Integer(
        records
            .iter()
            .map(|r| score(r).map_or(-2, |s| i64::from(s.final_verdict)))
            .collect(),
    );
    table
        .column(&format!("{prefix}_windows"), count(&|s| s.windows))
        .column(&format!("{prefix}_right"), count(&|s| s.right))
        .column(&format!("{prefix}_missed"), count(&|s| s.missed))
        .column(&format!("{prefix}_wrong_rotor"), count(&|s| s.wrong_rotor))
        .column(&format!("{prefix}_unclear"), count(&|s| s.unclear))
        .column(&format!("{prefix}_healthy_windows"), count(&|s| s.healthy_windows))
        .column(
            &format!("{prefix}_false_alarm_windows"),
            count(&|s| s.false_alarm_windows),
        )
        .column(
            &format!("{prefix}_false_alarm_events"),
            count(&|s| s.false_alarm_events),
        )
        .column(&format!("{prefix}_healthy_s"), seconds(&|s| Some(s.healthy_s())))
        .column(
            &format!("{prefix}_detected_after_s"),
            seconds(&|s| s.detected_after_s()),
        )
        .column(
            &format!("{prefix}_isolated_after_s"),
            seconds(&|s| s.isolated_after_s()),
        )
        .column(&format!("{prefix}_settled_after_s"), seconds(&|s| s.settled_after_s()))
        .column(&format!("{prefix}_verdict_at_end"), verdict);
}
