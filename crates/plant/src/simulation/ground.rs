//! A flight over ground that carries the vehicle: how it stands at the start, and its integration.
//!
//! The step is integrated in at least five parts of 0.5 ms, so that feet of some 100 rad/s are resolved, and anchors follow after each.

use rotortwin_flight_core::MAX_ROTORS;

use super::Simulation;
use crate::body::contact::{self, Contact, Footing, OnGround};
use crate::body::dynamics::Dynamics;
use crate::body::ground::{GroundContact, GroundEvent};
use crate::body::rigid_body::Surroundings;
use crate::config::SimulationConfig;
use crate::effects::Constants;
use crate::error::Refusal;
use crate::vector::Vector3;
use crate::vehicle::mismatch::MismatchDraw;
use crate::{PARTS_PER_STEP, STEP_S};

/// Time that a vehicle is given to find its rest before the flight, s.
const REST_S: f64 = 3.0;
/// A friction that holds on every slope.
const STICKING: f64 = 1e3;

/// The ground of a flight, if it carries the vehicle that this flight drew.
pub(super) fn contact(config: &SimulationConfig, mismatch: &MismatchDraw) -> Result<Option<Box<Contact>>, Refusal> {
    let Some(model) = &config.ground_contact else {
        return Ok(None);
    };
    let vehicle = &config.vehicle;
    let Some(gear) = &vehicle.landing_gear else {
        let reason = "the vehicle has no feet to stand on: give `landing_gear.feet_body_m` in its document";
        return Err(Refusal::new("ground.contact", reason));
    };
    let Some(down) = config.ground_down_m else {
        return Err(Refusal::new("ground.down_m", "missing key"));
    };
    let centre = mismatch.centre_of_mass_m;
    let about_centre = |place: Vector3| [0, 1, 2].map(|i| place[i] - centre[i]);
    let footing = Footing {
        feet: gear.feet_body_m.iter().map(|&foot| about_centre(foot)).collect(),
        hubs: vehicle
            .rotors
            .layout
            .placements()
            .iter()
            .map(|rotor| about_centre(rotor.position_body))
            .collect(),
        rotor_radius: Constants::nominal(vehicle).rotor_radius_m,
        mass: vehicle.body.mass_kg * mismatch.mass,
        gravity: vehicle.body.gravity_m_s2,
    };
    Ok(Some(Box::new(Contact::new(model, down, &footing))))
}

impl Simulation {
    /// Stands the vehicle on the ground below the first point of the trajectory, rotors at rest, and lets it find its rest: with a
    /// friction that holds, so that a flight on ice begins where it should.
    pub(super) fn stand(&mut self, model: &GroundContact, first: Vector3, yaw: f64) -> Result<(), Refusal> {
        let Some(contact) = &mut self.contact else {
            return Err(Refusal::new("initial.start", "no ground carries the vehicle"));
        };
        self.state.body = contact.standing(first[0], first[1], yaw);
        let friction = contact.set_friction(STICKING);
        let charge = self.state.state_of_charge;
        self.powertrain.hold(&[0.0; MAX_ROTORS]);
        let parts = (REST_S / STEP_S) as u32 * PARTS_PER_STEP;
        self.integrate_parts(parts, STEP_S / f64::from(PARTS_PER_STEP));
        self.state.state_of_charge = charge;
        let mut events = Vec::new();
        if let Some(contact) = &mut self.contact {
            contact.set_friction(friction);
            events = contact.take_events();
        }
        if events.is_empty() {
            return Ok(());
        }
        let reason = format!(
            "the vehicle does not stand on a slope of {}°: it tips over or its rotors touch the ground",
            model.slope_deg
        );
        Err(Refusal::new("ground.contact.slope_deg", reason))
    }

    /// Parts in which a step over ground is integrated: a multiple of [`PARTS_PER_STEP`].
    pub(super) fn ground_parts(&self) -> u32 {
        self.substeps.div_ceil(PARTS_PER_STEP) * PARTS_PER_STEP
    }

    /// `parts` parts of `h` s with the held command, on the ground of the flight.
    pub(super) fn integrate_parts(&mut self, parts: u32, h: f64) {
        match self.rotor_count {
            ..=4 => self.integrate_on_ground::<4>(parts, h),
            5..=6 => self.integrate_on_ground::<6>(parts, h),
            7..=8 => self.integrate_on_ground::<8>(parts, h),
            _ => self.integrate_on_ground::<MAX_ROTORS>(parts, h),
        }
    }

    fn integrate_on_ground<const N: usize>(&mut self, parts: u32, h: f64) {
        let Some(mut contact) = self.contact.take() else {
            return;
        };
        let mut now = self.dynamic_state::<N>();
        for _ in 0..parts {
            let dynamics = Dynamics {
                body: &self.body,
                around: OnGround {
                    around: self.environment.now(),
                    contact: &contact,
                },
                rotors: self.powertrain.held::<N>(),
                battery: self.battery.constants(),
                connected: self.battery.is_connected(),
            };
            let next = dynamics.step(&mut &self.battery, &now, h);
            contact.settle(&now.body, &next.body);
            now = next;
        }
        self.contact = Some(contact);
        self.take_dynamic_state(&now);
    }

    /// Wind, disturbances and the ground where the body is now.
    pub(super) fn around(&self) -> Surroundings {
        contact::around(self.environment.now(), self.contact.as_deref(), &self.state.body)
    }

    /// What happened on the ground since the last call; always empty for a flight without ground contact.
    pub fn take_ground_events(&mut self) -> Vec<GroundEvent> {
        self.contact
            .as_mut()
            .map_or_else(Vec::new, |contact| contact.take_events())
    }

    /// True while the vehicle touches the ground.
    pub fn on_ground(&self) -> bool {
        self.contact.as_ref().is_some_and(|contact| contact.touches())
    }
}
