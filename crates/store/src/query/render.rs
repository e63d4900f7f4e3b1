//! Tables as JSON, CSV or Parquet.
//!
//! | | no value | numbers |
//! |---|---|---|
//! | JSON | `null`, also for infinite values, which JSON lacks | the shortest text that round-trips in the column's own precision |
//! | CSV | an empty cell | the same; `inf`, `-inf` |
//! | Parquet | NaN | the column's own type; an integer column with gaps becomes double |

use super::channel::ChannelKind;
use super::{QueryError, Table, TableColumn, TelemetryFile};
use crate::column_file::{ColumnFileWriter, Content, Field, Layout, Packing, Values};

/// Output format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// One object: `units` and `data` by channel.
    Json,
    /// A header line, then one line per row.
    Csv,
    /// One row group, zstd.
    Parquet,
}

impl Format {
    /// Media type.
    pub const fn content_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv; charset=utf-8",
            Self::Parquet => "application/vnd.apache.parquet",
        }
    }
}

/// A table and its run.
#[derive(Clone, Debug, PartialEq)]
pub struct RunTable {
    /// Id of the run.
    pub run: String,
    /// The result.
    pub table: Table,
}

/// One run: JSON is an object, CSV and Parquet have the columns of the table.
///
/// # Errors
/// Parquet encoding fails.
pub fn one(table: &RunTable, format: Format) -> Result<Vec<u8>, QueryError> {
    match format {
        Format::Json => {
            let mut out = Vec::new();
            json(&mut out, table);
            out.push(b'\n');
            Ok(out)
        }
        Format::Csv => Ok(csv(std::slice::from_ref(table), false)),
        Format::Parquet => parquet(std::slice::from_ref(table), false),
    }
}

/// Several runs queried for the same channels: JSON `items`, one object per run; CSV and Parquet concatenated, with an additional first
/// column `run`.
///
/// # Errors
/// Parquet encoding fails.
pub fn several(tables: &[RunTable], format: Format) -> Result<Vec<u8>, QueryError> {
    match format {
        Format::Json => {
            let mut out = b"{\"items\":[".to_vec();
            for (at, table) in tables.iter().enumerate() {
                if at > 0 {
                    out.push(b',');
                }
                json(&mut out, table);
            }
            out.extend_from_slice(b"]}\n");
            Ok(out)
        }
        Format::Csv => Ok(csv(tables, true)),
        Format::Parquet => parquet(tables, true),
    }
}

fn text(out: &mut Vec<u8>, value: &str) {
    serde_json::to_writer(out, value).expect("a string is JSON, and memory takes it");
}

/// A finite number in its shortest form.
fn number(out: &mut Vec<u8>, kind: ChannelKind, value: f64) {
    let written = match kind {
        ChannelKind::F32 => serde_json::to_writer(out, &(value as f32)),
        ChannelKind::I32 | ChannelKind::I64 | ChannelKind::Bool => serde_json::to_writer(out, &(value as i64)),
        _ => serde_json::to_writer(out, &value),
    };
    written.expect("a number is JSON, and memory takes it");
}

fn json(out: &mut Vec<u8>, RunTable { run, table }: &RunTable) {
    out.extend_from_slice(b"{\"run\":");
    text(out, run);
    let facts = format!(
        ",\"source_rows\":{},\"rows\":{},\"decimated\":{},\"units\":{{",
        table.source_rows,
        table.rows(),
        table.decimated
    );
    out.extend_from_slice(facts.as_bytes());
    for (at, column) in table.columns.iter().enumerate() {
        if at > 0 {
            out.push(b',');
        }
        text(out, &column.channel.name);
        out.push(b':');
        text(out, &column.channel.unit);
    }
    out.extend_from_slice(b"},\"data\":{");
    for (at, column) in table.columns.iter().enumerate() {
        if at > 0 {
            out.push(b',');
        }
        text(out, &column.channel.name);
        out.extend_from_slice(b":[");
        for (at, value) in column.values.iter().enumerate() {
            if at > 0 {
                out.push(b',');
            }
            if value.is_finite() {
                number(out, column.channel.kind, *value);
            } else {
                out.extend_from_slice(b"null");
            }
        }
        out.push(b']');
    }
    out.extend_from_slice(b"}}");
}

/// All rows of all columns of a file as CSV.
///
/// # Errors
/// The file is damaged, or writing to `out` fails.
pub fn whole_csv(file: &TelemetryFile, out: &mut impl std::io::Write) -> Result<(), QueryError> {
    let columns: Vec<_> = file
        .channels()
        .iter()
        .filter(|channel| channel.kind.is_number())
        .collect();
    let names: Vec<&str> = columns.iter().map(|channel| channel.name.as_str()).collect();
    let mut text = names.join(",").into_bytes();
    text.push(b'\n');
    file.for_each_block(&names, |block| {
        for row in 0..block.first().map_or(0, Vec::len) {
            for (at, (values, channel)) in block.iter().zip(&columns).enumerate() {
                if at > 0 {
                    text.push(b',');
                }
                cell(&mut text, channel.kind, values[row]);
            }
            text.push(b'\n');
        }
        let written = out.write_all(&text);
        text.clear();
        written.map_err(|source| QueryError::Output { source })
    })
}

fn cell(out: &mut Vec<u8>, kind: ChannelKind, value: f64) {
    if value.is_finite() {
        number(out, kind, value);
    } else if value.is_infinite() {
        out.extend_from_slice(if value > 0.0 { b"inf" } else { b"-inf" });
    }
}

fn csv(tables: &[RunTable], with_run: bool) -> Vec<u8> {
    let mut out = Vec::new();
    let Some(first) = tables.first() else { return out };
    let names = first.table.columns.iter().map(|column| column.channel.name.as_str());
    let names: Vec<&str> = with_run.then_some("run").into_iter().chain(names).collect();
    out.extend_from_slice(names.join(",").as_bytes());
    out.push(b'\n');
    for RunTable { run, table } in tables {
        for row in 0..table.rows() {
            if with_run {
                out.extend_from_slice(run.as_bytes());
            }
            for (at, column) in table.columns.iter().enumerate() {
                if at > 0 || with_run {
                    out.push(b',');
                }
                cell(&mut out, column.channel.kind, column.values[row]);
            }
            out.push(b'\n');
        }
    }
    out
}

/// Type in Parquet output.
fn content(columns: &[&TableColumn]) -> Content {
    let gaps = || {
        columns
            .iter()
            .any(|column| column.values.iter().any(|value| value.is_nan()))
    };
    match columns[0].channel.kind {
        ChannelKind::F32 => Content::F32,
        ChannelKind::I32 | ChannelKind::Bool if !gaps() => Content::I32,
        ChannelKind::I64 if !gaps() => Content::I64,
        _ => Content::F64,
    }
}

fn parquet(tables: &[RunTable], with_run: bool) -> Result<Vec<u8>, QueryError> {
    let Some(first) = tables.first() else {
        return Ok(Vec::new());
    };
    let columns: Vec<Vec<&TableColumn>> = (0..first.table.columns.len())
        .map(|at| tables.iter().filter_map(|table| table.table.columns.get(at)).collect())
        .collect();
    let contents: Vec<Content> = columns.iter().map(|columns| content(columns)).collect();
    let field = |name: &str, content| Field {
        name: name.to_owned(),
        content,
        packing: Packing::Dictionary,
    };
    let run = with_run.then(|| field("run", Content::Text));
    let channels = columns.iter().zip(&contents);
    let channels = channels.map(|(columns, content)| field(&columns[0].channel.name, *content));
    let units: serde_json::Map<String, serde_json::Value> = first
        .table
        .columns
        .iter()
        .map(|TableColumn { channel, .. }| {
            let words = serde_json::json!({ "unit": channel.unit, "description": channel.description });
            (channel.name.clone(), words)
        })
        .collect();
    let layout = Layout {
        name: "telemetry",
        created_by: format!("rotortwin-store {}", env!("CARGO_PKG_VERSION")),
        fields: run.into_iter().chain(channels).collect(),
        metadata: vec![("columns".to_owned(), serde_json::Value::Object(units).to_string())],
        coarse_statistics: false,
    };
    let runs = with_run.then(|| {
        let names = tables
            .iter()
            .flat_map(|RunTable { run, table }| std::iter::repeat_n(run.as_str(), table.rows()));
        Values::Text(names.collect())
    });
    let values = columns.iter().zip(&contents).map(|(columns, content)| {
        let values = columns.iter().flat_map(|column| column.values.iter().copied());
        match content {
            Content::F32 => Values::F32(values.map(|value| value as f32).collect()),
            Content::I32 => Values::I32(values.map(|value| value as i32).collect()),
            Content::I64 => Values::I64(values.map(|value| value as i64).collect()),
            _ => Values::F64(values.collect()),
        }
    });
    let mut writer = ColumnFileWriter::new(Vec::new(), &layout)?;
    writer.push(runs.into_iter().chain(values))?;
    Ok(writer.finish()?)
}
