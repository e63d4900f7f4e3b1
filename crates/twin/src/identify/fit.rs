//! Thrust curve, lag, delay and the gains of roll and pitch, jointly: they form ridges (a longer lag goes with a
//! smaller inertia).
//!
//! Gauss–Newton on the prediction errors of lift, roll and pitch ([`super::observer`]), the observer's gains re-estimated on the way.
//! Intervals: the errors' own information where the parts of the flight agree within it; otherwise the spread of the
//! parts. Then the class default enters as a prior, so that what the flight does not determine keeps its class value,
//! with its wide interval.

use nalgebra::{SMatrix, SVector};
use std::ops::Range;

use super::actuator::lagged;
use super::class::{self, Class};
use super::curve::Curve;
use super::filters::through_low_pass;
use super::frames::Place;
use super::grid::{Grid, mean_deviation};
use super::observer::{
    Gains, lift_errors, lift_grid, neighbour_correlation, rate_errors, rate_grid, rate_input_errors,
};

/// α, β, ln τ, d, gain of roll, gain of pitch over their defaults.
pub(crate) const PARAMETERS: usize = 6;
type Vector = SVector<f64, PARAMETERS>;
type Matrix = SMatrix<f64, PARAMETERS, PARAMETERS>;

pub(crate) const ALPHA: usize = 0;
pub(crate) const BETA: usize = 1;
pub(crate) const LAG: usize = 2;
pub(crate) const DELAY: usize = 3;
pub(crate) const GAIN: [usize; 2] = [4, 5];

/// Length of a part, s, and the minimum number of parts.
const PART_S: f64 = 6.0;
const FEWEST_PARTS: f64 = 8.0;
/// Rows at the start of a part where filters and lag settle, s.
const SETTLE_S: f64 = 0.6;
/// Deviations that no length of flight removes, of α, β, ln τ, d, gains: unequal rotors, products of rates with another
/// inertia, a curve with three terms. The errors of randomly drawn vehicles are of this size when noise is not the
/// limit.
const FLOOR: [f64; PARAMETERS] = [0.01, 0.01, 0.007, 1e-4, 0.004, 0.004];
/// Correlation of neighbouring errors that chance alone explains; beyond it the errors are not white.
const WHITE: f64 = 0.1;

/// Bench values of α and β, and their information, instead of the class's.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ShapePrior {
    pub(crate) shape: [f64; 2],
    pub(crate) information: [[f64; 2]; 2],
}

/// Inputs of the fit.
#[derive(Clone, Copy)]
pub(crate) struct Problem<'a> {
    pub(crate) grids: &'a [Grid],
    /// Absent: the wiring is unknown, only the lift is fitted.
    pub(crate) places: Option<&'a [Place]>,
    pub(crate) class: Class,
    pub(crate) voltage_slope: f64,
    /// Shape of the thrust curve from a bench, instead of the class's.
    pub(crate) bench: Option<ShapePrior>,
}

/// n = d ln thrust/d ln duty that a propeller can have: about 1 where the ESC's law is that of the voltage, 2 where the duty is a rotor speed, more
/// where the range of the pulses begins below the motor's.
pub(crate) const SLOPES: std::ops::RangeInclusive<f64> = 0.6..=3.5;

/// What came out.
#[derive(Debug, Clone)]
pub(crate) struct Fitted {
    pub(crate) curve: Curve,
    pub(crate) lag_s: f64,
    pub(crate) delay_s: f64,
    /// Angular acceleration per lever of thrust over mass: l m/J, 1/m, with positions in units of the arm; roll, pitch.
    pub(crate) gain: [f64; 2],
    /// Of α, β, ln τ, d, ln gains; the class default is included.
    pub(crate) covariance: Matrix,
    /// From the log alone.
    pub(crate) data_deviation: Vector,
    pub(crate) parts: usize,
    /// Parameters in which the parts disagree by more than their errors.
    pub(crate) uneven: [bool; PARAMETERS],
}

struct Piece<'a> {
    grid: &'a Grid,
    rows: Range<usize>,
}

/// θ as numbers.
#[derive(Clone, Copy)]
struct State {
    theta: Vector,
    hover_duty: f64,
    hover: f64,
    voltage: f64,
    voltage_slope: f64,
    base_gain: [f64; 2],
}

impl State {
    fn curve(&self) -> Curve {
        Curve {
            hover_duty: self.hover_duty,
            hover: self.hover,
            alpha: self.theta[ALPHA],
            beta: self.theta[BETA],
            voltage_slope: self.voltage_slope,
            voltage: self.voltage,
        }
    }

    fn lag_s(&self) -> f64 {
        self.theta[LAG].exp().clamp(0.002, 0.6)
    }
}

/// Mean duty and mean voltage in the air.
pub(crate) fn hover_point(grids: &[Grid]) -> (f64, f64) {
    let mean = |value: &dyn Fn(&Grid, usize) -> f64| {
        let values = grids.iter().flat_map(|grid| {
            grid.airborne
                .iter()
                .flat_map(Clone::clone)
                .map(move |row| value(grid, row))
                .filter(|value| value.is_finite())
        });
        mean_deviation(values).0
    };
    let voltage = mean(&|grid, row| grid.voltage.as_ref().map_or(f64::NAN, |v| v[row]));
    (mean(&Grid::mean_duty), voltage)
}

/// T_h/m such that the curve's mean thrust in the air matches the accelerometer; without one, the thrust that carries
/// the weight at the logged tilt.
pub(crate) fn hover_level(grids: &[Grid], mut curve: Curve) -> f64 {
    curve.hover = 1.0;
    let (mut lift, mut shape) = (0.0, 0.0);
    for grid in grids {
        let measured = grid.lift();
        for row in grid.airborne.iter().flat_map(Clone::clone) {
            let volts = grid.voltage.as_ref().map_or(f64::NAN, |v| v[row]);
            let factor = curve.voltage_factor(volts);
            shape += factor * grid.duty.iter().map(|duty| curve.shape(duty[row])).sum::<f64>();
            lift += measured
                .as_ref()
                .map_or_else(|| grid.weight_along_thrust(row), |lift| lift[row]);
        }
    }
    lift / shape
}

/// Gain by class: l m/J.
pub(crate) fn class_gain(class: &Class, arm_m: f64) -> [f64; 2] {
    class.inertia_ratio.map(|kappa| 1.0 / (kappa * arm_m))
}

/// Fits; `arm_m` only sets the start values of the gains and their class default.
pub(crate) fn fit(problem: &Problem<'_>, arm_m: f64) -> Fitted {
    let total: f64 = problem.grids.iter().map(Grid::airborne_s).sum();
    let part_s = PART_S.max(total / 40.0).min(total / FEWEST_PARTS).max(1.5);
    let pieces: Vec<Piece<'_>> = problem
        .grids
        .iter()
        .flat_map(|grid| grid.pieces(part_s).into_iter().map(move |rows| Piece { grid, rows }))
        .collect();
    let class = problem.class;
    let (hover_duty, voltage) = hover_point(problem.grids);
    let mut prior = Vector::zeros();
    prior[ALPHA] = class.slope - 1.0;
    prior[LAG] = class.lag_s.ln();
    prior[DELAY] = class.delay_s;
    prior[GAIN[0]] = 1.0;
    prior[GAIN[1]] = 1.0;
    let mut state = State {
        theta: prior,
        hover_duty,
        hover: 1.0,
        voltage: if voltage.is_finite() { voltage } else { 1.0 },
        voltage_slope: if voltage.is_finite() {
            problem.voltage_slope
        } else {
            0.0
        },
        base_gain: class_gain(&class, arm_m),
    };
    let mut prior_information = prior_information();
    if let Some(bench) = problem.bench {
        for (row, i) in [ALPHA, BETA].into_iter().enumerate() {
            state.theta[i] = bench.shape[row];
            prior[i] = bench.shape[row];
            for (column, j) in [ALPHA, BETA].into_iter().enumerate() {
                prior_information[(i, j)] = bench.information[row][column];
            }
        }
    }
    state.hover = hover_level(problem.grids, state.curve());
    // Wide during the search: only so that what the log does not determine stays in place.
    let guard = prior_information * 0.02;

    let mut gains = Channels::first(problem);
    let mut noise = [1.0; 3];
    // How much more the scores of a channel scatter than white errors would: coloured channels count less.
    let mut design = [1.0; 3];
    let mut linear = Linear::default();
    for round in 0..14 {
        if round % 4 == 0 {
            gains.estimate(problem, &pieces, &state, &mut noise);
        }
        let weighted: [f64; 3] = std::array::from_fn(|channel| noise[channel] * design[channel]);
        linear = linearise(problem, &pieces, &state, &gains, &weighted);
        if round == 5 || round == 9 {
            for channel in 0..3 {
                design[channel] = (design[channel] * linear.scatter(channel)).max(1.0);
            }
            continue;
        }
        let hessian: Matrix = linear.information.iter().sum::<Matrix>() + guard;
        let gradient: Vector = linear.score.iter().sum::<Vector>() + guard * (prior - state.theta);
        let Some(step) = hessian.cholesky().map(|c| c.solve(&gradient)) else {
            break;
        };
        let limit = Vector::from([0.3, 0.3, 0.4, 0.01, 0.5, 0.5]);
        let shrink = (0..PARAMETERS).map(|i| limit[i] / step[i].abs()).fold(1.0, f64::min);
        state.theta += step * shrink;
        state.theta[LAG] = state.theta[LAG].clamp((0.003_f64).ln(), (0.5_f64).ln());
        let steps = problem.grids.iter().map(|g| g.step_s).fold(f64::INFINITY, f64::min);
        state.theta[DELAY] = state.theta[DELAY].clamp(-0.9 * steps, 0.1);
        for axis in 0..2 {
            state.theta[GAIN[axis]] = state.theta[GAIN[axis]].clamp(0.02, 30.0);
        }
        state.hover = hover_level(problem.grids, state.curve());
        if step.norm() < 1e-4 && round > 9 {
            break;
        }
    }
    finish(&state, &gains, &linear, prior, prior_information)
}

/// The fit itself; if its curve is one that no propeller has, a fit with the class's curve instead, so that lag and
/// inertia belong to that curve, and the slope that the flight indicates.
pub(crate) fn with_a_possible_slope(problem: &Problem<'_>, arm_m: f64, free: Fitted) -> (Fitted, Option<f64>) {
    /// So large that no flight moves it.
    const HELD: f64 = 1e9;
    let slope = free.curve.slope();
    if SLOPES.contains(&slope) {
        return (free, None);
    }
    let held = Problem {
        bench: Some(ShapePrior {
            shape: [problem.class.slope - 1.0, 0.0],
            information: [[HELD, 0.0], [0.0, HELD]],
        }),
        ..*problem
    };
    (fit(&held, arm_m), Some(slope))
}

fn prior_information() -> Matrix {
    let deviation = [
        class::SLOPE_DEVIATION * 1.2,
        class::BEND_DEVIATION,
        class::LAG_LOG_DEVIATION,
        class::DELAY_DEVIATION_S,
        class::INERTIA_LOG_DEVIATION,
        class::INERTIA_LOG_DEVIATION,
    ];
    Matrix::from_diagonal(&Vector::from(deviation.map(|d| 1.0 / (d * d))))
}

/// Observer gains of lift, roll and pitch.
#[derive(Clone, Copy)]
struct Channels {
    lift: Gains,
    rate: [Gains; 2],
    has_lift: bool,
    has_rates: bool,
    white: [f64; 3],
}

impl Channels {
    fn first(problem: &Problem<'_>) -> Self {
        Self {
            lift: Gains {
                first: 0.0,
                second: 0.01,
            },
            rate: [Gains {
                first: 0.1,
                second: 0.001,
            }; 2],
            has_lift: problem.grids.iter().all(|grid| grid.accel[2].is_some()),
            has_rates: problem.places.is_some() && problem.grids.iter().all(|grid| grid.rates.is_some()),
            white: [0.0; 3],
        }
    }

    /// The gains with the smallest error, with the gain of the torque refitted for each.
    fn estimate(&mut self, problem: &Problem<'_>, pieces: &[Piece<'_>], state: &State, noise: &mut [f64; 3]) {
        let series: Vec<Series> = pieces.iter().map(|piece| Series::of(problem, piece, state)).collect();
        let step_s = pieces.first().map_or(0.0025, |piece| piece.grid.step_s);
        let mut out = Vec::new();
        if self.has_lift {
            let errors: Vec<Vec<f64>> = pieces
                .iter()
                .zip(&series)
                .map(|(piece, series)| {
                    let lift = piece.grid.accel[2].as_ref().map_or(&[][..], |z| &z[piece.rows.clone()]);
                    lift.iter().zip(&series.lift).map(|(z, x)| -z - x).collect()
                })
                .collect();
            let mut best = f64::INFINITY;
            for gains in lift_grid(step_s) {
                let (mut power, mut count) = (0.0, 0.0);
                for (values, piece) in errors.iter().zip(pieces) {
                    lift_errors(values, gains, &mut out);
                    let settle = piece.grid.rows_of(SETTLE_S).min(out.len());
                    power += out[settle..].iter().map(|e| e * e).sum::<f64>();
                    count += (out.len() - settle) as f64;
                }
                if power / count < best {
                    best = power / count;
                    self.lift = gains;
                    self.white[0] = neighbour_correlation(&out);
                }
            }
            noise[0] = best;
        }
        if !self.has_rates {
            return;
        }
        let mut input = Vec::new();
        for axis in 0..2 {
            let mut best = f64::INFINITY;
            for gains in rate_grid() {
                let [mut ee, mut ex, mut xx, mut count] = [0.0; 4];
                let mut white = 0.0;
                for (piece, series) in pieces.iter().zip(&series) {
                    let rates = piece.grid.rates.as_ref().expect("all grids have rates");
                    rate_errors(&rates[axis][piece.rows.clone()], piece.grid.step_s, gains, &mut out);
                    rate_input_errors(&series.torque[axis], piece.grid.step_s, gains, &mut input);
                    for k in piece.grid.rows_of(SETTLE_S).min(out.len())..out.len() {
                        ee += out[k] * out[k];
                        ex += out[k] * input[k];
                        xx += input[k] * input[k];
                        count += 1.0;
                    }
                }
                let b = if xx > 0.0 { (-ex / xx).max(0.0) } else { 0.0 };
                let power = (ee + 2.0 * b * ex + b * b * xx) / count;
                if power < best {
                    best = power;
                    self.rate[axis] = gains;
                    for (piece, series) in pieces.iter().zip(&series).take(1) {
                        let rates = piece.grid.rates.as_ref().expect("all grids have rates");
                        rate_errors(&rates[axis][piece.rows.clone()], piece.grid.step_s, gains, &mut out);
                        rate_input_errors(&series.torque[axis], piece.grid.step_s, gains, &mut input);
                        let errors: Vec<f64> = out.iter().zip(&input).map(|(e, x)| e + b * x).collect();
                        white = neighbour_correlation(&errors[piece.grid.rows_of(SETTLE_S).min(errors.len())..]);
                    }
                    self.white[1 + axis] = white;
                }
            }
            noise[1 + axis] = best;
        }
    }
}

/// Model inputs of one piece.
pub(crate) struct Series {
    /// Sum of the rotors' thrust over mass at each row, m/s², as the accelerometer's low-pass leaves it.
    pub(crate) lift: Vec<f64>,
    /// Lever times thrust over mass, mean over the step, less its mean: roll, pitch, yaw; in units of the arm.
    pub(crate) torque: [Vec<f64>; 3],
}

impl Series {
    fn of(problem: &Problem<'_>, piece: &Piece<'_>, state: &State) -> Self {
        Self::new(
            piece.grid,
            &piece.rows,
            problem.places,
            &state.curve(),
            state.lag_s(),
            state.theta[DELAY],
        )
    }

    pub(crate) fn new(
        grid: &Grid,
        rows: &Range<usize>,
        places: Option<&[Place]>,
        curve: &Curve,
        lag_s: f64,
        delay_s: f64,
    ) -> Self {
        let mut lift = vec![0.0; rows.len()];
        let mut torque = [vec![0.0; rows.len()], vec![0.0; rows.len()], vec![0.0; rows.len()]];
        for rotor in 0..grid.duty.len() {
            let thrust = lagged(grid, rows, rotor, curve, lag_s, delay_s);
            for (sum, thrust) in lift.iter_mut().zip(&thrust.at) {
                *sum += thrust;
            }
            let Some(place) = places.map(|places| places[rotor]) else {
                continue;
            };
            let levers = [-place.position[1], place.position[0], place.yaw_sign()];
            for (sum, lever) in torque.iter_mut().zip(levers) {
                for (sum, thrust) in sum.iter_mut().zip(&thrust.mean) {
                    *sum += lever * thrust;
                }
            }
        }
        if let Some(corner_hz) = grid.accel_low_pass_hz {
            through_low_pass(&mut lift, corner_hz, grid.step_s);
        }
        for torque in &mut torque {
            let mean = torque.iter().sum::<f64>() / torque.len() as f64;
            torque.iter_mut().for_each(|x| *x -= mean);
        }
        Self { lift, torque }
    }
}

/// Errors of one piece at θ: lift, roll, pitch; only settled rows.
fn errors(problem: &Problem<'_>, piece: &Piece<'_>, state: &State, channels: &Channels) -> [Vec<f64>; 3] {
    let series = Series::of(problem, piece, state);
    let grid = piece.grid;
    let settle = grid.rows_of(SETTLE_S).min(piece.rows.len());
    let mut out: [Vec<f64>; 3] = Default::default();
    if channels.has_lift
        && let Some(z) = &grid.accel[2]
    {
        let values: Vec<f64> = z[piece.rows.clone()]
            .iter()
            .zip(&series.lift)
            .map(|(z, x)| -z - x)
            .collect();
        lift_errors(&values, channels.lift, &mut out[0]);
        out[0].drain(..settle);
    }
    if channels.has_rates
        && let Some(rates) = &grid.rates
    {
        let mut input = Vec::new();
        for axis in 0..2 {
            let gain = state.base_gain[axis] * state.theta[GAIN[axis]];
            // −(ω × Jω)/J: of roll and pitch, with Jz of a flat body and Jx = Jy.
            let cross = if axis == 0 { -CROSS } else { CROSS };
            let other = if axis == 0 { 1 } else { 0 };
            let torque: Vec<f64> = series.torque[axis]
                .iter()
                .zip(piece.rows.clone())
                .map(|(x, k)| gain * x + cross * rates[2][k] * rates[other][k])
                .collect();
            rate_errors(
                &rates[axis][piece.rows.clone()],
                grid.step_s,
                channels.rate[axis],
                &mut out[1 + axis],
            );
            rate_input_errors(&torque, grid.step_s, channels.rate[axis], &mut input);
            for (error, input) in out[1 + axis].iter_mut().zip(&input) {
                *error += input;
            }
            out[1 + axis].drain(..settle);
        }
    }
    out
}

/// (Jz − Jy)/Jx of a body with Jz = 0.93 (Jx + Jy).
const CROSS: f64 = 2.0 * class::YAW_INERTIA_SHARE - 1.0;

/// Information and score of each piece.
#[derive(Default)]
struct Linear {
    information: Vec<Matrix>,
    score: Vec<Vector>,
    /// By channel, then piece.
    channels: [Vec<(Matrix, Vector)>; 3],
}

impl Linear {
    /// Variance of a channel's scores over that of white errors, averaged over the parameters to which the channel is
    /// sensitive.
    fn scatter(&self, channel: usize) -> f64 {
        let pieces = &self.channels[channel];
        let ratios: Vec<f64> = (0..PARAMETERS)
            .filter_map(|i| {
                let information: f64 = pieces.iter().map(|(h, _)| h[(i, i)]).sum();
                let mean: f64 = pieces.iter().map(|(_, g)| g[i]).sum::<f64>() / pieces.len().max(1) as f64;
                let scatter: f64 = pieces.iter().map(|(_, g)| (g[i] - mean).powi(2)).sum();
                (information > 0.0).then(|| scatter / information)
            })
            .collect();
        let ratio = ratios.iter().sum::<f64>() / ratios.len().max(1) as f64;
        // By chance alone it is within a factor of three.
        if ratio > 3.0 { ratio } else { 1.0 }
    }
}

fn linearise(
    problem: &Problem<'_>,
    pieces: &[Piece<'_>],
    state: &State,
    channels: &Channels,
    noise: &[f64; 3],
) -> Linear {
    let shift = Vector::from([0.01, 0.01, 0.02, 2e-4, 0.02, 0.02]);
    let mut linear = Linear::default();
    for piece in pieces {
        let here = errors(problem, piece, state, channels);
        let slopes: Vec<[Vec<f64>; 3]> = (0..PARAMETERS)
            .map(|i| {
                let mut moved = *state;
                moved.theta[i] += shift[i];
                if i == ALPHA || i == BETA {
                    // The level follows the shape; over one piece as over all, to first order.
                    moved.hover *= mean_shape(piece, &state.curve()) / mean_shape(piece, &moved.curve());
                }
                let there = errors(problem, piece, &moved, channels);
                std::array::from_fn(|channel| {
                    here[channel]
                        .iter()
                        .zip(&there[channel])
                        .map(|(a, b)| (a - b) / shift[i])
                        .collect()
                })
            })
            .collect();
        let mut information = Matrix::zeros();
        let mut score = Vector::zeros();
        for channel in 0..3 {
            let (mut own, mut own_score) = (Matrix::zeros(), Vector::zeros());
            for k in 0..here[channel].len() {
                let row = Vector::from_fn(|i, _| slopes[i][channel][k]);
                own += row * row.transpose() / noise[channel];
                own_score += row * (here[channel][k] / noise[channel]);
            }
            information += own;
            score += own_score;
            linear.channels[channel].push((own, own_score));
        }
        linear.information.push(information);
        linear.score.push(score);
    }
    linear
}

fn mean_shape(piece: &Piece<'_>, curve: &Curve) -> f64 {
    piece
        .grid
        .duty
        .iter()
        .map(|duty| duty[piece.rows.clone()].iter().map(|u| curve.shape(*u)).sum::<f64>())
        .sum()
}

fn finish(state: &State, channels: &Channels, linear: &Linear, prior: Vector, prior_information: Matrix) -> Fitted {
    let parts = linear.information.len();
    let total: Matrix = linear.information.iter().sum::<Matrix>();
    // A parameter that no row determines must not make the matrix singular.
    let floor = prior_information * 1e-4;
    let model = (total + floor)
        .try_inverse()
        .unwrap_or_else(|| Matrix::identity() * 1e4);
    let mut meat = Matrix::zeros();
    let mean: Vector = linear.score.iter().sum::<Vector>() / parts.max(1) as f64;
    for score in &linear.score {
        let score = score - mean;
        meat += score * score.transpose();
    }
    let freedom = (parts.max(2) - 1) as f64;
    let sandwich = model * meat * model * (parts as f64 / freedom);
    // χ² of `parts − 1` at 99 %, over its freedom (Wilson–Hilferty).
    let threshold = {
        let spread = 2.0 / (9.0 * freedom);
        (1.0 - spread + 2.33 * spread.sqrt()).powi(3)
    };
    let mut uneven = [false; PARAMETERS];
    let mut inflation = Vector::repeat(1.0);
    for i in 0..PARAMETERS {
        let ratio = sandwich[(i, i)] / model[(i, i)];
        if ratio > threshold {
            uneven[i] = true;
            // The mean's own error, and the spread between the parts beyond their errors: the next flight may be like
            // any of them.
            let spread = parts as f64 * (ratio - 1.0);
            inflation[i] = (ratio + spread).sqrt();
        }
    }
    for axis in 0..2 {
        let white = channels.white[1 + axis].abs();
        if channels.has_rates && white > WHITE {
            inflation[GAIN[axis]] = inflation[GAIN[axis]].max(2.6);
        }
    }
    let scale = Matrix::from_diagonal(&inflation);
    let mut data = scale * model * scale;
    for (i, floor) in FLOOR.into_iter().enumerate() {
        data[(i, i)] += floor * floor;
    }
    let information = data.try_inverse().unwrap_or_else(Matrix::zeros);
    let covariance = (information + prior_information)
        .try_inverse()
        .unwrap_or_else(Matrix::identity);
    // Gains as logarithms: small steps about the estimate.
    let theta = covariance * (information * state.theta + prior_information * prior);
    let relative = Matrix::from_diagonal(&Vector::from([
        1.0,
        1.0,
        1.0,
        1.0,
        1.0 / theta[GAIN[0]].max(0.05),
        1.0 / theta[GAIN[1]].max(0.05),
    ]));
    let mut last = *state;
    last.theta = theta;
    Fitted {
        curve: last.curve(),
        lag_s: last.lag_s(),
        delay_s: theta[DELAY].max(0.0),
        gain: [0, 1].map(|axis| state.base_gain[axis] * theta[GAIN[axis]]),
        covariance: relative * covariance * relative,
        data_deviation: Vector::from_fn(|i, _| (relative[(i, i)]) * data[(i, i)].sqrt()),
        parts,
        uneven,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::FlightLog;

    /// 40 s in the air at 100 Hz, the motors up and down by a fifth; `force` and pitch of a row are functions of its
    /// duty.
    fn grid(force: Option<fn(f64) -> f64>, pitch: f64) -> Grid {
        let time: Vec<f64> = (0..4000).map(|k| 0.01 * f64::from(k)).collect();
        let duty: Vec<f64> = time.iter().map(|t| 0.4 * (1.0 + 0.2 * (2.5 * t).sin())).collect();
        let mut columns: Vec<(String, Vec<f64>)> =
            (1..=4).map(|rotor| (format!("duty_{rotor}"), duty.clone())).collect();
        for (name, value) in [("roll_rad", 0.0), ("pitch_rad", pitch), ("yaw_rad", 0.0)] {
            columns.push((name.to_owned(), vec![value; time.len()]));
        }
        if let Some(force) = force {
            // A pattern in place of the accelerometer's noise.
            let noisy = |(k, duty): (usize, &f64)| -force(*duty) + 0.01 * ((k * 7 % 11) as f64 - 5.0);
            columns.push(("accel_z_m_s2".to_owned(), duty.iter().enumerate().map(noisy).collect()));
        }
        let log = FlightLog::from_columns("made", time, columns).expect("a log");
        Grid::new(&log, &[1, 2, 3, 4]).expect("a flight")
    }

    /// An n of 0.1 used to be reported, with an interval of ±0.05.
    #[test]
    fn regress_a_slope_that_no_propeller_has_is_the_classs() {
        let class = Class::of(1.0, 0.15);
        let slope_of = |force: fn(f64) -> f64| {
            let grids = [grid(Some(force), 0.0)];
            let problem = Problem {
                grids: &grids,
                places: None,
                class,
                voltage_slope: 0.0,
                bench: None,
            };
            let (fitted, impossible) = with_a_possible_slope(&problem, 0.15, fit(&problem, 0.15));
            (fitted.curve.slope(), impossible)
        };
        let (slope, impossible) = slope_of(|_| 9.81);
        assert!((slope - class.slope).abs() < 1e-3, "{slope}");
        assert!(impossible.is_some_and(|slope| slope < 0.3), "{impossible:?}");
        let (slope, impossible) = slope_of(|duty| 9.6 * (duty / 0.4).powf(1.6));
        assert!(
            (slope - 1.6).abs() < 0.2 && impossible.is_none(),
            "{slope} {impossible:?}"
        );
    }

    /// The level used to be m g, however much the vehicle leaned into the wind.
    #[test]
    fn regress_the_level_without_an_accelerometer_is_that_of_the_tilt() {
        let pitch = 28.0_f64.to_radians();
        let level = |pitch: f64| {
            let grids = [grid(None, pitch)];
            4.0 * hover_level(&grids, Curve::with_slope(0.4, 1.0, 1.0))
        };
        assert!((level(0.0) - 9.81).abs() < 0.05, "{}", level(0.0));
        assert!(
            (level(pitch) / level(0.0) * pitch.cos() - 1.0).abs() < 1e-3,
            "{}",
            level(pitch)
        );
    }
}
