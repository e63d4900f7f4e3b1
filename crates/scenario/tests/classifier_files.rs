//! Classifier files: round trips are bit-identical; a file that does not fit is rejected with an error message.
#![expect(clippy::unwrap_used, reason = "a test that cannot read the configuration has failed")]

use std::path::{Path, PathBuf};

use rotortwin_scenario::settings::NominalThrustModel;
use rotortwin_scenario::{Classifier, Documents, Scenario};

fn config(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path)
}

fn shipped() -> Classifier {
    Classifier::read(&config("classifiers/f550-paper.json")).unwrap()
}

#[test]
fn val_file_reads_back_to_the_same_bits() {
    for name in ["f550-paper", "f550-improved"] {
        let path = config(&format!("classifiers/{name}.json"));
        let classifier = Classifier::read(&path).unwrap();
        assert_eq!(classifier.to_json(), std::fs::read_to_string(&path).unwrap());
    }
}

#[test]
fn prop_any_weight_passes_through_file_and_documents() {
    let mut random = rotortwin_plant::random::RandomStream::new(1, "weights");
    let mut classifier = shipped();
    let mut scenario = Scenario::load(config("scenarios/reference-flight.toml"))
        .unwrap()
        .documents()
        .clone();
    for _ in 0..64 {
        // Any finite f32, by its bits.
        for weight in &mut classifier.weights.hidden_weight {
            *weight = std::iter::repeat_with(|| f32::from_bits((random.unit() * 4_294_967_296.0) as u32))
                .find(|weight| weight.is_finite())
                .unwrap();
        }
        let bits = |c: &Classifier| c.weights.hidden_weight.iter().map(|w| w.to_bits()).collect::<Vec<_>>();
        let again: Classifier = serde_json::from_str(&classifier.to_json()).unwrap();
        assert_eq!(bits(&again), bits(&classifier));
        scenario.classifier = Some(classifier.clone());
        let documents = Documents::from_toml("documents", &scenario.to_toml()).unwrap();
        assert_eq!(bits(documents.classifier.as_ref().unwrap()), bits(&classifier));
    }
}

#[test]
fn scenario_documents_carry_the_network_itself() {
    let scenario = Scenario::load(config("scenarios/reference-flight.toml")).unwrap();
    let network = scenario.fdi_config().network.unwrap();
    let documents = Documents::from_toml("documents", &scenario.documents().to_toml()).unwrap();
    let again = Scenario::from_documents(&documents).unwrap();
    assert_eq!(again.fdi_config().network, Some(network));
    assert!(!network.self_calibrated());
    let improved = Scenario::load(config("scenarios/lag-aware-reference-flight.toml")).unwrap();
    assert!(improved.fdi_config().network.unwrap().self_calibrated());

    let bare = Scenario::load_without_classifier(config("scenarios/reference-flight.toml")).unwrap();
    assert!(bare.fdi_config().network.is_none() && bare.document().fdi.network.is_none());
    let mut torn = documents;
    torn.classifier = None;
    let sentence = Scenario::from_documents(&torn).unwrap_err().to_string();
    assert!(
        sentence.ends_with("key `fdi.network`: expected the classifier with the documents, it is missing"),
        "{sentence}"
    );
}

/// Error message after replacing `from` by `to` in the reference flight and modifying its classifier with `spoil`.
fn refusal(from: &str, to: &str, spoil: impl Fn(&str) -> String) -> String {
    let folder = tempfile::tempdir().unwrap();
    for path in [
        "blades/t9545.toml",
        "vehicles/f550.toml",
        "vehicles/quad-x.toml",
        "scenarios/reference-flight.toml",
        "classifiers/f550-paper.json",
    ] {
        let mut text = std::fs::read_to_string(config(path)).unwrap();
        if path.starts_with("scenarios") {
            assert!(text.contains(from), "nothing to replace");
            text = text.replacen(from, to, 1);
        }
        if path.starts_with("classifiers") {
            text = spoil(&text);
        }
        let target = folder.path().join(path);
        std::fs::create_dir_all(target.parent().unwrap()).unwrap();
        std::fs::write(target, text).unwrap();
    }
    for entry in std::fs::read_dir(config("blades")).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join("blades").join(path.file_name().unwrap())).unwrap();
    }
    let text = Scenario::load(folder.path().join("scenarios/reference-flight.toml"))
        .map_or_else(|e| e.to_string(), |_| "accepted".to_owned());
    // The scenario's line numbers change whenever its text is edited.
    let text = text.replace(&format!("{}/", folder.path().display()), "");
    match text.split_once(", line ") {
        Some((file, rest)) if file.ends_with(".toml") => format!("{file}, {}", rest.split_once(", ").unwrap().1),
        _ => text,
    }
}

/// Head of the table, with its comment.
const FDI: &str = "\n[fdi] #";

const KEY: &str = "scenarios/reference-flight.toml, key `fdi.network`: ";

#[test]
fn val_classifier_that_does_not_fit_the_scenario_is_refused() {
    let as_is = |text: &str| text.to_owned();
    assert_eq!(refusal(FDI, FDI, as_is), "accepted");
    let with = |line: &str| refusal(FDI, &format!("\n[fdi]\n{line}\n#"), as_is);
    assert_eq!(
        with("nominal_thrust = \"lagged\""),
        format!(
            "{KEY}the classifier `dji-f550-paper` was trained on residuals with nominal_thrust = \"static\", the scenario has \"lagged\""
        )
    );
    assert_eq!(
        with("window_samples = 50"),
        format!(
            "{KEY}the classifier `dji-f550-paper` was trained on windows of 25 samples, the scenario has window_samples = 50"
        )
    );
    assert_eq!(
        with("observer_gain_1_s = 6.0"),
        format!(
            "{KEY}the classifier `dji-f550-paper` was trained on residuals with an observer gain of 5 1/s, the scenario has \
             observer_gain_1_s = 6"
        )
    );
    assert_eq!(
        refusal("f550.toml", "quad-x.toml", as_is),
        format!("{KEY}the classifier `dji-f550-paper` was trained for 6 rotors, the vehicle has 4")
    );
    assert_eq!(
        refusal("f550-paper.json", "f551.json", as_is),
        format!("{KEY}expected the path of a classifier file, found none at classifiers/f551.json")
    );
}

#[test]
fn val_classifier_file_that_is_spoilt_is_refused() {
    let spoilt = |from: &str, to: &str| {
        refusal(FDI, FDI, |text| {
            assert!(text.contains(from), "nothing to replace");
            text.replacen(from, to, 1)
        })
    };
    let file = "classifiers/f550-paper.json";
    assert_eq!(
        spoilt("\"format_version\": 1", "\"format_version\": 2"),
        format!(
            "{file}, key `format_version`: expected format version 1, got 2; train the classifier again with this program"
        )
    );
    assert_eq!(
        spoilt("\"output_bias\": [", "\"output_bias\": [0.5, "),
        format!(
            "{file}, key `weights`: expected a network that can be run: the network's output_bias needs 7 values, but 8 are given"
        )
    );
    let first = shipped().weights.hidden_bias[0].to_string();
    assert_eq!(
        spoilt(&format!("\"hidden_bias\": [{first}"), "\"hidden_bias\": [1e39"),
        format!("{file}, line 19: expected a classifier file: number out of range")
    );
    let first = shipped().normalisation.deviation[0].to_string();
    assert_eq!(
        spoilt(&format!("\"deviation\": [{first}"), "\"deviation\": [0.0"),
        format!(
            "{file}, key `weights`: expected a network that can be run: the network's deviation of feature 1 must be above 0"
        )
    );
    assert_eq!(
        spoilt("\"name\"", "\"nome\""),
        format!(
            "{file}, line 3: expected a classifier file: unknown field `nome`, expected one of `format_version`, `name`, \
             `description`, `inputs`, `normalisation`, `weights`, `provenance`"
        )
    );
    assert!(spoilt("{", "[").starts_with(&format!("{file}, line ")));
    assert_eq!(shipped().inputs.nominal_thrust, NominalThrustModel::Static);
}
