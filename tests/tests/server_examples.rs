//! Example logs over HTTP: flown by the independent simulator, diagnosed without knowing the truth, which is revealed afterwards.

use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::server::Server;
use serde_json::{Value, json};

fn generated(server: &Server, body: &Value) -> (String, Value) {
    let id = server.generated(body);
    let job = server.get(&format!("/api/v1/logs/{id}"));
    (id, job)
}

#[test]
fn scenario_each_example_of_a_first_visit_is_diagnosed_as_what_it_is() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    for (preset, verdict) in [
        ("hidden-effect", "missing"),
        ("damaged-blade", "missing"),
        ("healthy", "agrees"),
    ] {
        let (id, job) = generated(&server, &json!({ "preset": preset, "seed": 3 }));
        // Nothing tells what is in it before somebody asks; the log is one like any other.
        let told = job.to_string();
        for word in ["rotor-drag", "share", "hidden", "damaged", "healthy"] {
            assert!(!told.contains(word), "{preset}: {word}: {told}");
        }
        assert!(
            job["result"]["report"]["rows"]
                .as_u64()
                .is_some_and(|rows| rows > 20_000),
            "{job}"
        );
        let truth = server.ask("GET", &format!("/api/v1/logs/{id}/truth"), &[], "").json();
        let hidden = truth["effects"].as_array().expect("a list");
        assert_eq!(hidden.len(), usize::from(preset != "healthy"), "{truth}");
        let diagnosis = server.submit_to(
            "diagnoses",
            &json!({ "model": { "vehicle": "f550" }, "flights": { "logs": [id] } }),
        );
        let job = server.ended_in("diagnoses", &diagnosis);
        assert_eq!(
            job["result"]["verdict"]["kind"], verdict,
            "{preset}: {}",
            job["result"]["sentence"]
        );
        if let [effect] = hidden.as_slice() {
            let found = &job["result"]["effects"][0]["instance"];
            assert_eq!(found["effect"], effect["id"], "{}", job["result"]["sentence"]);
            assert_eq!(found["rotor"], effect["rotor"]);
        }
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
        (json!({ "preset": "surprise" }), 422, "unknown variant"),
        (json!({ "effect": "none" }), 422, "there is no effect"),
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
