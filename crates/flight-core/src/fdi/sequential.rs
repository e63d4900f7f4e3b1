//! Sequential detector: decides over time, learns the disturbances of its own flight, estimates the lost thrust.
//!
//! placeholder docs
use super::FaultVerdict;
use super::residual::BodyMomentum;
use crate::MAX_ROTORS;
use crate::geometry::Geometry;

/// Wrench axes.
const AXES: usize = 4;
/// States of one axis filter.
const STATES: usize = 6;
/// Disturbance levels tried during the calibration.
const LEVELS: usize = 10;
/// Onset candidates.
const CANDIDATES: usize = 20;
/// Blocks until a step fault has settled through the rotor lag.
const ONSET_BLOCKS: usize = 16;

const D: usize = 0;
const W: usize = 1;
const B: usize = 2;
const TAU: usize = 5;

/// Parameters of the sequential detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SequentialConfig {
    /// s.
    pub calibration_start: f32,
    /// s.
    pub calibration_end: f32,
    /// Filter updates per decision window.
    pub updates_per_window: u8,
    /// s.
    pub rotor_time_constant: f32,
    /// of ln tau.
    pub rotor_time_constant_spread: f32,
    /// relative.
    pub gain_spread: f32,
    /// m.
    pub centre_of_mass_spread: f32,
    /// N s/m.
    pub drag_spread: f32,
    /// N per rotor.
    pub bias_spread: f32,
    /// s.
    pub disturbance_correlation_time: f32,
    /// N at a rotor.
    pub disturbance_floor: f32,
    /// N at a rotor.
    pub disturbance_ceiling: f32,
    /// nats.
    pub evidence_to_isolate: f32,
    /// nats.
    pub margin_to_isolate: f32,
    /// nats.
    pub prior_log_odds: f32,
    /// N.
    pub smallest_loss: f32,
    /// s.
    pub settling_time: f32,
    /// Smallest relative spread.
    pub rotor_gain_spread: f32,
    /// x
    pub excursion_in_calibration: f32,
    /// x
    pub bias_factor: f32,
    /// x
    pub level_margin: f32,
    /// nats
    pub repeat_bonus: f32,
    /// nats
    pub evidence_to_absorb: f32,
    /// x
    pub momentum_noise_share: f32,
    /// 1/s
    pub drift_share: f32,
    /// x
    pub level_gain: f32,
    /// x
    pub level_clip: f32,
    /// x
    pub level_ratio: f32,
    /// x
    pub surprise_weight: f32,
}

impl SequentialConfig {
    /// One tuning.
    pub const fn standard() -> Self {
        Self {
            calibration_start: 2.0,
            calibration_end: 10.0,
            updates_per_window: 2,
            rotor_time_constant: 0.05,
            rotor_time_constant_spread: 0.15,
            gain_spread: 0.05,
            centre_of_mass_spread: 0.004,
            drag_spread: 0.1,
            bias_spread: 0.5,
            disturbance_correlation_time: 2.0,
            disturbance_floor: 0.0005,
            disturbance_ceiling: 1.5,
            evidence_to_isolate: 25.0,
            margin_to_isolate: 6.0,
            prior_log_odds: 12.0,
            smallest_loss: 0.003,
            settling_time: 1.5,
            rotor_gain_spread: 0.003,
            excursion_in_calibration: 0.001,
            bias_factor: 1.0,
            level_margin: 4.0,
            repeat_bonus: 10.0,
            evidence_to_absorb: 45.0,
            momentum_noise_share: 0.02,
            drift_share: 0.02,
            level_gain: 0.036,
            level_clip: 1.5,
            level_ratio: 4.0,
            surprise_weight: 0.05,
        }
    }
}

/// Why a sequential configuration is refused: the field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SequentialConfigError {
    /// Field of [`SequentialConfig`].
    pub field: &'static str,
}

/// One axis: x = (D, w, b, own, second, tau).
#[derive(Clone, Copy, Debug, Default)]
struct AxisFilter {
    x: [f32; STATES],
    p: [[f32; STATES]; STATES],
}

/// Result of one update.
#[derive(Clone, Copy, Debug, Default)]
struct Innovation {
    /// e.
    value: f32,
    /// 1/S.
    information: f32,
    evidence: f32,
    gain: [f32; STATES],
}

/// What a prediction needs to know about the disturbance.
#[derive(Clone, Copy, Debug, Default)]
struct Disturbance {
    /// exp(-T/T_w).
    correlation: f32,
    /// Stationary variance of w.
    variance: f32,
    /// Added to D per block.
    momentum_noise: f32,
    /// Added to b per block.
    drift: f32,
    /// Measurement variance.
    measurement: f32,
}

impl AxisFilter {
    fn new(variance: [f32; STATES]) -> Self {
        let mut p = [[0.0; STATES]; STATES];
        for i in 0..STATES {
            p[i][i] = variance[i];
        }
        Self {
            x: [0.0; STATES],
            p,
        }
    }

    /// D += phi x, w decays.
    #[inline]
    fn predict(&mut self, phi: &[f32; STATES], d: &Disturbance) {
        let mut p_phi = [0.0; STATES];
        for i in 0..STATES {
            for j in 1..STATES {
                p_phi[i] += self.p[i][j] * phi[j];
            }
        }
        let mut quadratic = 0.0;
        let mut step = 0.0;
        for j in 1..STATES {
            quadratic += phi[j] * p_phi[j];
            step += phi[j] * self.x[j];
        }
        self.x[D] += step;
        let second_order = 0.5 * phi[TAU] * self.p[TAU][TAU];
        self.p[D][D] += 2.0 * p_phi[D] + quadratic + d.momentum_noise + second_order * second_order;
        for j in 1..STATES {
            self.p[D][j] += p_phi[j];
        }
        let rho = d.correlation;
        self.x[W] *= rho;
        for j in 0..STATES {
            if j != W {
                self.p[j][W] = self.p[j.min(W)][j.max(W)] * rho;
                self.p[W][j] = self.p[j][W];
            }
        }
        self.p[W][W] = rho * rho * self.p[W][W] + (1.0 - rho * rho) * d.variance;
        self.p[B][B] += d.drift;
        for j in 1..STATES {
            self.p[j][D] = self.p[D][j];
        }
    }

    /// Measures D.
    #[inline]
    fn update(&mut self, measured: f32, variance: f32) -> Innovation {
        let information = 1.0 / (self.p[D][D] + variance);
        let value = measured - self.x[D];
        let mut gain = [0.0; STATES];
        let row = self.p[D];
        for i in 0..STATES {
            gain[i] = row[i] * information;
            self.x[i] += gain[i] * value;
        }
        for i in 0..STATES {
            for j in i..STATES {
                let v = self.p[i][j] - gain[i] * row[j];
                self.p[i][j] = v;
                self.p[j][i] = v;
            }
        }
        Innovation {
            value,
            information,
            evidence: information,
            gain,
        }
    }
}

/// Filter of (D, w, b) alone at another disturbance level.
#[derive(Clone, Copy, Debug, Default)]
struct Shadow {
    x: [f32; 3],
    /// DD, Dw, Db, ww, wb, bb.
    p: [f32; 6],
}

impl Shadow {
    fn from_filter(filter: &AxisFilter) -> Self {
        let p = &filter.p;
        Self {
            x: [filter.x[D], filter.x[W], filter.x[B]],
            p: [p[D][D], p[D][W], p[D][B], p[W][W], p[W][B], p[B][B]],
        }
    }

    /// Log likelihood of the measured D.
    #[inline]
    fn step(&mut self, t: f32, known: f32, d: &Disturbance, measured: f32) -> f32 {
        let [dd, dw, db, ww, wb, bb] = self.p;
        let [x_d, x_w, x_b] = self.x;
        let x_d = x_d + t * (x_w + x_b) + known;
        let to_w = ww + wb;
        let to_b = wb + bb;
        let dd = dd + 2.0 * t * (dw + db) + t * t * (to_w + to_b) + d.momentum_noise;
        let rho = d.correlation;
        let dw = rho * (dw + t * to_w);
        let db = db + t * to_b;
        let ww = rho * rho * ww + (1.0 - rho * rho) * d.variance;
        let wb = rho * wb;
        let bb = bb + d.drift;
        let information = 1.0 / (dd + d.measurement);
        let e = measured - x_d;
        let (k_d, k_w, k_b) = (dd * information, dw * information, db * information);
        self.x = [
            x_d + k_d * e - measured,
            rho * x_w + k_w * e,
            x_b + k_b * e,
        ];
        self.p = [
            dd - k_d * dd,
            dw - k_d * dw,
            db - k_d * db,
            ww - k_w * dw,
            wb - k_w * db,
            bb - k_b * db,
        ];
        0.5 * (libm::logf(information) - e * e * information)
    }
}

/// Hypothesis "something changed at this block", for all rotors and sizes at once.
#[derive(Clone, Copy, Debug, Default)]
struct Candidate {
    /// Block in which the change starts.
    onset: u32,
    /// Error of each axis filter per unit of lost wrench.
    error: [[f32; STATES]; AXES],
    score: [f32; AXES],
    information: [f32; AXES],
}

/// First-order lag of one axis with its sensitivity to ln tau.
#[derive(Clone, Copy, Debug, Default)]
struct Lag {
    time_constant: f32,
    end_weight: f32,
    mean_weight: f32,
    end_slope: f32,
    mean_slope: f32,
    state: f32,
    sensitivity: f32,
}

impl Lag {
    fn set_time_constant(&mut self, tau: f32, period: f32) {
        let x = period / tau;
        let decay = libm::expf(-x);
        let a = -libm::expm1f(-x);
        self.time_constant = tau;
        self.end_weight = a;
        self.mean_weight = 1.0 - a / x;
        self.end_slope = -x * decay;
        self.mean_slope = (x * decay - a) / x;
    }

    /// Mean output and its derivative with respect to ln tau.
    #[inline]
    fn step(&mut self, input: f32) -> (f32, f32) {
        let gap = input - self.state;
        let mean = self.state + gap * self.mean_weight;
        let slope = self.sensitivity * (1.0 - self.mean_weight) + gap * self.mean_slope;
        self.state += gap * self.end_weight;
        self.sensitivity += gap * self.end_slope - self.sensitivity * self.end_weight;
        (mean, slope)
    }
}

/// Integral from the last block's mean, and its sum over the present block.
#[derive(Clone, Copy, Debug)]
struct Integral<const N: usize> {
    value: [f32; N],
    sum: [f32; N],
}

impl<const N: usize> Integral<N> {
    const ZERO: Self = Self {
        value: [0.0; N],
        sum: [0.0; N],
    };

    #[inline]
    fn accumulate(&mut self) {
        for i in 0..N {
            self.sum[i] += self.value[i];
        }
    }
    #[inline]
    fn advance(&mut self, rate: &[f32; N], period: f32) {
        for i in 0..N {
            self.value[i] += period * rate[i];
        }
    }
    /// Mean over the block; the next block counts from it.
    #[inline]
    fn close(&mut self, inverse_count: f32) -> [f32; N] {
        let mut mean = [0.0; N];
        for i in 0..N {
            mean[i] = self.sum[i] * inverse_count;
            self.value[i] -= mean[i];
            self.sum[i] = 0.0;
        }
        mean
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Sensor noise is measured.
    Warmup,
    /// The bank of disturbance levels runs.
    Calibration,
    /// Decisions.
    Watch,
}

/// See the module.
#[derive(Clone, Copy, Debug)]
pub struct SequentialDetector {
    config: SequentialConfig,
    rotor_count: usize,
    period: f32,
    block_period: f32,
    weight: f32,
    /// Columns of F over `arm`, per rotor.
    column: [[f32; AXES]; MAX_ROTORS],
    effectiveness: [[f32; AXES]; MAX_ROTORS],
    arm: [f32; AXES],
    inverse_arm: [f32; AXES],
    hover_thrust: [f32; MAX_ROTORS],
    onset_step: [f32; ONSET_BLOCKS],
    warmup_samples: u32,
    calibration_samples: u32,
    noise_from: u32,
    settling_blocks: u32,

    phase: Phase,
    samples: u32,
    block: u32,
    block_samples: u16,
    started: bool,
    lag: [Lag; AXES],
    predicted: [f32; AXES],
    last_drift: [f32; AXES],
    last_defect: [f32; AXES],
    difference_sum: [f32; AXES],
    difference_square: [f32; AXES],
    difference_count: f32,
    rates: [f32; 10],
    defect_sum: [f32; AXES],
    /// Lagged sum over the rotors of the squared deviation from hover thrust, N^2, and its block sum.
    excursion: f32,
    excursion_sum: f32,
    /// Squared relative uncertainty of one rotor's gain.
    rotor_gain_variance: f32,
    /// Mean over rotors of the squared column entry.
    column_square: [f32; AXES],
    regressors: Integral<10>,
    filter: [AxisFilter; AXES],
    disturbance: [Disturbance; AXES],
    shadow: [[Shadow; 2]; AXES],
    /// Mean of the clipped normalised innovations.
    surprise: [f32; AXES],
    bank: [[AxisFilter; LEVELS]; AXES],
    bank_level: [[Disturbance; LEVELS]; AXES],
    bank_score: [[f32; LEVELS]; AXES],
    candidate: [Candidate; CANDIDATES],
    candidate_count: usize,
    /// Onset of the leading candidate, never dropped.
    leading_onset: u32,
    pending: bool,
    loss_fraction: [f32; MAX_ROTORS],
    verdict: FaultVerdict,
    probability: f32,
    thrust_loss: f32,
    /// diagnostics
    pub diag: [f32; 16],
}

impl SequentialDetector {
    /// New.
    pub fn new(
        config: &SequentialConfig,
        geometry: &Geometry,
        mass: f32,
        gravity: f32,
        period: f32,
        window_len: u16,
    ) -> Self {
        let n = geometry.rotor_count();
        let f = geometry.effectiveness();
        let mut arm = [0.0f32; AXES];
        for axis in 0..AXES {
            for i in 0..n {
                arm[axis] = arm[axis].max(f[axis][i].abs());
            }
        }
        let mut column = [[0.0; AXES]; MAX_ROTORS];
        let mut effectiveness = [[0.0; AXES]; MAX_ROTORS];
        for i in 0..n {
            for axis in 0..AXES {
                effectiveness[i][axis] = f[axis][i];
                column[i][axis] = f[axis][i] / arm[axis];
            }
        }
        let mut column_square = [0.0; AXES];
        for i in 0..n {
            for axis in 0..AXES {
                column_square[axis] += column[i][axis] * column[i][axis] / n as f32;
            }
        }
        let block_period = period * f32::from(window_len) / f32::from(config.updates_per_window);
        // Mean over block r of the momentum that a lagged unit step loses.
        let t_block = f64::from(block_period);
        let tau = f64::from(config.rotor_time_constant);
        let mean = |r: usize| {
            let (t0, t1) = (r as f64 * t_block, (r as f64 + 1.0) * t_block);
            0.5 * (t0 + t1) - tau
                + tau * tau / t_block * (libm::exp(-t0 / tau) - libm::exp(-t1 / tau))
        };
        let mut onset_step = [0.0; ONSET_BLOCKS];
        for r in 0..ONSET_BLOCKS {
            let before = if r == 0 { 0.0 } else { mean(r - 1) };
            onset_step[r] = (mean(r) - before) as f32;
        }
        let mut lag = [Lag::default(); AXES];
        for l in &mut lag {
            l.set_time_constant(config.rotor_time_constant, period);
        }
        Self {
            config: *config,
            rotor_count: n,
            period,
            block_period,
            weight: mass * gravity,
            column,
            effectiveness,
            arm,
            inverse_arm: arm.map(|a| 1.0 / a),
            hover_thrust: geometry.allocate([-mass * gravity, 0.0, 0.0, 0.0]).map(|t| t.max(0.05)),
            onset_step,
            warmup_samples: libm::roundf(config.calibration_start / period) as u32,
            calibration_samples: libm::roundf(config.calibration_end / period) as u32,
            noise_from: libm::roundf(0.25 * config.calibration_start / period) as u32,
            settling_blocks: libm::roundf(config.settling_time / block_period) as u32,
            phase: Phase::Warmup,
            samples: 0,
            block: 0,
            block_samples: 0,
            started: false,
            lag,
            predicted: [0.0; AXES],
            last_drift: [0.0; AXES],
            last_defect: [0.0; AXES],
            difference_sum: [0.0; AXES],
            difference_square: [0.0; AXES],
            difference_count: 0.0,
            rates: [0.0; 10],
            defect_sum: [0.0; AXES],
            excursion: 0.0,
            excursion_sum: 0.0,
            rotor_gain_variance: config.rotor_gain_spread * config.rotor_gain_spread,
            column_square,
            regressors: Integral::ZERO,
            filter: [AxisFilter::default(); AXES],
            disturbance: [Disturbance::default(); AXES],
            shadow: [[Shadow::default(); 2]; AXES],
            surprise: [1.0; AXES],
            bank: [[AxisFilter::default(); LEVELS]; AXES],
            bank_level: [[Disturbance::default(); LEVELS]; AXES],
            bank_score: [[0.0; LEVELS]; AXES],
            candidate: [Candidate::default(); CANDIDATES],
            candidate_count: 0,
            leading_onset: 0,
            pending: false,
            loss_fraction: [0.0; MAX_ROTORS],
            verdict: FaultVerdict::NotReady,
            probability: 0.0,
            thrust_loss: 0.0,
            diag: [0.0; 16],
        }
    }

    /// Verdict, its probability, lost thrust (N).
    #[inline]
    pub const fn output(&self) -> (FaultVerdict, f32, f32) {
        (self.verdict, self.probability, self.thrust_loss)
    }

    /// One sample. `last_of_block`, `last_of_window` say where it stands.
    #[inline]
    pub fn step(
        &mut self,
        body: &BodyMomentum,
        static_wrench: &[f32; AXES],
        static_thrust: &[f32; MAX_ROTORS],
    ) {
        let dt = self.period;
        if !self.started {
            self.started = true;
            self.predicted = body.momentum;
            self.last_drift = body.drift;
            for axis in 0..AXES {
                self.lag[axis].state = static_wrench[axis];
            }
        }
        // From the last sample to this one: rotors as predicted then, drift by the trapezoid.
        for axis in 0..AXES {
            self.predicted[axis] += 0.5 * dt * (body.drift[axis] - self.last_drift[axis]);
            let defect = (body.momentum[axis] - self.predicted[axis]) * self.inverse_arm[axis];
            self.defect_sum[axis] += defect;
            let difference = defect - self.last_defect[axis];
            self.last_defect[axis] = defect;
            if self.samples >= self.noise_from {
                self.difference_sum[axis] += difference;
                self.difference_square[axis] += difference * difference;
            }
        }
        if self.samples >= self.noise_from {
            self.difference_count += 1.0;
        }
        self.regressors.accumulate();

        // To the next sample.
        let mut wrench = *static_wrench;
        for i in 0..self.rotor_count {
            if self.loss_fraction[i] > 0.0 {
                let lost = self.loss_fraction[i] * static_thrust[i];
                for axis in 0..AXES {
                    wrench[axis] -= lost * self.effectiveness[i][axis];
                }
            }
        }
        for axis in 0..AXES {
            let (mean, slope) = self.lag[axis].step(wrench[axis]);
            let rate = body.drift[axis] + mean;
            self.predicted[axis] += dt * rate;
            self.rates[axis] = mean * self.inverse_arm[axis];
            self.rates[4 + axis] = slope * self.inverse_arm[axis];
        }
        let mut excursion = 0.0;
        for i in 0..self.rotor_count {
            let deviation = static_thrust[i] - self.hover_thrust[i];
            excursion += deviation * deviation;
        }
        self.excursion += (excursion - self.excursion) * self.lag[0].end_weight;
        self.excursion_sum += self.excursion;
        self.rates[0] += self.weight;
        self.rates[8] = body.vertical_speed;
        self.rates[9] = 1.0;
        self.last_drift = body.drift;
        self.regressors.advance(&self.rates, dt);
        self.samples += 1;
        self.block_samples += 1;
    }

    /// After the last sample of a block.
    pub fn close_block(&mut self) {
        let count = f32::from(self.block_samples);
        let inverse_count = 1.0 / count;
        self.block_samples = 0;
        let phi_all = self.regressors.close(inverse_count);
        let mut defect = [0.0; AXES];
        for axis in 0..AXES {
            defect[axis] = self.defect_sum[axis] * inverse_count;
            self.defect_sum[axis] = 0.0;
            self.predicted[axis] += defect[axis] * self.arm[axis];
            self.last_defect[axis] -= defect[axis];
        }
        let t = phi_all[9];
        let excursion = self.excursion_sum * inverse_count * t * t;
        self.excursion_sum = 0.0;
        let phi = |axis: usize| {
            [
                0.0,
                t,
                t,
                phi_all[axis],
                if axis == 0 {
                    phi_all[8]
                } else {
                    phi_all[0] * self.inverse_arm[axis]
                },
                phi_all[4 + axis],
            ]
        };
        match self.phase {
            Phase::Warmup => {
                if self.samples >= self.warmup_samples {
                    self.start_calibration(count);
                }
            }
            Phase::Calibration => {
                for axis in 0..AXES {
                    let phi = phi(axis);
                    for level in 0..LEVELS {
                        let mut d = self.bank_level[axis][level];
                        d.momentum_noise +=
                            self.config.excursion_in_calibration * excursion * self.column_square[axis];
                        let filter = &mut self.bank[axis][level];
                        filter.predict(&phi, &d);
                        let innovation = filter.update(defect[axis], d.measurement);
                        filter.x[D] -= defect[axis];
                        self.bank_score[axis][level] += 0.5
                            * (libm::logf(innovation.information)
                                - innovation.value * innovation.value * innovation.information);
                    }
                }
                if self.samples >= self.calibration_samples {
                    self.finish_calibration();
                }
            }
            Phase::Watch => {
                let mut innovation = [Innovation::default(); AXES];
                let mut phis = [[0.0; STATES]; AXES];
                for axis in 0..AXES {
                    let phi = phi(axis);
                    phis[axis] = phi;
                    let mut d = self.disturbance[axis];
                    d.momentum_noise +=
                        self.rotor_gain_variance * excursion * self.column_square[axis];
                    let filter = &mut self.filter[axis];
                    let mut known = 0.0;
                    let mut known_variance = 0.0;
                    for j in B + 1..STATES {
                        known += phi[j] * filter.x[j];
                        for k in B + 1..STATES {
                            known_variance += phi[j] * phi[k] * filter.p[j][k];
                        }
                    }
                    filter.predict(&phi, &d);
                    let mut i = filter.update(defect[axis], d.measurement);
                    let z = (i.value * i.value * i.information).min(6.0);
                    let c = &self.config;
                    let mut likelihood = [0.0; 2];
                    for (side, factor) in [(0, c.level_ratio), (1, 1.0 / c.level_ratio)] {
                        let mut sd = d;
                        sd.variance *= factor;
                        sd.drift *= factor;
                        sd.momentum_noise += known_variance;
                        let shadow = &mut self.shadow[axis][side];
                        likelihood[side] = shadow.step(t, known, &sd, defect[axis]);
                    }
                    let gradient = (likelihood[0] - likelihood[1]).clamp(-c.level_clip, c.level_clip);
                    let step = if self.pending { 0.0 } else { gradient * c.level_gain };
                    let least = c.disturbance_floor * c.disturbance_floor;
                    let most = c.disturbance_ceiling * c.disturbance_ceiling;
                    let variance = &mut self.disturbance[axis].variance;
                    *variance = (*variance * (1.0 + step)).clamp(least, most);
                    self.disturbance[axis].drift =
                        c.drift_share * *variance * self.block_period;
                    let surprise = &mut self.surprise[axis];
                    *surprise += (z - *surprise) * c.surprise_weight;
                    i.evidence = i.information / surprise.max(1.0);
                    innovation[axis] = i;
                    filter.x[D] -= defect[axis];
                    // Relinearise the lag.
                    let shift = filter.x[TAU];
                    filter.x[TAU] = 0.0;
                    let lag = &mut self.lag[axis];
                    lag.state += lag.sensitivity * shift;
                    let tau = (lag.time_constant * libm::expf(shift)).clamp(0.005, 0.5);
                    lag.set_time_constant(tau, self.period);
                }
                self.open_candidate();
                for candidate in &mut self.candidate[..self.candidate_count] {
                    let age = (self.block - candidate.onset) as usize;
                    let input = if age < ONSET_BLOCKS {
                        self.onset_step[age]
                    } else {
                        self.block_period
                    };
                    for axis in 0..AXES {
                        let error = &mut candidate.error[axis];
                        let phi = &phis[axis];
                        let mut response = error[D] + input;
                        for j in 1..STATES {
                            response += phi[j] * error[j];
                        }
                        error[D] = response;
                        error[W] *= self.disturbance[axis].correlation;
                        let i = &innovation[axis];
                        let weighted = response * i.evidence;
                        candidate.score[axis] += weighted * i.value;
                        candidate.information[axis] += weighted * response;
                        for j in 0..STATES {
                            error[j] -= i.gain[j] * response;
                        }
                    }
                }
                for axis in 0..AXES { self.diag[10+axis]=libm::sqrtf(self.disturbance[axis].variance); }
                self.block = self.block.wrapping_add(1);
            }
        }
    }

    fn start_calibration(&mut self, block_samples: f32) {
        let c = &self.config;
        let n = self.difference_count;
        let ratio = libm::powf(
            c.disturbance_ceiling / c.disturbance_floor,
            1.0 / (LEVELS - 1) as f32,
        );
        for axis in 0..AXES {
            let mean = self.difference_sum[axis] / n;
            let variance = (0.5 * (self.difference_square[axis] / n - mean * mean)).max(1e-14);
            let measurement = variance / block_samples;
            let second = match axis {
                0 => c.drag_spread,
                1 | 2 => c.centre_of_mass_spread,
                _ => 0.25 * c.centre_of_mass_spread,
            };
            let bias = c.bias_spread;
            let prior = [
                measurement + variance,
                0.0,
                bias * bias,
                c.gain_spread * c.gain_spread,
                second * second,
                c.rotor_time_constant_spread * c.rotor_time_constant_spread,
            ];
            let correlation = libm::expf(-self.block_period / c.disturbance_correlation_time);
            let mut level = c.disturbance_floor;
            for k in 0..LEVELS {
                let sigma2 = level * level;
                self.bank_level[axis][k] = Disturbance {
                    correlation,
                    variance: sigma2,
                    momentum_noise: c.momentum_noise_share * measurement,
                    drift: c.drift_share * sigma2 * self.block_period,
                    measurement,
                };
                let mut p = prior;
                p[W] = sigma2;
                self.bank[axis][k] = AxisFilter::new(p);
                self.bank_score[axis][k] = 0.0;
                level *= ratio;
            }
        }
        self.phase = Phase::Calibration;
    }

    fn finish_calibration(&mut self) {
        for axis in 0..AXES {
            let score = &self.bank_score[axis];
            let best = score.iter().fold(f32::NEG_INFINITY, |a, b| a.max(*b));
            // The largest level that is not clearly worse.
            let mut chosen = 0;
            for k in 0..LEVELS {
                if score[k] > best - self.config.level_margin {
                    chosen = k;
                }
            }
            self.filter[axis] = self.bank[axis][chosen];
            self.disturbance[axis] = self.bank_level[axis][chosen];
            self.diag[axis] = chosen as f32;
        }
        let mut variance = 0.0;
        for axis in 0..AXES {
            let b = self.filter[axis].x[B];
            let hover = self.hover_thrust[0];
            variance += 0.25 * b * b
                / (hover * hover * self.column_square[axis] * self.rotor_count as f32);
        }
        let least = self.config.rotor_gain_spread * self.config.rotor_gain_spread;
        self.rotor_gain_variance = (self.config.bias_factor * variance).max(least);
        self.diag[9] = libm::sqrtf(self.rotor_gain_variance);
        for axis in 0..AXES { self.shadow[axis] = [Shadow::from_filter(&self.filter[axis]); 2]; }
        self.phase = Phase::Watch;
        self.block = 0;
        self.candidate_count = 0;
        self.verdict = FaultVerdict::Healthy;
    }

    fn open_candidate(&mut self) {
        if self.candidate_count == CANDIDATES {
            // Drop the one whose neighbours in time stand closest to each other for their age.
            let mut worst = 1;
            let mut least = f32::INFINITY;
            for m in 1..CANDIDATES - 1 {
                let gap = (self.candidate[m + 1].onset - self.candidate[m - 1].onset) as f32;
                let age = (self.block - self.candidate[m].onset) as f32 + 1.0;
                if gap / age < least && self.candidate[m].onset != self.leading_onset {
                    least = gap / age;
                    worst = m;
                }
            }
            self.candidate.copy_within(worst + 1.., worst);
            self.candidate_count -= 1;
        }
        self.candidate[self.candidate_count] = Candidate {
            onset: self.block,
            ..Candidate::default()
        };
        self.candidate_count += 1;
    }

    /// After the last block of a window.
    pub fn decide(&mut self) {
        if self.phase != Phase::Watch || self.candidate_count == 0 {
            return;
        }
        let mut llr = [f32::NEG_INFINITY; MAX_ROTORS];
        let mut loss = [0.0; MAX_ROTORS];
        let mut at = [0usize; MAX_ROTORS];
        for (index, candidate) in self.candidate[..self.candidate_count].iter().enumerate() {
            for i in 0..self.rotor_count {
                let f = &self.column[i];
                let mut numerator = 0.0;
                let mut denominator = 1e-9;
                for axis in 0..AXES {
                    numerator -= f[axis] * candidate.score[axis];
                    denominator += f[axis] * f[axis] * candidate.information[axis];
                }
                let least = -self.loss_fraction[i] * self.hover_thrust[i];
                let delta = (numerator / denominator).max(least);
                let l = delta * (numerator - 0.5 * delta * denominator);
                if l > llr[i] {
                    llr[i] = l;
                    loss[i] = delta;
                    at[i] = index;
                }
            }
        }
        let base = self.primary();
        if let Some(rotor) = base {
            llr[rotor] += self.config.repeat_bonus;
        }
        let mut first = 0;
        for i in 1..self.rotor_count {
            if llr[i] > llr[first] {
                first = i;
            }
        }
        self.leading_onset = self.candidate[at[first]].onset;
        let mut second = f32::NEG_INFINITY;
        for i in 0..self.rotor_count {
            if i != first {
                second = second.max(llr[i]);
            }
        }
        self.diag[4] = llr[first];
        self.diag[5] = second;
        self.diag[6] = first as f32;
        self.diag[7] = loss[first];
        let strong = llr[first] > self.config.evidence_to_isolate
            && llr[first] - second > self.config.margin_to_isolate
            && (loss[first] > self.config.smallest_loss || base == Some(first));
        match base {
            None => {
                if strong {
                    self.verdict = FaultVerdict::Faulty { rotor: first as u8 };
                    self.thrust_loss = loss[first];
                } else if let FaultVerdict::Faulty { rotor } = self.verdict {
                    if llr[usize::from(rotor)] < 0.5 * self.config.evidence_to_isolate {
                        self.verdict = FaultVerdict::Healthy;
                        self.thrust_loss = 0.0;
                    }
                }
                self.probability = 1.0
                    / (1.0
                        + libm::expf((self.config.prior_log_odds - llr[first]).clamp(-80.0, 80.0))
                        + libm::expf((second - llr[first]).clamp(-80.0, 80.0)));
                if self.verdict == FaultVerdict::Healthy {
                    self.probability = 1.0 - self.probability;
                }
            }
            Some(rotor) => {
                self.verdict = FaultVerdict::Faulty { rotor: rotor as u8 };
                self.thrust_loss = self.loss_fraction[rotor] * self.hover_thrust[rotor];
                if strong && first == rotor {
                    self.thrust_loss += loss[first];
                }
            }
        }
        let certain = strong && llr[first] > self.config.evidence_to_absorb;
        self.pending = certain;
        if certain {
            let age = self.block - self.candidate[at[first]].onset;
            if age >= self.settling_blocks {
                self.absorb(first, at[first], loss[first]);
            }
        }
    }

    fn primary(&self) -> Option<usize> {
        let mut best = None;
        let mut largest = 0.0;
        for i in 0..self.rotor_count {
            let loss = self.loss_fraction[i] * self.hover_thrust[i];
            if loss > largest {
                largest = loss;
                best = Some(i);
            }
        }
        if largest > 0.5 * self.config.smallest_loss {
            best
        } else {
            None
        }
    }

    fn absorb(&mut self, rotor: usize, index: usize, loss: f32) {
        let candidate = self.candidate[index];
        let f = &self.column[rotor];
        let mut information = 1e-9;
        for axis in 0..AXES {
            information += f[axis] * f[axis] * candidate.information[axis];
        }
        let variance = 1.0 / information;
        for axis in 0..AXES {
            let coefficient = -f[axis] * loss;
            let filter = &mut self.filter[axis];
            let mut direction = candidate.error[axis];
            for j in 0..STATES {
                filter.x[j] += coefficient * direction[j];
            }
            direction[B] += 1.0;
            let spread = f[axis] * f[axis] * variance;
            for i in 0..STATES {
                for j in 0..STATES {
                    filter.p[i][j] += spread * direction[i] * direction[j];
                }
            }
            self.lag[axis].state += coefficient * self.arm[axis];
            self.shadow[axis] = [Shadow::from_filter(filter); 2];
        }
        let fraction = self.loss_fraction[rotor] + loss / self.hover_thrust[rotor];
        self.loss_fraction[rotor] = fraction.clamp(0.0, 1.0);
        self.candidate_count = 0;
        self.pending = false;
        self.diag[8] += 1.0;
    }
}
