//! `rotortwin show` and `rotortwin check`: content of a run folder, or of a scenario.

use crate::output;
use clap::Parser;
use rotortwin_scenario::Scenario;
use rotortwin_store::summary::load_summary;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin show`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Run folder, or its summary.json
    pub run: PathBuf,
    /// Print the summary as JSON
    #[arg(long)]
    pub json: bool,
}

/// Prints the result of a recorded run; exit code 0 even if the run failed: showing it worked.
pub fn run(args: &Args) -> ExitCode {
    match load_summary(&args.run) {
        Ok(summary) if args.json => print!("{}", summary.to_json()),
        Ok(summary) => print!(
            "{}",
            output::summary_text(&summary, args.run.is_dir().then_some(args.run.as_path()))
        ),
        Err(error) => return output::bad_input(error),
    }
    ExitCode::SUCCESS
}

/// Arguments of `rotortwin check`.
#[derive(Debug, Parser)]
pub struct CheckArgs {
    /// Scenario: a file or a name
    #[arg(value_parser = crate::named::scenario())]
    pub scenario: PathBuf,
    /// Set a key of the scenario before it is checked, as for `fly`; may be given several times
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Print the settings in effect as JSON
    #[arg(long)]
    pub json: bool,
}

/// Checks a scenario without flying it.
pub fn check(args: &CheckArgs) -> ExitCode {
    let set: Vec<&str> = args.set.iter().map(String::as_str).collect();
    let checked = Scenario::load_with(&args.scenario, &set)
        .and_then(|scenario| scenario.simulation(scenario.seed()).map(|_| scenario));
    match checked {
        Ok(scenario) if args.json => match serde_json::to_string_pretty(scenario.documents()) {
            Ok(json) => println!("{json}"),
            Err(error) => return output::failed(error),
        },
        Ok(scenario) => {
            for warning in scenario.warnings() {
                output::say_aside(format!("{}: {warning}", args.scenario.display()));
            }
            print!("{}", scenario.documents().to_toml());
        }
        Err(error) => return output::bad_input(error),
    }
    ExitCode::SUCCESS
}
