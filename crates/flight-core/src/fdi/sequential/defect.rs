//! Momentum defect: measured momentum minus what gravity, drag, gyroscopic terms and lagged nominal rotors account for.
//!
//! The per-sample part of the sequential detector. An open integral, unlike the observers of Eqs. 31–32: nothing leaks, so a lost
//! thrust appears as a constant slope and sensor noise as white noise, which is how the Kalman filters of [`super::axis_filter`] model
//! them. Once per block (half a window) the means are taken and all integrals restart from them, which keeps the numbers small
//! enough for `f32`.
//!
//! The integrals required by its error model (φ of [`super::axis_filter`]) are maintained the same way.
//!
//! Discretisation: drift by the trapezoidal rule (gravity and gyroscopic terms are known at both ends of a step), rotors exactly
//! (the duty is held over a step).

use crate::MAX_ROTORS;
use crate::fdi::residual::BodyMomentum;
use crate::geometry::Geometry;

pub(super) mod lanes;

/// Fz, Mx, My, Mz.
pub(super) const AXES: usize = 4;

/// Maximum number of consecutive spikes; after that the jump is accepted as real.
const MAX_SPIKES_IN_ROW: u32 = 4;

/// Integrals in addition to the defect: wrench (4), lag sensitivity (4), vertical speed, time, gyroscopic torque (3).
const REGRESSORS: usize = 13;
const SPEED: usize = 8;
const TIME: usize = 9;
const GYROSCOPIC: usize = 10;

/// Axes of the two momenta whose product makes the gyroscopic torque about each body axis.
const OTHER_AXES: [[usize; 2]; 3] = [[2, 3], [3, 1], [1, 2]];

/// Smallest noise variance of one sample, (N·s)²: 1e-7 N·s, rounding of `f32`.
const LEAST_NOISE_VARIANCE: f32 = 1e-14;

/// First-order lag of one axis and the derivative of its output with respect to ln τ.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lag {
    time_constant: f32,
    /// a = 1 − e^(−x), x = dt/τ.
    end_weight: f32,
    /// c = 1 − a/x.
    mean_weight: f32,
    /// ∂a/∂ln τ.
    end_slope: f32,
    /// ∂c/∂ln τ.
    mean_slope: f32,
    state: f32,
    /// ∂state/∂ln τ.
    sensitivity: f32,
}

impl Lag {
    const BLANK: Self = Self {
        time_constant: 0.0,
        end_weight: 0.0,
        mean_weight: 0.0,
        end_slope: 0.0,
        mean_slope: 0.0,
        state: 0.0,
        sensitivity: 0.0,
    };

    /// * `time_constant`: τ, s   * `period`: dt, s
    pub(super) fn new(time_constant: f32, period: f32) -> Self {
        let mut lag = Self::BLANK;
        lag.set_time_constant(time_constant, period);
        lag
    }

    fn set_time_constant(&mut self, time_constant: f32, period: f32) {
        let x = period / time_constant;
        let decay = libm::expf(-x);
        let a = -libm::expm1f(-x);
        self.time_constant = time_constant;
        self.end_weight = a;
        self.mean_weight = 1.0 - a / x;
        self.end_slope = -x * decay;
        self.mean_slope = (x * decay - a) / x;
    }

    /// Mean output over a step with the held input, and its derivative with respect to ln τ.
    #[inline(always)]
    pub(super) fn step(&mut self, input: f32) -> (f32, f32) {
        let gap = input - self.state;
        let mean = self.state + gap * self.mean_weight;
        let slope = self.sensitivity * (1.0 - self.mean_weight) + gap * self.mean_slope;
        self.state += gap * self.end_weight;
        self.sensitivity += gap * self.end_slope - self.sensitivity * self.end_weight;
        (mean, slope)
    }
}

/// Running integrals since the last block's mean, and their sums over this block.
#[derive(Clone, Copy, Debug)]
struct Integrals {
    value: [f32; REGRESSORS],
    sum: [f32; REGRESSORS],
}

/// Result of one block of samples. Axes are divided by their longest lever, see [`super::axis_filter`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    /// Number of samples in the means.
    pub samples: f32,
    /// Change of the mean momentum defect since the previous block, N·s.
    pub defect: [f32; AXES],
    /// Time between the middles of the two blocks, s.
    pub elapsed: f32,
    /// ∫ lagged wrench, the vertical one without the weight, N·s.
    pub wrench: [f32; AXES],
    /// ∫ sensitivity of the lagged wrench to ln τ, N·s.
    pub lag_slope: [f32; AXES],
    /// ∫ vertical speed, m.
    pub vertical_path: f32,
    /// ∫ √(J_b² + J_c²) ω_b ω_c of roll, pitch and yaw, N·s.
    pub gyroscopic: [f32; 3],
    /// Mean over the block of Σ (f̄_i − hover thrust)², lagged, N².
    pub excursion: f32,
    /// Mean static nominal thrust of every rotor, N.
    pub thrust: [f32; MAX_ROTORS],
}

/// See the module documentation.
#[derive(Clone, Copy, Debug)]
pub(super) struct DefectMeter {
    rotor_count: usize,
    period: f32,
    weight: f32,
    arm: [f32; AXES],
    inverse_arm: [f32; AXES],
    /// Columns of F.
    effectiveness: [[f32; AXES]; MAX_ROTORS],
    hover_thrust: [f32; MAX_ROTORS],
    time_constant_range: (f32, f32),
    /// √(J_b⁻² + J_c⁻²) over the lever: converts a product of momenta to a torque.
    gyroscopic_weight: [f32; 3],

    started: bool,
    /// Momentum that the model accounts for; the defect is measured momentum minus this.
    accounted: [f32; AXES],
    /// Rate held over the current step, for rejected samples.
    rate: [f32; AXES],
    last_drift: [f32; AXES],
    lag: [Lag; AXES],
    regressor_rate: [f32; REGRESSORS],
    integrals: Integrals,
    defect_sum: [f32; AXES],
    excursion: f32,
    excursion_sum: f32,
    thrust_sum: [f32; MAX_ROTORS],
    samples: f32,

    last_defect: [f32; AXES],
    spike_limit: [f32; AXES],
    spikes_in_row: u32,
    noise_count: f32,
    noise_sum: [f32; AXES],
    noise_square: [f32; AXES],
}

impl DefectMeter {
    pub(super) const BLANK: Self = Self {
        rotor_count: 0,
        period: 0.0,
        weight: 0.0,
        arm: [0.0; AXES],
        inverse_arm: [0.0; AXES],
        effectiveness: [[0.0; AXES]; MAX_ROTORS],
        hover_thrust: [0.0; MAX_ROTORS],
        time_constant_range: (0.0, 0.0),
        gyroscopic_weight: [0.0; 3],
        started: false,
        accounted: [0.0; AXES],
        rate: [0.0; AXES],
        last_drift: [0.0; AXES],
        lag: [Lag::BLANK; AXES],
        regressor_rate: [0.0; REGRESSORS],
        integrals: Integrals {
            value: [0.0; REGRESSORS],
            sum: [0.0; REGRESSORS],
        },
        defect_sum: [0.0; AXES],
        excursion: 0.0,
        excursion_sum: 0.0,
        thrust_sum: [0.0; MAX_ROTORS],
        samples: 0.0,
        last_defect: [0.0; AXES],
        spike_limit: [0.0; AXES],
        spikes_in_row: 0,
        noise_count: 0.0,
        noise_sum: [0.0; AXES],
        noise_square: [0.0; AXES],
    };

    /// * `weight`: m g, N   * `inertia_body`: diagonal of J, kg·m²   * `arm`: longest lever of each axis   * `hover_thrust`: of every rotor, N
    /// * `time_constant`: τ of the rotors, s   * `period`: dt, s
    pub(super) fn new(
        geometry: &Geometry,
        weight: f32,
        inertia_body: [f32; 3],
        arm: [f32; AXES],
        hover_thrust: [f32; MAX_ROTORS],
        time_constant: f32,
        period: f32,
    ) -> Self {
        let f = geometry.effectiveness();
        Self {
            rotor_count: geometry.rotor_count(),
            period,
            weight,
            arm,
            inverse_arm: arm.map(|a| 1.0 / a),
            effectiveness: core::array::from_fn(|i| core::array::from_fn(|axis| f[axis][i])),
            hover_thrust,
            time_constant_range: (0.25 * time_constant, 4.0 * time_constant),
            gyroscopic_weight: core::array::from_fn(|k| {
                let [b, c] = OTHER_AXES[k].map(|axis| 1.0 / inertia_body[axis - 1]);
                libm::sqrtf(b * b + c * c) / arm[k + 1]
            }),
            lag: [Lag::new(time_constant, period); AXES],
            spike_limit: [f32::INFINITY; AXES],
            ..Self::BLANK
        }
    }

    /// Processes one sample.
    ///
    /// * `static_wrench`, `static_thrust`: nominal, without lag, N and N·m   * `loss_fraction`: thrust that each rotor is known to
    ///   have lost   * `learn_noise`: count this sample in the noise statistics
    #[inline]
    pub(super) fn step(
        &mut self,
        body: &BodyMomentum,
        static_wrench: &[f32; AXES],
        static_thrust: &[f32; MAX_ROTORS],
        loss_fraction: &[f32; MAX_ROTORS],
        learn_noise: bool,
    ) {
        if !self.started {
            self.started = true;
            self.accounted = body.momentum;
            self.last_drift = body.drift;
            for axis in 0..AXES {
                self.lag[axis].state = static_wrench[axis];
            }
        }
        let used = self.rotor_count.min(MAX_ROTORS);
        self.take(
            body,
            static_wrench,
            &static_thrust[..used],
            &loss_fraction[..used],
            learn_noise,
        );
    }

    /// [`DefectMeter::step`] after the first sample, with exactly one thrust per rotor.
    #[inline(always)]
    fn take(
        &mut self,
        body: &BodyMomentum,
        static_wrench: &[f32; AXES],
        static_thrust: &[f32],
        loss_fraction: &[f32],
        learn_noise: bool,
    ) {
        let dt = self.period;
        // Complete the step before this sample: the drift was held, and its other end is now known.
        let mut defect = [0.0; AXES];
        let mut spike = false;
        for axis in 0..AXES {
            self.accounted[axis] += 0.5 * dt * (body.drift[axis] - self.last_drift[axis]);
            defect[axis] = (body.momentum[axis] - self.accounted[axis]) * self.inverse_arm[axis];
            spike |= (defect[axis] - self.last_defect[axis]).abs() > self.spike_limit[axis];
        }
        self.last_drift = body.drift;
        if spike && self.spikes_in_row < MAX_SPIKES_IN_ROW {
            self.spikes_in_row += 1;
        } else {
            self.spikes_in_row = 0;
            if learn_noise {
                self.noise_count += 1.0;
                for axis in 0..AXES {
                    let difference = defect[axis] - self.last_defect[axis];
                    self.noise_sum[axis] += difference;
                    self.noise_square[axis] += difference * difference;
                }
            }
            self.last_defect = defect;
            self.samples += 1.0;
            for axis in 0..AXES {
                self.defect_sum[axis] += defect[axis];
            }
            for k in 0..REGRESSORS {
                self.integrals.sum[k] += self.integrals.value[k];
            }
        }

        // Start the step after it.
        let mut wrench = *static_wrench;
        let mut excursion = 0.0;
        for i in 0..static_thrust.len() {
            let deviation = static_thrust[i] - self.hover_thrust[i];
            excursion += deviation * deviation;
            self.thrust_sum[i] += static_thrust[i];
            let lost = loss_fraction[i] * static_thrust[i];
            for axis in 0..AXES {
                wrench[axis] -= lost * self.effectiveness[i][axis];
            }
        }
        for axis in 0..AXES {
            let (mean, slope) = self.lag[axis].step(wrench[axis]);
            self.rate[axis] = body.drift[axis] + mean;
            self.regressor_rate[axis] = mean * self.inverse_arm[axis];
            self.regressor_rate[AXES + axis] = slope * self.inverse_arm[axis];
        }
        self.regressor_rate[0] += self.weight;
        self.regressor_rate[SPEED] = body.vertical_speed;
        self.regressor_rate[TIME] = 1.0;
        for k in 0..3 {
            let [b, c] = OTHER_AXES[k];
            self.regressor_rate[GYROSCOPIC + k] = self.gyroscopic_weight[k] * body.momentum[b] * body.momentum[c];
        }
        // The mean of a square is at least the square of the mean: an upper bound on the deviation of lagged rotors.
        self.excursion += (excursion - self.excursion) * self.lag[0].end_weight;
        self.excursion_sum += self.excursion;
        self.hold();
    }

    /// Advances by one step at the last rates, as for a rejected sample.
    #[inline(always)]
    pub(super) fn hold(&mut self) {
        for axis in 0..AXES {
            self.accounted[axis] += self.period * self.rate[axis];
        }
        for k in 0..REGRESSORS {
            self.integrals.value[k] += self.period * self.regressor_rate[k];
        }
    }

    /// Means since the last block; None if there was no usable sample, in which case the block continues.
    pub(super) fn close_block(&mut self) -> Option<Block> {
        if self.samples < 1.0 {
            return None;
        }
        let share = 1.0 / self.samples;
        let mut regressor = [0.0; REGRESSORS];
        for k in 0..REGRESSORS {
            regressor[k] = self.integrals.sum[k] * share;
            self.integrals.value[k] -= regressor[k];
            self.integrals.sum[k] = 0.0;
        }
        let mut defect = [0.0; AXES];
        for axis in 0..AXES {
            defect[axis] = self.defect_sum[axis] * share;
            self.defect_sum[axis] = 0.0;
            self.last_defect[axis] -= defect[axis];
            self.accounted[axis] += defect[axis] * self.arm[axis];
        }
        let block = Block {
            samples: self.samples,
            defect,
            elapsed: regressor[TIME],
            wrench: core::array::from_fn(|axis| regressor[axis]),
            lag_slope: core::array::from_fn(|axis| regressor[AXES + axis]),
            vertical_path: regressor[SPEED],
            gyroscopic: core::array::from_fn(|k| regressor[GYROSCOPIC + k]),
            excursion: self.excursion_sum * share,
            thrust: self.thrust_sum.map(|sum| sum * share),
        };
        self.excursion_sum = 0.0;
        self.thrust_sum = [0.0; MAX_ROTORS];
        self.samples = 0.0;
        Some(block)
    }

    /// Variance of the white noise of one sample, (N·s)², from the differences of neighbouring samples; None without samples.
    pub(super) fn noise_variance(&self) -> Option<[f32; AXES]> {
        if self.noise_count < 1.0 {
            return None;
        }
        let n = self.noise_count;
        Some(core::array::from_fn(|axis| {
            let mean = self.noise_sum[axis] / n;
            (0.5 * (self.noise_square[axis] / n - mean * mean)).max(LEAST_NOISE_VARIANCE)
        }))
    }

    /// Sets the limit, N·s: a sample whose defect differs from the previous one by more is a spike.
    pub(super) fn set_spike_limit(&mut self, limit: [f32; AXES]) {
        self.spike_limit = limit;
    }

    /// Scales τ of one axis by e^shift, and updates the lag's state and what it accounted for since the last block's mean.
    pub(super) fn shift_time_constant(&mut self, axis: usize, shift: f32) {
        let (least, most) = self.time_constant_range;
        self.accounted[axis] += self.integrals.value[AXES + axis] * shift * self.arm[axis];
        let lag = &mut self.lag[axis];
        lag.state += lag.sensitivity * shift;
        let time_constant = super::limited(lag.time_constant * libm::expf(shift), least, most);
        lag.set_time_constant(time_constant, self.period);
    }

    /// Removes a wrench from the rotors as if it had been missing since the last block's mean, N and N·m: a fault that settled long ago
    /// becomes known.
    pub(super) fn remove_wrench(&mut self, wrench: &[f32; AXES]) {
        for axis in 0..AXES {
            self.lag[axis].state -= wrench[axis];
            self.accounted[axis] -= wrench[axis] * self.integrals.value[TIME];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fdi::test_vectors;

    const PERIOD: f32 = 0.0025;
    const INERTIA: [f32; 3] = [0.0266, 0.0266, 0.0498];

    #[test]
    fn val_lag_sensitivity_is_the_derivative() {
        // Central difference in ln τ over an input with steps and ramps.
        let h = 1e-2;
        let mut lag = Lag::new(0.05, PERIOD);
        let mut above = Lag::new(0.05 * libm::expf(h), PERIOD);
        let mut below = Lag::new(0.05 * libm::expf(-h), PERIOD);
        for k in 0..400u16 {
            let input = if k % 100 < 50 { 1.0 } else { 0.0 } + f32::from(k) / 400.0;
            let (_, slope) = lag.step(input);
            let difference = (above.step(input).0 - below.step(input).0) / (2.0 * h);
            // h²/6 times the third derivative, and f32 rounding over 2 h.
            assert!((slope - difference).abs() < 2e-4, "{k}: {slope} {difference}");
        }
    }

    fn meter() -> DefectMeter {
        let geometry = test_vectors::hexa_x();
        let mut hover = [0.0; MAX_ROTORS];
        hover[..6].fill(1.55 * 9.81 / 6.0);
        DefectMeter::new(
            &geometry,
            1.55 * 9.81,
            INERTIA,
            [1.0, 0.275, 0.238, 0.016],
            hover,
            0.05,
            PERIOD,
        )
    }

    fn hover() -> ([f32; AXES], [f32; MAX_ROTORS], BodyMomentum) {
        let mut thrust = [0.0; MAX_ROTORS];
        thrust[..6].fill(1.55 * 9.81 / 6.0);
        let wrench = test_vectors::hexa_x().wrench_from_thrust(&thrust);
        let body = BodyMomentum {
            drift: wrench.map(|w| -w),
            ..BodyMomentum::default()
        };
        (wrench, thrust, body)
    }

    #[test]
    fn val_constant_force_is_a_constant_slope() {
        let mut meter = meter();
        let (wrench, thrust, mut body) = hover();
        let mut last = None;
        for k in 1..=500u16 {
            meter.step(&body, &wrench, &thrust, &[0.0; MAX_ROTORS], false);
            // 0.02 N·m of roll: 0.0727 N at the lever.
            body.momentum[1] += PERIOD * 0.02;
            if k % 25 == 0 {
                last = meter.close_block();
            }
        }
        let block = last.expect("samples");
        assert!((block.elapsed - 25.0 * PERIOD).abs() < 1e-6);
        assert!((block.defect[1] / block.elapsed - 0.02 / 0.275).abs() < 1e-5);
        assert!(block.defect[0].abs() < 1e-6 && block.excursion < 1e-9);
        assert!((block.thrust[0] - thrust[0]).abs() < 1e-5);
    }

    #[test]
    fn val_wrong_inertia_leaves_its_share_of_the_gyroscopic_integral() {
        // Roll 5 % above and pitch 3 % below the document, at a steady 0.8 and 0.5 rad/s: yaw accelerates according to Euler's equations.
        let (error_x, error_y) = (0.05f32, -0.03f32);
        let (p, q) = (0.8, 0.5);
        let mut meter = meter();
        let (wrench, thrust, mut body) = hover();
        body.momentum = [0.0, INERTIA[0] * p, INERTIA[1] * q, 0.0];
        let mut last = None;
        for k in 1..=200u16 {
            meter.step(&body, &wrench, &thrust, &[0.0; MAX_ROTORS], false);
            body.momentum[3] += PERIOD * (INERTIA[0] * (1.0 + error_x) - INERTIA[1] * (1.0 + error_y)) * p * q;
            if k % 25 == 0 {
                last = meter.close_block();
            }
        }
        let block = last.expect("samples");
        let share = (error_x * INERTIA[0] - error_y * INERTIA[1]) / libm::hypotf(INERTIA[0], INERTIA[1]);
        assert!((block.defect[3] / block.gyroscopic[2] / share - 1.0).abs() < 1e-3);
        let rate = libm::hypotf(INERTIA[0], INERTIA[1]) * p * q / 0.016;
        assert!((block.gyroscopic[2] / (rate * block.elapsed) - 1.0).abs() < 1e-3);
        // Without a yaw rate the product vanishes for the other two axes; r stays below 0.01 rad/s here.
        assert!(block.gyroscopic[0].abs() < 0.02 * block.gyroscopic[2]);
    }

    #[test]
    fn val_spikes_and_gaps_do_not_show() {
        let mut meter = meter();
        meter.set_spike_limit([0.01; AXES]);
        let (wrench, thrust, mut body) = hover();
        for k in 0..200u16 {
            let clean = body.momentum;
            if k % 7 == 3 {
                body.momentum[1] += 1.0;
            }
            if k % 11 == 5 {
                meter.hold();
            } else {
                meter.step(&body, &wrench, &thrust, &[0.0; MAX_ROTORS], false);
            }
            body.momentum = clean;
            body.momentum[1] += PERIOD * 0.02;
        }
        let first = meter.close_block().expect("samples");
        assert!(first.samples > 120.0);
        let slope = first.defect[1] / first.elapsed;
        assert!((slope - 0.02 / 0.275).abs() < 1e-3, "{slope}");
    }

    #[test]
    fn val_noise_is_measured_without_the_slope() {
        let mut meter = meter();
        let (wrench, thrust, mut body) = hover();
        for k in 0..1000u16 {
            body.momentum[1] = PERIOD * f32::from(k) * 0.3 + if k % 2 == 0 { 1e-3 } else { -1e-3 };
            meter.step(&body, &wrench, &thrust, &[0.0; MAX_ROTORS], k > 0);
        }
        // Alternating ±a: differences of ±2a, half their mean square is 2a².
        let got = meter.noise_variance().expect("samples")[1];
        let want = 2.0 * (1e-3f32 / 0.275) * (1e-3 / 0.275);
        assert!((got / want - 1.0).abs() < 1e-2, "{got} {want}");
    }
}
