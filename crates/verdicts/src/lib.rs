//! What the detectors say, as data, and whole flight logs judged by them.
//!
//! * [`view`]: a verdict, a window, a session's answer as JSON, for everything that shows one: the API, the command, Python.
//! * [`log`]: a flight log judged: verdicts over time, the last word, what could not be judged and why.
//! * [`score`]: how right that was, where the truth is known.
//! * [`detectors`]: which detectors, of a model and settings.

mod axial;
pub mod detectors;
pub mod fleet;
pub mod log;
pub mod score;
pub mod view;
mod voltage;
