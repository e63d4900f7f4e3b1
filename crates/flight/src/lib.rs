//! Flights: the closed loop of one flight over any link, and the identity of its result.
//!
//! * [`lockstep`]: the loop between the plant and its two peers. * [`sample`]: its output, step by step.
//! * [`stepped`]: the same flight, stepped by the caller. * [`batch`]: many flights side by side, with the same results.
//! * [`conform`]: identifies the errors of an unknown controller.
//! * [`run_hash`]: one hash over all samples of a run; the same scenario and seed give the same hash over every link.
//! * [`pace`]: as fast as possible, or 400 Hz of wall clock with a report of jitter and missed deadlines. * [`lateness`]: which process was
//!   late, and why.
//! * [`setup`]: what the peers receive before a flight.

pub mod autopilot;
pub mod batch;
pub mod conform;
pub mod lateness;
pub mod lockstep;
pub mod pace;
pub mod run_hash;
pub mod sample;
pub mod setup;
pub mod stepped;
