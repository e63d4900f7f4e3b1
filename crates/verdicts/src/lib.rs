//! Verdicts of the detectors as data, and evaluation of whole flight logs.
//!
//! * [`view`]: verdicts, windows and session results as JSON, for the API, the command line and Python.
//! * [`log`]: evaluation of a flight log: verdicts over time, the final verdict, what could not be evaluated and why.
//! * [`score`]: its accuracy, if the truth is known.
//! * [`detectors`]: detectors for a model and settings.

pub mod detectors;
pub mod fleet;
pub mod log;
pub mod score;
pub mod view;
mod voltage;
