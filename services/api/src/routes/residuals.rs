//! Results of a comparison, sample by sample: measured, predicted and residual of a channel, and the flight conditions,
//! as means and extremes of buckets.
//!
//! The comparison's process has written the residuals of each log to a file; it is read here, never recomputed.

use super::jobs::Shared;
use super::tasks::done;
use super::telemetry::blocking;
use crate::App;
use crate::access::Caller;
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query};
use rotortwin_jobs::JobKind;
use rotortwin_store::query::{QueryError, TIME, TelemetryFile};
use rotortwin_twin::compare::files::{CONDITION, residuals_file};
use rotortwin_twin::predict::{Covariance, NAMES, UNITS};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use utoipa::{IntoParams, ToSchema};

/// Default number of buckets of an answer.
const USUAL_POINTS: usize = 900;
/// Buckets of an answer, at most.
const MOST_POINTS: usize = 20_000;

/// Which log, when, and in how many buckets.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct Interval {
    /// Index of the log in the result, from 0; default 0.
    #[serde(default)]
    #[param(default = 0)]
    log: usize,
    /// Start of the interval, s.
    from_s: Option<f64>,
    /// End of the interval, s.
    to_s: Option<f64>,
    /// Maximum number of buckets; default 900. With as many as samples, each bucket is one sample.
    #[param(minimum = 1, maximum = 20_000)]
    points: Option<usize>,
}

/// The same, of one channel.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct OfChannel {
    /// Which channel, such as `fx`.
    channel: String,
    /// Index of the log in the result, from 0; default 0.
    #[serde(default)]
    #[param(default = 0)]
    log: usize,
    /// Start of the interval, s.
    from_s: Option<f64>,
    /// End of the interval, s.
    to_s: Option<f64>,
    /// Maximum number of buckets; default 900. With as many as samples, each bucket is one sample.
    #[param(minimum = 1, maximum = 20_000)]
    points: Option<usize>,
}

/// One value per bucket; `null`: no sample counts.
#[derive(Debug, Default, Serialize, ToSchema)]
pub(crate) struct Buckets {
    /// Mean of the samples that count.
    mean: Vec<Option<f64>>,
    /// Minimum.
    low: Vec<Option<f64>>,
    /// Maximum.
    high: Vec<Option<f64>>,
}

/// One channel of one log: the measurement, and the prediction of each model.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ChannelSeries {
    /// Index of the log in the result, from 0.
    log: usize,
    /// Its name.
    name: String,
    /// Channel.
    channel: String,
    /// Unit of all values.
    unit: String,
    /// First sample of the log, s.
    start_s: f64,
    /// Last sample of the log, s.
    end_s: f64,
    /// Samples in the interval.
    source_rows: usize,
    /// Length of a bucket, s.
    bucket_s: f64,
    /// Middle of each bucket, s.
    time_s: Vec<f64>,
    /// Measured values.
    measured: Buckets,
    /// In the order of the result.
    models: Vec<ModelSeries>,
    /// Level of pure noise.
    noise: NoiseOfBucket,
}

/// Prediction of one model for a channel.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ModelSeries {
    /// Label, as in the result.
    label: String,
    /// Predicted: measured minus residual.
    predicted: Buckets,
    /// Residual: measured minus predicted.
    residual: Buckets,
}

/// Standard deviations of pure noise.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct NoiseOfBucket {
    /// That of a sample.
    sample: f64,
    /// That of the mean of a whole bucket.
    mean: f64,
}

/// The flight conditions of one log.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ConditionSeries {
    /// Index of the log in the result, from 0.
    log: usize,
    /// Its name.
    name: String,
    /// Samples in the interval.
    source_rows: usize,
    /// Length of a bucket, s.
    bucket_s: f64,
    /// Middle of each bucket, s: those of a channel's series with the same interval and number of buckets.
    time_s: Vec<f64>,
    /// The conditions.
    items: Vec<ConditionMeans>,
}

/// One flight condition.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ConditionMeans {
    /// Key, as in the result.
    name: String,
    /// Readable name.
    title: String,
    /// Unit.
    unit: String,
    /// Mean of each bucket; `null`: unknown.
    mean: Vec<Option<f64>>,
}

/// One channel of a compared log: measured, predicted by each model, and residual, in buckets with mean, lowest and highest sample.
#[utoipa::path(get, path = "/api/v1/comparisons/{id}/series", tag = "comparisons", operation_id = "comparison_series", params(("id" = String, Path), OfChannel), responses(
    (status = 200, description = "the series", body = ChannelSeries),
    (status = 400, description = "invalid parameter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "comparison not found, or it has no such log", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the job is not done", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "unknown channel, channel missing from the log, or empty interval", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn series(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    query: Result<Query<OfChannel>, QueryRejection>,
) -> Result<Json<ChannelSeries>, Problem> {
    let (Path(id), Query(query)) = (id?, query?);
    let channel = NAMES.iter().position(|name| *name == query.channel).ok_or_else(|| {
        Problem::unprocessable(format!(
            "unknown channel '{}'; expected one of {}",
            query.channel,
            NAMES.join(", ")
        ))
    })?;
    let interval = Interval {
        log: query.log,
        from_s: query.from_s,
        to_s: query.to_s,
        points: query.points,
    };
    interval.check()?;
    let source = Source::find(&app, &caller, &id, interval.log).await?;
    let name = source.name.clone();
    let read = blocking(move || source.channel(channel, &interval)).await?;
    read.map(Json).ok_or_else(|| {
        Problem::unprocessable(format!(
            "{name} lacks what channel '{}' needs: it cannot be tested with this log",
            query.channel
        ))
    })
}

/// The flight conditions of a compared log, in the same buckets as a channel's series.
#[utoipa::path(get, path = "/api/v1/comparisons/{id}/conditions", tag = "comparisons", operation_id = "comparison_conditions", params(("id" = String, Path), Interval), responses(
    (status = 200, description = "the conditions", body = ConditionSeries),
    (status = 400, description = "invalid parameter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "comparison not found, or it has no such log", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the job is not done", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "empty interval", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn conditions(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    interval: Result<Query<Interval>, QueryRejection>,
) -> Result<Json<ConditionSeries>, Problem> {
    let (Path(id), Query(interval)) = (id?, interval?);
    interval.check()?;
    let source = Source::find(&app, &caller, &id, interval.log).await?;
    blocking(move || source.conditions(&interval)).await.map(Json)
}

impl Interval {
    fn check(&self) -> Result<(), Problem> {
        let points = self.points.unwrap_or(USUAL_POINTS);
        if !(1..=MOST_POINTS).contains(&points) {
            return Err(Problem::unprocessable(format!(
                "`points` is {points}; expected 1 to {MOST_POINTS}"
            )));
        }
        let (from, to) = (
            self.from_s.unwrap_or(f64::NEG_INFINITY),
            self.to_s.unwrap_or(f64::INFINITY),
        );
        if from.is_nan() || to.is_nan() || from > to {
            return Err(Problem::unprocessable(format!(
                "from {from} s to {to} s is not an interval; expected `from_s` before `to_s`"
            )));
        }
        Ok(())
    }
}

/// The file with the residuals of one log, and the result's entry for it.
struct Source {
    path: PathBuf,
    place: usize,
    name: String,
    labels: Vec<String>,
}

/// What is needed of the result.
#[derive(Deserialize)]
struct Compared {
    models: Vec<Model>,
    logs: Vec<Log>,
}

#[derive(Deserialize)]
struct Model {
    label: String,
}

#[derive(Deserialize)]
struct Log {
    log: Reference,
}

#[derive(Deserialize)]
struct Reference {
    name: String,
}

impl Source {
    async fn find(app: &App, caller: &Caller, id: &str, place: usize) -> Result<Self, Problem> {
        let job = done(app, caller, JobKind::Comparison, id).await?;
        let text = job.result.unwrap_or_default();
        let result: Compared = serde_json::from_str(&text).map_err(|error| Problem::internal(&error))?;
        let names: Vec<&str> = result.logs.iter().map(|log| log.log.name.as_str()).collect();
        let name = names.get(place).ok_or_else(|| {
            Problem::not_found(format!(
                "the comparison {id} has {} logs, from 0; got `log` = {place}",
                names.len()
            ))
        })?;
        let file = residuals_file(&names, place);
        let path = app
            .artifacts
            .file(job.folder.as_deref().unwrap_or_default(), &file)
            .await;
        let path = path.map_err(|error| Problem::of_files(&error))?;
        Ok(Self {
            path: path
                .ok_or_else(|| Problem::not_found(format!("the residuals of comparison {id} were deleted: {file}")))?,
            place,
            name: (*name).to_owned(),
            labels: result.models.into_iter().map(|model| model.label).collect(),
        })
    }

    /// `None`: the log cannot test it.
    fn channel(&self, channel: usize, interval: &Interval) -> Result<Option<ChannelSeries>, QueryError> {
        let file = TelemetryFile::open(&self.path)?;
        let prefix = NAMES[channel];
        let mut names = vec![TIME.to_owned(), format!("{prefix}_measured")];
        names.extend((0..self.labels.len()).map(|place| format!("{prefix}_residual_{place}")));
        if names
            .iter()
            .any(|name| file.channels().iter().all(|known| known.name != *name))
        {
            return Ok(None);
        }
        let mut columns = read(&file, &names)?;
        let residuals = columns.split_off(2);
        let (time, measured) = (&columns[0], &columns[1]);
        let cut = Cut::new(time, interval);
        let covariance = covariance(&file, channel);
        let models = self.labels.iter().zip(&residuals).map(|(label, residual)| {
            let predicted: Vec<f64> = measured.iter().zip(residual).map(|(m, r)| m - r).collect();
            ModelSeries {
                label: label.clone(),
                predicted: cut.buckets(&predicted),
                residual: cut.buckets(residual),
            }
        });
        // Where nothing counts for the models, nothing is shown.
        let counted: Vec<f64> = match residuals.first() {
            Some(residual) => {
                let counts = |(m, r): (&f64, &f64)| if r.is_finite() { *m } else { f64::NAN };
                measured.iter().zip(residual).map(counts).collect()
            }
            None => measured.clone(),
        };
        Ok(Some(ChannelSeries {
            log: self.place,
            name: self.name.clone(),
            channel: prefix.to_owned(),
            unit: UNITS[channel].to_owned(),
            start_s: time.first().copied().unwrap_or(0.0),
            end_s: time.last().copied().unwrap_or(0.0),
            source_rows: cut.rows.len(),
            bucket_s: cut.bucket_s(),
            time_s: cut.times(),
            measured: cut.buckets(&counted),
            models: models.collect(),
            noise: NoiseOfBucket {
                sample: covariance.deviation_of_mean(1),
                mean: covariance.deviation_of_mean(cut.bucket),
            },
        }))
    }

    fn conditions(&self, interval: &Interval) -> Result<ConditionSeries, QueryError> {
        let file = TelemetryFile::open(&self.path)?;
        let known: Vec<[String; 3]> = file
            .fact("conditions")
            .and_then(|text| serde_json::from_str(text).ok())
            .unwrap_or_default();
        let mut names = vec![TIME.to_owned()];
        names.extend(known.iter().map(|[name, ..]| format!("{CONDITION}{name}")));
        let columns = read(&file, &names)?;
        let cut = Cut::new(&columns[0], interval);
        let items = known
            .into_iter()
            .zip(&columns[1..])
            .map(|([name, title, unit], values)| ConditionMeans {
                name,
                title,
                unit,
                mean: cut.buckets(values).mean,
            });
        Ok(ConditionSeries {
            log: self.place,
            name: self.name.clone(),
            source_rows: cut.rows.len(),
            bucket_s: cut.bucket_s(),
            time_s: cut.times(),
            items: items.collect(),
        })
    }
}

/// Whole columns of a file.
fn read(file: &TelemetryFile, names: &[String]) -> Result<Vec<Vec<f64>>, QueryError> {
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut columns = vec![Vec::new(); names.len()];
    file.for_each_block(&names, |block| {
        for (column, values) in columns.iter_mut().zip(block) {
            column.extend_from_slice(values);
        }
        Ok::<(), QueryError>(())
    })?;
    Ok(columns)
}

/// What pure noise does to a sample of a channel; nothing where the file does not say.
fn covariance(file: &TelemetryFile, channel: usize) -> Covariance {
    let all: Vec<[f64; 2]> = file
        .fact("covariances")
        .and_then(|text| serde_json::from_str(text).ok())
        .unwrap_or_default();
    let [variance, lag_one] = all.get(channel).copied().unwrap_or_default();
    Covariance { variance, lag_one }
}

/// The rows of an interval, in buckets.
struct Cut<'a> {
    time: &'a [f64],
    rows: std::ops::Range<usize>,
    /// Rows of a bucket.
    bucket: usize,
}

impl<'a> Cut<'a> {
    fn new(time: &'a [f64], interval: &Interval) -> Self {
        let from = interval.from_s.map_or(0, |from| time.partition_point(|t| *t < from));
        let to = interval
            .to_s
            .map_or(time.len(), |to| time.partition_point(|t| *t <= to));
        let rows = from..to.max(from);
        let points = interval.points.unwrap_or(USUAL_POINTS);
        Self {
            time,
            bucket: rows.len().div_ceil(points).max(1),
            rows,
        }
    }

    fn bucket_s(&self) -> f64 {
        let span = self.time.last().copied().unwrap_or(0.0) - self.time.first().copied().unwrap_or(0.0);
        let steps = self.time.len().saturating_sub(1).max(1);
        self.bucket as f64 * span / steps as f64
    }

    fn times(&self) -> Vec<f64> {
        let chunks = self.time[self.rows.clone()].chunks(self.bucket);
        chunks.map(|chunk| 0.5 * (chunk[0] + chunk[chunk.len() - 1])).collect()
    }

    fn buckets(&self, values: &[f64]) -> Buckets {
        let mut buckets = Buckets::default();
        for chunk in values[self.rows.clone()].chunks(self.bucket) {
            let (mut sum, mut count) = (0.0, 0_usize);
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for value in chunk.iter().copied().filter(|value| value.is_finite()) {
                sum += value;
                count += 1;
                low = low.min(value);
                high = high.max(value);
            }
            let any = count > 0;
            buckets.mean.push(any.then(|| sum / count as f64));
            buckets.low.push(any.then_some(low));
            buckets.high.push(any.then_some(high));
        }
        buckets
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn interval(from_s: Option<f64>, to_s: Option<f64>, points: usize) -> Interval {
        Interval {
            log: 0,
            from_s,
            to_s,
            points: Some(points),
        }
    }

    #[test]
    fn prop_no_spike_disappears_in_a_bucket() {
        let time: Vec<f64> = (0..1000).map(|k| 0.01 * f64::from(k)).collect();
        let mut values: Vec<f64> = (0..1000).map(|k| f64::from(k % 7)).collect();
        values[503] = 99.0;
        values[7] = f64::NAN;
        for points in [1, 3, 10, 333, 1000, 5000] {
            let cut = Cut::new(&time, &interval(None, None, points));
            let buckets = cut.buckets(&values);
            assert!(buckets.mean.len() <= points);
            assert_eq!(
                (buckets.mean.len(), cut.times().len()),
                (buckets.low.len(), buckets.high.len())
            );
            let highest = buckets.high.iter().flatten().copied().fold(f64::MIN, f64::max);
            assert!((highest - 99.0).abs() < 1e-12, "{points}");
            let inside = buckets.low.iter().zip(&buckets.mean).zip(&buckets.high);
            assert!(inside.clone().all(|((low, mean), high)| low <= mean && mean <= high));
        }
        // One sample per bucket: a masked one gives none.
        let cut = Cut::new(&time, &interval(None, None, 1000));
        assert_eq!(cut.buckets(&values).mean[7], None);
    }

    #[test]
    fn val_an_interval_has_the_rows_within_it() {
        let time: Vec<f64> = (0..100).map(|k| 0.5 * f64::from(k)).collect();
        let cut = Cut::new(&time, &interval(Some(10.0), Some(12.0), 900));
        assert_eq!((cut.rows.clone(), cut.bucket), (20..25, 1));
        assert!((cut.bucket_s() - 0.5).abs() < 1e-12);
        assert!(Cut::new(&time, &interval(Some(1e9), None, 5)).times().is_empty());
        assert!(interval(Some(2.0), Some(1.0), 5).check().is_err());
        assert!(interval(None, None, 0).check().is_err());
    }
}
