//! The law of the thrust: its slope over the duty, and its exponent of the battery voltage.
//!
//! Eq. 19 is a polynomial that was fitted on one motor and one propeller, linear in the voltage. Another motor, propeller or ESC
//! follows another law: bench tests of 13 motors with 8 propellers have exponents of the voltage of 1.4 to 1.9, an ESC that makes up
//! for the voltage has none, and the slope over the duty differs by a fifth. Both are neutral where the nominal curve is known best,
//! in hover at half charge, so that neither stands in for a wrong mass or density.

use super::prelude::*;

/// Smallest ratio to which an exponent is applied: below, a rotor has almost no thrust and the curve is not a power
/// law.
const LEAST_RATIO: f64 = 0.01;

/// Practically none: a measured curve has its law, and that of a vehicle from a log has the interval of the log. With 2
/// % of the size, as for other effects, a gain of the voltage sensor could no longer be distinguished from its offset.
const CLUTTER: f64 = 1e-5;

/// Row 55 of the catalogue.
pub(super) static SHAPE: EffectDeclaration = EffectDeclaration {
    id: "thrust-curve-shape",
    name: "Shape of the thrust curve",
    catalogue_number: Some(55),
    class: EffectClass::Physics,
    equation: "g_i → g_i ((g_i/f_h) (V₀/V))^e: d ln g/d ln u becomes (1 + e) times what it was; V₀ the resting voltage at half charge",
    places: &[Place::StaticLift],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "share",
        "e",
        "",
        "relative error of the slope of thrust over duty, both logarithmic",
        (-0.4, 0.4),
        0.15,
        0.15,
    )
    .with_clutter(CLUTTER)
    .correcting("rotors.thrust_slope", CorrectionScale::Share)],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::Duty]),
    excited_by: "a wide range of duty: climbs, descents, punches",
    confused_with: &["dead-zone", "voltage-exponent", "esc-resistance", "air-density"],
    source: "204 bench tests: slope 1.33 at a quarter of full thrust, 1.51 at half; flights 1.05 to 1.65",
    build: Build::BuiltIn(|setup| {
        Box::new(Law {
            of_lift: setup.values[0],
            of_voltage: -setup.values[0],
        })
    }),
};

/// Row 56 of the catalogue.
pub(super) static VOLTAGE_EXPONENT: EffectDeclaration = EffectDeclaration {
    id: "voltage-exponent",
    name: "Exponent of the voltage in the thrust",
    catalogue_number: Some(56),
    class: EffectClass::Physics,
    equation: "g_i → g_i (V/V₀)^e, V₀ the resting voltage at half charge",
    places: &[Place::StaticLift],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "exponent",
        "e",
        "",
        "added to the exponent of the voltage",
        (-1.2, 1.2),
        0.4,
        0.4,
    )
    .with_clutter(CLUTTER)
    .correcting("rotors.voltage_slope", CorrectionScale::Difference)],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::Duty, Requirement::BatteryVoltage]),
    excited_by: "a long discharge, and punches that make the voltage sag",
    confused_with: &[
        "esc-resistance",
        "voltage-gain",
        "thrust-curve-shape",
        "air-density",
        "mass",
    ],
    source: "bench tests of 13 motors and 8 propellers: V^1.4 to V^1.9; ESCs that compensate: V^0",
    build: Build::BuiltIn(|setup| {
        Box::new(Law {
            of_lift: 0.0,
            of_voltage: setup.values[0],
        })
    }),
};

/// g → g (g/f_h)^a (V/V₀)^b.
#[derive(Debug, Clone)]
struct Law {
    of_lift: f64,
    of_voltage: f64,
}

impl ActiveEffect for Law {
    fn hooks(&self) -> Hooks {
        Hooks::STATIC_LIFT
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn static_lift(&mut self, at: &Moment<'_>, lift: &mut [f64]) {
        let c = at.constants;
        let power = |ratio: f64, exponent: f64| {
            if exponent == 0.0 {
                1.0
            } else {
                libm::pow(ratio.max(LEAST_RATIO), exponent)
            }
        };
        let of_voltage = power(at.battery_voltage / c.reference_voltage_v, self.of_voltage);
        for lift in lift {
            *lift *= of_voltage * power(*lift / c.hover_thrust_n, self.of_lift);
        }
    }
}
