//! SQL over the files of jobs, through a server.

use rotortwin_tests::process::{Process, wait_until};
use rotortwin_tests::program::PATIENCE;
use rotortwin_tests::python::client_environment;
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::server::{Answer, Server};
use serde_json::{Value, json};
use std::time::Duration;

const ASK: &str = "/api/v1/queries";

fn ask(server: &Server, body: &Value) -> Answer {
    server.ask("POST", ASK, &[], &body.to_string())
}

#[test]
fn scenario_results_are_asked_where_the_server_keeps_them() {
    let Some(programs) = client_environment() else { return };
    let scratch = Scratch::new();
    let python = programs.join("python").display().to_string();
    let spill = scratch.path("spill");
    std::fs::create_dir(&spill).expect("it can be made");
    let spill = spill.display().to_string();
    let server = Server::start_in(
        &[
            ("ROTORTWIN_PYTHON", &python),
            ("TMPDIR", &spill),
            ("AWS_SECRET_ACCESS_KEY", "hush-hush"),
        ],
        "127.0.0.1:0",
        &scratch.path("data"),
        &["--query-time", "3"],
    );
    let flight = |seed: u64| server.submit(&json!({ "scenario": "short-hover", "link": "in-process", "seed": seed }));
    let ids = [flight(1), flight(2)];
    let runs = ids.each_ref().map(|id| server.ended(id));
    let other = flight(3);
    server.ended(&other);

    let sql = "SELECT folder, count(*) AS rows, max(time_s) AS last_s FROM telemetry GROUP BY folder ORDER BY folder";
    let answer = ask(&server, &json!({ "sql": sql, "runs": ids }));
    assert_eq!(answer.status, 200, "{}", answer.json());
    let answer = answer.json();
    let mut wanted = ids.clone();
    wanted.sort();
    for (row, id) in wanted.iter().enumerate() {
        assert_eq!(answer["rows"][row][0], json!(id), "{answer}");
        assert_eq!(answer["rows"][row][1], runs[0]["summary"]["steps"], "{answer}");
    }
    assert_eq!(
        (&answer["more"], answer["rows"].as_array().map(Vec::len)),
        (&json!(false), Some(2))
    );
    let few = ask(
        &server,
        &json!({ "sql": "SELECT time_s FROM telemetry", "runs": ids, "rows": 3 }),
    )
    .json();
    assert_eq!(
        (few["rows"].as_array().map(Vec::len), &few["more"]),
        (Some(3), &json!(true)),
        "{few}"
    );

    // Only the named files, and nothing of their location.
    let key = |id: &str| format!("jobs/{id}/1/out/telemetry.parquet");
    for (sql, status) in [
        (format!("SELECT * FROM read_parquet('{}')", key(&other)), 422),
        ("SELECT * FROM read_text('/etc/passwd')".to_owned(), 422),
        ("SELECT * FROM glob('*')".to_owned(), 422),
        ("COPY (SELECT 1) TO 'x.csv'".to_owned(), 422),
        ("SELECT 1; SELECT 2".to_owned(), 422),
        ("SELEC".to_owned(), 422),
        (String::new(), 422),
        ("SELECT '\0'".to_owned(), 422),
        (format!("SELECT '{}'", "x".repeat(200_000)), 422),
        (
            "SELECT count(*) FROM range(100000000000) a, range(1000000) b WHERE hash(a.range + b.range) = 7".to_owned(),
            422,
        ),
        ("SELECT length(list(range)) FROM range(300000000)".to_owned(), 422),
        ("SELECT sql FROM duckdb_views() WHERE NOT internal".to_owned(), 200),
    ] {
        let answer = ask(&server, &json!({ "sql": sql, "runs": [&ids[0]] }));
        let shown: String = sql.chars().take(80).collect();
        assert_eq!(answer.status, status, "{shown}: {}", answer.json());
        let text = answer.json().to_string();
        assert!(
            !text.contains(&scratch.folder().display().to_string()),
            "{shown}: {text}"
        );
    }
    assert!(!scratch.path("data/x.csv").exists());
    // A statement that spills to disk, from a client that does not wait for the answer: no temporary file remains.
    let large =
        "SELECT count(*) FROM (SELECT DISTINCT md5(a::VARCHAR) || md5((a + 1)::VARCHAR) FROM range(30000000) t(a))";
    let body = json!({ "sql": large, "runs": [&ids[0]] }).to_string();
    let asked = server.send("POST", ASK, &[], &body);
    let spilled = || std::fs::read_dir(&spill).expect("it is there").count();
    wait_until(PATIENCE, || spilled() > 0).expect("the query begins");
    std::thread::sleep(Duration::from_millis(700));
    let children = Process::children(server.process().pid);
    let environment = std::fs::read(format!("/proc/{}/environ", children[0].0.pid)).expect("it can be read");
    let environment = String::from_utf8_lossy(&environment);
    assert!(environment.contains("ROTORTWIN_PYTHON") && !environment.contains("hush-hush"));
    drop(asked);
    let gone = wait_until(Duration::from_secs(20), || {
        spilled() == 0 && Process::children(server.process().pid).is_empty()
    });
    assert!(gone.is_some(), "{} files stay", spilled());
    for (body, status, word) in [
        (json!({ "sql": "SELECT 1" }), 422, "expected 1 to 1000"),
        (json!({ "sql": "SELECT 1", "runs": ["nobody"] }), 404, "nobody"),
        (
            json!({ "sql": "SELECT 1", "campaigns": [&ids[0]] }),
            404,
            ids[0].as_str(),
        ),
        (json!({ "sql": "SELECT 1", "runs": ids, "rows": 0 }), 422, "`rows` is 0"),
        (json!({ "runs": ids }), 422, "sql"),
    ] {
        let answer = ask(&server, &body);
        let detail = answer.json()["detail"].as_str().unwrap_or_default().to_owned();
        assert!(
            answer.status == status && detail.contains(word),
            "{body}: {} {detail}",
            answer.status
        );
    }
}

#[test]
fn scenario_a_server_without_an_engine_says_so() {
    let scratch = Scratch::new();
    let empty = scratch.folder().display().to_string();
    let server = Server::start_in(&[("PATH", &empty)], "127.0.0.1:0", &scratch.path("data"), &[]);
    let id = server.submit(&json!({ "scenario": "short-hover", "link": "in-process" }));
    server.ended(&id);
    let answer = ask(&server, &json!({ "sql": "SELECT 1", "runs": [id] }));
    let detail = answer.json()["detail"].as_str().unwrap_or_default().to_owned();
    assert!(
        answer.status == 501 && detail.contains("pip install duckdb"),
        "{} {detail}",
        answer.status
    );
}
