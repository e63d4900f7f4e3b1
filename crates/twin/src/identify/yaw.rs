//! Yaw: drag torque of the rotors, and the torque of their acceleration.
//!
//! Jz ṙ = c (X + λ Ẋ), X the signed sum of the thrusts. The flight determines c/Jz and λ; c and Jz never separate. λ is
//! accepted only if it improves the prediction of held-out parts, and is far from 0 compared with the scatter of the
//! flight's parts: in a quiet flight the controller's response to gyro noise looks like it. Otherwise only a bound is
//! reported.

use nalgebra::{Matrix2, Vector2};

use super::class;
use super::filters::Band;
use super::fit::{Fitted, Series};
use super::frames::Place;
use super::grid::Grid;
use super::observer::{Gains, neighbour_correlation, rate_errors, rate_grid, rate_input_errors};
use crate::Z95;

/// What is determined from yaw.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Yaw {
    /// c m/Jz, 1/m.
    pub(crate) gain: f64,
    /// Relative deviation.
    pub(crate) deviation: f64,
    pub(crate) reaction: Reaction,
    /// R² of the yaw acceleration in its band.
    pub(crate) explained: f64,
    pub(crate) band: Band,
}

/// R² from which the gain is trusted, the same as for the drag. Of three flights of one Crazyflie only the one with yaw
/// steps reaches it; with roll and pitch excitation c/Jz came out 1.7 times too large with an interval that does not
/// reach the others.
pub(crate) const EXPLAINED: f64 = 0.6;
/// Relative deviation of λ that no length of flight removes: rotors follow f' or (√f)', which at hover are the same, and in between. Sized on
/// 200 vehicles drawn at random whose rotors follow the other law (seeds from 9000).
const LAW: f64 = 0.06;

/// λ, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Reaction {
    /// It shows.
    Seen {
        value_s: f64,
        deviation_s: f64,
        /// Relative deviation of λ c/Jz, which the flight determines better than either.
        product_deviation: f64,
    },
    /// None shows, and more than this would have.
    Below(f64),
    /// The flight does not determine it.
    Unknown,
}

impl Reaction {
    /// What a model has.
    pub(crate) fn value_s(self) -> f64 {
        match self {
            Self::Seen { value_s, .. } => value_s,
            Self::Below(_) | Self::Unknown => 0.0,
        }
    }
}

const PART_S: f64 = 6.0;
const SETTLE_S: f64 = 0.6;
/// λ over its deviation from which it is trusted.
const BELIEVED: f64 = 5.0;
/// Correlation of neighbouring errors above which they are not white, and the factor by which their deviation is then
/// widened.
const WHITE: f64 = 0.1;
const COLOURED: f64 = 2.6;
/// Longest λ that is one: beyond it the torque would be all reaction.
const LONGEST_S: f64 = 0.5;

/// Normal equations of one part of the flight, with (c m/Jz, λ c m/Jz) unknown.
#[derive(Clone, Copy)]
struct Normal {
    h: Matrix2<f64>,
    g: Vector2<f64>,
    power: f64,
    count: f64,
}

impl Normal {
    fn sum<'a>(parts: impl Iterator<Item = &'a Self>) -> Self {
        let zero = Self {
            h: Matrix2::zeros(),
            g: Vector2::zeros(),
            power: 0.0,
            count: 0.0,
        };
        parts.fold(zero, |a, b| Self {
            h: a.h + b.h,
            g: a.g + b.g,
            power: a.power + b.power,
            count: a.count + b.count,
        })
    }

    /// Inverse over the unknowns; without λ its row and column are 0.
    fn inverse(&self, with: bool) -> Option<Matrix2<f64>> {
        if with {
            return self.h.try_inverse();
        }
        let only = self.h[(0, 0)];
        (only > 0.0).then(|| Matrix2::new(1.0 / only, 0.0, 0.0, 0.0))
    }

    /// Mean square of the errors at θ.
    fn error(&self, theta: &Vector2<f64>) -> f64 {
        (self.power - 2.0 * theta.dot(&self.g) + theta.dot(&(self.h * theta))) / self.count
    }
}

/// A fit result.
struct Solution {
    noise: f64,
    theta: Vector2<f64>,
    /// Of the errors, as if white, and by the scatter of the parts.
    white: Matrix2<f64>,
    scattered: Matrix2<f64>,
    correlation: f64,
    parts: Vec<Normal>,
}

impl Solution {
    /// Covariance as reported: the next flight may differ, and errors that are not white count less.
    fn covariance(&self) -> Matrix2<f64> {
        let n = self.parts.len() as f64;
        let spread = 2.0 / (9.0 * (n - 1.0).max(1.0));
        let threshold = (1.0 - spread + 2.33 * spread.sqrt()).powi(3);
        let mut factors = [1.0_f64; 2];
        for (i, factor) in factors.iter_mut().enumerate() {
            let ratio = self.scattered[(i, i)] / self.white[(i, i)].max(f64::MIN_POSITIVE);
            if ratio > threshold && self.white[(i, i)] > 0.0 {
                *factor = (ratio + n * (ratio - 1.0)).sqrt();
            }
            if self.correlation.abs() > WHITE {
                *factor = factor.max(COLOURED);
            }
        }
        Matrix2::from_fn(|i, j| factors[i] * factors[j] * self.white[(i, j)])
    }

    /// Deviation of the mean of λ c m/Jz, which decides whether there is one.
    fn deviation_of_the_mean(&self) -> f64 {
        let widen = if self.correlation.abs() > WHITE { COLOURED } else { 1.0 };
        (widen * self.white[(1, 1)].sqrt()).max(self.scattered[(1, 1)].sqrt())
    }

    /// True if λ of every other part lowers the errors of the rest, both ways.
    fn shows_in_what_was_not_fitted(&self) -> bool {
        (0..2).all(|half| {
            let of = |which: usize| Normal::sum(self.parts.iter().skip(which).step_by(2));
            let (learn, proof) = (of(half), of(1 - half));
            let theta = |with| learn.inverse(with).map(|inverse| inverse * learn.g);
            match (theta(true), theta(false)) {
                (Some(with), Some(without)) => proof.count > 0.0 && proof.error(&with) < proof.error(&without),
                _ => false,
            }
        })
    }
}

struct Piece<'a> {
    step_s: f64,
    settle: usize,
    band: Band,
    rate: &'a [f64],
    slow: Vec<f64>,
    fast: Vec<f64>,
}

/// The result with these gains of the observer; `None` if nothing is determined.
fn solve(pieces: &[Piece<'_>], gains: Gains, with: bool) -> Option<Solution> {
    let (mut e, mut a, mut b) = (Vec::new(), Vec::new(), Vec::new());
    let mut parts = Vec::with_capacity(pieces.len());
    for piece in pieces {
        rate_errors(piece.rate, piece.step_s, gains, &mut e);
        rate_input_errors(&piece.slow, piece.step_s, gains, &mut a);
        rate_input_errors(&piece.fast, piece.step_s, gains, &mut b);
        let mut part = Normal::sum([].iter());
        for k in piece.settle.min(e.len())..e.len() {
            let x = Vector2::new(-a[k], -b[k]);
            part.h += x * x.transpose();
            part.g += x * e[k];
            part.power += e[k] * e[k];
            part.count += 1.0;
        }
        parts.push(part);
    }
    let all = Normal::sum(parts.iter());
    let inverse = all.inverse(with)?;
    let theta = inverse * all.g;
    let noise = all.error(&theta).max(0.0);
    let n = parts.len() as f64;
    let meat: Matrix2<f64> = parts
        .iter()
        .map(|part| {
            let score = part.g - part.h * theta;
            score * score.transpose()
        })
        .sum();
    let errors: Vec<f64> = e
        .iter()
        .zip(&a)
        .zip(&b)
        .map(|((e, a), b)| e + theta[0] * a + theta[1] * b)
        .collect();
    Some(Solution {
        noise,
        theta,
        white: inverse * noise,
        scattered: inverse * meat * inverse * (n / (n - 1.0).max(1.0)),
        correlation: neighbour_correlation(&errors),
        parts,
    })
}

/// R² of the yaw acceleration in its band by θ.
fn explained(pieces: &[Piece<'_>], theta: [f64; 2]) -> f64 {
    let (mut left, mut all) = (0.0, 0.0);
    for piece in pieces {
        let step = piece.step_s;
        let mut measured: Vec<f64> = piece.rate.windows(2).map(|pair| (pair[1] - pair[0]) / step).collect();
        measured.push(measured.last().copied().unwrap_or(0.0));
        let inputs = piece.slow.iter().zip(&piece.fast);
        let predicted: Vec<f64> = inputs.map(|(slow, fast)| theta[0] * slow + theta[1] * fast).collect();
        let (measured, predicted) = (piece.band.pass(&measured, step), piece.band.pass(&predicted, step));
        let settle = piece.band.settling(step).min(measured.len() / 4);
        for k in settle..measured.len() - settle {
            left += (measured[k] - predicted[k]).powi(2);
            all += measured[k] * measured[k];
        }
    }
    1.0 - left / all
}

pub(crate) fn fit(grids: &[Grid], places: &[Place], fitted: &Fitted) -> Option<Yaw> {
    let total: f64 = grids.iter().map(Grid::airborne_s).sum();
    let part_s = PART_S.max(total / 40.0).min(total / 8.0).max(1.5);
    let mut pieces = Vec::new();
    for grid in grids {
        let rates = grid.rates.as_ref()?;
        for rows in grid.pieces(part_s) {
            let series = Series::new(grid, &rows, Some(places), &fitted.curve, fitted.lag_s, fitted.delay_s);
            let slow = series.torque[2].clone();
            let fast = derivative(&slow, grid.step_s);
            pieces.push(Piece {
                step_s: grid.step_s,
                settle: grid.rows_of(SETTLE_S),
                band: Band::of_yaw(grid.step_s, grid.fast),
                rate: &rates[2][rows],
                slow,
                fast,
            });
        }
    }
    // With and without λ: the gains with the smallest error, then the result.
    let choose = |with: bool| {
        rate_grid()
            .filter_map(|gains| solve(&pieces, gains, with))
            .min_by(|a, b| a.noise.total_cmp(&b.noise))
    };
    let with = choose(true)?;
    let covariance = with.covariance();
    let (gain, product) = (with.theta[0], with.theta[1]);
    let value_s = product / gain;
    // Of a ratio of two numbers that err together.
    let deviation_s = (covariance[(1, 1)] + value_s * value_s * covariance[(0, 0)]
        - 2.0 * value_s * covariance[(0, 1)])
        .max(0.0)
        .sqrt()
        / gain.abs();
    let band = pieces.first()?.band;
    let share = explained(&pieces, [gain, product]);
    let far = product > BELIEVED * with.deviation_of_the_mean();
    let believed = share >= EXPLAINED;
    // If most of the yaw motion is not due to the rotors, the errors are systematic, and no scatter of parts reveals
    // their size.
    let (least, least_s) = if believed {
        (0.0, 0.0)
    } else {
        (class::MOMENT_LOG_DEVIATION, 0.5 * class::REACTION_MOST_S)
    };
    if gain > 0.0 && far && value_s < LONGEST_S && with.shows_in_what_was_not_fitted() {
        return Some(Yaw {
            gain,
            deviation: (covariance[(0, 0)].sqrt() / gain).max(least),
            reaction: Reaction::Seen {
                value_s,
                deviation_s: deviation_s.hypot(LAW * value_s).max(least_s),
                product_deviation: (covariance[(1, 1)].sqrt() / product).hypot(LAW).max(least),
            },
            explained: share,
            band,
        });
    }
    let without = choose(false)?;
    let alone = without.theta[0];
    if alone <= 0.0 {
        return None;
    }
    let most_s = value_s.max(0.0) + Z95 * deviation_s;
    let told = believed && gain > 0.0 && most_s.is_finite() && most_s < 0.5 * class::REACTION_MOST_S;
    let own = without.covariance()[(0, 0)].sqrt() / alone;
    // What a λ that was left out would change.
    let left_out = (gain - alone).abs() / alone;
    let deviation = if told {
        own.hypot(left_out)
    } else {
        own.max(covariance[(0, 0)].sqrt() / alone).hypot(left_out)
    };
    Some(Yaw {
        gain: alone,
        deviation: deviation.max(least),
        reaction: if told {
            Reaction::Below(most_s)
        } else {
            Reaction::Unknown
        },
        explained: share,
        band,
    })
}

/// Mean slope over the step around each mean.
pub(crate) fn derivative(values: &[f64], step_s: f64) -> Vec<f64> {
    let last = values.len() - 1;
    (0..values.len())
        .map(|k| {
            let (from, to) = (k.saturating_sub(1), (k + 1).min(last));
            (values[to] - values[from]) / ((to - from).max(1) as f64 * step_s)
        })
        .collect()
}
