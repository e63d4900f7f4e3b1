//! Ground effect: near the ground a rotor lifts more.
//!
//! Acts where the height above ground is known: a scenario needs `[ground]`, a log a range finder or a ground level. Heights below
//! half a rotor radius count as that.

use super::prelude::*;

/// Row 9 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "ground-effect",
    name: "Ground effect",
    catalogue_number: Some(9),
    class: EffectClass::Physics,
    equation: "T_i → T_i (1 + ρ_g (1/(1 − (R/4z_i)²) − 1))",
    places: &[Place::RotorThrust],
    channels: &[FORCE, MOMENT],
    parameters: &[ParameterDeclaration::size(
        "strength",
        "ρ_g",
        "",
        "1 is Cheeseman and Bennett; several rotors together have more",
        (0.0, 3.0),
        1.0,
        1.0,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::HeightAboveGround]),
    excited_by: "passes or landings below 0.6 m",
    confused_with: &["mass", "voltage-gain"],
    source: "Cheeseman, Bennett 1955; Sanchez-Cuevas 2017",
    build: Build::BuiltIn(|setup| {
        Box::new(GroundEffect {
            strength: setup.values[0],
            radius: setup.nominal.rotor_radius_m,
        })
    }),
};

#[derive(Debug, Clone)]
struct GroundEffect {
    strength: f64,
    radius: f64,
}

impl ActiveEffect for GroundEffect {
    fn hooks(&self) -> Hooks {
        Hooks::ROTOR_THRUST
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn rotor_thrust(&mut self, at: &Moment<'_>, thrust: &mut [f64]) {
        if at.height_above_ground == f64::INFINITY {
            return;
        }
        let down = at.ned_from_body[2];
        for (i, f) in thrust.iter_mut().enumerate() {
            let [x, y, _] = at.constants.rotor_position_body[i];
            let height = (at.height_above_ground - down[0] * x - down[1] * y).max(0.5 * self.radius);
            let ratio = self.radius / (4.0 * height);
            *f *= 1.0 + self.strength * (1.0 / (1.0 - ratio * ratio) - 1.0);
        }
    }
}
