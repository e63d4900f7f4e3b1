//! One pass over a log: the prediction of the model with some effects for every channel, in measurement space.
//!
//! ```text
//!  duty, V ─▶ actuators: delay, dead zone, Eq. 19, lag ─▶ thrust at every sample
//!                                                          │
//!  measured kinematics ─▶ sensors inverted ─▶ motion ──────┼─▶ body: wrench, J⁻¹ ─▶ sensors applied ─▶ F, M
//!                                              └─▶ kinematics ─▶ KV, KA, KP        └─▶ battery ─▶ V
//! ```
//! Times: row k is the state at t_k, the duty of row k acts from t_k to t_{k+1}. Channels of differences (KV, M, KA,
//! KP) at k belong to the step from t_k to t_{k+1}. The duty that predicts step k never depends on measurements after
//! t_k, so that feedback of measurement noise through the controller cannot be mistaken for physics. Velocity, attitude
//! and voltage of a step are means of its two ends; its rates are predicted from earlier readings ([`Plant::steps`]).
//!
//! Sensor errors are applied to the prediction, never removed from the measurement: dividing the measurement by 1 + s
//! shrinks its noise and wins for every s > 0. Only where a sensor is an *input* of another channel is its error
//! inverted; for the accelerometer, by the amount that follows from the model's force, so that the noise of the reading
//! is not scaled.

mod actuators;
mod battery;
mod body;
mod kinematics;
mod motion;
#[cfg(test)]
mod tests;

use std::sync::{Arc, OnceLock};

use rotortwin_plant::Vector3;
use rotortwin_plant::effects::{Constants, EffectSet, Hooks, Moment};
use rotortwin_plant::powertrain::battery::BatteryModel;
use rotortwin_plant::powertrain::blades::Blade;

use super::channels::{CHANNELS, F, KA, KP, KV, M, PerChannel, V};
use super::series::{Drive, Kinematics, Series, Vectors};
use super::vectors::to_body;
use body::{Imu, Steps, hooked_body};

pub(crate) use battery::{Power, root};

/// Parts of the chain that an effect touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stages {
    pub(crate) actuators: bool,
    pub(crate) motion: bool,
    /// What acts on the body; another motion alone does not count.
    pub(crate) body: bool,
    pub(crate) gravity: bool,
    pub(crate) battery: bool,
}

impl Stages {
    pub(crate) const ALL: Self = Self {
        actuators: true,
        motion: true,
        body: true,
        gravity: true,
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
        let with_battery = Constants {
            internal_resistance_ohm: b.internal_resistance_ohm,
            rc_resistance_ohm: b.rc_resistance_ohm,
            rc_time_s: b.rc_time_s,
            capacity_ah: b.capacity_ah,
            charge_offset: b.charge_offset,
            power_coefficient_w_per_n15: b.power_coefficient_w_per_n15,
            ..*a
        };
        let with_sensors = |c: Constants| Constants {
            accelerometer_bias_m_s2: b.accelerometer_bias_m_s2,
            accelerometer_scale: b.accelerometer_scale,
            gyro_bias_rad_s: b.gyro_bias_rad_s,
            gyro_scale: b.gyro_scale,
            imu_misalignment_rad: b.imu_misalignment_rad,
            imu_lever_arm_m: b.imu_lever_arm_m,
            level_offset_rad: b.level_offset_rad,
            heading_offset_rad: b.heading_offset_rad,
            imu_latency_s: b.imu_latency_s,
            attitude_latency_s: b.attitude_latency_s,
            velocity_latency_s: b.velocity_latency_s,
            position_latency_s: b.position_latency_s,
            ..c
        };
        let battery = actuators || with_battery != *a;
        let motion = with_sensors(*a) != *a || extra.uses(Hooks::READINGS);
        // Any other difference acts on the body: only those of battery and sensors do not.
        let body = actuators
            || with_sensors(with_battery) != *b
            || extra.uses(Hooks::WIND)
            || extra.uses(Hooks::ROTOR_THRUST)
            || extra.uses(Hooks::WRENCH);
        Self {
            actuators,
            motion,
            body,
            gravity: a.gravity_m_s2 != b.gravity_m_s2,
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
    /// Errors of the readings of the voltage persist over rows.
    pub(crate) persistent_voltage: bool,
    /// What Eq. 19 gets instead of the readings where they are too coarse, V.
    pub(crate) supply: Option<Arc<Vec<f64>>>,
    /// What Eq. 19 gets where no voltage was logged, V.
    pub(crate) unlogged_voltage: f64,
    /// Gain of the observer of the rates by axis: share of the innovation that is adopted.
    pub(crate) rate_gain: Vector3,
}

/// Which kinematics drive a pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// As measured: for residuals.
    Raw,
    /// Smoothed, but for the rates behind torques: for sensitivities.
    Smooth,
}

/// The result of a pass; parts that a perturbation leaves alone are shared.
#[derive(Debug, Clone)]
pub(crate) struct Prediction {
    /// Thrust at t_k before the hooks on it, N: `k * rotors + i`.
    pub(crate) thrust: Arc<Vec<f64>>,
    /// √ of it, if an effect requires it: many effects need the rotors' speeds, and square roots are expensive.
    root: Arc<OnceLock<Vec<f64>>>,
    /// True motion as reconstructed from the readings.
    pub(crate) motion: Arc<Kinematics>,
    /// What the model does to the body.
    steps: Arc<Steps>,
    /// True if the accelerometer's reading may differ from the force that acts on it.
    accel_errs: bool,
    /// Prediction of each channel.
    pub(crate) channels: [Arc<Vec<f64>>; CHANNELS],
}

/// The meaning of a moment: the instant t_k, or the step from t_k to t_{k+1} (kinematics as means of both ends).
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
        let driven = self.series.drive != Drive::None;
        let mut steps = base.map_or_else(Arc::default, |(base, _)| Arc::clone(&base.steps));
        let other_body =
            driven && (stages.body || base.is_none_or(|(base, _)| differs(effects, &base.motion, &motion)));
        if other_body {
            // Rates that another torque changes change it again by far less: by the observer's 10 ms, through damping and gyroscopics.
            let known = base.filter(|(base, _)| Arc::ptr_eq(&base.motion.observed_rates, &motion.observed_rates));
            let predicted = known.map(|(base, _)| &base.steps.predicted);
            steps = Arc::new(self.steps(effects.clone(), &motion, &thrust, &root, predicted));
        }
        let mut imu = Imu::default();
        let mut accel_errs = base.is_some_and(|(base, _)| base.accel_errs);
        if driven && (other_body || stages.motion) {
            imu = self.imu(effects.clone(), &motion, &thrust, &steps);
            accel_errs = imu.accel_error.is_some();
            if have.accel {
                put(
                    &mut channels,
                    F,
                    split(imu.accel.as_ref().unwrap_or(&steps.force)),
                    base,
                );
            }
            if have.rates {
                put(
                    &mut channels,
                    M,
                    split(imu.spin_up.as_ref().unwrap_or(&steps.spin_up)),
                    base,
                );
            }
        }
        // Without an accelerometer the force of the model shows in the velocity; with one, its errors are computed from
        // that force.
        if stages.motion || stages.gravity || (other_body && (!have.accel || accel_errs)) {
            let same_gravity = base.filter(|_| !stages.gravity).map(|(base, _)| base);
            self.kinematics(
                effects.constants(),
                &motion,
                (&steps, &imu),
                same_gravity,
                &mut channels,
            );
        }
        if stages.battery && have.voltage && self.series.drive != Drive::None {
            channels[V] = Arc::new(self.battery(effects.clone(), &motion, &thrust));
        }
        Prediction {
            thrust,
            root,
            motion,
            steps,
            accel_errs,
            channels,
        }
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
}

/// True if the readings of inertial sensors or attitude may differ from the truth; latencies excluded.
fn sensors_may_err(effects: &EffectSet) -> bool {
    effects.may_change() || effects.hooks().uses(Hooks::READINGS) || !effects.constants().sensors_are_exact()
}

/// True if the difference between two motions changes what acts on the body: without drag or effects on it, only its
/// rates matter.
fn differs(effects: &EffectSet, a: &Kinematics, b: &Kinematics) -> bool {
    let other = |part: fn(&Kinematics) -> &Vectors| !Arc::ptr_eq(part(a), part(b));
    let acts = effects.may_change() || hooked_body(effects);
    other(|m| &m.observed_rates)
        || ((acts || effects.constants().linear_drag_kg_s != 0.0) && (other(|m| &m.velocity) || other(|m| &m.attitude)))
        || (acts && (other(|m| &m.position) || other(|m| &m.angular_acceleration) || other(|m| &m.driving_accel)))
}

/// The measured side of every channel: accelerometer, difference quotients, voltage. Empty if there is none.
pub(crate) fn measured(series: &Series) -> PerChannel {
    std::array::from_fn(|channel| measured_channel(series, channel))
}

/// The same of one channel.
pub(crate) fn measured_channel(series: &Series, channel: usize) -> Vec<f64> {
    let have = series.available;
    let driven = series.drive != Drive::None;
    let difference = |x: &[Vector3], i: usize| -> Vec<f64> {
        let per = 1.0 / series.step_s;
        let last = (series.len > 0).then_some(f64::NAN);
        let steps = x.windows(2).map(|two| (two[1][i] - two[0][i]) * per);
        steps.chain(last).collect()
    };
    match channel {
        F..KV if have.accel && driven => series.raw.accel.iter().map(|a| a[channel - F]).collect(),
        KV..M if have.velocity && have.attitude && (have.accel || driven) => {
            difference(&series.raw.velocity, channel - KV)
        }
        M..KA if have.rates && driven => difference(&series.raw.rates, channel - M),
        KA..KP if have.attitude && have.rates => difference(&series.raw.attitude, channel - KA),
        KP..V if have.position && have.velocity => difference(&series.raw.position, channel - KP),
        V if have.voltage && driven => series.voltage.clone(),
        _ => Vec::new(),
    }
}
