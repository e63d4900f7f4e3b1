//! What is made of the shards: totals, one table of all flights, the summary.

use super::document::Criteria;
use super::folder::{CampaignFolder, program, write_whole};
use super::intervals::{poisson_rate, wilson};
use super::plan::Campaign;
use super::record::{DETECTORS, FlightRecord, columns};
use super::score::severity_name;
use super::totals::{Delays, DetectorTotals, Totals};
use crate::table_file::TableFileWriter;
use serde_json::{Value, json};
use std::io::Write as _;
use std::path::PathBuf;

/// All flights.
pub const PARQUET_FILE: &str = "campaign.parquet";
/// The same for spreadsheets.
pub const CSV_FILE: &str = "campaign.csv";
/// The totals.
pub const SUMMARY_FILE: &str = "summary.json";
/// What to look at first.
pub const REPORT_FILE: &str = "report.html";

/// Rows of a row group of `campaign.parquet`, at least: the index of the file stays small.
const ROW_GROUP: usize = 2048;

/// Reads every shard that is there, in order, and writes the table of all flights on the way. Memory: one row group.
pub fn collect(campaign: &Campaign, folder: &CampaignFolder) -> Result<Totals, String> {
    let mut totals = Totals::new(campaign);
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
        rows.iter().for_each(|record| totals.add(record));
        let table = columns(&rows, campaign.axes(), campaign.levels());
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

/// Writes `summary.json`: the totals, without any wall-clock time, so that the same flights give the same bytes.
pub fn write_summary(campaign: &Campaign, folder: &CampaignFolder, totals: &Totals) -> Result<PathBuf, String> {
    let path = folder.path().join(SUMMARY_FILE);
    let text = format!("{:#}\n", summary(campaign, totals));
    write_whole(&path, text.as_bytes())?;
    Ok(path)
}

/// The totals as JSON.
pub fn summary(campaign: &Campaign, totals: &Totals) -> Value {
    let criteria = &campaign.document().criteria;
    let detectors: serde_json::Map<String, Value> = DETECTORS
        .iter()
        .zip(&totals.detectors)
        .map(|(name, detector)| ((*name).to_owned(), detector_json(detector, criteria)))
        .collect();
    let axes: Vec<Value> = totals
        .axes
        .iter()
        .filter(|axis| !axis.overflown)
        .map(|axis| {
            let groups: Vec<Value> = axis
                .groups
                .iter()
                .map(|group| {
                    let detectors: serde_json::Map<String, Value> = DETECTORS
                        .iter()
                        .zip(&group.detectors)
                        .map(|(name, detector)| ((*name).to_owned(), brief_json(detector, criteria)))
                        .collect();
                    json!({ "value": group.name, "flights": group.flights, "failed": group.failed, "detectors": detectors })
                })
                .collect();
            json!({ "axis": axis.axis, "groups": groups })
        })
        .collect();
    let curve: Vec<Value> = totals
        .curve
        .iter()
        .map(|(level, detector)| {
            let mut point = detector_json(detector, criteria);
            point["evidence_nats"] = json!(level);
            point
        })
        .collect();
    json!({
        "campaign": campaign.document().name,
        "program": program(),
        "seed": campaign.document().seed,
        "planned_flights": campaign.flights(),
        "complete": totals.flights == campaign.flights(),
        "flights": totals.flights,
        "done": totals.done,
        "failed": totals.failed,
        "refused": totals.refused,
        "steps": totals.steps,
        "flown_h": totals.flown_h(),
        "hash": totals.hash(),
        "criteria": criteria,
        "detectors": detectors,
        "operating_curve": curve,
        "axes": axes,
        "thrust_loss_error": totals.loss_error.summary().map(|(count, mean, rms)| json!({
            "flights": count, "mean_n": mean, "rms_n": rms, "interval_holds_truth": totals.loss_error.covered(),
        })),
    })
}

fn delays_json(delays: &Delays) -> Value {
    json!({
        "flights": delays.total(),
        "median_s": delays.quantile_s(0.5),
        "p95_s": delays.quantile_s(0.95),
        "worst_s": delays.quantile_s(1.0),
    })
}

/// What is told of every group.
fn brief_json(detector: &DetectorTotals, criteria: &Criteria) -> Value {
    json!({
        "windows": detector.windows.total(),
        "right": detector.windows.share(),
        "right_95": detector.windows.interval(),
        "false_alarm_events": detector.false_alarm_events,
        "healthy_h": detector.healthy_h(),
        "fault_flights": detector.fault_flights,
        "isolated": delays_json(&detector.isolated),
        "isolated_in_time": detector.isolated.within(criteria.isolate_within_s),
    })
}

fn detector_json(detector: &DetectorTotals, criteria: &Criteria) -> Value {
    let mut json = brief_json(detector, criteria);
    let in_time = detector.isolated.within(criteria.isolate_within_s);
    let confusion: Vec<[i64; 3]> = detector
        .confusion
        .iter()
        .map(|((truth, verdict), count)| [i64::from(*truth), i64::from(*verdict), *count as i64])
        .collect();
    let severity: Vec<Value> = detector
        .by_severity
        .iter()
        .map(|(bin, sums)| json!({ "loss": severity_name(*bin), "windows": sums.total(), "right": sums.share(), "right_95": sums.interval() }))
        .collect();
    let onsets: Vec<Value> = detector
        .delay_by_severity
        .iter()
        .map(|(bin, (flights, delays))| {
            json!({
                "loss": severity_name(*bin),
                "flights": flights,
                "in_time": delays.within(criteria.isolate_within_s),
                "isolated": delays_json(delays),
            })
        })
        .collect();
    let more = json!({
        "healthy_right": detector.healthy.share(),
        "faulty_right": detector.faulty.share(),
        "missed": detector.missed,
        "wrong_rotor": detector.wrong_rotor,
        "wrong_rotor_flights": detector.wrong_rotor_flights,
        "unclear": detector.unclear,
        "false_alarms_per_h": detector.false_alarms_per_h(),
        "false_alarms_per_h_95": poisson_rate(detector.false_alarm_events, detector.healthy_h()),
        "false_alarm_flights": detector.false_alarm_flights,
        "detected": delays_json(&detector.detected),
        "settled": delays_json(&detector.settled),
        "isolated_in_time_95": wilson(in_time as f64, detector.fault_flights as f64),
        "confusion_truth_verdict_windows": confusion,
        "windows_by_severity": severity,
        "onsets_by_severity": onsets,
    });
    if let (Some(json), Value::Object(more)) = (json.as_object_mut(), more) {
        json.extend(more);
    }
    json
}
