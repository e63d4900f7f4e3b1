//! The Python client: its own tests against the current build, and its types.

use rotortwin_tests::program::program;
use rotortwin_tests::python::{bytecode_folder, client_environment, client_folder, environment};
use std::process::Command;

/// Runs a program of the environment in the client's folder; panics with its output if it fails.
fn passes(name: &str, arguments: &[&str]) {
    let Some(programs) = client_environment() else {
        return;
    };
    let output = Command::new(programs.join(name))
        .args(arguments)
        .current_dir(client_folder())
        .env("ROTORTWIN_PROGRAM", program())
        .env("PYTHONPYCACHEPREFIX", bytecode_folder())
        .output()
        .expect("it starts");
    let words = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert!(output.status.success(), "{name}: {}", words.concat());
    print!("{name}: {}", words.concat());
}

#[test]
fn scenario_its_tests_pass_against_the_real_server() {
    passes("pytest", &["-p", "no:cacheprovider"]);
}

#[test]
fn val_its_types_are_right() {
    passes("mypy", &["--cache-dir", "../../target/mypy-cache"]);
}

/// The stub of the native module, and a program that uses what runs in this process, in Pyright's strict mode (`pyrightconfig.json`).
#[test]
fn val_its_types_are_right_for_pyright() {
    let Some(client) = client_environment() else { return };
    // The package fetches Pyright itself; the Node that it runs on comes as a wheel.
    let Some(programs) = environment("python-pyright", &["pyright[nodejs]==1.1.414"]) else {
        return;
    };
    let output = Command::new(programs.join("pyright"))
        .args(["--project", ".", "--pythonpath"])
        .arg(client.join("python"))
        .current_dir(client_folder())
        .env("PYRIGHT_PYTHON_IGNORE_WARNINGS", "1")
        .output()
        .expect("it starts");
    let words = [&output.stdout, &output.stderr]
        .map(|text| String::from_utf8_lossy(text).into_owned())
        .concat();
    if !words.contains("errors, ") {
        return rotortwin_tests::skip(&format!("Pyright cannot be had here: {}", words.trim()));
    }
    assert!(output.status.success(), "{words}");
    print!("pyright: {words}");
}
