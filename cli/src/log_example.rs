//! `rotortwin log example`: a log with something hidden in it, by the independent simulator, imported like any other.

use crate::destination;
use crate::output::{bad_input, failed};
use rotortwin_blind::command::GenerateArgs;
use rotortwin_blind::error::BlindError;
use rotortwin_blind::example::{self, Example};
use rotortwin_blind::flight::fly;
use rotortwin_blind::log_file;
use rotortwin_blind::truth::Truth;
use rotortwin_twin::log::FlightLog;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What stands in the log's name where nobody gives another.
const NAME: &str = "log";
/// What is hidden, beside the log.
const TRUTH: &str = "truth.json";

/// Arguments of `rotortwin log example`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Vehicle document
    #[arg(long = "model", value_name = "VEHICLE", default_value = "f550", value_parser = crate::named::vehicle())]
    vehicle: PathBuf,
    /// What the log is to show
    #[arg(long, value_enum, conflicts_with = "effect")]
    preset: Option<Example>,
    /// What is hidden: an id, with a size and rotor that the seed draws, or id:parameter=value,…
    #[arg(long)]
    effect: Option<String>,
    /// Seed of every random stream, and of what is drawn
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Length, s
    #[arg(long, default_value_t = 60.0)]
    duration_s: f64,
    /// Folder for log.parquet, log.toml, log.import.json and truth.json
    #[arg(long, value_name = "DIR", default_value = "logs")]
    out: PathBuf,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> ExitCode {
    match make(args) {
        Ok(headline) => {
            println!("{headline}");
            ExitCode::SUCCESS
        }
        Err(Failure::Input(sentence)) => bad_input(sentence),
        Err(Failure::Disk(sentence)) => destination::failed_at(&args.out, sentence),
        Err(Failure::Other(sentence)) => failed(sentence),
    }
}

enum Failure {
    Input(String),
    Disk(String),
    Other(String),
}

impl From<BlindError> for Failure {
    fn from(error: BlindError) -> Self {
        match error {
            BlindError::Input { .. } => Self::Input(error.to_string()),
            _ => Self::Other(error.to_string()),
        }
    }
}

fn make(args: &Args) -> Result<String, Failure> {
    let scratch = tempfile::tempdir().map_err(|error| Failure::Disk(format!("a folder cannot be made: {error}")))?;
    let flown = scratch.path().join("flown.parquet");
    let mut plan = generator(args, &flown).plan()?;
    let rotors = plan.vehicle.rotors.len();
    plan.effects = match (&args.effect, args.preset) {
        (Some(text), _) => example::effect(text, rotors, args.seed)?,
        (None, preset) => preset.unwrap_or(Example::HiddenEffect).effects(rotors, args.seed),
    };
    let (rows, nuisances) = fly(&plan)?;
    log_file::write(&flown, &rows)?;
    let log = FlightLog::read(&flown).map_err(|error| Failure::Other(error.to_string()))?;
    log.store(&args.out, NAME)
        .map_err(|error| Failure::Disk(error.to_string()))?;
    Truth::new(&plan, &nuisances).write(&args.out.join(TRUTH))?;
    Ok(log.headline())
}

/// The generator's own arguments, all but what is hidden.
fn generator(args: &Args, out: &Path) -> GenerateArgs {
    GenerateArgs {
        vehicle: Some(args.vehicle.clone()),
        effects: Vec::new(),
        clutter: false,
        flight: "excitation".to_owned(),
        duration_s: args.duration_s,
        idle_s: None,
        seed: args.seed,
        noise_scale: 1.0,
        disturbance: 1.0,
        state_of_charge: None,
        out: out.to_owned(),
        truth: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum as _;

    #[test]
    fn val_presets_have_the_names_of_the_command_line() {
        for preset in Example::value_variants() {
            let value = preset.to_possible_value().expect("it can be asked for");
            assert_eq!(value.get_name(), preset.name());
        }
    }
}
