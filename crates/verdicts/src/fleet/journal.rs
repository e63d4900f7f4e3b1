//! Journal of a vehicle: one append-only file of JSON lines.
//!
//! ```text
//! fleet/NAME.jsonl   {"event":"vehicle", …}      first line: name, model, effect of a loss of each rotor
//!                    {"event":"flight", …}       an evaluated flight
//!                    {"event":"acknowledge", …}  a rotor was inspected
//!                    {"event":"reset", …}        its propeller was replaced
//! ```
//! A writer locks the file, reads what others have written, and appends complete lines, synced to disk. A file with any other content is
//! rejected with the line number, and left unchanged.

use humantime::{format_rfc3339_seconds, parse_rfc3339_weak};
use rotortwin_twin::log::FlightLog;
use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// Extension of a vehicle's file.
const ENDING: &str = "jsonl";
/// Longest wait for another writer.
const LONGEST_WAIT: Duration = Duration::from_secs(10);
/// Polling interval of the lock.
const LOOK: Duration = Duration::from_millis(20);

/// First line of a vehicle's file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleEntry {
    /// Its name, equal to that of the file.
    pub name: String,
    /// Reference model of the biases, as named.
    pub model: String,
    /// Content hash of that version: flights are compared with one model only.
    pub model_hash: String,
    /// For each rotor: change of every rotor's `asked` per x, if this rotor alone has lost the fraction 1 − e⁻ˣ of its thrust.
    pub signatures: Vec<Vec<f64>>,
}

/// Loss of thrust of a rotor detected within a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossEntry {
    /// From 1.
    pub rotor: usize,
    /// Fraction of its thrust.
    pub share: f64,
    /// Lower end of the 95 % interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Probability of the detector's verdict.
    pub probability: f64,
}

/// A flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlightEntry {
    /// The log, as named.
    pub log: String,
    /// Hash (XXH3-128) of its file: the same file counts once.
    pub log_hash: String,
    /// Date of the flight, UTC (RFC 3339), if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
    /// When it was added, UTC.
    pub added: String,
    /// Averaging time in the air, s.
    pub air_s: f64,
    /// For each rotor: ln of its mean commanded thrust over the model's hover thrust.
    pub asked: Vec<f64>,
    /// Its standard error within the flight, including manoeuvres: for information, no decision uses it.
    pub deviation: Vec<f64>,
    /// Losses named by the sequential detector at the end of each stretch after one calibration.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub losses: Vec<LossEntry>,
    /// Suspect rotors, from 1, of an ambiguous or unknown verdict.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub suspects: Vec<usize>,
    /// Seconds with a verdict of the sequential detector.
    pub judged_s: f64,
    /// Smallest detectable fractional thrust loss of each rotor at the end; empty without a verdict.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub smallest_loss: Vec<f64>,
}

/// Maintenance of a rotor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaintenanceEntry {
    /// From 1.
    pub rotor: usize,
    /// Who.
    pub by: String,
    /// When, UTC (RFC 3339).
    pub date: String,
    /// Findings or work done.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
}

/// A line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// The first one.
    Vehicle(VehicleEntry),
    /// A flight.
    Flight(FlightEntry),
    /// A rotor was inspected: what was known by then no longer requires inspection.
    Acknowledge(MaintenanceEntry),
    /// A propeller was replaced: the rotor's history restarts here.
    Reset(MaintenanceEntry),
}

impl Event {
    fn date(&self) -> Option<&str> {
        match self {
            Self::Vehicle(_) => None,
            Self::Flight(flight) => flight.date.as_deref(),
            Self::Acknowledge(entry) | Self::Reset(entry) => Some(&entry.date),
        }
    }
}

/// A vehicle's file.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    /// The vehicle.
    pub vehicle: VehicleEntry,
    /// The other events, in chronological order: by date if every flight has one, otherwise as written.
    pub events: Vec<Event>,
    /// Ordered by date.
    pub by_date: bool,
}

impl History {
    /// Rotors of the vehicle.
    pub fn rotor_count(&self) -> usize {
        self.vehicle.signatures.len()
    }

    /// Its flights.
    pub fn flights(&self) -> impl Iterator<Item = &FlightEntry> {
        self.events.iter().filter_map(|event| match event {
            Event::Flight(flight) => Some(flight),
            _ => None,
        })
    }
}

/// Folder with a file for each vehicle.
#[derive(Debug, Clone)]
pub struct Fleet {
    folder: PathBuf,
}

/// Result of adding a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Added {
    /// It was added.
    New,
    /// It already exists, as this flight number.
    Known(usize),
}

/// A date in file format: UTC, to the second.
///
/// # Errors
/// The text is not a date.
pub fn date(text: &str) -> Result<String, String> {
    let whole = if text.len() == "2026-01-31".len() {
        format!("{text}T00:00:00Z")
    } else {
        text.to_owned()
    };
    parse_rfc3339_weak(&whole)
        .map(|time| format_rfc3339_seconds(time).to_string())
        .map_err(|error| {
            format!("expected a date such as 2026-01-31 or 2026-01-31T14:05:00Z (UTC), got {text}: {error}")
        })
}

/// Start of a log in file format; `None` if it contains no date.
pub fn date_of(log: &FlightLog) -> Option<String> {
    let since_1970_s = log.report.flown.as_ref()?.unix_s + log.time_s.first()?;
    let since = Duration::try_from_secs_f64(since_1970_s).ok()?;
    Some(format_rfc3339_seconds(SystemTime::UNIX_EPOCH.checked_add(since)?).to_string())
}

/// Current time in file format.
#[expect(clippy::disallowed_methods, reason = "for people: when something was written down")]
pub fn now() -> String {
    format_rfc3339_seconds(SystemTime::now()).to_string()
}

/// A name that is also a valid file name.
///
/// # Errors
/// The name is invalid.
pub fn vehicle_name(text: &str) -> Result<String, String> {
    let letters = text
        .chars()
        .all(|letter| letter.is_ascii_alphanumeric() || "-_.".contains(letter));
    if text.is_empty() || text.len() > 64 || text.starts_with(['.', '-']) || !letters {
        return Err(format!(
            "expected a name of 1 to 64 letters, digits, `-`, `_` and `.`, not beginning with `.` or `-`, got {text:?}"
        ));
    }
    Ok(text.to_owned())
}

impl Fleet {
    /// In a folder, created with the first vehicle.
    pub fn new(folder: &Path) -> Self {
        Self {
            folder: folder.to_path_buf(),
        }
    }

    fn file_of(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.{ENDING}"))
    }

    /// Names of all vehicles, in order.
    ///
    /// # Errors
    /// The folder does not exist.
    pub fn vehicles(&self) -> Result<Vec<String>, String> {
        let entries = std::fs::read_dir(&self.folder).map_err(|error| {
            format!(
                "{}: cannot be read as a folder of vehicles: {error}",
                self.folder.display()
            )
        })?;
        let mut names = Vec::new();
        for entry in entries {
            let path = entry
                .map_err(|error| format!("{}: cannot be read: {error}", self.folder.display()))?
                .path();
            if path.extension().is_some_and(|ending| ending == ENDING)
                && let Some(name) = path.file_stem().and_then(|stem| stem.to_str())
            {
                names.push(name.to_owned());
            }
        }
        names.sort();
        Ok(names)
    }

    /// The history of a vehicle.
    ///
    /// # Errors
    /// Unknown vehicle, or invalid file.
    pub fn read(&self, name: &str) -> Result<History, String> {
        let path = self.file_of(name);
        let file = match File::open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Err(self.unknown(name)),
            Err(error) => return Err(format!("{}: cannot be read: {error}", path.display())),
        };
        lock(&file, &path, FlockOperation::NonBlockingLockShared)?;
        parse(name, &path, &text_of(&file, &path)?)?.ok_or_else(|| self.unknown(name))
    }

    fn unknown(&self, name: &str) -> String {
        let known = self.vehicles().unwrap_or_default();
        let known = if known.is_empty() {
            "none".to_owned()
        } else {
            known.join(", ")
        };
        format!(
            "{name}: vehicle not found in {}; expected one of: {known}; add a new one with `rotortwin fleet add {name} LOG… --model MODEL`",
            self.folder.display()
        )
    }

    /// Adds a flight, to a new file if there is none; skipped if its log already exists.
    ///
    /// # Errors
    /// Invalid file, a different model from the earlier flights, or a file that cannot be written or is locked by another process.
    pub fn add(&self, vehicle: &VehicleEntry, flight: FlightEntry) -> Result<Added, String> {
        std::fs::create_dir_all(&self.folder)
            .map_err(|error| format!("{}: the folder cannot be created: {error}", self.folder.display()))?;
        let path = self.file_of(&vehicle.name);
        let mut file = File::options()
            .create(true)
            .read(true)
            .append(true)
            .open(&path)
            .map_err(|error| format!("{}: cannot be written: {error}", path.display()))?;
        lock(&file, &path, FlockOperation::NonBlockingLockExclusive)?;
        let history = parse(&vehicle.name, &path, &text_of(&file, &path)?)?;
        let mut events = Vec::new();
        match &history {
            None => events.push(Event::Vehicle(vehicle.clone())),
            Some(history) => {
                same_model(&path, &history.vehicle, (&vehicle.model, &vehicle.model_hash))?;
                if let Some(place) = place_in(history, &flight.log_hash) {
                    return Ok(Added::Known(place));
                }
            }
        }
        events.push(Event::Flight(flight));
        append(&mut file, &path, &events)?;
        Ok(Added::New)
    }

    /// Rejects what [`Self::add`] would reject, before a log is evaluated; returns the number of an existing log.
    ///
    /// # Errors
    /// One sentence.
    pub fn place_of(&self, name: &str, model: (&str, &str), log_hash: &str) -> Result<Option<usize>, String> {
        let path = self.file_of(name);
        if !path.exists() {
            return Ok(None);
        }
        let file = File::open(&path).map_err(|error| format!("{}: cannot be read: {error}", path.display()))?;
        lock(&file, &path, FlockOperation::NonBlockingLockShared)?;
        let Some(history) = parse(name, &path, &text_of(&file, &path)?)? else {
            return Ok(None);
        };
        same_model(&path, &history.vehicle, model)?;
        Ok(place_in(&history, log_hash))
    }

    /// Records inspections of rotors or replacements of their propellers.
    ///
    /// # Errors
    /// Unknown vehicle or rotor, or a file that cannot be written.
    pub fn maintain(&self, name: &str, events: &[Event]) -> Result<(), String> {
        let path = self.file_of(name);
        let mut file = match File::options().read(true).append(true).open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Err(self.unknown(name)),
            Err(error) => return Err(format!("{}: cannot be written: {error}", path.display())),
        };
        lock(&file, &path, FlockOperation::NonBlockingLockExclusive)?;
        let history = parse(name, &path, &text_of(&file, &path)?)?.ok_or_else(|| self.unknown(name))?;
        for event in events {
            check(event, history.rotor_count()).map_err(|reason| format!("{name}: {reason}"))?;
        }
        append(&mut file, &path, events)
    }
}

fn place_in(history: &History, log_hash: &str) -> Option<usize> {
    history.flights().position(|known| known.log_hash == log_hash)
}

/// Biases of different models are not comparable: checks its name and the content hash of its version.
fn same_model(path: &Path, known: &VehicleEntry, (name, hash): (&str, &str)) -> Result<(), String> {
    if known.model_hash == hash {
        return Ok(());
    }
    Err(format!(
        "{}: its flights were compared with {} (version {}), and {} (version {}) is another model, relative to which biases start anew; expected the \
         same one, or another name for the vehicle",
        path.display(),
        known.model,
        known.model_hash,
        name,
        hash
    ))
}

fn lock(file: &File, path: &Path, operation: FlockOperation) -> Result<(), String> {
    let begun = Instant::now();
    loop {
        match flock(file, operation) {
            Ok(()) => return Ok(()),
            Err(rustix::io::Errno::WOULDBLOCK | rustix::io::Errno::INTR) if begun.elapsed() < LONGEST_WAIT => {
                std::thread::sleep(LOOK);
            }
            Err(rustix::io::Errno::WOULDBLOCK) => {
                return Err(format!(
                    "{}: another process has held the lock of this file for {} s",
                    path.display(),
                    LONGEST_WAIT.as_secs()
                ));
            }
            Err(error) => return Err(format!("{}: cannot be locked: {error}", path.display())),
        }
    }
}

fn text_of(mut file: &File, path: &Path) -> Result<String, String> {
    let mut text = String::new();
    file.read_to_string(&mut text)
        .map_err(|error| format!("{}: cannot be read as text: {error}", path.display()))?;
    Ok(text)
}

fn append(file: &mut File, path: &Path, events: &[Event]) -> Result<(), String> {
    let mut text = String::new();
    for event in events {
        text += &serde_json::to_string(event).expect("text and finite numbers are JSON");
        text.push('\n');
    }
    file.write_all(text.as_bytes())
        .and_then(|()| file.sync_data())
        .map_err(|error| format!("{}: cannot be written: {error}", path.display()))
}

/// Parses a file's text; `None` if it is empty.
fn parse(name: &str, path: &Path, text: &str) -> Result<Option<History>, String> {
    let at = |line: usize, reason: String| format!("{}, line {}: {reason}", path.display(), line + 1);
    let mut events = Vec::new();
    for (k, line) in text.split_inclusive('\n').enumerate() {
        if !line.ends_with('\n') {
            return Err(at(
                k,
                "incomplete line: a write was interrupted; remove this line and repeat the entry".to_owned(),
            ));
        }
        let event: Event = serde_json::from_str(line)
            .map_err(|error| at(k, format!("expected an event of a vehicle as JSON: {error}")))?;
        events.push(event);
    }
    let mut events = events.into_iter();
    let vehicle = match events.next() {
        None => return Ok(None),
        Some(Event::Vehicle(vehicle)) => vehicle,
        Some(_) => return Err(at(0, "expected the event `vehicle` first".to_owned())),
    };
    if vehicle.name != name {
        return Err(at(0, format!("expected the vehicle {name}, got {}", vehicle.name)));
    }
    let rotors = vehicle.signatures.len();
    if rotors == 0 || vehicle.signatures.iter().any(|row| row.len() != rotors) {
        return Err(at(
            0,
            "expected as many signatures as rotors, each with as many numbers".to_owned(),
        ));
    }
    let mut events: Vec<Event> = events.collect();
    for (k, event) in events.iter().enumerate() {
        check(event, rotors).map_err(|reason| at(k + 1, reason))?;
    }
    let by_date = events
        .iter()
        .all(|event| !matches!(event, Event::Flight(flight) if flight.date.is_none()));
    if by_date {
        // Dates have a uniform format, so that they sort as text; the sort is stable for equal dates.
        events.sort_by(|a, b| a.date().cmp(&b.date()));
    }
    Ok(Some(History {
        vehicle,
        events,
        by_date,
    }))
}

fn check(event: &Event, rotors: usize) -> Result<(), String> {
    let rotor = |rotor: usize| {
        if (1..=rotors).contains(&rotor) {
            Ok(())
        } else {
            Err(format!("expected a rotor from 1 to {rotors}, got {rotor}"))
        }
    };
    if let Some(given) = event.date() {
        date(given)?;
    }
    match event {
        Event::Vehicle(_) => Err("expected the event `vehicle` in the first line only".to_owned()),
        Event::Acknowledge(entry) | Event::Reset(entry) => rotor(entry.rotor),
        Event::Flight(flight) => {
            if flight.asked.len() != rotors || flight.deviation.len() != rotors {
                return Err(format!(
                    "expected `asked` and `deviation` of {rotors} rotors, got {} and {}",
                    flight.asked.len(),
                    flight.deviation.len()
                ));
            }
            let named = flight.losses.iter().map(|loss| loss.rotor);
            named.chain(flight.suspects.iter().copied()).try_for_each(rotor)
        }
    }
}
