//! A drag that differs forward and sideways, hidden by the foreign simulator: named with a value whose interval holds the truth; not
//! named where there is none; and not told from rotor drag where a flight goes one way only.
//!
//! `ANISOTROPY_CASES=24 ANISOTROPY_FIRST_SEED=900 cargo test --release -p rotortwin-twin --test val_drag_anisotropy -- --nocapture`
//! flies more.

#![expect(clippy::unwrap_used, reason = "a refusal where none is due fails the test")]

use std::path::{Path, PathBuf};

use rotortwin_blind::flight::{FlightPlan, fly};
use rotortwin_blind::hidden::Hidden;
use rotortwin_blind::log_file;
use rotortwin_blind::script::{Script, Segment};
use rotortwin_blind::vehicle::Vehicle;
use rotortwin_twin::diagnose::{Diagnosis, Finding, Options, diagnose};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;

const ID: &str = "drag-anisotropy";

fn f550() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml")
}

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

fn said(script: Script, seed: u64, effects: &[&str]) -> Diagnosis {
    let vehicle = Vehicle::load(&f550()).unwrap();
    let name = script.name.clone();
    let plan = FlightPlan {
        effects: effects.iter().map(|text| Hidden::parse(text).unwrap()).collect(),
        ..FlightPlan::new(vehicle, script, 60.0, seed)
    };
    let (rows, _) = fly(&plan).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flown.parquet");
    log_file::write(&path, &rows).unwrap();
    let log = FlightLog::read(&path).unwrap();
    let model = ModelVersion::load(f550()).unwrap();
    let found = diagnose(&[log], &model, &Options::default()).unwrap();
    println!("{name} {seed} {effects:?}: {}", found.sentence);
    found
}

fn built_in(case: u64, seed: u64) -> Script {
    Script::built_in(["excitation", "waypoint"][(case % 2) as usize], seed).unwrap()
}

fn named(found: &Diagnosis) -> Vec<&str> {
    let all = found.effects.iter().chain(&found.sensor_or_timing);
    all.map(|f| f.instance.effect.as_str()).collect()
}

fn finding<'a>(found: &'a Diagnosis, id: &str) -> &'a Finding {
    found.effects.iter().find(|f| f.instance.effect == id).unwrap()
}

#[test]
fn val_a_drag_that_differs_sideways_is_named_with_its_size() {
    let cases = setting("ANISOTROPY_CASES", 4);
    let mut held = 0;
    for case in 0..cases {
        let seed = setting("ANISOTROPY_FIRST_SEED", 7120) + case;
        let truth = [0.15, -0.15, 0.08, -0.25][(case % 4) as usize];
        let hidden = format!("{ID}:difference_kg_s={truth}");
        // Every other one beside an ordinary drag.
        let drag = "rotor-drag:drag_n_s_m=0.2";
        let both = [drag, hidden.as_str()];
        let effects = if case % 4 < 2 { &both[1..] } else { &both[..] };
        let found = said(built_in(case, seed), seed, effects);
        let mut names = named(&found);
        names.sort_unstable();
        assert_eq!(names.len(), effects.len(), "{}", found.sentence);
        assert_eq!(names[0], ID, "{}", found.sentence);
        let parameter = &finding(&found, ID).parameters[0];
        let (value, interval) = (parameter.value, parameter.interval_95);
        // Two intervals: one in twenty is outside of one.
        assert!(
            (value - truth).abs() < 2.0 * interval,
            "{value} ± {interval} for {truth}"
        );
        held += u64::from((value - truth).abs() < interval);
    }
    println!("{held} of {cases} within the interval");
    assert!(10 * held >= 7 * cases, "{held} of {cases} within the interval");
}

#[test]
fn val_an_even_drag_is_not_called_uneven() {
    let others = [
        "rotor-drag:drag_n_s_m=0.25",
        "linear-friction:drag_kg_s=0.2",
        "quadratic-drag:drag_kg_m=0.03",
        "",
    ];
    for (case, other) in (0..).zip(others) {
        let seed = setting("ANISOTROPY_FIRST_SEED", 7120) + 100 + case;
        let effects: Vec<&str> = [other].into_iter().filter(|text| !text.is_empty()).collect();
        let found = said(built_in(case, seed), seed, &effects);
        let expected: Vec<&str> = effects.iter().filter_map(|text| text.split(':').next()).collect();
        assert_eq!(named(&found), expected, "{}", found.sentence);
    }
}

#[test]
fn val_one_way_alone_does_not_tell_it_from_rotor_drag() {
    let leg = |north_m: f64| Segment::Go {
        duration_s: 5.0,
        north_m,
        east_m: 0.0,
        height_m: 3.0,
        yaw_rad: Some(0.0),
    };
    let script = Script {
        name: "to and fro".to_owned(),
        start_height_m: 3.0,
        start_north_m: 0.0,
        smoothing_rad_s: 8.0,
        segment: [12.0, 0.0].repeat(6).into_iter().map(leg).collect(),
    };
    let found = said(script, 7320, &[&format!("{ID}:difference_kg_s=0.3")]);
    let rivals = || found.effects.iter().flat_map(|f| &f.also_compatible);
    let told = |id: &str| named(&found).contains(&id) || rivals().any(|rival| rival.effect == id);
    assert!(told(ID) && told("rotor-drag"), "{}", found.sentence);
}
