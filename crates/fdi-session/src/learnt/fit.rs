//! Which signals of healthy flights explain the momentum defect of an axis, and by how much.
//!
//! ```text
//!  D' = w + b + c cos ψ + s sin ψ + Σ_k Θ_k s̃_k      states of the day: D, w, b, and c, s of its wind (roll and pitch)
//! ```
//! The Kalman filter of the day's states is linear in its input: one pass of it turns the defect into innovations e and
//! each signal into h_k, all over the standard deviation of the innovation, with e = Σ_k Θ_k h_k + white noise of
//! variance 1. So Θ is a least-squares fit, with a prior about 0.
//!
//! Thirty signals of a few flights go together, and many of them can take the place of one: the sum fits these flights
//! and is wrong on another day. So they are added one at a time, the most useful one first, as long as Θ from the other
//! flights predicts the flights better with it than without, and none of them worse (of a single flight: its halves).
//! The noise that is left is that of predictions, too.

use super::super::second_look::meter::air_spread;
use super::{AXES, AXIS_OF, FIRST_SPEED, NAMES, SCALE_THRUST, SIGNALS};
use nalgebra::{DMatrix, DVector};
use rotortwin_flight_core::fdi::FdiConfig;

/// Levels of noise that are tried, share of the hover thrust.
const LEVELS: [f64; 12] = [3e-4, 1e-3, 3e-3, 6e-3, 1e-2, 1.7e-2, 3e-2, 6e-2, 0.1, 0.3, 0.55, 1.0];
/// Correlation times of gusts that are tried, s: a wrong one would be made up for by gains and damping, as the controller
/// answers every gust.
const TIMES: [f64; 4] = [0.3, 1.0, 3.0, 10.0];
/// Iterations of noise and Θ.
const ROUNDS: usize = 2;
/// Smallest gain in ln likelihood of predicted flights for which a signal is added, and largest loss of one of them.
const LEAST_GAIN: f64 = 5.0;
const MOST_LOSS: f64 = 1.0;
/// States of the day.
const STATES: usize = 5;
const DEFECT: usize = 0;
const GUST: usize = 1;
const BIAS: usize = 2;
/// The defect, and all signals.
const COLUMNS: usize = 1 + SIGNALS;

/// A block of a flight.
#[derive(Clone, Debug)]
pub(super) struct Taken {
    /// Number of the flight.
    pub flight: usize,
    /// The first after a gap: independent of what came before.
    pub begins: bool,
    pub defect: [f64; AXES],
    pub elapsed: f64,
    /// ∫ cos ψ, ∫ sin ψ, s.
    pub heading: [f64; 2],
    /// ∫ signals through the lag.
    pub signal: [f64; SIGNALS],
    /// Of the mean of the momentum, (N·s)².
    pub noise: [f64; AXES],
}

impl Taken {
    /// Defect that Θ does not explain, N·s.
    fn rest(&self, axis: usize, theta: &[f64; SIGNALS]) -> f64 {
        let told: f64 = theta
            .iter()
            .zip(&self.signal)
            .map(|(theta, signal)| theta * signal)
            .sum();
        self.defect[axis] - told
    }
}

/// Gusts and white force of an axis, N², and their correlation over a block.
#[derive(Clone, Copy)]
struct Noise {
    gust: f64,
    white: f64,
    correlation: f64,
}

/// Θ of one axis, and gusts and white force that are left, N²: alternates between the noise for a given Θ and Θ for
/// that noise.
///
/// * `hover`: thrust of a rotor, N
pub(super) fn fitted(blocks: &[Taken], axis: usize, hover: f64, config: &FdiConfig) -> ([f64; SIGNALS], [f64; 2]) {
    let usual = blocks.iter().map(|block| block.elapsed).fold(0.0, f64::max);
    let square = |share: f64| (share * hover).powi(2);
    let [_, _, winds @ ..] = air_spread(axis).map(square);
    let constant = [square(f64::from(config.sequential.bias_spread)), winds[0], winds[1]];
    let precision = spread(axis, hover).map(|spread| if spread > 0.0 { spread.powi(-2) } else { f64::INFINITY });
    let parts = parts(blocks);
    let mut theta = [0.0; SIGNALS];
    let mut surprise = 1.0;
    let mut best = Noise {
        gust: 0.0,
        white: 0.0,
        correlation: 0.0,
    };
    for round in 0..=ROUNDS {
        let rest: Vec<f64> = blocks.iter().map(|block| block.rest(axis, &theta)).collect();
        let levels = LEVELS.iter().flat_map(|gust| LEVELS.map(|white| (*gust, white)));
        let mut most = f64::NEG_INFINITY;
        for (gust, white, time) in levels.flat_map(|(gust, white)| TIMES.map(|time| (gust, white, time))) {
            let noise = Noise {
                gust: square(gust),
                white: square(white),
                correlation: (-usual / time).exp(),
            };
            let log_likelihood = log_likelihood(blocks, &rest, axis, &noise, &constant);
            if log_likelihood > most {
                (most, best) = (log_likelihood, noise);
            }
        }
        if round < ROUNDS {
            let sums = whitened(blocks, &parts, axis, &best, &constant);
            (theta, surprise) = selected(&sums, &precision);
        }
    }
    let scale = surprise.max(1.0);
    (theta, [scale * best.gust, scale * best.white])
}

/// Prior standard deviation of Θ.
fn spread(axis: usize, hover: f64) -> [f64; SIGNALS] {
    std::array::from_fn(|k| {
        let (_, own, other) = NAMES[k];
        let scale = if k < FIRST_SPEED || k == SIGNALS - 1 {
            1.0
        } else {
            hover / SCALE_THRUST
        };
        let is_own = AXIS_OF[k].map_or(axis == 0 || k < SIGNALS - 1, |of| of == axis);
        scale * if is_own { own } else { other }
    })
}

/// The part that each block belongs to, of which one is predicted from the others: its flight, or its half of the only
/// flight.
fn parts(blocks: &[Taken]) -> Vec<usize> {
    let mut flights: Vec<usize> = blocks.iter().map(|block| block.flight).collect();
    flights.dedup();
    let of = |place: usize, block: &Taken| match flights.as_slice() {
        [_] => usize::from(2 * place >= blocks.len()),
        _ => flights.iter().position(|flight| *flight == block.flight).unwrap_or(0),
    };
    blocks
        .iter()
        .enumerate()
        .map(|(place, block)| of(place, block))
        .collect()
}

/// Advances mean and covariance of the day's states by a block; the mean has one column for each input.
struct Day<const N: usize> {
    x: [[f64; STATES]; N],
    p: [[f64; STATES]; STATES],
}

impl<const N: usize> Day<N> {
    fn new() -> Self {
        Self {
            x: [[0.0; STATES]; N],
            p: [[0.0; STATES]; STATES],
        }
    }

    fn begin(&mut self, measurement: f64, noise: &Noise, constant: &[f64; STATES - BIAS]) {
        *self = Self::new();
        self.p[DEFECT][DEFECT] = measurement;
        self.p[GUST][GUST] = noise.gust;
        for (k, variance) in constant.iter().enumerate() {
            self.p[BIAS + k][BIAS + k] = *variance;
        }
    }

    /// Innovations and their variance.
    fn step(&mut self, input: &[f64; N], block: &Taken, axis: usize, noise: &Noise) -> ([f64; N], f64) {
        let (elapsed, measurement) = (block.elapsed, block.noise[axis]);
        // P ← A P Aᵀ with A = 1 + e_D cᵀ.
        let c = [0.0, elapsed, elapsed, block.heading[0], block.heading[1]];
        let p = &mut self.p;
        let row: [f64; STATES] = std::array::from_fn(|k| (1..STATES).map(|j| c[j] * p[j][k]).sum());
        let spread: f64 = (1..STATES).map(|j| c[j] * row[j]).sum();
        p[DEFECT][DEFECT] += 2.0 * row[DEFECT] + spread + noise.white * elapsed * elapsed;
        for k in 1..STATES {
            p[DEFECT][k] += row[k];
            p[k][DEFECT] = p[DEFECT][k];
        }
        for k in 0..STATES {
            p[GUST][k] *= noise.correlation;
            p[k][GUST] *= noise.correlation;
        }
        p[GUST][GUST] += (1.0 - noise.correlation.powi(2)) * noise.gust;
        let column = p[DEFECT];
        let variance = column[DEFECT] + measurement;
        for i in 0..STATES {
            for j in 0..STATES {
                p[i][j] -= column[i] * column[j] / variance;
            }
        }
        let mut innovations = [0.0; N];
        for (k, x) in self.x.iter_mut().enumerate() {
            x[DEFECT] += (1..STATES).map(|j| c[j] * x[j]).sum::<f64>();
            x[GUST] *= noise.correlation;
            innovations[k] = input[k] - x[DEFECT];
            for i in 0..STATES {
                x[i] += column[i] / variance * innovations[k];
            }
            // D counts from the measured one.
            x[DEFECT] -= input[k];
        }
        (innovations, variance)
    }
}

/// Of the blocks, up to a constant.
///
/// * `rest`: of each, [`Taken::rest`]
fn log_likelihood(blocks: &[Taken], rest: &[f64], axis: usize, noise: &Noise, constant: &[f64; STATES - BIAS]) -> f64 {
    let mut day = Day::<1>::new();
    let mut sum = 0.0;
    for (block, rest) in blocks.iter().zip(rest) {
        if block.begins {
            day.begin(block.noise[axis], noise, constant);
            continue;
        }
        let (e, variance) = day.step(&[*rest], block, axis, noise);
        sum -= 0.5 * (variance.ln() + e[0] * e[0] / variance);
    }
    sum
}

/// Products of the whitened columns, summed over a part.
#[derive(Clone)]
struct Sums {
    of: Vec<[f64; COLUMNS]>,
    blocks: f64,
}

impl Sums {
    fn new() -> Self {
        Self {
            of: vec![[0.0; COLUMNS]; COLUMNS],
            blocks: 0.0,
        }
    }

    fn add(&mut self, other: &Self) {
        for (row, other) in self.of.iter_mut().zip(&other.of) {
            for (sum, other) in row.iter_mut().zip(other) {
                *sum += other;
            }
        }
        self.blocks += other.blocks;
    }

    /// Θ of some signals.
    fn solved(&self, signals: &[usize], precision: &[f64; SIGNALS]) -> Option<Vec<f64>> {
        let n = signals.len();
        let matrix = DMatrix::from_fn(n, n, |i, j| {
            let prior = if i == j { precision[signals[i]] } else { 0.0 };
            self.of[1 + signals[i]][1 + signals[j]] + prior
        });
        let right = DVector::from_fn(n, |i, _| self.of[0][1 + signals[i]]);
        Some(matrix.cholesky()?.solve(&right).as_slice().to_vec())
    }

    /// Σ e² with this Θ.
    fn left(&self, signals: &[usize], theta: &[f64]) -> f64 {
        let mut sum = self.of[0][0];
        for (i, theta_i) in signals.iter().zip(theta) {
            sum -= 2.0 * theta_i * self.of[0][1 + i];
            for (j, theta_j) in signals.iter().zip(theta) {
                sum += theta_i * theta_j * self.of[1 + i][1 + j];
            }
        }
        sum
    }
}

fn whitened(
    blocks: &[Taken],
    parts: &[usize],
    axis: usize,
    noise: &Noise,
    constant: &[f64; STATES - BIAS],
) -> Vec<Sums> {
    let mut sums = vec![Sums::new(); parts.iter().max().map_or(0, |last| last + 1)];
    let mut day = Day::<COLUMNS>::new();
    for (block, part) in blocks.iter().zip(parts) {
        if block.begins {
            day.begin(block.noise[axis], noise, constant);
            continue;
        }
        let mut input = [0.0; COLUMNS];
        input[0] = block.defect[axis];
        input[1..].copy_from_slice(&block.signal);
        let (e, variance) = day.step(&input, block, axis, noise);
        let sums = &mut sums[*part];
        for i in 0..COLUMNS {
            for j in 0..COLUMNS {
                sums.of[i][j] += e[i] * e[j] / variance;
            }
        }
        sums.blocks += 1.0;
    }
    sums
}

/// Θ of the signals that predict, and the largest mean of e² of a predicted part.
fn selected(parts: &[Sums], precision: &[f64; SIGNALS]) -> ([f64; SIGNALS], f64) {
    let mut all = Sums::new();
    let mut others = vec![Sums::new(); parts.len()];
    for (place, part) in parts.iter().enumerate() {
        all.add(part);
        for (other, sums) in others.iter_mut().enumerate() {
            if other != place {
                sums.add(part);
            }
        }
    }
    // Σ e² of each part, predicted from the others.
    let predicted = |signals: &[usize]| -> Option<Vec<f64>> {
        let of = |(part, others): (&Sums, &Sums)| Some(part.left(signals, &others.solved(signals, precision)?));
        parts.iter().zip(&others).map(of).collect()
    };
    let mut chosen: Vec<usize> = Vec::new();
    let mut left: Vec<f64> = parts.iter().map(|part| part.of[0][0]).collect();
    loop {
        let mut best: Option<(f64, usize, Vec<f64>)> = None;
        for signal in (0..SIGNALS).filter(|signal| precision[*signal].is_finite() && !chosen.contains(signal)) {
            let with: Vec<usize> = chosen.iter().copied().chain([signal]).collect();
            let Some(now) = predicted(&with) else { continue };
            let gains = || left.iter().zip(&now).map(|(before, now)| 0.5 * (before - now));
            let gain: f64 = gains().sum();
            if gain > LEAST_GAIN
                && gains().all(|gain| gain > -MOST_LOSS)
                && best.as_ref().is_none_or(|best| gain > best.0)
            {
                best = Some((gain, signal, now));
            }
        }
        let Some((_, signal, now)) = best else { break };
        chosen.push(signal);
        left = now;
    }
    let mut theta = [0.0; SIGNALS];
    for (signal, value) in chosen.iter().zip(all.solved(&chosen, precision).unwrap_or_default()) {
        theta[*signal] = value;
    }
    let surprise = parts.iter().zip(&left).map(|(part, left)| left / part.blocks.max(1.0));
    (theta, surprise.fold(0.0, f64::max))
}
