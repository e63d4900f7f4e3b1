//! Does one job on this machine.
//!
//! ```text
//!  words of a command line ─┐
//!                           ├─▶ Job ─▶ one function a kind ─▶ typed result (and its text, and its files)
//!  `rotortwin job FILE` ────┘              └─▶ JobEvent, while it goes on
//! ```
//! A command gives its words as a [`Job`] and prints what comes back; a worker writes the job into a file for a process that does the same.
//! Nothing here reads arguments, prints, or knows of servers.

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
mod logs;
pub mod named;
pub mod next_flight;
pub mod result;
pub mod sandbox;
pub mod text;
pub mod training;
pub mod verification;
pub mod versions;

use rotortwin_jobs::JobEvent;

/// Who is told what goes on.
pub type Tell<'a> = &'a (dyn Fn(&JobEvent) + Sync);
