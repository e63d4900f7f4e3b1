//! What healthy flights reveal about a vehicle beyond its model, and how a session uses it.
//!
//! ```text
//!  healthy flights ─▶ Learner: what rotors do not explain, against signals of the flight ─▶ Learnt: Θ
//!  Measurement, Θ ─▶ the duties that the model would need for the wrench that this vehicle has ─▶ engine, second look
//! ```
//! The momentum defect D of each axis a (as in [`super::second_look`], levers taken out) is fitted by
//!
//! ```text
//!  D_a' = w_a + b_a + Σ_k Θ_ak s̃_k       w' = −w/T + noise,  b: of one flight,  s̃: s through the rotors' lag
//! ```
//! over all blocks of all flights; gusts w and the bias b belong to the day, Θ to the vehicle. The
//! signals s are those with which missing physics usually correlates ([`NAMES`]): gains of the wrenches and of their
//! squares (mass, inertia, thrust curve, tilted rotors), speeds (drag and where it acts, inflow, translational lift),
//! rates (damping, products of inertia), changes of the commands (lag, latencies, rotor inertia), the voltage. Θ has a
//! prior about 0 with the plausible size of such physics, and only signals with which flights that the fit has not seen
//! are predicted better have a Θ other than 0 ([`fit`]).
//!
//! A session that has learnt adds F⁺ Σ_k Θ_ak s_k to the commanded thrusts: the detectors stay unchanged and see a
//! vehicle that matches their model. Their priors for what was learnt are narrowed by [`NARROW`]; the second look
//! assumes no calibration calmer than [`LEAST_NOISE`] of what the flights left, since eight seconds seldom contain a
//! gust or a corner of the flight to come.
//!
//! Limits: what the flights did not excite is not learnt; wind belongs to the day, so drag is learnt against the
//! ground. A fault in a flight that is learnt from becomes part of the vehicle.

mod fit;

use super::second_look::meter::{AXES, Meter};
use fit::{Taken, fitted};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::FdiConfig;
use rotortwin_flight_core::fdi::nominal_thrust::static_thrust;
use rotortwin_flight_core::frames::{BodyToNed, Vec3};
use rotortwin_flight_core::signals::Measurement;

/// Signals.
const SIGNALS: usize = NAMES.len();
/// Each in N at the levers, or in N for 1 m/s, 1 rad/s; its meaning, and the standard deviation of Θ: for the axis
/// itself and for the others.
const NAMES: [(&str, f64, f64); 30] = [
    ("vertical force beyond the weight", 0.1, 0.03),
    ("roll moment", 0.1, 0.03),
    ("pitch moment", 0.1, 0.03),
    ("yaw moment", 0.1, 0.03),
    ("change of the vertical force", 0.5, 0.05),
    ("change of the roll moment", 0.5, 0.05),
    ("change of the pitch moment", 0.5, 0.05),
    ("change of the yaw moment", 0.5, 0.05),
    ("vertical force, squares of thrusts off hover", 0.1, 0.02),
    ("roll moment, squares of thrusts off hover", 0.1, 0.02),
    ("pitch moment, squares of thrusts off hover", 0.1, 0.02),
    ("yaw moment, squares of thrusts off hover", 0.1, 0.02),
    ("forward speed", 0.1, 0.1),
    ("speed to the right", 0.1, 0.1),
    ("speed down", 0.5, 0.1),
    ("square of the horizontal speed", 0.03, 0.01),
    ("square of the vertical speed", 0.03, 0.01),
    ("forward speed times the horizontal speed", 0.02, 0.02),
    ("speed to the right times the horizontal speed", 0.02, 0.02),
    ("roll rate", 0.05, 0.05),
    ("pitch rate", 0.05, 0.05),
    ("yaw rate", 0.05, 0.05),
    ("product of pitch and yaw rate", 0.2, 0.05),
    ("product of roll and yaw rate", 0.2, 0.05),
    ("product of roll and pitch rate", 0.2, 0.05),
    (
        "roll rate times speed to the right less pitch rate times forward speed",
        0.05,
        0.02,
    ),
    ("specific force forward, as the air pushes", 0.5, 0.3),
    ("specific force to the right, as the air pushes", 0.5, 0.3),
    ("square of the horizontal specific force over the weight", 0.5, 0.3),
    ("voltage off its mean, times the thrust", 0.3, 0.0),
];
/// Hover thrust of the rotors to which these refer, N: speeds and rates scale with it.
const SCALE_THRUST: f64 = 2.5;
/// First of the changes of the wrench.
const FIRST_CHANGE: usize = AXES;
/// First of the signals whose Θ is not a share.
const FIRST_SPEED: usize = 12;
/// Axis to which a signal belongs; the rest belong to all equally.
const AXIS_OF: [Option<usize>; SIGNALS] = {
    let mut axis = [None; SIGNALS];
    let mut k = 0;
    while k < FIRST_SPEED {
        axis[k] = Some(k % AXES);
        k += 1;
    }
    axis
};
/// Minimum number of blocks to learn from: 20 s.
const FEWEST_BLOCKS: usize = 320;
/// Spreads of gain, lag, centre of mass and drag of a vehicle that is known from flights, relative to those of an
/// unknown one.
const NARROW: f32 = 0.4;
/// Periods of samples that differ by less are one rate.
const SAME_RATE: f32 = 0.02;
/// Variances of a calm day relative to those of the flights.
const LEAST_NOISE: f64 = 0.25;
/// Low-pass of the horizontal force, s: a proxy for the airspeed, from which a rotor's drag produces it.
const AIR_TIME: f64 = 0.05;
/// Time of the low-pass of the voltage, s.
const VOLTAGE_TIME: f64 = 20.0;

/// Signals of a flight, sample by sample.
#[derive(Clone, Debug)]
struct Signals {
    config: FdiConfig,
    arm: [f64; AXES],
    weight: f64,
    hover: f64,
    /// 1 − e^(−dt/τ).
    end: f64,
    lagged: Option<[f64; AXES]>,
    voltage: f64,
    /// Low-passed in the body frame: speeds, and their derivatives apart from forces.
    speed: [f64; 2],
    turn: [f64; 2],
}

impl Signals {
    fn new(config: &FdiConfig, arm: [f64; AXES]) -> Self {
        let x = f64::from(config.period) / f64::from(config.sequential.rotor_time_constant);
        let weight = f64::from(config.mass) * f64::from(config.gravity);
        Self {
            config: *config,
            arm,
            weight,
            hover: weight / config.geometry.rotor_count() as f64,
            end: -(-x).exp_m1(),
            lagged: None,
            voltage: 0.0,
            speed: [0.0; 2],
            turn: [0.0; 2],
        }
    }

    /// Of one sample.
    fn of(&mut self, input: &Measurement, thrust: &[f32; MAX_ROTORS]) -> [f64; SIGNALS] {
        let geometry = &self.config.geometry;
        let wrench = geometry.wrench_from_thrust(thrust);
        let hover = self.hover as f32;
        // Without a slope in hover, so that the gain of a wrench is that of its own signal.
        let square = geometry.wrench_from_thrust(&thrust.map(|f| (f - hover) * (f - hover)));
        let wrench: [f64; AXES] = std::array::from_fn(|axis| f64::from(wrench[axis]) / self.arm[axis]);
        let square: [f64; AXES] = std::array::from_fn(|axis| f64::from(square[axis]) / (self.arm[axis] * self.hover));
        let body = BodyToNed::from_euler(input.nav.attitude);
        let [u, v, w] = body.to_body(input.nav.velocity_ned).to_array().map(f64::from);
        let [p, q, r] = input.nav.body_rates.to_array().map(f64::from);
        let gravity = body
            .to_body(Vec3::new(0.0, 0.0, self.config.gravity))
            .to_array()
            .map(f64::from);
        // f = v' + ω × v − g.
        let turn = [q * w - r * v - gravity[0], r * u - p * w - gravity[1]];
        let lagged = self.lagged.get_or_insert_with(|| {
            self.voltage = f64::from(input.battery_voltage);
            (self.speed, self.turn) = ([u, v], turn);
            wrench
        });
        let mut push = [0.0; 2];
        for (k, speed) in [u, v].into_iter().enumerate() {
            let share = f64::from(self.config.period) / AIR_TIME;
            // The low-pass of a derivative is the distance to the low-pass, over its time.
            push[k] = f64::from(self.config.mass) * ((speed - self.speed[k]) / AIR_TIME + self.turn[k]);
            self.speed[k] += (speed - self.speed[k]) * share;
            self.turn[k] += (turn[k] - self.turn[k]) * share;
        }
        let change: [f64; AXES] = std::array::from_fn(|axis| wrench[axis] - lagged[axis]);
        for axis in 0..AXES {
            lagged[axis] += change[axis] * self.end;
        }
        let voltage = f64::from(input.battery_voltage);
        self.voltage += (voltage - self.voltage) * f64::from(self.config.period) / VOLTAGE_TIME;
        let level = u.hypot(v);
        let off = if self.voltage > 0.0 {
            voltage / self.voltage - 1.0
        } else {
            0.0
        };
        [
            wrench[0] + self.weight,
            wrench[1],
            wrench[2],
            wrench[3],
            change[0],
            change[1],
            change[2],
            change[3],
            square[0],
            square[1],
            square[2],
            square[3],
            u,
            v,
            w,
            level * level,
            w * w.abs(),
            u * level,
            v * level,
            p,
            q,
            r,
            q * r,
            p * r,
            p * q,
            p * v - q * u,
            push[0],
            push[1],
            (push[0] * push[0] + push[1] * push[1]) / self.hover,
            off * wrench[0],
        ]
    }
}

/// Learns from healthy flights.
#[derive(Clone, Debug)]
pub struct Learner {
    config: FdiConfig,
    meter: Meter,
    signals: Signals,
    /// 1 − e^(−dt/τ), and the share of a step's input in the mean over it.
    end: f64,
    mean: f64,
    lagged: Option<[f64; SIGNALS]>,
    rate: [f64; SIGNALS],
    integral: [f64; SIGNALS],
    sum: [f64; SIGNALS],
    samples: f64,
    begins: bool,
    blocks: Vec<Taken>,
    flights: usize,
    /// Of the flights' samples, s: the shortest and the longest.
    periods: [f32; 2],
}

impl Learner {
    /// For the vehicle of these detectors.
    pub fn new(config: &FdiConfig) -> Self {
        let meter = Meter::new(config);
        let x = f64::from(config.period) / f64::from(config.sequential.rotor_time_constant);
        let end = -(-x).exp_m1();
        Self {
            config: *config,
            signals: Signals::new(config, meter.arm),
            meter,
            end,
            mean: 1.0 - end / x,
            lagged: None,
            rate: [0.0; SIGNALS],
            integral: [0.0; SIGNALS],
            sum: [0.0; SIGNALS],
            samples: 0.0,
            begins: true,
            blocks: Vec::new(),
            flights: 0,
            periods: [f32::INFINITY, 0.0],
        }
    }

    /// Before another flight.
    ///
    /// * `config`: of its detectors, which may have another rate
    pub(crate) fn and_a_flight(mut self, config: &FdiConfig) -> Self {
        self.config = *config;
        self.begin();
        self.flights += 1;
        self.periods = [self.periods[0].min(config.period), self.periods[1].max(config.period)];
        self
    }

    /// The next sample does not continue the previous ones.
    pub(crate) fn begin(&mut self) {
        let blocks = std::mem::take(&mut self.blocks);
        *self = Self {
            blocks,
            flights: self.flights,
            periods: self.periods,
            ..Self::new(&self.config)
        };
    }

    /// Processes a sample that the engine has accepted.
    pub(crate) fn step(&mut self, input: &Measurement) {
        self.meter.step(input);
        self.samples += 1.0;
        for k in 0..SIGNALS {
            self.sum[k] += self.integral[k];
        }
        let rotors = self.config.geometry.rotor_count();
        let now = self
            .signals
            .of(input, &static_thrust(&self.config.thrust_map, rotors, input));
        let lagged = self.lagged.get_or_insert(now);
        for k in 0..SIGNALS {
            let gap = now[k] - lagged[k];
            self.rate[k] = lagged[k] + gap * self.mean;
            lagged[k] += gap * self.end;
        }
        self.advance();
    }

    /// A sample was lost or rejected.
    pub(crate) fn hold(&mut self) {
        self.meter.hold();
        self.advance();
    }

    fn advance(&mut self) {
        for k in 0..SIGNALS {
            self.integral[k] += f64::from(self.config.period) * self.rate[k];
        }
    }

    /// After the last sample of a window.
    ///
    /// * `counts`: the vehicle flew, and the model could explain its motion
    pub(crate) fn close(&mut self, counts: bool) {
        let Some(block) = self.meter.close() else {
            return;
        };
        let share = 1.0 / self.samples.max(1.0);
        let signal = self.sum.map(|sum| sum * share);
        for k in 0..SIGNALS {
            self.integral[k] -= signal[k];
        }
        (self.sum, self.samples) = ([0.0; SIGNALS], 0.0);
        let first = std::mem::replace(&mut self.begins, false);
        if !counts {
            self.begins = true;
        } else if first {
            // Its defect counts from a sample, not from a mean.
            self.blocks.push(Taken {
                flight: self.flights,
                begins: true,
                defect: [0.0; AXES],
                elapsed: 0.0,
                heading: [0.0; 2],
                signal: [0.0; SIGNALS],
                noise: block.roughness.map(|rough| rough / (2.0 * block.samples)),
            });
        } else {
            self.blocks.push(Taken {
                flight: self.flights,
                begins: false,
                defect: block.defect,
                elapsed: block.elapsed,
                heading: block.heading(),
                signal,
                noise: block.roughness.map(|rough| rough / (2.0 * block.samples)),
            });
        }
    }

    /// Result of the flights so far; `None`: too short.
    pub fn learnt(&self) -> Option<Learnt> {
        if self.blocks.len() < FEWEST_BLOCKS {
            return None;
        }
        let mut theta = [[0.0; SIGNALS]; AXES];
        let mut noise = [[0.0; 2]; AXES];
        for axis in 0..AXES {
            (theta[axis], noise[axis]) = fitted(&self.blocks, axis, self.signals.hover, &self.config);
        }
        Some(Learnt {
            inertia: take_inertia(&mut theta),
            noise,
            theta,
            periods: self.periods,
            flights: self.flights,
            seconds: self.blocks.iter().map(|block| block.elapsed).sum(),
        })
    }
}

/// Factor of the inertia about each axis. The gain common to roll and pitch is the slope of the thrust curve, which
/// does not affect a lost thrust; the rest of an axis' gain is its inertia (or its moment ratio), by which a lost
/// thrust counts more or less.
fn take_inertia(theta: &mut [[f64; SIGNALS]; AXES]) -> [f64; 3] {
    let [roll, pitch] = [theta[1][1], theta[2][2]];
    let common = if roll * pitch > 0.0 {
        roll.signum() * roll.abs().min(pitch.abs())
    } else {
        0.0
    };
    std::array::from_fn(|k| {
        let axis = k + 1;
        let gain = (1.0 + theta[axis][axis]) / (1.0 + common);
        let gain = gain.clamp(0.5, 2.0);
        theta[axis][axis] = common;
        for other in (0..SIGNALS).filter(|other| *other != axis) {
            theta[axis][other] /= gain;
        }
        1.0 / gain
    })
}

/// What was learnt about a vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct Learnt {
    theta: [[f64; SIGNALS]; AXES],
    inertia: [f64; 3],
    /// Remaining gusts and white force of each axis, N².
    noise: [[f64; 2]; AXES],
    /// Of the flights' samples, s: the shortest and the longest.
    periods: [f32; 2],
    /// Number of flights it is based on.
    pub flights: usize,
    /// Flight time it is based on, s.
    pub seconds: f64,
}

impl Learnt {
    /// Inertia about roll, pitch and yaw relative to the model's. The part common to roll and pitch counts as the slope
    /// of the thrust curve, so an inertia that is wrong by the same factor about both stays 1 here.
    pub fn inertia(&self) -> [f64; 3] {
        self.inertia
    }

    /// Lower limit of gusts and white force in a calibration, N²: half of that in the flights.
    pub(crate) fn least_noise(&self) -> [[f64; 2]; AXES] {
        self.noise.map(|levels| levels.map(|level| LEAST_NOISE * level))
    }

    /// The flights and these samples have one rate. What is learnt of changing commands holds for it only: a duty that is
    /// recorded at 100 Hz counts for 10 ms, although the rotor may have had four since.
    fn has_rate_of(&self, period: f32) -> bool {
        self.periods.iter().all(|of| (of / period - 1.0).abs() < SAME_RATE)
    }

    /// The same for samples of this period, s.
    fn at(mut self, period: f32) -> Self {
        if !self.has_rate_of(period) {
            for theta in &mut self.theta {
                theta[FIRST_CHANGE..FIRST_CHANGE + AXES].fill(0.0);
            }
        }
        self
    }

    /// The detectors' vehicle, with everything learnt for which they have a parameter.
    pub(crate) fn config(&self, config: &FdiConfig) -> FdiConfig {
        let mut config = *config;
        let knows_lag = self.has_rate_of(config.period);
        for (inertia, factor) in config.inertia_body.iter_mut().zip(self.inertia) {
            *inertia *= factor as f32;
        }
        let spreads = &mut config.sequential;
        for spread in [
            &mut spreads.gain_spread,
            &mut spreads.centre_of_mass_spread,
            &mut spreads.drag_spread,
        ] {
            *spread *= NARROW;
        }
        if knows_lag {
            spreads.rotor_time_constant_spread *= NARROW;
        }
        config
    }
}

/// Corrects the commands of a flight by what was learnt.
#[derive(Clone, Debug)]
pub(crate) struct Corrected {
    learnt: Learnt,
    signals: Signals,
}

impl Corrected {
    pub(crate) fn new(learnt: Learnt, config: &FdiConfig) -> Self {
        let arm = Meter::new(config).arm;
        Self {
            learnt: learnt.at(config.period),
            signals: Signals::new(config, arm),
        }
    }

    /// See [`Learnt::noise`].
    pub(crate) fn noise(&self) -> [[f64; 2]; AXES] {
        self.learnt.least_noise()
    }

    /// Call before samples that do not follow the previous ones.
    pub(crate) fn begin(&mut self) {
        self.signals.lagged = None;
    }

    /// The sample with the duties that a vehicle as modelled would have needed; one without numbers is unchanged.
    pub(crate) fn of(&mut self, input: &Measurement) -> Measurement {
        let numbers = [input.nav.velocity_ned.to_array(), input.nav.body_rates.to_array()];
        let attitude = input.nav.attitude;
        let all = numbers.as_flattened().iter().chain([
            &attitude.roll,
            &attitude.pitch,
            &attitude.yaw,
            &input.battery_voltage,
        ]);
        if !all.copied().all(f32::is_finite) {
            return *input;
        }
        let rotors = self.signals.config.geometry.rotor_count();
        let map = self.signals.config.thrust_map;
        let thrust = static_thrust(&map, rotors, input);
        let signal = self.signals.of(input, &thrust);
        let wrench: [f32; AXES] = std::array::from_fn(|axis| {
            let sum: f64 = self.learnt.theta[axis]
                .iter()
                .zip(&signal)
                .map(|(theta, s)| theta * s)
                .sum();
            (sum * self.signals.arm[axis]) as f32
        });
        let more = self.signals.config.geometry.allocate(wrench);
        let mut corrected = *input;
        for rotor in 0..rotors {
            if thrust[rotor] > 0.0 {
                let duty = map.duty(thrust[rotor] + more[rotor], input.battery_voltage);
                corrected.command.duty[rotor] = duty.clamp(0.0, 1.0);
            }
        }
        corrected
    }
}
