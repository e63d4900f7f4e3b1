//! One column of one row group as a stream of numbers.

use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use std::fs::File;

/// Reads a column from its first row on.
pub(super) struct ColumnStream {
    reader: ColumnReader,
    /// Definition level of a present value; 0: the column is required.
    full_level: i16,
}

impl ColumnStream {
    /// Opens column `place` of row group `group`.
    pub(super) fn open(file: &SerializedFileReader<File>, group: usize, place: usize) -> Result<Self, ParquetError> {
        let full_level = file
            .metadata()
            .file_metadata()
            .schema_descr()
            .column(place)
            .max_def_level();
        let reader = file.get_row_group(group)?.get_column_reader(place)?;
        Ok(Self { reader, full_level })
    }

    /// Skips rows; whole pages are not even decompressed.
    pub(super) fn skip(&mut self, rows: usize) -> Result<(), ParquetError> {
        if rows == 0 {
            return Ok(());
        }
        match &mut self.reader {
            ColumnReader::BoolColumnReader(reader) => reader.skip_records(rows),
            ColumnReader::Int32ColumnReader(reader) => reader.skip_records(rows),
            ColumnReader::Int64ColumnReader(reader) => reader.skip_records(rows),
            ColumnReader::FloatColumnReader(reader) => reader.skip_records(rows),
            ColumnReader::DoubleColumnReader(reader) => reader.skip_records(rows),
            _ => Err(no_numbers()),
        }
        .map(|_| ())
    }

    /// Appends the next `rows` values, fewer at the end; NaN: missing.
    pub(super) fn read(&mut self, rows: usize, into: &mut Vec<f64>) -> Result<(), ParquetError> {
        let level = self.full_level;
        match &mut self.reader {
            ColumnReader::BoolColumnReader(reader) => {
                append(reader, rows, level, into, |value| f64::from(u8::from(value)))
            }
            ColumnReader::Int32ColumnReader(reader) => append(reader, rows, level, into, f64::from),
            ColumnReader::Int64ColumnReader(reader) => append(reader, rows, level, into, |value| value as f64),
            ColumnReader::FloatColumnReader(reader) => append(reader, rows, level, into, f64::from),
            ColumnReader::DoubleColumnReader(reader) => append(reader, rows, level, into, |value| value),
            _ => Err(no_numbers()),
        }
    }
}

fn no_numbers() -> ParquetError {
    ParquetError::General("the column holds no numbers".to_owned())
}

fn append<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    rows: usize,
    full_level: i16,
    into: &mut Vec<f64>,
    number: impl Fn(T::T) -> f64,
) -> Result<(), ParquetError> {
    let mut values = Vec::with_capacity(rows);
    if full_level == 0 {
        reader.read_records(rows, None, None, &mut values)?;
        into.extend(values.into_iter().map(number));
        return Ok(());
    }
    let mut levels = Vec::with_capacity(rows);
    let (records, ..) = reader.read_records(rows, Some(&mut levels), None, &mut values)?;
    let mut values = values.into_iter().map(number);
    for at in 0..records {
        let there = levels.get(at) == Some(&full_level);
        into.push(if there {
            values.next().unwrap_or(f64::NAN)
        } else {
            f64::NAN
        });
    }
    Ok(())
}
