//! Typical values for a vehicle of this size: defaults and priors for what a flight cannot determine.
//!
//! J = κ m l². From published vehicles and eleven public flights; the 5-inch inertias, and the values for heavier
//! vehicles, are judgement. Standard deviations are deliberately wide.

use serde::Serialize;

/// A size class of vehicles.
#[derive(Debug, Clone, Copy, Serialize, utoipa::ToSchema)]
#[schema(as = VehicleClass)]
pub struct Class {
    /// In words.
    pub name: &'static str,
    /// n = d ln T/d ln u at hover.
    pub slope: f64,
    /// τ of the thrust, s.
    pub lag_s: f64,
    /// Delay from the command in the log to the motor, s.
    pub delay_s: f64,
    /// J/(m l²), roll, pitch.
    pub inertia_ratio: [f64; 2],
    /// Torque per thrust, m.
    pub moment_ratio_m: f64,
    /// Linear drag over mass, k/m, 1/s.
    pub drag_per_s: f64,
    /// Electrical efficiency against momentum theory: ideal hover power over actual power.
    pub efficiency: f64,
    /// Specific energy of the battery over the vehicle's mass, Ah·V/kg.
    pub energy_wh_per_kg: f64,
}

/// Deviation of n.
pub(crate) const SLOPE_DEVIATION: f64 = 0.2;
/// Variance of n as the fit's prior has it: of α and β.
pub(crate) const SLOPE_PRIOR_VARIANCE: f64 =
    1.44 * SLOPE_DEVIATION * SLOPE_DEVIATION + 0.25 * BEND_DEVIATION * BEND_DEVIATION;
/// Deviation of β.
pub(crate) const BEND_DEVIATION: f64 = 0.35;
/// Deviations of logarithms: τ, κ, c, k/m.
pub(crate) const LAG_LOG_DEVIATION: f64 = 0.3;
pub(crate) const INERTIA_LOG_DEVIATION: f64 = 0.3;
pub(crate) const MOMENT_LOG_DEVIATION: f64 = 0.4;
pub(crate) const DRAG_LOG_DEVIATION: f64 = 0.4;
/// Deviation of the delay, s.
pub(crate) const DELAY_DEVIATION_S: f64 = 0.006;
/// d ln T/d ln V, and its deviation: bench tests give 1.4 to 1.9, flights with compensation less.
pub(crate) const VOLTAGE_SLOPE: f64 = 1.5;
pub(crate) const VOLTAGE_SLOPE_DEVIATION: f64 = 0.4;
/// λ of N = c (X + λ Ẋ), s: at most this. Flights of real vehicles have 0.10 to 0.19.
pub(crate) const REACTION_MOST_S: f64 = 0.2;
/// Jz/(Jx + Jy): 1 for a flat body, less with height.
pub(crate) const YAW_INERTIA_SHARE: f64 = 0.93;
pub(crate) const YAW_INERTIA_LOG_DEVIATION: f64 = 0.05;

const MICRO: Class = Class {
    name: "micro, below 0.1 kg",
    slope: 1.5,
    lag_s: 0.065,
    delay_s: 0.008,
    inertia_ratio: [0.30, 0.32],
    moment_ratio_m: 0.006,
    drag_per_s: 0.35,
    efficiency: 0.15,
    energy_wh_per_kg: 33.0,
};
const FIVE_INCH: Class = Class {
    name: "5-inch, arm below 0.16 m",
    slope: 1.35,
    lag_s: 0.025,
    delay_s: 0.004,
    inertia_ratio: [0.20, 0.25],
    moment_ratio_m: 0.012,
    drag_per_s: 0.25,
    efficiency: 0.40,
    energy_wh_per_kg: 35.0,
};
const TEN_INCH: Class = Class {
    name: "10-inch, arm of 0.16 m to 0.45 m",
    slope: 1.35,
    lag_s: 0.045,
    delay_s: 0.010,
    inertia_ratio: [0.20, 0.23],
    moment_ratio_m: 0.016,
    drag_per_s: 0.19,
    efficiency: 0.50,
    energy_wh_per_kg: 55.0,
};
const LARGE: Class = Class {
    name: "large, arm above 0.45 m",
    slope: 1.35,
    lag_s: 0.070,
    delay_s: 0.010,
    inertia_ratio: [0.25, 0.25],
    moment_ratio_m: 0.020,
    drag_per_s: 0.20,
    efficiency: 0.50,
    energy_wh_per_kg: 70.0,
};

/// Radius of the largest propellers that `rotors` arms of this length hold side by side with some room, m.
pub(crate) fn largest_radius_m(rotors: usize, arm_m: f64) -> f64 {
    0.82 * arm_m * (std::f64::consts::PI / rotors as f64).sin()
}

impl Class {
    /// The class of a vehicle by mass, kg, and arm, m.
    pub fn of(mass_kg: f64, arm_m: f64) -> Self {
        if mass_kg < 0.1 {
            MICRO
        } else if arm_m < 0.16 {
            FIVE_INCH
        } else if arm_m < 0.45 {
            TEN_INCH
        } else {
            LARGE
        }
    }

    /// k_P, W/N^1.5, of one of `rotors` equal rotors on this arm: momentum theory, the propeller as large as the arm allows.
    pub(crate) fn power_coefficient(&self, rotors: usize, arm_m: f64) -> f64 {
        const AIR_KG_M3: f64 = 1.225;
        let pi = std::f64::consts::PI;
        let radius = largest_radius_m(rotors, arm_m);
        1.0 / (self.efficiency * (2.0 * AIR_KG_M3 * pi * radius * radius).sqrt())
    }
}
