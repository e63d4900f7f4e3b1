//! The controllers of several flights side by side: the equations of [`Controller::step`] for each flight in turn, in plain
//! branch-free loops that a compiler can vectorise over the lanes. Bit-identical results.
//!
//! Only for [`ThrustToDuty::Linear`]; the inverse map iterates separately for every flight.

use super::allocation::linear_duties;
use super::pid::PidState;
use super::{Controller, ThrustToDuty, control_law, is_plausible};
use crate::MAX_ROTORS;
use crate::elementary::BranchFree;
use crate::frames::{AttitudeSines, EulerAngles, Vec3};
use crate::signals::{NavState, Reference};

/// Rows of numbers, a column for each of `L` flights: position (m, NED), velocity (m/s, NED), attitude (rad), body rates (rad/s),
/// battery voltage (V).
pub type MeasuredRows<const L: usize> = [[f32; L]; 13];

/// Reference position (m, NED), velocity (m/s, NED), yaw (rad).
pub type ReferenceRows<const L: usize> = [[f32; L]; 7];

/// Sensed state of one lane.
#[inline(always)]
pub(crate) fn nav<const L: usize>(rows: &MeasuredRows<L>, lane: usize) -> NavState {
    NavState {
        position_ned: Vec3::new(rows[0][lane], rows[1][lane], rows[2][lane]),
        velocity_ned: Vec3::new(rows[3][lane], rows[4][lane], rows[5][lane]),
        attitude: EulerAngles {
            roll: rows[6][lane],
            pitch: rows[7][lane],
            yaw: rows[8][lane],
        },
        body_rates: Vec3::new(rows[9][lane], rows[10][lane], rows[11][lane]),
    }
}

/// Sine and cosine of every lane's attitude: (sin, cos) of roll, pitch, yaw.
#[derive(Clone, Debug)]
pub struct SineRows<const L: usize> {
    rows: [[f32; L]; 6],
    /// Non-zero where an angle exceeds the range of the branch-free functions.
    pub outside: [u32; L],
}

impl<const L: usize> SineRows<L> {
    /// Placeholder before any attitude has been computed.
    pub const NONE: Self = Self {
        rows: [[0.0; L]; 6],
        outside: [0; L],
    };

    /// Computes them for every lane.
    #[inline(always)]
    pub fn fill(&mut self, measured: &MeasuredRows<L>) {
        for angle in 0..3 {
            for lane in 0..L {
                let mut functions = BranchFree::default();
                let (sin, cos) = crate::elementary::Elementary::sin_cos(&mut functions, measured[6 + angle][lane]);
                self.rows[2 * angle][lane] = sin;
                self.rows[2 * angle + 1][lane] = cos;
                let before = if angle == 0 { 0 } else { self.outside[lane] };
                self.outside[lane] = before | u32::from(functions.outside);
            }
        }
    }

    #[inline(always)]
    pub(crate) fn get(&self, lane: usize) -> AttitudeSines {
        let r = &self.rows;
        AttitudeSines {
            roll: (r[0][lane], r[1][lane]),
            pitch: (r[2][lane], r[3][lane]),
            yaw: (r[4][lane], r[5][lane]),
        }
    }
}

/// Integrators and last outputs of `L` controllers for `N` rotors.
#[derive(Clone, Debug)]
pub struct ControlRows<const N: usize, const L: usize> {
    position_integral: [[f32; L]; 3],
    attitude_integral: [[f32; L]; 3],
    /// Fraction.
    pub duty: [[f32; L]; N],
    /// rad.
    pub attitude_setpoint: [[f32; L]; 3],
    /// As in [`super::ControlOutput`].
    pub saturated_rotors: [u32; L],
    /// Non-zero where this step must be done by [`ControlRows::step_alone`]: an input that [`Controller::step`] would not use as it
    /// is, or one outside the range of the branch-free functions.
    pub outside: [u32; L],
}

impl<const N: usize, const L: usize> ControlRows<N, L> {
    /// No controllers yet.
    pub const NONE: Self = Self {
        position_integral: [[0.0; L]; 3],
        attitude_integral: [[0.0; L]; 3],
        duty: [[0.0; L]; N],
        attitude_setpoint: [[0.0; L]; 3],
        saturated_rotors: [0; L],
        outside: [0; L],
    };

    /// True if the controller can run in a lane.
    pub fn suits(controller: &Controller) -> bool {
        controller.cfg.geometry.rotor_count() == N
            && matches!(controller.cfg.thrust_to_duty, ThrustToDuty::Linear { .. })
    }

    /// Copies the state of a controller, as left by [`Controller::trim`], into a lane.
    pub fn seat(&mut self, lane: usize, controller: &Controller) {
        self.set_integrals(lane, &controller.position, &controller.attitude);
    }

    #[inline(always)]
    fn set_integrals(&mut self, lane: usize, position: &PidState, attitude: &PidState) {
        for axis in 0..3 {
            self.position_integral[axis][lane] = position.integral[axis];
            self.attitude_integral[axis][lane] = attitude.integral[axis];
        }
    }

    /// One step of every lane with the configuration of `controller`, which all lanes share.
    ///
    /// Lanes marked in [`ControlRows::outside`] keep their integrators and produce no output.
    #[inline(always)]
    pub fn step(
        &mut self,
        controller: &Controller,
        measured: &MeasuredRows<L>,
        sines: &SineRows<L>,
        references: &ReferenceRows<L>,
    ) {
        let cfg = &controller.cfg;
        let ThrustToDuty::Linear { full_thrust } = cfg.thrust_to_duty else {
            self.outside = [1; L];
            return;
        };
        for lane in 0..L {
            let nav = nav(measured, lane);
            let r = references;
            let reference = Reference {
                position_ned: Vec3::new(r[0][lane], r[1][lane], r[2][lane]),
                velocity_ned: Vec3::new(r[3][lane], r[4][lane], r[5][lane]),
                yaw: r[6][lane],
            };
            let mut functions = BranchFree::default();
            let (before_p, before_a) = (
                PidState {
                    integral: [
                        self.position_integral[0][lane],
                        self.position_integral[1][lane],
                        self.position_integral[2][lane],
                    ],
                },
                PidState {
                    integral: [
                        self.attitude_integral[0][lane],
                        self.attitude_integral[1][lane],
                        self.attitude_integral[2][lane],
                    ],
                },
            );
            let (mut position, mut attitude) = (before_p, before_a);
            let (vector, wrench) = control_law(
                cfg,
                controller.tilt_limit_tan,
                (&mut position, &mut attitude),
                &nav,
                &sines.get(lane),
                &reference,
                &mut functions,
            );
            let mut thrust = [0.0; N];
            cfg.geometry.allocate_to(wrench, &mut thrust);
            let mut duty = [0.0; N];
            let saturated = linear_duties(&thrust, full_thrust, &mut duty);
            let outside = functions.outside | (sines.outside[lane] != 0) | !is_plausible(&nav, &reference);
            for axis in 0..3 {
                self.position_integral[axis][lane] = if outside {
                    before_p.integral[axis]
                } else {
                    position.integral[axis]
                };
                self.attitude_integral[axis][lane] = if outside {
                    before_a.integral[axis]
                } else {
                    attitude.integral[axis]
                };
            }
            for k in 0..N {
                self.duty[k][lane] = duty[k];
            }
            let setpoint = vector.attitude_setpoint;
            self.attitude_setpoint[0][lane] = setpoint.roll;
            self.attitude_setpoint[1][lane] = setpoint.pitch;
            self.attitude_setpoint[2][lane] = setpoint.yaw;
            self.saturated_rotors[lane] = saturated;
            self.outside[lane] = u32::from(outside);
        }
    }

    /// Steps one lane that [`ControlRows::step`] skipped. False if [`Controller::step`] would reject the input: the lane cannot
    /// continue, as it does not store the output that the controller would repeat.
    pub fn step_alone(
        &mut self,
        controller: &Controller,
        lane: usize,
        measured: &MeasuredRows<L>,
        references: &ReferenceRows<L>,
    ) -> bool {
        let mut alone = *controller;
        for axis in 0..3 {
            alone.position.integral[axis] = self.position_integral[axis][lane];
            alone.attitude.integral[axis] = self.attitude_integral[axis][lane];
        }
        let r = references;
        let reference = Reference {
            position_ned: Vec3::new(r[0][lane], r[1][lane], r[2][lane]),
            velocity_ned: Vec3::new(r[3][lane], r[4][lane], r[5][lane]),
            yaw: r[6][lane],
        };
        let output = alone.step(&nav(measured, lane), &reference, measured[12][lane]);
        let (position, attitude) = (alone.position, alone.attitude);
        self.set_integrals(lane, &position, &attitude);
        for k in 0..N.min(MAX_ROTORS) {
            self.duty[k][lane] = output.command.duty[k];
        }
        let setpoint = output.attitude_setpoint;
        self.attitude_setpoint[0][lane] = setpoint.roll;
        self.attitude_setpoint[1][lane] = setpoint.pitch;
        self.attitude_setpoint[2][lane] = setpoint.yaw;
        self.saturated_rotors[lane] = output.saturated_rotors;
        !output.input_rejected
    }
}
