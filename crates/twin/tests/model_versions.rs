//! Model versions: documents, hashes, the store.

#![expect(clippy::unwrap_used, reason = "a refusal where none is due fails the test")]

use std::path::{Path, PathBuf};

use rotortwin_scenario::VehicleDocuments;
use rotortwin_twin::model::specification::{effect_by_hand, parse_parameter};
use rotortwin_twin::model::{
    Correlation, Difference, HeldOut, LogReference, ModelEffect, ModelStore, ModelVersion, Source,
};

fn vehicle_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml")
}

fn first() -> ModelVersion {
    ModelVersion::first("f550", VehicleDocuments::load(vehicle_path()).unwrap())
}

fn drag(value: f64) -> ModelEffect {
    let parameters = [format!("drag_n_s_m={value}±0.00196")];
    effect_by_hand("rotor-drag", None, None, &parameters).unwrap()
}

/// A version with everything that a version can hold.
fn full() -> ModelVersion {
    let mut found = drag(0.1 + 0.2);
    found.provenance.source = Source::Diagnosis;
    found.provenance.ln_bayes_factor = Some(12_345.678_9);
    found.provenance.posterior = Some(1.0);
    found.provenance.log = vec![LogReference {
        name: "a \"b\".parquet".into(),
        hash: "0".repeat(32),
    }];
    found.provenance.held_out = vec![HeldOut {
        data: "odd blocks".into(),
        quantity: "force".into(),
        unit: "mN".into(),
        before: 409.0,
        after: 1e-7,
    }];
    let mut wind = effect_by_hand(
        "accelerometer-bias",
        None,
        None,
        &["x_m_s2=0.3".into(), "y_m_s2=-0.2+-0.196".into()],
    )
    .unwrap();
    for effect in [&mut found, &mut wind] {
        effect.provenance.tool = "rotortwin 0.1.0".into();
    }
    let mut version = first().with_effects([found, wind], "two at once, with a # in the text");
    version.correlation = vec![Correlation {
        between: ["rotor-drag.drag_n_s_m".into(), "accelerometer-bias.x_m_s2".into()],
        coefficient: -0.5,
    }];
    version
}

fn refusal(text: &str) -> String {
    ModelVersion::parse("model.toml", text, Path::new(""))
        .unwrap_err()
        .to_string()
}

#[test]
fn val_a_version_reads_back_from_its_file() {
    let version = full();
    let text = version.to_toml();
    let again = ModelVersion::parse("model.toml", &text, Path::new("")).unwrap();
    assert_eq!(again, version);
    assert_eq!(again.to_toml(), text);
}

#[test]
fn val_a_version_with_a_wind_for_each_flight_reads_back_and_says_what_changed() {
    let (before, after) = (full(), full().with_own_winds());
    let text = after.to_toml();
    assert_eq!(ModelVersion::parse("model.toml", &text, Path::new("")).unwrap(), after);
    assert_ne!(before.hash(), after.hash());
    let changed = Difference::between(&before, &after);
    assert!(changed.parameters.is_empty(), "{changed:?}");
    let keys: Vec<&str> = changed.keys.iter().map(|change| change.key.as_str()).collect();
    assert_eq!(keys, ["wind_of_each_flight"]);
    // Files of before this key mean what they meant.
    assert!(!before.to_toml().contains("wind_of_each_flight"));
}

#[test]
fn val_a_vehicle_document_is_version_0() {
    let version = ModelVersion::load(vehicle_path()).unwrap();
    assert_eq!(version, first());
    assert!(version.effect.is_empty() && version.parent.is_none());
}

#[test]
fn val_a_version_may_refer_to_its_vehicle_and_notices_when_it_changed() {
    let folder = tempfile::tempdir().unwrap();
    let copy = |name: &str| std::fs::read_to_string(vehicle_path().parent().unwrap().join(name)).unwrap();
    let vehicle = copy("f550.toml").replace("../blades/", "");
    std::fs::write(folder.path().join("vehicle.toml"), &vehicle).unwrap();
    std::fs::write(folder.path().join("t9545.toml"), copy("../blades/t9545.toml")).unwrap();
    let documents = VehicleDocuments::load(folder.path().join("vehicle.toml")).unwrap();
    let version = ModelVersion::first("f550", documents).with_effects([drag(0.25)], "");
    let path = folder.path().join("model.toml");
    std::fs::write(&path, version.to_toml_with_vehicle_file("vehicle.toml")).unwrap();
    let read = ModelVersion::load(&path).unwrap();
    assert_eq!(read, version);
    assert_eq!(
        read.hash(),
        version.hash(),
        "the hash is of the content, not of the layout"
    );

    std::fs::write(
        folder.path().join("vehicle.toml"),
        vehicle.replace("mass_kg = 1.55", "mass_kg = 1.56"),
    )
    .unwrap();
    let sentence = ModelVersion::load(&path).unwrap_err().to_string();
    assert!(
        sentence.contains("key `vehicle_file.hash`") && sentence.contains("was changed"),
        "{sentence}"
    );
}

#[test]
fn regress_the_content_hash_is_stable() {
    // Frozen: files written by an earlier program must keep their hash.
    assert_eq!(full().hash(), "a85a78ca82dfd94300b21704ba9e5640");
    assert_eq!(full().vehicle_hash(), "f21b81c25f786d993671aa8785b660b3");
}

#[test]
fn val_the_hash_ignores_layout_and_sees_every_value() {
    let version = full();
    let text = version.to_toml();
    let respaced = text
        .replace(" = ", "   =  ")
        .replace("# Model version", "# Another remark");
    assert_eq!(
        ModelVersion::parse("m", &respaced, Path::new("")).unwrap().hash(),
        version.hash()
    );
    let changes: [fn(&mut ModelVersion); 6] = [
        |v| v.note.push('!'),
        |v| v.parent = None,
        |v| *v.effect[0].parameters.get_mut("drag_n_s_m").unwrap() += 1e-15,
        |v| v.effect[0].provenance.posterior = None,
        |v| v.correlation[0].coefficient = 0.5,
        |v| v.vehicle.body.mass_kg += 1e-12,
    ];
    for change in changes {
        let mut other = version.clone();
        change(&mut other);
        assert_ne!(other.hash(), version.hash());
    }
}

#[test]
fn val_an_edited_file_is_refused_until_its_hash_is_taken_out() {
    let text = full().to_toml();
    let edited = text.replace("y_m_s2 = -0.2", "y_m_s2 = -0.25");
    let sentence = refusal(&edited);
    assert!(sentence.starts_with("model.toml, line 6, key `hash`: "), "{sentence}");
    let without: String = edited
        .lines()
        .filter(|l| !l.starts_with("hash = "))
        .map(|l| format!("{l}\n"))
        .collect();
    assert_eq!(
        ModelVersion::parse("m", &without, Path::new("")).unwrap().effect[1].parameters["y_m_s2"],
        -0.25
    );
}

#[test]
fn val_a_bad_document_is_refused_with_file_and_key() {
    let text: String = full()
        .to_toml()
        .lines()
        .filter(|l| !l.starts_with("hash = "))
        .map(|l| format!("{l}\n"))
        .collect();
    let cases = [
        ("model_format = 1", "model_format = 2", "key `model_format`: expected 1"),
        (
            "name = \"f550\"",
            "name = \"../x\"",
            "key `name`: expected 1 to 64 letters",
        ),
        ("parent = \"", "parent = \"zz", "key `parent`: expected a content hash"),
        (
            "effect = \"accelerometer-bias\"",
            "effect = \"rotor-drag\"",
            "key `effect[",
        ),
        (
            "effect = \"accelerometer-bias\"",
            "effect = \"accelerometer-bias\"\nrotor = 7",
            "key `effect[1].rotor`: accelerometer-bias belongs to the whole vehicle",
        ),
        ("y_m_s2 = 0.1", "w_m_s2 = 0.1", "key `effect[1].deviations.w_m_s2`"),
        (
            "y_m_s2 = 0.1",
            "y_m_s2 = -0.1",
            "key `effect[1].deviations.y_m_s2`: expected a standard deviation",
        ),
        (
            "y_m_s2 = -0.2",
            "y_m_s2 = nan",
            "key `effect[1].parameters.y_m_s2`: expected a number from",
        ),
        (
            "effect = \"accelerometer-bias\"",
            "effect = \"rotor-grag\"",
            "key `effect[1].effect`: expected the id of an effect",
        ),
        (
            "source = \"by-hand\"",
            "source = \"guessed\"",
            "expected one of by-hand, diagnosis",
        ),
        (
            "coefficient = -0.5",
            "coefficient = -1.5",
            "key `correlation[0].coefficient`",
        ),
        (
            "\"rotor-drag.drag_n_s_m\"",
            "\"drag\"",
            "key `correlation[0].between[0]`",
        ),
        ("mass_kg = 1.55", "mass_kg = -1.55", "key `vehicle.body.mass_kg`"),
        ("mass_kg = 1.55", "mass = 1.55", "vehicle.body.mass"),
        ("[blades]", "[knives]", "blades"),
    ];
    for (from, to, expected) in cases {
        assert!(text.contains(from), "{from}");
        let sentence = refusal(&text.replacen(from, to, 1));
        assert!(
            sentence.starts_with("model.toml") && sentence.contains(expected),
            "{from} → {to}: {sentence}"
        );
        assert!(!sentence.contains('\n'), "one sentence: {sentence}");
    }
    for (text, expected) in [
        ("x = ", "expected valid TOML"),
        ("x = 1", "expected a model version"),
        (
            "time_s,roll_rad\n0,0\n",
            "model.toml: this is a flight log; expected a vehicle document",
        ),
        ("PAR1", "model.toml: this is a flight log; expected a vehicle document"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.toml");
        std::fs::write(&path, text).unwrap();
        let sentence = ModelVersion::load(&path).unwrap_err().to_string();
        assert!(
            sentence.contains("model.toml") && sentence.contains(expected),
            "{sentence}"
        );
    }
}

#[test]
fn val_a_parameter_on_the_command_line() {
    assert_eq!(
        parse_parameter("kd=0.25±0.01"),
        Ok(("kd".into(), 0.25, Some(0.01 / 1.96)))
    );
    assert_eq!(
        parse_parameter("kd=-1e-3+/-2e-4"),
        Ok(("kd".into(), -1e-3, Some(2e-4 / 1.96)))
    );
    assert_eq!(parse_parameter("kd=1+-0"), Ok(("kd".into(), 1.0, Some(0.0))));
    assert_eq!(parse_parameter("kd=1"), Ok(("kd".into(), 1.0, None)));
    for wrong in ["kd", "=1", "kd=x", "kd=inf", "kd=1±", "kd=1±-1", "kd=nan"] {
        assert!(
            parse_parameter(wrong).unwrap_err().contains(&format!("`{wrong}`")),
            "{wrong}"
        );
    }
}

#[test]
fn val_adding_again_replaces_the_term_and_its_correlations() {
    let version = full();
    let next = version.with_effects([drag(0.4)], "refit");
    assert_eq!(next.parent, Some(version.hash()));
    assert_eq!(next.effect.len(), 2);
    assert_eq!(next.effect[0].parameters["drag_n_s_m"], 0.4);
    assert!(next.correlation.is_empty());
}

#[test]
fn scenario_versions_undo_branch_and_diff_in_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let store = ModelStore::new(folder.path().join("models"));
    assert!(store.names().unwrap().is_empty());
    let v0 = first();
    store.create(&v0).unwrap();
    assert!(store.create(&v0).unwrap_err().to_string().contains("already"));
    let v1 = v0.with_effects([drag(0.25)], "first");
    assert_eq!(store.append("main", &v1).unwrap().number, 1);
    // A version that is not based on the head is rejected: no other version is overwritten.
    assert!(
        store
            .append("main", &v0.with_effects([drag(0.3)], ""))
            .unwrap_err()
            .to_string()
            .contains("nothing was written")
    );
    store.branch("f550", "windy", 0).unwrap();
    let wind = effect_by_hand(
        "accelerometer-bias",
        None,
        None,
        &["x_m_s2=0.3".into(), "y_m_s2=0".into()],
    )
    .unwrap();
    let v2 = v0.with_effects([wind], "");
    assert_eq!(store.append("windy", &v2).unwrap().number, 2);
    assert_eq!(store.find("f550").unwrap().version, v1);
    assert_eq!(store.find("f550@windy").unwrap().version, v2);
    assert_eq!(store.find("f550@v0").unwrap().version, v0);
    assert_eq!(store.find("f550@windy").unwrap().label(), "f550@v2");

    let difference = Difference::between(&v1, &v2);
    let labels: Vec<_> = difference
        .parameters
        .iter()
        .map(|c| (c.effect.as_str(), c.before.is_some(), c.after.is_some()))
        .collect();
    assert_eq!(
        labels,
        [
            ("rotor-drag", true, false),
            ("accelerometer-bias", false, true),
            ("accelerometer-bias", false, true)
        ]
    );
    assert!(Difference::between(&v1, &v1).is_empty());

    assert_eq!(store.undo("f550", "main").unwrap(), (1, 0));
    assert_eq!(store.find("f550").unwrap().version, v0);
    assert!(
        store
            .undo("f550", "main")
            .unwrap_err()
            .to_string()
            .contains("nothing to undo")
    );
    assert_eq!(store.find("f550@v1").unwrap().version, v1, "undo loses nothing");
    assert_eq!(store.history("f550").unwrap().line_to(2), [0, 2]);
    assert_eq!(store.names().unwrap(), ["f550"]);
    // Nothing but versions and branches is left behind.
    let mut files: Vec<_> = std::fs::read_dir(folder.path().join("models/f550"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    assert_eq!(files, ["main.branch", "v0.toml", "v1.toml", "v2.toml", "windy.branch"]);
}

#[test]
fn val_a_damaged_store_is_told_with_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let store = ModelStore::new(folder.path());
    store.create(&first()).unwrap();
    let head = folder.path().join("f550/main.branch");
    for (text, expected) in [
        ("v9\n", "there is no v9.toml"),
        ("latest", "expected one version such as v1"),
    ] {
        std::fs::write(&head, text).unwrap();
        let sentence = store.find("f550").unwrap_err().to_string();
        assert!(
            sentence.contains("main.branch") && sentence.contains(expected),
            "{sentence}"
        );
    }
    assert!(
        store
            .find("f550@nowhere")
            .unwrap_err()
            .to_string()
            .contains("nowhere.branch")
    );
    assert!(store.find("other").unwrap_err().to_string().contains("models: f550"));
    let v0 = folder.path().join("f550/v0.toml");
    let text = std::fs::read_to_string(&v0).unwrap();
    std::fs::write(&v0, &text[..text.len() / 2]).unwrap();
    assert!(store.find("f550@v0").unwrap_err().to_string().contains("v0.toml"));
}
