//! The OpenAPI document against the real server: whatever it allows to send, no status 500 and no undocumented answer.

use rotortwin_tests::program::{Call, Link};
use rotortwin_tests::python::environment;
use rotortwin_tests::scratch::{Scratch, repository, shipped_scenario};
use rotortwin_tests::server::Server;
use serde_json::json;
use std::ffi::OsString;
use std::process::Command;

/// Seed and total time, s; `ROTORTWIN_API_SEED` and `ROTORTWIN_API_SECONDS` override them for long hunts.
const SEED: &str = "7";
const BUDGET_S: &str = "50";

#[test]
fn prop_every_answer_is_one_that_the_document_describes() {
    // Pinned: another version generates other requests from the same seed.
    let Some(programs) = environment("python-schemathesis", &["schemathesis==4.32.5"]) else {
        return;
    };
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let session = something_of_everything(&scratch, &server);
    let output = Command::new(programs.join("schemathesis"))
        .arg("--config-file")
        .arg(repository().join("tests/schemathesis/schemathesis.toml"))
        .args(["run", &format!("{}/api/v1/openapi.json", server.url())])
        .args(["--seed", &named("ROTORTWIN_API_SEED", SEED)])
        .args(["--max-time", &named("ROTORTWIN_API_SECONDS", BUDGET_S), "--no-color"])
        .current_dir(scratch.folder())
        .env("ROTORTWIN_URL", server.url())
        .env("FDI_SESSION", session)
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

/// Value of the environment variable, or else the default.
fn named(variable: &str, usual: &str) -> String {
    std::env::var(variable).unwrap_or_else(|_| usual.to_owned())
}

/// A job of each kind, a document of each kind and an open session (its id), so that requests find something.
fn something_of_everything(scratch: &Scratch, server: &Server) -> String {
    let mut runs = Vec::new();
    for seed in 1..=3 {
        let id = server.submit(&json!({ "scenario": "short-hover", "seed": seed, "link": "in-process" }));
        server.ended(&id);
        runs.push(id);
    }
    let twin = json!({ "model": { "vehicle": "f550" }, "flights": { "runs": [runs[0]] } });
    let campaign = json!({ "text": CAMPAIGN });
    let unlike = json!({ "model": { "vehicle": "f550" }, "between": ["mass", "air-density"] });
    let jobs = [
        ("comparisons", &twin),
        ("diagnoses", &twin),
        ("improvements", &twin),
        ("campaigns", &campaign),
        ("blind-benches", &json!({ "n": 1, "duration_s": 10 })),
        ("classifiers", &json!({ "seeds": 1 })),
        ("next-flights", &unlike),
    ];
    for (collection, body) in jobs {
        let id = server.submit_to(collection, body);
        let job = server.ended_in(collection, &id);
        assert_eq!(job["status"], "done", "{collection}: {job}");
    }
    let again = server.ask("POST", &format!("/api/v1/runs/{}/verify", runs[0]), &[], "");
    assert_eq!(again.status, 200, "{}", again.json());
    let example = server.generated(&json!({ "preset": "healthy", "seed": 4, "duration_s": 60 }));
    let own =
        json!({ "name": "mine", "flights": { "logs": [example] }, "mass_kg": 1.55, "arm_m": 0.275, "held_out": true });
    let own = server.submit_to("identifications", &own);
    let job = server.ended_in("identifications", &own);
    assert_eq!(job["status"], "done", "{job}");
    let folder = Call::fly(scratch, Link::InProcess, &shipped_scenario("short-hover"), "log")
        .run()
        .expect_code(0);
    let out = scratch.path("canonical");
    let words = [
        "log".into(),
        "import".into(),
        folder.out().as_os_str().to_owned(),
        "--out".into(),
        out.clone().into_os_string(),
    ];
    Call::new(scratch, words).run().expect_code(0);
    let log = std::fs::read_dir(&out)
        .expect("it was made")
        .filter_map(Result::ok)
        .map(|entry| entry.path());
    let log = log
        .into_iter()
        .find(|path| path.extension().is_some_and(|end| end == "parquet"))
        .expect("a log");
    let headers = [("content-type", "application/octet-stream")];
    let bytes = std::fs::read(log).expect("readable");
    let log = server.ask_bytes("POST", "/api/v1/logs?name=flight.parquet", &headers, &bytes);
    assert_eq!(log.status, 202, "{}", log.json());
    let log = server.ended_in("logs", log.json()["id"].as_str().expect("an id"));
    assert_eq!(log["status"], "done", "{log}");

    let version = scratch.path("models").into_os_string();
    let f550 = repository().join("config/vehicles/f550.toml").into_os_string();
    let call = |words: [OsString; 3]| {
        Call::new(scratch, words)
            .with(["--models".into(), version.clone()])
            .run()
            .expect_code(0)
    };
    call(["model".into(), "import".into(), f550]);
    let version = call(["model".into(), "export".into(), "f550".into()]).stdout;
    assert_eq!(
        server
            .ask(
                "PUT",
                "/api/v1/models/mine",
                &[("content-type", "application/toml")],
                &version
            )
            .status,
        201
    );
    let session = server.ask(
        "POST",
        "/api/v1/fdi/sessions",
        &[("content-type", "application/json")],
        r#"{"vehicle":"f550"}"#,
    );
    assert_eq!(session.status, 201, "{}", session.json());
    session.json()["session"]["id"].as_str().expect("an id").to_owned()
}

/// One flight.
const CAMPAIGN: &str = r#"
name = "one"
description = "one flight"
scenario = "../scenarios/short-hover.toml"
seed = 5
flights = 1
[[axis]]
name = "charge"
key = "initial.state_of_charge"
uniform = [0.5, 1.0]
"#;
