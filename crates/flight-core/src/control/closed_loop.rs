//! Tests of the controller in the loop with a compact plant in `f64`: Eqs. 1–9 and 19 in Euler angles, first-order
//! rotor lag, battery, RK4.

use super::*;
use crate::frames::Vec3;
use crate::test_plant::FreeBody;
use core::f32::consts::FRAC_PI_6;
use core::f64::consts::TAU;
use proptest::prelude::*;
use std::string::{String, ToString};
use std::vec::Vec;

const N: usize = 6;
/// p, v, η, ω, f, SoC.
const STATES: usize = 12 + N + 1;
const DT: f64 = 0.0025;
const SAMPLES: usize = 4800;
/// 6 s.
const FAULT_SAMPLE: usize = 2400;
const FAULTY_ROTOR: usize = 2;

fn vector_file(name: &str) -> String {
    let path = std::format!("{}/../../tests/vectors/{name}", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(path).expect("readable")
}

struct Plant {
    params: serde_json::Value,
    ocv: Vec<f64>,
    blade: [[f64; 5]; N],
    state: [f64; STATES],
}

impl Plant {
    fn number(&self, key: &str) -> f64 {
        self.params[key].as_f64().expect("number")
    }

    fn blade_from_params(&self, name: &str) -> [f64; 5] {
        core::array::from_fn(|k| self.params["blades"][name][k].as_f64().expect("number"))
    }

    fn new() -> Self {
        let params: serde_json::Value = serde_json::from_str(&vector_file("params.json")).expect("JSON");
        let knots = params["ocv_cell_every_5pct"].as_array().expect("array");
        let ocv = knots.iter().map(|v| 4.0 * v.as_f64().expect("number")).collect();
        let mut plant = Self {
            params,
            ocv,
            blade: [[0.0; 5]; N],
            state: [0.0; STATES],
        };
        plant.blade = [plant.blade_from_params("a"); N];
        let hover = plant.number("m") * plant.number("g") / N as f64;
        plant.state[..3].copy_from_slice(&[2.0, 0.0, -5.0]);
        plant.state[12..12 + N].fill(hover);
        plant.state[STATES - 1] = 0.9;
        plant
    }

    fn lift(blade: &[f64; 5], duty: f64, voltage: f64) -> f64 {
        let u = 100.0 * duty;
        let [a0, a1, a2, a3, v0] = *blade;
        ((voltage - v0) * (a0 * u.sqrt() + a1 * u + a2 * u * u + a3 * u * u * u)).max(0.0)
    }

    fn power(&self, x: &[f64; STATES]) -> f64 {
        let sum: f64 = x[12..12 + N].iter().map(|f| f.max(0.0).powf(1.5)).sum();
        self.number("KP_W_per_N15") * sum
    }

    fn voltage(&self, x: &[f64; STATES]) -> f64 {
        let position = x[STATES - 1].clamp(0.0, 1.0) * 20.0;
        let knot = (position as usize).min(19);
        let share = position - knot as f64;
        let open = self.ocv[knot] + share * (self.ocv[knot + 1] - self.ocv[knot]);
        0.5 * (open + (open * open - 4.0 * self.number("Rin") * self.power(x)).sqrt())
    }

    /// Duty at which blade (a) lifts `thrust`.
    fn hover_duty(&self, thrust: f64, voltage: f64) -> f64 {
        let (mut low, mut high) = (0.0712, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if Self::lift(&self.blade[0], middle, voltage) < thrust {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }

    fn derivative(&self, x: &[f64; STATES], duty: &[f64; N]) -> [f64; STATES] {
        let l = self.number("l");
        let (kappa, tau) = (self.number("kappa"), self.number("tau"));
        let mut wrench = [0.0; 4];
        for i in 0..N {
            let f = x[12 + i];
            let (s, c) = (TAU / 12.0 + TAU * i as f64 / N as f64).sin_cos();
            wrench[0] -= f;
            wrench[1] -= l * s * f;
            wrench[2] += l * c * f;
            wrench[3] += if i % 2 == 0 { kappa * f } else { -kappa * f };
        }
        let mut dx = [0.0; STATES];
        let rigid = FreeBody {
            mass: self.number("m"),
            gravity: self.number("g"),
            inertia: core::array::from_fn(|k| self.params["J"][k].as_f64().expect("number")),
        };
        let body: &[f64; 12] = x.first_chunk().expect("the first twelve states");
        dx[..12].copy_from_slice(&rigid.rates(body, &wrench, &[0.0; 6]));
        let voltage = self.voltage(x);
        for i in 0..N {
            dx[12 + i] = (Self::lift(&self.blade[i], duty[i], voltage) - x[12 + i]) / tau;
        }
        dx[STATES - 1] = -self.power(x) / voltage / (3600.0 * self.number("Qnom_Ah"));
        dx
    }

    fn advance(&mut self, duty: &[f64; N]) {
        let x = self.state;
        let along = |k: &[f64; STATES], h: f64| core::array::from_fn(|i| x[i] + h * k[i]);
        let k1 = self.derivative(&x, duty);
        let k2 = self.derivative(&along(&k1, DT / 2.0), duty);
        let k3 = self.derivative(&along(&k2, DT / 2.0), duty);
        let k4 = self.derivative(&along(&k3, DT), duty);
        for i in 0..STATES {
            self.state[i] += DT / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
    }

    fn nav(&self) -> NavState {
        let x = self.state.map(|v| v as f32);
        NavState {
            position_ned: Vec3::new(x[0], x[1], x[2]),
            velocity_ned: Vec3::new(x[3], x[4], x[5]),
            attitude: EulerAngles {
                roll: x[6],
                pitch: x[7],
                yaw: x[8],
            },
            body_rates: Vec3::new(x[9], x[10], x[11]),
        }
    }
}

/// Helicoid of the closed-loop vector, velocity by backward difference.
fn reference(sample: usize) -> Reference {
    let position = |t: f64| {
        let turn = TAU * t / 15.0;
        [
            2.0 * turn.cos(),
            2.0 * turn.sin(),
            -5.0 - 1.5 * (1.0 - (TAU * t / 45.0).cos()),
        ]
    };
    let t = sample as f64 * DT;
    let now = position(t);
    let later = sample.max(1) as f64 * DT;
    let (a, b) = (position(later - DT), position(later));
    let velocity: [f64; 3] = core::array::from_fn(|k| (b[k] - a[k]) / DT);
    Reference {
        position_ned: Vec3::from_array(now.map(|v| v as f32)),
        velocity_ned: Vec3::from_array(velocity.map(|v| v as f32)),
        yaw: (0.3 * (TAU * t / 30.0).sin()) as f32,
    }
}

fn config(thrust_to_duty: ThrustToDuty) -> ControllerConfig {
    let slow = PidGains {
        proportional: 4.98,
        integral: 2.08,
        derivative: 3.9,
    };
    let fast = PidGains {
        proportional: 242.0,
        integral: 720.0,
        derivative: 27.0,
    };
    ControllerConfig {
        geometry: Geometry::regular(N, 0.275, 0.016, FRAC_PI_6).expect("flyable"),
        mass: 1.55,
        inertia_body: [0.0266, 0.0266, 0.0498],
        gravity: 9.81,
        period: 0.0025,
        position_gains: [slow; 3],
        attitude_gains: [fast, fast, slow],
        tilt_limit: 35f32.to_radians(),
        thrust_to_duty,
    }
}

const LINEAR: ThrustToDuty = ThrustToDuty::Linear { full_thrust: 12.0059 };

fn inverse_map() -> ThrustToDuty {
    let blade_a = [-1.4310e-2, 4.6339e-3, 1.0350e-4, -1.7318e-7];
    ThrustToDuty::InverseMap(ThrustMap::new(blade_a, 5.2859).expect("Table 1"))
}

fn controller(thrust_to_duty: ThrustToDuty) -> Controller {
    Controller::new(config(thrust_to_duty)).expect("valid")
}

/// Flies the 12 s of the closed-loop vector; `observe` is called with sample, plant and output before each plant step,
/// and
/// `disturb` may corrupt the controller's inputs.
fn fly(
    thrust_to_duty: ThrustToDuty,
    disturb: impl Fn(usize, &mut NavState),
    mut observe: impl FnMut(usize, &Plant, &ControlOutput),
) {
    let mut plant = Plant::new();
    let mut controller = controller(thrust_to_duty);
    let voltage = plant.voltage(&plant.state);
    let hover = plant.hover_duty(plant.state[12], voltage);
    controller.trim(hover as f32, voltage as f32);
    for sample in 0..SAMPLES {
        if sample == FAULT_SAMPLE {
            plant.blade[FAULTY_ROTOR] = plant.blade_from_params("b");
        }
        let mut nav = plant.nav();
        disturb(sample, &mut nav);
        let voltage = plant.voltage(&plant.state) as f32;
        let output = controller.step(&nav, &reference(sample), voltage);
        observe(sample, &plant, &output);
        let duty = core::array::from_fn(|i| f64::from(output.command.duty[i]));
        plant.advance(&duty);
    }
}

/// Largest deviations from the double-precision flight allowed over 12 s: about four times what was measured. Sensed
/// state, gains and integrators are rounded to f32 (6e-8 of 5 m, of 242/s², of 0.38), and the loop is stable, so that
/// the rounding noise is filtered rather than summed.
const POSITION_TOLERANCE: f64 = 4e-6;
const VELOCITY_TOLERANCE: f64 = 3e-6;
const ATTITUDE_TOLERANCE: f64 = 2e-7;
const RATES_TOLERANCE: f64 = 1e-6;
const THRUST_TOLERANCE: f64 = 4e-6;
const CHARGE_TOLERANCE: f64 = 3e-10;
const VOLTAGE_TOLERANCE: f64 = 2e-7;
const DUTY_TOLERANCE: f64 = 5e-7;

#[test]
fn val_reference_flight() {
    let text = vector_file("closed_loop.csv");
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|v| v.parse().expect("number")).collect())
        .collect();
    let groups = [
        (1..4, POSITION_TOLERANCE),
        (4..7, VELOCITY_TOLERANCE),
        (7..10, ATTITUDE_TOLERANCE),
        (10..13, RATES_TOLERANCE),
        (13..19, THRUST_TOLERANCE),
        (19..20, CHARGE_TOLERANCE),
        (20..21, VOLTAGE_TOLERANCE),
        (21..27, DUTY_TOLERANCE),
    ];
    let mut worst = [0.0f64; 8];
    let mut compared = 0;
    fly(
        LINEAR,
        |_, _| (),
        |sample, plant, output| {
            assert!(!output.input_rejected);
            assert_eq!(output.saturated_rotors, 0);
            if sample % 80 != 0 && sample != SAMPLES - 1 {
                return;
            }
            let want = &rows[compared];
            compared += 1;
            let mut got = std::vec![sample as f64 * DT];
            got.extend(plant.state);
            got.push(plant.voltage(&plant.state));
            got.extend(output.command.duty[..N].iter().map(|u| f64::from(*u)));
            assert!((got[0] - want[0]).abs() < 1e-9);
            for (group, (columns, _)) in groups.iter().enumerate() {
                for column in columns.clone() {
                    worst[group] = worst[group].max((got[column] - want[column]).abs());
                }
            }
        },
    );
    assert_eq!(compared, rows.len());
    for ((columns, tolerance), worst) in groups.iter().zip(worst) {
        assert!(worst < *tolerance, "columns {columns:?}: {worst:e} of {tolerance:e}");
    }
}

/// Distance from the reference, m.
fn distance(sample: usize, plant: &Plant) -> f32 {
    (reference(sample).position_ned - plant.nav().position_ned).norm()
}

#[test]
fn scenario_inverse_map_flies_the_helicoid() {
    let mut last = f32::INFINITY;
    fly(
        inverse_map(),
        |_, _| (),
        |sample, plant, output| {
            assert!(!output.input_rejected);
            // From rest, the step in reference velocity demands more roll torque than the available lift allows.
            assert!(output.saturated_rotors == 0 || sample < 400, "sample {sample}");
            last = distance(sample, plant);
        },
    );
    // No feed-forward: the helicoid is followed at centimetres (0.06 m here, 0.11 m with the linear map).
    assert!(last < 0.1, "{last} m");
}

#[test]
fn scenario_rejected_input_is_flown_through() {
    let burst = 2000..2020;
    let spoil = |sample: usize, nav: &mut NavState| {
        if (2000..2020).contains(&sample) {
            let bad = [f32::NAN, f32::INFINITY, -2.0 * INPUT_LIMIT, f32::MAX];
            nav.position_ned.z = bad[sample % 4];
        }
    };
    let mut before = ControlOutput::default();
    let mut rejected = 0;
    let mut spoilt = [0.0; STATES];
    fly(LINEAR, spoil, |sample, plant, output| {
        assert_eq!(output.input_rejected, burst.contains(&sample), "sample {sample}");
        if output.input_rejected {
            rejected += 1;
            assert_eq!(output.command, before.command);
        }
        before = *output;
        spoilt = plant.state;
    });
    assert_eq!(rejected, burst.len());
    let mut clean = [0.0; STATES];
    fly(LINEAR, |_, _| (), |_, plant, _| clean = plant.state);
    for k in 0..3 {
        // A 50 ms sensor outage shifts the flight by centimetres, which decay within 7 s; corrupted integrators would
        // not recover.
        assert!(
            (spoilt[k] - clean[k]).abs() < 1e-3,
            "axis {k}: {} against {}",
            spoilt[k],
            clean[k]
        );
    }
}

fn at_rest() -> (NavState, Reference) {
    (NavState::default(), Reference::default())
}

/// Duty: a handful of f32 operations on 0.38.
const STATIC_DUTY_TOLERANCE: f32 = 3e-7;

#[test]
fn val_trim_commands_the_hover_duty() {
    for map in [LINEAR, inverse_map()] {
        let mut controller = controller(map);
        controller.trim(0.381, 16.3);
        let (nav, reference) = at_rest();
        // Until a valid input arrives, the trimmed command is held.
        let lost = NavState {
            body_rates: Vec3::new(0.0, f32::NAN, 0.0),
            ..nav
        };
        let held = controller.step(&lost, &reference, 16.3);
        assert!(held.input_rejected);
        let output = controller.step(&nav, &reference, 16.3);
        assert!(!output.input_rejected);
        for k in 0..N {
            assert!((output.command.duty[k] - 0.381).abs() < STATIC_DUTY_TOLERANCE);
            assert!((held.command.duty[k] - 0.381).abs() < STATIC_DUTY_TOLERANCE);
        }
        assert!(output.command.duty[N..].iter().all(|u| *u == 0.0));
        assert!((output.collective_thrust - held.collective_thrust).abs() < 1e-5);
    }
}

#[test]
fn val_lost_voltage_is_replaced_by_the_last_one() {
    let (nav, reference) = at_rest();
    for lost in [f32::NAN, f32::INFINITY, 0.0, 5.2859, -16.0] {
        let linear = controller(LINEAR).step(&nav, &reference, lost);
        assert!(!linear.input_rejected && !linear.voltage_substituted);

        let mut controller = controller(inverse_map());
        let never = controller.step(&nav, &reference, lost);
        assert!(never.input_rejected);
        assert_eq!(never.command, MotorCommand::default());

        let measured = controller.step(&nav, &reference, 16.0);
        assert!(!measured.input_rejected && !measured.voltage_substituted);
        let substituted = controller.step(&nav, &reference, lost);
        assert!(!substituted.input_rejected && substituted.voltage_substituted);
        assert_eq!(substituted.command, measured.command);
    }
}

#[test]
fn val_signs_and_limits_of_the_setpoint() {
    let (nav, reference) = at_rest();
    let towards = |north: f32, east: f32, down: f32, yaw: f32| {
        let mut controller = controller(LINEAR);
        let nav = NavState {
            attitude: EulerAngles { yaw, ..nav.attitude },
            ..nav
        };
        let reference = Reference {
            position_ned: Vec3::new(north, east, down),
            yaw,
            ..reference
        };
        controller.step(&nav, &reference, 16.0)
    };
    // Degrees of a setpoint; f32 asin, atan2 and sqrt.
    let close = |got: f32, want: f32| (got.to_degrees() - want).abs() < 1e-4;

    let north = towards(100.0, 0.0, 0.0, 0.0).attitude_setpoint;
    assert!(close(north.pitch, -35.0) && close(north.roll, 0.0), "{north:?}");
    let east = towards(0.0, 100.0, 0.0, 0.0).attitude_setpoint;
    assert!(close(east.roll, 35.0) && close(east.pitch, 0.0), "{east:?}");
    let east_facing_east = towards(0.0, 100.0, 0.0, core::f32::consts::FRAC_PI_2).attitude_setpoint;
    assert!(
        close(east_facing_east.pitch, -35.0) && close(east_facing_east.roll, 0.0),
        "{east_facing_east:?}"
    );
    // Small angles: tan θ = −a/g, a = 4.98 · 0.1.
    let near = towards(0.1, 0.0, 0.0, 0.0).attitude_setpoint;
    assert!(close(near.pitch, -(0.498f32 / 9.81).atan().to_degrees()), "{near:?}");

    // Far below: the minimum specific force applies. Far above: more than the motors can deliver.
    let sink = towards(0.0, 0.0, 100.0, 0.0);
    assert!((sink.collective_thrust - 1.55 * position::MIN_SPECIFIC_THRUST).abs() < 1e-6);
    assert_eq!(sink.saturated_rotors, 0);
    let climb = towards(0.0, 0.0, -100.0, 0.0);
    assert_eq!(climb.saturated_rotors, 0b11_1111);
    assert_eq!(climb.command.duty[..N], [1.0; N]);
}

#[test]
fn val_tilt_compensation_is_bounded() {
    let (nav, reference) = at_rest();
    let thrust = |roll: f32| {
        let nav = NavState {
            attitude: EulerAngles { roll, ..nav.attitude },
            ..nav
        };
        controller(LINEAR).step(&nav, &reference, 16.0).collective_thrust
    };
    let weight = 1.55 * 9.81;
    for (roll, cosine) in [(0.0, 1.0), (1.0, libm::cosf(1.0)), (1.5, 0.3), (3.0, 0.3)] {
        // N: four f32 operations on 15 to 51 N.
        assert!((thrust(roll) - weight / cosine).abs() < 1e-5, "roll {roll}");
    }
}

#[test]
fn val_yaw_error_takes_the_short_way() {
    let (nav, reference) = at_rest();
    let duty = |measured: f32, wanted: f32| {
        let mut controller = controller(LINEAR);
        let nav = NavState {
            attitude: EulerAngles {
                yaw: measured,
                ..nav.attitude
            },
            ..nav
        };
        let reference = Reference {
            yaw: wanted,
            ..reference
        };
        controller.step(&nav, &reference, 16.0).command.duty
    };
    let short = duty(0.0, 6.2 - core::f32::consts::TAU);
    for (k, across) in duty(-3.1, 3.1).into_iter().enumerate() {
        // The wrap itself rounds 6.2 rad to 2.4e-7, times 4.98 · 0.0498 · 10.4 / 12.
        assert!((across - short[k]).abs() < 1e-6, "rotor {k}");
    }
    // Nose left: less thrust on the rotors that turn counter-clockwise and yaw it to the right.
    assert!(short[0] < short[1]);
}

#[test]
fn val_saturated_rotors_are_named() {
    let (nav, reference) = at_rest();
    for map in [LINEAR, inverse_map()] {
        // Rolls hard to the right: the right-hand rotors 1 to 3 must stop, the left-hand ones saturate at full duty.
        let nav = NavState {
            body_rates: Vec3::new(-50.0, 0.0, 0.0),
            ..nav
        };
        let output = controller(map).step(&nav, &reference, 16.0);
        assert_eq!(output.saturated_rotors, 0b11_1111);
        assert_eq!(output.command.duty[..N], [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        let gentle = NavState {
            body_rates: Vec3::new(-3.0, 0.0, 0.0),
            ..nav
        };
        // 27 · 3 · 0.0266 N·m: 1.3 N on the outer four and 2.6 N, more than the weight's share, on rotors 2 and 5.
        let output = controller(map).step(&gentle, &reference, 16.0);
        assert_eq!(output.saturated_rotors, 0b00_0010);
        assert_eq!(output.command.duty[1], 0.0);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn prop_any_input_gives_duties_and_never_poisons_the_integrators(
        garbage in proptest::collection::vec(any::<f32>(), 20 * 4), linear in any::<bool>(),
    ) {
        let mut controller = controller(if linear { LINEAR } else { inverse_map() });
        controller.trim(0.38, 16.0);
        let check = |output: &ControlOutput| {
            output.command.duty[..N].iter().all(|u| (0.0..=1.0).contains(u))
                && output.command.duty[N..].iter().all(|u| *u == 0.0)
                && output.saturated_rotors < 1 << N
                && output.collective_thrust.is_finite()
                && output.attitude_setpoint.roll.is_finite()
                && output.attitude_setpoint.pitch.is_finite()
        };
        for v in garbage.chunks_exact(20) {
            let nav = NavState {
                position_ned: Vec3::new(v[0], v[1], v[2]),
                velocity_ned: Vec3::new(v[3], v[4], v[5]),
                attitude: EulerAngles { roll: v[6], pitch: v[7], yaw: v[8] },
                body_rates: Vec3::new(v[9], v[10], v[11]),
            };
            let reference = Reference {
                position_ned: Vec3::new(v[12], v[13], v[14]),
                velocity_ned: Vec3::new(v[15], v[16], v[17]),
                yaw: v[18],
            };
            let output = controller.step(&nav, &reference, v[19]);
            prop_assert!(check(&output), "{output:?}");
        }
        let (nav, reference) = at_rest();
        let output = controller.step(&nav, &reference, 16.0);
        prop_assert!(!output.input_rejected && check(&output), "{output:?}");
    }
}

#[test]
fn val_refusals_name_the_reason() {
    type Spoil = fn(&mut ControllerConfig);
    let cases: [(Spoil, &str); 9] = [
        (|c| c.mass = 0.0, "the mass must be a positive, finite number"),
        (|c| c.inertia_body[2] = f32::NAN, "the moment of inertia about z must"),
        (|c| c.gravity = -9.81, "the gravity must"),
        (|c| c.period = 2.0, "the control period must be 1 s or less"),
        (
            |c| c.tilt_limit = 1.5,
            "the tilt limit must be above 0 and at most 80 degrees",
        ),
        (
            |c| c.attitude_gains[1].derivative = -27.0,
            "the gains of the pitch axis",
        ),
        (
            |c| c.position_gains[2].integral = f32::INFINITY,
            "the gains of the z axis",
        ),
        (
            |c| c.thrust_to_duty = ThrustToDuty::Linear { full_thrust: 2.5 },
            "rotor 1 cannot give the thrust that hover asks of it",
        ),
        (
            // All rotors but one are forward of the centre of mass: the least-squares allocation makes that one push
            // down.
            |c| {
                let mut rotors = [c.geometry.rotors()[0]; 5];
                rotors.copy_from_slice(&c.geometry.rotors()[..5]);
                for (r, x) in rotors.iter_mut().zip([0.4, 0.2, 0.3, 0.3, 0.1]) {
                    r.position_body.x = x;
                }
                c.geometry = Geometry::new(&rotors).expect("of full rank");
            },
            "cannot give the thrust that hover asks of it",
        ),
    ];
    for (spoil, reason) in cases {
        let mut cfg = config(LINEAR);
        spoil(&mut cfg);
        let text = Controller::new(cfg).expect_err("refused").to_string();
        assert!(text.contains(reason), "{text}");
    }
    assert!(Controller::new(config(inverse_map())).is_ok());
}
