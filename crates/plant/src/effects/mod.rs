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
mod arm_length;
mod attitude_offset;
mod axial_inflow;
mod battery;
mod catalogue;
mod ceiling_wall;
mod centre_of_mass;
mod changes;
mod cold_battery;
mod constants;
mod current_heading;
mod declaration;
mod drag_anisotropy;
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
mod mass_loss;
mod moment_ratio;
mod motor_lag;
mod page;
mod prelude;
mod quadratic_drag;
mod readings;
mod rotational_damping;
mod rotor_drag;
mod rotor_inertia;
mod rotor_interference;
mod rotor_lift_bias;
mod rotor_moment_ratio;
mod rotor_thrust_scale;
mod rotor_tilt;
mod search;
mod set;
mod slung_load;
#[cfg(test)]
mod tests;
mod thrust_curve;
mod translational_lift;
mod user;
mod vibration;
mod vortex_ring;
mod wind;
mod wiring;
mod wrench;

pub use catalogue::catalogue;
pub use constants::{Allocation, Constants, hover_rotor_speed_rad_s};
pub use declaration::{
    Build, ChannelGroup, Correction, CorrectionScale, EffectClass, EffectDeclaration, ParameterDeclaration,
    ParameterKind, Place, Setup, Tolerance,
};
pub use hooks::{ActiveEffect, Hooks, Moment};
pub use instance::{Catalogue, EffectInstance};
pub use page::page;
pub use readings::Readings;
pub use search::{AtBattery, BetweenRows, Requirement, Search, Shapes, Strategy, TrimChange, Wiring};
pub use set::EffectSet;
pub use user::{EffectDocument, ParameterEntry, TermEntry, expression_places, expression_variables, factor_unit};
pub use wrench::Wrench;
