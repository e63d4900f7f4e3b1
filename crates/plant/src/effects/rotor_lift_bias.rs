//! Lift bias of one rotor: in every flight, as the fit of Eq. 19 has an error; fitted, never a finding.

use super::prelude::*;

/// Row 24 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "rotor-lift-bias",
    name: "Lift bias of one rotor",
    catalogue_number: Some(24),
    class: EffectClass::Nuisance,
    equation: "f_i → f_i + b_i",
    places: &[Place::StaticLift],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "bias_n",
        "b_i",
        "N",
        "constant added to the static lift",
        (-0.02, 0.02),
        0.0062,
        0.0062,
    )
    .with_clutter(0.0031)],
    per_rotor: true,
    may_set_in: false,
    needs: &[],
    search: Search::by(Strategy::Nuisance),
    excited_by: "always",
    confused_with: &["rotor-thrust-scale"],
    source: "§6: ±10.756 mN, the error of the fit",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [b], i| c.rotor_bias_n[i] += b)),
};
