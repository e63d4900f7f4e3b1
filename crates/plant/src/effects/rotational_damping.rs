//! Rotational damping: the k_r of Eq. 1.

use super::prelude::*;

/// Row 14 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
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
    confused_with: &["axial-inflow", "command-delay", "motor-time-constant"],
    source: "Eq. 1",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [k], _| c.angular_drag_nms += k)),
};
