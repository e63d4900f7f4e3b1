//! Delays of columns relative to each other.
//!
//! Both sides of a kinematic identity are filtered alike (a box of ±[`HALF_WINDOW_S`], so that no delay comes from the filter) and
//! correlated over lags. The peak, refined by a parabola, is the delay; its standard error follows from the correlation ρ, the
//! number of independent samples N and the mean square bandwidth β² = −ρ''/ρ at the peak:
//!
//! ```text
//! σ² = (1 − ρ²) / (ρ² N β²)
//! ```
//! Body rates and specific force come from one IMU and are taken as the reference.
//!
//! Limits: needs motion that is not periodic within ± [`LONGEST_S`]; the noise is taken as white.

use super::kinematics::ned_from_body;
use crate::log::report::Delay;
use crate::log::resample::{Between, at_times, usual_rate_hz};
use crate::log::{FlightLog, GAP_FACTOR, names};

/// Half length of the box filter, s.
const HALF_WINDOW_S: f64 = 0.05;
/// Longest delay that is looked for, s.
const LONGEST_S: f64 = 0.4;
/// Lags finer than this gain nothing, s.
const FINEST_LAG_S: f64 = 0.008;
/// Below this correlation there is not enough motion to determine a delay.
const FAINTEST: f64 = 0.5;
const GRAVITY_M_S2: f64 = 9.81;

type V3 = [f64; 3];

/// A pair of signals on a grid.
struct Signals {
    /// What may be late.
    signal: Vec<V3>,
    against: Vec<V3>,
    step_s: f64,
    /// Samples of the grid in one box.
    box_steps: f64,
}

/// Delays of attitude, velocity and position.
pub(super) fn estimate(log: &FlightLog) -> Vec<Delay> {
    let pairs: [(&str, &str, Option<Signals>); 3] = [
        ("attitude", "body rates", attitude(log)),
        ("velocity", "specific force", velocity(log)),
        ("position", "velocity", position(log)),
    ];
    pairs
        .into_iter()
        .filter_map(|(signal, against, signals)| {
            let (delay_s, uncertainty_s, correlation) = correlate(&signals?)?;
            Some(Delay {
                signal: signal.to_owned(),
                against: against.to_owned(),
                delay_s,
                uncertainty_s,
                correlation,
                applied: false,
            })
        })
        .collect()
}

/// Rows around a grid row: half width in rows, and grid rows.
fn grid(log: &FlightLog) -> (usize, Vec<usize>, f64) {
    let rate_hz = usual_rate_hz(&log.time_s);
    let half = ((HALF_WINDOW_S * rate_hz).round() as usize).max(1);
    let stride = ((FINEST_LAG_S * rate_hz).floor() as usize).max(1);
    let rows = (half..log.time_s.len().saturating_sub(half)).step_by(stride).collect();
    (half, rows, stride as f64 / rate_hz)
}

fn at(columns: &[&[f64]; 3], row: usize) -> V3 {
    [columns[0][row], columns[1][row], columns[2][row]]
}

/// Difference over a box against the mean over it.
fn signals(log: &FlightLog, difference: impl Fn(usize, usize) -> V3, value: impl Fn(usize) -> V3) -> Signals {
    let (half, rows, step_s) = grid(log);
    // Prefix sums of the trapezoidal rule.
    let mut sums = vec![[0.0; 3]; log.time_s.len()];
    let mut before = value(0);
    for row in 1..log.time_s.len() {
        let now = value(row);
        let half_dt = 0.5 * (log.time_s[row] - log.time_s[row - 1]);
        for axis in 0..3 {
            // An empty cell must not spoil all sums after it; its windows are dropped by the difference or by chance agree.
            let area = half_dt * (before[axis] + now[axis]);
            sums[row][axis] = sums[row - 1][axis] + if area.is_finite() { area } else { 0.0 };
        }
        before = now;
    }
    let longest_s = 3.0 * HALF_WINDOW_S.max(half as f64 * step_s);
    let (mut signal, mut against) = (Vec::with_capacity(rows.len()), Vec::with_capacity(rows.len()));
    for row in rows {
        let (first, last) = (row - half, row + half);
        let span_s = log.time_s[last] - log.time_s[first];
        let usable = span_s < longest_s;
        let of = |change: V3| change.map(|part| if usable { part / span_s } else { f64::NAN });
        signal.push(of(difference(first, last)));
        against.push(of([0, 1, 2].map(|axis| sums[last][axis] - sums[first][axis])));
    }
    let rate_hz = usual_rate_hz(&log.time_s);
    Signals {
        signal,
        against,
        step_s,
        box_steps: (2 * half) as f64 / rate_hz / step_s,
    }
}

fn attitude(log: &FlightLog) -> Option<Signals> {
    let attitude = log.vector(names::ATTITUDE)?;
    let rates = log.vector(names::RATES)?;
    let turned = |first: usize, last: usize| {
        super::kinematics::rotation_between(
            &ned_from_body(at(&attitude, first)),
            &ned_from_body(at(&attitude, last)),
        )
    };
    Some(signals(log, turned, |row| at(&rates, row)))
}

fn velocity(log: &FlightLog) -> Option<Signals> {
    let attitude = log.vector(names::ATTITUDE)?;
    let accel = log.vector(names::ACCEL)?;
    let velocity = log.vector(names::VELOCITY)?;
    let change = |first: usize, last: usize| [0, 1, 2].map(|axis| velocity[axis][last] - velocity[axis][first]);
    Some(signals(log, change, |row| {
        let force = at(&accel, row);
        let mut world =
            ned_from_body(at(&attitude, row)).map(|line| line[0] * force[0] + line[1] * force[1] + line[2] * force[2]);
        world[2] += GRAVITY_M_S2;
        world
    }))
}

fn position(log: &FlightLog) -> Option<Signals> {
    let position = log.vector(names::POSITION)?;
    let velocity = log.vector(names::VELOCITY)?;
    let change = |first: usize, last: usize| [0, 1, 2].map(|axis| position[axis][last] - position[axis][first]);
    Some(signals(log, change, |row| at(&velocity, row)))
}

/// Delay, standard error, correlation.
fn correlate(signals: &Signals) -> Option<(f64, f64, f64)> {
    let reach = (LONGEST_S / signals.step_s).ceil() as usize;
    let count = signals.signal.len();
    if count < 4 * reach {
        return None;
    }
    let centred = |series: &[V3]| -> Vec<V3> {
        let means = [0, 1, 2].map(|axis| {
            let present = series
                .iter()
                .map(|vector| vector[axis])
                .filter(|value| value.is_finite());
            let (count, sum) = present.fold((0_usize, 0.0), |(count, sum), value| (count + 1, sum + value));
            sum / count.max(1) as f64
        });
        series
            .iter()
            .map(|vector| [0, 1, 2].map(|axis| vector[axis] - means[axis]))
            .collect()
    };
    let (signal, against) = (centred(&signals.signal), centred(&signals.against));
    let correlation = |lag: isize| -> f64 {
        // signal(t) = against(t − lag)
        let (mut product, mut left, mut right) = (0.0, 0.0, 0.0);
        for row in reach..count - reach {
            let other = row.wrapping_add_signed(-lag);
            for axis in 0..3 {
                let (a, b) = (signal[row][axis], against[other][axis]);
                if a.is_finite() && b.is_finite() {
                    product += a * b;
                    left += a * a;
                    right += b * b;
                }
            }
        }
        product / (left * right).sqrt().max(f64::MIN_POSITIVE)
    };
    let reach = isize::try_from(reach).ok()?;
    let curve: Vec<f64> = (-reach..=reach).map(correlation).collect();
    let peak = (0..curve.len()).max_by(|a, b| curve[*a].total_cmp(&curve[*b]))?;
    let (Some(before), Some(after)) = (peak.checked_sub(1).map(|index| curve[index]), curve.get(peak + 1)) else {
        return None;
    };
    let top = curve[peak];
    let bend = before - 2.0 * top + after;
    if top < FAINTEST || bend >= 0.0 {
        return None;
    }
    let offset = 0.5 * (before - after) / bend;
    let delay_s = (peak as f64 - reach as f64 + offset) * signals.step_s;
    let bandwidth2 = -bend / (signals.step_s * signals.step_s) / top;
    let independent = 3.0 * count as f64 / signals.box_steps.max(1.0);
    let variance = (1.0 - top * top) / (top * top * independent * bandwidth2);
    Some((delay_s, variance.max(0.0).sqrt(), top))
}

impl FlightLog {
    /// The log with the estimated delays removed from attitude, velocity and position; the report states what was done.
    ///
    /// A delay is removed if it exceeds three standard errors and a tenth of a row. Values are interpolated; the ends
    /// without measurements have no value.
    #[must_use]
    pub fn aligned(&self) -> Self {
        let mut log = self.clone();
        let row_s = 1.0 / usual_rate_hz(&self.time_s);
        let gap_s = GAP_FACTOR * row_s;
        let mut velocity_s = 0.0;
        for delay in &mut log.report.delays {
            let (columns, mut shift_s): (&[&str], f64) = match delay.signal.as_str() {
                "attitude" => (&names::ATTITUDE, delay.delay_s),
                "velocity" => (&names::VELOCITY, delay.delay_s),
                // The position is compared with the velocity, which may be late itself.
                _ => (&names::POSITION, delay.delay_s + velocity_s),
            };
            let counts = delay.delay_s.abs() > (3.0 * delay.uncertainty_s).max(0.1 * row_s);
            if !counts && delay.signal != "position" {
                shift_s = 0.0;
            }
            if delay.signal == "velocity" {
                velocity_s = shift_s;
            }
            if shift_s.abs() < 0.1 * row_s {
                continue;
            }
            delay.applied = true;
            let then_s: Vec<f64> = self.time_s.iter().map(|time| time + shift_s).collect();
            for name in columns {
                if let Some(values) = log.columns.get_mut(*name) {
                    *values = at_times(&self.time_s, values, &then_s, Between::of(name), gap_s);
                }
            }
            log.report
                .notes
                .push(format!("{} moved {:+.1} ms in time", delay.signal, -1e3 * shift_s));
        }
        log
    }
}
