//! Effects: the physics, sensor faults and timing faults that a nominal vehicle lacks, each with its declaration.
//!
//! ```text
//!  declaration (equation, units, sizes, channels) ──▶ command line, documents, diagnosis
//!        │ build
//!        ▼
//!  ActiveEffect (hooks) ──▶ EffectSet ──▶ simulator (true state)   and   twin (measured kinematics of a log)
//! ```
//!
//! [`catalogue`] is the list of all; one file an effect. An effect whose sizes are 0 changes nothing, bit for bit. Effects act in
//! the order of their list; an effect with an onset acts from the step nearest to it.

mod accelerometer;
mod air_density;
mod attitude_offset;
mod axial_inflow;
mod battery;
mod ceiling_wall;
mod centre_of_mass;
mod cold_battery;
mod constants;
mod declaration;
mod drag_centre;
mod esc;
mod flapping_moment;
mod frame_flex;
mod ground_effect;
mod gusts;
mod gyroscope;
mod hooks;
mod imu_mounting;
mod inertia;
mod instance;
mod latency;
mod linear_friction;
mod mass;
mod moment_ratio;
mod motor_lag;
mod page;
mod quadratic_drag;
mod rotational_damping;
mod rotor_drag;
mod rotor_inertia;
mod rotor_interference;
mod rotor_lift_bias;
mod rotor_thrust_scale;
mod rotor_tilt;
mod set;
mod slung_load;
#[cfg(test)]
mod tests;
mod translational_lift;
mod user;
mod vibration;
mod vortex_ring;
mod wind;
mod wiring;

pub use constants::{Allocation, Constants};
pub use declaration::{
    Build, ChannelGroup, EffectClass, EffectDeclaration, ParameterDeclaration, ParameterKind, Place, Setup,
};
pub use hooks::{ActiveEffect, Hooks, Moment, Readings, Wrench};
pub use instance::{Catalogue, EffectInstance};
pub use page::page;
pub use set::EffectSet;
pub use user::{
    EffectDocument, ParameterEntry, TermEntry, UserEffect, expression_places, expression_variables, factor_unit,
};

/// What the file of an effect needs.
mod prelude {
    pub(super) use super::Constants;
    pub(super) use super::declaration::{
        Build, ChannelGroup, EffectClass, EffectDeclaration, ParameterDeclaration, Place, Setup,
    };
    pub(super) use super::hooks::{ActiveEffect, Changes, Hooks, Moment, Readings, Wrench};
    pub(super) use crate::random::NormalStream;
    pub(super) use crate::vector::{Vector3, length};

    pub(super) const FORCE: ChannelGroup = ChannelGroup::Force;
    pub(super) const MOMENT: ChannelGroup = ChannelGroup::Moment;
    pub(super) const VELOCITY: ChannelGroup = ChannelGroup::VelocityKinematics;
    pub(super) const ATTITUDE: ChannelGroup = ChannelGroup::AttitudeKinematics;
    pub(super) const POSITION: ChannelGroup = ChannelGroup::PositionKinematics;
    pub(super) const VOLTAGE: ChannelGroup = ChannelGroup::Voltage;
}

static CATALOGUE: &[&EffectDeclaration] = &[
    &rotor_drag::DECLARATION,
    &quadratic_drag::DECLARATION,
    &linear_friction::DECLARATION,
    &wind::DECLARATION,
    &gusts::GAUSS_MARKOV,
    &gusts::DRYDEN,
    &translational_lift::DECLARATION,
    &axial_inflow::DECLARATION,
    &vortex_ring::DECLARATION,
    &ground_effect::DECLARATION,
    &ceiling_wall::CEILING,
    &ceiling_wall::WALL,
    &rotor_interference::DECLARATION,
    &flapping_moment::DECLARATION,
    &drag_centre::DECLARATION,
    &rotational_damping::DECLARATION,
    &air_density::DECLARATION,
    &mass::DECLARATION,
    &slung_load::DECLARATION,
    &centre_of_mass::DECLARATION,
    &inertia::ROLL,
    &inertia::PITCH,
    &inertia::YAW,
    &inertia::PRODUCT_XY,
    &inertia::PRODUCT_XZ,
    &inertia::PRODUCT_YZ,
    &rotor_tilt::TANGENTIAL,
    &rotor_tilt::RADIAL,
    &frame_flex::DECLARATION,
    &rotor_thrust_scale::DECLARATION,
    &rotor_lift_bias::DECLARATION,
    &motor_lag::TIME_CONSTANT,
    &motor_lag::ASYMMETRY,
    &motor_lag::SPEED_DOMAIN,
    &esc::DELAY,
    &esc::DEAD_ZONE,
    &esc::SATURATION,
    &esc::RESISTANCE,
    &rotor_inertia::GYROSCOPIC,
    &rotor_inertia::REACTION,
    &moment_ratio::DECLARATION,
    &wiring::SWAPPED,
    &wiring::REVERSED,
    &battery::RESISTANCE,
    &battery::RC,
    &battery::CAPACITY,
    &cold_battery::DECLARATION,
    &battery::CHARGE,
    &battery::GAIN,
    &battery::OFFSET,
    &accelerometer::BIAS,
    &accelerometer::SCALE,
    &gyroscope::BIAS,
    &gyroscope::SCALE,
    &imu_mounting::MISALIGNMENT,
    &imu_mounting::LEVER_ARM,
    &latency::OF_IMU,
    &latency::OF_ATTITUDE,
    &latency::OF_VELOCITY,
    &latency::OF_POSITION,
    &attitude_offset::HEADING,
    &attitude_offset::LEVEL,
    &vibration::DECLARATION,
];

/// Every effect of this crate, in the order of the catalogue's rows.
pub fn catalogue() -> &'static [&'static EffectDeclaration] {
    CATALOGUE
}
