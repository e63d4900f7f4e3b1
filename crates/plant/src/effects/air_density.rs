//! Air density, or the constant of all propellers: a factor on the lift of every rotor.

use super::prelude::*;

/// Row 15 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "air-density",
    name: "Air density, propeller constant",
    catalogue_number: Some(15),
    class: EffectClass::Physics,
    equation: "f_i → (1 + s) f_i for all i",
    places: &[Place::StaticLift],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "share",
        "s",
        "",
        "relative error of the lift of all rotors",
        (-0.15, 0.15),
        0.08,
        -0.06,
    )
    .correcting_by_factors("rotors.thrust_level")],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "always; manoeuvres distinguish it from the mass",
    confused_with: &["mass", "voltage-gain", "voltage-offset", "dead-zone"],
    source: "ISA: −6 % per 500 m and ±5 % with temperature; Eq. 19",
    build: Build::BuiltIn(|setup| {
        Changes::<1>::boxed(setup, |c, [s], _| {
            for gain in &mut c.rotor_gain[..c.rotor_count] {
                *gain *= 1.0 + s;
            }
        })
    }),
};
