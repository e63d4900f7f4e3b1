//! Time stamps that scatter while the samples behind them are regular: a logger that stamps rows when they arrive.
//!
//! A column x and its derivative ẋ, both of the log, tell which it is. With h the usual interval, Δ the difference between rows and ẋ the mean
//! of two neighbours,
//! ```text
//! Δx − ẋ h = β ẋ (Δt − h) + noise:    β = 1 where the stamps are right, 0 where the samples are regular.
//! ```
//! β is estimated from all axes of position, velocity and attitude, and the stamps are replaced only where it is clearly
//! not 1 and close to 0. Rows in which ẋ is near its own noise do not count: they would draw β towards 0.

use super::checks::kinematics::{GRAVITY_M_S2, ned_from_body, white_noise};
use super::resample::{median, usual_rate_hz, wrapped};
use super::{FlightLog, names};
use std::f64::consts::TAU;

/// Scatter of the intervals over the usual one below which a model does not notice it.
const LEAST_SCATTER: f64 = 0.05;
/// Longest interval over the usual one that is no gap.
const LONGEST: f64 = 2.2;
/// ẋ over its noise from which a row counts: the noise then draws β towards 0 by a hundredth at most.
const CLEAR: f64 = 10.0;
/// Fewest rows that tell.
const FEWEST: usize = 200;
/// Standard deviations between β and 1.
const NOT_ONE: f64 = 8.0;
/// Largest β, with two standard deviations, of regular samples.
const NEARLY_ZERO: f64 = 0.2;
/// Rows over which the clock of the logger may drift.
const DRIFT_ROWS: usize = 400;

/// Share of the scatter of the stamps that the motion confirms.
struct Confirmed {
    beta: f64,
    deviation: f64,
}

/// Puts rows whose stamps scatter, and whose samples do not, on the regular times that the motion shows; a note says so.
pub(crate) fn regularise(log: &mut FlightLog) {
    let intervals: Vec<f64> = log.time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let step_s = 1.0 / usual_rate_hz(&log.time_s);
    if !(step_s > 0.0 && step_s.is_finite()) {
        return;
    }
    let near = intervals.iter().filter(|interval| **interval < LONGEST * step_s);
    let (count, sum) = near.fold((0_usize, 0.0), |(count, sum), interval| {
        (count + 1, sum + (interval - step_s).powi(2))
    });
    let scatter_s = (sum / count.max(1) as f64).sqrt();
    if scatter_s < LEAST_SCATTER * step_s {
        return;
    }
    let Some(confirmed) = confirmed(log, step_s) else {
        return;
    };
    let Confirmed { beta, deviation } = confirmed;
    if (1.0 - beta) < NOT_ONE * deviation || beta + 2.0 * deviation > NEARLY_ZERO {
        return;
    }
    let figures = format!(
        "intervals between rows scatter by {:.2} ms about {:.2} ms, and the motion that the rows hold is that of regular samples (it confirms {:.2} ± {:.2} of the scatter)",
        1e3 * scatter_s,
        1e3 * step_s,
        beta,
        2.0 * deviation
    );
    match regular(&log.time_s, step_s) {
        Some(time_s) => {
            log.time_s = time_s;
            log.report
                .notes
                .push(format!("time stamps: {figures}; the rows were put on regular times"));
        }
        None => log.report.notes.push(format!(
            "time stamps: {figures}; such stamps do not show where rows are missing, so they are kept; expect errors that nothing explains"
        )),
    }
}

/// β with its standard deviation over all columns that have a derivative in the log; `None` if too few rows tell.
fn confirmed(log: &FlightLog, step_s: f64) -> Option<Confirmed> {
    let mut all = Sums::default();
    let (velocity, attitude) = (log.vector(names::VELOCITY), log.vector(names::ATTITUDE));
    let rows = log.time_s.len();
    if let (Some(position), Some(velocity)) = (log.vector(names::POSITION), velocity) {
        for axis in 0..3 {
            all.add(&log.time_s, position[axis], velocity[axis], step_s, |d| d);
        }
    }
    if let (Some(velocity), Some(attitude), Some(accel)) = (velocity, attitude, log.vector(names::ACCEL)) {
        let at = |columns: &[&[f64]; 3], row: usize| [0, 1, 2].map(|axis: usize| columns[axis][row]);
        let world: Vec<[f64; 3]> = (0..rows)
            .map(|row| {
                let (force, turn) = (at(&accel, row), ned_from_body(at(&attitude, row)));
                let mut world = turn.map(|line| (0..3).map(|i| line[i] * force[i]).sum::<f64>());
                world[2] += GRAVITY_M_S2;
                world
            })
            .collect();
        for axis in 0..3 {
            let own: Vec<f64> = world.iter().map(|world| world[axis]).collect();
            all.add(&log.time_s, velocity[axis], &own, step_s, |d| d);
        }
    }
    if let (Some(attitude), Some(rates)) = (attitude, log.vector(names::RATES)) {
        let euler: Vec<[f64; 3]> = (0..rows)
            .map(|row| {
                let [p, q, r] = [0, 1, 2].map(|axis: usize| rates[axis][row]);
                let ((sin, cos), pitch) = (attitude[0][row].sin_cos(), attitude[1][row]);
                let turn = (sin * q + cos * r) / pitch.cos();
                [p + pitch.sin() * turn, cos * q - sin * r, turn]
            })
            .collect();
        for axis in 0..3 {
            let own: Vec<f64> = euler.iter().map(|euler| euler[axis]).collect();
            all.add(&log.time_s, attitude[axis], &own, step_s, wrapped);
        }
    }
    all.slope()
}

/// Σ w u y, Σ w u² and the variance of the former, over columns with weights w of the inverse variance of their noise.
#[derive(Default)]
struct Sums {
    moment: f64,
    square: f64,
    variance: f64,
    rows: usize,
}

impl Sums {
    /// A column with its derivative; `difference` takes a difference the short way round.
    fn add(&mut self, time_s: &[f64], x: &[f64], rate: &[f64], step_s: f64, difference: impl Fn(f64) -> f64) {
        let floor = CLEAR * white_noise(rate);
        // (u, y) of each pair of rows, `None` where it does not count.
        let pairs: Vec<Option<(f64, f64)>> = (1..x.len())
            .map(|row| {
                let interval = time_s[row] - time_s[row - 1];
                let mean = 0.5 * (rate[row] + rate[row - 1]);
                let (u, y) = (
                    mean * (interval - step_s),
                    difference(x[row] - x[row - 1]) - mean * step_s,
                );
                let counts = interval < LONGEST * step_s && mean.abs() > floor && u.is_finite() && y.is_finite();
                counts.then_some((u, y))
            })
            .collect();
        let known = || pairs.iter().flatten();
        let (count, moment, square) =
            known().fold((0_usize, 0.0, 0.0), |(n, m, s), (u, y)| (n + 1, m + u * y, s + u * u));
        if count < FEWEST || square == 0.0 {
            return;
        }
        let slope = moment / square;
        let noise = known().map(|(u, y)| (y - slope * u).powi(2)).sum::<f64>() / count as f64;
        if noise == 0.0 {
            return;
        }
        // Neighbouring differences share a row, in both factors.
        let score = |pair: &Option<(f64, f64)>| pair.map_or(0.0, |(u, y)| u * (y - slope * u));
        let own: f64 = pairs.iter().map(|pair| score(pair).powi(2)).sum();
        let shared: f64 = pairs.windows(2).map(|two| score(&two[0]) * score(&two[1])).sum();
        self.moment += moment / noise;
        self.square += square / noise;
        self.variance += (own + 2.0 * shared).max(own) / (noise * noise);
        self.rows += count;
    }

    fn slope(&self) -> Option<Confirmed> {
        (self.rows >= FEWEST).then(|| Confirmed {
            beta: self.moment / self.square,
            deviation: self.variance.sqrt() / self.square,
        })
    }
}

/// Regular times of rows; `None` if they do not show where rows are missing.
fn regular(time_s: &[f64], step_s: f64) -> Option<Vec<f64>> {
    /// Wander of the averaged stamps about a line over the interval, below which no row is missing: one shifts them by 1.
    const NONE_MISSING: f64 = 0.3;
    if let Some(places) = places(time_s, step_s) {
        let times = on_places(time_s, &places);
        return times.windows(2).all(|pair| pair[1] > pair[0]).then_some(times);
    }
    let all: Vec<f64> = (0..time_s.len()).map(|row| row as f64).collect();
    let times = on_places(time_s, &all);
    let (slope, offset) = line(&all, &times);
    let off = |(row, time): (usize, &f64)| (time - offset - slope * row as f64).abs();
    (times.iter().enumerate().map(off).fold(0.0, f64::max) < NONE_MISSING * step_s).then_some(times)
}

/// Places of the rows on a regular grid, missing ones counted, by the phase of the stamps on it; `None` where their
/// scatter reaches half of an interval.
fn places(time_s: &[f64], step_s: f64) -> Option<Vec<f64>> {
    /// Rows over which the interval is averaged.
    const SPAN: usize = 20;
    /// Rows of which most must agree on how many are missing before them.
    const AGREE: usize = 21;
    /// Share of rows that may be nearer to a place that is not theirs.
    const MOST_AMBIGUOUS: f64 = 0.15;
    let rows = time_s.len();
    let since: Vec<f64> = time_s.iter().map(|time| time - time_s[0]).collect();
    let mut step_s = step_s;
    for _ in 0..3 {
        // Spans in which a row is missing are longer by an interval.
        let spans = since
            .iter()
            .zip(since.iter().skip(SPAN))
            .map(|(begin, end)| end - begin);
        let near = spans.filter(|span| (span - SPAN as f64 * step_s).abs() < 0.5 * step_s);
        let (count, sum) = near.fold((0_usize, 0.0), |(count, sum), span| (count + 1, sum + span));
        if count == 0 {
            return None;
        }
        step_s = sum / (count * SPAN) as f64;
    }
    let late = phases(&since, step_s);
    let (rate, _) = line(&since, &late);
    step_s *= 1.0 + rate;
    let late = phases(&since, step_s);
    let missing: Vec<f64> = (0..rows)
        .map(|row| ((since[row] - late[row]) / step_s).round() - row as f64)
        .collect();
    let mut most = f64::NEG_INFINITY;
    let agreed: Vec<f64> = (0..rows)
        .map(|row| {
            let mut near = missing[row.saturating_sub(AGREE / 2)..(row + AGREE / 2 + 1).min(rows)].to_vec();
            most = most.max(median(&mut near).unwrap_or(0.0));
            most
        })
        .collect();
    let ambiguous = missing
        .iter()
        .zip(&agreed)
        .filter(|(own, agreed)| own != agreed)
        .count();
    (ambiguous as f64 <= MOST_AMBIGUOUS * rows as f64).then(|| {
        agreed
            .iter()
            .enumerate()
            .map(|(row, missing)| row as f64 + missing)
            .collect()
    })
}

/// What stamps are late by against a grid, by the mean direction of their phases over [`DRIFT_ROWS`], which missing rows
/// leave alone; continuous from row to row.
fn phases(since_s: &[f64], step_s: f64) -> Vec<f64> {
    let angles = since_s.iter().map(|time| TAU * time / step_s);
    let (sines, cosines): (Vec<f64>, Vec<f64>) = angles.map(f64::sin_cos).unzip();
    let mut before = 0.0;
    averaged(&sines)
        .iter()
        .zip(averaged(&cosines))
        .map(|(sine, cosine)| {
            before += wrapped(sine.atan2(cosine) - before);
            before * step_s / TAU
        })
        .collect()
}

/// Times of places of a grid: that of their line, and what the stamps are late by on average over [`DRIFT_ROWS`].
fn on_places(time_s: &[f64], places: &[f64]) -> Vec<f64> {
    let (step_s, _) = line(places, time_s);
    let late: Vec<f64> = places
        .iter()
        .zip(time_s)
        .map(|(place, time)| time - place * step_s)
        .collect();
    let late = averaged(&late);
    places
        .iter()
        .zip(&late)
        .map(|(place, late)| place * step_s + late)
        .collect()
}

/// Mean over the nearest [`DRIFT_ROWS`] values.
fn averaged(values: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0];
    for value in values {
        sums.push(sums[sums.len() - 1] + value);
    }
    let rows = values.len();
    let mean = |row: usize| {
        let first = row.saturating_sub(DRIFT_ROWS / 2).min(rows.saturating_sub(DRIFT_ROWS));
        let last = (first + DRIFT_ROWS).min(rows);
        (sums[last] - sums[first]) / (last - first) as f64
    };
    (0..rows).map(mean).collect()
}

/// Slope and offset of a line by least squares.
fn line(x: &[f64], y: &[f64]) -> (f64, f64) {
    let count = x.len() as f64;
    let (mean_x, mean_y) = (x.iter().sum::<f64>() / count, y.iter().sum::<f64>() / count);
    let square: f64 = x.iter().map(|x| (x - mean_x).powi(2)).sum();
    let moment: f64 = x.iter().zip(y).map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    let slope = if square > 0.0 { moment / square } else { 0.0 };
    (slope, mean_y - slope * mean_x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_plant::random::NormalStream;

    const STEP_S: f64 = 0.005;
    const ROWS: usize = 6000;

    /// Stamps, columns and true times of a flight at up to 5 m/s with noise; stamps scatter by up to `scatter_s`.
    type Rows = (Vec<f64>, Vec<(String, Vec<f64>)>, Vec<f64>);

    fn flown(scatter_s: f64, sampled_at_stamps: bool, drift: f64) -> Rows {
        let mut noise = NormalStream::new(4, "stamps");
        let regular: Vec<f64> = (0..ROWS).map(|row| row as f64 * STEP_S * (1.0 + drift)).collect();
        let scattered = regular
            .iter()
            .map(|time| time + scatter_s * noise.sample().clamp(-1.0, 1.0));
        let stamps: Vec<f64> = scattered.collect();
        let at = if sampled_at_stamps { &stamps } else { &regular };
        let mut column = |of: &dyn Fn(f64) -> f64, deviation: f64| -> Vec<f64> {
            at.iter().map(|&time| of(time) + deviation * noise.sample()).collect()
        };
        let columns = [
            ("position_north_m", column(&|t| 10.0 * (0.5 * t).sin(), 0.002)),
            ("position_east_m", column(&|t| 10.0 * (0.3 * t).cos(), 0.002)),
            ("position_down_m", column(&|_| -5.0, 0.002)),
            ("velocity_north_m_s", column(&|t| 5.0 * (0.5 * t).cos(), 0.01)),
            ("velocity_east_m_s", column(&|t| -3.0 * (0.3 * t).sin(), 0.01)),
            ("velocity_down_m_s", column(&|_| 0.0, 0.01)),
        ];
        let columns = columns.map(|(name, values)| (name.to_owned(), values));
        (stamps, columns.into(), regular)
    }

    fn told(log: &FlightLog) -> bool {
        log.report
            .notes
            .iter()
            .any(|note| note.starts_with("time stamps") && note.ends_with("regular times"))
    }

    fn worst(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn val_stamps_that_scatter_about_regular_samples_are_replaced_also_with_a_drifting_clock() {
        for (scatter_s, drift) in [(0.001, 0.0), (0.0024, 0.001)] {
            let (stamps, columns, regular) = flown(scatter_s, false, drift);
            let log = FlightLog::from_columns("flown", stamps, columns).unwrap();
            assert!(told(&log), "{scatter_s} {drift}");
            // The mean of 400 stamps: 1.7 ms / √400, three times.
            let worst = worst(&log.time_s, &regular);
            assert!(worst < 0.3e-3, "{scatter_s} {drift}: {worst} s");
        }
    }

    #[test]
    fn val_stamps_that_tell_when_a_sample_was_taken_stay() {
        let (stamps, columns, _) = flown(0.002, true, 0.0);
        let log = FlightLog::from_columns("flown", stamps.clone(), columns).unwrap();
        assert!(!told(&log));
        assert_eq!(log.time_s, stamps);
    }

    /// A row that is missing is a place without a row, not a shift of all later ones.
    #[test]
    fn val_missing_rows_keep_their_place() {
        let (stamps, columns, regular) = flown(0.0015, false, 0.0);
        let kept = |values: &[f64]| -> Vec<f64> {
            let rows = values.iter().enumerate().filter(|(row, _)| row % 150 != 77);
            rows.map(|(_, value)| *value).collect()
        };
        let columns = columns.iter().map(|(name, values)| (name.clone(), kept(values)));
        let log = FlightLog::from_columns("rows", kept(&stamps), columns).unwrap();
        assert!(told(&log));
        let worst = worst(&log.time_s, &kept(&regular));
        assert!(worst < 0.3e-3, "{worst} s");
    }
}
