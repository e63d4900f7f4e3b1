//! Tilt of one motor: thrust that leans along the circle of the rotors or outwards.

use super::prelude::*;

/// Row 21 of the catalogue.
pub(super) static TANGENTIAL: EffectDeclaration = EffectDeclaration {
    id: "rotor-tilt-tangential",
    name: "Tangential tilt of a motor",
    catalogue_number: Some(21),
    class: EffectClass::Physics,
    equation: "n_i = −e₃ + t_a e_tan",
    places: &[Place::MassProperties],
    channels: &[FORCE, MOMENT],
    parameters: &[ParameterDeclaration::size(
        "angle_rad",
        "t_a",
        "rad",
        "lean clockwise seen from above",
        (-0.09, 0.09),
        0.035,
        0.035,
    )],
    per_rotor: true,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "yaw and manoeuvres",
    confused_with: &[
        "rotor-moment-ratio",
        "moment-ratio",
        "wind",
        "level-offset",
        "accelerometer-bias",
    ],
    source: "geometry",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [t], i| c.rotor_tilt_tangential[i] += t)),
};

/// Row 21 of the catalogue.
pub(super) static RADIAL: EffectDeclaration = EffectDeclaration {
    id: "rotor-tilt-radial",
    name: "Radial tilt of a motor",
    catalogue_number: Some(21),
    class: EffectClass::Physics,
    equation: "n_i = −e₃ + t_b e_rad",
    places: &[Place::MassProperties],
    channels: &[FORCE, MOMENT],
    parameters: &[ParameterDeclaration::size(
        "angle_rad",
        "t_b",
        "rad",
        "lean outwards",
        (-0.09, 0.09),
        0.035,
        0.035,
    )],
    per_rotor: true,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "yaw turns and manoeuvres",
    confused_with: &["wind", "level-offset", "accelerometer-bias", "rotor-tilt-tangential"],
    source: "geometry",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [t], i| c.rotor_tilt_radial[i] += t)),
};
