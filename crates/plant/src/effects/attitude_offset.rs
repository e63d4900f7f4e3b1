//! Offsets of the attitude: heading (magnetometer) and level (trim of the estimator).

use super::prelude::*;

/// Row 52 of the catalogue.
pub(super) static HEADING: EffectDeclaration = EffectDeclaration {
    id: "heading-offset",
    name: "Heading (magnetometer) offset",
    catalogue_number: Some(52),
    class: EffectClass::SensorFault,
    equation: "ψ_m = ψ + o",
    places: &[Place::Reading],
    channels: &[VELOCITY],
    parameters: &[ParameterDeclaration::size(
        "offset_rad",
        "o",
        "rad",
        "added to yaw",
        (-0.2, 0.2),
        0.08,
        0.08,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "horizontal acceleration",
    confused_with: &["wind", "velocity-latency"],
    source: "magnetometer practice: 2 to 10°",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [o], _| c.heading_offset_rad += o)),
};

/// Row 53 of the catalogue.
pub(super) static LEVEL: EffectDeclaration = EffectDeclaration {
    id: "level-offset",
    name: "Level (trim) offset",
    catalogue_number: Some(53),
    class: EffectClass::SensorFault,
    equation: "φ_m = φ + o_φ,   θ_m = θ + o_θ",
    places: &[Place::Reading],
    channels: &[VELOCITY, ATTITUDE],
    parameters: &[
        ParameterDeclaration::size("roll_rad", "o_φ", "rad", "added to roll", (-0.05, 0.05), 0.015, 0.015),
        ParameterDeclaration::size(
            "pitch_rad",
            "o_θ",
            "rad",
            "added to pitch",
            (-0.05, 0.05),
            0.015,
            -0.012,
        ),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "always",
    confused_with: &["accelerometer-bias", "imu-misalignment", "wind"],
    source: "ArduPilot AHRS_TRIM: 0.5 to 1.5°",
    build: Build::BuiltIn(|setup| {
        Changes::<2>::boxed(setup, |c, [roll, pitch], _| {
            c.level_offset_rad[0] += roll;
            c.level_offset_rad[1] += pitch;
        })
    }),
};
