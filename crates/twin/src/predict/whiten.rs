//! Whitening of a residual channel whose noise is white or a first-order moving average.
//!
//! A difference quotient (x_{k+1} − x_k)/h of samples with white noise has the tridiagonal covariance c₀ on the diagonal, c₁ beside
//! it. With its Cholesky factor L (two diagonals) the whitened residual is w = L⁻¹ r: the innovation form of the Kalman filter,
//! w_k = (r_k − l_{k,k−1} w_{k−1})/l_{kk}. A masked sample is left out and the recursion starts anew behind it.

/// Covariance of one channel's noise: white (`lag_one` 0) or a first-order moving average.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Covariance {
    /// c₀, variance of a sample.
    pub variance: f64,
    /// c₁, covariance of neighbours; |c₁| < c₀/2.
    pub lag_one: f64,
}

impl Covariance {
    /// White noise of a standard deviation.
    pub fn white(deviation: f64) -> Self {
        Self {
            variance: deviation * deviation,
            lag_one: 0.0,
        }
    }

    /// Noise of a difference quotient over `step_s`: samples of deviation `sample`, a rate that is the mean of two samples of
    /// deviation `rate`, and white noise `floor` of the step itself.
    pub fn of_difference(sample: f64, rate: f64, floor: f64, step_s: f64) -> Self {
        let difference = (sample / step_s) * (sample / step_s);
        Self {
            variance: 2.0 * difference + 0.5 * rate * rate + floor * floor,
            lag_one: -difference + 0.25 * rate * rate,
        }
    }

    /// Kalman gain of the sampled signal, once it stands still: with c₀ = l² + m² and c₁ = l m, the difference quotient is
    /// r_k = (ε_{k+1} − (1 − K) ε_k)/h of innovations ε, so K = 1 + m/l.
    pub fn gain(self) -> f64 {
        let pivot = 0.5 * (self.variance + (self.variance * self.variance - 4.0 * self.lag_one * self.lag_one).sqrt());
        1.0 + self.lag_one / pivot
    }

    /// Times a factor on the deviation.
    pub fn scaled(self, factor: f64) -> Self {
        let square = factor * factor;
        Self {
            variance: self.variance * square,
            lag_one: self.lag_one * square,
        }
    }
}

/// The two diagonals of L⁻¹'s recursion for one mask, w_k = g_k r_k − p_k w_{k−1}.
///
/// They depend on nothing but the samples since the last masked one, and soon no more on these: kept is the table of (g, p) until they
/// stand still, and for each sample its place there.
#[derive(Debug, Clone)]
pub struct Whitener {
    /// Place in `steps`; 0 where masked.
    place: Vec<u16>,
    /// g = 1/l_kk and p = l_{k,k−1}/l_kk; zeros first.
    steps: Vec<[f64; 2]>,
}

impl Whitener {
    /// For a covariance and a mask (true: sample counts).
    pub fn new(covariance: Covariance, mask: &[bool]) -> Self {
        let mut steps = vec![[0.0; 2]];
        // l of the sample before; 0 starts anew.
        let mut before = 0.0;
        let mut place = 0u16;
        let place = mask.iter().map(|&counts| {
            if !counts {
                place = 0;
                return place;
            }
            let last = steps.len() - 1;
            if usize::from(place) == last && steps.len() <= usize::from(u16::MAX) {
                let off = if before > 0.0 { covariance.lag_one / before } else { 0.0 };
                // Rounding alone could bring the pivot of a nearly singular covariance to 0.
                let pivot = (covariance.variance - off * off)
                    .max(1e-12 * covariance.variance)
                    .sqrt();
                if pivot != before {
                    steps.push([1.0 / pivot, off / pivot]);
                    before = pivot;
                }
            }
            place = usize::from(place).saturating_add(1).min(steps.len() - 1) as u16;
            place
        });
        let place = place.collect();
        Self { place, steps }
    }

    /// L⁻¹ r in place; masked samples become 0.
    pub fn apply(&self, residual: &mut [f64]) {
        let mut before = 0.0;
        for (r, &place) in residual.iter_mut().zip(&self.place) {
            let [gain, previous] = self.steps[usize::from(place)];
            // A masked sample may be NaN: 0 · NaN would spread.
            before = if place == 0 { 0.0 } else { gain * *r - previous * before };
            *r = before;
        }
    }

    /// L⁻¹ (a − b) · `factor` as f32, for columns of a Jacobian.
    pub fn difference(&self, a: &[f64], b: &[f64], factor: f64) -> Vec<f32> {
        if let Some(gain) = self.white() {
            // Without a recursion several samples are taken at once.
            let scaled = a.iter().zip(b).zip(&self.place);
            return scaled
                .map(|((&x, &y), &place)| {
                    if place == 0 {
                        0.0
                    } else {
                        (gain * ((x - y) * factor)) as f32
                    }
                })
                .collect();
        }
        let mut before = 0.0;
        let whitened = a.iter().zip(b).zip(&self.place).map(|((&x, &y), &place)| {
            let [gain, previous] = self.steps[usize::from(place)];
            before = if place == 0 {
                0.0
            } else {
                gain * ((x - y) * factor) - previous * before
            };
            before as f32
        });
        whitened.collect()
    }

    /// g, if the noise is white: then it is the same for all samples.
    fn white(&self) -> Option<f64> {
        match self.steps.as_slice() {
            [_, [gain, previous]] if *previous == 0.0 => Some(*gain),
            _ => None,
        }
    }

    /// Length of the channel.
    pub fn len(&self) -> usize {
        self.place.len()
    }

    /// True for a channel without samples.
    pub fn is_empty(&self) -> bool {
        self.place.is_empty()
    }

    /// True where a sample counts.
    pub fn counts(&self, k: usize) -> bool {
        self.place[k] != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// rᵀ C⁻¹ r by Gaussian elimination of the full matrix.
    fn brute_force(covariance: Covariance, r: &[f64]) -> f64 {
        let n = r.len();
        let mut a = vec![vec![0.0; n + 1]; n];
        for i in 0..n {
            a[i][i] = covariance.variance;
            if i > 0 {
                a[i][i - 1] = covariance.lag_one;
                a[i - 1][i] = covariance.lag_one;
            }
            a[i][n] = r[i];
        }
        for i in 0..n {
            for j in i + 1..n {
                let factor = a[j][i] / a[i][i];
                for k in i..=n {
                    a[j][k] -= factor * a[i][k];
                }
            }
        }
        let mut x = vec![0.0; n];
        for i in (0..n).rev() {
            x[i] = (a[i][n] - (i + 1..n).map(|j| a[i][j] * x[j]).sum::<f64>()) / a[i][i];
        }
        x.iter().zip(r).map(|(x, r)| x * r).sum()
    }

    #[test]
    fn val_whitened_square_sum_equals_the_full_quadratic_form() {
        let covariance = Covariance::of_difference(0.0078, 0.08, 0.02, 0.0025);
        let r: Vec<f64> = (0..40)
            .map(|k| libm::sin(f64::from(k) * 1.7) + 0.1 * f64::from(k % 3))
            .collect();
        let mut mask = vec![true; 40];
        mask[13] = false;
        let mut w = r.clone();
        w[13] = f64::NAN;
        Whitener::new(covariance, &mask).apply(&mut w);
        let expected = brute_force(covariance, &r[..13]) + brute_force(covariance, &r[14..]);
        let got: f64 = w.iter().map(|w| w * w).sum();
        // Rounding of 40 eliminations of a well-conditioned matrix.
        assert!((got - expected).abs() < 1e-9 * expected, "{got} against {expected}");
        assert_eq!(w[13], 0.0);
    }

    #[test]
    fn val_gain_is_the_fixed_point_of_the_riccati_recursion() {
        let (sample, disturbance, step_s) = (0.0078, 0.25, 0.0025);
        let mut variance = 1.0;
        let mut gain = 0.0;
        for _ in 0..1000 {
            let foretold: f64 = variance + (disturbance * step_s) * (disturbance * step_s);
            gain = foretold / (foretold + sample * sample);
            variance = (1.0 - gain) * foretold;
        }
        let got = Covariance::of_difference(sample, 0.0, disturbance, step_s).gain();
        assert!((got - gain).abs() < 1e-9, "{got} against {gain}");
    }

    #[test]
    fn prop_a_difference_is_whitened_like_a_residual() {
        let mut mask = vec![true; 50];
        mask[7] = false;
        let a: Vec<f64> = (0..50).map(|k| libm::sin(0.9 * f64::from(k))).collect();
        let b: Vec<f64> = (0..50).map(|k| libm::cos(1.3 * f64::from(k))).collect();
        for covariance in [
            Covariance::white(0.3),
            Covariance::of_difference(0.01, 0.1, 0.0, 0.0025),
        ] {
            let whitener = Whitener::new(covariance, &mask);
            let mut expected: Vec<f64> = a.iter().zip(&b).map(|(a, b)| 4.0 * (a - b)).collect();
            whitener.apply(&mut expected);
            let expected: Vec<f32> = expected.iter().map(|&x| x as f32).collect();
            assert_eq!(whitener.difference(&a, &b, 4.0), expected);
        }
    }
}
