//! The blind bench as a job: the same rows as from the command line, over several workers, even if one of them is lost.

use rotortwin_tests::postgres::Postgres;
use rotortwin_tests::process::{Process, wait_until};
use rotortwin_tests::program::{Call, Ended, read_json};
use rotortwin_tests::scratch::{Scratch, repository};
use rotortwin_tests::server::{Server, Worker};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::Read as _;
use std::path::Path;
use std::time::Duration;

/// Flights just long enough for the diagnosis, s.
const DURATION_S: u32 = 20;
/// Wait for something that happens by itself.
const PATIENCE: Duration = Duration::from_secs(60);

/// Rows of the same bench on this machine.
fn bench_here(scratch: &Scratch, n: u32) -> (Ended, Vec<Value>) {
    std::os::unix::fs::symlink(repository().join("config"), scratch.path("config")).expect("linked");
    let here = Call::new(scratch, bench(n))
        .with(["--out", "here"])
        .run()
        .expect_code(0);
    let rows = rows_of(&read_json(&scratch.path("here/score.json")));
    assert_eq!(rows.len(), n as usize);
    (here, rows)
}

/// The arguments of a small bench.
fn bench(n: u32) -> Vec<String> {
    let options = [
        ("--preset", "mixed".to_owned()),
        ("--n", n.to_string()),
        ("--duration-s", DURATION_S.to_string()),
    ];
    let words = options.into_iter().flat_map(|(name, value)| [name.to_owned(), value]);
    ["blind".to_owned()].into_iter().chain(words).collect()
}

fn submission(n: u32) -> Value {
    json!({ "presets": ["mixed"], "n": n, "duration_s": DURATION_S })
}

/// The rows of a score, in order, without the wall time.
fn rows_of(score: &Value) -> Vec<Value> {
    let rows = score["rows"].as_array().expect("rows");
    let timeless = |row: &Value| {
        let mut row = row.clone();
        let seconds = row.as_object_mut().and_then(|row| row.remove("seconds"));
        assert!(seconds.is_some_and(|seconds| seconds.is_number()), "{row}");
        row
    };
    rows.iter().map(timeless).collect()
}

/// The rows of a bench on a server.
fn rows_there(server: &Server, id: &str) -> Vec<Value> {
    rows_of(&server.get(&format!("/api/v1/blind-benches/{id}/artifacts/score.json")))
}

/// All events of a job that has ended.
fn events(server: &Server, id: &str) -> String {
    let mut text = String::new();
    server
        .send("GET", &format!("/api/v1/blind-benches/{id}/events"), &[], "")
        .read_to_string(&mut text)
        .expect("events");
    text
}

/// The processes that run cases for a server or worker, and the generators and diagnoses they have started.
fn benches_of(worker: Process) -> Vec<Process> {
    let benches = Process::children(worker.pid)
        .into_iter()
        .filter(|(_, words)| words.iter().any(|word| word == "job"));
    benches
        .flat_map(|(bench, _)| {
            let children = Process::children(bench.pid).into_iter().map(|(child, _)| child);
            std::iter::once(bench).chain(children).collect::<Vec<_>>()
        })
        .collect()
}

#[test]
fn scenario_a_blind_bench_over_two_workers_has_the_rows_of_the_command_line() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let id = server.submit_to("blind-benches", &submission(4));
    let job = server.ended_in("blind-benches", &id);
    assert_eq!(job["status"], "done", "{job}");
    assert_eq!(
        (&job["facts"]["cases"], &job["facts"]["parts"]),
        (&json!(4), &json!(4)),
        "{job}"
    );
    let (_, here) = bench_here(&scratch, 4);
    assert_eq!(rows_there(&server, &id), here);

    let files = server.get(&format!("/api/v1/blind-benches/{id}/artifacts"));
    let files: BTreeSet<&str> = files["items"]
        .as_array()
        .expect("files")
        .iter()
        .filter_map(|file| file["path"].as_str())
        .collect();
    for file in [
        "report.html",
        "score.json",
        "rows.parquet",
        "rows/00003.json",
        "truth/00000.json",
        "answers/00002.json",
    ] {
        assert!(files.contains(file), "{file}: {files:?}");
    }
    let events = events(&server, &id);
    for case in 0..4 {
        assert!(events.contains(&format!("\"case\":{case}")), "{events}");
    }

    for (body, status, words) in [
        (
            json!({ "n": 1, "presets": ["nonsense"] }),
            422,
            "`presets[0]`: expected one of singles, clutter",
        ),
        (json!({ "n": 0 }), 422, "`n`: is 0"),
        (json!({ "n": 10_001 }), 422, "expected at most 10000 cases"),
        (
            json!({ "n": 1, "vehicles": [{ "vehicle": "nobody" }] }),
            404,
            "there is no vehicle 'nobody'",
        ),
        (
            json!({ "n": 1, "vehicles": [{ "vehicle": "a", "text": "x = 1" }] }),
            422,
            "key `x`: unknown key",
        ),
        (
            json!({ "n": 1, "vehicles": [{ "vehicle": "a", "text": "[rotors]\nblades = '/etc/hostname'" }] }),
            422,
            "is outside the library",
        ),
        (json!({ "n": 1, "duration_s": 3601 }), 422, "`duration_s`"),
        (json!({ "n": 1, "priority": 101 }), 422, "`priority` is 101"),
    ] {
        let answer = server.ask("POST", "/api/v1/blind-benches", &[], &body.to_string());
        let problem = answer.json();
        assert_eq!(answer.status, status, "{problem}");
        assert!(
            problem["detail"].as_str().is_some_and(|detail| detail.contains(words)),
            "{problem}"
        );
    }
}

/// From a cell of the confusion matrix to its cases, to one with its truth and answer, and to its log: the one that was diagnosed.
#[test]
fn scenario_from_a_cell_of_a_bench_to_the_log_of_a_case() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let body = json!({ "presets": ["singles", "clutter"], "n": 2, "duration_s": DURATION_S, "seed": 11 });
    let id = server.submit_to("blind-benches", &body);
    let early = server.ask("GET", &format!("/api/v1/blind-benches/{id}/cases"), &[], "");
    assert!([200, 409].contains(&early.status), "{}", early.json());
    let job = server.ended_in("blind-benches", &id);
    assert_eq!(job["status"], "done", "{job}");
    let cases = |query: &str| server.get(&format!("/api/v1/blind-benches/{id}/cases?{query}"));
    let numbers = |page: &Value| -> Vec<u64> {
        let items = page["items"].as_array().expect("items");
        items.iter().filter_map(|item| item["case"].as_u64()).collect()
    };

    // Every case is in the cell that the matrix counts it in, and in no other.
    let mut seen = Vec::new();
    for cell in job["result"]["confusion"].as_array().expect("a matrix") {
        let [hidden, named] = [0, 1].map(|k| {
            cell[k]
                .as_str()
                .expect("a word")
                .replace(' ', "%20")
                .replace('+', "%2B")
        });
        let page = cases(&format!("hidden={hidden}&named={named}"));
        assert_eq!(
            numbers(&page).len() as u64,
            cell[2].as_u64().expect("a count"),
            "{cell}: {page}"
        );
        seen.extend(numbers(&page));
    }
    seen.sort_unstable();
    assert_eq!(seen, [0, 1, 2, 3]);
    let mut paged = Vec::new();
    let mut cursor = "0".to_owned();
    loop {
        let page = cases(&format!("limit=3&cursor={cursor}"));
        paged.extend(numbers(&page));
        match page["next"].as_str() {
            Some(next) => cursor = next.to_owned(),
            None => break,
        }
    }
    assert_eq!(paged, [0, 1, 2, 3]);
    assert_eq!(numbers(&cases("preset=clutter")), [2, 3]);
    assert_eq!(numbers(&cases("hidden=no-such-effect")), Vec::<u64>::new());
    assert_eq!(
        server
            .ask("GET", &format!("/api/v1/blind-benches/{id}/cases?limit=0"), &[], "")
            .status,
        400
    );
    assert_eq!(
        server
            .ask("GET", &format!("/api/v1/blind-benches/{id}/cases/4"), &[], "")
            .status,
        404
    );
    assert_eq!(
        server
            .ask("POST", &format!("/api/v1/blind-benches/{id}/cases/4/log"), &[], "")
            .status,
        404
    );

    // With clutter: the generator's random draws are repeated from its seed.
    for number in [0, 2] {
        let address = format!("/api/v1/blind-benches/{id}/cases/{number}");
        let case = server.get(&address);
        assert_eq!(case["truth"]["effects"], case["effects"], "{case}");
        assert_eq!(case["log"], Value::Null);
        let answer = server.ask("POST", &format!("{address}/log"), &[], "");
        assert_eq!(answer.status, 202, "{}", answer.json());
        let log = answer.json()["id"].as_str().expect("an id").to_owned();
        let done = server.ended_in("logs", &log);
        assert_eq!(
            (&done["status"], &done["parent"]),
            (&json!("done"), &json!(id)),
            "{done}"
        );
        let again = server.ask("POST", &format!("{address}/log"), &[], "");
        assert_eq!((again.status, again.json()["id"].as_str()), (200, Some(log.as_str())));
        assert_eq!(server.get(&address)["log"], log.as_str());
        assert_eq!(
            server.get(&format!("/api/v1/logs/{log}/truth"))["effects"],
            case["effects"]
        );

        let twin = json!({ "model": { "vehicle": "f550" }, "flights": { "logs": [log] } });
        let found = server.submit_to("diagnoses", &twin);
        let found = &server.ended_in("diagnoses", &found)["result"];
        let before = &case["diagnosis"];
        for key in ["verdict", "effects", "sensor_or_timing"] {
            assert_eq!(
                without_names(&found[key]),
                without_names(&before[key]),
                "case {number}, {key}"
            );
        }
    }
}

/// A part of a diagnosis without the fields named after the file.
fn without_names(part: &Value) -> Value {
    let mut part = part.clone();
    fn strip(value: &mut Value) {
        match value {
            Value::Object(map) => {
                map.remove("picture");
                map.remove("log");
                map.values_mut().for_each(strip);
            }
            Value::Array(list) => list.iter_mut().for_each(strip),
            _ => {}
        }
    }
    strip(&mut part);
    part
}

#[test]
fn scenario_a_worker_killed_in_mid_bench_loses_nothing() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let (url, artifacts) = (postgres.url(), scratch.path("artifacts").display().to_string());
    let shared = ["--database-url", &url, "--artifacts", &artifacts, "--workers"];
    let server = Server::start_at("127.0.0.1:0", &scratch.path("server"), &[&shared[..], &["0"]].concat());
    let worker = |name: &str| Worker::start(&scratch.path(name), &[&shared[..], &["1"]].concat());
    let (mut victim, _other) = (worker("one"), worker("two"));
    let id = server.submit_to("blind-benches", &submission(6));
    let mut orphans = Vec::new();
    wait_until(PATIENCE, || {
        orphans = benches_of(victim.process());
        // The bench itself, and a generator or diagnosis.
        orphans.len() > 1
    })
    .expect("the worker does a case");
    victim.kill();
    let gone = wait_until(PATIENCE, || orphans.iter().all(|process| !process.is_alive()));
    assert!(
        gone.is_some_and(|time| time < Duration::from_secs(2)),
        "none outlives its worker: {gone:?}"
    );

    let job = server.ended_in("blind-benches", &id);
    assert_eq!(job["status"], "done", "{job}");
    assert_eq!(rows_there(&server, &id), bench_here(&scratch, 6).1);
    assert_eq!(events(&server, &id).matches("event: ended").count(), 1);
}

#[test]
fn scenario_a_canceled_blind_bench_ends() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let id = server.submit_to("blind-benches", &json!({ "n": 100 }));
    let mut working = Vec::new();
    wait_until(PATIENCE, || {
        working = benches_of(server.process());
        working.len() > 1
    })
    .expect("the workers do cases");
    let answer = server.ask("POST", &format!("/api/v1/blind-benches/{id}/cancel"), &[], "");
    assert_eq!((answer.status, &answer.json()["status"]), (202, &json!("canceled")));
    let gone = wait_until(PATIENCE, || {
        working.iter().all(|process| !process.is_alive()) && benches_of(server.process()).is_empty()
    });
    assert!(gone.is_some_and(|time| time < Duration::from_secs(5)), "{gone:?}");
    // 50 parts: most were queued, and the running ones have ended like the rest.
    let parts = || {
        let metrics = server.ask("GET", "/metrics", &[], "");
        String::from_utf8_lossy(&metrics.body).into_owned()
    };
    wait_until(PATIENCE, || {
        !parts().contains("kind=\"blind-bench-shard\",status=\"running\"}")
    })
    .unwrap_or_else(|| panic!("{}", parts()));
    assert!(
        parts().contains("kind=\"blind-bench-shard\",status=\"canceled\"}"),
        "{}",
        parts()
    );
    assert!(
        !parts().contains("kind=\"blind-bench-shard\",status=\"queued\"}"),
        "{}",
        parts()
    );
    let before = events(&server, &id);
    assert_eq!(before.matches("event: ended").count(), 1, "{before}");
    assert!(
        before
            .trim_end()
            .rsplit("event: ")
            .next()
            .is_some_and(|last| last.starts_with("ended")),
        "{before}"
    );
}

/// Output that must be the same from both machines.
fn sheet(ended: &Ended) -> Vec<&str> {
    let same = |line: &&str| !line.trim_start().starts_with("seconds") && !line.starts_with("Report:");
    ended.stdout.lines().filter(same).collect()
}

#[test]
fn scenario_a_blind_bench_elsewhere_prints_and_leaves_what_it_leaves_here() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let (here, rows) = bench_here(&scratch, 4);
    let remote = |words: &[&str]| Call::new(&scratch, ["--server", &server.url()]).with(words.iter().copied());
    let there = remote(&[]).with(bench(4)).with(["--out", "there"]).run().expect_code(0);
    assert_eq!(sheet(&there), sheet(&here));
    assert!(
        there.stdout.ends_with("Report: there/report.html\n"),
        "{}",
        there.stdout
    );
    assert_eq!(rows_of(&read_json(&scratch.path("there/score.json"))), rows);
    assert_eq!(names(&scratch.path("there")), names(&scratch.path("here")));

    // A vehicle that the server lacks, with its blades elsewhere.
    let text = |path: &str| std::fs::read_to_string(repository().join("config").join(path)).expect("readable");
    scratch.write("blades of mine.toml", text("blades/t9545.toml"));
    let mine = text("vehicles/f550.toml").replace("../blades/t9545.toml", "blades of mine.toml");
    scratch.write("Mine.toml", mine);
    let own = remote(&[])
        .with(bench(4))
        .with(["--vehicles", "Mine.toml", "--out", "own", "--json"]);
    let groups: Value = serde_json::from_str(&own.run().expect_code(0).stdout).expect("JSON");
    assert!(groups["groups"].is_array(), "{groups}");
    let named = |mut row: Value| {
        row["case"]["vehicle"] = json!("");
        row
    };
    let own = rows_of(&read_json(&scratch.path("own/score.json")));
    assert_eq!(own[0]["case"]["vehicle"], "config/vehicles/mine.toml");
    // The same numbers in other files are the same vehicle.
    assert_eq!(
        own.into_iter().map(named).collect::<Vec<_>>(),
        rows.into_iter().map(named).collect::<Vec<_>>()
    );

    let listed = remote(&["blind-benches", "list", "--json"]).run().expect_code(0);
    let listed: Value = serde_json::from_str(&listed.stdout).expect("JSON");
    assert_eq!(
        (&listed[1]["name"], &listed[1]["status"]),
        (&json!("mixed"), &json!("done"))
    );
    for (words, sentence) in [
        (&["blind", "--jobs", "2"][..], "--jobs"),
        (&["blind", "--n", "0"], "n: is 0"),
        (&["blind", "--vehicles", "nobody.toml"], "nobody.toml"),
        (&["blind", "--out", "there"], "is not empty"),
        (&["blind", "effects"], "on this machine only"),
    ] {
        let refused = remote(words).run().expect_code(2);
        assert!(refused.stderr[0].contains(sentence), "{words:?}: {:?}", refused.stderr);
    }
}

/// The files below a folder.
fn names(folder: &Path) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for entry in std::fs::read_dir(folder).expect("readable") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        if path.is_dir() {
            names.extend(self::names(&path).into_iter().map(|below| format!("{name}/{below}")));
        } else {
            names.insert(name);
        }
    }
    names
}
