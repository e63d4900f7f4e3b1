use super::*;
use std::f64::consts::FRAC_PI_2;

/// 50 Hz: 5 s at rest, 20 s of flight at a height of 5 m, 5 s at rest; a shaken airframe while it flies.
fn flown(columns: &[&str]) -> FlightLog {
    flown_with(columns, |_, values| values)
}

/// What a row holds.
#[derive(Clone, Copy)]
struct Row {
    duty: [f64; 4],
    roll: f64,
    rate: f64,
    accel_z: f64,
    down: f64,
}

fn flown_with(columns: &[&str], change: impl Fn(f64, Row) -> Row) -> FlightLog {
    let time: Vec<f64> = (0..1500).map(|k| 0.02 * f64::from(k)).collect();
    let rows: Vec<Row> = time
        .iter()
        .map(|&t| {
            let flies = (5.0..25.0).contains(&t);
            let height = if flies { (t - 5.0).min(25.0 - t).min(5.0) } else { 0.0 };
            let sway = if flies { (7.0 * t).sin() } else { 0.0 };
            change(
                t,
                Row {
                    duty: [if flies { 0.5 + 0.02 * sway } else { 0.05 }; 4],
                    roll: 0.05 * sway,
                    rate: 0.35 * if flies { (7.0 * t).cos() } else { 0.0 },
                    accel_z: -9.81 + sway,
                    down: -height,
                },
            )
        })
        .collect();
    let column = |name: &str| -> Vec<f64> {
        let of = |row: &Row| match name {
            "roll_rad" => row.roll,
            "roll_rate_rad_s" => row.rate,
            "accel_z_m_s2" => row.accel_z,
            "position_down_m" => row.down,
            "accel_x_m_s2" | "accel_y_m_s2" => 0.0,
            "pitch_rad" | "yaw_rad" | "pitch_rate_rad_s" | "yaw_rate_rad_s" => 0.0,
            duty => row.duty[duty.bytes().last().map_or(0, |digit| usize::from(digit - b'1'))],
        };
        rows.iter().map(of).collect()
    };
    let columns: Vec<(String, Vec<f64>)> = columns.iter().map(|name| ((*name).to_owned(), column(name))).collect();
    FlightLog::from_columns("flown", time, columns).expect("a log")
}

const DUTIES: [&str; 4] = ["duty_1", "duty_2", "duty_3", "duty_4"];
const ATTITUDE: [&str; 2] = ["roll_rad", "pitch_rad"];
const FORCES: [&str; 3] = ["accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"];
const RATES: [&str; 3] = ["roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"];

fn kinds(parts: &FlightParts) -> Vec<PartKind> {
    parts.parts.iter().map(|part| part.kind).collect()
}

const WHOLE: [PartKind; 5] = [
    PartKind::Ground,
    PartKind::TakeOff,
    PartKind::Air,
    PartKind::Landing,
    PartKind::Ground,
];

#[test]
fn val_motor_outputs_alone_tell_ground_from_flight() {
    let parts = flown(&DUTIES).flight_parts(None);
    assert_eq!(kinds(&parts), WHOLE, "{parts:?}");
    let air = parts.in_the_air();
    // 3 s off at either end, and half a second of the running mean.
    assert!((air[0].0 - 8.0).abs() < 0.6 && (air[0].1 - 22.0).abs() < 0.6, "{air:?}");
}

#[test]
fn val_a_height_tells_when_the_ground_is_left() {
    let columns = [&DUTIES[..], &ATTITUDE, &["position_down_m", "accel_z_m_s2"]].concat();
    let parts = flown(&columns).flight_parts(None);
    assert_eq!(kinds(&parts), WHOLE, "{parts:?}");
    let air = parts.in_the_air();
    // At 1 m/s the height of 1 m is passed a second after take-off.
    assert!((air[0].0 - 6.0).abs() < 0.5 && (air[0].1 - 24.0).abs() < 0.5, "{air:?}");
}

#[test]
fn val_a_log_that_begins_and_ends_in_the_air_is_all_air() {
    let columns = [&DUTIES[..], &ATTITUDE].concat();
    let inside = flown(&columns).part(8.0, 20.0).expect("inside");
    let parts = inside.flight_parts(None);
    assert_eq!(kinds(&parts), [PartKind::Air], "{parts:?}");
    assert!((parts.air_s() - 12.0).abs() < 0.1);
}

#[test]
fn val_a_pilots_flip_is_no_crash() {
    let columns = [&DUTIES[..], &ATTITUDE].concat();
    let log = flown_with(&columns, |t, row| Row {
        roll: if (15.0..15.6).contains(&t) { 2.0 } else { row.roll },
        ..row
    });
    let parts = log.flight_parts(None);
    let middle = [
        PartKind::Ground,
        PartKind::TakeOff,
        PartKind::Air,
        PartKind::Upset,
        PartKind::Air,
    ];
    assert_eq!(kinds(&parts)[..5], middle, "{parts:?}");
    assert!(parts.events.is_empty(), "{parts:?}");
}

/// Motor 3 goes to its limit at 15 s, the vehicle rolls over and lies there from 16.5 s on.
fn crashed(columns: &[&str]) -> FlightLog {
    flown_with(columns, |t, mut row| {
        if t >= 15.0 {
            row.duty[2] = 1.0;
            row.duty[1] = 0.2;
            row.roll = -(FRAC_PI_2 * (t - 15.0).powi(2)).min(2.5);
            row.rate = -2.0 * FRAC_PI_2 * (t - 15.0);
            row.down = (-5.0 + 4.9 * (t - 15.0).powi(2)).min(0.0);
        }
        if t >= 16.5 {
            row = Row {
                duty: [0.0; 4],
                roll: -2.5,
                rate: 0.0,
                accel_z: 7.9,
                down: 0.0,
            };
        }
        row
    })
}

#[test]
fn val_a_motor_at_its_limit_while_the_attitude_runs_away_is_a_lost_rotor() {
    // Attitude and motor outputs alone; and with rates and the places of the rotors: rotor 3 is at the left.
    let positions = [[0.7, 0.7], [-0.7, 0.7], [0.7, -0.7], [-0.7, -0.7]];
    let places = [0, 1, 2, 3].map(|rotor| RotorPlace {
        output: rotor + 1,
        position: positions[rotor],
    });
    for (columns, places) in [
        ([&DUTIES[..], &ATTITUDE].concat(), None),
        ([&DUTIES[..], &ATTITUDE, &RATES].concat(), Some(places.as_slice())),
    ] {
        let parts = crashed(&columns).flight_parts(places);
        let crash = parts
            .parts
            .iter()
            .find(|part| part.kind == PartKind::Crash)
            .expect("a crash");
        assert!((15.2..16.2).contains(&crash.start_s), "{parts:?}");
        assert!(
            parts.parts.iter().all(|part| part.kind != PartKind::Landing),
            "{parts:?}"
        );
        let lost: Vec<&FlightEvent> = parts.events.iter().filter(|e| e.kind == EventKind::LostRotor).collect();
        assert_eq!(lost.len(), 1, "{parts:?}");
        assert_eq!(lost[0].output, Some(3), "{lost:?}");
        assert!((14.9..15.9).contains(&lost[0].start_s), "{lost:?}");
        let air = parts.in_the_air();
        assert!(air[0].1 < 16.0, "{air:?}");
    }
}

/// Two rotors on one axis receive the same command: which of them was lost cannot be determined.
#[test]
fn val_of_two_rotors_on_one_axis_none_is_named_alone() {
    let positions = [[0.7, 0.7], [-0.7, 0.7], [0.7, -0.7], [0.7, -0.7]];
    let places = [0, 1, 2, 3].map(|rotor| RotorPlace {
        output: rotor + 1,
        position: positions[rotor],
    });
    let columns = [&DUTIES[..], &ATTITUDE, &RATES].concat();
    let parts = crashed(&columns).flight_parts(Some(&places));
    let lost: Vec<&FlightEvent> = parts.events.iter().filter(|e| e.kind == EventKind::LostRotor).collect();
    assert_eq!(lost.len(), 1, "{parts:?}");
    assert!(
        lost[0].output.is_none() && lost[0].detail.starts_with("rotor 3 or 4 lost"),
        "{lost:?}"
    );
}

/// A hard braking manoeuvre: the outputs 1 and 2 go to their limit for less than 0.12 s, then 3 and 4 together for longer, the tilt passes 70° and
/// comes back. Rotor 3 was called lost, and the manoeuvre a crash.
#[test]
fn regress_motors_that_reach_their_limit_together_have_lost_no_rotor() {
    let columns = [&DUTIES[..], &ATTITUDE, &FORCES].concat();
    let log = flown_with(&columns, |t, mut row| {
        if t < 15.0 {
            return row;
        }
        row.duty = match t {
            15.0..15.08 => [1.0, 1.0, 0.7, 0.7],
            15.12..15.5 => [0.6, 0.6, 1.0, 0.99],
            _ => [0.6; 4],
        };
        row.roll = 1.5 * (std::f64::consts::PI * (t - 15.0) / 0.7).sin();
        row
    });
    // The log ends as the vehicle is upright again.
    let parts = log.part(5.0, 15.7).expect("inside").flight_parts(None);
    assert!(parts.events.iter().all(|e| e.kind != EventKind::LostRotor), "{parts:?}");
    assert!(parts.parts.iter().any(|part| part.kind == PartKind::Upset), "{parts:?}");
    assert!(parts.parts.iter().all(|part| part.kind != PartKind::Crash), "{parts:?}");
}

/// Roll swings increase from 12 s on, each motor in turn commanded more while its arm sinks, and every arm responds; it
/// lies from 17.6 s.
#[test]
fn regress_an_arm_that_answers_its_motor_has_lost_no_rotor() {
    let swing = |t: f64| 0.02 * (0.9 * (t - 12.0)).exp() * (5.2 * (t - 12.0)).sin();
    let rate = |t: f64| (swing(t + 1e-4) - swing(t - 1e-4)) / 2e-4;
    let turn = |t: f64| (rate(t + 1e-4) - rate(t - 1e-4)) / 2e-4;
    let positions = [[0.7, 0.7], [-0.7, 0.7], [0.7, -0.7], [-0.7, -0.7]];
    let places = [0, 1, 2, 3].map(|rotor| RotorPlace {
        output: rotor + 1,
        position: positions[rotor],
    });
    let columns = [&DUTIES[..], &ATTITUDE, &RATES, &FORCES].concat();
    // This share of rotor 3's command in the swing reaches its arm.
    let swung = |reaches: bool| {
        let log = flown_with(&columns, |t, mut row| {
            if (12.0..17.6).contains(&t) {
                // The motors lag by 0.1 s.
                let asked = 0.018 * turn(t + 0.1);
                row.duty = [-1.0, -1.0, 1.0, 1.0].map(|side: f64| (0.5 + side * asked).clamp(0.0, 1.0));
                row.roll = swing(t);
                row.rate = rate(t);
                if !reaches {
                    // Asked for ever more while the arm sinks.
                    let sinks = (t - 16.0).max(0.0);
                    row.duty = [0.5, 0.5 - 0.5 * sinks.min(1.0), 0.5 + 0.5 * sinks.min(1.0), 0.5];
                    row.roll = -2.0 * sinks * sinks;
                    row.rate = -4.0 * sinks;
                }
            } else if t >= 17.6 {
                row = Row {
                    duty: [0.0; 4],
                    roll: -2.5,
                    rate: 0.0,
                    accel_z: if t < 17.7 { -60.0 } else { 7.9 },
                    down: 0.0,
                };
            }
            row
        });
        let parts = log.flight_parts(Some(&places));
        assert!(parts.parts.iter().any(|part| part.kind == PartKind::Crash), "{parts:?}");
        let lost: Vec<FlightEvent> = parts
            .events
            .into_iter()
            .filter(|e| e.kind == EventKind::LostRotor)
            .collect();
        lost
    };
    assert_eq!(swung(true), []);
    let lost = swung(false);
    assert!(lost.len() == 1 && lost[0].output == Some(3), "{lost:?}");
}

#[test]
fn val_a_tumble_with_all_motors_alike_names_no_rotor() {
    let columns = [&DUTIES[..], &ATTITUDE].concat();
    let log = crashed(&columns);
    let mut even = log.clone();
    for name in DUTIES {
        even.columns.insert(name.to_owned(), log.columns["duty_4"].clone());
    }
    let parts = even.flight_parts(None);
    assert!(parts.parts.iter().any(|part| part.kind == PartKind::Crash), "{parts:?}");
    assert!(parts.events.iter().all(|e| e.kind != EventKind::LostRotor), "{parts:?}");
}

#[test]
fn val_saturation_and_a_reset_of_the_position_are_events() {
    let columns = [&DUTIES[..], &ATTITUDE, &["position_down_m"]].concat();
    let log = flown_with(&columns, |t, mut row| {
        if (12.0..12.4).contains(&t) {
            row.duty[1] = 1.0;
        }
        if (18.0..24.0).contains(&t) {
            row.down -= 3.0;
        }
        row
    });
    let parts = log.flight_parts(None);
    let found: Vec<(EventKind, Option<usize>)> = parts.events.iter().map(|e| (e.kind, e.output)).collect();
    assert_eq!(
        found[..2],
        [(EventKind::Saturated, Some(2)), (EventKind::EstimatorReset, None)],
        "{parts:?}"
    );
    assert!((parts.events[0].start_s - 12.0).abs() < 0.1 && (parts.events[1].start_s - 18.0).abs() < 0.4);
}

#[test]
fn val_a_log_without_motors_is_not_known() {
    let parts = flown(&ATTITUDE).flight_parts(None);
    assert_eq!(kinds(&parts), [PartKind::Unknown]);
    assert!((parts.air_s() - 30.0).abs() < 0.1);
}

#[test]
fn val_a_gap_parts_two_flights() {
    let log = flown(&[&DUTIES[..], &ATTITUDE].concat());
    let keep: Vec<usize> = (0..log.time_s.len()).filter(|k| !(600..800).contains(k)).collect();
    let pick = |values: &Vec<f64>| keep.iter().map(|k| values[*k]).collect::<Vec<f64>>();
    let columns: Vec<(String, Vec<f64>)> = log
        .columns
        .iter()
        .map(|(name, values)| (name.clone(), pick(values)))
        .collect();
    let parts = FlightLog::from_columns("gap", pick(&log.time_s), columns)
        .expect("a log")
        .flight_parts(None);
    assert_eq!(parts.in_the_air().len(), 2, "{parts:?}");
    assert_eq!(parts.events[0].kind, EventKind::Gap);
}

#[test]
fn regress_motors_that_only_idle_are_on_the_ground() {
    let columns = [&DUTIES[..], &RATES, &["accel_z_m_s2"]].concat();
    let log = flown_with(&columns, |_, row| Row {
        duty: [0.048; 4],
        rate: 0.0,
        accel_z: -9.81,
        ..row
    });
    assert_eq!(kinds(&log.flight_parts(None)), [PartKind::Ground]);
    let off = flown_with(&DUTIES, |_, row| Row { duty: [0.0; 4], ..row });
    assert_eq!(kinds(&off.flight_parts(None)), [PartKind::Ground]);
    // Turned about by hand, as for the calibration of a compass.
    let columns = [&columns[..], &ATTITUDE].concat();
    let by_hand = flown_with(&columns, |t, row| Row {
        duty: [0.0; 4],
        rate: 2.0,
        roll: 2.0 * t.sin(),
        ..row
    });
    assert_eq!(kinds(&by_hand.flight_parts(None)), [PartKind::Ground]);
}

/// As a racing quadrotor whose propellers are off: the controller winds up, nothing moves, and somebody takes it away in the end.
#[test]
fn regress_motors_that_carry_nothing_do_not_fly() {
    let columns = [&DUTIES[..], &RATES, &["accel_z_m_s2"]].concat();
    let log = flown_with(&columns, |t, row| Row {
        duty: [(0.05 + 0.015 * (t - 5.0)).clamp(0.05, 0.35); 4],
        rate: if t > 29.5 { 5.0 } else { 0.002 * (40.0 * t).sin() },
        accel_z: -9.7 + 0.2 * (90.0 * t).sin(),
        ..row
    });
    let parts = log.flight_parts(None);
    assert_eq!(parts.air_s(), 0.0, "{parts:?}");
    assert!(
        parts.no_flight().is_some_and(|why| why.contains("does not move")),
        "{parts:?}"
    );
    assert!(
        parts.parts.iter().any(|part| part.why.contains("does not move")),
        "{parts:?}"
    );
    // A hover, whose motors hardly change, stays a flight.
    let hover = flown_with(&columns, |_, row| Row {
        rate: 0.002 * row.rate,
        accel_z: -9.81,
        ..row
    });
    assert!(hover.flight_parts(None).air_s() > 10.0);
}

/// The motors run at one duty throughout, without propellers on a bench: nothing turns, and they only produce noise.
#[test]
fn regress_a_bench_that_shakes_less_than_any_flight_is_the_ground() {
    let columns = [&DUTIES[..], &RATES, &FORCES, &["position_down_m"]].concat();
    let on_a_bench = |force: f64, height: f64| {
        let log = flown_with(&columns, |t, row| Row {
            rate: 0.01 * (40.0 * t).sin(),
            accel_z: -9.7 + force * (31.0 * t).sin(),
            down: if (7.0..23.0).contains(&t) { -height } else { 0.0 },
            ..row
        });
        log.flight_parts(None)
    };
    let parts = on_a_bench(0.1, 0.1);
    assert_eq!(parts.air_s(), 0.0, "{parts:?}");
    assert!(
        parts.no_flight().is_some_and(|why| why.contains("does not move")),
        "{parts:?}"
    );
    // A hover in still air that is simulated, without a height, may be as calm.
    let columns = [&DUTIES[..], &RATES, &FORCES].concat();
    let hover = flown_with(&columns, |t, row| Row {
        rate: 0.01 * (40.0 * t).sin(),
        accel_z: -9.7 + 0.1 * (31.0 * t).sin(),
        ..row
    });
    assert!(hover.flight_parts(None).air_s() > 10.0);
    // What is above the ground, or shakes more, flies.
    assert!(on_a_bench(0.1, 2.0).air_s() > 10.0);
    assert!(on_a_bench(1.0, 0.1).air_s() > 10.0);
}

/// A gyroscope whose readings are cut to 0 below its dead band, motors at an idle of 8 % with a twitch at the end: it was in the air throughout.
#[test]
fn regress_motors_that_idle_under_a_gyroscope_with_a_dead_band_are_on_the_ground() {
    let columns = [&DUTIES[..], &RATES, &FORCES].concat();
    let log = flown_with(&columns, |t, row| Row {
        duty: [if (28.0..28.4).contains(&t) { 0.2 } else { 0.08 }; 4],
        rate: if (28.0..28.4).contains(&t) { 0.01 } else { 0.0 },
        accel_z: -9.75 + 0.06 * (31.0 * t).sin(),
        ..row
    });
    let parts = log.flight_parts(None);
    assert_eq!(parts.air_s(), 0.0, "{parts:?}");
}

/// The motors run for 10 s before they lift the vehicle, which then stays low.
#[test]
fn regress_a_take_off_ends_soon_after_the_lift_however_low_the_flight() {
    let columns = [&DUTIES[..], &ATTITUDE, &RATES, &FORCES, &["position_down_m"]].concat();
    let log = flown_with(&columns, |t, row| {
        let lifted = !(5.0..12.0).contains(&t);
        Row {
            duty: if lifted {
                row.duty
            } else {
                row.duty.map(|duty| 0.6 * duty)
            },
            down: if t < 12.0 {
                0.0
            } else if t < 21.0 {
                -0.2
            } else {
                row.down
            },
            ..row
        }
    });
    let parts = log.flight_parts(None);
    assert_eq!(kinds(&parts), WHOLE, "{parts:?}");
    // Carried from 12 s on, and higher than its feet from 21 s on only.
    assert!((11.9..15.5).contains(&parts.in_the_air()[0].0), "{parts:?}");
}

/// The flight of [`flown`], whose motors run on after the landing: at the share `asked` of what carried it, after a
/// touch of this force, m/s².
fn landed_with_motors(asked: f64, touch: f64) -> FlightLog {
    let columns = [&DUTIES[..], &ATTITUDE, &RATES, &FORCES, &["position_down_m"]].concat();
    flown_with(&columns, |t, row| Row {
        duty: if t < 25.0 { row.duty } else { [0.5 * asked; 4] },
        accel_z: row.accel_z - if (24.98..25.02).contains(&t) { touch } else { 0.0 },
        ..row
    })
}

#[test]
fn regress_a_soft_landing_with_motors_that_run_on_is_the_ground() {
    let log = landed_with_motors(0.93, 8.0);
    let parts = log.flight_parts(None);
    assert_eq!(kinds(&parts), WHOLE, "{parts:?}");
    // The last metre is the landing's.
    assert!((parts.in_the_air()[0].1 - 24.0).abs() < 0.5, "{parts:?}");
    // What carries as much as in flight, or was never touched, may be a hover at that height.
    for (asked, touch) in [(1.0, 8.0), (0.93, 0.0)] {
        let parts = landed_with_motors(asked, touch).flight_parts(None);
        assert_eq!(kinds(&parts), WHOLE[..3], "{parts:?}");
    }
}

/// Telemetry at 1 Hz, occasionally some seconds late: each row was a part of its own, and a heading that turned between
/// two rows a jump.
#[test]
fn regress_slow_telemetry_is_one_flight() {
    let mut t = 0.0;
    let mut time = Vec::new();
    while t < 120.0 {
        time.push(t);
        t += if time.len() % 9 == 0 { 3.1 } else { 1.2 };
    }
    let flies = |t: f64| (30.0..90.0).contains(&t);
    let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|t| f(*t)).collect() };
    let mut columns: Vec<(String, Vec<f64>)> = DUTIES
        .iter()
        .map(|name| ((*name).to_owned(), of(&|t| if flies(t) { 0.5 } else { 0.0 })))
        .collect();
    for name in ["roll_rad", "pitch_rad"].iter().chain(&RATES) {
        columns.push((
            (*name).to_owned(),
            of(&|t| if flies(t) { 0.05 * (7.0 * t).sin() } else { 0.0 }),
        ));
    }
    columns.push((
        "yaw_rad".to_owned(),
        of(&|t| if (50.0..51.0).contains(&t) { 1.5 } else { 0.0 }),
    ));
    columns.push((
        "position_down_m".to_owned(),
        of(&|t| if flies(t) { -10.0 } else { 0.0 }),
    ));
    let log = FlightLog::from_columns("slow", time.clone(), columns).expect("a log");
    let parts = log.flight_parts(None);
    // A row of 1.2 s is the whole landing.
    let short = [PartKind::Ground, PartKind::TakeOff, PartKind::Air, PartKind::Ground];
    assert_eq!(kinds(&parts), short, "{parts:?}");
    assert!(parts.events.iter().all(|e| e.kind == EventKind::Gap), "{parts:?}");
}

/// A pilot pulls 4.5 g along the thrust, then falls with idle motors for 5 s, rolling; without attitude in the log this was a crash and a landing.
#[test]
fn regress_a_pull_and_a_fall_are_no_crash() {
    let columns = [&DUTIES[..], &RATES, &FORCES].concat();
    let fall = |turning: f64, force: f64| {
        flown_with(&columns, move |t, row| match t {
            12.0..12.6 => Row {
                duty: [0.95; 4],
                accel_z: -45.0,
                ..row
            },
            12.6..17.6 => Row {
                duty: [0.06; 4],
                accel_z: -force,
                rate: turning,
                ..row
            },
            _ => row,
        })
    };
    // A falling vehicle feels no weight; one that rolls at 3 rad/s is not lying.
    for log in [fall(0.0, 3.0), fall(3.0, 9.0)] {
        let parts = log.flight_parts(None);
        assert_eq!(kinds(&parts), WHOLE, "{parts:?}");
        assert!(parts.air_s() > 13.0, "{parts:?}");
    }
    // What lies feels its weight.
    assert_ne!(kinds(&fall(0.0, 9.8).flight_parts(None)), WHOLE);
    // An impact across the thrust ends a flight that does not continue.
    let blow = flown_with(&columns, |t, row| match t {
        12.0..12.1 => Row {
            duty: [0.06; 4],
            accel_z: -60.0,
            ..row
        },
        12.1.. => Row {
            duty: [0.0; 4],
            accel_z: -9.81,
            rate: 0.0,
            ..row
        },
        _ => row,
    });
    let parts = blow.flight_parts(None);
    assert!(parts.parts.iter().any(|part| part.kind == PartKind::Crash), "{parts:?}");
}

/// An attitude that is upside down for half of the flight is not a vehicle's.
#[test]
fn regress_an_attitude_that_ran_away_makes_no_crash() {
    let columns = [&DUTIES[..], &ATTITUDE].concat();
    let log = flown_with(&columns, |t, row| Row {
        roll: 0.3 * (t - 5.0).max(0.0),
        ..row
    });
    let parts = log.flight_parts(None);
    assert!(parts.parts.iter().all(|part| part.kind != PartKind::Crash), "{parts:?}");
    assert!(!parts.found_from.contains(&"attitude"), "{parts:?}");
}

/// One sample of an accelerometer logged at 10 Hz turned a calm flight into "an upset: tilt up to 6°, 38 m/s²". An
/// impact that turns the body counts at any rate.
#[test]
fn regress_one_sample_of_a_vibration_is_no_upset() {
    let columns = [&DUTIES[..], &ATTITUDE, &FORCES, &RATES, &["position_down_m"]].concat();
    let with = |turns: f64| {
        let log = flown_with(&columns, |t, mut row| {
            // Each sample holds for 0.1 s; the one at 15 s is a spike, after which the body turns.
            let sample = (10.0 * t + 1e-6).floor() as i64;
            if (50..250).contains(&sample) {
                row.accel_z = -9.81 + 2.0 * (1.9 * sample as f64).sin();
            }
            if sample == 150 {
                row.accel_z = -38.0;
            }
            if sample == 151 {
                row.rate = turns;
            }
            row
        });
        kinds(&log.flight_parts(None))
    };
    assert_eq!(with(0.2), WHOLE);
    assert!(with(3.0).contains(&PartKind::Upset));
}
