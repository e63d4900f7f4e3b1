//! The score sheet as files: `score.json`, `rows.parquet`, `report.html` (self-contained).

use super::run::Request;
use super::score::Row;
use super::sheet::Sheet;
use crate::error::{BlindError, Result};
use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use rotortwin_page::Report;
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;

/// Writes the three files.
pub fn write(folder: &Path, request: &Request, rows: &[Row], sheet: &Sheet) -> Result<()> {
    let put = |name: &str, text: String| {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|source| BlindError::file("writing", path, source))
    };
    let json = serde_json::json!({ "request": request, "sheet": sheet, "rows": rows });
    put("score.json", format!("{json:#}\n"))?;
    put("report.html", html(request, rows, sheet))?;
    write_parquet(&folder.join("rows.parquet"), rows)
}

fn kebab<T: serde::Serialize>(value: T) -> String {
    serde_json::to_value(value)
        .ok()
        .and_then(|value| value.as_str().map(str::to_owned))
        .unwrap_or_default()
}

/// One row per case; absent numbers are NaN.
fn write_parquet(path: &Path, rows: &[Row]) -> Result<()> {
    type Text = fn(&Row) -> String;
    type Number = fn(&Row) -> f64;
    let texts: [(&str, Text); 6] = [
        ("preset", |row| row.case.preset.name().to_owned()),
        ("flight", |row| row.case.flight.clone()),
        ("vehicle", |row| row.case.vehicle.clone()),
        ("truth", |row| row.truth.clone()),
        ("named", |row| row.named.clone()),
        ("outcome", |row| kebab(row.outcome)),
    ];
    let numbers: [(&str, Number); 6] = [
        ("size_factor", |row| row.case.scale),
        ("ln_evidence", |row| row.evidence.unwrap_or(f64::NAN)),
        ("parameter_error", |row| {
            row.parameter_errors.iter().copied().fold(f64::NAN, f64::max)
        }),
        ("onset_error_s", |row| row.onset_error_s.unwrap_or(f64::NAN)),
        ("chi2_after", |row| row.chi2.map_or(f64::NAN, |pair| pair[1])),
        ("seconds", |row| row.seconds),
    ];
    let field = |name: &str, physical, logical| {
        Type::primitive_type_builder(name, physical)
            .with_repetition(Repetition::REQUIRED)
            .with_logical_type(logical)
            .build()
            .map(Arc::new)
    };
    let mut fields = vec![
        field("case", Physical::INT64, None)?,
        field("seed", Physical::INT64, None)?,
    ];
    for (name, _) in &texts {
        fields.push(field(name, Physical::BYTE_ARRAY, Some(LogicalType::String))?);
    }
    for (name, _) in &numbers {
        fields.push(field(name, Physical::DOUBLE, None)?);
    }
    let schema = Arc::new(Type::group_type_builder("rows").with_fields(fields).build()?);
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
        .build();
    let file = std::fs::File::create(path).map_err(|source| BlindError::file("creating", path, source))?;
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for value in [|row: &Row| row.case.index as i64, |row: &Row| row.case.seed as i64] {
        let values: Vec<i64> = rows.iter().map(value).collect();
        if let Some(mut column) = group.next_column()? {
            column.typed::<Int64Type>().write_batch(&values, None, None)?;
            column.close()?;
        }
    }
    for (_, value) in &texts {
        let values: Vec<ByteArray> = rows
            .iter()
            .map(|row| ByteArray::from(value(row).into_bytes()))
            .collect();
        if let Some(mut column) = group.next_column()? {
            column.typed::<ByteArrayType>().write_batch(&values, None, None)?;
            column.close()?;
        }
    }
    for (_, value) in &numbers {
        let values: Vec<f64> = rows.iter().map(value).collect();
        if let Some(mut column) = group.next_column()? {
            column.typed::<DoubleType>().write_batch(&values, None, None)?;
            column.close()?;
        }
    }
    group.close()?;
    writer.close()?;
    Ok(())
}

/// What is inside of the page.
#[derive(Serialize)]
struct Inside<'a> {
    request: &'a Request,
    sheet: &'a Sheet,
    rows: Vec<ReportRow<'a>>,
}

/// One case, with its hidden effects as given to the generator.
#[derive(Serialize)]
struct ReportRow<'a> {
    hidden: String,
    #[serde(flatten)]
    row: &'a Row,
}

/// The page.
fn html(request: &Request, rows: &[Row], sheet: &Sheet) -> String {
    let lines = sheet.groups.iter().map(|group| {
        format!(
            "{} · {} cases: right, or correctly not testable {}; false alarms {}; confidently wrong {}",
            group.name,
            group.cases,
            group.right_or_not_testable.text(),
            group.false_alarms.text(),
            group.confidently_wrong.text()
        )
    });
    let cases = rows.iter().map(|row| ReportRow {
        hidden: row.case.effect_arguments().join(" "),
        row,
    });
    let report = Report {
        kind: "blind",
        title: "Blind bench",
        summary: &lines.collect::<Vec<_>>().join("\n"),
        program: &format!("rotortwin {}", request.version),
        data: &Inside {
            request,
            sheet,
            rows: cases.collect(),
        },
    };
    report.render().expect("text and numbers are JSON")
}
