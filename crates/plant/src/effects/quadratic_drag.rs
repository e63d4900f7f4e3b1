//! Parasitic drag of fuselage, arms and payload: quadratic in the air speed, the same in every direction.

use super::prelude::*;

/// Row 2 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "quadratic-drag",
    name: "Quadratic (parasitic) drag",
    catalogue_number: Some(2),
    class: EffectClass::Physics,
    equation: "F = −c_q |v_a| v_a,   c_q = ρ C_D A/2",
    places: &[Place::Force],
    channels: &[FORCE],
    parameters: &[ParameterDeclaration::size(
        "drag_kg_m",
        "c_q",
        "kg/m",
        "ρ C_D A/2",
        (0.0, 0.05),
        0.03,
        0.03,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::AirVelocity]),
    excited_by: "speeds above 3 m/s, several of them",
    confused_with: &["rotor-drag", "linear-friction"],
    source: "RotorPy c_D; ETH data-driven-dynamics fuselage model",
    build: Build::BuiltIn(|setup| Box::new(QuadraticDrag { drag: setup.values[0] })),
};

#[derive(Debug, Clone)]
struct QuadraticDrag {
    drag: f64,
}

impl ActiveEffect for QuadraticDrag {
    fn hooks(&self) -> Hooks {
        Hooks::WRENCH
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        let v = at.air_velocity_body;
        let factor = self.drag * length(v);
        for i in 0..3 {
            wrench.drag_body[i] -= factor * v[i];
        }
    }
}
