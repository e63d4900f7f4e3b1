//! Yaw: drag torque of the rotors, and the torque of their acceleration.
//!
//! Jz ṙ = c (X + λ Ẋ), X the signed sum of the thrusts. The flight tells c/Jz and λ; c and Jz never separate. λ is kept only where it
//! is told from 0 and is positive: in a quiet flight the controller's answer to gyro noise looks like it.

use nalgebra::{Matrix2, Vector2};

use super::fit::{Fitted, Series};
use super::frames::Place;
use super::grid::Grid;
use super::observer::{Gains, neighbour_correlation, rate_errors, rate_grid, rate_input_errors};

/// What yaw tells.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Yaw {
    /// c m/Jz, 1/m.
    pub(crate) gain: f64,
    /// Relative deviation.
    pub(crate) deviation: f64,
    /// λ, s; 0 where it is not told from 0.
    pub(crate) reaction_s: f64,
    pub(crate) reaction_deviation_s: f64,
}

const PART_S: f64 = 6.0;
const SETTLE_S: f64 = 0.6;
/// λ over its deviation from which it is believed.
const BELIEVED: f64 = 5.0;

pub(crate) fn fit(grids: &[Grid], places: &[Place], fitted: &Fitted) -> Option<Yaw> {
    struct Piece<'a> {
        grid: &'a Grid,
        rate: &'a [f64],
        slow: Vec<f64>,
        fast: Vec<f64>,
    }
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
                grid,
                rate: &rates[2][rows],
                slow,
                fast,
            });
        }
    }
    // With and without λ: the gains of least error, then the answer.
    let solve = |gains: Gains, with: bool| -> (f64, Vector2<f64>, Matrix2<f64>, f64) {
        let (mut e, mut a, mut b) = (Vec::new(), Vec::new(), Vec::new());
        let (mut h, mut g, mut power, mut count) = (Matrix2::zeros(), Vector2::zeros(), 0.0, 0.0);
        let mut parts = Vec::new();
        for piece in &pieces {
            let step = piece.grid.step_s;
            rate_errors(piece.rate, step, gains, &mut e);
            rate_input_errors(&piece.slow, step, gains, &mut a);
            rate_input_errors(&piece.fast, step, gains, &mut b);
            let (mut ph, mut pg) = (Matrix2::zeros(), Vector2::zeros());
            for k in piece.grid.rows_of(SETTLE_S).min(e.len())..e.len() {
                let x = Vector2::new(-a[k], if with { -b[k] } else { 0.0 });
                ph += x * x.transpose();
                pg += x * e[k];
                power += e[k] * e[k];
                count += 1.0;
            }
            h += ph;
            g += pg;
            parts.push((ph, pg));
        }
        if !with {
            h[(1, 1)] = 1.0;
        }
        let Some(inverse) = h.try_inverse() else {
            return (f64::INFINITY, Vector2::zeros(), Matrix2::zeros(), 0.0);
        };
        let theta = inverse * g;
        let noise = ((power - theta.dot(&g)) / count).max(0.0);
        let model = inverse * noise;
        let n = parts.len() as f64;
        let meat: Matrix2<f64> = parts
            .iter()
            .map(|(ph, pg)| {
                let score = pg - ph * theta;
                score * score.transpose()
            })
            .sum();
        let sandwich = inverse * meat * inverse * (n / (n - 1.0).max(1.0));
        let freedom = (n - 1.0).max(1.0);
        let spread = 2.0 / (9.0 * freedom);
        let threshold = (1.0 - spread + 2.33 * spread.sqrt()).powi(3);
        let mut covariance = model;
        for i in 0..2 {
            let ratio = sandwich[(i, i)] / model[(i, i)].max(f64::MIN_POSITIVE);
            if ratio > threshold && model[(i, i)] > 0.0 {
                let factor = (ratio + n * (ratio - 1.0)).sqrt();
                for j in 0..2 {
                    covariance[(i, j)] *= factor;
                    covariance[(j, i)] *= factor;
                }
            }
        }
        let errors: Vec<f64> = e
            .iter()
            .zip(&a)
            .zip(&b)
            .map(|((e, a), b)| e + theta[0] * a + theta[1] * b)
            .collect();
        (noise, theta, covariance, neighbour_correlation(&errors))
    };
    let choose = |with: bool| {
        rate_grid()
            .map(|gains| solve(gains, with))
            .min_by(|a, b| a.0.total_cmp(&b.0))
    };
    let (_, theta, covariance, white) = choose(true)?;
    let widen = |white: f64| if white.abs() > 0.1 { 2.6 } else { 1.0 };
    let second = covariance[(1, 1)].sqrt() * widen(white);
    if theta[0] > 0.0 && theta[1] > BELIEVED * second {
        let first = covariance[(0, 0)].sqrt() * widen(white);
        let reaction = theta[1] / theta[0];
        if reaction < 0.5 {
            return Some(Yaw {
                gain: theta[0],
                deviation: first / theta[0],
                reaction_s: reaction,
                reaction_deviation_s: reaction * ((second / theta[1]).powi(2) + (first / theta[0]).powi(2)).sqrt(),
            });
        }
    }
    let (_, theta, covariance, white) = choose(false)?;
    (theta[0] > 0.0).then(|| Yaw {
        gain: theta[0],
        deviation: covariance[(0, 0)].sqrt() * widen(white) / theta[0],
        reaction_s: 0.0,
        reaction_deviation_s: second / theta[0],
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
