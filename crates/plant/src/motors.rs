//! The motors of a flight: their speeds, and what turns them into lift, torque and current ([`crate::powertrain::motor`] has the equations).

use rotortwin_flight_core::MAX_ROTORS;

use crate::effects::Constants;
use crate::error::{Refusal, in_range};
use crate::powertrain::battery::{Battery, BatteryOutput};
use crate::powertrain::blades::Blade;
use crate::powertrain::motor::MotorModel;
use crate::vehicle::model::VehicleModel;

/// c_L, N·s², of a blade on rotor 1 of a vehicle with this motor: the value with which it lifts what the blade's Eq. 19
/// gives, at the hover on the nominal blade, at rest voltage and half charge; `None` if the motor cannot reach that
/// speed.
pub fn lift_coefficient(motor: &MotorModel, vehicle: &VehicleModel, nominal: &Blade, blade: &Blade) -> Option<f64> {
    let (duty, voltage) = reference(vehicle, nominal)?;
    let rotor = vehicle.rotors.layout.placements().into_iter().next()?;
    motor.lift_coefficient(blade, duty, voltage, rotor.moment_ratio)
}

/// Hover at rest voltage and half charge, where a motor's lift equals Eq. 19: duty, fraction, and V.
fn reference(vehicle: &VehicleModel, nominal: &Blade) -> Option<(f64, f64)> {
    let voltage = Battery::new(&vehicle.battery).open_circuit_voltage(0.5);
    let weight = vehicle.body.mass_kg * vehicle.body.gravity_m_s2;
    let duty = nominal.duty(weight / vehicle.rotor_count() as f64, voltage)?;
    Some((duty, voltage))
}

/// A hover.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hover {
    /// Fraction.
    pub(crate) duty: f64,
    /// Of a rotor at full duty and the voltage of the hover, N.
    pub(crate) largest_thrust: f64,
}

/// The motors of one flight: their speeds, and the constants that convert speeds into lift and current.
#[derive(Debug, Clone)]
pub(crate) struct Motors {
    document: MotorModel,
    /// Including the changes by effects.
    now: MotorModel,
    /// Lag of the document, s: effects state changes of the motor's inertia as changes of the lag.
    lag_s: f64,
    /// k_P of the document, W/N^1.5: effects state changes of the power as changes of k_P.
    power_coefficient: f64,
    reference: (f64, f64),
    /// c_D/c_L of the document, m.
    moment_ratio: [f64; MAX_ROTORS],
    /// c_L of the nominal blade, N·s².
    nominal: [f64; MAX_ROTORS],
    /// Ω, rad/s.
    pub(crate) speed: [f64; MAX_ROTORS],
}

impl Motors {
    /// The motors of a vehicle document; `None` if it has none.
    ///
    /// # Errors
    /// The motors cannot turn the nominal blade as fast as a hover needs.
    pub(crate) fn new(vehicle: &VehicleModel, nominal: &Blade) -> Result<Option<Self>, Refusal> {
        let Some(document) = vehicle.rotors.motor else {
            return Ok(None);
        };
        let refused = || {
            let reason = "expected a motor that turns the nominal blade at hover, this one has too much resistance, too large an idle current or too small \
                          a speed constant";
            Refusal::new("vehicle.rotors.motor", reason)
        };
        let reference = reference(vehicle, nominal).ok_or_else(refused)?;
        let mut motors = Self {
            document,
            now: document,
            lag_s: vehicle.rotors.thrust_lag_s,
            power_coefficient: vehicle.battery.power_coefficient_w_per_n15,
            reference,
            moment_ratio: [0.0; MAX_ROTORS],
            nominal: [0.0; MAX_ROTORS],
            speed: [0.0; MAX_ROTORS],
        };
        for (i, placement) in vehicle.rotors.layout.placements().iter().enumerate() {
            let ratio = placement.moment_ratio;
            motors.moment_ratio[i] = ratio;
            let coefficient = document.lift_coefficient(nominal, reference.0, reference.1, ratio);
            motors.nominal[i] = coefficient.ok_or_else(refused)?;
            let hover = document.steady_speed(reference.0, reference.1, ratio * motors.nominal[i]);
            let time_constant = document.time_constant_s(reference.0, hover, ratio * motors.nominal[i]);
            // As with the lag of Eq. 19: below 5 ms a step of 2.5 ms would not resolve it.
            in_range("time constant at hover", time_constant, 0.005, 1.0, "s")
                .map_err(|refusal| refusal.under("vehicle.rotors.motor"))?;
        }
        Ok(Some(motors))
    }

    /// Applies the changes by effects.
    pub(crate) fn take(&mut self, constants: &Constants) {
        self.now = self
            .document
            .changed(constants.esc_resistance_ohm, constants.thrust_lag_up_s / self.lag_s);
    }

    /// Speeds at which healthy rotors carry these thrusts, N.
    pub(crate) fn begin(&mut self, thrust: &[f64; MAX_ROTORS]) {
        for i in 0..MAX_ROTORS {
            if self.nominal[i] > 0.0 {
                self.speed[i] = (thrust[i] / self.nominal[i]).max(0.0).sqrt();
            }
        }
    }

    /// c_L of rotor `i` with a blade, N·s²; 0 for one that lifts nothing.
    pub(crate) fn lift_coefficient(&self, i: usize, blade: &Blade) -> f64 {
        let (duty, voltage) = self.reference;
        let coefficient = self
            .document
            .lift_coefficient(blade, duty, voltage, self.moment_ratio[i]);
        coefficient.unwrap_or(0.0)
    }

    /// Thrusts of healthy rotors at the present speeds, N.
    pub(crate) fn healthy_thrust(&self) -> [f64; MAX_ROTORS] {
        self.healthy(&self.speed, &[0.0; MAX_ROTORS]).0
    }

    /// Thrusts of healthy rotors at these speeds, N, and their rates, N/s: c_L Ω² and 2 c_L Ω Ω'.
    pub(crate) fn healthy(
        &self,
        speed: &[f64; MAX_ROTORS],
        speed_rate: &[f64; MAX_ROTORS],
    ) -> ([f64; MAX_ROTORS], [f64; MAX_ROTORS]) {
        (
            std::array::from_fn(|i| self.nominal[i] * speed[i] * speed[i]),
            std::array::from_fn(|i| 2.0 * self.nominal[i] * speed[i] * speed_rate[i]),
        )
    }

    /// Ω of a healthy rotor that carries `thrust`, N: rad/s.
    pub(crate) fn hover_speed(&self, thrust: f64) -> f64 {
        (thrust / self.nominal[0]).sqrt()
    }

    /// The hover at a charge in which each rotor carries `mean`, N.
    pub(crate) fn hover(&self, vehicle: &VehicleModel, state_of_charge: f64, mean: f64) -> Hover {
        let (motor, ratio) = (&self.document, self.moment_ratio[0]);
        let open = Battery::new(&vehicle.battery).open_circuit_voltage(state_of_charge);
        let speed = self.hover_speed(mean);
        let torque = ratio * mean + motor.viscous_friction_nms * speed;
        let current = torque / motor.back_emf_v_s() + motor.idle_current_a;
        let driving = motor.back_emf_v_s() * speed + motor.winding_resistance_ohm * current;
        let resistance = vehicle.battery.internal_resistance_ohm * vehicle.rotor_count() as f64;
        let (mut voltage, mut duty) = (open, 0.0);
        // The duty rises as the voltage falls, and the voltage falls with it, by a few per cent: each round is as much more exact.
        for _ in 0..40 {
            duty = driving / (voltage - motor.esc_resistance_ohm * current);
            voltage = open - resistance * duty * current;
        }
        let fastest = motor.steady_speed(1.0, voltage, ratio * self.nominal[0]);
        Hover {
            duty,
            largest_thrust: self.nominal[0] * fastest * fastest,
        }
    }

    /// J, kg·m².
    pub(crate) fn inertia(&self) -> f64 {
        self.now.inertia_kg_m2
    }

    /// Voltages and current of a battery with the inner voltage `source`, V, behind which `open` is the open-circuit voltage.
    pub(crate) fn battery(
        &self,
        open: f64,
        source: f64,
        constants: &Constants,
        duty: &[f64; MAX_ROTORS],
        speed: &[f64; MAX_ROTORS],
    ) -> BatteryOutput {
        let n = constants.rotor_count;
        let share = constants.power_coefficient_w_per_n15 / self.power_coefficient;
        let rotors = || duty[..n].iter().copied().zip(speed[..n].iter().copied());
        let voltage = self
            .now
            .terminal_voltage(source, constants.internal_resistance_ohm * share, rotors());
        let current: f64 = rotors().map(|(u, speed)| u * self.now.current(u, voltage, speed)).sum();
        BatteryOutput {
            open_circuit_voltage: open,
            battery_voltage: voltage,
            battery_current: share * current,
        }
    }

    /// Ω' of every rotor, rad/s², while it lifts `thrust`, N. Without a battery no current flows and the rotors run down.
    pub(crate) fn acceleration(
        &self,
        constants: &Constants,
        battery: &BatteryOutput,
        duty: &[f64; MAX_ROTORS],
        speed: &[f64; MAX_ROTORS],
        thrust: &[f64; MAX_ROTORS],
    ) -> [f64; MAX_ROTORS] {
        let mut acceleration = [0.0; MAX_ROTORS];
        for i in 0..constants.rotor_count {
            let load = constants.moment_ratio_m[i] * thrust[i];
            acceleration[i] = if battery.battery_voltage > 0.0 {
                self.now.acceleration(duty[i], battery.battery_voltage, speed[i], load)
            } else {
                self.now.running_down(speed[i], load)
            };
        }
        acceleration
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_eq_18_has_the_shape_of_table_1() {
        // Eq. 19 was measured on this motor; Eq. 18 has two free numbers less and meets it at hover only.
        let vehicle = crate::testing::vehicle("f550");
        let motor = MotorModel::AIR_GEAR_350;
        let blade = crate::testing::blades(&vehicle).blade["a"];
        let lift = lift_coefficient(&motor, &vehicle, &blade, &blade).unwrap();
        let mut squares = Vec::new();
        for percent in 20..=100 {
            for volts in [15.2, 15.9, 16.6] {
                let duty = f64::from(percent) / 100.0;
                let speed = motor.steady_speed(duty, volts, 0.016 * lift);
                squares.push((lift * speed * speed - blade.lift(duty, volts)).powi(2));
            }
        }
        let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        assert!(rms < 0.065, "{rms} N");
    }
}
