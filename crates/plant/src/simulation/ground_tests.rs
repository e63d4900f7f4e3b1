//! The ground against closed-form answers: rest, drop, slope, lift-off, landing, smaller steps; quad, hexa and octo.

use rotortwin_flight_core::MAX_ROTORS;

use super::Simulation;
use crate::body::ground::{GroundContact, GroundEvent};
use crate::body::rigid_body::{Quaternion, RigidBodyState};
use crate::config::SimulationConfig;
use crate::nearest_step;
use crate::testing::{blades, hover, preset, vehicle_on_skids};
use crate::vehicle::mismatch::MismatchPreset;

const VEHICLES: [&str; 3] = ["quad-x", "f550", "octo-x"];

/// A vehicle on flat ground at z = 0, exactly its document.
fn standing(name: &str) -> SimulationConfig {
    let vehicle = vehicle_on_skids(name);
    SimulationConfig {
        nominal_blade: blades(&vehicle).blade[&vehicle.rotors.nominal_blade],
        vehicle,
        duration_steps: nearest_step(100.0),
        mismatch: preset(MismatchPreset::None),
        ground_down_m: Some(0.0),
        ground_contact: Some(GroundContact::default()),
        starts_on_ground: true,
        starts_trimmed: false,
        ..hover()
    }
}

fn flight(config: &SimulationConfig) -> Simulation {
    Simulation::new(config, 1).unwrap()
}

/// The same flight from another state of the body, in the air.
fn from(config: &SimulationConfig, change: impl Fn(&mut RigidBodyState)) -> Simulation {
    let mut sim = flight(&SimulationConfig {
        starts_on_ground: false,
        ..config.clone()
    });
    let mut state = *sim.state();
    change(&mut state.body);
    sim.set_state(state);
    sim
}

fn step(sim: &mut Simulation) {
    sim.advance_duty(&[0.0; MAX_ROTORS]).unwrap();
}

/// Kinetic and potential energy and that of the feet, J.
fn energy(sim: &Simulation, config: &SimulationConfig) -> f64 {
    let body = &sim.state().body;
    let square = |v: [f64; 3], w: [f64; 3]| (0..3).map(|i| w[i] * v[i] * v[i]).sum::<f64>();
    let m = config.vehicle.body.mass_kg;
    let kinetic = square(body.velocity_ned, [m; 3]) + square(body.body_rates, config.vehicle.body.inertia_body_kg_m2);
    let contact = sim.contact.as_ref().unwrap();
    0.5 * kinetic - m * config.vehicle.body.gravity_m_s2 * body.position_ned[2] + contact.elastic_energy(body)
}

#[test]
fn val_at_rest_nothing_creeps_and_the_accelerometer_shows_minus_g() {
    for name in VEHICLES {
        let config = standing(name);
        let mut sim = flight(&config);
        let begin = *sim.truth();
        for _ in 0..nearest_step(60.0) {
            step(&mut sim);
        }
        let end = sim.truth();
        for axis in 0..3 {
            let moved = (end.position_ned_m[axis] - begin.position_ned_m[axis]).abs();
            let turned = (end.attitude_rad[axis] - begin.attitude_rad[axis]).abs().to_degrees();
            assert!(moved < 1e-4, "{name}: {moved} m along axis {axis}");
            assert!(turned < 0.01, "{name}: {turned}° about axis {axis}");
        }
        let force = sim.specific_force();
        let g = config.vehicle.body.gravity_m_s2;
        for (axis, expected) in [0.0, 0.0, -g].into_iter().enumerate() {
            assert!((force[axis] - expected).abs() < 1e-6, "{name}: {force:?}");
        }
        assert!(sim.take_ground_events().is_empty());
    }
}

#[test]
fn val_at_rest_the_feet_sink_as_deep_as_the_document_says() {
    let config = standing("f550");
    let sim = flight(&config);
    // Feet 0.18 m below the centre of mass, 1 mm in the ground.
    assert!((sim.truth().position_ned_m[2] + 0.179).abs() < 1e-9);
}

#[test]
fn val_a_drop_gains_no_energy_and_settles_within_a_second() {
    for name in VEHICLES {
        for tilt in [0.0, 0.2] {
            let config = standing(name);
            let rest = flight(&config).truth().position_ned_m[2];
            let mut sim = from(&config, |body| {
                body.position_ned = [0.0, 0.0, rest - 0.5];
                body.ned_from_body = Quaternion::from_euler([tilt, 0.5 * tilt, 0.0]);
            });
            let scale = energy(&sim, &config) - energy(&flight(&config), &config);
            let mut last = energy(&sim, &config);
            for _ in 0..nearest_step(1.32) {
                step(&mut sim);
                let now = energy(&sim, &config);
                assert!(
                    now < last + 1e-6 * scale,
                    "{name}, {tilt} rad: {} J gained at step {}",
                    now - last,
                    sim.step()
                );
                last = now;
            }
            // Down after √(2 h/g) = 0.32 s; a second later it stands.
            let truth = sim.truth();
            let fast = truth.velocity_ned_m_s.iter().chain(&truth.body_rates_rad_s);
            assert!(fast.clone().all(|v| v.abs() < 1e-2), "{name}, {tilt} rad: {truth:?}");
            assert!((truth.position_ned_m[2] - rest).abs() < 1e-3, "{name}: {truth:?}");
        }
    }
}

#[test]
fn val_a_drop_is_a_hard_landing_at_the_speed_of_fall() {
    let config = standing("f550");
    let rest = flight(&config).truth().position_ned_m[2];
    let mut sim = from(&config, |body| body.position_ned = [0.0, 0.0, rest - 0.5]);
    for _ in 0..nearest_step(1.0) {
        step(&mut sim);
    }
    let events = sim.take_ground_events();
    let [GroundEvent::HardLanding { speed_m_s }] = events[..] else {
        panic!("{events:?}");
    };
    let fall = (2.0 * 9.81 * 0.499_f64).sqrt();
    assert!((speed_m_s - fall).abs() < 0.01, "{speed_m_s} for {fall} m/s");
}

/// Acceleration downhill over 1 s on a slope of 10°, m/s².
fn slide(name: &str, friction: f64) -> f64 {
    let mut config = standing(name);
    config.ground_contact = Some(GroundContact {
        friction,
        slope_deg: 10.0,
        downhill_deg: 30.0,
        ..GroundContact::default()
    });
    let mut sim = flight(&config);
    let speed = |sim: &Simulation| sim.truth().velocity_ned_m_s.iter().map(|v| v * v).sum::<f64>().sqrt();
    for _ in 0..400 {
        step(&mut sim);
    }
    let before = speed(&sim);
    for _ in 0..400 {
        step(&mut sim);
    }
    speed(&sim) - before
}

#[test]
fn val_a_slope_of_10_degrees_holds_at_0_8_and_slides_at_0_1() {
    let (sin, cos) = 10.0_f64.to_radians().sin_cos();
    for name in VEHICLES {
        let held = slide(name, 0.8);
        assert!(held.abs() < 1e-6, "{name}: {held} m/s² where friction holds");
        let (got, expected) = (slide(name, 0.1), 9.81 * (sin - 0.1 * cos));
        assert!((got / expected - 1.0).abs() < 0.01, "{name}: {got} for {expected} m/s²");
    }
}

/// Height gained in 2 s with all rotors held at a share of the weight, m.
fn lift(name: &str, share: f64) -> f64 {
    let config = standing(name);
    let mut sim = flight(&config);
    let begin = sim.truth().position_ned_m[2];
    let n = sim.rotor_count();
    let body = &config.vehicle.body;
    let wanted = share * body.mass_kg * body.gravity_m_s2 / n as f64;
    let mut duty = [0.0; MAX_ROTORS];
    // From the weight's share of 99 % on: the vehicle lightens on its feet without a jump.
    for k in 0..nearest_step(3.0) {
        let ramp = wanted * (k as f64 / 400.0).min(1.0);
        let voltage = sim.truth().battery_voltage_v;
        let held = config.nominal_blade.duty(ramp, voltage).unwrap_or(0.0);
        duty[..n].fill(held);
        sim.advance_duty(&duty).unwrap();
    }
    begin - sim.truth().position_ned_m[2]
}

#[test]
fn val_it_lifts_off_where_thrust_is_weight() {
    for name in VEHICLES {
        // The feet spring back by 1 mm when they are relieved.
        let (below, above) = (lift(name, 0.999), lift(name, 1.001));
        assert!(below < 0.001, "{name}: {below} m at 99.9 % of the weight");
        // ½ · 0.001 g · (2 s)² is 2 cm, less the effect of the lag.
        assert!(above > 0.008, "{name}: {above} m at 100.1 % of the weight");
    }
}

#[test]
fn val_a_landing_at_half_a_metre_per_second_rebounds_less_than_2_cm() {
    for name in VEHICLES {
        let config = standing(name);
        let rest = flight(&config).truth().position_ned_m[2];
        let mut sim = from(&config, |body| {
            body.position_ned = [0.0, 0.0, rest - 0.01];
            body.velocity_ned = [0.0, 0.0, 0.5];
        });
        let (mut touched, mut highest) = (false, 0.0_f64);
        for _ in 0..400 {
            step(&mut sim);
            touched |= sim.on_ground();
            if touched {
                highest = highest.max(rest - sim.truth().position_ned_m[2]);
            }
        }
        assert!(touched && highest < 0.02, "{name}: rebounds {highest} m");
    }
}

#[test]
fn val_half_the_step_moves_nothing_by_a_millimetre() {
    for name in VEHICLES {
        let landed = |substeps: u32| {
            let config = SimulationConfig {
                integrator_substeps: substeps,
                ..standing(name)
            };
            let mut sim = from(&config, |body| {
                body.position_ned = [0.0, 0.0, -0.4];
                body.velocity_ned = [0.3, -0.2, 0.5];
                body.ned_from_body = Quaternion::from_euler([0.15, -0.1, 0.4]);
            });
            let mut path = Vec::new();
            for _ in 0..800 {
                step(&mut sim);
                path.push(sim.truth().position_ned_m);
            }
            path
        };
        let worst = landed(5)
            .iter()
            .zip(landed(10))
            .flat_map(|(a, b)| (0..3).map(move |i| (a[i] - b[i]).abs()))
            .fold(0.0, f64::max);
        assert!(worst < 1e-3, "{name}: {worst} m");
    }
}

#[test]
fn val_on_its_side_it_tips_over_and_the_rotors_strike() {
    let config = standing("f550");
    let mut sim = from(&config, |body| {
        body.position_ned = [0.0, 0.0, -0.3];
        body.ned_from_body = Quaternion::from_euler([1.7, 0.0, 0.0]);
    });
    for _ in 0..1200 {
        step(&mut sim);
    }
    let events = sim.take_ground_events();
    assert!(
        events
            .iter()
            .any(|e| matches!(e, GroundEvent::TipOver { tilt_rad } if *tilt_rad > 1.0))
    );
    assert!(events.iter().any(|e| matches!(e, GroundEvent::RotorStrike { .. })));
    // It comes to lie on its arms, the centre of mass in their plane.
    let truth = sim.truth();
    assert!(truth.position_ned_m[2].abs() < 0.01, "{truth:?}");
    assert!(truth.velocity_ned_m_s.iter().all(|v| v.abs() < 1e-3));
}

#[test]
fn val_high_over_the_ground_the_flight_is_that_without_it() {
    let with = SimulationConfig {
        starts_on_ground: false,
        starts_trimmed: true,
        integrator_substeps: 5,
        ..standing("f550")
    };
    let without = SimulationConfig {
        ground_down_m: None,
        ground_contact: None,
        ..with.clone()
    };
    let fly = |config: &SimulationConfig| {
        let mut sim = flight(config);
        let duty = [f64::from(sim.hover_duty()) + 0.01; MAX_ROTORS];
        for _ in 0..400 {
            sim.advance_duty(&duty).unwrap();
        }
        *sim.truth()
    };
    assert_eq!(fly(&with), fly(&without));
}
