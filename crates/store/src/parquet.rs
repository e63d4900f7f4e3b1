//! Telemetry → `telemetry.parquet`: every column of every step, in full.
//!
//! One row group per chunk of the spool, all columns required (never null), zstd. Floating-point columns are split into byte
//! streams before compression, which suits noise; codes and masks go through a dictionary.
//!
//! Parquet has no field for units, so the file's key-value metadata contains, in addition to the facts of the run, one entry
//! `rotortwin.columns`: a JSON object column → {unit, description}.

use crate::error::{Result, StoreError};
use crate::spool::{Chunk, SpoolHeader};
use crate::summary::Summary;
use crate::telemetry::{Column, Kind};
use parquet::basic::{Compression, Encoding, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{DoubleType, FloatType, Int32Type, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnPath, Type};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// zstd level: noise does not compress; level 3 made the file of a 90 s flight 0.8 % smaller.
const ZSTD_LEVEL: i32 = 1;

/// Writes chunks of telemetry as Parquet.
pub(crate) struct ParquetSink<W: Write + Send> {
    writer: SerializedFileWriter<W>,
    kinds: Vec<Kind>,
    path: PathBuf,
}

fn schema(columns: &[Column]) -> std::result::Result<Type, ParquetError> {
    let fields = columns
        .iter()
        .map(|column| {
            let (physical, logical) = match column.kind {
                Kind::F64 => (Physical::DOUBLE, None),
                Kind::F32 => (Physical::FLOAT, None),
                Kind::I32 => (Physical::INT32, None),
                Kind::U64 => (Physical::INT64, Some(LogicalType::integer(64, false))),
            };
            Type::primitive_type_builder(&column.name, physical)
                .with_repetition(Repetition::REQUIRED)
                .with_logical_type(logical)
                .build()
                .map(Arc::new)
        })
        .collect::<std::result::Result<_, _>>()?;
    Type::group_type_builder("telemetry").with_fields(fields).build()
}

fn metadata(header: &SpoolHeader, columns: &[Column], summary: &Summary) -> Vec<KeyValue> {
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
    .map(|(key, value)| KeyValue::new(format!("rotortwin.{key}"), value))
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
        let wrap = |source| StoreError::Parquet {
            path: path.to_path_buf(),
            source,
        };
        let level = ZstdLevel::try_new(ZSTD_LEVEL).map_err(wrap)?;
        let mut properties = WriterProperties::builder()
            .set_created_by(format!("rotortwin-store {}", env!("CARGO_PKG_VERSION")))
            .set_compression(Compression::ZSTD(level))
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .set_key_value_metadata(Some(metadata(header, columns, summary)));
        for column in columns {
            let path = ColumnPath::from(column.name.as_str());
            properties = match column.kind {
                Kind::F64 | Kind::F32 => properties
                    .set_column_dictionary_enabled(path.clone(), false)
                    .set_column_encoding(path, Encoding::BYTE_STREAM_SPLIT),
                Kind::I32 | Kind::U64 if column.name != "step" => properties,
                Kind::I32 | Kind::U64 => properties
                    .set_column_dictionary_enabled(path.clone(), false)
                    .set_column_encoding(path, Encoding::DELTA_BINARY_PACKED),
            };
        }
        let schema = Arc::new(schema(columns).map_err(wrap)?);
        let writer = SerializedFileWriter::new(writer, schema, Arc::new(properties.build())).map_err(wrap)?;
        let kinds = columns.iter().map(|column| column.kind).collect();
        Ok(Self {
            writer,
            kinds,
            path: path.to_path_buf(),
        })
    }

    /// Writes one row group.
    pub(crate) fn push(&mut self, chunk: &Chunk) -> Result<()> {
        self.write_group(chunk).map_err(|source| StoreError::Parquet {
            path: self.path.clone(),
            source,
        })
    }

    fn write_group(&mut self, chunk: &Chunk) -> std::result::Result<(), ParquetError> {
        let mut group = self.writer.next_row_group()?;
        for (values, kind) in chunk.columns.iter().zip(&self.kinds) {
            let mut column = group
                .next_column()?
                .ok_or_else(|| ParquetError::General("the schema has fewer columns than the spool".to_owned()))?;
            match kind {
                Kind::F64 => column.typed::<DoubleType>().write_batch(values, None, None)?,
                Kind::F32 => {
                    let values: Vec<f32> = values.iter().map(|value| *value as f32).collect();
                    column.typed::<FloatType>().write_batch(&values, None, None)?
                }
                Kind::I32 => {
                    let values: Vec<i32> = values.iter().map(|value| *value as i32).collect();
                    column.typed::<Int32Type>().write_batch(&values, None, None)?
                }
                Kind::U64 => {
                    let values: Vec<i64> = values.iter().map(|value| *value as i64).collect();
                    column.typed::<Int64Type>().write_batch(&values, None, None)?
                }
            };
            column.close()?;
        }
        group.close()?;
        Ok(())
    }

    /// Completes the file.
    pub(crate) fn finish(self) -> Result<W> {
        let wrap = |source| StoreError::Parquet {
            path: self.path,
            source,
        };
        self.writer.into_inner().map_err(wrap)
    }
}
