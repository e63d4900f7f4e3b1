//! The Python client: its own tests against the current build, and its types.

use rotortwin_tests::program::program;
use rotortwin_tests::python::{client_environment, client_folder};
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
        .env("PYTHONDONTWRITEBYTECODE", "1")
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
