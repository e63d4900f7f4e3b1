//! Wrench to duties: pseudo-inverse, thrust-to-duty map, motor limits.

use super::ThrustToDuty;
use crate::MAX_ROTORS;
use crate::geometry::Geometry;
use crate::signals::MotorCommand;

/// Duties for a wrench (Fz, Mx, My, Mz), and a bit mask of the saturated rotors.
///
/// f = F⁺ w; u_i = clip(map(f_i), 0, 1). The limits are applied rotor by rotor, without redistribution.
#[inline]
pub(super) fn duties(
    geometry: &Geometry,
    map: &ThrustToDuty,
    wrench: [f32; 4],
    battery_voltage: f32,
) -> (MotorCommand, u32) {
    let thrust = geometry.allocate(wrench);
    let rotor_count = geometry.rotor_count().min(MAX_ROTORS);
    let mut command = MotorCommand::default();
    let mut saturated = 0;
    match map {
        ThrustToDuty::Linear { full_thrust } => {
            saturated = linear_duties(&thrust[..rotor_count], *full_thrust, &mut command.duty);
        }
        ThrustToDuty::InverseMap(map) => {
            let full_thrust = map.thrust(1.0, battery_voltage);
            for k in 0..rotor_count {
                command.duty[k] = map.duty(thrust[k], battery_voltage);
                saturated |= u32::from(!(0.0..=full_thrust).contains(&thrust[k])) << k;
            }
        }
    }
    (command, saturated)
}

/// Duties from the linear map through 0, and a bit mask of the saturated rotors.
#[inline(always)]
pub(super) fn linear_duties(thrust: &[f32], full_thrust: f32, limited: &mut [f32]) -> u32 {
    let mut saturated = 0;
    for k in 0..thrust.len() {
        let duty = thrust[k] / full_thrust;
        limited[k] = limit_duty(duty);
        saturated |= u32::from(!(0.0..=1.0).contains(&duty)) << k;
    }
    saturated
}

/// Clamps to \[0, 1\]; NaN becomes 0, which stops the rotor.
#[inline(always)]
fn limit_duty(duty: f32) -> f32 {
    if duty >= 1.0 {
        1.0
    } else if duty > 0.0 {
        duty
    } else {
        0.0
    }
}
