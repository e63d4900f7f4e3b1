//! The generator's command line, shared by the program `rotortwin-blind` and by `rotortwin blind generate`.

use crate::catalogue::KINDS;
use crate::draw::draw_clutter;
use crate::error::{BlindError, Result};
use crate::flight::{FlightPlan, fly};
use crate::hidden::Hidden;
use crate::log_file;
use crate::random::Stream;
use crate::script::{FLIGHTS, Script};
use crate::truth::Truth;
use crate::vehicle::Vehicle;
use clap::{Parser, Subcommand};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Shortest and longest flight, s.
pub const DURATION_S: [f64; 2] = [1.0, 3600.0];

/// Independent simulator that writes flight logs with hidden effects.
#[derive(Debug, Parser)]
#[command(name = "rotortwin-blind", version, max_term_width = 120)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What the generator can do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Fly once and write the log, and the truth in a separate file
    Generate(GenerateArgs),
    /// List what can be hidden: ids, parameters, typical sizes
    Effects {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
}

/// Arguments of `generate`.
#[derive(Debug, Clone, Parser)]
pub struct GenerateArgs {
    /// Vehicle document [default: the f550 of config/vehicles]
    #[arg(long = "model", alias = "vehicle", value_name = "VEHICLE")]
    pub vehicle: Option<PathBuf>,
    /// Hidden effect, `id:parameter=value,…`, also `rotor=` and `onset_s=`; repeat for several
    #[arg(long = "effect", value_name = "EFFECT")]
    pub effects: Vec<String>,
    /// Small deviations (2 % of the typical size, normal) of every other parameter
    #[arg(long)]
    pub clutter: bool,
    /// hover, helix, waypoint, excitation, or a script file (.toml)
    #[arg(long, value_name = "NAME", default_value = "excitation")]
    pub flight: String,
    /// Length, s
    #[arg(long, value_name = "S", default_value_t = 90.0)]
    pub duration_s: f64,
    /// Time on the ground with idling rotors at the start, s, before take-off into the flight
    #[arg(long, value_name = "S")]
    pub idle_s: Option<f64>,
    /// Seed of all random streams
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Factor on the sensor noise of Table 4
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub noise_scale: f64,
    /// White force and torque that represent everything unmodelled, times 0.05 N and 5 mN·m; 0: only sensor noise moves
    /// the duties of a hover
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub disturbance: f64,
    /// Charge at the start, 0 to 1 [default: drawn from 0.5 to 1]
    #[arg(long, value_name = "FRACTION")]
    pub state_of_charge: Option<f64>,
    /// Log file to write (.parquet)
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Truth file to write (.json) [default: none]
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
}

impl GenerateArgs {
    /// The plan that the arguments describe.
    pub fn plan(&self) -> Result<FlightPlan> {
        let vehicle = Vehicle::load(
            self.vehicle
                .as_deref()
                .unwrap_or(Path::new("config/vehicles/f550.toml")),
        )?;
        let effects = self
            .effects
            .iter()
            .map(|text| Hidden::parse(text))
            .collect::<Result<Vec<_>>>()?;
        let range = |name: &str, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(BlindError::input(
                    name,
                    format!("expected {low} to {high}, got {value}"),
                ))
            }
        };
        range("--duration-s", self.duration_s, DURATION_S[0], DURATION_S[1])?;
        range("--noise-scale", self.noise_scale, 0.0, 100.0)?;
        range("--disturbance", self.disturbance, 0.0, 100.0)?;
        range("--idle-s", self.idle_s.unwrap_or(0.0), 0.0, self.duration_s)?;
        range("--state-of-charge", self.state_of_charge.unwrap_or(0.5), 0.05, 1.0)?;
        let script = match Script::built_in(&self.flight, self.seed) {
            Some(script) => script,
            None if self.flight.ends_with(".toml") => Script::load(self.flight.as_ref())?,
            None => {
                let reason = format!(
                    "expected one of {} or a script file ending in .toml, got `{}`",
                    FLIGHTS.join(", "),
                    self.flight
                );
                return Err(BlindError::input("--flight", reason));
            }
        };
        let script = if self.idle_s.is_some() {
            script.from_the_ground()
        } else {
            script
        };
        let clutter = if self.clutter {
            draw_clutter(&effects, vehicle.rotors.len(), &mut Stream::new(self.seed, "clutter"))
        } else {
            Vec::new()
        };
        Ok(FlightPlan {
            vehicle,
            script,
            duration: self.duration_s,
            seed: self.seed,
            effects,
            clutter,
            noise_scale: self.noise_scale,
            disturbance: self.disturbance,
            state_of_charge: self.state_of_charge,
            idle_s: self.idle_s,
        })
    }
}

/// Flies and writes what the arguments ask for.
pub fn generate(args: &GenerateArgs) -> Result<()> {
    let plan = args.plan()?;
    // Looked at before the flight: what was flown would be lost.
    [Some(&args.out), args.truth.as_ref()]
        .into_iter()
        .flatten()
        .try_for_each(|path| writable(path))?;
    let (rows, nuisances) = fly(&plan)?;
    log_file::write(&args.out, &rows)?;
    if let Some(path) = &args.truth {
        Truth::new(&plan, &nuisances).write(path)?;
    }
    Ok(())
}

/// Tries whether a file can be written, and leaves everything as it was.
fn writable(path: &Path) -> Result<()> {
    let existed = path.exists();
    std::fs::File::options()
        .append(true)
        .create(true)
        .open(path)
        .and_then(|_| if existed { Ok(()) } else { std::fs::remove_file(path) })
        .map_err(|error| BlindError::input(path.display().to_string(), format!("cannot be written: {error}")))
}

fn list(json: bool) -> String {
    let mut text = String::new();
    if json {
        let kinds: Vec<_> = KINDS
            .iter()
            .map(|kind| {
                let parameters: Vec<_> = kind
                    .parameters
                    .iter()
                    .map(|p| serde_json::json!({ "name": p.name, "unit": p.unit, "typical": p.typical }))
                    .collect();
                serde_json::json!({
                    "id": kind.id, "number": kind.number, "title": kind.title, "place": format!("{:?}", kind.place).to_lowercase(),
                    "per_rotor": kind.per_rotor, "companion": kind.companion, "parameters": parameters,
                })
            })
            .collect();
        text = format!("{:#}\n", serde_json::Value::Array(kinds));
    } else {
        for kind in KINDS {
            let rotor = if kind.per_rotor { "rotor=1," } else { "" };
            let parameters: Vec<String> = kind
                .parameters
                .iter()
                .map(|p| format!("{}={}", p.name, p.typical))
                .collect();
            text += &format!(
                "{:2}  {}:{rotor}{}\n    {}\n",
                kind.number,
                kind.id,
                parameters.join(","),
                kind.title
            );
        }
    }
    text
}

/// Runs the generator: exit code 0 done, 1 the flight was lost or a file not written, 2 bad input.
pub fn run(command: &Command) -> ExitCode {
    match command {
        Command::Effects { json } => {
            // A reader who has closed the pipe has seen enough.
            std::io::stdout().write_all(list(*json).as_bytes()).ok();
            ExitCode::SUCCESS
        }
        Command::Generate(args) => match generate(args) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                writeln!(std::io::stderr(), "{error}").ok();
                ExitCode::from(if matches!(error, BlindError::Input { .. }) {
                    2
                } else {
                    1
                })
            }
        },
    }
}
