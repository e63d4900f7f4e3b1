//! Mass: payload, another battery, or a scale that was wrong.

use super::prelude::*;

/// Row 16 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "mass",
    name: "Mass",
    catalogue_number: Some(16),
    class: EffectClass::Physics,
    equation: "m → m (1 + d)",
    places: &[Place::MassProperties],
    channels: &[FORCE],
    parameters: &[
        ParameterDeclaration::size("share", "d", "", "relative error of the mass", (-0.2, 0.3), 0.1, 0.1)
            .correcting_by_factors("body.mass_kg"),
    ],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR.in_trim(TrimChange::Weight),
    excited_by: "always",
    confused_with: &["air-density", "voltage-gain", "accelerometer-scale", "dead-zone"],
    source: "Eq. 1",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.mass_kg *= 1.0 + d)),
};
