//! The HTTP server with real processes: every accepted job ends, whatever dies; nothing is duplicated; refusals are one
//! sentence.

use rotortwin_tests::process::{Process, wait_until};
use rotortwin_tests::program::{Call, Link};
use rotortwin_tests::scratch::{Scratch, shipped_scenario};
use rotortwin_tests::server::Server;
use serde_json::{Value, json};
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::time::Duration;

/// A hover long enough in wall time to interfere with it.
fn slow(seconds: f64) -> Value {
    json!({ "scenario": "short-hover", "pace": "real-time", "set": [format!("duration_s={seconds}")] })
}

/// Events of a run until the stream ends: (number, kind).
fn events(server: &Server, id: &str, last: u64) -> Vec<(u64, String)> {
    let last = last.to_string();
    let path = format!("/api/v1/runs/{id}/events");
    let stream = server.send("GET", &path, &[("last-event-id", &last)], "");
    let mut events: Vec<(u64, String)> = Vec::new();
    let mut number = 0;
    for line in BufReader::new(stream).lines().map_while(Result::ok) {
        if let Some(text) = line.strip_prefix("id: ") {
            number = text.parse().expect("a number");
        } else if let Some(kind) = line.strip_prefix("event: ") {
            events.push((number, kind.to_owned()));
        }
    }
    // The order of `id` and `event` within an event is the server's choice.
    events
}

/// A request does not wait indefinitely for a worker: proxies would cut it off. The same key continues to wait for the
/// same job.
#[test]
fn scenario_a_verification_that_takes_long_is_answered_with_its_job() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let mut server = Server::start(&data);
    let id = server.submit(&json!({ "scenario": "short-hover", "seed": 7, "link": "in-process" }));
    let run = server.ended(&id);
    assert_eq!(server.stop(), Some(0));
    let mut server = Server::start_at("127.0.0.1:0", &data, &["--workers", "0"]);
    let (path, key) = (format!("/api/v1/runs/{id}/verify"), [("idempotency-key", "once")]);
    let begun = std::time::Instant::now();
    let waits = server.ask("POST", &path, &key, "");
    let waited_s = begun.elapsed().as_secs();
    let job = waits.json();
    assert_eq!(
        (waits.status, &job["kind"], &job["status"]),
        (202, &json!("verification"), &json!("queued")),
        "{job}"
    );
    assert!((19..28).contains(&waited_s), "{waited_s} s");
    let address = format!("/api/v1/verifications/{}", job["id"].as_str().expect("an id"));
    assert!(waits.headers.contains(&address), "{}", waits.headers);
    assert_eq!(server.stop(), Some(0));
    server.start_again(&data);
    let compared = server.ask("POST", &path, &key, "");
    let answer = compared.json();
    assert_eq!(
        (compared.status, &answer["same"], &answer["again"]),
        (200, &json!(true), &run["run_hash"]),
        "{answer}"
    );
    assert_eq!(answer["job"], job["id"]);
    assert!(answer["wall_ms"].as_i64().is_some_and(|ms| ms >= 19_000), "{answer}");
}

#[test]
fn scenario_a_run_over_http_is_the_run_of_the_command_line() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let id = server.submit(&json!({ "scenario": "short-hover", "seed": 7 }));
    let run = server.ended(&id);
    assert_eq!(run["status"], "done", "{run}");
    // Its kind and its result are where those of every job are.
    assert_eq!(
        (&run["kind"], &run["result"], &run["result"]["run_hash"]),
        (&json!("run"), &run["summary"], &run["run_hash"])
    );
    let listed = server.get("/api/v1/runs")["items"][0].clone();
    assert_eq!(
        (&listed["kind"], &listed["id"], &listed["result"]),
        (&json!("run"), &run["id"], &Value::Null)
    );
    let here = Call::fly(&scratch, Link::InProcess, &shipped_scenario("short-hover"), "here").with(["--seed", "7"]);
    assert_eq!(run["run_hash"], here.run().expect_code(0).run_hash());
    let verified = server.ask("POST", &format!("/api/v1/runs/{id}/verify"), &[], "").json();
    assert_eq!(
        (&verified["same"], &verified["recorded"]),
        (&json!(true), &run["run_hash"])
    );
    // A job of its own, with its own kind.
    let job = server.get(&format!(
        "/api/v1/verifications/{}",
        verified["job"].as_str().expect("an id")
    ));
    assert_eq!(
        (&job["status"], &job["parent"], &job["result"]["replayed"]),
        (&json!("done"), &json!(id), &run["run_hash"])
    );
    let key = [("idempotency-key", "once")];
    let [one, two] = [(); 2].map(|()| {
        server
            .ask("POST", &format!("/api/v1/runs/{id}/verify"), &key, "")
            .json()
    });
    assert_eq!(one["job"], two["job"], "{one} {two}");
    // A different hash is an answer, not a failure of the server.
    let summary = scratch.path("data").join(format!("jobs/{id}/1/out/summary.json"));
    let text = std::fs::read_to_string(&summary).expect("it is there");
    let hash = run["run_hash"].as_str().expect("a hash");
    std::fs::write(&summary, text.replace(hash, &"0".repeat(hash.len()))).expect("it can be changed");
    let differs = server.ask("POST", &format!("/api/v1/runs/{id}/verify"), &[], "");
    assert_eq!((differs.status, &differs.json()["same"]), (200, &json!(false)));
    std::fs::write(&summary, text).expect("it can be changed back");

    let numbers: Vec<u64> = events(&server, &id, 0).iter().map(|(number, _)| *number).collect();
    assert!(numbers.iter().copied().eq(1..=numbers.len() as u64), "{numbers:?}");
    let rest = events(&server, &id, numbers.len() as u64 - 2);
    assert_eq!(rest.len(), 2, "{rest:?}");
    assert_eq!(rest[1].1, "ended");

    let report = server.ask("GET", &format!("/api/v1/runs/{id}/artifacts/report.html"), &[], "");
    assert!(report.status == 200 && report.body.to_ascii_lowercase().starts_with(b"<!doctype html>"));
    let some = server.ask(
        "GET",
        &format!("/api/v1/runs/{id}/artifacts/run.mcap"),
        &[("range", "bytes=1-4")],
        "",
    );
    assert_eq!((some.status, some.body.as_slice()), (206, b"MCAP".as_slice()));
    // The page is served at every address outside the API.
    let front = server.ask("GET", "/", &[], "");
    let deep = server.ask("GET", &format!("/runs/{id}"), &[], "");
    assert_eq!((front.status, deep.status), (200, 200));
    assert!(front.body == deep.body && front.body.to_ascii_lowercase().starts_with(b"<!doctype html>"));
    let tag = front.headers.lines().find_map(|line| {
        line.split_once(": ")
            .filter(|(name, _)| name.eq_ignore_ascii_case("etag"))
    });
    let (_, tag) = tag.expect("it has an ETag");
    assert_eq!(server.ask("GET", "/", &[("if-none-match", tag.trim())], "").status, 304);
    for path in ["/assets/none.js", "/api/none", "/api/v1/none"] {
        let problem = server.ask("GET", path, &[], "");
        assert_eq!(
            (problem.status, &problem.json()["status"]),
            (404, &serde_json::json!(404)),
            "{path}"
        );
    }
}

#[test]
fn scenario_the_same_submission_makes_one_run_and_another_is_refused() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let submit = |body: &str| server.ask("POST", "/api/v1/runs", &[("idempotency-key", "one")], body);
    let (first, second) = (
        submit(r#"{"scenario":"short-hover"}"#),
        submit(r#"{"scenario":"short-hover"}"#),
    );
    assert_eq!((first.status, second.status), (202, 200));
    assert_eq!(first.json()["id"], second.json()["id"]);
    let other = submit(r#"{"scenario":"short-hover","seed":2}"#);
    assert_eq!(other.status, 409);
    assert!(other.headers.contains("application/problem+json"));
    assert_eq!(server.get("/api/v1/runs")["items"].as_array().map(Vec::len), Some(1));
}

#[test]
fn scenario_what_cannot_be_flown_is_refused_with_the_reason() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    for (body, status, words) in [
        (r#"{"scenario":"nowhere"}"#, 404, "short-hover"),
        (r"{}", 422, "scenario"),
        (r#"{"scenario":"hover","set":["duration_s=-3"]}"#, 422, "duration_s"),
        (
            r#"{"scenario":"hover","set":["vehicle=../../../../etc/passwd"]}"#,
            422,
            "is outside the library",
        ),
        (r#"{"text":"vehicle = '/etc/passwd'"}"#, 422, "is outside the library"),
        (r#"{"scenario":"hover","colour":"red"}"#, 422, "colour"),
        (r#" ["short-hover"]"#, 422, "expected one JSON object"),
        ("{", 400, "JSON"),
    ] {
        let answer = server.ask("POST", "/api/v1/runs", &[], body);
        let problem = answer.json();
        assert_eq!(answer.status, status, "{body}: {problem}");
        assert!(
            problem["detail"].as_str().is_some_and(|detail| detail.contains(words)),
            "{body}: {problem}"
        );
    }
    let large = format!("{{\"text\":\"{}\"}}", "x".repeat(3 << 20));
    assert_eq!(server.ask("POST", "/api/v1/runs", &[], &large).status, 413);
    assert_eq!(server.get("/api/v1/runs")["items"], json!([]));
    let id = server.submit(&json!({ "scenario": "short-hover" }));
    server.ended(&id);
    let outside = format!("/api/v1/runs/{id}/artifacts/..%2f..%2f..%2frotortwin.sqlite");
    assert_eq!(server.ask("GET", &outside, &[], "").status, 404);
}

/// A submission is one JSON object: serde would also take its fields from a list, in their order.
#[test]
fn scenario_a_list_is_no_submission() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    for body in [
        r#"["short-hover"]"#,
        "[]",
        r#"[{"scenario":"short-hover"}]"#,
        "7",
        r#""short-hover""#,
        "null",
    ] {
        let answer = server.ask("POST", "/api/v1/runs", &[], body);
        let problem = answer.json();
        assert_eq!(
            (answer.status, &problem["type"]),
            (422, &json!("/problems/unprocessable")),
            "{body}: {problem}"
        );
        // The first two would be read as the first fields, or as none.
        let is_array = problem["detail"].to_string().contains("expected one JSON object");
        assert_eq!(is_array, body.len() < 17 && body.starts_with('['), "{body}: {problem}");
    }
    assert_eq!(server.get("/api/v1/runs")["items"], json!([]));
}

#[test]
fn scenario_a_canceled_run_ends_and_keeps_what_it_has() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let id = server.submit(&slow(60.0));
    let path = format!("/api/v1/runs/{id}");
    // Not only started: it has flown some steps.
    let stream = server.send("GET", &format!("{path}/events"), &[], "");
    let mut lines = BufReader::new(stream).lines().map_while(Result::ok);
    assert!(lines.any(|line| line == "event: progress"), "it flies");
    assert_eq!(server.ask("DELETE", &path, &[], "").status, 409);
    assert_eq!(server.ask("POST", &format!("{path}/cancel"), &[], "").status, 202);
    let run = server.ended(&id);
    assert_eq!(run["status"], "canceled", "{run}");
    assert!(run["summary"]["steps"].as_u64().is_some(), "{run}");
    assert_eq!(server.ask("POST", &format!("{path}/cancel"), &[], "").status, 409);
    assert_eq!(server.ask("DELETE", &path, &[], "").status, 204);
    assert_eq!(server.ask("GET", &path, &[], "").status, 404);
    assert!(!scratch.path("data").join("jobs").join(&id).exists());
    // In one process nothing is written before the end: either that is still reached, or what is said is how far it was.
    let mut body = slow(60.0);
    body["link"] = json!("in-process");
    let id = server.submit(&body);
    let stream = server.send("GET", &format!("/api/v1/runs/{id}/events"), &[], "");
    let flown_s = BufReader::new(stream).lines().map_while(Result::ok).find_map(|line| {
        let event: Value = serde_json::from_str(line.strip_prefix("data: ")?).ok()?;
        event["sim_time_s"].as_f64().filter(|at| *at > 1.0)
    });
    let flown_s = flown_s.expect("it flies");
    let cancel = format!("/api/v1/runs/{id}/cancel");
    assert_eq!(server.ask("POST", &cancel, &[], "").status, 202);
    let run = server.ended(&id);
    let Some(why) = run["error"].as_str() else {
        assert!(
            run["summary"]["steps"].as_u64().is_some_and(|steps| steps > 400),
            "{run}"
        );
        return;
    };
    let said_s = why
        .strip_prefix("canceled after ")
        .and_then(|rest| rest.split_once(" s of flight"));
    let said_s: f64 = said_s
        .and_then(|(number, _)| number.parse().ok())
        .unwrap_or_else(|| panic!("{why}"));
    assert!((flown_s - 0.1..flown_s + 10.0).contains(&said_s), "{flown_s}: {why}");
}

/// Attempts of a run that is flying.
fn events_so_far(server: &Server, path: &str) -> u64 {
    let run = server.get(path);
    if run["status"] == "running" {
        run["attempts"].as_u64().unwrap_or(0)
    } else {
        0
    }
}

/// No process of a flight in this folder is alive.
fn nobody_flies(data: &Path) -> bool {
    Process::with_word(&data.display().to_string()).is_empty()
}

#[test]
fn scenario_a_killed_server_loses_nothing_and_doubles_nothing() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let mut server = Server::start(&data);
    let mut ids: Vec<String> = (1..=6)
        .map(|seed| server.submit(&json!({ "scenario": "short-hover", "seed": seed })))
        .collect();
    ids.push(server.submit(&slow(3.0)));
    for round in 0..3 {
        std::thread::sleep(Duration::from_millis(150 + 200 * round));
        server.kill();
        // The flights notice that their standard input is closed.
        wait_until(Duration::from_secs(20), || nobody_flies(&data)).expect("no flight outlives its server");
        server = Server::start(&data);
        ids.push(server.submit(&json!({ "scenario": "short-hover", "seed": 1 })));
    }
    let runs: Vec<Value> = ids.iter().map(|id| server.ended(id)).collect();
    assert!(runs.iter().all(|run| run["status"] == "done"), "{runs:?}");
    // The same flight gives the same bits, however often it was started.
    for again in &runs[7..] {
        assert_eq!(again["run_hash"], runs[0]["run_hash"]);
    }
    assert_eq!(
        server.get("/api/v1/runs?limit=100")["items"].as_array().map(Vec::len),
        Some(ids.len())
    );
    for id in &ids {
        let ends = events(&server, id, 0)
            .iter()
            .filter(|(_, kind)| kind == "ended")
            .count();
        assert_eq!(ends, 1, "{id}");
    }
}

#[test]
fn scenario_a_stopped_server_puts_its_flights_back() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let mut server = Server::start(&data);
    let id = server.submit(&slow(4.0));
    let path = format!("/api/v1/runs/{id}");
    wait_until(Duration::from_secs(30), || events_so_far(&server, &path) > 0).expect("it begins");
    assert_eq!(server.stop(), Some(0));
    assert!(nobody_flies(&data));
    let server = Server::start(&data);
    let run = server.ended(&id);
    assert_eq!((&run["status"], &run["attempts"]), (&json!("done"), &json!(2)), "{run}");
}

#[test]
fn scenario_one_server_a_folder_and_no_strangers() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let _server = Server::start(&data);
    let library = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config");
    let serve = |listen: &str| {
        let args = [
            "serve".into(),
            "--listen".into(),
            listen.into(),
            "--data".into(),
            data.clone().into_os_string(),
        ];
        let library = ["--library".into(), library.clone().into_os_string()];
        Call::new(&scratch, args)
            .with(library)
            .run()
            .expect_code(2)
            .stderr
            .join(" ")
    };
    assert!(serve("127.0.0.1:0").contains("another rotortwin server uses this data folder"));
    assert!(serve("0.0.0.0:0").contains("in the clear"));
}

#[test]
fn val_parameters_of_a_path_are_in_it() {
    let scratch = Scratch::new();
    let now = Call::new(&scratch, ["serve", "--openapi"]).run().expect_code(0).stdout;
    let document: Value = serde_json::from_str(&now).expect("JSON");
    let mut wrong = Vec::new();
    for (path, operations) in document["paths"].as_object().expect("paths") {
        for (method, operation) in operations.as_object().expect("operations") {
            for parameter in operation["parameters"].as_array().into_iter().flatten() {
                let name = parameter["name"].as_str().expect("a name");
                if parameter["in"] == "path" && !path.contains(&format!("{{{name}}}")) {
                    wrong.push(format!("{method} {path}: {name}"));
                }
            }
        }
    }
    assert_eq!(wrong, Vec::<String>::new());
}

#[test]
fn regress_openapi_document() {
    let scratch = Scratch::new();
    let now = Call::new(&scratch, ["serve", "--openapi"]).run().expect_code(0).stdout;
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/openapi.json");
    if std::env::var_os("ROTORTWIN_UPDATE_GOLDEN").is_some() {
        std::fs::write(&golden, &now).expect("written");
    }
    let before = std::fs::read_to_string(&golden).unwrap_or_default();
    assert!(
        before == now,
        "the API has changed; if that was meant: ROTORTWIN_UPDATE_GOLDEN=1 cargo test --release -p rotortwin-tests --test server regress_"
    );
}
