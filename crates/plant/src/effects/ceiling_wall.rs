//! Ceiling and wall: a rotor below a ceiling lifts more, one beside a wall is drawn to it.
//!
//! Where ceiling and wall are is a shape of the effect. A vehicle cannot be beyond them: where its position says so by more than a position
//! may err, there is none. Otherwise a ceiling below all of a flight would be a constant factor on the thrust.

use super::prelude::*;

/// Largest error of a position beside a surface, m.
const POSITION_ERROR_M: f64 = 0.5;

/// (R/(d + R))² at distance d of a surface, m: 1 beyond it by the error of a position, 0 further on.
fn nearness(radius: f64, distance: f64) -> f64 {
    if distance < -POSITION_ERROR_M {
        return 0.0;
    }
    let ratio = radius / (distance.max(0.0) + radius);
    ratio * ratio
}

/// Row 10 of the catalogue.
pub(super) static CEILING: EffectDeclaration = EffectDeclaration {
    id: "ceiling-effect",
    name: "Ceiling effect",
    catalogue_number: Some(10),
    class: EffectClass::Physics,
    equation: "T_i → T_i/(1 − k (R/(z_c + R))²),   z_c the distance to the ceiling",
    places: &[Place::RotorThrust],
    channels: &[FORCE],
    parameters: &[
        ParameterDeclaration::size(
            "strength",
            "k",
            "",
            "1 reproduces the fit of the source",
            (0.0, 1.5),
            1.0,
            1.0,
        ),
        ParameterDeclaration::shape(
            "height_m",
            "h",
            "m",
            "height of the ceiling over the origin of NED",
            (0.5, 10.0),
            3.0,
        ),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::by(Strategy::Shapes(Shapes::Above { height: "height_m" })).requiring(&[Requirement::Position]),
    excited_by: "flight within two rotor radii of the ceiling",
    confused_with: &["ground-effect", "mass"],
    source: "form of the ceiling effect as in Hsiao, Chirarattananon 2019",
    build: Build::BuiltIn(|setup| {
        Box::new(Ceiling {
            strength: setup.values[0],
            height: setup.values[1],
            radius: setup.nominal.rotor_radius_m,
        })
    }),
};

/// Row 10 of the catalogue.
pub(super) static WALL: EffectDeclaration = EffectDeclaration {
    id: "wall-effect",
    name: "Wall effect",
    catalogue_number: Some(10),
    class: EffectClass::Physics,
    equation: "F = k (R/(d + R))² Σ T_i towards the wall, d the distance to it",
    places: &[Place::Force],
    channels: &[FORCE],
    parameters: &[
        ParameterDeclaration::size(
            "strength",
            "k",
            "",
            "share of the thrust that acts sideways at the wall",
            (0.0, 0.3),
            0.1,
            0.1,
        ),
        ParameterDeclaration::shape(
            "distance_m",
            "d_w",
            "m",
            "distance of the wall from the origin of NED",
            (0.3, 20.0),
            2.0,
        ),
        ParameterDeclaration::shape(
            "azimuth_rad",
            "ψ_w",
            "rad",
            "direction of the wall from north, clockwise",
            (-3.2, 3.2),
            1.0,
        ),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::by(Strategy::Shapes(Shapes::Beside {
        distance: "distance_m",
        azimuth: "azimuth_rad",
    }))
    .requiring(&[Requirement::Position]),
    excited_by: "flight within two rotor radii of a wall",
    confused_with: &["wind", "accelerometer-bias"],
    source: "form assumed: no fitted source; decays as the ceiling effect does",
    build: Build::BuiltIn(|setup| Box::new(Wall::new(setup))),
};

#[derive(Debug, Clone)]
struct Ceiling {
    strength: f64,
    height: f64,
    radius: f64,
}

impl ActiveEffect for Ceiling {
    fn hooks(&self) -> Hooks {
        Hooks::ROTOR_THRUST
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn rotor_thrust(&mut self, at: &Moment<'_>, thrust: &mut [f64]) {
        let near = nearness(self.radius, self.height + at.position_ned[2]);
        // Beyond 90 % of the pole the fit means nothing any more.
        let factor = 1.0 / (1.0 - (self.strength * near).min(0.9));
        for f in thrust {
            *f *= factor;
        }
    }
}

#[derive(Debug, Clone)]
struct Wall {
    strength: f64,
    distance: f64,
    north: f64,
    east: f64,
    radius: f64,
}

impl Wall {
    fn new(setup: &Setup<'_>) -> Self {
        let (sin, cos) = libm::sincos(setup.values[2]);
        Self {
            strength: setup.values[0],
            distance: setup.values[1],
            north: cos,
            east: sin,
            radius: setup.nominal.rotor_radius_m,
        }
    }
}

impl ActiveEffect for Wall {
    fn hooks(&self) -> Hooks {
        Hooks::WRENCH
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        let along = self.north * at.position_ned[0] + self.east * at.position_ned[1];
        let near = nearness(self.radius, self.distance - along);
        let force = self.strength * near * at.rotor_thrust.iter().sum::<f64>();
        let body = at.body_from_ned([force * self.north, force * self.east, 0.0]);
        for i in 0..3 {
            wrench.force_body[i] += body[i];
        }
    }
}
