//! Example logs over HTTP: flown by the independent simulator, diagnosed without knowledge of the truth, which is revealed
//! afterwards.

use rotortwin_blind::example::Example;
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::server::Server;
use serde_json::{Value, json};

fn generated(server: &Server, body: &Value) -> (String, Value) {
    let id = server.generated(body);
    let job = server.get(&format!("/api/v1/logs/{id}"));
    (id, job)
}

fn diagnosed(server: &Server, model: &Value, log: &str) -> Value {
    let body = json!({ "model": model, "flights": { "logs": [log] } });
    server.ended_in("diagnoses", &server.submit_to("diagnoses", &body))
}

/// The first and the last of the seeds that a first visit is shown.
#[test]
fn scenario_each_example_of_a_first_visit_is_diagnosed_as_what_it_is() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    for (example, verdict, seeds) in [
        (Example::HiddenEffect, "missing", 2),
        (Example::DamagedBlade, "missing", 1),
        (Example::Healthy, "agrees", 1),
    ] {
        let preset = example.name();
        for seed in example.seeds().iter().rev().take(seeds) {
            let (id, job) = generated(&server, &json!({ "preset": preset, "seed": seed }));
            // Nothing reveals the truth before it is requested; the log looks like any other.
            let told = job.to_string();
            for word in ["rotor-drag", "share", "hidden", "damaged", "healthy"] {
                assert!(!told.contains(word), "{preset}: {word}: {told}");
            }
            let rows = job["result"]["report"]["rows"].as_u64();
            assert!(rows.is_some_and(|rows| rows > 20_000), "{job}");
            let truth = server.ask("GET", &format!("/api/v1/logs/{id}/truth"), &[], "").json();
            let hidden = truth["effects"].as_array().expect("a list");
            assert_eq!(hidden.len(), usize::from(example != Example::Healthy), "{truth}");
            // A model of its own for each, so that one has the answers of no other.
            let name = format!("{preset}-{seed}");
            let model = json!({ "name": name, "model": { "vehicle": "f550" } });
            let model = server.ask("POST", "/api/v1/models", &[], &model.to_string());
            assert_eq!(model.status, 201, "{}", model.json());
            let job = diagnosed(&server, &json!({ "model": name }), &id);
            let sentence = &job["result"]["sentence"];
            assert_eq!(job["result"]["verdict"]["kind"], verdict, "{preset} {seed}: {sentence}");
            let [effect] = hidden.as_slice() else { continue };
            let found = &job["result"]["effects"][0]["instance"];
            assert_eq!(found["effect"], effect["id"], "{preset} {seed}: {sentence}");
            assert_eq!(found["rotor"], effect["rotor"], "{preset} {seed}: {sentence}");
            added_it_agrees(&server, &name, &id, &job);
            if example == Example::DamagedBlade {
                seen_by_the_detectors(&server, &id, &hidden[0], &job["result"]["effects"][0]);
            }
        }
    }
    // Without a seed it is one of these.
    let (id, _) = generated(&server, &json!({ "preset": "healthy" }));
    let truth = server.get(&format!("/api/v1/logs/{id}/truth"));
    let drawn = truth["seed"].as_u64().expect("a number");
    assert!(Example::Healthy.seeds().contains(&drawn), "{truth}");
}

/// What the diagnosis found, added to the model as the page does it: the comparison then agrees in every channel.
fn added_it_agrees(server: &Server, name: &str, log: &str, diagnosis: &Value) {
    let add = json!({ "diagnosis": diagnosis["id"], "pick": 1 }).to_string();
    let added = server.ask("POST", &format!("/api/v1/models/{name}/versions"), &[], &add);
    assert_eq!(added.status, 201, "{}", added.json());
    let body = json!({ "model": { "model": format!("{name}@v1") }, "flights": { "logs": [log] } });
    let compared = server.ended_in("comparisons", &server.submit_to("comparisons", &body));
    let model = &compared["result"]["logs"][0]["models"][0];
    assert_eq!(model["agrees"], true, "{name}: {}", compared["result"]["verdict"]);
}

/// The blade breaks in mid-flight: the diagnosis dates it, and the FDI page names the rotor and the time.
fn seen_by_the_detectors(server: &Server, log: &str, hidden: &Value, found: &Value) {
    let breaks = hidden["onset_s"].as_f64().expect("it breaks in mid-flight");
    let dated = found["onset_s"]
        .as_f64()
        .unwrap_or_else(|| panic!("not dated: {found}"));
    assert!((dated - breaks).abs() < 1.0, "{dated} s instead of {breaks} s");
    let address = format!("/api/v1/fdi/reports?vehicle=f550&flight=true&log={log}");
    let report = server.ask("POST", &address, &[], "").json();
    let rotor = &hidden["rotor"];
    let last = &report["final_window"]["sequential"];
    assert_eq!(last["code"], *rotor, "{last:#}");
    let changes = report["timeline"].as_array().expect("a list");
    let named = changes.iter().find(|change| change["sequential"]["code"] == *rotor);
    let named_s = named.and_then(|change| change["time_s"].as_f64()).expect("it is named");
    assert!(
        (breaks..breaks + 5.0).contains(&named_s),
        "{named_s} s after {breaks} s"
    );
    let false_alarm = changes.iter().any(|change| {
        change["time_s"].as_f64().is_some_and(|at| at < breaks) && change["sequential"]["code"].as_i64() > Some(0)
    });
    assert!(!false_alarm, "{changes:?}");
    // The same flight, as plotted by the page.
    let picture = server.get(&format!("/api/v1/logs/{log}/flight"));
    assert_eq!(report["flight"], picture);
    assert_eq!(picture["outputs"].as_array().map(Vec::len), Some(6));
    assert!(
        picture["time_s"]
            .as_array()
            .is_some_and(|time| (100..=800).contains(&time.len()))
    );
    assert!(
        picture["parts"]["parts"]
            .as_array()
            .is_some_and(|parts| parts.iter().any(|part| part["kind"] == "air"))
    );
    assert!(picture["vibration"]["gyroscope"].is_array(), "{}", picture["vibration"]);
}

#[test]
fn scenario_an_effect_shows_what_it_does_to_a_flight() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let picture = |query: &str| server.ask("GET", &format!("/api/v1/catalogue/{query}"), &[], "");
    let rms = |size: &str| {
        let found = picture(&format!(
            "rotor-drag/picture?vehicle=f550&flight=fast-circle&parameters=drag_n_s_m:{size}"
        ))
        .json();
        let channel = found["channels"][0].clone();
        assert!(
            ["fx", "fy"].contains(&channel["channel"].as_str().unwrap_or_default()),
            "{channel}"
        );
        assert!(
            channel["conditions"][0]["at"]
                .as_array()
                .is_some_and(|at| at.len() >= 2),
            "{channel}"
        );
        channel["rms"].as_f64().expect("a number")
    };
    let (one, two) = (rms("0.2"), rms("0.4"));
    assert!(
        (two / one - 2.0).abs() < 0.05,
        "twice the drag, twice the force: {one} {two}"
    );
    let rotor = picture("rotor-thrust-scale/picture?vehicle=quad-x&rotor=3&flight=hover").json();
    assert_eq!(
        (&rotor["rotor"], &rotor["flight"]),
        (&json!(3), &json!("hover")),
        "{rotor}"
    );
    for (query, status, words) in [
        ("nothing/picture?vehicle=f550", 404, "effect 'nothing' not found"),
        ("rotor-drag/picture?vehicle=nothing", 404, "f550"),
        (
            "rotor-drag/picture?vehicle=f550&parameters=nothing:1",
            422,
            "no such parameter",
        ),
        ("rotor-drag/picture?vehicle=f550&parameters=drag_n_s_m:x", 422, "number"),
        (
            "rotor-drag/picture?vehicle=f550&parameters=drag_n_s_m",
            400,
            "`parameters`",
        ),
        (
            "rotor-drag/picture?vehicle=f550&flight=nothing",
            422,
            "unknown manoeuvre",
        ),
        ("rotor-drag/picture?vehicle=f550&rotor=1", 422, "whole vehicle"),
    ] {
        let answer = picture(query);
        let (code, problem) = (answer.status, answer.json());
        assert_eq!(code, status, "{query}: {problem}");
        assert!(
            problem["detail"].as_str().is_some_and(|detail| detail.contains(words)),
            "{problem}"
        );
    }
}

#[test]
fn scenario_an_effect_of_ones_own_choice_and_what_is_refused() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let (id, job) = generated(
        &server,
        &json!({ "effect": "rotor-drag:drag_n_s_m=0.25", "seed": 1, "duration_s": 20, "vehicle": "quad-x" }),
    );
    assert_eq!(job["facts"]["vehicle"], "quad-x");
    let truth = server.ask("GET", &format!("/api/v1/logs/{id}/truth"), &[], "").json();
    assert_eq!(
        truth["effects"],
        json!([{ "id": "rotor-drag", "parameters": { "drag_n_s_m": 0.25 } }])
    );
    for (body, status, words) in [
        (json!({}), 422, "either `preset` or `effect`"),
        (json!({ "preset": "healthy", "effect": "mass" }), 422, "either"),
        (json!({ "preset": "surprise" }), 422, "`preset`: expected one of"),
        (json!({ "effect": "none" }), 422, "unknown effect `none`"),
        (json!({ "effect": "rotor-thrust-scale:rotor=9" }), 422, "from 1 to 6"),
        (json!({ "preset": "healthy", "vehicle": "none" }), 404, "f550"),
        (json!({ "preset": "healthy", "duration_s": 1e9 }), 422, "duration_s"),
    ] {
        let problem = server.ask("POST", "/api/v1/logs/generate", &[], &body.to_string());
        let (code, problem) = (problem.status, problem.json());
        assert_eq!(code, status, "{body}: {problem}");
        assert!(
            problem["detail"].as_str().is_some_and(|detail| detail.contains(words)),
            "{problem}"
        );
    }
    let log = server.ask_bytes(
        "POST",
        "/api/v1/logs?name=other.csv",
        &[("content-type", "application/octet-stream")],
        b"time_s,duty_1\n0,0.5\n",
    );
    let other = log.json()["id"].as_str().expect("an id").to_owned();
    server.ended_in("logs", &other);
    let status = server
        .ask("GET", &format!("/api/v1/logs/{other}/truth"), &[], "")
        .status;
    assert!(matches!(status, 404 | 409), "{status}");
}
