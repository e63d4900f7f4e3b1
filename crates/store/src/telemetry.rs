//! The telemetry schema of a run: the columns of a row, and the row itself.
//!
//! One row per 2.5 ms step, filled by the loop of the run and written to the spool:
//!
//! ```text
//! sensors, command, FDI report, truth ─▶ TelemetryRow ─▶ spool ─▶ telemetry.parquet · run.mcap · report.html
//! ```
//!
//! A row contains the sensed and commanded signals under the canonical names of a flight log (`position_north_m`, `duty_1`, …), so
//! that a run can be read wherever a flight log can, then the simulated truth (`true_…`, `fault_label`), then the output of the FDI
//! engine. Units are SI, world frame NED, body frame FRD, rotors in the order of the vehicle file, from 1.
//!
//! Name, unit, kind and value of a column are defined in one line of [`TelemetryRow::visit`], which drives the schema, the spool and
//! every exporter, so that they cannot disagree about the order.
//!
//! Limits: the schema depends on the rotor count only. Signals that some runs lack (network verdict, wind) are present with a
//! neutral value, not omitted.

use rotortwin_flight_core::MAX_ROTORS;
use serde::{Deserialize, Serialize};

/// Type of a column in the spool and in Parquet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Simulated quantities and time.
    F64,
    /// On-board quantities.
    F32,
    /// Codes.
    I32,
    /// Step number and bit masks.
    U64,
}

impl Kind {
    /// Bytes of one value.
    pub const fn bytes(self) -> usize {
        match self {
            Kind::F64 | Kind::U64 => 8,
            Kind::F32 | Kind::I32 => 4,
        }
    }
}

/// One column of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// Unique name; ends in the unit where there is one.
    pub name: String,
    /// Display unit (`m/s`); `1` for fractions, codes and masks.
    pub unit: String,
    /// Type of its values.
    pub kind: Kind,
    /// Description, one sentence without a full stop.
    pub description: String,
}

/// Simulated truth at the start of the step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TruthRow {
    /// m, NED.
    pub position_ned_m: [f64; 3],
    /// m/s, NED.
    pub velocity_ned_m_s: [f64; 3],
    /// Roll, pitch, yaw, rad.
    pub attitude_rad: [f64; 3],
    /// p, q, r, rad/s, body.
    pub body_rates_rad_s: [f64; 3],
    /// Thrust of each rotor, N.
    pub thrust_n: [f64; MAX_ROTORS],
    /// Charge left, fraction of the capacity.
    pub state_of_charge: f64,
    /// V_oc, V.
    pub open_circuit_voltage_v: f64,
    /// V_batt at the terminals, V.
    pub battery_voltage_v: f64,
    /// Wind over ground, m/s, NED.
    pub wind_ned_m_s: [f64; 3],
}

/// All recorded data of one step, as plain numbers.
///
/// Entries of rotor arrays past the rotor count are not recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TelemetryRow {
    /// Step number, from 0.
    pub step: u64,
    /// Simulated time at the start of the step, ns.
    pub sim_time_ns: u64,
    /// Sensed position, m, NED.
    pub position_ned_m: [f32; 3],
    /// Sensed velocity, m/s, NED.
    pub velocity_ned_m_s: [f32; 3],
    /// Sensed roll, pitch, yaw, rad.
    pub attitude_rad: [f32; 3],
    /// Sensed p, q, r, rad/s, body.
    pub body_rates_rad_s: [f32; 3],
    /// Accelerometer: specific force, m/s², body.
    pub specific_force_m_s2: [f32; 3],
    /// Duty held over the step, fraction.
    pub duty: [f32; MAX_ROTORS],
    /// Measured voltage at the battery's terminals, V.
    pub battery_voltage_v: f32,
    /// Current at the battery's terminals, discharge > 0, A.
    pub battery_current_a: f64,
    /// Reference position, m, NED.
    pub reference_position_ned_m: [f32; 3],
    /// Reference velocity, m/s, NED.
    pub reference_velocity_ned_m_s: [f32; 3],
    /// Reference yaw, rad.
    pub reference_yaw_rad: f32,
    /// Simulated truth.
    pub truth: TruthRow,
    /// `HEALTHY`, the number of the one faulty rotor (from 1), or `UNKNOWN` if several are faulty
    /// ([`rotortwin_flight_core::fdi::verdict_code`]).
    pub fault_label: i32,
    /// Bit i set: rotor i (from 0) is faulty.
    pub faulty_rotors: u32,
    /// Condition of each rotor: 0 healthy, others as in `SpoolHeader::conditions`.
    pub rotor_condition: [i32; MAX_ROTORS],
    /// Bit mask of the sensor faults in force, in the order of the scenario; 0 if none.
    pub sensor_faults: u32,
    /// Attitude setpoint of the inner loop (roll, pitch, yaw), rad.
    pub attitude_setpoint_rad: [f32; 3],
    /// Bit i set: the duty of rotor i (from 0) was limited.
    pub saturated_rotors: u32,
    /// r_i (Eq. 32), components arm, lever, yaw, N m s.
    pub residuals_nms: [[f32; 3]; MAX_ROTORS],
    /// Residual of the equivalent four-axis observer: F_z (N s), M_x, M_y, M_z (N m s), body.
    pub wrench_residual: [f32; 4],
    /// Verdict code of the T-test.
    pub t_test: i32,
    /// Verdict code of the trained network.
    pub network: i32,
    /// Verdict code of the sequential detector.
    pub sequential: i32,
    /// Probability of the sequential verdict, fraction.
    pub sequential_probability: f32,
    /// Loss of thrust estimated by the sequential detector: N, lower and upper end of its 95 % interval, the same as fractions of
    /// the rotor's nominal thrust.
    pub thrust_loss: [f32; 6],
    /// The same for the other rotor of a pair.
    pub second_thrust_loss: [f32; 6],
    /// Bit i set: rotor i (from 0) is or may be faulty.
    pub suspect_rotors: u32,
    /// Number of sets that an ambiguous verdict leaves open.
    pub hypothesis_count: u32,
    /// True on the last step of an evaluation window: the verdicts are new, otherwise held.
    pub window_end: bool,
}

/// Name, unit and meaning of a column, without allocation: `head` + rotor number + `tail`.
#[derive(Clone, Copy)]
pub(crate) struct Label {
    head: &'static str,
    rotor: Option<usize>,
    tail: &'static str,
    unit: &'static str,
    description: &'static str,
}

/// A column that exists once.
#[inline(always)]
const fn one(name: &'static str, unit: &'static str, description: &'static str) -> Label {
    Label {
        head: name,
        rotor: None,
        tail: "",
        unit,
        description,
    }
}

/// A column that exists for each rotor; `rotor` from 0.
#[inline(always)]
const fn of(
    head: &'static str,
    rotor: usize,
    tail: &'static str,
    unit: &'static str,
    description: &'static str,
) -> Label {
    Label {
        head,
        rotor: Some(rotor),
        tail,
        unit,
        description,
    }
}

/// Receives the columns of a row in order.
pub(crate) trait Sink {
    fn f64(&mut self, label: Label, value: f64);
    fn f32(&mut self, label: Label, value: f32);
    fn i32(&mut self, label: Label, value: i32);
    fn u64(&mut self, label: Label, value: u64);
}

/// Collects the schema.
struct Schema(Vec<Column>);

impl Schema {
    fn column(&mut self, label: Label, kind: Kind) {
        let name = match label.rotor {
            Some(rotor) => format!("{}{}{}", label.head, rotor + 1, label.tail),
            None => label.head.to_owned(),
        };
        self.0.push(Column {
            name,
            unit: label.unit.to_owned(),
            kind,
            description: label.description.to_owned(),
        });
    }
}

impl Sink for Schema {
    fn f64(&mut self, label: Label, _: f64) {
        self.column(label, Kind::F64);
    }
    fn f32(&mut self, label: Label, _: f32) {
        self.column(label, Kind::F32);
    }
    fn i32(&mut self, label: Label, _: i32) {
        self.column(label, Kind::I32);
    }
    fn u64(&mut self, label: Label, _: u64) {
        self.column(label, Kind::U64);
    }
}

/// Collects the values as plain numbers.
struct Numbers<'a> {
    out: &'a mut [f64],
    at: usize,
}

impl Numbers<'_> {
    #[inline(always)]
    fn put(&mut self, value: f64) {
        self.out[self.at] = value;
        self.at += 1;
    }
}

impl Sink for Numbers<'_> {
    #[inline(always)]
    fn f64(&mut self, _: Label, value: f64) {
        self.put(value);
    }
    #[inline(always)]
    fn f32(&mut self, _: Label, value: f32) {
        self.put(f64::from(value));
    }
    #[inline(always)]
    fn i32(&mut self, _: Label, value: i32) {
        self.put(f64::from(value));
    }
    #[inline(always)]
    fn u64(&mut self, _: Label, value: u64) {
        self.put(value as f64);
    }
}

/// Collects the values as little-endian bytes of their kind.
struct Bytes<'a> {
    out: &'a mut [u8],
    at: usize,
}

impl Bytes<'_> {
    #[inline(always)]
    fn put<const N: usize>(&mut self, value: [u8; N]) {
        self.out[self.at..self.at + N].copy_from_slice(&value);
        self.at += N;
    }
}

impl Sink for Bytes<'_> {
    #[inline(always)]
    fn f64(&mut self, _: Label, value: f64) {
        self.put(value.to_le_bytes());
    }
    #[inline(always)]
    fn f32(&mut self, _: Label, value: f32) {
        self.put(value.to_le_bytes());
    }
    #[inline(always)]
    fn i32(&mut self, _: Label, value: i32) {
        self.put(value.to_le_bytes());
    }
    #[inline(always)]
    fn u64(&mut self, _: Label, value: u64) {
        self.put(value.to_le_bytes());
    }
}

/// Estimated loss of the rotor named by the sequential detector.
const LOSS_COLUMNS: [Label; 6] = [
    one(
        "thrust_loss_n",
        "N",
        "Loss of thrust that the sequential detector estimates",
    ),
    one("thrust_loss_low_n", "N", "Lower end of the 95 % interval of the loss"),
    one("thrust_loss_high_n", "N", "Upper end of the 95 % interval of the loss"),
    one(
        "thrust_loss_share",
        "1",
        "Loss as a share of the rotor's nominal thrust at hover",
    ),
    one(
        "thrust_loss_share_low",
        "1",
        "Lower end of the 95 % interval of the share",
    ),
    one(
        "thrust_loss_share_high",
        "1",
        "Upper end of the 95 % interval of the share",
    ),
];

/// Estimated loss of the other rotor of a pair.
const SECOND_LOSS_COLUMNS: [Label; 6] = [
    one(
        "second_thrust_loss_n",
        "N",
        "Loss of thrust that the sequential detector estimates, other rotor of a pair",
    ),
    one(
        "second_thrust_loss_low_n",
        "N",
        "Lower end of the 95 % interval of the loss, other rotor of a pair",
    ),
    one(
        "second_thrust_loss_high_n",
        "N",
        "Upper end of the 95 % interval of the loss, other rotor of a pair",
    ),
    one(
        "second_thrust_loss_share",
        "1",
        "Loss as a share of the rotor's nominal thrust at hover, other rotor of a pair",
    ),
    one(
        "second_thrust_loss_share_low",
        "1",
        "Lower end of the 95 % interval of the share, other rotor of a pair",
    ),
    one(
        "second_thrust_loss_share_high",
        "1",
        "Upper end of the 95 % interval of the share, other rotor of a pair",
    ),
];

impl TelemetryRow {
    /// Passes every column of a run with `rotor_count` rotors to `sink`, in schema order.
    #[inline(always)]
    fn visit<S: Sink>(&self, rotor_count: usize, sink: &mut S) {
        let rotors = 0..rotor_count;
        let truth = &self.truth;

        sink.f64(
            one("time_s", "s", "Simulated time at the start of the step"),
            self.sim_time_ns as f64 / 1e9,
        );
        sink.u64(one("step", "1", "Step number, from 0"), self.step);

        let [north, east, down] = self.position_ned_m;
        sink.f32(one("position_north_m", "m", "Sensed position, north"), north);
        sink.f32(one("position_east_m", "m", "Sensed position, east"), east);
        sink.f32(one("position_down_m", "m", "Sensed position, down"), down);
        let [north, east, down] = self.velocity_ned_m_s;
        sink.f32(one("velocity_north_m_s", "m/s", "Sensed velocity, north"), north);
        sink.f32(one("velocity_east_m_s", "m/s", "Sensed velocity, east"), east);
        sink.f32(one("velocity_down_m_s", "m/s", "Sensed velocity, down"), down);
        let [roll, pitch, yaw] = self.attitude_rad;
        sink.f32(one("roll_rad", "rad", "Sensed roll (ZYX Euler angles)"), roll);
        sink.f32(one("pitch_rad", "rad", "Sensed pitch"), pitch);
        sink.f32(
            one("yaw_rad", "rad", "Sensed yaw, clockwise from north seen from above"),
            yaw,
        );
        let [p, q, r] = self.body_rates_rad_s;
        sink.f32(one("roll_rate_rad_s", "rad/s", "Sensed body rate p"), p);
        sink.f32(one("pitch_rate_rad_s", "rad/s", "Sensed body rate q"), q);
        sink.f32(one("yaw_rate_rad_s", "rad/s", "Sensed body rate r"), r);
        let [x, y, z] = self.specific_force_m_s2;
        sink.f32(one("accel_x_m_s2", "m/s²", "Accelerometer: specific force, forward"), x);
        sink.f32(one("accel_y_m_s2", "m/s²", "Accelerometer: specific force, right"), y);
        sink.f32(one("accel_z_m_s2", "m/s²", "Accelerometer: specific force, down"), z);
        for i in rotors.clone() {
            sink.f32(
                of("duty_", i, "", "1", "Commanded duty cycle held over the step, 0 to 1"),
                self.duty[i],
            );
        }
        sink.f32(
            one("battery_voltage_v", "V", "Measured voltage at the battery's terminals"),
            self.battery_voltage_v,
        );
        sink.f64(
            one(
                "battery_current_a",
                "A",
                "Current at the battery's terminals, discharge > 0",
            ),
            self.battery_current_a,
        );

        let [north, east, down] = self.reference_position_ned_m;
        sink.f32(one("reference_north_m", "m", "Reference position, north"), north);
        sink.f32(one("reference_east_m", "m", "Reference position, east"), east);
        sink.f32(one("reference_down_m", "m", "Reference position, down"), down);
        let [north, east, down] = self.reference_velocity_ned_m_s;
        sink.f32(
            one("reference_velocity_north_m_s", "m/s", "Reference velocity, north"),
            north,
        );
        sink.f32(
            one("reference_velocity_east_m_s", "m/s", "Reference velocity, east"),
            east,
        );
        sink.f32(
            one("reference_velocity_down_m_s", "m/s", "Reference velocity, down"),
            down,
        );
        sink.f32(one("reference_yaw_rad", "rad", "Reference yaw"), self.reference_yaw_rad);

        let [north, east, down] = truth.position_ned_m;
        sink.f64(one("true_position_north_m", "m", "True position, north"), north);
        sink.f64(one("true_position_east_m", "m", "True position, east"), east);
        sink.f64(one("true_position_down_m", "m", "True position, down"), down);
        let [north, east, down] = truth.velocity_ned_m_s;
        sink.f64(one("true_velocity_north_m_s", "m/s", "True velocity, north"), north);
        sink.f64(one("true_velocity_east_m_s", "m/s", "True velocity, east"), east);
        sink.f64(one("true_velocity_down_m_s", "m/s", "True velocity, down"), down);
        let [roll, pitch, yaw] = truth.attitude_rad;
        sink.f64(one("true_roll_rad", "rad", "True roll"), roll);
        sink.f64(one("true_pitch_rad", "rad", "True pitch"), pitch);
        sink.f64(one("true_yaw_rad", "rad", "True yaw"), yaw);
        let [p, q, r] = truth.body_rates_rad_s;
        sink.f64(one("true_roll_rate_rad_s", "rad/s", "True body rate p"), p);
        sink.f64(one("true_pitch_rate_rad_s", "rad/s", "True body rate q"), q);
        sink.f64(one("true_yaw_rate_rad_s", "rad/s", "True body rate r"), r);
        for i in rotors.clone() {
            sink.f64(
                of("true_thrust_", i, "_n", "N", "True thrust of the rotor"),
                truth.thrust_n[i],
            );
        }
        sink.f64(
            one("true_state_of_charge", "1", "Charge left, fraction of the capacity"),
            truth.state_of_charge,
        );
        sink.f64(
            one(
                "true_open_circuit_voltage_v",
                "V",
                "Open-circuit voltage of the battery",
            ),
            truth.open_circuit_voltage_v,
        );
        sink.f64(
            one("true_battery_voltage_v", "V", "True voltage at the battery's terminals"),
            truth.battery_voltage_v,
        );
        let [north, east, down] = truth.wind_ned_m_s;
        sink.f64(one("wind_north_m_s", "m/s", "Wind over ground, north"), north);
        sink.f64(one("wind_east_m_s", "m/s", "Wind over ground, east"), east);
        sink.f64(one("wind_down_m_s", "m/s", "Wind over ground, down"), down);

        sink.i32(
            one(
                "fault_label",
                "1",
                "Truth: 0 no fault, i fault of rotor i, -1 several rotors faulty",
            ),
            self.fault_label,
        );
        sink.u64(
            one("faulty_rotors", "1", "Truth: bit i set if rotor i+1 is faulty"),
            u64::from(self.faulty_rotors),
        );
        for i in rotors.clone() {
            sink.i32(
                of(
                    "rotor_condition_",
                    i,
                    "",
                    "1",
                    "Truth: 0 healthy, other codes as listed in the summary",
                ),
                self.rotor_condition[i],
            );
        }
        sink.u64(
            one(
                "sensor_faults",
                "1",
                "Truth: bit i set if sensor fault i+1 of the scenario is in force",
            ),
            u64::from(self.sensor_faults),
        );

        let [roll, pitch, yaw] = self.attitude_setpoint_rad;
        sink.f32(
            one("roll_setpoint_rad", "rad", "Roll set-point of the inner loop"),
            roll,
        );
        sink.f32(
            one("pitch_setpoint_rad", "rad", "Pitch set-point of the inner loop"),
            pitch,
        );
        sink.f32(one("yaw_setpoint_rad", "rad", "Yaw set-point of the inner loop"), yaw);
        sink.u64(
            one(
                "saturated_rotors",
                "1",
                "Bit i set if the duty of rotor i+1 was limited",
            ),
            u64::from(self.saturated_rotors),
        );

        for i in rotors {
            let [arm, lever, yaw] = self.residuals_nms[i];
            sink.f32(
                of(
                    "residual_",
                    i,
                    "_arm_nms",
                    "N m s",
                    "Residual r_i (Eq. 32), first component",
                ),
                arm,
            );
            sink.f32(
                of(
                    "residual_",
                    i,
                    "_lever_nms",
                    "N m s",
                    "Residual r_i (Eq. 32), second component",
                ),
                lever,
            );
            sink.f32(
                of(
                    "residual_",
                    i,
                    "_yaw_nms",
                    "N m s",
                    "Residual r_i (Eq. 32), third component",
                ),
                yaw,
            );
        }
        let [fz, mx, my, mz] = self.wrench_residual;
        sink.f32(
            one(
                "wrench_residual_fz_ns",
                "N s",
                "Residual of the four-axis observer, body z force",
            ),
            fz,
        );
        sink.f32(
            one(
                "wrench_residual_mx_nms",
                "N m s",
                "Residual of the four-axis observer, roll moment",
            ),
            mx,
        );
        sink.f32(
            one(
                "wrench_residual_my_nms",
                "N m s",
                "Residual of the four-axis observer, pitch moment",
            ),
            my,
        );
        sink.f32(
            one(
                "wrench_residual_mz_nms",
                "N m s",
                "Residual of the four-axis observer, yaw moment",
            ),
            mz,
        );
        sink.i32(
            one(
                "verdict_t_test",
                "1",
                "Verdict of the T-test: -2 not ready, -1 unknown fault, 0 healthy, i rotor i",
            ),
            self.t_test,
        );
        sink.i32(
            one(
                "verdict_network",
                "1",
                "Verdict of the trained network, codes as verdict_t_test",
            ),
            self.network,
        );
        sink.i32(
            one(
                "verdict_sequential",
                "1",
                "Verdict of the sequential detector, codes as verdict_t_test, also -3 ambiguous and 100 i + j rotors i and j",
            ),
            self.sequential,
        );
        sink.f32(
            one(
                "sequential_probability",
                "1",
                "Probability that the sequential detector gives to its verdict",
            ),
            self.sequential_probability,
        );
        for (column, value) in LOSS_COLUMNS.into_iter().zip(self.thrust_loss) {
            sink.f32(column, value);
        }
        for (column, value) in SECOND_LOSS_COLUMNS.into_iter().zip(self.second_thrust_loss) {
            sink.f32(column, value);
        }
        sink.i32(
            one(
                "hypothesis_count",
                "1",
                "Sets of rotors that an ambiguous verdict leaves open",
            ),
            self.hypothesis_count.cast_signed(),
        );
        sink.i32(
            one(
                "suspect_rotors",
                "1",
                "Bit i set if rotor i+1 is or may be concerned, by the sequential detector",
            ),
            self.suspect_rotors.cast_signed(),
        );
        sink.i32(
            one("window_end", "1", "1 on the last step of an evaluation window, else 0"),
            i32::from(self.window_end),
        );
    }

    /// The row as numbers in the order of [`telemetry_columns`].
    ///
    /// `out` has one entry per column; panics if it is shorter.
    #[inline]
    pub fn fill(&self, rotor_count: usize, out: &mut [f64]) {
        self.visit(rotor_count, &mut Numbers { out, at: 0 });
    }

    /// The row as stored in the spool: little-endian values of each column's kind, without gaps.
    #[inline]
    pub(crate) fn encode(&self, rotor_count: usize, out: &mut [u8]) {
        self.visit(rotor_count, &mut Bytes { out, at: 0 });
    }
}

/// Columns of what is sensed, as in a flight log: position, velocity, attitude, body rates, specific force, voltage.
pub const SENSED: [&str; 16] = [
    "position_north_m",
    "position_east_m",
    "position_down_m",
    "velocity_north_m_s",
    "velocity_east_m_s",
    "velocity_down_m_s",
    "roll_rad",
    "pitch_rad",
    "yaw_rad",
    "roll_rate_rad_s",
    "pitch_rate_rad_s",
    "yaw_rate_rad_s",
    "accel_x_m_s2",
    "accel_y_m_s2",
    "accel_z_m_s2",
    "battery_voltage_v",
];

/// The schema of a run with `rotor_count` rotors (at most [`MAX_ROTORS`]).
pub fn telemetry_columns(rotor_count: usize) -> Vec<Column> {
    let mut schema = Schema(Vec::new());
    TelemetryRow::default().visit(rotor_count.min(MAX_ROTORS), &mut schema);
    schema.0
}

/// Bytes of one row in the spool.
pub(crate) fn row_bytes(columns: &[Column]) -> usize {
    columns.iter().map(|column| column.kind.bytes()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn val_schema_has_the_canonical_names_once() {
        let columns = telemetry_columns(6);
        let names: BTreeSet<&str> = columns.iter().map(|column| column.name.as_str()).collect();
        assert_eq!(names.len(), columns.len(), "a name stands twice");
        for name in [
            "time_s",
            "position_north_m",
            "velocity_down_m_s",
            "roll_rad",
            "yaw_rate_rad_s",
            "duty_1",
            "duty_6",
            "battery_voltage_v",
            "battery_current_a",
            "reference_yaw_rad",
            "true_thrust_6_n",
            "residual_6_yaw_nms",
        ] {
            assert!(names.contains(name), "{name} is missing");
        }
        assert!(!names.contains("duty_7"));
    }

    #[test]
    fn val_numbers_and_schema_have_the_same_order() {
        let mut row = TelemetryRow {
            step: 7,
            sim_time_ns: 17_500_000,
            fault_label: 3,
            ..TelemetryRow::default()
        };
        row.residuals_nms[2] = [0.25, 0.5, 0.75];
        row.truth.thrust_n[5] = 2.5;
        row.window_end = true;
        let columns = telemetry_columns(6);
        let mut numbers = vec![f64::NAN; columns.len()];
        row.fill(6, &mut numbers);
        let value = |name: &str| numbers[columns.iter().position(|column| column.name == name).unwrap()];
        assert_eq!(value("time_s"), 0.0175);
        assert_eq!(value("step"), 7.0);
        assert_eq!(value("fault_label"), 3.0);
        assert_eq!(value("residual_3_lever_nms"), 0.5);
        assert_eq!(value("true_thrust_6_n"), 2.5);
        assert_eq!(value("window_end"), 1.0);
        assert!(numbers.iter().all(|number| !number.is_nan()), "a column was not filled");
    }
}
