//! Description of the rest of a channel: how large, how fast, and with what it correlates.

use crate::estimation::parameters::number;
use crate::predict::{NAMES, Predictor};

/// Means of such lengths part an error by how fast it changes, s.
const SLOW_S: f64 = 10.0;
const MIDDLE_S: f64 = 1.0;
/// Smallest correlation that is reported.
const WORTH_TELLING: f64 = 0.3;

/// What is left of a channel.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rest {
    pub(super) channel: usize,
    /// Root mean square of means of 0.1 s, in the unit of the channel.
    pub(super) error: f64,
    /// What noise leaves of such means.
    pub(super) noise: f64,
    /// Shares of the mean square: constant, slower than 10 s, 1 to 10 s, faster.
    pub(super) shares: [f64; 4],
}

impl Rest {
    /// * `means`: of consecutive stretches of `mean_s`; intervals between two parts of a flight are left out
    pub(super) fn of(channel: usize, means: &[f64], noise: f64, mean_s: f64) -> Self {
        let square = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>() / x.len().max(1) as f64;
        let joined = |length_s: f64| -> Vec<f64> {
            let group = ((length_s / mean_s).round() as usize).max(1);
            means
                .chunks(group)
                .flat_map(|chunk| vec![chunk.iter().sum::<f64>() / chunk.len() as f64; chunk.len()])
                .collect()
        };
        let all = square(means);
        let mean = means.iter().sum::<f64>() / means.len().max(1) as f64;
        let (slow, middle) = (square(&joined(SLOW_S)), square(&joined(MIDDLE_S)));
        let constant = mean * mean;
        let shares = [constant, slow - constant, middle - slow, all - middle]
            .map(|part| (part / all.max(f64::MIN_POSITIVE)).max(0.0));
        Self {
            channel,
            error: all.sqrt(),
            noise,
            shares,
        }
    }
}

/// A channel in words.
fn channel_words(channel: usize) -> &'static str {
    match NAMES[channel] {
        "fx" => "specific force forward",
        "fy" => "specific force to the right",
        "fz" => "specific force downwards",
        "mx" => "roll acceleration",
        "my" => "pitch acceleration",
        "mz" => "yaw acceleration",
        "v" => "voltage",
        other => other,
    }
}

/// In a sentence.
pub(super) fn sentence(predictor: &Predictor, rest: &Rest, follows: Option<(String, f64)>, name: bool) -> String {
    let unit = match NAMES[rest.channel] {
        "mx" | "my" | "mz" => "rad/s²",
        "v" => "V",
        _ => "m/s²",
    };
    let of = if name {
        format!(" of {}", predictor.name)
    } else {
        String::new()
    };
    let [constant, slow, middle, fast] = rest.shares.map(|share| 100.0 * share);
    let follows = follows
        .filter(|(_, correlation)| correlation.abs() >= WORTH_TELLING)
        .map_or(
            "; follows no term of motion, thrust or time (all correlations below 0.3)".to_owned(),
            |(what, correlation)| format!("; follows {what} (correlation {correlation:.2})"),
        );
    format!(
        "left in {} ({}){of}: {} {unit}, noise {}; of its square {constant:.0} % constant, {slow:.0} % slower than 10 s, {middle:.0} % 1 to 10 s, {fast:.0} % \
         faster{follows}",
        NAMES[rest.channel],
        channel_words(rest.channel),
        number(rest.error),
        number(rest.noise),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_an_error_is_parted_by_how_fast_it_changes() {
        let of = |f: &dyn Fn(f64) -> f64| {
            let means: Vec<f64> = (0..1000).map(|k| f(0.1 * f64::from(k))).collect();
            Rest::of(0, &means, 0.1, 0.1).shares
        };
        let wave = |period_s: f64| move |t: f64| (std::f64::consts::TAU * t / period_s).sin();
        assert!(of(&|_| 2.0)[0] > 0.99);
        assert!(of(&wave(60.0))[1] > 0.8, "{:?}", of(&wave(60.0)));
        // A mean over a quarter of a period keeps 8/π² = 0.81 of the square, of which means over 10 s keep some.
        assert!(of(&wave(4.0))[2] > 0.75, "{:?}", of(&wave(4.0)));
        assert!(of(&wave(0.5))[3] > 0.95, "{:?}", of(&wave(0.5)));
    }
}
