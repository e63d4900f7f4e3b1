//! Bodies of the requests that submit jobs, and of the check before a submission: what a server's routes read and what
//! `rotortwin --server` writes.
//!
//! ```text
//!  command line ─▶ RunSubmission, … ──JSON──▶ route ─▶ names looked up in the library, files found ─▶ Job
//! ```
//! A body names documents, logs and runs as the server knows them; a [`Job`](crate::Job) names files by path. What can be checked without
//! the server's library, files and limits is checked here; each refusal is one sentence.
//!
//! The serialised form is part of the key under which a repeated request is recognised: fields keep their order, and a new one is left out
//! where it is not set.

mod blind_bench;
mod campaign;
mod classifier;
mod named;
mod run;
mod scenario;
mod twin;

pub use blind_bench::{BenchVehicle, BlindBenchSubmission};
pub use campaign::CampaignSubmission;
pub use classifier::ClassifierSubmission;
pub use named::{Flights, ModelChoice};
pub use run::RunSubmission;
pub use scenario::ScenarioToCheck;
pub use twin::TwinSubmission;
