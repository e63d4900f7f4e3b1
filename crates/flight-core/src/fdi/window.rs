//! Running statistics of the 4-axis wrench residual: over one decision window, and over the calibration time.
//!
//! Between the residual generators and the T-test and network. Both need means (and the T-test variances) of 3 n_a scalar
//! residuals, but those are fixed linear combinations of four numbers: so the mean vector and covariance matrix of the four are
//! kept (14 numbers), and a projection `v` has mean vᵀμ and variance vᵀΣv, exactly.
//!
//! Method: Welford's recursion, one update per sample, no buffer. Windows do not overlap.

/// Recursive mean and covariance of a sequence of 4-vectors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WrenchStatistics {
    pub(super) count: u32,
    pub(super) mean: [f32; 4],
    /// Σ (x − mean)(x − mean)ᵀ, lower triangle row by row.
    pub(super) co_moment: [f32; 10],
}

impl WrenchStatistics {
    pub(super) const EMPTY: Self = Self {
        count: 0,
        mean: [0.0; 4],
        co_moment: [0.0; 10],
    };

    /// Adds one sample.
    #[inline(always)]
    pub fn push(&mut self, sample: &[f32; 4]) {
        self.count = self.count.saturating_add(1);
        let weight = 1.0 / self.count as f32;
        let mut before = [0.0; 4];
        let mut after = [0.0; 4];
        for axis in 0..4 {
            before[axis] = sample[axis] - self.mean[axis];
            self.mean[axis] += weight * before[axis];
            after[axis] = sample[axis] - self.mean[axis];
        }
        // Unrolled: no index checks are left.
        let ([b0, b1, b2, b3], [a0, a1, a2, a3]) = (before, after);
        let products = [
            b0 * a0,
            b1 * a0,
            b1 * a1,
            b2 * a0,
            b2 * a1,
            b2 * a2,
            b3 * a0,
            b3 * a1,
            b3 * a2,
            b3 * a3,
        ];
        for (entry, product) in self.co_moment.iter_mut().zip(products) {
            *entry += product;
        }
    }

    /// Resets.
    #[inline]
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Number of samples.
    #[inline]
    pub const fn count(&self) -> u32 {
        self.count
    }

    /// Mean of the four axes; 0 without samples.
    #[inline]
    pub const fn mean(&self) -> [f32; 4] {
        self.mean
    }

    /// Mean of the projection vᵀx.
    #[inline]
    pub fn projected_mean(&self, v: &[f32; 4]) -> f32 {
        dot(v, &self.mean)
    }

    /// Unbiased sample variance of the projection vᵀx, never negative; 0 for fewer than two samples.
    #[inline]
    pub fn projected_variance(&self, v: &[f32; 4]) -> f32 {
        if self.count < 2 {
            return 0.0;
        }
        let c = &self.co_moment;
        let diagonal = v[0] * v[0] * c[0] + v[1] * v[1] * c[2] + v[2] * v[2] * c[5] + v[3] * v[3] * c[9];
        let rest =
            v[1] * v[0] * c[1] + v[2] * (v[0] * c[3] + v[1] * c[4]) + v[3] * (v[0] * c[6] + v[1] * c[7] + v[2] * c[8]);
        let sum = diagonal + 2.0 * rest;
        if sum > 0.0 { sum / (self.count - 1) as f32 } else { 0.0 }
    }
}

/// Mean of the wrench residual over the calibration period, in which the vehicle is assumed healthy (µ₀ of §5.3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Baseline {
    pub(super) first: u32,
    pub(super) end: u32,
    pub(super) seen: u32,
    pub(super) count: u32,
    pub(super) mean: [f32; 4],
}

impl Baseline {
    /// Over the samples with first ≤ index < end, counted from 0.
    pub const fn new(first: u32, end: u32) -> Self {
        Self {
            first,
            end,
            seen: 0,
            count: 0,
            mean: [0.0; 4],
        }
    }

    /// Adds the next sample.
    #[inline]
    pub fn push(&mut self, sample: &[f32; 4]) {
        if self.seen >= self.end {
            return;
        }
        if self.seen >= self.first {
            self.count += 1;
            let weight = 1.0 / self.count as f32;
            for axis in 0..4 {
                self.mean[axis] += weight * (sample[axis] - self.mean[axis]);
            }
        }
        self.seen += 1;
    }

    /// The mean, once complete.
    #[inline]
    pub fn mean(&self) -> Option<[f32; 4]> {
        (self.seen >= self.end).then_some(self.mean)
    }
}

#[inline]
pub(crate) fn dot(a: &[f32; 4], b: &[f32; 4]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn prop_projection_equals_statistics_of_projected_samples(
            samples in proptest::collection::vec(proptest::array::uniform4(-1.0f32..1.0), 2..60),
            v in proptest::array::uniform4(-1.0f32..1.0),
        ) {
            let mut statistics = WrenchStatistics::default();
            for sample in &samples {
                statistics.push(sample);
            }
            let projected: Vec<f64> = samples
                .iter()
                .map(|s| (0..4).map(|a| f64::from(v[a]) * f64::from(s[a])).sum())
                .collect();
            let n = projected.len() as f64;
            let mean = projected.iter().sum::<f64>() / n;
            let variance = projected.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (n - 1.0);
            // Sums of up to 60 f32 terms of size 1, four axes: about 240 roundings of 6e-8.
            prop_assert!((f64::from(statistics.projected_mean(&v)) - mean).abs() < 1.5e-5);
            prop_assert!((f64::from(statistics.projected_variance(&v)) - variance).abs() < 3e-5);
            prop_assert!(statistics.projected_variance(&v) >= 0.0);
        }
    }

    #[test]
    fn val_baseline_uses_its_samples_only() {
        let mut baseline = Baseline::new(2, 4);
        for value in [100.0, 100.0, 1.0, 3.0, 100.0] {
            let done = baseline.seen >= 4;
            assert_eq!(baseline.mean().is_some(), done);
            baseline.push(&[value, 0.0, -value, 0.0]);
        }
        assert_eq!(baseline.mean(), Some([2.0, 0.0, -2.0, 0.0]));
    }

    #[test]
    fn val_large_offset_keeps_the_variance() {
        // The point of Welford's method: a variance 1e6 times smaller than the squared mean survives in f32.
        let mut statistics = WrenchStatistics::default();
        for k in 0..100u8 {
            let x = 1000.0 + if k % 2 == 0 { 1.0 } else { -1.0 };
            statistics.push(&[x, 0.0, 0.0, 0.0]);
        }
        let variance = statistics.projected_variance(&[1.0, 0.0, 0.0, 0.0]);
        assert!((variance - 100.0 / 99.0).abs() < 1e-3);
    }
}
