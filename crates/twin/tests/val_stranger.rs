//! An unknown vehicle: identified from one flight, diagnosed on another. What was measured is a prior and not missing
//! physics; what was guessed is reported as a guess; anything else that is missing is still named.
//!
//! The vehicles are drawn at random, away from the class defaults, and flown by the independent simulator.

#![expect(clippy::unwrap_used, reason = "a refusal where none is due fails the test")]

mod development_data;
mod foreign_log;

use std::path::Path;

use development_data::shared;
use foreign_log::foreign_log;
use rotortwin_blind::flight::FlightPlan;
use rotortwin_blind::hidden::Hidden;
use rotortwin_blind::script::Script;
use rotortwin_blind::vehicle::Vehicle;
use rotortwin_plant::effects::{CorrectionScale, EffectClass, catalogue};
use rotortwin_twin::diagnose::{Diagnosis, Options, Verdict, diagnose};
use rotortwin_twin::identify::{Class, Request, Source, files, identify};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;

const ARM_M: f64 = 0.275;

/// A hexarotor of the F550's frame whose mass, inertia and lag are those of no document, with some friction.
fn stranger() -> Vehicle {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
    let mut vehicle = Vehicle::load(&path).unwrap();
    vehicle.mass = 1.72;
    vehicle.inertia = [0.0325, 0.0281, 0.0560];
    vehicle.thrust_lag = 0.037;
    vehicle
}

fn flown(vehicle: &Vehicle, flight: &str, seconds: f64, seed: u64, effects: &[&str]) -> FlightLog {
    let plan = FlightPlan {
        effects: effects.iter().map(|text| Hidden::parse(text).unwrap()).collect(),
        ..FlightPlan::new(vehicle.clone(), Script::built_in(flight, seed).unwrap(), seconds, seed)
    };
    let order: Vec<usize> = (0..vehicle.rotors.len()).collect();
    foreign_log(&format!("{flight} {seed}"), &plan, &order).unwrap()
}

/// The vehicle as `vehicle from-log` writes it from one flight, read back from its files.
fn identified(vehicle: &Vehicle, log: &FlightLog) -> ModelVersion {
    let request = Request {
        mass_kg: vehicle.mass,
        arm_m: ARM_M,
        frame: Some("hexa-cw-x".to_owned()),
        trust_frame: false,
        capacity_ah: None,
        cells: None,
    };
    read_back(log, &request)
}

fn read_back(log: &FlightLog, request: &Request) -> ModelVersion {
    let found = files(&identify(std::slice::from_ref(log), request).unwrap(), "own");
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [
        ("own.toml", &found.vehicle),
        ("own.blades.toml", &found.blades),
        ("own.intervals.toml", &found.intervals),
    ] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    ModelVersion::load(folder.path().join("own.toml")).unwrap()
}

fn said(log: FlightLog, model: &ModelVersion) -> Diagnosis {
    let found = diagnose(&[log], model, &Options::default()).unwrap();
    println!("{}", found.sentence);
    found
}

/// Key of the constant that no flight of this kind determines.
const DRAG: &str = "body.linear_drag_kg_s";

#[test]
fn val_measured_constants_are_priors_and_a_drag_that_a_log_does_not_show_is_none_of_its_class() {
    let vehicle = stranger();
    let model = identified(&vehicle, &flown(&vehicle, "excitation", 60.0, 71, &[]));
    assert!(model.constant.len() > 10);
    // It has none, and the flight bounds it below what its class says.
    let drag = model.constant.iter().find(|one| one.key == DRAG).unwrap();
    assert_eq!(drag.source, Source::Log, "{drag:?}");
    let class = Class::of(vehicle.mass, ARM_M).drag_per_s * vehicle.mass;
    assert!(
        (drag.low..=drag.high).contains(&vehicle.linear_drag) && drag.high < class,
        "{drag:?}"
    );

    // Another flight of the same vehicle lacks nothing, and there is nothing to calibrate first.
    let found = said(flown(&vehicle, "excitation", 60.0, 72, &[]), &model);
    assert_eq!(found.verdict, Verdict::Agrees, "{}", found.sentence);
    assert!(found.calibrate.is_empty(), "{:?}", found.calibrate);
}

#[test]
fn val_guesses_are_told_as_such() {
    let vehicle = stranger();
    // No flight at one place determines a drag, so that of the class is written.
    let model = identified(&vehicle, &flown(&vehicle, "hover", 60.0, 71, &[]));
    let guess = model.constant.iter().find(|one| one.key == DRAG).unwrap();
    assert_eq!(guess.source, Source::Class);
    let found = said(flown(&vehicle, "excitation", 60.0, 72, &[]), &model);
    let Verdict::CalibrateFirst { constants } = &found.verdict else {
        panic!("{}", found.sentence);
    };
    assert!(constants.iter().any(|key| key == DRAG), "{}", found.sentence);
    // A hover determined neither this nor the slope of the thrust curve, and the required value is the truth.
    let wanted = found.calibrate.iter().find(|one| one.key == DRAG).unwrap();
    let off = (wanted.wanted - vehicle.linear_drag).abs();
    assert!(
        off < 2.0 * wanted.wanted_interval_95 && off < 0.1 * guess.value,
        "{wanted:?}"
    );
    for (key, truth) in [
        ("body.inertia_body_kg_m2[0]", vehicle.inertia[0]),
        ("body.inertia_body_kg_m2[1]", vehicle.inertia[1]),
        ("rotors.thrust_lag_s", vehicle.thrust_lag),
    ] {
        for one in found.calibrate.iter().filter(|one| one.key == key) {
            assert!((one.wanted / truth - 1.0).abs() < 0.1, "{one:?} {truth}");
        }
    }
    // The vehicle is healthy: nothing is named that would only make up for the guesses.
    assert!(found.effects.is_empty(), "{}", found.sentence);
    assert!(
        found.sentence.starts_with("Calibrate first") && found.sentence.contains("vehicle from-log"),
        "{}",
        found.sentence
    );
}

#[test]
fn val_a_guess_within_its_class_that_the_flights_know_better_is_told_and_nothing_is_missing() {
    let vehicle = stranger();
    let mut model = identified(&vehicle, &flown(&vehicle, "excitation", 60.0, 71, &[]));
    // Another's guess of the roll inertia: 4 % off, 15 % known.
    const KEY: &str = "body.inertia_body_kg_m2[0]";
    let guessed = model.vehicle.body.inertia_body_kg_m2[0] * 1.04;
    model.vehicle.body.inertia_body_kg_m2[0] = guessed;
    let constant = model.constant.iter_mut().find(|one| one.key == KEY).unwrap();
    (constant.value, constant.low, constant.high) = (guessed, 0.7 * guessed, 1.3 * guessed);
    constant.source = Source::Class;
    let found = said(flown(&vehicle, "excitation", 60.0, 72, &[]), &model);
    assert!(
        !matches!(found.verdict, Verdict::Missing { .. } | Verdict::PartlyMissing { .. }),
        "{}",
        found.sentence
    );
    let wanted = found.calibrate.iter().find(|one| one.key == KEY).unwrap();
    println!("{wanted:?}");
    assert!(
        (wanted.wanted - vehicle.inertia[0]).abs() < 2.0 * wanted.wanted_interval_95
            && wanted.wanted_interval_95 < 0.1 * guessed,
        "{wanted:?}"
    );
    if !wanted.blocking {
        assert_eq!(found.verdict, Verdict::Agrees, "{}", found.sentence);
    }
}

#[test]
fn val_a_vehicle_without_its_intervals_is_told_so_before_anything_is_called_missing() {
    let vehicle = stranger();
    let mut model = identified(&vehicle, &flown(&vehicle, "hover", 60.0, 71, &[]));
    model.constant.clear();
    assert!(model.lacks_intervals());
    let found = said(flown(&vehicle, "excitation", 40.0, 72, &[]), &model);
    // Something compensates for the guesses, whether it is accepted or not.
    let is_dropped = |note: &String| note.starts_with("rejected: ");
    assert!(!found.effects.is_empty() || found.notes.iter().any(is_dropped));
    assert!(
        found
            .sentence
            .contains("own.intervals.toml) are missing from its folder")
            && found.notes.iter().any(|note| note.contains("missing from its folder")),
        "{}",
        found.sentence
    );
    // Nothing is called missing where any error on unseen blocks rises.
    let risen = found.held_out.iter().any(rotortwin_twin::diagnose::HeldOutError::rises);
    let missing = matches!(found.verdict, Verdict::Missing { .. } | Verdict::PartlyMissing { .. });
    assert!(!(risen && missing), "{}", found.sentence);
}

#[test]
fn val_what_is_missing_is_named_beside_priors() {
    let vehicle = stranger();
    let model = identified(&vehicle, &flown(&vehicle, "excitation", 60.0, 71, &[]));
    // With the same constants taken as exact, a healthy vehicle would be called faulty; with them as priors, a damaged
    // rotor is still found.
    let log = flown(
        &vehicle,
        "excitation",
        60.0,
        75,
        &["rotor-thrust-scale:rotor=3,share=-0.3"],
    );
    let found = said(log, &model);
    let named: Vec<_> = found
        .effects
        .iter()
        .map(|f| (f.instance.effect.as_str(), f.instance.rotor))
        .collect();
    assert!(named.contains(&("rotor-thrust-scale", Some(3))), "{}", found.sentence);
}

/// No finding says of a measured constant what its interval allows anyway, and none has a size that cannot be.
fn check_against_intervals(found: &Diagnosis, model: &ModelVersion) {
    for finding in &found.effects {
        let declaration = catalogue().iter().find(|entry| entry.id == finding.instance.effect);
        for p in declaration.map_or(&[][..], |entry| entry.parameters) {
            let Some(correction) = p.corrects else { continue };
            let Some(constant) = model.constant.iter().find(|c| c.key == correction.key) else {
                continue;
            };
            let value = finding.instance.parameters[p.name];
            let implied = match correction.scale {
                CorrectionScale::Share => constant.value * (1.0 + value),
                CorrectionScale::Difference => constant.value + value,
                CorrectionScale::Whole => value,
            };
            assert!(
                constant.low == constant.high || !(constant.low..=constant.high).contains(&implied),
                "{} is within what is known: {}",
                constant.name,
                found.sentence
            );
        }
        // Gusts have no size of their own: a variance takes up what nothing else explains.
        let sized = finding.class != EffectClass::Noise;
        assert!(
            !sized || finding.parameters.iter().all(|p| p.plausible),
            "{}",
            found.sentence
        );
    }
}

#[test]
fn val_real_flights_of_a_strangers_vehicle() {
    // Mass and arm as its makers give them; half of the flight to calibrate, the other to diagnose.
    let Some(folder) = shared("data/real/arpl_crazyflie_sysid") else {
        return;
    };
    for (name, first, second) in [
        ("log10", (4.0, 26.0), (24.0, 40.0)),
        ("log15", (8.0, 33.0), (30.0, 51.0)),
    ] {
        let log = FlightLog::read(&folder.join(name)).unwrap();
        let request = Request {
            mass_kg: 0.027,
            arm_m: 0.0396,
            frame: None,
            trust_frame: false,
            capacity_ah: None,
            cells: None,
        };
        let model = read_back(&log.slice(first.0, first.1), &request);
        assert!(model.guesses().is_some());
        let found = said(log.slice(second.0, second.1), &model);
        check_against_intervals(&found, &model);
        // What remains on a real vehicle is said; nothing passes for the whole of it.
        assert!(!matches!(found.verdict, Verdict::Missing { .. }), "{}", found.sentence);
        assert!(
            found
                .notes
                .iter()
                .any(|note| note.contains("guessed from vehicles of this class"))
        );
    }
}
