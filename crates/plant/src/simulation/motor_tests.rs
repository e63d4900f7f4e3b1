//! Flights of a vehicle whose rotors are turned by ESCs and motors (`[rotors.motor]`).

use rotortwin_flight_core::MAX_ROTORS;

use super::Simulation;
use crate::config::SimulationConfig;
use crate::effects::EffectInstance;
use crate::powertrain::faults::FaultEntry;
use crate::powertrain::motor::MotorModel;
use crate::testing::{faults, hover, preset, vehicle};
use crate::vehicle::mismatch::MismatchPreset;

fn config() -> SimulationConfig {
    SimulationConfig {
        vehicle: vehicle("f550-motors"),
        mismatch: preset(MismatchPreset::None),
        ..hover()
    }
}

fn hover_duty(simulation: &Simulation) -> [f64; MAX_ROTORS] {
    [f64::from(simulation.hover_duty()); MAX_ROTORS]
}

#[test]
fn val_a_trimmed_hover_stays() {
    let config = config();
    let mut simulation = Simulation::new(&config, 1).unwrap();
    let duty = hover_duty(&simulation);
    for _ in 0..400 {
        simulation.advance_duty(&duty).unwrap();
    }
    let truth = simulation.truth();
    let weight = 1.55 * 9.81 / 6.0;
    // The duty is an f32, and the charge falls by 0.03 % a second.
    assert!((truth.rotor_thrust_n[2] - weight).abs() < 2e-3, "{truth:?}");
    assert!(truth.velocity_ned_m_s[2].abs() < 1e-2, "{truth:?}");
}

#[test]
fn val_the_battery_gives_what_the_motors_take() {
    let simulation = Simulation::new(&config(), 1).unwrap();
    let truth = *simulation.truth();
    let (motor, duty) = (MotorModel::AIR_GEAR_350, f64::from(simulation.hover_duty()));
    // K (I − I₀) = μ f, and the ESC passes on u I.
    let back_emf = 60.0 / (2.0 * std::f64::consts::PI * 920.0);
    let current = 0.016 * (1.55 * 9.81 / 6.0) / back_emf + motor.idle_current_a;
    let drawn = 6.0 * duty * current;
    assert!((truth.battery_current_a - drawn).abs() < 1e-4, "{truth:?} {drawn}");
    let drop = truth.open_circuit_voltage_v - truth.battery_voltage_v;
    assert!((drop - 0.010 * drawn).abs() < 1e-6);
}

#[test]
fn val_a_rotor_that_breaks_lifts_less_at_once_and_then_turns_faster() {
    let base = config();
    let entry = FaultEntry {
        time_s: 0.5,
        rotor: 2,
        thrust_loss_percent: Some(20.0),
        ..FaultEntry::default()
    };
    let config = SimulationConfig {
        faults: faults(&base, &[entry]),
        ..base
    };
    let mut simulation = Simulation::new(&config, 1).unwrap();
    let duty = hover_duty(&simulation);
    let thrust = |simulation: &Simulation| simulation.truth().rotor_thrust_n[1];
    for _ in 0..200 {
        simulation.advance_duty(&duty).unwrap();
    }
    let before = thrust(&simulation);
    simulation.advance_duty(&duty).unwrap();
    // No lag between a blade that breaks and its lift: in 2.5 ms the speed has moved by little.
    let at_once = thrust(&simulation);
    assert!((at_once / before - 0.8).abs() < 0.005, "{before} {at_once}");
    for _ in 0..100 {
        simulation.advance_duty(&duty).unwrap();
    }
    // Less load on the same duty: the speed rises until the motor is in balance again.
    let later = thrust(&simulation);
    assert!(
        later > 1.02 * at_once && later < 0.9 * before,
        "{before} {at_once} {later}"
    );
}

#[test]
fn val_blades_that_drag_slow_their_motor_and_cost_current() {
    let flown = |entries: &[FaultEntry]| {
        let base = config();
        let config = SimulationConfig {
            faults: faults(&base, entries),
            ..base
        };
        let mut simulation = Simulation::new(&config, 1).unwrap();
        let duty = hover_duty(&simulation);
        for _ in 0..300 {
            simulation.advance_duty(&duty).unwrap();
        }
        *simulation.truth()
    };
    let drags = FaultEntry {
        time_s: 0.1,
        rotor: 2,
        moment_ratio_change_percent: Some(30.0),
        ..FaultEntry::default()
    };
    let (healthy, worn) = (flown(&[]), flown(&[drags]));
    let share = worn.rotor_thrust_n[1] / healthy.rotor_thrust_n[1];
    assert!((0.7..0.97).contains(&share), "{share}");
    assert!(worn.battery_current_a > healthy.battery_current_a + 0.02, "{worn:?}");
}

#[test]
fn val_a_rotor_that_speeds_up_turns_the_vehicle() {
    let config = config();
    let mut simulation = Simulation::new(&config, 1).unwrap();
    let mut duty = hover_duty(&simulation);
    // Odd rotors turn counter-clockwise: they speed up and push the nose to the right, at first by their inertia alone.
    for (i, duty) in duty.iter_mut().take(6).enumerate() {
        *duty += if i % 2 == 0 { 0.02 } else { -0.02 };
    }
    simulation.advance_duty(&duty).unwrap();
    let yaw = simulation.truth().body_rates_rad_s[2];
    let motor = MotorModel::AIR_GEAR_350;
    let back_emf = 60.0 / (2.0 * std::f64::consts::PI * 920.0);
    let voltage = simulation.truth().battery_voltage_v;
    // J Ω' = K Δu V/R at the first instant, six rotors against J_z.
    let torque = 6.0 * back_emf * 0.02 * voltage / motor.winding_resistance_ohm;
    let expected = torque / 0.0498 * 0.0025;
    assert!((yaw / expected - 1.0).abs() < 0.05, "{yaw} {expected}");
}

#[test]
fn val_an_empty_battery_lets_the_rotors_run_down() {
    let config = SimulationConfig {
        state_of_charge: 0.0101,
        duration_steps: crate::nearest_step(60.0),
        ..config()
    };
    let mut simulation = Simulation::new(&config, 1).unwrap();
    let duty = [0.9; MAX_ROTORS];
    for _ in 0..8000 {
        if simulation.advance_duty(&duty).is_err() || simulation.truth().battery_voltage_v < 0.1 {
            break;
        }
    }
    for _ in 0..1200 {
        if simulation.advance_duty(&duty).is_err() {
            break;
        }
    }
    assert!(simulation.truth().battery_voltage_v < 0.1, "the battery is cut off");
    let thrust = simulation.truth().rotor_thrust_n[0];
    assert!((0.0..0.05).contains(&thrust), "{thrust}");
}

#[test]
fn val_what_a_motor_has_not_is_refused() {
    let with = |id: &str, share: f64| {
        let config = SimulationConfig {
            effects: vec![EffectInstance::new(id, &[("share", share)])],
            ..config()
        };
        Simulation::new(&config, 1)
    };
    for id in ["lag-asymmetry", "speed-domain-lag"] {
        let refusal = with(id, 0.3).unwrap_err();
        assert_eq!(refusal.key, "effect[0]", "{refusal}");
        assert!(
            refusal.reason.contains(id) && refusal.reason.contains("rotors.motor"),
            "{refusal}"
        );
    }
    with("motor-time-constant", 0.3).unwrap();
}

#[test]
fn val_a_motor_too_weak_for_the_vehicle_is_refused() {
    let mut config = config();
    config.vehicle.rotors.motor = Some(MotorModel {
        winding_resistance_ohm: 9.0,
        ..MotorModel::AIR_GEAR_350
    });
    let refusal = Simulation::new(&config, 1).unwrap_err();
    assert_eq!(refusal.key, "vehicle.rotors.motor");
    config.vehicle.rotors.motor = Some(MotorModel {
        inertia_kg_m2: 1e-7,
        ..MotorModel::AIR_GEAR_350
    });
    let refusal = Simulation::new(&config, 1).unwrap_err();
    assert!(refusal.reason.contains("0.005"), "{refusal}");
}
