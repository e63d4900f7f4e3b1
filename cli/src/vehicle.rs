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
    /// State how exact a vehicle file is: a diagnosis takes no smaller error of a constant for missing physics
    Tolerances(Stated),
}

#[derive(Debug, Parser)]
struct Stated {
    /// Vehicle document; NAME.intervals.toml beside it is written and must not exist
    #[arg(value_name = "NAME.toml")]
    vehicle: PathBuf,
    /// ± of a constant at 95 %: mass=1% inertia=5% thrust=2% torque-ratio=5% arms=0.5% lag=10% capacity=5% resistance=20% (all=2%: these
    /// eight), rotors=3% (one rotor beside the others), centre-of-mass=4mm
    #[arg(required = true, value_name = "CONSTANT=SIZE", value_parser = tolerance)]
    tolerances: Vec<(String, f64)>,
}

/// Largest tolerance that can be stated, %; a constant that is known worse is unknown.
const MOST_PERCENT: f64 = 90.0;

/// What is stated in per cent.
const SHARES: [&str; 10] = [
    "mass",
    "inertia",
    "thrust",
    "torque-ratio",
    "arms",
    "lag",
    "capacity",
    "resistance",
    "all",
    "rotors",
];

/// `mass=1%` as (`mass`, 0.01), `centre-of-mass=4mm` as (`centre-of-mass`, 0.004).
fn tolerance(text: &str) -> Result<(String, f64), String> {
    let (name, size) = text.split_once('=').ok_or("expected CONSTANT=SIZE, such as mass=1%")?;
    let (unit, factor, most) = match name {
        "centre-of-mass" => ("mm", 1e-3, f64::INFINITY),
        share if SHARES.contains(&share) => ("%", 1e-2, MOST_PERCENT),
        _ => return Err(format!("expected {} or centre-of-mass", SHARES.join(", "))),
    };
    let number = size
        .strip_suffix(unit)
        .and_then(|number| number.trim().parse::<f64>().ok());
    match number.filter(|number| number.is_finite() && *number > 0.0 && *number <= most) {
        Some(number) => Ok((name.to_owned(), factor * number)),
        None if unit == "mm" => Err("expected millimetres above 0, such as 4mm".to_owned()),
        None => Err(format!(
            "expected per cent above 0 and up to {MOST_PERCENT}, such as 2%"
        )),
    }
}

impl Stated {
    fn tolerances(&self) -> Tolerances {
        let of = |wanted: &str| {
            self.tolerances
                .iter()
                .rev()
                .find(|(name, _)| name == wanted)
                .map(|(_, size)| *size)
        };
        let of_all = |wanted| of(wanted).or_else(|| of("all"));
        Tolerances {
            mass: of_all("mass"),
            inertia: of_all("inertia"),
            thrust: of_all("thrust"),
            torque_ratio: of_all("torque-ratio"),
            arms: of_all("arms"),
            lag: of_all("lag"),
            capacity: of_all("capacity"),
            resistance: of_all("resistance"),
            rotors: of("rotors"),
            centre_of_mass_m: of("centre-of-mass"),
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
