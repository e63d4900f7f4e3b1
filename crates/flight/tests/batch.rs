//! Flights side by side give the samples and run hashes of the single-flight loop.

use rotortwin_flight::batch::{Alone, BatchFlight, fly_batch};
use rotortwin_flight::lockstep::{self, FlightEnd, FlightObserver, NoObserver, StopReason};
use rotortwin_flight::pace::Pace;
use rotortwin_flight::sample::Sample;
use rotortwin_flight::setup;
use rotortwin_plant::powertrain::faults::FaultEntry;
use rotortwin_plant::vector_units::{Dispatch, VectorUnit};
use rotortwin_plant::vehicle::load::LoadDrop;
use rotortwin_scenario::{Documents, Scenario};
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};

fn shipped(name: &str) -> Scenario {
    let path = format!("{}/../../config/scenarios/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    Scenario::load(path).expect("a good scenario")
}

fn changed(name: &str, change: impl FnOnce(&mut Documents)) -> Scenario {
    let mut documents = shipped(name).documents().clone();
    change(&mut documents);
    Scenario::from_documents(&documents).expect("a good scenario")
}

fn fault(time_s: f64, rotor: u32) -> FaultEntry {
    FaultEntry {
        time_s,
        rotor,
        ..FaultEntry::default()
    }
}

/// Run hash, steps and end of one flight in the single-flight loop.
fn single(scenario: &Scenario, seed: u64) -> (String, u64, FlightEnd) {
    let mut simulation = scenario.simulation(seed).expect("a good scenario");
    let setup = setup::run_setup(scenario, &simulation, 1);
    let mut link = InProcessLink::new(PidPeer::default(), FdiEnginePeer::default());
    let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut NoObserver);
    (outcome.run_hash, outcome.steps, outcome.end)
}

#[test]
fn scenario_mixed_flights_have_the_hashes_of_single_ones() {
    let scenarios = [
        // Three rotor counts; faults, mismatch, wind; networks; flights of different lengths, more than there are
        // lanes.
        shipped("reference-flight"),
        shipped("realistic-reference-flight"),
        shipped("windy-hover"),
        shipped("waypoints"),
        shipped("quad-hover-chip"),
        shipped("octo-helix-loss"),
        shipped("lag-aware-reference-flight"),
        // Falls.
        shipped("rotor-failure"),
        shipped("motors-off"),
        // A rotor that gives more, one that comes and goes, blades that drag.
        changed("hover", |documents| {
            documents.scenario.duration_s = 15.0;
            let blade = documents.blades.blade.get_mut("b").expect("blade b");
            blade.moment_ratio_factor = 1.2;
            documents.scenario.fault = vec![
                FaultEntry {
                    thrust_loss_percent: Some(-8.0),
                    moment_ratio_change_percent: Some(15.0),
                    ramp_s: Some(0.5),
                    ..fault(2.0, 1)
                },
                FaultEntry {
                    thrust_loss_percent: Some(12.0),
                    moment_ratio_change_percent: Some(-10.0),
                    period_s: Some(2.0),
                    on_s: Some(0.5),
                    ..fault(3.0, 4)
                },
                FaultEntry {
                    blade: Some("b".to_owned()),
                    ..fault(8.0, 5)
                },
            ];
        }),
        // Drops a load: not in lanes.
        changed("hover", |documents| {
            documents.scenario.duration_s = 5.0;
            documents.scenario.load_drop = vec![LoadDrop {
                time_s: 2.0,
                mass_kg: 0.15,
                position_body_m: [0.03, -0.02, 0.05],
            }];
        }),
        // Has a sensor fault: not in lanes.
        shipped("gyro-bias"),
        // The battery runs empty in flight: not in lanes.
        changed("hover", |documents| {
            documents.scenario.duration_s = 20.0;
            documents.vehicle.battery.capacity_ah = 0.06;
        }),
        changed("hover", |documents| {
            documents.scenario.duration_s = 5.0;
            documents.scenario.integrator_substeps = 3;
        }),
    ];
    let flights: Vec<BatchFlight<'_>> = scenarios
        .iter()
        .flat_map(|scenario| (1..=3).map(move |seed| BatchFlight { scenario, seed }))
        .collect();
    let wanted: Vec<_> = flights
        .iter()
        .map(|flight| single(flight.scenario, flight.seed))
        .collect();
    for unit in VectorUnit::available() {
        let dispatch = Dispatch::new(*unit).expect("available");
        let (outcomes, report) = fly_batch(&flights, dispatch, |_| NoObserver).expect("good flights");
        for (i, (got, (hash, steps, end))) in outcomes.iter().zip(&wanted).enumerate() {
            let name = flights[i].scenario.name();
            assert_eq!(got.outcome.steps, *steps, "{name} on {}", unit.name());
            assert_eq!(got.outcome.run_hash, *hash, "{name} on {}", unit.name());
            assert_eq!(got.outcome.end, *end, "{name} on {}", unit.name());
        }
        let alone: u64 = report.alone.values().sum();
        assert_eq!(report.in_lanes + alone, flights.len() as u64);
        assert_eq!(
            report.alone.get(&Alone::Left),
            Some(&3),
            "the three with a small battery"
        );
        assert_eq!(report.alone.len(), 3, "{report:?}");
        assert_eq!(report.alone.get(&Alone::Effects), Some(&3), "the three with a load");
        assert!(report.alone.get(&Alone::SensorFaults) == Some(&3), "{report:?}");
    }
}

/// Records the samples it sees; stops after some of them.
struct Witness {
    steps: Vec<u64>,
    codes: Vec<i32>,
    stop_after: usize,
}

impl FlightObserver for Witness {
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        self.steps.push(sample.truth.step);
        self.codes.push(sample.report.sequential);
        Ok(())
    }

    fn stop_requested(&mut self) -> Option<StopReason> {
        (self.steps.len() >= self.stop_after).then_some(StopReason::Canceled)
    }
}

#[test]
fn scenario_observers_see_every_sample_once_and_can_stop() {
    let small_battery = changed("hover", |documents| {
        documents.scenario.duration_s = 20.0;
        documents.vehicle.battery.capacity_ah = 0.06;
    });
    let long = shipped("reference-flight");
    let mut flights = vec![BatchFlight {
        scenario: &small_battery,
        seed: 1,
    }];
    flights.extend((1..=10).map(|seed| BatchFlight { scenario: &long, seed }));
    let stop_after = |index: usize| if index == 0 { usize::MAX } else { 1000 + 100 * index };
    let (outcomes, _) = fly_batch(&flights, Dispatch::default(), |index| Witness {
        steps: Vec::new(),
        codes: Vec::new(),
        stop_after: stop_after(index),
    })
    .expect("good flights");
    for (index, outcome) in outcomes.iter().enumerate() {
        let steps = &outcome.observer.steps;
        assert_eq!(steps.len() as u64, outcome.outcome.steps);
        assert!(
            steps.iter().enumerate().all(|(i, step)| i as u64 == *step),
            "flight {index}"
        );
        if index > 0 {
            assert_eq!(steps.len(), stop_after(index));
            assert_eq!(outcome.outcome.end, FlightEnd::Canceled);
        }
    }
}

#[test]
fn val_what_has_no_lane_is_counted() {
    let inverse = changed("hover", |documents| {
        documents.scenario.duration_s = 3.0;
        documents.scenario.controller.thrust_to_duty = rotortwin_scenario::settings::ThrustToDutyMap::InverseMap;
    });
    let flights = [1, 2, 3].map(|seed| BatchFlight {
        scenario: &inverse,
        seed,
    });
    let (outcomes, report) = fly_batch(&flights, Dispatch::default(), |_| NoObserver).expect("good flights");
    assert_eq!(outcomes[0].outcome.run_hash, single(&inverse, 1).0);
    assert_eq!(report.alone.get(&Alone::InverseMap), Some(&3));
    // Two flights would leave six lanes empty.
    let (outcomes, report) = fly_batch(&flights[1..], Dispatch::default(), |_| NoObserver).expect("good flights");
    assert_eq!(outcomes[0].outcome.run_hash, single(&inverse, 2).0);
    assert_eq!(report.alone.get(&Alone::Few), Some(&2));
}
