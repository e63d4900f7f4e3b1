//! Files of a comparison: `comparison.json`, `residuals-LOG.parquet`, `report.html`.

use std::path::{Path, PathBuf};

use rotortwin_store::column_file::{ColumnFileWriter, Content, Field, Layout, Packing, Values};

use super::{Comparison, LogSeries};
use crate::flight_picture::FlightPicture;
use crate::model::document::plain_name;
use crate::predict::{CHANNELS, NAMES, UNITS};

/// How the columns of the flight conditions begin.
pub const CONDITION: &str = "condition_";

/// Why a file could not be written: one sentence.
#[derive(Debug, thiserror::Error)]
#[error("writing {path}: {reason}")]
pub struct WriteError {
    path: PathBuf,
    reason: String,
}

fn failed(path: &Path) -> impl Fn(&dyn std::fmt::Display) -> WriteError {
    let path = path.to_owned();
    move |reason| WriteError {
        path: path.clone(),
        reason: reason.to_string(),
    }
}

/// The comparison as JSON. A number that is not finite (an untestable channel's) is null.
pub fn json(comparison: &Comparison) -> String {
    serde_json::to_string_pretty(comparison).expect("text and numbers are JSON")
}

/// Writes all files into `folder`, which is made if it is not there.
///
/// # Errors
/// The file system refuses.
pub fn write(
    folder: &Path,
    comparison: &Comparison,
    series: &[LogSeries],
    flights: &[FlightPicture],
) -> Result<(), WriteError> {
    std::fs::create_dir_all(folder).map_err(|error| failed(folder)(&error))?;
    let put = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|error| failed(&path)(&error))
    };
    put("comparison.json", &json(comparison))?;
    put("report.html", &super::report::render(comparison, series, flights))?;
    let names: Vec<&str> = comparison.logs.iter().map(|log| log.log.name.as_str()).collect();
    for (place, (log, series)) in comparison.logs.iter().zip(series).enumerate() {
        residuals(&folder.join(residuals_file(&names, place)), log, series)?;
    }
    Ok(())
}

/// Name of the file with the residuals of the log at `place` among the `names` of a comparison's logs.
pub fn residuals_file(names: &[&str], place: usize) -> String {
    let name = plain_name(names[place]);
    // Two logs may have one name.
    if names[..place].iter().any(|other| plain_name(other) == name) {
        format!("residuals-{name}-{}.parquet", place + 1)
    } else {
        format!("residuals-{name}.parquet")
    }
}

/// Variance and lag-one covariance of a sample of pure noise, by channel.
fn covariances(log: &super::LogComparison) -> Vec<[f64; 2]> {
    let all = log.noise.covariances(1.0 / log.rate_hz);
    all.iter().map(|one| [one.variance, one.lag_one]).collect()
}

/// One row per sample: time, per channel the measurement and each model's residual, raw and whitened, then the flight
/// conditions; NaN where nothing counts. The metadata contain the effect of pure noise on each channel (`covariances`:
/// variance and lag-one covariance of a sample).
fn residuals(path: &Path, log: &super::LogComparison, series: &LogSeries) -> Result<(), WriteError> {
    let fail = failed(path);
    let mut columns: Vec<(String, Vec<f32>)> =
        vec![("time_s".to_owned(), series.time_s.iter().map(|t| *t as f32).collect())];
    let mut units = serde_json::Map::new();
    units.insert("time_s".to_owned(), "s".into());
    for channel in 0..CHANNELS {
        if series.measured[channel].is_empty() {
            continue;
        }
        let mut push = |name: String, unit: &str, values: Vec<f32>| {
            units.insert(name.clone(), unit.into());
            columns.push((name, values));
        };
        let measured = series.measured[channel].iter().map(|v| *v as f32).collect();
        push(format!("{}_measured", NAMES[channel]), UNITS[channel], measured);
        for (place, residuals) in series.models.iter().enumerate() {
            if residuals.raw[channel].is_empty() {
                continue;
            }
            let counted = |values: &[f64]| -> Vec<f32> {
                values
                    .iter()
                    .zip(&residuals.mask[channel])
                    .map(|(v, &m)| if m { *v as f32 } else { f32::NAN })
                    .collect()
            };
            push(
                format!("{}_residual_{place}", NAMES[channel]),
                UNITS[channel],
                counted(&residuals.raw[channel]),
            );
            push(
                format!("{}_whitened_{place}", NAMES[channel]),
                "1",
                counted(&residuals.whitened[channel]),
            );
        }
    }
    for condition in &series.conditions {
        let name = format!("{CONDITION}{}", condition.name);
        units.insert(name.clone(), condition.unit.into());
        columns.push((name, condition.values.iter().map(|v| *v as f32).collect()));
    }
    let titles: Vec<[&str; 3]> = series.conditions.iter().map(|c| [c.name, c.title, c.unit]).collect();
    let labels: Vec<&str> = log.models.iter().map(|model| model.model.as_str()).collect();
    let entry = |key: &str, value: String| (key.to_owned(), value);
    let metadata = vec![
        entry("log", log.log.name.clone()),
        entry("log_hash", log.log.hash.clone()),
        entry("models", serde_json::to_string(&labels).expect("texts are JSON")),
        entry("units", serde_json::Value::Object(units).to_string()),
        entry("rate_hz", log.rate_hz.to_string()),
        entry("covariances", serde_json::json!(covariances(log)).to_string()),
        entry("conditions", serde_json::json!(titles).to_string()),
    ];
    let fields = columns.iter().map(|(name, _)| Field {
        name: name.clone(),
        content: Content::F32,
        packing: Packing::ByteStreams,
    });
    let layout = Layout {
        name: "residuals",
        created_by: crate::model::TOOL.to_owned(),
        fields: fields.collect(),
        metadata,
        coarse_statistics: false,
    };
    let file = std::fs::File::create(path).map_err(|error| fail(&error))?;
    let write = || {
        let mut writer = ColumnFileWriter::new(file, &layout)?;
        writer.push(columns.iter().map(|(_, values)| Values::F32(values.into())))?;
        writer.finish()
    };
    write().map(drop).map_err(|error| fail(&error))
}
