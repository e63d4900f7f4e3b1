//! The OpenAPI document against the real server: whatever it allows to send, no status 500 and no undocumented answer.

use rotortwin_tests::program::{Call, Link, read_json};
use rotortwin_tests::python::{bytecode_folder, environment};
use rotortwin_tests::scratch::{Scratch, repository, shipped_scenario};
use rotortwin_tests::server::Server;
use serde_json::{Value, json};
use std::ffi::OsString;
use std::path::Path;
use std::process::Command;

/// Seed and total time, s; `ROTORTWIN_API_SEED` and `ROTORTWIN_API_SECONDS` override them for hunts.
const SEED: &str = "7";
const BUDGET_S: &str = "50";
/// Least number of requests; `ROTORTWIN_API_CASES` overrides it. One search has as many as its time allows; further ones follow, each at the
/// next seed, until there are that many.
const CASES: &str = "1";

#[test]
fn prop_every_answer_is_one_that_the_document_describes() {
    // Pinned: another version generates other requests from the same seed.
    let Some(programs) = environment("python-schemathesis", &["schemathesis==4.32.5"]) else {
        return;
    };
    let number = |variable, usual| named(variable, usual).parse::<u64>().expect(variable);
    let (seed, wanted) = (number("ROTORTWIN_API_SEED", SEED), number("ROTORTWIN_API_CASES", CASES));
    let mut cases = 0;
    for seed in seed.. {
        cases += searched(&programs, seed);
        println!("schemathesis: {cases} cases up to seed {seed}, nothing found");
        if cases >= wanted {
            break;
        }
    }
}

/// Searches at a seed, and returns the number of requests. Each search has a server of its own: requests delete what there is.
///
/// # Panics
/// An answer is not as the document says, or there was none.
fn searched(programs: &Path, seed: u64) -> u64 {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let session = something_of_everything(&scratch, &server);
    let output = Command::new(programs.join("schemathesis"))
        .arg("--config-file")
        .arg(repository().join("tests/schemathesis/schemathesis.toml"))
        .args(["run", &format!("{}/api/v1/openapi.json", server.url())])
        .args(["--seed", &seed.to_string()])
        .args(["--max-time", &named("ROTORTWIN_API_SECONDS", BUDGET_S), "--no-color"])
        .current_dir(scratch.folder())
        .env("ROTORTWIN_URL", server.url())
        .env("FDI_SESSION", session)
        .env("SCHEMATHESIS_HOOKS", repository().join("tests/schemathesis/hooks.py"))
        .env("PYTHONPYCACHEPREFIX", bytecode_folder())
        .output()
        .expect("it starts");
    let words = [&output.stdout, &output.stderr]
        .map(|text| String::from_utf8_lossy(text).into_owned())
        .concat();
    assert!(output.status.success(), "seed {seed}: {words}");
    let cases = words
        .lines()
        .skip_while(|line| !line.starts_with("Test cases:"))
        .nth(1)
        .and_then(|line| line.trim().split_once(" generated"));
    let cases = cases.and_then(|(number, _)| number.parse().ok());
    cases
        .filter(|number| *number > 0)
        .unwrap_or_else(|| panic!("seed {seed}: {words}"))
}

/// Value of the environment variable, or else the default.
fn named(variable: &str, usual: &str) -> String {
    std::env::var(variable).unwrap_or_else(|_| usual.to_owned())
}

/// What the document states about a parameter binds the server, and what the server accepts is in the document. Each
/// case was found by a search.
#[test]
fn regress_parameters_and_whole_numbers_are_what_the_document_says() {
    let scratch = Scratch::new();
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &["--workers", "0"]);
    let refused = |method: &str, path: &str, headers: &[(&str, &str)], words: &str| {
        let body = if method == "GET" {
            ""
        } else {
            r#"{"scenario":"short-hover"}"#
        };
        let json = ("content-type", "application/json");
        let answer = server.ask(method, path, &[headers, &[json]].concat(), body);
        let problem = answer.json();
        let detail = problem["detail"].as_str().unwrap_or_default();
        assert!(
            answer.status == 400 && detail.contains(words),
            "{method} {path}: {problem}"
        );
    };
    let long = "x".repeat(1001);
    for name in ["named", "hidden"] {
        refused(
            "GET",
            &format!("/api/v1/blind-benches/none/cases?{name}={long}"),
            &[],
            "0 to 1000 characters",
        );
    }
    refused(
        "GET",
        "/api/v1/blind-benches/none/cases?limit=1001",
        &[],
        "`limit` is 1001; expected 1 to 1000",
    );
    refused(
        "GET",
        "/api/v1/catalogue/rotor-drag/picture?vehicle=f550&parameters=a:1,,b:2",
        &[],
        "`parameters`",
    );
    refused(
        "GET",
        "/api/v1/runs/none/telemetry?channels=*&from_s=nan",
        &[],
        "a finite number",
    );
    refused(
        "GET",
        "/api/v1/events?wait=false",
        &[("last-event-id", "")],
        "`Last-Event-ID`",
    );
    for key in ["a\tb", "", "ä", &"k".repeat(201)] {
        refused("POST", "/api/v1/runs", &[("idempotency-key", key)], "`Idempotency-Key`");
    }
    // Of 64 bits, in the document as in the server.
    let most = u64::MAX;
    let missing = server.ask(
        "GET",
        &format!("/api/v1/blind-benches/none/cases?cursor={most}"),
        &[],
        "",
    );
    assert_eq!(missing.status, 404, "{}", missing.json());
    refused(
        "GET",
        "/api/v1/blind-benches/none/cases?cursor=18446744073709551616",
        &[],
        "cursor",
    );
    let id = server.submit(&json!({ "scenario": "short-hover", "seed": most }));
    let fork = server.ask(
        "POST",
        &format!("/api/v1/runs/{id}/fork"),
        &[("content-type", "application/json")],
        r#"{"seed": 18446744073709551614.0, "priority": 2e1}"#,
    );
    let fork = (fork.status, fork.json());
    assert_eq!(
        (fork.0, &fork.1["seed"], &fork.1["priority"]),
        (202, &json!(most - 1), &json!(20)),
        "{}",
        fork.1
    );
    let document = read_json(&repository().join("tests/golden/openapi.json"));
    let schemas = &document["components"]["schemas"];
    for place in [
        &schemas["Fork"]["properties"]["seed"],
        &schemas["Run"]["properties"]["seed"],
        parameter(&document, "/api/v1/runs/{id}/telemetry", "points"),
        parameter(&document, "/api/v1/blind-benches/{id}/cases", "cursor"),
        parameter(&document, "/api/v1/runs/{id}/events", "Last-Event-ID"),
    ] {
        assert_eq!(place["maximum"], json!(most), "{place}");
    }
}

/// Schema of a parameter of a GET.
fn parameter<'d>(document: &'d Value, path: &str, name: &str) -> &'d Value {
    let all = document["paths"][path]["get"]["parameters"]
        .as_array()
        .expect("parameters");
    let one = all.iter().find(|one| one["name"] == name).expect("it is there");
    &one["schema"]
}

/// Schemas that do not describe their content, each with the reason.
const SAY_NOTHING: [(&str, &str); 8] = [
    (
        "/AnyEventData/properties/data",
        "each kind of event has its own: `QueueEvent`, `JobEvent` and `RunEvent` say which",
    ),
    (
        "/QueueEvent/oneOf/0/properties/data",
        "that a job was accepted says everything",
    ),
    (
        "/JobView/properties/result",
        "each kind of job has its own: `JobWithResult_…` of its address says which",
    ),
    (
        "/QueryAnswer/properties/rows/items/items",
        "a cell of whatever SQL was asked for",
    ),
    (
        "/Table/properties/rows/items/items",
        "a number, a truth value or a text, by the column",
    ),
    (
        "/Proposal/properties/document",
        "an effect document, which `POST /effects/validate` and docs/effects.md explain",
    ),
    (
        "/WorstMoment/properties/conditions/items/items",
        "title, value, unit: a list, whose description says so",
    ),
    ("/artifacts/{path}/get/responses", "the bytes of a file of any type"),
];

/// `{"type": "object"}` without a word was the schema of seven properties; a list was called `Vec`.
#[test]
fn val_no_schema_of_the_document_is_a_bare_object() {
    let document = read_json(&repository().join("tests/golden/openapi.json"));
    let mut found = Vec::new();
    say_nothing(&document, "", &mut found);
    let unexplained: Vec<&String> = found
        .iter()
        .filter(|place| !SAY_NOTHING.iter().any(|(known, _)| place.contains(known)))
        .collect();
    assert_eq!(
        unexplained,
        Vec::<&String>::new(),
        "expected properties, or `additionalProperties`"
    );
    for (known, why) in SAY_NOTHING {
        assert!(
            found.iter().any(|place| place.contains(known)),
            "{known} ({why}) says something by now"
        );
    }
    let schemas = document["components"]["schemas"].as_object().expect("schemas");
    for name in ["Vec", "JobWithResult_Vec", "Object", "Value"] {
        assert!(!schemas.contains_key(name), "{name} is no name for a schema");
    }
}

/// Places of schemas that allow anything, or any object.
fn say_nothing(value: &Value, place: &str, found: &mut Vec<String>) {
    match value {
        Value::Object(map) => {
            let says = [
                "properties",
                "additionalProperties",
                "allOf",
                "oneOf",
                "anyOf",
                "enum",
                "const",
                "$ref",
            ];
            let is_bare_object =
                map.get("type") == Some(&json!("object")) && !says.iter().any(|key| map.contains_key(*key));
            let is_schema = ["/schema", "/items"].iter().any(|end| place.ends_with(end))
                || place.rsplit('/').nth(1) == Some("properties");
            let says_anything =
                is_schema && !map.contains_key("type") && !says.iter().any(|key| map.contains_key(*key));
            if is_bare_object || says_anything {
                found.push(place.to_owned());
            }
            for (key, part) in map {
                say_nothing(part, &format!("{place}/{key}"), found);
            }
        }
        Value::Array(list) => {
            for (at, part) in list.iter().enumerate() {
                say_nothing(part, &format!("{place}/{at}"), found);
            }
        }
        _ => {}
    }
}

/// What docs/jobs.md says of files and events is what their schemas say: each is read by a validator of JSON Schema.
#[test]
fn val_jobs_and_their_events_are_as_the_document_says() {
    let Some(programs) = environment("python-schemathesis", &["schemathesis==4.32.5"]) else {
        return;
    };
    let scratch = Scratch::new();
    let flown = Call::fly(&scratch, Link::InProcess, &shipped_scenario("short-hover"), "flown")
        .run()
        .expect_code(0);
    let summary = flown.summary();
    let campaign = scratch.write(
        "one.toml",
        CAMPAIGN.replace("../scenarios/short-hover.toml", "short-hover"),
    );
    let jobs = [
        json!({ "job": "run", "documents": summary.pointer("/scenario/text"), "seed": "7", "link": "in-process", "pace": "fast" }),
        json!({ "job": "verification", "run": "out" }),
        json!({ "job": "log-example", "vehicle": "f550", "seed": 3, "duration_s": 30.0, "out": "logs" }),
        json!({ "job": "log-import", "file": "logs/log.parquet", "out": "again", "rate_hz": 50.0 }),
        json!({ "job": "campaign", "campaign": campaign, "out": "campaign", "threads": 1 }),
        json!({ "job": "campaign", "campaign": campaign, "out": "part", "shards": { "start": 0, "end": 1 } }),
        json!({ "job": "blind-bench", "presets": ["null-hover"], "n": 1, "seed": 1, "vehicles": ["f550"], "duration_s": 10.0, "out": "bench" }),
        json!({ "job": "diagnosis", "logs": ["logs/log.parquet"], "model": "f550", "models": "models" }),
        json!({ "job": "training", "method": "paper", "scenario": "reference-flight", "seeds": 1, "first_seed": 1, "out": "c.json" }),
        json!({ "job": "next-flight", "model": "f550", "models": "models", "between": ["mass", "air-density"] }),
    ];
    let mut values = Vec::new();
    for job in jobs {
        let file = json!({ "version": 2, "job": job });
        let path = scratch.write("job.json", file.to_string());
        let ended = Call::new(&scratch, ["job".into(), path.into_os_string()])
            .run()
            .expect_code(0);
        values.push(json!({ "schema": "JobFile", "value": file, "valid": true }));
        let schema = if job["job"] == "run" { "RunEvent" } else { "JobEvent" };
        let lines = ended.stdout.lines().take_while(|line| line.contains("\"event\":"));
        let events = lines.map(|line| serde_json::from_str::<Value>(line).expect("a line of JSON"));
        values.extend(events.map(|event| json!({ "schema": schema, "value": event, "valid": true })));
    }
    let events = |schema: &str| values.iter().filter(|one| one["schema"] == schema).count();
    assert!(events("JobEvent") > 3 && events("RunEvent") > 3, "{values:?}");
    for wrong in [
        json!({ "version": 2, "job": { "job": "verification" } }),
        json!({ "version": 2, "job": { "job": "nothing", "run": "out" } }),
        json!({ "job": { "job": "verification", "run": "out" } }),
    ] {
        values.push(json!({ "schema": "JobFile", "value": wrong, "valid": false }));
    }
    values.push(json!({ "schema": "JobEvent", "value": { "event": "progress", "share": "half" }, "valid": false }));
    let file = scratch.write("values.json", json!(values).to_string());
    let output = Command::new(programs.join("python"))
        .args(["-c", VALIDATED])
        .arg(repository().join("tests/golden/openapi.json"))
        .arg(file)
        .output()
        .expect("it starts");
    let words = [&output.stdout, &output.stderr]
        .map(|text| String::from_utf8_lossy(text).into_owned())
        .concat();
    assert!(output.status.success(), "{words}");
    print!("{words}");
}

/// Reads the document and the values; prints each value that does not match its description.
const VALIDATED: &str = r##"
import json, sys
import jsonschema_rs

document = json.load(open(sys.argv[1]))
values = json.load(open(sys.argv[2]))
wrong = 0
for one in values:
    schema = {"$ref": f"#/components/schemas/{one['schema']}", "components": document["components"]}
    errors = [str(error) for error in jsonschema_rs.validator_for(schema).iter_errors(one["value"])]
    if bool(errors) == one["valid"]:
        wrong += 1
        print(one["schema"], json.dumps(one["value"])[:400], errors[:3])
print(f"{len(values)} values against their schemas")
sys.exit(wrong > 0)
"##;

/// A job of each kind, a document of each kind, an open session (its id): the requested items exist.
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
