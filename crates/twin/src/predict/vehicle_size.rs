//! Plausible sizes for a vehicle of a different size from the one that the catalogue's numbers refer to.
//!
//! The catalogue's sizes are those of a hexarotor of 1.55 kg. A payload of 150 g, a plausible one there, is five times
//! the weight of a Crazyflie: used unchanged, the clutter alone (2 % of a size) would hide everything that such a
//! vehicle can carry. So a size with the dimension of a force (or of a force over a speed) goes with the weight, of a
//! torque with weight and arm, of a length with the arm, of an inertia with the inertia, of a voltage with the pack's,
//! of a resistance with voltage over current in hover. Fractions, angles, times, speeds and accelerations stay; so do
//! shapes (a rope, a wall's distance) and the effects of users.

use rotortwin_plant::effects::{Constants, EffectDeclaration, ParameterDeclaration, ParameterKind};
use rotortwin_plant::powertrain::battery::{Battery, BatteryModel};

/// The vehicle of the catalogue's sizes (config/vehicles/f550.toml): mass, arm, mean inertia, resting voltage at half charge, current
/// in hover.
const MASS_KG: f64 = 1.55;
const ARM_M: f64 = 0.275;
const INERTIA_KG_M2: f64 = (0.0266 + 0.0266 + 0.0498) / 3.0;
const RESTING_V: f64 = 15.36;
const HOVER_A: f64 = 9.93;
/// A ratio nearer to 1 than this factor counts as 1: the plausible sizes are not known better.
const SAME: f64 = 1.5;

/// Sizes of a vehicle over those of the catalogue's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct VehicleSize {
    weight: f64,
    arm: f64,
    inertia: f64,
    voltage: f64,
    resistance: f64,
}

impl VehicleSize {
    /// Of a nominal vehicle with its battery.
    pub(crate) fn of(nominal: &Constants, battery: &BatteryModel) -> Self {
        let count = nominal.rotor_count as f64;
        let ratio = |value: f64, catalogue: f64| {
            let ratio = value / catalogue;
            if ratio < SAME && ratio > 1.0 / SAME { 1.0 } else { ratio }
        };
        let arm = (0..nominal.rotor_count).map(|i| nominal.arm_length(i)).sum::<f64>() / count;
        let j = &nominal.inertia_body_kg_m2;
        let resting = Battery::new(battery).open_circuit_voltage(0.5);
        let f = nominal.hover_thrust_n;
        let current = nominal.power_coefficient_w_per_n15 * f * f.sqrt() * count / resting;
        Self {
            weight: ratio(nominal.mass_kg, MASS_KG),
            arm: ratio(arm, ARM_M),
            inertia: ratio((j[0][0] + j[1][1] + j[2][2]) / 3.0, INERTIA_KG_M2),
            voltage: ratio(resting, RESTING_V),
            resistance: ratio(resting / current.max(1e-6), RESTING_V / HOVER_A),
        }
    }

    /// What a size with a unit is multiplied with.
    fn factor(&self, unit: &str) -> f64 {
        match unit {
            "N" | "kg" | "N·s/m" | "N·s²/m²" | "kg/s" | "kg/m" => self.weight,
            "N·m" | "N·m·s" | "N·s" => self.weight * self.arm,
            "m" => self.arm,
            "kg·m²" => self.inertia,
            "V" => self.voltage,
            "Ω" => self.resistance,
            _ => 1.0,
        }
    }

    /// The parameters of an effect with the plausible sizes of this vehicle.
    pub(crate) fn parameters(&self, declaration: &EffectDeclaration) -> Vec<ParameterDeclaration> {
        let built_in = declaration.catalogue_number.is_some();
        let scaled = |p: &ParameterDeclaration| {
            let factor = if built_in && p.kind == ParameterKind::Size {
                self.factor(p.unit)
            } else {
                1.0
            };
            ParameterDeclaration {
                plausible_low: factor * p.plausible_low,
                plausible_high: factor * p.plausible_high,
                size: factor * p.size,
                clutter: factor * p.clutter,
                typical: factor * p.typical,
                ..*p
            }
        };
        declaration.parameters.iter().map(scaled).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ModelVersion;
    use rotortwin_plant::effects::catalogue;
    use std::path::Path;

    fn size_of(vehicle: &str) -> VehicleSize {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../config/vehicles")
            .join(vehicle);
        let vehicle = ModelVersion::load(&path).unwrap().documents().vehicle;
        VehicleSize::of(&Constants::nominal(&vehicle), &vehicle.battery)
    }

    #[test]
    fn val_the_catalogues_vehicle_has_the_catalogues_sizes() {
        for vehicle in ["f550.toml", "quad-x.toml", "octo-x.toml", "hexa-h.toml"] {
            let size = size_of(vehicle);
            for declaration in catalogue() {
                assert_eq!(
                    size.parameters(declaration),
                    declaration.parameters,
                    "{vehicle} {}",
                    declaration.id
                );
            }
        }
    }

    #[test]
    fn val_a_crazyflie_carries_grams_and_its_angles_and_times_stay() {
        let size = size_of("crazyflie-lee.toml");
        for declaration in catalogue() {
            for (scaled, p) in size.parameters(declaration).iter().zip(declaration.parameters) {
                match (p.kind, p.unit) {
                    // 150 g on 1.55 kg are 3.1 g on 32 g.
                    (ParameterKind::Size, "kg") => assert!((scaled.size - 0.15 * 0.032 / 1.55).abs() < 1e-12),
                    (_, "" | "s" | "s/m" | "rad" | "m/s" | "rad/s" | "m/s²" | "Hz" | "1/s" | "K")
                    | (ParameterKind::Shape, _) => {
                        assert_eq!(scaled, p, "{}", declaration.id);
                    }
                    // Every other unit of a size has a rule.
                    _ => assert!(
                        scaled.size < 0.5 * p.size || p.unit == "Ω",
                        "{} {}",
                        declaration.id,
                        p.unit
                    ),
                }
            }
        }
    }
}
