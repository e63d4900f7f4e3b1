//! Rotor–rotor interference: in fast flight the rear rotors work in the wake of the front ones.

use super::prelude::*;

/// Row 11 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "rotor-interference",
    name: "Rotor–rotor interference",
    catalogue_number: Some(11),
    class: EffectClass::Physics,
    equation: "T_i → T_i (1 − k max(0, −v_i · l_i/|l_i|))",
    places: &[Place::RotorThrust],
    channels: &[FORCE, MOMENT],
    parameters: &[ParameterDeclaration::size(
        "loss_s_m",
        "k",
        "s/m",
        "share of thrust lost by the rearmost rotor per air speed",
        (0.0, 0.1),
        0.05,
        0.05,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::AirVelocity]),
    excited_by: "fast flight",
    confused_with: &["centre-of-mass", "flapping-moment"],
    source: "discussion in NeuroBEM (RSS 2021); linear form assumed",
    build: Build::BuiltIn(|setup| Box::new(Interference { loss: setup.values[0] })),
};

#[derive(Debug, Clone)]
struct Interference {
    loss: f64,
}

impl ActiveEffect for Interference {
    fn hooks(&self) -> Hooks {
        Hooks::ROTOR_THRUST
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn rotor_thrust(&mut self, at: &Moment<'_>, thrust: &mut [f64]) {
        for (i, f) in thrust.iter_mut().enumerate() {
            let ([x, y], v) = (at.constants.rotor_direction(i), at.rotor_air_velocity(i));
            let behind = -(v[0] * x + v[1] * y);
            if behind > 0.0 {
                *f *= (1.0 - self.loss * behind).max(0.0);
            }
        }
    }
}
