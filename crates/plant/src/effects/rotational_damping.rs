//! Rotational damping: the k_r of Eq. 1, and that of the yaw alone.
//!
//! A rotor that turns with the vehicle moves through the air at ω_z l, and its drag there (the H-force of
//! [`rotor_drag`](super::rotor_drag)) holds the yaw back: k_z ≈ k_d l², k_d of all rotors, l the arm.

use super::prelude::*;

/// Row 14 of the catalogue.
pub(super) static ALL_AXES: EffectDeclaration = EffectDeclaration {
    id: "rotational-damping",
    name: "Rotational damping",
    catalogue_number: Some(14),
    class: EffectClass::Physics,
    equation: "M = −k_r ω",
    places: &[Place::Torque],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "damping_n_m_s",
        "k_r",
        "N·m·s",
        "damping about each body axis",
        (0.0, 0.02),
        0.01,
        0.01,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "body rates",
    confused_with: &["axial-inflow", "command-delay", "motor-time-constant", "yaw-damping"],
    source: "Eq. 1",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [k], _| c.angular_drag_nms += k)),
};

/// Row 60 of the catalogue.
pub(super) static YAW: EffectDeclaration = EffectDeclaration {
    id: "yaw-damping",
    name: "Damping of the yaw",
    catalogue_number: Some(60),
    class: EffectClass::Physics,
    equation: "M_z = −k_z ω_z",
    places: &[Place::Torque],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "damping_n_m_s",
        "k_z",
        "N·m·s",
        "damping about the vertical body axis; about k_d l² of a rotor drag k_d on arms of length l",
        (0.0, 0.08),
        0.02,
        0.02,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "yaw rate",
    confused_with: &["rotational-damping", "motor-time-constant", "rotor-reaction"],
    source: "blade-element theory: H-force of Faessler, Franchi, Scaramuzza 2018 at the speed ω_z l of each rotor",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [k], _| c.yaw_drag_nms += k)),
};
