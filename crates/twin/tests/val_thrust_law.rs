//! A thrust that follows another law than Eq. 19: another exponent of the voltage, another slope over the duty. Hidden
//! by the independent simulator; the correct name, or no confident one.
//!
//! `LAW_CASES=24 LAW_FIRST_SEED=900 cargo test --release -p rotortwin-twin --test val_thrust_law -- --nocapture` flies more.

#![expect(clippy::unwrap_used, reason = "a refusal where none is due fails the test")]

use std::path::{Path, PathBuf};

use rotortwin_blind::flight::{FlightPlan, fly};
use rotortwin_blind::hidden::Hidden;
use rotortwin_blind::log_file;
use rotortwin_blind::script::Script;
use rotortwin_blind::vehicle::Vehicle;
use rotortwin_twin::diagnose::{Diagnosis, Options, Verdict, diagnose};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;

fn f550() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml")
}

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

fn said(flight: &str, seed: u64, effect: &str) -> Diagnosis {
    let vehicle = Vehicle::load(&f550()).unwrap();
    let plan = FlightPlan {
        effects: vec![Hidden::parse(effect).unwrap()],
        ..FlightPlan::new(vehicle, Script::built_in(flight, seed).unwrap(), 90.0, seed)
    };
    let (rows, _) = fly(&plan).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flown.parquet");
    log_file::write(&path, &rows).unwrap();
    let log = FlightLog::read(&path).unwrap();
    let model = ModelVersion::load(f550()).unwrap();
    let found = diagnose(&[log], &model, &Options::default()).unwrap();
    println!("{flight} {seed} {effect}: {}", found.sentence);
    found
}

/// True where something else is named with no doubt attached.
fn is_confidently_wrong(found: &Diagnosis, id: &str) -> bool {
    let confident = matches!(found.verdict, Verdict::Missing { .. } | Verdict::LogFault { .. });
    let named = || found.effects.iter().chain(&found.sensor_or_timing);
    let alternatives = named().any(|f| !f.also_compatible.is_empty());
    confident && !alternatives && named().any(|f| f.instance.effect != id)
}

#[test]
fn val_another_law_of_the_thrust_is_named_or_doubted() {
    let cases = setting("LAW_CASES", 4);
    let (mut right, mut wrong) = (0, Vec::new());
    for case in 0..cases {
        let seed = setting("LAW_FIRST_SEED", 640) + case;
        let flight = ["excitation", "waypoint"][(case / 4 % 2) as usize];
        let (id, effect) = match case % 4 {
            0 => ("voltage-exponent", "voltage-exponent:exponent=0.4"),
            1 => ("voltage-exponent", "voltage-exponent:exponent=-0.4"),
            2 => ("thrust-curve-shape", "thrust-curve-shape:share=0.15"),
            _ => ("thrust-curve-shape", "thrust-curve-shape:share=-0.15"),
        };
        let found = said(flight, seed, effect);
        let named: Vec<&str> = found
            .effects
            .iter()
            .chain(&found.sensor_or_timing)
            .map(|f| f.instance.effect.as_str())
            .collect();
        right += u64::from(named == [id]);
        if is_confidently_wrong(&found, id) {
            wrong.push(format!("{flight} {seed} {effect}: {}", found.sentence));
        }
    }
    println!("right {right} of {cases}, confidently wrong {}", wrong.len());
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(4 * right >= 3 * cases, "right {right} of {cases}");
}
