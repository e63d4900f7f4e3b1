//! Executes one job on this machine.
//!
//! ```text
//!  command-line arguments ──┐
//!                           ├─▶ Job ─▶ one function per kind ─▶ typed result (and its text, and its files)
//!  `rotortwin job FILE` ────┘              └─▶ JobEvent, while running
//! ```
//! A command converts its arguments to a [`Job`] and prints the result; a worker writes the job to a file for a process that does the same.
//! This crate does not parse arguments or print, and does not know servers.

pub mod autopilot;
pub mod blind;
pub mod campaign;
pub mod comparison;
pub mod destination;
pub mod diagnosis;
pub mod failure;
pub mod flight;
pub mod grid;
pub mod identification;
pub mod improvement;
pub mod log_example;
pub mod log_import;
pub mod log_verdict;
mod logs;
pub mod named;
pub mod next_flight;
pub mod question;
pub mod result;
pub mod sandbox;
pub mod second_look;
pub mod sql;
pub mod text;
pub mod tolerances;
pub mod training;
pub mod verification;
pub mod versions;

use rotortwin_jobs::JobEvent;

/// Receiver of events.
pub type Tell<'a> = &'a (dyn Fn(&JobEvent) + Sync);
