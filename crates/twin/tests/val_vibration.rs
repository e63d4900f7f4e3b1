//! Propellers out of balance in flights of the independent simulator, whose logs hold no rotor speed: it follows from
//! duty and voltage, and its scale from the lines in the accelerometer.

#![expect(clippy::unwrap_used, reason = "a refusal where none is due fails the test")]

mod foreign_log;

use std::f64::consts::TAU;
use std::path::Path;

use foreign_log::foreign_log;
use rotortwin_blind::flight::{FlightPlan, fly};
use rotortwin_blind::random::Stream;
use rotortwin_blind::script::Script;
use rotortwin_blind::vehicle::Vehicle;
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;
use rotortwin_twin::vibration::{change, vibration};

const SECONDS: f64 = 40.0;
/// Rows of the foreign simulator, s.
const STEP_S: f64 = 0.0025;
/// Thrust of a rotor over the square of its speed, N s²: not in the log.
const THRUST_COEFFICIENT: f64 = 8.2e-6;
/// Each rotor's own share of speed for the same thrust: propellers are not alike.
const OWN_SPEED: [f64; 6] = [0.012, -0.018, 0.004, 0.021, -0.009, -0.002];
/// Pull of a healthy rotor at 100 Hz, m/s².
const HEALTHY: [f64; 6] = [0.25, 0.15, 0.30, 0.20, 0.28, 0.18];

fn f550() -> (Vehicle, ModelVersion) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
    (Vehicle::load(&path).unwrap(), ModelVersion::load(&path).unwrap())
}

/// A flight whose accelerometer feels the rotors turn.
fn shaken(vehicle: &Vehicle, script: &str, seed: u64, amplitudes: &[f64; 6]) -> FlightLog {
    let plan = FlightPlan::new(vehicle.clone(), Script::built_in(script, seed).unwrap(), SECONDS, seed);
    let mut log = foreign_log(&format!("{script} {seed}"), &plan, &[0, 1, 2, 3, 4, 5]).unwrap();
    let (rows, _) = fly(&plan).unwrap();
    let mut draws = Stream::new(7, "the way from motor to sensor");
    for (rotor, amplitude) in amplitudes.iter().enumerate() {
        let way: Vec<(f64, f64)> = (0..3).map(|_| (draws.normal(), draws.between(0.0, TAU))).collect();
        let size = way.iter().map(|(share, _)| share * share).sum::<f64>().sqrt();
        let (mut thrust, mut angle) = (vehicle.hover_thrust(), draws.between(0.0, TAU));
        for (k, row) in rows.iter().enumerate() {
            let target = vehicle.static_thrust(row.duties[rotor], row.voltage);
            thrust += (target - thrust) * (1.0 - (-STEP_S / vehicle.thrust_lag).exp());
            let speed = (thrust.max(0.01) / THRUST_COEFFICIENT).sqrt() * (1.0 + OWN_SPEED[rotor]);
            angle += speed * STEP_S;
            let pull = amplitude * (speed / (TAU * 100.0)).powi(2);
            for (axis, (share, lag)) in ["accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"].iter().zip(&way) {
                log.columns.get_mut(*axis).unwrap()[k] += pull * share / size * (angle + lag).cos();
            }
        }
    }
    log
}

#[test]
fn val_rotor_speeds_are_found_from_duty_voltage_and_the_lines() {
    let (vehicle, model) = f550();
    let hover_hz = (vehicle.hover_thrust() / THRUST_COEFFICIENT).sqrt() / TAU;
    let found = vibration(&shaken(&vehicle, "excitation", 3, &HEALTHY), Some(&model)).unwrap();
    assert!(
        (found.reference_hz / hover_hz - 1.0).abs() < 0.03,
        "{} of {hover_hz}",
        found.reference_hz
    );
}

#[test]
fn val_a_propeller_out_of_balance_is_named_without_rotor_speeds() {
    let (vehicle, model) = f550();
    let healthy: Vec<FlightLog> = (20..24)
        .map(|seed| shaken(&vehicle, "excitation", seed, &HEALTHY))
        .collect();
    let (mut right, mut wrong, mut alarms) = (0, 0, 0);
    for rotor in 0..6 {
        let mut damaged = HEALTHY;
        damaged[rotor] *= 4.0;
        let seed = 40 + rotor as u64;
        let found = change(
            &[shaken(&vehicle, "excitation", seed, &damaged)],
            &healthy,
            Some(&model),
        )
        .unwrap();
        println!(
            "rotor {}: {} {:?}",
            rotor + 1,
            found.sentence,
            found.flights[0].strongest
        );
        right += usize::from(found.named.len() == 1 && found.named[0].rotor == Some(rotor + 1));
        wrong += usize::from(found.named.iter().any(|one| one.rotor != Some(rotor + 1)));
        let quiet = change(
            &[shaken(&vehicle, "excitation", seed + 20, &HEALTHY)],
            &healthy,
            Some(&model),
        )
        .unwrap();
        println!("none: {} {:?}", quiet.sentence, quiet.together);
        alarms += usize::from(!quiet.named.is_empty());
    }
    assert_eq!((wrong, alarms), (0, 0));
    // Rotors 2, 4 and 6 were the quietest: four times of little is not twice of all.
    assert!(right >= 3, "{right} of 6");
}

#[test]
fn val_in_a_hover_the_rotors_shake_more_and_none_is_named() {
    let (vehicle, model) = f550();
    let healthy: Vec<FlightLog> = (20..24).map(|seed| shaken(&vehicle, "hover", seed, &HEALTHY)).collect();
    let mut damaged = HEALTHY;
    damaged[2] *= 4.0;
    let found = change(&[shaken(&vehicle, "hover", 50, &damaged)], &healthy, Some(&model)).unwrap();
    assert!(found.named.is_empty(), "{}", found.sentence);
    assert!(
        found.sentence.contains("these flights do not show which of them"),
        "{}",
        found.sentence
    );
}
