//! Hosts, networks and processes that are lost silently: others soon take over their jobs, and nothing else is held up.

use rotortwin_tests::cable::Cable;
use rotortwin_tests::clock::Clock;
use rotortwin_tests::postgres::Postgres;
use rotortwin_tests::process::{Process, wait_until};
use rotortwin_tests::program::Call;
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::server::{Server, Worker};
use rustix::process::Signal;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// From the loss of a host to the next attempt at its jobs.
const RECOVERY: Duration = Duration::from_secs(30);

fn words<'a>(url: &'a str, artifacts: &'a str, rest: &[&'a str]) -> Vec<&'a str> {
    [["--database-url", url, "--artifacts", artifacts].as_slice(), rest].concat()
}

/// A flight that takes about a minute.
fn long_flight() -> Value {
    json!({ "scenario": "reference-flight", "pace": "real-time", "link": "in-process" })
}

fn wait_for(server: &Server, id: &str, limit: Duration, what: &str, is_true: impl Fn(&Value) -> bool) -> Duration {
    let mut run = Value::Null;
    let path = format!("/api/v1/runs/{id}");
    wait_until(limit, || {
        std::thread::sleep(Duration::from_millis(50));
        run = server.get(&path);
        is_true(&run)
    })
    .unwrap_or_else(|| panic!("{what}: {run}"))
}

#[test]
fn scenario_a_host_lost_within_a_transaction_keeps_no_other_job_waiting() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let (url, artifacts) = (postgres.url(), scratch.path("artifacts").display().to_string());
    let server = Server::start_at(
        "127.0.0.1:0",
        &scratch.path("server"),
        &words(&url, &artifacts, &["--workers", "0"]),
    );
    let mut lost = Worker::start(&scratch.path("lost"), &words(&url, &artifacts, &["--workers", "2"]));
    let [held, free] = [(); 2].map(|()| server.submit(&long_flight()));
    for id in [&held, &free] {
        wait_for(&server, id, RECOVERY, "begun", |run| run["status"] == "running");
    }
    // The host was lost between writing about one of its jobs and the commit: the row is locked, and its holder does not respond.
    lost.kill();
    let session = postgres.hold(&format!("UPDATE job SET claim = claim WHERE id = '{held}'"));
    let _other = Worker::start(&scratch.path("other"), &words(&url, &artifacts, &["--workers", "2"]));
    let again = |run: &Value| run["attempts"].as_i64() >= Some(2);
    wait_for(&server, &free, RECOVERY, "another host has the other job", again);
    let answer = server.ask("POST", &format!("/api/v1/runs/{held}/cancel"), &[], "");
    assert_eq!(answer.status, 503, "not now: {}", String::from_utf8_lossy(&answer.body));
    assert!(
        answer.headers.to_ascii_lowercase().contains("retry-after"),
        "{}",
        answer.headers
    );
    drop(session);
    wait_for(&server, &held, RECOVERY, "its row is free again", again);
    for id in [&held, &free] {
        assert_eq!(
            server.ask("POST", &format!("/api/v1/runs/{id}/cancel"), &[], "").status,
            202
        );
    }
}

#[test]
fn scenario_our_own_transactions_are_undone_when_their_host_is_silent() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let (url, artifacts) = (postgres.url(), scratch.path("artifacts").display().to_string());
    let server = Server::start_at(
        "127.0.0.1:0",
        &scratch.path("server"),
        &words(&url, &artifacts, &["--workers", "0"]),
    );
    let worker = Worker::start(&scratch.path("worker"), &words(&url, &artifacts, &["--workers", "8"]));
    let runs = [(); 8].map(|()| server.submit(&long_flight()));
    for id in &runs {
        wait_for(&server, id, RECOVERY, "begun", |run| run["status"] == "running");
    }
    // Stopped repeatedly until it is caught within a transaction that locks a row.
    let open = "SELECT count(*) FROM pg_stat_activity WHERE state LIKE 'idle in transaction%'";
    wait_until(RECOVERY * 2, || {
        worker.process().signal(Signal::CONT);
        std::thread::sleep(Duration::from_millis(7));
        worker.process().signal(Signal::STOP);
        std::thread::sleep(Duration::from_millis(20));
        postgres.ask(open) != "0"
    })
    .expect("it is within a transaction now and then");
    let begun = Instant::now();
    wait_until(Duration::from_secs(10), || postgres.ask(open) == "0").expect("the database undoes it");
    println!("undone after {:?}", begun.elapsed());
    worker.process().signal(Signal::CONT);
    for id in &runs {
        assert_eq!(
            server.ask("POST", &format!("/api/v1/runs/{id}/cancel"), &[], "").status,
            202
        );
    }
}

#[test]
fn scenario_a_network_cut_without_a_word() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let (url, artifacts) = (postgres.url(), scratch.path("artifacts").display().to_string());
    let server = Server::start_at(
        "127.0.0.1:0",
        &scratch.path("server"),
        &words(&url, &artifacts, &["--workers", "0"]),
    );
    let cable = Cable::to(postgres.port());
    let far = url.replace(&format!(":{}/", postgres.port()), &format!(":{}/", cable.port()));
    let mut worker = Worker::start(&scratch.path("far"), &words(&far, &artifacts, &["--workers", "1"]));
    let id = server.submit(&long_flight());
    wait_for(&server, &id, RECOVERY, "begun", |run| run["status"] == "running");
    cable.cut();
    let other = Worker::start(&scratch.path("near"), &words(&url, &artifacts, &["--workers", "1"]));
    wait_for(&server, &id, RECOVERY, "somebody else has it", |run| {
        run["attempts"] == 2
    });

    // Once mended, it works again: nothing waits on the connections that were cut.
    drop(other);
    cable.mend();
    let took = wait_for(&server, &id, Duration::from_secs(60), "it works again", |run| {
        run["attempts"] == 3
    });
    println!("works again {took:?} after the other worker was lost");

    // While cut off, it can be ended.
    cable.cut();
    std::thread::sleep(Duration::from_secs(1));
    let begun = Instant::now();
    let process = worker.process();
    process.signal(Signal::TERM);
    wait_until(Duration::from_secs(20), || !process.is_alive()).expect("it ends");
    println!("ended {:?} after SIGTERM", begun.elapsed());
    worker.kill();
}

/// What docs/server.md says of the patience of the database, as Postgres shows it: `tcp_user_timeout` in ms, the others of `tcp_*` in s.
const PROMISED: [(&str, &str); 8] = [
    ("lock_timeout", "5s"),
    ("statement_timeout", "15s"),
    ("idle_in_transaction_session_timeout", "5s"),
    ("tcp_keepalives_idle", "10"),
    ("tcp_keepalives_interval", "3"),
    ("tcp_keepalives_count", "3"),
    ("tcp_user_timeout", "10000"),
    // 202 means on disk.
    ("synchronous_commit", "on"),
];

/// Settings are those of a session, and no session sees those of another one: a trigger notes them in the sessions of the server (which
/// inserts the job) and of the worker (which takes it).
#[test]
fn scenario_connections_have_the_time_outs_that_the_manual_promises() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let (url, artifacts) = (postgres.url(), scratch.path("artifacts").display().to_string());
    let server = Server::start_at(
        "127.0.0.1:0",
        &scratch.path("server"),
        &words(&url, &artifacts, &["--workers", "0"]),
    );
    let names: Vec<String> = PROMISED.iter().map(|(name, _)| format!("('{name}')")).collect();
    postgres.ask(&format!(
        "CREATE TABLE seen (operation text, setting text, has text); \
         CREATE FUNCTION see() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN \
           INSERT INTO seen SELECT TG_OP, p.setting, current_setting(p.setting) FROM (VALUES {}) AS p (setting); RETURN NULL; END $$; \
         CREATE TRIGGER see AFTER INSERT OR UPDATE ON job FOR EACH ROW EXECUTE FUNCTION see()",
        names.join(", ")
    ));
    // A session without our settings has others, so the trigger shows those of the session.
    let usual = postgres.ask("SHOW tcp_keepalives_idle");
    assert_ne!(usual, "10");
    let seen = |operation: &str, name: &str| {
        postgres.ask(&format!(
            "SELECT string_agg(DISTINCT has, ' or ') FROM seen WHERE operation = '{operation}' AND setting = '{name}'"
        ))
    };
    let id = server.submit(&json!({ "scenario": "short-hover", "link": "in-process" }));
    for (name, expected) in PROMISED {
        assert_eq!(seen("INSERT", name), expected, "{name} of the server's connections");
    }
    let _worker = Worker::start(&scratch.path("worker"), &words(&url, &artifacts, &["--workers", "1"]));
    assert_eq!(server.ended(&id)["status"], "done");
    for (name, expected) in PROMISED {
        assert_eq!(seen("UPDATE", name), expected, "{name} of the worker's connections");
    }
}

/// Requests of every kind while Postgres stops, is down and starts: each succeeds, or is refused with 503 and a retry delay; no status
/// is an internal error.
#[test]
fn scenario_a_database_that_starts_again_is_a_pause() {
    let scratch = Scratch::new();
    let Some(mut postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let (url, artifacts) = (postgres.url(), scratch.path("artifacts").display().to_string());
    let words = words(&url, &artifacts, &["--workers", "0"]);
    let server = Server::start_at("127.0.0.1:0", &scratch.path("server"), &words);
    let id = server.submit(&long_flight());
    let run = format!("/api/v1/runs/{id}");
    let body = long_flight().to_string();
    let requests: [(&str, String, &str); 7] = [
        ("POST", "/api/v1/runs".to_owned(), &body),
        ("GET", run.clone(), ""),
        ("GET", "/api/v1/runs".to_owned(), ""),
        ("GET", "/api/v1/limits".to_owned(), ""),
        ("GET", "/api/v1/table".to_owned(), ""),
        ("GET", "/metrics".to_owned(), ""),
        ("GET", "/readyz".to_owned(), ""),
    ];
    let is_over = AtomicBool::new(false);
    let (mut answered, mut paused) = (0, 0);
    std::thread::scope(|scope| {
        let asking: Vec<_> = requests
            .iter()
            .map(|(method, path, body)| {
                let (server, is_over) = (&server, &is_over);
                scope.spawn(move || {
                    let (mut answered, mut paused) = (0, 0);
                    while !is_over.load(Ordering::Relaxed) {
                        let answer = server.ask(method, path, &[], body);
                        match answer.status {
                            200 | 202 => answered += 1,
                            503 => {
                                let head = answer.headers.to_ascii_lowercase();
                                assert!(head.contains("\r\nretry-after: "), "{path}: {head}");
                                paused += 1;
                            }
                            other => panic!("{method} {path}: {other}: {}", String::from_utf8_lossy(&answer.body)),
                        }
                    }
                    (answered, paused)
                })
            })
            .collect();
        for _ in 0..2 {
            std::thread::sleep(Duration::from_millis(700));
            postgres.kill();
            std::thread::sleep(Duration::from_millis(1500));
            postgres.up();
        }
        // All succeed again.
        std::thread::sleep(Duration::from_secs(2));
        is_over.store(true, Ordering::Relaxed);
        for asking in asking {
            let (yes, later) = asking.join().expect("no other answer");
            answered += yes;
            paused += later;
        }
    });
    println!("{answered} answers, {paused} pauses");
    assert!(answered > 0 && paused > 0, "{answered} answers, {paused} pauses");
    assert_eq!(server.get(&run)["status"], "queued");
}

/// Workers of the connection count; `ROTORTWIN_WORKERS=200` for the size of a department.
fn many_workers() -> usize {
    let wanted = std::env::var("ROTORTWIN_WORKERS").ok();
    wanted.map_or(6, |number| number.parse().expect("a number of workers"))
}

#[test]
fn scenario_workers_take_a_few_connections_whatever_they_do() {
    let scratch = Scratch::new();
    let Some(mut postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let many = many_workers();
    // Exactly the number in docs/server.md.
    postgres.ask(&format!("ALTER SYSTEM SET max_connections = {}", 4 * many + 11 + 3));
    postgres.kill();
    postgres.up();
    let (url, artifacts) = (postgres.url(), scratch.path("artifacts").display().to_string());
    let server = Server::start_at(
        "127.0.0.1:0",
        &scratch.path("server"),
        &words(&url, &artifacts, &["--workers", "0"]),
    );
    let count = || -> usize {
        let text = postgres.ask(
            "SELECT count(*) FROM pg_stat_activity WHERE backend_type = 'client backend' AND pid <> pg_backend_pid()",
        );
        text.parse().expect("a number")
    };
    let before = count();
    assert!(before <= 11, "{before} connections of an idle server");
    let workers: Vec<Worker> = (0..many)
        .map(|number| {
            let folder = scratch.path(&format!("worker-{number}"));
            Worker::start(&folder, &words(&url, &artifacts, &["--workers", "16"]))
        })
        .collect();
    let most = |begun: Instant| {
        let mut most = 0;
        while begun.elapsed() < Duration::from_secs(4) {
            most = most.max(count());
        }
        most
    };
    let idle = most(Instant::now());
    assert!(idle <= 11 + many * 4, "{idle} connections of {many} idle workers");
    let ids: Vec<String> = (0..24)
        .map(|_| server.submit(&json!({ "scenario": "short-hover", "link": "in-process", "pace": "real-time" })))
        .collect();
    let busy = most(Instant::now());
    assert!(
        busy <= 11 + many * 4,
        "{busy} connections of {many} workers with 24 jobs"
    );
    println!("{before} connections of a server, {idle} with {many} idle workers, {busy} with 24 jobs");
    for id in ids {
        let run = server.ended(&id);
        assert_eq!(run["status"], "done", "{run}");
    }
    drop(workers);
}

/// A hung worker with open connections is detected by a health check on its host.
#[test]
fn scenario_a_frozen_process_gives_no_sign_of_life() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start(&data);
    let place = format!("worker:{}", data.display());
    let health = || Call::new(&scratch, ["health", &place, "--silence", "6"]).run();
    let well = wait_until(Duration::from_secs(20), || health().code == Some(0));
    assert!(well.is_some(), "it gives signs of life");
    server.process().signal(Signal::STOP);
    let seen = wait_until(Duration::from_secs(30), || health().code == Some(1));
    let sentence = health().stderr.concat();
    server.process().signal(Signal::CONT);
    assert!(seen.is_some(), "{sentence}");
    assert!(sentence.contains("the last heartbeat is"), "{sentence}");
    let again = wait_until(Duration::from_secs(20), || health().code == Some(0));
    assert!(again.is_some(), "it goes on");
    let nobody = Call::new(&scratch, ["health", "worker:/nowhere"]).run().expect_code(1);
    assert!(nobody.stderr.concat().contains("no heartbeat"), "{:?}", nobody.stderr);
    // A check over HTTP says why, not only that.
    let nobody = Call::new(&scratch, ["health", "http://127.0.0.1:1/readyz"])
        .run()
        .expect_code(1);
    assert!(nobody.stderr.concat().contains("refused"), "{:?}", nobody.stderr);
}

/// The processes of a flight: its job's process and its children.
fn processes_of(data: &str, name: &str) -> Vec<Process> {
    let flights = Process::with_word(data);
    let jobs = flights.iter().flat_map(|process| Process::children(process.pid));
    let all = jobs.flat_map(|(job, words)| {
        let mut below = Process::children(job.pid);
        below.push((job, words));
        below
    });
    all.filter(|(_, words)| words.get(1).is_some_and(|word| word == name))
        .map(|(process, _)| process)
        .collect()
}

/// Attempts of a job that have files.
fn attempts_with_files(data: &str, id: &str) -> Vec<String> {
    let entries = std::fs::read_dir(Path::new(data).join("jobs").join(id));
    let names = entries.into_iter().flatten().flatten().map(|entry| entry.file_name());
    let mut names: Vec<String> = names.map(|name| name.to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A job killed at each attempt has failed: its last files stay, count, and are deleted with it.
#[test]
fn scenario_what_failed_attempts_leave_is_removed_or_counted() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start_at("127.0.0.1:0", &data, &["--workers", "1"]);
    let data = data.display().to_string();
    let id = server.submit(&long_flight());
    for attempt in 1..=3 {
        wait_for(&server, &id, RECOVERY, "begun", |run| run["attempts"] == attempt);
        let written = || {
            std::fs::read_dir(Path::new(&data).join(format!("jobs/{id}/{attempt}/out")))
                .is_ok_and(|mut out| out.next().is_some())
        };
        wait_until(RECOVERY, written).expect("it writes something");
        assert_eq!(attempts_with_files(&data, &id), [attempt.to_string()]);
        let found = processes_of(&data, "job");
        assert!(!found.is_empty());
        found.iter().for_each(|process| process.signal(Signal::KILL));
    }
    let run = server.ended(&id);
    assert_eq!(run["status"], "failed", "{run}");
    assert_eq!(attempts_with_files(&data, &id), ["3"]);
    let account = server.get("/api/v1/limits");
    assert!(
        run["bytes"].as_i64() > Some(0) && account["bytes"] == run["bytes"],
        "{run} {account}"
    );
    assert_eq!(server.ask("DELETE", &format!("/api/v1/runs/{id}"), &[], "").status, 204);
    assert_eq!(attempts_with_files(&data, &id), [""; 0]);
    assert_eq!(server.get("/api/v1/limits")["bytes"], 0);
}

/// The database's clock is set back by an hour: jobs due by the old clock start immediately, not an hour later.
#[test]
fn scenario_a_clock_set_back_keeps_no_job_waiting() {
    let scratch = Scratch::new();
    let Some(clock) = Clock::new(&scratch.path("")) else {
        return;
    };
    let Some(postgres) = Postgres::start_in(&clock.environment(), &scratch.path("")) else {
        return;
    };
    let (url, artifacts) = (postgres.url(), scratch.path("artifacts").display().to_string());
    let server = Server::start_at(
        "127.0.0.1:0",
        &scratch.path("server"),
        &words(&url, &artifacts, &["--workers", "0"]),
    );
    clock.set_ahead(3600);
    let ahead = postgres.ask("SELECT EXTRACT(EPOCH FROM clock_timestamp())");
    let mut lost = Worker::start(&scratch.path("lost"), &words(&url, &artifacts, &["--workers", "1"]));
    let of_lost = server.submit(&long_flight());
    wait_for(&server, &of_lost, RECOVERY, "begun", |run| run["status"] == "running");
    let stopped = Worker::start(&scratch.path("stopped"), &words(&url, &artifacts, &["--workers", "1"]));
    let of_stopped = server.submit(&long_flight());
    wait_for(&server, &of_stopped, RECOVERY, "begun", |run| {
        run["status"] == "running"
    });
    stopped.process().signal(Signal::TERM);
    wait_for(&server, &of_stopped, RECOVERY, "given back", |run| {
        run["status"] == "queued"
    });
    lost.kill();
    clock.set_ahead(0);
    let now = postgres.ask("SELECT EXTRACT(EPOCH FROM clock_timestamp())");
    let [ahead, now] = [ahead, now].map(|text| text.parse::<f64>().expect("seconds"));
    assert!(ahead - now > 3000.0, "the clock was set back: {ahead} {now}");
    let _other = Worker::start(&scratch.path("other"), &words(&url, &artifacts, &["--workers", "2"]));
    for id in [&of_stopped, &of_lost] {
        let took = wait_for(&server, id, RECOVERY, "begun again", |run| {
            run["attempts"].as_i64() >= Some(2)
        });
        println!("begun again after {took:?}");
    }
    // And forward: running jobs continue or are restarted.
    clock.set_ahead(7200);
    for id in [&of_stopped, &of_lost] {
        wait_for(&server, id, RECOVERY, "goes on", |run| run["status"] == "running");
        assert_eq!(
            server.ask("POST", &format!("/api/v1/runs/{id}/cancel"), &[], "").status,
            202
        );
    }
}

#[test]
fn scenario_a_process_killed_before_it_has_joined_costs_one_try() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start_at("127.0.0.1:0", &data, &["--workers", "1"]);
    for name in ["controller", "fdi", "job"] {
        let id = server.submit(&json!({ "scenario": "short-hover" }));
        let data = data.display().to_string();
        wait_until(Duration::from_secs(20), || {
            let found = processes_of(&data, name);
            found.iter().for_each(|process| process.signal(Signal::KILL));
            !found.is_empty()
        })
        .unwrap_or_else(|| panic!("no {name}"));
        let run = server.ended(&id);
        assert_eq!(
            (&run["status"], &run["attempts"]),
            (&json!("done"), &json!(2)),
            "{name}: {run}"
        );
        let events = server.ask("GET", &format!("/api/v1/runs/{id}/events"), &[], "");
        let events = String::from_utf8_lossy(&events.body).into_owned();
        assert_eq!(
            attempts_with_files(&data, &id),
            ["2"],
            "{name}: files of the first attempt stay"
        );
        assert!(
            events.contains("requeued") && !events.contains("silent for 0 ms"),
            "{name}: {events}"
        );
    }
}
