//! An imported log on disk: `NAME.parquet`, its side file `NAME.toml`, and the import report `NAME.import.json`.

use super::flight_parts::{FlightEvent, FlightParts};
use super::report::{Flown, ImportReport, Stream};
use super::{FlightLog, LogError, LogSource, Origin, Segment, SourceKind, error, sources};
use rotortwin_flight_core::MAX_ROTORS;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use utoipa::ToSchema;

/// Longest text that is read of a file's metadata; thousands of parameters are some hundred kilobytes.
const MOST_KEPT_BYTES: usize = 1 << 22;
/// Changes of modes and parameters, and a pilot's inputs, of one log.
const MOST_HAPPENINGS: usize = 1 << 16;
/// Streams of one log.
const MOST_STREAMS: usize = 4096;

/// What the Parquet file of an import keeps about its source beyond the columns.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Kept {
    source: SourceKind,
    clock_start_s: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    flown: Option<Flown>,
    rotor_outputs: Vec<usize>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    other_vehicle: Option<String>,
    streams: Vec<Stream>,
    parameters: BTreeMap<String, f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    happenings: Vec<FlightEvent>,
}

impl Kept {
    /// As JSON; `None` for logs that have no other source than their columns.
    pub(crate) fn of(log: &FlightLog) -> Option<String> {
        if !log.source.kind.is_of_a_vehicle() {
            return None;
        }
        let kept = Self {
            source: log.source.kind,
            clock_start_s: log.report.clock_start_s,
            flown: log.report.flown.clone(),
            rotor_outputs: log.report.rotor_outputs.clone(),
            other_vehicle: log.report.other_vehicle.clone(),
            streams: log.report.streams.clone(),
            parameters: log.parameters.clone(),
            happenings: log.report.happenings.clone(),
        };
        serde_json::to_string(&kept).ok()
    }

    /// Restores in the log what was kept; reports what cannot be read.
    pub(crate) fn restore(text: &str, log: &mut FlightLog) {
        let read = if text.len() > MOST_KEPT_BYTES {
            Err(format!("{} bytes", text.len()))
        } else {
            serde_json::from_str::<Self>(text).map_err(|error| error.to_string())
        };
        let possible = |kept: &Self| {
            kept.source.is_of_a_vehicle()
                && kept.rotor_outputs.len() <= MAX_ROTORS
                && kept.streams.len() <= MOST_STREAMS
                && kept.parameters.len() <= sources::MOST_PARAMETERS
                && kept.happenings.len() <= MOST_HAPPENINGS
        };
        match read {
            Ok(kept) if possible(&kept) => {
                log.source.kind = kept.source;
                log.report.clock_start_s = kept.clock_start_s;
                log.report.flown = kept.flown;
                log.report.rotor_outputs = kept.rotor_outputs;
                log.report.other_vehicle = kept.other_vehicle;
                log.report.streams = kept.streams;
                log.report.happenings = kept.happenings;
                log.parameters = kept.parameters;
            }
            Ok(_) => log
                .report
                .notes
                .push("the stored description of the source is impossible: ignored".to_owned()),
            Err(reason) => log.report.notes.push(format!(
                "the stored description of the source cannot be read ({reason}): ignored"
            )),
        }
    }
}

/// `NAME.import.json`: what was read from a file, and how it was converted.
#[derive(Debug, Serialize, ToSchema)]
pub struct ImportAccount<'a> {
    /// Readable report: channels, rates, gaps, what is missing and what cannot be tested without it.
    account: String,
    /// Parts (on the ground, in the air, …) and events.
    flight_parts: FlightParts,
    /// One line.
    headline: String,
    /// The same as `account`, as data.
    #[schema(value_type = ImportReport)]
    report: &'a ImportReport,
    /// The file.
    #[schema(value_type = LogSource)]
    source: &'a LogSource,
}

/// The side file as written.
#[derive(Serialize)]
struct SideFileOut<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    vehicle: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    licence: Option<&'a str>,
    source: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    origin: Option<Origin>,
    #[serde(rename = "segment", skip_serializing_if = "<[Segment]>::is_empty")]
    segments: &'a [Segment],
}

impl FlightLog {
    /// Writes the log into a folder, which is made if need be; returns the Parquet file's path.
    ///
    /// All three files appear, whole, or none.
    ///
    /// # Errors
    /// A file of this name is there already, or the folder cannot be written.
    pub fn store(&self, folder: &Path, name: &str) -> Result<PathBuf, LogError> {
        refuse_a_file_as_folder(folder)?;
        let parquet = folder.join(format!("{name}.parquet"));
        let side = folder.join(format!("{name}.toml"));
        let account = folder.join(format!("{name}.import.json"));
        for path in [&parquet, &side, &account] {
            if path.exists() {
                return Err(LogError::format(
                    path,
                    "already exists; name another folder with --out, or remove it",
                ));
            }
        }
        std::fs::create_dir_all(folder).map_err(error::io(folder, "cannot make the folder"))?;
        let out = SideFileOut {
            vehicle: self.vehicle.as_deref(),
            licence: self.licence.as_deref(),
            source: format!(
                "{} ({:?}, XXH3 {})",
                self.source.path.display(),
                self.source.kind,
                self.source.content_hash
            ),
            origin: self.origin,
            segments: &self.segments,
        };
        let side_text =
            toml::to_string(&out).map_err(|bad| LogError::format(&side, format!("cannot be written: {bad}")))?;
        let parts = self.flight_parts(None);
        let told = ImportAccount {
            account: self.account_with(&parts),
            flight_parts: parts,
            headline: self.headline(),
            report: &self.report,
            source: &self.source,
        };
        let report_text = serde_json::to_value(&told)
            .and_then(|value| serde_json::to_string_pretty(&value))
            .map_err(|bad| LogError::format(&account, format!("cannot be written: {bad}")))?;
        let text = |path: &Path, text: String| {
            whole(path, |path| {
                std::fs::write(path, text).map_err(error::io(path, "cannot write"))
            })
        };
        let written = text(&side, side_text)
            .and_then(|()| text(&account, report_text))
            .and_then(|()| whole(&parquet, |path| self.write_parquet(path)));
        if written.is_err() {
            // They were not there before; without the log they would only stand in the way of the next attempt.
            drop((std::fs::remove_file(&side), std::fs::remove_file(&account)));
        }
        written.map(|()| parquet)
    }
}

/// A file name where a folder is expected: `--out flight.parquet` created a folder of that name.
fn refuse_a_file_as_folder(folder: &Path) -> Result<(), LogError> {
    let ending = folder.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    let of_a_log = ending.is_some_and(|ending| ["parquet", "csv"].contains(&ending.as_str()));
    if of_a_log && !folder.is_dir() {
        return Err(LogError::format(
            folder,
            "--out takes a folder, in which the log is stored as NAME.parquet with its report; got the name of a file",
        ));
    }
    Ok(())
}

/// Writes a temporary file next to it and renames, so that readers never see half of it.
fn whole(path: &Path, write: impl FnOnce(&Path) -> Result<(), LogError>) -> Result<(), LogError> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    let written =
        write(&partial).and_then(|()| std::fs::rename(&partial, path).map_err(error::io(path, "cannot write")));
    if written.is_err() {
        // The first error is the one to report.
        drop(std::fs::remove_file(&partial));
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_file_as_folder_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let log = FlightLog::from_columns("x", vec![0.0, 1.0], []).unwrap();
        let reason = log
            .store(&folder.path().join("x.parquet"), "x")
            .unwrap_err()
            .to_string();
        assert!(reason.contains("--out takes a folder"), "{reason}");
        assert!(!folder.path().join("x.parquet").exists());
        // A folder that is there under such a name is one.
        std::fs::create_dir(folder.path().join("old.csv")).unwrap();
        assert!(log.store(&folder.path().join("old.csv"), "x").is_ok());
        assert!(log.store(&folder.path().join("new"), "x").is_ok());
    }
}
