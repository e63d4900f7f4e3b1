//! The gyroscope: bias and scale.

use super::prelude::*;

/// Row 44 of the catalogue.
pub(super) static BIAS: EffectDeclaration = EffectDeclaration {
    id: "gyro-bias",
    name: "Gyroscope bias",
    catalogue_number: Some(44),
    class: EffectClass::SensorFault,
    equation: "ω_m = ω + b",
    places: &[Place::Reading],
    channels: &[ATTITUDE],
    parameters: &[
        ParameterDeclaration::size(
            "x_rad_s",
            "b_x",
            "rad/s",
            "bias about body x",
            (-0.05, 0.05),
            0.015,
            0.015,
        ),
        ParameterDeclaration::size(
            "y_rad_s",
            "b_y",
            "rad/s",
            "bias about body y",
            (-0.05, 0.05),
            0.015,
            -0.01,
        ),
        ParameterDeclaration::size(
            "z_rad_s",
            "b_z",
            "rad/s",
            "bias about body z",
            (-0.05, 0.05),
            0.015,
            0.012,
        ),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "always",
    confused_with: &[],
    source: "MPU-9250 data sheet: ±5 °/s before calibration",
    build: Build::BuiltIn(|setup| {
        Changes::<3>::boxed(setup, |c, bias, _| {
            for i in 0..3 {
                c.gyro_bias_rad_s[i] += bias[i];
            }
        })
    }),
};

/// Row 45 of the catalogue.
pub(super) static SCALE: EffectDeclaration = EffectDeclaration {
    id: "gyro-scale",
    name: "Gyroscope scale",
    catalogue_number: Some(45),
    class: EffectClass::SensorFault,
    equation: "ω_m = (1 + s) ω",
    places: &[Place::Reading],
    channels: &[MOMENT, ATTITUDE],
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
    excited_by: "body rates",
    confused_with: &["inertia-roll", "inertia-pitch"],
    source: "MPU-9250 data sheet: ±3 %",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [s], _| c.gyro_scale += s)),
};
