//! Flapping (pitching) moment: the advancing blade rises, the rotor disc tilts and turns the vehicle with it.
//!
//! With k_f > 0 it lowers the nose in forward flight, as RotorPy has it; a disc that tilts back raises it (Hoffmann,
//! Huang, Waslander, Tomlin 2007): k_f < 0.

use super::prelude::*;

/// Row 12 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "flapping-moment",
    name: "Flapping moment",
    catalogue_number: Some(12),
    class: EffectClass::Physics,
    equation: "M = k_f Σ (Ω_i/Ω_h) (v_i,y, −v_i,x, 0)",
    places: &[Place::Torque],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "moment_n_s",
        "k_f",
        "N·s",
        "torque of one rotor at hover speed per air speed across the disc; positive: the nose goes down in forward flight",
        (-0.006, 0.006),
        0.003,
        0.003,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::AirVelocity]),
    excited_by: "translation",
    confused_with: &["drag-centre", "rotor-interference"],
    source: "RotorPy k_flap; Hoffmann, Huang, Waslander, Tomlin 2007 for the other sign",
    build: Build::BuiltIn(|setup| {
        Box::new(Flapping {
            factor: setup.values[0],
        })
    }),
};

#[derive(Debug, Clone)]
struct Flapping {
    factor: f64,
}

impl ActiveEffect for Flapping {
    fn hooks(&self) -> Hooks {
        Hooks::WRENCH
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        for (i, ratio) in at.rotor_speed_ratio.iter().enumerate() {
            let v = at.rotor_air_velocity(i);
            wrench.torque_body[0] += self.factor * ratio * v[1];
            wrench.torque_body[1] -= self.factor * ratio * v[0];
        }
    }
}
