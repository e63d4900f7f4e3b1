//! Drag that differs between forward and sideways flight: a long fuselage, arms or a payload across.
//!
//! It is a share of the existing drag: as a force of its own it would be fitted to anything else that turns with the
//! body (a load on a rope, a tilted rotor). The vertical axis is left alone: a vertical drag that differs from the
//! horizontal one is covered by rotor drag (horizontal) and linear friction (all three axes) together.

use super::prelude::*;

/// Row 59 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "drag-anisotropy",
    name: "Drag that differs forward and sideways",
    catalogue_number: Some(59),
    class: EffectClass::Physics,
    equation: "F_drag,x → (1 + a/2) F_drag,x,   F_drag,y → (1 − a/2) F_drag,y:   a = 2 (k_x − k_y)/(k_x + k_y)",
    places: &[Place::Force],
    channels: &[FORCE],
    parameters: &[ParameterDeclaration::size(
        "share",
        "a",
        "",
        "drag forward minus that sideways, over their mean",
        (-1.2, 1.2),
        0.4,
        0.4,
    )],
    per_rotor: false,
    may_set_in: false,
    needs: &["rotor-drag", "quadratic-drag", "linear-friction"],
    search: Search::by(Strategy::OfAnother).requiring(&[Requirement::AirVelocity]),
    excited_by: "translation forward and sideways: one way alone it is a drag of another size",
    confused_with: &["rotor-drag", "linear-friction", "quadratic-drag", "wind"],
    source: "Faessler, Franchi, Scaramuzza 2018, eq. 2 and table: diag(0.544, 0.386, 0) 1/s, a = 0.34",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [share], _| c.drag_anisotropy += share)),
};
