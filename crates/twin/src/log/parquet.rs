//! Parquet logs: flat columns of numbers; null = missing.
//!
//! Read: any flat schema with double, float, integer or Boolean columns; zstd, snappy or no compression. Text columns are named in
//! the report. Written: f64 columns, optional (null = no value), zstd.

use super::stored::Kept;
use super::table::{RawColumn, Table};
use super::{FlightLog, LogError, MAX_COLUMNS, error, names};
use parquet::column::reader::ColumnReader;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use rotortwin_store::column_file::{ColumnFileWriter, Content, Field, Layout, Packing, Values};
use std::path::Path;

/// How a Parquet file begins.
pub(crate) const MAGIC: &[u8] = b"PAR1";

/// Rows read at a time.
const BATCH: usize = 16_384;

/// Key under which a stored import keeps information about its source.
const KEPT: &str = "import";

/// Reads the table of a Parquet file, and the information that a stored import kept about its source.
///
/// The decoder panics on some damaged pages (an index past the end in `byte_stream_split`, parquet 60.1); here that
/// becomes an error.
pub(crate) fn read(path: &Path, bytes: Vec<u8>, most_cells: usize) -> Result<(Table, Option<String>), LogError> {
    std::panic::catch_unwind(|| decode(path, bytes, most_cells)).unwrap_or_else(|_| {
        Err(LogError::format(
            path,
            "the file is damaged: its pages cannot be decoded",
        ))
    })
}

fn decode(path: &Path, bytes: Vec<u8>, most_cells: usize) -> Result<(Table, Option<String>), LogError> {
    let wrap = |source: ParquetError| LogError::format(path, format!("not a Parquet file that can be read: {source}"));
    let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).map_err(wrap)?;
    let metadata = reader.metadata();
    let schema = metadata.file_metadata().schema_descr_ptr();
    if schema.num_columns() == 0 {
        return Err(LogError::format(path, "the file has no columns"));
    }
    if schema.num_columns() > MAX_COLUMNS {
        return Err(LogError::format(
            path,
            format!(
                "{} columns are more than the {MAX_COLUMNS} that this program takes",
                schema.num_columns()
            ),
        ));
    }
    let promised = usize::try_from(metadata.file_metadata().num_rows()).unwrap_or(usize::MAX);
    // Memory is allocated according to the sizes that the groups state.
    let grouped = metadata.row_groups().iter().try_fold(0_usize, |sum, group| {
        usize::try_from(group.num_rows())
            .ok()
            .and_then(|rows| sum.checked_add(rows))
    });
    if grouped != Some(promised) {
        return Err(LogError::format(
            path,
            "the file is damaged: its row groups do not have the declared number of rows",
        ));
    }
    if promised > most_cells / schema.num_columns() {
        return Err(LogError::format(
            path,
            format!(
                "{promised} rows of {} columns are more than this program takes",
                schema.num_columns()
            ),
        ));
    }
    let mut columns = Vec::new();
    for (index, column) in schema.columns().iter().enumerate() {
        let name = column.path().string();
        if column.max_rep_level() > 0 {
            return Err(LogError::column(path, &name, "expected one number per row, got a list"));
        }
        if columns.iter().any(|other: &RawColumn| other.name == name) {
            return Err(LogError::column(path, &name, "duplicate column name in the schema"));
        }
        let mut raw = RawColumn::new(&name);
        for group in 0..reader.num_row_groups() {
            let group = reader.get_row_group(group).map_err(wrap)?;
            let expected = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
            let before = raw.values.len();
            raw.values.reserve_exact(expected);
            read_column(
                group.get_column_reader(index).map_err(wrap)?,
                column.max_def_level(),
                expected,
                &mut raw,
            )
            .map_err(|source| LogError::column(path, &name, format!("the file is damaged: {source}")))?;
            if raw.values.len() != before + expected {
                return Err(LogError::column(
                    path,
                    &name,
                    "the file is damaged: it has fewer rows than it declares",
                ));
            }
        }
        columns.push(raw);
    }
    let facts = metadata.file_metadata().key_value_metadata();
    let kept = facts.and_then(|facts| {
        facts
            .iter()
            .find(|fact| fact.key.strip_prefix("rotortwin.") == Some(KEPT))?
            .value
            .clone()
    });
    Ok((Table { columns }, kept))
}

/// Appends the cells of one column of one row group; text becomes bad cells.
fn read_column(reader: ColumnReader, full_level: i16, rows: usize, into: &mut RawColumn) -> Result<(), ParquetError> {
    macro_rules! numbers {
        ($reader:expr, $number:expr) => {{
            let mut reader = $reader;
            let mut done = 0;
            while done < rows {
                let (mut levels, mut values) = (Vec::new(), Vec::new());
                let (records, _, _) =
                    reader.read_records(BATCH.min(rows - done), Some(&mut levels), None, &mut values)?;
                if records == 0 {
                    break;
                }
                done += records;
                let mut values = values.iter().map($number);
                for record in 0..records {
                    if full_level > 0 && levels.get(record) != Some(&full_level) {
                        into.values.push(f64::NAN);
                        continue;
                    }
                    match values.next() {
                        Some(Ok(value)) if value.is_finite() => into.values.push(value),
                        Some(Ok(value)) => into.push_bad(&value.to_string()),
                        Some(Err(text)) => into.push_bad(&text),
                        None => return Err(ParquetError::General("values are missing".to_owned())),
                    }
                }
            }
        }};
    }
    let text = |bytes: &[u8]| Err::<f64, String>(String::from_utf8_lossy(bytes).into_owned());
    match reader {
        ColumnReader::DoubleColumnReader(reader) => numbers!(reader, |value: &f64| Ok::<f64, String>(*value)),
        ColumnReader::FloatColumnReader(reader) => numbers!(reader, |value: &f32| Ok::<f64, String>(f64::from(*value))),
        ColumnReader::Int32ColumnReader(reader) => numbers!(reader, |value: &i32| Ok::<f64, String>(f64::from(*value))),
        ColumnReader::Int64ColumnReader(reader) => numbers!(reader, |value: &i64| Ok::<f64, String>(*value as f64)),
        ColumnReader::BoolColumnReader(reader) => {
            numbers!(reader, |value: &bool| Ok::<f64, String>(f64::from(u8::from(*value))));
        }
        ColumnReader::Int96ColumnReader(reader) => {
            numbers!(reader, |_value: &parquet::data_type::Int96| Err::<f64, String>(
                "a date".to_owned()
            ));
        }
        ColumnReader::ByteArrayColumnReader(reader) => {
            numbers!(reader, |value: &parquet::data_type::ByteArray| text(value.data()));
        }
        ColumnReader::FixedLenByteArrayColumnReader(reader) => {
            numbers!(reader, |value: &parquet::data_type::FixedLenByteArray| text(
                value.data()
            ));
        }
    }
    Ok(())
}

impl FlightLog {
    /// Writes the log as Parquet: f64 columns, null = no value, zstd; units in the metadata.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_parquet(&self, path: &Path) -> Result<(), LogError> {
        let file = std::fs::File::create(path).map_err(error::io(path, "cannot write the log"))?;
        self.write_parquet_to(file)
            .map_err(|source| LogError::format(path, format!("cannot write Parquet: {source}")))
    }

    fn write_parquet_to(&self, file: std::fs::File) -> Result<(), ParquetError> {
        let mut columns = vec![(names::TIME, self.time_s.as_slice())];
        columns.extend(self.columns_in_order());
        let units = columns
            .iter()
            .filter_map(|(name, _)| Some(format!("{name}: {}", names::unit(name)?)))
            .collect::<Vec<_>>();
        let mut metadata = vec![
            ("log".to_owned(), self.name.clone()),
            ("source_hash".to_owned(), self.source.content_hash.clone()),
            ("units".to_owned(), units.join("; ")),
        ];
        metadata.extend(Kept::of(self).map(|kept| (KEPT.to_owned(), kept)));
        let fields = columns.iter().map(|(name, _)| Field {
            name: (*name).to_owned(),
            content: Content::OptionalF64,
            packing: Packing::ByteStreams,
        });
        let layout = Layout {
            name: "flight_log",
            created_by: format!("rotortwin-twin {}", env!("CARGO_PKG_VERSION")),
            fields: fields.collect(),
            metadata,
            coarse_statistics: false,
        };
        let mut writer = ColumnFileWriter::new(file, &layout)?;
        writer.push(columns.iter().map(|(_, values)| Values::F64((*values).into())))?;
        writer.finish()?;
        Ok(())
    }
}
