//! `rotortwin vibration`: vibration of a flight at the speed of each rotor, and which rotor vibrates more than before.

use crate::output::{bad_input, fitted};
use clap::Parser;
use rotortwin_runner::grid::Grid;
use rotortwin_twin::identify::read_for;
use rotortwin_twin::log::{FlightLog, ReadOptions};
use rotortwin_twin::model::{ModelStore, ModelVersion};
use rotortwin_twin::predict::PredictError;
use rotortwin_twin::vibration::{Change, Line, Vibration, change, vibration};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin vibration`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Flight logs of one vehicle, of any source; LOG@35:65 takes only these seconds
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Model that gives rotor speeds from duty and voltage; needed for single rotors if the log holds no rotor speeds from the ESCs
    #[arg(long, value_name = "MODEL")]
    model: Option<String>,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    models: PathBuf,
    /// At least three healthy flights of the same vehicle, to find rotors that vibrate more than in these
    #[arg(long, num_args = 1.., value_name = "LOG")]
    baseline: Vec<PathBuf>,
    /// Print the result as JSON, nothing else
    #[arg(long)]
    json: bool,
}

/// Result of the command.
#[derive(Debug, Serialize)]
struct Found {
    flights: Vec<Vibration>,
    #[serde(skip_serializing_if = "Option::is_none")]
    change: Option<Change>,
    /// Why the vehicle is taken as a whole although a model was named.
    #[serde(skip_serializing_if = "Option::is_none")]
    not_by_rotor: Option<String>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> ExitCode {
    match find(args) {
        Ok(found) if args.json => {
            println!(
                "{}",
                serde_json::to_string_pretty(&found).expect("text and numbers are JSON")
            );
            ExitCode::SUCCESS
        }
        Ok(found) => {
            println!("{}", fitted(&text(&found)));
            ExitCode::SUCCESS
        }
        Err(sentence) => bad_input(sentence),
    }
}

fn find(args: &Args) -> Result<Found, String> {
    let model = match &args.model {
        Some(name) => Some(
            ModelStore::new(&args.models)
                .find(name)
                .map_err(|e| e.to_string())?
                .version,
        ),
        None => None,
    };
    let read = |paths: &[PathBuf]| {
        paths
            .iter()
            .map(|path| log(path, model.as_ref()))
            .collect::<Result<Vec<_>, _>>()
    };
    let (logs, healthy) = (read(&args.logs)?, read(&args.baseline)?);
    match (of(&logs, &healthy, model.as_ref()), &model) {
        // Most logs are too slow for the speeds of rotors, but show how the vehicle vibrates as a whole.
        (Err(by_rotor), Some(_)) => of(&logs, &healthy, None)
            .map(|found| Found {
                not_by_rotor: Some(by_rotor.to_string()),
                ..found
            })
            .map_err(|as_a_whole| format!("{by_rotor}; {as_a_whole}")),
        (found, _) => found.map_err(|error| error.to_string()),
    }
}

fn of(logs: &[FlightLog], healthy: &[FlightLog], model: Option<&ModelVersion>) -> Result<Found, PredictError> {
    let change = match healthy {
        [] => None,
        _ => Some(change(logs, healthy, model)?),
    };
    let flights = match &change {
        Some(change) => change.flights.clone(),
        None => logs.iter().map(|log| vibration(log, model)).collect::<Result<_, _>>()?,
    };
    Ok(Found {
        flights,
        change,
        not_by_rotor: None,
    })
}

/// With the rotors in the order of the vehicle, if given.
fn log(path: &Path, model: Option<&ModelVersion>) -> Result<FlightLog, String> {
    match model {
        Some(model) => read_for(path, &ReadOptions::default(), &model.vehicle).map_err(|e| e.to_string()),
        None => FlightLog::read_part(path).map_err(|e| e.to_string()),
    }
}

fn text(found: &Found) -> String {
    let mut text = found
        .change
        .as_ref()
        .map_or_else(String::new, |change| format!("{}\n\n", change.sentence));
    for flight in &found.flights {
        if let Some([low, high]) = flight.band_hz {
            text += &format!(
                "{}: {} at {:.0} Hz, no rotor speeds: all vibration from {low:.0} to {high:.0} Hz {:.3} {}, strongest at {:.0} Hz\n\n",
                flight.log,
                flight.sensor.name(),
                flight.rate_hz,
                flight.amplitude,
                flight.sensor.unit(),
                flight.reference_hz
            );
            continue;
        }
        text += &format!(
            "{}: {} at {:.0} Hz, rotor speeds from {}; all rotors together {:.3} {} at {:.1} Hz\n",
            flight.log,
            flight.sensor.name(),
            flight.rate_hz,
            flight.speeds_from,
            flight.amplitude,
            flight.sensor.unit(),
            flight.reference_hz
        );
        text += &format!("{}\n", table(flight, found.change.as_ref()));
        if let Some(one) = &flight.strongest {
            text += &if one.told_apart {
                format!("The strongest line is that of rotor {}.\n", one.rotor)
            } else {
                "This flight does not show which rotor has the strongest line: the rotor speeds are too similar.\n"
                    .to_owned()
            };
        }
        text.push('\n');
    }
    if let Some(reason) = &found.not_by_rotor {
        text += &format!("{reason}; so the vehicle is taken as a whole.\n");
    } else if found.flights.iter().any(|flight| flight.band_hz.is_some()) {
        text += "Single rotors need rotor speeds from the ESCs in the log, or --model to get them from duty and voltage. Heavier or faster \
                 flights may vibrate more without any damage.\n";
    }
    if found.change.is_none() {
        text += "New propellers differ as well: --baseline with healthy flights shows which line has grown.\n";
    }
    text
}

fn table(flight: &Vibration, change: Option<&Change>) -> Grid {
    let mut header = vec![
        "rotor".to_owned(),
        "mean speed, Hz".to_owned(),
        format!("amplitude, {}", flight.sensor.unit()),
    ];
    let grown = change.filter(|change| !change.rotors.is_empty());
    if grown.is_some() {
        header.push("over healthy flights".to_owned());
        header.push("probability".to_owned());
    }
    let mut table = Grid::new(header).numbers([0, 1]);
    for one in &flight.rotors {
        let mut cells = vec![one.rotor.to_string(), format!("{:.1}", one.speed_hz), amplitude(one)];
        if let Some(change) = grown {
            let growth = change.rotors.iter().find(|growth| growth.rotor == Some(one.rotor));
            cells.push(growth.map_or_else(
                || "–".to_owned(),
                |g| format!("{:.1} [{:.1}, {:.1}]", g.factor, g.interval_95[0], g.interval_95[1]),
            ));
            cells.push(growth.map_or_else(|| "–".to_owned(), |g| format!("{:.1} %", 100.0 * g.posterior)));
        }
        table.add_row(cells);
    }
    table
}

fn amplitude(line: &Line) -> String {
    match (line.amplitude, line.interval_95) {
        (Some(_), Some([_, high])) if !line.seen => format!("below {high:.3}"),
        (Some(amplitude), Some([low, high])) => format!("{amplitude:.3} [{low:.3}, {high:.3}]"),
        _ => "not separable".to_owned(),
    }
}
