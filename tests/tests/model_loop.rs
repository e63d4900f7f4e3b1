//! Runs of this program as flight logs: a hidden effect that a scenario flies with is what the diagnosis of its run folder names.

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
