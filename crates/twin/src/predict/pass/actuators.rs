//! The actuators of a pass: delay, dead zone, Eq. 19 and lag, from duty and logged voltage to the thrust of every rotor.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::effects::{Constants, EffectSet, Hooks};

use super::{Plant, When};
use crate::predict::series::{Drive, Kinematics};

impl Plant {
    /// Thrust of every rotor at every sample, N.
    pub(super) fn actuators(&self, mut set: EffectSet, motion: &Kinematics) -> Vec<f64> {
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
        let nominal_voltage = self.unlogged_voltage;
        let mut thrust = [0.0; MAX_ROTORS];
        let mut started = false;
        let (mut lift, mut duty) = ([0.0; MAX_ROTORS], [0.0; MAX_ROTORS]);
        let (mut ratio, mut rate) = ([0.0; MAX_ROTORS], [0.0; MAX_ROTORS]);
        // exp(−h/τ) is needed at every step and rotor with the same few τ.
        let mut decay = (f64::NAN, 0.0, f64::NAN, 0.0);
        let mut voltage = nominal_voltage;
        let mut unlogged = self.unlogged(set.constants());
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
            if let Some(battery) = &mut unlogged {
                let drawn = if started {
                    &thrust[..n]
                } else {
                    &[set.constants().hover_thrust_n; MAX_ROTORS][..n]
                };
                let sum = drawn.iter().map(|f| f.max(0.0) * f.max(0.0).sqrt()).sum();
                voltage = battery.step(set.constants(), sum, s.step_s);
            } else if let Some(v) = self.logged_voltage(k) {
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
        let voltage = self.supply.as_deref().unwrap_or(&self.series.voltage);
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
}
