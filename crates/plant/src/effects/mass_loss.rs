//! Mass that leaves over the flight: a sprayer's tank, fuel, a cargo that pours out. From the start, or from an onset.
//!
//! At the same duty the vehicle accelerates upwards more and more. A sagging battery, a falling thrust curve and a
//! fading motor do the opposite, and the rate has one sign. A voltage law can look alike during a discharge; but it
//! also scales the torques of the rotors, and follows the voltage through every punch, while mass that leaves at the
//! centre of mass changes neither. Where a flight has neither punches nor torques, both are named.
//!
//! Inertia and centre of mass stay: the tank is near the centre.

use super::prelude::*;

/// A vehicle does not lose more than this share of itself: where the tank is empty at the latest.
const MOST: f64 = 0.9;

/// Row 57 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "mass-loss",
    name: "Mass that leaves in flight",
    catalogue_number: Some(57),
    class: EffectClass::Physics,
    equation: "m → m − ṁ t,   t from the start or the onset",
    places: &[Place::MassProperties],
    channels: &[FORCE],
    parameters: &[ParameterDeclaration::size(
        "rate_kg_s",
        "ṁ",
        "kg/s",
        "mass that leaves per time",
        (0.0, 0.01),
        0.0025,
        0.0025,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.growing().requiring(&[Requirement::BatteryVoltage]),
    excited_by: "minutes; punches that make the voltage sag distinguish it from laws of the voltage",
    confused_with: &["voltage-exponent", "mass", "air-density", "esc-resistance"],
    source: "Eq. 1; sprayers: 10 kg of 25 kg in 10 minutes; petrol generators: 0.5 kg/h",
    build: Build::BuiltIn(|setup| {
        Box::new(MassLoss {
            rate: setup.values[0],
            gone: 0.0,
        })
    }),
};

#[derive(Debug, Clone)]
struct MassLoss {
    /// kg/s.
    rate: f64,
    /// kg.
    gone: f64,
}

impl ActiveEffect for MassLoss {
    fn hooks(&self) -> Hooks {
        Hooks::VARYING_CONSTANTS.and(Hooks::ADVANCE)
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn constants(&self, constants: &mut Constants) {
        constants.mass_kg -= self.gone.min(MOST * constants.mass_kg);
    }

    fn advance(&mut self, _at: &Moment<'_>, step_s: f64) {
        self.gone += self.rate * step_s;
    }
}
