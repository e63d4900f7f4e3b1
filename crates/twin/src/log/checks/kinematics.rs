//! Are the columns kinematically consistent?
//!
//! Three identities hold for any rigid body, whatever flies it. Over windows of T they need no derivative of noise:
//!
//! ```text
//! rates      log(R(t)ᵀ R(t+T))  = ∫ ω dt               body axes
//! velocity   v(t+T) − v(t)      = ∫ (R f + g) dt        world axes; f: specific force
//! position   p(t+T) − p(t)      = ∫ v dt                world axes
//! ```
//! Left and right side of each are compared over all windows: on which axes, with which sign, with which gain. Anything but
//! identity and gain 1 means wrong axes, wrong units or a wrong clock, and which of them follows from the pattern.
//!
//! Limits: needs motion (a stationary hover shows nothing and is reported as "not enough motion"); windows with empty
//! cells or gaps are left out.

use crate::log::resample::{usual_rate_hz, wrapped};
use crate::log::{FlightLog, names};

/// Standard gravity is accurate enough for a check, m/s².
pub(crate) const GRAVITY_M_S2: f64 = 9.81;
/// Shortest window, s: attitude noise over it must be small against the motion.
const SHORTEST_WINDOW_S: f64 = 0.2;
/// A window has at least this many intervals.
const FEWEST_INTERVALS: usize = 5;
/// Fewer windows than this are not conclusive.
const FEWEST_WINDOWS: usize = 20;

type V3 = [f64; 3];
type M3 = [V3; 3];

/// One identity over all windows: the change according to the motion (`left`) and according to the integral (`right`).
#[derive(Clone, Debug)]
pub(crate) struct Pairs {
    left: Vec<V3>,
    right: Vec<V3>,
    /// White noise of the left side, from the log's own third differences or its steps, per axis.
    noise: V3,
    /// White noise of the right side's integral over a window; 0 if not required.
    integrated: V3,
}

/// Signed axes: in `to[i] = (axis, sign)`, axis i of the left side corresponds to that axis of the right side.
pub(crate) type Axes = [(usize, f64); 3];

/// How well the two sides of an identity agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fit {
    /// Best signed axes.
    pub(crate) axes: Axes,
    /// Share of the left side's variance that they explain with the best common gain.
    pub(crate) explained: f64,
    /// The same with the axes unchanged.
    pub(crate) explained_as_is: f64,
    /// left = gain · right, least squares over the axes, with the best axes.
    pub(crate) gain: f64,
    /// Axes whose motion exceeds the noise.
    pub(crate) moving: [bool; 3],
    /// The right side's noise hides the motion on an axis that moves: a disagreement of the sides is then not
    /// conclusive.
    pub(crate) hidden: bool,
}

pub(crate) const IDENTITY: Axes = [(0, 1.0), (1, 1.0), (2, 1.0)];

/// R of Eq. 2: body vectors to the world.
pub(crate) fn ned_from_body([roll, pitch, yaw]: V3) -> M3 {
    let (sr, cr) = roll.sin_cos();
    let (sp, cp) = pitch.sin_cos();
    let (sy, cy) = yaw.sin_cos();
    [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
}

fn apply(matrix: &M3, vector: V3) -> V3 {
    matrix.map(|row| row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2])
}

/// Rotation vector of AᵀB, rad.
pub(crate) fn rotation_between(a: &M3, b: &M3) -> V3 {
    let mut relative = [[0.0; 3]; 3];
    for (row, line) in relative.iter_mut().enumerate() {
        for (column, cell) in line.iter_mut().enumerate() {
            *cell = (0..3).map(|k| a[k][row] * b[k][column]).sum();
        }
    }
    let twice_sin = [
        relative[2][1] - relative[1][2],
        relative[0][2] - relative[2][0],
        relative[1][0] - relative[0][1],
    ];
    let cos = (0.5 * (relative[0][0] + relative[1][1] + relative[2][2] - 1.0)).clamp(-1.0, 1.0);
    let sin = 0.5 * twice_sin.iter().map(|part| part * part).sum::<f64>().sqrt();
    let angle = sin.atan2(cos);
    let factor = if sin < 1e-9 { 0.5 } else { 0.5 * angle / sin };
    twice_sin.map(|part| part * factor)
}

/// Windows of a log: (first row, last row), without gaps.
fn windows(log: &FlightLog) -> Vec<(usize, usize)> {
    let rate_hz = usual_rate_hz(&log.time_s);
    let rows = FEWEST_INTERVALS.max((SHORTEST_WINDOW_S * rate_hz).round() as usize);
    let longest_s = 1.5 * rows as f64 / rate_hz;
    (0..log.time_s.len().saturating_sub(rows))
        .step_by(rows)
        .map(|first| (first, first + rows))
        .filter(|(first, last)| log.time_s[*last] - log.time_s[*first] < longest_s)
        .collect()
}

/// Trapezoidal integral over a window; NaN if a cell is empty.
fn integral(time_s: &[f64], first: usize, last: usize, value: impl Fn(usize) -> V3) -> V3 {
    let mut sum = [0.0; 3];
    let mut before = value(first);
    for row in first..last {
        let after = value(row + 1);
        let half_dt = 0.5 * (time_s[row + 1] - time_s[row]);
        for axis in 0..3 {
            sum[axis] += half_dt * (before[axis] + after[axis]);
        }
        before = after;
    }
    sum
}

fn at(columns: &[&[f64]; 3], row: usize) -> V3 {
    [columns[0][row], columns[1][row], columns[2][row]]
}

fn gather(pairs: impl Iterator<Item = (V3, V3)>, noise: V3, integrated: V3) -> Option<Pairs> {
    let finite = |vector: &V3| vector.iter().all(|part| part.is_finite());
    let (left, right): (Vec<V3>, Vec<V3>) = pairs.filter(|(left, right)| finite(left) && finite(right)).unzip();
    (left.len() >= FEWEST_WINDOWS).then_some(Pairs {
        left,
        right,
        noise,
        integrated,
    })
}

/// Standard deviation of the white part of a column from its third differences (a cubic has none; their variance is 20 σ²).
pub(crate) fn white_noise(values: &[f64]) -> f64 {
    let third = values
        .windows(4)
        .map(|v| v[3] - 3.0 * v[2] + 3.0 * v[1] - v[0])
        .filter(|d| d.is_finite());
    let (count, sum) = third.fold((0_usize, 0.0), |(count, sum), d| (count + 1, sum + d * d));
    if count == 0 {
        0.0
    } else {
        (sum / count as f64 / 20.0).sqrt()
    }
}

/// Step of a column that is held between its updates or rounded: the value below which a tenth of its changes lie. The
/// third differences of such a column are 0 nearly everywhere. 0 if most rows differ.
fn step(column: &[f64]) -> f64 {
    let changes = column.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let mut steps: Vec<f64> = changes.filter(|change| change.is_finite() && *change > 0.0).collect();
    if 2 * steps.len() > column.len() || steps.is_empty() {
        return 0.0;
    }
    let tenth = steps.len() / 10;
    *steps.select_nth_unstable_by(tenth, f64::total_cmp).1
}

/// Attitude against body rates.
pub(crate) fn rate_pairs(log: &FlightLog) -> Option<Pairs> {
    let attitude = log.vector(names::ATTITUDE)?;
    let rates = log.vector(names::RATES)?;
    let noise = attitude.map(|column| std::f64::consts::SQRT_2 * white_noise(&unwrapped(column)));
    let pairs = windows(log).into_iter().map(|(first, last)| {
        let left = rotation_between(
            &ned_from_body(at(&attitude, first)),
            &ned_from_body(at(&attitude, last)),
        );
        (left, integral(&log.time_s, first, last, |row| at(&rates, row)))
    });
    gather(pairs, noise, [0.0; 3])
}

fn unwrapped(column: &[f64]) -> Vec<f64> {
    let mut before: Option<f64> = None;
    column
        .iter()
        .map(|angle| {
            let next = before
                .filter(|before| before.is_finite())
                .map_or(*angle, |before| before + wrapped(angle - before));
            before = Some(next);
            next
        })
        .collect()
}

/// Velocity against specific force.
pub(crate) fn velocity_pairs(log: &FlightLog) -> Option<Pairs> {
    force_pairs(log, |attitude, force| apply(&ned_from_body(attitude), force))
}

/// The same for a force that is already in world axes.
pub(crate) fn world_force_pairs(log: &FlightLog) -> Option<Pairs> {
    force_pairs(log, |_, force| force)
}

/// Velocity against specific force, which `to_world` rotates, given roll, pitch, yaw, from the accelerometer's axes
/// into the world's.
fn force_pairs(log: &FlightLog, to_world: impl Fn(V3, V3) -> V3) -> Option<Pairs> {
    let attitude = log.vector(names::ATTITUDE)?;
    let accel = log.vector(names::ACCEL)?;
    let velocity = log.vector(names::VELOCITY)?;
    let noise = velocity.map(|column| std::f64::consts::SQRT_2 * white_noise(column).max(step(column)));
    // Vibration of the accelerometer over a window, about the same on each axis of the world.
    let rate_hz = usual_rate_hz(&log.time_s);
    let shakes = (accel.iter().map(|column| white_noise(column).powi(2)).sum::<f64>() / 3.0).sqrt();
    let integrated = [shakes * (SHORTEST_WINDOW_S.max(FEWEST_INTERVALS as f64 / rate_hz) / rate_hz).sqrt(); 3];
    // An accelerometer that reads +g at rest is upside down; without this, gravity would count twice and hide the rest.
    let up = mean(accel[2]) > 0.5 * GRAVITY_M_S2;
    let sign = if up { [1.0, -1.0, -1.0] } else { [1.0; 3] };
    let pairs = windows(log).into_iter().map(|(first, last)| {
        let (before, after) = (at(&velocity, first), at(&velocity, last));
        let left = [0, 1, 2].map(|axis| after[axis] - before[axis]);
        let right = integral(&log.time_s, first, last, |row| {
            let force = at(&accel, row);
            let mut world = to_world(at(&attitude, row), [0, 1, 2].map(|axis| sign[axis] * force[axis]));
            world[2] += GRAVITY_M_S2;
            world
        });
        (left, right)
    });
    gather(pairs, noise, integrated)
}

/// Position against velocity.
pub(crate) fn position_pairs(log: &FlightLog) -> Option<Pairs> {
    let position = log.vector(names::POSITION)?;
    let velocity = log.vector(names::VELOCITY)?;
    let noise = position.map(|column| std::f64::consts::SQRT_2 * white_noise(column));
    let pairs = windows(log).into_iter().map(|(first, last)| {
        let (before, after) = (at(&position, first), at(&position, last));
        let left = [0, 1, 2].map(|axis| after[axis] - before[axis]);
        (left, integral(&log.time_s, first, last, |row| at(&velocity, row)))
    });
    gather(pairs, noise, [0.0; 3])
}

/// Specific force up along the body's z from velocity and attitude, m/s², and mean duty, window by window: without an
/// accelerometer, this shows which way z points.
pub(crate) fn lift_pairs(log: &FlightLog) -> Option<Vec<(f64, f64)>> {
    let attitude = log.vector(names::ATTITUDE)?;
    let velocity = log.vector(names::VELOCITY)?;
    let duties = log.duties();
    let pairs = windows(log).into_iter().map(|(first, last)| {
        let elapsed = log.time_s[last] - log.time_s[first];
        let (before, after) = (at(&velocity, first), at(&velocity, last));
        let mut force = [0, 1, 2].map(|axis| (after[axis] - before[axis]) / elapsed);
        force[2] -= GRAVITY_M_S2;
        let rotation = ned_from_body(at(&attitude, (first + last) / 2));
        let up = -(0..3).map(|axis| rotation[axis][2] * force[axis]).sum::<f64>();
        let rows = duties.iter().flat_map(|duty| &duty[first..=last]);
        let duty = rows.sum::<f64>() / (duties.len() * (last - first + 1)) as f64;
        (up, duty)
    });
    let pairs: Vec<(f64, f64)> = pairs.filter(|(up, duty)| up.is_finite() && duty.is_finite()).collect();
    (pairs.len() >= FEWEST_WINDOWS).then_some(pairs)
}

pub(crate) fn mean(values: &[f64]) -> f64 {
    let (count, sum) = values
        .iter()
        .filter(|value| value.is_finite())
        .fold((0_usize, 0.0), |(count, sum), value| (count + 1, sum + value));
    sum / count as f64
}

/// All 48 signed axes.
fn signed_axes() -> impl Iterator<Item = Axes> {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    ORDERS.into_iter().flat_map(|order| {
        (0..8_u32)
            .map(move |signs| [0, 1, 2].map(|axis| (order[axis], if signs >> axis & 1 == 1 { -1.0 } else { 1.0 })))
    })
}

impl Pairs {
    /// Fits signed axes and a common gain; `None` if no axis moves enough to decide.
    ///
    /// Means are removed, so that a sensor bias does not matter.
    pub(crate) fn fit(&self) -> Option<Fit> {
        /// Motion of an axis counts above this many noise deviations.
        const STANDS_OUT: f64 = 3.0;
        let count = self.left.len() as f64;
        let centred = |vectors: &[V3]| -> Vec<V3> {
            let means = [0, 1, 2].map(|axis| vectors.iter().map(|vector| vector[axis]).sum::<f64>() / count);
            vectors
                .iter()
                .map(|vector| [0, 1, 2].map(|axis| vector[axis] - means[axis]))
                .collect()
        };
        let (left, right) = (centred(&self.left), centred(&self.right));
        let product = |a: &[V3], b: &[V3], i: usize, j: usize| -> f64 {
            a.iter().zip(b).map(|(a, b)| a[i] * b[j]).sum::<f64>() / count
        };
        let left_power = [0, 1, 2].map(|axis| product(&left, &left, axis, axis));
        let moving = [0, 1, 2].map(|axis| {
            let noise = self.noise[axis];
            left_power[axis] > (STANDS_OUT * noise).powi(2) && left_power[axis] > 1e-10
        });
        if moving.iter().filter(|moving| **moving).count() < 2 {
            return None;
        }
        let mut cross = [[0.0; 3]; 3];
        for (i, line) in cross.iter_mut().enumerate() {
            for (j, cell) in line.iter_mut().enumerate() {
                *cell = product(&left, &right, i, j);
            }
        }
        let right_power = [0, 1, 2].map(|axis| product(&right, &right, axis, axis));
        // Axes are weighted by their correlation, so that a fast yaw cannot outvote roll and pitch.
        let score = |axes: &Axes| -> (f64, f64) {
            let (mut explained, mut top, mut bottom, mut counted) = (0.0, 0.0, 0.0, 0.0);
            for i in (0..3).filter(|axis| moving[*axis]) {
                let (j, sign) = axes[i];
                let correlation = sign * cross[i][j] / (left_power[i] * right_power[j]).sqrt().max(f64::MIN_POSITIVE);
                explained += correlation.max(0.0).powi(2) * correlation.signum();
                top += sign * cross[i][j] / left_power[i];
                bottom += right_power[j] / left_power[i];
                counted += 1.0;
            }
            (explained / counted, top / bottom.max(f64::MIN_POSITIVE))
        };
        let (explained_as_is, gain_as_is) = score(&IDENTITY);
        // In a tie (axes that do not move), the identity is chosen.
        let mut best = (IDENTITY, explained_as_is, gain_as_is);
        for axes in signed_axes() {
            let (explained, gain) = score(&axes);
            if explained > best.1 + 1e-9 {
                best = (axes, explained, gain);
            }
        }
        Some(Fit {
            axes: best.0,
            explained: best.1,
            explained_as_is,
            gain: best.2,
            moving,
            hidden: (0..3).any(|axis| moving[axis] && self.integrated[axis].powi(2) > left_power[axis]),
        })
    }
}
