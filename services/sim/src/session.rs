//! One run from its scenario to its folder, over any link.

use crate::commands::{Recorded, Recording};
use crate::conditions::ConditionSchedule;
use crate::network_over_time::NetworkOverTime;
use crate::recorder::Recorder;
use crate::second_look::SecondLook;
use rotortwin_flight::autopilot::{self, HandOver};
use rotortwin_flight::lateness::{Who, Why};
use rotortwin_flight::lockstep::{self, FlightEnd, FlightOutcome, NoObserver, StopReason};
use rotortwin_flight::pace::{Pace, RealTimeReport};
use rotortwin_flight::run_hash::model_hash;
pub use rotortwin_flight::setup::run_setup;
use rotortwin_plant::{STEP_NS, Simulation};
use rotortwin_process::{StopRequest, Supervisor, priority};
use rotortwin_scenario::Scenario;
use rotortwin_store::StoreError;
use rotortwin_store::own_detector::{Detector, judge_all};
use rotortwin_store::run_folder::RunFolder;
use rotortwin_store::spool::{SpoolHeader, SpoolReader, SpoolWriter};
use rotortwin_store::summary::{ControllerRecord, Failure, LateSteps, RealTime, ScenarioRecord, Status, Summary};
use rotortwin_wire::autopilot::{Autopilot, Identity};
use rotortwin_wire::events::RunEvent;
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::link::{LinkError, PlantLink, RunSetup};
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Link name of a run flown by an autopilot with its own clock.
pub const AUTOPILOT_LINK: &str = "autopilot ";

/// Identity of one execution of a scenario.
#[derive(Clone, Debug)]
pub struct SessionConfig {
    /// File of the scenario, as given.
    pub scenario_path: PathBuf,
    /// Seed of all noise.
    pub seed: u64,
    /// `in-process`, `iceoryx2` or `zenoh`.
    pub link_name: String,
    /// Pace of the run.
    pub pace: Pace,
    /// Identity of this execution, never 0.
    pub run_id: u64,
    /// Real-time priority of the processes, for the record.
    pub priority: Option<u8>,
    /// Samples to report per second of simulated time; `None`: none.
    pub live_hz: Option<f64>,
}

/// Link to our own controller and FDI engine in this process.
pub fn in_process_link() -> InProcessLink<PidPeer, FdiEnginePeer> {
    InProcessLink::new(PidPeer::default(), FdiEnginePeer::default())
}

/// Effect of a stop request on the flight.
#[inline]
pub fn stop_reason(supervisor: &Supervisor) -> Option<StopReason> {
    supervisor.stop_request().map(|request| match request {
        StopRequest::Cancel => StopReason::Canceled,
        StopRequest::Fail { peer, sentence } => StopReason::Failed(lockstep::Failure::lost(&peer, sentence)),
        StopRequest::Orphaned => StopReason::Failed(lockstep::Failure::lost(
            "supervisor",
            "the supervisor (rotortwin fly) died; the plant ended the run",
        )),
    })
}

/// Flies `scenario` over `link` and writes its run folder, whatever happens to the peers.
///
/// `emit` receives the events; `stop` is called before each step and ends the run early if it returns a reason. An error means
/// that the folder could not be written; a failed flight is a summary with status `failed`.
pub fn fly(
    scenario: &Scenario,
    config: &SessionConfig,
    link: &mut impl PlantLink,
    folder: &RunFolder,
    emit: &mut dyn FnMut(RunEvent),
    stop: &mut dyn FnMut() -> Option<StopReason>,
) -> Result<Summary, StoreError> {
    let fly = |simulation: &mut Simulation, setup: &RunSetup, recorder: &mut Recorder<'_>| {
        let outcome = lockstep::fly(simulation, link, setup, config.pace, recorder);
        (outcome, config.link_name.clone(), link.controller())
    };
    recorded(scenario, config, folder, (emit, stop), fly)
}

/// As [`fly`], with an autopilot that has its own clock in place of the controller, and the FDI engine in this process.
pub fn fly_autopilot(
    scenario: &Scenario,
    config: &SessionConfig,
    autopilot: &mut impl Autopilot,
    folder: &RunFolder,
    emit: &mut dyn FnMut(RunEvent),
    stop: &mut dyn FnMut() -> Option<StopReason>,
) -> Result<Summary, StoreError> {
    let instruments = scenario.document().instruments.clone().unwrap_or_default();
    let rotors = scenario.vehicle().rotor_count();
    let fly = |simulation: &mut Simulation, setup: &RunSetup, recorder: &mut Recorder<'_>| {
        let failed = |sentence| FlightEnd::Failed(lockstep::Failure::of("plant", sentence));
        let instruments = (&instruments, config.seed);
        let mut recording = match Recording::new(autopilot, folder.path(), rotors) {
            Ok(recording) => recording,
            Err(sentence) => {
                let outcome = FlightOutcome::before_step_0(failed(sentence));
                return (outcome, config.link_name.clone(), None);
            }
        };
        let hand_over = HandOver::default();
        let mut outcome = autopilot::fly(simulation, &mut recording, setup, instruments, hand_over, recorder).flight;
        // The version is only known afterwards.
        let identity = recording.identity();
        let link_name = match &identity.version {
            Some(version) => format!("{}, {version}", config.link_name),
            None => config.link_name.clone(),
        };
        if let Err(sentence) = recording.close() {
            outcome.end = failed(sentence);
        }
        (outcome, link_name, Some(identity))
    };
    recorded(scenario, config, folder, (emit, stop), fly)
}

/// True if an autopilot with its own clock flew the run: a replay needs its commands.
pub fn was_flown_by_autopilot(summary: &Summary) -> bool {
    summary.link.starts_with(AUTOPILOT_LINK)
}

/// Run hash of a recorded autopilot flight, replayed with its commands.
///
/// # Errors
/// The commands are missing or end early, or the flight failed.
pub fn replay_autopilot(
    scenario: &Scenario,
    mut simulation: Simulation,
    seed: u64,
    folder: &Path,
) -> Result<String, String> {
    let instruments = scenario.document().instruments.clone().unwrap_or_default();
    let mut commands = Recorded::open(folder, simulation.rotor_count())?;
    let setup = run_setup(scenario, &simulation, 1);
    let (instruments, hand_over) = ((&instruments, seed), HandOver::default());
    let outcome = autopilot::fly(
        &mut simulation,
        &mut commands,
        &setup,
        instruments,
        hand_over,
        &mut NoObserver,
    )
    .flight;
    match outcome.end {
        FlightEnd::Done => Ok(outcome.run_hash),
        FlightEnd::Canceled => Err("the replay was canceled".to_owned()),
        FlightEnd::Failed(failure) => Err(failure.sentence),
    }
}

/// Spool header of a run.
pub fn telemetry_header(scenario: &Scenario) -> SpoolHeader {
    header_of(scenario, &ConditionSchedule::new(scenario))
}

fn header_of(scenario: &Scenario, conditions: &ConditionSchedule) -> SpoolHeader {
    let vehicle = scenario.vehicle();
    let placements = vehicle.rotors.layout.placements();
    let weight_n = vehicle.body.mass_kg * vehicle.body.gravity_m_s2;
    SpoolHeader {
        rotor_count: vehicle.rotor_count(),
        step_ns: STEP_NS,
        conditions: conditions.descriptions().clone(),
        sensor_faults: conditions.sensor_fault_names().to_vec(),
        rotor_positions_body_m: placements.iter().map(|rotor| rotor.position_body).collect(),
        hover_thrust_n: weight_n / placements.len() as f64,
        dropped_loads: conditions.dropped_loads(),
    }
}

/// Records the flight executed by `flown`, which returns the outcome, the link and the controller.
fn recorded(
    scenario: &Scenario,
    config: &SessionConfig,
    folder: &RunFolder,
    (emit, stop): (&mut dyn FnMut(RunEvent), &mut dyn FnMut() -> Option<StopReason>),
    flown: impl FnOnce(&mut Simulation, &RunSetup, &mut Recorder<'_>) -> (FlightOutcome, String, Option<Identity>),
) -> Result<Summary, StoreError> {
    let mut simulation = scenario
        .simulation(config.seed)
        .expect("the scenario was tried with this seed before");
    simulation.record_accelerometer(&scenario.document().sensors, config.seed);
    let conditions = ConditionSchedule::new(scenario);
    let header = header_of(scenario, &conditions);
    let spool = SpoolWriter::create(&folder.spool_path(), &header)?;
    emit(RunEvent::Waiting);
    let setup = run_setup(scenario, &simulation, config.run_id);
    let mut recorder = Recorder::new(spool, scenario.duration_steps(), conditions, emit, stop);
    if let Some(rate_hz) = config.live_hz {
        recorder = recorder.with_live(rate_hz, simulation.rotor_count());
    }
    let (outcome, link, controller) = flown(&mut simulation, &setup, &mut recorder);
    recorder.finish()?;
    // The remaining work has no deadline, and must not keep others from the processor.
    priority::give_back();
    emit(RunEvent::Recording { steps: outcome.steps });
    let summary = Summary {
        link,
        controller: controller.map(|identity| ControllerRecord {
            peer: identity.peer,
            version: identity.version,
            lockstep: identity.lockstep,
        }),
        ..summary_of(scenario, config, &outcome)
    };
    let mut summary = finalise(folder, summary)?;
    if summary.steps > 0 {
        let (mut again, mut network) = (SecondLook::new(scenario), NetworkOverTime::beside_the_network(scenario));
        let mut detectors: Vec<&mut dyn Detector> = Vec::new();
        detectors.extend(again.as_mut().map(|one| one as &mut dyn Detector));
        detectors.extend(network.as_mut().map(|one| one as &mut dyn Detector));
        summary = judge_all(folder.path(), &mut detectors)?;
    }
    emit(RunEvent::Finished);
    Ok(summary)
}

fn summary_of(scenario: &Scenario, config: &SessionConfig, outcome: &FlightOutcome) -> Summary {
    let (status, failure) = match &outcome.end {
        FlightEnd::Done => (Status::Done, None),
        FlightEnd::Canceled => (Status::Canceled, None),
        FlightEnd::Failed(reason) => (Status::Failed, Some(failure(reason, outcome.steps))),
    };
    Summary {
        status,
        failure,
        run_hash: outcome.run_hash.clone(),
        wall_s: outcome.wall.as_secs_f64(),
        real_time: outcome
            .real_time
            .as_ref()
            .map(|report| real_time(report, config.priority)),
        ..blank_summary(scenario, config)
    }
}

/// A summary with everything known before the flight.
fn blank_summary(scenario: &Scenario, config: &SessionConfig) -> Summary {
    Summary {
        model_hash: model_hash(scenario),
        program_version: format!("rotortwin {}", env!("CARGO_PKG_VERSION")),
        scenario: ScenarioRecord {
            name: scenario.name().to_owned(),
            path: config.scenario_path.display().to_string(),
            vehicle: scenario.vehicle().name.clone(),
            text: scenario.documents().to_toml(),
        },
        seed: config.seed,
        link: config.link_name.clone(),
        pace: match config.pace {
            Pace::Fast => "fast".to_owned(),
            Pace::RealTime => "real-time".to_owned(),
        },
        ..Summary::default()
    }
}

fn real_time(report: &RealTimeReport, priority: Option<u8>) -> RealTime {
    RealTime {
        period_ms: report.period_us / 1e3,
        jitter_us_p50: report.jitter_p50_us,
        jitter_us_p99: report.jitter_p99_us,
        jitter_us_max: report.jitter_max_us,
        deadline_misses: report.deadline_misses,
        overrun_ms_max: Some(report.overrun_max_us / 1e3),
        priority,
        late: report
            .late
            .iter()
            .map(|late| LateSteps {
                who: match late.who {
                    Who::Plant => "plant",
                    Who::Controller => "controller",
                    Who::Fdi => "fdi",
                }
                .to_owned(),
                why: match late.why {
                    Why::Scheduler => "scheduler",
                    Why::Computing => "computing",
                    Why::Unknown => "unknown",
                }
                .to_owned(),
                steps: late.steps,
                worst_ms: late.worst_ms,
            })
            .collect(),
    }
}

fn failure(failure: &lockstep::Failure, steps: u64) -> Failure {
    Failure {
        peer: failure.peer.clone(),
        step: failure.last_step.unwrap_or_else(|| steps.saturating_sub(1)),
        silence_ms: u64::try_from(failure.silence.as_millis()).unwrap_or(u64::MAX),
        lost: failure.lost,
        sentence: failure.sentence.clone(),
    }
}

/// Writes the summary of a run whose link could not be opened.
pub fn never_opened(
    scenario: &Scenario,
    config: &SessionConfig,
    folder: &RunFolder,
    error: &LinkError,
) -> Result<Summary, StoreError> {
    let mut summary = blank_summary(scenario, config);
    summary.status = Status::Failed;
    summary.failure = Some(failure(&lockstep::Failure::from(error), 0));
    finalise(folder, summary)
}

/// A supervisor's knowledge of a plant that did not write its summary.
#[derive(Clone, Debug)]
pub struct DeadPlant {
    /// How it ended, e.g. "the plant (process 12) was killed by signal 9".
    pub how: String,
    /// Time from its last sign of life to the notice of its end.
    pub silence: Duration,
    /// Last complete step that it reported.
    pub last_step: Option<u64>,
    /// Wall-clock time of the run.
    pub wall: Duration,
}

/// Writes what is known of a run whose plant died: the rows that reached the spool, and the process responsible.
pub fn finalise_dead_plant(
    scenario: &Scenario,
    config: &SessionConfig,
    folder: &RunFolder,
    dead: &DeadPlant,
) -> Result<Summary, StoreError> {
    let mut summary = blank_summary(scenario, config);
    let last_row = SpoolReader::open(&folder.spool_path())
        .ok()
        .and_then(|spool| spool.rows().checked_sub(1));
    // The last rows are lost with the plant; it may have reported them.
    let last_step = last_row.max(dead.last_step);
    let after = match last_step {
        Some(step) => format!("after step {step}"),
        None => "before its first step".to_owned(),
    };
    summary.status = Status::Failed;
    summary.wall_s = dead.wall.as_secs_f64();
    summary.failure = Some(Failure {
        peer: "plant".to_owned(),
        step: last_step.unwrap_or(0),
        silence_ms: u64::try_from(dead.silence.as_millis()).unwrap_or(u64::MAX),
        lost: true,
        sentence: match dead.silence.as_millis() {
            // The kernel reported its end at once.
            0 => format!("{} {after}", dead.how),
            silence_ms => format!("{} {after}: silent for {silence_ms} ms", dead.how),
        },
    });
    finalise(folder, summary)
}

fn finalise(folder: &RunFolder, summary: Summary) -> Result<Summary, StoreError> {
    rotortwin_store::finalise(folder, summary).map(|outputs| outputs.summary)
}
