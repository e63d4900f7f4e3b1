//! Boundary signals: inputs and outputs of the controller and the FDI engine.
//!
//! The plant's truth has its own types (crate `rotortwin-plant`) on purpose: neither the controller nor the FDI engine can be
//! given the truth by mistake.

use crate::MAX_ROTORS;
use crate::frames::{Body, EulerAngles, Ned, Vec3};

/// Sensed navigation state y = (p_F, ṗ_F, η, ω), noise of Table 4 included.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NavState {
    /// p_F, m, NED.
    pub position_ned: Vec3<Ned>,
    /// ṗ_F, m/s, NED.
    pub velocity_ned: Vec3<Ned>,
    /// η, rad.
    pub attitude: EulerAngles,
    /// ω = (p, q, r), rad/s, body.
    pub body_rates: Vec3<Body>,
}

impl NavState {
    /// True if all components are finite.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.position_ned.is_finite()
            && self.velocity_ned.is_finite()
            && self.attitude.roll.is_finite()
            && self.attitude.pitch.is_finite()
            && self.attitude.yaw.is_finite()
            && self.body_rates.is_finite()
    }
}

/// Trajectory reference.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reference {
    /// m, NED.
    pub position_ned: Vec3<Ned>,
    /// m/s, NED.
    pub velocity_ned: Vec3<Ned>,
    /// ψ_r, rad.
    pub yaw: f32,
}

/// Duty cycle of every rotor, u of §2.4, fraction in \[0, 1\]; entries past the rotor count are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorCommand {
    /// u, fraction.
    pub duty: [f32; MAX_ROTORS],
}

/// FDI input for one 2.5 ms step: the state at its start, the duty held over it, the voltage at its start.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measurement {
    /// Sensed state at the start of the step.
    pub nav: NavState,
    /// Duty held over the step.
    pub command: MotorCommand,
    /// V_batt at the start of the step, V.
    pub battery_voltage: f32,
}
