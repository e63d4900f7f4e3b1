//! Inertia: moments and products.

use super::prelude::*;

/// Row 19 of the catalogue: the moment of inertia about body axis `AXIS`.
///
/// * `parameters`: the relative error, see [`share`]
/// * `search`: an arm or the unit of a drawing that was read wrong makes several of them wrong at once
const fn moment<const AXIS: usize>(
    id: &'static str,
    name: &'static str,
    equation: &'static str,
    parameters: &'static [ParameterDeclaration],
    confused_with: &'static [&'static str],
    search: Search,
) -> EffectDeclaration {
    EffectDeclaration {
        id,
        name,
        catalogue_number: Some(19),
        class: EffectClass::Physics,
        equation,
        places: &[Place::MassProperties],
        channels: &[MOMENT],
        parameters,
        per_rotor: false,
        may_set_in: false,
        needs: &[],
        search,
        excited_by: "angular acceleration about this axis",
        confused_with,
        source: "bifilar pendulum practice: ±15 to 20 %",
        build: Build::BuiltIn(|setup| {
            Changes::<1>::boxed(setup, |c, [d], _| c.inertia_body_kg_m2[AXIS][AXIS] *= 1.0 + d)
        }),
    }
}

/// The relative error of a moment of inertia.
const fn share(typical: f64) -> ParameterDeclaration {
    ParameterDeclaration::size("share", "d", "", "relative error", (-0.4, 0.4), 0.2, typical)
}

/// Row 20 of the catalogue: the product of inertia of body axes `A` and `B`.
const fn product<const A: usize, const B: usize>(
    id: &'static str,
    name: &'static str,
    equation: &'static str,
    parameters: &'static [ParameterDeclaration],
) -> EffectDeclaration {
    EffectDeclaration {
        id,
        name,
        catalogue_number: Some(20),
        class: EffectClass::Physics,
        equation,
        places: &[Place::MassProperties],
        channels: &[MOMENT],
        parameters,
        per_rotor: false,
        may_set_in: false,
        needs: &[],
        search: Search::LINEAR,
        excited_by: "angular acceleration and rates about two axes at once",
        confused_with: &["centre-of-mass", "imu-misalignment"],
        source: "rigid body",
        build: Build::BuiltIn(|setup| {
            Changes::<1>::boxed(setup, |c, [j], _| {
                c.inertia_body_kg_m2[A][B] += j;
                c.inertia_body_kg_m2[B][A] += j;
            })
        }),
    }
}

/// An entry of the inertia tensor off its diagonal.
const fn entry(symbol: &'static str) -> ParameterDeclaration {
    ParameterDeclaration::size(
        "value_kg_m2",
        symbol,
        "kg·m²",
        "entry of the inertia tensor",
        (-0.003, 0.003),
        0.001,
        0.001,
    )
}

/// Effects that a slower or weaker thrust is confused with, and vice versa.
const OF_TILTING: &[&str] = &["rotor-thrust-scale", "air-density", "motor-time-constant"];

pub(super) static ROLL: EffectDeclaration = moment::<0>(
    "inertia-roll",
    "Roll inertia",
    "J_x → J_x (1 + d)",
    &const { [share(0.15).correcting_by_factors("body.inertia_body_kg_m2[0]")] },
    OF_TILTING,
    Search::LINEAR.along_with(&["inertia-pitch", "inertia-yaw"]),
);

pub(super) static PITCH: EffectDeclaration = moment::<1>(
    "inertia-pitch",
    "Pitch inertia",
    "J_y → J_y (1 + d)",
    &const { [share(0.15).correcting_by_factors("body.inertia_body_kg_m2[1]")] },
    OF_TILTING,
    Search::LINEAR,
);

pub(super) static YAW: EffectDeclaration = moment::<2>(
    "inertia-yaw",
    "Yaw inertia",
    "J_z → J_z (1 + d)",
    &const { [share(0.2).correcting_by_factors("body.inertia_body_kg_m2[2]")] },
    &["moment-ratio", "rotor-reaction"],
    Search::LINEAR,
);

pub(super) static PRODUCT_XY: EffectDeclaration = product::<0, 1>(
    "inertia-product-xy",
    "Product of inertia xy",
    "J_xy of J",
    &const { [entry("J_xy")] },
);

pub(super) static PRODUCT_XZ: EffectDeclaration = product::<0, 2>(
    "inertia-product-xz",
    "Product of inertia xz",
    "J_xz of J",
    &const { [entry("J_xz")] },
);

pub(super) static PRODUCT_YZ: EffectDeclaration = product::<1, 2>(
    "inertia-product-yz",
    "Product of inertia yz",
    "J_yz of J",
    &const { [entry("J_yz")] },
);
