//! `rotortwin vehicle from-log`: a user's own vehicle from flight logs, mass and arm.

use crate::output;
use clap::{Parser, Subcommand};
use rotortwin_runner::identification::identify;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin vehicle`.
#[derive(Debug, Parser)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Identify a vehicle from flight logs, its mass and its arm length, which no log contains
    FromLog(FromLog),
}

#[derive(Debug, Parser)]
struct FromLog {
    /// Flight logs of one vehicle; LOG@FROM:TO takes a part, in seconds of the log
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Mass including battery, kg
    #[arg(long, value_name = "KG", allow_negative_numbers = true)]
    mass: f64,
    /// Distance from the centre of the vehicle to the farthest rotor, m
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    arm: f64,
    /// Frame, if the log does not state it, such as quad-x (numbers as in ArduPilot)
    #[arg(long)]
    frame: Option<String>,
    /// Use the stated frame even if the motion contradicts it
    #[arg(long)]
    trust_frame: bool,
    /// Thrust bench of one rotor, or a datasheet table: command, thrust, and optionally voltage, current, torque, power; may be given
    /// several times
    #[arg(long, value_name = "FILE")]
    bench: Vec<PathBuf>,
    /// Capacity of the battery, Ah
    #[arg(long, value_name = "AH")]
    capacity: Option<f64>,
    /// Cells in series
    #[arg(long)]
    cells: Option<u32>,
    /// Write NAME.toml, NAME.blades.toml, NAME.intervals.toml and NAME.report.html; must not exist
    #[arg(long, value_name = "NAME.toml")]
    out: Option<PathBuf>,
    /// Fit each half of each flight and score it on the other: R², and that of the class default
    #[arg(long = "halves", visible_alias = "held-out")]
    held_out: bool,
    /// Print JSON, nothing else
    #[arg(long)]
    json: bool,
}

impl FromLog {
    fn job(&self) -> rotortwin_jobs::Identification {
        rotortwin_jobs::Identification {
            logs: self.logs.clone(),
            mass_kg: self.mass,
            arm_m: self.arm,
            frame: self.frame.clone(),
            trust_frame: self.trust_frame,
            capacity_ah: self.capacity,
            cells: self.cells,
            held_out: self.held_out,
            bench: self.bench.clone(),
            out: self.out.clone(),
        }
    }
}

/// Identifies, writes and prints; exit code 2 for bad input, 1 if the result cannot be written.
pub(crate) fn run(args: &Args) -> ExitCode {
    let What::FromLog(args) = &args.what;
    let found = match identify(&args.job()) {
        Ok(found) => found,
        Err(failure) => return output::told(&failure),
    };
    if args.json {
        println!("{:#}", found.json());
    } else {
        print!("{}", output::fitted(&found.text()));
    }
    ExitCode::SUCCESS
}
