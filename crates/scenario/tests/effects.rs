//! Flights with effects: the step with effects compared with the step without, every effect in flight, rejections.

use std::path::{Path, PathBuf};

use rotortwin_flight_core::control::Controller;
use rotortwin_plant::TruthSample;
use rotortwin_plant::effects::{ParameterKind, catalogue};
use rotortwin_scenario::Scenario;

/// Both steps integrate the same equations in another order of operations, closed loop, 4 s, noise of Table 4: rounding grows with
/// the flight; 1e-9 m is three orders below the sensors' f32.
const SAME_FLIGHT: f64 = 1e-7;

fn config() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/scenarios")
}

/// A fast circle with yaw turns, climbs and steep descents near the ground.
fn text(duration_s: f64, rest: &str) -> String {
    format!(
        r#"
name = "effects"
description = "test"
vehicle = "../vehicles/f550.toml"
duration_s = {duration_s}
[controller]
thrust_to_duty = "inverse-map"
[trajectory]
kind = "helix"
radius_m = 2.0
turn_s = 5.0
start_height_m = 0.2
climb_amplitude_m = 2.2
climb_period_s = 4.0
yaw_amplitude_rad = 1.0
yaw_period_s = 3.0
{rest}
"#
    )
}

fn fly(text: &str) -> Vec<TruthSample> {
    let scenario = Scenario::parse(text, config()).unwrap_or_else(|error| panic!("{error}\n{text}"));
    let mut sim = scenario.simulation(3).expect("the scenario was checked");
    let mut controller = Controller::new(scenario.controller_config()).expect("the scenario was checked");
    controller.trim(sim.hover_duty(), sim.sense().battery_voltage);
    let mut samples = vec![*sim.truth()];
    while !sim.done() {
        let sample = sim.sense();
        let output = controller.step(&sample.nav, &sample.reference, sample.battery_voltage);
        sim.advance(&output.command).expect("duties are finite");
        samples.push(*sim.truth());
    }
    samples
}

fn distance(a: &TruthSample, b: &TruthSample) -> f64 {
    (0..3)
        .map(|i| (a.position_ned_m[i] - b.position_ned_m[i]).abs())
        .fold(0.0, f64::max)
}

#[test]
fn val_step_with_effects_is_the_step_without_until_the_onset() {
    let vehicle = "[mismatch]\npreset = \"realistic\"\n[wind]\nmean_ned_m_s = [2.0, 0.0, 0.0]\ngust_rms_m_s = 0.5\n[[fault]]\ntime_s = 1.0\nrotor = 3\nblade = \"b\"\n";
    let without = fly(&text(4.0, vehicle));
    let late = "[[effect]]\neffect = \"mass\"\nonset_s = 3.0\nparameters = { share = 0.2 }\n";
    let with = fly(&text(4.0, &format!("{vehicle}{late}")));
    for (a, b) in without.iter().zip(&with).take(1200) {
        assert!(distance(a, b) < SAME_FLIGHT, "step {}: {}", a.step, distance(a, b));
        assert!((a.battery_voltage_v - b.battery_voltage_v).abs() < SAME_FLIGHT);
    }
    let end = distance(without.last().unwrap(), with.last().unwrap());
    assert!(end > 0.01, "the mass must show after its onset, moved {end} m");
}

#[test]
fn scenario_every_effect_flies_and_changes_the_flight() {
    let base = fly(&text(4.0, ""));
    let sensed_only = [
        "accelerometer-bias",
        "accelerometer-scale",
        "imu-lever-arm",
        "vibration-rectification",
    ];
    for entry in catalogue() {
        let mut values = Vec::new();
        for p in entry.parameters {
            let value = match (p.kind, p.name) {
                (ParameterKind::Shape, "partner") => 2.0,
                // Ceiling and wall are in the flight path.
                (ParameterKind::Shape, "height_m") => 1.0,
                (ParameterKind::Shape, "distance_m") => 0.5,
                // The flight needs little of its duty range: use a saturation that it reaches.
                (ParameterKind::Size, "lost_duty") => 0.55,
                // Swapped or reversed rotors crash the vehicle within a second; a fraction of them flies.
                (ParameterKind::Size, "share") if entry.catalogue_number == Some(35) => 0.1,
                _ => p.typical,
            };
            values.push(format!("{} = {value}", p.name));
        }
        let rotor = if entry.per_rotor { "rotor = 1\n" } else { "" };
        let drag = if entry.needs.is_empty() {
            ""
        } else {
            "[[effect]]\neffect = \"rotor-drag\"\nparameters = { drag_n_s_m = 0.25 }\n"
        };
        let ground = if entry.id == "ground-effect" {
            "[ground]\ndown_m = 0.0\n"
        } else {
            ""
        };
        let effect = format!(
            "{ground}{drag}[[effect]]\neffect = \"{}\"\n{rotor}parameters = {{ {} }}\n",
            entry.id,
            values.join(", ")
        );
        let flown = fly(&text(4.0, &effect));
        assert!(
            flown.iter().all(|s| s.position_ned_m.iter().all(|x| x.is_finite())),
            "{}",
            entry.id
        );
        let far = base.iter().zip(&flown).map(|(a, b)| distance(a, b)).fold(0.0, f64::max);
        let volts = base
            .iter()
            .zip(&flown)
            .map(|(a, b)| (a.battery_voltage_v - b.battery_voltage_v).abs())
            .fold(0.0, f64::max);
        if sensed_only.contains(&entry.id) {
            assert!(
                far < SAME_FLIGHT,
                "{}: no algorithm has the accelerometer, moved {far} m",
                entry.id
            );
        } else {
            assert!(far > 1e-6 || volts > 1e-4, "{}: moved {far} m, {volts} V", entry.id);
        }
    }
}

#[test]
fn val_refusals_name_key_and_reason() {
    let cases = [
        ("effect = \"rotor-drug\"", "effect[0].effect", "nearest: rotor-drag"),
        (
            "effect = \"mass\"\nparameters = { drag = 1.0 }",
            "effect[0].parameters.drag",
            "it has share",
        ),
        (
            "effect = \"mass\"\nparameters = { share = 40.0 }",
            "effect[0].parameters.share",
            "expected a number from -3 to 3",
        ),
        (
            "effect = \"mass\"\nparameters = { share = -2.0 }",
            "effect",
            "mass above 0",
        ),
        ("effect = \"mass\"", "effect[0].parameters", "cannot have an effect"),
        (
            "effect = \"mass\"\nrotor = 2\nparameters = { share = 0.1 }",
            "effect[0].rotor",
            "whole vehicle",
        ),
        (
            "effect = \"rotor-thrust-scale\"\nparameters = { share = -0.1 }",
            "effect[0].rotor",
            "from 1 to 6",
        ),
        (
            "effect = \"rotor-thrust-scale\"\nrotor = 7\nparameters = { share = -0.1 }",
            "effect[0].rotor",
            "got 7",
        ),
        (
            "effect = \"mass\"\nonset_s = 9.0\nparameters = { share = 0.1 }",
            "effect[0].onset_s",
            "the flight ends at 3 s",
        ),
        (
            "effect = \"wind\"\nparameters = { north_m_s = 2.0 }",
            "effect[0].effect",
            "add one of rotor-drag",
        ),
        (
            "effect = \"ground-effect\"\nparameters = { strength = 1.0 }",
            "effect[0].effect",
            "ground.down_m",
        ),
        (
            "effect = \"swapped-rotors\"\nrotor = 2\nparameters = { share = 1.0, partner = 2.0 }",
            "effect[0].parameters.partner",
            "another rotor",
        ),
    ];
    for (effect, key, reason) in cases {
        let error = Scenario::parse(&text(3.0, &format!("[[effect]]\n{effect}\n")), config()).expect_err(effect);
        assert_eq!(error.key(), Some(key), "{error}");
        assert!(error.reason().contains(reason), "{error}");
        assert!(error.line().is_some(), "{error}");
    }
}

#[test]
fn prop_accelerometer_leaves_the_flight_alone() {
    let scenario = Scenario::parse(&text(1.0, ""), config()).unwrap();
    let duty = [0.4_f32; rotortwin_flight_core::MAX_ROTORS];
    let run = |record: bool| {
        let mut sim = scenario.simulation(7).unwrap();
        if record {
            sim.record_accelerometer(&scenario.document().sensors, 7);
        }
        let mut samples = Vec::new();
        while !sim.done() {
            samples.push(sim.sense());
            let command = rotortwin_flight_core::signals::MotorCommand { duty };
            sim.advance(&command).unwrap();
        }
        samples
    };
    let (with, without) = (run(true), run(false));
    for (a, b) in with.iter().zip(&without) {
        assert_eq!(a.nav, b.nav);
        assert!(a.specific_force_m_s2.is_some() && b.specific_force_m_s2.is_none());
    }
}

#[test]
fn regress_page_is_up_to_date() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/effects.md");
    let page = std::fs::read_to_string(path).unwrap_or_default();
    assert!(
        page == rotortwin_plant::effects::page(),
        "docs/effects.md is out of date: rotortwin effects --page > docs/effects.md"
    );
}

#[test]
fn scenario_effect_of_a_user_flies_like_the_built_in_one() {
    let own = fly(&text(
        2.0,
        "[[effect]]\neffect = \"fin-drag\"\nparameters = { drag_kg_m = 0.02 }\n",
    )
    .replace(
        "description",
        "effect_files = [\"../effects/fin-drag.toml\"]\ndescription",
    ));
    let base = fly(&text(2.0, ""));
    assert!(distance(own.last().unwrap(), base.last().unwrap()) > 1e-3);
}
