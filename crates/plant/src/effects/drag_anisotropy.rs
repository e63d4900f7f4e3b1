//! Drag that differs between forward and sideways flight: a long fuselage, arms or a payload across.
//!
//! Only the difference is an effect of its own, so that it is no twin of another drag: what both directions share is rotor drag, what all
//! three share is linear friction, and the two together are a vertical drag other than the horizontal one. The diagonal drag (k_x, k_y, k_z)
//! is therefore rotor drag (k_x + k_y)/2 − k_z, friction k_z, and Δ = k_x − k_y.

use super::prelude::*;

/// Row 57 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "drag-anisotropy",
    name: "Drag that differs forward and sideways",
    catalogue_number: Some(57),
    class: EffectClass::Physics,
    equation: "F_xy = −(Δ/2) (v_a,x, −v_a,y): drag per air speed Δ = k_x − k_y more forward than sideways",
    places: &[Place::Force],
    channels: &[FORCE],
    parameters: &[ParameterDeclaration::size(
        "difference_kg_s",
        "Δ",
        "kg/s",
        "drag per air speed forward minus that sideways",
        (-0.4, 0.4),
        0.15,
        0.15,
    )],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::AirVelocity]),
    excited_by: "translation forward and sideways: in one direction alone it is rotor drag",
    confused_with: &["rotor-drag", "linear-friction", "quadratic-drag"],
    source: "Faessler, Franchi, Scaramuzza 2018, eq. 2: drag diag(d_x, d_y, d_z) with d_x ≠ d_y",
    build: Build::BuiltIn(|setup| {
        Box::new(DragAnisotropy {
            half: 0.5 * setup.values[0],
        })
    }),
};

#[derive(Debug, Clone)]
struct DragAnisotropy {
    half: f64,
}

impl ActiveEffect for DragAnisotropy {
    fn hooks(&self) -> Hooks {
        Hooks::WRENCH
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        wrench.drag_body[0] -= self.half * at.air_velocity_body[0];
        wrench.drag_body[1] += self.half * at.air_velocity_body[1];
    }
}
