//! Inner loop: attitude error to angular acceleration.

use super::ControllerConfig;
use super::pid::PidState;
use crate::frames::{EulerAngles, wrap_angle};
use crate::signals::NavState;
use core::f32::consts::PI;

/// PID on the Euler angle errors, derivative on the measured body rates: α = Kp e + Ki ∫e − Kd ω, rad/s², body.
///
/// Euler angle errors stand for body axis errors, as in the paper: right near level flight, with some coupling between
/// the axes at the tilt limit.
#[inline]
pub(super) fn angular_acceleration_setpoint(
    state: &mut PidState,
    cfg: &ControllerConfig,
    nav: &NavState,
    setpoint: &EulerAngles,
) -> [f32; 3] {
    let error = [
        setpoint.roll - nav.attitude.roll,
        setpoint.pitch - nav.attitude.pitch,
        wrap_yaw_error(setpoint.yaw - nav.attitude.yaw),
    ];
    let error_rate = (-nav.body_rates).to_array();
    state.step(&cfg.attitude_gains, error, error_rate, cfg.period)
}

/// [`wrap_angle`], with its three transcendental functions left out (and no rounding) where there is nothing to wrap.
#[inline]
fn wrap_yaw_error(error: f32) -> f32 {
    if error.abs() <= PI { error } else { wrap_angle(error) }
}
