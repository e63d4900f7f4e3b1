//! The blind bench: draws cases, has each generated and diagnosed by a process of its own, and scores the answers.
//!
//! ```text
//!  preset, n, seed ─▶ cases ─▶ generator process ─▶ logs/0007.parquet ─▶ diagnosis process ─▶ answers/0007.json ─┐
//!                                     └───────────▶ truth/0007.json ───────────────────────────────────────────┴─▶ score
//! ```
//!
//! The diagnosis is a command line that gets a log and a vehicle; it never sees `truth/`. Everything is on disk case by
//! case, so a bench that was stopped resumes. Nothing here knows physics.
//!
//! Damaged rotors ([`faults`]) are instead judged by the detectors over time, and have a score sheet of their own
//! ([`faults_sheet`]).

pub mod answer;
pub mod cases;
pub mod faults;
pub mod faults_sheet;
pub mod merge;
pub mod product;
pub mod report;
pub mod run;
pub mod score;
pub mod sheet;
