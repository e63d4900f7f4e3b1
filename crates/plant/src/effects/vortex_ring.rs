//! Vortex ring: in a steep descent the rotor flies into its own wake and loses thrust.
//!
//! The mean loss only; the buffeting that comes with it is not modelled. The loss stops growing at a descent of 1.5 v_h, where the
//! windmill state begins.

use super::prelude::*;

/// Row 8 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "vortex-ring",
    name: "Vortex-ring thrust loss",
    catalogue_number: Some(8),
    class: EffectClass::Physics,
    equation: "ΔT_i/T_i = −k max(0, v_i,down/v_h − 0.5)²",
    places: &[Place::RotorThrust],
    channels: &[FORCE, MOMENT],
    parameters: &[ParameterDeclaration::size(
        "loss",
        "k",
        "",
        "share of thrust lost one induced velocity beyond the onset",
        (0.0, 1.0),
        0.7,
        0.7,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::AirVelocity]),
    excited_by: "descents above 2.5 m/s",
    confused_with: &["axial-inflow"],
    source: "Leishman 2006, ch. 2.13: onset at half the induced velocity",
    build: Build::BuiltIn(|setup| {
        Box::new(VortexRing {
            loss: setup.values[0],
            per_induced_velocity: 1.0 / setup.nominal.hover_induced_velocity_m_s,
        })
    }),
};

#[derive(Debug, Clone)]
struct VortexRing {
    loss: f64,
    per_induced_velocity: f64,
}

impl ActiveEffect for VortexRing {
    fn hooks(&self) -> Hooks {
        Hooks::ROTOR_THRUST
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn rotor_thrust(&mut self, at: &Moment<'_>, thrust: &mut [f64]) {
        for (i, f) in thrust.iter_mut().enumerate() {
            let beyond = (at.rotor_air_velocity(i)[2] * self.per_induced_velocity - 0.5).clamp(0.0, 1.0);
            *f *= (1.0 - self.loss * beyond * beyond).max(0.0);
        }
    }
}
