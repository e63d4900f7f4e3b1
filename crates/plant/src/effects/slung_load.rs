//! Slung load: a mass on a rope below the centre of mass, as a linear pendulum with two horizontal degrees of freedom.
//!
//! q is the deflection of the load from the vertical, rad, NED. The pull along the rope is horizontal m_p g q and vertical
//! w (g − a_z), w being the part of the load that the vehicle's mass does not contain yet. Small angles; the rope stays taut and
//! ends at the centre of mass. Leapfrog at the caller's step (half a drift, kick, half a drift): the force is that of the middle of the
//! step, the frequency is right to (√(g/L) h)²/24. A force that is half a step late would pass for less damping.

use super::prelude::*;

/// Row 17 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "slung-load",
    name: "Slung load",
    catalogue_number: Some(17),
    class: EffectClass::Physics,
    equation: "q'' = −(g/L) q − a_xy/L − c q',   F_xy = m_p g q,   F_z = w (g − a_z)",
    places: &[Place::Force],
    channels: &[FORCE],
    parameters: &[
        ParameterDeclaration::size("mass_kg", "m_p", "kg", "swinging mass", (0.0, 0.4), 0.15, 0.15).essential(),
        ParameterDeclaration::size(
            "weight_kg",
            "w",
            "kg",
            "weight that the vehicle document does not contain yet",
            (0.0, 0.4),
            0.15,
            0.15,
        ),
        ParameterDeclaration::shape("length_m", "L", "m", "rope", (0.2, 3.0), 1.0),
        ParameterDeclaration::shape("damping_1_s", "c", "1/s", "damping of the swing", (0.0, 1.0), 0.2),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::by(Strategy::Shapes(Shapes::Range(&["length_m"]))),
    excited_by: "accelerations; shows at √(g/L)",
    confused_with: &["gusts", "mass"],
    source: "linear pendulum",
    build: Build::BuiltIn(|setup| Box::new(SlungLoad::new(setup))),
};

#[derive(Debug, Clone)]
struct SlungLoad {
    mass: f64,
    weight: f64,
    per_length: f64,
    damping: f64,
    gravity: f64,
    swing: [f64; 2],
    swing_rate: [f64; 2],
}

impl SlungLoad {
    fn new(setup: &Setup<'_>) -> Self {
        Self {
            mass: setup.values[0],
            weight: setup.values[1],
            per_length: 1.0 / setup.values[2],
            damping: setup.values[3],
            gravity: setup.nominal.gravity_m_s2,
            swing: [0.0; 2],
            swing_rate: [0.0; 2],
        }
    }

    /// Swing after `time_s` at the present rates.
    fn drifted(&self, time_s: f64) -> [f64; 2] {
        [0, 1].map(|i| self.swing[i] + time_s * self.swing_rate[i])
    }
}

/// Row `i` of R f: acceleration without gravity along a NED axis, m/s².
fn ned_row(at: &Moment<'_>, i: usize) -> f64 {
    let (row, f) = (at.ned_from_body[i], at.specific_force);
    row[0] * f[0] + row[1] * f[1] + row[2] * f[2]
}

impl ActiveEffect for SlungLoad {
    fn hooks(&self) -> Hooks {
        Hooks::WRENCH.and(Hooks::ADVANCE)
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        let pull = self.mass * self.gravity;
        // g − a_z = −(R f)_z, f the specific force.
        let carried = -self.weight * ned_row(at, 2);
        let [north, east] = self.drifted(0.5 * at.step_s);
        let force = at.body_from_ned([pull * north, pull * east, carried]);
        for i in 0..3 {
            wrench.force_body[i] += force[i];
        }
    }

    fn advance(&mut self, at: &Moment<'_>, step_s: f64) {
        self.swing = self.drifted(0.5 * step_s);
        // The damping acts on the mean of the rates before and after.
        let held = 0.5 * step_s * self.damping;
        for i in 0..2 {
            let pull = -self.per_length * (self.gravity * self.swing[i] + ned_row(at, i));
            self.swing_rate[i] = ((1.0 - held) * self.swing_rate[i] + step_s * pull) / (1.0 + held);
        }
        self.swing = self.drifted(0.5 * step_s);
    }
}
