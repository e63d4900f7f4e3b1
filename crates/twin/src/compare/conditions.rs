//! Flight conditions of a log, and how a residual depends on them: binned means with bands.

use serde::Serialize;
use utoipa::ToSchema;

use super::statistics::finite_mean;
use crate::Z95;
use crate::predict::Series;
use crate::predict::series::Drive;
use crate::predict::vectors::{rotation, to_body};

/// Bins of a condition.
const BINS: usize = 12;
/// Blocks below which a bin is left out.
const LEAST_BLOCKS: usize = 4;

/// One condition of a flight, a value per sample.
#[derive(Debug, Clone)]
pub struct Condition {
    /// Key: `forward_speed`.
    pub name: &'static str,
    /// For people: `forward speed`.
    pub title: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// NaN where unknown.
    pub values: Vec<f64>,
}

/// The conditions that can be derived from a log.
pub fn of(series: &Series) -> Vec<Condition> {
    let (raw, have) = (&series.smooth, series.available);
    let mut found = Vec::new();
    let mut put = |name, title, unit, values: Vec<f64>| {
        if values.iter().any(|v| v.is_finite()) {
            found.push(Condition {
                name,
                title,
                unit,
                values,
            });
        }
    };
    let each = |value: &dyn Fn(usize) -> f64| -> Vec<f64> { (0..series.len).map(value).collect() };
    if have.velocity && have.attitude {
        let body: Vec<_> = (0..series.len)
            .map(|k| to_body(&rotation(raw.attitude[k]), raw.velocity[k]))
            .collect();
        put(
            "forward_speed",
            "forward speed",
            "m/s",
            body.iter().map(|v| v[0]).collect(),
        );
        put(
            "sideways_speed",
            "sideways speed",
            "m/s",
            body.iter().map(|v| v[1]).collect(),
        );
    }
    if have.velocity {
        put(
            "speed",
            "speed over ground",
            "m/s",
            each(&|k| {
                let v = raw.velocity[k];
                (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
            }),
        );
        put("climb", "climb rate", "m/s", each(&|k| -raw.velocity[k][2]));
    }
    if series.height.iter().any(|h| h.is_finite()) {
        put(
            "height",
            "height above ground",
            "m",
            each(&|k| {
                if series.height[k].is_finite() {
                    series.height[k]
                } else {
                    f64::NAN
                }
            }),
        );
    } else if have.position {
        put("height", "height over the origin", "m", each(&|k| -raw.position[k][2]));
    }
    if series.drive == Drive::Duty {
        let n = series.rotors;
        put(
            "throttle",
            "mean duty",
            "",
            each(&|k| series.input[k * n..(k + 1) * n].iter().sum::<f64>() / n as f64),
        );
    }
    if have.rates {
        put("roll_rate", "roll rate", "rad/s", each(&|k| raw.rates[k][0]));
        put("pitch_rate", "pitch rate", "rad/s", each(&|k| raw.rates[k][1]));
        put("yaw_rate", "yaw rate", "rad/s", each(&|k| raw.rates[k][2]));
    }
    if have.attitude {
        put(
            "tilt",
            "tilt",
            "rad",
            each(&|k| {
                let [roll, pitch, _] = raw.attitude[k];
                libm::acos((libm::cos(roll) * libm::cos(pitch)).clamp(-1.0, 1.0))
            }),
        );
    }
    if have.voltage {
        put("voltage", "battery voltage", "V", series.voltage.clone());
    }
    found
}

/// A residual against a condition.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Dependence {
    /// Key of the condition.
    pub condition: &'static str,
    /// Readable name.
    pub title: &'static str,
    /// Unit of the condition.
    pub unit: &'static str,
    /// Fraction of the variance of the residual's block means that lies between the bins, 0 to 1, corrected for their
    /// number.
    pub explained: f64,
    /// The bins with enough data, by increasing condition.
    pub bins: Vec<Bin>,
}

/// One bin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Bin {
    /// Mean of the condition.
    pub at: f64,
    /// Mean residual, unit of the channel.
    pub mean: f64,
    /// Half width of the band that contains 95 % of the means of pure noise.
    pub band_95: f64,
    /// chi² per block: 1 for pure noise.
    pub chi2: f64,
    /// Number of blocks.
    pub blocks: usize,
}

/// How block means of a residual depend on block means of a condition; `deviation` is that of a block mean of pure noise.
pub fn dependence(condition: &Condition, at: &[f64], residual: &[f64], deviation: f64) -> Option<Dependence> {
    let pairs: Vec<(f64, f64)> = at
        .iter()
        .copied()
        .zip(residual.iter().copied())
        .filter(|(x, r)| x.is_finite() && r.is_finite())
        .collect();
    let low = pairs.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let high = pairs.iter().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
    if pairs.len() < 4 * LEAST_BLOCKS || high - low < 1e-6 * (1.0 + high.abs()) {
        return None;
    }
    let mut members = vec![Vec::new(); BINS];
    for (x, r) in &pairs {
        let place = ((x - low) / (high - low) * BINS as f64) as usize;
        members[place.min(BINS - 1)].push((*x, *r));
    }
    let (total, _) = finite_mean(pairs.iter().map(|p| p.1));
    let (mut between, mut used, mut counted) = (0.0, 0_usize, 0_usize);
    let mut bins = Vec::new();
    for bin in members.iter().filter(|bin| bin.len() >= LEAST_BLOCKS) {
        let count = bin.len() as f64;
        let mean = bin.iter().map(|p| p.1).sum::<f64>() / count;
        between += count * (mean - total) * (mean - total);
        used += 1;
        counted += bin.len();
        bins.push(Bin {
            at: bin.iter().map(|p| p.0).sum::<f64>() / count,
            mean,
            band_95: Z95 * deviation / count.sqrt(),
            chi2: bin.iter().map(|p| p.1 * p.1).sum::<f64>() / (count * deviation * deviation),
            blocks: bin.len(),
        });
    }
    if used < 2 {
        return None;
    }
    let kept = pairs.iter().map(|p| (p.1 - total) * (p.1 - total)).sum::<f64>();
    // Adjusted as R²: bins of noise explain nothing on average.
    let raw = if kept > 0.0 { (between / kept).min(1.0) } else { 0.0 };
    let freedom = (counted as f64 - 1.0) / (counted as f64 - used as f64).max(1.0);
    let explained = (1.0 - (1.0 - raw) * freedom).max(0.0);
    Some(Dependence {
        condition: condition.name,
        title: condition.title,
        unit: condition.unit,
        explained,
        bins,
    })
}
