//! A log as steps at a constant rate, block by block, without holding the resampled log in memory.

use super::resample::{Between, at_times, usual_rate_hz};
use super::{FlightLog, GAP_FACTOR};

/// Steps of a block.
const BLOCK: usize = 10_000;
/// Times that differ by rounding are the same row.
const SAME_S: f64 = 1e-9;

impl FlightLog {
    /// Steps that [`FlightLog::for_each_block`] gives.
    pub fn steps(&self, rate_hz: f64) -> usize {
        // One more than whole intervals; rounding must not lose the last. Saturates.
        ((self.duration_s() * rate_hz + 1e-6).floor() as usize).saturating_add(1)
    }

    /// Passes on columns at a constant rate from the log's first time on, block by block: number of the first step, and
    /// the values of each column, NaN where there is none. The values are those of [`FlightLog::resampled`]; a log that
    /// already has this rate keeps its bits.
    ///
    /// * `columns`: those that the log lacks are NaN throughout   * `rate_hz`: 0 exclusive to 100 kHz
    ///
    /// # Errors
    /// Those of `take`, immediately.
    pub fn for_each_block<E>(
        &self,
        columns: &[&str],
        rate_hz: f64,
        mut take: impl FnMut(usize, &[Vec<f64>]) -> Result<(), E>,
    ) -> Result<(), E> {
        let start_s = self.time_s.first().copied().unwrap_or(0.0);
        let gap_s = GAP_FACTOR / usual_rate_hz(&self.time_s);
        let steps = self.steps(rate_hz);
        for first in (0..steps).step_by(BLOCK) {
            let times: Vec<f64> = (first..steps.min(first + BLOCK))
                .map(|step| start_s + step as f64 / rate_hz)
                .collect();
            let begin = self
                .time_s
                .partition_point(|time| *time <= times[0] + SAME_S)
                .saturating_sub(1);
            let last = times[times.len() - 1];
            let end = (self.time_s.partition_point(|time| *time <= last + SAME_S) + 1).min(self.time_s.len());
            let block: Vec<Vec<f64>> = columns
                .iter()
                .map(|name| match self.column(name) {
                    Some(values) => at_times(
                        &self.time_s[begin..end],
                        &values[begin..end],
                        &times,
                        Between::of(name),
                        gap_s,
                    ),
                    None => vec![f64::NAN; times.len()],
                })
                .collect();
            take(first, &block)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_blocks_are_the_resampled_log() {
        // 130 s at 123 Hz with a gap and an empty cell: more than five blocks at 400 Hz.
        let mut time_s: Vec<f64> = (0..16_000).map(|row| 5.0 + f64::from(row) / 123.0).collect();
        for time in &mut time_s[9000..] {
            *time += 0.5;
        }
        let mut roll: Vec<f64> = time_s.iter().map(|time| (3.0 * time).sin() * 0.1).collect();
        roll[777] = f64::NAN;
        let duty: Vec<f64> = time_s.iter().map(|time| 0.5 + 0.1 * time.cos()).collect();
        let columns = [("roll_rad".to_owned(), roll), ("duty_1".to_owned(), duty)];
        let log = FlightLog::from_columns("log", time_s, columns).expect("a good log");
        let whole = log.resampled(400.0).expect("it is short");
        let names = ["roll_rad", "duty_1", "pitch_rad"];
        let mut blocks: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
        let given: Result<(), String> = log.for_each_block(&names, 400.0, |first, block| {
            assert_eq!(first, blocks[0].len());
            for (all, part) in blocks.iter_mut().zip(block) {
                all.extend(part);
            }
            Ok(())
        });
        assert_eq!(given, Ok(()));
        assert_eq!(blocks[0].len(), log.steps(400.0));
        let bits = |values: &[f64]| -> Vec<u64> { values.iter().map(|value| value.to_bits()).collect() };
        for (name, block) in names.iter().zip(&blocks).take(2) {
            assert_eq!(bits(block), bits(whole.column(name).expect("it is there")), "{name}");
        }
        assert!(blocks[0].iter().filter(|value| value.is_nan()).count() > 100);
        assert!(blocks[2].iter().all(|value| value.is_nan()));
    }
}
