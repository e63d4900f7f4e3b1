//! Drag of the rotors in translation (H-force): linear in the air velocity across the rotor disc, and in rotor speed.

use super::prelude::*;

/// Row 1 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "rotor-drag",
    name: "Rotor drag",
    catalogue_number: Some(1),
    class: EffectClass::Physics,
    equation: "F_xy = −k_d (Σ Ω_i/(n Ω_h)) v_a,xy",
    places: &[Place::Force],
    channels: &[FORCE],
    parameters: &[ParameterDeclaration::size(
        "drag_n_s_m",
        "k_d",
        "N·s/m",
        "drag of all rotors together at hover speed per air speed, beyond `rotors.drag_kg_s` of the vehicle",
        (0.0, 0.9),
        0.25,
        0.25,
    )
    .correcting("body.linear_drag_kg_s", CorrectionScale::Difference)],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::AirVelocity]),
    excited_by: "translation; several speeds distinguish it from quadratic drag, climbs from linear friction",
    confused_with: &["quadratic-drag", "linear-friction", "wind"],
    source: "Faessler, Franchi, Scaramuzza 2018, eq. 2; RotorPy k_d",
    build: Build::BuiltIn(|setup| Box::new(RotorDrag { drag: setup.values[0] })),
};

/// `rotors.drag_kg_s` of the vehicle at work, kg/s.
pub(super) fn of_the_document(drag: f64) -> Box<dyn ActiveEffect> {
    Box::new(RotorDrag { drag })
}

#[derive(Debug, Clone)]
struct RotorDrag {
    drag: f64,
}

impl ActiveEffect for RotorDrag {
    fn hooks(&self) -> Hooks {
        Hooks::WRENCH
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        let factor = self.drag * at.mean_speed_ratio();
        wrench.drag_body[0] -= factor * at.air_velocity_body[0];
        wrench.drag_body[1] -= factor * at.air_velocity_body[1];
    }
}
