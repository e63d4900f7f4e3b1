//! Telemetry → `telemetry.parquet`: every column of every step, in full.
//!
//! One row group per chunk of the spool, all columns required (never null), zstd. Floating-point columns are split into byte
//! streams before compression, which suits noise; codes and masks go through a dictionary.
//!
//! Parquet has no field for units, so the file's key-value metadata contains, in addition to the facts of the run, one entry
//! `rotortwin.columns`: a JSON object column → {unit, description}.

use crate::column_file::{ColumnFileWriter, Content, Field, Layout, Packing, Values};
use crate::error::{Result, StoreError};
use crate::spool::{Chunk, SpoolHeader};
use crate::summary::Summary;
use crate::telemetry::{Column, Kind};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Writes chunks of telemetry as Parquet.
pub(crate) struct ParquetSink<W: Write + Send> {
    writer: ColumnFileWriter<W>,
    kinds: Vec<Kind>,
    path: PathBuf,
}

fn field(column: &Column) -> Field {
    let (content, packing) = match column.kind {
        Kind::F64 => (Content::F64, Packing::ByteStreams),
        Kind::F32 => (Content::F32, Packing::ByteStreams),
        Kind::I32 => (Content::I32, Packing::Dictionary),
        Kind::U64 => (Content::U64, Packing::Dictionary),
    };
    let packing = if column.name == "step" {
        Packing::Differences
    } else {
        packing
    };
    Field {
        name: column.name.clone(),
        content,
        packing,
    }
}

fn metadata(header: &SpoolHeader, columns: &[Column], summary: &Summary) -> Vec<(String, String)> {
    let units: serde_json::Map<String, serde_json::Value> = columns
        .iter()
        .map(|column| {
            let entry = serde_json::json!({ "unit": column.unit, "description": column.description });
            (column.name.clone(), entry)
        })
        .collect();
    let json = |value: &dyn erased::Json| value.text();
    [
        ("run", summary.run.clone()),
        ("scenario", summary.scenario.name.clone()),
        ("scenario_text", summary.scenario.text.clone()),
        ("vehicle", summary.scenario.vehicle.clone()),
        ("seed", summary.seed.to_string()),
        ("status", summary.status.as_str().to_owned()),
        ("run_hash", summary.run_hash.clone()),
        ("model_hash", summary.model_hash.clone()),
        ("program_version", summary.program_version.clone()),
        ("rotor_count", header.rotor_count.to_string()),
        ("step_ns", header.step_ns.to_string()),
        ("conditions", json(&header.conditions)),
        ("sensor_faults", json(&header.sensor_faults)),
        ("columns", json(&units)),
    ]
    .into_iter()
    .map(|(key, value)| (key.to_owned(), value))
    .collect()
}

/// Any value as JSON text, for a table of different types.
mod erased {
    pub(super) trait Json {
        fn text(&self) -> String;
    }
    impl<T: serde::Serialize> Json for T {
        fn text(&self) -> String {
            serde_json::to_string(self).expect("maps of strings are JSON")
        }
    }
}

impl<W: Write + Send> ParquetSink<W> {
    /// Starts a file; `path` is for error messages.
    pub(crate) fn new(
        writer: W,
        path: &Path,
        header: &SpoolHeader,
        columns: &[Column],
        summary: &Summary,
    ) -> Result<Self> {
        let layout = Layout {
            name: "telemetry",
            created_by: format!("rotortwin-store {}", env!("CARGO_PKG_VERSION")),
            fields: columns.iter().map(field).collect(),
            metadata: metadata(header, columns, summary),
            coarse_statistics: true,
        };
        let writer = ColumnFileWriter::new(writer, &layout).map_err(|source| StoreError::Parquet {
            path: path.to_path_buf(),
            source,
        })?;
        Ok(Self {
            writer,
            kinds: columns.iter().map(|column| column.kind).collect(),
            path: path.to_path_buf(),
        })
    }

    /// Writes one row group.
    pub(crate) fn push(&mut self, chunk: &Chunk) -> Result<()> {
        let columns = chunk.columns.iter().zip(&self.kinds).map(|(values, kind)| match kind {
            Kind::F64 => Values::F64(values.into()),
            Kind::F32 => Values::F32(values.iter().map(|value| *value as f32).collect()),
            Kind::I32 => Values::I32(values.iter().map(|value| *value as i32).collect()),
            Kind::U64 => Values::I64(values.iter().map(|value| *value as i64).collect()),
        });
        self.writer.push(columns).map_err(|source| StoreError::Parquet {
            path: self.path.clone(),
            source,
        })
    }

    /// Completes the file.
    pub(crate) fn finish(self) -> Result<W> {
        let wrap = |source| StoreError::Parquet {
            path: self.path,
            source,
        };
        self.writer.finish().map_err(wrap)
    }
}
