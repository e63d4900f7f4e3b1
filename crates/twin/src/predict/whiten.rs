//! Whitening of a residual channel whose noise is white or a first-order moving average.
//!
//! A difference quotient (x_{k+1} − x_k)/h of samples with white noise has the tridiagonal covariance c₀ on the diagonal, c₁ beside
//! it. With its Cholesky factor L (two diagonals) the whitened residual is w = L⁻¹ r: the innovation form of the Kalman filter,
//! w_k = (r_k − l_{k,k−1} w_{k−1})/l_{kk}. A masked sample is left out and the recursion restarts after it.

/// Covariance of one channel's noise: white (`lag_one` 0) or a first-order moving average.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Covariance {
    /// c₀, variance of a sample.
    pub variance: f64,
    /// c₁, covariance of neighbours; |c₁| < c₀/2.
    pub lag_one: f64,
}

impl Covariance {
    /// Deviation of the mean of `count` samples of pure noise.
    pub fn deviation_of_mean(self, count: usize) -> f64 {
        let n = count as f64;
        ((n * self.variance + 2.0 * (n - 1.0) * self.lag_one) / (n * n))
            .max(0.0)
            .sqrt()
    }

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

/// Noise of a measured rate on one axis: white readings, a white torque and one that drifts. Its innovations are those of a Kalman
/// filter of (rate, torque):
///
/// m_k = μ_k + n_k,   μ_{k+1} = μ_k + h r̄_k + D_k + w_k,   D_{k+1} = D_k + v_k
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateNoise {
    /// Deviation of a reading n, rad/s.
    pub reading: f64,
    /// Deviation of a step's change of the rate by a white torque, w, over that of a reading.
    pub white: f64,
    /// Deviation of a step of the drifting torque, v, as rate by step, over that of a reading.
    pub drift: f64,
}

/// Steps over which the drifting torque has drifted when a log begins.
const DRIFTED_STEPS: f64 = 800.0;
/// Relative change of the innovation's variance from which the filter stands still.
const STEADY: f64 = 1e-10;
/// Steps of the filter at most until it is taken as still.
const MOST_FILTER_STEPS: usize = 20_000;

/// One step of the filter for readings of deviation 1: variance of the innovation, its shares that go to the rate and to the torque.
type FilterStep = [f64; 3];

impl RateNoise {
    /// The filter's steps until it stands still, `most` at most.
    fn steps(self, most: usize) -> Vec<FilterStep> {
        let (white, drift) = (self.white * self.white, self.drift * self.drift);
        let (mut rate, mut both, mut torque) = (1.0, 0.0, drift * DRIFTED_STEPS);
        let mut steps: Vec<FilterStep> = Vec::new();
        while steps.len() < most {
            (rate, both, torque) = (rate + 2.0 * both + torque + white, both + torque, torque + drift);
            let variance = rate + 1.0;
            let (to_rate, to_torque) = (rate / variance, both / variance);
            torque -= to_torque * both;
            both *= 1.0 - to_rate;
            rate *= 1.0 - to_rate;
            let still = steps.last().is_some_and(|last| {
                (last[0] - variance).abs() < STEADY * variance
                    && (last[2] - to_torque).abs() < STEADY * to_torque.abs() + 1e-15
            });
            steps.push([variance, to_rate, to_torque]);
            if still {
                break;
            }
        }
        steps
    }

    /// ln likelihood of rate residuals h r (rad/s; NaN where masked) with readings of this deviation, and with the deviation of the
    /// readings that makes it most likely, and that deviation. Without the constant.
    pub fn log_likelihood(self, residual: &[f64]) -> (f64, f64, f64) {
        // No sample is further from the last masked one than the residual is long.
        let steps = self.steps(residual.len().clamp(1, MOST_FILTER_STEPS));
        let (mut at, mut count, mut squares, mut logs) = (0, 0.0, 0.0, 0.0);
        let (mut after, mut torque) = (0.0, 0.0);
        let log_variance: Vec<f64> = steps.iter().map(|step| step[0].ln()).collect();
        for &r in residual {
            if r.is_nan() {
                (at, after, torque) = (0, 0.0, 0.0);
                continue;
            }
            let [variance, to_rate, to_torque] = steps[at];
            let innovation = r + after - torque;
            after = (1.0 - to_rate) * innovation;
            torque += to_torque * innovation;
            squares += innovation * innovation / variance;
            logs += log_variance[at];
            count += 1.0;
            at = (at + 1).min(steps.len() - 1);
        }
        let own = self.reading * self.reading;
        let best = (squares / f64::max(count, 1.0)).max(f64::MIN_POSITIVE);
        let with = |square: f64| -0.5 * (squares / square + count * square.ln() + logs);
        (with(own), with(best), best.sqrt())
    }

    /// The noise that makes residuals h r (rad/s; NaN where masked) most likely: the gain of the predictor is
    /// estimated, not assumed. A wrong gain leaves innovations that are predictable from earlier readings; the
    /// controller responds to these readings, and its commands then seem to explain them.
    pub fn most_likely(self, residual: &[f64]) -> Self {
        const WHITE: (f64, f64) = (1e-3, 30.0);
        const DRIFT: (f64, f64) = (1e-8, 1.0);
        let within = |one: Self| Self {
            white: one.white.clamp(WHITE.0, WHITE.1),
            drift: one.drift.clamp(DRIFT.0, DRIFT.1),
            ..one
        };
        let of = |one: Self| one.log_likelihood(residual).1;
        let mut best = within(self);
        let mut most = of(best);
        // A valley may lead to either border: start from where it is and from both corners.
        for start in [(0.002, 1e-7), (0.05, 1e-7), (0.01, 1e-4)] {
            let other = Self {
                white: start.0,
                drift: start.1,
                ..best
            };
            let value = of(other);
            if value > most {
                (best, most) = (other, value);
            }
        }
        let mut factor: f64 = 4.0;
        while factor > 1.05 {
            let mut moved = false;
            for (white, drift) in [
                (factor, 1.0),
                (1.0 / factor, 1.0),
                (1.0, factor * factor),
                (1.0, 1.0 / (factor * factor)),
            ] {
                let other = within(Self {
                    white: best.white * white,
                    drift: best.drift * drift,
                    ..best
                });
                let value = of(other);
                if value > most + 1e-6 {
                    (best, most, moved) = (other, value, true);
                }
            }
            if !moved {
                factor = factor.sqrt();
            }
        }
        Self {
            reading: of_reading(best, residual),
            ..best
        }
    }
}

/// Deviation of a reading that makes residuals most likely.
fn of_reading(noise: RateNoise, residual: &[f64]) -> f64 {
    noise.log_likelihood(residual).2
}

/// The two diagonals of L⁻¹'s recursion for one mask, w_k = g_k r_k − p_k w_{k−1}; or the filter of a [`RateNoise`].
///
/// They depend on nothing but the samples since the last masked one, and soon no more on these: kept is the table of (g, p) until they
/// stand still, and for each sample its place there.
#[derive(Debug, Clone)]
pub struct Whitener {
    /// Place in `steps`; 0 where masked.
    place: Vec<u16>,
    /// g = 1/l_kk and p = l_{k,k−1}/l_kk; zeros first.
    steps: Vec<[f64; 2]>,
    /// Steps of the filter in place of `steps`, for readings of this deviation at this interval.
    filter: Option<Filter>,
}

/// A filter of rates, or of a level, as a whitener.
#[derive(Debug, Clone)]
struct Filter {
    /// 1/deviation of the innovation, shares of it for rate and torque; zeros first.
    steps: Vec<[f64; 3]>,
    step_s: f64,
}

/// What the filter remembers: rate and torque of the step before, rad/s.
#[derive(Debug, Clone, Copy, Default)]
struct FilterState {
    after: f64,
    torque: f64,
}

impl Filter {
    /// Innovation over its deviation; 0 where masked.
    fn innovation(&self, state: &mut FilterState, place: u16, residual: f64) -> f64 {
        if place == 0 {
            *state = FilterState::default();
            return 0.0;
        }
        let step = self.steps[usize::from(place)];
        let innovation = self.step_s * residual + state.after - state.torque;
        state.take(step, innovation);
        step[0] * innovation
    }
}

impl FilterState {
    fn take(&mut self, step: [f64; 3], innovation: f64) {
        self.after = (1.0 - step[1]) * innovation;
        self.torque += step[2] * innovation;
    }
}

impl Whitener {
    /// The same samples with the innovations of a rate's filter, for residuals in rad/s².
    pub fn with_filter(&self, noise: RateNoise, step_s: f64) -> Self {
        let mut steps = vec![[0.0; 3]];
        steps.extend(
            noise
                .steps(MOST_FILTER_STEPS)
                .into_iter()
                .map(|[variance, rate, torque]| [1.0 / (noise.reading * variance.sqrt()), rate, torque]),
        );
        self.filtered(steps, step_s)
    }

    fn filtered(&self, steps: Vec<[f64; 3]>, step_s: f64) -> Self {
        let mut at = 0;
        let place = self.place.iter().map(|&place| {
            at = if place == 0 { 0 } else { (at + 1).min(steps.len() - 1) };
            at as u16
        });
        Self {
            place: place.collect(),
            steps: Vec::new(),
            filter: Some(Filter { steps, step_s }),
        }
    }

    /// The same samples with the innovations of a level that walks: white noise of deviation `white` about a level that moves by
    /// `walk` a step and is `start` from 0 at first.
    ///
    /// e_k = r_k − l_k,   l_{k+1} = l_k + K_k e_k: the filter of a rate whose readings all go to the drift
    pub fn with_walk(&self, white: f64, walk: f64, start: f64) -> Self {
        let mut steps = vec![[0.0; 3]];
        let mut level = start * start;
        while steps.len() < MOST_FILTER_STEPS {
            let variance = level + white * white;
            let gain = level / variance;
            steps.push([1.0 / variance.sqrt(), 1.0, gain]);
            let next = level * (1.0 - gain) + walk * walk;
            if (next - level).abs() < STEADY * level {
                break;
            }
            level = next;
        }
        self.filtered(steps, 1.0)
    }

    /// r of w = L⁻¹ r in place; masked samples become NaN.
    pub fn undo(&self, whitened: &mut [f64]) {
        let mut before = 0.0;
        let mut state = FilterState::default();
        for (w, &place) in whitened.iter_mut().zip(&self.place) {
            if place == 0 {
                (*w, before, state) = (f64::NAN, 0.0, FilterState::default());
                continue;
            }
            if let Some(filter) = &self.filter {
                let step = filter.steps[usize::from(place)];
                let innovation = *w / step[0];
                *w = (innovation - state.after + state.torque) / filter.step_s;
                state.take(step, innovation);
            } else {
                let [gain, previous] = self.steps[usize::from(place)];
                let now = *w;
                *w = (now + previous * before) / gain;
                before = now;
            }
        }
    }

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
        Self {
            place,
            steps,
            filter: None,
        }
    }

    /// L⁻¹ r in place; masked samples become 0.
    pub fn apply(&self, residual: &mut [f64]) {
        if let Some(filter) = &self.filter {
            let mut state = FilterState::default();
            for (r, &place) in residual.iter_mut().zip(&self.place) {
                *r = filter.innovation(&mut state, place, *r);
            }
            return;
        }
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
        if let Some(filter) = &self.filter {
            let mut state = FilterState::default();
            let samples = a.iter().zip(b).zip(&self.place);
            return samples
                .map(|((&x, &y), &place)| filter.innovation(&mut state, place, (x - y) * factor) as f32)
                .collect();
        }
        if let Some(gain) = self.white() {
            // Without a recursion several samples are processed together.
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

    /// True for the filter of a rate or a level: what it puts out depends on all that came before.
    pub fn remembers(&self) -> bool {
        self.filter.is_some()
    }

    /// What sample `k` puts out, and what is remembered after it, without input; of what was remembered before it.
    fn free(&self, k: usize, remembered: [f64; 2]) -> (f64, [f64; 2]) {
        let (Some(filter), true) = (&self.filter, self.counts(k)) else {
            return (0.0, [0.0; 2]);
        };
        let [gain, to_rate, to_torque] = filter.steps[usize::from(self.place[k])];
        let innovation = remembered[0] - remembered[1];
        let after = [(1.0 - to_rate) * innovation, remembered[1] + to_torque * innovation];
        (gain * innovation, after)
    }

    /// What a filter remembers (rate, torque) before each of the rows `at`, which rise, once it has whitened a column.
    pub fn remembered(&self, whitened: &[f32], at: &[usize]) -> Vec<[f64; 2]> {
        let Some(filter) = &self.filter else {
            return vec![[0.0; 2]; at.len()];
        };
        let (mut found, mut state) = (Vec::with_capacity(at.len()), FilterState::default());
        for (k, &w) in whitened.iter().enumerate() {
            while found.len() < at.len() && at[found.len()] <= k {
                found.push([state.after, state.torque]);
            }
            if self.counts(k) {
                let step = filter.steps[usize::from(self.place[k])];
                state.take(step, f64::from(w) / step[0]);
            } else {
                state = FilterState::default();
            }
        }
        found.resize(at.len(), [state.after, state.torque]);
        found
    }

    /// Σ_{k ≥ t} y_k h_k, with h what a filter puts out without input, per unit of what it remembers before t; for each row t of `at`.
    pub fn echoes(&self, y: impl Fn(usize) -> f64, at: &[usize]) -> Vec<[f64; 2]> {
        let mut found = vec![[0.0; 2]; at.len()];
        let (mut left, mut sum) = (at.len(), [0.0; 2]);
        for k in (0..self.len()).rev() {
            let y = y(k);
            sum = [[1.0, 0.0], [0.0, 1.0]].map(|unit| {
                let (out, after) = self.free(k, unit);
                out * y + after[0] * sum[0] + after[1] * sum[1]
            });
            while left > 0 && at[left - 1] >= k {
                left -= 1;
                if at[left] == k {
                    found[left] = sum;
                }
            }
        }
        found
    }

    /// Σ_{k ≥ t} h_k h_kᵀ of the same.
    pub fn echo_squares(&self, at: &[usize]) -> Vec<[[f64; 2]; 2]> {
        let mut found = vec![[[0.0; 2]; 2]; at.len()];
        let (mut left, mut sum) = (at.len(), [[0.0; 2]; 2]);
        for k in (0..self.len()).rev() {
            let [(out, after), (other_out, other_after)] = [[1.0, 0.0], [0.0, 1.0]].map(|unit| self.free(k, unit));
            let form = |a: [f64; 2], b: [f64; 2]| {
                (0..2)
                    .map(|i| a[i] * (sum[i][0] * b[0] + sum[i][1] * b[1]))
                    .sum::<f64>()
            };
            let mixed = out * other_out + form(after, other_after);
            sum = [
                [out * out + form(after, after), mixed],
                [mixed, other_out * other_out + form(other_after, other_after)],
            ];
            while left > 0 && at[left - 1] >= k {
                left -= 1;
                if at[left] == k {
                    found[left] = sum;
                }
            }
        }
        found
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
    use rotortwin_plant::random::NormalStream;

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
    fn val_a_level_that_walks_is_whitened() {
        let mut noise = NormalStream::new(4, "walk");
        let (white, walk) = (0.005, 2e-4);
        let mut level = 0.02;
        let mut r: Vec<f64> = (0..20_000)
            .map(|_| {
                level += walk * noise.sample();
                level + white * noise.sample()
            })
            .collect();
        let before = r.clone();
        let whitener = Whitener::new(Covariance::white(white), &vec![true; r.len()]).with_walk(white, walk, 0.02);
        whitener.apply(&mut r);
        let square = r.iter().map(|w| w * w).sum::<f64>() / r.len() as f64;
        let neighbours = r.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / r.len() as f64;
        // 1/√n is 0.7 %.
        assert!(
            (square - 1.0).abs() < 0.04 && neighbours.abs() < 0.03,
            "{square} {neighbours}"
        );
        whitener.undo(&mut r);
        assert!(r.iter().zip(&before).all(|(a, b)| (a - b).abs() < 1e-9));
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
            let predicted: f64 = variance + (disturbance * step_s) * (disturbance * step_s);
            gain = predicted / (predicted + sample * sample);
            variance = (1.0 - gain) * predicted;
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

    /// A yaw loop that responds only to the noise of its gyro: (h r with the rates as read, lagged command), rad/s and
    /// rad/s².
    fn loop_of_noise(gain: f64, noise: f64, disturbance: f64, seed: u64) -> (Vec<f64>, Vec<f64>) {
        let (h, lag) = (0.0025, 0.05);
        let mut draws = NormalStream::new(seed, "loop");
        let (mut rate, mut torque, mut read) = (0.0, 0.0, 0.0);
        let (mut differences, mut torques) = (Vec::new(), Vec::new());
        for _ in 0..16_000 {
            let after = torque + (1.0 - libm::exp(-h / lag)) * (-gain * read - torque);
            let mean = 0.5 * (torque + after);
            torque = after;
            rate += h * mean + disturbance * draws.sample();
            let now = rate + noise * draws.sample();
            differences.push(now - read - h * mean);
            torques.push(mean);
            read = now;
        }
        (differences, torques)
    }

    /// What a false gain of the torque seems to be, by least squares of whitened residuals, in its own deviations.
    fn false_gain(noise: RateNoise, differences: &[f64], torques: &[f64]) -> f64 {
        let plain = Whitener::new(Covariance::white(1.0), &vec![true; differences.len()]);
        let filter = plain.with_filter(noise, 1.0);
        let (mut r, mut x) = (
            differences.to_vec(),
            torques.iter().map(|t| 0.0025 * t).collect::<Vec<_>>(),
        );
        filter.apply(&mut r);
        filter.apply(&mut x);
        let of = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        of(&x, &r) / of(&x, &x).sqrt()
    }

    #[test]
    fn val_noise_that_comes_back_as_a_command_explains_nothing_with_the_most_likely_gain() {
        let (reading, gain) = (0.0055, 3.9);
        let assumed = RateNoise {
            reading,
            white: 0.045,
            drift: 1e-8,
        };
        let (mut most, mut assumed_least) = (0.0_f64, f64::INFINITY);
        for seed in 0..8 {
            let (differences, torques) = loop_of_noise(gain, reading, 0.0, seed);
            let likely = assumed.most_likely(&differences);
            most = most.max(false_gain(likely, &differences, &torques).abs());
            assumed_least = assumed_least.min(false_gain(assumed, &differences, &torques).abs());
        }
        // With the assumed gain every seed shows an effect that is not there; with the most likely one none of eight
        // exceeds the one-in-two-thousand level.
        assert!(assumed_least > 4.0, "{assumed_least}");
        assert!(most < 3.5, "{most}");
    }

    #[test]
    fn val_the_most_likely_noise_is_that_which_was_drawn() {
        let (reading, disturbance) = (0.0055, 0.0011);
        let (differences, _) = loop_of_noise(0.0, reading, disturbance, 3);
        let start = RateNoise {
            reading: 0.01,
            white: 0.02,
            drift: 1e-6,
        };
        let found = start.most_likely(&differences);
        assert!((found.reading / reading - 1.0).abs() < 0.03, "{found:?}");
        assert!((found.white / (disturbance / reading) - 1.0).abs() < 0.15, "{found:?}");
    }

    /// Products of a column that is cut off before it is whitened, from those of the whole column.
    #[test]
    fn val_a_column_that_begins_late_has_the_products_of_one_that_is_whitened_so() {
        let n = 400;
        let mut mask = vec![true; n];
        mask[150] = false;
        let noise = RateNoise {
            reading: 0.0055,
            white: 0.03,
            drift: 1e-3,
        };
        let whitener =
            Whitener::new(Covariance::of_difference(0.01, 0.0, 0.2, 0.0025), &mask).with_filter(noise, 0.0025);
        let x: Vec<f64> = (0..n).map(|k| 1.0 + 0.3 * libm::sin(0.05 * k as f64)).collect();
        let y: Vec<f64> = (0..n).map(|k| 0.4 - libm::cos(0.013 * k as f64)).collect();
        let none = vec![0.0; n];
        let (whole, other) = (whitener.difference(&x, &none, 1.0), whitener.difference(&y, &none, 1.0));
        let at = [0, 40, 149, 150, 151, 300];
        let (state, squares) = (whitener.remembered(&whole, &at), whitener.echo_squares(&at));
        let (echo, own_echo) = (
            whitener.echoes(|k| f64::from(other[k]), &at),
            whitener.echoes(|k| f64::from(whole[k]), &at),
        );
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        for (i, &t) in at.iter().enumerate() {
            let mut cut = x.clone();
            cut[..t].fill(0.0);
            let cut = whitener.difference(&cut, &none, 1.0);
            let sum = |a: &[f32], b: &[f32]| a[t..].iter().zip(&b[t..]).map(|(a, b)| f64::from(a * b)).sum::<f64>();
            let mixed = sum(&whole, &other) - dot(state[i], echo[i]);
            let form = squares[i].map(|row| dot(row, state[i]));
            let own = sum(&whole, &whole) - 2.0 * dot(state[i], own_echo[i]) + dot(state[i], form);
            // Columns are f32.
            assert!(
                (mixed - sum(&cut, &other)).abs() < 1e-4 * sum(&other, &other),
                "{t}: {mixed}"
            );
            assert!((own - sum(&cut, &cut)).abs() < 1e-4 * sum(&cut, &cut), "{t}: {own}");
        }
    }

    #[test]
    fn prop_a_filter_is_undone() {
        let mut mask = vec![true; 60];
        mask[20] = false;
        let noise = RateNoise {
            reading: 0.0055,
            white: 0.03,
            drift: 1e-4,
        };
        let plain = Whitener::new(Covariance::of_difference(0.01, 0.0, 0.2, 0.0025), &mask);
        for whitener in [plain.with_filter(noise, 0.0025), plain] {
            let r: Vec<f64> = (0..60).map(|k| libm::sin(0.7 * f64::from(k))).collect();
            let mut back = r.clone();
            whitener.apply(&mut back);
            assert_eq!(back[20], 0.0);
            let none = whitener.difference(&r, &vec![0.0; 60], 1.0);
            assert!(back.iter().zip(&none).all(|(a, b)| *a as f32 == *b));
            whitener.undo(&mut back);
            assert!(back[20].is_nan());
            let same = |k: usize| k == 20 || (back[k] - r[k]).abs() < 1e-9;
            assert!((0..60).all(same));
        }
    }
}
