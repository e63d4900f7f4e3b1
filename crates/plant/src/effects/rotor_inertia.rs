//! Inertia of the rotors: gyroscopic torque while the vehicle turns, reaction torque while rotors speed up.

use super::prelude::*;

/// Row 32 of the catalogue.
pub(super) static GYROSCOPIC: EffectDeclaration = EffectDeclaration {
    id: "gyroscopic-torque",
    name: "Gyroscopic torque of the rotors",
    catalogue_number: Some(32),
    class: EffectClass::Physics,
    equation: "M_xy = J_r Σ s_i Ω_i (q, −p),   s_i = 1 counter-clockwise",
    places: &[Place::Torque],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "inertia_kg_m2",
        "J_r",
        "kg·m²",
        "inertia of one rotor about its axis",
        (0.0, 0.0001),
        5e-05,
        6e-05,
    )],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "yaw demand together with roll or pitch rates",
    confused_with: &["inertia-product-xy"],
    source: "rigid body; RotorPy has none",
    build: Build::BuiltIn(|setup| {
        Box::new(Gyroscopic {
            momentum: setup.values[0] * setup.nominal.hover_rotor_speed_rad_s,
        })
    }),
};

/// Row 33 of the catalogue.
pub(super) static REACTION: EffectDeclaration = EffectDeclaration {
    id: "rotor-reaction",
    name: "Reaction to rotor acceleration",
    catalogue_number: Some(33),
    class: EffectClass::Physics,
    equation: "N = J_r Σ s_i Ω_i',   s_i = 1 counter-clockwise",
    places: &[Place::Torque],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "inertia_kg_m2",
        "J_r",
        "kg·m²",
        "inertia of one rotor about its axis, beyond that of `rotors.reaction_s` of the vehicle",
        (0.0, 0.0001),
        5e-05,
        6e-05,
    )
    .correcting("rotors.inertia_kg_m2", CorrectionScale::Difference)],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::FrequentCommand]),
    excited_by: "yaw commands",
    confused_with: &["inertia-yaw", "moment-ratio", "motor-time-constant"],
    source: "Leishman 2006",
    build: Build::BuiltIn(|setup| {
        Box::new(Reaction {
            momentum: setup.values[0] * setup.nominal.hover_rotor_speed_rad_s,
        })
    }),
};

/// `rotors.reaction_s` of the vehicle at work: N = λ Σ s_i c_i f_i', which real flights follow better than J_r Σ s_i Ω_i' with Ω ∝ √f
/// (decision 0080).
pub(super) fn of_the_document() -> Box<dyn ActiveEffect> {
    Box::new(OfTheDocument)
}

#[derive(Debug, Clone)]
struct Gyroscopic {
    momentum: f64,
}

impl ActiveEffect for Gyroscopic {
    fn hooks(&self) -> Hooks {
        Hooks::WRENCH
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        let mut sum = 0.0;
        for (ratio, spin) in at.rotor_speed_ratio.iter().zip(&at.constants.rotor_spin) {
            sum += ratio * spin;
        }
        let [p, q, _] = at.body_rates;
        wrench.torque_body[0] += self.momentum * sum * q;
        wrench.torque_body[1] -= self.momentum * sum * p;
    }
}

#[derive(Debug, Clone)]
struct Reaction {
    momentum: f64,
}

impl ActiveEffect for Reaction {
    fn hooks(&self) -> Hooks {
        Hooks::WRENCH
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        let mut sum = 0.0;
        for (rate, spin) in at.rotor_speed_rate.iter().zip(&at.constants.rotor_spin) {
            sum += rate * spin;
        }
        wrench.torque_body[2] += self.momentum * sum;
    }
}

#[derive(Debug, Clone)]
struct OfTheDocument;

impl ActiveEffect for OfTheDocument {
    fn hooks(&self) -> Hooks {
        Hooks::WRENCH
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        let c = at.constants;
        let ratios = at.rotor_speed_ratio.iter().zip(at.rotor_speed_rate);
        let drags = c.rotor_spin.iter().zip(&c.moment_ratio_m);
        let mut sum = 0.0;
        for ((ratio, rate), (spin, drag)) in ratios.zip(drags) {
            // f' = 2 f_h (Ω/Ω_h) (Ω/Ω_h)'.
            sum += spin * drag * 2.0 * c.hover_thrust_n * ratio * rate;
        }
        wrench.torque_body[2] += c.rotor_reaction_s * sum;
    }
}
