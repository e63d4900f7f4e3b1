//! Suspicious logs: each error is named, and a log without errors has no finding.
//!
//! The motion is analytic, so that all columns are exactly consistent; then one error at a time is introduced.

use rotortwin_plant::vehicle::model::{Layout, VehicleModel};
use rotortwin_twin::log::{FindingKind, FlightLog, names};
use std::path::PathBuf;

const GRAVITY_M_S2: f64 = 9.81;

type Columns = Vec<(String, Vec<f64>)>;

fn ned_from_body([roll, pitch, yaw]: [f64; 3]) -> [[f64; 3]; 3] {
    let (sr, cr) = roll.sin_cos();
    let (sp, cp) = pitch.sin_cos();
    let (sy, cy) = yaw.sin_cos();
    [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
}

/// Noise that repeats: uniform in ±1.
fn noise(state: &mut u64) -> f64 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// 60 s of motion at a rate: time, and every kinematic column in NED and FRD with a little noise.
fn motion(rate_hz: f64) -> (Vec<f64>, Columns) {
    let rows = (60.0 * rate_hz) as usize;
    let time: Vec<f64> = (0..rows).map(|row| row as f64 / rate_hz).collect();
    // Sums of sines: value, first and second derivative.
    let wave = |t: f64, parts: &[(f64, f64)]| -> [f64; 3] {
        parts
            .iter()
            .enumerate()
            .fold([0.0; 3], |[x, v, a], (index, (size, hertz))| {
                let w = std::f64::consts::TAU * hertz;
                let (sin, cos) = (w * t + 0.7 * index as f64).sin_cos();
                [x + size * sin, v + size * w * cos, a - size * w * w * sin]
            })
    };
    let waves: [&[(f64, f64)]; 6] = [
        &[(1.5, 0.11), (0.3, 0.41), (0.05, 0.9)],
        &[(1.2, 0.13), (0.25, 0.37), (0.06, 0.8)],
        &[(0.8, 0.09), (0.15, 0.33)],
        &[(0.15, 0.6), (0.05, 1.7)],
        &[(0.12, 0.5), (0.06, 1.3)],
        &[(0.5, 0.15), (0.1, 0.7)],
    ];
    let mut state = 42;
    let names: Vec<&str> = [
        names::POSITION,
        names::VELOCITY,
        names::ATTITUDE,
        names::RATES,
        names::ACCEL,
    ]
    .concat();
    let sizes = [0.002, 0.01, 0.001, 0.005, 0.05];
    let mut columns: Columns = names.iter().map(|name| ((*name).to_owned(), Vec::new())).collect();
    for t in &time {
        let parts: Vec<[f64; 3]> = waves.iter().map(|parts| wave(*t, parts)).collect();
        let angle = |axis: usize, order: usize| parts[3 + axis][order];
        let attitude = [angle(0, 0), angle(1, 0), angle(2, 0)];
        let (roll, pitch) = (attitude[0], attitude[1]);
        let rates = [
            angle(0, 1) - angle(2, 1) * pitch.sin(),
            angle(1, 1) * roll.cos() + angle(2, 1) * roll.sin() * pitch.cos(),
            -angle(1, 1) * roll.sin() + angle(2, 1) * roll.cos() * pitch.cos(),
        ];
        let rotation = ned_from_body(attitude);
        let needed = [parts[0][2], parts[1][2], parts[2][2] - GRAVITY_M_S2];
        let force = [0, 1, 2].map(|axis| (0..3).map(|k| rotation[k][axis] * needed[k]).sum::<f64>());
        let values = [
            [parts[0][0], parts[1][0], parts[2][0] - 3.0],
            [parts[0][1], parts[1][1], parts[2][1]],
            attitude,
            rates,
            force,
        ];
        for (index, value) in values.iter().flatten().enumerate() {
            columns[index].1.push(value + sizes[index / 3] * noise(&mut state));
        }
    }
    (time, columns)
}

fn quad() -> VehicleModel {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/quad-x.toml");
    toml::from_str(&std::fs::read_to_string(root).expect("the vehicle file is in the repository")).expect("it is valid")
}

/// Duties whose lagged torque turns the vehicle as the columns say, with a little noise.
fn add_duties(time: &[f64], columns: &mut Columns, vehicle: &VehicleModel) {
    add_duties_with_noise(time, columns, vehicle, 0.001);
}

fn add_duties_with_noise(time: &[f64], columns: &mut Columns, vehicle: &VehicleModel, size: f64) {
    let dt = time[1] - time[0];
    let column = |name: &str| columns.iter().find(|(other, _)| other == name).expect("made").1.clone();
    let turning: Vec<Vec<f64>> = names::RATES
        .iter()
        .map(|name| {
            let rates = column(name);
            // Smooth over 25 ms, as the real torque is.
            let half = (0.0125 / dt) as usize + 1;
            (0..rates.len())
                .map(|row| {
                    let (first, last) = (row.saturating_sub(half), (row + half).min(rates.len() - 1));
                    (rates[last] - rates[first]) / ((last - first) as f64 * dt)
                })
                .collect()
        })
        .collect();
    let mut state = 7;
    for (rotor, placement) in vehicle.rotors.layout.placements().iter().enumerate() {
        let arm = placement.torque_arm([0.0; 3], 1.0);
        let inertia = vehicle.body.inertia_body_kg_m2;
        let power = |axis: usize| {
            let placements = vehicle.rotors.layout.placements();
            placements
                .iter()
                .map(|other| other.torque_arm([0.0; 3], 1.0)[axis].powi(2))
                .sum::<f64>()
        };
        let thrust: Vec<f64> = (0..time.len())
            .map(|row| {
                (0..3)
                    .map(|axis| inertia[axis] * turning[axis][row] * arm[axis] / power(axis))
                    .sum()
            })
            .collect();
        let duty = (0..time.len())
            .map(|row| {
                let next = thrust[(row + 1).min(thrust.len() - 1)];
                let lead = thrust[row] + vehicle.rotors.thrust_lag_s * (next - thrust[row]) / dt;
                (0.4 + lead / 20.0 + size * noise(&mut state)).clamp(0.0, 1.0)
            })
            .collect();
        columns.push((names::duty(rotor + 1), duty));
    }
}

fn log(time: Vec<f64>, columns: Columns) -> FlightLog {
    FlightLog::from_columns("made up", time, columns).expect("nothing to refuse")
}

fn kinds(log: &FlightLog) -> Vec<FindingKind> {
    log.report.findings.iter().map(|finding| finding.kind.clone()).collect()
}

fn change(columns: &mut Columns, names: &[&str], mut with: impl FnMut(f64) -> f64) {
    for (name, values) in columns {
        if names.contains(&name.as_str()) {
            for value in values {
                *value = with(*value);
            }
        }
    }
}

fn exchange(columns: &mut Columns, a: &str, b: &str) {
    for (name, _) in columns {
        if name == a {
            *name = b.to_owned();
        } else if name == b {
            *name = a.to_owned();
        }
    }
}

/// Names, and what to do to the log.
type Mistake = (&'static str, FindingKind, fn(&mut Vec<f64>, &mut Columns));

const MISTAKES: [Mistake; 18] = [
    ("rates in deg/s", FindingKind::RatesInDegrees, |_, c| {
        change(c, &names::RATES, f64::to_degrees)
    }),
    ("small angles in degrees", FindingKind::AnglesInDegrees, |_, c| {
        // Small enough to pass for radians.
        change(c, &names::ATTITUDE, |angle| (0.1 * angle).to_degrees());
        change(c, &names::RATES, |rate| 0.1 * rate);
        c.retain(|(name, _)| !names::VELOCITY.contains(&name.as_str()));
    }),
    ("rates in FLU", FindingKind::BodyAxesFlu, |_, c| {
        change(c, &names::RATES[1..], |rate| -rate)
    }),
    ("IMU in FLU", FindingKind::BodyAxesFlu, |_, c| {
        change(c, &names::RATES[1..], |rate| -rate);
        change(c, &names::ACCEL[1..], |force| -force);
    }),
    ("accelerometer upside down", FindingKind::UpsideDownAxes, |_, c| {
        change(c, &names::ACCEL[1..], |force| -force);
    }),
    ("upside down, no attitude", FindingKind::UpsideDownAxes, |_, c| {
        c.retain(|(name, _)| names::ACCEL.contains(&name.as_str()) || names::RATES.contains(&name.as_str()));
        change(c, &names::ACCEL[2..], |force| -force);
    }),
    ("velocity in ENU", FindingKind::WorldAxesEnu, |_, c| {
        exchange(c, names::VELOCITY[0], names::VELOCITY[1]);
        change(c, &names::VELOCITY[2..], |velocity| -velocity);
    }),
    ("position and velocity in ENU", FindingKind::WorldAxesEnu, |_, c| {
        exchange(c, names::VELOCITY[0], names::VELOCITY[1]);
        exchange(c, names::POSITION[0], names::POSITION[1]);
        change(c, &[names::VELOCITY[2], names::POSITION[2]], |value| -value);
    }),
    ("z up everywhere", FindingKind::WorldAxesEnu, |_, c| {
        // Turning world and body by half a turn about x keeps the identities: NWU and FLU.
        change(c, &[names::ATTITUDE[1], names::ATTITUDE[2]], |angle| -angle);
        change(c, &names::RATES[1..], |rate| -rate);
        change(c, &names::ACCEL[1..], |force| -force);
        change(c, &names::VELOCITY[1..], |velocity| -velocity);
        change(c, &names::POSITION[1..], |position| -position);
    }),
    ("roll and pitch rate exchanged", FindingKind::SwappedAxes, |_, c| {
        exchange(c, names::RATES[0], names::RATES[1])
    }),
    ("accelerometer x and z exchanged", FindingKind::SwappedAxes, |_, c| {
        exchange(c, names::ACCEL[0], names::ACCEL[2])
    }),
    ("time stamps half as long", FindingKind::TimeScale, |t, _| {
        t.iter_mut().for_each(|time| *time *= 0.5)
    }),
    ("time stamps twice as long", FindingKind::TimeScale, |t, _| {
        t.iter_mut().for_each(|time| *time *= 2.0)
    }),
    (
        "position and velocity in millimetres",
        FindingKind::ScaleMismatch,
        |_, c| {
            change(c, &names::POSITION, |metres| 1000.0 * metres);
            change(c, &names::VELOCITY, |metres_per_s| 1000.0 * metres_per_s);
        },
    ),
    ("position in feet", FindingKind::ScaleMismatch, |_, c| {
        change(c, &names::POSITION, |position| position / 0.3048)
    }),
    ("stuck gyroscope", FindingKind::Stuck, |_, c| {
        change(c, &names::RATES[..1], |_| 0.1)
    }),
    ("saturated gyroscope", FindingKind::Saturated, |_, c| {
        change(c, &names::RATES[..1], |rate| rate.clamp(-0.3, 0.3))
    }),
    ("one column", FindingKind::OneColumn, |_, c| c.truncate(1)),
];

#[test]
fn val_each_mistake_is_named_at_each_rate() {
    for rate_hz in [50.0, 250.0, 1000.0] {
        let (time, columns) = motion(rate_hz);
        let clean = log(time.clone(), columns.clone());
        assert!(
            clean.report.findings.is_empty(),
            "{rate_hz} Hz, nothing wrong: {:?}",
            clean.report.findings
        );
        for (name, kind, make) in &MISTAKES {
            let (mut time, mut columns) = (time.clone(), columns.clone());
            make(&mut time, &mut columns);
            let found = log(time, columns);
            assert!(
                kinds(&found).contains(kind),
                "{name} at {rate_hz} Hz: {:?}",
                found.report.findings
            );
        }
    }
}

#[test]
fn val_units_that_a_gain_gives_away_are_named() {
    for (length, speed, expected) in [
        (
            1000.0,
            1000.0,
            "the velocity seems to be in mm/s and the position in mm",
        ),
        (100.0, 100.0, "the velocity seems to be in cm/s and the position in cm"),
        (1.0, 3.6, "the velocity seems to be in km/h; m/s was expected"),
        (1.0 / 0.3048, 1.0, "the position seems to be in ft; m was expected"),
    ] {
        let (time, mut columns) = motion(100.0);
        change(&mut columns, &names::POSITION, |metres| length * metres);
        change(&mut columns, &names::VELOCITY, |metres_per_s| speed * metres_per_s);
        let found = log(time, columns).report.findings;
        let said = found.iter().find(|one| one.kind == FindingKind::ScaleMismatch);
        let detail = &said.unwrap_or_else(|| panic!("{expected}: {found:?}")).detail;
        assert!(detail.contains(expected), "{detail}");
    }
    // No unit that anybody writes.
    let (time, mut columns) = motion(100.0);
    change(&mut columns, &names::POSITION, |metres| 17.0 * metres);
    let found = log(time, columns).report.findings;
    assert!(
        found.iter().any(|one| one.detail.ends_with("a unit is wrong")),
        "{found:?}"
    );
}

#[test]
fn val_rows_that_are_seconds_apart_are_named() {
    let (time, columns) = motion(50.0);
    let ms = time.iter().map(|t| 1000.0 * t).collect();
    assert!(kinds(&log(ms, columns.clone())).contains(&FindingKind::SlowRows));
    assert!(!kinds(&log(time, columns)).contains(&FindingKind::SlowRows));
}

/// A calm hover without an accelerometer, whose columns are there all the same, was a vehicle at rest.
#[test]
fn regress_a_column_without_values_says_nothing_of_rest() {
    let time: Vec<f64> = (0..2000).map(|row| 0.01 * f64::from(row)).collect();
    let mut state = 7;
    let mut noisy =
        |mean: f64, size: f64| -> Vec<f64> { time.iter().map(|_| mean + size * noise(&mut state)).collect() };
    let mut columns: Columns = (1..=4)
        .map(|rotor| (format!("duty_{rotor}"), noisy(0.4, 0.001)))
        .collect();
    columns.extend(names::RATES.iter().map(|name| ((*name).to_owned(), noisy(0.0, 0.005))));
    for (values, is_at_rest) in [(noisy(-3.0, 0.001), true), (vec![f64::NAN; time.len()], false)] {
        let mut all = columns.clone();
        all.extend(names::ACCEL.iter().map(|name| ((*name).to_owned(), values.clone())));
        let found = kinds(&log(time.clone(), all));
        assert_eq!(found.contains(&FindingKind::NoFlight), is_at_rest, "{found:?}");
    }
}

#[test]
fn val_grounded_and_empty_logs_are_named() {
    let (time, mut columns) = motion(100.0);
    for rotor in 1..=4 {
        columns.push((names::duty(rotor), vec![0.02; time.len()]));
    }
    assert_eq!(kinds(&log(time.clone(), columns)), [FindingKind::NoFlight]);
    let (_, mut columns) = motion(100.0);
    columns.push(("battery_voltage_v".to_owned(), vec![f64::NAN; time.len()]));
    assert_eq!(kinds(&log(time, columns)), [FindingKind::AllMissing]);
}

#[test]
fn val_what_no_multirotor_and_no_battery_has_is_left_out_and_the_rest_is_read() {
    // An estimator that was logged and not flown by: it falls at 200 m/s and more, as its position says, too.
    let (time, mut columns) = motion(100.0);
    for (name, values) in &mut columns {
        let runaway: fn(f64, f64) -> f64 = match name.as_str() {
            "velocity_down_m_s" => |v, t| v + 120.0 + 4.0 * t,
            "position_down_m" => |x, t| x + (120.0 + 2.0 * t) * t,
            _ => continue,
        };
        values
            .iter_mut()
            .zip(&time)
            .for_each(|(value, t)| *value = runaway(*value, *t));
    }
    columns.push((
        "battery_voltage_v".to_owned(),
        time.iter().map(|t| 5.95 + 0.002 * t).collect(),
    ));
    let found = log(time.clone(), columns);
    for name in names::VELOCITY
        .iter()
        .chain(&names::POSITION)
        .chain(&["battery_voltage_v"])
    {
        assert!(found.column(name).is_none(), "{name}");
    }
    assert!(found.column("roll_rad").is_some() && found.column("accel_z_m_s2").is_some());
    assert_eq!(found.report.findings, []);
    let notes = found.report.notes.join("\n");
    assert!(
        notes.contains("the estimator ran away") && notes.contains("5.95 to 6.07 V"),
        "{notes}"
    );
    // What a battery and a fast vehicle have stays.
    let (time, mut columns) = motion(100.0);
    for (cells, cell_v) in [(1.0, 3.6), (3.0, 4.2), (6.0, 3.4), (12.0, 4.35)] {
        columns.retain(|(name, _)| name != "battery_voltage_v");
        columns.push((
            "battery_voltage_v".to_owned(),
            time.iter().map(|t| cells * (cell_v - 0.001 * t)).collect(),
        ));
        let found = log(time.clone(), columns.clone());
        assert!(found.column("battery_voltage_v").is_some() && found.column("velocity_down_m_s").is_some());
    }
}

/// PX4's own log of a correct hexarotor was rejected: "correlation² 2.76". Its allocation leaves six duties in a space
/// of four dimensions, and another order of them produces no torque about some axis except rounding.
#[test]
fn regress_an_exact_allocation_is_no_swapped_motor() {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
    let text = std::fs::read_to_string(root).expect("the vehicle file is in the repository");
    let vehicle: VehicleModel = toml::from_str(&text).expect("it is valid");
    let (time, mut columns) = motion(100.0);
    add_duties_with_noise(&time, &mut columns, &vehicle, 0.0);
    // As a log holds them.
    for (_, values) in columns.iter_mut().filter(|(name, _)| name.starts_with("duty_")) {
        values.iter_mut().for_each(|duty| *duty = f64::from(*duty as f32));
    }
    let right = log(time.clone(), columns.clone());
    assert_eq!(right.check_against_vehicle(&vehicle), []);
    exchange(&mut columns, &names::duty(2), &names::duty(3));
    let found = log(time, columns).check_against_vehicle(&vehicle);
    assert!(
        found.iter().any(|finding| finding.kind == FindingKind::SwappedMotors),
        "{found:?}"
    );
}

#[test]
fn val_swapped_motors_and_rotor_count_are_named() {
    let vehicle = quad();
    for rate_hz in [100.0, 400.0] {
        let (time, mut columns) = motion(rate_hz);
        add_duties(&time, &mut columns, &vehicle);
        let right = log(time.clone(), columns.clone());
        assert_eq!(right.check_against_vehicle(&vehicle), [], "{rate_hz} Hz");
        for (a, b) in [(1, 2), (1, 3), (2, 4)] {
            let mut swapped = columns.clone();
            exchange(&mut swapped, &names::duty(a), &names::duty(b));
            let found = log(time.clone(), swapped).check_against_vehicle(&vehicle);
            assert_eq!(found.len(), 1, "{a} {b} at {rate_hz} Hz");
            assert_eq!(found[0].kind, FindingKind::SwappedMotors);
            let says = format!("duty_{a} drives rotor {b}");
            assert!(found[0].detail.contains(&says), "{}", found[0].detail);
        }
        let mut hexa = vehicle.clone();
        hexa.rotors.layout = Layout::RegularX {
            rotors: 6,
            arm_length_m: 0.275,
            moment_ratio_m: 0.016,
        };
        assert_eq!(right.check_against_vehicle(&hexa)[0].kind, FindingKind::RotorCount);
    }
}

/// A delay is found within three of its own standard errors, or a millisecond, whichever is more.
#[test]
fn val_delays_are_found_and_taken_out() {
    const WITHIN_S: f64 = 1e-3;
    for rate_hz in [50.0, 400.0] {
        let (time, columns) = motion(rate_hz);
        let rows = (0.08 * rate_hz) as usize;
        let delayed = columns
            .iter()
            .map(|(name, values)| {
                let mut values = values.clone();
                if names::VELOCITY.contains(&name.as_str()) {
                    values.rotate_right(rows);
                    values[..rows].fill(f64::NAN);
                }
                (name.clone(), values)
            })
            .collect();
        let late = log(time, delayed);
        let expected_s = rows as f64 / rate_hz;
        for (signal, wanted_s) in [("attitude", 0.0), ("velocity", expected_s), ("position", -expected_s)] {
            let delay = late
                .report
                .delays
                .iter()
                .find(|delay| delay.signal == signal)
                .expect("enough motion");
            let within_s = WITHIN_S.max(3.0 * delay.uncertainty_s);
            assert!(
                (delay.delay_s - wanted_s).abs() < within_s,
                "{rate_hz} Hz: {delay:?}, {wanted_s} s were put in"
            );
        }
        let aligned = late.aligned();
        let again =
            FlightLog::from_columns("aligned", aligned.time_s.clone(), aligned.columns.clone()).expect("still a log");
        for delay in &again.report.delays {
            assert!(
                delay.delay_s.abs() < WITHIN_S.max(3.0 * delay.uncertainty_s),
                "{rate_hz} Hz: {delay:?} is left"
            );
        }
        assert!(aligned.report.delays.iter().any(|delay| delay.applied));
        assert!(!late.report.delays.iter().any(|delay| delay.applied));
    }
}

/// The vehicles of the public logs hover where their flights did.
#[test]
fn val_crazyflie_vehicles_hover_at_the_duty_of_their_flights() {
    use rotortwin_scenario::VehicleDocuments;
    // Duty and voltage of the hovers: CrazyPAD E8, mean of seven healthy flights; Eschmann et al., their curve at 27 g and the voltage
    // that the curve is taken at.
    for (file, duty, voltage_v) in [("crazyflie-e8", 0.676, 3.53), ("crazyflie-2", 0.66, 3.8)] {
        const WITHIN: f64 = 0.03;
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("../../config/vehicles/{file}.toml"));
        let vehicle = VehicleDocuments::load(&path).expect(file);
        let weight_n = vehicle.vehicle.body.mass_kg * vehicle.vehicle.body.gravity_m_s2;
        let blade = vehicle.nominal_blade();
        let lift_n = 4.0 * blade.lift(duty, voltage_v);
        assert!(
            (lift_n / weight_n - 1.0).abs() < WITHIN,
            "{file}: {lift_n} N carry {weight_n} N"
        );
    }
}
