//! Lines at the rotor speeds in a vibration: order tracking by weighted least squares, block by block.
//!
//! In a block of [`BLOCK_S`] an axis of the sensor is
//!
//! ```text
//! y(t) = c₀ + c₁ t + c₂ t² + Σ_r (Ω_r(t)/Ω_ref)² (a_r cos φ_r(t) + b_r sin φ_r(t)) + e(t),   φ_r(t) = ∫ Ω_r dt
//! ```
//! fitted to all rotors at once with Hann's weights, because rotors at nearly the same speed share a line and only the
//! joint fit shows how well they can be separated. An unbalanced rotor pulls with m r Ω², hence the square. Phases are
//! not carried from block to block: the speed of a rotor is not known well enough for that. So the power a² + b² of the
//! blocks is averaged, minus the contribution of noise, which is measured next to the lines, where no rotor turns.
//!
//! Source of the idea: Ghalamchi and Mueller, *Vibration-Based Propeller Fault Diagnosis for Multicopters*, ICUAS 2018 (rotors turn at
//! different speeds in manoeuvres, so the spectrum isolates them); the joint fit is that of Vold and Kalman's order tracking without its
//! smoothness term.

use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;
use std::ops::Range;

/// Length of a block, s: it resolves two lines 4 Hz apart, and a speed error of 0.5 % rotates the phase at 100 Hz by a
/// quarter turn.
pub(super) const BLOCK_S: f64 = 0.5;
/// Least share of the rows that a block must have.
const LEAST_ROWS: f64 = 0.8;
/// Terms of the slow motion below the lines.
const SLOW: usize = 3;
/// Where the noise is measured, in orders of the mean speed of the rotors.
const BESIDE: [f64; 10] = [0.62, 0.70, 0.78, 0.86, 0.93, 1.07, 1.14, 1.22, 1.30, 1.38];
/// Least distance of such a place from every line, in widths of a block's line (1/T).
const CLEAR: f64 = 3.0;
/// A rotor counts in a block if the fit of all rotors makes its line at most this much noisier than it would be alone.
const MOST_INFLATION: f64 = 6.0;
/// Step between speeds that are tried, in widths of a block's line.
const LINE_SHARE: f64 = 0.1;
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
    /// Blocks in which the rotor is distinguished from the others.
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
pub(super) fn hann(time_s: &[f64]) -> Vec<f64> {
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

/// Scales that are tried on the speeds of rotors: evenly spaced, so that the phasors follow each other by one multiplication.
#[derive(Debug, Clone, Copy)]
pub(super) struct Comb {
    pub(super) first: f64,
    pub(super) step: f64,
    pub(super) count: usize,
}

impl Comb {
    /// About 1 by ± `range`, a tenth of a line's width apart at `speed`, rad/s.
    fn about_one(range: f64, speed: f64) -> Self {
        let step = LINE_SHARE / (BLOCK_S * speed / TAU);
        let half = (range / step).ceil();
        Self {
            first: 1.0 - half * step,
            step,
            count: 2 * half as usize + 1,
        }
    }

    /// From `low` to `high`, a tenth of a line's width apart, of speeds that are 1 in the mean.
    pub(super) fn between(low: f64, high: f64) -> Self {
        let step = TAU * LINE_SHARE / BLOCK_S;
        Self {
            first: low,
            step,
            count: ((high - low) / step).max(0.0) as usize + 1,
        }
    }

    pub(super) fn scale(&self, k: usize) -> f64 {
        self.first + k as f64 * self.step
    }

    /// Adds to `sums` the power of a line alone on all axes, for every scale of its angle.
    fn add(&self, sums: &mut [f64], weights: &[f64], axes: [&[f64]; 3], angles: &[f64]) {
        let total: f64 = weights.iter().sum();
        let mut phasors: Vec<[f64; 2]> = Vec::with_capacity(angles.len());
        let mut turns: Vec<[f64; 2]> = Vec::with_capacity(angles.len());
        for (angle, weight) in angles.iter().zip(weights) {
            let (sin, cos) = (self.first * angle).sin_cos();
            phasors.push([weight * cos, weight * sin]);
            let (sin, cos) = (self.step * angle).sin_cos();
            turns.push([cos, sin]);
        }
        for sum in sums {
            let mut parts = [[0.0; 2]; 3];
            for (k, ([c, s], [cos, sin])) in phasors.iter_mut().zip(&turns).enumerate() {
                for (part, axis) in parts.iter_mut().zip(&axes) {
                    part[0] += *c * axis[k];
                    part[1] += *s * axis[k];
                }
                (*c, *s) = (*c * cos - *s * sin, *s * cos + *c * sin);
            }
            let power: f64 = parts.iter().map(|[a, b]| a * a + b * b).sum();
            *sum += 4.0 * power / (total * total);
        }
    }
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
            speeds[rows.clone()]
                .iter()
                .map(|s| (s / shaken.reference).powi(2))
                .collect()
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
            gains[rotor][k] * if (j - SLOW).is_multiple_of(2) { cos } else { sin }
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
        let places = beside(speeds, time_s);
        let at = |residual: &Vec<f64>| {
            let powers = places
                .iter()
                .map(|place| alone(&self.weights, residual, |k| place * (time_s[k] - start)));
            powers.sum::<f64>() / places.len() as f64
        };
        self.residuals.iter().map(at).collect()
    }

    /// The signal of one rotor plus what no rotor explains, on an axis.
    fn with_rotor(&self, axis: usize, rotor: usize) -> Vec<f64> {
        let (a, b) = (
            self.coefficients[axis][SLOW + 2 * rotor],
            self.coefficients[axis][SLOW + 2 * rotor + 1],
        );
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

    /// Power of each rotor's line; `None` for one that is distinguished in fewer than [`LEAST_BLOCKS`].
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
                let power: f64 = (0..3)
                    .map(|axis| lines.power(axis, rotor) - inflation * noise[axis])
                    .sum();
                powers.push((power, 1.0 / (inflation * inflation)));
            }
        }
        found.iter().map(|one| mean_power(one)).collect()
    }

    /// Share by which the speeds of a rotor are to be multiplied so that its line is strongest, with the other rotors' lines taken out;
    /// within ± `range`.
    pub(super) fn best_scale(&self, rotor: usize, range: f64, most_blocks: usize) -> f64 {
        let comb = Comb::about_one(range, self.reference);
        let mut total = vec![0.0; comb.count];
        for rows in self.spread_blocks(most_blocks) {
            let Some(lines) = Lines::fit(self, rows) else { continue };
            if lines.inflation[rotor] > MOST_INFLATION {
                continue;
            }
            let signals: [Vec<f64>; 3] = std::array::from_fn(|axis| lines.with_rotor(axis, rotor));
            comb.add(
                &mut total,
                &lines.weights,
                signals.each_ref().map(Vec::as_slice),
                &lines.angles[rotor],
            );
        }
        let at_one = total[comb.count / 2];
        let best = (0..total.len()).max_by(|a, b| total[*a].total_cmp(&total[*b]));
        // A tenth more may be noise: then the speed stays as it was said to be.
        best.filter(|k| total[*k] > 1.1 * at_one).map_or(1.0, |k| comb.scale(k))
    }

    /// Power of all rotors' lines, each alone, for every scale of their speeds; of evenly spread blocks.
    pub(super) fn power_at(&self, comb: &Comb, most_blocks: usize) -> Vec<f64> {
        let mut sums = vec![0.0; comb.count];
        for rows in self.spread_blocks(most_blocks) {
            let time_s = &self.time_s[rows.clone()];
            let weights = hann(time_s);
            let axes = self.axes.map(|axis| &axis[rows.clone()]);
            for speeds in &self.speeds {
                comb.add(&mut sums, &weights, axes, &phase(time_s, &speeds[rows.clone()]));
            }
        }
        sums
    }

    /// Lines one after the other, where the scale of each rotor's speed is not known: the rotor and scale with the strongest line is taken
    /// out of the signal, then the next of the others (matching pursuit).
    ///
    /// Rotors of a hover turn alike, and any of them explains any line with a scale of its own. Manoeuvres change that: see [`Pursuit::rival`].
    pub(super) fn pursue(&self, range: f64, most_blocks: usize) -> Pursuit {
        let comb = Comb::about_one(range, self.reference);
        let mut blocks: Vec<Unexplained> = self
            .spread_blocks(most_blocks)
            .map(|rows| self.unexplained(rows))
            .collect();
        let mut pursuit = Pursuit {
            scales: vec![1.0; self.speeds.len()],
            first: 0,
            rival: 0.0,
            power: 0.0,
        };
        let mut left: Vec<usize> = (0..self.speeds.len()).collect();
        while !left.is_empty() {
            // Strongest line of each rotor: power and scale.
            let strongest = |rotor: &usize| {
                let mut powers = vec![0.0; comb.count];
                for block in &blocks {
                    let axes = block.axes.each_ref().map(Vec::as_slice);
                    comb.add(&mut powers, &block.weights, axes, &block.angles[*rotor]);
                }
                let of_scales = powers.iter().enumerate().map(|(k, power)| (*power, comb.scale(k)));
                of_scales.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, 1.0))
            };
            let found: Vec<(f64, f64)> = left.iter().map(strongest).collect();
            let best = (0..left.len())
                .max_by(|a, b| found[*a].0.total_cmp(&found[*b].0))
                .unwrap_or(0);
            let (rotor, (power, scale)) = (left[best], found[best]);
            if left.len() == self.speeds.len() {
                pursuit.first = rotor;
                let others = found.iter().enumerate().filter(|(k, _)| *k != best).map(|(_, f)| f.0);
                pursuit.rival = others.fold(0.0, f64::max) / power;
            }
            pursuit.scales[rotor] = scale;
            pursuit.power += power;
            for block in &mut blocks {
                block.take_out(rotor, scale);
            }
            left.remove(best);
        }
        let noise: f64 = blocks
            .iter()
            .map(|block| block.noise(&self.mean_speeds(&block.rows)))
            .sum();
        pursuit.power = (pursuit.power - noise * self.speeds.len() as f64).max(0.0) / blocks.len() as f64;
        pursuit
    }

    fn unexplained(&self, rows: &Range<usize>) -> Unexplained {
        let time_s = &self.time_s[rows.clone()];
        Unexplained {
            rows: rows.clone(),
            since: time_s.iter().map(|t| t - time_s[0]).collect(),
            weights: hann(time_s),
            angles: self.speeds.iter().map(|s| phase(time_s, &s[rows.clone()])).collect(),
            axes: self.axes.map(|axis| axis[rows.clone()].to_vec()),
        }
    }

    /// Blocks evenly over the flight, `most` of them.
    pub(super) fn spread_blocks(&self, most: usize) -> impl Iterator<Item = &Range<usize>> {
        let step = self.blocks.len().div_ceil(most.max(1)).max(1);
        self.blocks.iter().step_by(step)
    }
}

/// What [`Shaken::pursue`] finds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pursuit {
    /// By which the speeds of each rotor are to be multiplied.
    pub(super) scales: Vec<f64>,
    /// Rotor with the strongest line, from 0.
    pub(super) first: usize,
    /// Power of that line as the best of the other rotors explains it, over its own: near 1 if they cannot be
    /// distinguished.
    pub(super) rival: f64,
    /// Power of all lines together, less noise, a² + b² over all axes.
    pub(super) power: f64,
}

/// A block of which lines are being taken out.
struct Unexplained {
    rows: Range<usize>,
    since: Vec<f64>,
    weights: Vec<f64>,
    angles: Vec<Vec<f64>>,
    axes: [Vec<f64>; 3],
}

impl Unexplained {
    fn take_out(&mut self, rotor: usize, scale: f64) {
        let total: f64 = self.weights.iter().sum();
        for axis in &mut self.axes {
            let (mut real, mut imaginary) = (0.0, 0.0);
            for ((w, y), angle) in self.weights.iter().zip(axis.iter()).zip(&self.angles[rotor]) {
                let (sin, cos) = (scale * angle).sin_cos();
                real += 2.0 / total * w * y * cos;
                imaginary += 2.0 / total * w * y * sin;
            }
            for (y, angle) in axis.iter_mut().zip(&self.angles[rotor]) {
                let (sin, cos) = (scale * angle).sin_cos();
                *y -= real * cos + imaginary * sin;
            }
        }
    }

    /// Power of a line where no rotor turns, over all axes.
    fn noise(&self, speeds: &[f64]) -> f64 {
        let places = beside(speeds, &self.since);
        let at = |place: &f64| -> f64 {
            let angle = |k: usize| place * self.since[k];
            self.axes.iter().map(|axis| alone(&self.weights, axis, angle)).sum()
        };
        places.iter().map(at).sum::<f64>() / places.len() as f64
    }
}

/// Where in a block no rotor turns, rad/s.
fn beside(speeds: &[f64], since: &[f64]) -> Vec<f64> {
    let span = since[since.len() - 1] - since[0];
    let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
    let nyquist = 0.5 * TAU * (since.len() - 1) as f64 / span;
    let width = CLEAR * TAU / span;
    let clear =
        |place: f64| place > 2.0 * width && place < 0.95 * nyquist && speeds.iter().all(|s| (s - place).abs() > width);
    let places: Vec<f64> = BESIDE.iter().map(|order| order * mean).filter(|p| clear(*p)).collect();
    if places.is_empty() {
        // Rotors are spread over everything beside them: what is left at their own middle.
        return vec![mean];
    }
    places
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
