//! Inner loop: attitude error to angular acceleration.

use super::ControllerConfig;
use super::pid::PidState;
use crate::elementary::Elementary;
use crate::frames::EulerAngles;
use crate::signals::NavState;

/// PID on the Euler angle errors, derivative on the measured body rates: α = Kp e + Ki ∫e − Kd ω, rad/s², body.
///
/// Euler angle errors stand in for body-axis errors, as in the paper: exact near level flight, with some coupling
/// between the axes at the tilt limit.
#[inline(always)]
pub(super) fn angular_acceleration_setpoint(
    state: &mut PidState,
    cfg: &ControllerConfig,
    nav: &NavState,
    setpoint: &EulerAngles,
    functions: &mut impl Elementary,
) -> [f32; 3] {
    let error = [
        setpoint.roll - nav.attitude.roll,
        setpoint.pitch - nav.attitude.pitch,
        functions.wrap_angle(setpoint.yaw - nav.attitude.yaw),
    ];
    let error_rate = (-nav.body_rates).to_array();
    state.step(&cfg.attitude_gains, error, error_rate, cfg.period)
}
