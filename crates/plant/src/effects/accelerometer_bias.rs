//! Accelerometer bias: a constant error of the specific force.

use super::declaration::{Build, ChannelGroup, EffectClass, EffectDeclaration, ParameterDeclaration, Place};
use super::hooks::Changes;

const fn axis(name: &'static str, symbol: &'static str) -> ParameterDeclaration {
    ParameterDeclaration::size(
        name,
        symbol,
        "m/s²",
        "bias along this body axis",
        (-0.5, 0.5),
        0.15,
        0.15,
    )
}

/// Row 42 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "accelerometer-bias",
    name: "Accelerometer bias",
    catalogue_number: Some(42),
    class: EffectClass::SensorFault,
    equation: "a_m = a + b",
    places: &[Place::Reading],
    channels: &[ChannelGroup::Force, ChannelGroup::VelocityKinematics],
    parameters: &[axis("x_m_s2", "b_x"), axis("y_m_s2", "b_y"), axis("z_m_s2", "b_z")],
    per_rotor: false,
    needs: &[],
    excited_by: "always; a yaw turn tells it from wind and level offset",
    confused_with: &["level-offset", "wind", "rotor-tilt-tangential"],
    source: "MPU-9250 data sheet: zero-g offset ±0.6 m/s² before calibration",
    build: Build::BuiltIn(|setup| {
        Changes::<3>::boxed(setup, |c, bias, _| {
            for i in 0..3 {
                c.accelerometer_bias_m_s2[i] += bias[i];
            }
        })
    }),
};
