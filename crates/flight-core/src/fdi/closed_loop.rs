//! Tests of the engine in closed loop with the controller and a compact rigid body: lagged rotors, biases, sensor noise of Table
//! 4, gusts. Not the project's plant (which the FDI engine must not see), and simpler: constant voltage, no drag.

use super::test_vectors::{PERIOD, blade_a, body};
use super::*;
use crate::control::{Controller, ControllerConfig, PidGains, ThrustToDuty};
use crate::frames::{EulerAngles, Vec3};
use crate::signals::{MotorCommand, NavState, Reference};
use crate::test_plant::FreeBody;
use proptest::prelude::*;
use std::sync::OnceLock;
use std::vec::Vec;

const VOLTAGE: f32 = 16.0;
const ROTOR_LAG: f64 = 0.05;
const FULL_THRUST: f32 = 12.0059;

/// Normal deviates from a linear congruential generator; good enough for tests and identical on every platform.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// Conditions of a flight.
#[derive(Clone, Copy)]
struct Conditions {
    rotor_count: usize,
    seed: u64,
    duration_s: f64,
    /// Fractional thrust loss of `rotor` between the two times.
    loss: f64,
    rotor: usize,
    /// Another rotor with the same loss, and its onset time.
    second: Option<(usize, f64)>,
    from_s: f64,
    to_s: f64,
    /// Standard deviations of force (N) and torque (N·m) with 2 s of correlation.
    gust: (f64, f64),
    /// Pitch torque that sets in at `from_s` and persists, N·m.
    pitch_torque: f64,
    /// Factor on τ.
    lag: f64,
    circle: bool,
}

impl Conditions {
    const CALM: Self = Self {
        rotor_count: 6,
        seed: 1,
        duration_s: 14.0,
        loss: 0.0,
        rotor: 0,
        second: None,
        from_s: 12.0,
        to_s: 1e9,
        gust: (0.0, 0.0),
        pitch_torque: 0.0,
        lag: 1.0,
        circle: true,
    };
}

fn geometry(rotor_count: usize) -> Geometry {
    Geometry::regular(rotor_count, 0.275, 0.016, core::f32::consts::PI / rotor_count as f32).expect("regular")
}

fn config(rotor_count: usize) -> FdiConfig {
    FdiConfig {
        geometry: geometry(rotor_count),
        mass: body().mass,
        inertia_body: body().inertia_body,
        gravity: body().gravity,
        linear_drag: 0.0,
        angular_drag: 0.0,
        period: PERIOD,
        thrust_map: blade_a(),
        nominal_thrust: NominalThrust::Static,
        observer_gain: 5.0,
        window_len: 25,
        t_test: TTestConfig::paper(),
        network: None,
        sequential: SequentialConfig::standard(),
    }
}

fn controller(rotor_count: usize) -> Controller {
    let outer = PidGains {
        proportional: 4.98,
        integral: 2.08,
        derivative: 3.90,
    };
    let inner = PidGains {
        proportional: 242.0,
        integral: 720.0,
        derivative: 27.0,
    };
    let mut controller = Controller::new(ControllerConfig {
        geometry: geometry(rotor_count),
        mass: body().mass,
        inertia_body: body().inertia_body,
        gravity: body().gravity,
        period: PERIOD,
        position_gains: [outer; 3],
        attitude_gains: [inner, inner, outer],
        tilt_limit: 0.6,
        thrust_to_duty: ThrustToDuty::Linear {
            full_thrust: FULL_THRUST,
        },
    })
    .expect("Table 5");
    let hover = body().mass * body().gravity / rotor_count as f32;
    controller.trim(blade_a().duty(hover, VOLTAGE), VOLTAGE);
    controller
}

/// Flies and passes every measurement to `each`.
fn fly(conditions: &Conditions, mut each: impl FnMut(f64, &Measurement)) {
    let c = conditions;
    let n = c.rotor_count;
    let dt = f64::from(PERIOD);
    let geometry = geometry(n);
    let map = blade_a();
    let f = geometry.effectiveness();
    let rigid = FreeBody {
        mass: f64::from(body().mass),
        gravity: f64::from(body().gravity),
        inertia: body().inertia_body.map(f64::from),
    };
    let mut noise = Noise(c.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15));
    let bias: Vec<f64> = (0..n).map(|_| 0.010_756 * (2.0 * noise.uniform() - 1.0)).collect();
    let mut controller = controller(n);
    // p, v, η, ω.
    let mut x = [0.0f64; 12];
    let mut thrust = std::vec![f64::from(body().mass * body().gravity) / n as f64; n];
    let mut gust = [0.0f64; 6];
    let decay = libm::exp(-dt / 2.0);
    let steps = libm::round(c.duration_s / dt) as usize;
    for k in 0..steps {
        let t = k as f64 * dt;
        let turn = if c.circle { 0.4 * t } else { 0.0 };
        let reference = Reference {
            position_ned: Vec3::new(2.0 * libm::sin(turn) as f32, 2.0 - 2.0 * libm::cos(turn) as f32, 0.0),
            velocity_ned: if c.circle {
                Vec3::new(0.8 * libm::cos(turn) as f32, 0.8 * libm::sin(turn) as f32, 0.0)
            } else {
                Vec3::ZERO
            },
            yaw: 0.0,
        };
        let deviation = [0.000_784_8, 0.0078, 0.000_551_92, 0.0055];
        let y: [f32; 12] = core::array::from_fn(|i| (x[i] + deviation[i / 3] * noise.normal()) as f32);
        let nav = NavState {
            position_ned: Vec3::new(y[0], y[1], y[2]),
            velocity_ned: Vec3::new(y[3], y[4], y[5]),
            attitude: EulerAngles {
                roll: y[6],
                pitch: y[7],
                yaw: y[8],
            },
            body_rates: Vec3::new(y[9], y[10], y[11]),
        };
        let command = controller.step(&nav, &reference, VOLTAGE).command;
        each(
            t,
            &Measurement {
                nav,
                command,
                battery_voltage: VOLTAGE,
            },
        );

        for i in 0..6 {
            let level = if i < 3 { c.gust.0 } else { c.gust.1 };
            gust[i] = decay * gust[i] + libm::sqrt(1.0 - decay * decay) * level * noise.normal();
        }
        let mut push = gust;
        if t >= c.from_s {
            push[4] += c.pitch_torque;
        }
        let lost = if t >= c.from_s && t < c.to_s { c.loss } else { 0.0 };
        let settled: Vec<f64> = (0..n)
            .map(|i| {
                let also = c.second.is_some_and(|(rotor, from_s)| i == rotor && t >= from_s);
                let share = match () {
                    () if i == c.rotor => 1.0 - lost,
                    () if also => 1.0 - c.loss,
                    () => 1.0,
                };
                share * f64::from(map.thrust(command.duty[i], VOLTAGE)) + bias[i]
            })
            .collect();
        // Midpoint rule, with the lagged thrust in closed form.
        let half = rigid.rates(&x, &wrench_after(&settled, &thrust, 0.0, f, c), &push);
        let middle: [f64; 12] = core::array::from_fn(|i| x[i] + 0.5 * dt * half[i]);
        let full = rigid.rates(&middle, &wrench_after(&settled, &thrust, 0.5 * dt, f, c), &push);
        for i in 0..12 {
            x[i] += dt * full[i];
        }
        let end = libm::exp(-dt / (ROTOR_LAG * c.lag));
        for i in 0..n {
            thrust[i] = settled[i] + (thrust[i] - settled[i]) * end;
        }
    }
}

/// Wrench some time after the start of a step.
fn wrench_after(settled: &[f64], start: &[f64], after: f64, f: &[[f32; MAX_ROTORS]; 4], c: &Conditions) -> [f64; 4] {
    let decay = libm::exp(-after / (ROTOR_LAG * c.lag));
    core::array::from_fn(|axis| {
        (0..settled.len())
            .map(|i| f64::from(f[axis][i]) * (settled[i] + (start[i] - settled[i]) * decay))
            .sum()
    })
}

/// First time of each verdict of the sequential detector, s.
#[derive(Default, Debug)]
struct Log {
    changes: Vec<(f64, FaultVerdict)>,
    last: Option<FdiOutput>,
    t_test: Vec<(f64, FaultVerdict)>,
}

fn run(conditions: &Conditions) -> Log {
    let mut engine = FdiEngine::new(config(conditions.rotor_count)).expect("valid");
    let mut log = Log::default();
    fly(conditions, |t, measurement| {
        let output = engine.step(measurement);
        if output.window_end {
            if log.changes.last().map(|change| change.1) != Some(output.sequential) {
                log.changes.push((t + f64::from(PERIOD), output.sequential));
            }
            log.t_test.push((t, output.t_test));
        }
        log.last = Some(output);
    });
    log
}

#[test]
fn scenario_every_rotor_is_isolated_at_once() {
    for rotor_count in [4, 6, 8] {
        for rotor in 0..rotor_count {
            let log = run(&Conditions {
                rotor_count,
                rotor,
                seed: 100 + rotor as u64,
                loss: 0.035,
                ..Conditions::CALM
            });
            let verdicts: Vec<FaultVerdict> = log.changes.iter().map(|change| change.1).collect();
            let faulty = FaultVerdict::Faulty { rotor: rotor as u8 };
            assert_eq!(
                verdicts,
                [FaultVerdict::NotReady, FaultVerdict::Healthy, faulty],
                "rotor {rotor} of {rotor_count}"
            );
            assert!((log.changes[1].0 - 10.0).abs() < 0.1);
            let delay = log.changes[2].0 - 12.0;
            assert!((0.0..=0.4).contains(&delay), "{delay}");
            let last = log.last.expect("samples");
            assert!(last.sequential_probability > 0.99);
            // 3.5 % of a rotor's hover thrust; the controller raises the demand by as much.
            let lost = 0.035 * 1.55 * 9.81 / rotor_count as f32;
            assert!(
                (last.thrust_loss[0].loss / lost - 1.0).abs() < 0.1,
                "{:?} {lost}",
                last.thrust_loss
            );
        }
    }
}

/// Estimated losses against the truth.
#[derive(Default, Debug)]
struct Sizes {
    /// Within their intervals.
    inside: u32,
    count: u32,
    /// Sum of the squared relative errors.
    square: f64,
}

impl Sizes {
    fn add(&mut self, estimate: &LossEstimate, truth: f64) {
        let [share, low, high] = estimate.share().map(f64::from);
        self.inside += u32::from(low <= truth && truth <= high);
        self.count += 1;
        self.square += (share / truth - 1.0) * (share / truth - 1.0);
    }

    fn rms(&self) -> f64 {
        libm::sqrt(self.square / f64::from(self.count))
    }
}

#[test]
fn val_a_loss_is_sized_wherever_in_a_block_it_begins() {
    // A window is 25 steps long; onset times grow sparse in a long flight.
    let soon = [(false, 0.05), (true, 0.1), (false, 0.2)].map(|(circle, loss)| (12.0, circle, loss, 1));
    let late = (180.0, true, 0.03, 5);
    let mut sizes = Sizes::default();
    for (from_s, circle, loss, every) in soon.into_iter().chain([late]) {
        for step in (0..25).step_by(every) {
            let rotor = step % 6;
            let log = run(&Conditions {
                rotor,
                seed: 700 + step as u64,
                loss,
                circle,
                from_s: from_s + f64::from(PERIOD) * step as f64,
                duration_s: from_s + 4.0,
                ..Conditions::CALM
            });
            let last = log.last.expect("samples");
            let named = FaultVerdict::Faulty { rotor: rotor as u8 };
            assert_eq!(last.sequential, named, "{:?}", log.changes);
            sizes.add(&last.thrust_loss[0], loss);
        }
    }
    // With each taken for one that began with a block, 46 of the first 75 were inside, at 6 % rms.
    assert!(sizes.inside >= 77 && sizes.rms() < 0.025, "{sizes:?}");
}

#[test]
fn val_two_losses_are_sized_wherever_in_a_block_they_begin() {
    let mut sizes = Sizes::default();
    for step in 0..25 {
        // Equal losses of opposite rotors are a pure vertical force, which other pairs give, too.
        let (rotor, second) = (step % 6, (step + [1, 2, 4, 5][step % 4]) % 6);
        let from_s = 12.0 + f64::from(PERIOD) * step as f64;
        let log = run(&Conditions {
            rotor,
            second: Some((second, from_s)),
            seed: 800 + step as u64,
            loss: 0.1,
            from_s,
            duration_s: 18.0,
            ..Conditions::CALM
        });
        let last = log.last.expect("samples");
        let (first, second) = (rotor.min(second) as u8, rotor.max(second) as u8);
        let named = FaultVerdict::FaultyPair { first, second };
        assert_eq!(last.sequential, named, "{step}: {:?}", log.changes);
        for estimate in last.thrust_loss {
            sizes.add(&estimate, 0.1);
        }
    }
    assert!(sizes.inside >= 46 && sizes.rms() < 0.03, "{sizes:?}");
}

#[test]
fn scenario_two_faults_are_named_or_left_open() {
    // Simultaneously and in sequence; opposite rotors of a hexarotor that fail equally at the same time are a pure vertical
    // force.
    for rotor_count in [4, 6, 8] {
        for second in 1..rotor_count {
            for second_from_s in [12.0, 16.0] {
                let log = run(&Conditions {
                    rotor_count,
                    loss: 0.08,
                    second: Some((second, second_from_s)),
                    duration_s: 22.0,
                    seed: 300 + second as u64,
                    ..Conditions::CALM
                });
                let last = log.last.expect("samples");
                let name = std::format!(
                    "rotors 1 and {} of {rotor_count} from {second_from_s} s: {:?}",
                    second + 1,
                    log.changes
                );
                let both = 1 | 1 << second;
                assert_eq!(last.suspects.rotors & both, both, "{name}");
                let twins =
                    (rotor_count == 6 && second == 3 || rotor_count == 8 && second == 4) && second_from_s == 12.0;
                if twins {
                    assert_eq!(last.sequential, FaultVerdict::Ambiguous, "{name}");
                    assert!(last.suspects.hypothesis_count >= 2, "{name}");
                    assert!(last.suspects.hypotheses.contains(&both), "{name}");
                } else {
                    let pair = FaultVerdict::FaultyPair {
                        first: 0,
                        second: second as u8,
                    };
                    assert_eq!(last.sequential, pair, "{name}");
                    for estimate in last.thrust_loss {
                        let [share, low, high] = estimate.share();
                        assert!(
                            (share - 0.08).abs() < 0.02 && low < share && share < high,
                            "{name}: {estimate:?}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn scenario_fault_that_heals_is_forgotten() {
    let log = run(&Conditions {
        loss: 0.08,
        rotor: 1,
        to_s: 16.0,
        duration_s: 20.0,
        ..Conditions::CALM
    });
    let last = log.changes.last().expect("verdicts");
    assert_eq!(last.1, FaultVerdict::Healthy, "{:?}", log.changes);
    assert!(last.0 > 16.0 && last.0 < 18.5);
    assert_eq!(log.last.expect("samples").thrust_loss[0].loss, 0.0);
}

#[test]
fn scenario_torque_between_two_rotors_is_unknown() {
    // Rotors 1 and 6 sit 30° right and left of forward: a nose-down torque is their average fault direction.
    let log = run(&Conditions {
        pitch_torque: -0.02,
        duration_s: 16.0,
        ..Conditions::CALM
    });
    let verdicts: Vec<FaultVerdict> = log.changes.iter().map(|change| change.1).collect();
    assert_eq!(
        verdicts,
        [FaultVerdict::NotReady, FaultVerdict::Healthy, FaultVerdict::Unknown],
        "{:?}",
        log.changes
    );
}

#[test]
fn scenario_shifted_gyro_is_no_fault() {
    let mut engine = FdiEngine::new(config(6)).expect("valid");
    let mut verdicts = Vec::new();
    let calm = Conditions {
        duration_s: 20.0,
        ..Conditions::CALM
    };
    fly(&calm, |t, measurement| {
        let mut shifted = *measurement;
        if t >= 12.0 {
            shifted.nav.body_rates.x += 0.02;
        }
        let verdict = engine.step(&shifted).sequential;
        if verdicts.last() != Some(&verdict) {
            verdicts.push(verdict);
        }
    });
    assert_eq!(verdicts, [FaultVerdict::NotReady, FaultVerdict::Healthy]);
}

#[test]
fn scenario_t_test_isolates_in_calm_hover() {
    let log = run(&Conditions {
        loss: 0.08,
        rotor: 2,
        circle: false,
        duration_s: 16.0,
        ..Conditions::CALM
    });
    let share = |from: f64, to: f64, verdict: FaultVerdict| {
        let within: Vec<_> = log
            .t_test
            .iter()
            .filter(|entry| entry.0 >= from && entry.0 < to)
            .collect();
        within.iter().filter(|entry| entry.1 == verdict).count() as f64 / within.len() as f64
    };
    assert_eq!(share(0.0, 10.0, FaultVerdict::NotReady), 1.0);
    assert_eq!(share(10.1, 12.0, FaultVerdict::Healthy), 1.0);
    // From one second after the onset: h = 5/s has settled.
    assert!(share(13.0, 16.0, FaultVerdict::Faulty { rotor: 2 }) > 0.8);
}

/// One calm flight with a fault, recorded once.
fn record() -> &'static [Measurement] {
    static RECORD: OnceLock<Vec<Measurement>> = OnceLock::new();
    RECORD.get_or_init(|| {
        let mut samples = Vec::new();
        fly(
            &Conditions {
                loss: 0.05,
                rotor: 3,
                ..Conditions::CALM
            },
            |_, measurement| samples.push(*measurement),
        );
        samples
    })
}

fn poisoned(sample: &Measurement, which: usize, value: f32) -> Measurement {
    let mut bad = *sample;
    match which % 8 {
        0 => bad.nav.position_ned.x = value,
        1 => bad.nav.velocity_ned.z = value,
        2 => bad.nav.attitude.pitch = value,
        3 => bad.nav.body_rates.y = value,
        4 => bad.battery_voltage = value,
        5 => bad.command.duty[3] = value,
        6 => bad.nav.attitude.yaw = value,
        _ => bad.nav.body_rates.z = value,
    }
    bad
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn prop_rejected_samples_leave_the_verdict(seed in 0u64..1000) {
        let mut noise = Noise(seed + 1);
        let mut engine = FdiEngine::new(config(6)).expect("valid");
        let mut rejected = 0;
        let mut last = None;
        for sample in record() {
            let bad = noise.uniform() < 0.05;
            let before = engine.output;
            let output = if bad {
                let value = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][(noise.uniform() * 3.0) as usize];
                rejected += 1;
                engine.step(&poisoned(sample, (noise.uniform() * 8.0) as usize, value))
            } else {
                engine.step(sample)
            };
            prop_assert_eq!(output.rejected_samples, rejected);
            if bad {
                prop_assert_eq!(output.residuals, before.residuals);
                prop_assert_eq!(output.sequential, before.sequential);
                prop_assert!(!output.window_end);
            }
            prop_assert!(output.wrench_residual.iter().all(|r| r.is_finite()));
            last = Some(output);
        }
        prop_assert!(rejected > 50);
        prop_assert_eq!(last.expect("samples").sequential, FaultVerdict::Faulty { rotor: 3 });
    }

    #[test]
    fn prop_short_spikes_leave_the_verdict(seed in 0u64..1000) {
        let mut noise = Noise(seed + 1);
        let mut engine = FdiEngine::new(config(6)).expect("valid");
        let mut verdicts = Vec::new();
        for (k, sample) in record().iter().enumerate() {
            let spike = k > 1000 && noise.uniform() < 0.01;
            let sample = if spike { poisoned(sample, 3, 5.0) } else { *sample };
            let output = engine.step(&sample);
            if verdicts.last() != Some(&output.sequential) {
                verdicts.push(output.sequential);
            }
        }
        prop_assert_eq!(verdicts, [FaultVerdict::NotReady, FaultVerdict::Healthy, FaultVerdict::Faulty { rotor: 3 }]);
    }

    #[test]
    fn prop_absurd_input_neither_panics_nor_stays(
        seed in 0u64..1000,
        magnitude in 1.0f32..38.0,
    ) {
        let mut noise = Noise(seed + 1);
        let mut engine = FdiEngine::new(config(6)).expect("valid");
        let scale = libm::powf(10.0, magnitude);
        for _ in 0..8000 {
            let mut value = || (scale as f64 * noise.normal()) as f32;
            let output = engine.step(&Measurement {
                nav: NavState {
                    position_ned: Vec3::new(value(), value(), value()),
                    velocity_ned: Vec3::new(value(), value(), value()),
                    attitude: EulerAngles { roll: value(), pitch: value(), yaw: value() },
                    body_rates: Vec3::new(value(), value(), value()),
                },
                command: MotorCommand { duty: [value(); MAX_ROTORS] },
                battery_voltage: value(),
            });
            prop_assert!(output.wrench_residual.iter().all(|r| r.is_finite()));
            prop_assert!(output.sequential_probability.is_finite() && output.thrust_loss[0].high.is_finite());
        }
    }
}

#[test]
fn val_steps_without_a_network_stay_not_ready() {
    assert_eq!(
        run(&Conditions::CALM).last.expect("samples").network,
        FaultVerdict::NotReady
    );
}

#[test]
fn val_bad_configurations_are_refused() {
    let refused = |change: fn(&mut FdiConfig), field: &str| {
        let mut bad = config(6);
        change(&mut bad);
        let error = FdiEngine::new(bad).expect_err(field);
        let text = std::format!("{error}");
        assert!(text.contains(field), "{text}");
    };
    refused(|c| c.mass = 0.0, "mass");
    refused(|c| c.inertia_body[2] = f32::NAN, "inertia_body");
    refused(|c| c.gravity = -9.81, "gravity");
    refused(|c| c.linear_drag = -1.0, "linear_drag");
    refused(|c| c.angular_drag = f32::INFINITY, "angular_drag");
    refused(|c| c.period = 0.0, "period");
    refused(|c| c.observer_gain = 400.0, "observer_gain");
    refused(|c| c.window_len = 1, "window_len");
    refused(|c| c.t_test.alpha_detect = 2.0, "alpha_detect");
    refused(|c| c.t_test.baseline_end = 1.0, "baseline_end");
    refused(
        |c| c.nominal_thrust = NominalThrust::Lagged { time_constant: 0.0 },
        "time_constant",
    );
    refused(
        |c| c.nominal_thrust = NominalThrust::Linear { full_thrust: f32::NAN },
        "full_thrust",
    );
    refused(|c| c.sequential.calibration_end = 3.0, "calibration_end");
    refused(|c| c.sequential.updates_per_window = 0, "updates_per_window");
    refused(|c| c.sequential.evidence_to_isolate = f32::NAN, "evidence_to_isolate");
    refused(|c| c.sequential.disturbance_ceiling = 0.0, "disturbance_ceiling");
    let tables = [0.0; 4 * 3 * 4 * 3];
    let network = Network::new(
        4,
        &NetworkWeights {
            mean: &tables[..12],
            deviation: &[1.0; 12],
            hidden_weight: &tables[..144],
            hidden_bias: &tables[..12],
            output_weight: &tables[..60],
            output_bias: &tables[..5],
        },
    )
    .expect("complete");
    let mut bad = config(6);
    bad.network = Some(network);
    assert_eq!(
        FdiEngine::new(bad).expect_err("other vehicle"),
        FdiConfigError::NetworkRotorCount { vehicle: 6, network: 4 }
    );
}
