//! Files that are wrong in one measure or a little in all, and logs that lack what a comparison leans on: the answer is that measure, or that
//! nothing is missing.
//!
//! The vehicles are flown by the independent simulator.

#![expect(clippy::unwrap_used, reason = "a refusal where none is due fails the test")]

mod foreign_log;

use std::path::{Path, PathBuf};

use foreign_log::foreign_log;
use rotortwin_blind::draw::draw_clutter;
use rotortwin_blind::flight::FlightPlan;
use rotortwin_blind::hidden::Hidden;
use rotortwin_blind::random::Stream;
use rotortwin_blind::script::Script;
use rotortwin_blind::vehicle::Vehicle;
use rotortwin_twin::diagnose::{Diagnosis, Options, Verdict, diagnose};
use rotortwin_twin::identify::{Request, files, identify};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;

fn f550() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml")
}

fn flown(vehicle: &Vehicle, flight: &str, seed: u64, effects: &[&str]) -> FlightLog {
    let plan = FlightPlan {
        effects: effects.iter().map(|text| Hidden::parse(text).unwrap()).collect(),
        ..FlightPlan::new(vehicle.clone(), Script::built_in(flight, seed).unwrap(), 60.0, seed)
    };
    let order: Vec<usize> = (0..vehicle.rotors.len()).collect();
    foreign_log(&format!("{flight} {seed}"), &plan, &order).unwrap()
}

fn said(log: FlightLog, model: &ModelVersion) -> Diagnosis {
    let found = diagnose(&[log], model, &Options::default()).unwrap();
    println!("{}", found.sentence);
    found
}

/// The value of the only size of a named effect; it is within one and a half intervals of the truth.
fn check_size(found: &Diagnosis, effect: &str, truth: f64) {
    let finding = found.effects.iter().find(|f| f.instance.effect == effect);
    let size = &finding
        .unwrap_or_else(|| panic!("{effect}: {}", found.sentence))
        .parameters[0];
    let off = (size.value - truth).abs();
    assert!(off < 1.5 * size.interval_95, "{effect} {truth}: {}", found.sentence);
}

fn check_missing(found: &Diagnosis, effects: &[(&str, f64)]) {
    assert!(matches!(found.verdict, Verdict::Missing { .. }), "{}", found.sentence);
    assert_eq!(found.effects.len(), effects.len(), "{}", found.sentence);
    for &(effect, truth) in effects {
        check_size(found, effect, truth);
    }
}

#[test]
fn val_inertias_that_are_wrong_by_one_factor_are_named_and_no_mass_instead() {
    let vehicle = Vehicle::load(&f550()).unwrap();
    for (flight, seed, factor) in [("excitation", 31, 1.2), ("waypoint", 32, 1.2)] {
        let mut model = ModelVersion::load(f550()).unwrap();
        for inertia in &mut model.vehicle.body.inertia_body_kg_m2 {
            *inertia *= factor;
        }
        let share = 1.0 / factor - 1.0;
        let found = said(flown(&vehicle, flight, seed, &[]), &model);
        check_missing(
            &found,
            &[
                ("inertia-roll", share),
                ("inertia-pitch", share),
                ("inertia-yaw", share),
            ],
        );
    }
}

/// Small errors hide one another: with the right size of the largest, those of the others show, and must not speak against it.
#[test]
fn val_constants_that_are_all_off_by_two_per_cent_do_not_hide_what_is_missing() {
    let vehicle = Vehicle::load(&f550()).unwrap();
    let model = ModelVersion::load(f550()).unwrap();
    let mut excused = 0;
    for (seed, effect, size) in [
        (41, "yaw-damping:damping_n_m_s=0.02", 0.02),
        (42, "internal-resistance:added_ohm=0.015", 0.015),
    ] {
        let effects = vec![Hidden::parse(effect).unwrap()];
        let clutter = draw_clutter(&effects, vehicle.rotors.len(), &mut Stream::new(seed, "clutter"));
        let plan = FlightPlan {
            effects,
            clutter,
            ..FlightPlan::new(
                vehicle.clone(),
                Script::built_in("excitation", seed).unwrap(),
                60.0,
                seed,
            )
        };
        let order: Vec<usize> = (0..vehicle.rotors.len()).collect();
        let found = said(foreign_log(effect, &plan, &order).unwrap(), &model);
        check_missing(&found, &[(effect.split(':').next().unwrap(), size)]);
        excused += usize::from(found.sentence.contains("other constants which are off a little"));
    }
    assert!(excused > 0, "no error was left for the small errors to explain");
}

#[test]
fn val_arms_of_another_length_are_named_with_their_error() {
    let vehicle = Vehicle::load(&f550()).unwrap();
    let model = ModelVersion::load(f550()).unwrap();
    for (flight, seed, share) in [("excitation", 33, 0.1), ("waypoint", 34, -0.12)] {
        let hidden = format!("arm-length:share={share}");
        let found = said(flown(&vehicle, flight, seed, &[&hidden]), &model);
        check_missing(&found, &[("arm-length", share)]);
    }
}

#[test]
fn val_without_a_voltage_a_healthy_flight_lacks_nothing_and_an_effect_keeps_its_size() {
    let vehicle = Vehicle::load(&f550()).unwrap();
    let model = ModelVersion::load(f550()).unwrap();
    let unlogged = |flight: &str, seed: u64, effects: &[&str], others: &[&str]| {
        let mut log = flown(&vehicle, flight, seed, effects);
        for column in others.iter().chain(&["battery_voltage_v"]) {
            log.columns.remove(*column).unwrap();
        }
        log
    };
    let velocity = ["velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"];
    for (flight, seed, others) in [("excitation", 35, &velocity[..0]), ("waypoint", 36, &velocity[..])] {
        let found = said(unlogged(flight, seed, &[], others), &model);
        assert_eq!(found.verdict, Verdict::Agrees, "{}", found.sentence);
    }
    let found = said(
        unlogged("excitation", 37, &["rotor-drag:drag_n_s_m=0.25"], &velocity[..0]),
        &model,
    );
    check_missing(&found, &[("rotor-drag", 0.25)]);
}

#[test]
fn val_a_log_with_gaps_is_no_missing_physics() {
    let vehicle = Vehicle::load(&f550()).unwrap();
    let model = ModelVersion::load(f550()).unwrap();
    for (flight, seed) in [("excitation", 38), ("waypoint", 39)] {
        let log = flown(&vehicle, flight, seed, &[]);
        // A fifth of a second is lost every four.
        let kept = |time_s: f64| (time_s / 4.0).fract() < 0.95;
        let rows: Vec<usize> = (0..log.time_s.len()).filter(|&k| kept(log.time_s[k])).collect();
        let of = |values: &[f64]| rows.iter().map(|&k| values[k]).collect::<Vec<f64>>();
        let columns = log.columns.iter().map(|(name, values)| (name.clone(), of(values)));
        let log = FlightLog::from_columns(&log.name, of(&log.time_s), columns).unwrap();
        let found = said(log, &model);
        assert_eq!(found.verdict, Verdict::Agrees, "{}", found.sentence);
    }
}

/// Identified from one healthy flight, with a battery of another chart and capacity than those of its class.
#[test]
fn val_damage_after_the_flight_that_a_vehicle_was_identified_from_is_named_with_its_size() {
    let mut vehicle = Vehicle::load(&f550()).unwrap();
    (vehicle.mass, vehicle.inertia, vehicle.thrust_lag) = (1.72, [0.0325, 0.0281, 0.0560], 0.037);
    vehicle.capacity_ah *= 0.9;
    let (least, most) = (
        vehicle.open_circuit_voltage[0],
        *vehicle.open_circuit_voltage.last().unwrap(),
    );
    for voltage in &mut vehicle.open_circuit_voltage {
        // Bent towards a straight line by a tenth: 20 mV a cell in the middle.
        let charge = (*voltage - least) / (most - least);
        *voltage = least + (most - least) * charge.powf(0.9);
    }
    let request = Request {
        mass_kg: vehicle.mass,
        arm_m: 0.275,
        frame: Some("hexa-cw-x".to_owned()),
        trust_frame: false,
        capacity_ah: None,
        cells: None,
    };
    let healthy = flown(&vehicle, "excitation", 41, &[]);
    let written = files(&identify(std::slice::from_ref(&healthy), &request).unwrap(), "own");
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [
        ("own.toml", &written.vehicle),
        ("own.blades.toml", &written.blades),
        ("own.intervals.toml", &written.intervals),
    ] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let model = ModelVersion::load(folder.path().join("own.toml")).unwrap();
    let found = said(flown(&vehicle, "excitation", 42, &[]), &model);
    assert!(
        found.effects.is_empty() && found.sensor_or_timing.is_empty(),
        "{}",
        found.sentence
    );
    let found = said(
        flown(&vehicle, "excitation", 43, &["rotor-thrust-scale:rotor=2,share=-0.1"]),
        &model,
    );
    check_size(&found, "rotor-thrust-scale", -0.1);
    let found = said(
        flown(&vehicle, "excitation", 44, &["centre-of-mass:forward_m=0.006"]),
        &model,
    );
    check_size(&found, "centre-of-mass", 0.006);
}
