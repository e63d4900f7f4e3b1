//! The pilot and controller inside the scripted autopilots: waits, arms, climbs to its height, holds there, and flies an optional tour.

use rotortwin_flight_core::control::Controller;
use rotortwin_flight_core::frames::{EulerAngles, Vec3};
use rotortwin_flight_core::signals::{NavState, Reference};
use rotortwin_scenario::Scenario;

/// Height above the ground of a vehicle on its skids, m, and rate of climb, m/s.
const CLIMB: (f64, f64) = (0.179, 1.0);

/// A tour in three dimensions, ahead, aside and up: amplitude m, angular rate rad/s.
const TOUR: [(f64, f64); 3] = [(4.0, 0.7), (3.0, 1.0), (0.6, 1.3)];

/// An autopilot's estimate of its own motion: m, m/s, NED; rad; rad/s.
pub(crate) struct Motion {
    pub(crate) position: [f64; 3],
    pub(crate) velocity: [f64; 3],
    pub(crate) attitude: [f64; 3],
    pub(crate) body_rates: [f64; 3],
}

/// Its schedule, on its own clock.
#[derive(Clone, Copy)]
pub(crate) struct Plan {
    /// Time of arming, s.
    pub(crate) arms_s: f64,
    /// Hold height, m over the origin.
    pub(crate) height_m: f64,
    /// Start of the tour, s; `None`: it holds position.
    pub(crate) tour_s: Option<f64>,
}

impl Plan {
    /// Position, m, and velocity, m/s, NED.
    fn wanted(&self, time_s: f64) -> ([f64; 3], [f64; 3]) {
        let since = time_s - self.arms_s;
        let height = (CLIMB.0 + CLIMB.1 * since).min(self.height_m);
        let climb = if height < self.height_m { CLIMB.1 } else { 0.0 };
        let (mut place, mut velocity) = ([0.0, 0.0, -height], [0.0, 0.0, -climb]);
        if let Some(t) = self.tour_s.map(|begin| time_s - begin).filter(|t| *t > 0.0) {
            for (i, (amplitude, rate)) in TOUR.into_iter().enumerate() {
                let grown = amplitude * (0.25 * t).min(1.0);
                place[i] += grown * (rate * t).sin();
                velocity[i] += grown * rate * (rate * t).cos();
            }
        }
        (place, velocity)
    }
}

pub(crate) struct Pilot {
    scenario: Scenario,
    controller: Controller,
    plan: Plan,
    /// In our rotor order.
    pub(crate) duty: [f64; 6],
    next_s: f64,
}

fn controller(scenario: &Scenario) -> Controller {
    Controller::new(scenario.controller_config()).expect("a good controller")
}

impl Pilot {
    pub(crate) fn new(scenario: &Scenario, plan: Plan) -> Self {
        Self {
            scenario: scenario.clone(),
            controller: controller(scenario),
            plan,
            duty: [0.0; 6],
            next_s: plan.arms_s,
        }
    }

    /// Restarts from the beginning.
    pub(crate) fn restart(&mut self) {
        self.controller = controller(&self.scenario);
        (self.duty, self.next_s) = ([0.0; 6], self.plan.arms_s);
    }

    /// Duties at `time_s`; 0 before it arms.
    pub(crate) fn fly(&mut self, time_s: f64, motion: &Motion) {
        let single = |v: [f64; 3]| Vec3::from_array(v.map(|x| x as f32));
        // The controller of flight-core counts in steps of 2.5 ms.
        while time_s >= self.next_s {
            self.next_s += 0.0025;
            let nav = NavState {
                position_ned: single(motion.position),
                velocity_ned: single(motion.velocity),
                attitude: EulerAngles {
                    roll: motion.attitude[0] as f32,
                    pitch: motion.attitude[1] as f32,
                    yaw: motion.attitude[2] as f32,
                },
                body_rates: Vec3::from_array(motion.body_rates.map(|x| x as f32)),
            };
            let (place, velocity) = self.plan.wanted(time_s);
            let reference = Reference {
                position_ned: single(place),
                velocity_ned: single(velocity),
                yaw: 0.0,
            };
            let duty = self.controller.step(&nav, &reference, 15.5).command.duty;
            self.duty = std::array::from_fn(|rotor| f64::from(duty[rotor]));
        }
    }
}
