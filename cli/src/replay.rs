//! `rotortwin replay`: repeats a recorded run and compares.

use crate::output;
use clap::Parser;
use rotortwin_jobs::Verification;
use rotortwin_runner::verification::{Verified, verify};
use std::path::PathBuf;
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

/// Repeats the recorded scenario in this process; exit code 0 if the run hash is the same, 1 if it differs.
pub fn run(args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    let run = args.run.clone();
    match verify(&Verification { run }) {
        Ok(verified) => report(args, &verified),
        Err(failure) => output::told(&failure),
    }
}

fn report(args: &Args, verified: &Verified) -> ExitCode {
    let Verified { summary, hash } = verified;
    if args.json {
        println!("{}", serde_json::to_string(&verified.verdict()).expect("text is JSON"));
    } else if verified.same() {
        output::say(format!(
            "same: {} steps over {} and again in this process have the run hash {hash}",
            summary.steps, summary.link
        ));
    } else {
        output::say(format!(
            "DIFFERENT\n  recorded {} ({}, over {})",
            summary.run_hash, summary.program_version, summary.link
        ));
        output::say(format!(
            "  replayed {hash} (rotortwin {}, in this process)",
            env!("CARGO_PKG_VERSION")
        ));
        if let Some(note) = verified.note() {
            output::say(format!("  {note}"));
        }
    }
    if verified.same() {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(rotortwin_process::EXIT_FAILED)
    }
}
