//! The sixteen flight logs of a foreign simulator, each with a known hidden effect or none: the right answer on each.
//!
//! The logs are not in the repository; without them the tests say so and end.

use std::path::PathBuf;

use rotortwin_plant::VehicleDocuments;
use rotortwin_twin::diagnose::{Diagnosis, Options, Verdict, diagnose};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn answer(number: usize) -> Option<Diagnosis> {
    let folder = std::env::var_os("ROTORTWIN_SHARED").map_or_else(|| root().join("../shared"), PathBuf::from);
    let path = folder.join(format!("data/hidden_effect/log{number:02}.parquet"));
    if !path.is_file() {
        rotortwin_skip(&format!("{} is not there", path.display()));
        return None;
    }
    let log = FlightLog::read(&path).expect("a canonical log");
    let documents = VehicleDocuments::load(root().join("config/vehicles/f550.toml")).expect("the F550");
    let model = ModelVersion::first("f550", documents);
    Some(diagnose(&[log], &model, &Options::default()).expect("a diagnosis"))
}

/// As in the system tests: `./test` counts these lines.
fn rotortwin_skip(reason: &str) {
    use std::io::Write as _;
    eprintln!("skipped: {reason}");
    if let Some(log) = std::env::var_os("ROTORTWIN_SKIP_LOG") {
        let file = std::fs::OpenOptions::new().create(true).append(true).open(log);
        let written = file.and_then(|mut file| writeln!(file, "{reason}"));
        written.expect("the file named by ROTORTWIN_SKIP_LOG can be written");
    }
}

fn named(diagnosis: &Diagnosis) -> Vec<(String, Option<usize>)> {
    let found = diagnosis.effects.iter().chain(&diagnosis.sensor_or_timing);
    found.map(|f| (f.instance.effect.clone(), f.instance.rotor)).collect()
}

fn value(diagnosis: &Diagnosis, effect: &str, parameter: &str) -> f64 {
    let mut found = diagnosis.effects.iter().chain(&diagnosis.sensor_or_timing);
    found
        .find(|f| f.instance.effect == effect)
        .expect("the effect is found")
        .instance
        .parameters[parameter]
}

#[test]
fn val_healthy_flights_agree() {
    for number in [4, 16, 15] {
        let Some(diagnosis) = answer(number) else { return };
        assert_eq!(
            diagnosis.verdict,
            Verdict::Agrees,
            "log {number}: {}",
            diagnosis.sentence
        );
        assert!(
            number != 15 || diagnosis.not_testable.len() > 10,
            "hover cannot show much"
        );
    }
}

#[test]
fn val_rotor_drag_is_named_and_its_error_falls_to_the_noise() {
    let Some(diagnosis) = answer(1) else { return };
    assert_eq!(
        named(&diagnosis),
        [("rotor-drag".to_owned(), None)],
        "{}",
        diagnosis.sentence
    );
    // Hidden: 0.25; clutter of the other drags makes it uncertain by 1 %.
    assert!((value(&diagnosis, "rotor-drag", "drag_n_s_m") - 0.25).abs() < 0.0075);
    let force = diagnosis.held_out.iter().find(|e| e.quantity == "force").unwrap();
    assert!(force.before > 0.3 && force.after < 0.025, "{force:?}");
}

#[test]
fn val_centre_of_mass_and_blade_are_told_apart() {
    let Some(diagnosis) = answer(5) else { return };
    assert_eq!(
        named(&diagnosis),
        [("centre-of-mass".to_owned(), None)],
        "{}",
        diagnosis.sentence
    );
    assert!((value(&diagnosis, "centre-of-mass", "forward_m") - 0.008).abs() < 0.0005);
    assert!((value(&diagnosis, "centre-of-mass", "right_m") + 0.005).abs() < 0.0005);
    let Some(diagnosis) = answer(7) else { return };
    assert_eq!(
        named(&diagnosis),
        [("rotor-thrust-scale".to_owned(), Some(3))],
        "{}",
        diagnosis.sentence
    );
}

#[test]
fn val_log_faults_are_not_missing_physics() {
    for (number, id) in [(10, "velocity-latency"), (11, "heading-offset")] {
        let Some(diagnosis) = answer(number) else { return };
        assert!(
            matches!(diagnosis.verdict, Verdict::LogFault { .. }),
            "{}",
            diagnosis.sentence
        );
        assert_eq!(named(&diagnosis), [(id.to_owned(), None)], "{}", diagnosis.sentence);
    }
}
