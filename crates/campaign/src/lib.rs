//! Flights: the closed loop of one flight, whatever carries its messages, and what identifies its result.
//!
//! * [`flight`]: the lockstep loop between the plant and its two peers.
//! * [`run_hash`]: one hash over all samples of a run; the same scenario and seed give the same one over every link.
//! * [`pace`]: as fast as possible, or 400 Hz of wall clock with a report of jitter and missed deadlines.

pub mod cross_validation;
pub mod data_set;
pub mod flight;
pub mod learning;
pub mod pace;
pub mod parallel;
pub mod protocol;
pub mod run_hash;
pub mod scores;
pub mod setup;
pub mod windows;
