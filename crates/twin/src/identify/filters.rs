//! Band-pass filters without phase: second-order Butterworth sections, forwards and backwards.

use std::f64::consts::{PI, SQRT_2};

#[derive(Clone, Copy)]
struct Biquad {
    b: [f64; 3],
    a: [f64; 2],
}

impl Biquad {
    fn low_pass(corner_hz: f64, step_s: f64) -> Self {
        let k = (PI * corner_hz * step_s).tan();
        let norm = 1.0 / (1.0 + SQRT_2 * k + k * k);
        let b0 = k * k * norm;
        Self {
            b: [b0, 2.0 * b0, b0],
            a: [2.0 * (k * k - 1.0) * norm, (1.0 - SQRT_2 * k + k * k) * norm],
        }
    }

    fn high_pass(corner_hz: f64, step_s: f64) -> Self {
        let k = (PI * corner_hz * step_s).tan();
        let norm = 1.0 / (1.0 + SQRT_2 * k + k * k);
        Self {
            b: [norm, -2.0 * norm, norm],
            a: [2.0 * (k * k - 1.0) * norm, (1.0 - SQRT_2 * k + k * k) * norm],
        }
    }

    /// In place, from the state that a constant first value has settled in.
    fn run(&self, values: &mut [f64]) {
        let Some(&first) = values.first() else { return };
        let gain = self.b.iter().sum::<f64>() / (1.0 + self.a[0] + self.a[1]);
        let settled = first * gain;
        let mut z2 = self.b[2] * first - self.a[1] * settled;
        let mut z1 = self.b[1] * first - self.a[0] * settled + z2;
        for value in values {
            let x = *value;
            let y = self.b[0] * x + z1;
            z1 = self.b[1] * x - self.a[0] * y + z2;
            z2 = self.b[2] * x - self.a[1] * y;
            *value = y;
        }
    }

    fn both_ways(&self, values: &mut [f64]) {
        self.run(values);
        values.reverse();
        self.run(values);
        values.reverse();
    }
}

/// What a second-order Butterworth low-pass, as of an autopilot's sensor, leaves of a signal that it has settled on at
/// its first row; nothing is changed where the rows are too slow for the corner to matter.
pub(crate) fn through_low_pass(values: &mut [f64], corner_hz: f64, step_s: f64) {
    if corner_hz < 0.45 / step_s {
        Biquad::low_pass(corner_hz, step_s).run(values);
    }
}

/// A band, Hz; `low` 0: no high-pass.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, utoipa::ToSchema)]
#[schema(as = FrequencyBand)]
pub struct Band {
    /// Hz.
    pub low_hz: f64,
    /// Hz.
    pub high_hz: f64,
}

impl Band {
    /// What is in the band; corners of −6 dB (both ways).
    pub(crate) fn pass(&self, values: &[f64], step_s: f64) -> Vec<f64> {
        let mut out = values.to_vec();
        if self.high_hz < 0.45 / step_s {
            Biquad::low_pass(self.high_hz, step_s).both_ways(&mut out);
        }
        if self.low_hz > 0.0 {
            Biquad::high_pass(self.low_hz, step_s).both_ways(&mut out);
        }
        out
    }

    /// Rows at either end where the filter has not settled.
    pub(crate) fn settling(&self, step_s: f64) -> usize {
        let slow = if self.low_hz > 0.0 { self.low_hz } else { self.high_hz };
        (0.5 / slow / step_s).ceil() as usize
    }

    /// Where roll and pitch accelerations are compared, by sample rate; `fast`: logged at 600 Hz or more.
    pub(crate) fn of_torque(step_s: f64, fast: bool) -> Self {
        let rate = 1.0 / step_s;
        let (low_hz, high_hz) = if fast {
            (2.0, 40.0)
        } else if rate > 120.0 {
            (1.5, 10.0)
        } else {
            (1.0, (0.2 * rate).min(5.0))
        };
        Self { low_hz, high_hz }
    }

    /// Where yaw accelerations are.
    pub(crate) fn of_yaw(step_s: f64, fast: bool) -> Self {
        if fast {
            return Self::of_torque(step_s, fast);
        }
        Self {
            low_hz: 0.5,
            high_hz: 4.0_f64.min(0.2 / step_s),
        }
    }

    /// Where the vertical specific force is, drift included.
    pub(crate) fn of_lift(step_s: f64, fast: bool) -> Self {
        let rate = 1.0 / step_s;
        let high_hz = if fast { 25.0 } else { (0.1 * rate).min(4.0) };
        Self { low_hz: 0.0, high_hz }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_sine_in_the_band_stays_and_one_outside_goes() {
        let step = 0.005;
        let band = Band {
            low_hz: 1.5,
            high_hz: 10.0,
        };
        let gain = |hz: f64| {
            let sine: Vec<f64> = (0..4000).map(|k| (2.0 * PI * hz * f64::from(k) * step).sin()).collect();
            let out = band.pass(&sine, step);
            let power = |v: &[f64]| v[500..3500].iter().map(|x| x * x).sum::<f64>();
            (power(&out) / power(&sine)).sqrt()
        };
        assert!((gain(4.0) - 1.0).abs() < 0.05, "{}", gain(4.0));
        assert!(gain(0.2) < 0.01 && gain(60.0) < 0.01);
    }
}
