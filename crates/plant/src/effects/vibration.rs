//! Vibration rectification: an accelerometer that vibrates reads a bias that grows with the square of the vibration.
//!
//! The vibration of unbalanced rotors grows with Ω², that is with the thrust; its square thus with the square of the mean thrust.

use super::prelude::*;

/// Row 54 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "vibration-rectification",
    name: "Vibration rectification",
    catalogue_number: Some(54),
    class: EffectClass::SensorFault,
    equation: "b_z = b_h (Σ f_i/(n f_h))²",
    places: &[Place::Reading],
    channels: &[FORCE, VELOCITY],
    parameters: &[ParameterDeclaration::size(
        "hover_bias_m_s2",
        "b_h",
        "m/s²",
        "bias of the z axis in hover",
        (-0.5, 0.5),
        0.25,
        0.25,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "changes of throttle",
    confused_with: &["accelerometer-bias", "mass"],
    source: "accelerometer data sheets: rectification k rms²",
    build: Build::BuiltIn(|setup| {
        Box::new(Vibration {
            bias: setup.values[0],
            per_weight: 1.0 / (setup.nominal.rotor_count as f64 * setup.nominal.hover_thrust_n),
        })
    }),
};

#[derive(Debug, Clone)]
struct Vibration {
    bias: f64,
    per_weight: f64,
}

impl ActiveEffect for Vibration {
    fn hooks(&self) -> Hooks {
        Hooks::READINGS
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn readings(&mut self, at: &Moment<'_>, readings: &mut Readings) {
        let level = self.per_weight * at.rotor_thrust.iter().sum::<f64>();
        readings.specific_force[2] += self.bias * level * level;
    }
}
