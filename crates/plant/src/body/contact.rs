//! Contact of the vehicle with the ground: the wrench of feet and arms on it, and what happens there.
//!
//! Each point presses with Hunt and Crossley's force and rubs with Coulomb friction, regularised by an anchored spring:
//!
//! F_n = k δ max(0, 1 + a δ̇),   F_t = k (x_a − x)_t − c v_t, at most µ F_n
//!
//! δ is the depth, x_a the anchor, the place where the point took hold. a and c give the required damping at rest. An
//! anchor stays while friction holds, so a standing vehicle does not creep; it is dragged along at the end of each step
//! in which µ F_n is exceeded. The force is never negative, and the normal force only dissipates energy (Hunt and
//! Crossley 1975).
//!
//! Points are the feet and the rotors' hubs, so a vehicle that tips over comes to rest on its side. Limits: the ground
//! is a plane, points do not break, a rotor that strikes keeps turning.

use crate::body::dynamics::Around;
use crate::body::ground::{GroundContact, GroundEvent, Plane};
use crate::body::rigid_body::{RigidBodyState, Surroundings};
use crate::vector::{Vector3, cross, length};

/// A body tilted against the ground by more than this, touching it, has tipped over: 60°.
const TIPPED_OVER_COS: f64 = 0.5;

/// A foot or a rotor's hub.
#[derive(Debug, Clone)]
struct Point {
    /// m, body, from the centre of mass.
    place: Vector3,
    /// Where it took hold, m, NED.
    anchor: Option<Vector3>,
}

/// What a vehicle is to the ground.
#[derive(Debug, Clone)]
pub(crate) struct Footing {
    /// Feet, m, body, from the centre of mass.
    pub(crate) feet: Vec<Vector3>,
    /// Rotors' hubs, m, body, from the centre of mass.
    pub(crate) hubs: Vec<Vector3>,
    /// Radius of a rotor, m.
    pub(crate) rotor_radius: f64,
    /// Mass, kg.
    pub(crate) mass: f64,
    /// g, m/s².
    pub(crate) gravity: f64,
}

/// The ground under one vehicle.
#[derive(Debug, Clone)]
pub(crate) struct Contact {
    plane: Plane,
    friction: f64,
    hard_landing: f64,
    /// k, N/m.
    stiffness: f64,
    /// a, s/m.
    normal_damping: f64,
    /// c, N·s/m.
    tangential_damping: f64,
    points: Vec<Point>,
    feet: usize,
    /// No point is farther from the centre of mass, m.
    reach: f64,
    rotor_radius: f64,
    /// Rest height of the centre of mass over the ground, m along the normal.
    rest_height: f64,
    airborne: bool,
    tipped: bool,
    struck: u32,
    events: Vec<GroundEvent>,
}

impl Contact {
    pub(crate) fn new(model: &GroundContact, down: f64, footing: &Footing) -> Self {
        let feet = footing.feet.len();
        let share = footing.mass / feet as f64;
        // Square of the frequency of the vehicle on its feet.
        let frequency = (footing.gravity / model.sink_m).sqrt();
        let points: Vec<Point> = footing
            .feet
            .iter()
            .chain(&footing.hubs)
            .map(|&place| Point { place, anchor: None })
            .collect();
        let deepest = footing.feet.iter().fold(0.0, |most: f64, foot| most.max(foot[2]));
        Self {
            plane: Plane::new(down, model),
            friction: model.friction,
            hard_landing: model.hard_landing_m_s,
            stiffness: share * frequency * frequency,
            // At rest k δ = share · g, so that c = share · g · a = 2 ζ share ω.
            normal_damping: 2.0 * model.damping_ratio * frequency / footing.gravity,
            tangential_damping: 2.0 * model.damping_ratio * share * frequency,
            feet,
            reach: points.iter().map(|point| length(point.place)).fold(0.0, f64::max) + footing.rotor_radius,
            points,
            rotor_radius: footing.rotor_radius,
            rest_height: deepest - model.sink_m,
            airborne: true,
            tipped: false,
            struck: 0,
            events: Vec::new(),
        }
    }

    /// The body standing still on its feet over (north, east), before it has found its rest.
    pub(crate) fn standing(&self, north: f64, east: f64, yaw: f64) -> RigidBodyState {
        let foot = self.plane.at(north, east);
        RigidBodyState {
            position_ned: [0, 1, 2].map(|i| foot[i] + self.rest_height * self.plane.normal[i]),
            velocity_ned: [0.0; 3],
            ned_from_body: self.plane.standing(yaw),
            body_rates: [0.0; 3],
        }
    }

    /// The same ground with another friction.
    pub(crate) fn set_friction(&mut self, friction: f64) -> f64 {
        std::mem::replace(&mut self.friction, friction)
    }

    /// The centre of mass moves by `shift`, m, body, within the vehicle.
    pub(crate) fn move_centre(&mut self, shift: Vector3) {
        for point in &mut self.points {
            point.place = [0, 1, 2].map(|i| point.place[i] - shift[i]);
        }
        self.reach += length(shift);
        self.rest_height -= shift[2];
    }

    /// Distance to the ground along a direction, m; infinite if it points away.
    pub(crate) fn distance(&self, position_ned: Vector3, direction_ned: Vector3) -> f64 {
        let n = self.plane.normal;
        let towards = -(direction_ned[0] * n[0] + direction_ned[1] * n[1] + direction_ned[2] * n[2]);
        if towards > 0.0 {
            -self.plane.depth(position_ned) / towards
        } else {
            f64::INFINITY
        }
    }

    /// True while a point touches.
    pub(crate) fn touches(&self) -> bool {
        !self.airborne
    }

    /// What has happened since the last call.
    pub(crate) fn take_events(&mut self) -> Vec<GroundEvent> {
        std::mem::take(&mut self.events)
    }

    /// Place and velocity of a point, NED.
    #[inline]
    fn motion(&self, place: Vector3, body: &RigidBodyState) -> (Vector3, Vector3) {
        let q = body.ned_from_body;
        let arm = q.ned_from_body(place);
        let turning = q.ned_from_body(cross(body.body_rates, place));
        (
            [0, 1, 2].map(|i| body.position_ned[i] + arm[i]),
            [0, 1, 2].map(|i| body.velocity_ned[i] + turning[i]),
        )
    }

    /// F_n, N, of a point at a depth that moves out of the ground with `leaving` m/s.
    #[inline]
    fn normal_force(&self, depth: f64, leaving: f64) -> f64 {
        self.stiffness * depth.max(0.0) * (1.0 - self.normal_damping * leaving).max(0.0)
    }

    /// Part of a NED vector along the ground.
    #[inline]
    fn along(&self, v: Vector3) -> Vector3 {
        let n = self.plane.normal;
        let out = v[0] * n[0] + v[1] * n[1] + v[2] * n[2];
        [0, 1, 2].map(|i| v[i] - out * n[i])
    }

    /// Force, N, NED, and torque, N·m, body, of the ground on the body.
    pub(crate) fn wrench(&self, body: &RigidBodyState) -> (Vector3, Vector3) {
        let (mut force, mut torque) = ([0.0; 3], [0.0; 3]);
        if self.plane.depth(body.position_ned) < -self.reach {
            return (force, torque);
        }
        let n = self.plane.normal;
        for point in &self.points {
            let (place, velocity) = self.motion(point.place, body);
            let depth = self.plane.depth(place);
            if depth <= 0.0 {
                continue;
            }
            let leaving = velocity[0] * n[0] + velocity[1] * n[1] + velocity[2] * n[2];
            let pressing = self.normal_force(depth, leaving);
            let slip = self.along(velocity);
            let stretch = point
                .anchor
                .map_or([0.0; 3], |anchor| self.along([0, 1, 2].map(|i| anchor[i] - place[i])));
            let rubbing = [0, 1, 2].map(|i| self.stiffness * stretch[i] - self.tangential_damping * slip[i]);
            let (most, wanted) = (self.friction * pressing, length(rubbing));
            let scale = if wanted > most { most / wanted } else { 1.0 };
            let total = [0, 1, 2].map(|i| pressing * n[i] + scale * rubbing[i]);
            let turning = cross(point.place, body.ned_from_body.body_from_ned(total));
            for i in 0..3 {
                force[i] += total[i];
                torque[i] += turning[i];
            }
        }
        (force, torque)
    }

    /// Takes a step from `before` to `after`: anchors follow, and contact events are recorded.
    pub(crate) fn settle(&mut self, before: &RigidBodyState, after: &RigidBodyState) {
        let n = self.plane.normal;
        let near = self.plane.depth(after.position_ned) >= -self.reach;
        let mut fastest: f64 = 0.0;
        let mut touching = false;
        for index in 0..self.points.len() {
            let (place, velocity) = self.motion(self.points[index].place, after);
            let depth = self.plane.depth(place);
            if !near || depth <= 0.0 {
                self.points[index].anchor = None;
                continue;
            }
            touching = true;
            let leaving = velocity[0] * n[0] + velocity[1] * n[1] + velocity[2] * n[2];
            let Some(anchor) = self.points[index].anchor else {
                // The force has slowed it down since.
                let (_, arriving) = self.motion(self.points[index].place, before);
                fastest = fastest.max(-(arriving[0] * n[0] + arriving[1] * n[1] + arriving[2] * n[2]));
                self.points[index].anchor = Some(place);
                continue;
            };
            let stretch = self.along([0, 1, 2].map(|i| anchor[i] - place[i]));
            let (most, now) = (
                self.friction * self.normal_force(depth, leaving) / self.stiffness,
                length(stretch),
            );
            if now > most {
                self.points[index].anchor = Some([0, 1, 2].map(|i| place[i] + stretch[i] * (most / now)));
            }
        }
        if touching && self.airborne && fastest > self.hard_landing {
            self.events.push(GroundEvent::HardLanding { speed_m_s: fastest });
        }
        self.airborne = !touching;
        if near {
            self.note_attitude(after, touching);
        }
    }

    fn note_attitude(&mut self, body: &RigidBodyState, touching: bool) {
        let n = body.ned_from_body.body_from_ned(self.plane.normal);
        // −n₃ is the cosine of the tilt against the ground.
        let tipped = touching && -n[2] < TIPPED_OVER_COS;
        if tipped && !self.tipped {
            let tilt_rad = libm::acos((-n[2]).clamp(-1.0, 1.0));
            self.events.push(GroundEvent::TipOver { tilt_rad });
        }
        self.tipped = tipped;
        let edge = self.rotor_radius * (n[0] * n[0] + n[1] * n[1]).sqrt();
        for rotor in 0..self.points.len() - self.feet {
            let (hub, _) = self.motion(self.points[self.feet + rotor].place, body);
            let bit = 1 << rotor;
            if self.plane.depth(hub) + edge <= 0.0 {
                self.struck &= !bit;
            } else if self.struck & bit == 0 {
                self.struck |= bit;
                self.events.push(GroundEvent::RotorStrike { rotor });
            }
        }
    }

    /// Energy stored in feet and anchors, J.
    #[cfg(test)]
    pub(crate) fn elastic_energy(&self, body: &RigidBodyState) -> f64 {
        let of = |point: &Point| {
            let (place, _) = self.motion(point.place, body);
            let depth = self.plane.depth(place).max(0.0);
            let stretch = point.anchor.filter(|_| depth > 0.0).map_or(0.0, |anchor| {
                length(self.along([0, 1, 2].map(|i| anchor[i] - place[i])))
            });
            0.5 * self.stiffness * (depth * depth + stretch * stretch)
        };
        self.points.iter().map(of).sum()
    }
}

/// Wind and disturbances together with the ground.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OnGround<'a> {
    pub(crate) around: &'a Surroundings,
    pub(crate) contact: &'a Contact,
}

impl Around for OnGround<'_> {
    #[inline]
    fn at(&self, body: &RigidBodyState) -> Surroundings {
        let (force, torque) = self.contact.wrench(body);
        Surroundings {
            wind_ned: self.around.wind_ned,
            force_ned: [0, 1, 2].map(|i| self.around.force_ned[i] + force[i]),
            torque_body: [0, 1, 2].map(|i| self.around.torque_body[i] + torque[i]),
        }
    }
}

/// Wind and disturbances, and the ground's contribution at a state of the body.
#[inline]
pub(crate) fn around(surroundings: &Surroundings, contact: Option<&Contact>, body: &RigidBodyState) -> Surroundings {
    match contact {
        None => *surroundings,
        Some(contact) => OnGround {
            around: surroundings,
            contact,
        }
        .at(body),
    }
}
