//! Mounting of the IMU: a small rotation, and a place off the centre of mass.

use super::prelude::*;

/// Row 46 of the catalogue.
pub(super) static MISALIGNMENT: EffectDeclaration = EffectDeclaration {
    id: "imu-misalignment",
    name: "Misalignment of the IMU",
    catalogue_number: Some(46),
    class: EffectClass::SensorFault,
    equation: "a_m = a + m × a,   ω_m = ω + m × ω",
    places: &[Place::Reading],
    channels: &[FORCE, MOMENT, VELOCITY, ATTITUDE],
    parameters: &[
        ParameterDeclaration::size(
            "x_rad",
            "m_x",
            "rad",
            "rotation about body x",
            (-0.09, 0.09),
            0.025,
            0.025,
        ),
        ParameterDeclaration::size(
            "y_rad",
            "m_y",
            "rad",
            "rotation about body y",
            (-0.09, 0.09),
            0.025,
            -0.02,
        ),
        ParameterDeclaration::size(
            "z_rad",
            "m_z",
            "rad",
            "rotation about body z",
            (-0.09, 0.09),
            0.025,
            0.03,
        ),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "always",
    confused_with: &["level-offset", "rotor-tilt-tangential", "inertia-product-xy"],
    source: "mounting practice: 1 to 2°",
    build: Build::BuiltIn(|setup| {
        Changes::<3>::boxed(setup, |c, m, _| {
            for i in 0..3 {
                c.imu_misalignment_rad[i] += m[i];
            }
        })
    }),
};

/// Row 47 of the catalogue.
pub(super) static LEVER_ARM: EffectDeclaration = EffectDeclaration {
    id: "imu-lever-arm",
    name: "Lever arm of the IMU",
    catalogue_number: Some(47),
    class: EffectClass::SensorFault,
    equation: "a_m = a + ω' × r + ω × (ω × r)",
    places: &[Place::Reading],
    channels: &[FORCE, VELOCITY],
    parameters: &[
        ParameterDeclaration::size(
            "x_m",
            "r_x",
            "m",
            "place of the IMU along body x",
            (-0.1, 0.1),
            0.03,
            0.03,
        ),
        ParameterDeclaration::size(
            "y_m",
            "r_y",
            "m",
            "place of the IMU along body y",
            (-0.1, 0.1),
            0.03,
            -0.02,
        ),
        ParameterDeclaration::size(
            "z_m",
            "r_z",
            "m",
            "place of the IMU along body z",
            (-0.1, 0.1),
            0.03,
            0.03,
        ),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "angular acceleration",
    confused_with: &["centre-of-mass", "imu-misalignment"],
    source: "rigid body",
    build: Build::BuiltIn(|setup| {
        Changes::<3>::boxed(setup, |c, r, _| {
            for i in 0..3 {
                c.imu_lever_arm_m[i] += r[i];
            }
        })
    }),
};
