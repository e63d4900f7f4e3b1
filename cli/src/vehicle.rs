//! `rotortwin vehicle`: a user's own vehicle from flight logs, mass and arm, and how exact a vehicle file is.

use crate::output;
use clap::{Parser, Subcommand};
use rotortwin_runner::identification::identify;
use rotortwin_runner::tolerances::write_tolerances;
use rotortwin_twin::model::tolerances::Tolerances;
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
    /// State how exact a vehicle file is, in per cent of each constant (95 %): a diagnosis takes no smaller error for missing physics
    Tolerances(Stated),
}

#[derive(Debug, Parser)]
struct Stated {
    /// Vehicle document; NAME.intervals.toml beside it is written and must not exist
    #[arg(value_name = "NAME.toml")]
    vehicle: PathBuf,
    /// All but rotors and centre of mass, ± %, unless given by themselves
    #[arg(long, value_name = "PERCENT", value_parser = share, allow_negative_numbers = true)]
    all: Option<f64>,
    /// Mass, ± %
    #[arg(long, value_name = "PERCENT", value_parser = share, allow_negative_numbers = true)]
    mass: Option<f64>,
    /// Each moment of inertia, ± %
    #[arg(long, value_name = "PERCENT", value_parser = share, allow_negative_numbers = true)]
    inertia: Option<f64>,
    /// Thrust of all rotors, ± %
    #[arg(long, value_name = "PERCENT", value_parser = share, allow_negative_numbers = true)]
    thrust: Option<f64>,
    /// Thrust of one rotor beside the others', ± %
    #[arg(long, value_name = "PERCENT", value_parser = share, allow_negative_numbers = true)]
    rotors: Option<f64>,
    /// Torque over thrust of a rotor, ± %
    #[arg(long, value_name = "PERCENT", value_parser = share, allow_negative_numbers = true)]
    torque_ratio: Option<f64>,
    /// Length of the arms, ± %
    #[arg(long, value_name = "PERCENT", value_parser = share, allow_negative_numbers = true)]
    arms: Option<f64>,
    /// Lag of the thrust, ± %
    #[arg(long, value_name = "PERCENT", value_parser = share, allow_negative_numbers = true)]
    lag: Option<f64>,
    /// Capacity of the battery, ± %
    #[arg(long, value_name = "PERCENT", value_parser = share, allow_negative_numbers = true)]
    capacity: Option<f64>,
    /// Internal resistance of the battery, ± %
    #[arg(long, value_name = "PERCENT", value_parser = share, allow_negative_numbers = true)]
    resistance: Option<f64>,
    /// Centre of mass, forward and to the right, ± mm
    #[arg(long, value_name = "MM", value_parser = metres, allow_negative_numbers = true)]
    centre_of_mass: Option<f64>,
}

/// Largest tolerance that can be stated, %; a constant that is known worse is unknown.
const MOST_PERCENT: f64 = 90.0;

/// A share from per cent.
fn share(text: &str) -> Result<f64, String> {
    let percent: f64 = text.trim_end_matches('%').trim().parse().unwrap_or(f64::NAN);
    if percent > 0.0 && percent <= MOST_PERCENT {
        return Ok(0.01 * percent);
    }
    Err(format!("expected per cent above 0 and up to {MOST_PERCENT}"))
}

/// Metres from millimetres.
fn metres(text: &str) -> Result<f64, String> {
    let millimetres: f64 = text.trim_end_matches("mm").trim().parse().unwrap_or(f64::NAN);
    if millimetres > 0.0 && millimetres.is_finite() {
        return Ok(1e-3 * millimetres);
    }
    Err("expected millimetres above 0".to_owned())
}

impl Stated {
    fn tolerances(&self) -> Tolerances {
        Tolerances {
            mass: self.mass.or(self.all),
            inertia: self.inertia.or(self.all),
            thrust: self.thrust.or(self.all),
            rotors: self.rotors,
            torque_ratio: self.torque_ratio.or(self.all),
            arms: self.arms.or(self.all),
            lag: self.lag.or(self.all),
            capacity: self.capacity.or(self.all),
            resistance: self.resistance.or(self.all),
            centre_of_mass_m: self.centre_of_mass,
        }
    }
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

/// Exit code 2 for bad input, 1 if the result cannot be written.
pub(crate) fn run(args: &Args) -> ExitCode {
    match &args.what {
        What::FromLog(args) => from_log(args),
        What::Tolerances(args) => match write_tolerances(&args.vehicle, &args.tolerances()) {
            Ok(told) => {
                print!("{}", output::fitted(&told));
                ExitCode::SUCCESS
            }
            Err(failure) => output::told(&failure),
        },
    }
}

/// Identifies, writes and prints.
fn from_log(args: &FromLog) -> ExitCode {
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
