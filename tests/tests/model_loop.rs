//! Runs of this program as flight logs: the diagnosis of a run folder names the hidden effect of its scenario; for a
//! scenario without an effect or faults, the model agrees.

use std::path::{Path, PathBuf};

use rotortwin_tests::program::{Call, Link, text};
use rotortwin_tests::scratch::{Scratch, repository};
use serde_json::Value;

fn scenario(effect: &str) -> String {
    let vehicle = repository().join("config/vehicles/f550.toml");
    format!(
        "name = 'hidden'\ndescription = 'legs with a hidden effect'\nvehicle = '{}'\nduration_s = 40.0\n[trajectory]\nkind = 'waypoints'\n\
         points_ned_m = [[0.0, 0.0, -5.0], [8.0, 0.0, -5.0], [8.0, 8.0, -8.0], [0.0, 8.0, -8.0], [-6.0, 2.0, -4.0], [0.0, 0.0, -5.0]]\n\
         interval_s = 6.0\nspeed_m_s = 4.0\n{effect}",
        vehicle.display()
    )
}

/// Verdict and named effects of a run folder.
fn diagnosed(scratch: &Scratch, effect: &str, name: &str) -> (String, Vec<(String, f64)>) {
    let path = scratch.write(&format!("{name}.toml"), scenario(effect));
    let flown = Call::fly(scratch, Link::InProcess, &path, name).run().expect_code(0);
    let model = repository().join("config/vehicles/f550.toml");
    let ended = Call::new(scratch, ["diagnose".into(), flown.out().as_os_str().to_owned()])
        .with(["--model".into(), model.into_os_string(), "--json".into()])
        .run()
        .expect_code(0);
    let diagnosis: Value = serde_json::from_str(&ended.stdout).expect("JSON");
    let named = diagnosis["effects"].as_array().expect("a list").iter().map(|finding| {
        let value = finding["parameters"][0]["value"].as_f64().expect("a value");
        (text(finding, "/instance/effect").to_owned(), value)
    });
    let named = named.collect();
    (text(&diagnosis, "/verdict/kind").to_owned(), named)
}

#[test]
fn scenario_a_hidden_effect_of_a_run_is_named_from_its_folder() {
    let scratch = Scratch::new();
    let drag = "[[effect]]\neffect = 'rotor-drag'\nparameters = { drag_n_s_m = 0.25 }\n";
    let (verdict, named) = diagnosed(&scratch, drag, "drag");
    assert_eq!(verdict, "missing");
    assert!(
        matches!(named.as_slice(), [(id, value)] if id == "rotor-drag" && (value - 0.25).abs() < 0.01),
        "{named:?}"
    );
    let (verdict, named) = diagnosed(&scratch, "", "healthy");
    assert_eq!((verdict.as_str(), named), ("agrees", Vec::new()));
}

/// `model add`, `diagnose` and `improve` print the version that they stand on with its hash; a diagnosis is only added to the version it was made on.
#[test]
fn scenario_commands_say_on_which_version_they_stand() {
    let scratch = Scratch::new();
    let call = |line: &str, code: i32| {
        let words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        let ended = Call::new(&scratch, words).run().expect_code(code);
        format!("{}{}", ended.stdout, ended.stderr.join("\n"))
    };
    // The hash that `model show` gives, and that of a version file.
    let hash = |model: &str| {
        let shown: Value = serde_json::from_str(&call(&format!("model show {model} --json"), 0)).expect("JSON");
        let hash = text(&shown, "/hash").to_owned();
        assert_eq!(hash.len(), 32, "{hash}");
        (text(&shown, "/version").to_owned(), hash)
    };
    call(
        "blind generate --effect rotor-drag --flight waypoint --seed 7 --duration-s 60 --out log.parquet",
        0,
    );

    // On the shipped vehicle, of which no folder of models has a version.
    let said = call("diagnose log.parquet --model f550 --out found", 0);
    let diagnosis = rotortwin_tests::program::read_json(&scratch.path("found/diagnosis.json"));
    let vehicle = text(&diagnosis, "/model/hash").to_owned();
    assert!(said.contains(&format!("Model        f550, hash {vehicle}")), "{said}");
    let added = call("model add f550 --from found/diagnosis.json", 0);
    let (label, first) = hash("f550");
    assert_eq!(label, "f550@v1");
    assert!(added.starts_with(&format!("f550@v1 · hash {first}")), "{added}");
    assert_eq!(hash("f550@v0").1, vehicle);

    // On a version of the folder: its number, not only the name.
    let said = call("diagnose log.parquet --model f550", 0);
    assert!(said.contains(&format!("Model        f550@v1, hash {first}")), "{said}");
    let said = call("improve log.parquet --model f550 --yes", 0);
    assert!(said.contains(&format!("Model        f550@v1, hash {first}")), "{said}");
    call("model branch f550@v0 again", 0);
    let said = call("improve log.parquet --model f550@again --yes", 0);
    let (label, last) = hash("f550@again");
    assert_eq!(label, "f550@v2");
    let line = format!("Model        f550@v2, hash {last}; based on f550@v0, hash {vehicle}");
    assert!(said.contains(&line), "{said}");

    // The same findings once more.
    let again = call("model add f550 --from found/diagnosis.json", 2);
    assert!(again.contains("f550 has all of this already"), "{again}");
    // On a version with something else, and on another vehicle.
    call("model add f550 mass share=0.02", 0);
    let (_, heavier) = hash("f550");
    for (model, there) in [("f550", heavier), ("quad-x", String::new())] {
        let before = scratch.listing();
        let refused = call(&format!("model add {model} --from found/diagnosis.json"), 2);
        for said in ["f550", vehicle.as_str(), model, there.as_str(), "diagnose against that"] {
            assert!(refused.contains(said), "expected {said} in: {refused}");
        }
        assert_eq!(scratch.listing(), before, "{model}: something was written");
    }
}

/// A scenario that is shipped, with the vehicle that it flies.
struct Shipped {
    name: String,
    path: PathBuf,
    vehicle: PathBuf,
}

/// The scenarios that fly the vehicle as its document has it, once their faults are left out: no wind, no mismatch, no effect, no sensor that
/// errs.
fn healthy() -> Vec<Shipped> {
    let folder = repository().join("config/scenarios");
    let mut paths: Vec<PathBuf> = std::fs::read_dir(&folder)
        .expect("a folder of scenarios")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|end| end == "toml"))
        .collect();
    paths.sort();
    paths
        .into_iter()
        .filter_map(|path| as_its_document(&folder, path))
        .collect()
}

fn as_its_document(folder: &Path, path: PathBuf) -> Option<Shipped> {
    let text = std::fs::read_to_string(&path).expect("a scenario");
    let document: toml::Table = toml::from_str(&text).expect("TOML");
    let other = ["wind", "mismatch", "effect", "load_drop", "sensor_fault"];
    let vehicle = document["vehicle"].as_str().expect("a vehicle");
    other.iter().all(|key| !document.contains_key(*key)).then(|| Shipped {
        name: path.file_stem().expect("a name").to_string_lossy().into_owned(),
        vehicle: folder.join(vehicle),
        path,
    })
}

/// What the diagnosis of healthy flights names that is not there, as `scenario seed: sentence`; a flight of `seconds` at the most.
fn named_where_nothing_is(seeds: impl Fn(usize) -> Vec<u64>, seconds: Option<f64>) -> Vec<String> {
    let mut wrong = Vec::new();
    let all = healthy();
    assert!(all.len() >= 13, "{} scenarios", all.len());
    for (place, one) in all.iter().enumerate() {
        for seed in seeds(place) {
            let scratch = Scratch::new();
            let mut arguments = vec![
                "--set".to_owned(),
                "fault=[]".to_owned(),
                "--seed".to_owned(),
                seed.to_string(),
            ];
            // A hover's seconds are alike; what lands has to have landed.
            let whole = one.name.ends_with("hover") || one.name == "takeoff-and-land";
            if let Some(seconds) = seconds.filter(|_| !whole) {
                arguments.extend(["--set".to_owned(), format!("duration_s={seconds}")]);
            }
            let flown = Call::fly(&scratch, Link::InProcess, &one.path, "flown")
                .with(arguments)
                .run()
                .expect_code(0);
            let ended = Call::new(&scratch, ["diagnose".into(), flown.out().as_os_str().to_owned()])
                .with(["--model".into(), one.vehicle.clone().into_os_string(), "--json".into()])
                .run()
                .expect_code(0);
            let diagnosis: Value = serde_json::from_str(&ended.stdout).expect("JSON");
            let (verdict, sentence) = (text(&diagnosis, "/verdict/kind"), text(&diagnosis, "/sentence"));
            println!("{} {seed}: {verdict}", one.name);
            if verdict != "agrees" {
                wrong.push(format!("{} {seed}: {sentence}", one.name));
            }
        }
    }
    wrong
}

/// Whole hovers, the whole flight that lands, and the first 20 s of the others, each with a seed of its own. Of whole flights with five seeds, which takes five minutes:
/// `cargo test --release -p rotortwin-tests --test model_loop -- --ignored --nocapture`.
#[test]
fn val_the_model_agrees_with_every_healthy_scenario() {
    let wrong = named_where_nothing_is(|place| vec![911 + place as u64], Some(20.0));
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
#[ignore = "five minutes: cargo test --release -p rotortwin-tests --test model_loop -- --ignored --nocapture"]
fn val_the_model_agrees_with_every_healthy_scenario_at_five_seeds() {
    let wrong = named_where_nothing_is(|_| (901..=905).collect(), None);
    assert!(wrong.is_empty(), "{wrong:#?}");
}
