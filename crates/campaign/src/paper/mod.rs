//! The paper's evaluation, on many flights:
//!
//! ```text
//!  protocol ─▶ windows ─▶ data_set ─┬▶ cross_validation (learning) ─┬▶ reproduction ─▶ tables, report, table_file
//!                                   └▶ T-test verdicts ─────────────┘        └▶ classifiers ─▶ a classifier file
//! ```
//!
//! * [`protocol`]: the 48 flights. * [`windows`]: one flight, condensed. * [`data_set`]: all of them, as samples.
//! * [`cross_validation`], [`scores`]: accuracy of a network. * [`reproduction`]: the tables of the paper.
//! * [`classifiers`]: trained networks as files.

pub mod classifiers;
pub mod cross_validation;
pub mod data_set;
pub mod protocol;
pub mod reproduction;
pub mod scores;
pub mod windows;
