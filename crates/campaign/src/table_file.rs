//! Tables of numbers as CSV (for people and spreadsheets) and Parquet (for pandas, Polars, DuckDB).
//!
//! Both files have the same columns and rows. Floating-point numbers read back bit-identically.

use parquet::errors::ParquetError;
use rotortwin_store::column_file::{self, ColumnFileWriter, Content, Field, Layout, Packing};
use std::fmt::Write as _;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// Values of one column.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Texts.
    Text(Vec<String>),
    /// Whole numbers.
    Integer(Vec<i64>),
    /// Doubles; NaN if missing.
    Double(Vec<f64>),
    /// Single-precision numbers, as in flight code.
    Single(Vec<f32>),
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Self::Text(values) => values.len(),
            Self::Integer(values) => values.len(),
            Self::Double(values) => values.len(),
            Self::Single(values) => values.len(),
        }
    }

    fn cell(&self, row: usize) -> String {
        match self {
            Self::Text(values) => quoted(&values[row]),
            Self::Integer(values) => values[row].to_string(),
            Self::Double(values) if values[row].is_nan() => String::new(),
            Self::Double(values) => values[row].to_string(),
            Self::Single(values) => values[row].to_string(),
        }
    }
}

/// A CSV field, quoted if necessary.
pub fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// A table: columns of equal length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TableFile {
    columns: Vec<(String, Values)>,
}

/// Why a file was not written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: cannot write the table: {reason}")]
pub struct TableFileError {
    path: PathBuf,
    reason: String,
}

impl TableFile {
    /// Adds a column.
    pub fn column(&mut self, name: &str, values: Values) -> &mut Self {
        if let Some((_, first)) = self.columns.first() {
            assert_eq!(values.len(), first.len(), "column {name} is as long as the others");
        }
        self.columns.push((name.to_owned(), values));
        self
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |(_, values)| values.len())
    }

    /// As CSV text, with a header.
    pub fn to_csv(&self) -> String {
        let mut text = String::new();
        let names: Vec<String> = self.columns.iter().map(|(name, _)| quoted(name)).collect();
        writeln!(text, "{}", names.join(",")).expect("a String takes everything");
        for row in 0..self.rows() {
            for (i, (_, values)) in self.columns.iter().enumerate() {
                text.push_str(if i > 0 { "," } else { "" });
                text.push_str(&values.cell(row));
            }
            text.push('\n');
        }
        text
    }

    /// Writes `to_csv` to `path`.
    pub fn write_csv(&self, path: &Path) -> Result<(), TableFileError> {
        std::fs::write(path, self.to_csv()).map_err(|error| refused(path, &error))
    }

    /// Writes the table to `path` as Parquet.
    pub fn write_parquet(&self, path: &Path) -> Result<(), TableFileError> {
        let mut writer = TableFileWriter::create(path, self)?;
        writer.push(self)?;
        writer.finish()
    }
}

/// Writes tables with the same columns into one Parquet file, one row group each.
pub struct TableFileWriter {
    path: PathBuf,
    writer: ColumnFileWriter<BufWriter<File>>,
}

impl TableFileWriter {
    /// Starts a file with the columns of `table`; no row is written yet.
    pub fn create(path: &Path, table: &TableFile) -> Result<Self, TableFileError> {
        let file = File::create(path).map_err(|error| refused(path, &error))?;
        let writer = Self::begin(BufWriter::new(file), table).map_err(|error| refused(path, &error))?;
        Ok(Self {
            path: path.to_path_buf(),
            writer,
        })
    }

    fn begin(file: BufWriter<File>, table: &TableFile) -> Result<ColumnFileWriter<BufWriter<File>>, ParquetError> {
        let fields = table.columns.iter().map(|(name, values)| Field {
            name: name.clone(),
            content: match values {
                Values::Text(_) => Content::Text,
                Values::Integer(_) => Content::I64,
                Values::Double(_) => Content::F64,
                Values::Single(_) => Content::F32,
            },
            packing: Packing::Dictionary,
        });
        let layout = Layout {
            name: "table",
            created_by: format!("rotortwin-campaign {}", env!("CARGO_PKG_VERSION")),
            fields: fields.collect(),
            metadata: Vec::new(),
            coarse_statistics: false,
        };
        ColumnFileWriter::new(file, &layout)
    }

    /// Adds the rows of `table`, whose columns must be those of the first one.
    pub fn push(&mut self, table: &TableFile) -> Result<(), TableFileError> {
        let columns = table.columns.iter().map(|(_, values)| match values {
            Values::Text(values) => column_file::Values::Text(values.iter().map(String::as_str).collect()),
            Values::Integer(values) => column_file::Values::I64(values.into()),
            Values::Double(values) => column_file::Values::F64(values.into()),
            Values::Single(values) => column_file::Values::F32(values.into()),
        });
        self.writer.push(columns).map_err(|error| refused(&self.path, &error))
    }

    /// Completes the file.
    pub fn finish(self) -> Result<(), TableFileError> {
        let Self { path, writer } = self;
        writer.finish().map_err(|error| refused(&path, &error))?;
        Ok(())
    }
}

fn refused(path: &Path, reason: &dyn std::fmt::Display) -> TableFileError {
    TableFileError {
        path: path.to_path_buf(),
        reason: reason.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use parquet::record::RowAccessor as _;

    #[test]
    fn val_both_files_hold_what_was_put_in() {
        let mut table = TableFile::default();
        table
            .column("name", Values::Text(vec!["a".to_owned(), "b, \"c\"".to_owned()]))
            .column("count", Values::Integer(vec![-1, 7]))
            .column("share", Values::Double(vec![0.1 + 0.2, f64::NAN]))
            .column("mean", Values::Single(vec![0.1, 1e-9]));
        assert_eq!(
            table.to_csv(),
            "name,count,share,mean\na,-1,0.30000000000000004,0.1\n\"b, \"\"c\"\"\",7,,0.000000001\n"
        );
        let folder = std::env::temp_dir().join(format!("rotortwin-table-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("writable");
        let path = folder.join("table.parquet");
        table.write_parquet(&path).expect("written");
        let reader = SerializedFileReader::new(File::open(&path).expect("there")).expect("Parquet");
        let rows: Vec<_> = reader
            .get_row_iter(None)
            .expect("rows")
            .map(|row| row.expect("row"))
            .collect();
        assert_eq!(rows.len(), 2);
        assert_eq!(rows[1].get_string(0).expect("text"), "b, \"c\"");
        assert_eq!(rows[0].get_long(1).expect("integer"), -1);
        assert_eq!(rows[0].get_double(2).expect("double"), 0.1 + 0.2);
        assert_eq!(rows[1].get_float(3).expect("single"), 1e-9);
        std::fs::remove_dir_all(&folder).expect("removable");
    }
}
