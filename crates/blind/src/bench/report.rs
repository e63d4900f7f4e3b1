//! The score sheet as files: `score.json`, `rows.parquet`, `report.html` (stands alone).

use super::run::Request;
use super::score::{Outcome, Row};
use super::sheet::{Group, Share, Sheet};
use crate::error::{BlindError, Result};
use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
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

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

const STYLE: &str = "*{box-sizing:border-box}body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:78rem;padding:0 1rem;color:#1d2330}\
h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2rem}table{border-collapse:collapse;width:100%;font-size:.86rem}\
th,td{text-align:left;padding:.3rem .5rem;border-bottom:1px solid #e2e6ee;vertical-align:top}th{background:#f4f6fa}\
td.n{font-variant-numeric:tabular-nums;white-space:nowrap}.bad{background:#fdecea}.doubt{background:#fff6e0}.good{background:#eaf6ee}\
.bar{background:#e2e6ee;height:.5rem;width:9rem;position:relative;display:inline-block}\
.bar i{position:absolute;height:100%;background:#9db7e8}.bar b{position:absolute;height:100%;width:2px;background:#1d4ed8}\
p.note{color:#5a6478;font-size:.86rem}";

fn bar(share: &Share) -> String {
    format!(
        "<span class=bar><i style='left:{:.1}%;width:{:.1}%'></i><b style='left:{:.1}%'></b></span>",
        100.0 * share.low,
        100.0 * (share.high - share.low),
        100.0 * share.share
    )
}

fn group_rows(group: &Group) -> String {
    let shares: [(&str, &Share); 13] = [
        ("right, or rightly not testable", &group.right_or_not_testable),
        ("first name right", &group.top1),
        ("all hidden effects found", &group.all_found),
        ("exactly the hidden set", &group.exact),
        ("within the named group", &group.in_group),
        ("rightly not testable", &group.not_testable),
        ("missed", &group.missed),
        ("confidently wrong", &group.confidently_wrong),
        ("wrong, with a doubt", &group.wrong_flagged),
        ("false alarms", &group.false_alarms),
        ("outside the catalogue, and said so", &group.flagged),
        ("95 % intervals that cover", &group.coverage),
        ("onset within 1 s", &group.onset_within_1_s),
    ];
    let mut text = format!("<h2>{} · {} cases</h2><table>", escape(&group.name), group.cases);
    for (name, share) in shares.iter().filter(|(_, share)| share.of > 0) {
        text += &format!(
            "<tr><td>{name}</td><td class=n>{}</td><td>{}</td></tr>",
            share.text(),
            bar(share)
        );
    }
    if let Some([median, p90]) = group.parameter_error {
        text += &format!(
            "<tr><td>parameter error</td><td class=n>{:.2} % median, {:.2} % at 90 %</td><td></td></tr>",
            100.0 * median,
            100.0 * p90
        );
    }
    if let Some([median, worst]) = group.chi2_after {
        text += &format!(
            "<tr><td>χ²/N of right answers (1: the oracle's)</td><td class=n>{median:.4} median, {worst:.4} worst</td><td></td></tr>"
        );
    }
    text += &format!(
        "<tr><td>seconds a diagnosis</td><td class=n>{:.2} median, {:.2} worst</td><td></td></tr></table>",
        group.seconds[0], group.seconds[1]
    );
    text
}

fn colour(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Right | Outcome::Flagged => "good",
        Outcome::NotTestable | Outcome::NotFlown => "",
        Outcome::InGroup | Outcome::WrongFlagged | Outcome::Missed => "doubt",
        Outcome::ConfidentlyWrong | Outcome::FalseAlarm | Outcome::Failed => "bad",
    }
}

fn html(request: &Request, rows: &[Row], sheet: &Sheet) -> String {
    let presets: Vec<&str> = request.presets.iter().map(|preset| preset.name()).collect();
    let mut text = format!(
        "<!doctype html><html lang=en><meta charset=utf-8><title>Blind bench</title><style>{STYLE}</style><h1>Blind bench</h1>\
         <p>{} cases of {}; seed {}; {} s flights; vehicles {}; rotortwin {}.</p>\
         <p class=note>Logs come from a simulator that shares no code with the diagnosis; the diagnosis saw the log and the nominal vehicle \
         only. Shares with 95 % intervals (Wilson). \u{201c}Rightly not testable\u{201d}: nothing was named, and the answer's own table of \
         smallest detectable sizes says that this size would not have shown.</p>",
        rows.len(),
        escape(&presets.join(", ")),
        request.seed,
        request.duration_s,
        escape(&request.vehicles.join(", ")),
        escape(&request.version),
    );
    for group in &sheet.groups {
        text += &group_rows(group);
    }
    text += "<h2>What was named for what</h2><table><tr><th>hidden<th>named<th>cases</tr>";
    for (truth, named, n) in &sheet.confusion {
        let class = if truth == named { "good" } else { "" };
        text += &format!(
            "<tr class='{class}'><td>{}<td>{}<td class=n>{n}</tr>",
            escape(truth),
            escape(named)
        );
    }
    text += "</table><h2>Every case</h2><table><tr><th>case<th>preset<th>flight<th>seed<th>hidden<th>named<th>outcome<th>ln evidence\
             <th>parameter error<th>s</tr>";
    for row in rows {
        let error = row.parameter_errors.iter().copied().fold(f64::NAN, f64::max);
        let number = |value: f64, digits: usize| {
            if value.is_finite() {
                format!("{value:.digits$}")
            } else {
                String::new()
            }
        };
        text += &format!(
            "<tr class='{}'><td class=n>{}<td>{}<td>{}<td class=n>{}<td>{}<td>{}<td>{}<td class=n>{}<td class=n>{}<td class=n>{:.2}</tr>",
            colour(row.outcome),
            row.case.index,
            row.case.preset.name(),
            escape(&row.case.flight),
            row.case.seed,
            escape(&row.case.effect_arguments().join(" ")),
            escape(row.failure.as_deref().unwrap_or(&row.named)),
            kebab(row.outcome),
            number(row.evidence.unwrap_or(f64::NAN), 1),
            if error.is_finite() {
                format!("{:.2} %", 100.0 * error)
            } else {
                String::new()
            },
            row.seconds,
        );
    }
    text + "</table></html>\n"
}
