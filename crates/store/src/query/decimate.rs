//! Decimation that preserves the appearance of a plot.
//!
//! The rows of the interval are split into buckets of (almost) equal length, with two output rows each:
//!
//! | column | first row of a bucket | second row |
//! |---|---|---|
//! | the time | of the bucket's first row | of its last row |
//! | numbers and codes | smallest and largest value, in the order of occurrence | |
//! | bit masks | bits set in all rows | bits set in any row |
//!
//! So every output value was measured (except masks), extremes are never lost, and times are accurate to the length of a bucket. All
//! channels share the time. NaN (no value) is skipped; a bucket of NaN gives NaN. If there are no more rows than points, every row is
//! returned unchanged.

/// Columns that contain bit masks.
pub(crate) const MASKS: [&str; 4] = ["faulty_rotors", "saturated_rotors", "sensor_faults", "suspect_rotors"];

/// Values kept of a bucket.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// First and last value: the time.
    Ends,
    /// Smallest and largest value in order of occurrence.
    Extremes,
    /// Bits set in all rows, bits set in any row.
    Bits,
}

impl Keep {
    /// The method appropriate for the column of this name.
    pub fn of(name: &str) -> Self {
        if MASKS.contains(&name) {
            Self::Bits
        } else {
            Self::Extremes
        }
    }
}

/// Processes a column in order and keeps what a plot needs.
#[derive(Debug)]
pub struct Decimator {
    rows: u64,
    buckets: u64,
    keep: Keep,
    at: u64,
    bucket: u64,
    bucket_end: u64,
    state: State,
    out: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct State {
    least: f64,
    largest: f64,
    /// The largest came before the smallest.
    falls: bool,
    first: f64,
    last: f64,
    all: u64,
    any: u64,
}

impl State {
    const EMPTY: Self = Self {
        least: f64::NAN,
        largest: f64::NAN,
        falls: false,
        first: f64::NAN,
        last: f64::NAN,
        all: u64::MAX,
        any: 0,
    };

    fn extremes(&mut self, values: &[f64]) {
        for &value in values {
            // Also true before the first value; NaN is neither less nor greater.
            if value < self.least || (self.least.is_nan() && !value.is_nan()) {
                self.least = value;
                self.falls = true;
            }
            if value > self.largest || (self.largest.is_nan() && !value.is_nan()) {
                self.largest = value;
                self.falls = false;
            }
        }
    }

    fn bits(&mut self, values: &[f64]) {
        for &value in values {
            self.all &= value as u64;
            self.any |= value as u64;
        }
    }
}

impl Decimator {
    /// For a column of `rows` values of which at most `points` (at least 2) are kept.
    pub fn new(rows: u64, points: usize, keep: Keep) -> Self {
        let points = points.max(2) as u64;
        let buckets = if rows <= points { rows } else { points / 2 };
        let capacity = usize::try_from(rows.min(points)).unwrap_or(0);
        let mut decimator = Self {
            rows,
            buckets,
            keep,
            at: 0,
            bucket: 0,
            bucket_end: 0,
            state: State::EMPTY,
            out: Vec::with_capacity(capacity),
        };
        decimator.bucket_end = decimator.end_of(0);
        decimator
    }

    fn end_of(&self, bucket: u64) -> u64 {
        let end = (u128::from(bucket) + 1) * u128::from(self.rows) / u128::from(self.buckets.max(1));
        u64::try_from(end).unwrap_or(u64::MAX)
    }

    /// Processes the next values; more than announced are ignored.
    pub fn push(&mut self, mut values: &[f64]) {
        let left = usize::try_from(self.rows - self.at).unwrap_or(usize::MAX);
        values = &values[..values.len().min(left)];
        if self.buckets == self.rows {
            self.at += values.len() as u64;
            self.out.extend_from_slice(values);
            return;
        }
        while !values.is_empty() {
            let take = usize::try_from(self.bucket_end - self.at).unwrap_or(usize::MAX);
            let (now, rest) = values.split_at(take.min(values.len()));
            match self.keep {
                Keep::Ends => {
                    if self.state.first.is_nan() {
                        self.state.first = now[0];
                    }
                    self.state.last = now[now.len() - 1];
                }
                Keep::Extremes => self.state.extremes(now),
                Keep::Bits => self.state.bits(now),
            }
            self.at += now.len() as u64;
            if self.at == self.bucket_end {
                self.close();
            }
            values = rest;
        }
    }

    fn close(&mut self) {
        let state = std::mem::replace(&mut self.state, State::EMPTY);
        self.out.extend_from_slice(&match self.keep {
            Keep::Ends => [state.first, state.last],
            Keep::Extremes if state.falls => [state.largest, state.least],
            Keep::Extremes => [state.least, state.largest],
            Keep::Bits => [state.all as f64, state.any as f64],
        });
        self.bucket += 1;
        self.bucket_end = self.end_of(self.bucket);
    }

    /// The values kept.
    pub fn finish(self) -> Vec<f64> {
        self.out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn decimated(values: &[f64], points: usize, keep: Keep, batch: usize) -> Vec<f64> {
        let mut decimator = Decimator::new(values.len() as u64, points, keep);
        values.chunks(batch.max(1)).for_each(|batch| decimator.push(batch));
        decimator.finish()
    }

    /// Rows of bucket `bucket`, formulated differently from the decimator.
    fn bucket(values: &[f64], buckets: usize, bucket: usize) -> &[f64] {
        &values[bucket * values.len() / buckets..(bucket + 1) * values.len() / buckets]
    }

    fn number() -> impl Strategy<Value = f64> {
        prop_oneof![8 => -1e9..1e9f64, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY)]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn prop_extremes_of_every_bucket_are_kept_in_their_order(
            values in prop::collection::vec(number(), 1..400), points in 2..60usize, batch in 1..70usize,
        ) {
            let kept = decimated(&values, points, Keep::Extremes, batch);
            prop_assert!(kept.len() <= points.max(2));
            if values.len() <= points {
                prop_assert!(kept.iter().zip(&values).all(|(a, b)| a.to_bits() == b.to_bits()));
                prop_assert_eq!(kept.len(), values.len());
                return Ok(());
            }
            let buckets = kept.len() / 2;
            for at in 0..buckets {
                let rows = bucket(&values, buckets, at);
                let (a, b) = (kept[2 * at], kept[2 * at + 1]);
                let there: Vec<f64> = rows.iter().copied().filter(|value| !value.is_nan()).collect();
                if there.is_empty() {
                    prop_assert!(a.is_nan() && b.is_nan());
                    continue;
                }
                let least = there.iter().copied().fold(f64::INFINITY, f64::min);
                let largest = there.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                prop_assert_eq!((a.min(b), a.max(b)), (least, largest));
                let place = |wanted: f64| rows.iter().position(|value| *value == wanted);
                prop_assert!(place(a) <= place(b), "{} and {} are not in their order", a, b);
            }
        }

        #[test]
        fn prop_time_rises_and_covers_the_interval(rows in 1..5000usize, points in 2..200usize, batch in 1..999usize) {
            let times: Vec<f64> = (0..rows).map(|row| row as f64 * 0.0025).collect();
            let kept = decimated(&times, points, Keep::Ends, batch);
            prop_assert!(kept.windows(2).all(|pair| pair[0] < pair[1]));
            prop_assert_eq!((kept[0], kept[kept.len() - 1]), (times[0], times[rows - 1]));
        }

        #[test]
        fn prop_no_bit_is_lost_and_none_is_made_up(
            masks in prop::collection::vec(0..64u64, 50..400), points in 2..40usize,
        ) {
            let values: Vec<f64> = masks.iter().map(|mask| *mask as f64).collect();
            let kept = decimated(&values, points, Keep::Bits, 33);
            let buckets = kept.len() / 2;
            for at in 0..buckets {
                let rows = bucket(&values, buckets, at);
                let any = rows.iter().fold(0, |bits, value| bits | *value as u64);
                let all = rows.iter().fold(u64::MAX, |bits, value| bits & *value as u64);
                prop_assert_eq!((kept[2 * at] as u64, kept[2 * at + 1] as u64), (all, any));
            }
        }
    }

    #[test]
    fn val_masks_are_the_columns_that_say_so() {
        for column in crate::telemetry_columns(6) {
            let says = column.description.to_lowercase().contains("bit i set");
            assert_eq!(MASKS.contains(&column.name.as_str()), says, "{}", column.name);
        }
    }

    #[test]
    fn val_nothing_gives_nothing() {
        assert_eq!(decimated(&[], 10, Keep::Extremes, 1), Vec::<f64>::new());
    }
}
