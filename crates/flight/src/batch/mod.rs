//! Many flights at once: the closed loop of [`crate::lockstep`] with the plants, controllers and FDI engines of several flights side
//! by side in vector registers. Same samples and run hashes, at a fraction of the time per flight.
//!
//! ```text
//!  flights ─▶ groups of one controller and FDI configuration ─▶ lanes ─▶ observers, outcomes, in the order of the flights
//!                                                     └─▶ what has no form for lanes ─▶ alone, by crate::lockstep; counted
//! ```
//!
//! Flights may differ in everything; those of a group share rotor count, controller and FDI configuration. When a lane's flight ends,
//! the lane takes the next one. A flight that exceeds what lanes support (see [`Alone`]) is flown again from its start by the
//! single-flight loop; its observer does not see a sample twice.
//!
//! Limits: as fast as possible, on one thread; 4, 6 or 8 rotors; no external peers.

mod group;

use crate::lockstep::{self, FlightObserver, FlightOutcome, StopReason};
use crate::pace::Pace;
use crate::sample::Sample;
use crate::setup::run_setup;
use group::LaneGroup;
use rotortwin_flight_core::control::lanes::ControlRows;
use rotortwin_flight_core::control::{Controller, ControllerConfig};
use rotortwin_flight_core::fdi::{FdiConfig, FdiEngine};
use rotortwin_plant::Simulation;
use rotortwin_plant::batch::{LANES, NoLane};
use rotortwin_plant::vector_units::Dispatch;
use rotortwin_scenario::Scenario;
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};
use rotortwin_wire::setup::{self, Trim};
use std::collections::BTreeMap;

/// Groups of fewer flights are flown alone: a step of all lanes costs about as much as three single steps.
const FEWEST_IN_LANES: usize = 3;

/// Run id of flights visible only to this process.
const RUN_ID: u64 = 1;

/// One flight to fly.
#[derive(Clone, Copy, Debug)]
pub struct BatchFlight<'a> {
    /// Scenario to fly.
    pub scenario: &'a Scenario,
    /// Seed of its random numbers.
    pub seed: u64,
}

/// Why a flight was flown alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Alone {
    /// No lanes for this number of rotors.
    RotorCount,
    /// Its controller inverts the thrust map iteratively.
    InverseMap,
    /// It has sensor faults.
    SensorFaults,
    /// Its scenario has effects or dropped loads.
    Effects,
    /// Too few flights share its configurations: empty lanes cost as much as full ones.
    Few,
    /// Something happened that lanes do not support: an empty battery, or a state or input that is not finite or not plausible.
    Left,
}

impl Alone {
    /// Human-readable reason.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::RotorCount => "rotor count without lanes",
            Self::InverseMap => "inverse thrust map in the controller",
            Self::SensorFaults => "sensor faults",
            Self::Effects => "effects or dropped loads",
            Self::Few => "few flights of its configuration",
            Self::Left => "left what lanes can do",
        }
    }
}

/// How the flights of a batch were flown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BatchReport {
    /// Flights that stayed in lanes.
    pub in_lanes: u64,
    /// Flights that were flown alone, by reason.
    pub alone: BTreeMap<Alone, u64>,
}

/// Result of one flight.
#[derive(Debug)]
pub struct BatchOutcome<O> {
    /// As returned by [`lockstep::fly`]; wall-clock time is shared by the flights that ran together.
    pub outcome: FlightOutcome,
    /// Its observer.
    pub observer: O,
}

/// Properties shared by all lanes of a group.
#[derive(Clone, PartialEq)]
struct GroupKey {
    controller: ControllerConfig,
    fdi: FdiConfig,
    substeps: u32,
}

/// A flight waiting for a lane.
struct Waiting<O> {
    index: usize,
    simulation: Simulation,
    trim: Option<Trim>,
    observer: O,
}

/// Flies all of `flights`; `observer` creates the observer of each, by its index. Results are in the order of the flights.
///
/// Fails with an error message if a scenario cannot be flown at all.
pub fn fly_batch<O: FlightObserver>(
    flights: &[BatchFlight<'_>],
    dispatch: Dispatch,
    mut observer: impl FnMut(usize) -> O,
) -> Result<(Vec<BatchOutcome<O>>, BatchReport), String> {
    let mut report = BatchReport::default();
    let mut results: Vec<Option<BatchOutcome<O>>> = flights.iter().map(|_| None).collect();
    // Flights of the same scenario document have the same configurations; those of different documents are compared.
    let mut groups: Vec<(GroupKey, Vec<usize>)> = Vec::new();
    let mut last: Option<(&Scenario, usize)> = None;
    for (index, flight) in flights.iter().enumerate() {
        let group = match last {
            Some((scenario, group)) if std::ptr::eq(scenario, flight.scenario) => group,
            _ => {
                let key = prepare(flight)?;
                groups.iter().position(|(other, _)| *other == key).unwrap_or_else(|| {
                    groups.push((key, Vec::new()));
                    groups.len() - 1
                })
            }
        };
        groups[group].1.push(index);
        last = Some((flight.scenario, group));
    }
    for (key, members) in &groups {
        let mut finish = |index: usize, outcome: BatchOutcome<O>, alone: Option<Alone>| {
            results[index] = Some(outcome);
            match alone {
                None => report.in_lanes += 1,
                Some(reason) => *report.alone.entry(reason).or_default() += 1,
            }
        };
        fly_group(flights, members, key, dispatch, &mut observer, &mut finish)?;
    }
    let outcomes = results
        .into_iter()
        .map(|outcome| outcome.expect("every flight belongs to one group"))
        .collect();
    Ok((outcomes, report))
}

/// The configurations that a flight's peers receive, through the same handshake as over any link.
fn prepare(flight: &BatchFlight<'_>) -> Result<GroupKey, String> {
    let simulation = flight
        .scenario
        .simulation(flight.seed)
        .map_err(|error| error.to_string())?;
    let sent = run_setup(flight.scenario, &simulation, RUN_ID);
    let (controller, _) = setup::controller_config(&sent.controller)?;
    let fdi = setup::fdi_config(&sent.fdi)?;
    Ok(GroupKey {
        controller,
        fdi,
        substeps: flight.scenario.document().integrator_substeps,
    })
}

/// Whether [`fly_batch`] accepts a flight: the single-flight loop rejects the same ones, with its own messages.
pub fn takes(flight: &BatchFlight<'_>) -> bool {
    prepare(flight).is_ok_and(|key| Controller::new(key.controller).is_ok() && FdiEngine::new(key.fdi).is_ok())
}

fn fly_group<O: FlightObserver>(
    flights: &[BatchFlight<'_>],
    members: &[usize],
    key: &GroupKey,
    dispatch: Dispatch,
    observer: &mut impl FnMut(usize) -> O,
    finish: &mut impl FnMut(usize, BatchOutcome<O>, Option<Alone>),
) -> Result<(), String> {
    if members.len() < FEWEST_IN_LANES {
        for &index in members {
            let outcome = fly_alone(&flights[index], observer(index), 0)?;
            finish(index, outcome, Some(Alone::Few));
        }
        return Ok(());
    }
    match key.fdi.geometry.rotor_count() {
        4 => fly_lanes::<4, O>(flights, members, key, dispatch, observer, finish),
        6 => fly_lanes::<6, O>(flights, members, key, dispatch, observer, finish),
        8 => fly_lanes::<8, O>(flights, members, key, dispatch, observer, finish),
        _ => {
            for &index in members {
                let outcome = fly_alone(&flights[index], observer(index), 0)?;
                finish(index, outcome, Some(Alone::RotorCount));
            }
            Ok(())
        }
    }
}

fn fly_lanes<const N: usize, O: FlightObserver>(
    flights: &[BatchFlight<'_>],
    members: &[usize],
    key: &GroupKey,
    dispatch: Dispatch,
    observer: &mut impl FnMut(usize) -> O,
    finish: &mut impl FnMut(usize, BatchOutcome<O>, Option<Alone>),
) -> Result<(), String> {
    let mut group = LaneGroup::<N, O>::new(key, dispatch)?;
    let suits = Controller::new(key.controller).is_ok_and(|controller| ControlRows::<N, LANES>::suits(&controller));
    let mut waiting = members.iter().copied();
    loop {
        while let Some(lane) = group.free_lane() {
            let Some(index) = waiting.next() else { break };
            let flight = &flights[index];
            if !suits {
                finish(index, fly_alone(flight, observer(index), 0)?, Some(Alone::InverseMap));
                continue;
            }
            let simulation = flight
                .scenario
                .simulation(flight.seed)
                .map_err(|error| error.to_string())?;
            if let Err(reason) = group.check(&simulation) {
                let reason = match reason {
                    NoLane::SensorFaults => Alone::SensorFaults,
                    NoLane::Effects => Alone::Effects,
                    NoLane::RotorCount | NoLane::Substeps | NoLane::Begun => Alone::RotorCount,
                };
                finish(index, fly_alone(flight, observer(index), 0)?, Some(reason));
                continue;
            }
            let trim = flight.scenario.starts_trimmed().then(|| Trim {
                duty: simulation.hover_duty(),
                battery_voltage: simulation.truth().battery_voltage_v as f32,
            });
            group.seat(
                lane,
                Waiting {
                    index,
                    simulation,
                    trim,
                    observer: observer(index),
                },
            )?;
        }
        if group.is_empty() {
            return Ok(());
        }
        group.step(&mut |left| match left {
            group::Left::Ended { index, outcome } => {
                finish(index, outcome, None);
                Ok(())
            }
            group::Left::Lost { index, observer, seen } => {
                let outcome = fly_alone(&flights[index], observer, seen)?;
                finish(index, outcome, Some(Alone::Left));
                Ok(())
            }
        })?;
    }
}

/// Flies one flight with the single-flight loop; the observer does not see the first `seen` samples.
fn fly_alone<O: FlightObserver>(flight: &BatchFlight<'_>, observer: O, seen: u64) -> Result<BatchOutcome<O>, String> {
    let mut simulation = flight
        .scenario
        .simulation(flight.seed)
        .map_err(|error| error.to_string())?;
    let setup = run_setup(flight.scenario, &simulation, RUN_ID);
    let mut link = InProcessLink::new(PidPeer::default(), FdiEnginePeer::default());
    let mut late = LateObserver { observer, unseen: seen };
    let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut late);
    Ok(BatchOutcome {
        outcome,
        observer: late.observer,
    })
}

/// Withholds samples that the observer has already seen.
struct LateObserver<O> {
    observer: O,
    /// First step not yet seen.
    unseen: u64,
}

impl<O: FlightObserver> FlightObserver for LateObserver<O> {
    const SEES_SAMPLES: bool = O::SEES_SAMPLES;

    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        if sample.truth.step < self.unseen {
            return Ok(());
        }
        self.observer.sample(sample)
    }

    fn stop_requested(&mut self) -> Option<StopReason> {
        self.observer.stop_requested()
    }
}
