//! Every document under `config/`: every key documented, accepted, and flown to its end with the shipped controller.
#![expect(clippy::unwrap_used, reason = "a test that cannot read the configuration has failed")]

use std::path::{Path, PathBuf};

use rotortwin_flight_core::control::Controller;
use rotortwin_scenario::Scenario;

/// Largest distance from the position reference, m, over a whole flight of each scenario with its own seed; about twice the
/// measured value. Every scenario must be listed.
const LARGEST_ERROR_M: [(&str, f64); 19] = [
    ("autopilot-hover-octo", 4.0),
    ("autopilot-hover-quad", 4.0),
    ("autopilot-hover", 4.0),
    ("autopilot-waypoints", 4.0),
    ("gyro-bias", 0.005),
    ("helix-2", 1.2),
    ("hover", 0.01),
    ("lag-aware-reference-flight", 0.5),
    ("motors-off", 4.0),
    ("octo-helix-loss", 0.5),
    ("quad-hover-chip", 0.03),
    ("realistic-reference-flight", 0.7),
    ("reference-flight", 0.5),
    ("rotor-failure", 1.0),
    ("short-hover", 0.01),
    ("takeoff-and-land", 2.5),
    ("waypoints", 2.0),
    ("windy-hover", 0.5),
    ("worn-rotor", 0.2),
];

fn config(folder: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(folder)
}

fn documents(folder: &str) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(config(folder))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    assert!(
        paths.iter().all(|path| path.extension().is_some_and(|e| e == "toml")),
        "{paths:?}"
    );
    paths
}

fn stem(path: &Path) -> &str {
    path.file_stem().and_then(|name| name.to_str()).unwrap()
}

/// Distance from the position reference, largest over the flight, m.
fn largest_error(scenario: &Scenario) -> f64 {
    let mut sim = scenario.simulation(scenario.seed()).unwrap();
    let mut controller = Controller::new(scenario.controller_config()).unwrap();
    if scenario.starts_trimmed() {
        controller.trim(sim.hover_duty(), sim.sense().battery_voltage);
    }
    let mut largest: f64 = 0.0;
    while !sim.done() {
        let sample = sim.sense();
        let wanted = sample.reference.position_ned.to_array();
        let error = sim
            .truth()
            .position_ned_m
            .iter()
            .zip(wanted)
            .map(|(p, r)| (p - f64::from(r)).powi(2))
            .sum::<f64>();
        largest = largest.max(error.sqrt());
        let output = controller.step(&sample.nav, &sample.reference, sample.battery_voltage);
        sim.advance(&output.command).unwrap();
    }
    assert_eq!(sim.step(), scenario.duration_steps());
    largest
}

#[test]
fn scenario_every_shipped_flight_stays_on_course() {
    let paths = documents("scenarios");
    let listed: Vec<&str> = LARGEST_ERROR_M.iter().map(|(name, _)| *name).collect();
    assert_eq!(
        paths.iter().map(|path| stem(path)).collect::<Vec<_>>(),
        listed,
        "list every scenario with its bound"
    );
    for (path, (name, bound)) in paths.iter().zip(LARGEST_ERROR_M) {
        let scenario = Scenario::load(path).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(scenario.name(), name);
        let error = largest_error(&scenario);
        assert!(error < bound, "{name}: {error:.3} m from the reference");
        assert!(
            error > bound / 20.0,
            "{name}: {error:.4} m is far within its bound of {bound} m: tighten it"
        );
    }
}

#[test]
fn scenario_every_shipped_vehicle_hovers() {
    for path in documents("vehicles") {
        let text = format!(
            "name = 'hover'\ndescription = ''\nvehicle = '{}.toml'\nduration_s = 5.0\nmismatch = {{ preset = 'none' }}\n\
             trajectory = {{ kind = 'hover', position_ned_m = [0, 0, -5] }}",
            stem(&path)
        );
        let scenario = Scenario::parse(&text, config("vehicles")).unwrap_or_else(|error| panic!("{error}"));
        let error = largest_error(&scenario);
        assert!(error < 0.01, "{}: {error:.3} m from its place", path.display());
    }
}

#[test]
fn scenario_loss_of_a_rotor_stays_defined() {
    // A hexarotor with alternating spins cannot hold its attitude without a rotor: it tumbles, with finite numbers.
    let path = config("scenarios/hover.toml");
    let fault = "fault=[{ time_s = 5.0, rotor = 3, rotor_lost = true }]";
    let scenario = Scenario::load_with(path, &[fault, "duration_s=60.0"]).unwrap();
    assert!(largest_error(&scenario) > 1.0, "the vehicle should not survive this");
}

/// Keys of the shipped documents have a comment next to or above them; a table may be documented at its head.
#[test]
fn scenario_every_key_of_the_annotated_documents_has_a_comment() {
    let mut annotated = vec![config("scenarios/reference-flight.toml")];
    annotated.extend(documents("vehicles"));
    annotated.extend(documents("blades"));
    for path in annotated {
        let text = std::fs::read_to_string(&path).unwrap();
        let mut explained = false;
        for (number, line) in text.lines().enumerate() {
            let code = line.trim();
            let comment = code.contains('#');
            let key = code
                .split_once('=')
                .is_some_and(|(key, _)| !key.contains(['#', '{', '"']));
            // A comment on its own line documents the lines below it up to the next empty one.
            explained = !code.is_empty() && (explained || code.starts_with('#') || (code.starts_with('[') && comment));
            assert!(
                !key || comment || explained,
                "{}:{}: {line}",
                path.display(),
                number + 1
            );
        }
    }
}
