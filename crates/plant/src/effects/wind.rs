//! Constant wind. It acts through drag only: without a drag among the effects or in the vehicle it cannot act.

use super::prelude::*;

/// Row 4 of the catalogue. Vehicles fly in winds of up to 12 to 15 m/s by their makers' data sheets.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "wind",
    name: "Constant wind",
    catalogue_number: Some(4),
    class: EffectClass::Physics,
    equation: "v_a = Rᵀ(v − w)",
    places: &[Place::Wind],
    channels: &[FORCE],
    parameters: &[
        ParameterDeclaration::size(
            "north_m_s",
            "w_N",
            "m/s",
            "where the air moves to, north",
            (-15.0, 15.0),
            3.0,
            3.0,
        ),
        ParameterDeclaration::size(
            "east_m_s",
            "w_E",
            "m/s",
            "where the air moves to, east",
            (-15.0, 15.0),
            3.0,
            -2.0,
        ),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &["rotor-drag", "quadratic-drag", "linear-friction"],
    search: Search::LINEAR
        .requiring(&[Requirement::AirVelocity])
        .of_the_steady_wind(),
    excited_by: "any flight outdoors; a yaw turn distinguishes it from biases that turn with the vehicle",
    confused_with: &[
        "level-offset",
        "accelerometer-bias",
        "rotor-tilt-tangential",
        "rotor-tilt-radial",
    ],
    source: "drag fusion of PX4 EKF2",
    build: Build::BuiltIn(|setup| {
        Changes::<2>::boxed(setup, |c, [north, east], _| {
            c.wind_ned_m_s[0] += north;
            c.wind_ned_m_s[1] += east;
        })
    }),
};
