//! The development logs outside the repository, of the independent simulator and of real vehicles. Skipped if they are
//! not present.

mod development_data;

use development_data::shared;
use rotortwin_scenario::VehicleDocuments;
use rotortwin_twin::log::{FindingKind, FlightLog, names};
use std::path::{Path, PathBuf};

fn vehicle(name: &str) -> VehicleDocuments {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../config/vehicles/{name}.toml"));
    VehicleDocuments::load(path).expect(name)
}

#[test]
fn val_foreign_logs_are_not_accused_and_their_one_delay_is_seen() {
    /// The delays that other hidden effects feign, s.
    const FEIGNED_S: f64 = 4e-3;
    let Some(folder) = shared("data/hidden_effect") else {
        return;
    };
    let f550 = vehicle("f550");
    for number in 1..=16 {
        let log = FlightLog::read(&folder.join(format!("log{number:02}.parquet"))).expect("accepted");
        assert_eq!(log.report.findings, [], "log {number}");
        assert_eq!(log.check_against_vehicle(&f550.vehicle), [], "log {number}");
        // Log 15 hovers on the spot; log 10 has a velocity that is 80 ms late.
        for delay in log.report.delays.iter().filter(|_| number != 15) {
            let expected_s = match (number, delay.signal.as_str()) {
                (10, "velocity") => 0.08,
                (10, "position") => -0.08,
                _ => 0.0,
            };
            assert!(
                (delay.delay_s - expected_s).abs() < FEIGNED_S,
                "log {number}: {delay:?}"
            );
        }
    }
}

#[test]
fn val_swapped_motors_of_foreign_logs_are_named() {
    let Some(folder) = shared("data/hidden_effect") else {
        return;
    };
    let f550 = vehicle("f550");
    for number in [4, 16, 5] {
        let mut log = FlightLog::read(&folder.join(format!("log{number:02}.parquet"))).expect("accepted");
        // Rotors side by side differ little in the torques of a gentle helix: there nothing is said about 1 and 2.
        let pairs: &[(usize, usize)] = if number == 5 {
            &[(2, 5), (3, 6)]
        } else {
            &[(1, 2), (2, 5), (3, 6)]
        };
        for &(a, b) in pairs {
            let (left, right) = (names::duty(a), names::duty(b));
            let mut swap = || {
                let first = log.columns.remove(&left).expect("there");
                let second = log.columns.insert(right.clone(), first).expect("there");
                log.columns.insert(left.clone(), second);
            };
            swap();
            let found = log.check_against_vehicle(&f550.vehicle);
            assert!(
                found.iter().any(|finding| finding.kind == FindingKind::SwappedMotors
                    && finding.detail.contains(&format!("duty_{a} drives rotor {b}"))),
                "log {number}, {a} and {b}: {found:?}"
            );
            let mut swap = || {
                let first = log.columns.remove(&left).expect("there");
                let second = log.columns.insert(right.clone(), first).expect("there");
                log.columns.insert(left.clone(), second);
            };
            swap();
        }
    }
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push(path);
        }
    }
    found.sort();
    found
}

#[test]
fn val_every_real_flight_is_imported() {
    let Some(folder) = shared("data/real") else {
        return;
    };
    let crazyflie = vehicle("crazyflie-2");
    let mut imported = 0;
    for part in [
        "arpl_crazyflie_sysid",
        "crazypad_e8/motor_data",
        "crazypad_e8/controller_data",
        "crazyswarm2_slung_load/logs",
    ] {
        for path in files(&folder.join(part)) {
            if ["md", "LICENSE"]
                .iter()
                .any(|end| path.to_string_lossy().ends_with(end))
            {
                continue;
            }
            let log = FlightLog::read(&path).expect("accepted");
            assert!(
                log.duration_s() > 5.0 && log.report.findings.iter().all(|finding| !finding.blocks()),
                "{}: {:?}",
                path.display(),
                log.report.findings
            );
            if part.starts_with("arpl") {
                assert_eq!(log.check_against_vehicle(&crazyflie.vehicle), [], "{}", path.display());
            }
            imported += 1;
        }
    }
    // 3 + 123 + 10 files.
    assert!(imported >= 130, "{imported}");
    for (name, flight) in [
        ("pyulog_parser_samples/sample.ulg", false),
        ("pyulog_parser_samples/sample_log_small.ulg", false),
        ("ardupilot_text_logs/underpowered.log", true),
        ("ardupilot_text_logs/robert_lefebvre_octo_PM.log", true),
    ] {
        let log = FlightLog::read(&folder.join(name)).expect("accepted");
        let grounded = log
            .report
            .findings
            .iter()
            .any(|finding| finding.kind == FindingKind::NoFlight);
        assert_eq!(grounded, !flight, "{name}: {:?}", log.report.findings);
    }
}
