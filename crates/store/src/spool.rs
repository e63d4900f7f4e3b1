//! The spool: an append-only file with one row per step, written during the run.
//!
//! ```text
//! "RTSPOOL1" · format version u32 · header length u32 · header (JSON, [`SpoolHeader`]) · row · row · row …
//! ```
//!
//! All numbers are little-endian. A row has a fixed size and holds each column in its own type (an f32 stays an f32), which
//! halves the size compared with rows of f64, and with it the cost of a row.
//!
//! Crash safety: rows are appended through a buffer of 256 KiB, so a killed process loses at most the rows in that buffer (about
//! 0.5 s of a hexarotor's flight at 400 Hz; [`SpoolWriter::flush`] shortens that). A file that ends within a row is read up to
//! the last complete one. Nothing is synced to disk: a power failure may lose more.
//!
//! The spool is a working file. It has no index and no compression, its format may change with any version of the program, and
//! [`finalise`](crate::run_folder::finalise) removes it.

use crate::error::{Result, StoreError, io};
use crate::telemetry::{Column, Kind, TelemetryRow, row_bytes, telemetry_columns};
use rotortwin_flight_core::MAX_ROTORS;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

const MAGIC: [u8; 8] = *b"RTSPOOL1";
const VERSION: u32 = 1;
/// Magic, version, header length.
const PREFIX_BYTES: usize = 16;
/// Maximum plausible header size; a real one has about 15 KiB.
const HEADER_LIMIT: usize = 16 << 20;
/// One write to the kernel per this many bytes.
const BUFFER_BYTES: usize = 256 << 10;
/// Rows of one [`Chunk`]: one row group in Parquet, about 50 MB of numbers for a hexarotor.
pub(crate) const CHUNK_ROWS: usize = 65_536;

/// Metadata in a spool.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SpoolHeader {
    /// Number of rotors of the vehicle, 1 to [`MAX_ROTORS`].
    pub rotor_count: usize,
    /// Length of a step, ns.
    pub step_ns: u64,
    /// Meaning of the codes of `rotor_condition_i`, e.g. 1 → "blade b"; 0 is healthy and needs no entry.
    #[serde(default)]
    pub conditions: BTreeMap<i32, String>,
    /// Meaning of the bits of `sensor_faults`, from bit 0.
    #[serde(default)]
    pub sensor_faults: Vec<String>,
    /// Rotor hubs relative to the centre of mass, FRD, m, for drawing the vehicle. Empty: unknown.
    #[serde(default)]
    pub rotor_positions_body_m: Vec<[f64; 3]>,
    /// Hover thrust of a rotor, N: scales the arrows. 0: unknown.
    #[serde(default)]
    pub hover_thrust_n: f64,
    /// Loads dropped in flight, in the order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub dropped_loads: Vec<DroppedLoad>,
}

/// A load that the vehicle drops.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DroppedLoad {
    /// s; the step that begins then is the first without it.
    pub time_s: f64,
    /// kg.
    pub mass_kg: f64,
}

/// The header as stored in the file.
#[derive(Serialize, Deserialize)]
struct FileHeader {
    run: SpoolHeader,
    columns: Vec<Column>,
}

/// Appends rows to a spool.
#[derive(Debug)]
pub struct SpoolWriter {
    file: File,
    path: PathBuf,
    rotor_count: usize,
    row_bytes: usize,
    buffer: Vec<u8>,
    filled: usize,
    rows: u64,
    /// A write failed, possibly half-way through a row: nothing may follow it.
    broken: bool,
}

impl SpoolWriter {
    /// Creates a spool at `path`; fails if the file exists.
    pub fn create(path: &Path, header: &SpoolHeader) -> Result<Self> {
        if header.rotor_count == 0 || header.rotor_count > MAX_ROTORS {
            return Err(StoreError::RotorCount {
                count: header.rotor_count,
            });
        }
        let columns = telemetry_columns(header.rotor_count);
        let row_bytes = row_bytes(&columns);
        let json = serde_json::to_vec(&FileHeader {
            run: header.clone(),
            columns,
        })
        .expect("a header of strings and integers is JSON");
        let mut file = File::create_new(path).map_err(io(path, "cannot create the spool"))?;
        let mut start = Vec::with_capacity(PREFIX_BYTES + json.len());
        start.extend_from_slice(&MAGIC);
        start.extend_from_slice(&VERSION.to_le_bytes());
        start.extend_from_slice(&(json.len() as u32).to_le_bytes());
        start.extend_from_slice(&json);
        file.write_all(&start).map_err(io(path, "cannot write the spool"))?;
        let capacity = (BUFFER_BYTES / row_bytes).max(1) * row_bytes;
        Ok(Self {
            file,
            path: path.to_path_buf(),
            rotor_count: header.rotor_count,
            row_bytes,
            buffer: vec![0; capacity],
            filled: 0,
            rows: 0,
            broken: false,
        })
    }

    /// Appends a row.
    #[inline]
    pub fn push(&mut self, row: &TelemetryRow) -> Result<()> {
        if self.filled == self.buffer.len() {
            self.flush()?;
        }
        row.encode(
            self.rotor_count,
            &mut self.buffer[self.filled..self.filled + self.row_bytes],
        );
        self.filled += self.row_bytes;
        self.rows += 1;
        Ok(())
    }

    /// Passes the buffered rows to the kernel: they survive the death of this process.
    pub fn flush(&mut self) -> Result<()> {
        const ACTION: &str = "cannot write the spool";
        if self.broken {
            return Err(io(&self.path, ACTION)(std::io::Error::other("an earlier write failed")));
        }
        let written = self.file.write_all(&self.buffer[..self.filled]);
        self.broken = written.is_err();
        self.filled = 0;
        written.map_err(io(&self.path, ACTION))
    }

    /// Rows appended so far.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Completes the spool, returning an error that dropping it would swallow.
    pub fn finish(mut self) -> Result<u64> {
        self.flush()?;
        Ok(self.rows)
    }
}

impl Drop for SpoolWriter {
    fn drop(&mut self) {
        // Best effort: call `finish` to get the error.
        drop(self.flush());
    }
}

/// Some consecutive rows, column by column, as f64 (codes, masks and step numbers below 2^53 are exact).
#[derive(Debug)]
pub struct Chunk {
    /// Number of its first row.
    pub first_row: u64,
    /// Rows in it.
    pub len: usize,
    /// One vector of `len` values per column of the schema.
    pub columns: Vec<Vec<f64>>,
}

/// Reads a spool.
#[derive(Debug)]
pub struct SpoolReader {
    file: File,
    path: PathBuf,
    header: SpoolHeader,
    columns: Vec<Column>,
    row_bytes: usize,
    first_row_at: u64,
    rows: u64,
}

impl SpoolReader {
    /// Opens a spool; rows appended later are not seen.
    pub fn open(path: &Path) -> Result<Self> {
        let bad = |reason: String| StoreError::NotASpool {
            path: path.to_path_buf(),
            reason,
        };
        let mut file = File::open(path).map_err(io(path, "cannot open the spool"))?;
        let mut prefix = [0; PREFIX_BYTES];
        file.read_exact(&mut prefix)
            .map_err(|error| bad(format!("it ends within its first {PREFIX_BYTES} bytes ({error})")))?;
        let word = |at: usize| u32::from_le_bytes([prefix[at], prefix[at + 1], prefix[at + 2], prefix[at + 3]]);
        if prefix[..8] != MAGIC {
            return Err(bad("it does not begin with RTSPOOL1".to_owned()));
        }
        if word(8) != VERSION {
            return Err(bad(format!(
                "format version {}; this program reads version {VERSION}",
                word(8)
            )));
        }
        let header_len = word(12) as usize;
        if header_len > HEADER_LIMIT {
            return Err(bad(format!("its header claims {header_len} bytes")));
        }
        let mut json = vec![0; header_len];
        file.read_exact(&mut json)
            .map_err(|error| bad(format!("it ends within its header ({error})")))?;
        let FileHeader { run: header, columns } =
            serde_json::from_slice(&json).map_err(|error| bad(format!("its header is damaged ({error})")))?;
        if header.rotor_count > MAX_ROTORS || columns != telemetry_columns(header.rotor_count) {
            return Err(bad(
                "its columns are not those of this version of the program".to_owned()
            ));
        }
        let row_bytes = row_bytes(&columns);
        let first_row_at = (PREFIX_BYTES + header_len) as u64;
        let length = file
            .metadata()
            .map_err(io(path, "cannot read the size of the spool"))?
            .len();
        let rows = length.saturating_sub(first_row_at) / row_bytes as u64;
        Ok(Self {
            file,
            path: path.to_path_buf(),
            header,
            columns,
            row_bytes,
            first_row_at,
            rows,
        })
    }

    /// Metadata of the spool.
    pub fn header(&self) -> &SpoolHeader {
        &self.header
    }

    /// The schema.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Complete rows.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Passes all rows to `take`, in order, in chunks of bounded size; not called if there are no rows.
    pub fn for_each_chunk(&mut self, mut take: impl FnMut(&Chunk) -> Result<()>) -> Result<()> {
        self.file
            .seek(SeekFrom::Start(self.first_row_at))
            .map_err(io(&self.path, "cannot read the spool"))?;
        let most = CHUNK_ROWS.min(usize::try_from(self.rows).unwrap_or(CHUNK_ROWS));
        let mut bytes = vec![0; most * self.row_bytes];
        let mut chunk = Chunk {
            first_row: 0,
            len: 0,
            columns: vec![Vec::with_capacity(most); self.columns.len()],
        };
        while chunk.first_row < self.rows {
            chunk.len = most.min(usize::try_from(self.rows - chunk.first_row).unwrap_or(most));
            let bytes = &mut bytes[..chunk.len * self.row_bytes];
            self.file
                .read_exact(bytes)
                .map_err(io(&self.path, "cannot read the spool"))?;
            transpose(bytes, self.row_bytes, &self.columns, &mut chunk.columns);
            take(&chunk)?;
            chunk.first_row += chunk.len as u64;
        }
        Ok(())
    }
}

/// Converts rows of bytes to columns of numbers, in blocks of rows that fit in the cache.
fn transpose(bytes: &[u8], row_bytes: usize, schema: &[Column], columns: &mut [Vec<f64>]) {
    const BLOCK_ROWS: usize = 512;
    columns.iter_mut().for_each(Vec::clear);
    for block in bytes.chunks(BLOCK_ROWS * row_bytes) {
        let mut at = 0;
        for (column, values) in schema.iter().zip(columns.iter_mut()) {
            let rows = block.chunks_exact(row_bytes);
            match column.kind {
                Kind::F64 => values.extend(rows.map(|row| f64::from_le_bytes(array(row, at)))),
                Kind::F32 => values.extend(rows.map(|row| f64::from(f32::from_le_bytes(array(row, at))))),
                Kind::I32 => values.extend(rows.map(|row| f64::from(i32::from_le_bytes(array(row, at))))),
                Kind::U64 => values.extend(rows.map(|row| u64::from_le_bytes(array(row, at)) as f64)),
            }
            at += column.kind.bytes();
        }
    }
}

#[inline(always)]
fn array<const N: usize>(row: &[u8], at: usize) -> [u8; N] {
    row[at..at + N].try_into().expect("the slice has N bytes")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    fn header() -> SpoolHeader {
        SpoolHeader {
            rotor_count: 6,
            step_ns: 2_500_000,
            ..SpoolHeader::default()
        }
    }

    fn write(path: &Path, rows: u64) {
        let mut spool = SpoolWriter::create(path, &header()).unwrap();
        for step in 0..rows {
            spool.push(&synthetic::row(step)).unwrap();
        }
        assert_eq!(spool.finish().unwrap(), rows);
    }

    /// Row `at` of the spool must contain exactly `synthetic::row(at)`.
    fn assert_rows(path: &Path, expected: u64) {
        let mut spool = SpoolReader::open(path).unwrap();
        assert_eq!(spool.rows(), expected);
        let mut seen = 0;
        let mut numbers = vec![0.0; spool.columns().len()];
        spool
            .for_each_chunk(|chunk| {
                for at in 0..chunk.len {
                    synthetic::row(chunk.first_row + at as u64).fill(6, &mut numbers);
                    for (column, number) in chunk.columns.iter().zip(&numbers) {
                        assert_eq!(column[at].to_bits(), number.to_bits());
                    }
                    seen += 1;
                }
                Ok(())
            })
            .unwrap();
        assert_eq!(seen, expected);
    }

    #[test]
    fn val_rows_come_back_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("spool");
        write(&path, 3000);
        assert_rows(&path, 3000);
    }

    #[test]
    fn val_rows_come_back_across_chunks() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("spool");
        let rows = CHUNK_ROWS as u64 + 100;
        write(&path, rows);
        assert_rows(&path, rows);
    }

    #[test]
    fn val_truncated_last_row_is_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("spool");
        write(&path, 10);
        let length = std::fs::metadata(&path).unwrap().len();
        File::options()
            .write(true)
            .open(&path)
            .unwrap()
            .set_len(length - 1)
            .unwrap();
        assert_rows(&path, 9);
    }

    #[test]
    fn val_flushed_rows_survive_a_writer_that_never_ends() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("spool");
        let mut spool = SpoolWriter::create(&path, &header()).unwrap();
        for step in 0..5 {
            spool.push(&synthetic::row(step)).unwrap();
        }
        spool.flush().unwrap();
        spool.push(&synthetic::row(5)).unwrap();
        std::mem::forget(spool);
        assert_rows(&path, 5);
    }

    #[test]
    fn val_other_files_are_refused_with_a_reason() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("spool");
        for (content, reason) in [
            (&b""[..], "first 16 bytes"),
            (&b"PAR1aaaaaaaaaaaaaaaaaaaa"[..], "RTSPOOL1"),
            (&b"RTSPOOL1\x09\x00\x00\x00\x02\x00\x00\x00{}"[..], "version 9"),
            (&b"RTSPOOL1\x01\x00\x00\x00\xff\x00\x00\x00{}"[..], "within its header"),
            (&b"RTSPOOL1\x01\x00\x00\x00\x02\x00\x00\x00{}"[..], "damaged"),
        ] {
            std::fs::write(&path, content).unwrap();
            let message = SpoolReader::open(&path).unwrap_err().to_string();
            assert!(message.contains(reason), "{message}");
        }
        assert!(matches!(
            SpoolWriter::create(
                &folder.path().join("n"),
                &SpoolHeader {
                    rotor_count: 17,
                    ..header()
                }
            ),
            Err(StoreError::RotorCount { count: 17 })
        ));
    }
}
