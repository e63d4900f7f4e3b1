//! Flight logs: one type for every source.
//!
//! ```text
//! CSV, Parquet, run folder (canonical names) ───────────────────────────▶ Table ─▶ accept: refusals, Euler angles ─▶ FlightLog
//! ULog, DataFlash, usdlog, blackbox, tlog, MCAP ─▶ streams ─▶ mapping: units, frames, one time ──▶ Table ─┘
//! ```
//! A log has one time base and columns of numbers: the canonical ones ([`names`]) in SI, NED and FRD, and whatever else the file
//! holds under its own name. A cell without a value is NaN in memory and nowhere else.
//!
//! What cannot be correct is rejected with one sentence ([`LogError`]) before anything is stored; what looks wrong but
//! could be read is a [`Finding`] in the [`ImportReport`].
//!
//! [`flight_parts`] finds which parts of it are on the ground, in the air, a crash.
//!
//! Limits: a log is held in memory as f64, 8 bytes a cell (90 s at 1 kHz and 40 columns: 29 MB); [`MAX_CELLS`] bounds it.

mod accept;
mod assemble;
mod calendar;
mod checks;
mod csv;
mod describe;
mod draft;
mod error;
mod event;
mod findings;
pub mod flight_parts;
mod gate;
mod happenings;
pub(crate) mod low_pass;
mod mapping;
pub mod names;
mod outputs;
mod parquet;
mod part;
mod remap;
mod report;
mod resample;
pub(crate) mod rest;
mod rotor_order;
mod side_file;
mod simulated;
mod source_rates;
mod sources;
mod stamps;
mod steps;
mod stored;
mod table;
mod units;
mod utc;

pub(crate) use checks::LEAST_TO_CONTRADICT_HZ;
pub use checks::TurnChanges;
pub use describe::ColumnRange;
pub use draft::{Draft, draft};
pub use error::LogError;
pub use findings::{Finding, FindingKind};
pub use report::{
    ColumnNoise, Delay, Flown, GAP_FACTOR, Gap, ImportReport, Missing, MissingCells, Stream, UnusedColumn,
};
pub use resample::running_mean;
pub use rotor_order::{RotorOrder, stated as stated_order};
pub use source_rates::SensorRate;
pub use stored::ImportAccount;

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};

/// Most cells of one log: 2 GiB of numbers.
pub const MAX_CELLS: usize = 1 << 28;

/// Most columns of one log, and numbers of one sample of an autopilot's log.
pub const MAX_COLUMNS: usize = 4096;

/// Longest file that is read.
pub const MAX_FILE_BYTES: u64 = 1 << 31;
/// The table in a run folder; the same name as in `rotortwin-store`.
const RUN_TELEMETRY: &str = "telemetry.parquet";
/// The account in a folder of a recording of ROS 2.
const RECORDING_METADATA: &str = "metadata.yaml";

/// How [`FlightLog::read_with`] reads.
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// Mapping file whose rows go before the built-in ones.
    pub mapping: Option<PathBuf>,
    /// For a simulated run, use the truth (`true_…` columns) instead of the sensed values.
    pub truth: bool,
    /// Import the readable part of a file whose checksum is wrong.
    pub accept_damaged: bool,
    /// Most cells of a table, below [`MAX_CELLS`]; for files of strangers.
    pub most_cells: Option<usize>,
}

/// File format of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
#[schema(as = LogSourceKind)]
pub enum SourceKind {
    /// Canonical CSV.
    Csv,
    /// Canonical Parquet.
    Parquet,
    /// Folder of a simulated run.
    RunFolder,
    /// PX4 ULog.
    Px4Ulog,
    /// ArduPilot DataFlash, binary.
    ArdupilotDataflash,
    /// ArduPilot DataFlash, text.
    ArdupilotDataflashText,
    /// Crazyflie micro-SD log.
    CrazyflieUsdlog,
    /// Betaflight or INAV blackbox.
    Blackbox,
    /// MAVLink telemetry log.
    MavlinkTlog,
    /// Recording of ROS 2 (MCAP).
    Ros2Bag,
    /// `run.mcap` of a simulated run.
    RunMcap,
    /// CSV of whatever columns, by a mapping.
    MappedCsv,
    /// Made in this process.
    Memory,
}

impl SourceKind {
    /// True for files in a native format of a vehicle or its ground station.
    pub(crate) fn is_of_a_vehicle(self) -> bool {
        !matches!(
            self,
            Self::Csv | Self::Parquet | Self::RunFolder | Self::RunMcap | Self::Memory
        )
    }

    /// True if position and velocity come from an autopilot's estimator, at whatever rate they are logged.
    pub fn is_of_an_estimator(self) -> bool {
        matches!(
            self,
            Self::Px4Ulog | Self::ArdupilotDataflash | Self::ArdupilotDataflashText | Self::MavlinkTlog | Self::Ros2Bag
        )
    }

    /// How to have the motor outputs in such a log at a higher rate.
    pub(crate) fn faster_outputs(self) -> &'static str {
        match self {
            Self::Px4Ulog => "PX4: set SDLOG_PROFILE to high rate (17), which logs actuator_motors at full rate",
            Self::ArdupilotDataflash | Self::ArdupilotDataflashText => {
                "ArduPilot writes RCOU at 10 Hz whatever LOG_BITMASK says: record SERVO_OUTPUT_RAW by telemetry (SR*_RC_CHAN 50), with LOG_BITMASK of fast attitude and fast IMU for the rest"
            }
            Self::MavlinkTlog => "request SERVO_OUTPUT_RAW at 50 Hz or more (ArduPilot: SR*_RC_CHAN 50)",
            _ => "log the motor outputs as fast as the gyroscope",
        }
    }
}

/// Source of a log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct LogSource {
    /// File format; for a stored import, that of the imported file.
    pub kind: SourceKind,
    /// The file; empty for a log made in this process.
    #[schema(value_type = String)]
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
    /// Parameters of the autopilot, by their names; empty for sources that hold none.
    pub parameters: BTreeMap<String, f64>,
    /// What the import did.
    pub report: ImportReport,
}

fn most_cells(options: &ReadOptions) -> usize {
    options.most_cells.unwrap_or(MAX_CELLS).min(MAX_CELLS)
}

/// Parses a log of an autopilot and brings it into canonical form.
fn read_autopilot(
    source: impl FnOnce(SourceKind) -> LogSource,
    file: &Path,
    format: sources::Format,
    bytes: &[u8],
    side: Option<side_file::SideFile>,
    options: &ReadOptions,
) -> Result<FlightLog, LogError> {
    let (kind, name) = match format {
        sources::Format::Ulog => (SourceKind::Px4Ulog, mapping::SourceName::Px4Ulog),
        sources::Format::DataFlash => (SourceKind::ArdupilotDataflash, mapping::SourceName::ArdupilotDataflash),
        sources::Format::DataFlashText => (
            SourceKind::ArdupilotDataflashText,
            mapping::SourceName::ArdupilotDataflash,
        ),
        sources::Format::Usdlog => (SourceKind::CrazyflieUsdlog, mapping::SourceName::CrazyflieUsdlog),
        sources::Format::Blackbox | sources::Format::BlackboxCsv => {
            (SourceKind::Blackbox, mapping::SourceName::Blackbox)
        }
        sources::Format::Tlog => (SourceKind::MavlinkTlog, mapping::SourceName::MavlinkTlog),
        sources::Format::RunMcap => (SourceKind::RunMcap, mapping::SourceName::RunMcap),
        sources::Format::Mcap | sources::Format::Db3 | sources::Format::Ros1Bag | sources::Format::Zstd => {
            (SourceKind::Ros2Bag, mapping::SourceName::Ros2)
        }
    };
    if options.truth && format == sources::Format::RunMcap {
        return Err(LogError::format(file, "--truth is for run folders; name the folder"));
    }
    refuse_truth(file, options)?;
    let mapping = mapping::load(name, options.mapping.as_deref())?;
    let asked = sources::Asked {
        accept_damaged: options.accept_damaged,
        most_cells: most_cells(options),
        places: mapping.places(),
        topics: mapping.topics.clone(),
    };
    let parsed = sources::parse(format, bytes, &asked).map_err(|reason| LogError::format(file, reason))?;
    accepted(source(kind), file, &parsed, &mapping, side, options)
}

fn refuse_truth(file: &Path, options: &ReadOptions) -> Result<(), LogError> {
    if options.truth {
        return Err(LogError::format(
            file,
            "a measured log has no truth; --truth is for simulated runs",
        ));
    }
    Ok(())
}

/// Streams onto one time base, in canonical columns.
fn accepted(
    source: LogSource,
    file: &Path,
    parsed: &sources::SourceLog,
    mapping: &mapping::MappingFile,
    side: Option<side_file::SideFile>,
    options: &ReadOptions,
) -> Result<FlightLog, LogError> {
    let mut assembled =
        assemble::assemble(parsed, mapping, most_cells(options)).map_err(|reason| LogError::format(file, reason))?;
    let made_up = simulated::take_made_up_speeds(&mut assembled.table);
    let mut log = accept::accept(source, assembled.table, side)?;
    log.origin = log.origin.or(assembled.origin);
    log.parameters = parsed.parameters.clone();
    log.report.clock_start_s = assembled.report.clock_start_s;
    log.report.flown = assembled.report.flown;
    log.report.rotor_outputs = assembled.report.rotor_outputs;
    log.report.other_vehicle = assembled.report.other_vehicle;
    log.report.streams = assembled.report.streams;
    log.report.happenings = assembled.report.happenings;
    log.report.unused_columns.extend(assembled.report.unused_columns);
    log.report.conversions.splice(0..0, assembled.report.conversions);
    log.report.notes.splice(0..0, assembled.report.notes);
    log.report.notes.extend(made_up);
    log.report.notes.extend(simulated::of_streams(parsed));
    Ok(log)
}

/// The file of a recording of ROS 2, which is a folder with `metadata.yaml` and one or more files; `None` for anything
/// else.
fn recording_in(path: &Path) -> Result<Option<PathBuf>, LogError> {
    if !path.join(RECORDING_METADATA).is_file() {
        return Ok(None);
    }
    let entries = std::fs::read_dir(path).map_err(error::io(path, "cannot read the folder"))?;
    let is_recording = |file: &PathBuf| {
        let name = file
            .file_name()
            .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        [".mcap", ".db3", ".mcap.zstd", ".db3.zstd"]
            .iter()
            .any(|ending| name.ends_with(ending))
    };
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(is_recording)
        .collect();
    files.sort();
    match files.as_slice() {
        [file] => Ok(Some(file.clone())),
        [] => Err(LogError::format(
            path,
            "a folder of ROS 2 without a recording (.mcap) in it",
        )),
        [first, .., last] => Err(LogError::format(
            path,
            format!(
                "a recording in {} files, {} to {}; name one of them",
                files.len(),
                first.display(),
                last.display()
            ),
        )),
    }
}

/// True if a file is a flight log by its first bytes: one of an autopilot, Parquet, or a table whose header names a time.
///
/// False where it cannot be read.
pub(crate) fn is_log(path: &Path) -> bool {
    /// Enough for the beginning of every kind, and for a header of some hundreds of columns.
    const BEGINNING: u64 = 1 << 16;
    let mut bytes = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(BEGINNING).read_to_end(&mut bytes));
    let is_table = || {
        let header = bytes.split(|byte| *byte == b'\n').next().unwrap_or_default();
        let header = String::from_utf8_lossy(header);
        let mut cells = header.split([',', ';', '\t']);
        header.contains([',', ';', '\t']) && cells.any(|cell| cell.trim().trim_matches('"') == names::TIME)
    };
    read.is_ok() && (sources::detect(&bytes).is_some() || bytes.starts_with(parquet::MAGIC) || is_table())
}

impl FlightLog {
    /// Reads a flight log; the kind of file is found from its content.
    ///
    /// Takes canonical CSV and Parquet, run folders (`telemetry.parquet`), PX4 ULog, ArduPilot DataFlash (binary and text),
    /// Crazyflie usdlog, Betaflight or INAV blackbox, MAVLink tlog, and recordings of ROS 2 (a file or its folder). A side file `NAME.toml` beside `NAME.csv` or `NAME.parquet` is read with it.
    ///
    /// # Errors
    /// Whatever the canonical format forbids, with file, row and column.
    pub fn read(path: &Path) -> Result<Self, LogError> {
        Self::read_with(path, &ReadOptions::default())
    }

    /// As [`FlightLog::read`], with options.
    ///
    /// # Errors
    /// Whatever the canonical format forbids, with file, row and column.
    pub fn read_with(path: &Path, options: &ReadOptions) -> Result<Self, LogError> {
        let recording = recording_in(path)?;
        let is_run = recording.is_none() && path.is_dir();
        let file = match recording {
            Some(file) => file,
            None if is_run => path.join(RUN_TELEMETRY),
            None => path.to_path_buf(),
        };
        if is_run && !file.exists() {
            return Err(LogError::format(
                path,
                format!("a folder without {RUN_TELEMETRY}; a run folder, or a file in this one, was expected"),
            ));
        }
        let length = std::fs::metadata(&file)
            .map_err(error::io(&file, "cannot read the log"))?
            .len();
        if length > MAX_FILE_BYTES {
            return Err(LogError::format(
                &file,
                format!("{length} bytes; logs of up to {MAX_FILE_BYTES} bytes are read"),
            ));
        }
        let bytes = std::fs::read(&file).map_err(error::io(&file, "cannot read the log"))?;
        let content_hash = format!("{:032x}", xxhash_rust::xxh3::xxh3_128(&bytes));
        // A mapping next to a table of arbitrary columns is not a side file.
        let side = if options.mapping.as_deref() == Some(&file.with_extension("toml")) {
            None
        } else {
            side_file::read_beside(&file)?
        };
        let source = |kind| LogSource {
            kind,
            path: path.to_path_buf(),
            content_hash,
        };
        if let Some(format) = sources::detect(&bytes) {
            return read_autopilot(source, &file, format, &bytes, side, options);
        }
        if let Some((mapping, layout)) = options.mapping.as_deref().map(mapping::of_table).transpose()?.flatten() {
            refuse_truth(&file, options)?;
            let parsed = if bytes.starts_with(parquet::MAGIC) {
                let (table, _) = parquet::read(&file, bytes, most_cells(options))?;
                sources::of_columns(table, &layout)
            } else {
                sources::parse_table(&bytes, &layout, most_cells(options))
            };
            let parsed = parsed.map_err(|reason| LogError::format(&file, reason))?;
            return accepted(source(SourceKind::MappedCsv), &file, &parsed, &mapping, None, options);
        }
        let most_cells = most_cells(options);
        let (kind, (mut table, kept)) = if bytes.starts_with(parquet::MAGIC) {
            let kind = if is_run {
                SourceKind::RunFolder
            } else {
                SourceKind::Parquet
            };
            (kind, parquet::read(&file, bytes, most_cells)?)
        } else {
            (SourceKind::Csv, (csv::read(&file, &bytes, most_cells)?, None))
        };
        if options.truth {
            table.take_truth().map_err(|reason| LogError::format(&file, reason))?;
        }
        let mut remapped = Vec::new();
        if let Some(path) = &options.mapping {
            let mapping = mapping::load_for_canonical(path)?;
            remapped = remap::remap(&mut table, &mapping).map_err(|reason| LogError::format(path, reason))?;
        }
        let simulated = simulated::of_columns(&table);
        let mut log = accept::accept(source(kind), table, side)?;
        log.report.flown = utc::of_times(&log.time_s);
        if let Some(kept) = kept {
            stored::Kept::restore(&kept, &mut log);
        }
        log.report.conversions.splice(0..0, remapped);
        log.report.notes.extend(simulated);
        Ok(log)
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

    /// Number of rotors according to the columns (duties, otherwise measured speeds); 0 if there are none.
    pub fn rotor_count(&self) -> usize {
        let most = |number: fn(&str) -> Option<usize>| self.columns.keys().filter_map(|name| number(name)).max();
        most(names::duty_rotor)
            .or_else(|| most(names::speed_rotor))
            .unwrap_or(0)
    }

    /// Rows per second where none is missing, Hz.
    pub fn sample_rate_hz(&self) -> f64 {
        resample::usual_rate_hz(&self.time_s)
    }

    /// From the first to the last row, s.
    pub fn duration_s(&self) -> f64 {
        match self.time_s.as_slice() {
            [first, .., last] => last - first,
            _ => 0.0,
        }
    }
}
