//! The canonical log as Parquet: `f32` but for the time, one row group, zstd, as other tools would write it.

use crate::error::{BlindError, Result};
use crate::flight::Row;
use parquet::basic::{Compression, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{DoubleType, FloatType};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use std::path::Path;
use std::sync::Arc;

type Column = (String, Box<dyn Fn(&Row) -> f64>);

fn columns(rotors: usize) -> Vec<Column> {
    let mut columns: Vec<Column> = Vec::new();
    type Axis = fn(&Row) -> &nalgebra::Vector3<f64>;
    let vectors: [(Axis, [&str; 3]); 5] = [
        (
            |r| &r.position,
            ["position_north_m", "position_east_m", "position_down_m"],
        ),
        (
            |r| &r.velocity,
            ["velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"],
        ),
        (|r| &r.euler, ["roll_rad", "pitch_rad", "yaw_rad"]),
        (|r| &r.rates, ["roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"]),
        (|r| &r.accel, ["accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"]),
    ];
    for (vector, names) in vectors {
        for (axis, name) in names.into_iter().enumerate() {
            columns.push((name.to_owned(), Box::new(move |row| vector(row)[axis])));
        }
    }
    for i in 0..rotors {
        columns.push((format!("duty_{}", i + 1), Box::new(move |row| row.duties[i])));
    }
    columns.push(("battery_voltage_v".to_owned(), Box::new(|row| row.voltage)));
    columns
}

/// Writes a log; nothing stays of one that cannot be written to its end.
pub fn write(path: &Path, rows: &[Row]) -> Result<()> {
    let written = write_rows(path, rows);
    if written.is_err() {
        // The first error is the one to report.
        drop(std::fs::remove_file(path));
    }
    written.map_err(|error| match error {
        BlindError::Parquet(ParquetError::External(cause)) => match cause.downcast() {
            Ok(cause) => BlindError::file("writing the log", path, *cause),
            Err(cause) => BlindError::Parquet(ParquetError::External(cause)),
        },
        other => other,
    })
}

fn write_rows(path: &Path, rows: &[Row]) -> Result<()> {
    let rotors = rows.first().map_or(0, |row| row.duties.len());
    let columns = columns(rotors);
    let field = |name: &str, physical| {
        Type::primitive_type_builder(name, physical)
            .with_repetition(Repetition::REQUIRED)
            .build()
            .map(Arc::new)
    };
    let mut fields = vec![field("time_s", Physical::DOUBLE)?];
    for (name, _) in &columns {
        fields.push(field(name, Physical::FLOAT)?);
    }
    let schema = Arc::new(Type::group_type_builder("log").with_fields(fields).build()?);
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
        .set_dictionary_enabled(false)
        .build();
    let file = std::fs::File::create(path).map_err(|source| BlindError::file("creating the log", path, source))?;
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    let times: Vec<f64> = rows.iter().map(|row| row.time).collect();
    if let Some(mut column) = group.next_column()? {
        column.typed::<DoubleType>().write_batch(&times, None, None)?;
        column.close()?;
    }
    for (_, value) in &columns {
        let values: Vec<f32> = rows.iter().map(|row| value(row) as f32).collect();
        if let Some(mut column) = group.next_column()? {
            column.typed::<FloatType>().write_batch(&values, None, None)?;
            column.close()?;
        }
    }
    group.close()?;
    writer.close()?;
    Ok(())
}
