//! Models compared with flights over HTTP, classifiers trained on the server: the results are those of the command
//! line.

use rotortwin_tests::program::Call;
use rotortwin_tests::scratch::{Scratch, repository};
use rotortwin_tests::server::{Answer, Server};
use serde_json::{Value, json};

/// Healthy propellers, with drag that the vehicle's model lacks.
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

fn upload(server: &Server, query: &str, body: &[u8]) -> Answer {
    // The harness sends texts; a log as text is a CSV.
    let text = String::from_utf8(body.to_vec()).expect("a CSV");
    let headers = [("content-type", "application/octet-stream")];
    server.ask("POST", &format!("/api/v1/logs?{query}"), &headers, &text)
}

#[test]
fn scenario_from_an_upload_to_an_improved_model() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let (run, _) = done(
        &server,
        "runs",
        &json!({ "scenario": "waypoints", "link": "in-process" }),
    );

    // A log of that run as a foreign CSV: exported, uploaded, imported.
    let export = server.ask(
        "GET",
        &format!("/api/v1/runs/{run}/artifacts/telemetry.parquet"),
        &[],
        "",
    );
    assert_eq!(export.status, 200);
    let log = upload(&server, "name=flight.csv", LOG.as_bytes());
    assert_eq!(log.status, 202, "{}", log.json());
    let id = log.json()["id"].as_str().expect("an id").to_owned();
    let log = server.ended_in("logs", &id);
    assert_eq!(log["status"], "failed", "{log}");
    assert!(
        log["error"].as_str().is_some_and(|why| why.contains("log.csv")),
        "{log}"
    );

    let (comparison, job) = done(
        &server,
        "comparisons",
        &json!({ "model": { "vehicle": "f550" }, "flights": { "runs": [format!("{run}@20:60")] } }),
    );
    assert!(job["result"]["logs"].is_array(), "{job}");
    let report = server.ask(
        "GET",
        &format!("/api/v1/comparisons/{comparison}/artifacts/report.html"),
        &[],
        "",
    );
    assert_eq!(report.status, 200);

    for (body, status, words) in [
        (
            json!({ "model": { "vehicle": "f550" }, "flights": {} }),
            422,
            "expected 1 to",
        ),
        (
            json!({ "model": { "vehicle": "f550" }, "flights": { "runs": ["none"] } }),
            404,
            "there is no run",
        ),
        (
            json!({ "model": { "vehicle": "none" }, "flights": { "runs": [run] } }),
            404,
            "f550",
        ),
        (
            json!({ "model": {}, "flights": { "runs": [run] } }),
            422,
            "expected one of",
        ),
        (
            json!({ "model": { "vehicle": "f550" }, "flights": { "runs": [format!("{run}@--out")] } }),
            0,
            "",
        ),
        (
            json!({ "model": { "vehicle": "f550" }, "flights": { "runs": [format!("{run}@/etc")] } }),
            422,
            "is not a part of a log",
        ),
        (
            json!({ "model": { "vehicle": "f550" }, "flights": { "runs": [run] }, "effects": ["x"] }),
            422,
            "belong to a diagnosis",
        ),
    ] {
        let answer = server.ask("POST", "/api/v1/comparisons", &[], &body.to_string());
        if status == 0 {
            // A word that looks like an option is still just a part's name.
            let id = answer.json()["id"].as_str().expect("an id").to_owned();
            assert_eq!(server.ended_in("comparisons", &id)["status"], "failed");
            continue;
        }
        let problem = answer.json();
        assert_eq!(answer.status, status, "{problem}");
        assert!(
            problem["detail"].as_str().is_some_and(|detail| detail.contains(words)),
            "{problem}"
        );
    }
    for (query, status) in [
        ("name=a.exe", 422),
        ("name=../x.csv", 422),
        ("", 400),
        ("name=a.csv&rate_hz=0", 422),
    ] {
        assert_eq!(upload(&server, query, b"x").status, status, "{query}");
    }
    assert_eq!(upload(&server, "name=a.csv", b"").status, 422);
}

fn exported(server: &Server, log: &str, channels: &str) -> String {
    let path = format!("/api/v1/logs/{log}/telemetry?channels={channels}&format=csv&points=100000");
    let answer = server.ask("GET", &path, &[], "");
    assert_eq!(answer.status, 200, "{}", String::from_utf8_lossy(&answer.body));
    String::from_utf8(answer.body).expect("a CSV")
}

fn read_again(server: &Server, log: &str, mapping: &str) -> Value {
    let body = json!({ "mapping": mapping }).to_string();
    let answer = server.ask("POST", &format!("/api/v1/logs/{log}/import"), &[], &body);
    assert_eq!(answer.status, 202, "{}", answer.json());
    server.ended_in("logs", answer.json()["id"].as_str().expect("an id"))
}

/// Motor outputs in another order: no model is compared with the log before it is read again in the order of the finding. A table
/// names its columns in that order, the log of an autopilot has `order`.
#[test]
fn scenario_exchanged_motors_are_found_and_read_again_in_their_order() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let right = server.generated(&json!({ "preset": "healthy", "seed": 3, "duration_s": 30 }));
    let table = exported(&server, &right, "*");
    let exchanged = table.replacen("duty_1,duty_2,", "duty_2,duty_1,", 1);
    assert_ne!(exchanged, table, "{}", table.lines().next().unwrap_or_default());
    let log = upload(&server, "name=motors.csv", exchanged.as_bytes()).json()["id"].clone();
    let log = log.as_str().expect("an id");
    assert_eq!(server.ended_in("logs", log)["status"], "done");
    let compared = |log: &str| {
        let body = json!({ "model": { "vehicle": "f550" }, "flights": { "logs": [log] } });
        server.ended_in("comparisons", &server.submit_to("comparisons", &body))
    };
    let refused = compared(log);
    assert_eq!(refused["status"], "failed", "{refused}");
    let why = refused["error"].as_str().expect("a sentence");
    assert!(
        why.contains("the log is at fault") && why.contains("duty_1 drives rotor 2, duty_2 drives rotor 1"),
        "{why}"
    );
    let row = "source = \"canonical\"\n[[column]]\nto = \"duty\"\nunit = \"1\"\nfrom = ";
    let mended = read_again(
        &server,
        log,
        &format!("{row}\"file:duty_2,duty_1,duty_3,duty_4,duty_5,duty_6\"\n"),
    );
    assert_eq!(mended["status"], "done", "{mended}");
    let again = compared(mended["id"].as_str().expect("an id"));
    assert_eq!(
        again["result"]["logs"][0]["models"][0]["agrees"], true,
        "{}",
        again["result"]["verdict"]
    );
    let wrong = read_again(&server, log, &format!("{row}\"file:duty_1,duty_2\"\norder = [2, 1]\n"));
    let why = wrong["error"].as_str().expect("a sentence");
    assert!(why.contains("name the columns in the order of the rotors"), "{why}");
}

#[test]
fn scenario_the_log_of_an_autopilot_is_read_again_with_its_motors_in_another_order() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let file = repository().join("crates/twin/tests/data/made-up.bin");
    let bytes = std::fs::read(file).expect("it is there");
    let headers = [("content-type", "application/octet-stream")];
    let answer = server.ask_bytes("POST", "/api/v1/logs?name=made-up.bin", &headers, &bytes);
    let log = answer.json()["id"].as_str().expect("an id").to_owned();
    assert_eq!(server.ended_in("logs", &log)["status"], "done");
    let range = "low = { parameter = [\"MOT_PWM_MIN\"], default = 1000.0 }\nhigh = { parameter = [\"MOT_PWM_MAX\"], default = 2000.0 }";
    let again = |order: &str| {
        let mapping = format!(
            "source = \"ardupilot-dataflash\"\n[[column]]\nto = \"duty\"\nfrom = \"RCOU:C{{}}\"\n{range}\norder = {order}\n"
        );
        read_again(&server, &log, &mapping)
    };
    let turned = again("[2, 1, 3, 4]");
    assert_eq!(turned["status"], "done", "{turned}");
    // Rotor 1 has the second output, rotor 2 the first, the others their own.
    let rows = |log: &str, channels: &str| -> Vec<String> {
        let table = exported(&server, log, channels);
        table.lines().skip(1).map(str::to_owned).collect()
    };
    let turned = turned["id"].as_str().expect("an id");
    for (rotor, output) in [(1, 2), (2, 1), (3, 3), (4, 4)] {
        let [here, there] = [
            rows(turned, &format!("duty_{rotor}")),
            rows(&log, &format!("duty_{output}")),
        ];
        assert!(here.len() > 100 && here == there, "rotor {rotor}");
    }
    assert_ne!(rows(&log, "duty_1"), rows(&log, "duty_2"));
    let twice = again("[1, 1, 3, 4]");
    let why = twice["error"].as_str().expect("a sentence");
    assert!(
        why.contains("order = [1, 1, 3, 4] names field 1 for rotors 1 and 2"),
        "{why}"
    );
}

/// Not a valid log.
const LOG: &str = "time,colour\n0,red\n";

#[test]
fn scenario_a_missing_effect_is_named_and_added_over_http() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let (run, _) = done(
        &server,
        "runs",
        &json!({ "scenario": "waypoints", "link": "in-process", "set": HIDDEN_DRAG }),
    );
    let flights = json!({ "runs": [run] });
    let (_, diagnosis) = done(
        &server,
        "diagnoses",
        &json!({ "model": { "vehicle": "f550" }, "flights": flights }),
    );
    let found = &diagnosis["result"]["effects"][0];
    assert_eq!(
        found["instance"]["effect"], "rotor-drag",
        "{}",
        diagnosis["result"]["sentence"]
    );
    let drag = found["parameters"][0]["value"].as_f64().expect("a number");
    assert!((drag - 0.25).abs() < 0.01, "{drag}");
    let (improvement, job) = done(
        &server,
        "improvements",
        &json!({ "model": { "vehicle": "f550" }, "flights": flights }),
    );
    assert!(job["result"]["reason"].is_string(), "{}", job["result"]);
    let model = server.ask(
        "GET",
        &format!("/api/v1/improvements/{improvement}/artifacts/model.toml"),
        &[],
        "",
    );
    assert!(String::from_utf8_lossy(&model.body).contains("rotor-drag"));
    // The trained model fits the flight better than the original one.
    let error = |model: Value| {
        let (_, job) = done(&server, "comparisons", &json!({ "model": model, "flights": flights }));
        job["result"]["logs"][0]["models"][0].clone()
    };
    let (before, after) = (
        error(json!({ "vehicle": "f550" })),
        error(json!({ "improvement": improvement })),
    );
    assert_ne!(before, after);
}

#[test]
fn scenario_a_classifier_trained_over_http_is_that_of_the_command_line_and_flies() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let (id, _) = done(&server, "classifiers", &json!({ "seeds": 1 }));
    let there = server.ask(
        "GET",
        &format!("/api/v1/classifiers/{id}/artifacts/classifier.json"),
        &[],
        "",
    );
    let out = scratch.path("here.json");
    let words = ["train", "--seeds", "1", "--out", &out.display().to_string()].map(str::to_owned);
    let scenario = [
        "--scenario".to_owned(),
        rotortwin_tests::scratch::shipped_scenario("reference-flight")
            .display()
            .to_string(),
    ];
    Call::new(&scratch, words).with(scenario).run().expect_code(0);
    // Equal except for the path in the recorded command.
    let weights = |bytes: &[u8]| {
        let mut classifier: Value = serde_json::from_slice(bytes).expect("JSON");
        let made = classifier["provenance"]["command"].take();
        assert!(made.as_str().is_some_and(|command| command.contains("train")), "{made}");
        classifier
    };
    assert!(weights(&std::fs::read(out).expect("it is there")) == weights(&there.body));
    let (_, run) = done(
        &server,
        "runs",
        &json!({ "scenario": "short-hover", "link": "in-process", "classifier": id }),
    );
    assert_eq!(run["status"], "done");
    let problem = server.ask("POST", "/api/v1/classifiers", &[], r#"{"seeds":0}"#);
    assert_eq!(problem.status, 422);

    // New flights: a campaign with this network in every one of them.
    let (evaluation, status) = {
        let path = format!("/api/v1/classifiers/{id}/evaluations");
        let answer = server.ask("POST", &path, &[], r#"{"repeats":1}"#);
        (answer.json()["id"].as_str().expect("an id").to_owned(), answer.status)
    };
    assert_eq!(status, 202);
    let campaign = server.ended_in("campaigns", &evaluation);
    assert_eq!(campaign["status"], "done", "{campaign}");
    assert_eq!(campaign["facts"]["flights"], 48, "{campaign}");
    let right = campaign["result"]["axes"][0]["groups"]
        .as_array()
        .expect("groups")
        .iter()
        .map(|group| group["detectors"]["network"]["right"].as_f64().expect("a share"));
    // The quiet courses: waypoints are the network's hard case (Table 6) and are not required here.
    let good = right.filter(|share| *share > 0.97).count();
    assert!(good >= 3, "{campaign}");
}
