//! `rotortwin` flies by itself and delegates to `rotortwin-network` what needs other hosts:
//! docs/decisions/0062-two-programs.md.

use rotortwin_tests::program::program;
use rotortwin_tests::scratch::Scratch;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder with only `rotortwin` in it.
fn alone(scratch: &Scratch) -> PathBuf {
    let built = program().with_file_name("rotortwin-alone-under-test");
    let own = scratch.path("rotortwin");
    std::fs::copy(&built, &own).unwrap_or_else(|error| panic!("{}: {error}", built.display()));
    own
}

fn call(program: &Path, scratch: &Scratch, words: &[&str]) -> Output {
    Command::new(program)
        .args(words)
        .current_dir(scratch.folder())
        // Not one that happens to be installed here.
        .env("PATH", scratch.folder())
        .output()
        .expect("the program starts")
}

fn error_of(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn scenario_a_flight_needs_one_program() {
    let scratch = Scratch::new();
    let own = alone(&scratch);
    let domain = scratch.domain().to_owned();
    let flown = call(
        &own,
        &scratch,
        &[
            "fly",
            "hover",
            "--set",
            "duration_s=3",
            "--domain",
            &domain,
            "--out",
            "run",
        ],
    );
    assert!(flown.status.success(), "{}", error_of(&flown));
    assert!(scratch.path("run").join("summary.json").is_file());
}

#[test]
fn scenario_who_asks_for_the_network_without_its_program_is_told_what_to_build() {
    let scratch = Scratch::new();
    let own = alone(&scratch);
    for words in [
        &["serve"][..],
        &["fly", "hover", "--link", "zenoh"],
        &["--server", "http://127.0.0.1:1", "show", "x"],
        &["runs", "list"],
        &["controller", "--link", "zenoh:connect=tcp/127.0.0.1:1", "--run-id", "1"],
        &["conform", "zenoh"],
    ] {
        let output = call(&own, &scratch, words);
        let said = error_of(&output);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
        assert_eq!(said.lines().count(), 1, "{words:?}: {said}");
        assert!(
            said.contains("rotortwin-network") && said.contains("cargo build"),
            "{words:?}: {said}"
        );
    }
}

#[test]
fn scenario_the_network_program_takes_over_beside_it_or_on_the_search_path() {
    let scratch = Scratch::new();
    let own = alone(&scratch);
    std::os::unix::fs::symlink(program(), scratch.path("rotortwin-network")).expect("a link can be made");
    let document = call(&own, &scratch, &["serve", "--openapi"]);
    assert!(document.status.success(), "{}", error_of(&document));
    assert!(document.stdout.starts_with(b"{"), "the API document is JSON");
    let flown = call(
        &own,
        &scratch,
        &[
            "fly",
            "hover",
            "--set",
            "duration_s=3",
            "--link",
            "zenoh",
            "--out",
            "run",
        ],
    );
    assert!(flown.status.success(), "{}", error_of(&flown));
    // Nothing listens there: the message is the other program's.
    let asked = call(&own, &scratch, &["health", "tcp/127.0.0.1:1"]);
    assert_eq!(asked.status.code(), Some(1), "{}", error_of(&asked));
}

/// The dependencies compiled before the first flight.
#[test]
fn prop_the_first_program_compiles_no_server_and_no_zenoh() {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let tree = Command::new(cargo)
        .args([
            "tree",
            "--locked",
            "--offline",
            "--package",
            "rotortwin",
            "--edges",
            "normal,build",
            "--prefix",
            "none",
        ])
        // With the features of all packages the tree would be the workspace's.
        .env_remove("CARGO_RESOLVER_FEATURE_UNIFICATION")
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .output()
        .expect("cargo starts");
    assert!(tree.status.success(), "{}", error_of(&tree));
    let packages = String::from_utf8_lossy(&tree.stdout);
    let names: Vec<&str> = packages.lines().filter_map(|line| line.split(' ').next()).collect();
    assert!(names.contains(&"iceoryx2"), "the list is that of the program");
    for heavy in [
        "zenoh",
        "sqlx",
        "axum",
        "hyper",
        "reqwest",
        "tokio",
        "rustls",
        "opentelemetry",
        "object_store",
    ] {
        assert!(!names.contains(&heavy), "{heavy} is compiled before the first flight");
    }
}
