//! Powertrain: duty and battery voltage to static lift (Eq. 19), then the rotors' first-order lag.
//!
//! g_i = (1 − loss_i) · max(0, gain_i · Eq. 19(u_i, V; blade_i) + bias_i [u_i > 0]),   f_i' = (g_i − f_i)/τ
//!
//! The polynomial of the duty is evaluated once per step, when the command is taken; only the voltage varies within the step.
//! Gain and bias are the rotor's own error, unknown to controller and detector; the loss, negative for a gain, is a fault. A thrust is
//! never negative. The torque that a rotor's drag exerts on the vehicle is κ_i f_i, with κ_i = c_D/c_L of the vehicle times
//! [`RotorTruth::moment_ratio_factor`].

use rotortwin_flight_core::MAX_ROTORS;

use crate::powertrain::blades::Blade;
use crate::powertrain::held::HeldRotors;
use crate::vector::Vector3;

/// One rotor of the true vehicle.
#[derive(Debug, Clone, Copy)]
pub struct RotorTruth {
    /// Mounted blade.
    pub blade: Blade,
    /// Factor on Eq. 19, 1 if exact.
    pub gain: f64,
    /// Added to the static lift while the duty is above 0, N.
    pub bias: f64,
    /// Lost share of the thrust: 0 healthy, 1 lost rotor, negative for a rotor that gives more.
    pub thrust_loss: f64,
    /// Change of c_D/c_L by a fault, fraction of the mounted blade's.
    pub moment_ratio_change: f64,
    /// Torque about the true centre of mass per newton of thrust of the healthy rotor, m, body: column of F in Eq. 6.
    pub torque_arm: Vector3,
}

impl RotorTruth {
    /// c_D/c_L over that of the healthy rotor with its nominal blade: the mounted blade's factor, and the change by a fault.
    #[inline]
    pub fn moment_ratio_factor(&self) -> f64 {
        self.blade.moment_ratio_factor * (1.0 + self.moment_ratio_change)
    }

    /// [`Self::torque_arm`] with the rotor's faults.
    #[inline]
    pub(crate) fn acting_torque_arm(&self) -> Vector3 {
        let [roll, pitch, yaw] = self.torque_arm;
        [roll, pitch, yaw * self.moment_ratio_factor()]
    }
}

/// All rotors. Arrays are padded with rotors that never turn.
#[derive(Debug, Clone)]
pub struct Powertrain {
    rotors: Vec<RotorTruth>,
    /// Of the held command: gain · bracket of Eq. 19, N/V.
    lift_per_volt: [f64; MAX_ROTORS],
    voltage_offset: [f64; MAX_ROTORS],
    bias: [f64; MAX_ROTORS],
    health: [f64; MAX_ROTORS],
    torque_arm: [[f64; MAX_ROTORS]; 3],
    per_lag: f64,
}

impl Powertrain {
    /// Rotors of the true vehicle with a common lag τ in s.
    pub(crate) fn new(rotors: Vec<RotorTruth>, lag: f64) -> Self {
        let zero = [0.0; MAX_ROTORS];
        let mut powertrain = Self {
            rotors,
            lift_per_volt: zero,
            voltage_offset: zero,
            bias: zero,
            health: zero,
            torque_arm: [zero; 3],
            per_lag: 1.0 / lag,
        };
        for rotor in 0..powertrain.rotors.len() {
            powertrain.take_torque_arm(rotor);
        }
        powertrain
    }

    fn take_torque_arm(&mut self, rotor: usize) {
        for (row, entry) in self.torque_arm.iter_mut().zip(self.rotors[rotor].acting_torque_arm()) {
            row[rotor] = entry;
        }
    }

    /// The rotors as they are now.
    pub fn rotors(&self) -> &[RotorTruth] {
        &self.rotors
    }

    /// Makes another rotor of one.
    pub(crate) fn change(&mut self, rotor: usize, change: impl FnOnce(&mut RotorTruth)) {
        change(&mut self.rotors[rotor]);
        self.take_torque_arm(rotor);
    }

    /// Takes the duties (fractions in \[0, 1\]) that are held over the coming step.
    #[inline]
    pub(crate) fn hold(&mut self, duty: &[f64; MAX_ROTORS]) {
        for (i, rotor) in self.rotors.iter().enumerate() {
            self.lift_per_volt[i] = rotor.gain * rotor.blade.lift_per_volt(duty[i]);
            self.voltage_offset[i] = rotor.blade.voltage_offset_v;
            self.bias[i] = if duty[i] > 0.0 { rotor.bias } else { 0.0 };
            self.health[i] = 1.0 - rotor.thrust_loss;
        }
    }

    /// 1/τ, 1/s.
    pub(crate) fn per_lag(&self) -> f64 {
        self.per_lag
    }

    /// What the first `N` rotors do over the step with the held command.
    #[inline(always)]
    pub(crate) fn held<const N: usize>(&self) -> HeldRotors<'_, N> {
        HeldRotors {
            lift_per_volt: first(&self.lift_per_volt),
            voltage_offset: first(&self.voltage_offset),
            bias: first(&self.bias),
            health: first(&self.health),
            torque_arm: [
                first(&self.torque_arm[0]),
                first(&self.torque_arm[1]),
                first(&self.torque_arm[2]),
            ],
            per_lag: self.per_lag,
        }
    }
}

#[inline(always)]
fn first<const N: usize>(values: &[f64; MAX_ROTORS]) -> &[f64; N] {
    values.first_chunk().expect("N is at most the number of rotors")
}
