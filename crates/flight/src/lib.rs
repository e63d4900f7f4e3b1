//! Flights: the closed loop of one flight, whatever carries its messages, and what identifies its result.
//!
//! * [`lockstep`]: the loop between the plant and its two peers. * [`sample`]: what leaves it, step by step.
//! * [`stepped`]: the same flight in the hands of a caller. * [`batch`]: many flights side by side, with the same results.
//! * [`conform`]: what an unknown controller does wrong.
//! * [`run_hash`]: one hash over all samples of a run; the same scenario and seed give the same one over every link.
//! * [`pace`]: as fast as possible, or 400 Hz of wall clock with a report of jitter and missed deadlines. * [`lateness`]: who was late, and why.
//! * [`weighed`]: the network's verdicts weighed over time. * [`setup`]: what the peers of a flight are told before it.

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
pub mod weighed;
