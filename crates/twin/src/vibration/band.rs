//! Vibration of a vehicle as a whole, if rotor speeds are unknown: the sensor's vibration above the frequencies of the
//! vehicle's own motion.
//!
//! ```text
//! P = median over half seconds of  Σ_k Σ_axes 4 |Σ w y e^(−2πi f_k t)|² / (N Σ w²),   f_k = 2 Hz k from 25 Hz to 0.45 of the rate
//! ```
//! with Hann's weights, so that a single line of amplitude A gives A². The median ignores short events: a landing, a
//! knock. Lines above half of the sensor's rate alias into the band as far as the sensor's own filter lets them
//! through; they count, too.
//!
//! It cannot identify single rotors, and it does not refer to a rotor speed: heavier or faster flights may vibrate more
//! without damage.

use super::orders::{BLOCK_S, Shaken, hann};
use super::speeds::{FASTEST, SLOWEST_HZ};
use crate::predict::noise::median;
use std::f64::consts::TAU;

/// The upper end of the band is at least this many times its lower end.
const LEAST_WIDTH: f64 = 2.0;

/// Vibration of all rotors and everything else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Whole {
    /// a² + b² of one line that would shake as much, over all axes.
    pub(super) power: f64,
    /// Where it is strongest, Hz.
    pub(super) strongest_hz: f64,
}

/// Band of a sensor, Hz; none if the sensor is too slow for one.
pub(super) fn of_rate(rate_hz: f64) -> Option<[f64; 2]> {
    let top = FASTEST * rate_hz;
    (top >= least_top()).then_some([SLOWEST_HZ, top])
}

/// Lowest upper end of a band, Hz.
pub(super) fn least_top() -> f64 {
    LEAST_WIDTH * SLOWEST_HZ
}

/// Slowest sensor that has a band, Hz.
pub(super) fn least_rate() -> f64 {
    least_top() / FASTEST
}

/// Vibration within a band; none if no block is whole.
pub(super) fn whole(shaken: &Shaken<'_>, band_hz: [f64; 2], most_blocks: usize) -> Option<Whole> {
    let bins = (band_hz[0] * BLOCK_S).ceil() as usize..=(band_hz[1] * BLOCK_S).floor() as usize;
    let mut spectrum = vec![0.0; bins.clone().count()];
    let mut totals = Vec::new();
    for rows in shaken.spread_blocks(most_blocks) {
        let time_s = &shaken.time_s[rows.clone()];
        let weights = hann(time_s);
        let sum: f64 = weights.iter().sum();
        let squares: f64 = weights.iter().map(|w| w * w).sum();
        let scale = 4.0 / (time_s.len() as f64 * squares);
        let mut block = vec![0.0; spectrum.len()];
        for axis in shaken.axes {
            let values = &axis[rows.clone()];
            let mean = values.iter().zip(&weights).map(|(y, w)| y * w).sum::<f64>() / sum;
            let weighted: Vec<f64> = values.iter().zip(&weights).map(|(y, w)| w * (y - mean)).collect();
            for (power, bin) in block.iter_mut().zip(bins.clone()) {
                *power += scale * square(&weighted, time_s, bin as f64 / BLOCK_S);
            }
        }
        let total: f64 = block.iter().sum();
        if total.is_finite() {
            totals.push(total);
            spectrum.iter_mut().zip(&block).for_each(|(sum, power)| *sum += power);
        }
    }
    let strongest = (0..spectrum.len()).max_by(|a, b| spectrum[*a].total_cmp(&spectrum[*b]))?;
    (!totals.is_empty()).then(|| Whole {
        power: median(&mut totals),
        strongest_hz: (bins.start() + strongest) as f64 / BLOCK_S,
    })
}

/// |Σ y e^(−2πi f t)|².
fn square(values: &[f64], time_s: &[f64], hz: f64) -> f64 {
    let (mut real, mut imaginary) = (0.0, 0.0);
    for (y, t) in values.iter().zip(time_s) {
        let (sin, cos) = (TAU * hz * (t - time_s[0])).sin_cos();
        real += y * cos;
        imaginary += y * sin;
    }
    real * real + imaginary * imaginary
}
