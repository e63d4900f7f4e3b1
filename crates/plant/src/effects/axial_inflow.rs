//! Axial inflow: a rotor that climbs through the air meets it at a smaller angle and lifts less.

use super::prelude::*;

/// Row 7 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "axial-inflow",
    name: "Axial inflow",
    catalogue_number: Some(7),
    class: EffectClass::Physics,
    equation: "ΔT_i = −k_z (Ω_i/Ω_h) v_i,up",
    places: &[Place::RotorThrust],
    channels: &[FORCE, MOMENT],
    parameters: &[ParameterDeclaration::size(
        "loss_n_s_m",
        "k_z",
        "N·s/m",
        "thrust lost by one rotor per climb speed at hover speed",
        (0.0, 0.25),
        0.15,
        0.15,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::AirVelocity]),
    excited_by: "climbs, and roll and pitch rates (it damps them)",
    confused_with: &["rotational-damping", "command-delay"],
    source: "momentum theory: T/(2 v_ind) to T/(4 v_ind)",
    build: Build::BuiltIn(|setup| {
        Box::new(AxialInflow {
            factor: setup.values[0],
        })
    }),
};

#[derive(Debug, Clone)]
struct AxialInflow {
    factor: f64,
}

impl ActiveEffect for AxialInflow {
    fn hooks(&self) -> Hooks {
        Hooks::ROTOR_THRUST
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn rotor_thrust(&mut self, at: &Moment<'_>, thrust: &mut [f64]) {
        for (i, f) in thrust.iter_mut().enumerate() {
            // Body z is down: v_i,up = −v_i,z.
            *f += self.factor * at.rotor_speed_ratio[i] * at.rotor_air_velocity(i)[2];
        }
    }
}
