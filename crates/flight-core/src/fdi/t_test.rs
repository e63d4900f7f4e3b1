//! Student's T-test on the window means of the residuals, and the signature matrix (§5.3).
//!
//! Once per window of n samples (25 in Table 5), after a calibration period in which the vehicle is assumed healthy:
//!
//! t = (mean − µ₀)/(s/√n), rejected if |t| exceeds the two-sided critical value with n − 1 degrees of freedom
//!
//! 1. *Detect*: the first component (arm) of every r_i against α_FD. With equal opposite rotors, a fault triggers n_a − 2 of them;
//!    fewer mean healthy.
//! 2. *Isolate*: all three components of every r_i against α_FDI. Triggering pattern ρ_i = 1 if any of the three is rejected.
//! 3. *Signature* (Table 3): column i is all ones but for a 0 in row i. ρ equal to column i: rotor i; else an unknown fault.
//!
//! Limits: two-sided, although a fault can only be a loss; windows are independent. Needs sensor noise: without it the window's
//! own spread vanishes and everything is significant.

use super::FaultVerdict;
use super::student_t::two_sided_critical_value;
use super::window::{WrenchStatistics, dot};
use crate::geometry::Geometry;

/// Parameters of the T-test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TTestConfig {
    /// α_FD, significance of the detection, in (0, 1).
    pub alpha_detect: f64,
    /// α_FDI, significance of the isolation, in (0, 1).
    pub alpha_isolate: f64,
    /// Start of the calibration of µ₀, s after the first sample.
    pub baseline_start: f32,
    /// End of the calibration, s; verdicts follow.
    pub baseline_end: f32,
}

impl TTestConfig {
    /// Placeholder, to be filled with a configuration.
    pub(super) const BLANK: Self = Self {
        alpha_detect: 0.0,
        alpha_isolate: 0.0,
        baseline_start: 0.0,
        baseline_end: 0.0,
    };

    /// Table 5; µ₀ from 2 s to 10 s ("during the first 10 seconds of flight, excluding the initial transient").
    pub const fn paper() -> Self {
        Self {
            alpha_detect: 1e-10,
            alpha_isolate: 1e-8,
            baseline_start: 2.0,
            baseline_end: 10.0,
        }
    }
}

/// The T-test with precomputed thresholds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TTest {
    /// Squared critical values over the window length: reject if (mean − µ₀)² > this · s².
    detect: f32,
    isolate: f32,
}

impl TTest {
    pub(super) const BLANK: Self = Self {
        detect: 0.0,
        isolate: 0.0,
    };

    /// * `window_len`: n, at least 2
    ///
    /// None if a significance is not in (0, 1) or has no finite critical value for this window.
    pub fn new(config: &TTestConfig, window_len: u16) -> Option<Self> {
        let n = f64::from(window_len);
        let threshold = |alpha| {
            let t = two_sided_critical_value(alpha, n - 1.0)?;
            Some((t * t / n) as f32)
        };
        Some(Self {
            detect: threshold(config.alpha_detect)?,
            isolate: threshold(config.alpha_isolate)?,
        })
    }

    /// Verdict on one full window.
    ///
    /// * `baseline`: µ₀ of the wrench residual
    pub fn evaluate(&self, geometry: &Geometry, window: &WrenchStatistics, baseline: &[f32; 4]) -> FaultVerdict {
        let rotor_count = geometry.rotor_count();
        let mut detections = 0;
        for i in 0..rotor_count {
            if rejects(&geometry.decoupling_basis(i)[0], window, baseline, self.detect) {
                detections += 1;
            }
        }
        if detections + 2 < rotor_count {
            return FaultVerdict::Healthy;
        }
        let mut blind = None;
        let mut blind_count = 0;
        for i in 0..rotor_count {
            let triggered = geometry
                .decoupling_basis(i)
                .iter()
                .any(|v| rejects(v, window, baseline, self.isolate));
            if !triggered {
                blind = Some(i);
                blind_count += 1;
            }
        }
        match blind {
            Some(rotor) if blind_count == 1 => FaultVerdict::Faulty { rotor: rotor as u8 },
            _ => FaultVerdict::Unknown,
        }
    }
}

/// |t| above the critical value; without any spread, any difference counts.
#[inline]
fn rejects(v: &[f32; 4], window: &WrenchStatistics, baseline: &[f32; 4], threshold: f32) -> bool {
    let difference = window.projected_mean(v) - dot(v, baseline);
    difference * difference > threshold * window.projected_variance(v)
}

#[cfg(test)]
mod tests {
    use super::super::test_vectors;
    use super::*;

    /// Relative. Window mean and spread each carry a few f32 roundings of 6e-8 on 25 terms; µ₀ is of the same size.
    const STATISTIC_TOLERANCE: f64 = 1e-5;

    #[test]
    fn val_reference_statistic() {
        let vectors = test_vectors::json("ttest.json");
        let axis = [0.0, 1.0, 0.0, 0.0];
        for case in vectors["cases"].as_array().expect("array") {
            let mut window = WrenchStatistics::default();
            for x in case["sample"].as_array().expect("array") {
                window.push(&[0.0, x.as_f64().expect("number") as f32, 0.0, 0.0]);
            }
            let mu0 = case["mu0"].as_f64().expect("number") as f32;
            let want = case["t"].as_f64().expect("number");
            let spread = libm::sqrtf(window.projected_variance(&axis) / 25.0);
            let got = f64::from((window.projected_mean(&axis) - mu0) / spread);
            assert!(
                (got - want).abs() <= STATISTIC_TOLERANCE * want.abs(),
                "{got} against {want}"
            );
            // The squared form used by the step decides the same way, just below and above the statistic.
            let baseline = [0.0, mu0, 0.0, 0.0];
            let t_squared = (want * want / 25.0) as f32;
            assert!(rejects(&axis, &window, &baseline, 0.9999 * t_squared));
            assert!(!rejects(&axis, &window, &baseline, 1.0001 * t_squared));
        }
    }

    #[test]
    fn val_thresholds_of_table_5() {
        let test = TTest::new(&TTestConfig::paper(), 25).expect("in range");
        // Critical values from vectors/README, f32.
        assert!((test.detect - 10.836_978 * 10.836_978 / 25.0).abs() < 1e-5);
        assert!((test.isolate - 8.527_84 * 8.527_84 / 25.0).abs() < 1e-5);
    }

    /// A window with a given mean and a small spread on every axis.
    fn window(mean: [f32; 4], spread: f32) -> WrenchStatistics {
        let mut statistics = WrenchStatistics::default();
        for k in 0..25u8 {
            let mut sample = mean;
            for (axis, x) in sample.iter_mut().enumerate() {
                *x += spread * f32::from((k * (3 + 2 * axis as u8) + axis as u8) % 25) / 12.0 - spread;
            }
            statistics.push(&sample);
        }
        statistics
    }

    #[test]
    fn val_signature_of_every_rotor() {
        for (count, offset) in [(4, 0.8), (6, 0.5), (8, 0.4)] {
            let geometry = Geometry::regular(count, 0.275, 0.016, offset).expect("regular");
            let test = TTest::new(&TTestConfig::paper(), 25).expect("in range");
            for rotor in 0..count {
                let f = geometry.effectiveness();
                let fault = core::array::from_fn(|axis| -f[axis][rotor] * 0.09 / 5.0);
                let verdict = test.evaluate(&geometry, &window(fault, 1e-4), &[0.0; 4]);
                assert_eq!(verdict, FaultVerdict::Faulty { rotor: rotor as u8 }, "{count} rotors");
                let baseline_removed = test.evaluate(&geometry, &window(fault, 1e-4), &fault);
                assert_eq!(baseline_removed, FaultVerdict::Healthy);
            }
        }
    }

    #[test]
    fn val_pattern_without_a_signature_is_unknown() {
        let geometry = Geometry::regular(6, 0.275, 0.016, 0.5).expect("regular");
        let test = TTest::new(&TTestConfig::paper(), 25).expect("in range");
        // A roll torque between two arms: every residual sees it.
        let verdict = test.evaluate(&geometry, &window([0.0, 0.02, 0.013, 0.0], 1e-4), &[0.0; 4]);
        assert_eq!(verdict, FaultVerdict::Unknown);
    }

    #[test]
    fn val_levels_outside_of_range_are_refused() {
        for alpha in [0.0, 1.0, f64::NAN] {
            let config = TTestConfig {
                alpha_detect: alpha,
                ..TTestConfig::paper()
            };
            assert!(TTest::new(&config, 25).is_none());
        }
        assert!(TTest::new(&TTestConfig::paper(), 1).is_none());
    }
}
