//! A log with something hidden in it, by the independent simulator, imported like any other.

use crate::failure::Failure;
use rotortwin_blind::command::GenerateArgs;
use rotortwin_blind::example::{self, Example};
use rotortwin_blind::flight::fly;
use rotortwin_blind::log_file;
use rotortwin_blind::truth::Truth;
use rotortwin_jobs::LogExample as Job;
use rotortwin_twin::log::FlightLog;
use std::path::Path;

/// What stands in the log's name where nobody gives another.
pub const NAME: &str = "log";
/// What is hidden, beside the log.
const TRUTH: &str = "truth.json";

/// Flies, hides and imports.
///
/// # Errors
/// What is to be hidden or the vehicle cannot be used, or the files not be written.
pub fn make(job: &Job) -> Result<FlightLog, Failure> {
    let disk = |error: &dyn std::fmt::Display| Failure::writing(&job.out, error);
    let scratch = tempfile::tempdir().map_err(|error| disk(&format!("a folder cannot be made: {error}")))?;
    let flown = scratch.path().join("flown.parquet");
    let mut plan = generator(job, &flown).plan()?;
    let rotors = plan.vehicle.rotors.len();
    plan.effects = match (&job.effect, job.preset) {
        (Some(text), _) => example::effect(text, rotors, job.seed)?,
        (None, preset) => preset.unwrap_or(Example::HiddenEffect).effects(rotors, job.seed),
    };
    let (rows, nuisances) = fly(&plan)?;
    log_file::write(&flown, &rows)?;
    let log = FlightLog::read(&flown).map_err(Failure::failed)?;
    log.store(&job.out, NAME).map_err(|error| disk(&error))?;
    Truth::new(&plan, &nuisances).write(&job.out.join(TRUTH))?;
    Ok(log)
}

/// The generator's own arguments, all but what is hidden.
fn generator(job: &Job, out: &Path) -> GenerateArgs {
    GenerateArgs {
        vehicle: Some(job.vehicle.clone()),
        effects: Vec::new(),
        clutter: false,
        flight: "excitation".to_owned(),
        duration_s: job.duration_s,
        idle_s: None,
        seed: job.seed,
        noise_scale: 1.0,
        disturbance: 1.0,
        state_of_charge: None,
        out: out.to_owned(),
        truth: None,
    }
}
