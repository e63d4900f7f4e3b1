//! Verdicts of the detectors as data, and evaluation of whole flight logs.
//!
//! * [`view`]: a verdict, a window, a session's answer as JSON, for every user of one: the API, the command, Python.
//! * [`log`]: evaluation of a flight log: verdicts over time, the final verdict, what could not be judged and why.
//! * [`detectors`]: the detectors built from a model and settings.

mod axial;
pub mod detectors;
mod exchanged;
pub mod fleet;
pub mod log;
mod report;
mod sparse;
mod speeds;
mod turn_rates;
pub mod view;
mod voltage;
