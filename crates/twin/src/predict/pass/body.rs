//! The body of a pass: the wrench of rotors and air in every step, and the resulting IMU readings.

use std::sync::{Arc, OnceLock};

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::Vector3;
use rotortwin_plant::effects::{EffectSet, Hooks, Readings, Wrench};

use super::{Plant, When, between, sensors_may_err, turned};
use crate::predict::series::{Kinematics, shifted};
use crate::predict::vectors::{cross, euler_rates, inverted, times, to_body};

/// The model's motion of the body.
#[derive(Debug, Default)]
pub(crate) struct Steps {
    /// Specific force at t_k, m/s².
    pub(super) force: Vec<Vector3>,
    /// Angular acceleration over step k, rad/s².
    pub(super) spin_up: Vec<Vector3>,
    /// Specific force over step k, m/s²; only without an accelerometer.
    pub(super) mean: Option<Vec<Vector3>>,
    /// Rates over step k as predicted at its start, rad/s: torques are predicted with these.
    pub(super) predicted: Arc<Vec<Vector3>>,
}

/// Readings of the IMU, where they differ from the motion.
#[derive(Debug, Default)]
pub(super) struct Imu {
    /// Reading of the accelerometer at t_k, m/s².
    pub(super) accel: Option<Vec<Vector3>>,
    /// Rate of the gyroscope's reading over step k, rad/s².
    pub(super) spin_up: Option<Vec<Vector3>>,
    /// Error of the accelerometer's reading at t_k, m/s², computed from the model's own force; `None` if nothing can
    /// falsify its readings. The velocity is predicted from the readings less this. Dividing a reading by its scale
    /// would also change its noise, and that would affect the evidence.
    pub(super) accel_error: Option<Vec<Vector3>>,
    /// Rate over step k of the error of the attitude, rad/s, if an effect makes it vary with the flight. The attitude
    /// is propagated over the step by the gyroscope: its own reading at the end contains the noise of the very
    /// difference that this predicts, and an error that depends on the heading would be favoured for explaining that
    /// noise.
    pub(super) attitude_error_rate: Option<Vec<Vector3>>,
}

impl Plant {
    /// Excess of the mean thrust over the two steps around t_k over the thrust at t_k: (f_{k−1} − 2 f_k + f_{k+1})/4,
    /// N. A new duty bends the thrust there by up to step/τ of the duty's change; smoothed, it looks like a command
    /// that is early.
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

    /// The model's motion of the body. `root` is √thrust, if effects of rotors or wrench act; `predicted` the rates
    /// over each step, if they are known.
    ///
    /// The rates come from an observer, ω̂ ← ω̂ + h ω̇ + K (y − ω̂ − h ω̇), never from readings after the step began: a
    /// disturbance of the step persists in the rates that follow, and a damping estimated from these would be too small
    /// by h q²/(2 ⟨ω²⟩), q the disturbance as an angular acceleration (a third of a usual damping on a calm flight).
    pub(super) fn steps(
        &self,
        mut set: EffectSet,
        motion: &Kinematics,
        thrust: &[f64],
        root: &OnceLock<Vec<f64>>,
        predicted: Option<&Arc<Vec<Vector3>>>,
    ) -> Steps {
        let s = &self.series;
        let n = s.rotors;
        let zero = [0.0; 3];
        let (mut force, mut spin_up) = (vec![zero; s.len], vec![zero; s.len]);
        let mut mean = (!s.available.accel).then(|| vec![zero; s.len]);
        let mut f = [0.0; MAX_ROTORS];
        // Σ f at t_{k−1}, t_k, t_{k+1}.
        let mut sums = [0.0, 0.0, thrust[..n].iter().sum::<f64>()];
        let (mut ratio, mut rate) = ([0.0; MAX_ROTORS], [0.0; MAX_ROTORS]);
        // A copy, because the hooks change the set; computed anew only if effects set in or vary.
        let mut c = *set.constants();
        let (mut inverse, mut allocation) = (inverted(&c.inertia_body_kg_m2), c.allocation());
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
        let read = &motion.observed_rates;
        let mut observed = read[0];
        let mut made = predicted.is_none().then(|| Vec::with_capacity(s.len));
        for k in 0..steps {
            if set.begin(s.time(k)) {
                c = *set.constants();
                (inverse, allocation) = (inverted(&c.inertia_body_kg_m2), c.allocation());
                hooked = hooked_body(&set);
                root = roots(hooked);
            }
            let active = set.hooks();
            let omega = match predicted {
                Some(known) => known[k],
                None => {
                    // Half a step later; its own angular acceleration is not known yet.
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
                w = allocation.wrench(&f[..n]);
                set.wrench(&at, &mut w);
                w = c.closed(&w, at.air_velocity_body, at.body_rates);
                set.advance(&at, s.step_s);
            } else {
                w = allocation.wrench(&f[..n]);
                if c.linear_drag_kg_s != 0.0 || c.angular_drag_nms != 0.0 || c.yaw_drag_nms != 0.0 {
                    let r = turned(&motion.ned_from_body, k, k + 1);
                    let (v, wind) = (between(&motion.velocity, k, k + 1), c.wind_ned_m_s);
                    let relative = [v[0] - wind[0], v[1] - wind[1], v[2] - wind[2]];
                    w = c.closed(&w, to_body(&r, relative), omega);
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
            let push = [push[0] * per_mass, push[1] * per_mass, push[2] * per_mass];
            if let Some(mean) = &mut mean {
                mean[k] = push;
            }
            // The value at t_k lies between the means of the steps on either side, less the corner of the thrust
            // between them (along the body's axis: the lateral effect of a tilted rotor's corner is negligible).
            for i in 0..3 {
                force[k][i] += 0.5 * push[i];
                force[k + 1][i] = 0.5 * push[i];
            }
            if k > 0 {
                force[k][2] += 0.25 * per_mass * (sums[0] - 2.0 * sums[1] + sums[2]);
            }
        }
        spin_up[steps] = spin_up[steps - 1];
        for end in [0, steps] {
            force[end] = force[end].map(|half| 2.0 * half);
        }
        if let Some(mean) = &mut mean {
            mean[steps] = mean[steps - 1];
        }
        Steps {
            force,
            spin_up,
            mean,
            predicted: made.map_or_else(|| predicted.map(Arc::clone).unwrap_or_default(), Arc::new),
        }
    }

    /// The IMU's readings of it.
    pub(super) fn imu(&self, mut set: EffectSet, motion: &Kinematics, thrust: &[f64], steps: &Steps) -> Imu {
        let s = &self.series;
        let n = s.rotors;
        let mut imu = Imu::default();
        let mut c = *set.constants();
        if sensors_may_err(&set) {
            let Steps { force, spin_up, .. } = steps;
            let (mut accel, mut turned) = (force.clone(), spin_up.clone());
            let mut error = vec![[0.0; 3]; s.len];
            let mut attitude_rate = vec![[0.0; 3]; s.len];
            let mut attitude_errs = false;
            let mut last = [0.0; 3];
            let (mut inverse, mut allocation) = (inverted(&c.inertia_body_kg_m2), c.allocation());
            let (mut ratio, nothing) = ([0.0; MAX_ROTORS], [0.0; MAX_ROTORS]);
            for k in 0..s.len {
                if set.begin(s.time(k)) {
                    c = *set.constants();
                    (inverse, allocation) = (inverted(&c.inertia_body_kg_m2), c.allocation());
                }
                let mut read = Readings {
                    specific_force: force[k],
                    body_rates: motion.rates[k],
                    attitude: motion.attitude[k],
                    velocity_ned: motion.velocity[k],
                    position_ned: motion.position[k],
                    battery_voltage: 0.0,
                };
                // The model's own angular acceleration at t_k: the measured one is only noise, or smoothed away.
                let before = if k > 0 { spin_up[k - 1] } else { spin_up[k] };
                let mut turning = [0, 1, 2].map(|i| 0.5 * (before[i] + spin_up[k][i]));
                if c.imu_lever_arm_m != [0.0; 3] {
                    let rounded = times(&inverse, allocation.wrench(&self.corner(k, thrust)[..n]).torque_body);
                    turning = [0, 1, 2].map(|i| turning[i] - rounded[i]);
                }
                c.corrupt(&mut read, turning);
                if set.hooks().uses(Hooks::READINGS) {
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
                    let before = read.attitude;
                    set.readings(&at, &mut read);
                    if read.attitude != before {
                        attitude_errs = true;
                        let mut error = |attitude: Vector3| {
                            let mut one = Readings { attitude, ..read };
                            set.readings(&at, &mut one);
                            [0, 1, 2].map(|i| one.attitude[i] - attitude[i])
                        };
                        if k > 0 {
                            let there = error(carried(motion, k - 1, s.step_s));
                            attitude_rate[k - 1] = [0, 1, 2].map(|i| (there[i] - last[i]) / s.step_s);
                        }
                        last = error(motion.attitude[k]);
                    } else {
                        last = [0.0; 3];
                    }
                }
                error[k] = [0, 1, 2].map(|i| read.specific_force[i] - force[k][i]);
                accel[k] = read.specific_force;
                // Rate of the gyroscope's reading: its errors without the bias.
                let scale = 1.0 + c.gyro_scale;
                let sideways = cross(c.imu_misalignment_rad, spin_up[k]);
                turned[k] = [0, 1, 2].map(|i| scale * (spin_up[k][i] + sideways[i]));
            }
            imu = Imu {
                accel: Some(accel),
                spin_up: Some(turned),
                accel_error: Some(error),
                attitude_error_rate: attitude_errs.then_some(attitude_rate),
            };
        }
        if c.imu_latency_s != 0.0 {
            let accel = imu.accel.as_ref().unwrap_or(&steps.force);
            imu.accel = Some(shifted(accel, -c.imu_latency_s, s.step_s));
            // Means over steps: measurements after t_k must not enter (the duty of row k + 1 responds to its noise).
            let turned = imu.spin_up.as_ref().unwrap_or(&steps.spin_up);
            imu.spin_up = Some(late_means(turned, c.imu_latency_s, s.step_s));
        }
        imu
    }
}

/// The attitude at the end of step k, from that at its start and the rates of the gyroscope.
fn carried(motion: &Kinematics, k: usize, step_s: f64) -> Vector3 {
    let rate = |k: usize| euler_rates(&motion.ned_from_body[k], motion.rates[k]);
    let (before, after) = (rate(k), rate(k + 1));
    [0, 1, 2].map(|i| motion.attitude[k][i] + 0.5 * step_s * (before[i] + after[i]))
}

/// Means over steps of a signal with a delay of `delay_s`: the mean of two neighbouring steps, weighted by their share
/// of the time. Exact for values that are constant over a step, and for a delay ≥ 0 no later step than its own enters.
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
pub(super) fn hooked_body(set: &EffectSet) -> bool {
    let hooks = set.hooks();
    [Hooks::ROTOR_THRUST, Hooks::WRENCH, Hooks::WIND, Hooks::ADVANCE]
        .into_iter()
        .any(|hook| hooks.uses(hook))
}
