//! The lockstep loop of one flight.
//!
//! ```text
//!  for each step k:   sense ─▶ link.exchange ─▶ advance the plant with command k
//!                       │            │
//!                       └─ pending ──┴─▶ when the FDI report of the oldest pending step arrives: hash it, observe it
//! ```
//! The loop is the same for every link; it owns the ordering, the link owns the waiting. The FDI engine may trail by a bounded
//! number of steps; samples still leave the loop complete and in step order.
//!
//! A run ends in one of three ways ([`FlightEnd`]): done, stopped by its observer, or failed with an error message that names the
//! culprit. However it ends, every complete sample has been observed first and both peers have been notified.

use crate::pace::{Pace, Pacer, RealTimeReport};
use crate::run_hash::RunHasher;
use crate::sample::Sample;
use rotortwin_plant::body::ground::GroundEvent;
use rotortwin_plant::{STEP_NS, Simulation, SimulationError, TruthSample};
use rotortwin_proto::Role;
use rotortwin_wire::frames::{CommandFrame, SensorFrame, Stamp};
use rotortwin_wire::link::{LinkError, PlantLink, RunSetup};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Observes a flight from inside its process.
pub trait FlightObserver {
    /// False for an observer that needs no samples: flights side by side then need not assemble them.
    const SEES_SAMPLES: bool = true;

    /// Called once for each complete step, in order. An error ends the run as failed.
    fn sample(&mut self, sample: &Sample) -> Result<(), String>;

    /// Called before each step: a reason to stop now, or `None` to continue.
    fn stop_requested(&mut self) -> Option<StopReason>;

    /// A mishap on the ground occurred before `sim_time_s`.
    fn mishap(&mut self, _sim_time_s: f64, _event: GroundEvent) {}

    /// An autopilot has handed over after `prelude_s` of simulated time: step 0 follows.
    fn handed_over(&mut self, _prelude_s: f64) {}

    /// A message from an autopilot or its pilot, `plant_time_s` after the start of the plant.
    fn words(&mut self, _plant_time_s: f64, _text: String) {}
}

impl<O: FlightObserver> FlightObserver for &mut O {
    const SEES_SAMPLES: bool = O::SEES_SAMPLES;

    #[inline]
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        (**self).sample(sample)
    }

    #[inline]
    fn stop_requested(&mut self) -> Option<StopReason> {
        (**self).stop_requested()
    }

    fn mishap(&mut self, sim_time_s: f64, event: GroundEvent) {
        (**self).mishap(sim_time_s, event);
    }

    fn handed_over(&mut self, prelude_s: f64) {
        (**self).handed_over(prelude_s);
    }

    fn words(&mut self, plant_time_s: f64, text: String) {
        (**self).words(plant_time_s, text);
    }
}

/// Why an observer stops a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// Cancelled by the user; not a failure.
    Canceled,
    /// Something outside the loop failed.
    Failed(Failure),
}

/// An observer that does nothing.
#[derive(Default)]
pub struct NoObserver;

impl FlightObserver for NoObserver {
    const SEES_SAMPLES: bool = false;

    #[inline]
    fn sample(&mut self, _: &Sample) -> Result<(), String> {
        Ok(())
    }

    #[inline]
    fn stop_requested(&mut self) -> Option<StopReason> {
        None
    }
}

/// How a flight ended.
#[derive(Clone, Debug, PartialEq)]
pub enum FlightEnd {
    /// All steps were flown.
    Done,
    /// Cancelled by the user.
    Canceled,
    /// It ended early and unintentionally.
    Failed(Failure),
}

/// What failed, and which peer is at fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// `plant`, `controller`, `fdi` or `supervisor`.
    pub peer: String,
    /// Last step that the peer answered.
    pub last_step: Option<u64>,
    /// How long it had been silent.
    pub silence: Duration,
    /// The peer died, fell silent or never connected, or the transport failed; a retry of the same flight may succeed.
    pub lost: bool,
    /// The complete error message.
    pub sentence: String,
}

impl Failure {
    /// A failure other than silence.
    pub fn of(peer: &str, sentence: impl Into<String>) -> Self {
        Self {
            peer: peer.to_owned(),
            last_step: None,
            silence: Duration::ZERO,
            lost: false,
            sentence: sentence.into(),
        }
    }

    /// The failure of a process known to have ended.
    pub fn lost(peer: &str, sentence: impl Into<String>) -> Self {
        Self {
            lost: true,
            ..Self::of(peer, sentence)
        }
    }
}

impl From<&LinkError> for Failure {
    fn from(error: &LinkError) -> Self {
        let (role, last_step, silence) = match error {
            LinkError::PeerDied {
                role,
                last_step,
                silence,
                ..
            }
            | LinkError::PeerSilent {
                role,
                last_step,
                silence,
                ..
            } => (*role, *last_step, *silence),
            LinkError::PeerMissing { role, limit, .. } => (*role, None, *limit),
            LinkError::Refused { role, .. } | LinkError::Unreadable { role, .. } => (*role, None, Duration::ZERO),
            LinkError::ProtocolViolation { role, step, .. } => (*role, Some(*step), Duration::ZERO),
            LinkError::RunFailed { .. } | LinkError::Stopped | LinkError::Transport { .. } => {
                (Role::Plant, None, Duration::ZERO)
            }
        };
        let peer = match role {
            Role::Controller => "controller",
            Role::Fdi => "fdi",
            Role::Plant | Role::Unspecified => "plant",
        };
        let lost = matches!(
            error,
            LinkError::PeerDied { .. }
                | LinkError::PeerSilent { .. }
                | LinkError::PeerMissing { .. }
                // After a process was killed while opening shared memory, no other process can open it.
                | LinkError::Transport { .. }
        );
        Self {
            peer: peer.to_owned(),
            last_step,
            silence,
            lost,
            sentence: error.to_string(),
        }
    }
}

/// Result of a flight, without its samples.
#[derive(Clone, Debug)]
pub struct FlightOutcome {
    /// How it ended.
    pub end: FlightEnd,
    /// Complete samples.
    pub steps: u64,
    /// Hash over all complete samples.
    pub run_hash: String,
    /// Wall-clock time of the loop.
    pub wall: Duration,
    /// Jitter and deadline misses, at real-time pace.
    pub real_time: Option<RealTimeReport>,
}

impl FlightOutcome {
    /// A flight that could not start.
    pub fn before_step_0(end: FlightEnd) -> Self {
        Self {
            end,
            steps: 0,
            run_hash: RunHasher::new(0).digest(),
            wall: Duration::ZERO,
            real_time: None,
        }
    }
}

/// Flies `simulation` to its end with the peers behind `link`.
pub fn fly(
    simulation: &mut Simulation,
    link: &mut impl PlantLink,
    setup: &RunSetup,
    pace: Pace,
    observer: &mut impl FlightObserver,
) -> FlightOutcome {
    let opened = link.open(setup);
    let mut flight = Flight {
        run_id: setup.run_id,
        pending: VecDeque::new(),
        hasher: RunHasher::new(simulation.rotor_count()),
        steps: 0,
        pacer: Pacer::new(pace, Duration::from_nanos(STEP_NS)),
    };
    let start = Instant::now();
    let end = match opened
        .map_err(StopReason::from)
        .and_then(|()| flight.run(simulation, link, observer))
    {
        Ok(()) => FlightEnd::Done,
        Err(StopReason::Canceled) => FlightEnd::Canceled,
        Err(StopReason::Failed(failure)) => match observer.stop_requested() {
            // An observer that asked to stop knows why; a link that broke at the same time only saw the consequence.
            Some(StopReason::Canceled) => FlightEnd::Canceled,
            Some(StopReason::Failed(reason)) => FlightEnd::Failed(reason),
            None => FlightEnd::Failed(failure),
        },
    };
    let failure = match &end {
        FlightEnd::Done => None,
        FlightEnd::Canceled => Some("canceled"),
        FlightEnd::Failed(failure) => Some(failure.sentence.as_str()),
    };
    link.finish(flight.steps, failure);
    FlightOutcome {
        end,
        steps: flight.steps,
        run_hash: flight.hasher.digest(),
        wall: start.elapsed(),
        real_time: flight.pacer.report(),
    }
}

/// What is known about a step before its report arrives.
struct Pending {
    sensors: SensorFrame,
    command: CommandFrame,
    truth: TruthSample,
    specific_force_m_s2: Option<[f32; 3]>,
}

/// The state of the loop.
struct Flight {
    run_id: u64,
    /// Steps whose report is outstanding, oldest first.
    pending: VecDeque<Pending>,
    hasher: RunHasher,
    /// Complete samples.
    steps: u64,
    pacer: Pacer,
}

impl Flight {
    fn run(
        &mut self,
        simulation: &mut Simulation,
        link: &mut impl PlantLink,
        observer: &mut impl FlightObserver,
    ) -> Result<(), StopReason> {
        self.pacer
            .follow(link.process(Role::Controller), link.process(Role::Fdi));
        while !simulation.done() {
            if let Some(reason) = observer.stop_requested() {
                return Err(reason);
            }
            let result = self.step(simulation, link, observer);
            if let Err(StopReason::Failed(failure)) = &result
                && failure.peer != "fdi"
            {
                // Keep what is complete: the engine may have answered more steps than were taken. Do not wait again for a dead or
                // stalled engine.
                while let Ok(true) = self.take_report(link, observer, false) {}
            }
            result?;
        }
        while !self.pending.is_empty() {
            self.take_report(link, observer, true)?;
        }
        Ok(())
    }

    #[inline]
    fn step(
        &mut self,
        simulation: &mut Simulation,
        link: &mut impl PlantLink,
        observer: &mut impl FlightObserver,
    ) -> Result<(), StopReason> {
        let sensed = simulation.sense();
        self.pacer.begin_step(sensed.step);
        let stamp = Stamp {
            run_id: self.run_id,
            step: sensed.step,
            sim_time_ns: sensed.sim_time_ns,
        };
        let sensors = SensorFrame::new(stamp, &sensed.nav, &sensed.reference, sensed.battery_voltage);
        let truth = *simulation.truth();
        let command = link.exchange(&sensors)?;
        self.pacer.end_step();
        simulation.advance(&command.command())?;
        for event in simulation.take_ground_events() {
            observer.mishap(simulation.truth().sim_time_ns as f64 * 1e-9, event);
        }
        self.pending.push_back(Pending {
            sensors,
            command,
            truth,
            specific_force_m_s2: sensed.specific_force_m_s2,
        });
        while self.take_report(link, observer, false)? {}
        // The report of this step may still arrive.
        self.pacer.reports_missing(self.pending.len().saturating_sub(1));
        Ok(())
    }

    /// Completes the oldest pending step if its report has arrived; false otherwise.
    #[inline]
    fn take_report(
        &mut self,
        link: &mut impl PlantLink,
        observer: &mut impl FlightObserver,
        wait: bool,
    ) -> Result<bool, StopReason> {
        if self.pending.is_empty() {
            return Ok(false);
        }
        let Some(report) = link.next_report(wait)? else {
            return Ok(false);
        };
        let Some(Pending {
            sensors,
            command,
            truth,
            specific_force_m_s2,
        }) = self.pending.pop_front()
        else {
            return Ok(false);
        };
        let sample = Sample {
            sensors,
            command,
            report,
            truth,
            specific_force_m_s2,
        };
        self.hasher.update(&sample);
        self.steps += 1;
        observer
            .sample(&sample)
            .map_err(|sentence| StopReason::Failed(Failure::of("plant", sentence)))?;
        Ok(true)
    }
}

impl From<LinkError> for StopReason {
    fn from(error: LinkError) -> Self {
        Self::Failed(Failure::from(&error))
    }
}

impl From<SimulationError> for StopReason {
    fn from(error: SimulationError) -> Self {
        Self::Failed(Failure::of("plant", error.to_string()))
    }
}
