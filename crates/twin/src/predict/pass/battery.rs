//! The battery of a pass: terminal voltage from the rotors' power, and its means over strides of steps.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::effects::{Constants, EffectSet, Hooks};
use rotortwin_plant::powertrain::battery::Battery;

use super::{Plant, When};
use crate::predict::series::{Drive, Kinematics};

/// Σ f^1.5 of the rotors over a stride of steps, N^1.5.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Power {
    pub(crate) mean: f64,
    pub(crate) variance: f64,
}

/// √(V_oc² − 4 R P) of the terminal voltage (V_oc + √…)/2 (Eq. 8); 0 where less than P can be drawn.
pub(crate) fn root(open: f64, c: &Constants, power: f64) -> f64 {
    (open * open - 4.0 * c.internal_resistance_ohm * power).max(0.0).sqrt()
}

/// A battery whose voltage no log tells, as it empties.
pub(super) struct Unlogged {
    battery: Battery,
    charge: f64,
    relaxation: f64,
}

impl Unlogged {
    /// Voltage that drives the rotors while they draw a power of Σ f^1.5 over a step, V.
    pub(super) fn step(&mut self, c: &Constants, sum: f64, step_s: f64) -> f64 {
        let power = sum * c.power_coefficient_w_per_n15;
        let open = self.battery.open_circuit_voltage(self.charge) - self.relaxation;
        let voltage = 0.5 * (open + root(open, c, power));
        let current = power / voltage.max(1e-3);
        // A flight that takes more than the document's battery holds had another one.
        self.charge = (self.charge - current * step_s / (3600.0 * c.capacity_ah)).max(LEAST_CHARGE);
        if c.rc_resistance_ohm != 0.0 {
            let relaxed = 1.0 - libm::exp(-step_s / c.rc_time_s);
            self.relaxation += relaxed * (c.rc_resistance_ohm * current - self.relaxation);
        }
        voltage
    }
}

/// Charge below which nobody flies, fraction.
const LEAST_CHARGE: f64 = 0.1;

impl Plant {
    /// The battery at take-off, if the voltage behind the duties was not logged.
    pub(super) fn unlogged(&self, c: &Constants) -> Option<Unlogged> {
        self.is_unlogged().then(|| Unlogged {
            battery: Battery::new(&self.battery_model),
            charge: self.charge + c.charge_offset,
            relaxation: 0.0,
        })
    }

    /// True if the voltage behind the duties was not logged.
    pub(crate) fn is_unlogged(&self) -> bool {
        self.series.drive == Drive::Duty && !self.series.available.voltage
    }

    /// Battery voltage as the sensor reads it, V.
    pub(super) fn battery(&self, set: EffectSet, motion: &Kinematics, thrust: &[f64]) -> Vec<f64> {
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
        let mut c = *set.constants();
        let shares = |c: &Constants| {
            (
                step_s / (3600.0 * c.capacity_ah),
                1.0 - libm::exp(-step_s / c.rc_time_s),
            )
        };
        let (mut per_ampere, mut relaxed) = shares(&c);
        for (j, sum) in powers.iter().enumerate() {
            let k = j * stride;
            if set.begin(s.time(k)) {
                c = *set.constants();
                (per_ampere, relaxed) = shares(&c);
            }
            let power = sum.mean * c.power_coefficient_w_per_n15;
            let open = battery.open_circuit_voltage(charge) - relaxation;
            let root = root(open, &c, power);
            let mut voltage = 0.5 * (open + root);
            if stride > 1 && root > 0.0 {
                let bend = c.internal_resistance_ohm * c.power_coefficient_w_per_n15;
                voltage -= bend * bend * sum.variance / (root * root * root);
            }
            let current = power / voltage.max(1e-3);
            charge -= current * per_ampere;
            if c.rc_resistance_ohm != 0.0 {
                relaxation += relaxed * (c.rc_resistance_ohm * current - relaxation);
            }
            out.push((1.0 + c.voltage_gain) * voltage + c.voltage_offset_v);
            if advancing {
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
