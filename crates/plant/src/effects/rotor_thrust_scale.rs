//! Thrust of one rotor: a damaged or foreign blade, a worn motor.

use super::prelude::*;

/// Row 23 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "rotor-thrust-scale",
    name: "Thrust of one rotor (damaged blade)",
    catalogue_number: Some(23),
    class: EffectClass::Physics,
    equation: "f_i → (1 + s) f_i",
    places: &[Place::StaticLift],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "share",
        "s",
        "",
        "relative error of the static lift",
        (-0.3, 0.1),
        0.05,
        -0.05,
    )
    .correcting("rotors.thrust_scale", CorrectionScale::Whole)],
    per_rotor: true,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.in_trim(TrimChange::RotorThrust),
    excited_by: "always",
    confused_with: &["centre-of-mass", "rotor-lift-bias"],
    source: "Table 1, blades b, c, d; Eq. 19",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [s], i| c.rotor_gain[i] *= 1.0 + s)),
};
