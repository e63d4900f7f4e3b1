//! Lines at the rotor speeds in a vibration: order tracking by weighted least squares, block by block.
//!
//! In a block of [`BLOCK_S`] an axis of the sensor is
//!
//! ```text
//! y(t) = c₀ + c₁ t + c₂ t² + Σ_r (Ω_r(t)/Ω_ref)² (a_r cos φ_r(t) + b_r sin φ_r(t)) + e(t),   φ_r(t) = ∫ Ω_r dt
//! ```
//! fitted to all rotors at once with Hann's weights, because rotors that turn almost alike share a line and only the fit of all says how
//! well they are told apart. An unbalanced rotor pulls with m r Ω², hence the square. Phases are not carried from block to block: the
//! speed of a rotor is not known well enough for that. So the power a² + b² of the blocks is averaged, less what noise alone would give,
//! which is measured beside the lines, where no rotor turns.
//!
//! Source of the idea: Ghalamchi and Mueller, *Vibration-Based Propeller Fault Diagnosis for Multicopters*, ICUAS 2018 (rotors turn at
//! different speeds in manoeuvres, so the spectrum isolates them); the joint fit is that of Vold and Kalman's order tracking without its
//! smoothness term.

use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;
use std::ops::Range;

/// Length of a block, s: two lines 4 Hz apart are told apart in it, and a speed that is 0.5 % off turns 100 Hz by a quarter.
pub(super) const BLOCK_S: f64 = 0.5;
/// Least share of the rows that a block must have.
const LEAST_ROWS: f64 = 0.8;
/// Terms of the slow motion below the lines.
const SLOW: usize = 3;
/// Where the noise is measured, in orders of the mean speed of the rotors.
const BESIDE: [f64; 10] = [0.62, 0.70, 0.78, 0.86, 0.93, 1.07, 1.14, 1.22, 1.30, 1.38];
/// Least distance of such a place from every line, in widths of a block's line (1/T).
const CLEAR: f64 = 3.0;
/// A rotor counts in a block if the fit of all rotors makes its line at most so much noisier than it would be alone.
const MOST_INFLATION: f64 = 6.0;
/// Least blocks that make a line.
pub(super) const LEAST_BLOCKS: usize = 8;

/// One sensor with the speeds of the rotors, on the rows of a log.
#[derive(Debug, Clone)]
pub(super) struct Shaken<'a> {
    /// s.
    pub(super) time_s: &'a [f64],
    /// Axes of the sensor.
    pub(super) axes: [&'a [f64]; 3],
    /// Speed of each rotor at each row, rad/s.
    pub(super) speeds: Vec<Vec<f64>>,
    /// Speed to which amplitudes refer, rad/s.
    pub(super) reference: f64,
    /// Blocks of rows.
    pub(super) blocks: Vec<Range<usize>>,
}

/// Power of a rotor's line at the reference speed: a² + b², summed over the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Power {
    pub(super) mean: f64,
    /// Standard error, from the spread over the blocks.
    pub(super) error: f64,
    /// Blocks in which the rotor is told apart from the others.
    pub(super) blocks: usize,
}

/// Blocks of whole rows within the seconds in the air.
pub(super) fn blocks(time_s: &[f64], air: &[(f64, f64)], rate_hz: f64) -> Vec<Range<usize>> {
    let least = (LEAST_ROWS * BLOCK_S * rate_hz) as usize;
    let mut found = Vec::new();
    for (from, to) in air {
        let count = ((to - from) / BLOCK_S).floor() as usize;
        for k in 0..count {
            let start = from + k as f64 * BLOCK_S;
            let first = time_s.partition_point(|t| *t < start);
            let last = time_s.partition_point(|t| *t < start + BLOCK_S);
            if last - first >= least {
                found.push(first..last);
            }
        }
    }
    found
}

/// Hann's weights over a block.
fn hann(time_s: &[f64]) -> Vec<f64> {
    let start = time_s[0];
    let span = time_s[time_s.len() - 1] - start;
    let weight = |t: &f64| 0.5 - 0.5 * (TAU * (t - start) / span).cos();
    time_s.iter().map(weight).collect()
}

/// Angle of a rotor since the first row, by the trapezoidal rule, rad.
fn phase(time_s: &[f64], speed: &[f64]) -> Vec<f64> {
    let mut angle = 0.0;
    let mut angles = vec![0.0; time_s.len()];
    for k in 1..time_s.len() {
        angle += 0.5 * (speed[k] + speed[k - 1]) * (time_s[k] - time_s[k - 1]);
        angles[k] = angle;
    }
    angles
}

/// |a − i b|² of one line alone in a signal whose slow part is gone: 2/Σw Σ w y e^(−iφ).
fn alone(weights: &[f64], values: &[f64], angle: impl Fn(usize) -> f64) -> f64 {
    let (mut real, mut imaginary) = (0.0, 0.0);
    for (k, (w, y)) in weights.iter().zip(values).enumerate() {
        let (sin, cos) = angle(k).sin_cos();
        real += w * y * cos;
        imaginary += w * y * sin;
    }
    let total: f64 = weights.iter().sum();
    4.0 * (real * real + imaginary * imaginary) / (total * total)
}

/// The lines of one block.
struct Lines {
    /// Hann's weights and the angles of the rotors.
    weights: Vec<f64>,
    angles: Vec<Vec<f64>>,
    /// (Ω/Ω_ref)², rotor by rotor.
    gains: Vec<Vec<f64>>,
    /// What is left of each axis.
    residuals: Vec<Vec<f64>>,
    /// a and b of each rotor, axis by axis.
    coefficients: Vec<DVector<f64>>,
    /// Noise of each rotor's power over that of a line alone.
    inflation: Vec<f64>,
}

impl Lines {
    /// Fits a block; `None` where the fit is singular or a value is missing.
    fn fit(shaken: &Shaken<'_>, rows: &Range<usize>) -> Option<Self> {
        let time_s = &shaken.time_s[rows.clone()];
        let weights = hann(time_s);
        let rotors = shaken.speeds.len();
        let angles: Vec<Vec<f64>> = shaken.speeds.iter().map(|s| phase(time_s, &s[rows.clone()])).collect();
        let gain = |speeds: &Vec<f64>| -> Vec<f64> {
            speeds[rows.clone()].iter().map(|s| (s / shaken.reference).powi(2)).collect()
        };
        let gains: Vec<Vec<f64>> = shaken.speeds.iter().map(gain).collect();
        let (count, unknowns) = (time_s.len(), SLOW + 2 * rotors);
        let middle = 0.5 * (time_s[0] + time_s[count - 1]);
        let design = DMatrix::from_fn(count, unknowns, |k, j| {
            if j < SLOW {
                return ((time_s[k] - middle) / BLOCK_S).powi(j as i32);
            }
            let rotor = (j - SLOW) / 2;
            let (sin, cos) = angles[rotor][k].sin_cos();
            gains[rotor][k] * if (j - SLOW) % 2 == 0 { cos } else { sin }
        });
        let weighted = DMatrix::from_fn(count, unknowns, |k, j| weights[k] * design[(k, j)]);
        let inverse = (weighted.transpose() * &design).cholesky()?.inverse();
        let spread = &inverse * (weighted.transpose() * &weighted) * &inverse;
        let (sum, squares) = weights.iter().fold((0.0, 0.0), |(s, q), w| (s + w, q + w * w));
        let lone = 4.0 * squares / (sum * sum);
        let inflation = (0..rotors)
            .map(|r| {
                let j = SLOW + 2 * r;
                let mean_gain = gains[r].iter().sum::<f64>() / count as f64;
                (spread[(j, j)] + spread[(j + 1, j + 1)]) / lone * mean_gain * mean_gain
            })
            .collect();
        let mut coefficients = Vec::new();
        let mut residuals = Vec::new();
        for axis in shaken.axes {
            let values = DVector::from_column_slice(&axis[rows.clone()]);
            let solution = &inverse * (weighted.transpose() * &values);
            let rest = values - &design * &solution;
            if !rest.iter().all(|x| x.is_finite()) {
                return None;
            }
            residuals.push(rest.as_slice().to_vec());
            coefficients.push(solution);
        }
        Some(Self {
            weights,
            angles,
            gains,
            residuals,
            coefficients,
            inflation,
        })
    }

    /// a² + b² of a rotor on an axis.
    fn power(&self, axis: usize, rotor: usize) -> f64 {
        let c = &self.coefficients[axis];
        c[SLOW + 2 * rotor].powi(2) + c[SLOW + 2 * rotor + 1].powi(2)
    }

    /// Power of a line where no rotor turns, axis by axis.
    fn noise(&self, time_s: &[f64], speeds: &[f64]) -> Vec<f64> {
        let start = time_s[0];
        let span = time_s[time_s.len() - 1] - start;
        let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
        let nyquist = 0.5 * TAU * (time_s.len() - 1) as f64 / span;
        let width = CLEAR * TAU / span;
        let clear = |place: f64| {
            place > 2.0 * width && place < 0.95 * nyquist && speeds.iter().all(|s| (s - place).abs() > width)
        };
        let mut places: Vec<f64> = BESIDE.iter().map(|order| order * mean).filter(|p| clear(*p)).collect();
        if places.is_empty() {
            // Rotors spread over everything beside them: what the residual leaves at their own middle.
            places.push(mean);
        }
        let at = |residual: &Vec<f64>| {
            let powers = places.iter().map(|place| alone(&self.weights, residual, |k| place * (time_s[k] - start)));
            powers.sum::<f64>() / places.len() as f64
        };
        self.residuals.iter().map(at).collect()
    }

    /// The signal of one rotor with what no rotor explains, on an axis.
    fn with_rotor(&self, axis: usize, rotor: usize) -> Vec<f64> {
        let (a, b) = (self.coefficients[axis][SLOW + 2 * rotor], self.coefficients[axis][SLOW + 2 * rotor + 1]);
        let own = self.angles[rotor].iter().zip(&self.gains[rotor]);
        self.residuals[axis]
            .iter()
            .zip(own)
            .map(|(rest, (angle, gain))| rest + gain * (a * angle.cos() + b * angle.sin()))
            .collect()
    }
}

impl Shaken<'_> {
    /// Mean speed of each rotor in a block, rad/s.
    fn mean_speeds(&self, rows: &Range<usize>) -> Vec<f64> {
        let mean = |s: &Vec<f64>| s[rows.clone()].iter().sum::<f64>() / rows.len() as f64;
        self.speeds.iter().map(mean).collect()
    }

    /// Power of each rotor's line; `None` for one that is told apart in fewer than [`LEAST_BLOCKS`].
    pub(super) fn powers(&self) -> Vec<Option<Power>> {
        let mut found: Vec<Vec<(f64, f64)>> = vec![Vec::new(); self.speeds.len()];
        for rows in &self.blocks {
            let Some(lines) = Lines::fit(self, rows) else { continue };
            let noise = lines.noise(&self.time_s[rows.clone()], &self.mean_speeds(rows));
            for (rotor, powers) in found.iter_mut().enumerate() {
                let inflation = lines.inflation[rotor];
                if inflation > MOST_INFLATION {
                    continue;
                }
                let power: f64 = (0..3).map(|axis| lines.power(axis, rotor) - inflation * noise[axis]).sum();
                powers.push((power, 1.0 / (inflation * inflation)));
            }
        }
        found.iter().map(|one| mean_power(one)).collect()
    }

    /// Share by which the speeds of a rotor are to be multiplied so that its line is strongest, with the other rotors' lines taken out;
    /// within ± `range`, in steps of a tenth of a line's width.
    pub(super) fn best_scale(&self, rotor: usize, range: f64, most_blocks: usize) -> f64 {
        let step = 0.1 / (BLOCK_S * self.reference / TAU);
        let count = (range / step).ceil() as i64;
        let scales: Vec<f64> = (-count..=count).map(|k| 1.0 + k as f64 * step).collect();
        let mut total = vec![0.0; scales.len()];
        for rows in self.spread_blocks(most_blocks) {
            let Some(lines) = Lines::fit(self, rows) else { continue };
            if lines.inflation[rotor] > MOST_INFLATION {
                continue;
            }
            for axis in 0..3 {
                let signal = lines.with_rotor(axis, rotor);
                for (sum, scale) in total.iter_mut().zip(&scales) {
                    *sum += alone(&lines.weights, &signal, |k| scale * lines.angles[rotor][k]);
                }
            }
        }
        let at_one = total[count as usize];
        let best = (0..total.len()).max_by(|a, b| total[*a].total_cmp(&total[*b]));
        // A tenth more may be noise: then the speed stays as it was said to be.
        best.filter(|k| total[*k] > 1.1 * at_one).map_or(1.0, |k| scales[k])
    }

    /// Power of all rotors' lines, each alone, with all speeds times `scale`; of evenly spread blocks.
    pub(super) fn power_at(&self, scale: f64, most_blocks: usize) -> f64 {
        let mut sum = 0.0;
        for rows in self.spread_blocks(most_blocks) {
            let time_s = &self.time_s[rows.clone()];
            let weights = hann(time_s);
            for speeds in &self.speeds {
                let angles = phase(time_s, &speeds[rows.clone()]);
                for axis in self.axes {
                    sum += alone(&weights, &axis[rows.clone()], |k| scale * angles[k]);
                }
            }
        }
        sum
    }

    fn spread_blocks(&self, most: usize) -> impl Iterator<Item = &Range<usize>> {
        let step = self.blocks.len().div_ceil(most.max(1)).max(1);
        self.blocks.iter().step_by(step)
    }
}

/// Weighted mean with its standard error.
fn mean_power(blocks: &[(f64, f64)]) -> Option<Power> {
    if blocks.len() < LEAST_BLOCKS {
        return None;
    }
    let total: f64 = blocks.iter().map(|(_, w)| w).sum();
    let mean = blocks.iter().map(|(p, w)| p * w).sum::<f64>() / total;
    let squares: f64 = blocks.iter().map(|(p, w)| (w * (p - mean)).powi(2)).sum();
    Some(Power {
        mean,
        error: squares.sqrt() / total,
        blocks: blocks.len(),
    })
}
