//! Flights: the closed loop of one flight, whatever carries its messages, and what identifies its result.
//!
//! * [`flight`]: the lockstep loop between the plant and its two peers.
//! * [`batch`]: many flights side by side, with the same results.
//! * [`run_hash`]: one hash over all samples of a run; the same scenario and seed give the same one over every link.
//! * [`pace`]: as fast as possible, or 400 Hz of wall clock with a report of jitter and missed deadlines.
//! * [`setup`]: what the peers of a flight are told before it.
//!
//! * [`study`]: campaigns of many flights, see there.
//!
//! And the paper's evaluation, on many flights:
//!
//! ```text
//!  protocol ─▶ windows ─▶ data_set ─┬▶ cross_validation (learning) ─┬▶ reproduction ─▶ tables, report, table_file
//!                                   └▶ T-test verdicts ─────────────┘        └▶ classifiers ─▶ a classifier file
//! ```
//!
//! * [`protocol`]: the 48 flights. * [`windows`]: one flight, boiled down. * [`data_set`]: all of them, as samples.
//! * [`learning`]: training in f64. * [`cross_validation`], [`scores`]: how good it is. * [`parallel`]: on every core, same bits.
//! * [`reproduction`]: the tables of the paper. * [`classifiers`]: trained networks as files.

pub mod batch;
pub mod classifiers;
pub mod cross_validation;
pub mod data_set;
pub mod flight;
pub mod learning;
pub mod pace;
pub mod parallel;
pub mod protocol;
pub mod reproduction;
pub mod run_hash;
pub mod scores;
pub mod setup;
pub mod study;
pub mod table_file;
pub mod windows;
