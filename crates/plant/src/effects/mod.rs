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

mod accelerometer_bias;
mod constants;
mod declaration;
mod hooks;
mod instance;
mod mass;
mod rotor_drag;
mod rotor_thrust_scale;
mod set;
#[cfg(test)]
mod tests;

pub use constants::Constants;
pub use declaration::{
    Build, ChannelGroup, EffectClass, EffectDeclaration, ParameterDeclaration, ParameterKind, Place, Setup,
};
pub use hooks::{ActiveEffect, Hooks, Moment, Readings, Wrench};
pub use instance::{Catalogue, EffectInstance};
pub use set::EffectSet;

static CATALOGUE: &[&EffectDeclaration] = &[
    &rotor_drag::DECLARATION,
    &mass::DECLARATION,
    &rotor_thrust_scale::DECLARATION,
    &accelerometer_bias::DECLARATION,
];

/// Every effect of this crate, in the order of the catalogue's rows.
pub fn catalogue() -> &'static [&'static EffectDeclaration] {
    CATALOGUE
}
