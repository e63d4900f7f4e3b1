//! The plant against the open-loop reference vector: 2 s of a tumbling vehicle, from an independent implementation in f64.

use std::f64::consts::PI;
use std::path::Path;

use rotortwin_flight_core::MAX_ROTORS;

use crate::body::rigid_body::{Quaternion, RigidBodyState};
use crate::config::SimulationConfig;
use crate::nearest_step;
use crate::powertrain::faults::FaultEntry;
use crate::simulation::Simulation;
use crate::state::PlantState;
use crate::testing::{faults, hover, preset};
use crate::vehicle::mismatch::MismatchPreset;

/// The vector's own tolerance: its source reaches 6e-9 with one Runge–Kutta step per sample.
const OPEN_LOOP_TOLERANCE: f64 = 1e-8;
/// With 40 substeps the method is exact to 3e-13 and what remains is the rounding of the printed vector, 5e-12.
const OPEN_LOOP_CONVERGED: f64 = 1e-11;

/// The scenario of the vector: nothing but blade b on rotor 3 from 1 s on.
fn flight(substeps: u32) -> SimulationConfig {
    let mut config = SimulationConfig {
        duration_steps: nearest_step(2.0),
        integrator_substeps: substeps,
        mismatch: preset(MismatchPreset::None),
        ..hover()
    };
    let blade = FaultEntry {
        time_s: 1.0,
        rotor: 3,
        blade: Some("b".to_owned()),
        ..FaultEntry::default()
    };
    config.faults = faults(&config, &[blade]);
    config
}

/// Largest difference from the vector over all columns, angles modulo a turn.
fn worst_difference(substeps: u32) -> f64 {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut sim = Simulation::new(&flight(substeps), 1).unwrap();
    let mut thrust = [0.0; MAX_ROTORS];
    thrust[..6].copy_from_slice(&[2.50, 2.55, 2.60, 2.45, 2.50, 2.40]);
    let bias = [0.005, -0.003, 0.008, -0.010, 0.002, 0.0];
    sim.set_state(PlantState {
        body: RigidBodyState {
            position_ned: [1.0, -2.0, -5.0],
            velocity_ned: [0.5, -0.3, 0.2],
            ned_from_body: Quaternion::from_euler([0.05, -0.04, 0.3]),
            body_rates: [0.1, -0.2, 0.15],
        },
        thrust,
        state_of_charge: 0.9,
    });
    sim.set_rotor_bias(&bias);

    let vector = std::fs::read_to_string(root.join("tests/vectors/open_loop.csv")).unwrap();
    let mut worst: f64 = 0.0;
    let mut rows = 0;
    for line in vector.lines().skip(1) {
        let row: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        let step = (row[0] * 400.0).round() as u64;
        while sim.step() < step {
            let t = sim.step() as f64 / 400.0;
            let mut duty = [0.0; MAX_ROTORS];
            for (i, u) in duty[..6].iter_mut().enumerate() {
                let i = i as f64;
                *u = 0.375 + 0.02 * (2.0 * PI * (0.5 + 0.25 * i) * t + i).sin();
            }
            sim.advance_duty(&duty).unwrap();
        }
        let truth = sim.truth();
        let mut got = Vec::with_capacity(row.len());
        got.extend(truth.position_ned_m);
        got.extend(truth.velocity_ned_m_s);
        got.extend(truth.attitude_rad);
        got.extend(truth.body_rates_rad_s);
        got.extend(&truth.rotor_thrust_n[..6]);
        got.extend([truth.state_of_charge, truth.battery_voltage_v, truth.battery_current_a]);
        for (column, (got, expected)) in got.iter().zip(&row[1..]).enumerate() {
            let mut difference = got - expected;
            if (6..9).contains(&column) {
                difference -= 2.0 * PI * (difference / (2.0 * PI)).round();
            }
            worst = worst.max(difference.abs());
        }
        rows += 1;
    }
    assert_eq!(rows, 41, "0 s to 2 s, every 20 samples");
    worst
}

#[test]
fn val_open_loop_with_one_substep() {
    let worst = worst_difference(1);
    assert!(worst < OPEN_LOOP_TOLERANCE, "worst difference {worst:e}");
}

#[test]
fn val_open_loop_converged() {
    let worst = worst_difference(40);
    assert!(worst < OPEN_LOOP_CONVERGED, "worst difference {worst:e}");
}

#[test]
fn val_open_loop_is_of_fourth_order() {
    let (one, two) = (worst_difference(1), worst_difference(2));
    // Order 4 gives a factor of 16; the knots of the voltage chart and rounding leave it a little less sharp.
    assert!(
        one / two > 10.0,
        "halving the step shrinks the error only from {one:e} to {two:e}"
    );
}
