//! The accelerometer: bias and scale.

use super::prelude::*;

/// Row 42 of the catalogue.
pub(super) static BIAS: EffectDeclaration = EffectDeclaration {
    id: "accelerometer-bias",
    name: "Accelerometer bias",
    catalogue_number: Some(42),
    class: EffectClass::SensorFault,
    equation: "a_m = a + b",
    places: &[Place::Reading],
    channels: &[FORCE, VELOCITY],
    parameters: &[
        ParameterDeclaration::size("x_m_s2", "b_x", "m/s²", "bias along body x", (-0.5, 0.5), 0.15, 0.15),
        ParameterDeclaration::size("y_m_s2", "b_y", "m/s²", "bias along body y", (-0.5, 0.5), 0.15, -0.1),
        ParameterDeclaration::size("z_m_s2", "b_z", "m/s²", "bias along body z", (-0.5, 0.5), 0.15, 0.12),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "always; a yaw turn distinguishes it from wind",
    confused_with: &["level-offset", "wind", "rotor-tilt-tangential", "rotor-tilt-radial"],
    source: "MPU-9250 data sheet: zero-g offset ±0.6 m/s² before calibration",
    build: Build::BuiltIn(|setup| {
        Changes::<3>::boxed(setup, |c, bias, _| {
            for i in 0..3 {
                c.accelerometer_bias_m_s2[i] += bias[i];
            }
        })
    }),
};

/// Row 43 of the catalogue.
pub(super) static SCALE: EffectDeclaration = EffectDeclaration {
    id: "accelerometer-scale",
    name: "Accelerometer scale",
    catalogue_number: Some(43),
    class: EffectClass::SensorFault,
    equation: "a_m = (1 + s) a",
    places: &[Place::Reading],
    channels: &[FORCE, VELOCITY],
    parameters: &[ParameterDeclaration::size(
        "share",
        "s",
        "",
        "relative error of all axes",
        (-0.05, 0.05),
        0.02,
        0.02,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "always",
    confused_with: &["mass"],
    source: "MPU-9250 data sheet: ±3 %",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [s], _| c.accelerometer_scale += s)),
};
