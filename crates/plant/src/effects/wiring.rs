//! Gross errors of the build: two motors plugged the wrong way round, a propeller that turns the other way.
//!
//! The share is 1 for the real error; values between are for continuity only.

use super::prelude::*;

/// Row 35 of the catalogue.
pub(super) static SWAPPED: EffectDeclaration = EffectDeclaration {
    id: "swapped-rotors",
    name: "Two motors swapped",
    catalogue_number: Some(35),
    class: EffectClass::Physics,
    equation: "u_i → (1 − s) u_i + s u_j and the other way round",
    places: &[Place::Command],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[
        ParameterDeclaration::size("share", "s", "", "1 swapped, 0 not", (0.0, 1.0), 1.0, 1.0),
        ParameterDeclaration::shape("partner", "j", "", "number of the other rotor", (1.0, 16.0), 2.0),
    ],
    per_rotor: true,
    may_set_in: false,
    needs: &[],
    search: Search::by(Strategy::Wiring(Wiring::Pair { partner: "partner" })).requiring(&[Requirement::Command]),
    excited_by: "always",
    confused_with: &["reversed-spin"],
    source: "motor test of ArduPilot",
    build: Build::BuiltIn(|setup| Box::new(Swapped::new(setup))),
};

/// Row 35 of the catalogue.
pub(super) static REVERSED: EffectDeclaration = EffectDeclaration {
    id: "reversed-spin",
    name: "Rotor with the wrong sense of rotation",
    catalogue_number: Some(35),
    class: EffectClass::Physics,
    equation: "s_i → (1 − 2s) s_i",
    places: &[Place::MassProperties],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "share",
        "s",
        "",
        "1 reversed, 0 not",
        (0.0, 1.0),
        1.0,
        1.0,
    )],
    per_rotor: true,
    may_set_in: false,
    needs: &[],
    search: Search::by(Strategy::Wiring(Wiring::Single)),
    excited_by: "always",
    confused_with: &["swapped-rotors", "moment-ratio"],
    source: "motor test of ArduPilot",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [s], i| c.rotor_spin[i] *= 1.0 - 2.0 * s)),
};

#[derive(Debug, Clone)]
struct Swapped {
    share: f64,
    rotor: usize,
    partner: usize,
}

impl Swapped {
    fn new(setup: &Setup<'_>) -> Self {
        Self {
            share: setup.values[0],
            rotor: setup.rotor,
            partner: (libm::round(setup.values[1]).max(1.0) as usize) - 1,
        }
    }
}

impl ActiveEffect for Swapped {
    fn hooks(&self) -> Hooks {
        Hooks::COMMAND
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn command(&mut self, _at: &Moment<'_>, duty: &mut [f64]) {
        if self.share == 0.0 || self.partner >= duty.len() {
            return;
        }
        let (a, b) = (duty[self.rotor], duty[self.partner]);
        duty[self.rotor] += self.share * (b - a);
        duty[self.partner] += self.share * (a - b);
    }
}
