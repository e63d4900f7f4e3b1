//! Drag-to-lift ratio of all rotors: how much yaw torque a newton of thrust makes.

use super::prelude::*;

/// Row 34 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "moment-ratio",
    name: "Drag-to-lift ratio",
    catalogue_number: Some(34),
    class: EffectClass::Physics,
    equation: "c_D/c_L → (1 + d) c_D/c_L",
    places: &[Place::MassProperties],
    channels: &[MOMENT],
    parameters: &[
        ParameterDeclaration::size("share", "d", "", "relative error of c_D/c_L", (-0.4, 0.4), 0.2, 0.2)
            .correcting("rotors.moment_ratio_m", CorrectionScale::Share),
    ],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "yaw",
    confused_with: &["inertia-yaw", "rotor-reaction"],
    source: "Eq. 36",
    build: Build::BuiltIn(|setup| {
        Changes::<1>::boxed(setup, |c, [d], _| {
            for ratio in &mut c.moment_ratio_m[..c.rotor_count] {
                *ratio *= 1.0 + d;
            }
        })
    }),
};
