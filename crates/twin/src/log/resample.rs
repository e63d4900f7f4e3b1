//! Parts of a log and other sample rates.
//!
//! A duty is held until the next row, so it is resampled by holding; everything else is interpolated linearly, angles
//! the short way round. A sample between two rows separated by a gap, or next to an empty cell, has no value. There is
//! no anti-alias filter: a lower rate aliases what is above half of it.

use super::{FlightLog, GAP_FACTOR, MAX_CELLS, names};
use std::f64::consts::{PI, TAU};

/// Median of finite values; `None` of nothing. Reorders the values.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Rows per second where none is missing, Hz; 0 of fewer than two times.
///
/// That of the median interval, unless the mean of the intervals about the median is another: a clock of whole
/// milliseconds stamps 400 Hz 2 and 3 ms apart in turn, and no interval is the true one. Intervals far from the median
/// do not count in the mean, as long ones are lost rows or gaps and those as much shorter would offset nothing; a
/// pattern such as 1 and 2 ms cannot be told from rows that were lost, and gives the rate of the majority.
pub(crate) fn usual_rate_hz(time_s: &[f64]) -> f64 {
    /// Distance from the median, as a share of it, up to which an interval counts: a lost row is 1 away.
    const ABOUT: f64 = 0.75;
    /// Difference between mean and median, as a share, below which they are the same: jitter and rounding of regular
    /// stamps, whose median is the exact one.
    const SAME: f64 = 0.01;
    let mut intervals: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let Some(median_s) = median(&mut intervals) else {
        return 0.0;
    };
    let about = intervals
        .iter()
        .filter(|interval| (*interval - median_s).abs() < ABOUT * median_s);
    let (count, sum_s) = about.fold((0.0, 0.0), |(count, sum_s), interval| (count + 1.0, sum_s + interval));
    let mean_s = sum_s / count;
    if (mean_s - median_s).abs() > SAME * median_s {
        1.0 / mean_s
    } else {
        1.0 / median_s
    }
}

/// How a column is continued between its rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Between {
    /// The value holds until the next row.
    Hold,
    /// Straight line.
    Linear,
    /// Straight line on the circle, in radians.
    Angle,
}

impl Between {
    /// For a column by its name.
    pub(crate) fn of(name: &str) -> Self {
        let commanded =
            names::duty_rotor(name).is_some() || name == names::THRUST_COMMAND || names::TORQUE_COMMAND.contains(&name);
        if commanded || !names::is_canonical(name) {
            Self::Hold
        } else if name == names::ATTITUDE[0] || name == names::ATTITUDE[2] || name == names::REFERENCE[3] {
            Self::Angle
        } else {
            Self::Linear
        }
    }
}

/// An angle in (−π, π].
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    let turn = angle_rad.rem_euclid(TAU);
    if turn > PI { turn - TAU } else { turn }
}

/// Values at other times; both time bases increase. No value outside the old time base, over gaps, or next to empty
/// cells.
pub(crate) fn at_times(old_s: &[f64], values: &[f64], new_s: &[f64], between: Between, gap_s: f64) -> Vec<f64> {
    // Times that differ by rounding are the same row.
    const SAME_S: f64 = 1e-9;
    let mut row = 0;
    new_s
        .iter()
        .map(|&time| {
            while row + 1 < old_s.len() && old_s[row + 1] <= time + SAME_S {
                row += 1;
            }
            let since = time - old_s[row];
            if since < -SAME_S {
                return f64::NAN;
            }
            if since <= SAME_S {
                return values[row];
            }
            let Some(&next_s) = old_s.get(row + 1) else {
                return if between == Between::Hold && since <= gap_s {
                    values[row]
                } else {
                    f64::NAN
                };
            };
            if next_s - old_s[row] > gap_s {
                return f64::NAN;
            }
            let share = since / (next_s - old_s[row]);
            match between {
                Between::Hold => values[row],
                Between::Linear => values[row] + share * (values[row + 1] - values[row]),
                Between::Angle => wrapped(values[row] + share * wrapped(values[row + 1] - values[row])),
            }
        })
        .collect()
}

impl FlightLog {
    /// The rows with `start_s` ≤ time ≤ `end_s`; segments are cut to it. Times stay.
    ///
    /// Fewer than two rows remain if the interval is outside of the log: check [`FlightLog::time_s`].
    #[must_use]
    pub fn slice(&self, start_s: f64, end_s: f64) -> Self {
        let first = self.time_s.partition_point(|time| *time < start_s);
        let last = self.time_s.partition_point(|time| *time <= end_s).max(first);
        let mut part = self.clone();
        part.time_s = self.time_s[first..last].to_vec();
        for values in part.columns.values_mut() {
            *values = values[first..last].to_vec();
        }
        part.segments
            .retain(|segment| segment.end_s > start_s && segment.start_s < end_s);
        for segment in &mut part.segments {
            segment.start_s = segment.start_s.max(start_s);
            segment.end_s = segment.end_s.min(end_s);
        }
        part.report.rows = part.time_s.len();
        part.report.sample_rate_hz = usual_rate_hz(&part.time_s);
        part.report
            .gaps
            .retain(|gap| gap.end_s > start_s && gap.start_s < end_s);
        part
    }

    /// The log at a constant rate from its first time on; a note is added to the report.
    ///
    /// * `rate_hz`: 0 exclusive to 100 kHz
    ///
    /// # Errors
    /// One sentence: it would have more than [`MAX_CELLS`] cells, as a log whose clock jumps by years would.
    pub fn resampled(&self, rate_hz: f64) -> Result<Self, String> {
        self.resampled_over(rate_hz, GAP_FACTOR / usual_rate_hz(&self.time_s))
    }

    /// The same with gaps of up to `gap_s` bridged.
    ///
    /// # Errors
    /// As [`FlightLog::resampled`].
    pub(crate) fn resampled_over(&self, rate_hz: f64, gap_s: f64) -> Result<Self, String> {
        let cells = (self.duration_s() * rate_hz + 1.0) * (self.columns.len() + 1) as f64;
        if cells > MAX_CELLS as f64 {
            return Err(format!(
                "{}: {} s at {rate_hz} Hz are {cells:.2e} cells; at most {MAX_CELLS} are taken: cut a part out of the log, or choose a \
                 lower rate",
                self.name,
                self.duration_s()
            ));
        }
        let start_s = self.time_s.first().copied().unwrap_or(0.0);
        // One row more than whole intervals; rounding must not lose the last.
        let rows = 1 + (self.duration_s() * rate_hz + 1e-6).floor() as usize;
        let new_s: Vec<f64> = (0..rows).map(|row| start_s + row as f64 / rate_hz).collect();
        let old_rate_hz = usual_rate_hz(&self.time_s);
        let mut log = self.clone();
        for (name, values) in &mut log.columns {
            *values = at_times(&self.time_s, values, &new_s, Between::of(name), gap_s);
        }
        log.time_s = new_s;
        log.report.rows = rows;
        log.report.sample_rate_hz = rate_hz;
        log.report.notes.push(format!(
            "resampled from {old_rate_hz:.3} Hz to {rate_hz} Hz: duties and unknown columns held, the rest linear"
        ));
        Ok(log)
    }

    /// Every `factor`-th row, counted anew after a gap: measurements are means over `factor` rows about it, commands over those that they are in
    /// force for; angles are those of the row.
    #[must_use]
    pub(crate) fn thinned(&self, factor: usize) -> Self {
        let gap_s = GAP_FACTOR / usual_rate_hz(&self.time_s);
        // Rows of a run without gaps, and the kept ones in it.
        let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
        let mut first = 0;
        for row in 1..=self.time_s.len() {
            if row == self.time_s.len() || self.time_s[row] - self.time_s[row - 1] > gap_s {
                runs.push(first..row);
                first = row;
            }
        }
        let kept = || {
            runs.iter()
                .flat_map(|run| run.clone().step_by(factor).map(move |row| (row, run.clone())))
        };
        let mean = |values: &[f64], rows: std::ops::Range<usize>| {
            let finite = values[rows].iter().filter(|value| value.is_finite());
            let (sum, count) = finite.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
            sum / count
        };
        let mut log = self.clone();
        for (name, values) in &mut log.columns {
            let whole = &self.columns[name];
            let is_turn = Between::of(name) == Between::Angle
                || names::ATTITUDE.contains(&&name[..])
                || names::QUATERNION.contains(&&name[..]);
            let held = Between::of(name) == Between::Hold;
            let of = |(row, run): (usize, std::ops::Range<usize>)| match (is_turn, held) {
                (true, _) => whole[row],
                (_, true) => mean(whole, row..(row + factor).min(run.end)),
                _ => {
                    let half = factor / 2;
                    mean(
                        whole,
                        row.saturating_sub(half).max(run.start)..(row + half + 1).min(run.end),
                    )
                }
            };
            *values = kept().map(of).collect();
        }
        log.time_s = kept().map(|(row, _)| self.time_s[row]).collect();
        log.report.rows = log.time_s.len();
        log.report.sample_rate_hz = usual_rate_hz(&log.time_s);
        log
    }
}

/// Mean over `half` rows to either side, fewer at the ends; rows without a value do not count.
pub fn running_mean(values: &[f64], half: usize) -> Vec<f64> {
    let mut sums = Vec::with_capacity(values.len() + 1);
    let (mut sum, mut count) = (0.0, 0_usize);
    sums.push((0.0, 0));
    for value in values {
        if value.is_finite() {
            sum += value;
            count += 1;
        }
        sums.push((sum, count));
    }
    (0..values.len())
        .map(|k| {
            let (from, to) = (sums[k.saturating_sub(half)], sums[(k + half + 1).min(values.len())]);
            (to.0 - from.0) / (to.1 - from.1) as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_thinned_log_has_means_about_its_rows_and_none_over_a_gap() {
        let time: Vec<f64> = (0..40)
            .map(|k| 0.001 * f64::from(k) + if k < 22 { 0.0 } else { 1.0 })
            .collect();
        let ramp: Vec<f64> = (0..40).map(f64::from).collect();
        let columns = [
            ("duty_1".to_owned(), ramp.iter().map(|value| value / 100.0).collect()),
            ("roll_rate_rad_s".to_owned(), ramp.clone()),
            ("yaw_rad".to_owned(), ramp.iter().map(|value| wrapped(*value)).collect()),
        ];
        let log = FlightLog::from_columns("ramp", time, columns)
            .expect("a log")
            .thinned(4);
        // Rows 0, 4 … 20, then anew from 22.
        let rows = [0.0, 4.0, 8.0, 12.0, 16.0, 20.0, 22.0, 26.0, 30.0, 34.0, 38.0];
        assert_eq!(log.time_s.len(), rows.len());
        let rate = &log.columns["roll_rate_rad_s"];
        for (k, row) in rows.into_iter().enumerate().filter(|(k, _)| ![0, 5, 6, 10].contains(k)) {
            assert_eq!(rate[k], row);
            assert!((log.columns["duty_1"][k] - (row + 1.5) / 100.0).abs() < 1e-12);
            assert_eq!(log.columns["yaw_rad"][k], wrapped(row));
        }
        // At the ends of a run, from the available samples.
        assert_eq!((rate[0], rate[5], rate[6]), (1.0, 19.5, 23.0));
    }

    /// Times whose intervals repeat, in s.
    fn repeated(intervals_s: &[f64], rows: usize) -> Vec<f64> {
        let mut time_s = 0.0;
        let times = intervals_s.iter().cycle().take(rows).map(|interval| {
            time_s += interval;
            time_s
        });
        times.collect()
    }

    #[test]
    fn val_the_rate_of_regular_rows_is_that_of_their_interval() {
        let times = repeated(&[0.004], 2000);
        let mut intervals: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        // To the last bit: answers known for such logs stay.
        assert_eq!(usual_rate_hz(&times), 1.0 / median(&mut intervals).expect("intervals"));
        assert_eq!(usual_rate_hz(&[1.0]), 0.0);
    }

    #[test]
    fn val_the_rate_of_intervals_of_2_and_3_ms_is_400_hz() {
        for rows in [1000, 1001] {
            for pattern in [&[0.002, 0.003][..], &[0.003, 0.002], &[0.002, 0.003, 0.003, 0.002]] {
                let rate_hz = usual_rate_hz(&repeated(pattern, rows));
                assert!((rate_hz - 400.0).abs() < 0.5, "{rows} rows, {pattern:?}: {rate_hz} Hz");
            }
        }
        // With a microsecond more or less, as a clock of microseconds has them.
        let rate_hz = usual_rate_hz(&repeated(&[0.002_002, 0.002_998, 0.001_999, 0.003_001], 1000));
        assert!((rate_hz - 400.0).abs() < 0.5, "{rate_hz} Hz");
    }

    #[test]
    fn val_neither_jitter_nor_rounding_nor_lost_rows_change_the_rate() {
        let mut random = rotortwin_plant::random::NormalStream::new(7, "stamps");
        let jittered: Vec<f64> = (0..4000)
            .map(|k| 0.0025 * f64::from(k) + 0.0002 * random.sample())
            .collect();
        let rounded = |times: &[f64], unit_s: f64| -> Vec<f64> {
            times.iter().map(|time| (time / unit_s).round() * unit_s).collect()
        };
        let regular = repeated(&[1.0 / 400.0], 4000);
        let odd = repeated(&[1.0 / 1600.0], 4000);
        let lossy: Vec<f64> = (0..4000)
            .filter(|k| k % 7 != 3)
            .map(|k| 0.0025 * f64::from(k))
            .collect();
        let gaps: Vec<f64> = repeated(&[0.002, 0.003], 4000)
            .iter()
            .enumerate()
            .map(|(k, time)| time + 0.7 * (k / 300) as f64)
            .collect();
        for (what, times, rate_hz) in [
            ("jitter", jittered, 400.0),
            ("rounded to 1 µs", rounded(&regular, 1e-6), 400.0),
            ("rounded to 1 ms", rounded(&regular, 1e-3), 400.0),
            ("1600 Hz rounded to 1 µs", rounded(&odd, 1e-6), 1600.0),
            ("every seventh row lost", lossy, 400.0),
            ("2 and 3 ms with gaps", gaps, 400.0),
        ] {
            let found = usual_rate_hz(&times);
            assert!(
                (found / rate_hz - 1.0).abs() < 0.01,
                "{what}: {found} Hz, expected {rate_hz}"
            );
        }
    }

    #[test]
    fn val_angles_are_interpolated_the_short_way() {
        let values = at_times(&[0.0, 1.0], &[3.0, -3.0], &[0.5], Between::Angle, 2.0);
        assert!((wrapped(values[0] - PI)).abs() < 1e-12, "{values:?}");
    }

    #[test]
    fn val_gaps_and_ends_have_no_value() {
        let old_s = [0.0, 1.0, 5.0];
        let values = at_times(
            &old_s,
            &[1.0, 2.0, 3.0],
            &[-1.0, 0.5, 1.0, 2.0, 5.0, 6.0],
            Between::Linear,
            2.0,
        );
        assert!(values[0].is_nan() && values[3].is_nan() && values[5].is_nan());
        assert_eq!((values[1], values[2], values[4]), (1.5, 2.0, 3.0));
    }
}
