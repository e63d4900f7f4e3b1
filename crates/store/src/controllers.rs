//! Comparison of controllers: one row per flight, from its summary and telemetry.
//!
//! ```text
//! summary.json ──────▶ who flew, scenario, fault, verdicts ─┐
//! telemetry.parquet ─▶ errors, tilt, energy, recovery ──────┴▶ ControllerRow ─▶ `rotortwin controllers`, GET /api/v1/controllers
//! ```
//! All errors are those of the true state relative to the scenario's reference, which is the same for every controller. Roll and pitch
//! have no reference there: they are compared with the controller's own setpoint of its inner loop, if reported; an autopilot does not
//! report one. [`differences`] states whether flights are comparable at all.

use crate::analysis::wrapped;
use crate::files::TELEMETRY_FILE;
use crate::query::{QueryError, TelemetryFile};
use crate::summary::{Evaluator, Interval, Summary};
use serde::{Deserialize, Serialize};
use std::path::Path;
use utoipa::ToSchema;

/// Default recovery distance: a vehicle within this distance of the reference has recovered, m.
pub const WITHIN_M: f64 = 0.5;

/// Columns read at each step.
const COLUMNS: [&str; 15] = [
    "time_s",
    "true_position_north_m",
    "true_position_east_m",
    "true_position_down_m",
    "reference_north_m",
    "reference_east_m",
    "reference_down_m",
    "true_roll_rad",
    "true_pitch_rad",
    "true_yaw_rad",
    "reference_yaw_rad",
    "roll_setpoint_rad",
    "pitch_setpoint_rad",
    "true_battery_voltage_v",
    "battery_current_a",
];

/// Root mean square and largest value of an error over a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Spread {
    /// Root mean square.
    pub rms: f64,
    /// Largest value.
    pub max: f64,
}

/// Performance of one controller in a flight.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ControllerRow {
    /// Folder of the run, or its id on a server.
    pub run: String,
    /// Controller that flew.
    pub controller: String,
    /// Version that it reports; absent if it reports none.
    pub version: Option<String>,
    /// It replies to each step before the next one begins; absent if unknown.
    pub lockstep: Option<bool>,
    /// How the processes were connected.
    pub link: String,
    /// How the flight ended: `done`, `failed`, `canceled`.
    pub status: String,
    /// Why it failed.
    pub failure: Option<String>,
    /// Name of the scenario.
    pub scenario: String,
    /// Name of the vehicle.
    pub vehicle: String,
    /// Content hash of the vehicle model that was flown.
    pub model_hash: String,
    /// Seed of all noise.
    pub seed: u64,
    /// Length of the flight, s of simulated time.
    pub simulated_s: f64,
    /// Distance between true and reference position, m.
    pub position_m: Option<Spread>,
    /// True yaw against its reference, degrees.
    pub yaw_deg: Option<Spread>,
    /// True roll and pitch against the setpoints of the controller's inner loop, degrees; absent if it did not report
    /// them.
    pub roll_pitch_deg: Option<Spread>,
    /// Angle between the thrust axis and the vertical, degrees.
    pub tilt_deg: Option<Spread>,
    /// Energy taken from the battery at its terminals, W h.
    pub energy_wh: Option<f64>,
    /// Alarms of the sequential detector while no rotor was faulty.
    pub false_alarms: u64,
    /// The first rotor fault; absent if there is none.
    pub fault: Option<FaultResponse>,
}

/// Response to a fault, and its detection. Verdicts are those of the sequential detector.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FaultResponse {
    /// In words: "rotor 3: −10 % thrust".
    pub description: String,
    /// s.
    pub onset_s: f64,
    /// Detection delay: from the onset to the first verdict other than healthy, s; absent if there is none before the
    /// next change of the fault.
    pub detected_after_s: Option<f64>,
    /// Isolation delay: from the onset to the first correct verdict, s; absent likewise.
    pub isolated_after_s: Option<f64>,
    /// The last verdict before the next change of the fault is correct.
    pub right_at_end: bool,
    /// Largest distance from the reference from the onset on, m.
    pub farthest_m: f64,
    /// From the onset until the vehicle stays within the bound to the end of the flight, s: 0 if it never left it;
    /// absent if it is outside at the end.
    pub recovered_after_s: Option<f64>,
}

impl ControllerRow {
    /// Row of a run folder; a vehicle has recovered when it stays within `within_m` of its reference.
    ///
    /// # Errors
    /// The telemetry cannot be read.
    pub fn of_folder(folder: &Path, summary: &Summary, within_m: f64) -> Result<Self, QueryError> {
        let path = folder.join(TELEMETRY_FILE);
        let telemetry = (summary.steps > 0).then_some(path.as_path());
        Self::new(folder.display().to_string(), summary, telemetry, within_m)
    }

    /// Row of a run whose telemetry is in this file; `None`: nothing was recorded.
    ///
    /// # Errors
    /// The telemetry cannot be read.
    pub fn new(run: String, summary: &Summary, telemetry: Option<&Path>, within_m: f64) -> Result<Self, QueryError> {
        let controller = summary.controller.clone();
        let fault = summary.intervals.iter().find(|interval| interval.fault_label != 0);
        let mut row = Self {
            run,
            controller: controller
                .as_ref()
                .map_or_else(|| summary.link.clone(), |who| who.peer.clone()),
            version: controller.as_ref().and_then(|who| who.version.clone()),
            lockstep: controller.as_ref().map(|who| who.lockstep),
            link: summary.link.clone(),
            status: summary.status.as_str().to_owned(),
            failure: summary.failure.as_ref().map(|failure| failure.sentence.clone()),
            scenario: summary.scenario.name.clone(),
            vehicle: summary.scenario.vehicle.clone(),
            model_hash: summary.model_hash.clone(),
            seed: summary.seed,
            simulated_s: summary.simulated_s,
            false_alarms: summary.false_alarm_events(Evaluator::Sequential),
            ..Self::default()
        };
        let mut sums = Sums::new(fault.map(|fault| fault.start_s), within_m);
        if let Some(path) = telemetry {
            TelemetryFile::open(path)?.for_each_block::<QueryError>(&COLUMNS, |block| {
                for step in 0..block[0].len() {
                    sums.push(std::array::from_fn(|column| block[column][step]));
                }
                Ok(())
            })?;
        }
        sums.fill(&mut row);
        row.fault = fault.map(|fault| sums.response(fault));
        Ok(row)
    }
}

/// Sums over all steps, and the last time at which the vehicle was too far away.
struct Sums {
    onset_s: Option<f64>,
    within_m: f64,
    steps: u64,
    step_s: f64,
    last_s: f64,
    position: [f64; 2],
    yaw: [f64; 2],
    roll_pitch: [f64; 2],
    tilt: [f64; 2],
    told_setpoints: bool,
    energy_j: f64,
    farthest_m: f64,
    /// Time of the last step outside the bound, from the onset on.
    last_outside_s: Option<f64>,
    outside: bool,
}

impl Sums {
    fn new(onset_s: Option<f64>, within_m: f64) -> Self {
        Self {
            onset_s,
            within_m,
            steps: 0,
            step_s: 0.0,
            last_s: 0.0,
            position: [0.0; 2],
            yaw: [0.0; 2],
            roll_pitch: [0.0; 2],
            tilt: [0.0; 2],
            told_setpoints: false,
            energy_j: 0.0,
            farthest_m: 0.0,
            last_outside_s: None,
            outside: false,
        }
    }

    fn push(&mut self, row: [f64; COLUMNS.len()]) {
        let [
            time,
            north,
            east,
            down,
            to_north,
            to_east,
            to_down,
            roll,
            pitch,
            yaw,
            to_yaw,
            to_roll,
            to_pitch,
            volts,
            amperes,
        ] = row;
        if self.steps > 0 {
            self.step_s = time - self.last_s;
        }
        let away = ((north - to_north).powi(2) + (east - to_east).powi(2) + (down - to_down).powi(2)).sqrt();
        let inner = ((roll - to_roll).powi(2) + (pitch - to_pitch).powi(2)).sqrt();
        let tilt = (roll.cos() * pitch.cos()).clamp(-1.0, 1.0).acos();
        for (sums, error) in [
            (&mut self.position, away),
            (&mut self.yaw, wrapped(yaw - to_yaw).abs()),
            (&mut self.roll_pitch, inner),
            (&mut self.tilt, tilt),
        ] {
            sums[0] += error * error;
            // NaN is kept: a flight that diverged has no largest error.
            if error > sums[1] || error.is_nan() {
                sums[1] = error;
            }
        }
        self.told_setpoints |= to_roll != 0.0 || to_pitch != 0.0;
        self.energy_j += volts * amperes * self.step_s;
        if self.onset_s.is_some_and(|onset| time >= onset) {
            self.farthest_m = self.farthest_m.max(away);
            self.outside = away.is_nan() || away > self.within_m;
            if self.outside {
                self.last_outside_s = Some(time);
            }
        }
        self.steps += 1;
        self.last_s = time;
    }

    fn spread(&self, [squares, max]: [f64; 2], unit: f64) -> Option<Spread> {
        (self.steps > 0).then(|| Spread {
            rms: unit * (squares / self.steps as f64).sqrt(),
            max: unit * max,
        })
    }

    fn fill(&self, row: &mut ControllerRow) {
        let degrees = 1_f64.to_degrees();
        row.position_m = self.spread(self.position, 1.0);
        row.yaw_deg = self.spread(self.yaw, degrees);
        row.roll_pitch_deg = self.spread(self.roll_pitch, degrees).filter(|_| self.told_setpoints);
        row.tilt_deg = self.spread(self.tilt, degrees);
        row.energy_wh = (self.steps > 0).then_some(self.energy_j / 3600.0);
    }

    fn response(&self, fault: &Interval) -> FaultResponse {
        let score = fault.scores.of(Evaluator::Sequential);
        FaultResponse {
            description: fault.description.clone(),
            onset_s: fault.start_s,
            detected_after_s: score.detected_after_s,
            isolated_after_s: score.isolated_after_s,
            right_at_end: score.right_at_end,
            farthest_m: self.farthest_m,
            recovered_after_s: match self.last_outside_s {
                None => Some(0.0),
                Some(_) if self.outside => None,
                Some(last) => Some(last + self.step_s - fault.start_s),
            },
        }
    }
}

/// Reasons why flights are not comparable: differences other than the controller, one sentence each.
pub fn differences(rows: &[ControllerRow]) -> Vec<String> {
    let Some((first, others)) = rows.split_first() else {
        return Vec::new();
    };
    let mut told = Vec::new();
    let mut tell = |what: &str, of: &dyn Fn(&ControllerRow) -> String| {
        let one = of(first);
        let mut other: Vec<String> = others.iter().map(of).filter(|other| *other != one).collect();
        other.dedup();
        if !other.is_empty() {
            told.push(format!("{what} differs: {one}; {}", other.join("; ")));
        }
    };
    tell("the scenario", &|row| row.scenario.clone());
    tell("the vehicle", &|row| match row.model_hash.get(..8) {
        Some(hash) => format!("{} ({hash})", row.vehicle),
        None => row.vehicle.clone(),
    });
    tell("the seed", &|row| row.seed.to_string());
    tell("the fault", &|row| match &row.fault {
        Some(fault) => format!("{} at {} s", fault.description, fault.onset_s),
        None => "none".to_owned(),
    });
    tell("the length", &|row| format!("{:.2} s", row.simulated_s));
    told
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 100 steps of 10 ms: 1 m away from 0.3 s to 0.5 s, then 0.1 m; 10 V and 36 A.
    fn sums(onset_s: Option<f64>, within_m: f64) -> Sums {
        let mut sums = Sums::new(onset_s, within_m);
        for step in 0..100 {
            let away = match step {
                0..30 => 0.0,
                30..50 => 1.0,
                _ => 0.1,
            };
            let mut row = [0.0; COLUMNS.len()];
            row[0] = 0.01 * f64::from(step);
            (row[1], row[4]) = (5.0 + away, 5.0);
            // Yaw and its reference on both sides of south.
            (row[9], row[10]) = (3.1, -3.1);
            (row[13], row[14]) = (10.0, 36.0);
            sums.push(row);
        }
        sums
    }

    #[test]
    fn val_errors_energy_and_recovery_by_hand() {
        let fault = Interval {
            start_s: 0.3,
            fault_label: 3,
            ..Interval::default()
        };
        let sums = sums(Some(0.3), 0.5);
        let mut row = ControllerRow::default();
        sums.fill(&mut row);
        let position = row.position_m.unwrap();
        assert!((position.rms - (20.5_f64 / 100.0).sqrt()).abs() < 1e-12 && (position.max - 1.0).abs() < 1e-12);
        let yaw = row.yaw_deg.unwrap().max;
        assert!((yaw - (std::f64::consts::TAU - 6.2).to_degrees()).abs() < 1e-9, "{yaw}");
        assert_eq!(row.roll_pitch_deg, None, "nobody told a set-point");
        // The first step has no length yet.
        assert!((row.energy_wh.unwrap() - 360.0 * 0.99 / 3600.0).abs() < 1e-9);
        let response = sums.response(&fault);
        assert!((response.recovered_after_s.unwrap() - 0.2).abs() < 1e-9);
        assert!((response.farthest_m - 1.0).abs() < 1e-12);
        assert_eq!(
            super::tests::sums(Some(0.3), 2.0).response(&fault).recovered_after_s,
            Some(0.0)
        );
        assert_eq!(
            super::tests::sums(Some(0.3), 0.05).response(&fault).recovered_after_s,
            None
        );
    }

    #[test]
    fn val_what_keeps_flights_from_being_compared_is_said() {
        let one = ControllerRow {
            scenario: "hover".to_owned(),
            seed: 1,
            ..ControllerRow::default()
        };
        let other = ControllerRow {
            seed: 2,
            controller: "another".to_owned(),
            ..one.clone()
        };
        assert_eq!(differences(&[one.clone(), one.clone()]), Vec::<String>::new());
        assert_eq!(differences(&[one, other]), ["the seed differs: 1; 2"]);
    }
}
