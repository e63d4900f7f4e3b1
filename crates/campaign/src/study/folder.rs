//! The folder of a campaign: a manifest, and shards of records that are written atomically.
//!
//! ```text
//!  campaign.json        identity of the campaign; written first
//!  campaign.lock        held while a process works on it
//!  shards/000000.parquet, 000001.parquet, …     32 flights each, in any order of appearance
//!  campaign.parquet, campaign.csv, summary.json, report.html     created from the shards, at the end of every run of the command
//! ```
//! Files are written under a temporary name and renamed, so that only complete shards remain however the process is killed; unfinished
//! flights are repeated. Nothing is synced to disk: a power failure may lose the latest shards, or leave an unreadable one, which is then
//! reported.

use super::plan::Campaign;
use super::record::{FlightRecord, columns};
use crate::table_file::Values;
use parquet::file::reader::{ChunkReader, FileReader as _, SerializedFileReader};
use parquet::record::RowAccessor as _;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::path::{Path, PathBuf};

/// Flights of a shard.
pub const SHARD_FLIGHTS: u64 = 32;

/// Number of shards for a number of flights.
pub fn shards_of(flights: u64) -> u64 {
    flights.div_ceil(SHARD_FLIGHTS)
}

/// File that identifies the campaign of a folder.
pub const MANIFEST: &str = "campaign.json";
const LOCK: &str = "campaign.lock";
const SHARDS: &str = "shards";
const PART: &str = "part";
const FORMAT: u32 = 1;

/// Identity of a folder's campaign.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Manifest {
    format: u32,
    name: String,
    program: String,
    /// Hash of the campaign document and every file that it references.
    content_hash: String,
    flights: u64,
}

/// A folder that this process has locked.
#[derive(Debug)]
pub struct CampaignFolder {
    path: PathBuf,
    flights: u64,
    /// Held until it is dropped.
    _lock: File,
}

impl Manifest {
    fn of(campaign: &Campaign) -> Result<Self, String> {
        Ok(Self {
            format: FORMAT,
            name: campaign.document().name.clone(),
            program: program(),
            content_hash: campaign.content_hash().map_err(|error| error.to_string())?,
            flights: campaign.flights(),
        })
    }

    fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("texts and numbers are JSON")
    }
}

/// The manifest of a campaign's folder, wherever it is.
///
/// # Errors
/// A file referenced by the campaign cannot be read.
pub fn manifest(campaign: &Campaign) -> Result<String, String> {
    Ok(Manifest::of(campaign)?.to_json())
}

/// Checks that the manifest `found` at `place` is that of this campaign and this program; the error message names `place`.
///
/// # Errors
/// It is not.
pub fn check_manifest(place: &str, found: &[u8], campaign: &Campaign) -> Result<(), String> {
    let wanted = Manifest::of(campaign)?;
    let known: Manifest = serde_json::from_slice(found)
        .map_err(|error| format!("{place}/{MANIFEST}: not the manifest of a campaign: {error}"))?;
    if known.format != FORMAT {
        return Err(format!(
            "{place}: was written in format {} of campaign folders, this program has {FORMAT}; name another folder with --out",
            known.format
        ));
    }
    if known.program != wanted.program {
        return Err(format!(
            "{place}: was created by {}, this is {}, whose flights may differ; choose another folder with --out",
            known.program, wanted.program
        ));
    }
    if known != wanted {
        return Err(format!(
            "{place}: holds flights of another campaign: {} or a file that it names has changed since; name another folder with --out, \
             or remove this one",
            campaign.path().display()
        ));
    }
    Ok(())
}

/// Whether this is what a campaign leaves that ended, killed or for want of space, before its manifest was written.
fn is_of_a_beginning(path: &Path) -> bool {
    let is = |name: &str| path.file_name().is_some_and(|file| file == name);
    let is_empty = || std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none());
    is(LOCK) || path.extension().is_some_and(|ending| ending == PART) || is(SHARDS) && is_empty()
}

/// Path of a shard below the folder.
pub fn shard_name(shard: u64) -> String {
    format!("{SHARDS}/{shard:06}.parquet")
}

/// The shard with this path below the folder.
pub fn shard_number(name: &str) -> Option<u64> {
    let digits = name.strip_prefix(SHARDS)?.strip_prefix('/')?.strip_suffix(".parquet")?;
    let shard = digits.parse().ok()?;
    (shard_name(shard) == name).then_some(shard)
}

/// Program and version, as in the manifest.
pub fn program() -> String {
    format!("rotortwin {}", env!("CARGO_PKG_VERSION"))
}

impl CampaignFolder {
    /// Creates the folder of `campaign` at `path`, or opens it to resume. On an error, nothing was changed.
    pub fn open(path: &Path, campaign: &Campaign) -> Result<Self, String> {
        let wanted = Manifest::of(campaign)?;
        let shown = path.display();
        let manifest_path = path.join(MANIFEST);
        let known = match std::fs::read_to_string(&manifest_path) {
            Ok(text) => Some(text),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(error) => return Err(format!("{}: cannot be read: {error}", manifest_path.display())),
        };
        match &known {
            Some(text) => check_manifest(&shown.to_string(), text.as_bytes(), campaign)?,
            None => {
                let occupied = match std::fs::read_dir(path) {
                    Ok(entries) => entries
                        .filter_map(Result::ok)
                        .any(|entry| !is_of_a_beginning(&entry.path())),
                    Err(error) if error.kind() == std::io::ErrorKind::NotFound => false,
                    Err(error) => return Err(format!("{shown}: cannot be read as a folder: {error}")),
                };
                if occupied {
                    return Err(format!(
                        "{shown}: holds files that are not those of a campaign; name another folder with --out"
                    ));
                }
                std::fs::create_dir_all(path.join(SHARDS))
                    .map_err(|error| format!("{shown}: the folder cannot be created: {error}"))?;
            }
        }
        let lock_path = path.join(LOCK);
        let lock = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(&lock_path)
            .map_err(|error| format!("{}: cannot be written: {error}", lock_path.display()))?;
        rustix::fs::flock(&lock, rustix::fs::FlockOperation::NonBlockingLockExclusive)
            .map_err(|_taken| format!("{shown}: another process is working on this campaign"))?;
        if known.is_none() {
            write_whole(&manifest_path, wanted.to_json().as_bytes())?;
        }
        let folder = Self {
            path: path.to_path_buf(),
            flights: wanted.flights,
            _lock: lock,
        };
        folder.sweep()?;
        Ok(folder)
    }

    /// As [`CampaignFolder::open`], for an existing folder.
    pub fn open_present(path: &Path, campaign: &Campaign) -> Result<Self, String> {
        if path.join(MANIFEST).is_file() {
            Self::open(path, campaign)
        } else {
            Err(format!(
                "{}: expected a folder that 'rotortwin campaign' has written, it has no {MANIFEST}",
                path.display()
            ))
        }
    }

    /// Removes incomplete files of a killed process.
    fn sweep(&self) -> Result<(), String> {
        let shards = self.path.join(SHARDS);
        std::fs::create_dir_all(&shards).map_err(|error| format!("{}: {error}", shards.display()))?;
        let entries = std::fs::read_dir(&shards).map_err(|error| format!("{}: {error}", shards.display()))?;
        for entry in entries.filter_map(Result::ok) {
            let path = entry.path();
            if path.extension().is_some_and(|extension| extension == PART) {
                std::fs::remove_file(&path)
                    .map_err(|error| format!("{}: cannot be removed: {error}", path.display()))?;
            }
        }
        Ok(())
    }

    /// Path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Shards of the whole campaign.
    pub fn shard_count(&self) -> u64 {
        shards_of(self.flights)
    }

    /// Flights of a shard.
    pub fn shard_range(&self, shard: u64) -> std::ops::Range<u64> {
        shard * SHARD_FLIGHTS..((shard + 1) * SHARD_FLIGHTS).min(self.flights)
    }

    fn shard_path(&self, shard: u64) -> PathBuf {
        self.path.join(shard_name(shard))
    }

    /// True if all its flights have been flown.
    pub fn has_shard(&self, shard: u64) -> bool {
        self.shard_path(shard).is_file()
    }

    /// The file of a shard, as it is.
    pub fn shard_bytes(&self, shard: u64) -> Result<Vec<u8>, String> {
        let path = self.shard_path(shard);
        std::fs::read(&path).map_err(|error| format!("{}: cannot be read: {error}", path.display()))
    }

    /// Stores the bytes of a shard flown elsewhere, if they belong to its flights.
    ///
    /// # Errors
    /// They do not, or cannot be written; the message names `from` if it concerns the bytes.
    pub fn put_shard(&self, shard: u64, content: &[u8], from: &str) -> Result<(), String> {
        // Reject unreadable content here, where its place can be named.
        self.records(shard, bytes::Bytes::copy_from_slice(content))
            .map_err(|reason| format!("{from}: {reason}; remove it, fly it again and merge again"))?;
        write_whole(&self.shard_path(shard), content)
    }

    /// Removes a shard that has been uploaded.
    ///
    /// # Errors
    /// The file cannot be removed.
    pub fn drop_shard(&self, shard: u64) -> Result<(), String> {
        let path = self.shard_path(shard);
        std::fs::remove_file(&path).map_err(|error| format!("{}: cannot be removed: {error}", path.display()))
    }

    /// Writes a whole shard.
    pub fn write_shard(&self, shard: u64, records: &[FlightRecord], campaign: &Campaign) -> Result<(), String> {
        let mut table = columns(records, campaign.axes(), campaign.levels());
        table.column(
            "record",
            Values::Text(records.iter().map(FlightRecord::to_json).collect()),
        );
        let path = self.shard_path(shard);
        let part = path.with_extension(PART);
        table.write_parquet(&part).map_err(|error| error.to_string())?;
        std::fs::rename(&part, &path).map_err(|error| format!("{}: cannot be written: {error}", path.display()))
    }

    /// The records of a shard, in the order of the flights.
    pub fn read_shard(&self, shard: u64) -> Result<Vec<FlightRecord>, String> {
        let path = self.shard_path(shard);
        let refuse = |reason: String| {
            format!(
                "{}: {reason}; remove the file and run the command again",
                path.display()
            )
        };
        let file = File::open(&path).map_err(|error| refuse(format!("cannot be read: {error}")))?;
        self.records(shard, file).map_err(refuse)
    }

    fn records(&self, shard: u64, file: impl ChunkReader + 'static) -> Result<Vec<FlightRecord>, String> {
        let records = read_records(file)?;
        let range = self.shard_range(shard);
        if !records.iter().map(|record| record.flight).eq(range.clone()) {
            return Err(format!(
                "does not hold the flights {} to {}",
                range.start,
                range.end - 1
            ));
        }
        Ok(records)
    }
}

/// The records of a shard file, in the order of the flights.
///
/// # Errors
/// It is not a shard of a campaign: part of a sentence, without the file's name.
pub fn read_records(file: impl ChunkReader + 'static) -> Result<Vec<FlightRecord>, String> {
    let reader = SerializedFileReader::new(file).map_err(|error| format!("not a whole Parquet file: {error}"))?;
    let schema = reader.metadata().file_metadata().schema();
    let place = schema
        .get_fields()
        .iter()
        .position(|field| field.name() == "record")
        .ok_or("has no column `record`")?;
    let rows = reader.get_row_iter(None).map_err(|error| error.to_string())?;
    rows.map(|row| {
        let row = row.map_err(|error| error.to_string())?;
        let text = row.get_string(place).map_err(|error| error.to_string())?;
        serde_json::from_str(text).map_err(|error| format!("a record cannot be read: {error}"))
    })
    .collect()
}

/// Writes a file under a temporary name and renames it.
pub fn write_whole(path: &Path, content: &[u8]) -> Result<(), String> {
    let part = path.with_extension(PART);
    let written = std::fs::write(&part, content).and_then(|()| std::fs::rename(&part, path));
    if written.is_err() {
        // The first error is the one to report.
        drop(std::fs::remove_file(&part));
    }
    written.map_err(|error| format!("{}: cannot be written: {error}", path.display()))
}
