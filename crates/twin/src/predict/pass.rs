//! One pass over a log: what the model with some effects predicts for every channel, in measurement space.
//!
//! ```text
//!  duty, V ─▶ actuators: delay, dead zone, Eq. 19, lag ─▶ thrust at every sample
//!                                                          │
//!  measured kinematics ─▶ sensors inverted ─▶ motion ──────┼─▶ body: wrench, J⁻¹ ─▶ sensors applied ─▶ F, M
//!                                              └─▶ kinematics ─▶ KV, KA, KP        └─▶ battery ─▶ V
//! ```
//! Times: row k is the state at t_k, the duty of row k acts from t_k to t_{k+1}. Channels of differences (KV, M, KA, KP) stand at k
//! for the step from t_k to t_{k+1}. The duty that predicts step k never answers to what was measured after t_k, so that the feedback
//! of measurement noise through the controller cannot pass for physics. Kinematics and voltage of a step are means of its two ends.
//!
//! Sensor errors are applied to the prediction, never taken off the measurement: dividing the measurement by 1 + s shrinks its noise
//! and wins for every s > 0. Only where a sensor is an *input* of another channel is its error inverted; the accelerometer's as
//! what the model's force makes of it, so that the noise of the reading is not scaled.

use std::sync::{Arc, OnceLock};

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::Vector3;
use rotortwin_plant::battery::{Battery, BatteryModel};
use rotortwin_plant::blades::Blade;
use rotortwin_plant::effects::{Constants, EffectSet, Hooks, Moment, Readings, Wrench};

use super::channels::{CHANNELS, F, KA, KP, KV, M, PerChannel, V};
use super::series::{Drive, Kinematics, Series, shifted};

/// Parts of the chain that an effect touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stages {
    pub(crate) actuators: bool,
    pub(crate) motion: bool,
    pub(crate) body: bool,
    pub(crate) kinematics: bool,
    pub(crate) battery: bool,
}

impl Stages {
    pub(crate) const ALL: Self = Self {
        actuators: true,
        motion: true,
        body: true,
        kinematics: true,
        battery: true,
    };

    /// The stages whose result differs between two vehicles; `extra` are the hooks in which their effects differ.
    pub(crate) fn between(a: &Constants, b: &Constants, extra: Hooks) -> Self {
        if extra.uses(Hooks::VARYING_CONSTANTS) {
            return Self::ALL;
        }
        let voltage = a.voltage_gain != b.voltage_gain || a.voltage_offset_v != b.voltage_offset_v;
        let actuators = voltage
            || a.rotor_gain != b.rotor_gain
            || a.rotor_bias_n != b.rotor_bias_n
            || a.thrust_lag_up_s != b.thrust_lag_up_s
            || a.thrust_lag_down_s != b.thrust_lag_down_s
            || a.speed_domain_share != b.speed_domain_share
            || a.command_delay_s != b.command_delay_s
            || a.dead_zone != b.dead_zone
            || a.duty_limit != b.duty_limit
            || a.esc_resistance_ohm != b.esc_resistance_ohm
            || extra.uses(Hooks::COMMAND)
            || extra.uses(Hooks::STATIC_LIFT);
        let battery = actuators
            || a.internal_resistance_ohm != b.internal_resistance_ohm
            || a.rc_resistance_ohm != b.rc_resistance_ohm
            || a.rc_time_s != b.rc_time_s
            || a.capacity_ah != b.capacity_ah
            || a.charge_offset != b.charge_offset
            || a.power_coefficient_w_per_n15 != b.power_coefficient_w_per_n15;
        let motion = a.accelerometer_bias_m_s2 != b.accelerometer_bias_m_s2
            || a.accelerometer_scale != b.accelerometer_scale
            || a.gyro_bias_rad_s != b.gyro_bias_rad_s
            || a.gyro_scale != b.gyro_scale
            || a.imu_misalignment_rad != b.imu_misalignment_rad
            || a.imu_lever_arm_m != b.imu_lever_arm_m
            || a.level_offset_rad != b.level_offset_rad
            || a.heading_offset_rad != b.heading_offset_rad
            || a.imu_latency_s != b.imu_latency_s
            || a.attitude_latency_s != b.attitude_latency_s
            || a.velocity_latency_s != b.velocity_latency_s
            || a.position_latency_s != b.position_latency_s
            || extra.uses(Hooks::READINGS);
        // Whatever else differs acts on the body: the battery alone does not.
        let without_battery = Constants {
            internal_resistance_ohm: b.internal_resistance_ohm,
            rc_resistance_ohm: b.rc_resistance_ohm,
            rc_time_s: b.rc_time_s,
            capacity_ah: b.capacity_ah,
            charge_offset: b.charge_offset,
            power_coefficient_w_per_n15: b.power_coefficient_w_per_n15,
            ..*a
        };
        let body = actuators
            || motion
            || without_battery != *b
            || extra.uses(Hooks::WIND)
            || extra.uses(Hooks::ROTOR_THRUST)
            || extra.uses(Hooks::WRENCH);
        Self {
            actuators,
            motion,
            body,
            kinematics: motion || a.gravity_m_s2 != b.gravity_m_s2,
            battery,
        }
    }
}

/// What does not change from pass to pass: series, nominal blade and battery.
#[derive(Debug, Clone)]
pub(crate) struct Plant {
    pub(crate) series: Arc<Series>,
    pub(crate) blade: Blade,
    pub(crate) battery_model: BatteryModel,
    /// Charge at the start before any offset, fraction.
    pub(crate) charge: f64,
    /// Gain of the observer of the rates by axis: share of what a reading differs from its forecast that is believed.
    pub(crate) rate_gain: Vector3,
}

/// Σ f^1.5 of the rotors over a stride of steps, N^1.5.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Power {
    pub(crate) mean: f64,
    pub(crate) variance: f64,
}

/// Which kinematics drive a pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// As measured: for residuals.
    Raw,
    /// Smoothed: for sensitivities.
    Smooth,
}

/// The result of a pass; parts that a perturbation leaves alone are shared.
#[derive(Debug, Clone)]
pub(crate) struct Prediction {
    /// Thrust at t_k before the hooks on it, N: `k * rotors + i`.
    pub(crate) thrust: Arc<Vec<f64>>,
    /// √ of it, where an effect has asked for it: many effects need the rotors' speeds, and roots are dear.
    root: Arc<OnceLock<Vec<f64>>>,
    /// True motion as reconstructed from the readings.
    pub(crate) motion: Arc<Kinematics>,
    /// Rates over step k as its start foretells them, rad/s: what torques are predicted with.
    foretold: Arc<Vec<Vector3>>,
    /// Prediction of each channel.
    pub(crate) channels: [Arc<Vec<f64>>; CHANNELS],
}

/// What a moment stands for: the instant t_k, or the step from t_k to t_{k+1} (kinematics as means of both ends).
#[derive(Debug, Clone, Copy)]
enum When {
    Sample(usize),
    Step(usize),
}

/// Mean of two samples.
#[inline]
fn between(x: &[Vector3], k: usize, next: usize) -> Vector3 {
    let (a, b) = (&x[k], &x[next]);
    [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])]
}

/// Rotation in the middle of two samples: their mean is one to the second order of the angle between them.
#[inline]
fn turned(x: &[[Vector3; 3]], k: usize, next: usize) -> [Vector3; 3] {
    let (a, b) = (&x[k], &x[next]);
    let row = |i: usize| {
        [
            0.5 * (a[i][0] + b[i][0]),
            0.5 * (a[i][1] + b[i][1]),
            0.5 * (a[i][2] + b[i][2]),
        ]
    };
    [row(0), row(1), row(2)]
}

/// What comes of the body.
#[derive(Debug, Default)]
struct Body {
    /// Reading of the accelerometer at t_k, m/s².
    accel: Vec<Vector3>,
    /// Rate of the gyroscope's reading over step k, rad/s².
    spin_up: Vec<Vector3>,
    /// True specific force over step k, m/s²; only where there is no accelerometer.
    of_steps: Option<Vec<Vector3>>,
    /// Rates over step k, rad/s, where the observer was run.
    foretold: Option<Vec<Vector3>>,
    /// What the accelerometer reads too much at t_k, m/s², told by the model's own force; `None` if its readings are true. The velocity
    /// is predicted from the readings less this. To divide a reading by its scale would shrink or swell its noise, and win or lose for
    /// that.
    accel_error: Option<Vec<Vector3>>,
}

/// The three components of a vector series.
fn split(x: &[Vector3]) -> [Vec<f64>; 3] {
    std::array::from_fn(|axis| x.iter().map(|v| v[axis]).collect())
}

/// Puts three channels in place; one that is as in `base` stays shared with it.
fn put(
    channels: &mut [Arc<Vec<f64>>; CHANNELS],
    first: usize,
    columns: [Vec<f64>; 3],
    base: Option<(&Prediction, Stages)>,
) {
    for (i, column) in columns.into_iter().enumerate() {
        let same = base.is_some_and(|(base, _)| *base.channels[first + i] == column);
        if !same {
            channels[first + i] = Arc::new(column);
        }
    }
}

impl Plant {
    /// Runs the stages that differ from `base`; all of them without one.
    pub(crate) fn run(&self, effects: &EffectSet, source: Source, base: Option<(&Prediction, Stages)>) -> Prediction {
        let stages = base.map_or(Stages::ALL, |(_, stages)| stages);
        let motion = match base {
            Some((base, stages)) if !stages.motion => Arc::clone(&base.motion),
            _ => Arc::new(self.motion(effects, source)),
        };
        let (thrust, root) = match base {
            Some((base, stages)) if !stages.actuators => (Arc::clone(&base.thrust), Arc::clone(&base.root)),
            _ => (Arc::new(self.actuators(effects.clone(), &motion)), Arc::default()),
        };
        let mut channels: [Arc<Vec<f64>>; CHANNELS] = match base {
            Some((base, _)) => base.channels.clone(),
            None => std::array::from_fn(|_| Arc::new(Vec::new())),
        };
        let have = self.series.available;
        let mut body = Body::default();
        let mut foretold = base.map_or_else(Arc::default, |(base, _)| Arc::clone(&base.foretold));
        if stages.body && self.series.drive != Drive::None {
            let known = (!foretold.is_empty() && !stages.motion).then_some(foretold.as_slice());
            body = self.body(effects.clone(), &motion, &thrust, &root, known);
            if let Some(made) = body.foretold.take() {
                foretold = Arc::new(made);
            }
            if have.accel {
                put(&mut channels, F, split(&body.accel), base);
            }
            if have.rates {
                put(&mut channels, M, split(&body.spin_up), base);
            }
        }
        // Without an accelerometer the force of the model shows in the velocity.
        if stages.kinematics || (!have.accel && stages.body) {
            self.kinematics(effects.constants(), &motion, &body, &mut channels);
        }
        if stages.battery && have.voltage && self.series.drive != Drive::None {
            channels[V] = Arc::new(self.battery(effects.clone(), &motion, &thrust));
        }
        Prediction {
            thrust,
            root,
            motion,
            foretold,
            channels,
        }
    }

    /// The true motion behind the readings: latencies undone, sensor errors inverted by fixed-point iteration; but for those of the
    /// accelerometer, which [`Self::body`] tells where there is a model's force.
    fn motion(&self, effects: &EffectSet, source: Source) -> Kinematics {
        let measured = match source {
            Source::Raw => self.series.whole(),
            Source::Smooth => &self.series.smooth,
        };
        let c = effects.constants();
        let step = self.series.step_s;
        let at = |x: &Vec<Vector3>, latency: f64| {
            if latency == 0.0 {
                x.clone()
            } else {
                shifted(x, latency, step)
            }
        };
        let mut motion = Kinematics {
            position: at(&measured.position, c.position_latency_s),
            velocity: at(&measured.velocity, c.velocity_latency_s),
            attitude: at(&measured.attitude, c.attitude_latency_s),
            rates: at(&measured.rates, c.imu_latency_s),
            angular_acceleration: at(&measured.angular_acceleration, c.imu_latency_s),
            accel: at(&measured.accel, c.imu_latency_s),
            // The noise of a reading must not come back through its own prediction: a load that pulls with its mass times what the
            // accelerometer reads would add its share of the noise, and lose to any rival that does not.
            driving_accel: at(&self.series.smooth.driving_accel, c.imu_latency_s),
            observed_rates: match source {
                Source::Raw => Vec::new(),
                Source::Smooth => at(&self.series.whole().rates, c.imu_latency_s),
            },
            ned_from_body: Vec::new(),
        };
        motion.ned_from_body = motion.attitude.iter().map(|&attitude| rotation(attitude)).collect();
        let mut set = effects.clone();
        let hooked = set.hooks().uses(Hooks::READINGS);
        if !hooked && sensors_are_exact(c) {
            return motion;
        }
        let nothing = [0.0; MAX_ROTORS];
        let n = self.series.rotors;
        let mut c = *c;
        let turning = at(&self.series.smooth.angular_acceleration, c.imu_latency_s);
        for k in 0..self.series.len {
            if set.begin(self.series.time(k)) {
                c = *set.constants();
            }
            let read = Readings {
                position_ned: motion.position[k],
                velocity_ned: motion.velocity[k],
                attitude: motion.attitude[k],
                body_rates: motion.rates[k],
                specific_force: motion.driving_accel[k],
                battery_voltage: 0.0,
            };
            let mut truth = read;
            for _ in 0..3 {
                let mut again = truth;
                c.corrupt(&mut again, turning[k]);
                if hooked {
                    // The rotors' thrust comes later in the chain; the specific force tells their sum.
                    let each = (-c.mass_kg * truth.specific_force[2] / n as f64).max(0.0);
                    let thrust = [each; MAX_ROTORS];
                    let at = self.moment(When::Sample(k), &motion, &c, &thrust[..n], &nothing[..n], &nothing[..n]);
                    set.readings(&at, &mut again);
                }
                for i in 0..3 {
                    truth.position_ned[i] += read.position_ned[i] - again.position_ned[i];
                    truth.velocity_ned[i] += read.velocity_ned[i] - again.velocity_ned[i];
                    truth.attitude[i] += read.attitude[i] - again.attitude[i];
                    truth.body_rates[i] += read.body_rates[i] - again.body_rates[i];
                    truth.specific_force[i] += read.specific_force[i] - again.specific_force[i];
                }
            }
            motion.position[k] = truth.position_ned;
            motion.velocity[k] = truth.velocity_ned;
            if motion.attitude[k] != truth.attitude {
                motion.attitude[k] = truth.attitude;
                motion.ned_from_body[k] = rotation(truth.attitude);
            }
            motion.rates[k] = truth.body_rates;
            if let Some(observed) = motion.observed_rates.get_mut(k) {
                for i in 0..3 {
                    observed[i] += truth.body_rates[i] - read.body_rates[i];
                }
            }
            motion.driving_accel[k] = truth.specific_force;
            if self.series.drive == Drive::None {
                // Without a model's force; with one, `body` tells the accelerometer's errors.
                for i in 0..3 {
                    motion.accel[k][i] += truth.specific_force[i] - read.specific_force[i];
                }
            }
        }
        motion
    }

    fn moment<'a>(
        &'a self,
        when: When,
        motion: &Kinematics,
        constants: &'a Constants,
        thrust: &'a [f64],
        ratio: &'a [f64],
        rate: &'a [f64],
    ) -> Moment<'a> {
        let s = &self.series;
        let (k, next) = match when {
            When::Sample(k) => (k, k),
            When::Step(k) => (k, k + 1),
        };
        let ned_from_body = turned(&motion.ned_from_body, k, next);
        let wind = constants.wind_ned_m_s;
        let v = between(&motion.velocity, k, next);
        let relative = [v[0] - wind[0], v[1] - wind[1], v[2] - wind[2]];
        let n = s.rotors;
        Moment {
            time_s: s.time(k),
            step_s: s.step_s,
            position_ned: motion.position[k],
            velocity_ned: v,
            air_velocity_body: to_body(&ned_from_body, relative),
            body_rates: between(&motion.rates, k, next),
            angular_acceleration: between(&motion.angular_acceleration, k, next),
            specific_force: between(&motion.driving_accel, k, next),
            ned_from_body,
            height_above_ground: s.height[k],
            rotor_thrust: thrust,
            rotor_speed_ratio: ratio,
            rotor_speed_rate: rate,
            duty: &s.input[k * n..(k + 1) * n],
            battery_voltage: s.voltage.get(k).copied().unwrap_or(0.0),
            battery_current: 0.0,
            constants,
        }
    }

    /// Thrust of every rotor at every sample, N.
    fn actuators(&self, mut set: EffectSet, motion: &Kinematics) -> Vec<f64> {
        let s = &self.series;
        let n = s.rotors;
        let mut out = Vec::with_capacity(s.len * n);
        if s.drive == Drive::RotorSpeed {
            let c = set.constants();
            for k in 0..s.len {
                for i in 0..n {
                    let ratio = s.input[k * n + i] / c.hover_rotor_speed_rad_s;
                    out.push(c.rotor_gain[i] * c.hover_thrust_n * ratio * ratio + c.rotor_bias_n[i]);
                }
            }
            return out;
        }
        let nominal_voltage = self.resting_voltage();
        let mut thrust = [0.0; MAX_ROTORS];
        let mut started = false;
        let (mut lift, mut duty) = ([0.0; MAX_ROTORS], [0.0; MAX_ROTORS]);
        let (mut ratio, mut rate) = ([0.0; MAX_ROTORS], [0.0; MAX_ROTORS]);
        // exp(−h/τ) is asked for at every step and rotor with the same few τ.
        let mut decay = (f64::NAN, 0.0, f64::NAN, 0.0);
        let mut voltage = nominal_voltage;
        let hooks = Hooks::COMMAND;
        for k in 0..s.len {
            if k > 0 {
                out.extend_from_slice(&thrust[..n]);
            }
            set.begin(s.time(k));
            let c = set.constants();
            if decay.0 != c.thrust_lag_up_s || decay.2 != c.thrust_lag_down_s {
                decay = (
                    c.thrust_lag_up_s,
                    1.0 - libm::exp(-s.step_s / c.thrust_lag_up_s),
                    c.thrust_lag_down_s,
                    1.0 - libm::exp(-s.step_s / c.thrust_lag_down_s),
                );
            }
            if let Some(v) = self.logged_voltage(k) {
                voltage = (v - c.voltage_offset_v) / (1.0 + c.voltage_gain);
            }
            self.delayed_input(k, c.command_delay_s, &mut duty);
            let active = set.hooks();
            if active.uses(hooks) || active.uses(Hooks::STATIC_LIFT) || active.uses(Hooks::ADVANCE) {
                let c = *set.constants();
                for i in 0..n {
                    ratio[i] = (thrust[i].max(0.0) / c.hover_thrust_n).sqrt();
                    rate[i] = 0.0;
                }
                let at = self.moment(When::Sample(k), motion, &c, &thrust[..n], &ratio[..n], &rate[..n]);
                set.command(&at, &mut duty[..n]);
                self.static_lift(&c, &duty, voltage, &thrust, &mut lift);
                set.static_lift(&at, &mut lift[..n]);
                set.advance(&at, s.step_s);
            } else {
                self.static_lift(c, &duty, voltage, &thrust, &mut lift);
            }
            let c = set.constants();
            if !started {
                started = true;
                thrust[..n].copy_from_slice(&lift[..n]);
                out.extend_from_slice(&thrust[..n]);
            }
            for i in 0..n {
                thrust[i] = if c.speed_domain_share == 0.0 {
                    let share = if lift[i] > thrust[i] { decay.1 } else { decay.3 };
                    thrust[i] + share * (lift[i] - thrust[i])
                } else {
                    // Midpoint rule: the lag of the speed has no closed form that is cheaper.
                    let half = thrust[i] + 0.5 * s.step_s * c.thrust_rate(lift[i], thrust[i]);
                    thrust[i] + s.step_s * c.thrust_rate(lift[i], half)
                };
            }
        }
        out.truncate(s.len * n);
        out
    }

    /// Logged voltage of step k, V, the mean of both ends where there are two: it sags while the thrust rises, and that of the start
    /// alone would pass for a slower motor.
    #[inline]
    fn logged_voltage(&self, k: usize) -> Option<f64> {
        let voltage = &self.series.voltage;
        let start = *voltage.get(k)?;
        let end = voltage.get(k + 1).copied().filter(|v| v.is_finite()).unwrap_or(start);
        let mean = 0.5 * (start + end);
        mean.is_finite().then_some(mean)
    }

    /// The input in force over step k, `delay_s` late; of two samples in one step, the mean by their share of the time.
    fn delayed_input(&self, k: usize, delay_s: f64, duty: &mut [f64; MAX_ROTORS]) {
        let s = &self.series;
        let n = s.rotors;
        if delay_s == 0.0 {
            duty[..n].copy_from_slice(&s.input[k * n..(k + 1) * n]);
            return;
        }
        let steps = delay_s / s.step_s;
        let whole = steps.floor();
        let part = steps - whole;
        let last = s.len as i64 - 1;
        let newer = (k as i64 - whole as i64).clamp(0, last) as usize;
        let older = (k as i64 - whole as i64 - 1).clamp(0, last) as usize;
        for i in 0..n {
            duty[i] = (1.0 - part) * s.input[newer * n + i] + part * s.input[older * n + i];
        }
    }

    fn static_lift(
        &self,
        c: &Constants,
        duty: &[f64; MAX_ROTORS],
        voltage: f64,
        thrust: &[f64; MAX_ROTORS],
        lift: &mut [f64; MAX_ROTORS],
    ) {
        for i in 0..self.series.rotors {
            let bare = if self.series.drive == Drive::Wrench {
                duty[i]
            } else {
                let mut seen = voltage;
                if c.esc_resistance_ohm != 0.0 {
                    let f = thrust[i].max(0.0);
                    seen -= c.esc_resistance_ohm * c.power_coefficient_w_per_n15 * f * f.sqrt() / voltage;
                }
                self.blade.lift(c.effective_duty(duty[i]), seen)
            };
            let bias = if duty[i] > 0.0 { c.rotor_bias_n[i] } else { 0.0 };
            lift[i] = (c.rotor_gain[i] * bare + bias).max(0.0);
        }
    }

    /// Open-circuit voltage at the start: what Eq. 19 gets where no voltage was logged.
    fn resting_voltage(&self) -> f64 {
        Battery::new(&self.battery_model).open_circuit_voltage(self.charge)
    }

    /// What the mean of the thrust over the two steps around t_k has more than the thrust at t_k: (f_{k−1} − 2 f_k + f_{k+1})/4, N.
    /// A new duty bends the thrust there by up to step/τ of the duty's change; rounded off, it looks like a command that is early.
    fn corner(&self, k: usize, thrust: &[f64]) -> [f64; MAX_ROTORS] {
        let n = self.series.rotors;
        let mut out = [0.0; MAX_ROTORS];
        if k > 0 && k + 1 < self.series.len {
            for (i, out) in out.iter_mut().enumerate().take(n) {
                *out = 0.25 * (thrust[(k - 1) * n + i] - 2.0 * thrust[k * n + i] + thrust[(k + 1) * n + i]);
            }
        }
        out
    }

    /// What the model does to the body, and what the IMU reads of it. `root` is √thrust, where effects of rotors or wrench act;
    /// `foretold` the rates over each step, where they are known.
    ///
    /// The rates come of an observer, ω̂ ← ω̂ + h ω̇ + K (y − ω̂ − h ω̇), never of what was measured after the step began: a disturbance
    /// of the step lives on in the rates that follow, and a damping told by these would come out too small by h q²/(2 ⟨ω²⟩), q the
    /// disturbance as an angular acceleration (a third of a usual damping on a calm flight).
    fn body(
        &self,
        mut set: EffectSet,
        motion: &Kinematics,
        thrust: &[f64],
        root: &OnceLock<Vec<f64>>,
        foretold: Option<&[Vector3]>,
    ) -> Body {
        let s = &self.series;
        let n = s.rotors;
        let zero = [0.0; 3];
        let (mut force, mut spin_up) = (vec![zero; s.len], vec![zero; s.len]);
        let mut of_steps = (!s.available.accel).then(|| vec![zero; s.len]);
        let mut f = [0.0; MAX_ROTORS];
        // Σ f at t_{k−1}, t_k, t_{k+1}.
        let mut sums = [0.0, 0.0, thrust[..n].iter().sum::<f64>()];
        let (mut ratio, mut rate) = ([0.0; MAX_ROTORS], [0.0; MAX_ROTORS]);
        // A copy, because the hooks change the set; taken anew only where effects set in or vary.
        let mut c = *set.constants();
        let mut inverse = inverted(&c.inertia_body_kg_m2);
        let roots = |hooked: bool| -> &[f64] {
            if hooked {
                root.get_or_init(|| thrust.iter().map(|f| f.max(0.0).sqrt()).collect())
            } else {
                &[]
            }
        };
        let mut hooked = hooked_body(&set);
        let mut root = roots(hooked);
        let steps = s.len - 1;
        let read = if motion.observed_rates.is_empty() {
            &motion.rates
        } else {
            &motion.observed_rates
        };
        let mut observed = read[0];
        let mut made = foretold.is_none().then(|| Vec::with_capacity(s.len));
        for k in 0..steps {
            if set.begin(s.time(k)) {
                c = *set.constants();
                inverse = inverted(&c.inertia_body_kg_m2);
                hooked = hooked_body(&set);
                root = roots(hooked);
            }
            let active = set.hooks();
            let omega = match foretold {
                Some(known) => known[k],
                None => {
                    // Half a step on; its own angular acceleration is not known yet.
                    let turning = if k > 0 { spin_up[k - 1] } else { zero };
                    [0, 1, 2].map(|i| observed[i] + 0.5 * s.step_s * turning[i])
                }
            };
            sums = [sums[1], sums[2], 0.0];
            for i in 0..n {
                let after = thrust[(k + 1) * n + i];
                f[i] = 0.5 * (thrust[k * n + i] + after);
                sums[2] += after;
            }
            let mut w: Wrench;
            if hooked {
                let per = (1.0 / c.hover_thrust_n).sqrt();
                for i in 0..n {
                    let (before, after) = (root[k * n + i] * per, root[(k + 1) * n + i] * per);
                    ratio[i] = 0.5 * (before + after);
                    rate[i] = (after - before) / s.step_s;
                }
                let undisturbed = f;
                let mut at = self.moment(When::Step(k), motion, &c, &undisturbed[..n], &ratio[..n], &rate[..n]);
                at.body_rates = omega;
                if active.uses(Hooks::WIND) {
                    let mut wind = c.wind_ned_m_s;
                    set.wind(&at, &mut wind);
                    let v = at.velocity_ned;
                    let relative = [v[0] - wind[0], v[1] - wind[1], v[2] - wind[2]];
                    at.air_velocity_body = to_body(&at.ned_from_body, relative);
                }
                set.rotor_thrust(&at, &mut f[..n]);
                w = c.rotor_wrench(&f[..n]);
                set.wrench(&at, &mut w);
                w = w.closed(at.air_velocity_body, at.body_rates, &c);
                set.advance(&at, s.step_s);
            } else {
                w = c.rotor_wrench(&f[..n]);
                if c.linear_drag_kg_s != 0.0 || c.angular_drag_nms != 0.0 {
                    let r = turned(&motion.ned_from_body, k, k + 1);
                    let (v, wind) = (between(&motion.velocity, k, k + 1), c.wind_ned_m_s);
                    let relative = [v[0] - wind[0], v[1] - wind[1], v[2] - wind[2]];
                    w = w.closed(to_body(&r, relative), omega, &c);
                }
            }
            let momentum = times(&c.inertia_body_kg_m2, omega);
            let gyroscopic = cross(omega, momentum);
            let (torque, push) = (w.torque_body, w.force_body);
            let net = [
                torque[0] - gyroscopic[0],
                torque[1] - gyroscopic[1],
                torque[2] - gyroscopic[2],
            ];
            spin_up[k] = times(&inverse, net);
            if let Some(made) = &mut made {
                made.push(omega);
                for i in 0..3 {
                    let forecast = observed[i] + s.step_s * spin_up[k][i];
                    observed[i] = forecast + self.rate_gain[i] * (read[k + 1][i] - forecast);
                }
            }
            let per_mass = 1.0 / c.mass_kg;
            let mean = [push[0] * per_mass, push[1] * per_mass, push[2] * per_mass];
            if let Some(of_steps) = &mut of_steps {
                of_steps[k] = mean;
            }
            // The value at t_k lies between the means of the steps on either side, less the corner of the thrust between them (along
            // the body's axis: what a tilted rotor's corner does sideways is nothing).
            for i in 0..3 {
                force[k][i] += 0.5 * mean[i];
                force[k + 1][i] = 0.5 * mean[i];
            }
            if k > 0 {
                force[k][2] += 0.25 * per_mass * (sums[0] - 2.0 * sums[1] + sums[2]);
            }
        }
        spin_up[steps] = spin_up[steps - 1];
        for end in [0, steps] {
            force[end] = force[end].map(|half| 2.0 * half);
        }
        if let Some(of_steps) = &mut of_steps {
            of_steps[steps] = of_steps[steps - 1];
        }
        let mut c = *set.constants();
        let hooked = set.hooks().uses(Hooks::READINGS);
        let mut moments = spin_up;
        let mut accel_error = None;
        if hooked || !sensors_are_exact(&c) {
            let spin_up = moments.clone();
            let error = accel_error.insert(vec![zero; s.len]);
            let nothing = [0.0; MAX_ROTORS];
            let mut set = set.clone();
            for k in 0..s.len {
                if set.begin(s.time(k)) {
                    c = *set.constants();
                }
                let mut read = Readings {
                    specific_force: force[k],
                    body_rates: motion.rates[k],
                    attitude: motion.attitude[k],
                    velocity_ned: motion.velocity[k],
                    position_ned: motion.position[k],
                    battery_voltage: 0.0,
                };
                // The model's own angular acceleration at t_k: the measured one is all noise, or smoothed away.
                let before = if k > 0 { spin_up[k - 1] } else { spin_up[k] };
                let mut turning = [0, 1, 2].map(|i| 0.5 * (before[i] + spin_up[k][i]));
                if c.imu_lever_arm_m != zero {
                    let rounded = times(&inverse, c.rotor_wrench(&self.corner(k, thrust)[..n]).torque_body);
                    turning = [0, 1, 2].map(|i| turning[i] - rounded[i]);
                }
                c.corrupt(&mut read, turning);
                if hooked {
                    for i in 0..n {
                        ratio[i] = (thrust[k * n + i].max(0.0) / c.hover_thrust_n).sqrt();
                    }
                    let at = self.moment(
                        When::Sample(k),
                        motion,
                        &c,
                        &thrust[k * n..(k + 1) * n],
                        &ratio[..n],
                        &nothing[..n],
                    );
                    set.readings(&at, &mut read);
                }
                error[k] = [0, 1, 2].map(|i| read.specific_force[i] - force[k][i]);
                force[k] = read.specific_force;
                // The rate of what the gyroscope reads: its errors without the bias.
                let scale = 1.0 + c.gyro_scale;
                let turned = cross(c.imu_misalignment_rad, spin_up[k]);
                moments[k] = [0, 1, 2].map(|i| scale * (spin_up[k][i] + turned[i]));
            }
        }
        if c.imu_latency_s != 0.0 {
            force = shifted(&force, -c.imu_latency_s, s.step_s);
            // Means over steps: what was measured after t_k must not come in (the duty of row k + 1 answers to its noise).
            moments = late_means(&moments, c.imu_latency_s, s.step_s);
        }
        Body {
            accel: force,
            spin_up: moments,
            of_steps,
            foretold: made,
            accel_error,
        }
    }

    /// KV, KA, KP.
    fn kinematics(&self, c: &Constants, motion: &Kinematics, body: &Body, channels: &mut [Arc<Vec<f64>>; CHANNELS]) {
        let s = &self.series;
        let have = s.available;
        let step = s.step_s;
        let mut put = |first: usize, rate: Vec<Vector3>, latency: f64, mean: bool| {
            let rate = if latency == 0.0 {
                rate
            } else {
                shifted(&rate, -latency, step)
            };
            for i in 0..3 {
                let column = (0..s.len)
                    .map(|k| {
                        let next = if mean { (k + 1).min(s.len - 1) } else { k };
                        0.5 * (rate[k][i] + rate[next][i])
                    })
                    .collect();
                channels[first + i] = Arc::new(column);
            }
        };
        if have.velocity && have.attitude {
            let force = if have.accel {
                Some(&motion.accel)
            } else {
                body.of_steps.as_ref()
            };
            if let Some(force) = force {
                let error = body.accel_error.as_ref().filter(|_| have.accel);
                let rate = (0..s.len)
                    .map(|k| {
                        let r = motion.ned_from_body[k];
                        let mut f = force[k];
                        if let Some(error) = error {
                            f = [f[0] - error[k][0], f[1] - error[k][1], f[2] - error[k][2]];
                        }
                        let mut a = times(&r, f);
                        a[2] += c.gravity_m_s2;
                        a
                    })
                    .collect();
                // The model's force is a step mean already.
                put(KV, rate, c.velocity_latency_s, have.accel);
            }
        }
        if have.attitude && have.rates {
            let rate = (0..s.len)
                .map(|k| euler_rates(&motion.ned_from_body[k], motion.rates[k]))
                .collect();
            put(KA, rate, c.attitude_latency_s, true);
        }
        if have.position && have.velocity {
            put(KP, motion.velocity.clone(), c.position_latency_s, true);
        }
    }

    /// Battery voltage as the sensor reads it, V.
    fn battery(&self, set: EffectSet, motion: &Kinematics, thrust: &[f64]) -> Vec<f64> {
        self.battery_of(set, motion, thrust, &self.powers(thrust, 1), 1)
    }

    /// Σ f^1.5 of the rotors: means and variances over `stride` steps.
    pub(crate) fn powers(&self, thrust: &[f64], stride: usize) -> Vec<Power> {
        let n = self.series.rotors;
        let sum = |thrust: &[f64]| -> f64 {
            thrust
                .iter()
                .map(|f| {
                    let f = f.max(0.0);
                    f * f.sqrt()
                })
                .sum()
        };
        thrust
            .chunks(n * stride)
            .map(|chunk| {
                let steps = (chunk.len() / n) as f64;
                let mean = sum(chunk) / steps;
                let square = |step: &[f64]| (sum(step) - mean) * (sum(step) - mean);
                let variance = if stride > 1 {
                    chunk.chunks(n).map(square).sum::<f64>() / steps
                } else {
                    0.0
                };
                Power { mean, variance }
            })
            .collect()
    }

    /// The same with Σ f^1.5 given, in strides of several steps. The voltage bends with the power P: its mean over a stride in which P
    /// varies is V(P̄) + V″ σ²/2, V″ = −2 R²/(V_oc² − 4 R P)^1.5.
    pub(crate) fn battery_of(
        &self,
        mut set: EffectSet,
        motion: &Kinematics,
        thrust: &[f64],
        powers: &[Power],
        stride: usize,
    ) -> Vec<f64> {
        let s = &self.series;
        let n = s.rotors;
        let step_s = s.step_s * stride as f64;
        let battery = Battery::new(&self.battery_model);
        let mut charge = self.charge + set.constants().charge_offset;
        let mut relaxation = 0.0;
        let mut out = Vec::with_capacity(powers.len());
        let nothing = [0.0; MAX_ROTORS];
        let advancing = set.hooks().uses(Hooks::ADVANCE) && set.hooks().uses(Hooks::VARYING_CONSTANTS);
        for (j, sum) in powers.iter().enumerate() {
            let k = j * stride;
            set.begin(s.time(k));
            let c = set.constants();
            let power = sum.mean * c.power_coefficient_w_per_n15;
            let open = battery.open_circuit_voltage(charge) - relaxation;
            let root = (open * open - 4.0 * c.internal_resistance_ohm * power).max(0.0).sqrt();
            let mut voltage = 0.5 * (open + root);
            if stride > 1 && root > 0.0 {
                let bend = c.internal_resistance_ohm * c.power_coefficient_w_per_n15;
                voltage -= bend * bend * sum.variance / (root * root * root);
            }
            let current = power / voltage.max(1e-3);
            charge -= current * step_s / (3600.0 * c.capacity_ah);
            if c.rc_resistance_ohm != 0.0 {
                let share = 1.0 - libm::exp(-step_s / c.rc_time_s);
                relaxation += share * (c.rc_resistance_ohm * current - relaxation);
            }
            out.push((1.0 + c.voltage_gain) * voltage + c.voltage_offset_v);
            if advancing {
                let c = *c;
                let mut at = self.moment(
                    When::Sample(k),
                    motion,
                    &c,
                    &thrust[k * n..(k + 1) * n],
                    &nothing[..n],
                    &nothing[..n],
                );
                at.battery_current = current;
                set.advance(&at, step_s);
            }
        }
        out
    }
}

/// Means over steps of a signal that is `delay_s` late: the mean of two neighbouring steps by their share of the time. Exact for
/// values that are constant over a step, and for a delay ≥ 0 no later step than its own comes in.
fn late_means(x: &[Vector3], delay_s: f64, step_s: f64) -> Vec<Vector3> {
    let steps = delay_s / step_s;
    let whole = steps.floor();
    let part = steps - whole;
    let last = x.len() as i64 - 1;
    (0..=last)
        .map(|k| {
            let newer = x[(k - whole as i64).clamp(0, last) as usize];
            let older = x[(k - whole as i64 - 1).clamp(0, last) as usize];
            [0, 1, 2].map(|i| (1.0 - part) * newer[i] + part * older[i])
        })
        .collect()
}

/// True where an effect acts on rotors, wrench or wind.
fn hooked_body(set: &EffectSet) -> bool {
    let hooks = set.hooks();
    [Hooks::ROTOR_THRUST, Hooks::WRENCH, Hooks::WIND, Hooks::ADVANCE]
        .into_iter()
        .any(|hook| hooks.uses(hook))
}

fn sensors_are_exact(c: &Constants) -> bool {
    c.accelerometer_bias_m_s2 == [0.0; 3]
        && c.accelerometer_scale == 0.0
        && c.gyro_bias_rad_s == [0.0; 3]
        && c.gyro_scale == 0.0
        && c.imu_misalignment_rad == [0.0; 3]
        && c.imu_lever_arm_m == [0.0; 3]
        && c.level_offset_rad == [0.0; 2]
        && c.heading_offset_rad == 0.0
}

/// The measured side of every channel: accelerometer, difference quotients, voltage.
pub(crate) fn measured(series: &Series) -> PerChannel {
    let have = series.available;
    let n = series.len;
    let per = 1.0 / series.step_s;
    let mut out: PerChannel = std::array::from_fn(|_| Vec::new());
    let difference = |x: &[Vector3], i: usize| -> Vec<f64> {
        (0..n)
            .map(|k| {
                if k + 1 < n {
                    (x[k + 1][i] - x[k][i]) * per
                } else {
                    f64::NAN
                }
            })
            .collect()
    };
    let driven = series.drive != Drive::None;
    for i in 0..3 {
        if have.accel && driven {
            out[F + i] = series.raw.accel.iter().map(|a| a[i]).collect();
        }
        if have.velocity && have.attitude && (have.accel || driven) {
            out[KV + i] = difference(&series.raw.velocity, i);
        }
        if have.rates && driven {
            out[M + i] = difference(&series.raw.rates, i);
        }
        if have.attitude && have.rates {
            out[KA + i] = difference(&series.raw.attitude, i);
        }
        if have.position && have.velocity {
            out[KP + i] = difference(&series.raw.position, i);
        }
    }
    if have.voltage && driven {
        out[V] = series.voltage.clone();
    }
    out
}

/// R of Eq. 2, rows first.
pub(crate) fn rotation(attitude: Vector3) -> [Vector3; 3] {
    let (sr, cr) = libm::sincos(attitude[0]);
    let (sp, cp) = libm::sincos(attitude[1]);
    let (sy, cy) = libm::sincos(attitude[2]);
    [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
}

/// η̇ = T(η) ω, with the sines and cosines of η taken from R (pitch within ±π/2).
fn euler_rates(ned_from_body: &[Vector3; 3], rates: Vector3) -> Vector3 {
    let [minus_sp, sr_cp, cr_cp] = ned_from_body[2];
    let (sp, cp) = (-minus_sp, (sr_cp * sr_cp + cr_cp * cr_cp).sqrt());
    let (sr, cr) = (sr_cp / cp, cr_cp / cp);
    let across = sr * rates[1] + cr * rates[2];
    [rates[0] + across * sp / cp, cr * rates[1] - sr * rates[2], across / cp]
}

pub(crate) fn to_body(r: &[Vector3; 3], v: Vector3) -> Vector3 {
    [0, 1, 2].map(|i| r[0][i] * v[0] + r[1][i] * v[1] + r[2][i] * v[2])
}

#[inline]
pub(crate) fn times(m: &[Vector3; 3], v: Vector3) -> Vector3 {
    // Not `map`, which the compiler leaves a call in the hottest loop of all.
    let dot = |row: &Vector3| row[0] * v[0] + row[1] * v[1] + row[2] * v[2];
    [dot(&m[0]), dot(&m[1]), dot(&m[2])]
}

pub(crate) fn cross(a: Vector3, b: Vector3) -> Vector3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Inverse of a 3×3 matrix by cofactors.
pub(crate) fn inverted(m: &[Vector3; 3]) -> [Vector3; 3] {
    let rows = [cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])];
    let per = 1.0 / (m[0][0] * rows[0][0] + m[0][1] * rows[0][1] + m[0][2] * rows[0][2]);
    [0, 1, 2].map(|i| [rows[0][i] * per, rows[1][i] * per, rows[2][i] * per])
}
