//! `rotortwin replay`: fly a recorded run again and compare.

use crate::output;
use clap::Parser;
use rotortwin_flight::lockstep::{self, FlightEnd, NoObserver};
use rotortwin_flight::pace::Pace;
use rotortwin_plant::Simulation;
use rotortwin_scenario::{ConfigError, Documents, Scenario};
use rotortwin_sim::session;
use rotortwin_store::summary::{Status, Summary, load_summary};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin replay`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Run folder, or its summary.json
    pub run: PathBuf,
    /// Print the comparison as JSON
    #[arg(long)]
    pub json: bool,
}

/// Executes the recorded scenario again, in this process; exit code 0 if the run hash is the same, 1 if it differs.
pub fn run(args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    let summary = match load_summary(&args.run) {
        Ok(summary) => summary,
        Err(error) => return output::bad_input(error),
    };
    if summary.status != Status::Done {
        return output::bad_input(format!(
            "{} is a run that was {}; only a run that was done can be flown again and compared",
            args.run.display(),
            summary.status.as_str()
        ));
    }
    let (scenario, simulation) = match prepare(args, &summary) {
        Ok(prepared) => prepared,
        Err(error) => return output::bad_input(error),
    };
    let replayed = if session::was_flown_by_autopilot(&summary) {
        let folder = if args.run.is_dir() {
            Some(args.run.as_path())
        } else {
            args.run.parent()
        };
        let folder = folder.unwrap_or(Path::new(""));
        session::replay_autopilot(&scenario, simulation, summary.seed, folder)
    } else {
        replay(&scenario, simulation)
    };
    match replayed {
        Ok(hash) => report(args, &summary, &hash),
        Err(sentence) => output::failed(sentence),
    }
}

fn prepare(args: &Args, summary: &Summary) -> Result<(Scenario, Simulation), ConfigError> {
    let name = format!("{}, the recorded scenario", args.run.display());
    let scenario = Scenario::from_documents(&Documents::from_toml(&name, &summary.scenario.text)?)?;
    let simulation = scenario.simulation(summary.seed)?;
    Ok((scenario, simulation))
}

fn replay(scenario: &Scenario, mut simulation: Simulation) -> Result<String, String> {
    let setup = session::run_setup(scenario, &simulation, 1);
    let mut link = session::in_process_link();
    let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut NoObserver);
    match outcome.end {
        FlightEnd::Done => Ok(outcome.run_hash),
        FlightEnd::Canceled => Err("the replay was canceled".to_owned()),
        FlightEnd::Failed(failure) => Err(failure.sentence),
    }
}

fn report(args: &Args, summary: &Summary, hash: &str) -> ExitCode {
    let same = hash == summary.run_hash;
    if args.json {
        println!(
            "{}",
            serde_json::json!({ "same": same, "recorded": summary.run_hash, "replayed": hash })
        );
    } else if same {
        println!(
            "same: {} steps over {} and again in this process have the run hash {hash}",
            summary.steps, summary.link
        );
    } else {
        println!(
            "DIFFERENT\n  recorded {} ({}, over {})",
            summary.run_hash, summary.program_version, summary.link
        );
        println!(
            "  replayed {hash} (rotortwin {}, in this process)",
            env!("CARGO_PKG_VERSION")
        );
    }
    if same {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(rotortwin_process::EXIT_FAILED)
    }
}
