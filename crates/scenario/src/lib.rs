//! Documents: descriptions of a flight, written by hand, checked as a whole and converted to plain configurations.
//!
//! ```text
//!  scenario.toml ─▶ vehicle.toml ─▶ blades.toml          ┌─▶ SimulationConfig ─▶ plant
//!        ├───────▶ classifier.json        ─▶ Scenario ───┼─▶ ControllerConfig ─▶ flight-core
//!        └───────▶ effect.toml …                         └─▶ FdiConfig        ─▶ flight-core
//! ```
//!
//! A document that cannot be flown is rejected with file, line and key ([`ConfigError`]); [`complaints`] finds all errors at once.
//! The physics lives in `rotortwin-plant`, which knows no documents.
//!
//! ```no_run
//! use rotortwin_flight_core::control::Controller;
//! use rotortwin_scenario::Scenario;
//!
//! let scenario = Scenario::load("config/scenarios/reference-flight.toml")?;
//! let mut sim = scenario.simulation(scenario.seed())?;
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
//! Rotors are numbered from 1 in documents and texts, from 0 in arrays.

pub mod autopilot_frame;
pub mod classifier;
pub mod complaints;
pub mod detectors;
mod effect_check;
pub mod effect_documents;
pub mod error;
pub mod names;
mod nominal;
pub mod scenario;
pub mod scenario_document;
pub mod settings;
pub mod shipped;
pub mod template;
pub mod toml_document;
pub mod vehicle_documents;

pub use classifier::Classifier;
pub use detectors::{DetectorSettings, Detectors};
pub use error::ConfigError;
pub use scenario::{Documents, Scenario};
pub use vehicle_documents::VehicleDocuments;
