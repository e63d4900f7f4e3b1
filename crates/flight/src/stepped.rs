//! One flight, stepped by a caller that owns the loop: a reinforcement-learning environment, a notebook.
//!
//! ```text
//!  sensors() ─▶ the caller chooses duties, or leaves it to our controller ─▶ step() ─▶ a complete sample, the next sensors()
//! ```
//! With our controller, samples and run hash equal those of [`crate::lockstep::fly`].

use crate::lockstep::Failure;
use crate::run_hash::RunHasher;
use crate::sample::Sample;
use crate::setup::run_setup;
use rotortwin_plant::{Simulation, TruthSample};
use rotortwin_proto::ControllerSetup;
use rotortwin_scenario::Scenario;
use rotortwin_wire::frames::{CommandFrame, SensorFrame, Stamp};
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::link::{ControllerPeer, PlantLink as _, RunSetup};
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};

/// Run id of a flight visible only to this process.
const RUN_ID: u64 = 1;

/// A flight stepped by the caller. A clone is the same flight at the same step, noise to come included.
#[derive(Clone)]
pub struct SteppedFlight {
    simulation: Simulation,
    link: InProcessLink<Steered, FdiEnginePeer>,
    hasher: RunHasher,
    sensors: SensorFrame,
    specific_force_m_s2: Option<[f32; 3]>,
    steps: u64,
}

impl SteppedFlight {
    /// A flight before its first step.
    ///
    /// # Errors
    /// The scenario cannot be flown.
    pub fn new(scenario: &Scenario, seed: u64) -> Result<Self, String> {
        let simulation = scenario.simulation(seed).map_err(|error| error.to_string())?;
        let setup: RunSetup = run_setup(scenario, &simulation, RUN_ID);
        let mut link = InProcessLink::new(Steered::default(), FdiEnginePeer::default());
        link.open(&setup).map_err(|error| error.to_string())?;
        let mut flight = Self {
            hasher: RunHasher::new(simulation.rotor_count()),
            simulation,
            link,
            sensors: SensorFrame::default(),
            specific_force_m_s2: None,
            steps: 0,
        };
        flight.sense();
        Ok(flight)
    }

    fn sense(&mut self) {
        let sensed = self.simulation.sense();
        let stamp = Stamp {
            run_id: RUN_ID,
            step: sensed.step,
            sim_time_ns: sensed.sim_time_ns,
        };
        self.sensors = SensorFrame::new(stamp, &sensed.nav, &sensed.reference, sensed.battery_voltage);
        self.specific_force_m_s2 = sensed.specific_force_m_s2;
    }

    /// Sensor values at the start of the next step; after the last one, at its end.
    pub fn sensors(&self) -> &SensorFrame {
        &self.sensors
    }

    /// The truth at the same time.
    pub fn truth(&self) -> &TruthSample {
        self.simulation.truth()
    }

    /// Rotors of the vehicle.
    pub fn rotor_count(&self) -> usize {
        self.simulation.rotor_count()
    }

    /// Duty, fraction, at which the nominal vehicle hovers at the initial charge.
    pub fn hover_duty(&self) -> f32 {
        self.simulation.hover_duty()
    }

    /// Complete samples.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// All steps of the scenario were flown.
    pub fn done(&self) -> bool {
        self.simulation.done()
    }

    /// Hash over all complete samples.
    pub fn run_hash(&self) -> String {
        self.hasher.digest()
    }

    /// Our controller's command for [`Self::sensors`]; it is computed at most once per step.
    pub fn controller_command(&mut self) -> CommandFrame {
        let sensors = self.sensors.canonical();
        self.link.controller_mut().own(&sensors)
    }

    /// Flies one step with `duty`, fraction by rotor, or with our controller's command. A controller not called in a step does not see
    /// it: its integrators are frozen.
    ///
    /// # Errors
    /// The flight is over, a duty is NaN, or the state of the plant is no longer valid; the flight cannot continue then.
    pub fn step(&mut self, duty: Option<&[f32]>) -> Result<Sample, Failure> {
        if let Some(duty) = duty {
            if duty.len() != self.rotor_count() {
                let sentence = format!("expected {} duties, got {}", self.rotor_count(), duty.len());
                return Err(Failure::of("controller", sentence));
            }
            let mut command = CommandFrame::default();
            command.duty[..duty.len()].copy_from_slice(duty);
            self.link.controller_mut().chosen = Some(command);
        }
        let truth = *self.simulation.truth();
        let command = self
            .link
            .exchange(&self.sensors)
            .map_err(|error| Failure::from(&error))?;
        self.simulation
            .advance(&command.command())
            .map_err(|error| Failure::of("plant", error.to_string()))?;
        let report = match self.link.next_report(true) {
            Ok(Some(report)) => report,
            Ok(None) => return Err(Failure::of("fdi", "the FDI engine gave no report")),
            Err(error) => return Err(Failure::from(&error)),
        };
        let sample = Sample {
            sensors: self.sensors,
            command,
            report,
            truth,
            specific_force_m_s2: self.specific_force_m_s2,
        };
        self.hasher.update(&sample);
        self.steps += 1;
        self.sense();
        Ok(sample)
    }
}

/// The caller's command if there is one, otherwise our controller's.
#[derive(Clone, Default)]
struct Steered {
    own: PidPeer,
    /// Our controller's command for the step in its stamp.
    answered: Option<CommandFrame>,
    /// The caller's command for the next step.
    chosen: Option<CommandFrame>,
}

impl Steered {
    fn own(&mut self, sensors: &SensorFrame) -> CommandFrame {
        match self.answered {
            Some(answer) if answer.stamp == sensors.stamp => answer,
            _ => *self.answered.insert(self.own.step(sensors)),
        }
    }
}

impl ControllerPeer for Steered {
    fn setup(&mut self, parameters: &ControllerSetup) -> Result<(), String> {
        self.own.setup(parameters)
    }

    fn step(&mut self, sensors: &SensorFrame) -> CommandFrame {
        match self.chosen.take() {
            Some(command) => command,
            None => self.own(sensors),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lockstep::{NoObserver, fly};
    use crate::pace::Pace;

    fn scenario() -> Scenario {
        let path = format!("{}/../../config/scenarios/short-hover.toml", env!("CARGO_MANIFEST_DIR"));
        Scenario::load_with(path, &["duration_s=2"]).expect("a good scenario")
    }

    #[test]
    fn regress_a_flight_by_steps_has_the_hash_of_the_loop() {
        let scenario = scenario();
        let mut simulation = scenario.simulation(3).expect("it flies");
        let setup = run_setup(&scenario, &simulation, 77);
        let mut link = InProcessLink::new(PidPeer::default(), FdiEnginePeer::default());
        let whole = fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut NoObserver);

        let mut flight = SteppedFlight::new(&scenario, 3).expect("it flies");
        while !flight.done() {
            // Querying first, or returning the same command, changes nothing.
            if flight.steps().is_multiple_of(3) {
                let duty = flight.controller_command().duty;
                assert_eq!(flight.controller_command().duty, duty);
            }
            flight.step(None).expect("a step");
        }
        assert_eq!((flight.steps(), flight.run_hash()), (whole.steps, whole.run_hash));
        assert!(
            flight
                .step(None)
                .is_err_and(|failure| failure.sentence.contains("over"))
        );
    }

    #[test]
    fn val_the_callers_duties_are_flown() {
        let mut flight = SteppedFlight::new(&scenario(), 3).expect("it flies");
        let full = vec![1.0; flight.rotor_count()];
        for _ in 0..200 {
            let sample = flight.step(Some(&full)).expect("a step");
            assert_eq!(sample.command.duty[..full.len()], full[..]);
        }
        assert!(flight.truth().velocity_ned_m_s[2] < -1.0, "it climbs");
        for (duty, words) in [(vec![0.5], "expected 6 duties"), (vec![f32::NAN; 6], "duty")] {
            let failure = flight.step(Some(&duty)).expect_err("it is refused");
            assert!(failure.sentence.contains(words), "{}", failure.sentence);
        }
    }
}
