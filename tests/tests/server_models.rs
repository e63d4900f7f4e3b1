//! Models that grow over HTTP: findings of a diagnosis are added, compared, undone, branched, exported.

use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::server::{Answer, Server};
use serde_json::{Value, json};

/// Healthy propellers, in drag that the vehicle's model does not know.
const HIDDEN_DRAG: [&str; 3] = [
    "fault=[]",
    "duration_s=60.0",
    "effect=[{effect='rotor-drag',parameters={drag_n_s_m=0.25}}]",
];

fn done(server: &Server, collection: &str, body: &Value) -> (String, Value) {
    let id = server.submit_to(collection, body);
    let job = server.ended_in(collection, &id);
    assert_eq!(job["status"], "done", "{collection}: {job}");
    (id, job)
}

fn post(server: &Server, path: &str, headers: &[(&str, &str)], body: &Value) -> Answer {
    server.ask("POST", &format!("/api/v1/models/{path}"), headers, &body.to_string())
}

fn get(server: &Server, path: &str) -> Value {
    let answer = server.ask("GET", &format!("/api/v1/models/{path}"), &[], "");
    assert_eq!(answer.status, 200, "{path}: {}", answer.json());
    answer.json()
}

/// Error of the force, of each model of a comparison, mN.
fn force_errors(job: &Value) -> Vec<f64> {
    let models = job["result"]["logs"][0]["models"].as_array().expect("models");
    let force = |model: &Value| {
        let errors = model["errors"].as_array().expect("errors");
        let force = errors
            .iter()
            .find(|error| error["quantity"] == "force")
            .expect("a force");
        force["error"].as_f64().expect("a number")
    };
    models.iter().map(force).collect()
}

#[test]
fn scenario_what_is_found_is_added_and_undone_over_http() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let (run, _) = done(
        &server,
        "runs",
        &json!({ "scenario": "waypoints", "link": "in-process", "set": HIDDEN_DRAG }),
    );
    let flights = json!({ "runs": [run] });
    let (diagnosis, job) = done(
        &server,
        "diagnoses",
        &json!({ "model": { "vehicle": "f550" }, "flights": flights }),
    );
    assert_eq!(job["result"]["effects"][0]["instance"]["effect"], "rotor-drag");

    // A vehicle is its own version 0, and nothing is stored yet.
    let before = get(&server, "f550/history");
    assert_eq!(
        (&before["begun"], &before["versions"][0]["version"]),
        (&json!(false), &json!(0))
    );
    let first = before["branches"][0]["hash"].as_str().expect("a hash").to_owned();
    assert_eq!(job["result"]["model"]["hash"], json!(first), "what was diagnosed");

    // Added once; a second client that saw the same version is refused and changes nothing.
    let body = json!({ "diagnosis": diagnosis, "pick": 1, "note": "from the bench" });
    let seen = format!("\"{first}\"");
    let added = post(&server, "f550/versions", &[("if-match", &seen)], &body);
    assert_eq!(added.status, 201, "{}", added.json());
    let added = added.json();
    assert_eq!(
        (&added["model"], &added["version"]["version"]),
        (&json!("f550"), &json!(1))
    );
    assert_eq!(added["difference"]["parameters"][0]["effect"], "rotor-drag");
    let drag = added["version"]["effects"][0]["parameters"][0]["value"]
        .as_f64()
        .expect("a number");
    assert!((drag - 0.25).abs() < 0.01, "{drag}");
    let second = post(&server, "f550/versions", &[("if-match", &seen)], &body);
    assert_eq!(second.status, 412, "{}", second.json());
    // Nor does it become a version without a difference.
    let again = post(&server, "f550/versions", &[], &body);
    assert_eq!(again.status, 422, "{}", again.json());
    let detail = again.json()["detail"].to_string();
    assert!(detail.contains("f550@v1 has all of this already"), "{detail}");
    let after = get(&server, "f550/history");
    assert_eq!(after["versions"].as_array().map(Vec::len), Some(2));
    assert_eq!(
        (&after["begun"], &after["branches"][0]["version"]),
        (&json!(true), &json!(1))
    );
    assert_eq!(
        (&after["versions"][1]["parent"], &after["versions"][1]["note"]),
        (&json!(0), &json!("from the bench"))
    );
    let names = server.ask("GET", "/api/v1/models", &[], "").json();
    assert!(
        names["own"].as_array().is_some_and(|own| own.contains(&json!("f550"))),
        "{names}"
    );

    // Both versions in one comparison: the error falls to the noise.
    let (_, comparison) = done(
        &server,
        "comparisons",
        &json!({ "model": { "model": "f550@v0" }, "more_models": [{ "model": "f550" }], "flights": flights }),
    );
    let labels: Vec<&Value> = comparison["result"]["models"]
        .as_array()
        .expect("models")
        .iter()
        .map(|m| &m["label"])
        .collect();
    assert_eq!(labels, ["f550@v0", "f550"]);
    let [worse, better] = force_errors(&comparison)[..] else {
        panic!("{comparison}")
    };
    assert!(better < 0.3 * worse, "{worse} mN, then {better} mN");

    // Undone, diffed, branched, exported.
    let undone = post(&server, "f550/undo", &[], &json!({})).json();
    assert_eq!(
        (&undone["left"], &undone["version"]["version"]),
        (&json!(1), &json!(0)),
        "{undone}"
    );
    assert_eq!(undone["version"]["hash"], json!(first), "the old numbers");
    assert_eq!(
        post(&server, "f550/undo", &[], &json!({})).status,
        409,
        "nothing is before v0"
    );
    let difference = get(&server, "f550/diff?from=v1");
    assert_eq!(
        (&difference["from"], &difference["to"]),
        (&json!("f550@v1"), &json!("f550@v0"))
    );
    assert!(difference["parameters"][0]["after"].is_null(), "{difference}");
    let windy = post(&server, "f550/branches", &[], &json!({ "name": "windy", "at": "v1" }));
    assert_eq!(windy.status, 201, "{}", windy.json());
    assert_eq!(
        post(&server, "f550/branches", &[], &json!({ "name": "windy" })).status,
        409
    );
    assert_eq!(
        post(&server, "f550/branches", &[], &json!({ "name": "v7" })).status,
        422
    );
    let file = server.ask("GET", "/api/v1/models/f550/versions/windy", &[], "");
    let text = String::from_utf8(file.body).expect("text");
    assert!(text.contains("rotor-drag") && text.contains("[vehicle"), "{text}");
    assert_eq!(get(&server, "f550/versions/windy?format=json")["label"], "f550@v1");

    // The exported file starts another model; the library's head follows main.
    let other = server.ask(
        "POST",
        "/api/v1/models",
        &[],
        &json!({ "name": "other", "model": { "version": text } }).to_string(),
    );
    assert_eq!(other.status, 201, "{}", other.json());
    assert_eq!(
        get(&server, "other/history")["versions"][0]["effects"][0]["effect"],
        "rotor-drag"
    );
    let head = server.ask("GET", "/api/v1/models/f550", &[], "");
    assert!(
        !String::from_utf8_lossy(&head.body).contains("rotor-drag"),
        "main was undone"
    );
    let mut toml = String::from_utf8(head.body).expect("text");
    toml.push('\n');
    let put = server.ask(
        "PUT",
        "/api/v1/models/f550",
        &[("content-type", "application/toml")],
        &toml,
    );
    assert_eq!(put.status, 409, "{}", put.json());
    assert_eq!(server.ask("DELETE", "/api/v1/models/f550", &[], "").status, 204);
    assert_eq!(get(&server, "f550/history")["begun"], json!(false));
}

/// A drag that begins at 2.5 m/s is in no catalogue: the diagnosis proposes an effect, which becomes the next version with its document.
#[test]
fn scenario_what_no_catalogue_has_is_proposed_and_added_over_http() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let hidden = "threshold-drag:drag_n_s3_m3=0.1,threshold_m_s=2.5";
    let log = server.generated(&json!({ "effect": hidden, "seed": 31 }));
    let flights = json!({ "logs": [log] });
    let (diagnosis, job) = done(
        &server,
        "diagnoses",
        &json!({ "model": { "vehicle": "f550" }, "flights": flights }),
    );
    let result = &job["result"];
    assert_eq!(result["verdict"]["kind"], "outside-catalogue", "{}", result["sentence"]);
    let proposal = &result["proposal"];
    let acts = proposal["terms"][0]["acts"].to_string();
    assert!(acts.contains("max(airspeed - 2.5"), "{acts}");

    // Beside a pick it is neither; as what it is, it becomes version 1.
    let both = json!({ "diagnosis": diagnosis, "proposal": true, "pick": 1 });
    assert_eq!(post(&server, "f550/versions", &[], &both).status, 422);
    let body = json!({ "diagnosis": diagnosis, "proposal": true });
    let added = post(&server, "f550/versions", &[], &body);
    assert_eq!(added.status, 201, "{}", added.json());
    let added = added.json();
    let effect = &added["version"]["effects"][0];
    assert_eq!(effect["effect"], proposal["document"]["id"]);
    for term in proposal["terms"].as_array().expect("terms") {
        let parameters = effect["parameters"].as_array().expect("parameters");
        let value = parameters.iter().find(|value| value["name"] == term["parameter"]);
        assert_eq!(value.map(|value| &value["value"]), Some(&term["factor"]), "{effect}");
    }
    let file = server.ask("GET", "/api/v1/models/f550/versions/v1", &[], "");
    let text = String::from_utf8(file.body).expect("text");
    assert!(text.contains("[[effect_document]]"), "{text}");

    let (_, comparison) = done(
        &server,
        "comparisons",
        &json!({ "model": { "model": "f550@v0" }, "more_models": [{ "model": "f550" }], "flights": flights }),
    );
    let [worse, better] = force_errors(&comparison)[..] else {
        panic!("{comparison}")
    };
    assert!(better < 0.5 * worse, "{worse} mN, then {better} mN");
}

#[test]
fn scenario_additions_that_make_no_sense_change_nothing() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let mut server = Server::start(&data);
    let (run, _) = done(
        &server,
        "runs",
        &json!({ "scenario": "short-hover", "link": "in-process" }),
    );
    let (diagnosis, _) = done(
        &server,
        "diagnoses",
        &json!({ "model": { "vehicle": "f550" }, "flights": { "runs": [run] } }),
    );
    let effect = |value: f64| json!({ "effect": { "effect": "mass", "parameters": { "share": value } } });
    for (path, body, status, words) in [
        ("none/versions", effect(0.1), 404, "model or vehicle '"),
        (
            "f550/versions",
            json!({ "diagnosis": diagnosis }),
            422,
            "no missing physics",
        ),
        (
            "f550/versions",
            json!({ "diagnosis": diagnosis, "proposal": true }),
            422,
            "proposes nothing",
        ),
        (
            "f550/versions",
            json!({ "diagnosis": "none" }),
            404,
            "there is no diagnosis",
        ),
        ("f550/versions", json!({}), 422, "expected either `diagnosis`"),
        (
            "f550/versions",
            json!({ "effect": { "effect": "none", "parameters": {} } }),
            422,
            "none",
        ),
        ("f550/versions", effect(1e9), 422, "share"),
        (
            "f550/versions",
            json!({ "branch": "none", "effect": { "effect": "mass", "parameters": { "share": 0.1 } } }),
            404,
            "f550@none not found",
        ),
        ("f550/undo", json!({}), 409, "nothing to undo"),
        ("f550/undo", json!({ "branch": 3 }), 422, "branch"),
        ("f550/branches", json!({ "name": "a b" }), 400, "name"),
    ] {
        let problem = post(&server, path, &[], &body);
        let (code, problem) = (problem.status, problem.json());
        assert_eq!(code, status, "{path} {body}: {problem}");
        assert!(
            problem["detail"].as_str().is_some_and(|detail| detail.contains(words)),
            "{problem}"
        );
    }
    assert_eq!(get(&server, "f550/history")["begun"], json!(false), "nothing was begun");
    assert_eq!(
        post(&server, "f550/versions", &[("if-match", "\"x\"")], &effect(0.1)).status,
        412
    );

    // By hand; a diagnosis of an earlier model belongs to no other one.
    let added = post(&server, "f550/versions", &[], &effect(0.1));
    assert_eq!(added.status, 201, "{}", added.json());
    // Many concurrently: each continues from the version it saw, or is rejected.
    let statuses = std::thread::scope(|scope| {
        let calls: Vec<_> = (0..8)
            .map(|k| {
                let server = &server;
                scope.spawn(move || post(server, "f550/versions", &[], &effect(0.01 * f64::from(k + 1))).status)
            })
            .collect();
        calls
            .into_iter()
            .map(|call| call.join().expect("an answer"))
            .collect::<Vec<u16>>()
    });
    let made = statuses.iter().filter(|status| **status == 201).count();
    assert!(
        made >= 1 && statuses.iter().all(|status| matches!(status, 201 | 412)),
        "{statuses:?}"
    );
    let history = get(&server, "f550/history");
    let versions = history["versions"].as_array().expect("versions");
    assert_eq!(versions.len(), 2 + made, "none was lost, none left over");
    for (number, version) in versions.iter().enumerate().skip(1) {
        assert_eq!(
            (&version["version"], &version["parent"]),
            (&json!(number), &json!(number - 1)),
            "one line"
        );
    }
    // It is on disk.
    server.kill();
    server.start_again(&data);
    assert_eq!(get(&server, "f550/history"), history);
}
