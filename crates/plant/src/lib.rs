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
//! A [`Scenario`] is read from TOML documents, checked as a whole and refused with file, line and key; a [`Simulation`] flies it,
//! one step of 2.5 ms at a time, and knows nothing of links, processes or clocks. Same scenario and seed give the same bits on
//! every machine: `f64` throughout, transcendental functions from `libm`, no fused multiply-add, one random stream per noise.
//!
//! Controller and detector never see this crate's truth: they get `flight-core`'s `NavState` and, through
//! [`Scenario::controller_config`], the nominal vehicle.
//!
//! ```no_run
//! use rotortwin_flight_core::control::Controller;
//! use rotortwin_plant::{Scenario, Simulation};
//!
//! let scenario = Scenario::load("config/scenarios/reference-flight.toml")?;
//! let mut sim = Simulation::new(&scenario, scenario.seed())?;
//! let mut controller = Controller::new(scenario.controller_config())?;
//! controller.trim(sim.hover_duty(), sim.sense().battery_voltage);
//! while !sim.done() {
//!     let sample = sim.sense();
//!     let output = controller.step(&sample.nav, &sample.reference, sample.battery_voltage);
//!     sim.advance(&output.command)?;
//! }
//! println!("charge left: {:.1} %", 100.0 * sim.truth().state_of_charge);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Conventions: SI units, radians, NED world, FRD body, ZYX Euler angles; rotors are numbered from 1 in documents and texts, from
//! 0 in arrays. Equation and table numbers are those of the paper.

pub mod batch;
pub mod battery;
pub mod blades;
pub mod classifier;
pub mod complaints;
pub mod detectors;
pub mod document;
mod dynamics;
mod effect_check;
mod effect_flight;
pub mod effects;
mod elementary;
pub mod environment;
pub mod error;
pub mod faults;
pub mod mismatch;
mod nominal;
pub mod powertrain;
#[cfg(test)]
mod properties;
pub mod random;
pub mod rigid_body;
pub mod scenario;
pub mod sensor_faults;
pub mod sensors;
pub mod simulation;
pub mod template;
pub mod trajectory;
#[cfg(test)]
mod validation;
mod vector;
pub mod vector_units;
pub mod vehicle;
pub mod vehicle_documents;

pub use classifier::Classifier;
pub use detectors::{DetectorSettings, Detectors};
pub use error::{ConfigError, SimulationError};
pub use scenario::{Documents, Scenario};
pub use simulation::{SensedSample, Simulation, TruthSample};
pub use vector::Vector3;
pub use vehicle_documents::VehicleDocuments;

/// Steps per second: the paper's control rate (Table 5); fixed.
pub const STEP_RATE_HZ: f64 = 400.0;
/// Length of a step, s.
pub const STEP_S: f64 = 0.0025;
/// Length of a step, ns.
pub const STEP_NS: u64 = 2_500_000;

/// The step nearest to a time in s, for finite times from 0.
pub fn nearest_step(time_s: f64) -> u64 {
    libm::round(time_s * STEP_RATE_HZ) as u64
}
