//! A flight in parts of 0.5 ms, for controllers that do not answer 400 times a second, and the time before the flight.
//!
//! ```text
//!  begin_prelude ─▶ advance_part … ─▶ hand_over ─▶ step 0: advance_part × 5 ─▶ step 1 ─▶ …
//! ```
//! During the prelude time runs and the vehicle moves, but the flight does not: trajectory, faults and steps wait for the hand-over,
//! and the sensors of controller and detectors are not read. Its length changes the charge and the wind that the flight begins with.

use rotortwin_flight_core::MAX_ROTORS;

use super::{Simulation, ground};
use crate::STEP_S;
use crate::error::{Refusal, SimulationError};
use crate::sensing::instruments::{InstrumentSample, Instruments, Scene};

/// Parts of a step.
pub const PARTS_PER_STEP: u32 = ground::PARTS;
/// Length of a part, ns.
pub const PART_NS: u64 = crate::STEP_NS / PARTS_PER_STEP as u64;

/// How far a flight in parts is.
#[derive(Debug, Clone, Default)]
pub(super) struct Parts {
    /// Since the start of the plant, prelude included.
    elapsed: u64,
    /// Done of the current step.
    done: u32,
    prelude: bool,
}

impl Simulation {
    /// Begins the time before the flight. To be called at step 0.
    ///
    /// # Errors
    /// The scenario has no ground that carries the vehicle, does not begin on it, or has effects, whose delays and states know whole steps only.
    pub fn begin_prelude(&mut self) -> Result<(), Refusal> {
        if self.contact.is_none() || !self.on_ground() {
            let reason = "an autopilot arms on the ground: expected \"on-ground\", and `[ground.contact]`";
            return Err(Refusal::new("initial.start", reason));
        }
        if self.effects.is_some() {
            let reason = "a flight with an autopilot of its own clock takes no effects yet, nor a vehicle with `rotors.reaction_s`: they know whole \
                          steps of 2.5 ms only";
            return Err(Refusal::new("effect", reason));
        }
        self.parts.prelude = true;
        Ok(())
    }

    /// Ends the prelude: the next part is the first of step 0. To be called where a step begins ([`Simulation::step_begins`]).
    pub fn hand_over(&mut self) {
        self.parts.prelude = false;
        self.record_truth(0);
    }

    /// Lets time run on after the last step, until the vehicle stands: nothing of it counts, and faults stay as they are.
    pub fn begin_landing(&mut self) {
        self.parts.prelude = true;
    }

    /// True if the next part is the first of a step.
    pub fn step_begins(&self) -> bool {
        self.parts.done == 0
    }

    /// Time since the start of the plant, prelude included, ns.
    pub fn elapsed_ns(&self) -> u64 {
        self.parts.elapsed * PART_NS
    }

    /// Holds duties, limited to \[0, 1\], over 0.5 ms; true if that completed a step. Ground contact is required.
    ///
    /// # Errors
    /// As [`Simulation::advance`].
    pub fn advance_part(&mut self, duty: &[f64; MAX_ROTORS]) -> Result<bool, SimulationError> {
        let step = self.truth.step;
        if self.parts.done == 0 && !self.parts.prelude {
            if self.done() {
                return Err(SimulationError::FlightOver { step });
            }
            self.sense();
        }
        let limited = self.limited(duty)?;
        self.powertrain.hold(&limited);
        let parts = self.ground_parts();
        self.integrate_parts(parts / PARTS_PER_STEP, STEP_S / f64::from(parts));
        self.parts.elapsed += 1;
        self.parts.done = (self.parts.done + 1) % PARTS_PER_STEP;
        let complete = self.parts.done == 0;
        if complete && !self.parts.prelude {
            self.complete_step(step + 1)?;
        } else {
            self.check_state(step)?;
            if complete {
                self.cut_off_if_empty();
                self.environment.advance();
            }
            self.record_truth(step);
        }
        Ok(complete)
    }

    /// First point of the trajectory, m, NED.
    pub fn first_point(&self) -> [f64; 3] {
        self.reference.trajectory().pose(0.0).0
    }

    /// Yaw at the first point, rad.
    pub fn first_yaw(&self) -> f64 {
        self.reference.trajectory().pose(0.0).1
    }

    /// What instruments say now.
    pub fn measure(&self, instruments: &mut Instruments) -> InstrumentSample {
        let body = &self.state.body;
        let down = body.ned_from_body.down_axis();
        instruments.measure(&Scene {
            time_ns: self.elapsed_ns(),
            position_ned: body.position_ned,
            velocity_ned: body.velocity_ned,
            body_rates: body.body_rates,
            specific_force: self.specific_force(),
            magnetic_field: body.ned_from_body.body_from_ned(instruments.magnetic_field_ned()),
            distance: self
                .contact
                .as_ref()
                .map_or(f64::INFINITY, |contact| contact.distance(body.position_ned, down)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::ground::GroundContact;
    use crate::config::SimulationConfig;
    use crate::nearest_step;
    use crate::powertrain::faults::FaultEntry;
    use crate::sensing::instruments::InstrumentModel;
    use crate::testing::{faults, hover, vehicle_on_skids};

    fn config() -> SimulationConfig {
        SimulationConfig {
            vehicle: vehicle_on_skids("f550"),
            duration_steps: nearest_step(2.0),
            ground_down_m: Some(0.0),
            ground_contact: Some(GroundContact::default()),
            starts_on_ground: true,
            starts_trimmed: false,
            ..hover()
        }
    }

    #[test]
    fn prop_five_parts_of_the_same_duty_are_a_step() {
        let (mut whole, mut parts) = (
            Simulation::new(&config(), 5).unwrap(),
            Simulation::new(&config(), 5).unwrap(),
        );
        let mut duty = [0.0; MAX_ROTORS];
        for k in 0..800 {
            duty[..6].fill(0.3 + 0.0005 * f64::from(k));
            whole.advance_duty(&duty).unwrap();
            for part in 1..=PARTS_PER_STEP {
                assert_eq!(parts.advance_part(&duty).unwrap(), part == PARTS_PER_STEP);
            }
            assert_eq!(whole.truth(), parts.truth());
            assert_eq!(whole.sense(), parts.sense());
        }
        assert!(whole.truth().position_ned_m[2] < -1.0, "it has left the ground");
        assert!(parts.done() && parts.advance_part(&duty).is_err());
    }

    #[test]
    fn val_the_flight_waits_for_the_hand_over() {
        let mut config = config();
        let entry = FaultEntry {
            time_s: 1.0,
            rotor: 2,
            blade: None,
            thrust_loss_percent: Some(50.0),
            ramp_s: None,
            rotor_lost: None,
        };
        config.faults = faults(&config, &[entry]);
        let mut sim = Simulation::new(&config, 1).unwrap();
        sim.begin_prelude().unwrap();
        let idle = [0.0; MAX_ROTORS];
        for _ in 0..4000 * PARTS_PER_STEP {
            sim.advance_part(&idle).unwrap();
        }
        assert_eq!((sim.step(), sim.elapsed_ns()), (0, 10_000_000_000));
        assert_eq!(sim.truth().faulty_rotors, 0);
        sim.hand_over();
        for _ in 0..400 * PARTS_PER_STEP {
            sim.advance_part(&idle).unwrap();
        }
        assert_eq!((sim.step(), sim.elapsed_ns()), (400, 11_000_000_000));
        assert_eq!(sim.truth().faulty_rotors, 0b10, "the fault counts from the hand-over");
    }

    #[test]
    fn val_time_runs_on_after_the_last_step() {
        let mut sim = Simulation::new(&config(), 1).unwrap();
        sim.begin_prelude().unwrap();
        sim.hand_over();
        let idle = [0.0; MAX_ROTORS];
        while !sim.done() {
            sim.advance_part(&idle).unwrap();
        }
        let step = sim.step();
        assert!(sim.advance_part(&idle).is_err(), "the flight is over");
        sim.begin_landing();
        for _ in 0..400 * PARTS_PER_STEP {
            sim.advance_part(&idle).unwrap();
        }
        assert_eq!((sim.step(), sim.elapsed_ns()), (step, 3_000_000_000));
        assert!(sim.on_ground());
    }

    #[test]
    fn val_instruments_of_a_standing_vehicle() {
        let sim = Simulation::new(&config(), 1).unwrap();
        let mut instruments = Instruments::new(&InstrumentModel::exact(), 1);
        let sample = sim.measure(&mut instruments);
        assert!((sample.specific_force_m_s2[2] + 9.81).abs() < 1e-6);
        assert!((sample.range_m.unwrap() - 0.179).abs() < 1e-3);
        for (got, expected) in sample.magnetic_field_gauss.iter().zip([0.215_23, 0.007_71, 0.427_41]) {
            assert!((got - expected).abs() < 1e-4, "{sample:?}");
        }
    }

    #[test]
    fn val_no_prelude_in_the_air() {
        let mut sim = Simulation::new(&hover(), 1).unwrap();
        assert_eq!(sim.begin_prelude().unwrap_err().key, "initial.start");
    }
}
