//! The plant: an f64 simulation of a multirotor, from motor commands to sensor readings.
//!
//! ```text
//!                    ┌────────────────────────── Simulation ───────────────────────────┐
//!  MotorCommand ─▶ powertrain (blades, faults, lag) ─▶ rigid body ◀─ environment       │
//!                    │   ▲ V_batt        │ power          │ state                      │
//!                    │ battery ◀─────────┘                ▼                            │
//!                    │                          sensors, sensor faults ─▶ NavState ─▶ SensedSample
//!                    │ trajectory ─▶ Reference ───────────────────────────────────▶    │
//!                    └──────────────────────────────────────────────────▶ TruthSample ─┘
//! ```
//!
//! A [`Simulation`] flies a plain [`SimulationConfig`], one step of 2.5 ms at a time, and knows nothing of documents, links, processes
//! or clocks; `rotortwin-scenario` makes such configurations of TOML documents. Same configuration and seed give the same bits on
//! every machine: `f64` throughout, transcendental functions from `libm`, no fused multiply-add, one random stream per noise.
//!
//! Controller and detector never see this crate's truth: they get `flight-core`'s `NavState`.
//!
//! Conventions: SI units, radians, NED world, FRD body, ZYX Euler angles; rotors are numbered from 1 in documents and texts, from
//! 0 in arrays. Equation and table numbers are those of the paper.

pub mod batch;
pub mod body;
pub mod config;
mod effect_flight;
pub mod effects;
mod elementary;
pub mod error;
pub mod motors;
pub mod powertrain;
#[cfg(test)]
mod properties;
pub mod random;
pub mod sensing;
pub mod simulation;
mod state;
#[cfg(test)]
mod testing;
pub mod trajectory;
pub mod trim;
#[cfg(test)]
mod validation;
mod vector;
pub mod vector_units;
pub mod vehicle;

pub use config::SimulationConfig;
pub use error::SimulationError;
pub use simulation::{SensedSample, Simulation, TruthSample};
pub use vector::Vector3;

/// Steps per second: the paper's control rate (Table 5); fixed.
pub const STEP_RATE_HZ: f64 = 400.0;
/// Length of a step, s.
pub const STEP_S: f64 = 0.0025;
/// Length of a step, ns.
pub const STEP_NS: u64 = 2_500_000;
/// Parts of a step, needed by a ground or an autopilot's own clock.
pub const PARTS_PER_STEP: u32 = 5;
/// Length of a part, s.
pub(crate) const PART_S: f64 = STEP_S / PARTS_PER_STEP as f64;

/// The step nearest to a time in s, for finite times from 0.
pub fn nearest_step(time_s: f64) -> u64 {
    libm::round(time_s * STEP_RATE_HZ) as u64
}
