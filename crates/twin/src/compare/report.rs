//! `report.html` of a comparison: where, when, how much, what was assumed; the components of the web page, and this result.
//!
//! The plots over time are made from buckets of 0.1 s (longer for long logs): means, and for the residual also the
//! lowest and highest sample, so that no spike disappears. The prediction of a model is the measurement minus its
//! residual, so it is not stored.

use rotortwin_page::{Report, rounded};
use serde::Serialize;

use super::statistics::block_means;
use super::{Comparison, LogComparison, LogSeries};
use crate::flight_picture::FlightPicture;
use crate::predict::{CHANNELS, ChannelResiduals, NAMES, UNITS};

/// Shortest bucket of the plots, s.
const BUCKET_S: f64 = 0.1;
/// Most buckets of a plot.
const MOST_BUCKETS: usize = 1800;

/// A comparison with the data that a page plots.
#[derive(Serialize)]
pub struct Drawn {
    comparison: Comparison,
    pictures: Vec<LogPictures>,
}

impl Drawn {
    /// Decimates the series of a comparison to screen resolution.
    pub fn new(comparison: Comparison, series: &[LogSeries]) -> Self {
        let pictures = pictures_of(&comparison, series);
        Self { comparison, pictures }
    }
}

/// What is inside of the page.
#[derive(Serialize)]
struct Inside<'a> {
    comparison: &'a Comparison,
    pictures: Vec<LogPictures>,
    flights: &'a [FlightPicture],
}

/// One log over time.
#[derive(Serialize)]
struct LogPictures {
    start_s: f64,
    end_s: f64,
    bucket_s: f64,
    /// Middle of each bucket.
    time_s: Vec<Option<f64>>,
    channels: Vec<ChannelPicture>,
    conditions: Vec<ConditionMeans>,
}

/// A flight condition, bucket by bucket: on request the page shows only the buckets within bounds.
#[derive(Serialize)]
struct ConditionMeans {
    name: &'static str,
    title: &'static str,
    unit: &'static str,
    mean: Vec<Option<f64>>,
}

/// One channel that the log can test.
#[derive(Serialize)]
struct ChannelPicture {
    channel: &'static str,
    unit: &'static str,
    noise: NoiseOfBucket,
    measured: Vec<Option<f64>>,
    /// Of each model, in the order of the result.
    residuals: Vec<Residual>,
}

/// Standard deviations of pure noise.
#[derive(Serialize)]
struct NoiseOfBucket {
    sample: Option<f64>,
    mean: Option<f64>,
}

#[derive(Serialize)]
struct Residual {
    mean: Vec<Option<f64>>,
    low: Vec<Option<f64>>,
    high: Vec<Option<f64>>,
}

/// The page; `flights` are the same logs, in the same order.
///
/// # Panics
/// Never: text and numbers are JSON.
pub fn render(comparison: &Comparison, series: &[LogSeries], flights: &[FlightPicture]) -> String {
    let logs: Vec<&str> = comparison.logs.iter().map(|log| log.log.name.as_str()).collect();
    let sentences = comparison.logs.iter().flat_map(|log| {
        let name = &log.log.name;
        log.models
            .iter()
            .map(move |model| format!("{name}: {}", model.sentence()))
    });
    Report {
        kind: "comparison",
        title: &format!("Comparison · {}", logs.join(", ")),
        summary: &sentences.collect::<Vec<_>>().join("\n"),
        program: comparison.tool,
        data: &Inside {
            comparison,
            pictures: pictures_of(comparison, series),
            flights,
        },
    }
    .render()
    .expect("text and numbers are JSON")
}

fn pictures_of(comparison: &Comparison, series: &[LogSeries]) -> Vec<LogPictures> {
    let logs = comparison.logs.iter().zip(series);
    logs.map(|(log, series)| pictures(log, series)).collect()
}

fn pictures(log: &LogComparison, series: &LogSeries) -> LogPictures {
    let step = 1.0 / log.rate_hz;
    let samples = series.time_s.len();
    let bucket = ((BUCKET_S / step).round() as usize)
        .max(samples.div_ceil(MOST_BUCKETS))
        .max(1);
    let chunks = series.time_s.chunks(bucket);
    let covariances = log.noise.covariances(step);
    let channels = (0..CHANNELS).filter_map(|channel| {
        // The same samples count for every model.
        let mask = series.models.first().map(|model| &model.mask[channel])?;
        (!mask.is_empty()).then(|| ChannelPicture {
            channel: NAMES[channel],
            unit: UNITS[channel],
            noise: NoiseOfBucket {
                sample: rounded(covariances[channel].deviation_of_mean(1)),
                mean: rounded(covariances[channel].deviation_of_mean(bucket)),
            },
            measured: all_rounded(block_means(&series.measured[channel], mask, bucket)),
            residuals: series
                .models
                .iter()
                .map(|model| residual(model, channel, bucket))
                .collect(),
        })
    });
    let all = vec![true; samples];
    let conditions = series.conditions.iter().map(|condition| ConditionMeans {
        name: condition.name,
        title: condition.title,
        unit: condition.unit,
        mean: all_rounded(block_means(&condition.values, &all, bucket)),
    });
    LogPictures {
        start_s: series.time_s.first().copied().unwrap_or(0.0),
        end_s: series.time_s.last().copied().unwrap_or(0.0),
        bucket_s: bucket as f64 * step,
        time_s: all_rounded(chunks.map(|chunk| 0.5 * (chunk[0] + chunk[chunk.len() - 1]))),
        channels: channels.collect(),
        conditions: conditions.collect(),
    }
}

fn residual(model: &ChannelResiduals, channel: usize, bucket: usize) -> Residual {
    let (raw, mask) = (&model.raw[channel], &model.mask[channel]);
    let extreme = |pick: fn(f64, f64) -> f64| {
        let of = |(values, mask): (&[f64], &[bool])| {
            let counted = values.iter().zip(mask).filter(|&(_, &counts)| counts);
            counted.map(|(value, _)| *value).reduce(pick).unwrap_or(f64::NAN)
        };
        all_rounded(raw.chunks(bucket).zip(mask.chunks(bucket)).map(of))
    };
    Residual {
        mean: all_rounded(block_means(raw, mask, bucket)),
        low: extreme(f64::min),
        high: extreme(f64::max),
    }
}

fn all_rounded(values: impl IntoIterator<Item = f64>) -> Vec<Option<f64>> {
    values.into_iter().map(rounded).collect()
}
