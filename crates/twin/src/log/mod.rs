//! Flight logs: one type for every source.
//!
//! ```text
//! CSV, Parquet (canonical names) ─▶ Table ─▶ accept: refusals, Euler angles, report ─▶ FlightLog
//! ```
//! A log has one time base and columns of numbers: the canonical ones ([`names`]) in SI, NED and FRD, and whatever else the file
//! holds under its own name. A cell without a value is NaN in memory and nowhere else.
//!
//! What cannot be right is refused with one sentence ([`LogError`]) before anything is kept; what looks wrong but could be read is
//! a [`Finding`] in the [`ImportReport`].
//!
//! Limits: a log is held in memory as f64, 8 bytes a cell (90 s at 1 kHz and 40 columns: 29 MB); [`MAX_CELLS`] bounds it.

mod accept;
mod csv;
mod error;
mod findings;
pub mod names;
mod parquet;
mod report;
mod resample;
mod side_file;
mod table;

pub use error::LogError;
pub use findings::{Finding, FindingKind};
pub use report::{ColumnNoise, Delay, GAP_FACTOR, Gap, ImportReport, Missing, MissingCells, Stream, UnusedColumn};

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Most cells of one log: 2 GiB of numbers.
pub const MAX_CELLS: usize = 1 << 28;

/// What a log was read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SourceKind {
    /// Canonical CSV.
    Csv,
    /// Canonical Parquet.
    Parquet,
    /// Made in this process.
    Memory,
}

/// Where a log comes from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LogSource {
    /// Kind of file.
    pub kind: SourceKind,
    /// The file; empty for a log made in this process.
    pub path: PathBuf,
    /// XXH3-128 of the file's bytes, 32 hexadecimal digits; empty for a log made in this process.
    pub content_hash: String,
}

/// A named part of a log; from the side file or from the source.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// Its name.
    pub name: String,
    /// Begin, s, on the log's time.
    pub start_s: f64,
    /// End, s, on the log's time.
    pub end_s: f64,
}

/// Where north 0, east 0, down 0 is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Geodetic latitude, degrees.
    pub latitude_deg: f64,
    /// Longitude, degrees.
    pub longitude_deg: f64,
    /// Above mean sea level, m.
    pub altitude_m: f64,
}

/// One flight as measured.
#[derive(Clone, Debug)]
pub struct FlightLog {
    /// File name without its extension.
    pub name: String,
    /// Where it comes from.
    pub source: LogSource,
    /// Time of each row, s; strictly increasing, at least two rows.
    pub time_s: Vec<f64>,
    /// Every other column, by name; as long as `time_s`; NaN = no value.
    pub columns: BTreeMap<String, Vec<f64>>,
    /// Named parts, in the order of the side file.
    pub segments: Vec<Segment>,
    /// Vehicle file that the side file names, as written there.
    pub vehicle: Option<String>,
    /// Origin of the position, if known.
    pub origin: Option<Origin>,
    /// Licence of the data, if the side file names one.
    pub licence: Option<String>,
    /// What the import did.
    pub report: ImportReport,
}

impl FlightLog {
    /// Reads a flight log; the kind of file is found from its content.
    ///
    /// A side file `NAME.toml` beside `NAME.csv` or `NAME.parquet` is read with it.
    ///
    /// # Errors
    /// Whatever the canonical format forbids, with file, row and column.
    pub fn read(path: &Path) -> Result<Self, LogError> {
        let bytes = std::fs::read(path).map_err(error::io(path, "cannot read the log"))?;
        let hash = format!("{:032x}", xxhash_rust::xxh3::xxh3_128(&bytes));
        let side = side_file::read_beside(path)?;
        let (kind, table) = if bytes.starts_with(b"PAR1") {
            (SourceKind::Parquet, parquet::read(path, bytes)?)
        } else {
            (SourceKind::Csv, csv::read(path, &bytes)?)
        };
        let source = LogSource {
            kind,
            path: path.to_path_buf(),
            content_hash: hash,
        };
        accept::accept(source, table, side)
    }

    /// A log from columns of this process; checked like a file.
    ///
    /// # Errors
    /// Whatever the canonical format forbids.
    pub fn from_columns(
        name: &str,
        time_s: Vec<f64>,
        columns: impl IntoIterator<Item = (String, Vec<f64>)>,
    ) -> Result<Self, LogError> {
        let mut table = table::Table::default();
        table.push(names::TIME, time_s);
        for (column, values) in columns {
            table.push(&column, values);
        }
        let source = LogSource {
            kind: SourceKind::Memory,
            path: PathBuf::from(name),
            content_hash: String::new(),
        };
        accept::accept(source, table, None)
    }

    /// Values of a column, one per row; NaN = no value.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.get(name).map(Vec::as_slice)
    }

    /// Columns of a vector, if all of them are there.
    pub fn vector<const N: usize>(&self, names: [&str; N]) -> Option<[&[f64]; N]> {
        let mut found = [&[] as &[f64]; N];
        for (slot, name) in found.iter_mut().zip(names) {
            *slot = self.column(name)?;
        }
        Some(found)
    }

    /// Duties of all rotors, in the rotor order of the vehicle file; empty if the log has none or one is missing in between.
    pub fn duties(&self) -> Vec<&[f64]> {
        let count = self.rotor_count();
        (1..=count)
            .map_while(|rotor| self.column(&names::duty(rotor)))
            .collect()
    }

    /// Number of rotors that the columns speak of (duties, else measured speeds); 0 if they speak of none.
    pub fn rotor_count(&self) -> usize {
        let most = |number: fn(&str) -> Option<usize>| self.columns.keys().filter_map(|name| number(name)).max();
        most(names::duty_rotor)
            .or_else(|| most(names::speed_rotor))
            .unwrap_or(0)
    }

    /// Median sample rate, Hz.
    pub fn sample_rate_hz(&self) -> f64 {
        resample::median_rate_hz(&self.time_s)
    }

    /// From the first to the last row, s.
    pub fn duration_s(&self) -> f64 {
        match self.time_s.as_slice() {
            [first, .., last] => last - first,
            _ => 0.0,
        }
    }
}
