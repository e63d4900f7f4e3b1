//! Whether mass and arm can be those of a multirotor: a factor of ten or a wrong unit passes every fit, as all forces scale with the mass.
//!
//! The disc loading m g/(n π r²), with propellers as large as the arm allows, is 15 to 150 N/m² of vehicles from 27 g to 20 kg; racing
//! quadrotors and heavy lifters reach 250.

use super::Request;
use super::class::largest_radius_m;
use std::f64::consts::PI;
use std::ops::RangeInclusive;

const GRAVITY_M_S2: f64 = 9.81;
/// Disc loadings of ordinary vehicles, N/m².
const ORDINARY: RangeInclusive<f64> = 8.0..=300.0;
/// Disc loadings with which nothing flies, or nothing stays whole, N/m².
const POSSIBLE: RangeInclusive<f64> = 0.1..=3000.0;
/// Heaviest vehicle on one cell, kg.
const ONE_CELL_KG: f64 = 0.3;

/// N/m² of a vehicle with so many rotors.
fn loading(mass_kg: f64, arm_m: f64, rotors: usize) -> f64 {
    let radius = largest_radius_m(rotors, arm_m);
    mass_kg * GRAVITY_M_S2 / (rotors as f64 * PI * radius * radius)
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
}
