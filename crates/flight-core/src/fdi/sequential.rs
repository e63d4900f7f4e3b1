//! Sequential detector: decides over time instead of window by window, and calibrates itself to the current flight.
//!
//! ```text
//!  BodyMomentum, nominal thrust ─▶ defect ──block means──▶ axis_filter ×4 ──innovations──▶ onset ──evidence──▶ decision
//!                                    ▲                          │ level of gusts, gains, bias, τ
//!                                    └──────── τ, known loss ◀──┴──────────────────────────────────────────────┘
//! ```
//!
//! # Theory of operation
//!
//! 1. *Defect.* Momentum that the rotors, lagged with τ, do not explain (four axes; all residuals of Eq. 32 are projections of
//!    these). A lost thrust appears as a constant slope.
//! 2. *Filters.* Per axis, a Kalman filter explains the defect by what a healthy vehicle may do: gusts (coloured noise whose level is
//!    learnt), a constant bias (rotor biases, offset of the centre of mass), gain errors, the error of τ. What it learns in one
//!    manoeuvre carries over to the next. So the same tuning decides within one or two windows where there is only sensor noise, and
//!    takes longer in wind.
//! 3. *Onset.* Generalised likelihood ratio of a step of lost thrust, for every rotor, over eighteen onset times. Losses are
//!    positive: the sign of the torque distinguishes opposite rotors. Anything that a jump of the momentum itself explains better (a
//!    sensor shift, a knock) does not count.
//! 4. *Decision*, at each window's end: the evidence for the best rotor, in nats, and its lead over the next one, and over every pair of
//!    rotors ([`sets`]). Where one rotor does not explain the lost wrench, a pair is named if it is the only candidate, otherwise the
//!    verdict is ambiguous and lists the candidate sets. A settled fault becomes part of the model, after which *changes* are sought: of
//!    the same rotor in either direction (a fault may grow or heal), of another one only as a loss.
//!
//! ```text
//!   NotReady ──calibration_end──▶ Healthy ⇄ Faulty{rotor}, FaultyPair (pending: every window may revise it)
//!                                    │  ▲          │ evidence_to_absorb and settling_time
//!                                    ▼  │ healed   ▼
//!                       Unknown, Ambiguous└─── Faulty{rotor}, FaultyPair (part of the model)
//! ```
//!
//! # Calibration
//!
//! * up to `calibration_start`: sensor noise, from the differences of neighbouring samples (the first quarter is skipped);
//! * up to `calibration_end`: ten gust levels in parallel on each axis; the largest that is not clearly less likely than the best is
//!   chosen. The vehicle must be healthy until then: a fault present from the start is mistaken for bias;
//! * afterwards: the level follows the likelihood slowly; in a sudden storm, evidence is discounted (*surprise*).
//!
//! # Limits
//!
//! Sets of up to two rotors at a time; further faults, one after the other, are reported as one set of an ambiguous verdict. What geometry
//! and gusts leave undecided is reported as such: a rotor that heals and an opposite one that fails equally differ in the vertical force
//! alone, as do equal losses of opposite rotors and no loss at all. A second loss below about a tenth of the first may be hidden by the
//! uncertainty of the gains until a manoeuvre has excited them. Torque disturbances that set in suddenly, persist and point like a rotor's
//! loss are mistaken for one; those that point between rotors are an unknown fault, and remain one until later data contradict it. A loss
//! below `smallest_loss` is never reported. The sensor noise is assumed to stay as measured.
//!
//! Glossary: *block*, part of a window after which the filters are updated; *level*, standard deviation of the gusts; *lever*, the
//! longest lever of an axis, which turns its torques into thrusts at a rotor; *absorb*, make a fault part of the model.

mod axis_filter;
mod config;
mod decision;
mod defect;
mod estimate;
mod observation;
mod onset;
mod sets;

use super::FaultVerdict;
use super::residual::{BodyMomentum, RigidBody};
use crate::MAX_ROTORS;
use crate::geometry::Geometry;
use axis_filter::{AxisFilter, BIAS, Disturbance, GUST, Innovation, LevelProbe, STATES};
use config::NOISE_SKIP;
pub use config::{MAX_UPDATES_PER_WINDOW, SequentialConfig, SequentialConfigError};
pub(super) use defect::lanes::MeterRows;
use defect::{AXES, Block, DefectMeter};
pub use estimate::{LossEstimate, MAX_HYPOTHESES, Suspects};
use onset::OnsetHypotheses;

/// Gust levels tried during the calibration.
const LEVELS: usize = 10;

/// Averaging time of each rotor's thrust, used to convert a loss in newtons to a fraction, s.
const THRUST_TIME: f32 = 1.0;

/// The detector's decision after a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SequentialDecision {
    /// Held until the next window.
    pub verdict: FaultVerdict,
    /// Posterior probability of the verdict, 0 to 1; 0 while not ready.
    pub probability: f32,
    /// Thrust lost by the rotors named, in the order of their numbers.
    pub thrust_loss: [LossEstimate; 2],
    /// Rotors that the verdict concerns.
    pub suspects: Suspects,
}

impl SequentialDecision {
    const NONE: Self = Self {
        verdict: FaultVerdict::NotReady,
        probability: 0.0,
        thrust_loss: [LossEstimate::NONE; 2],
        suspects: Suspects::NONE,
    };
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Measures the sensor noise.
    WarmUp,
    /// Compares gust levels.
    Calibration,
    /// Makes decisions.
    Watch,
}

/// One gust level in the calibration.
#[derive(Clone, Copy, Debug, Default)]
struct Contender {
    filter: AxisFilter,
    variance: f32,
    log_likelihood: f32,
}

impl Contender {
    const BLANK: Self = Self {
        filter: AxisFilter::BLANK,
        variance: 0.0,
        log_likelihood: 0.0,
    };
}

/// One axis after the calibration.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    filter: AxisFilter,
    /// Gust level, squared, N².
    variance: f32,
    /// Variance of the noise of one sample, (N·s)².
    noise: f32,
    /// Average of the clipped squared innovations: 1 if the model holds.
    surprise: f32,
    /// Above and below the level in use.
    probe: [LevelProbe; 2],
    /// Mean squared entry of F on this axis, levers divided out.
    column_square: f32,
}

impl Axis {
    const BLANK: Self = Self {
        filter: AxisFilter::BLANK,
        variance: 0.0,
        noise: 0.0,
        surprise: 0.0,
        probe: [LevelProbe::BLANK; 2],
        column_square: 0.0,
    };
}

/// A fault that is part of the model.
#[derive(Clone, Copy, Debug, Default)]
struct KnownFault {
    /// Share of the thrust lost.
    fraction: f32,
    /// Standard deviation of the lost thrust, N.
    deviation: f32,
    /// Probability when it was absorbed.
    probability: f32,
}

impl KnownFault {
    const BLANK: Self = Self {
        fraction: 0.0,
        deviation: 0.0,
        probability: 0.0,
    };
}

/// Constants of a flight, from the configuration and the vehicle.
#[derive(Clone, Copy, Debug)]
struct Tuning {
    config: SequentialConfig,
    rotor_count: usize,
    block_period: f32,
    /// Correlation of the gusts from block to block.
    correlation: f32,
    /// 1 − e^(−block/τ).
    lag_weight: f32,
    /// Mean hover thrust of a rotor, N.
    mean_hover_thrust: f32,
    hover_thrust: [f32; MAX_ROTORS],
    /// Columns of F, levers divided out.
    column: [[f32; AXES]; MAX_ROTORS],
    arm: [f32; AXES],
    mass: f32,
    noise_from: u32,
    calibration_from: u32,
    watch_from: u32,
    settling_blocks: u32,
    ambiguity_windows: u16,
    /// Age from which a pair may be named: the vertical force, which distinguishes it from a pure torque, becomes known late.
    pair_blocks: u32,
}

impl Tuning {
    const BLANK: Self = Self {
        config: SequentialConfig::BLANK,
        rotor_count: 0,
        block_period: 0.0,
        correlation: 0.0,
        lag_weight: 0.0,
        mean_hover_thrust: 0.0,
        hover_thrust: [0.0; MAX_ROTORS],
        column: [[0.0; AXES]; MAX_ROTORS],
        arm: [0.0; AXES],
        mass: 0.0,
        noise_from: 0,
        calibration_from: 0,
        watch_from: 0,
        settling_blocks: 0,
        ambiguity_windows: 0,
        pair_blocks: 0,
    };

    fn new(config: &SequentialConfig, geometry: &Geometry, body: &RigidBody, period: f32, window_len: u16) -> Self {
        let rotor_count = geometry.rotor_count();
        let f = geometry.effectiveness();
        let weight = body.mass * body.gravity;
        let mean_hover_thrust = weight / rotor_count as f32;
        // Rotors that carry almost nothing in hover get a tenth of the mean, so that fractions of their thrust stay meaningful.
        let hover_thrust = geometry.allocate([-weight, 0.0, 0.0, 0.0]);
        let hover_thrust = hover_thrust.map(|thrust| thrust.max(0.1 * mean_hover_thrust));
        let mut arm = [0.0f32; AXES];
        for axis in 0..AXES {
            for i in 0..rotor_count {
                arm[axis] = arm[axis].max(f[axis][i].abs());
            }
        }
        let mut column = [[0.0; AXES]; MAX_ROTORS];
        for i in 0..rotor_count {
            for axis in 0..AXES {
                column[i][axis] = f[axis][i] / arm[axis];
            }
        }
        let window_period = period * f32::from(window_len);
        let block_period = window_period / f32::from(config.updates_per_window);
        let count = |time: f32, unit: f32| libm::roundf(time / unit) as u32;
        Self {
            config: *config,
            rotor_count,
            block_period,
            correlation: libm::expf(-block_period / config.disturbance_correlation_time),
            lag_weight: 1.0 - libm::expf(-block_period / config.rotor_time_constant),
            mean_hover_thrust,
            hover_thrust,
            column,
            arm,
            mass: body.mass,
            noise_from: count(NOISE_SKIP * config.calibration_start, period),
            calibration_from: count(config.calibration_start, period),
            watch_from: count(config.calibration_end, period),
            settling_blocks: count(config.settling_time, block_period),
            ambiguity_windows: count(config.ambiguity_time, window_period) as u16,
            pair_blocks: count(config.ambiguity_time, block_period),
        }
    }
}

/// State of the calibration, including what it learns about the rotors.
#[derive(Clone, Copy, Debug)]
struct Calibration {
    contender: [[Contender; LEVELS]; AXES],
    /// Variance of the relative thrust differences between rotors.
    rotor_gain_variance: f32,
}

impl Calibration {
    const BLANK: Self = Self {
        contender: [[Contender::BLANK; LEVELS]; AXES],
        rotor_gain_variance: 0.0,
    };

    /// In place, see [`SequentialDetector::configure`].
    fn clear(&mut self, tuning: &Tuning) {
        // Destructured, so that no field is forgotten.
        let Self {
            contender,
            rotor_gain_variance,
        } = self;
        for level in contender.as_flattened_mut() {
            *level = Contender::BLANK;
        }
        *rotor_gain_variance = tuning.config.excursion_in_calibration;
    }
}

/// State tracked after the calibration.
#[derive(Clone, Copy, Debug)]
struct Watch {
    axis: [Axis; AXES],
    onset: OnsetHypotheses,
    /// Averaged static thrust of every rotor, N; frozen while something stands out, so that it is the thrust at onset.
    thrust: [f32; MAX_ROTORS],
    /// The same over the last block.
    recent_thrust: [f32; MAX_ROTORS],
    /// Rotor with the most evidence at the last window's end.
    leading_rotor: usize,
    /// See [`SequentialDetector::follow_demand`].
    extra_demand: f32,
    /// Nothing stands out.
    quiet: bool,
    /// A fault stands out enough that the gust level is frozen until it is absorbed.
    pending: bool,
    ambiguous_windows: u16,
    known: [KnownFault; MAX_ROTORS],
    /// Gain errors of the axes and their variances as of the last quiet window.
    gain: [f32; AXES],
    gain_variance: [f32; AXES],
    /// In the form that the meter expects.
    loss_fraction: [f32; MAX_ROTORS],
    decision: SequentialDecision,
}

impl Watch {
    const BLANK: Self = Self {
        axis: [Axis::BLANK; AXES],
        onset: OnsetHypotheses::BLANK,
        thrust: [0.0; MAX_ROTORS],
        recent_thrust: [0.0; MAX_ROTORS],
        leading_rotor: 0,
        extra_demand: 0.0,
        quiet: false,
        pending: false,
        ambiguous_windows: 0,
        known: [KnownFault::BLANK; MAX_ROTORS],
        gain: [0.0; AXES],
        gain_variance: [0.0; AXES],
        loss_fraction: [0.0; MAX_ROTORS],
        decision: SequentialDecision::NONE,
    };

    /// In place, see [`SequentialDetector::configure`].
    fn clear(&mut self, tuning: &Tuning) {
        // Destructured, so that no field is forgotten.
        let Self {
            axis,
            onset,
            thrust,
            recent_thrust,
            leading_rotor,
            extra_demand,
            quiet,
            pending,
            ambiguous_windows,
            known,
            gain,
            gain_variance,
            loss_fraction,
            decision,
        } = self;
        let config = &tuning.config;
        *axis = [Axis::BLANK; AXES];
        for i in 0..tuning.rotor_count.min(MAX_ROTORS) {
            for a in 0..AXES {
                axis[a].column_square += tuning.column[i][a] * tuning.column[i][a] / tuning.rotor_count as f32;
                axis[a].surprise = 1.0;
            }
        }
        onset.configure(tuning.block_period, config.rotor_time_constant);
        *thrust = tuning.hover_thrust;
        *recent_thrust = tuning.hover_thrust;
        *leading_rotor = 0;
        *extra_demand = 0.0;
        *quiet = true;
        *pending = false;
        *ambiguous_windows = 0;
        *known = [KnownFault::BLANK; MAX_ROTORS];
        *gain = [0.0; AXES];
        *gain_variance = [config.gain_spread * config.gain_spread; AXES];
        *loss_fraction = [0.0; MAX_ROTORS];
        *decision = SequentialDecision::NONE;
    }
}

/// See the module documentation.
#[derive(Clone, Copy, Debug)]
pub struct SequentialDetector {
    tuning: Tuning,
    phase: Phase,
    samples: u32,
    meter: DefectMeter,
    calibration: Calibration,
    watch: Watch,
}

/// A rotor index with a bound visible to the compiler: keeps the step panic-free.
#[inline(always)]
const fn within(rotor: usize) -> usize {
    if rotor < MAX_ROTORS { rotor } else { MAX_ROTORS - 1 }
}

/// `f32::clamp` without its check that the limits are ordered: those of the configuration are.
#[inline(always)]
fn limited(value: f32, low: f32, high: f32) -> f32 {
    if value < low {
        low
    } else if value > high {
        high
    } else {
        value
    }
}

impl SequentialDetector {
    /// Before [`SequentialDetector::configure`].
    pub(crate) const BLANK: Self = Self {
        tuning: Tuning::BLANK,
        phase: Phase::WarmUp,
        samples: 0,
        meter: DefectMeter::BLANK,
        calibration: Calibration::BLANK,
        watch: Watch::BLANK,
    };

    /// Restarts with a configuration that passes [`SequentialConfig::check`] for the same `period` and `window_len`; in place, as a board
    /// has no room for two.
    ///
    /// * `body`: mass, inertia and gravity of the document   * `period`: dt, s   * `window_len`: samples per decision
    pub fn configure(
        &mut self,
        config: &SequentialConfig,
        geometry: &Geometry,
        body: &RigidBody,
        period: f32,
        window_len: u16,
    ) {
        // Destructured, so that no field is forgotten.
        let Self {
            tuning,
            phase,
            samples,
            meter,
            calibration,
            watch,
        } = self;
        *tuning = Tuning::new(config, geometry, body, period, window_len);
        *phase = Phase::WarmUp;
        *samples = 0;
        *meter = DefectMeter::new(
            geometry,
            body.mass * body.gravity,
            body.inertia_body,
            tuning.arm,
            tuning.hover_thrust,
            config.rotor_time_constant,
            period,
        );
        calibration.clear(tuning);
        watch.clear(tuning);
    }

    /// n_a, with a bound visible to the compiler.
    #[inline(always)]
    fn rotors(&self) -> usize {
        self.tuning.rotor_count.min(MAX_ROTORS)
    }

    /// The last decision.
    #[inline]
    pub const fn decision(&self) -> &SequentialDecision {
        &self.watch.decision
    }

    /// Processes one sample.
    ///
    /// * `static_wrench`, `static_thrust`: steady-state values of healthy rotors, N and N·m
    #[inline]
    pub fn step(&mut self, body: &BodyMomentum, static_wrench: &[f32; AXES], static_thrust: &[f32; MAX_ROTORS]) {
        let learn_noise = self.phase == Phase::WarmUp && self.samples >= self.tuning.noise_from;
        self.meter.step(
            body,
            static_wrench,
            static_thrust,
            &self.watch.loss_fraction,
            learn_noise,
        );
        self.samples = self.samples.saturating_add(1);
    }

    /// Copies per-sample state into a lane; returns the number of samples so far.
    pub(super) fn seat_meter<const N: usize, const L: usize>(&self, lane: usize, rows: &mut MeterRows<N, L>) -> u32 {
        rows.seat(lane, &self.meter, &self.watch.loss_fraction);
        self.samples
    }

    /// Copies back what [`SequentialDetector::seat_meter`] moved out.
    pub(super) fn leave_meter<const N: usize, const L: usize>(
        &mut self,
        lane: usize,
        rows: &MeterRows<N, L>,
        samples: u32,
    ) {
        rows.write(lane, &mut self.meter);
        self.samples = samples;
    }

    /// [`SequentialDetector::step`] for a lane.
    #[inline(always)]
    pub(super) fn step_lane<const N: usize, const L: usize>(
        &self,
        rows: &mut MeterRows<N, L>,
        lane: usize,
        body: &BodyMomentum,
        static_wrench: &[f32; AXES],
        static_thrust: &[f32; N],
    ) {
        rows.step(&self.meter, lane, body, static_wrench, static_thrust);
    }

    /// True while the sensor noise is measured.
    pub(super) fn is_warming_up(&self) -> bool {
        self.phase == Phase::WarmUp
    }

    /// First sample whose differences count towards the noise.
    #[inline(always)]
    pub(super) fn noise_from(&self) -> u32 {
        self.tuning.noise_from
    }

    /// Advances by one step without a sample.
    #[inline]
    pub fn coast(&mut self) {
        self.meter.hold();
    }

    /// After the last sample of a block.
    pub fn close_block(&mut self) {
        let Some(block) = self.meter.close_block() else {
            return;
        };
        self.watch.recent_thrust = block.thrust;
        if self.watch.quiet {
            let weight = (self.tuning.block_period / THRUST_TIME).min(1.0);
            for i in 0..self.rotors() {
                self.watch.thrust[i] += (block.thrust[i] - self.watch.thrust[i]) * weight;
            }
        }
        match self.phase {
            Phase::WarmUp => {
                if self.samples >= self.tuning.calibration_from {
                    self.start_calibration();
                }
            }
            Phase::Calibration => {
                self.calibrate(&block);
                if self.samples >= self.tuning.watch_from {
                    self.start_watch();
                }
            }
            Phase::Watch => self.watch(&block),
        }
    }

    /// Additional demand on the leading rotor relative to the time before anything stood out, as a fraction, through the lag. A rotor that
    /// loses a fraction of its thrust is immediately commanded more, and loses the same fraction of that: the lost thrust grows with it.
    fn follow_demand(&mut self, block: &Block) {
        if self.watch.quiet {
            self.watch.extra_demand = 0.0;
            return;
        }
        let rotor = within(self.watch.leading_rotor);
        let extra = block.thrust[rotor] / self.watch.thrust[rotor].max(0.1 * self.tuning.mean_hover_thrust) - 1.0;
        self.watch.extra_demand += (extra.clamp(-0.5, 1.0) - self.watch.extra_demand) * self.tuning.lag_weight;
    }

    /// φ of one axis, see [`axis_filter`].
    #[inline]
    fn phi(&self, axis: usize, block: &Block) -> [f32; STATES] {
        let second = if axis == 0 {
            block.vertical_path
        } else {
            // Force over lever: the parameter is a length over the longest lever.
            block.wrench[0] * self.tuning.arm[1].max(self.tuning.arm[2]) / self.tuning.arm[axis]
        };
        [
            0.0,
            block.elapsed,
            block.elapsed,
            block.wrench[axis],
            second,
            block.lag_slope[axis],
            if axis == 0 { 0.0 } else { block.gyroscopic[axis - 1] },
        ]
    }

    /// Disturbance model of one axis over this block.
    #[inline]
    fn disturbance(&self, axis: usize, variance: f32, block: &Block) -> Disturbance {
        let measurement = self.watch.axis[axis].noise / block.samples;
        let excursion = self.calibration.rotor_gain_variance * block.excursion * self.watch.axis[axis].column_square;
        Disturbance {
            correlation: self.tuning.correlation,
            variance,
            momentum_noise: self.tuning.config.momentum_noise_share * measurement
                + excursion * block.elapsed * block.elapsed,
            drift: self.tuning.config.drift_share * variance * self.tuning.block_period,
            measurement,
        }
    }

    fn start_calibration(&mut self) {
        let Some(noise) = self.meter.noise_variance() else {
            return;
        };
        let c = &self.tuning.config;
        self.meter
            .set_spike_limit(noise.map(|variance| c.spike_sigma * libm::sqrtf(2.0 * variance)));
        let floor = c.disturbance_floor * self.tuning.mean_hover_thrust;
        let ratio = libm::powf(c.disturbance_ceiling / c.disturbance_floor, 1.0 / (LEVELS - 1) as f32);
        let bias = c.bias_spread * self.tuning.mean_hover_thrust;
        for axis in 0..AXES {
            self.watch.axis[axis].noise = noise[axis];
            let second = match axis {
                0 => c.drag_spread * self.tuning.mass,
                1 | 2 => c.centre_of_mass_spread,
                // For yaw this is not the centre of mass: small differences between rotors affect the yaw torque as it affects the others.
                _ => c.centre_of_mass_spread * self.tuning.arm[3] / self.tuning.arm[1].max(self.tuning.arm[2]),
            };
            let mut prior = [
                2.0 * noise[axis],
                0.0,
                bias * bias,
                c.gain_spread * c.gain_spread,
                second * second,
                c.rotor_time_constant_spread * c.rotor_time_constant_spread,
                if axis == 0 { 0.0 } else { c.gain_spread * c.gain_spread },
            ];
            let mut level = floor;
            for contender in &mut self.calibration.contender[axis] {
                prior[GUST] = level * level;
                *contender = Contender {
                    filter: AxisFilter::new(&prior),
                    variance: level * level,
                    log_likelihood: 0.0,
                };
                level *= ratio;
            }
        }
        self.phase = Phase::Calibration;
    }

    fn calibrate(&mut self, block: &Block) {
        for axis in 0..AXES {
            let phi = self.phi(axis, block);
            for level in 0..LEVELS {
                let variance = self.calibration.contender[axis][level].variance;
                let disturbance = self.disturbance(axis, variance, block);
                let contender = &mut self.calibration.contender[axis][level];
                contender.filter.predict(&phi, &disturbance);
                let innovation = contender.filter.update(block.defect[axis], disturbance.measurement);
                contender.log_likelihood += innovation.log_likelihood();
            }
        }
    }

    fn start_watch(&mut self) {
        let mut gain_variance = 0.0;
        for axis in 0..AXES {
            let contenders = &self.calibration.contender[axis];
            let mut chosen = &contenders[0];
            let mut best = chosen.log_likelihood;
            for contender in contenders {
                best = best.max(contender.log_likelihood);
            }
            for contender in contenders {
                if contender.log_likelihood > best - self.tuning.config.level_margin {
                    chosen = contender;
                }
            }
            let state = &mut self.watch.axis[axis];
            state.filter = chosen.filter;
            state.variance = chosen.variance;
            state.probe = [LevelProbe::new(&chosen.filter); 2];
            // Independent gain errors ε on n rotors produce a bias of variance ε² f² n · mean(F²).
            let unit = self.tuning.mean_hover_thrust
                * self.tuning.mean_hover_thrust
                * state.column_square
                * self.tuning.rotor_count as f32;
            let bias = chosen.filter.state[BIAS];
            gain_variance += bias * bias / unit / AXES as f32;
        }
        let least = self.tuning.config.rotor_gain_spread * self.tuning.config.rotor_gain_spread;
        self.calibration.rotor_gain_variance = (self.tuning.config.bias_factor * gain_variance).max(least);
        self.watch.onset.clear();
        self.phase = Phase::Watch;
        self.watch.decision.verdict = FaultVerdict::Healthy;
        self.watch.decision.probability = 1.0;
    }

    fn watch(&mut self, block: &Block) {
        let mut phi = [[0.0; STATES]; AXES];
        let mut innovation = [Innovation::default(); AXES];
        let mut evidence = [0.0; AXES];
        for axis in 0..AXES {
            phi[axis] = self.phi(axis, block);
            let disturbance = self.disturbance(axis, self.watch.axis[axis].variance, block);
            let state = &mut self.watch.axis[axis];
            let (known, known_variance) = state.filter.parameter_effect(&phi[axis]);
            state.filter.predict(&phi[axis], &disturbance);
            innovation[axis] = state.filter.update(block.defect[axis], disturbance.measurement);

            state.surprise += (innovation[axis].surprise() - state.surprise) * self.tuning.config.surprise_weight;
            evidence[axis] = innovation[axis].information / state.surprise.max(1.0);

            self.follow_level(axis, block, known, known_variance, &disturbance);
        }
        self.follow_demand(block);
        self.watch.onset.update(
            &phi,
            &innovation,
            &evidence,
            self.tuning.correlation,
            block.elapsed,
            self.watch.extra_demand,
        );
    }

    /// Moves the gust level of one axis towards the likelier of the two probes.
    fn follow_level(&mut self, axis: usize, block: &Block, known: f32, known_variance: f32, disturbance: &Disturbance) {
        let c = &self.tuning.config;
        let state = &mut self.watch.axis[axis];
        let mut log_likelihood = [0.0; 2];
        for (side, factor) in [c.level_ratio, 1.0 / c.level_ratio].into_iter().enumerate() {
            let mut assumed = *disturbance;
            assumed.variance *= factor;
            assumed.drift *= factor;
            assumed.momentum_noise += known_variance;
            log_likelihood[side] = state.probe[side].step(block.elapsed, known, &assumed, block.defect[axis]);
        }
        if self.watch.pending {
            return;
        }
        let step = limited(log_likelihood[0] - log_likelihood[1], -c.level_clip, c.level_clip) * c.level_gain;
        let floor = c.disturbance_floor * self.tuning.mean_hover_thrust;
        let ceiling = c.disturbance_ceiling * self.tuning.mean_hover_thrust;
        state.variance = limited(state.variance * (1.0 + step), floor * floor, ceiling * ceiling);
    }
}
