//! Campaigns from Python on a Ray and a Dask cluster on this machine, whose nodes die.

use rotortwin_tests::program::program;
use rotortwin_tests::python::{bytecode_folder, client_folder};
use rotortwin_tests::ray::executors_environment;
use std::process::Command;

#[test]
fn scenario_campaigns_survive_the_death_of_nodes() {
    let Some(programs) = executors_environment() else {
        return;
    };
    let output = Command::new(programs.join("pytest"))
        .args(["-p", "no:cacheprovider", "tests/executors"])
        .current_dir(client_folder())
        .env("ROTORTWIN_PROGRAM", program())
        .env("PYTHONPYCACHEPREFIX", bytecode_folder())
        .env("RAY_USAGE_STATS_ENABLED", "0")
        .output()
        .expect("it starts");
    let words = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert!(output.status.success(), "{}", words.concat());
    print!("{}", words.concat());
}
