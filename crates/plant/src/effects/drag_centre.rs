//! Height of the centre of drag: drag that acts above the centre of mass turns the vehicle. Needs a drag.

use super::prelude::*;

/// Row 13 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "drag-centre",
    name: "Height of the drag centre",
    catalogue_number: Some(13),
    class: EffectClass::Physics,
    equation: "M = r_d × F_drag,   r_d = (0, 0, −z_d)",
    places: &[Place::Torque],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "height_m",
        "z_d",
        "m",
        "height of the drag centre over the centre of mass",
        (-0.1, 0.1),
        0.04,
        0.04,
    )],
    per_rotor: false,
    may_set_in: false,
    needs: &["rotor-drag", "quadratic-drag", "linear-friction"],
    search: Search::LINEAR.requiring(&[Requirement::AirVelocity]),
    excited_by: "translation",
    confused_with: &["flapping-moment"],
    source: "geometry",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [height], _| c.drag_centre_height_m += height)),
};
