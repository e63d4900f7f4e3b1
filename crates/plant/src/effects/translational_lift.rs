//! Translational lift: a rotor that moves through the air meets more of it and lifts more.

use super::prelude::*;

/// Row 6 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "translational-lift",
    name: "Translational lift",
    catalogue_number: Some(6),
    class: EffectClass::Physics,
    equation: "ΔT_i = k_h |v_i,xy|²",
    places: &[Place::RotorThrust],
    channels: &[FORCE, MOMENT],
    parameters: &[ParameterDeclaration::size(
        "lift_n_s2_m2",
        "k_h",
        "N·s²/m²",
        "lift of one rotor per squared air speed across the disc",
        (0.0, 0.008),
        0.005,
        0.005,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::AirVelocity]),
    excited_by: "fast level flight",
    confused_with: &["axial-inflow", "mass", "voltage-gain"],
    source: "RotorPy k_h; Bangura 2017",
    build: Build::BuiltIn(|setup| {
        Box::new(TranslationalLift {
            factor: setup.values[0],
        })
    }),
};

#[derive(Debug, Clone)]
struct TranslationalLift {
    factor: f64,
}

impl ActiveEffect for TranslationalLift {
    fn hooks(&self) -> Hooks {
        Hooks::ROTOR_THRUST
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn rotor_thrust(&mut self, at: &Moment<'_>, thrust: &mut [f64]) {
        for (i, f) in thrust.iter_mut().enumerate() {
            let v = at.rotor_air_velocity(i);
            *f += self.factor * (v[0] * v[0] + v[1] * v[1]);
        }
    }
}
