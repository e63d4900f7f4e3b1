//! Real flights with damaged propellers, as their authors publish them, through `log map`, import and `vibration`.
//!
//! Neither set has a licence, so nothing of them is here. `ROTORTWIN_DAMAGED_FLIGHTS` names a folder with the clones
//! `UAV-Realistic-Fault-Dataset` (github.com/tiiuae) and `prop-damage-adapt` (github.com/udesa-ai); without it the tests count as skipped.
//! `docs/detector.md` ("Damaged propellers in real flights") has the figures. Thresholds are those of simulated flights; none was chosen on these.

#![expect(clippy::unwrap_used, reason = "a file that cannot be read fails the test")]

#[expect(unreachable_pub, reason = "public in the crate that the file is of")]
#[path = "../../../tests/src/skip.rs"]
mod skip;

use rotortwin_twin::log::{FlightLog, ReadOptions, draft};
use rotortwin_twin::vibration::{Change, change};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Flights of a Holybro X500 that are judged: broken propellers, recording.
const X500: [(usize, &str); 8] = [
    (0, "2022_01_05-10_23_31"),
    (0, "2022_01_10-09_36_37"),
    (1, "2021_12_31-12_05_31"),
    (2, "2021_12_31-13_26_27"),
    (2, "2021_12_31-14_34_17"),
    (3, "2021_12_31-14_20_48"),
    (3, "2022_01_10-10_26_25"),
    (4, "2022_01_05-09_17_09"),
];
/// Seconds of a healthy flight of the X500 that count as flights, between take-off and landing.
const X500_PARTS: [(f64, f64); 3] = [(12.0, 32.0), (32.0, 52.0), (52.0, 72.0)];

fn folder(inside: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("ROTORTWIN_DAMAGED_FLIGHTS").map(|folder| PathBuf::from(folder).join(inside));
    if folder.as_ref().is_none_or(|folder| !folder.is_dir()) {
        skip::skip(&format!(
            "flights with damaged propellers: {inside} is not in ROTORTWIN_DAMAGED_FLIGHTS"
        ));
        return None;
    }
    folder
}

/// Reads a table with the mapping that `log map` drafts, with rows per second if no clock is found.
fn read(table: &Path, rate_hz: Option<f64>) -> FlightLog {
    let mut drafted = draft(table, &std::fs::read(table).unwrap()).unwrap().toml;
    if let Some(rate_hz) = rate_hz {
        assert!(drafted.contains("rate_hz = 100.0"), "{drafted}");
        drafted = drafted.replace("rate_hz = 100.0", &format!("rate_hz = {rate_hz:.1}"));
    }
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("map.toml");
    std::fs::write(&map, drafted).unwrap();
    let options = ReadOptions {
        mapping: Some(map),
        ..ReadOptions::default()
    };
    FlightLog::read_with(table, &options).unwrap()
}

/// A recording of `SensorCombined`, one JSON object per line, as a table like those of PX4's own tools. Its timestamps
/// are those of messages that arrive out of order; every row integrates 5 ms.
fn x500(dataset: &Path, broken: usize, recorded: &str) -> FlightLog {
    let name = format!("rosbag2_{recorded}");
    let path = dataset.join(format!("{broken}/{name}/{name}-SensorCombined.jsonl"));
    let mut table =
        "accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],gyro_rad[0],gyro_rad[1],gyro_rad[2]\n"
            .to_owned();
    for line in std::fs::read_to_string(&path).unwrap().lines() {
        let row: serde_json::Value = serde_json::from_str(line).unwrap();
        let axis = |name: &str, axis: usize| row[name][axis].as_f64().unwrap();
        let [a, g] =
            ["accelerometer_m_s2", "gyro_rad"].map(|name| [0, 1, 2].map(|k| axis(name, k).to_string()).join(","));
        writeln!(table, "{a},{g}").unwrap();
    }
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join(format!("x500-{broken}-{recorded}.csv"));
    std::fs::write(&csv, table).unwrap();
    read(&csv, Some(200.0))
}

fn parts(log: &FlightLog, seconds: &[(f64, f64)]) -> Vec<FlightLog> {
    seconds.iter().map(|(from, to)| log.part(*from, *to).unwrap()).collect()
}

/// True if the flight is said to vibrate more.
fn told(found: &Change) -> bool {
    assert!(found.named.is_empty(), "no rotor can be named: {}", found.sentence);
    found.sentence.contains("vibrates more between")
}

#[test]
fn val_broken_propellers_of_an_x500_are_told_and_healthy_flights_are_not() {
    let Some(folder) = folder("UAV-Realistic-Fault-Dataset/Dataset") else {
        return;
    };
    let logs: Vec<(usize, FlightLog)> = X500
        .iter()
        .map(|(broken, recorded)| (*broken, x500(&folder, *broken, recorded)))
        .collect();
    for (reference, healthy) in logs.iter().enumerate().filter(|(_, (broken, _))| *broken == 0) {
        let baseline = parts(&healthy.1, &X500_PARTS);
        let (mut alarms, mut found) = (0, 0);
        for (other, (broken, log)) in logs.iter().enumerate() {
            if other == reference {
                continue;
            }
            let change = change(std::slice::from_ref(log), &baseline, None).unwrap();
            println!("{} against {}: {}", log.name, healthy.1.name, change.sentence);
            if *broken == 0 {
                alarms += usize::from(told(&change));
            } else {
                found += usize::from(told(&change));
            }
        }
        assert_eq!((found, alarms), (6, 0), "of 6 with broken propellers and 1 healthy");
    }
}

/// Seconds of a healthy flight, and flights with their file and whether they are damaged.
type Case = (&'static str, [(f64, f64); 3], &'static [&'static str], usize);

#[test]
fn val_a_cut_tip_is_told_at_the_same_load() {
    let Some(folder) = folder("prop-damage-adapt/data") else {
        return;
    };
    let log = |file: &str| read(&folder.join(format!("{file}_inertial.csv")), None);
    // Files `M2…` to `M4…` of `quadcarbono` are `M1…` turned by 90° in software: no flights of their own.
    let cases: [Case; 4] = [
        (
            "quadcarbono/M1_Hnominal_corto",
            [(0.0, 43.0), (43.0, 86.0), (86.0, 129.0)],
            &[
                "quadcarbono/M1_Hasymm164",
                "quadcarbono_weight_shift/M1_Hasymm164_bat_adelante",
                "quadcarbono_weight_shift/M1_Hasymm164_bat_atras",
            ],
            3,
        ),
        (
            "quadcarbono_1000/M1_Hnominal_1000g",
            [(5.0, 40.0), (40.0, 75.0), (75.0, 110.0)],
            &["quadcarbono_1000/M1_Hasymm164_1000g"],
            1,
        ),
        (
            "quadcarbono_water/M1_Hnominal_start_agua",
            [(0.0, 15.0), (15.0, 30.0), (30.0, 45.0)],
            &["quadcarbono_water/M1_Hasymm164_start_agua"],
            0,
        ),
        (
            "hexaF550/M1_Hnominal",
            [(5.0, 40.0), (40.0, 75.0), (75.0, 110.0)],
            &["hexaF550/M1_Hasymm10"],
            0,
        ),
    ];
    let mut healthy = Vec::new();
    for (reference, seconds, damaged, expected) in cases {
        let whole = log(reference);
        let baseline = parts(&whole, &seconds);
        let mut found = 0;
        for file in damaged {
            let change = change(&[log(file)], &baseline, None).unwrap();
            println!("{file} against {reference}: {}", change.sentence);
            found += usize::from(told(&change));
        }
        assert_eq!(found, expected, "{reference}");
        healthy.push((reference, whole, baseline));
    }
    // Healthy flights of the same vehicle with another load.
    let of_the_quadrotor = &healthy[..3];
    for (name, flight, _) in of_the_quadrotor {
        for (reference, _, baseline) in of_the_quadrotor.iter().filter(|(other, ..)| other != name) {
            let change = change(std::slice::from_ref(flight), baseline, None).unwrap();
            println!("{name} against {reference}: {}", change.sentence);
            assert!(!told(&change), "{}", change.sentence);
        }
    }
    // Three healthy flights of three loads scatter too much for anything.
    let baseline: Vec<FlightLog> = of_the_quadrotor.iter().map(|(_, whole, _)| whole.clone()).collect();
    let damaged = change(&[log("quadcarbono/M1_Hasymm164")], &baseline, None).unwrap();
    println!("M1_Hasymm164 against three loads: {}", damaged.sentence);
    assert!(!told(&damaged));
}
