//! A flight in parts of 0.5 ms, for controllers that do not answer 400 times a second, and the time before the flight.
//!
//! ```text
//!  begin_prelude ─▶ advance_part … ─▶ hand_over ─▶ step 0: advance_part × 5 ─▶ step 1 ─▶ …
//! ```
//! During the prelude time runs and the vehicle moves, but the flight does not: trajectory, faults and steps wait for the hand-over,
//! and the sensors of controller and detectors are not read. Its length changes the charge and the wind that the flight begins with.
//! Effects act during it as they do from the start of any flight, at time 0 for what depends on the time; those with an onset wait, too.

use rotortwin_flight_core::MAX_ROTORS;

use super::Simulation;
use crate::effect_flight::{Part, Plant};
use crate::error::{Refusal, SimulationError};
use crate::sensing::instruments::{InstrumentSample, Instruments, Scene};
use crate::{PARTS_PER_STEP, STEP_S};

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
    /// The scenario has no ground that carries the vehicle, does not begin on it, or has an effect on the values or the
    /// timing of sensors: an autopilot reads instruments of its own, on which such effects do not act.
    pub fn begin_prelude(&mut self) -> Result<(), Refusal> {
        if self.contact.is_none() || !self.on_ground() {
            let reason = "an autopilot arms on the ground: expected \"on-ground\", and `[ground.contact]`";
            return Err(Refusal::new("initial.start", reason));
        }
        if let Some(effects) = &mut self.effects {
            if let Some(id) = effects.of_readings() {
                let reason = format!(
                    "`{id}` acts on the readings of our own estimator, and an autopilot of its own clock has other sensors, those of \
                     `[instruments]`: expected effects on forces, rotors, mass, air or battery only"
                );
                return Err(Refusal::new("effect", reason));
            }
            effects.hold_onsets();
        }
        self.parts.prelude = true;
        Ok(())
    }

    /// Ends the prelude: the next part is the first of step 0. To be called where a step begins ([`Simulation::step_begins`]).
    pub fn hand_over(&mut self) {
        self.parts.prelude = false;
        if let Some(effects) = &mut self.effects {
            effects.release_onsets();
        }
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
        let parts = self.ground_parts();
        let substeps = parts / PARTS_PER_STEP;
        if let Some(effects) = &mut self.effects {
            let air = Plant {
                rotors: self.powertrain.rotors(),
                battery: &self.battery,
                around: self.environment.now(),
                contact: None,
            };
            let contact = self.contact.as_deref_mut();
            let part = Part {
                step_begins_s: step as f64 * STEP_S,
                done: self.parts.done,
                substeps,
            };
            effects.advance_part(&part, &mut self.state, &air, contact, &limited);
        } else {
            self.powertrain.hold(&limited);
            self.integrate_parts(substeps, STEP_S / f64::from(parts));
        }
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

    /// Readings of the instruments now.
    pub fn measure(&self, instruments: &mut Instruments) -> InstrumentSample {
        let body = &self.state.body;
        let down = body.ned_from_body.down_axis();
        let (position_ned, velocity_ned) = match &self.effects {
            Some(effects) => effects.measured_motion(body),
            None => (body.position_ned, body.velocity_ned),
        };
        instruments.measure(&Scene {
            time_ns: self.elapsed_ns(),
            position_ned,
            velocity_ned,
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
    use crate::effects::{EffectInstance, ParameterKind, Place, catalogue};
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
            thrust_loss_percent: Some(50.0),
            ..FaultEntry::default()
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

    /// Every effect of the catalogue with its typical values, with what it needs; those on readings apart.
    fn each_effect() -> impl Iterator<Item = (bool, Vec<EffectInstance>)> {
        let typical = |id: &str| {
            let declared = catalogue().iter().find(|declared| declared.id == id).unwrap();
            let values: Vec<_> = declared.parameters.iter().map(|p| (p.name, p.typical)).collect();
            let effect = EffectInstance::new(id, &values);
            if declared.per_rotor { effect.on_rotor(1) } else { effect }
        };
        catalogue().iter().map(move |declared| {
            assert!(declared.parameters.iter().any(|p| p.kind == ParameterKind::Size));
            let of_readings = [Place::Reading, Place::Timing]
                .iter()
                .any(|place| declared.places.contains(place));
            let needed = declared.needs.first().map(|id| typical(id));
            (of_readings, needed.into_iter().chain([typical(declared.id)]).collect())
        })
    }

    #[test]
    fn prop_five_parts_of_the_same_duty_are_a_step_with_every_effect() {
        let mut flown = 0;
        for (_, effects) in each_effect().filter(|(of_readings, _)| !of_readings) {
            let config = SimulationConfig { effects, ..config() };
            let (mut whole, mut parts) = (
                Simulation::new(&config, 5).unwrap(),
                Simulation::new(&config, 5).unwrap(),
            );
            parts.begin_prelude().unwrap();
            parts.hand_over();
            let mut duty = [0.0; MAX_ROTORS];
            for k in 0..800 {
                duty[..6].fill(0.3 + 0.0005 * f64::from(k));
                whole.advance_duty(&duty).unwrap();
                for part in 1..=PARTS_PER_STEP {
                    assert_eq!(parts.advance_part(&duty).unwrap(), part == PARTS_PER_STEP);
                }
            }
            let (a, b) = (whole.truth(), parts.truth());
            let name = &config.effects.last().unwrap().effect;
            for i in 0..3 {
                // Accelerations that hooks see are fresher by a part.
                assert!(
                    (a.position_ned_m[i] - b.position_ned_m[i]).abs() < 1e-4,
                    "{name}: {a:?} {b:?}"
                );
                assert!(
                    (a.velocity_ned_m_s[i] - b.velocity_ned_m_s[i]).abs() < 1e-3,
                    "{name}: {a:?} {b:?}"
                );
            }
            assert!(
                (a.battery_voltage_v - b.battery_voltage_v).abs() < 1e-4,
                "{name}: {a:?} {b:?}"
            );
            // A centre of mass aside tips it over.
            flown += u32::from(a.position_ned_m[2] < -0.5);
        }
        assert!(flown > 40, "{flown} have left the ground");
    }

    #[test]
    fn val_effects_on_readings_are_refused_by_name() {
        for (_, effects) in each_effect().filter(|(of_readings, _)| *of_readings) {
            let id = effects.last().unwrap().effect.clone();
            let mut sim = Simulation::new(&SimulationConfig { effects, ..config() }, 1).unwrap();
            let refusal = sim.begin_prelude().unwrap_err();
            assert_eq!(refusal.key, "effect");
            assert!(refusal.reason.contains(&format!("`{id}`")), "{refusal}");
        }
    }

    /// Thrust of rotor 1 over that of rotor 2.
    fn ratio(sim: &Simulation) -> f64 {
        let thrust = &sim.truth().rotor_thrust_n;
        thrust[0] / thrust[1]
    }

    #[test]
    fn val_onsets_count_from_the_hand_over() {
        let half = |rotor| EffectInstance::new("rotor-thrust-scale", &[("share", -0.5)]).on_rotor(rotor);
        for (onset_s, in_prelude, at_first, later) in [
            (None, 0.5, 0.5, 0.5),
            (Some(0.0), 1.0, 0.5, 0.5),
            (Some(1.0), 1.0, 1.0, 0.5),
        ] {
            let mut effect = half(1);
            effect.onset_s = onset_s;
            let config = SimulationConfig {
                effects: vec![effect],
                mismatch: crate::testing::preset(crate::vehicle::mismatch::MismatchPreset::None),
                ..config()
            };
            let mut sim = Simulation::new(&config, 1).unwrap();
            sim.begin_prelude().unwrap();
            let mut duty = [0.0; MAX_ROTORS];
            duty[..6].fill(0.15);
            let run = |sim: &mut Simulation, steps: u32| {
                for _ in 0..steps * PARTS_PER_STEP {
                    sim.advance_part(&duty).unwrap();
                }
                ratio(sim)
            };
            let near =
                |got: f64, expected: f64| assert!((got - expected).abs() < 0.01, "{onset_s:?}: {got} {expected}");
            near(run(&mut sim, 2000), in_prelude);
            sim.hand_over();
            near(run(&mut sim, 360), at_first);
            near(run(&mut sim, 360), later);
        }
    }

    #[test]
    fn val_a_delay_counts_in_parts() {
        // 3 ms are six parts, and no whole number of steps.
        let config = SimulationConfig {
            effects: vec![EffectInstance::new("command-delay", &[("delay_s", 0.003)])],
            ..config()
        };
        let mut sim = Simulation::new(&config, 1).unwrap();
        sim.begin_prelude().unwrap();
        let mut duty = [0.0; MAX_ROTORS];
        duty[..6].fill(0.3);
        let turning: Vec<bool> = (0..8)
            .map(|_| {
                sim.advance_part(&duty).unwrap();
                sim.truth().rotor_thrust_n[0] > 0.0
            })
            .collect();
        assert_eq!(turning, [false, false, false, false, false, false, true, true]);
    }

    #[test]
    fn val_rotors_with_inertia_and_drag_fly_with_an_autopilot() {
        let mut config = config();
        config.vehicle.rotors.reaction_s = 0.1;
        config.vehicle.rotors.drag_kg_s = 0.1;
        Simulation::new(&config, 1).unwrap().begin_prelude().unwrap();
    }
}
