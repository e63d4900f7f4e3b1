//! The OpenAPI document against the real server: whatever it allows to send, no 500 and no answer that it does not describe.

use rotortwin_tests::python::environment;
use rotortwin_tests::scratch::{Scratch, repository};
use rotortwin_tests::server::Server;
use serde_json::json;
use std::process::Command;

/// All of it together, s; the seed is fixed.
const BUDGET_S: &str = "50";

#[test]
fn prop_every_answer_is_one_that_the_document_describes() {
    // This version: another one sends something else under the same seed.
    let Some(programs) = environment("python-schemathesis", &["schemathesis==4.32.5"]) else {
        return;
    };
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    for seed in 1..=3 {
        let id = server.submit(&json!({ "scenario": "short-hover", "seed": seed, "link": "in-process" }));
        server.ended(&id);
    }
    let output = Command::new(programs.join("schemathesis"))
        .arg("--config-file")
        .arg(repository().join("tests/schemathesis/schemathesis.toml"))
        .args(["run", &format!("{}/api/v1/openapi.json", server.url())])
        .args(["--seed", "7", "--max-time", BUDGET_S, "--no-color"])
        .current_dir(scratch.folder())
        .env("ROTORTWIN_URL", server.url())
        .env("SCHEMATHESIS_HOOKS", repository().join("tests/schemathesis/hooks.py"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .expect("it starts");
    let words = [&output.stdout, &output.stderr]
        .map(|text| String::from_utf8_lossy(text).into_owned())
        .concat();
    assert!(output.status.success(), "{words}");
    let cases = words
        .lines()
        .skip_while(|line| !line.starts_with("Test cases:"))
        .nth(1)
        .unwrap_or_default();
    assert!(cases.contains("generated"), "{words}");
    println!("schemathesis: {}", cases.trim());
}
