//! Length of the arms: how far the rotors are from the middle of the vehicle.
//!
//! A diagonal that was taken for an arm, or an arm that was measured to the motor's edge, scales the torques of roll and pitch, and with the
//! gyroscopic torques of Euler's equation known no inertia makes up for it.

use super::prelude::*;

/// Row 61 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "arm-length",
    name: "Length of the arms",
    catalogue_number: Some(61),
    class: EffectClass::Physics,
    equation: "(x_i, y_i) → (x_i, y_i) (1 + d)",
    places: &[Place::MassProperties],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "share",
        "d",
        "",
        "relative error of the distance of all rotors from the middle",
        (-0.3, 0.3),
        0.1,
        0.1,
    )
    .correcting("rotors.arm_m", CorrectionScale::Share)],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR.unless_guessed(&["inertia-roll", "inertia-pitch"]),
    excited_by: "angular acceleration in roll and pitch",
    confused_with: &["inertia-roll", "inertia-pitch", "moment-ratio", "air-density", "mass"],
    source: "rigid body: torque r_i × f_i of each rotor",
    build: Build::BuiltIn(|setup| {
        Changes::<1>::boxed(setup, |c, [d], _| {
            for [x, y, _] in &mut c.rotor_position_body[..c.rotor_count] {
                *x *= 1.0 + d;
                *y *= 1.0 + d;
            }
        })
    }),
};
