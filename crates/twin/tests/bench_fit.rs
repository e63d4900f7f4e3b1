//! Fits of bench data against real measurements.

use rotortwin_twin::bench_fit::{Mapping, Table, lag, report, thrust, write};
use std::path::{Path, PathBuf};

fn strawson(name: &str) -> Table {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/strawson")
        .join(name);
    Table::read(&path, &Mapping::default()).expect("the file of the test stand is read")
}

/// The voltage exponent of small motors lies between 1.5 and 1.9 (fits of all 103 pairs of this source: docs/bench-fit.md).
#[test]
fn val_thrust_grows_with_a_power_of_the_voltage_between_1_and_2() {
    let fit = thrust::fit_thrust(&[strawson("a1_7.csv"), strawson("a1_11.csv")]).unwrap();
    let model = fit.models.iter().find(|model| model.name == "quadratic, V^n").unwrap();
    let n = model.parameter("n").unwrap();
    assert!(n.low > 1.5 && n.high < 1.9, "{n:?}");
    // The structures without the voltage are far behind.
    let without = fit.models.iter().find(|model| model.name == "quadratic").unwrap();
    assert!(without.held_out_rmse > 5.0 * model.held_out_rmse);
}

#[test]
fn scenario_the_blade_of_a_bench_fit_is_read_by_the_plant() {
    let fit = thrust::fit_thrust(&[strawson("a1_7.csv"), strawson("a1_11.csv")]).unwrap();
    let model = fit.models.iter().find(|model| model.name == "Eq. 19").unwrap();
    let blades = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config/blades/t9545.toml");
    let document = std::fs::read_to_string(blades).unwrap();
    let changed = write::add_blade(&document, "bench", model, "rotortwin fit thrust").unwrap();
    let blades: rotortwin_plant::powertrain::blades::BladeSet = toml::from_str(&changed).unwrap();
    assert!(format!("{blades:?}").contains("bench"));
}

#[test]
fn scenario_a_report_stands_alone_and_json_is_json() {
    let fit = thrust::fit_thrust(&[strawson("a1_7.csv"), strawson("a1_11.csv")]).unwrap();
    let html = report::html("Thrust <of> a1", std::slice::from_ref(&fit));
    assert!(html.contains("Thrust &lt;of&gt; a1"));
    let (_, rest) = html.split_once("id=\"report\">").unwrap();
    let inside: serde_json::Value = serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap();
    let drawn = &inside["data"][0];
    let x: Vec<f64> = drawn["x"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(serde_json::Value::as_f64)
        .collect();
    assert!(x.len() == 22 && x.is_sorted(), "{x:?}");
    assert_eq!(
        (drawn["fitted"].as_array().unwrap().len(), &drawn["points"]),
        (22, &serde_json::json!(22))
    );
    let value: serde_json::Value = serde_json::from_str(&report::json(&[fit])).unwrap();
    assert_eq!(value[0]["points"], 22);
    assert_eq!(value[0]["models"][0]["parameters"].as_array().unwrap().len(), 4);
}

#[test]
fn scenario_a_file_without_steps_or_columns_is_refused_in_a_sentence() {
    let table = strawson("a1_7.csv");
    let sentence = lag::fit_lag(&[table]).unwrap_err().to_string();
    assert!(sentence.contains("found no step"), "{sentence}");
}
