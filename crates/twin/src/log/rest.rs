//! Quiet seconds on the ground, and the accelerometer readings in them.

use std::ops::Range;

/// Standard deviation of the specific force's size in a quiet second, at most, m/s².
const FORCE_DEVIATION: f64 = 0.25;
/// The same of a body rate, rad/s.
const RATE_DEVIATION: f64 = 0.03;
/// What an accelerometer that works reads at rest, m/s².
const READINGS: Range<f64> = 7.5..12.5;
/// Fewer quiet seconds say nothing.
const FEWEST: usize = 2;

/// Mean size of the specific force over rows in which it is quiet; `None` if it is not, or if a value is missing: then
/// stillness cannot be established.
pub(crate) fn quiet_mean(accel: [&[f64]; 3], rates: Option<[&[f64]; 3]>, rows: Range<usize>) -> Option<f64> {
    let [x, y, z] = accel;
    let size = |k: usize| (x[k] * x[k] + y[k] * y[k] + z[k] * z[k]).sqrt();
    let (mean, deviation) = mean_deviation(rows.clone().map(size));
    let turns_little = |rate: &[f64]| mean_deviation(rate[rows.clone()].iter().copied()).1 <= RATE_DEVIATION;
    let still = rates.is_none_or(|rates| rates.into_iter().all(turns_little));
    (still && deviation < FORCE_DEVIATION && READINGS.contains(&mean)).then_some(mean)
}

/// The middle one of the means of quiet seconds over gravity; `None` of too few.
pub(crate) fn scale_of(mut means: Vec<f64>, gravity: f64) -> Option<f64> {
    if means.len() < FEWEST {
        return None;
    }
    means.sort_by(f64::total_cmp);
    Some(means[means.len() / 2] / gravity)
}

/// In two passes: the deviation of a small noise on a large mean keeps its digits.
fn mean_deviation(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    let square = values.map(|value| (value - mean) * (value - mean)).sum::<f64>() / count;
    (mean, square.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_second_is_quiet_where_nothing_moves_and_nothing_is_missing() {
        let (still, down) = (vec![0.0; 100], vec![-9.9; 100]);
        let accel = [&still[..], &still[..], &down[..]];
        let mean = quiet_mean(accel, Some([&still; 3]), 0..100).expect("quiet");
        assert!((mean - 9.9).abs() < 1e-9);
        assert_eq!(quiet_mean(accel, None, 0..100), Some(mean));
        let turning: Vec<f64> = (0..100).map(|k| 0.1 * f64::from(k % 2)).collect();
        assert_eq!(quiet_mean(accel, Some([&still, &turning, &still]), 0..100), None);
        let mut gap = still.clone();
        gap[50] = f64::NAN;
        assert_eq!(quiet_mean(accel, Some([&still, &gap, &still]), 0..100), None);
        assert_eq!(quiet_mean([&still, &gap, &down], None, 0..100), None);
        assert_eq!(quiet_mean([&still; 3], None, 0..100), None);
    }

    #[test]
    fn val_one_quiet_second_is_not_enough() {
        assert_eq!(scale_of(vec![10.0], 10.0), None);
        assert_eq!(scale_of(vec![9.0, 10.0, 12.0], 10.0), Some(1.0));
    }
}
