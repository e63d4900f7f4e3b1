//! Jobs over several processes and databases: campaigns in parts, runs whose parts fly elsewhere, an older database, random kills.

use rotortwin_links::endpoint::{PeerOptions, serve_controller};
use rotortwin_links::zenoh::ZenohOptions;
use rotortwin_proto::{ControllerSetup, Role};
use rotortwin_tests::accepted::{Accepted, nothing_lost_and_nothing_doubled, short_run, submit_for_sure};
use rotortwin_tests::postgres::Postgres;
use rotortwin_tests::process::{Process, wait_until};
use rotortwin_tests::program::{Call, Link};
use rotortwin_tests::random::Random;
use rotortwin_tests::scratch::{Scratch, repository, shipped_scenario};
use rotortwin_tests::server::{Server, Worker};
use rotortwin_wire::frames::{CommandFrame, SensorFrame};
use rotortwin_wire::link::{ControllerPeer, LinkTiming};
use rotortwin_wire::peers::PidPeer;
use rotortwin_zenoh::endpoint::ZenohEndpoint;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::time::{Duration, Instant};

/// 80 short flights in 3 parts.
const CAMPAIGN: &str = r#"
name = "parts"
description = "three parts"
scenario = "../scenarios/short-hover.toml"
seed = 5
flights = 80

[[axis]]
name = "charge"
key = "initial.state_of_charge"
uniform = [0.5, 1.0]
"#;

fn shared(scratch: &Scratch, postgres: &Postgres, rest: &[&str]) -> Vec<String> {
    let artifacts = scratch.path("artifacts").display().to_string();
    ["--database-url", &postgres.url(), "--artifacts", &artifacts]
        .iter()
        .chain(rest)
        .map(|word| (*word).to_owned())
        .collect()
}

fn words(all: &[String]) -> Vec<&str> {
    all.iter().map(String::as_str).collect()
}

#[test]
fn scenario_a_campaign_in_parts_is_the_campaign_of_the_command_line() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let id = server.submit_to("campaigns", &json!({ "text": CAMPAIGN }));
    let campaign = server.ended_in("campaigns", &id);
    assert_eq!(campaign["status"], "done", "{campaign}");
    assert_eq!(campaign["facts"]["parts"], 3, "{campaign}");
    // It starts with its first part, whichever that is, and a second time to merge them.
    assert_eq!(
        kinds(&server, &id),
        ["queued", "started", "part", "part", "part", "started", "ended"]
    );

    // The same file next to copies of the documents it names.
    let config = scratch.path("config");
    for folder in ["scenarios", "vehicles", "blades", "classifiers", "campaigns"] {
        std::fs::create_dir_all(config.join(folder)).expect("made");
        for entry in std::fs::read_dir(repository().join("config").join(folder)).expect("readable") {
            let path = entry.expect("an entry").path();
            std::fs::copy(&path, config.join(folder).join(path.file_name().expect("a name"))).expect("copied");
        }
    }
    let file = config.join("campaigns/here.toml");
    std::fs::write(&file, CAMPAIGN).expect("written");
    let out = scratch.path("here");
    let here = Call::new(
        &scratch,
        [
            "campaign".into(),
            file.into_os_string(),
            "--json".into(),
            "--out".into(),
            out.into_os_string(),
        ],
    );
    let here: Value = serde_json::from_str(&here.run().expect_code(0).stdout).expect("JSON");
    assert_eq!(campaign["result"]["hash"], here["hash"]);
    assert_eq!(campaign["result"]["flights"], 80);
    let report = server.ask("GET", &format!("/api/v1/campaigns/{id}/artifacts/report.html"), &[], "");
    assert_eq!(report.status, 200);

    for (body, words) in [
        (
            json!({ "text": CAMPAIGN.replace("../scenarios/short-hover.toml", "/etc/hostname") }),
            "is outside the library",
        ),
        (
            json!({ "text": CAMPAIGN.replace("uniform = [0.5, 1.0]", "values = [\"x\"]") }),
            "charge",
        ),
        (json!({ "text": "name = 3" }), "name"),
        (json!({ "text": "[" }), "TOML"),
        (json!({}), "expected either"),
    ] {
        let answer = server.ask("POST", "/api/v1/campaigns", &[], &body.to_string());
        let problem = answer.json();
        assert_eq!(answer.status, 422, "{problem}");
        assert!(
            problem["detail"].as_str().is_some_and(|detail| detail.contains(words)),
            "{problem}"
        );
    }
}

/// Losses that a detector with little data sometimes misses.
const CELLS: &str = r#"
name = "cells"
description = "some rotors lose a little, some much"
scenario = "../scenarios/short-hover.toml"
seed = 9
flights = 70

[set]
duration_s = 8.0
fault = [{ time_s = 5.5, rotor = 2, thrust_loss_percent = 9.0 }]
[set.fdi]
calibration_start_s = 0.75
calibration_end_s = 4.75

[[axis]]
name = "charge"
key = "initial.state_of_charge"
uniform = [0.5, 1.0]

[[axis]]
name = "rotor"
key = "fault[0].rotor"
values = [2, 5]
pick = "any"

[[axis]]
name = "loss"
key = "fault[0].thrust_loss_percent"
values = [0.1, 9.0]
pick = "any"
"#;

#[test]
fn scenario_flights_of_a_cell_are_listed_and_each_is_the_same_run() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let id = server.submit_to("campaigns", &json!({ "text": CELLS }));
    let address = format!("/api/v1/campaigns/{id}/flights");
    let campaign = server.ended_in("campaigns", &id);
    assert_eq!(campaign["status"], "done", "{campaign}");

    // Each cell of the matrix has as many windows as its flights together, page by page.
    let all = |query: &str| {
        let (mut flights, mut cursor) = (Vec::new(), String::new());
        loop {
            let page = server.get(&format!("{address}?limit=20{cursor}{query}"));
            flights.extend(page["items"].as_array().expect("flights").clone());
            match page["next"].as_str() {
                Some(next) => cursor = format!("&cursor={next}"),
                None => return flights,
            }
        }
    };
    let windows = |flights: &[Value]| flights.iter().filter_map(|one| one["windows"].as_u64()).sum::<u64>();
    for detector in ["sequential", "t_test"] {
        let score = &campaign["result"]["detectors"][detector];
        let cells = score["confusion_truth_verdict_windows"].as_array().expect("a matrix");
        assert!(cells.len() > 3, "{cells:?}");
        for cell in cells {
            let (truth, verdict) = (&cell[0], &cell[1]);
            let flights = all(&format!("&detector={detector}&truth={truth}&verdict={verdict}"));
            assert_eq!(json!(windows(&flights)), cell[2], "{detector}: {cell}");
            assert!(flights.iter().all(|one| one["windows"] != 0), "{flights:?}");
        }
    }
    let every = all("");
    let numbers: Vec<u64> = every.iter().filter_map(|one| one["flight"].as_u64()).collect();
    assert_eq!(numbers, (0..70).collect::<Vec<u64>>());
    assert_eq!(
        json!(windows(&every)),
        campaign["result"]["detectors"]["sequential"]["windows"]
    );
    assert_eq!(all("&status=failed").len(), 0);
    let two_verdicts = windows(&all("&truth=5&verdict=5,0"));
    assert_eq!(
        two_verdicts,
        windows(&all("&truth=5&verdict=5")) + windows(&all("&truth=5&verdict=0"))
    );

    // A flight of a cell, as a run: the same seed, the same samples; repeated, the same run.
    let flight = all("&truth=5&verdict=5").remove(1);
    assert_eq!(
        flight["parameters"][1],
        json!({ "axis": "rotor", "value": 5 }),
        "{flight}"
    );
    assert_eq!((&flight["faulty_rotors"], &flight["run"]), (&json!([5]), &Value::Null));
    let fly = format!("{address}/{}/run", flight["flight"]);
    let first = server.ask("POST", &fly, &[], "");
    assert_eq!(first.status, 202, "{}", first.json());
    let run = server.ended(first.json()["id"].as_str().expect("an id"));
    assert_eq!(run["run_hash"], flight["run_hash"], "{run}");
    assert_eq!(
        (run["seed"].to_string(), &run["parent"]),
        (flight["seed"].as_str().expect("digits").to_owned(), &json!(id))
    );
    let second = server.ask("POST", &fly, &[], "");
    assert_eq!((second.status, &second.json()["id"]), (200, &run["id"]));
    let there = all("&truth=5&verdict=5").remove(1);
    assert_eq!(there["run"], run["id"]);
    assert_eq!(
        server.get(&format!("/api/v1/runs?parent={id}"))["items"]
            .as_array()
            .map(Vec::len),
        Some(1)
    );

    let status = |method: &str, path: &str| server.ask(method, path, &[], "").status;
    assert_eq!(status("POST", &format!("{address}/70/run")), 404);
    assert_eq!(status("POST", &format!("{address}/x/run")), 400);
    assert_eq!(status("POST", "/api/v1/campaigns/none/flights/0/run"), 404);
    assert_eq!(status("GET", "/api/v1/campaigns/none/flights"), 404);
    for query in [
        "verdict=x",
        "truth=x",
        "detector=none",
        "limit=0",
        "limit=1001",
        "cursor=-1",
        "status=lost",
    ] {
        assert_eq!(status("GET", &format!("{address}?{query}")), 400, "{query}");
    }
    let idle = server.submit_to("campaigns", &json!({ "text": CELLS.replace("seed = 9", "seed = 8") }));
    let early = server.ask("GET", &format!("/api/v1/campaigns/{idle}/flights"), &[], "");
    assert!([200, 409].contains(&early.status), "{}", early.json());
}

/// 64 flights in two parts, each of which takes seconds.
const LONG: &str = r#"
name = "long"
description = "two long parts"
scenario = "../scenarios/short-hover.toml"
seed = 5
flights = 64
[set]
duration_s = 1000.0
"#;

/// Ids of the campaigns listed in a state.
fn listed(server: &Server, status: &str) -> Vec<String> {
    let page = server.get(&format!("/api/v1/campaigns?status={status}"));
    let items = page["items"].as_array().expect("a list");
    items
        .iter()
        .filter_map(|job| job["id"].as_str().map(str::to_owned))
        .collect()
}

fn assert_waits(server: &Server, id: &str) {
    let job = server.get(&format!("/api/v1/campaigns/{id}"));
    assert_eq!(
        (&job["status"], &job["started_ms"]),
        (&json!("queued"), &Value::Null),
        "{job}"
    );
    assert_eq!(
        (listed(server, "queued"), listed(server, "running")),
        (vec![id.to_owned()], vec![])
    );
}

/// The stream of all jobs, which has no parts, says that a campaign runs: a page that shows it as queued reads it again.
fn assert_told_to_run(server: &Server, id: &str) {
    let stream = server.send("GET", "/api/v1/events?progress=false&after=0.0", &[], "");
    let mut kind = String::new();
    let started = BufReader::new(stream).lines().find_map(|line| {
        let line = line.expect("the stream goes on until it has started");
        if let Some(text) = line.strip_prefix("event: ") {
            text.clone_into(&mut kind);
        }
        let data: Value = serde_json::from_str(line.strip_prefix("data: ")?).expect("JSON");
        (kind == "started" && data["job"] == id).then_some(data)
    });
    let started = started.expect("an event");
    assert!(started["data"]["part"].is_string(), "{started}");
    assert!(started["data"]["worker"].is_string(), "{started}");
}

/// Kinds of a campaign's own events, which has ended.
fn kinds(server: &Server, id: &str) -> Vec<String> {
    let answer = server.ask("GET", &format!("/api/v1/campaigns/{id}/events"), &[], "");
    let text = String::from_utf8_lossy(&answer.body).into_owned();
    let kinds = text.lines().filter_map(|line| line.strip_prefix("event: "));
    kinds.filter(|kind| *kind != "progress").map(str::to_owned).collect()
}

/// Waits until a campaign runs; then none of its parts is done.
fn assert_runs(server: &Server, id: &str) {
    let path = format!("/api/v1/campaigns/{id}");
    let mut job = Value::Null;
    wait_until(Duration::from_secs(60), || {
        std::thread::sleep(Duration::from_millis(10));
        job = server.get(&path);
        job["status"] != "queued"
    })
    .expect("it begins");
    assert_eq!(
        (&job["status"], &job["waits_for"]),
        (&json!("running"), &json!(2)),
        "{job}"
    );
    assert!(job["started_ms"].as_i64() >= job["submitted_ms"].as_i64(), "{job}");
    assert_told_to_run(server, id);
    assert_eq!(
        (listed(server, "queued"), listed(server, "running")),
        (vec![], vec![id.to_owned()])
    );
    // Nobody has claimed the whole, so it is canceled at once.
    let canceled = server.ask("POST", &format!("{path}/cancel"), &[], "").json();
    assert_eq!(
        (&canceled["status"], &canceled["started_ms"]),
        (&json!("canceled"), &job["started_ms"]),
        "{canceled}"
    );
    assert_eq!((listed(server, "queued"), listed(server, "running")), (vec![], vec![]));
    assert_eq!(kinds(server, id), ["queued", "started", "ended"]);
}

#[test]
fn scenario_a_campaign_runs_from_its_first_part_on() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let mut server = Server::start_at("127.0.0.1:0", &data, &["--workers", "0"]);
    let id = server.submit_to("campaigns", &json!({ "text": LONG }));
    assert_waits(&server, &id);
    assert_eq!(server.stop(), Some(0));
    let server = Server::start_at("127.0.0.1:0", &data, &["--workers", "1"]);
    assert_runs(&server, &id);
}

#[test]
fn scenario_a_campaign_runs_from_its_first_part_on_with_postgres() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let arguments = shared(&scratch, &postgres, &["--workers", "0"]);
    let server = Server::start_at("127.0.0.1:0", &scratch.path("server"), &words(&arguments));
    let id = server.submit_to("campaigns", &json!({ "text": LONG }));
    assert_waits(&server, &id);
    let arguments = shared(&scratch, &postgres, &["--workers", "1"]);
    let _worker = Worker::start(&scratch.path("worker"), &words(&arguments));
    assert_runs(&server, &id);
}

#[test]
fn scenario_a_canceled_campaign_takes_its_parts_along() {
    let scratch = Scratch::new();
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &["--workers", "0"]);
    let id = server.submit_to("campaigns", &json!({ "text": CAMPAIGN }));
    let answer = server.ask("POST", &format!("/api/v1/campaigns/{id}/cancel"), &[], "");
    assert_eq!((answer.status, &answer.json()["status"]), (202, &json!("canceled")));
    let metrics = server.ask("GET", "/metrics", &[], "");
    let text = String::from_utf8_lossy(&metrics.body).into_owned();
    assert!(
        text.contains("kind=\"campaign-shard\",status=\"canceled\"} 3"),
        "{text}"
    );
    assert_eq!(
        server.ask("DELETE", &format!("/api/v1/campaigns/{id}"), &[], "").status,
        204
    );
    let metrics = server.ask("GET", "/metrics", &[], "");
    let text = String::from_utf8_lossy(&metrics.body).into_owned();
    assert!(!text.contains("kind=\"campaign"), "{text}");
    // Times of the requests, without the names.
    let cancel = "method=\"POST\",route=\"/api/v1/campaigns/{id}/cancel\",status=\"202\"} 1";
    assert!(
        text.contains(&format!("rotortwin_request_duration_seconds_count{{{cancel}")),
        "{text}"
    );
    assert!(text.contains("rotortwin_queue_age_seconds 0\n"), "{text}");
    server.submit(&json!({ "scenario": "short-hover" }));
    std::thread::sleep(std::time::Duration::from_millis(30));
    let metrics = server.ask("GET", "/metrics?tenants=true", &[], "");
    let text = String::from_utf8_lossy(&metrics.body).into_owned();
    assert!(
        text.contains("rotortwin_tenant_jobs{tenant=\"local\",status=\"queued\"} 1"),
        "{text}"
    );
    let age = text
        .lines()
        .find_map(|line| line.strip_prefix("rotortwin_queue_age_seconds "));
    assert!(
        age.and_then(|age| age.parse().ok()).is_some_and(|age: f64| age > 0.02),
        "{text}"
    );
}

#[test]
fn scenario_parts_of_a_run_on_other_workers_give_the_same_run() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let arguments = shared(&scratch, &postgres, &["--workers", "0"]);
    let server = Server::start_at("127.0.0.1:0", &scratch.path("server"), &words(&arguments));
    let arguments = shared(&scratch, &postgres, &["--workers", "1"]);
    let _plant = Worker::start(&scratch.path("plant"), &words(&arguments));
    let arguments = shared(&scratch, &postgres, &["--roles", "controller,fdi"]);
    let _parts = Worker::start(&scratch.path("parts"), &words(&arguments));
    let id = server.submit(&json!({
        "scenario": "short-hover", "seed": 7, "link": "zenoh", "controller": "worker", "fdi": "worker"
    }));
    let run = server.ended(&id);
    assert_eq!(run["status"], "done", "{run}");
    let here = Call::fly(&scratch, Link::InProcess, &shipped_scenario("short-hover"), "here").with(["--seed", "7"]);
    assert_eq!(run["run_hash"], here.run().expect_code(0).run_hash());
    let count = |query: &str| {
        server.get(&format!("/api/v1/runs?{query}"))["items"]
            .as_array()
            .map(Vec::len)
    };
    // It ends before the detectors are calibrated.
    assert_eq!((count("verdict=-2"), count("verdict=3")), (Some(1), Some(0)), "{run}");
}

/// The FDI engine's host is there immediately, the controller's 12 s later: the plant waits, and so does the part that
/// came first.
#[test]
fn scenario_parts_of_a_run_come_one_after_the_other() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let arguments = shared(&scratch, &postgres, &["--workers", "1"]);
    let server = Server::start_at("127.0.0.1:0", &scratch.path("server"), &words(&arguments));
    let arguments = shared(&scratch, &postgres, &["--roles", "fdi"]);
    let _fdi = Worker::start(&scratch.path("fdi"), &words(&arguments));
    let id = server.submit(&json!({
        "scenario": "short-hover", "link": "zenoh", "controller": "worker", "fdi": "worker"
    }));
    std::thread::sleep(Duration::from_secs(12));
    let arguments = shared(&scratch, &postgres, &["--roles", "controller"]);
    let _controller = Worker::start(&scratch.path("controller"), &words(&arguments));
    let run = server.ended(&id);
    assert_eq!((&run["status"], &run["attempts"]), (&json!("done"), &json!(1)), "{run}");
}

#[test]
fn scenario_somebody_elses_controller_joins_with_the_ticket() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let refused = server.ask(
        "POST",
        "/api/v1/runs",
        &[],
        r#"{"scenario":"short-hover","controller":"external"}"#,
    );
    assert_eq!(refused.status, 422);
    let id = server.submit(&json!({ "scenario": "short-hover", "seed": 7, "link": "zenoh", "controller": "external" }));
    let path = format!("/api/v1/runs/{id}/ticket");
    let begun = Instant::now();
    let ticket = loop {
        let answer = server.ask("GET", &path, &[], "");
        if answer.status == 200 {
            break answer.json()["peers"][0].clone();
        }
        assert!(begun.elapsed() < Duration::from_secs(30), "{}", answer.json());
        std::thread::sleep(Duration::from_millis(20));
    };
    assert_eq!(
        (&ticket["role"], &ticket["messages"]),
        (&json!("controller"), &json!(1))
    );
    let text = |key: &str| ticket[key].as_str().expect("a text").to_owned();
    let joined = Call::new(
        &scratch,
        [
            "controller".to_owned(),
            "--link".to_owned(),
            text("link"),
            "--run-id".to_owned(),
            text("run_id"),
        ],
    );
    joined.run().expect_code(0);
    let run = server.ended(&id);
    assert_eq!(run["status"], "done", "{run}");
    assert_eq!(server.ask("GET", &path, &[], "").status, 409);
    // It was ours that joined.
    let again = server.ask("POST", &format!("/api/v1/runs/{id}/verify"), &[], "").json();
    assert_eq!((&again["same"], again.get("note")), (&json!(true), None), "{again}");

    let nobody = server.submit(&json!({
        "scenario": "short-hover", "link": "zenoh", "controller": "external", "join_timeout_ms": 300
    }));
    let run = server.ended(&nobody);
    assert_eq!(
        (&run["status"], &run["attempts"]),
        (&json!("failed"), &json!(1)),
        "{run}"
    );
    assert!(
        run["error"]
            .as_str()
            .is_some_and(|why| why.contains("controller did not join")),
        "{run}"
    );
}

/// Ours with slightly less thrust: to a verification, an external controller.
#[derive(Default)]
struct OtherController(PidPeer);

impl ControllerPeer for OtherController {
    fn setup(&mut self, setup: &ControllerSetup) -> Result<(), String> {
        self.0.setup(setup)
    }

    fn step(&mut self, sensors: &SensorFrame) -> CommandFrame {
        let mut command = self.0.step(sensors);
        for duty in &mut command.duty {
            *duty *= 0.999;
        }
        command
    }
}

/// A run flown by an external controller cannot be repeated without it: the answer says so, and is not an alarm.
#[test]
fn scenario_a_run_of_an_external_controller_is_verified_with_a_note() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let id = server.submit(&json!({ "scenario": "short-hover", "seed": 7, "link": "zenoh", "controller": "external" }));
    let begun = Instant::now();
    let ticket = loop {
        let answer = server.ask("GET", &format!("/api/v1/runs/{id}/ticket"), &[], "");
        if answer.status == 200 {
            break answer.json()["peers"][0].clone();
        }
        assert!(begun.elapsed() < Duration::from_secs(30), "{}", answer.json());
        std::thread::sleep(Duration::from_millis(20));
    };
    let text = |key: &str| ticket[key].as_str().expect("a text");
    let address = text("link")
        .strip_prefix("zenoh:connect=")
        .expect("an address")
        .to_owned();
    let run_id = u64::from_str_radix(text("run_id"), 16).expect("16 hex digits");
    let mut endpoint = ZenohEndpoint::new(Role::Controller, run_id, ZenohOptions::connect(address)).expect("it opens");
    let options = PeerOptions::new("other-controller 2.0".to_owned(), &LinkTiming::default());
    serve_controller(&mut endpoint, &mut OtherController::default(), &options).expect("it flies to the end");
    let run = server.ended(&id);
    assert_eq!(
        (&run["status"], &run["summary"]["controller"]["peer"]),
        (&json!("done"), &json!("other-controller")),
        "{run}"
    );
    let again = server.ask("POST", &format!("/api/v1/runs/{id}/verify"), &[], "").json();
    assert_eq!(again["same"], json!(false), "{again}");
    let note = again["note"].as_str().unwrap_or_default();
    assert!(
        note.contains("an external controller (other-controller") && note.contains("the hashes do not show"),
        "{again}"
    );
}

#[test]
fn val_a_database_of_the_first_version_is_copied_and_migrated() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    std::fs::create_dir_all(&data).expect("made");
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/server-version-1.sqlite");
    std::fs::copy(fixture, data.join("rotortwin.sqlite")).expect("copied");
    let server = Server::start(&data);
    let runs = server.get("/api/v1/runs");
    let runs = runs["items"].as_array().expect("runs");
    assert_eq!(runs.len(), 2, "{runs:?}");
    let done = &runs[1];
    assert_eq!(
        (&done["status"], &done["seed"], &done["vehicle"]),
        (&json!("done"), &json!(7), &json!("DJI F550"))
    );
    // The other one was queued: it is flown now.
    let id = runs[0]["id"].as_str().expect("an id");
    assert_eq!(server.ended(id)["status"], "done");
    assert!(data.join("rotortwin.sqlite.before-2").is_file());
}

/// A job of every kind, queued (one run: running) by the version in which jobs were command lines; that server was then killed.
#[test]
fn val_what_the_version_before_has_queued_is_done() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    copy_folder(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("data/queued-by-version-1"),
        &data,
    );
    let server = Server::start(&data);
    let mut jobs: BTreeMap<&str, Vec<Value>> = BTreeMap::new();
    for (collection, count) in [
        ("runs", 2),
        ("campaigns", 1),
        ("blind-benches", 1),
        ("logs", 2),
        ("comparisons", 1),
        ("diagnoses", 1),
        ("improvements", 1),
        ("classifiers", 1),
    ] {
        let page = server.get(&format!("/api/v1/{collection}"));
        let items = page["items"].as_array().expect("jobs");
        assert_eq!(items.len(), count, "{collection}: {page}");
        for item in items {
            let job = server.ended_in(collection, item["id"].as_str().expect("an id"));
            assert_eq!(job["status"], "done", "{collection}: {job}");
            jobs.entry(collection).or_default().push(job);
        }
    }
    // That program's own results.
    assert_eq!(
        jobs["campaigns"][0]["result"]["hash"],
        "a91c6e311723b897ac140aa3f55c297a"
    );
    let run = jobs["runs"]
        .iter()
        .find(|run| run["seed"] == 7)
        .expect("the one of seed 7");
    assert_eq!(run["run_hash"], "eb4637975c64b6d15f3c3b52412b323e");
    assert_eq!(
        jobs["comparisons"][0]["result"]["logs"][0]["models"][0]["model"],
        "as built --really"
    );
    assert_eq!(jobs["diagnoses"][0]["result"]["effects"][0]["instance"]["rotor"], 3);
    assert_eq!(
        jobs["classifiers"][0]["result"]["provenance"]["cross_validation"]["seeds"],
        json!([7])
    );
    let model = format!(
        "/api/v1/improvements/{}/artifacts/model.toml",
        jobs["improvements"][0]["id"].as_str().expect("an id")
    );
    assert_eq!(server.ask("GET", &model, &[], "").status, 200);
}

fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("made");
    for entry in std::fs::read_dir(from).expect("readable") {
        let path = entry.expect("an entry").path();
        let target = to.join(path.file_name().expect("a name"));
        if path.is_dir() {
            copy_folder(&path, &target);
        } else {
            std::fs::copy(&path, target).expect("copied");
        }
    }
}

#[test]
fn scenario_runs_are_filtered_by_vehicle_time_and_verdict() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let fly = |more: &[&str]| {
        let set = [
            &[
                "duration_s=8.0",
                "fdi.calibration_start_s=0.75",
                "fdi.calibration_end_s=4.75",
            ],
            more,
        ]
        .concat();
        server.ended(&server.submit(&json!({ "scenario": "short-hover", "set": set, "link": "in-process" })))
    };
    let healthy = fly(&[]);
    let damaged = fly(&["fault=[{time_s=5.5, rotor=3, thrust_loss_percent=9.0}]"]);
    assert_eq!(
        (&healthy["verdict"], &damaged["verdict"]),
        (&json!(0), &json!(3)),
        "{damaged}"
    );
    let ids = |query: &str| {
        let page = server.get(&format!("/api/v1/runs?{query}"));
        let items = page["items"].as_array().expect("runs").clone();
        items.iter().map(|run| run["id"].clone()).collect::<Vec<Value>>()
    };
    assert_eq!(ids("verdict=3"), [damaged["id"].clone()]);
    assert_eq!(ids("verdict=0"), [healthy["id"].clone()]);
    assert_eq!(ids("verdict=4"), [Value::Null; 0]);
    let at = damaged["submitted_ms"].as_i64().expect("a time");
    assert_eq!(
        ids(&format!("vehicle=DJI%20F550&from_ms={at}")),
        [damaged["id"].clone()]
    );
    assert_eq!(
        ids(&format!("vehicle=DJI%20F550&to_ms={at}&verdict=0")),
        [healthy["id"].clone()]
    );
    // Lists include it.
    assert_eq!(server.get("/api/v1/runs")["items"][0]["verdict"], 3);
    assert_eq!(server.ask("GET", "/api/v1/runs?verdict=x", &[], "").status, 400);
}

#[test]
fn scenario_a_table_of_runs() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let ids: Vec<String> = (1..=3)
        .map(|seed| server.submit(&json!({ "scenario": "short-hover", "seed": seed, "link": "in-process" })))
        .collect();
    let runs: Vec<Value> = ids.iter().map(|id| server.ended(id)).collect();
    let names = server.get("/api/v1/table");
    assert!(
        names["rows"][0]
            .as_array()
            .is_some_and(|names| names.contains(&json!("steps"))),
        "{names}"
    );
    // A column that these runs lack, but a summary can have, is empty; an impossible one is named.
    let table = server.get("/api/v1/table?columns=steps,intervals.9.position_rms_m&name=short-hover");
    let refused = server.ask("GET", "/api/v1/table?columns=steps,stesp,tracking", &[], "");
    let told = refused.json()["detail"].as_str().unwrap_or_default().to_owned();
    assert_eq!(refused.status, 422, "{told}");
    for words in ["'stesp', 'tracking'", " steps,", " tracking.position_rms_m,"] {
        assert!(told.contains(words), "{words} is not in: {told}");
    }
    let rows = table["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 3);
    for row in rows {
        let run = runs.iter().find(|run| run["id"] == row[0]).expect("one of them");
        assert_eq!(
            (&row[4], &row[5], &row[6]),
            (&run["run_hash"], &run["summary"]["steps"], &Value::Null)
        );
    }
    let csv = server.ask("GET", "/api/v1/table?columns=steps&format=csv", &[], "");
    assert_eq!(String::from_utf8_lossy(&csv.body).lines().count(), 4);
    assert_eq!(server.ask("GET", "/api/v1/table?columns=,", &[], "").status, 400);
}

/// Kills of the kill tests; `ROTORTWIN_KILLS=300` for the long ones of docs/server.md.
fn kills() -> u32 {
    std::env::var("ROTORTWIN_KILLS").map_or(12, |text| text.parse().expect("a number"))
}

#[test]
fn scenario_random_kills_with_sqlite() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let arguments = ["--workers", "2"];
    let mut server = Server::start_at("127.0.0.1:0", &data, &arguments);
    let address = server.address().to_owned();
    let mut random = Random::new(11);
    let mut accepted = Accepted::new();
    for round in 0..kills() {
        for number in 0..2 {
            let (key, seed) = (format!("{round}-{number}"), u64::from(round % 5));
            accepted.insert(key.clone(), (submit_for_sure(&address, &key, &short_run(seed)), seed));
        }
        std::thread::sleep(Duration::from_millis(random.below(400)));
        if random.below(3) == 0 {
            kill_one_of_a_run(&mut random, &data);
        } else {
            server.kill();
            server = Server::start_at(&address, &data, &arguments);
        }
    }
    nothing_lost_and_nothing_doubled(&server, &accepted);
}

/// Kills a process whose command line contains its folder: supervisor, plant, controller or FDI engine of some run.
fn kill_one_of_a_run(random: &mut Random, folder: &Path) {
    let processes: Vec<Process> = Process::with_word(&format!("{}/jobs", folder.display()));
    if !processes.is_empty() {
        let victim = random.below(processes.len() as u64);
        processes[usize::try_from(victim).expect("few")].signal(rustix::process::Signal::KILL);
    }
}

#[test]
fn scenario_random_kills_with_postgres_and_workers() {
    let scratch = Scratch::new();
    let Some(mut postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let artifacts = scratch.path("artifacts");
    let of_server = shared(&scratch, &postgres, &["--workers", "0"]);
    let of_worker = shared(&scratch, &postgres, &["--workers", "1"]);
    let mut server = Server::start_at("127.0.0.1:0", &scratch.path("server"), &words(&of_server));
    let address = server.address().to_owned();
    let folder = |number: usize| scratch.path(&format!("worker-{number}"));
    let mut workers: Vec<Worker> = (0..2)
        .map(|number| Worker::start(&folder(number), &words(&of_worker)))
        .collect();
    let mut random = Random::new(12);
    let mut accepted = Accepted::new();
    for round in 0..kills() {
        for number in 0..2 {
            let (key, seed) = (format!("{round}-{number}"), u64::from(round % 5));
            accepted.insert(key.clone(), (submit_for_sure(&address, &key, &short_run(seed)), seed));
        }
        std::thread::sleep(Duration::from_millis(random.below(400)));
        match random.below(4) {
            0 => {
                server.kill();
                server = Server::start_at(&address, &scratch.path("server"), &words(&of_server));
            }
            1 => {
                let number = usize::try_from(random.below(2)).expect("small");
                workers[number].kill();
                workers[number] = Worker::start(&folder(number), &words(&of_worker));
            }
            2 => {
                postgres.kill();
                postgres.up();
            }
            _ => kill_one_of_a_run(&mut random, &artifacts),
        }
    }
    nothing_lost_and_nothing_doubled(&server, &accepted);
}
