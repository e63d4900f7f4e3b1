//! Inertia: moments and products.

use super::prelude::*;

/// Row 19 of the catalogue.
pub(super) static ROLL: EffectDeclaration = EffectDeclaration {
    id: "inertia-roll",
    name: "Roll inertia",
    catalogue_number: Some(19),
    class: EffectClass::Physics,
    equation: "J_x → J_x (1 + d)",
    places: &[Place::MassProperties],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "share",
        "d",
        "",
        "relative error",
        (-0.4, 0.4),
        0.2,
        0.15,
    )],
    per_rotor: false,
    needs: &[],
    excited_by: "angular acceleration about this axis",
    confused_with: &["rotor-thrust-scale", "air-density", "motor-time-constant"],
    source: "bifilar pendulum practice: ±15 to 20 %",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.inertia_body_kg_m2[0][0] *= 1.0 + d)),
};

/// Row 19 of the catalogue.
pub(super) static PITCH: EffectDeclaration = EffectDeclaration {
    id: "inertia-pitch",
    name: "Pitch inertia",
    catalogue_number: Some(19),
    class: EffectClass::Physics,
    equation: "J_y → J_y (1 + d)",
    places: &[Place::MassProperties],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "share",
        "d",
        "",
        "relative error",
        (-0.4, 0.4),
        0.2,
        0.15,
    )],
    per_rotor: false,
    needs: &[],
    excited_by: "angular acceleration about this axis",
    confused_with: &["rotor-thrust-scale", "air-density", "motor-time-constant"],
    source: "bifilar pendulum practice: ±15 to 20 %",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.inertia_body_kg_m2[1][1] *= 1.0 + d)),
};

/// Row 19 of the catalogue.
pub(super) static YAW: EffectDeclaration = EffectDeclaration {
    id: "inertia-yaw",
    name: "Yaw inertia",
    catalogue_number: Some(19),
    class: EffectClass::Physics,
    equation: "J_z → J_z (1 + d)",
    places: &[Place::MassProperties],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "share",
        "d",
        "",
        "relative error",
        (-0.4, 0.4),
        0.2,
        0.2,
    )],
    per_rotor: false,
    needs: &[],
    excited_by: "angular acceleration about this axis",
    confused_with: &["moment-ratio", "rotor-reaction"],
    source: "bifilar pendulum practice: ±15 to 20 %",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.inertia_body_kg_m2[2][2] *= 1.0 + d)),
};

/// Row 20 of the catalogue.
pub(super) static PRODUCT_XY: EffectDeclaration = EffectDeclaration {
    id: "inertia-product-xy",
    name: "Product of inertia xy",
    catalogue_number: Some(20),
    class: EffectClass::Physics,
    equation: "J_xy of J",
    places: &[Place::MassProperties],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "value_kg_m2",
        "J_xy",
        "kg·m²",
        "entry of the inertia tensor",
        (-0.003, 0.003),
        0.001,
        0.001,
    )],
    per_rotor: false,
    needs: &[],
    excited_by: "angular acceleration and rates about two axes at once",
    confused_with: &["centre-of-mass", "imu-misalignment"],
    source: "rigid body",
    build: Build::BuiltIn(|setup| {
        Changes::<1>::boxed(setup, |c, [j], _| {
            c.inertia_body_kg_m2[0][1] += j;
            c.inertia_body_kg_m2[1][0] += j;
        })
    }),
};

/// Row 20 of the catalogue.
pub(super) static PRODUCT_XZ: EffectDeclaration = EffectDeclaration {
    id: "inertia-product-xz",
    name: "Product of inertia xz",
    catalogue_number: Some(20),
    class: EffectClass::Physics,
    equation: "J_xz of J",
    places: &[Place::MassProperties],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "value_kg_m2",
        "J_xz",
        "kg·m²",
        "entry of the inertia tensor",
        (-0.003, 0.003),
        0.001,
        0.001,
    )],
    per_rotor: false,
    needs: &[],
    excited_by: "angular acceleration and rates about two axes at once",
    confused_with: &["centre-of-mass", "imu-misalignment"],
    source: "rigid body",
    build: Build::BuiltIn(|setup| {
        Changes::<1>::boxed(setup, |c, [j], _| {
            c.inertia_body_kg_m2[0][2] += j;
            c.inertia_body_kg_m2[2][0] += j;
        })
    }),
};

/// Row 20 of the catalogue.
pub(super) static PRODUCT_YZ: EffectDeclaration = EffectDeclaration {
    id: "inertia-product-yz",
    name: "Product of inertia yz",
    catalogue_number: Some(20),
    class: EffectClass::Physics,
    equation: "J_yz of J",
    places: &[Place::MassProperties],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "value_kg_m2",
        "J_yz",
        "kg·m²",
        "entry of the inertia tensor",
        (-0.003, 0.003),
        0.001,
        0.001,
    )],
    per_rotor: false,
    needs: &[],
    excited_by: "angular acceleration and rates about two axes at once",
    confused_with: &["centre-of-mass", "imu-misalignment"],
    source: "rigid body",
    build: Build::BuiltIn(|setup| {
        Changes::<1>::boxed(setup, |c, [j], _| {
            c.inertia_body_kg_m2[1][2] += j;
            c.inertia_body_kg_m2[2][1] += j;
        })
    }),
};
