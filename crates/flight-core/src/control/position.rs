//! Outer loop: position error to collective thrust and attitude setpoint.

use super::ControllerConfig;
use super::pid::PidState;
use crate::elementary::{Elementary, square_root};
use crate::frames::{AttitudeSines, EulerAngles, Ned, Vec3};
use crate::signals::{NavState, Reference};

/// Minimum downward specific force that the thrust must balance, m/s²: the vehicle never commands inverted or
/// free-falling flight.
pub(super) const MIN_SPECIFIC_THRUST: f32 = 1.0;

/// Lower bound of cos φ cos θ in the tilt compensation: never more than 3.3 times the thrust is commanded, however far
/// the vehicle tips.
pub(super) const MIN_TILT_COSINE: f32 = 0.3;

/// Setpoints from the outer loop to the inner one.
#[derive(Clone, Copy, Debug)]
pub(super) struct ThrustVector {
    /// T, N.
    pub(super) collective_thrust: f32,
    /// φ_ref, θ_ref and the reference yaw.
    pub(super) attitude_setpoint: EulerAngles,
}

/// PID on the position error, derivative on the velocity error: a = Kp e + Ki ∫e + Kd (v_ref − v), m/s², NED.
#[inline(always)]
pub(super) fn acceleration_setpoint(
    state: &mut PidState,
    cfg: &ControllerConfig,
    nav: &NavState,
    reference: &Reference,
) -> Vec3<Ned> {
    let error = reference.position_ned - nav.position_ned;
    let error_rate = reference.velocity_ned - nav.velocity_ned;
    Vec3::from_array(state.step(&cfg.position_gains, error.to_array(), error_rate.to_array(), cfg.period))
}

/// Thrust and attitude that produce an acceleration.
///
/// b = g e₃ − a, with b_z ≥ 1 m/s² and its horizontal part at most tan(tilt limit) b_z;
/// n = b/‖b‖; φ_ref = asin(n_x sin ψ − n_y cos ψ); θ_ref = atan2(n_x cos ψ + n_y sin ψ, n_z) with the measured ψ;
/// T = m b_z / max(0.3, cos φ cos θ)
#[inline(always)]
pub(super) fn thrust_vector(
    cfg: &ControllerConfig,
    tilt_limit_tan: f32,
    acceleration: Vec3<Ned>,
    sines: &AttitudeSines,
    yaw_reference: f32,
    functions: &mut impl Elementary,
) -> ThrustVector {
    let raw = cfg.gravity - acceleration.z;
    let b_z = if raw > MIN_SPECIFIC_THRUST {
        raw
    } else {
        MIN_SPECIFIC_THRUST
    };
    let (b_x, b_y) = (-acceleration.x, -acceleration.y);
    let horizontal = square_root(b_x * b_x + b_y * b_y);
    let limit = tilt_limit_tan * b_z;
    let scale = limit / horizontal;
    let (b_x, b_y) = if horizontal > limit {
        (b_x * scale, b_y * scale)
    } else {
        (b_x, b_y)
    };
    // At least b_z, which is at least 1: no division by zero.
    let norm = square_root(b_x * b_x + b_y * b_y + b_z * b_z);
    let (n_x, n_y, n_z) = (b_x / norm, b_y / norm, b_z / norm);

    let (sin_yaw, cos_yaw) = sines.yaw;
    let tilt_cosine = sines.roll.1 * sines.pitch.1;
    let compensation = if tilt_cosine > MIN_TILT_COSINE {
        tilt_cosine
    } else {
        MIN_TILT_COSINE
    };
    ThrustVector {
        collective_thrust: cfg.mass * b_z / compensation,
        attitude_setpoint: EulerAngles {
            // The tilt limit keeps the argument well inside ±1.
            roll: functions.asin(n_x * sin_yaw - n_y * cos_yaw),
            pitch: functions.atan2(n_x * cos_yaw + n_y * sin_yaw, n_z),
            yaw: yaw_reference,
        },
    }
}
