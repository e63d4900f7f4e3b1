//! `rotortwin fleet`: the flights of one vehicle over time, and which propeller to inspect.

use crate::fdi_service::DetectorArgs;
use crate::output::{bad_input, failed, fitted, line};
use rotortwin_page::Report;
use rotortwin_runner::grid::Grid;
use rotortwin_twin::identify::read_for;
use rotortwin_twin::log::{ReadOptions, RotorOrder};
use rotortwin_twin::model::ModelStore;
use rotortwin_verdicts::fleet::journal::{self, Added, Event, Fleet, MaintenanceEntry};
use rotortwin_verdicts::fleet::measure;
use rotortwin_verdicts::fleet::trend::{LEAST_BEFORE, LEAST_FLIGHTS, LEAST_LOSS};
use rotortwin_verdicts::fleet::view::{FleetView, RotorView, Share, Status, view};
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin fleet`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder with a file for each vehicle
    #[arg(long, value_name = "DIR", default_value = "fleet", global = true)]
    fleet: PathBuf,
    #[command(subcommand)]
    action: Action,
}

/// What is asked for.
#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Judge flight logs of a vehicle and add them to its file; a log that is already in it is not counted again
    Add(Box<AddArgs>),
    /// Show each rotor over the flights: bias, loss, what to inspect; without a name all vehicles
    Show(ShowArgs),
    /// Acknowledge that rotors have been inspected: earlier findings need no further inspection
    Acknowledge(MaintainArgs),
    /// Record that propellers were replaced: the history of these rotors restarts; nothing is deleted
    Reset(MaintainArgs),
}

#[derive(Debug, clap::Args)]
struct AddArgs {
    /// Name of the vehicle
    #[arg(value_name = "VEHICLE", value_parser = journal::vehicle_name)]
    vehicle: String,
    /// Flight logs of any source, or run folders, in the order in which they were flown; LOG@35:65 takes only these seconds
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    #[command(flatten)]
    detectors: DetectorArgs,
    /// When the flight was, UTC, such as 2026-01-31 or 2026-01-31T14:05:00Z; of one log. It overrides the date in the log; without either,
    /// flights are in the order of entry
    #[arg(long, value_name = "DATE", value_parser = journal::date)]
    date: Option<String>,
}

#[derive(Debug, clap::Args)]
struct ShowArgs {
    /// Name of the vehicle
    #[arg(value_name = "VEHICLE", value_parser = journal::vehicle_name)]
    vehicle: Option<String>,
    /// Print everything as JSON; a list for all vehicles
    #[arg(long)]
    json: bool,
    /// Write a self-contained page into this file
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
struct MaintainArgs {
    /// Name of the vehicle
    #[arg(value_name = "VEHICLE", value_parser = journal::vehicle_name)]
    vehicle: String,
    /// Rotors, from 1; several with commas
    #[arg(long, value_name = "N", required = true, value_delimiter = ',')]
    rotor: Vec<usize>,
    /// Who did it
    #[arg(long, value_name = "NAME")]
    by: String,
    /// What was found or done
    #[arg(long, value_name = "TEXT", default_value = "")]
    note: String,
    /// Date, UTC [default: now]
    #[arg(long, value_name = "DATE", value_parser = journal::date)]
    date: Option<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> ExitCode {
    let fleet = Fleet::new(&args.fleet);
    match &args.action {
        Action::Add(add) => done(add_flights(&fleet, add)),
        Action::Show(show) => show_vehicles(&fleet, show),
        Action::Acknowledge(what) => done(maintain(&fleet, what, Event::Acknowledge)),
        Action::Reset(what) => done(maintain(&fleet, what, Event::Reset)),
    }
}

fn done(result: Result<(), String>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(sentence) => bad_input(sentence),
    }
}

fn add_flights(fleet: &Fleet, args: &AddArgs) -> Result<(), String> {
    if args.date.is_some() && args.logs.len() > 1 {
        return Err(format!(
            "--date: expected one log, because it is the date of one flight, got {}",
            args.logs.len()
        ));
    }
    let model = args.detectors.model();
    let found = ModelStore::new(args.detectors.models()).find(model);
    let version = found.map_err(|error| error.to_string())?.version;
    let (detectors, note) = args.detectors.detectors()?;
    if let Some(note) = note {
        line(&fitted(&format!("Note: {note}")));
    }
    for path in &args.logs {
        let log = read_for(path, &ReadOptions::default(), &version.vehicle)?;
        if let RotorOrder::Vehicle(note) = &log.report.rotor_order {
            line(&fitted(&format!("Note: {note}")));
        }
        let known = |place: usize| {
            line(&fitted(&format!(
                "{}: already counted as flight {} of {}",
                path.display(),
                place + 1,
                args.vehicle
            )));
        };
        let hash = &log.source.content_hash;
        if let Some(place) = fleet.place_of(&args.vehicle, (model, &version.hash()), hash)? {
            known(place);
            continue;
        }
        let stated = args.date.clone().map(|date| (date, "as stated with --date"));
        let flown = stated.or_else(|| Some((journal::date_of(&log)?, log.report.flown.as_ref()?.from.as_str())));
        let date = flown.as_ref().map(|(date, _)| date.clone());
        let when = match &flown {
            Some((date, from)) => format!("flown {date} ({from})"),
            None => "the date of the flight is unknown: the log holds none; --date gives one".to_owned(),
        };
        let (vehicle, flight) = measure(&args.vehicle, (model, &version), &log, &detectors, date)?;
        let seconds = flight.air_s;
        match fleet.add(&vehicle, flight)? {
            Added::New => line(&fitted(&format!(
                "{}: {seconds:.0} s in the air, {when}",
                path.display()
            ))),
            // Another process was faster.
            Added::Known(place) => known(place),
        }
    }
    let seen = view(&fleet.read(&args.vehicle)?);
    line("");
    line(&fitted(&text_of(&seen)));
    Ok(())
}

fn maintain(fleet: &Fleet, args: &MaintainArgs, event: fn(MaintenanceEntry) -> Event) -> Result<(), String> {
    if args.by.trim().is_empty() {
        return Err("--by: expected a name, got nothing".to_owned());
    }
    let date = args.date.clone().unwrap_or_else(journal::now);
    let entry = |rotor: &usize| {
        event(MaintenanceEntry {
            rotor: *rotor,
            by: args.by.clone(),
            date: date.clone(),
            note: args.note.clone(),
        })
    };
    let events: Vec<Event> = args.rotor.iter().map(entry).collect();
    fleet.maintain(&args.vehicle, &events)?;
    line(&fitted(&text_of(&view(&fleet.read(&args.vehicle)?))));
    Ok(())
}

fn show_vehicles(fleet: &Fleet, args: &ShowArgs) -> ExitCode {
    let names = match &args.vehicle {
        Some(name) => Ok(vec![name.clone()]),
        None => fleet.vehicles(),
    };
    let views = names.and_then(|names| {
        names
            .iter()
            .map(|name| fleet.read(name).map(|history| view(&history)))
            .collect::<Result<Vec<FleetView>, String>>()
    });
    let views = match views {
        Ok(views) => views,
        Err(sentence) => return bad_input(sentence),
    };
    if let Some(path) = &args.report
        && let Err(error) = std::fs::write(path, page_of(&views))
    {
        return failed(format!("{}: cannot be written: {error}", path.display()));
    }
    if args.json {
        let text = match (&args.vehicle, views.as_slice()) {
            (Some(_), [one]) => serde_json::to_string_pretty(one),
            _ => serde_json::to_string_pretty(&views),
        };
        line(&text.expect("text and finite numbers are JSON"));
    } else if args.vehicle.is_some() {
        views.iter().for_each(|one| line(&fitted(&text_of(one))));
    } else {
        line(&overview(&views).to_string());
    }
    ExitCode::SUCCESS
}

fn page_of(views: &[FleetView]) -> String {
    let names: Vec<&str> = views.iter().map(|one| one.vehicle.as_str()).collect();
    let summary: Vec<String> = views.iter().map(text_of).collect();
    let page = Report {
        kind: "fleet",
        title: &format!("Fleet · {}", names.join(", ")),
        summary: &summary.join("\n\n"),
        program: rotortwin_twin::model::TOOL,
        data: &views,
    };
    page.render().expect("text and numbers are JSON")
}

/// One line per vehicle.
fn overview(views: &[FleetView]) -> Grid {
    let mut table = Grid::new(["vehicle", "flights", "last", "inspect", "acknowledged"]).numbers([1]);
    for one in views {
        let of = |status: Status| -> String {
            let rotors = one.rotors.iter().filter(|rotor| rotor.status == status);
            let numbers: Vec<String> = rotors.map(|rotor| rotor.rotor.to_string()).collect();
            if numbers.is_empty() {
                "–".to_owned()
            } else {
                format!("rotor {}", numbers.join(", "))
            }
        };
        let last = one.flights.last();
        table.add_row([
            one.vehicle.clone(),
            one.flights.len().to_string(),
            last.and_then(|flight| flight.date.clone())
                .unwrap_or_else(|| "–".to_owned()),
            of(Status::Inspect),
            of(Status::Acknowledged),
        ]);
    }
    table
}

fn percent(share: &Share) -> String {
    format!(
        "{:+.1} % [{:+.1}, {:+.1}]",
        100.0 * share.share,
        100.0 * share.low,
        100.0 * share.high
    )
}

/// One vehicle.
fn text_of(one: &FleetView) -> String {
    let order = if one.by_date {
        "by date"
    } else {
        "in the order of entry, because not every flight has a date"
    };
    let mut text = format!(
        "Vehicle      {}, compared with {}\nFlights      {}, {order}\n",
        one.vehicle,
        one.model,
        one.flights.len()
    );
    text += &match one.spread {
        Some(spread) => format!(
            "Spread       {:.2} % of a rotor's thrust between flights, 1 σ\n",
            100.0 * spread
        ),
        None => "Spread       unknown: two flights are needed\n".to_owned(),
    };
    if let Some(share) = &one.common_per_flight {
        text += &format!(
            "All rotors   need {} more thrust command from flight to flight: battery, air, mass, or all propellers together\n",
            percent(share)
        );
    }
    text += &format!("\n{}\n\n{}\n", rotor_table(one), flight_table(one));
    text += "\nBias: commanded thrust of a rotor over the model's, apart from what all rotors have in common. Loss: over the flights since its propeller was replaced; ";
    text += &format!(
        "named from {} flights on ({} for a trend), where it is {:.0} % or more and beyond the spread between flights. Brackets: 95 %.\n",
        LEAST_BEFORE + 1,
        LEAST_FLIGHTS,
        100.0 * LEAST_LOSS
    );
    let reasons: Vec<String> = one.rotors.iter().filter_map(reason_of).collect();
    if reasons.is_empty() {
        text += "\nNo rotor deviates significantly.\n";
    } else {
        text += &format!("\n{}\n", reasons.join("\n"));
    }
    for event in &one.maintenance {
        let note = if event.note.is_empty() {
            String::new()
        } else {
            format!(": {}", event.note)
        };
        text += &format!(
            "{} rotor {} after flight {}, {} by {}{note}\n",
            event.event, event.rotor, event.after_flight, event.date, event.by
        );
    }
    text.trim_end().to_owned()
}

fn reason_of(rotor: &RotorView) -> Option<String> {
    let word = match rotor.status {
        Status::Inspect => "INSPECT",
        Status::Acknowledged => "acknowledged:",
        Status::Ok | Status::TooFewFlights => return None,
    };
    Some(format!("{word} rotor {}: {}", rotor.rotor, rotor.reasons.join("; ")))
}

fn rotor_table(one: &FleetView) -> Grid {
    let mut table = Grid::new([
        "rotor",
        "since flight",
        "bias now",
        "loss over flights",
        "per flight",
        "status",
    ])
    .numbers([0, 1]);
    for rotor in &one.rotors {
        let none = || "–".to_owned();
        let loss = rotor.loss.as_ref();
        table.add_row([
            rotor.rotor.to_string(),
            rotor.since_flight.to_string(),
            rotor.bias.as_ref().map_or_else(none, percent),
            loss.map_or_else(none, |loss| percent(&loss.lost)),
            loss.and_then(|loss| loss.per_flight.as_ref())
                .map_or_else(none, percent),
            match rotor.status {
                Status::Ok => "ok",
                Status::Inspect => "INSPECT",
                Status::Acknowledged => "acknowledged",
                Status::TooFewFlights => "too few flights",
            }
            .to_owned(),
        ]);
    }
    table
}

fn flight_table(one: &FleetView) -> Grid {
    let mut header: Vec<String> = ["flight", "date", "log", "in the air", "all rotors"]
        .map(str::to_owned)
        .to_vec();
    header.extend(one.rotors.iter().map(|rotor| format!("rotor {}", rotor.rotor)));
    header.push("within the flight".to_owned());
    let mut table = Grid::new(header).numbers([0].into_iter().chain(3..5 + one.rotors.len()));
    for flight in &one.flights {
        let losses: Vec<String> = flight
            .losses
            .iter()
            .map(|loss| format!("rotor {} lost {:.1} %", loss.rotor, 100.0 * loss.share))
            .collect();
        let name = std::path::Path::new(&flight.log).file_name().unwrap_or_default();
        let mut cells = vec![
            flight.flight.to_string(),
            flight.date.clone().unwrap_or_else(|| "–".to_owned()),
            name.to_string_lossy().into_owned(),
            format!("{:.0} s", flight.air_s),
            format!("{:+.1} %", 100.0 * flight.common_bias),
        ];
        cells.extend(flight.bias.iter().map(|bias| format!("{:+.2} %", 100.0 * bias)));
        cells.push(if losses.is_empty() {
            "–".to_owned()
        } else {
            losses.join(", ")
        });
        table.add_row(cells);
    }
    table
}
