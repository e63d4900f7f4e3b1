//! Isotropic linear friction: the k_t of Eq. 1.

use super::prelude::*;

/// Row 3 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "linear-friction",
    name: "Linear friction",
    catalogue_number: Some(3),
    class: EffectClass::Physics,
    equation: "F = −k_t v_a",
    places: &[Place::Force],
    channels: &[FORCE],
    parameters: &[ParameterDeclaration::size(
        "drag_kg_s",
        "k_t",
        "kg/s",
        "friction per air speed, in all directions",
        (-0.2, 0.4),
        0.2,
        0.2,
    )
    .correcting("body.linear_drag_kg_s", CorrectionScale::Difference)],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::AirVelocity]),
    excited_by: "translation and climbs",
    confused_with: &["rotor-drag", "quadratic-drag", "axial-inflow"],
    source: "Eq. 1",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [k], _| c.linear_drag_kg_s += k)),
};
