//! Parquet files of flat columns: schema, packing, metadata and row groups, for every such file that the product writes. (The blind bench
//! writes its own: it shares no code with the product.)
//!
//! Compressed with zstd, level 1: noise does not compress, and level 3 made the telemetry of a 90 s flight 0.8 % smaller.

use parquet::basic::{Compression, Encoding, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, FloatType, Int32Type, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnPath, Type};
use std::borrow::Cow;
use std::io::Write;
use std::sync::Arc;

const ZSTD_LEVEL: i32 = 1;

/// What a column holds. A value is never null, except in [`Content::OptionalF64`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// Texts.
    Text,
    /// 32-bit integers.
    I32,
    /// 64-bit integers.
    I64,
    /// Unsigned 64-bit integers, passed as [`Values::I64`].
    U64,
    /// Single-precision numbers.
    F32,
    /// Double-precision numbers.
    F64,
    /// Double-precision numbers; NaN is written as null.
    OptionalF64,
}

/// How a column is encoded before compression.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// A dictionary as long as it is small: suits codes, masks and texts.
    Dictionary,
    /// The bytes of floating-point numbers in separate streams: suits noise.
    ByteStreams,
    /// Differences: suits counters.
    Differences,
}

/// A column of a file.
#[derive(Clone, Debug)]
pub struct Field {
    /// Name.
    pub name: String,
    /// Type of its values.
    pub content: Content,
    /// Encoding.
    pub packing: Packing,
}

/// Everything about a file but its rows.
#[derive(Clone, Debug)]
pub struct Layout {
    /// Name of the schema.
    pub name: &'static str,
    /// Program and version.
    pub created_by: String,
    /// Columns in order.
    pub fields: Vec<Field>,
    /// Key-value metadata; each key gets the prefix `rotortwin.`.
    pub metadata: Vec<(String, String)>,
    /// Statistics for each row group only, not for each page.
    pub coarse_statistics: bool,
}

/// Values of one column in one row group.
#[derive(Debug)]
pub enum Values<'a> {
    /// Texts.
    Text(Vec<&'a str>),
    /// 32-bit integers.
    I32(Cow<'a, [i32]>),
    /// 64-bit integers.
    I64(Cow<'a, [i64]>),
    /// Single-precision numbers.
    F32(Cow<'a, [f32]>),
    /// Double-precision numbers.
    F64(Cow<'a, [f64]>),
}

/// Writes a file, one row group at a time.
#[expect(missing_debug_implementations, reason = "the writer of the library has none")]
pub struct ColumnFileWriter<W: Write + Send> {
    writer: SerializedFileWriter<W>,
    contents: Vec<Content>,
}

fn schema(layout: &Layout) -> Result<Type, ParquetError> {
    let fields = layout
        .fields
        .iter()
        .map(|field| {
            let (physical, logical) = match field.content {
                Content::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
                Content::I32 => (Physical::INT32, None),
                Content::I64 => (Physical::INT64, None),
                Content::U64 => (Physical::INT64, Some(LogicalType::integer(64, false))),
                Content::F32 => (Physical::FLOAT, None),
                Content::F64 | Content::OptionalF64 => (Physical::DOUBLE, None),
            };
            let repetition = if field.content == Content::OptionalF64 {
                Repetition::OPTIONAL
            } else {
                Repetition::REQUIRED
            };
            Type::primitive_type_builder(&field.name, physical)
                .with_repetition(repetition)
                .with_logical_type(logical)
                .build()
                .map(Arc::new)
        })
        .collect::<Result<_, _>>()?;
    Type::group_type_builder(layout.name).with_fields(fields).build()
}

fn properties(layout: &Layout) -> Result<WriterProperties, ParquetError> {
    let mut properties = WriterProperties::builder()
        .set_created_by(layout.created_by.clone())
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(ZSTD_LEVEL)?));
    if layout.coarse_statistics {
        properties = properties.set_statistics_enabled(EnabledStatistics::Chunk);
    }
    if !layout.metadata.is_empty() {
        let entries = layout.metadata.iter();
        let entries = entries.map(|(key, value)| KeyValue::new(format!("rotortwin.{key}"), value.clone()));
        properties = properties.set_key_value_metadata(Some(entries.collect()));
    }
    for field in &layout.fields {
        let encoding = match field.packing {
            Packing::Dictionary => continue,
            Packing::ByteStreams => Encoding::BYTE_STREAM_SPLIT,
            Packing::Differences => Encoding::DELTA_BINARY_PACKED,
        };
        let path = ColumnPath::from(field.name.as_str());
        properties = properties
            .set_column_dictionary_enabled(path.clone(), false)
            .set_column_encoding(path, encoding);
    }
    Ok(properties.build())
}

/// Texts as the library takes them; neighbours that are the same text in memory share their bytes.
fn byte_arrays(texts: &[&str]) -> Vec<ByteArray> {
    let mut arrays: Vec<ByteArray> = Vec::with_capacity(texts.len());
    for (at, text) in texts.iter().enumerate() {
        arrays.push(match arrays.last() {
            Some(last) if std::ptr::eq(texts[at - 1], *text) => last.clone(),
            _ => ByteArray::from(*text),
        });
    }
    arrays
}

impl<W: Write + Send> ColumnFileWriter<W> {
    /// Starts a file; no row is written yet.
    ///
    /// # Errors
    /// The schema is impossible (duplicate or empty names), or `writer` fails.
    pub fn new(writer: W, layout: &Layout) -> Result<Self, ParquetError> {
        let writer = SerializedFileWriter::new(writer, Arc::new(schema(layout)?), Arc::new(properties(layout)?))?;
        let contents = layout.fields.iter().map(|field| field.content).collect();
        Ok(Self { writer, contents })
    }

    /// Adds a row group; `columns` are those of the layout, in its order and with its types.
    ///
    /// # Errors
    /// There are more columns than in the layout, their lengths differ, or the writer fails.
    ///
    /// # Panics
    /// The type of a column is not that of the layout.
    pub fn push<'a>(&mut self, columns: impl IntoIterator<Item = Values<'a>>) -> Result<(), ParquetError> {
        let mut group = self.writer.next_row_group()?;
        for (values, content) in columns.into_iter().zip(&self.contents) {
            let mut column = group
                .next_column()?
                .ok_or_else(|| ParquetError::General("more columns than in the layout".to_owned()))?;
            match values {
                Values::Text(texts) => column
                    .typed::<ByteArrayType>()
                    .write_batch(&byte_arrays(&texts), None, None)?,
                Values::I32(values) => column.typed::<Int32Type>().write_batch(&values, None, None)?,
                Values::I64(values) => column.typed::<Int64Type>().write_batch(&values, None, None)?,
                Values::F32(values) => column.typed::<FloatType>().write_batch(&values, None, None)?,
                Values::F64(values) if *content == Content::OptionalF64 => {
                    let levels: Vec<i16> = values.iter().map(|value| i16::from(!value.is_nan())).collect();
                    let present: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
                    column
                        .typed::<DoubleType>()
                        .write_batch(&present, Some(&levels), None)?
                }
                Values::F64(values) => column.typed::<DoubleType>().write_batch(&values, None, None)?,
            };
            column.close()?;
        }
        group.close()?;
        Ok(())
    }

    /// Completes the file.
    ///
    /// # Errors
    /// The writer fails.
    pub fn finish(self) -> Result<W, ParquetError> {
        self.writer.into_inner()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use parquet::record::RowAccessor as _;

    fn field(name: &str, content: Content, packing: Packing) -> Field {
        Field {
            name: name.to_owned(),
            content,
            packing,
        }
    }

    #[test]
    fn val_every_type_reads_back() {
        let layout = Layout {
            name: "test",
            created_by: "test 1".to_owned(),
            fields: vec![
                field("text", Content::Text, Packing::Dictionary),
                field("i32", Content::I32, Packing::Dictionary),
                field("i64", Content::I64, Packing::Differences),
                field("u64", Content::U64, Packing::Differences),
                field("f32", Content::F32, Packing::ByteStreams),
                field("f64", Content::F64, Packing::ByteStreams),
                field("gaps", Content::OptionalF64, Packing::ByteStreams),
            ],
            metadata: vec![("note".to_owned(), "of a test".to_owned())],
            coarse_statistics: true,
        };
        let file = tempfile::tempfile().unwrap();
        let mut writer = ColumnFileWriter::new(file.try_clone().unwrap(), &layout).unwrap();
        let same = "same";
        for group in 0..2_i32 {
            writer
                .push([
                    Values::Text(vec![same, same, "other"]),
                    Values::I32(vec![group, -1, 2].into()),
                    Values::I64(vec![i64::MIN, 0, 5].into()),
                    Values::I64(vec![1, 2, 3].into()),
                    Values::F32(vec![0.5, -0.5, 1e-7].into()),
                    Values::F64(vec![1e300, f64::MIN_POSITIVE, -0.0].into()),
                    Values::F64(vec![f64::NAN, 2.0, f64::NAN].into()),
                ])
                .unwrap();
        }
        writer.finish().unwrap();
        let reader = SerializedFileReader::new(file).unwrap();
        let facts = reader.metadata().file_metadata();
        assert_eq!((facts.num_rows(), facts.created_by()), (6, Some("test 1")));
        let entries = facts.key_value_metadata().unwrap();
        assert_eq!(
            (entries[0].key.as_str(), entries[0].value.as_deref()),
            ("rotortwin.note", Some("of a test"))
        );
        let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
        assert_eq!(rows[1].get_string(0).unwrap(), "same");
        assert_eq!(rows[2].get_string(0).unwrap(), "other");
        assert_eq!(
            (rows[3].get_int(1).unwrap(), rows[0].get_long(2).unwrap()),
            (1, i64::MIN)
        );
        assert_eq!(rows[5].get_ulong(3).unwrap(), 3);
        assert_eq!(
            (rows[2].get_float(4).unwrap(), rows[0].get_double(5).unwrap()),
            (1e-7, 1e300)
        );
        assert!(rows[2].get_double(5).unwrap().is_sign_negative());
        assert_eq!(rows[1].get_double(6).unwrap(), 2.0);
        assert!(rows[0].get_double(6).is_err() && rows[5].get_double(6).is_err());
    }
}
