//! Native, fixed-size messages of the 400 Hz loop: `#[repr(C)]`, no pointers, so that iceoryx2 can share them between processes.
//!
//! Same fields as the messages of `proto/rotortwin/v1/signals.proto`, which documents ranges. Arrays over rotors have
//! [`MAX_ROTORS`] entries; those past the rotor count are 0.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::frames::{EulerAngles, Vec3};
use rotortwin_flight_core::signals::{Measurement, MotorCommand, NavState, Reference};

/// Which step of which run a message belongs to.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamp {
    /// Identity of the run, drawn anew for each execution, never 0.
    pub run_id: u64,
    /// Step number, from 0.
    pub step: u64,
    /// Simulated time at the start of the step, ns.
    pub sim_time_ns: u64,
}

/// Plant to controller and FDI engine, at the start of a step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorFrame {
    /// Run and step.
    pub stamp: Stamp,
    /// Sensed position, m, NED.
    pub position_ned_m: [f32; 3],
    /// Sensed velocity, m/s, NED.
    pub velocity_ned_m_s: [f32; 3],
    /// Sensed roll, pitch, yaw, rad.
    pub attitude_rad: [f32; 3],
    /// Sensed p, q, r, rad/s, body.
    pub body_rates_rad_s: [f32; 3],
    /// Reference position, m, NED.
    pub reference_position_ned_m: [f32; 3],
    /// Reference velocity, m/s, NED.
    pub reference_velocity_ned_m_s: [f32; 3],
    /// Reference yaw, rad.
    pub reference_yaw_rad: f32,
    /// Measured voltage at the battery's terminals, V.
    pub battery_voltage_v: f32,
}

impl SensorFrame {
    /// A frame from the signals of `flight-core`.
    #[inline]
    pub fn new(stamp: Stamp, nav: &NavState, reference: &Reference, battery_voltage_v: f32) -> Self {
        Self {
            stamp,
            position_ned_m: nav.position_ned.to_array(),
            velocity_ned_m_s: nav.velocity_ned.to_array(),
            attitude_rad: [nav.attitude.roll, nav.attitude.pitch, nav.attitude.yaw],
            body_rates_rad_s: nav.body_rates.to_array(),
            reference_position_ned_m: reference.position_ned.to_array(),
            reference_velocity_ned_m_s: reference.velocity_ned.to_array(),
            reference_yaw_rad: reference.yaw,
            battery_voltage_v,
        }
    }

    /// All numbers in the order of the fields.
    #[inline]
    pub fn numbers(&self) -> [f32; 20] {
        let mut numbers = [0.0; 20];
        let parts: [&[f32]; 8] = [
            &self.position_ned_m,
            &self.velocity_ned_m_s,
            &self.attitude_rad,
            &self.body_rates_rad_s,
            &self.reference_position_ned_m,
            &self.reference_velocity_ned_m_s,
            &[self.reference_yaw_rad],
            &[self.battery_voltage_v],
        ];
        let mut at = 0;
        for part in parts {
            numbers[at..at + part.len()].copy_from_slice(part);
            at += part.len();
        }
        numbers
    }

    /// The sensed state.
    #[inline]
    pub fn nav(&self) -> NavState {
        NavState {
            position_ned: Vec3::from_array(self.position_ned_m),
            velocity_ned: Vec3::from_array(self.velocity_ned_m_s),
            attitude: EulerAngles {
                roll: self.attitude_rad[0],
                pitch: self.attitude_rad[1],
                yaw: self.attitude_rad[2],
            },
            body_rates: Vec3::from_array(self.body_rates_rad_s),
        }
    }

    /// The reference.
    #[inline]
    pub fn reference(&self) -> Reference {
        Reference {
            position_ned: Vec3::from_array(self.reference_position_ned_m),
            velocity_ned: Vec3::from_array(self.reference_velocity_ned_m_s),
            yaw: self.reference_yaw_rad,
        }
    }
}

/// Controller to plant and FDI engine: the duty held over the step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CommandFrame {
    /// Run and step of the [`SensorFrame`] that this answers.
    pub stamp: Stamp,
    /// Duty cycle of each rotor, fraction.
    pub duty: [f32; MAX_ROTORS],
    /// Attitude setpoint of the inner loop (roll, pitch, yaw), rad; for plots only.
    pub attitude_setpoint_rad: [f32; 3],
    /// Bit i set: the duty of rotor i (from 0) was limited.
    pub saturated_rotors: u32,
}

impl CommandFrame {
    /// The command in `flight-core`'s type.
    #[inline]
    pub fn command(&self) -> MotorCommand {
        MotorCommand { duty: self.duty }
    }

    /// The FDI engine's input for the step that `sensors` opens and this command completes.
    #[inline]
    pub fn measurement(&self, sensors: &SensorFrame) -> Measurement {
        Measurement {
            nav: sensors.nav(),
            command: self.command(),
            battery_voltage: sensors.battery_voltage_v,
        }
    }
}

/// Maximum number of rotor sets in a report.
pub const MAX_HYPOTHESES: usize = rotortwin_flight_core::fdi::MAX_HYPOTHESES;

/// Lost thrust of one rotor at hover with its 95 % interval; all 0 if no rotor is named; only the loss is set if the engine provides
/// no interval.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LossEstimate {
    /// N.
    pub loss_n: f32,
    /// Lower end, N.
    pub low_n: f32,
    /// Upper end, N.
    pub high_n: f32,
    /// Loss as a fraction of the rotor's nominal hover thrust.
    pub share: f32,
    /// Lower end, fraction.
    pub share_low: f32,
    /// Upper end, fraction.
    pub share_high: f32,
}

impl LossEstimate {
    /// In the order of the fields.
    #[inline]
    pub const fn values(&self) -> [f32; 6] {
        [
            self.loss_n,
            self.low_n,
            self.high_n,
            self.share,
            self.share_low,
            self.share_high,
        ]
    }

    /// From the order of the fields.
    #[inline]
    pub const fn from_values(values: [f32; 6]) -> Self {
        let [loss_n, low_n, high_n, share, share_low, share_high] = values;
        Self {
            loss_n,
            low_n,
            high_n,
            share,
            share_low,
            share_high,
        }
    }

    /// The same, clamped to at most the rotor's entire thrust.
    #[must_use]
    pub fn limited(self) -> Self {
        if self.share_high <= 1.0 || self.share <= 0.0 {
            return self;
        }
        let nominal_n = self.loss_n / self.share;
        Self {
            loss_n: self.loss_n.min(nominal_n),
            low_n: self.low_n.min(nominal_n),
            high_n: self.high_n.min(nominal_n),
            share: self.share.min(1.0),
            share_low: self.share_low.min(1.0),
            share_high: self.share_high.min(1.0),
        }
    }
}

/// FDI engine to plant: residuals and verdicts of the step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FdiReport {
    /// Run and step of the [`SensorFrame`] that this answers.
    pub stamp: Stamp,
    /// r_i (Eq. 32), components arm, lever, yaw, N m s.
    pub residuals_nms: [[f32; 3]; MAX_ROTORS],
    /// Residual of the equivalent four-axis observer: F_z (N s), M_x, M_y, M_z (N m s), body.
    pub wrench_residual: [f32; 4],
    /// Verdict codes: −2 not ready, −1 unknown fault, 0 healthy, i rotor i (from 1); of the sequential detector also −3 ambiguous
    /// and 100 i + j rotors i and j.
    pub t_test: i32,
    /// As `t_test`, of the trained network.
    pub network: i32,
    /// As `t_test`, of the sequential detector.
    pub sequential: i32,
    /// Probability of the sequential verdict, fraction.
    pub sequential_probability: f32,
    /// Loss of thrust estimated by the sequential detector: of the rotor named, for a pair of the one with the lower number.
    pub thrust_loss: LossEstimate,
    /// Loss of the other rotor of a pair.
    pub second_thrust_loss: LossEstimate,
    /// Bit i set: rotor i (from 0) is or may be faulty.
    pub suspect_rotors: u32,
    /// Number of sets that an ambiguous verdict leaves open; may exceed those listed.
    pub hypothesis_count: u32,
    /// The likeliest of them as bit masks, in descending order; 0 past the count.
    pub hypothesis_rotors: [u32; MAX_HYPOTHESES],
    /// 1 on the last step of an evaluation window, otherwise 0.
    pub window_end: u32,
}
