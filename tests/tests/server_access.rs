//! Access to a server: tokens, scopes, tenants, HTTPS, limits.

use rotortwin_tests::process::wait_until;
use rotortwin_tests::program::Call;
use rotortwin_tests::scratch::{Scratch, repository};
use rotortwin_tests::server::Server;
use serde_json::{Value, json};
use std::path::Path;
use std::time::Duration;

const HOVER: &str = r#"{"scenario":"short-hover","link":"in-process"}"#;

fn token(scratch: &Scratch, data: &Path, more: &[&str]) -> String {
    let data = data.display().to_string();
    let words: Vec<&str> = ["token", "create", "--data", &data]
        .iter()
        .chain(more)
        .copied()
        .collect();
    Call::new(scratch, words).run().expect_code(0).stdout.trim().to_owned()
}

/// Method, address, body; returns the status and the problem or answer.
fn ask(server: &Server, token: &str, method: &str, path: &str, body: &str) -> (u16, Value) {
    let bearer = format!("Bearer {token}");
    let headers: &[(&str, &str)] = if token.is_empty() {
        &[]
    } else {
        &[("authorization", &bearer)]
    };
    let answer = server.ask(method, path, headers, body);
    (answer.status, serde_json::from_slice(&answer.body).unwrap_or_default())
}

#[test]
fn scenario_tokens_say_who_may_do_what_on_whose_account() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start(&data);
    let before = ask(&server, "", "POST", "/api/v1/runs", HOVER);
    assert_eq!(before.0, 202, "without tokens, this host may do everything");

    // From the first token on, everyone needs one; the server keeps running.
    let reader = token(&scratch, &data, &["reader", "--tenant", "a", "--scopes", "read"]);
    let writer = token(&scratch, &data, &["writer", "--tenant", "a"]);
    let other = token(&scratch, &data, &["other", "--tenant", "b"]);
    let admin = token(&scratch, &data, &["admin", "--scopes", "admin"]);
    for path in ["/api/v1/runs", "/metrics", "/api/v1/scenarios"] {
        assert_eq!(ask(&server, "", "GET", path, "").0, 401, "{path}");
    }
    // The page, which prompts for a token, reveals nothing of anyone's work.
    for path in ["/healthz", "/readyz", "/api/v1/openapi.json"] {
        assert_eq!(ask(&server, "", "GET", path, "").0, 200, "{path}");
    }
    for nonsense in ["rtw_x_y", &writer[..writer.len() - 1], &format!("{writer}0")] {
        let (status, problem) = ask(&server, nonsense, "GET", "/api/v1/runs", "");
        assert_eq!(status, 401, "{problem}");
    }
    let (status, problem) = ask(&server, &reader, "POST", "/api/v1/runs", HOVER);
    assert_eq!(status, 403);
    assert!(
        problem["detail"]
            .as_str()
            .is_some_and(|detail| detail.contains("`write`")),
        "{problem}"
    );

    let (status, run) = ask(&server, &writer, "POST", "/api/v1/runs", HOVER);
    assert_eq!((status, &run["tenant"]), (202, &json!("a")));
    let path = format!("/api/v1/runs/{}", run["id"].as_str().expect("an id"));
    assert_eq!(ask(&server, &reader, "GET", &path, "").0, 200);
    // Another account's items look as if they did not exist, whatever the request.
    for (method, more) in [
        ("GET", ""),
        ("DELETE", ""),
        ("POST", "/cancel"),
        ("GET", "/events"),
        ("GET", "/artifacts"),
    ] {
        let (status, problem) = ask(&server, &other, method, &format!("{path}{more}"), "");
        assert_eq!(status, 404, "{method} {more}: {problem}");
    }
    let items = |token: &str| {
        ask(&server, token, "GET", "/api/v1/runs", "").1["items"]
            .as_array()
            .map(Vec::len)
    };
    assert_eq!(
        (items(&reader), items(&other), items(&admin)),
        (Some(1), Some(0), Some(2))
    );

    // The same key of two tenants gives two runs.
    for token in [&writer, &other] {
        let bearer = format!("Bearer {token}");
        let headers = [("authorization", bearer.as_str()), ("idempotency-key", "night")];
        assert_eq!(server.ask("POST", "/api/v1/runs", &headers, HOVER).status, 202);
    }

    let id = writer.split('_').nth(1).expect("an id").to_owned();
    let data = data.display().to_string();
    let revoke = || Call::new(&scratch, ["token", "revoke", &id, "--data", &data]).run();
    revoke().expect_code(0);
    revoke().expect_code(2);
    assert_eq!(ask(&server, &writer, "GET", &path, "").0, 401);
    let list = Call::new(&scratch, ["token", "list", "--data", &data])
        .run()
        .expect_code(0)
        .stdout;
    assert!(list.contains("revoked") && list.contains("reader"), "{list}");
    // A query where there is no server creates no database.
    let elsewhere = scratch.path("elsewhere");
    let asked = Call::new(&scratch, ["token", "list", "--data", &elsewhere.display().to_string()])
        .run()
        .expect_code(2);
    assert!(asked.stderr.concat().contains("DATABASE_URL"), "{:?}", asked.stderr);
    assert!(!elsewhere.exists());
    let secret = reader.rsplit('_').next().expect("a secret");
    assert!(!list.contains(secret));
    let database = std::fs::read(Path::new(&data).join("rotortwin.sqlite")).expect("readable");
    let log = std::fs::read(Path::new(&data).join("rotortwin.sqlite-wal")).unwrap_or_default();
    for bytes in [database, log] {
        assert!(
            !bytes.windows(secret.len()).any(|window| window == secret.as_bytes()),
            "the secret is stored"
        );
    }
}

#[test]
fn scenario_the_same_key_is_the_same_job_whatever_has_changed() {
    let scratch = Scratch::new();
    let server = Server::start_at(
        "127.0.0.1:0",
        &scratch.path("data"),
        &["--workers", "0", "--tenant-jobs", "4"],
    );
    let scenarios = repository().join("config/scenarios");
    let text = std::fs::read_to_string(scenarios.join("short-hover.toml")).expect("readable");
    let toml = [("content-type", "application/toml")];
    assert_eq!(server.ask("PUT", "/api/v1/scenarios/mine", &toml, &text).status, 201);
    let ask = |path: &str, key: &str, body: &str| {
        let answer = server.ask("POST", path, &[("idempotency-key", key)], body);
        (answer.status, answer.json())
    };
    let body = r#"{"scenario":"mine","link":"in-process"}"#;
    let (status, run) = ask("/api/v1/runs", "night", body);
    assert_eq!(status, 202, "{run}");
    let id = run["id"].as_str().expect("an id").to_owned();
    let fork = format!("/api/v1/runs/{id}/fork");
    let (status, forked) = ask(&fork, "fork", r#"{"healthy":true}"#);
    assert_eq!(status, 202, "{forked}");
    let log = |key: &str| {
        let headers = [("idempotency-key", key), ("content-type", "application/octet-stream")];
        server.ask(
            "POST",
            "/api/v1/logs?name=a.csv&vehicle=f550",
            &headers,
            "time_s,roll_rad\n0,0\n",
        )
    };
    let uploaded = log("log");
    assert_eq!(uploaded.status, 202);
    let uploaded = uploaded.json()["id"].as_str().expect("an id").to_owned();
    let import = format!("/api/v1/logs/{uploaded}/import");
    let (status, imported) = ask(&import, "import", r#"{"damaged":true}"#);
    assert_eq!(status, 202, "{imported}");

    // The account is full, and the scenario, the run it was forked from and the first log are gone.
    assert_eq!(ask("/api/v1/runs", "another", body).0, 429);
    assert_eq!(server.ask("DELETE", "/api/v1/scenarios/mine", &[], "").status, 204);
    assert_eq!(
        server.ask("POST", &format!("/api/v1/runs/{id}/cancel"), &[], "").status,
        202
    );
    let (status, again) = ask("/api/v1/runs", "night", body);
    assert_eq!((status, &again["id"]), (200, &run["id"]), "{again}");
    assert_eq!(ask("/api/v1/runs", "night", HOVER).0, 409, "another body");
    assert_eq!(server.ask("DELETE", &format!("/api/v1/runs/{id}"), &[], "").status, 204);
    let (status, again) = ask(&fork, "fork", r#"{"healthy":true}"#);
    assert_eq!((status, &again["id"]), (200, &forked["id"]), "{again}");
    assert_eq!(log("log").status, 200);
    assert_eq!(
        server
            .ask("POST", &format!("/api/v1/logs/{uploaded}/cancel"), &[], "")
            .status,
        202
    );
    assert_eq!(
        server
            .ask("DELETE", &format!("/api/v1/logs/{uploaded}"), &[], "")
            .status,
        204
    );
    let (status, again) = ask(&import, "import", r#"{"damaged":true}"#);
    assert_eq!((status, &again["id"]), (200, &imported["id"]), "{again}");
}

#[test]
fn scenario_limits_are_said_in_one_sentence() {
    let scratch = Scratch::new();
    let limits = [
        "--workers",
        "0",
        "--tenant-jobs",
        "2",
        "--longest-flight",
        "60",
        "--rate",
        "20",
    ];
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &limits);
    let submit = |body: &str| {
        let answer = server.ask("POST", "/api/v1/runs", &[], body);
        (
            answer.status,
            answer.json()["detail"].as_str().unwrap_or_default().to_owned(),
        )
    };
    let long = submit(r#"{"scenario":"short-hover","set":["duration_s=61"]}"#);
    assert!(long.0 == 422 && long.1.contains("at most 60 s"), "{long:?}");
    let own = submit(r#"{"scenario":"short-hover","max_sim_s":1}"#);
    assert!(own.0 == 422 && own.1.contains("max_sim_s"), "{own:?}");
    assert_eq!((submit(HOVER).0, submit(HOVER).0), (202, 202));
    let third = submit(HOVER);
    assert!(
        third.0 == 429 && third.1.contains("2 jobs queued or running"),
        "{third:?}"
    );
    let mut last = server.ask("GET", "/api/v1/scenarios", &[], "");
    for _ in 0..100 {
        if last.status == 429 {
            break;
        }
        last = server.ask("GET", "/api/v1/scenarios", &[], "");
    }
    assert!(
        last.status == 429 && last.headers.to_ascii_lowercase().contains("retry-after"),
        "{}",
        last.headers
    );
    assert_eq!(
        server.ask("GET", "/healthz", &[], "").status,
        200,
        "a watchdog is always answered"
    );
}

/// A read-only token gets no ticket, which would allow flying.
#[test]
fn scenario_a_ticket_is_for_those_who_may_write() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start(&data);
    let reader = token(&scratch, &data, &["reader", "--tenant", "a", "--scopes", "read"]);
    let writer = token(&scratch, &data, &["writer", "--tenant", "a"]);
    let external = r#"{"scenario":"short-hover","link":"zenoh","controller":"external"}"#;
    let (status, run) = ask(&server, &writer, "POST", "/api/v1/runs", external);
    assert_eq!(status, 202, "{run}");
    let path = format!("/api/v1/runs/{}", run["id"].as_str().expect("an id"));
    let ticket = format!("{path}/ticket");
    wait_until(Duration::from_secs(30), || {
        ask(&server, &writer, "GET", &ticket, "").0 == 200
    })
    .expect("the plant waits");
    let (status, problem) = ask(&server, &reader, "GET", &ticket, "");
    assert_eq!(status, 403, "{problem}");
    assert!(problem["detail"].to_string().contains("`write`"), "{problem}");
    assert_eq!(ask(&server, &reader, "GET", &path, "").0, 200, "it may look");
    assert_eq!(ask(&server, &writer, "POST", &format!("{path}/cancel"), "").0, 202);
}

/// One account uses up its share of the FDI sessions, and another one can still open one.
#[test]
fn scenario_fdi_sessions_are_shared_by_the_accounts() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let words = ["--workers", "0", "--fdi-sessions", "5", "--tenant-fdi-sessions", "2"];
    let server = Server::start_at("127.0.0.1:0", &data, &words);
    let vehicle = r#"{"vehicle":"f550"}"#;
    let open = |token: &str| ask(&server, token, "POST", "/api/v1/fdi/sessions", vehicle);
    // Without tokens there is one account, which owns all sessions.
    let mut mine: Vec<String> = (0..5)
        .map(|_| {
            let (status, told) = open("");
            assert_eq!(status, 201, "{told}");
            told["session"]["id"].as_str().expect("an id").to_owned()
        })
        .collect();
    assert_eq!(open("").0, 429, "the caller has them all");
    let admin = token(&scratch, &data, &["admin", "--scopes", "admin"]);
    for _ in 0..4 {
        let path = format!("/api/v1/fdi/sessions/{}", mine.pop().expect("four"));
        assert!(ask(&server, &admin, "DELETE", &path, "").0 < 300);
    }
    let [a, b] = ["a", "b"].map(|tenant| token(&scratch, &data, &[tenant, "--tenant", tenant]));
    let (_, first) = open(&a);
    assert_eq!(open(&a).0, 201);
    let (status, problem) = open(&a);
    assert_eq!(status, 429, "{problem}");
    assert!(
        problem["detail"]
            .to_string()
            .contains("'a' has 2 FDI sessions open, the limit per tenant"),
        "{problem}"
    );
    assert_eq!((open(&b).0, open(&b).0), (201, 201), "the others' are not gone");
    // A closed session frees its place.
    assert_eq!(open(&b).0, 429);
    let path = format!(
        "/api/v1/fdi/sessions/{}",
        first["session"]["id"].as_str().expect("an id")
    );
    assert!(ask(&server, &a, "DELETE", &path, "").0 < 300);
    assert_eq!(open(&a).0, 201);
}
