//! Whether mass and arm, inertias and torques are plausible for a multirotor: a factor of ten or a wrong unit passes
//! every fit, as all forces scale with the mass.
//!
//! The disc loading m g/(n π r²), with propellers as large as the arm allows, is 15 to 150 N/m² of vehicles from 27 g to 20 kg; racing
//! quadrotors and heavy lifters reach 250.

use super::Request;
use super::class::{self, largest_radius_m};
use super::grid::GRAVITY;
use std::f64::consts::PI;
use std::ops::RangeInclusive;

/// Disc loadings of ordinary vehicles, N/m².
const ORDINARY: RangeInclusive<f64> = 8.0..=300.0;
/// Disc loadings with which nothing flies, or nothing stays whole, N/m².
const POSSIBLE: RangeInclusive<f64> = 0.1..=3000.0;
/// Heaviest vehicle on one cell, kg.
const ONE_CELL_KG: f64 = 0.3;

/// Radii of gyration about roll and pitch that a multirotor can have, over its arm: 0.71 if its whole mass were at the rotors of an even polygon,
/// 0.2 if a twelfth of it were there and the rest a point. Vehicles of the classes have 0.45 to 0.57.
pub(super) const GYRATION_OVER_ARM: std::ops::RangeInclusive<f64> = 0.2..=0.8;

/// √(J/m) over the arm, of a gain l m/J, 1/m.
pub(super) fn gyration_over_arm(gain: f64, arm_m: f64) -> f64 {
    (arm_m / gain).sqrt() / arm_m
}

/// Whether the gain of roll or pitch, l m/J, is one that a multirotor can have.
pub(crate) fn has_possible_gyration(gain: f64, arm_m: f64) -> bool {
    GYRATION_OVER_ARM.contains(&gyration_over_arm(gain, arm_m))
}

/// Whether the gain of yaw, c m/Jz, 1/m, is one that propellers can have on these arms, with Jz by the gains of roll and pitch.
pub(crate) fn has_possible_moment(yaw_gain: f64, gain: [f64; 2], arm_m: f64) -> bool {
    let gyration_squared = gain.iter().map(|gain| arm_m / gain).sum::<f64>();
    MOMENT_RATIO_OVER_ARM.contains(&(yaw_gain * class::YAW_INERTIA_SHARE * gyration_squared / arm_m))
}

/// Torque over thrust that a propeller can have, over the arm. Propellers have 0.02 to 0.1 of their diameter, which is 0.3 to 1.7 arms.
pub(super) const MOMENT_RATIO_OVER_ARM: std::ops::RangeInclusive<f64> = 0.004..=0.3;

/// N/m² of a vehicle with this many rotors.
fn loading(mass_kg: f64, arm_m: f64, rotors: usize) -> f64 {
    let radius = largest_radius_m(rotors, arm_m);
    mass_kg * GRAVITY / (rotors as f64 * PI * radius * radius)
}

/// The unit that somebody meant, if another one makes the vehicle ordinary.
fn meant(request: &Request, rotors: usize) -> String {
    let (mass, arm) = (request.mass_kg, request.arm_m);
    let fits = |mass, arm| ORDINARY.contains(&loading(mass, arm, rotors));
    let guess = if fits(mass / 1000.0, arm) {
        format!("{mass} g would be {:.4} kg", mass / 1000.0)
    } else if fits(mass, arm / 100.0) {
        format!("{arm} cm would be {:.4} m", arm / 100.0)
    } else if fits(mass, arm / 1000.0) {
        format!("{arm} mm would be {:.4} m", arm / 1000.0)
    } else {
        return String::new();
    };
    format!(" ({guess})")
}

/// Why the vehicle cannot be: one sentence.
pub(super) fn refusal(request: &Request, rotors: usize) -> Option<String> {
    let loading = loading(request.mass_kg, request.arm_m, rotors);
    (!POSSIBLE.contains(&loading)).then(|| {
        format!(
            "mass and arm: {} kg on {rotors} rotors with arms of {} m is {loading:.3} N on each square metre of propeller; expected {} to {}{}",
            request.mass_kg,
            request.arm_m,
            ORDINARY.start(),
            ORDINARY.end(),
            meant(request, rotors)
        )
    })
}

/// Why mass, arm or cells may be wrong: a note.
pub(super) fn doubt(request: &Request, rotors: usize, cells: u32) -> Option<String> {
    let (mass, arm) = (request.mass_kg, request.arm_m);
    let loading = loading(mass, arm, rotors);
    if !ORDINARY.contains(&loading) {
        return Some(format!(
            "check mass and arm: {mass} kg on {rotors} rotors with arms of {arm} m is {loading:.0} N on each square metre of propeller, where ordinary vehicles have {} to {}{}: \
             thrust, inertia, drag and battery below are in proportion to the mass",
            ORDINARY.start(),
            ORDINARY.end(),
            meant(request, rotors)
        ));
    }
    (cells == 1 && mass > ONE_CELL_KG).then(|| {
        format!("check the mass: {mass} kg on a battery of one cell, which carries some {ONE_CELL_KG} kg at most")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(mass_kg: f64, arm_m: f64) -> Request {
        Request {
            mass_kg,
            arm_m,
            frame: None,
            trust_frame: false,
            capacity_ah: None,
            cells: None,
        }
    }

    /// Masses and arms as published: Crazyflie 2.1, 5-inch racer, F550, Erle-Copter, S500, DJI M600, Freefly Alta X.
    #[test]
    fn val_real_vehicles_raise_no_doubt() {
        for (mass, arm, rotors, cells) in [
            (0.027, 0.0396, 4, 1),
            (0.036, 0.046, 4, 1),
            (0.75, 0.11, 4, 6),
            (1.55, 0.275, 6, 4),
            (1.1, 0.23, 4, 3),
            (1.5, 0.25, 4, 4),
            (10.0, 0.567, 6, 6),
            (18.0, 0.72, 4, 12),
        ] {
            let found = doubt(&request(mass, arm), rotors, cells);
            assert!(found.is_none(), "{found:?}");
            assert!(refusal(&request(mass, arm), rotors).is_none());
        }
    }

    #[test]
    fn val_wrong_units_and_factors_are_told() {
        for (mass, arm, rotors, words) in [
            (15.5, 0.275, 6, "check mass and arm"),
            (0.27, 0.0396, 4, "check mass and arm"),
            (0.155, 0.275, 6, "check mass and arm"),
        ] {
            let found = doubt(&request(mass, arm), rotors, 4).unwrap_or_default();
            assert!(found.contains(words), "{mass} kg, {arm} m: {found:?}");
        }
        for (mass, arm, rotors, words) in [
            (27.0, 0.0396, 4, "27 g would be 0.0270 kg"),
            (0.027, 3.96, 4, "3.96 cm would be 0.0396 m"),
        ] {
            let found = refusal(&request(mass, arm), rotors).unwrap_or_default();
            assert!(found.contains(words), "{mass} kg, {arm} m: {found:?}");
        }
        assert!(doubt(&request(1.5, 0.25), 4, 1).is_some_and(|note| note.contains("one cell")));
    }

    /// Gains of halves that no vehicle has made R² of −20 000.
    #[test]
    fn regress_gains_that_no_vehicle_has_are_told() {
        let arm_m = 0.149;
        // J = 0.25 m l² and 1.2 m l².
        let [usual, impossible] = [0.25, 1.2].map(|ratio| 1.0 / (ratio * arm_m));
        assert!(has_possible_gyration(usual, arm_m) && !has_possible_gyration(impossible, arm_m));
        // Jz of a flat body, c of 0.012 m and of 1.29 m.
        let of = |ratio_m: f64| ratio_m / (class::YAW_INERTIA_SHARE * 0.5 * arm_m * arm_m);
        assert!(has_possible_moment(of(0.012), [usual; 2], arm_m));
        assert!(!has_possible_moment(of(1.29), [usual; 2], arm_m));
    }
}
