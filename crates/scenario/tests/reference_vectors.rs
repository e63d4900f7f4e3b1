//! The plant's equations and the closed loop compared with reference vectors of an independent implementation in f64.
#![expect(clippy::unwrap_used, reason = "a test that cannot read its vectors has failed")]

use std::path::PathBuf;

use rotortwin_flight_core::control::Controller;
use rotortwin_plant::powertrain::battery::Battery;
use rotortwin_plant::vehicle::model::Layout;
use rotortwin_scenario::Scenario;

/// Relative, from the vectors' README; values below 1 N count absolutely, since Eq. 19 cancels near 7 % duty.
const LIFT_TOLERANCE: f64 = 1e-12;
/// From the vectors' README: the duty comes from a bisection.
const LIFT_INVERSE_TOLERANCE: f64 = 1e-9;
/// Relative, from the vectors' README.
const BATTERY_TOLERANCE: f64 = 1e-12;
/// From the vectors' README.
const GEOMETRY_TOLERANCE: f64 = 1e-14;
/// Position m, velocity m/s, attitude rad, body rates rad/s, thrust N over 12 s of flight. Controller and signals are f32: a
/// position of 6 m has a resolution of 2e-7 m and drives duties through gains of up to 242, so 1e-6 (the f64 tolerance) is out of
/// reach.
const CLOSED_LOOP_TOLERANCE: [f64; 5] = [5e-6, 5e-6, 5e-7, 2e-6, 5e-6];

fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

fn vector(name: &str) -> String {
    std::fs::read_to_string(root().join("tests/vectors").join(name)).unwrap()
}

fn rows(name: &str) -> Vec<Vec<f64>> {
    vector(name)
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|x| x.parse().unwrap()).collect())
        .collect()
}

fn reference_flight() -> Scenario {
    Scenario::load(root().join("config/scenarios/reference-flight.toml")).unwrap()
}

#[test]
fn val_lift_of_every_blade() {
    let scenario = reference_flight();
    let text = vector("lift.csv");
    let mut count = 0;
    for line in text.lines().skip(1) {
        let (name, numbers) = line.split_once(',').unwrap();
        let numbers: Vec<f64> = numbers.split(',').map(|x| x.parse().unwrap()).collect();
        let [voltage, duty, raw, clipped] = numbers[..] else {
            panic!("four numbers in {line}")
        };
        let blade = scenario.blades().blade[name];
        let got_raw = (voltage - blade.voltage_offset_v) * blade.raw_lift_per_volt(duty);
        let got = blade.lift(duty, voltage);
        assert!(
            (got_raw - raw).abs() <= LIFT_TOLERANCE * raw.abs().max(1.0),
            "{line}: {got_raw}"
        );
        assert!(
            (got - clipped).abs() <= LIFT_TOLERANCE * clipped.abs().max(1.0),
            "{line}: {got}"
        );
        count += 1;
    }
    assert!(count > 100, "only {count} rows");
}

#[test]
fn val_lift_inverse() {
    let scenario = reference_flight();
    for row in rows("lift_inverse.csv") {
        let got = scenario.nominal_blade().duty(row[0], row[1]).unwrap();
        assert!((got - row[2]).abs() < LIFT_INVERSE_TOLERANCE, "{row:?}: {got}");
    }
}

#[test]
fn val_battery() {
    let scenario = reference_flight();
    let battery = Battery::new(&scenario.vehicle().battery);
    for row in rows("battery.csv") {
        let [charge, thrust, open, terminal, current] = row[..] else {
            panic!("five numbers in {row:?}")
        };
        let power = battery.power_coefficient() * 6.0 * thrust * thrust.sqrt();
        let got = battery.output(charge, power);
        for (got, expected) in [
            (got.open_circuit_voltage, open),
            (got.battery_voltage, terminal),
            (got.battery_current, current),
        ] {
            assert!(
                (got - expected).abs() <= BATTERY_TOLERANCE * expected.abs().max(1.0),
                "{row:?}: {got}"
            );
        }
    }
}

#[test]
fn val_control_effectiveness() {
    let vectors: serde_json::Value = serde_json::from_str(&vector("geometry.json")).unwrap();
    let regular_x = |rotors| Layout::RegularX {
        rotors,
        arm_length_m: 0.275,
        moment_ratio_m: 0.016,
    };
    let plus = Layout::RegularPlus {
        rotors: 6,
        arm_length_m: 0.275,
        moment_ratio_m: 0.016,
    };
    for (name, layout) in [
        ("hexa_x", regular_x(6)),
        ("hexa_plus", plus),
        ("quad_x", regular_x(4)),
        ("octo_x", regular_x(8)),
    ] {
        let effectiveness = &vectors[name]["F"];
        for (i, placement) in layout.placements().iter().enumerate() {
            for (row, got) in placement.torque_arm([0.0; 3], 1.0).into_iter().enumerate() {
                let expected = effectiveness[3 + row][i].as_f64().unwrap();
                assert!(
                    (got - expected).abs() <= GEOMETRY_TOLERANCE,
                    "{name} F[{}][{i}]: {got}, {expected}",
                    3 + row
                );
            }
        }
    }
}

#[test]
fn val_closed_loop() {
    const SCENARIO: &str = r#"
name = "closed-loop"
description = "tests/vectors/closed_loop.csv"
vehicle = "../vehicles/f550.toml"
duration_s = 12.0
[trajectory]
kind = "helix"
radius_m = 2.0
turn_s = 15.0
start_height_m = 5.0
climb_amplitude_m = 1.5
climb_period_s = 45.0
yaw_amplitude_rad = 0.3
yaw_period_s = 30.0
[mismatch]
preset = "none"
[sensors]
position_noise_m = 0.0
velocity_noise_m_s = 0.0
attitude_noise_rad = 0.0
body_rates_noise_rad_s = 0.0
[[fault]]
time_s = 6.0
rotor = 3
blade = "b"
"#;
    let scenario = Scenario::parse(SCENARIO, root().join("config/scenarios")).unwrap();
    let mut sim = scenario.simulation(1).unwrap();
    let mut controller = Controller::new(scenario.controller_config()).unwrap();
    controller.trim(sim.hover_duty(), sim.sense().battery_voltage);
    let mut worst = [0.0_f64; 5];
    for row in rows("closed_loop.csv") {
        let step = (row[0] * 400.0).round() as u64;
        while sim.step() < step {
            let sample = sim.sense();
            let output = controller.step(&sample.nav, &sample.reference, sample.battery_voltage);
            sim.advance(&output.command).unwrap();
        }
        let truth = sim.truth();
        let groups: [&[f64]; 5] = [
            &truth.position_ned_m,
            &truth.velocity_ned_m_s,
            &truth.attitude_rad,
            &truth.body_rates_rad_s,
            &truth.rotor_thrust_n[..6],
        ];
        let mut column = 1;
        for (worst, group) in worst.iter_mut().zip(groups) {
            for got in group {
                *worst = worst.max((got - row[column]).abs());
                column += 1;
            }
        }
    }
    println!("largest differences: {worst:?}");
    for (worst, tolerance) in worst.iter().zip(CLOSED_LOOP_TOLERANCE) {
        assert!(
            *worst < tolerance,
            "largest differences {worst:e}, tolerances {CLOSED_LOOP_TOLERANCE:?}"
        );
    }
}
