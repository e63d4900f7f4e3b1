//! Kalman filters of one wrench axis: decompose its momentum defect.
//!
//! Units: every axis is divided by its longest lever (1, l_x, l_y, c_D/c_L), so that disturbances of all four axes are thrusts at
//! a rotor, N, and the defect D is N·s.
//!
//! ```text
//!  D' = w + b + g φ_own + s φ_second + t φ_lag + j φ_gyr    D: momentum defect      measured once per block, white noise
//!  w' = −w/T + noise                                        w: gusts, level σ       b: constant (bias), slowly drifting
//!  g, s, t, j constant                                      g: gain error of the axis   s: see below   t: error of ln τ
//! ```
//!
//! φ_second is the vertical force for roll, pitch and yaw (offset of the centre of mass) and the vertical speed for the vertical
//! axis (drag). φ_lag is the sensitivity of the lagged wrench to ln τ. φ_gyr is the effect of errors in the other two moments of
//! inertia, ε_b and ε_c, on the gyroscopic torque (J_b − J_c) ω_b ω_c of Euler's equations; on yaw the document's own torque is 0 where
//! roll and pitch inertia are equal, so turning a corner shows only the error:
//!
//! j φ_gyr = (ε_b J_b − ε_c J_c) ω_b ω_c,  φ_gyr = √(J_b² + J_c²) ω_b ω_c,  j as uncertain as ε_b and ε_c each (none for vertical force)
//!
//! All φ are integrated over the flight and averaged over the samples of a block like D itself, so that the model is exact for constant
//! parameters.

/// Number of states of [`AxisFilter`]; the last one is the error of the gyroscopic torque.
pub(super) const STATES: usize = 7;
/// Momentum defect.
pub(super) const DEFECT: usize = 0;
/// Gusts.
pub(super) const GUST: usize = 1;
/// Constant disturbance.
pub(super) const BIAS: usize = 2;
/// Gain error; followed by the second parameter.
pub(super) const GAIN: usize = 3;
/// Relative error of ln τ.
pub(super) const LAG: usize = 5;

/// Clip limit of the squared normalised innovation when surprise is averaged: 1.4 % of a χ² with one degree of freedom exceed 6.
pub(super) const SURPRISE_LIMIT: f32 = 6.0;

/// Assumed disturbance of an axis over one block.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Disturbance {
    /// e^(−block/T).
    pub correlation: f32,
    /// σ² of the gusts, N².
    pub variance: f32,
    /// Added to the variance of D, (N·s)².
    pub momentum_noise: f32,
    /// Added to the variance of b, N².
    pub drift: f32,
    /// Variance of a block's mean of D, (N·s)².
    pub measurement: f32,
}

/// Prediction error of a measurement and the filter's response.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Innovation {
    /// Measured less predicted, N·s.
    pub value: f32,
    /// Inverse of its variance.
    pub information: f32,
    /// Kalman gain.
    pub gain: [f32; STATES],
}

impl Innovation {
    /// Squared, normalised and clipped: 0.97 on average if the model holds.
    #[inline]
    pub(super) fn surprise(&self) -> f32 {
        (self.value * self.value * self.information).min(SURPRISE_LIMIT)
    }

    /// Log likelihood up to a constant, nats.
    #[inline]
    pub(super) fn log_likelihood(&self) -> f32 {
        0.5 * (libm::logf(self.information) - self.value * self.value * self.information)
    }
}

/// Kalman filter with the states of the module documentation.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AxisFilter {
    pub state: [f32; STATES],
    /// Symmetric; both halves are kept.
    pub covariance: [[f32; STATES]; STATES],
}

impl AxisFilter {
    pub(super) const BLANK: Self = Self {
        state: [0.0; STATES],
        covariance: [[0.0; STATES]; STATES],
    };

    /// All states 0 with the given variances.
    pub(super) fn new(variance: &[f32; STATES]) -> Self {
        let mut covariance = [[0.0; STATES]; STATES];
        for i in 0..STATES {
            covariance[i][i] = variance[i];
        }
        Self {
            state: [0.0; STATES],
            covariance,
        }
    }

    /// Advances to the next block.
    ///
    /// * `phi`: φ over the block, entry [`DEFECT`] 0
    ///
    /// The lag enters linearised; the variance of its second-order term, (½ φ t²)², is added to D.
    #[inline]
    pub(super) fn predict(&mut self, phi: &[f32; STATES], disturbance: &Disturbance) {
        let p = &mut self.covariance;
        let mut p_phi = [0.0; STATES];
        for i in 0..STATES {
            for j in 1..STATES {
                p_phi[i] += p[i][j] * phi[j];
            }
        }
        let mut variance = 0.0;
        let mut step = 0.0;
        for j in 1..STATES {
            variance += phi[j] * p_phi[j];
            step += phi[j] * self.state[j];
        }
        let second_order = 0.5 * phi[LAG] * p[LAG][LAG];
        self.state[DEFECT] += step;
        p[DEFECT][DEFECT] += 2.0 * p_phi[DEFECT] + variance + disturbance.momentum_noise + second_order * second_order;
        for j in 1..STATES {
            p[DEFECT][j] += p_phi[j];
        }
        let decay = disturbance.correlation;
        self.state[GUST] *= decay;
        p[DEFECT][GUST] *= decay;
        for j in BIAS..STATES {
            p[GUST][j] *= decay;
            p[j][GUST] = p[GUST][j];
        }
        p[GUST][GUST] = decay * decay * p[GUST][GUST] + (1.0 - decay * decay) * disturbance.variance;
        p[BIAS][BIAS] += disturbance.drift;
        for j in 1..STATES {
            p[j][DEFECT] = p[DEFECT][j];
        }
    }

    /// Updates with the measured defect; D counts from it afterwards.
    #[inline]
    pub(super) fn update(&mut self, measured: f32, variance: f32) -> Innovation {
        let row = self.covariance[DEFECT];
        let information = 1.0 / (row[DEFECT] + variance);
        let value = measured - self.state[DEFECT];
        let mut gain = [0.0; STATES];
        for i in 0..STATES {
            gain[i] = row[i] * information;
            self.state[i] += gain[i] * value;
        }
        for i in 0..STATES {
            for j in i..STATES {
                let entry = self.covariance[i][j] - gain[i] * row[j];
                self.covariance[i][j] = entry;
                self.covariance[j][i] = entry;
            }
        }
        self.state[DEFECT] -= measured;
        Innovation {
            value,
            information,
            gain,
        }
    }

    /// Predicted change of D, and its variance, from the parameters other than the disturbances.
    #[inline]
    pub(super) fn parameter_effect(&self, phi: &[f32; STATES]) -> (f32, f32) {
        let mut mean = 0.0;
        let mut variance = 0.0;
        for i in BIAS + 1..STATES {
            mean += phi[i] * self.state[i];
            for j in BIAS + 1..STATES {
                variance += phi[i] * phi[j] * self.covariance[i][j];
            }
        }
        (mean, variance)
    }
}

/// A filter of (D, w, b) alone that assumes a different gust level and leaves the other parameters to the main filter.
///
/// Two of them, one above and one below the level in use, indicate by their likelihoods which way the level should move.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LevelProbe {
    state: [f32; 3],
    /// DD, Dw, Db, ww, wb, bb.
    covariance: [f32; 6],
}

impl LevelProbe {
    pub(super) const BLANK: Self = Self {
        state: [0.0; 3],
        covariance: [0.0; 6],
    };

    /// Starts from the main filter.
    pub(super) fn new(filter: &AxisFilter) -> Self {
        let p = &filter.covariance;
        Self {
            state: [filter.state[DEFECT], filter.state[GUST], filter.state[BIAS]],
            covariance: [
                p[DEFECT][DEFECT],
                p[DEFECT][GUST],
                p[DEFECT][BIAS],
                p[GUST][GUST],
                p[GUST][BIAS],
                p[BIAS][BIAS],
            ],
        }
    }

    /// Log likelihood of the measured defect up to a constant, nats; D counts from it afterwards.
    ///
    /// * `elapsed`: block length, s   * `known`: change of D that the main filter's parameters explain, N·s
    #[inline]
    pub(super) fn step(&mut self, elapsed: f32, known: f32, disturbance: &Disturbance, measured: f32) -> f32 {
        let [dd, dw, db, ww, wb, bb] = self.covariance;
        let [defect, gust, bias] = self.state;
        let decay = disturbance.correlation;

        let from_gust = ww + wb;
        let from_bias = wb + bb;
        let dd =
            dd + 2.0 * elapsed * (dw + db) + elapsed * elapsed * (from_gust + from_bias) + disturbance.momentum_noise;
        let dw = decay * (dw + elapsed * from_gust);
        let db = db + elapsed * from_bias;
        let ww = decay * decay * ww + (1.0 - decay * decay) * disturbance.variance;
        let wb = decay * wb;
        let bb = bb + disturbance.drift;

        let information = 1.0 / (dd + disturbance.measurement);
        let value = measured - (defect + elapsed * (gust + bias) + known);
        let gain = [dd * information, dw * information, db * information];
        self.state = [
            gain[0] * value - value,
            decay * gust + gain[1] * value,
            bias + gain[2] * value,
        ];
        self.covariance = [
            dd - gain[0] * dd,
            dw - gain[0] * dw,
            db - gain[0] * db,
            ww - gain[1] * dw,
            wb - gain[1] * db,
            bb - gain[2] * db,
        ];
        0.5 * (libm::logf(information) - value * value * information)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    /// The textbook recursion in `f64`: P ← A P Aᵀ + Q, then the update in Joseph form.
    struct Reference {
        x: [f64; STATES],
        p: [[f64; STATES]; STATES],
    }

    impl Reference {
        fn step(&mut self, phi: &[f32; STATES], d: &Disturbance, measured: f32) -> (f64, f64) {
            let decay = f64::from(d.correlation);
            let mut a = [[0.0; STATES]; STATES];
            for i in 0..STATES {
                a[i][i] = 1.0;
                a[DEFECT][i] = if i == DEFECT { 1.0 } else { f64::from(phi[i]) };
            }
            a[GUST][GUST] = decay;
            let mut q = [0.0; STATES];
            let second_order = 0.5 * f64::from(phi[LAG]) * self.p[LAG][LAG];
            q[DEFECT] = f64::from(d.momentum_noise) + second_order * second_order;
            q[GUST] = (1.0 - decay * decay) * f64::from(d.variance);
            q[BIAS] = f64::from(d.drift);
            self.x = core::array::from_fn(|i| (0..STATES).map(|j| a[i][j] * self.x[j]).sum());
            let sandwich = |a: &[[f64; STATES]; STATES], p: &[[f64; STATES]; STATES]| -> [[f64; STATES]; STATES] {
                core::array::from_fn(|i| {
                    core::array::from_fn(|j| {
                        let mut sum = 0.0;
                        for k in 0..STATES {
                            for l in 0..STATES {
                                sum += a[i][k] * p[k][l] * a[j][l];
                            }
                        }
                        sum
                    })
                })
            };
            self.p = sandwich(&a, &self.p);
            for i in 0..STATES {
                self.p[i][i] += q[i];
            }
            let r = f64::from(d.measurement);
            let s = self.p[DEFECT][DEFECT] + r;
            let e = f64::from(measured) - self.x[DEFECT];
            let gain: [f64; STATES] = core::array::from_fn(|i| self.p[i][DEFECT] / s);
            let mut joseph = [[0.0; STATES]; STATES];
            for i in 0..STATES {
                self.x[i] += gain[i] * e;
                joseph[i][i] = 1.0;
                joseph[i][DEFECT] -= gain[i];
            }
            self.p = sandwich(&joseph, &self.p);
            for i in 0..STATES {
                for j in 0..STATES {
                    self.p[i][j] += gain[i] * r * gain[j];
                }
            }
            self.x[DEFECT] -= f64::from(measured);
            (e, s)
        }
    }

    fn disturbance() -> Disturbance {
        Disturbance {
            correlation: 0.985,
            variance: 5e-5,
            momentum_noise: 1e-10,
            drift: 3e-8,
            measurement: 2e-8,
        }
    }

    const VARIANCE: [f32; STATES] = [1e-6, 5e-5, 0.25, 2.5e-3, 2e-4, 2e-2, 2.5e-3];

    /// Fifty seconds of blocks with a corner every nine: the span of one flight.
    fn blocks() -> impl Iterator<Item = ([f32; STATES], f32)> {
        (0..1600).map(|k| {
            let t = k as f32 / 32.0;
            let corner = if k % 288 < 10 { libm::sinf(k as f32 * 1.3) } else { 0.0 };
            let phi = [
                0.0,
                0.031,
                0.031,
                0.031 * (0.02 * libm::sinf(3.0 * t) + corner),
                0.031 * (0.1 * libm::sinf(0.4 * t) + corner),
                0.02 * (0.02 * libm::cosf(3.0 * t) - corner),
                0.031 * corner * libm::cosf(0.7 * t),
            ];
            // 0.1 N of bias, a gust, noise, and the effect of wrong parameters.
            let defect = 0.031 * (0.1 + 0.01 * libm::sinf(0.7 * t))
                + 2e-4 * libm::sinf(k as f32 * 12.9)
                + 0.03 * phi[3]
                + 0.15 * phi[5]
                - 0.04 * phi[6];
            (phi, defect)
        })
    }

    #[test]
    fn val_filter_against_textbook_in_f64() {
        let d = disturbance();
        let mut filter = AxisFilter::new(&VARIANCE);
        let mut reference = Reference {
            x: [0.0; STATES],
            p: core::array::from_fn(|i| core::array::from_fn(|j| if i == j { f64::from(VARIANCE[i]) } else { 0.0 })),
        };
        let mut worst = 0.0f64;
        for (phi, defect) in blocks() {
            filter.predict(&phi, &d);
            let innovation = filter.update(defect, d.measurement);
            let (e, s) = reference.step(&phi, &d, defect);
            let sigma = libm::sqrt(s);
            worst = worst.max((f64::from(innovation.value) - e).abs() / sigma);
            // The prior variance of the bias is 1e7 times the final one; f32 keeps the innovation variance to within 1 % after it.
            let ratio = 1.0 / (f64::from(innovation.information) * s);
            assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
            for i in 0..STATES {
                assert!(filter.covariance[i][i] > 0.0, "variance {i}");
            }
        }
        // In standard deviations of the innovation: far below anything that affects a decision.
        assert!(worst < 0.05, "{worst}");
    }

    #[test]
    fn val_probe_is_the_filter_without_parameters() {
        let d = disturbance();
        let mut filter = AxisFilter::new(&[1e-6, 5e-5, 0.25, 0.0, 0.0, 0.0, 0.0]);
        let mut probe = LevelProbe::new(&filter);
        for (phi, defect) in blocks() {
            let phi = [0.0, phi[1], phi[2], 0.0, 0.0, 0.0, 0.0];
            filter.predict(&phi, &d);
            let want = filter.update(defect, d.measurement).log_likelihood();
            let got = probe.step(phi[1], 0.0, &d, defect);
            assert!((got - want).abs() < 1e-2 * want.abs().max(1.0), "{got} {want}");
        }
    }

    #[test]
    fn val_likelihood_finds_the_level() {
        // Gusts of a known level, generated by the model itself.
        let mut d = disturbance();
        let mut state = 1u32;
        let mut uniform = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let mut normal = || (0..12).map(|_| uniform()).sum::<f32>() - 6.0;
        let (mut gust, mut momentum, mut before) = (0.0f32, 0.0f32, 0.0f32);
        let defects: Vec<f32> = (0..1000)
            .map(|_| {
                gust = 0.985 * gust + libm::sqrtf((1.0 - 0.985 * 0.985) * 5e-5) * normal();
                momentum += 0.031 * gust;
                let measured = momentum + libm::sqrtf(2e-8) * normal();
                let defect = measured - before;
                before = measured;
                defect
            })
            .collect();
        let score: Vec<f32> = [0.01, 0.1, 1.0, 10.0, 100.0]
            .iter()
            .map(|factor| {
                d.variance = 5e-5 * factor;
                let mut probe = LevelProbe::new(&AxisFilter::new(&[1e-6, d.variance, 0.01, 0.0, 0.0, 0.0, 0.0]));
                defects.iter().map(|defect| probe.step(0.031, 0.0, &d, *defect)).sum()
            })
            .collect();
        for (k, s) in score.iter().enumerate() {
            assert!(k == 2 || *s < score[2] - 2.0, "{score:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn prop_covariance_stays_positive(
            steps in proptest::collection::vec((proptest::array::uniform7(-1.0f32..1.0), -1.0f32..1.0), 1..200),
        ) {
            let d = disturbance();
            let mut filter = AxisFilter::new(&VARIANCE);
            for (mut phi, defect) in steps {
                phi[DEFECT] = 0.0;
                phi[GUST] = 0.031;
                phi[BIAS] = 0.031;
                filter.predict(&phi, &d);
                let innovation = filter.update(defect, d.measurement);
                prop_assert!(innovation.information > 0.0 && innovation.information.is_finite());
                prop_assert!(filter.state.iter().all(|x| x.is_finite()));
            }
        }
    }
}
