//! The flights of `tests/regressions`, found and shrunk by `rotortwin campaign --hunt`: they fail as recorded, or the detector has
//! changed.

use rotortwin_campaign::study::engine::{OneByOne, fly_scenario};
use rotortwin_campaign::study::{Campaign, hunt::Failure};
use rotortwin_scenario::Scenario;
use std::path::{Path, PathBuf};

/// Known failures; `None` once one is fixed.
const EXPECTED: [(&str, Option<Failure>); 3] = [
    ("false-alarm-in-slow-gusts", Some(Failure::FalseAlarm)),
    ("missed-slow-ramp", Some(Failure::Late)),
    ("wrong-rotor-after-ramp", Some(Failure::WrongRotor)),
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

#[test]
fn regress_hunted_flights_fail_as_is_known() {
    let campaign = Campaign::load(&root().join("config/campaigns/wide-draw.toml")).expect("a good campaign");
    let criteria = campaign.document().criteria;
    for (name, expected) in EXPECTED {
        let path = root().join(format!("tests/regressions/{name}.toml"));
        let scenario = Scenario::load(&path).expect("a scenario that can be flown");
        assert_eq!(scenario.name(), name);
        let record = fly_scenario(&campaign, &OneByOne, scenario).expect("it flies");
        assert_eq!(record.reason, "", "{name}");
        assert_eq!(
            Failure::of(&record, &criteria),
            expected,
            "{name}: better or worse than known; change EXPECTED and tests/regressions/README.md"
        );
    }
}

#[test]
fn val_every_kept_flight_is_tested() {
    let kept = std::fs::read_dir(root().join("tests/regressions")).expect("the folder is there");
    let mut names: Vec<String> = kept
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned()))
        .collect();
    names.sort();
    assert_eq!(names, EXPECTED.map(|(name, _)| name));
}
