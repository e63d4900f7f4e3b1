//! Hover of the nominal vehicle: the state in which a flight begins, and the test that it can fly at all.

use rotortwin_flight_core::MAX_ROTORS;

use crate::config::SimulationConfig;
use crate::error::Refusal;
use crate::motors::Motors;
use crate::powertrain::battery::Battery;
use crate::powertrain::held::sum_of_powers;

/// Hover of the nominal vehicle.
#[derive(Debug, Clone, Copy)]
pub struct Trim {
    /// Least-norm thrusts that balance the weight, N.
    pub thrust: [f64; MAX_ROTORS],
    /// Duty for the mean thrust, fraction.
    pub duty: f64,
}

/// Hover of the nominal vehicle at the initial charge, or the reason why there is none.
pub fn trim(config: &SimulationConfig) -> Result<Trim, Refusal> {
    let vehicle = &config.vehicle;
    let placements = vehicle.rotors.layout.placements();
    let weight = vehicle.body.mass_kg * vehicle.body.gravity_m_s2;
    // Least-norm thrusts for (−m g, 0, 0, 0): Fᵀ (F Fᵀ)⁻¹ w, in f64.
    let columns: Vec<nalgebra::Vector4<f64>> = placements
        .iter()
        .map(|p| {
            let [mx, my, mz] = p.torque_arm([0.0; 3], 1.0);
            nalgebra::Vector4::new(-1.0, mx, my, mz)
        })
        .collect();
    let gram = columns.iter().fold(nalgebra::Matrix4::zeros(), |sum, column| {
        sum + column * column.transpose()
    });
    let inverse = gram
        .try_inverse()
        .ok_or_else(|| Refusal::new("vehicle", "this layout cannot be balanced"))?;
    let multiplier = inverse * nalgebra::Vector4::new(-weight, 0.0, 0.0, 0.0);
    let mut thrust = [0.0; MAX_ROTORS];
    for (f, column) in thrust.iter_mut().zip(&columns) {
        *f = column.dot(&multiplier);
    }
    let charge = config.state_of_charge;
    let mean = weight / placements.len() as f64;
    let (duty, most) = match Motors::new(vehicle, &config.nominal_blade)? {
        Some(motors) => {
            let hover = motors.hover(vehicle, charge, mean);
            (
                Some(hover.duty).filter(|duty| (0.0..=1.0).contains(duty)),
                hover.largest_thrust,
            )
        }
        None => {
            let battery = Battery::new(&vehicle.battery);
            let power = battery.power_coefficient() * sum_of_powers(&thrust);
            let voltage = battery.output(charge, power).battery_voltage;
            let blade = &config.nominal_blade;
            (blade.duty(mean, voltage), blade.lift(1.0, voltage))
        }
    };
    for (i, &f) in thrust[..placements.len()].iter().enumerate() {
        if !(f > 0.0 && f < most) {
            let reason = format!(
                "this vehicle cannot hover at a charge of {charge}: rotor {} would have to give {f:.3} N, it can give 0 to {most:.3} N",
                i + 1
            );
            return Err(Refusal::new("vehicle", reason));
        }
    }
    let duty = duty.ok_or_else(|| Refusal::new("vehicle", "this vehicle cannot hover: no duty lifts its weight"))?;
    Ok(Trim { thrust, duty })
}
