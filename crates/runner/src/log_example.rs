//! Creates a log with a hidden effect, from the independent simulator, imported like any other.

use crate::failure::Failure;
use rotortwin_blind::command::GenerateArgs;
use rotortwin_blind::error::BlindError;
use rotortwin_blind::example::{self, Example};
use rotortwin_blind::flight::{FlightPlan, Nuisances, Row, fly};
use rotortwin_blind::log_file;
use rotortwin_blind::truth::Truth;
use rotortwin_jobs::LogExample as Job;
use rotortwin_twin::log::FlightLog;
use std::path::Path;

/// Default name of the log.
pub const NAME: &str = "log";
/// The hidden effect, next to the log.
pub const TRUTH: &str = "truth.json";

/// Maximum draws of a preset: the hidden effect may tip a vehicle over, which was not requested.
const DRAWS: u64 = 8;

/// Flies with a hidden effect and imports the log.
///
/// # Errors
/// The effect or the vehicle cannot be used, the flight is lost, or the files cannot be written.
pub fn make(job: &Job) -> Result<FlightLog, Failure> {
    let disk = |error: &dyn std::fmt::Display| Failure::writing(&job.out, error);
    // Before the flight: what was flown would be lost.
    if let Some(there) = [format!("{NAME}.parquet"), TRUTH.to_owned()]
        .iter()
        .map(|name| job.out.join(name))
        .find(|path| path.exists())
    {
        return Err(Failure::Input(format!(
            "{}: already exists; name another folder with --out, or remove it",
            there.display()
        )));
    }
    let scratch = tempfile::tempdir().map_err(|error| disk(&format!("a folder cannot be created: {error}")))?;
    let flown = scratch.path().join("flown.parquet");
    let (plan, rows, nuisances) = fly_one(job, &flown)?;
    log_file::write(&flown, &rows)?;
    let log = FlightLog::read(&flown).map_err(Failure::failed)?;
    log.store(&job.out, NAME).map_err(|error| disk(&error))?;
    Truth::new(&plan, &nuisances).write(&job.out.join(TRUTH))?;
    Ok(log)
}

/// The flight that was asked for, a case of a blind bench as it is; of a preset whose flight is lost the one of the next seed, as its truth says.
fn fly_one(job: &Job, out: &Path) -> Result<(FlightPlan, Vec<Row>, Nuisances), Failure> {
    let mut draw = 0;
    loop {
        let seed = job.seed.wrapping_add(draw);
        let mut plan = generator(job, seed, out).plan()?;
        if job.case.is_some() {
            let (rows, nuisances) = fly(&plan)?;
            return Ok((plan, rows, nuisances));
        }
        let rotors = plan.vehicle.rotors.len();
        plan.effects = match (&job.effect, job.preset) {
            (Some(text), _) => example::effect(text, rotors, seed)?,
            (None, preset) => preset
                .unwrap_or(Example::HiddenEffect)
                .effects(rotors, job.duration_s, seed),
        };
        draw += 1;
        match fly(&plan) {
            Err(BlindError::FlightLost { .. }) if job.effect.is_none() && draw < DRAWS => {}
            flown => {
                let (rows, nuisances) = flown?;
                return Ok((plan, rows, nuisances));
            }
        }
    }
}

/// The generator's own arguments; of an example all but what is hidden.
fn generator(job: &Job, seed: u64, out: &Path) -> GenerateArgs {
    let case = job.case.as_ref();
    GenerateArgs {
        vehicle: Some(job.vehicle.clone()),
        effects: case.map_or_else(Vec::new, |case| case.effects.clone()),
        clutter: case.is_some_and(|case| case.clutter),
        flight: case.map_or_else(|| "excitation".to_owned(), |case| case.flight.clone()),
        duration_s: job.duration_s,
        idle_s: None,
        seed,
        noise_scale: 1.0,
        disturbance: case.map_or(1.0, |case| case.disturbance),
        state_of_charge: None,
        out: out.to_owned(),
        truth: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// "Fly it" answered "the flight was lost at 52.28 s: the vehicle tipped over".
    #[test]
    fn regress_a_lost_flight_of_a_preset_is_drawn_again() {
        let folder = tempfile::tempdir().unwrap();
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let mut job = Job {
            vehicle: root.join("config/vehicles/f550.toml"),
            preset: Some(Example::HiddenEffect),
            effect: None,
            seed: 15_504,
            duration_s: 60.0,
            case: None,
            out: folder.path().to_owned(),
        };
        let (plan, rows, _) = fly_one(&job, Path::new("unused")).unwrap();
        assert!(plan.seed > job.seed && plan.seed < job.seed + DRAWS, "{}", plan.seed);
        assert_eq!(
            plan.effects,
            Example::HiddenEffect.effects(6, 60.0, plan.seed),
            "the truth is that of the flight"
        );
        assert!(rows.len() > 20_000, "{}", rows.len());
        // An explicitly requested effect is reported as it ended.
        let hidden = &Example::HiddenEffect.effects(6, 60.0, job.seed)[0];
        let values = hidden
            .parameters
            .iter()
            .map(|(name, value)| format!("{name}={value:?}"));
        job.effect = Some(format!("{}:{}", hidden.id, values.collect::<Vec<_>>().join(",")));
        let told = format!("{:?}", fly_one(&job, Path::new("unused")).map(|_| ()).unwrap_err());
        assert!(told.contains("the flight was lost"), "{told}");
    }
}
