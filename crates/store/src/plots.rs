//! Plot data: telemetry decimated to screen resolution, without hiding anything.
//!
//! * [`Envelope`]: a bucket of rows becomes its lowest and its highest value, in the order in which they occurred. A spike of a
//!   single step stays visible however long the flight. All series of one envelope share their time axis, exact to half a bucket.
//! * [`Means`]: a bucket becomes its mean; for series otherwise covered by noise.
//! * [`Verdicts`]: a bucket becomes the set of verdicts in force during it, so that no isolated false alarm disappears.
//! * [`Sample`]: every k-th sample of a stretch, for the normal plot.

use crate::analysis::column;
use crate::spool::{Chunk, SpoolHeader};
use crate::summary::Evaluator;
use crate::telemetry::Column;
use rotortwin_flight_core::fdi::FaultVerdict;
use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, NOT_READY, UNKNOWN};

/// Buckets of the full-width plots: at most twice this many points.
const WIDE_BUCKETS: u64 = 1950;
/// Buckets of the small residual plots.
const SMALL_BUCKETS: u64 = 900;
/// Buckets of the means.
const MEAN_BUCKETS: u64 = 360;
/// Maximum number of samples for one line of the normal plot; at least half of it are kept.
const SAMPLE_LIMIT: usize = 8192;
/// Omitted at the beginning of a stretch, s: the observers settle.
const SETTLE_S: f64 = 1.0;

/// Start of the samples that determine the scale of the residual plots, s: otherwise, in a flight of some length, the transient at its
/// start would be the only visible feature.
pub(crate) fn scale_from_s(end_s: f64) -> f64 {
    if end_s > 8.0 { 2.0 } else { 0.0 }
}

/// A column, optionally minus another one, and the conversion factor to the unit of its plot.
#[derive(Clone, Copy, Debug)]
struct Source {
    place: usize,
    less: Option<usize>,
    factor: f64,
}

impl Source {
    #[inline]
    fn value(&self, chunk: &Chunk, row: usize) -> f64 {
        let less = self.less.map_or(0.0, |place| chunk.columns[place][row]);
        (chunk.columns[self.place][row] - less) * self.factor
    }
}

/// Lowest and highest value of each bucket.
#[derive(Debug)]
pub(crate) struct Envelope {
    sources: Vec<Source>,
    time: usize,
    bucket_rows: u64,
    in_bucket: u64,
    /// Per source: lowest, highest, and whether the lowest came first.
    open: Vec<(f64, f64, bool)>,
    /// Start of the open bucket, s.
    start_s: f64,
    /// Time of each point, s.
    pub(crate) times: Vec<f32>,
    /// Per source: value of each point; NaN if the bucket has no number.
    pub(crate) values: Vec<Vec<f32>>,
}

impl Envelope {
    fn new(sources: Vec<Source>, time: usize, rows: u64, buckets: u64) -> Self {
        // As many points as rows is the full resolution: no thinning.
        let bucket_rows = if rows <= 2 * buckets { 1 } else { rows.div_ceil(buckets) };
        let count = sources.len();
        Self {
            sources,
            time,
            bucket_rows,
            in_bucket: 0,
            open: vec![(f64::INFINITY, f64::NEG_INFINITY, true); count],
            start_s: 0.0,
            times: Vec::new(),
            values: vec![Vec::new(); count],
        }
    }

    fn push(&mut self, chunk: &Chunk) {
        for row in 0..chunk.len {
            let time = chunk.columns[self.time][row];
            if self.in_bucket == 0 {
                self.start_s = time;
            }
            for (source, (low, high, low_first)) in self.sources.iter().zip(&mut self.open) {
                let value = source.value(chunk, row);
                if value < *low {
                    *low = value;
                    *low_first = false;
                }
                if value > *high {
                    *high = value;
                    *low_first = true;
                }
            }
            self.in_bucket += 1;
            if self.in_bucket == self.bucket_rows {
                self.close(time);
            }
        }
    }

    /// Closes a bucket whose last row is at `end_s`.
    fn close(&mut self, end_s: f64) {
        // A bucket of one row is one point.
        let count = if self.in_bucket > 1 { 2 } else { 1 };
        self.times.push(self.start_s as f32);
        if count == 2 {
            self.times.push(((self.start_s + end_s) / 2.0) as f32);
        }
        for (open, values) in self.open.iter_mut().zip(&mut self.values) {
            let (low, high, low_first) = *open;
            let points = match (low <= high, low_first) {
                (false, _) => [f32::NAN; 2],
                (true, true) => [low as f32, high as f32],
                (true, false) => [high as f32, low as f32],
            };
            values.extend(&points[..count]);
            *open = (f64::INFINITY, f64::NEG_INFINITY, true);
        }
        self.in_bucket = 0;
    }

    fn finish(&mut self, end_s: f64) {
        if self.in_bucket > 0 {
            self.close(end_s);
        }
    }
}

/// Mean of each bucket, at its middle.
#[derive(Debug)]
pub(crate) struct Means {
    sources: Vec<Source>,
    time: usize,
    bucket_rows: u64,
    in_bucket: u64,
    sums: Vec<f64>,
    start_s: f64,
    /// Time of each point, s.
    pub(crate) times: Vec<f32>,
    /// Per source: value of each point.
    pub(crate) values: Vec<Vec<f32>>,
}

impl Means {
    fn new(sources: Vec<Source>, time: usize, rows: u64, buckets: u64) -> Self {
        let count = sources.len();
        Self {
            sources,
            time,
            bucket_rows: rows.div_ceil(buckets).max(1),
            in_bucket: 0,
            sums: vec![0.0; count],
            start_s: 0.0,
            times: Vec::new(),
            values: vec![Vec::new(); count],
        }
    }

    fn push(&mut self, chunk: &Chunk) {
        for row in 0..chunk.len {
            let time = chunk.columns[self.time][row];
            if self.in_bucket == 0 {
                self.start_s = time;
            }
            for (source, sum) in self.sources.iter().zip(&mut self.sums) {
                *sum += source.value(chunk, row);
            }
            self.in_bucket += 1;
            if self.in_bucket == self.bucket_rows {
                self.close(time);
            }
        }
    }

    fn close(&mut self, end_s: f64) {
        self.times.push(((self.start_s + end_s) / 2.0) as f32);
        for (sum, values) in self.sums.iter_mut().zip(&mut self.values) {
            values.push((*sum / self.in_bucket as f64) as f32);
            *sum = 0.0;
        }
        self.in_bucket = 0;
    }

    fn finish(&mut self, end_s: f64) {
        if self.in_bucket > 0 {
            self.close(end_s);
        }
    }
}

/// A stretch of time in which the same set of verdicts was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seen {
    /// s.
    pub(crate) start_s: f64,
    /// s.
    pub(crate) end_s: f64,
    /// Bit (code + 2) set: the verdict was in force; a pair sets the bits of both rotors, an ambiguous verdict that of an unknown fault.
    pub(crate) codes: u32,
}

/// Which verdicts of one evaluator were in force at which time.
#[derive(Debug)]
pub(crate) struct Verdicts {
    place: usize,
    open: u32,
    /// In chronological order, without gaps.
    pub(crate) seen: Vec<Seen>,
}

impl Verdicts {
    fn close(&mut self, start_s: f64, end_s: f64) {
        match self.seen.last_mut() {
            Some(last) if last.codes == self.open => last.end_s = end_s,
            _ => self.seen.push(Seen {
                start_s,
                end_s,
                codes: self.open,
            }),
        }
        self.open = 0;
    }
}

/// Evenly thinned samples of the three components of two residuals.
#[derive(Debug, Default)]
pub(crate) struct Sample {
    stride: u64,
    seen: u64,
    /// Residual 1 and 2, components arm, lever, yaw.
    values: Vec<[f64; 6]>,
}

impl Sample {
    fn push(&mut self, value: [f64; 6]) {
        let stride = self.stride.max(1);
        if self.seen.is_multiple_of(stride) {
            if self.values.len() == SAMPLE_LIMIT {
                let mut at = 0;
                self.values.retain(|_| {
                    at += 1;
                    at % 2 == 1
                });
                self.stride = 2 * stride;
            }
            if self.seen.is_multiple_of(self.stride.max(1)) {
                self.values.push(value);
            }
        }
        self.seen += 1;
    }

    /// Sorted samples of one component (0 to 2) of residual 1 or 2 (`second`).
    pub(crate) fn sorted(&self, second: bool, component: usize) -> Vec<f64> {
        let at = component + if second { 3 } else { 0 };
        let mut values: Vec<f64> = self
            .values
            .iter()
            .map(|value| value[at])
            .filter(|value| value.is_finite())
            .collect();
        values.sort_by(f64::total_cmp);
        values
    }
}

/// Progress in collecting samples for the normal plot.
#[derive(Debug, PartialEq)]
enum Stage {
    Healthy {
        from_s: f64,
    },
    Faulty {
        from_s: f64,
        label: f64,
        conditions: Vec<f64>,
    },
    Over,
}

/// Data of all figures of one run.
#[derive(Debug)]
pub(crate) struct Plots {
    pub(crate) rotor_count: usize,
    /// Positions, attitude, battery: series in the order of [`WIDE`], then the position error north, east, down.
    pub(crate) wide: Envelope,
    /// Residuals: rotor-major, arm, lever, yaw.
    pub(crate) residuals: Envelope,
    /// Means of the residuals, the same order.
    pub(crate) residual_means: Means,
    /// In the order of [`Evaluator::ALL`].
    pub(crate) verdicts: Vec<Verdicts>,
    /// Before the first fault.
    pub(crate) healthy: Sample,
    /// In the first interval with a fault.
    pub(crate) faulty: Sample,
    /// Length of the flight, s.
    pub(crate) end_s: f64,
    /// For the normal plot: residual 2 instead of 1, because rotor 1 is the faulty one.
    pub(crate) second_residual: bool,
    stage: Stage,
    verdict_rows: u64,
    in_bucket: u64,
    bucket_start_s: f64,
    step_s: f64,
    time: usize,
    label: usize,
    conditions: usize,
    residual_place: usize,
}

/// Columns of the wide plots with the factor to the plot's unit.
pub(crate) const WIDE: [(&str, f64); 16] = [
    ("reference_north_m", 1.0),
    ("true_position_north_m", 1.0),
    ("reference_east_m", 1.0),
    ("true_position_east_m", 1.0),
    ("reference_down_m", 1.0),
    ("true_position_down_m", 1.0),
    ("roll_setpoint_rad", DEGREES),
    ("true_roll_rad", DEGREES),
    ("pitch_setpoint_rad", DEGREES),
    ("true_pitch_rad", DEGREES),
    ("reference_yaw_rad", DEGREES),
    ("true_yaw_rad", DEGREES),
    ("true_state_of_charge", 100.0),
    ("true_open_circuit_voltage_v", 1.0),
    ("true_battery_voltage_v", 1.0),
    ("thrust_loss_n", 1.0),
];

const DEGREES: f64 = 180.0 / std::f64::consts::PI;

impl Plots {
    /// For a spool with this header and schema and `rows` rows.
    pub(crate) fn new(header: &SpoolHeader, columns: &[Column], rows: u64) -> Self {
        let place = |name: &str| column(columns, name);
        let time = place("time_s");
        let source = |place: usize, factor: f64| Source {
            place,
            less: None,
            factor,
        };
        let residual_place = place("residual_1_arm_nms");
        let residuals: Vec<Source> = (0..3 * header.rotor_count)
            .map(|component| source(residual_place + component, 1.0))
            .collect();
        let errors = [(0, 1), (2, 3), (4, 5)].map(|(reference, state)| Source {
            less: Some(place(WIDE[reference].0)),
            ..source(place(WIDE[state].0), 1.0)
        });
        let wide = WIDE
            .iter()
            .map(|(name, factor)| source(place(name), *factor))
            .chain(errors)
            .collect();
        Self {
            rotor_count: header.rotor_count,
            wide: Envelope::new(wide, time, rows, WIDE_BUCKETS),
            residuals: Envelope::new(residuals.clone(), time, rows, SMALL_BUCKETS),
            residual_means: Means::new(residuals, time, rows, MEAN_BUCKETS),
            verdicts: Evaluator::ALL
                .map(|evaluator| Verdicts {
                    place: place(evaluator.column()),
                    open: 0,
                    seen: Vec::new(),
                })
                .into(),
            healthy: Sample::default(),
            faulty: Sample::default(),
            end_s: 0.0,
            second_residual: false,
            stage: Stage::Healthy { from_s: SETTLE_S },
            verdict_rows: rows.div_ceil(2 * WIDE_BUCKETS).max(1),
            in_bucket: 0,
            bucket_start_s: 0.0,
            step_s: header.step_ns as f64 / 1e9,
            time,
            label: place("fault_label"),
            conditions: place("rotor_condition_1"),
            residual_place,
        }
    }

    /// Processes the next rows.
    pub(crate) fn push(&mut self, chunk: &Chunk) {
        self.wide.push(chunk);
        self.residuals.push(chunk);
        self.residual_means.push(chunk);
        for row in 0..chunk.len {
            let time = chunk.columns[self.time][row];
            if self.in_bucket == 0 {
                self.bucket_start_s = time;
            }
            for verdicts in &mut self.verdicts {
                let code = chunk.columns[verdicts.place][row] as i32;
                let bit = |mark: i32| 1 << (mark.clamp(NOT_READY, 29) - NOT_READY);
                verdicts.open |= match FaultVerdict::of_code(code) {
                    Some(FaultVerdict::Ambiguous) => bit(UNKNOWN),
                    Some(FaultVerdict::FaultyPair { first, second }) => {
                        bit(i32::from(first) + 1) | bit(i32::from(second) + 1)
                    }
                    _ => bit(code),
                };
            }
            self.in_bucket += 1;
            self.end_s = time + self.step_s;
            if self.in_bucket == self.verdict_rows {
                self.close_verdicts();
            }
            self.collect(chunk, row, time);
        }
    }

    fn close_verdicts(&mut self) {
        for verdicts in &mut self.verdicts {
            verdicts.close(self.bucket_start_s, self.end_s);
        }
        self.in_bucket = 0;
    }

    /// Flushes incomplete buckets.
    pub(crate) fn finish(&mut self) {
        let last_s = self.end_s - self.step_s;
        self.wide.finish(last_s);
        self.residuals.finish(last_s);
        self.residual_means.finish(last_s);
        if self.in_bucket > 0 {
            self.close_verdicts();
        }
    }

    fn collect(&mut self, chunk: &Chunk, row: usize, time: f64) {
        let label = chunk.columns[self.label][row];
        let conditions = || (0..self.rotor_count).map(|rotor| chunk.columns[self.conditions + rotor][row]);
        let next = match &self.stage {
            Stage::Healthy { .. } if label as i32 != HEALTHY => {
                self.second_residual = label as i32 == 1;
                Some(Stage::Faulty {
                    from_s: time + SETTLE_S,
                    label,
                    conditions: conditions().collect(),
                })
            }
            Stage::Faulty {
                label: before,
                conditions: old,
                ..
            } if *before != label || !conditions().eq(old.iter().copied()) => Some(Stage::Over),
            _ => None,
        };
        if let Some(next) = next {
            self.stage = next;
        }
        let sample = match &self.stage {
            Stage::Healthy { from_s } if time >= *from_s => &mut self.healthy,
            Stage::Faulty { from_s, .. } if time >= *from_s => &mut self.faulty,
            _ => return,
        };
        // Every real vehicle has at least four rotors; a synthetic one with a single rotor repeats its first.
        let value =
            |at: usize| chunk.columns[self.residual_place + if at < 3 * self.rotor_count { at } else { at - 3 }][row];
        sample.push([0, 1, 2, 3, 4, 5].map(value));
    }
}

/// One line of a normal plot: quantiles of the samples against those of the standard normal distribution.
#[derive(Debug)]
pub(crate) struct NormalLine {
    /// Value at each of [`NormalPlot::z`]; NaN where there are too few samples for that tail.
    pub(crate) quantiles: Vec<f32>,
    /// Value at z = 0 and rise per unit of z of the line through the quartiles.
    pub(crate) reference: [f64; 2],
}

/// The grid of standard normal quantiles −3.5 … 3.5.
pub(crate) fn normal_grid() -> Vec<f64> {
    (-70..=70).map(|i| f64::from(i) * 0.05).collect()
}

/// The line of sorted samples; absent if there are fewer than eight.
pub(crate) fn normal_line(sorted: &[f64], grid: &[f64]) -> Option<NormalLine> {
    let count = sorted.len();
    if count < 8 {
        return None;
    }
    // Plotting position (i − 1/2)/N, linear in between.
    let quantile = |p: f64| {
        let at = p * count as f64 - 0.5;
        let below = at.floor();
        if below < 0.0 || below as usize + 1 >= count {
            return f64::NAN;
        }
        let i = below as usize;
        sorted[i] + (at - below) * (sorted[i + 1] - sorted[i])
    };
    const QUARTILE_Z: f64 = 0.674_489_750_196_081_7;
    let (low, high) = (quantile(0.25), quantile(0.75));
    Some(NormalLine {
        quantiles: grid.iter().map(|z| quantile(normal_cdf(*z)) as f32).collect(),
        reference: [(low + high) / 2.0, (high - low) / (2.0 * QUARTILE_Z)],
    })
}

/// Φ(z), by the series of erf; absolute error below 1e-12 for |z| < 5, which the grid keeps to.
pub(crate) fn normal_cdf(z: f64) -> f64 {
    // Φ(z) = 1/2 + φ(z)·(z + z³/3 + z⁵/(3·5) + …)
    let density = (-z * z / 2.0).exp() / std::f64::consts::TAU.sqrt();
    let (mut term, mut sum) = (z, z);
    let mut k = 1.0;
    while term.abs() > 1e-17 * sum.abs() && k < 200.0 {
        term *= z * z / (2.0 * k + 1.0);
        sum += term;
        k += 1.0;
    }
    0.5 + density * sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::telemetry::telemetry_columns;

    /// A chunk of `rows` rows in which every column is `value(row)`.
    fn chunk(rows: usize, value: impl Fn(usize) -> f64) -> Chunk {
        let columns = telemetry_columns(6);
        let step_s = 0.0025;
        let mut data = vec![(0..rows).map(&value).collect::<Vec<f64>>(); columns.len()];
        data[column(&columns, "time_s")] = (0..rows).map(|row| row as f64 * step_s).collect();
        for name in ["fault_label", "verdict_t_test", "verdict_sequential", "verdict_network"] {
            data[column(&columns, name)] = vec![0.0; rows];
        }
        Chunk {
            first_row: 0,
            len: rows,
            columns: data,
        }
    }

    fn header() -> SpoolHeader {
        SpoolHeader {
            rotor_count: 6,
            step_ns: 2_500_000,
            ..SpoolHeader::default()
        }
    }

    #[test]
    fn prop_no_spike_is_lost_and_points_are_bounded() {
        for rows in [1, 7, 3_900, 3_901, 36_000, 100_003] {
            let spike = rows * 2 / 3;
            let data = chunk(rows, |row| if row == spike { 9.0 } else { (row % 7) as f64 * 0.1 });
            let mut plots = Plots::new(&header(), &telemetry_columns(6), rows as u64);
            plots.push(&data);
            plots.finish();
            assert!(plots.wide.times.len() <= 4000, "{} points", plots.wide.times.len());
            for values in &plots.wide.values {
                assert_eq!(values.len(), plots.wide.times.len());
            }
            let north = &plots.wide.values[0];
            let at = north
                .iter()
                .position(|value| *value == 9.0)
                .expect("the spike is drawn");
            let bucket_s = (rows as f64 / 1950.0).ceil().max(1.0) * 0.0025;
            assert!((f64::from(plots.wide.times[at]) - spike as f64 * 0.0025).abs() <= bucket_s);
            assert!(
                plots.wide.times.windows(2).all(|pair| pair[0] < pair[1]),
                "time does not increase"
            );
        }
    }

    #[test]
    fn val_extremes_stand_in_their_order() {
        // Increasing: in each bucket the low value comes first. Decreasing: the high one.
        for (sign, first_is_lower) in [(1.0, true), (-1.0, false)] {
            let data = chunk(40_000, |row| sign * row as f64);
            let mut plots = Plots::new(&header(), &telemetry_columns(6), 40_000);
            plots.push(&data);
            plots.finish();
            let north = &plots.wide.values[0];
            assert!(north.chunks(2).all(|pair| (pair[0] < pair[1]) == first_is_lower));
        }
    }

    #[test]
    fn val_single_deviating_verdict_is_seen() {
        let rows = 1_000_000;
        let mut data = chunk(rows, |_| 0.0);
        data.columns[column(&telemetry_columns(6), "verdict_t_test")][777_777] = -1.0;
        let mut plots = Plots::new(&header(), &telemetry_columns(6), rows as u64);
        plots.push(&data);
        plots.finish();
        let seen = &plots.verdicts[0].seen;
        assert_eq!(seen.len(), 3);
        assert_eq!(seen[1].codes, 0b110);
        assert!(seen[1].start_s <= 777_777.0 * 0.0025 && 777_777.0 * 0.0025 < seen[1].end_s);
        assert_eq!(plots.verdicts[1].seen.len(), 1);
    }

    #[test]
    fn val_normal_cdf_against_tables() {
        // NIST handbook, table of the standard normal distribution.
        for (z, expected) in [
            (0.0, 0.5),
            (1.0, 0.841_344_746_068_543),
            (-1.96, 0.024_997_895_148_220),
            (3.5, 0.999_767_370_920_964),
        ] {
            const TOLERANCE: f64 = 1e-12;
            assert!((normal_cdf(z) - expected).abs() < TOLERANCE, "{z}");
        }
    }

    #[test]
    fn val_normal_line_of_normal_samples_is_straight() {
        let grid = normal_grid();
        // Samples that are exactly the quantiles of N(2, 0.5²), by bisection.
        let samples: Vec<f64> = (0..4001)
            .map(|i| {
                let p = (f64::from(i) + 0.5) / 4001.0;
                let (mut low, mut high) = (-5.0, 5.0);
                for _ in 0..60 {
                    let middle = (low + high) / 2.0;
                    if normal_cdf(middle) < p {
                        low = middle
                    } else {
                        high = middle
                    }
                }
                2.0 + 0.5 * low
            })
            .collect();
        let line = normal_line(&samples, &grid).unwrap();
        // Linear interpolation between 4001 quantiles.
        const TOLERANCE: f64 = 1e-3;
        assert!((line.reference[0] - 2.0).abs() < TOLERANCE && (line.reference[1] - 0.5).abs() < TOLERANCE);
        for (z, value) in grid.iter().zip(&line.quantiles).filter(|(z, _)| z.abs() < 3.0) {
            assert!(
                (f64::from(*value) - (2.0 + 0.5 * z)).abs() < 5.0 * TOLERANCE,
                "{z} {value}"
            );
        }
        assert!(normal_line(&samples[..7], &grid).is_none());
    }

    #[test]
    fn val_samples_are_thinned_evenly() {
        let mut sample = Sample::default();
        for i in 0..100_000 {
            sample.push([f64::from(i); 6]);
        }
        let values = sample.sorted(false, 0);
        assert!(values.len() <= SAMPLE_LIMIT && values.len() > SAMPLE_LIMIT / 2);
        let gap = values[1] - values[0];
        assert!(values.windows(2).all(|pair| pair[1] - pair[0] == gap));
    }
}
