//! `rotortwin log example`: a log with a hidden effect, from the independent simulator, imported like any other.

use crate::output;
use rotortwin_blind::example::Example;
use rotortwin_runner::log_example;
use rotortwin_scenario::names::{Kind, typed};
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin log example`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Vehicle document
    #[arg(long = "model", value_name = "VEHICLE", default_value = "f550", value_parser = crate::named::vehicle())]
    vehicle: PathBuf,
    /// Purpose of the log
    #[arg(long, value_enum, conflicts_with = "effect")]
    preset: Option<Example>,
    /// Hidden effect: an id, with size and rotor drawn from the seed, or id:parameter=value,…
    #[arg(long)]
    effect: Option<String>,
    /// Seed of all random streams and draws
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Length, s
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    duration_s: f64,
    /// Folder for log.parquet, log.toml, log.import.json and truth.json
    #[arg(long, value_name = "DIR", default_value = "logs")]
    out: PathBuf,
}

impl Args {
    fn job(&self) -> rotortwin_jobs::LogExample {
        rotortwin_jobs::LogExample {
            vehicle: self.vehicle.clone(),
            preset: self.preset,
            effect: self.effect.clone(),
            seed: self.seed,
            duration_s: self.duration_s,
            case: None,
            out: self.out.clone(),
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> ExitCode {
    match log_example::make(&args.job()) {
        Ok(log) => {
            let path = args.out.join(format!("{}.parquet", log_example::NAME));
            let path = path.display();
            let model = typed(Kind::Vehicle, &args.vehicle);
            output::say(format!("{} → {path}", log.headline()));
            output::say(format!("Hidden       {}", args.out.join(log_example::TRUTH).display()));
            output::say(format!("Next         rotortwin diagnose {path} --model {model}"));
            ExitCode::SUCCESS
        }
        Err(failure) => output::told(&failure),
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
