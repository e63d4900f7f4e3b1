//! A row of telemetry as the messages of `proto/rotortwin/v1/telemetry.proto`.

use crate::analysis::column;
use crate::telemetry::Column;
use rotortwin_proto::{
    BatteryTelemetry, BodyVector, CommandTelemetry, EulerAngles, FdiTelemetry, NavTelemetry, NedVector,
    ReferenceTelemetry, TruthTelemetry,
};

/// Indices of the columns read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Places {
    time: usize,
    nav: usize,
    duty: usize,
    battery_voltage: usize,
    reference: usize,
    truth: usize,
    label: usize,
    setpoint: usize,
    residuals: usize,
}

impl Places {
    pub(super) fn of(columns: &[Column]) -> Self {
        let place = |name: &str| column(columns, name);
        Self {
            time: place("time_s"),
            nav: place("position_north_m"),
            duty: place("duty_1"),
            battery_voltage: place("battery_voltage_v"),
            reference: place("reference_north_m"),
            truth: place("true_position_north_m"),
            label: place("fault_label"),
            setpoint: place("roll_setpoint_rad"),
            residuals: place("residual_1_arm_nms"),
        }
    }
}

/// A row of telemetry, and where its values are.
pub(super) struct Row<At> {
    /// Value of a column, by its index.
    at: At,
    places: Places,
    /// Number of rotors.
    n: usize,
}

impl<At: Fn(usize) -> f64> Row<At> {
    pub(super) const fn new(at: At, places: Places, rotor_count: usize) -> Self {
        Self {
            at,
            places,
            n: rotor_count,
        }
    }

    /// Simulated time, ns.
    pub(super) fn time_ns(&self) -> u64 {
        ((self.at)(self.places.time) * 1e9).round() as u64
    }

    pub(super) fn nav(&self) -> NavTelemetry {
        let nav = self.places.nav;
        NavTelemetry {
            position_ned_m: self.ned(nav),
            velocity_ned_m_s: self.ned(nav + 3),
            attitude: self.euler(nav + 6),
            body_rates_rad_s: self.body(nav + 9),
        }
    }

    pub(super) fn reference(&self) -> ReferenceTelemetry {
        let Places {
            reference, setpoint, ..
        } = self.places;
        ReferenceTelemetry {
            position_ned_m: self.ned(reference),
            velocity_ned_m_s: self.ned(reference + 3),
            yaw_rad: self.f(reference + 6),
            attitude_setpoint: self.euler(setpoint),
        }
    }

    pub(super) fn command(&self) -> CommandTelemetry {
        CommandTelemetry {
            duty: self.many(self.places.duty, self.n, 1),
            saturated_rotors: (self.at)(self.places.setpoint + 3) as u32,
        }
    }

    pub(super) fn truth(&self) -> TruthTelemetry {
        let Places { truth, label, .. } = self.places;
        TruthTelemetry {
            position_ned_m: self.ned(truth),
            velocity_ned_m_s: self.ned(truth + 3),
            attitude: self.euler(truth + 6),
            body_rates_rad_s: self.body(truth + 9),
            thrust_n: self.many(self.thrust(), self.n, 1),
            wind_ned_m_s: self.ned(self.charge() + 3),
            fault_label: (self.at)(label) as i32,
            faulty_rotors: (self.at)(label + 1) as u32,
            rotor_condition: self.rotor_conditions(),
            sensor_faults: (self.at)(self.sensor_faults_place()) as u32,
        }
    }

    pub(super) fn battery(&self) -> BatteryTelemetry {
        let (measured, charge) = (self.places.battery_voltage, self.charge());
        BatteryTelemetry {
            voltage_v: self.f(measured),
            current_a: self.f(measured + 1),
            true_voltage_v: self.f(charge + 2),
            open_circuit_voltage_v: self.f(charge + 1),
            state_of_charge: self.f(charge),
        }
    }

    pub(super) fn fdi(&self) -> FdiTelemetry {
        let residuals = self.places.residuals;
        let wrench = residuals + 3 * self.n;
        let verdicts = self.verdicts();
        FdiTelemetry {
            residual_arm_nms: self.many(residuals, self.n, 3),
            residual_lever_nms: self.many(residuals + 1, self.n, 3),
            residual_yaw_nms: self.many(residuals + 2, self.n, 3),
            wrench_residual: self.many(wrench, 4, 1),
            verdict_t_test: (self.at)(verdicts) as i32,
            verdict_network: (self.at)(verdicts + 1) as i32,
            verdict_sequential: self.sequential(),
            sequential_probability: self.f(verdicts + 3),
            thrust_loss_n: self.f(verdicts + 4),
            thrust_loss_low_n: self.f(verdicts + 5),
            thrust_loss_high_n: self.f(verdicts + 6),
            thrust_loss_share: self.f(verdicts + 7),
            thrust_loss_share_low: self.f(verdicts + 8),
            thrust_loss_share_high: self.f(verdicts + 9),
            second_thrust_loss_n: self.f(verdicts + 10),
            second_thrust_loss_low_n: self.f(verdicts + 11),
            second_thrust_loss_high_n: self.f(verdicts + 12),
            second_thrust_loss_share: self.f(verdicts + 13),
            second_thrust_loss_share_low: self.f(verdicts + 14),
            second_thrust_loss_share_high: self.f(verdicts + 15),
            hypothesis_count: (self.at)(verdicts + 16) as u32,
            suspect_rotors: (self.at)(verdicts + 17) as u32,
            window_end: (self.at)(verdicts + 18) > 0.5,
        }
    }

    /// True position, NED, m, and attitude, ZYX Euler angles, rad.
    pub(super) fn flown(&self) -> ([f64; 3], [f64; 3]) {
        let truth = self.places.truth;
        (self.triple(truth), self.triple(truth + 6))
    }

    /// Position and attitude of the reference, as [`flown`](Self::flown): only its yaw is asked for.
    pub(super) fn asked(&self) -> ([f64; 3], [f64; 3]) {
        let reference = self.places.reference;
        (self.triple(reference), [0.0, 0.0, (self.at)(reference + 6)])
    }

    /// True thrust of a rotor, N.
    pub(super) fn thrust_n(&self, rotor: usize) -> f64 {
        (self.at)(self.thrust() + rotor)
    }

    /// Truth: condition of each rotor.
    pub(super) fn rotor_conditions(&self) -> Vec<i32> {
        let conditions = self.places.label + 2;
        (0..self.n).map(|i| (self.at)(conditions + i) as i32).collect()
    }

    /// Truth: one bit for each sensor fault.
    pub(super) fn sensor_faults(&self) -> u64 {
        (self.at)(self.sensor_faults_place()) as u64
    }

    /// Verdict of the sequential detector.
    pub(super) fn sequential(&self) -> i32 {
        (self.at)(self.verdicts() + 2) as i32
    }

    /// Its probability.
    pub(super) fn probability(&self) -> f64 {
        (self.at)(self.verdicts() + 3)
    }

    /// One bit for each rotor that it suspects.
    pub(super) fn suspect_rotors(&self) -> u64 {
        (self.at)(self.verdicts() + 17) as u64
    }

    const fn sensor_faults_place(&self) -> usize {
        self.places.label + 2 + self.n
    }

    const fn thrust(&self) -> usize {
        self.places.truth + 12
    }

    const fn charge(&self) -> usize {
        self.thrust() + self.n
    }

    const fn verdicts(&self) -> usize {
        self.places.residuals + 3 * self.n + 4
    }

    fn f(&self, place: usize) -> f32 {
        (self.at)(place) as f32
    }

    fn triple(&self, p: usize) -> [f64; 3] {
        [(self.at)(p), (self.at)(p + 1), (self.at)(p + 2)]
    }

    fn many(&self, place: usize, count: usize, stride: usize) -> Vec<f32> {
        (0..count).map(|i| self.f(place + i * stride)).collect()
    }

    fn ned(&self, p: usize) -> Option<NedVector> {
        Some(NedVector {
            north: self.f(p),
            east: self.f(p + 1),
            down: self.f(p + 2),
        })
    }

    fn body(&self, p: usize) -> Option<BodyVector> {
        Some(BodyVector {
            forward: self.f(p),
            right: self.f(p + 1),
            down: self.f(p + 2),
        })
    }

    fn euler(&self, p: usize) -> Option<EulerAngles> {
        Some(EulerAngles {
            roll_rad: self.f(p),
            pitch_rad: self.f(p + 1),
            yaw_rad: self.f(p + 2),
        })
    }
}
