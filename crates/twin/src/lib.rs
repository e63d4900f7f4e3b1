//! The twin compared with measurements.
//!
//! ```text
//! log file ─▶ log::FlightLog ─▶ comparison with a model ─▶ missing effect ─▶ model with the effect ─▶ compared again
//! ```
//! * [`bench_fit`]: vehicle constants from test stands: thrust, battery, motor lag.
//! * [`log`]: flight logs of several sources as one type: canonical columns, SI units, NED and FRD.
//! * [`compare`]: models against logs: where, when and how much they disagree.
//! * [`content_hash`]: of documents and logs.
//! * [`model`]: versions of the model: vehicle, effects, provenance; as files.
//! * [`predict`]: a model's prediction of a log, one step ahead, in sixteen channels.
//! * [`estimation`]: parameters and nuisances from whitened residuals, for all of the following.
//! * [`diagnose`]: which effect the model lacks, with evidence.
//! * [`propose`]: an explanation of an error that is in no catalogue.
//! * [`improve`]: the loop over these, version by version.
//! * [`identify`]: a vehicle with intervals from flight logs, mass and arm.
//! * [`flight_picture`]: a model-independent view of a flight: trajectory, parts, events, motor outputs, vibration.
//! * [`baseline`]: a flight that may not be healthy, compared with healthy flights of the same vehicle.
//! * [`vibration`]: how strongly a flight shakes at the speed of each rotor, and against healthy flights.
//! * [`over_time`]: flights of a report, with each channel against the model.
//! * [`sandbox`]: what an effect does to a flight, as a plot.
//! * [`next_flight`]: the manoeuvre that would distinguish two effects.
//!
//! Conventions as everywhere (`docs/conventions.md`): SI, radians, world NED, body FRD, rotors numbered from 1 in names.

pub mod baseline;
pub mod bench_fit;
pub mod compare;
pub mod content_hash;
pub mod diagnose;
pub mod estimation;
pub mod flight_picture;
pub mod identify;
pub mod improve;
pub mod log;
pub mod model;
pub mod next_flight;
pub mod over_time;
pub mod predict;
pub mod propose;
pub mod sandbox;
mod schema;
pub mod vibration;

/// Half of a 95 % interval of a normal distribution, in standard deviations, for every `±` in a document or on a command line: frozen, as
/// content hashes of models depend on it.
pub const Z95: f64 = 1.96;

/// Fewest healthy flights of a vehicle whose spread suffices to detect a change.
pub const LEAST_BASELINE: usize = 3;

/// Posterior from which a change against healthy flights is named.
pub const NAMED: f64 = 0.95;
