//! Invariants of the plant: conservation, independence of streams, defined behaviour at the edges.

use proptest::prelude::*;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::signals::MotorCommand;

use crate::body::environment::WindModel;
use crate::body::rigid_body::{Quaternion, RigidBodyState};
use crate::config::SimulationConfig;
use crate::effects::EffectInstance;
use crate::error::SimulationError;
use crate::nearest_step;
use crate::powertrain::faults::FaultEntry;
use crate::random::{NormalStream, RandomStream};
use crate::sensing::faults::{SensorFaultEntry, SensorFaultPlan};
use crate::sensing::readings::Sensor;
use crate::sensing::sensors::SensorModel;
use crate::simulation::{SensedSample, Simulation, TruthSample};
use crate::state::PlantState;
use crate::testing::{faults, hover, preset};
use crate::vector::{Vector3, cross};
use crate::vehicle::load::{LoadDrop, LoadPlan};
use crate::vehicle::mismatch::MismatchPreset;

/// Relative drift over 1 s of a tumbling body at up to 6 rad/s: the fourth-order error of 400 steps of 2.5 ms.
const CONSERVATION_TOLERANCE: f64 = 1e-8;
/// Every rounding of a normalisation and of the check's own norm at its worst, in units of ε/2: the sum of squares is off by 4 and its root by 3,
/// twice; the inverse and the product add one each.
const UNIT_TOLERANCE: f64 = 4.0 * f64::EPSILON;

/// A flight of the hovering F550 with something changed.
fn simulation(change: impl FnOnce(&mut SimulationConfig), seed: u64) -> Simulation {
    let mut config = hover();
    change(&mut config);
    Simulation::new(&config, seed).unwrap()
}

fn realistic(config: &mut SimulationConfig) {
    config.mismatch = preset(MismatchPreset::Realistic);
}

fn as_it_is(_: &mut SimulationConfig) {}

/// A fault of a rotor that does nothing yet.
fn fault(time_s: f64, rotor: u32) -> FaultEntry {
    FaultEntry {
        time_s,
        rotor,
        ..FaultEntry::default()
    }
}

/// A sensor fault from 0.5 s on that does nothing yet.
fn sensor_fault(sensor: Sensor, end_s: Option<f64>) -> SensorFaultEntry {
    SensorFaultEntry {
        time_s: 0.5,
        end_s,
        sensor,
        bias_si: None,
        stuck: None,
        dropout_probability: None,
        delay_s: None,
    }
}

/// A command that shakes the vehicle a little.
fn command(sim: &Simulation) -> MotorCommand {
    let wobble = (sim.step() % 7) as f32 * 0.002;
    MotorCommand {
        duty: std::array::from_fn(|i| sim.hover_duty() + if i % 2 == 0 { wobble } else { -wobble }),
    }
}

/// Flies `steps` steps in open loop; all samples.
fn fly(sim: &mut Simulation, steps: usize) -> Vec<(SensedSample, TruthSample)> {
    (0..steps)
        .map(|_| {
            let sample = (sim.sense(), *sim.truth());
            let command = command(sim);
            sim.advance(&command).unwrap();
            sample
        })
        .collect()
}

fn rotated(q: Quaternion, v: Vector3) -> Vector3 {
    let [w, x, y, z] = q.0;
    let t = cross([x, y, z], v).map(|c| 2.0 * c);
    let u = cross([x, y, z], t);
    [0, 1, 2].map(|i| v[i] + w * t[i] + u[i])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn prop_free_fall_conserves(rates in prop::array::uniform3(-6.0..6.0f64), velocity in prop::array::uniform3(-5.0..5.0f64),
                                euler in prop::array::uniform3(-1.5..1.5f64)) {
        let mut sim = simulation(|config| {
            config.mismatch = preset(MismatchPreset::None);
            config.starts_trimmed = false;
        }, 1);
        sim.set_state(PlantState {
            body: RigidBodyState {
                position_ned: [0.0, 0.0, -5.0],
                velocity_ned: velocity,
                ned_from_body: Quaternion::from_euler(euler),
                body_rates: rates,
            },
            thrust: [0.0; MAX_ROTORS],
            state_of_charge: 0.9,
        });
        let inertia = [0.0266, 0.0266, 0.0498];
        let invariants = |sim: &Simulation| {
            let (body, truth) = (sim.state().body, sim.truth());
            let momentum = [0, 1, 2].map(|i| inertia[i] * truth.body_rates_rad_s[i]);
            let spin: f64 = (0..3).map(|i| 0.5 * momentum[i] * truth.body_rates_rad_s[i]).sum();
            let speed: f64 = truth.velocity_ned_m_s.iter().map(|v| 0.5 * 1.55 * v * v).sum();
            (spin, speed - 1.55 * 9.81 * truth.position_ned_m[2], rotated(body.ned_from_body, momentum))
        };
        let start = invariants(&sim);
        for _ in 0..400 {
            sim.advance(&MotorCommand::default()).unwrap();
            let [w, x, y, z] = sim.state().body.ned_from_body.0;
            prop_assert!(((w * w + x * x + y * y + z * z).sqrt() - 1.0).abs() <= UNIT_TOLERANCE);
        }
        let end = invariants(&sim);
        prop_assert!((end.0 - start.0).abs() <= CONSERVATION_TOLERANCE * start.0.max(1e-3), "{start:?} {end:?}");
        prop_assert!((end.1 - start.1).abs() <= CONSERVATION_TOLERANCE * 100.0, "{start:?} {end:?}");
        for i in 0..3 {
            prop_assert!((end.2[i] - start.2[i]).abs() <= CONSERVATION_TOLERANCE, "{start:?} {end:?}");
        }
    }

    #[test]
    fn prop_euler_angles_round_trip(roll in -3.1..3.1f64, pitch in -1.5..1.5f64, yaw in -3.1..3.1f64) {
        let back = Quaternion::from_euler([roll, pitch, yaw]).to_euler();
        // asin loses half of the digits towards ±90° of pitch: 1e-16 over cos(1.5).
        for (a, b) in back.iter().zip([roll, pitch, yaw]) {
            prop_assert!((a - b).abs() < 1e-13, "{back:?}");
        }
        let down = rotated(Quaternion::from_euler([roll, pitch, yaw]), [0.0, 0.0, 1.0]);
        // Third column of Eq. 2.
        let expected = [
            roll.sin() * yaw.sin() + roll.cos() * yaw.cos() * pitch.sin(),
            roll.cos() * yaw.sin() * pitch.sin() - yaw.cos() * roll.sin(),
            roll.cos() * pitch.cos(),
        ];
        for i in 0..3 {
            prop_assert!((down[i] - expected[i]).abs() < 1e-15);
            prop_assert!((Quaternion::from_euler([roll, pitch, yaw]).down_axis()[i] - expected[i]).abs() < 1e-15);
        }
    }

    #[test]
    fn prop_any_command_keeps_thrust_in_bounds(duty in prop::array::uniform16(-2.0..3.0f32), seed in 0u64..1000) {
        let mut sim = simulation(realistic, seed);
        for _ in 0..200 {
            sim.advance(&MotorCommand { duty }).unwrap();
            let truth = sim.truth();
            prop_assert!(truth.rotor_thrust_n[..6].iter().all(|f| (0.0..14.0).contains(f)), "{truth:?}");
            prop_assert!(truth.rotor_thrust_n[6..].iter().all(|f| *f == 0.0));
            prop_assert!(truth.battery_voltage_v <= truth.open_circuit_voltage_v && truth.battery_current_a >= 0.0);
        }
    }
}

#[test]
fn prop_same_seed_same_bits() {
    let gusty = |config: &mut SimulationConfig| {
        realistic(config);
        config.wind = Some(WindModel {
            mean_ned_m_s: [0.0; 3],
            gust_rms_m_s: 1.0,
            gust_correlation_s: 2.0,
        });
    };
    let flight = |seed| fly(&mut simulation(gusty, seed), 400);
    assert_eq!(flight(3), flight(3));
    assert_ne!(flight(3), flight(4));
}

#[test]
fn prop_sensing_or_not_makes_no_difference() {
    let mut asked = simulation(as_it_is, 1);
    let mut silent = simulation(as_it_is, 1);
    for _ in 0..100 {
        let command = command(&asked);
        assert_eq!(asked.sense(), asked.sense());
        asked.advance(&command).unwrap();
        silent.advance(&command).unwrap();
    }
    assert_eq!(asked.sense(), silent.sense());
}

#[test]
fn prop_streams_are_independent() {
    let plain = fly(&mut simulation(as_it_is, 1), 300);
    // Voltage noise draws from another stream: everything else keeps its bits.
    let noisy = |config: &mut SimulationConfig| config.sensors.battery_voltage_noise_v = 0.1;
    for (a, b) in plain.iter().zip(fly(&mut simulation(noisy, 1), 300)) {
        assert_eq!((a.0.nav, a.1), (b.0.nav, b.1));
        assert_ne!(a.0.battery_voltage, b.0.battery_voltage);
    }
    // The same is true of the noise of a sensor whose neighbour fails.
    let failing = |config: &mut SimulationConfig| {
        let bias = SensorFaultEntry {
            time_s: 0.0,
            bias_si: Some(vec![1.0, 0.0, 0.0]),
            ..sensor_fault(Sensor::Velocity, None)
        };
        config.sensor_faults = SensorFaultPlan::new(&[bias], config.duration_steps).unwrap();
    };
    for (a, b) in plain.iter().zip(fly(&mut simulation(failing, 1), 300)) {
        assert_eq!(
            (a.0.nav.position_ned, a.0.nav.body_rates, a.1),
            (b.0.nav.position_ned, b.0.nav.body_rates, b.1)
        );
    }
    // Drawing a further parameter leaves the others as they were.
    let more = simulation(realistic, 1);
    assert_eq!(
        more.mismatch().rotor_bias_n,
        simulation(as_it_is, 1).mismatch().rotor_bias_n
    );
}

#[test]
fn prop_padding_leaves_the_bits() {
    let wide = |sim: &mut Simulation| {
        let mut samples = Vec::new();
        for _ in 0..100 {
            let command = command(sim).duty.map(f64::from);
            sim.advance_padded(&command).unwrap();
            samples.push(*sim.truth());
        }
        samples
    };
    let narrow: Vec<TruthSample> = fly(&mut simulation(as_it_is, 1), 101)
        .into_iter()
        .skip(1)
        .map(|s| s.1)
        .collect();
    assert_eq!(narrow, wide(&mut simulation(as_it_is, 1)));
}

/// Frozen from the first build. A change of these bits changes every recorded run; a machine with other bits breaks replay.
#[test]
fn regress_bits() {
    let mut stream = RandomStream::new(1, "sensor/position");
    assert_eq!(
        [stream.unit(), stream.unit()].map(f64::to_bits),
        [4603780903849626813, 4604582580771558830]
    );
    let normals = NormalStream::new(1, "sensor/position").sample3();
    assert_eq!(
        normals.map(f64::to_bits),
        [13831319547862698151, 13831153020128251303, 13824708827427435301]
    );
    let (sensed, truth) = fly(&mut simulation(realistic, 1), 401).pop().unwrap();
    assert_eq!(
        truth.position_ned_m.map(f64::to_bits),
        [4597586135360668172, 13828116815536925373, 13840300921955828127]
    );
    assert_eq!(
        truth.attitude_rad.map(f64::to_bits),
        [13828107545849938811, 13821584052420334350, 4594719733928913173]
    );
    assert_eq!(
        sensed.nav.body_rates.to_array().map(f32::to_bits),
        [3216331480, 3205720439, 1037974010]
    );
}

#[test]
fn val_normals_are_normal() {
    const COUNT: usize = 4_000_000;
    let mut stream = NormalStream::new(7, "test");
    let mut moments = [0.0; 4];
    let mut tails = [0usize; 5];
    for _ in 0..COUNT {
        let x = stream.sample();
        for (power, moment) in moments.iter_mut().enumerate() {
            *moment += x.powi(power as i32 + 1);
        }
        for (tail, count) in tails.iter_mut().enumerate() {
            *count += usize::from(x > tail as f64);
        }
    }
    let moments = moments.map(|sum| sum / COUNT as f64);
    // Standard errors of the moments of a normal: √1, √2, √15, √96 over √COUNT; four of them.
    let bound = |variance: f64| 4.0 * (variance / COUNT as f64).sqrt();
    for ((moment, expected), variance) in moments.iter().zip([0.0, 1.0, 0.0, 3.0]).zip([1.0, 2.0, 15.0, 96.0]) {
        assert!((moment - expected).abs() < bound(variance), "moments {moments:?}");
    }
    // P(x > 0 … 4), from tables of the normal distribution; the last reaches beyond the ziggurat's tail at 3.65.
    for (count, share) in tails
        .iter()
        .zip([0.5, 0.158_655_3, 0.022_750_13, 0.001_349_898, 3.167_124e-5])
    {
        let expected = share * COUNT as f64;
        assert!(
            (*count as f64 - expected).abs() < 4.0 * expected.sqrt(),
            "tails {tails:?}"
        );
    }
}

#[test]
fn val_gusts_have_their_rms_and_memory() {
    let long = |config: &mut SimulationConfig| {
        config.duration_steps = nearest_step(2000.0);
        config.mismatch.linear_drag_kg_s = Some(0.01);
        config.wind = Some(WindModel {
            mean_ned_m_s: [2.0, 0.0, 0.0],
            gust_rms_m_s: 1.5,
            gust_correlation_s: 2.0,
        });
    };
    let mut sim = simulation(long, 5);
    let gusts: Vec<f64> = (0..800_000)
        .map(|_| {
            sim.advance(&MotorCommand::default()).unwrap();
            sim.truth().wind_ned_m_s[1]
        })
        .collect();
    let mean_product =
        |lag: usize| gusts[lag..].iter().zip(&gusts).map(|(a, b)| a * b).sum::<f64>() / (gusts.len() - lag) as f64;
    // 2000 s hold about 500 independent samples of a process with a memory of 2 s: 4 standard errors of a variance are 25 %.
    assert!(
        (mean_product(0) / 2.25 - 1.0).abs() < 0.25,
        "variance {}",
        mean_product(0)
    );
    let correlation = mean_product(800) / mean_product(0);
    assert!(
        (correlation - (-1.0f64).exp()).abs() < 0.16,
        "correlation over 2 s {correlation}"
    );
}

#[test]
fn val_wind_carries_a_falling_vehicle() {
    let windy = |config: &mut SimulationConfig| {
        config.mismatch = preset(MismatchPreset::None);
        config.mismatch.linear_drag_kg_s = Some(5.0);
        config.wind = Some(WindModel {
            mean_ned_m_s: [3.0, -2.0, 0.0],
            gust_rms_m_s: 0.0,
            gust_correlation_s: 2.0,
        });
        config.starts_trimmed = false;
    };
    let mut sim = simulation(windy, 1);
    for _ in 0..2000 {
        sim.advance(&MotorCommand::default()).unwrap();
    }
    // Terminal velocity: wind plus m g/k_t downwards, after 16 time constants m/k_t.
    let expected = [3.0, -2.0, 1.55 * 9.81 / 5.0];
    for (got, expected) in sim.truth().velocity_ned_m_s.iter().zip(expected) {
        assert!((got - expected).abs() < 1e-6, "{:?}", sim.truth());
    }
}

#[test]
fn val_impossible_numbers_are_named() {
    let mut sim = simulation(as_it_is, 1);
    let mut duty = [0.4; MAX_ROTORS];
    duty[4] = f32::NAN;
    assert_eq!(
        sim.advance(&MotorCommand { duty }).unwrap_err().to_string(),
        "step 0: the duty commanded to rotor 5 is not finite"
    );
    let mut state = *sim.state();
    state.body.body_rates = [1e200, 1e200, 1e200];
    sim.set_state(state);
    let error = sim.advance(&MotorCommand::default()).unwrap_err();
    assert_eq!(
        error,
        SimulationError::NonFiniteState {
            step: 1,
            quantity: "the body rates"
        }
    );
    let mut sim = simulation(as_it_is, 1);
    fly(&mut sim, 2000);
    assert!(sim.done());
    assert_eq!(
        sim.advance(&MotorCommand::default()),
        Err(SimulationError::FlightOver { step: 2000 })
    );
}

#[test]
fn val_empty_battery_lets_the_vehicle_fall() {
    let mut sim = simulation(as_it_is, 1);
    let mut state = *sim.state();
    state.state_of_charge = 1e-4;
    sim.set_state(state);
    let duty = [sim.hover_duty(); MAX_ROTORS];
    while !sim.done() {
        sim.advance(&MotorCommand { duty }).unwrap();
    }
    let truth = sim.truth();
    assert_eq!(
        (truth.state_of_charge, truth.battery_voltage_v, truth.battery_current_a),
        (0.0, 0.0, 0.0)
    );
    assert!(truth.rotor_thrust_n.iter().all(|f| *f < 1e-9), "{truth:?}");
    assert!(truth.velocity_ned_m_s[2] > 10.0, "{truth:?}");
}

#[test]
fn val_thrust_loss_steps_ramps_and_is_labelled() {
    let loss = |time_s, percent, ramp_s| FaultEntry {
        thrust_loss_percent: Some(percent),
        ramp_s,
        ..fault(time_s, 2)
    };
    let damaged = |config: &mut SimulationConfig| {
        config.mismatch = preset(MismatchPreset::None);
        let blade = FaultEntry {
            blade: Some("c".to_owned()),
            ..fault(2.5, 4)
        };
        let lost = FaultEntry {
            rotor_lost: Some(true),
            ..fault(4.0, 1)
        };
        let entries = [
            loss(1.0, 10.0, None),
            loss(2.0, 30.0, Some(1.0)),
            blade,
            loss(3.5, 0.0, None),
            lost,
        ];
        config.faults = faults(config, &entries);
    };
    let truth = fly(&mut simulation(damaged, 1), 2000);
    let at = |t: f64| &truth[(t * 400.0) as usize].1;
    let loss = |t: f64| at(t).rotor_thrust_loss[1];
    assert_eq!((loss(0.9975), loss(1.0), loss(1.9975)), (0.0, 0.1, 0.1));
    assert!((loss(2.4975) - 0.2).abs() < 1e-12 && loss(2.9975) == 0.3 && loss(3.25) == 0.3);
    assert_eq!(
        (at(0.5).fault_label, at(1.0).fault_label, at(2.5).fault_label),
        (0, 2, -1)
    );
    assert_eq!(
        (at(2.5).rotor_blade[3], at(3.5).fault_label, at(3.5).faulty_rotors),
        (3, 4, 0b1000)
    );
    assert_eq!(at(4.0).rotor_thrust_loss[0], 1.0);
    // Held at hover duty the thrust follows the loss through the lag of 0.05 s; 0.9 s later nothing is left of it.
    let healthy = at(0.9975).rotor_thrust_n[4];
    assert!((at(1.9).rotor_thrust_n[1] / at(1.9).rotor_thrust_n[5] - 0.9).abs() < 0.02);
    assert!(at(4.9).rotor_thrust_n[0] < 1e-6 * healthy);
}

#[test]
fn val_sensor_faults_do_what_they_say() {
    let failing = |config: &mut SimulationConfig| {
        config.sensors = SensorModel::exact();
        let entries = [
            SensorFaultEntry {
                bias_si: Some(vec![0.5, 0.0, -0.25]),
                ..sensor_fault(Sensor::BodyRates, Some(1.0))
            },
            SensorFaultEntry {
                delay_s: Some(0.05),
                ..sensor_fault(Sensor::Velocity, None)
            },
            SensorFaultEntry {
                stuck: Some(true),
                ..sensor_fault(Sensor::Position, Some(1.0))
            },
            SensorFaultEntry {
                dropout_probability: Some(0.5),
                ..sensor_fault(Sensor::BatteryVoltage, Some(1.0))
            },
        ];
        config.sensor_faults = SensorFaultPlan::new(&entries, config.duration_steps).unwrap();
    };
    let samples = fly(&mut simulation(failing, 1), 600);
    let mut lost = 0;
    for (k, (sensed, truth)) in samples.iter().enumerate() {
        let active = (200..400).contains(&k);
        let nav = &sensed.nav;
        let bias = if active { [0.5, 0.0, -0.25] } else { [0.0; 3] };
        let rates = [0, 1, 2].map(|i| (truth.body_rates_rad_s[i] + bias[i]) as f32);
        assert_eq!(nav.body_rates.to_array(), rates, "step {k}");
        let delayed = &samples[if k >= 200 { k - 20 } else { k }].1;
        assert_eq!(
            nav.velocity_ned.to_array(),
            delayed.velocity_ned_m_s.map(|v| v as f32),
            "step {k}"
        );
        let held = &samples[if active { 200 } else { k }].1;
        assert_eq!(
            nav.position_ned.to_array(),
            held.position_ned_m.map(|p| p as f32),
            "step {k}"
        );
        let stale = sensed.stale_sensors;
        assert!(
            stale == 0 || (active && stale == 0b10000),
            "step {k}: only dropouts are flagged"
        );
        let voltage = if stale == 0 {
            truth.battery_voltage_v as f32
        } else {
            samples[k - 1].0.battery_voltage
        };
        assert_eq!(sensed.battery_voltage, voltage, "step {k}");
        lost += usize::from(stale != 0);
    }
    // 200 samples at one half: 100 ± 4 standard deviations of 7.
    assert!((72..=128).contains(&lost), "{lost} samples lost");
}

/// Truth of the whole flight with these faults, in open loop.
fn truth_with(entries: &[FaultEntry], change: impl FnOnce(&mut SimulationConfig)) -> Vec<TruthSample> {
    let mut sim = simulation(
        |config| {
            change(config);
            config.faults = faults(config, entries);
        },
        1,
    );
    let steps = nearest_step(5.0) as usize;
    fly(&mut sim, steps).into_iter().map(|(_, truth)| truth).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn prop_an_intermittent_fault_is_its_list_of_steps(
        onset in 0..1200u64, period in 2..900u64, on in 0.0..1.0f64, loss in -20.0..60.0f64, torque in -30.0..80.0f64, motors in any::<bool>()
    ) {
        let on = ((on * period as f64) as u64).clamp(1, period - 1);
        let s = |steps: u64| steps as f64 / 400.0;
        let changed = |time_s: f64, loss: f64, torque: f64| FaultEntry {
            thrust_loss_percent: Some(loss),
            moment_ratio_change_percent: Some(torque),
            ..fault(time_s, 3)
        };
        // It has lost something before: between the bursts it is as it was.
        let before = FaultEntry { thrust_loss_percent: Some(7.0), ..fault(0.0, 3) };
        // From 4 s on, something else.
        let after = changed(4.0, 30.0, 0.0);
        let onset = onset + 1;
        let intermittent = FaultEntry { period_s: Some(s(period)), on_s: Some(s(on)), ..changed(s(onset), loss, torque) };
        let mut list = vec![before.clone()];
        let mut begin = onset;
        while begin < 1600 {
            list.push(changed(s(begin), loss, torque));
            if begin + on < 1600 {
                list.push(changed(s(begin + on), 7.0, 0.0));
            }
            begin += period;
        }
        // A list that ends in what comes anyway would be refused.
        let torque_at_end = FaultEntry { moment_ratio_change_percent: None, ..after.clone() };
        let acts_at_end = (1599 - onset) % period < on;
        list.push(if acts_at_end { after.clone() } else { torque_at_end });
        let with_motors = |config: &mut SimulationConfig| if motors { config.vehicle = crate::testing::vehicle("f550-motors") };
        let intermittent = truth_with(&[before, intermittent, after], with_motors);
        prop_assert_eq!(intermittent, truth_with(&list, with_motors));
    }
}

#[test]
fn val_an_intermittent_fault_is_labelled_while_it_acts() {
    let entry = FaultEntry {
        thrust_loss_percent: Some(10.0),
        period_s: Some(2.0),
        on_s: Some(0.5),
        ..fault(1.0, 2)
    };
    let truth = truth_with(&[entry], as_it_is);
    for (step, sample) in truth.iter().enumerate() {
        let acts = step >= 400 && (step - 400) % 800 < 200;
        let expected = if acts { (2, 0.1) } else { (0, 0.0) };
        assert_eq!(
            (sample.fault_label, sample.rotor_thrust_loss[1]),
            expected,
            "step {step}"
        );
    }
}

/// Plain and extended step round differently.
const ROUNDING: f64 = 1e-9;

/// Largest difference of motions and thrusts.
fn difference(one: &[TruthSample], other: &[TruthSample]) -> f64 {
    let of = |a: &TruthSample, b: &TruthSample| {
        let motion = a.motion().into_iter().zip(b.motion());
        let thrust = a.rotor_thrust_n.into_iter().zip(b.rotor_thrust_n);
        motion.chain(thrust).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
    };
    one.iter().zip(other).map(|(a, b)| of(a, b)).fold(0.0, f64::max)
}

#[test]
fn val_gain_and_torque_are_those_of_the_effects() {
    let perfect = |config: &mut SimulationConfig| config.mismatch = preset(MismatchPreset::None);
    let entry = FaultEntry {
        thrust_loss_percent: Some(-12.5),
        moment_ratio_change_percent: Some(20.0),
        ..fault(0.5, 2)
    };
    let by_fault = truth_with(std::slice::from_ref(&entry), perfect);
    assert_eq!((by_fault[199].fault_label, by_fault[200].fault_label), (0, 2));
    assert_eq!(by_fault[200].rotor_thrust_loss[1], -0.125);
    let effect = |id: &str, share: f64, onset_s: f64| {
        let mut effect = EffectInstance::new(id, &[("share", share)]).on_rotor(2);
        effect.onset_s = Some(onset_s);
        effect
    };
    let by_effects = truth_with(&[], |config| {
        perfect(config);
        config.effects = vec![
            effect("rotor-thrust-scale", 0.125, 0.5),
            effect("rotor-moment-ratio", 0.2, 0.5),
        ];
    });
    assert!(
        difference(&by_fault, &by_effects) < ROUNDING,
        "{}",
        difference(&by_fault, &by_effects)
    );
    // In the step with effects, too.
    let with_effect = truth_with(std::slice::from_ref(&entry), |config| {
        perfect(config);
        // It sets in after the flight.
        config.effects = vec![effect("rotor-moment-ratio", 0.1, 10.0)];
    });
    assert!(difference(&by_fault, &with_effect) < ROUNDING);
    let healthy = truth_with(&[], perfect);
    let yaw = |truth: &[TruthSample]| truth[360].body_rates_rad_s[2];
    assert!(
        (yaw(&by_fault) - yaw(&healthy)).abs() > 0.05,
        "the torque turns the vehicle"
    );
}

#[test]
fn val_a_blade_that_drags_is_a_change_of_the_torque() {
    let blade = |config: &mut SimulationConfig, factor: f64| {
        let mut blades = crate::testing::blades(&config.vehicle);
        let mut mounted = blades.blade["a"];
        mounted.moment_ratio_factor = factor;
        blades.blade.insert("z".to_owned(), mounted);
        let entry = FaultEntry {
            blade: Some("z".to_owned()),
            ..fault(0.5, 5)
        };
        config.faults =
            crate::powertrain::faults::FaultPlan::new(&[entry], 6, &blades, "a", config.duration_steps).unwrap();
    };
    let mounted = |factor| {
        let mut sim = simulation(|config| blade(config, factor), 1);
        fly(&mut sim, 800)
            .into_iter()
            .map(|(_, truth)| truth.motion())
            .collect::<Vec<_>>()
    };
    let changed = truth_with(
        &[FaultEntry {
            moment_ratio_change_percent: Some(25.0),
            ..fault(0.5, 5)
        }],
        as_it_is,
    );
    let of_fault: Vec<_> = changed[..800].iter().map(TruthSample::motion).collect();
    assert_eq!(mounted(1.25), of_fault, "to the last bit");
    assert_ne!(mounted(1.0), of_fault);
}

/// A load that goes at 0.5 s.
fn load(mass_kg: f64, position_body_m: Vector3) -> LoadDrop {
    LoadDrop {
        time_s: 0.5,
        mass_kg,
        position_body_m,
    }
}

#[test]
fn val_a_dropped_load_leaves_a_lighter_vehicle() {
    let (mass, place) = (0.15, [0.04, -0.03, 0.05]);
    let mut sim = simulation(
        |config| {
            config.mismatch = preset(MismatchPreset::None);
            config.sensors = SensorModel::exact();
            config.loads = LoadPlan::new(&[load(mass, place)], &config.vehicle, config.duration_steps).unwrap();
        },
        1,
    );
    let duty = [sim.hover_duty(); MAX_ROTORS];
    let mut samples = Vec::new();
    while sim.step() < 202 {
        samples.push((sim.sense(), *sim.truth()));
        sim.advance(&MotorCommand { duty }).unwrap();
    }
    let (sensed, truth) = samples[200];
    let before = samples[199].1;
    // The centre of mass moves away from the load by Δ/m' of its distance, and the sensors stay.
    let share = mass / (1.55 - mass);
    for (axis, place) in place.into_iter().enumerate() {
        let jump = truth.position_ned_m[axis] - before.position_ned_m[axis];
        assert!((jump + share * place).abs() < 2e-5, "axis {axis}: {jump}");
        let read = f64::from(sensed.nav.position_ned.to_array()[axis]);
        assert!((read - before.position_ned_m[axis]).abs() < 2e-5, "axis {axis}: {read}");
    }
    assert_eq!((truth.fault_label, truth.faulty_rotors), (0, 0), "no rotor is faulty");
    // Hover thrust lifts what is left; the arm of the shifted weight turns it: τ = Σ (l_i − c') × f_i.
    let next = samples[201].1;
    let rate = |i: usize| (next.velocity_ned_m_s[i] - truth.velocity_ned_m_s[i]) / 0.0025;
    assert!((rate(2) + 9.81 * share).abs() < 5e-3, "{}", rate(2));
    let weight = 1.55 * 9.81;
    let shift = place.map(|p| -share * p);
    let torque = [shift[1] * weight, -shift[0] * weight, 0.0];
    let square: f64 = place.iter().map(|p| p * p).sum();
    let reduced = 1.55 * share;
    let inertia = nalgebra::Matrix3::from_fn(|row, column| {
        let document = if row == column {
            [0.0266, 0.0266, 0.0498][row]
        } else {
            0.0
        };
        let diagonal = if row == column { square } else { 0.0 };
        document - reduced * (diagonal - place[row] * place[column])
    });
    let expected = inertia.try_inverse().unwrap() * nalgebra::Vector3::from(torque);
    for axis in 0..3 {
        let turned = (next.body_rates_rad_s[axis] - truth.body_rates_rad_s[axis]) / 0.0025;
        assert!(
            (turned - expected[axis]).abs() < 2e-2,
            "axis {axis}: {turned} {}",
            expected[axis]
        );
    }
}

#[test]
fn prop_a_drop_in_flight_takes_no_energy_from_what_remains() {
    // Tumbling without thrust: what remains goes on as it was, its energy and momentum apart from those of the load.
    let (mass, place) = (0.15, [0.04, -0.03, 0.05]);
    let mut sim = simulation(
        |config| {
            config.mismatch = preset(MismatchPreset::None);
            config.starts_trimmed = false;
            config.loads = LoadPlan::new(&[load(mass, place)], &config.vehicle, config.duration_steps).unwrap();
        },
        1,
    );
    sim.set_state(PlantState {
        body: RigidBodyState {
            position_ned: [0.0, 0.0, -50.0],
            velocity_ned: [2.0, -1.0, 0.5],
            ned_from_body: Quaternion::from_euler([0.3, -0.2, 0.5]),
            body_rates: [3.0, -2.0, 4.0],
        },
        thrust: [0.0; MAX_ROTORS],
        state_of_charge: 0.9,
    });
    while sim.step() < 199 {
        sim.advance(&MotorCommand::default()).unwrap();
    }
    let load_of = |body: &RigidBodyState| {
        let (away, turning) = (
            rotated(body.ned_from_body, place),
            rotated(body.ned_from_body, cross(body.body_rates, place)),
        );
        (
            [0, 1, 2].map(|i| body.position_ned[i] + away[i]),
            [0, 1, 2].map(|i| body.velocity_ned[i] + turning[i]),
        )
    };
    let whole = sim.state().body;
    let (_, mut speed) = load_of(&whole);
    sim.advance(&MotorCommand::default()).unwrap();
    let rest = sim.state().body;
    // The load, released a step later, falls as its place of the whole would have moved: to the order of ω² h.
    speed[2] += 9.81 * 0.0025;
    let total = |v: Vector3, w: Vector3| [0, 1, 2].map(|i| (1.55 - mass) * v[i] + mass * w[i]);
    let momentum = total(rest.velocity_ned, speed);
    for i in 0..3 {
        let fallen = if i == 2 { 1.55 * 9.81 * 0.0025 } else { 0.0 };
        let expected = 1.55 * whole.velocity_ned[i] + fallen;
        assert!((momentum[i] - expected).abs() < 0.15 * 30.0 * 0.07 * 0.0025, "axis {i}");
    }
    // From then on what remains conserves its own.
    let energy = |body: &RigidBodyState| {
        let v: f64 = body.velocity_ned.iter().map(|v| v * v).sum();
        0.5 * v - 9.81 * body.position_ned[2]
    };
    let start = energy(&sim.state().body);
    for _ in 0..400 {
        sim.advance(&MotorCommand::default()).unwrap();
    }
    assert!((energy(&sim.state().body) - start).abs() < CONSERVATION_TOLERANCE * start.abs());
}
