//! Verdicts of the detectors as data, and evaluation of whole flight logs.
//!
//! * [`view`]: a verdict, a window, a session's answer as JSON, for everything that shows one: the API, the command, Python.
//! * [`log`]: a flight log judged: verdicts over time, the last word, what could not be judged and why.
//! * [`detectors`]: which detectors, of a model and settings.

mod axial;
pub mod detectors;
pub mod fleet;
pub mod log;
mod speeds;
pub mod view;
mod voltage;
