//! A job's inputs exist when it starts: they cannot be deleted before, in either database.

use rotortwin_tests::postgres::Postgres;
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::server::{Answer, Server};
use serde_json::{Value, json};

/// Runs of which one is deleted while a comparison of it is submitted.
const RACES: usize = 16;

fn comparison(runs: &[&str]) -> String {
    json!({ "model": { "vehicle": "f550" }, "flights": { "runs": runs } }).to_string()
}

fn delete(server: &Server, path: &str) -> Answer {
    server.ask("DELETE", &format!("/api/v1/{path}"), &[], "")
}

fn id(answer: &Answer) -> String {
    answer.json()["id"].as_str().expect("an id").to_owned()
}

/// Some finished runs on a server that starts no more jobs.
fn done_runs(data: &std::path::Path, words: &[&str], count: usize) -> (Server, Vec<String>) {
    let mut server = Server::start_at("127.0.0.1:0", data, &[words, &["--workers", "2"]].concat());
    let runs: Vec<String> = (0..count)
        .map(|seed| server.submit(&json!({ "scenario": "short-hover", "seed": seed, "link": "in-process" })))
        .collect();
    for run in &runs {
        assert_eq!(server.ended(run)["status"], "done");
    }
    assert_eq!(server.stop(), Some(0));
    let server = Server::start_at("127.0.0.1:0", data, &[words, &["--workers", "0"]].concat());
    (server, runs)
}

fn needed_stays(data: &std::path::Path, words: &[&str]) {
    let (server, runs) = done_runs(data, words, RACES + 2);
    let (kept, other) = (&runs[RACES], &runs[RACES + 1]);
    let waits = server.ask("POST", "/api/v1/comparisons", &[], &comparison(&[kept, other]));
    assert_eq!(waits.status, 202, "{}", waits.json());
    let waits = id(&waits);
    for run in [kept, other] {
        let refused = delete(&server, &format!("runs/{run}"));
        let problem = refused.json();
        assert_eq!(
            (refused.status, &problem["type"]),
            (409, &json!("/problems/in-use")),
            "{problem}"
        );
        let told = problem["detail"].to_string();
        assert!(told.contains(&format!("the comparison {waits} is queued")), "{told}");
        assert_eq!(server.get(&format!("/api/v1/runs/{run}"))["status"], "done");
    }
    // Once it has ended, in whatever way, the run is no longer needed.
    let cancel = server.ask("POST", &format!("/api/v1/comparisons/{waits}/cancel"), &[], "");
    assert_eq!(cancel.status, 202, "{}", cancel.json());
    assert_eq!(delete(&server, &format!("runs/{kept}")).status, 204);
    let late = server.ask("POST", "/api/v1/comparisons", &[], &comparison(&[kept]));
    assert_eq!(late.status, 404, "{}", late.json());

    // Both together: either the comparison finds its run, or it is rejected.
    let mut both = [0, 0];
    for run in &runs[..RACES] {
        let (deleted, submitted) = std::thread::scope(|scope| {
            let deleting = scope.spawn(|| delete(&server, &format!("runs/{run}")));
            let submitted = server.ask("POST", "/api/v1/comparisons", &[], &comparison(&[run]));
            (deleting.join().expect("an answer"), submitted)
        });
        let still = server.ask("GET", &format!("/api/v1/runs/{run}"), &[], "").status;
        match (deleted.status, submitted.status) {
            (204, 404) => both[0] += 1,
            (409, 202) => {
                assert_eq!(deleted.json()["type"], "/problems/in-use");
                assert_eq!(still, 200);
                both[1] += 1;
            }
            other => panic!("{other:?}: {}", String::from_utf8_lossy(&submitted.body)),
        }
    }
    println!("of {RACES} at once: {} deleted, {} submitted", both[0], both[1]);

    // A submitted comparison finishes: its run exists.
    drop(server);
    let server = Server::start_at("127.0.0.1:0", data, &[words, &["--workers", "2"]].concat());
    let jobs = server.get("/api/v1/comparisons?limit=100");
    for job in jobs["items"].as_array().expect("a list") {
        let job = server.ended_in("comparisons", job["id"].as_str().expect("an id"));
        let expected = if job["id"] == json!(waits) { "canceled" } else { "done" };
        assert_eq!(job["status"], expected, "{job}");
    }
}

#[test]
fn scenario_what_a_job_reads_is_not_deleted_with_sqlite() {
    let scratch = Scratch::new();
    needed_stays(&scratch.path("data"), &[]);
}

#[test]
fn scenario_what_a_job_reads_is_not_deleted_with_postgres() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    needed_stays(&scratch.path("data"), &["--database-url", &postgres.url()]);
}

/// Postgres cannot store text with a zero character, SQLite can: to a client it is the same rejection as any other
/// invalid name.
#[test]
fn regress_a_zero_character_is_no_failure_of_postgres() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let words = ["--workers", "0", "--database-url", &postgres.url()];
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &words);
    for (method, path, body) in [
        ("GET", "runs/a%00b", ""),
        ("GET", "runs?name=a%00b", ""),
        ("GET", "campaigns?cursor=%00", ""),
        ("GET", "models/a%00b/history", ""),
        ("POST", "runs", r#"{"scenario":"a\u0000b"}"#),
        (
            "POST",
            "comparisons",
            r#"{"model":{"vehicle":"f550"},"flights":{"runs":["a\u0000b"]}}"#,
        ),
    ] {
        let answer = server.ask(
            method,
            &format!("/api/v1/{path}"),
            &[("content-type", "application/json")],
            body,
        );
        let is_refused = (400..500).contains(&answer.status);
        assert!(is_refused, "{method} {path}: {} {}", answer.status, answer.json());
    }
}

/// A log imported by the old server, and jobs that read it: the parts of a job count for the whole, and a deleted job leaves no trace of
/// its inputs.
#[test]
fn scenario_a_log_is_needed_until_its_last_reader_has_ended() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let mut server = Server::start(&data);
    let log = server.generated(&json!({ "preset": "healthy" }));
    assert_eq!(server.stop(), Some(0));
    let server = Server::start_at("127.0.0.1:0", &data, &["--workers", "0"]);
    let flights = json!({ "model": { "vehicle": "f550" }, "flights": { "logs": [format!("{log}@5:20")] } }).to_string();
    let readers: Vec<(&str, String)> = ["comparisons", "diagnoses", "improvements"]
        .into_iter()
        .map(|collection| {
            let answer = server.ask("POST", &format!("/api/v1/{collection}"), &[], &flights);
            assert_eq!(answer.status, 202, "{collection}: {}", answer.json());
            (collection, id(&answer))
        })
        .collect();
    for (collection, reader) in &readers {
        let refused = delete(&server, &format!("logs/{log}"));
        assert_eq!(refused.status, 409, "{collection}");
        let told: Value = refused.json();
        assert!(told["detail"].to_string().contains(reader), "{collection}: {told}");
        let path = format!("{collection}/{reader}");
        assert_eq!(
            server.ask("POST", &format!("/api/v1/{path}/cancel"), &[], "").status,
            202
        );
        assert_eq!(delete(&server, &path).status, 204);
    }
    assert_eq!(delete(&server, &format!("logs/{log}")).status, 204);
}
