//! Results from the shards: totals, one table of all flights, the summary.

use super::folder::{CampaignFolder, write_whole};
use super::own::read_all;
use super::plan::Campaign;
use super::record::{FlightRecord, columns};
use super::report;
use super::summary::CampaignSummary;
use super::totals::Totals;
use crate::table_file::TableFileWriter;
use std::io::Write as _;
use std::path::PathBuf;

/// All flights.
pub const PARQUET_FILE: &str = "campaign.parquet";
/// The same for spreadsheets.
pub const CSV_FILE: &str = "campaign.csv";
/// The totals.
pub const SUMMARY_FILE: &str = "summary.json";
/// The report.
pub const REPORT_FILE: &str = "report.html";

/// Minimum rows of a row group of `campaign.parquet`: keeps the index of the file small.
const ROW_GROUP: usize = 2048;

/// Reads every existing shard, in order, and writes the table of all flights on the way, with what detectors of the user's own scored in them.
/// Memory: one row group, and these scores.
pub fn collect(campaign: &Campaign, folder: &CampaignFolder) -> Result<Totals, String> {
    let own = read_all(folder)?;
    let mut totals = Totals::with_own(campaign, &own);
    let parquet = folder.path().join(PARQUET_FILE);
    let csv = folder.path().join(CSV_FILE);
    let (parquet_part, csv_part) = (parquet.with_extension("parquet.part"), csv.with_extension("csv.part"));
    let csv_error = |error: std::io::Error| format!("{}: cannot be written: {error}", csv.display());
    let mut csv_out = std::io::BufWriter::new(std::fs::File::create(&csv_part).map_err(csv_error)?);
    let mut writer: Option<TableFileWriter> = None;
    let mut rows: Vec<FlightRecord> = Vec::new();
    let present: Vec<u64> = (0..folder.shard_count())
        .filter(|shard| folder.has_shard(*shard))
        .collect();
    for (i, shard) in present.iter().enumerate() {
        rows.extend(folder.read_shard(*shard)?);
        if rows.len() < ROW_GROUP && i + 1 < present.len() {
            continue;
        }
        rows.iter().for_each(|record| totals.add_judged(record, &own));
        let mut table = columns(&rows, campaign.axes(), campaign.levels());
        own.iter().for_each(|scores| scores.add_columns(&mut table, &rows));
        rows.clear();
        let text = table.to_csv();
        let body = match &writer {
            None => text.as_str(),
            Some(_) => text.split_once('\n').map_or("", |(_, body)| body),
        };
        csv_out.write_all(body.as_bytes()).map_err(csv_error)?;
        let writer = match &mut writer {
            Some(writer) => writer,
            None => writer.insert(TableFileWriter::create(&parquet_part, &table).map_err(|error| error.to_string())?),
        };
        writer.push(&table).map_err(|error| error.to_string())?;
    }
    csv_out.flush().map_err(csv_error)?;
    std::fs::rename(&csv_part, &csv).map_err(csv_error)?;
    if let Some(writer) = writer {
        writer.finish().map_err(|error| error.to_string())?;
        std::fs::rename(&parquet_part, &parquet)
            .map_err(|error| format!("{}: cannot be written: {error}", parquet.display()))?;
    }
    Ok(totals)
}

/// Renews everything that is made of the shards: tables, summary, report.
///
/// # Errors
/// One sentence: a shard cannot be read, or a file not written.
pub fn write_all(campaign: &Campaign, folder: &CampaignFolder) -> Result<Totals, String> {
    let totals = collect(campaign, folder)?;
    write_summary(campaign, folder, &totals)?;
    let page = report::render(campaign, &totals);
    write_whole(&folder.path().join(REPORT_FILE), page.as_bytes())?;
    Ok(totals)
}

/// Writes `summary.json`.
pub fn write_summary(campaign: &Campaign, folder: &CampaignFolder, totals: &Totals) -> Result<PathBuf, String> {
    let path = folder.path().join(SUMMARY_FILE);
    let text = format!("{}\n", CampaignSummary::new(campaign, totals).json());
    write_whole(&path, text.as_bytes())?;
    Ok(path)
}
