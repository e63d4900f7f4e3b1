//! Real logs against what other readers find in them, and files that are damaged in every way.

use proptest::prelude::*;
use rotortwin_twin::log::flight_parts::EventKind;
use rotortwin_twin::log::{FindingKind, FlightLog, ReadOptions, SourceKind};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Deserialize)]
struct Expected {
    count: usize,
    mean: f64,
    first: f64,
    last: f64,
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(data(name)).expect("the excerpt is in the repository")
}

/// f32 values printed as f64 and summed in another order.
const SAME: f64 = 1e-9;

#[test]
fn val_excerpts_hold_what_other_readers_find() {
    let text = std::fs::read_to_string(data("expected.toml")).expect("in the repository");
    let expected: BTreeMap<String, BTreeMap<String, Expected>> = toml::from_str(&text).expect("written by make.py");
    let files = [
        ("crazyflie-sysid", "usdlog", SourceKind::CrazyflieUsdlog),
        ("crazypad-e8", "usdlog", SourceKind::CrazyflieUsdlog),
        ("px4-on-the-ground", "ulg", SourceKind::Px4Ulog),
        ("made-up", "bin", SourceKind::ArdupilotDataflash),
    ];
    assert_eq!(expected.len(), files.len());
    for (name, extension, kind) in files {
        holds(name, extension, kind, &expected[name]);
    }
}

#[test]
fn val_a_recording_of_ros_2_holds_what_was_flown() {
    let text = std::fs::read_to_string(data("expected_ros2.toml")).expect("in the repository");
    let expected: BTreeMap<String, BTreeMap<String, Expected>> =
        toml::from_str(&text).expect("printed by make_ros2.py");
    holds("ros2", "mcap", SourceKind::Ros2Bag, &expected["ros2"]);
    let log = FlightLog::read(&data("ros2.mcap")).expect("a log");
    let notes = log.report.notes.join("\n");
    assert!(notes.contains("/drone1 is taken, /drone2 left out"), "{notes}");
    assert_eq!(log.report.clock_start_s.map(f64::round), Some(1_750_000_000.0));
    let unused = &log.report.unused_columns;
    assert!(
        unused
            .iter()
            .any(|one| one.column == "/camera/image" && one.reason.contains("sensor_msgs/Image (20 messages)")),
        "{unused:?}"
    );
}

fn holds(name: &str, extension: &str, kind: SourceKind, expected: &BTreeMap<String, Expected>) {
    {
        let log = FlightLog::read(&data(&format!("{name}.{extension}"))).expect(name);
        assert_eq!(log.source.kind, kind);
        for (column, expected) in expected {
            let values = if column == "time_s" {
                &log.time_s[..]
            } else {
                log.column(column).expect(column)
            };
            let present: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
            assert_eq!(present.len(), expected.count, "{name} {column}");
            let mean = present.iter().sum::<f64>() / present.len() as f64;
            for (what, found, wanted) in [
                ("mean", mean, expected.mean),
                ("first", present[0], expected.first),
                ("last", present[present.len() - 1], expected.last),
            ] {
                assert!(
                    (found - wanted).abs() < SAME * (1.0 + wanted.abs()),
                    "{name} {column} {what}: {found}, {wanted}"
                );
            }
        }
    }
}

#[test]
fn val_motors_take_their_pulse_limits_from_the_parameters() {
    // 1500 of 1100 to 1900 is the middle; the other instance of the IMU is not mixed in.
    let log = FlightLog::read(&data("made-up.bin")).expect("a log");
    let duty = |rotor: usize| log.duties()[rotor - 1][1];
    assert_eq!((log.rotor_count(), duty(1), duty(3), duty(4)), (4, 0.5, 1.0, 0.25));
    assert!(
        log.report
            .notes
            .iter()
            .any(|note| note.contains("14 bytes are not part of a message")),
        "{:?}",
        log.report.notes
    );
}

#[test]
fn val_nothing_flies_on_the_ground() {
    let log = FlightLog::read(&data("px4-on-the-ground.ulg")).expect("a log");
    assert!(
        log.report
            .findings
            .iter()
            .any(|finding| finding.kind == FindingKind::NoFlight),
        "{:?}",
        log.report.findings
    );
}

#[test]
fn val_a_wrong_checksum_is_refused_unless_asked_for() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("log07");
    let mut content = bytes("crazypad-e8.usdlog");
    let middle = content.len() / 2;
    content[middle] ^= 1;
    std::fs::write(&path, &content).expect("written");
    let sentence = FlightLog::read(&path).expect_err("a flipped bit").to_string();
    assert!(
        sentence.contains("log07: the CRC-32 at the end does not fit"),
        "{sentence}"
    );
    let options = ReadOptions {
        accept_damaged: true,
        ..ReadOptions::default()
    };
    assert!(FlightLog::read_with(&path, &options).is_ok());
}

#[test]
fn val_a_mapping_overrides_one_row() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mapping = folder.path().join("mine.toml");
    let read = |text: &str| {
        std::fs::write(&mapping, text).expect("written");
        let options = ReadOptions {
            mapping: Some(mapping.clone()),
            ..ReadOptions::default()
        };
        FlightLog::read_with(&data("crazyflie-sysid.usdlog"), &options)
    };
    let plain = FlightLog::read(&data("crazyflie-sysid.usdlog")).expect("a log");
    let order = "source = \"crazyflie-usdlog\"\n[[column]]\nto = \"duty\"\nfrom = \"fixedFrequency:motor.m1,motor.m2,motor.m3,motor.m4\"\nhigh = 65535.0\norder = [4, 3, 2, 1]\n";
    let turned = read(order).expect("a log");
    assert_eq!(plain.duties()[0], turned.duties()[3]);
    assert_eq!(
        plain.column("roll_rate_rad_s"),
        turned.column("roll_rate_rad_s"),
        "the other rows stay"
    );
    let rotors = |more: &str| format!("source = \"crazyflie-usdlog\"\n{more}");
    let twice = order.replace("[4, 3, 2, 1]", "[1, 1, 3, 4]");
    let (field_twice, row_twice) = (
        rotors(
            "[[column]]\nto = \"duty\"\nfrom = \"fixedFrequency:motor.m1,motor.m2,motor.m1,motor.m4\"\nhigh = 65535.0\n",
        ),
        rotors(
            "[[column]]\nto = \"duty_1\"\nfrom = \"fixedFrequency:motor.m1\"\n[[column]]\nto = \"duty_2\"\nfrom = \"fixedFrequency:motor.m1\"\n",
        ),
    );
    for (text, expected) in [
        (
            twice.as_str(),
            "column 1 ('duty'): order = [1, 1, 3, 4] names field 1 for rotors 1 and 2; expected another field for each rotor",
        ),
        (field_twice.as_str(), "names motor.m1 in places 1 and 3"),
        (
            row_twice.as_str(),
            "'duty_1' and 'duty_2' are both read from \"fixedFrequency:motor.m1\"",
        ),
        ("source = \"px4-ulog\"\n", "the mapping is for source = \"px4-ulog\""),
        (
            "source = \"crazyflie-usdlog\"\n[[column]]\nto = \"accel\"\nfrom = \"fixedFrequency:acc.x,acc.y,acc.z\"\nunit = \"deg\"\n",
            "does not fit 'accel'",
        ),
        (
            "source = \"crazyflie-usdlog\"\n[[column]]\nto = \"accel\"\nfrom = \"acc\"\n",
            "expected \"topic:field\"",
        ),
        (
            "source = \"crazyflie-usdlog\"\n[[column]]\nto = \"accel\"\nfrom = \"fixedFrequency:acc.x,acc.y,acc.z\"\nunit = \"m/s2\"\n",
            "the unit cannot be right",
        ),
    ] {
        let sentence = read(text).expect_err(text).to_string();
        assert!(sentence.contains(expected), "{sentence}");
    }
}

#[test]
fn val_text_dataflash_without_times_gets_its_nominal_rate() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("old.log");
    let mut text = "ArduCopter V3.0.1\nFMT, 1, 17, ATT, cccc, RollIn,Roll,PitchIn,Pitch,YawIn,Yaw\nFMT, 9, 19, CURR, hIhh, Thr,ThrInt,Volt,Curr\n".to_owned();
    for k in 0..100 {
        text += &format!("ATT, 0.0, {}, 0.0, {}, 0.0, 90.0\n", k % 7, k % 5);
        if k % 10 == 5 {
            text += &format!("CURR, 500, 0, {}, 2000\n", 1200 - k);
        }
    }
    std::fs::write(&path, text).expect("written");
    let log = FlightLog::read(&path).expect("a log");
    assert_eq!((log.time_s.len(), log.time_s[1]), (100, 0.1));
    assert_eq!(log.column("roll_rad").expect("mapped")[3], 3.0_f64.to_radians());
    // Half a row after the ATT before it, so halfway between two rows: 11.95 V at 0.55 s.
    let voltage = log.column("battery_voltage_v").expect("mapped");
    assert!((voltage[6] - 11.945).abs() < 1e-9, "{}", voltage[6]);
}

/// Fast attitude of ArduCopter 4.7 is a message of its own, on stamps of whole milliseconds; ATT stays at 10 Hz.
#[test]
fn val_arducopter_with_fast_attitude_has_it_at_the_rate_of_the_loop() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let roll_deg = |time_us: u32| 5.0 * (1e-5 * f64::from(time_us)).sin();
    let of = |name: &str, fast: bool| {
        let path = folder.path().join(name);
        let mut text = "FMT, 2, 9, IMU, Qffffff, TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ\nFMT, 3, 9, ANG, Qfff, TimeUS,Roll,Pitch,Yaw\n\
             FMT, 4, 9, ATT, Qfff, TimeUS,Roll,Pitch,Yaw\n"
            .to_owned();
        for k in 0..800_u32 {
            // 2 and 3 ms in turn.
            let time = 1_000_000 + 1000 * (5 * k / 2);
            text += &format!("IMU, {time}, 0.0{}, 0.0, 0.0, 0.0, 0.0, -9.81\n", k % 3);
            if fast {
                text += &format!("ANG, {time}, {:.6}, 0.5, 90.0\n", roll_deg(time));
            }
            if k % 40 == 0 {
                text += &format!("ATT, {time}, {:.6}, 0.5, 90.0\n", roll_deg(time));
            }
        }
        std::fs::write(&path, text).expect("written");
        FlightLog::read(&path).expect("a log")
    };
    for (name, fast, attitude) in [("fast.log", true, "ANG"), ("slow.log", false, "ATT")] {
        let log = of(name, fast);
        assert!(
            (log.sample_rate_hz() - 400.0).abs() < 0.5,
            "{name}: {} Hz",
            log.sample_rate_hz()
        );
        let text = &log.report.conversions;
        let read = format!("attitude ← {attitude}:");
        assert!(text.iter().any(|one| one.starts_with(&read)), "{name}: {text:?}");
        // Between two samples of ATT its line is off by degrees: 10 rad/s of 5°.
        let roll = log.column("roll_rad").expect("mapped");
        let off = |row: usize| {
            let time_us = 1_000_000 + 1000 * (5 * row as u32 / 2);
            (roll[row].to_degrees() - roll_deg(time_us)).abs()
        };
        let worst = (0..700).map(off).fold(0.0, f64::max);
        assert_eq!(worst < 1e-4, fast, "{name}: {worst}°");
    }
}

/// Messages of ArduCopter by their numbers: `CURR` is of floats since 3.4, `MOT_PWM_MIN` 0 means the throttle channel's range, and
/// `RCOU` had other names up to 3.2.
#[test]
fn regress_arducopter_before_and_after_its_messages_changed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let of = |name: &str, fields: &str, unit: f64| {
        let path = folder.path().join(name);
        let mut text = format!(
            "FMT, 1, 9, PARM, QNf, TimeUS,Name,Value\nFMT, 2, 9, IMU, Qffffff, TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ\n\
             FMT, 3, 9, RCOU, QHHHH, TimeUS,{fields}\nFMT, 4, 9, CURR, Qfff, TimeUS,Throttle,Volt,Curr\n\
             PARM, 100, MOT_PWM_MIN, 0\nPARM, 100, MOT_PWM_MAX, 0\nPARM, 100, SERVO1_MIN, 1100\nPARM, 100, SERVO1_MAX, 1900\n\
             PARM, 100, RC3_MIN, 982\nPARM, 100, RC3_MAX, 2006\n"
        );
        for k in 0..200_u32 {
            let (time, shake) = (1_000_000 + 20_000 * k, f64::from(k % 7));
            text += &format!(
                "IMU, {time}, 0.0{}, 0.0, 0.0, 0.0, 0.0, {}\n",
                k % 3,
                -9.81 + 0.1 * shake
            );
            let output = 1494 + k % 3;
            text += &format!("RCOU, {time}, {output}, {output}, 1495, {output}\n");
            text += &format!(
                "CURR, {time}, 500, {}, {}\n",
                unit * (15.9 - 0.001 * f64::from(k)),
                unit * (21.0 + shake)
            );
        }
        std::fs::write(&path, text).expect("written");
        FlightLog::read(&path).expect("a log")
    };
    for (name, fields, unit) in [
        ("new.log", "C1,C2,C3,C4", 1.0),
        ("old.log", "Chan1,Chan2,Chan3,Chan4", 100.0),
    ] {
        let log = of(name, fields, unit);
        assert!(
            (log.column("battery_current_a").expect("mapped")[7] - 21.0).abs() < 1e-6,
            "{name}"
        );
        assert!(
            (log.column("battery_voltage_v").expect("mapped")[0] - 15.9).abs() < 1e-6,
            "{name}"
        );
        let duty = log.column("duty_3").expect("mapped")[0];
        assert!((duty - (1495.0 - 982.0) / 1024.0).abs() < 1e-9, "{name}: {duty}");
    }
}

/// Found by `prop_damaged_files_never_panic`: the type of a variable was a line feed, which broke the sentence that quoted it.
#[test]
fn regress_a_line_feed_in_a_name_stays_within_the_sentence() {
    let mut content = bytes("crazyflie-sysid.usdlog");
    let place = content.windows(6).position(|w| w == b"acc.x(").expect("a variable") + 6;
    content[place] = b'\n';
    survive("named", &content);
}

/// Whatever the bytes are: a log or one sentence.
fn survive(name: &str, content: &[u8]) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(name);
    std::fs::write(&path, content).expect("written");
    for accept_damaged in [false, true] {
        let options = ReadOptions {
            accept_damaged,
            ..ReadOptions::default()
        };
        if let Err(refusal) = FlightLog::read_with(&path, &options) {
            let sentence = refusal.to_string();
            assert!(!sentence.contains('\n') && sentence.contains(name), "{sentence}");
        }
    }
}

const EXCERPTS: [&str; 4] = [
    "crazyflie-sysid.usdlog",
    "crazypad-e8.usdlog",
    "px4-on-the-ground.ulg",
    "made-up.bin",
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn prop_cut_files_never_panic(file in 0..EXCERPTS.len(), keep in 0.0..1.0_f64) {
        let content = bytes(EXCERPTS[file]);
        survive("cut", &content[..(content.len() as f64 * keep) as usize]);
    }

    #[test]
    fn prop_damaged_files_never_panic(
        file in 0..EXCERPTS.len(),
        damage in proptest::collection::vec((0.0..1.0_f64, any::<u8>()), 1..40),
        in_the_head in any::<bool>(),
    ) {
        let mut content = bytes(EXCERPTS[file]);
        let reach = if in_the_head { content.len().min(3000) } else { content.len() };
        for (place, byte) in damage {
            let place = (place * reach as f64) as usize;
            content[place] = byte;
        }
        survive("damaged", &content);
    }

    #[test]
    fn prop_absurd_lengths_never_panic(file in 0..EXCERPTS.len(), place in 0..2000_usize) {
        let mut content = bytes(EXCERPTS[file]);
        content.truncate(20_000);
        content[place..place + 2].fill(0xff);
        survive("absurd", &content);
    }

    #[test]
    fn prop_damaged_parquet_never_panics(
        rows in 2..200_usize,
        damage in proptest::collection::vec((0.0..1.0_f64, any::<u8>()), 1..12),
        at_the_end in any::<bool>(),
    ) {
        let time_s = (0..rows).map(|row| row as f64).collect();
        let column = |factor: f64| (0..rows).map(|row| (factor * row as f64).sin()).collect();
        let columns = [("roll_rad".to_owned(), column(0.1)), ("position_down_m".to_owned(), column(0.3))];
        let log = FlightLog::from_columns("whole", time_s, columns).expect("nothing to refuse");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("whole.parquet");
        log.write_parquet(&path).expect("written");
        let mut content = std::fs::read(&path).expect("read");
        // The footer, which says how much of everything there is, is at the end.
        let first = if at_the_end { content.len().saturating_sub(400) } else { 4 };
        for (place, byte) in damage {
            let place = first + (place * (content.len() - first) as f64) as usize;
            content[place] = byte;
        }
        survive("damaged.parquet", &content);
    }

    #[test]
    fn prop_any_bytes_after_a_magic_never_panic(
        file in 0..5_usize,
        tail in proptest::collection::vec(any::<u8>(), 0..4000),
    ) {
        let magic: [&[u8]; 5] = [b"PAR1", b"ULog\x01\x12\x35", b"\xa3\x95\x80", b"\xbc\x02\x00", b"FMT, 1, 2, A, B\n"];
        let mut content = magic[file].to_vec();
        content.extend(tail);
        survive("any", &content);
    }
}

/// 20 s of an ArduCopter's log: modes, arming, a parameter that changes, a stick.
fn eventful(path: &Path) {
    let mut text = "FMT, 1, 9, PARM, QNf, TimeUS,Name,Value\nFMT, 2, 9, MODE, QMBB, TimeUS,Mode,ModeNum,Rsn\n\
                    FMT, 3, 9, EV, QB, TimeUS,Id\nFMT, 4, 9, RCIN, QHHHH, TimeUS,C1,C2,C3,C4\n\
                    FMT, 5, 9, IMU, Qffffff, TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ\n\
                    FMT, 6, 9, RCOU, QHHHH, TimeUS,C1,C2,C3,C4\nPARM, 100, ATC_RAT_RLL_P, 0.135\nPARM, 110, WPNAV_SPEED, 500\n"
        .to_owned();
    for k in 0..1000_u32 {
        let (time, t) = (1_000_000 + 20_000 * k, 0.02 * f64::from(k));
        let flies = (4.0..16.0).contains(&t);
        text += &format!(
            "IMU, {time}, {}, 0, 0, 0, 0, {}\n",
            0.3 * (7.0 * t).sin(),
            -9.81 + 0.3 * (5.0 * t).sin()
        );
        let output = if flies { 1500 } else { 1000 };
        text += &format!("RCOU, {time}, {output}, {output}, {output}, {output}\n");
        let roll = if (8.0..9.0).contains(&t) { 1900 } else { 1500 };
        text += &format!("RCIN, {time}, {roll}, 1500, 1400, 1500\n");
        match k {
            0 => text += &format!("MODE, {time}, 2, 2, 1\n"),
            100 => text += &format!("EV, {time}, 10\n"),
            300 => text += &format!("PARM, {time}, ATC_RAT_RLL_P, 0.18\n"),
            500 => text += &format!("MODE, {time}, 5, 5, 1\nPARM, {time}, WPNAV_SPEED, 500\n"),
            900 => text += &format!("EV, {time}, 11\n"),
            _ => {}
        }
    }
    std::fs::write(path, text).expect("the folder can be written");
}

#[test]
fn val_what_autopilot_and_pilot_did_is_told_with_the_events_also_of_a_part_and_of_an_import() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("eventful.log");
    eventful(&path);
    let log = FlightLog::read(&path).expect("a log");
    let told = |log: &FlightLog| -> Vec<(EventKind, f64, String)> {
        let events = log.flight_parts(None).events.into_iter();
        let of = |e: &rotortwin_twin::log::flight_parts::FlightEvent| {
            [EventKind::Mode, EventKind::Parameter, EventKind::Pilot].contains(&e.kind)
        };
        events.filter(of).map(|e| (e.kind, e.start_s, e.detail)).collect()
    };
    let found = told(&log);
    let expected = [
        (EventKind::Mode, 0.0, "flight mode Alt Hold"),
        (EventKind::Mode, 2.0, "armed"),
        (
            EventKind::Parameter,
            6.0,
            "parameters changed: ATC_RAT_RLL_P from 0.135 to 0.18",
        ),
        (EventKind::Pilot, 8.0, "the pilot's sticks: roll +100 %"),
        (EventKind::Mode, 10.0, "flight mode Loiter"),
        (EventKind::Mode, 18.0, "disarmed"),
    ];
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for ((kind, at, words), (expected, when, what)) in found.iter().zip(expected) {
        assert_eq!((*kind, &words[..]), (expected, what));
        assert!((at - when).abs() < 0.03, "{at} for {when}");
    }
    // A part begins in the mode that it was in; an import keeps all.
    let part = told(&log.part(9.5, 15.0).expect("rows"));
    assert_eq!(
        part.iter().map(|(.., words)| &words[..]).collect::<Vec<_>>(),
        ["flight mode Alt Hold", "flight mode Loiter"]
    );
    let stored = log.store(&folder.path().join("out"), "eventful").expect("written");
    assert_eq!(told(&FlightLog::read(&stored).expect("a log")), found);
}
