//! Autopilots listed by a server's operator, and comparison of controllers; the autopilot is a scripted peer.

#[expect(dead_code, reason = "restarts are a matter of the link's own tests")]
#[path = "../../services/bridge/tests/leveller/mod.rs"]
mod leveller;
#[path = "../../services/bridge/tests/px4_estimate/mod.rs"]
mod px4_estimate;
mod scripted_ardupilot;
mod scripted_betaflight;
mod scripted_pilot;
mod scripted_px4;

use rotortwin_scenario::Scenario;
use rotortwin_tests::postgres::Postgres;
use rotortwin_tests::process::wait_until;
use rotortwin_tests::program::{Call, Ended, PATIENCE, read_json, text};
use rotortwin_tests::scratch::{Scratch, repository};
use rotortwin_tests::server::{Server, Worker};
use rotortwin_tests::skip;
use scripted_ardupilot::{ROTOR_OF_CHANNEL, ScriptedArduPilot};
use scripted_betaflight::ScriptedBetaflight;
use serde_json::{Value, json};
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Seconds after the hand-over, and the damage.
const FLIGHT: &str = r#"
name = "autopilot"
description = "a hover from the ground"
vehicle = "../vehicles/f550-skids.toml"
duration_s = 16.0
[initial]
start = "on-ground"
[trajectory]
kind = "hover"
position_ned_m = [0.0, 0.0, -1.5]
[ground]
down_m = 0.0
[ground.contact]
[[fault]]
time_s = 12.0
rotor = 3
thrust_loss_percent = 10.0
"#;

fn scenario() -> Scenario {
    Scenario::parse(FLIGHT, repository().join("config/scenarios")).expect("a good scenario")
}

/// A free UDP port of this host.
fn free_address() -> SocketAddr {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a free port");
    socket.local_addr().expect("it is bound")
}

fn listed(name: &str, at: SocketAddr) -> String {
    format!("{name}=ardupilot:{at},pilot=none")
}

fn flight(name: &str) -> Value {
    json!({ "text": FLIGHT, "controller": { "autopilot": name } })
}

fn detail(server: &Server, body: &Value) -> String {
    let answer = server.ask("POST", "/api/v1/runs", &[], &body.to_string());
    assert_eq!(answer.status, 422, "{}", answer.json());
    answer.json()["detail"].as_str().expect("a sentence").to_owned()
}

fn autopilot(server: &Server, name: &str) -> Value {
    let all = server.get("/api/v1/autopilots");
    let items = all["items"].as_array().expect("a list");
    items
        .iter()
        .find(|one| one["name"] == name)
        .expect("it is listed")
        .clone()
}

#[test]
fn scenario_runs_name_an_autopilot_and_have_it_one_after_the_other() {
    let scratch = Scratch::new();
    let at = free_address();
    let more = ["--workers", "3", "--autopilot", &listed("bench-1", at)];
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &more);
    let state = autopilot(&server, "bench-1");
    assert_eq!(
        (&state["kind"], &state["lockstep"], &state["state"], &state["version"]),
        (&json!("ardupilot"), &json!(true), &json!("free"), &Value::Null)
    );
    let ids = [server.submit(&flight("bench-1")), server.submit(&flight("bench-1"))];
    // No flight yet: one waits for the autopilot, the other for the first.
    let busy = wait_until(PATIENCE, || autopilot(&server, "bench-1")["state"] == "busy");
    assert!(busy.is_some());
    let first = autopilot(&server, "bench-1")["run"]
        .as_str()
        .expect("its own run")
        .to_owned();
    let second = ids.iter().find(|id| **id != first).expect("one of the two");
    let waiting = server.get(&format!("/api/v1/runs/{second}"));
    assert_eq!(waiting["status"], "queued", "{waiting}");
    assert_eq!(
        waiting["waits_because"],
        format!("the autopilot 'bench-1' is busy with run {first}")
    );
    // Other runs are not held up.
    let other = server.submit(&json!({ "scenario": "short-hover", "link": "in-process" }));
    assert_eq!(server.ended(&other)["status"], "done");

    let peer = ScriptedArduPilot::start(at, &scenario(), 1.5);
    let [one, two] = ids.each_ref().map(|id| server.ended(id));
    for run in [&one, &two] {
        assert_eq!(run["status"], "done", "{run}");
        assert_eq!(run["attempts"], 1);
        assert_eq!(
            (&run["link"], &run["controller"]),
            (&json!("in-process"), &json!({ "autopilot": "bench-1" }))
        );
        let who = &run["summary"]["controller"];
        assert!(
            who["peer"]
                .as_str()
                .is_some_and(|peer| peer.starts_with("ArduPilot at 127.0.0.1:")),
            "{who}"
        );
        assert_eq!(who["lockstep"], true);
    }
    let begun = |run: &Value| run["started_ms"].as_i64().expect("a time");
    let ended = |run: &Value| run["finished_ms"].as_i64().expect("a time");
    assert!(begun(&one) >= ended(&two) || begun(&two) >= ended(&one), "{one} {two}");
    assert!(peer.answered() > 2 * 16_000, "{}", peer.answered());
    let state = autopilot(&server, "bench-1");
    assert_eq!((&state["state"], &state["run"]), (&json!("free"), &Value::Null));
    assert!(state["flown_ms"].is_i64(), "{state}");

    // Replayed from the autopilot's recorded packets, without it.
    drop(peer);
    let answer = server.ask("POST", &format!("/api/v1/runs/{}/verify", ids[0]), &[], "");
    assert_eq!(answer.status, 200, "{}", answer.json());

    // Compared with our own controller.
    let own = server.submit(&json!({ "text": FLIGHT.replace("on-ground", "trimmed"), "link": "in-process" }));
    assert_eq!(server.ended(&own)["status"], "done");
    let table = server.get(&format!("/api/v1/controllers?runs={own},{}&within_m=0.3", ids[0]));
    assert_eq!(table["differences"], json!([]), "{table}");
    let rows = table["rows"].as_array().expect("rows");
    assert_eq!(
        (rows.len(), &rows[0]["controller"]),
        (2, &json!("rotortwin-controller")),
        "{table}"
    );
    for row in rows {
        let number = |path: &str| {
            row.pointer(path)
                .and_then(Value::as_f64)
                .unwrap_or_else(|| panic!("{path}: {row}"))
        };
        assert!((0.0..0.3).contains(&number("/position_m/rms")), "{row}");
        // 16 s of hover of this vehicle at some 150 to 250 W.
        assert!((0.4..1.4).contains(&number("/energy_wh")), "{row}");
        assert!((0.0..3.0).contains(&number("/fault/isolated_after_s")), "{row}");
        assert!(
            number("/fault/detected_after_s") <= number("/fault/isolated_after_s"),
            "{row}"
        );
        assert_eq!(
            (&row["fault"]["right_at_end"], &row["false_alarms"]),
            (&json!(true), &json!(0)),
            "{row}"
        );
        assert!(number("/fault/recovered_after_s") >= 0.0);
    }
    for (query, status, words) in [
        ("runs=", 422, "names 0 runs"),
        ("runs=nothing", 404, "no run nothing"),
        (&format!("runs={own}&within_m=-1"), 400, "within_m"),
    ] {
        let answer = server.ask("GET", &format!("/api/v1/controllers?{query}"), &[], "");
        assert_eq!(answer.status, status, "{}", answer.json());
        assert!(
            answer.json()["detail"]
                .as_str()
                .is_some_and(|detail| detail.contains(words)),
            "{}",
            answer.json()
        );
    }
}

#[test]
fn scenario_addresses_are_not_taken_from_requests() {
    let scratch = Scratch::new();
    let more = ["--workers", "1", "--autopilot", &listed("bench-1", free_address())];
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &more);
    let address = detail(&server, &flight("ardupilot:0.0.0.0:9002"));
    assert!(
        address.contains("expected one of: bench-1; a request cannot give an address"),
        "{address}"
    );
    let unknown = detail(&server, &flight("bench-2"));
    assert!(
        unknown.contains("'bench-2', which is not configured; expected one of: bench-1"),
        "{unknown}"
    );
    for (change, words) in [
        (json!({ "link": "zenoh" }), "one process"),
        (json!({ "link": "zenoh", "fdi": "worker" }), "one process"),
        (json!({ "pace": "real-time" }), "sets its own pace"),
        (
            json!({ "text": FLIGHT.replace("on-ground", "trimmed") }),
            "initial.start",
        ),
        (json!({ "text": FLIGHT.replace("f550-skids", "quad-x") }), ""),
    ] {
        let mut body = flight("bench-1");
        body.as_object_mut()
            .expect("an object")
            .extend(change.as_object().expect("an object").clone());
        let sentence = detail(&server, &body);
        assert!(sentence.contains(words), "{sentence}");
    }
    // An unknown controller is a bad request.
    let wrong = json!({ "text": FLIGHT, "controller": { "address": "127.0.0.1:9002" } });
    let answer = server.ask("POST", "/api/v1/runs", &[], &wrong.to_string());
    assert!(matches!(answer.status, 400 | 422), "{}", answer.json());

    // Errors on the command line are reported before anything is opened.
    for (words, sentence) in [
        (&["bench 1=ardupilot"][..], "expected 1 to 64 letters"),
        (&["ardupilot"], "expected NAME=ADDRESS"),
        (&["a=inav"], "expected ardupilot"),
        (&["a=ardupilot", "--autopilot", "b=ardupilot"], "is already configured"),
        (
            &["a=betaflight,pilot=tcp:127.0.0.1:1"],
            "takes no commands over MAVLink",
        ),
        (&["a=ardupilot", "--workers", "0"], "no worker here would fly with it"),
    ] {
        let data = scratch.path("refused");
        let call = Call::new(&scratch, ["serve", "--listen", "127.0.0.1:0", "--data"]).with([data.into_os_string()]);
        let ended = call
            .with(["--autopilot"])
            .with(words.iter().copied())
            .run()
            .expect_code(2);
        assert!(ended.stderr.concat().contains(sentence), "{:?}", ended.stderr);
    }
}

/// The message of a run that failed and was not retried.
#[track_caller]
fn failed_at_once(server: &Server, id: &str) -> String {
    let run = server.ended(id);
    assert_eq!(
        (&run["status"], &run["attempts"]),
        (&json!("failed"), &json!(1)),
        "{run}"
    );
    run["error"].as_str().expect("a sentence").to_owned()
}

#[test]
fn scenario_a_silent_autopilot_ends_the_run_at_the_first_attempt() {
    let scratch = Scratch::new();
    let at = free_address();
    let more = ["--workers", "1", "--autopilot", &listed("bench-1", at)];
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &more);
    // It never connects.
    let mut body = flight("bench-1");
    body["join_timeout_ms"] = json!(700);
    let error = failed_at_once(&server, &server.submit(&body));
    assert!(
        error.contains("ArduPilot") && error.contains(&at.port().to_string()),
        "{error}"
    );

    // It falls silent in flight.
    let peer = ScriptedArduPilot::start(at, &scenario(), 1.5);
    let id = server.submit(&flight("bench-1"));
    assert!(wait_until(PATIENCE, || peer.answered() > 8000).is_some());
    peer.silence(true);
    let error = failed_at_once(&server, &id);
    assert!(
        error.contains("ArduPilot at 127.0.0.1:") && error.contains("frame"),
        "{error}"
    );
    assert_eq!(autopilot(&server, "bench-1")["state"], "free");
}

/// Only the worker on whose host it is listed flies with it; without that worker a run waits and says for what.
#[test]
fn scenario_the_worker_that_lists_it_flies_with_it() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(scratch.folder()) else {
        return;
    };
    let (url, artifacts) = (postgres.url(), scratch.path("artifacts").display().to_string());
    let shared = ["--database-url", &url, "--artifacts", &artifacts];
    let at = free_address();
    let name = listed("bench-1", at);
    let with = |more: &[&'static str]| [&shared[..], more].concat();
    let server = Server::start_at("127.0.0.1:0", &scratch.path("server"), &with(&["--workers", "1"]));
    let _idle = Worker::start(&scratch.path("idle"), &with(&["--workers", "2"]));
    let mut listing = [&shared[..], &["--workers", "2", "--autopilot", &name]].concat();
    let mut worker = Worker::start(&scratch.path("lists"), &listing);
    let process = autopilot(&server, "bench-1")["worker"].clone();
    let peer = ScriptedArduPilot::start(at, &scenario(), 1.5);
    let ids: Vec<String> = (0..3).map(|_| server.submit(&flight("bench-1"))).collect();
    let runs: Vec<Value> = ids.iter().map(|id| server.ended(id)).collect();
    let mut times: Vec<(i64, i64)> = Vec::new();
    for run in &runs {
        assert_eq!((&run["status"], &run["worker"]), (&json!("done"), &process), "{run}");
        let time = |key: &str| run[key].as_i64().expect("a time");
        times.push((time("started_ms"), time("finished_ms")));
    }
    times.sort_unstable();
    assert!(times.windows(2).all(|two| two[0].1 <= two[1].0), "{times:?}");

    worker.kill();
    drop(peer);
    let away = wait_until(PATIENCE, || autopilot(&server, "bench-1")["state"] == "away");
    assert!(away.is_some(), "{}", autopilot(&server, "bench-1"));
    let id = server.submit(&flight("bench-1"));
    std::thread::sleep(Duration::from_secs(3));
    let run = server.get(&format!("/api/v1/runs/{id}"));
    assert_eq!(run["status"], "queued");
    let why = run["waits_because"].as_str().expect("a reason");
    assert!(why.contains("is away: its worker"), "{why}");
    // Another worker lists it, and the run is flown.
    listing.truncate(4);
    let at = free_address();
    let name = listed("bench-1", at);
    listing.extend(["--workers", "1", "--autopilot", &name]);
    let _peer = ScriptedArduPilot::start(at, &scenario(), 1.5);
    let _worker = Worker::start(&scratch.path("again"), &listing);
    assert_eq!(server.ended(&id)["status"], "done");
}

#[test]
fn scenario_controllers_are_compared_in_one_table() {
    let scratch = Scratch::new();
    let at = free_address();
    let file = scratch.write(
        "flight.toml",
        FLIGHT.replace(
            "../vehicles",
            &repository().join("config/vehicles").display().to_string(),
        ),
    );
    let _peer = ScriptedArduPilot::start(at, &scenario(), 1.5);
    let out = scratch.path("compared");
    let autopilot = format!("ardupilot:{at}");
    let call = Call::new(
        &scratch,
        [
            "controllers".into(),
            file.into_os_string(),
            "--out".into(),
            out.clone().into_os_string(),
        ],
    )
    .with([
        "--controller",
        "own",
        "--controller",
        &autopilot,
        "--controller",
        "external",
        "--pilot",
        "none",
        "--within",
        "0.25",
    ]);
    let mut run = call.start();
    // An external one, over zenoh, with the printed command.
    let line = run.line(|line| line.starts_with("  rotortwin controller "));
    let words: Vec<&str> = line.split_whitespace().skip(1).collect();
    let external = Call::new(&scratch, words).start();
    let ended = run.end(PATIENCE).expect_code(0);
    external.end(PATIENCE).expect_code(0);
    for words in [
        "flown by",
        "ArduPilot at",
        "rotortwin-controller",
        "isolated after",
        "within 0.25 m again after",
        "energy",
    ] {
        assert!(ended.stdout.contains(words), "{words}: {}", ended.stdout);
    }
    assert!(!ended.stdout.contains("Careful"), "{}", ended.stdout);

    let folders = [
        "1-own",
        &format!("2-{}", autopilot.replace([':', '.'], "-")),
        "3-external",
    ]
    .map(|name| out.join(name).into_os_string());
    let call = Call::new(&scratch, ["controllers", "--json", "--runs"]).with(folders);
    let table: Value = serde_json::from_str(&call.run().expect_code(0).stdout).expect("nothing but JSON");
    let rows = table["rows"].as_array().expect("rows");
    assert_eq!((rows.len(), &table["differences"]), (3, &json!([])), "{table}");
    // The same controller over another link gives the same flight.
    for key in [
        "position_m",
        "energy_wh",
        "fault",
        "seed",
        "controller",
        "version",
        "yaw_deg",
        "roll_pitch_deg",
    ] {
        assert_eq!(rows[0][key], rows[2][key], "{key}");
    }
    assert!(
        rows[1]["roll_pitch_deg"].is_null() && rows[0]["roll_pitch_deg"].is_object(),
        "{table}"
    );
    for row in rows {
        assert_eq!(
            (&row["status"], &row["lockstep"], &row["fault"]["right_at_end"]),
            (&json!("done"), &json!(true), &json!(true))
        );
    }
    // What cannot be compared is reported.
    let other = Call::new(
        &scratch,
        [
            "fly".into(),
            scratch.path("flight.toml").into_os_string(),
            "--out".into(),
            scratch.path("other").into_os_string(),
        ],
    )
    .with([
        "--link",
        "in-process",
        "--seed",
        "9",
        "--set",
        "initial.start=\"trimmed\"",
        "--set",
        "fault=[]",
    ]);
    other.run().expect_code(0);
    let call = Call::new(&scratch, ["controllers", "--runs"]).with([
        out.join("1-own").into_os_string(),
        scratch.path("other").into_os_string(),
    ]);
    let text = call.run().expect_code(0).stdout;
    assert!(
        text.contains("Careful: the seed differs") && text.contains("Careful: the fault differs"),
        "{text}"
    );
}

/// Drag of the rotors that the document of the vehicle lacks, N·s/m.
const HIDDEN_DRAG: f64 = 0.25;
/// Start of the tour: height over the origin, m, and simulated time, s, after the hand-over.
const TOUR: (f64, f64) = (3.0, 14.0);

/// A tour about a hover with that drag, for a document in any folder.
fn hidden_drag() -> String {
    let vehicle = repository().join("config/vehicles/f550-skids.toml");
    format!(
        "name = 'hidden'\ndescription = 'a tour'\nvehicle = '{}'\nduration_s = 45.0\n[initial]\nstart = 'on-ground'\n\
         [trajectory]\nkind = 'hover'\nposition_ned_m = [0.0, 0.0, -{:?}]\n[ground]\ndown_m = 0.0\n[ground.contact]\n\
         [[effect]]\neffect = 'rotor-drag'\nparameters = {{ drag_n_s_m = {HIDDEN_DRAG:?} }}\n",
        vehicle.display(),
        TOUR.0,
    )
}

/// Output of a command on the run folder and a model.
fn said(scratch: &Scratch, command: &str, model: &str) -> Value {
    let ended = Call::new(scratch, [command, "run", "--json", "--model", model]).run();
    serde_json::from_str(&ended.stdout).unwrap_or_else(|_| panic!("{command}: {:?}", ended.stderr))
}

/// Flies with `--controller ADDRESS` against what `starts` there, and has the run diagnosed.
fn names_the_hidden_drag(kind: &str, starts: impl FnOnce(SocketAddr, &Scenario)) {
    let scratch = Scratch::new();
    let at = free_address();
    let path = scratch.write("hidden.toml", hidden_drag());
    let scenario = Scenario::load(&path).expect("a good scenario");
    starts(at, &scenario);
    let controller = format!("{kind}:{at}");
    Call::new(&scratch, ["fly".into(), path.into_os_string()])
        .with(["--controller", &controller, "--pilot", "none", "--out", "run"])
        .run()
        .expect_code(0);
    // The vehicle as the autopilot knew it.
    let document = repository().join("config/vehicles/f550-skids.toml");
    let believed = document.to_str().expect("a path in letters");
    assert_eq!(
        said(&scratch, "compare", believed)["logs"][0]["models"][0]["agrees"],
        false
    );
    let diagnosis = said(&scratch, "diagnose", believed);
    assert_eq!(text(&diagnosis, "/verdict/kind"), "missing", "{diagnosis}");
    let named = diagnosis["effects"].as_array().expect("a list");
    assert_eq!(named.len(), 1, "{diagnosis}");
    assert_eq!(text(&named[0], "/instance/effect"), "rotor-drag", "{diagnosis}");
    let drag = &named[0]["parameters"][0];
    let number = |key: &str| drag[key].as_f64().expect("a number");
    let (value, interval) = (number("value"), number("interval_95"));
    println!("{kind}: {value} ± {interval} N·s/m");
    assert!((value - HIDDEN_DRAG).abs() < interval, "{drag}");
    assert!(interval < 0.02, "{drag}");

    // The vehicle as flown.
    let drag = format!("drag_n_s_m={HIDDEN_DRAG:?}");
    Call::new(&scratch, ["model", "add", believed, "rotor-drag", &drag])
        .run()
        .expect_code(0);
    let compared = said(&scratch, "compare", "f550-skids");
    assert_eq!(compared["logs"][0]["models"][0]["agrees"], true, "{compared}");
}

#[test]
fn scenario_drag_that_the_vehicle_of_an_ardupilot_lacks_is_named_from_its_run() {
    let mut peer = None;
    names_the_hidden_drag("ardupilot", |at, scenario| {
        peer = Some(ScriptedArduPilot::start_for(at, scenario, TOUR.0, Some(TOUR.1)));
    });
    drop(peer);
}

#[test]
fn scenario_drag_that_the_vehicle_of_a_px4_lacks_is_named_from_its_run() {
    let mut peer = None;
    names_the_hidden_drag("px4", |at, scenario| {
        peer = Some(scripted_px4::start(at, scenario, TOUR.0, TOUR.1));
    });
    let ended = peer.expect("it was started").join();
    ended.expect("the peer understood the plant");
}

/// A hover from the ground of this length after the hand-over, as a file.
fn short_flight(scratch: &Scratch, duration_s: f64) -> PathBuf {
    let vehicles = repository().join("config/vehicles").display().to_string();
    let flight = FLIGHT
        .replace("../vehicles", &vehicles)
        .replace("duration_s = 16.0", &format!("duration_s = {duration_s:?}"));
    let fault = flight.find("[[fault]]").expect("it has one");
    scratch.write("short.toml", &flight[..fault])
}

/// `fly` of that flight with `--controller ADDRESS` into `run`, and the pilot of others where there is one.
fn flown_by(scratch: &Scratch, duration_s: f64, address: &str) -> Call {
    let call = Call::new(
        scratch,
        ["fly".into(), short_flight(scratch, duration_s).into_os_string()],
    );
    let call = call.with(["--controller", address, "--out", "run", "--join-timeout", "20000"]);
    if address.starts_with("betaflight") {
        call
    } else {
        call.with(["--pilot", "none"])
    }
}

/// The one sentence with which a command failed: exit code 1, and nothing else names the peer.
#[track_caller]
fn failed_with_one_sentence(ended: Ended, peer: &str) -> String {
    let ended = ended.expect_code(1);
    let mut said = ended
        .stdout
        .lines()
        .chain(ended.stderr.iter().map(String::as_str))
        .filter(|line| line.contains(peer) && (line.contains("--step-timeout") || line.contains("connection")));
    let sentence = said
        .next()
        .unwrap_or_else(|| panic!("{}\n{:?}", ended.stdout, ended.stderr))
        .to_owned();
    assert_eq!(said.next(), None, "it is said once");
    sentence
}

#[test]
fn scenario_an_ardupilot_that_falls_silent_ends_the_command_with_one_sentence() {
    let scratch = Scratch::new();
    let at = free_address();
    let peer = ScriptedArduPilot::start(at, &scenario(), 1.5);
    let run = flown_by(&scratch, 16.0, &format!("ardupilot:{at}"))
        .with(["--step-timeout", "1500"])
        .start();
    assert!(wait_until(PATIENCE, || peer.answered() > 8000).is_some());
    peer.silence(true);
    let sentence = failed_with_one_sentence(run.end(PATIENCE), "ArduPilot at 127.0.0.1:");
    let last = peer.answered() - 1;
    assert!(
        sentence.contains(&format!("after frame {last}: silent for 1")) && sentence.contains("allowed are 1500 ms"),
        "frame {last}: {sentence}"
    );
    // What was flown until then is kept, marked as failed.
    let summary = read_json(&scratch.path("run").join("summary.json"));
    assert_eq!(text(&summary, "/status"), "failed");
}

#[test]
fn scenario_a_px4_that_closes_the_connection_ends_the_command_with_one_sentence() {
    let scratch = Scratch::new();
    let at = free_address();
    let peer = scripted_px4::start_until(at, &scenario(), 1.5, None, 9.0);
    let ended = flown_by(&scratch, 16.0, &format!("px4:{at}")).run();
    let sentence = failed_with_one_sentence(ended, "PX4 at 127.0.0.1:");
    assert!(
        sentence.contains("closed the connection after its answer to the sample of 9.0"),
        "{sentence}"
    );
    peer.join().expect("the peer understood the plant");
}

#[test]
fn scenario_a_port_that_is_taken_ends_the_command_before_anything_is_written() {
    let scratch = Scratch::new();
    let udp = UdpSocket::bind("127.0.0.1:0").expect("a free port");
    let tcp = TcpListener::bind("127.0.0.1:0").expect("a free port");
    for (kind, at) in [
        ("ardupilot", udp.local_addr().expect("it is bound")),
        ("px4", tcp.local_addr().expect("it is bound")),
    ] {
        let ended = flown_by(&scratch, 3.0, &format!("{kind}:{at}")).run().expect_code(1);
        let said: Vec<&String> = ended
            .stderr
            .iter()
            .filter(|line| line.contains("cannot open"))
            .collect();
        assert!(
            said.len() == 1 && said[0].contains(&at.to_string()),
            "{kind}: {:?}",
            ended.stderr
        );
        assert!(!scratch.path("run").exists(), "{kind}");
    }
}

#[test]
fn scenario_an_autopilots_run_is_replayed_by_its_commands_alone() {
    for kind in ["ardupilot", "px4"] {
        let scratch = Scratch::new();
        let at = free_address();
        let address = format!("{kind}:{at}");
        if kind == "ardupilot" {
            let _peer = ScriptedArduPilot::start(at, &scenario(), 1.5);
            flown_by(&scratch, 4.0, &address).run().expect_code(0);
        } else {
            let peer = scripted_px4::start_until(at, &scenario(), 1.5, None, f64::INFINITY);
            flown_by(&scratch, 4.0, &address).run().expect_code(0);
            peer.join().expect("the peer understood the plant");
        }
        let run = scratch.path("run");
        let hash = text(&read_json(&run.join("summary.json")), "/run_hash").to_owned();
        let replayed = Call::new(&scratch, ["replay", "run"]).run().expect_code(0);
        assert!(
            replayed.stdout.starts_with("same: ") && replayed.stdout.contains(&hash),
            "{kind}: {}",
            replayed.stdout
        );
        // A flipped bit in its packets: another flight, or none.
        let commands = run.join("autopilot-commands.bin");
        let mut bytes = std::fs::read(&commands).expect("it was written");
        let middle = bytes.len() * 3 / 4;
        bytes[middle] ^= 0x20;
        std::fs::write(&commands, &bytes).expect("it is ours");
        Call::new(&scratch, ["replay", "run"]).run().expect_code(1);
    }
}

#[test]
fn scenario_a_betaflight_flies_twice_not_in_lockstep_and_falls_silent() {
    let scratch = Scratch::new();
    let peer = ScriptedBetaflight::start();
    let address = format!("betaflight:{}", peer.port());
    for _ in 0..2 {
        // The second plant is a new one to the same Betaflight.
        let ended = flown_by(&scratch, 3.0, &address).run().expect_code(0);
        let said = format!("{}\n{}", ended.stdout, ended.stderr.join("\n"));
        assert!(said.contains("not lockstep: of "), "{said}");
        let summary = read_json(&scratch.path("run").join("summary.json"));
        assert_eq!(summary["controller"]["lockstep"], false, "{summary}");
        assert!(text(&summary, "/link").ends_with(", not lockstep"), "{summary}");
        let hash = text(&summary, "/run_hash").to_owned();
        let replayed = Call::new(&scratch, ["replay", "run"]).run().expect_code(0);
        assert!(
            replayed.stdout.starts_with("same: ") && replayed.stdout.contains(&hash),
            "{}",
            replayed.stdout
        );
        std::fs::remove_dir_all(scratch.path("run")).expect("it is ours");
    }
    let before = peer.states();
    let run = flown_by(&scratch, 30.0, &address)
        .with(["--step-timeout", "700"])
        .start();
    assert!(wait_until(PATIENCE, || peer.states() > before + 1000).is_some());
    peer.silence(true);
    let sentence = failed_with_one_sentence(run.end(PATIENCE), "Betaflight at 127.0.0.1:");
    assert!(
        sentence.contains("sent no motors after state ") && sentence.contains("allowed are 700 ms"),
        "{sentence}"
    );
}

#[test]
fn scenario_swapped_motors_are_named_by_the_command() {
    let scratch = Scratch::new();
    let flight = short_flight(&scratch, 5.0);
    let tested = |wires: [usize; 6]| {
        let at = free_address();
        let _peer = ScriptedArduPilot::start_wired(at, &scenario(), 1.5, None, wires);
        Call::new(&scratch, ["spin-test".to_owned(), format!("ardupilot:{at}")])
            .with(["--pilot", "none", "--join-timeout", "20000", "--scenario"])
            .with([flight.clone().into_os_string()])
            .run()
    };
    let right = tested(ROTOR_OF_CHANNEL).expect_code(0);
    assert!(right.stdout.ends_with("All motors are correct\n"), "{}", right.stdout);
    // Wires of channels 2 and 6 swapped.
    let wrong = tested([2, 4, 6, 3, 1, 5]).expect_code(1);
    let line = |channel: usize| {
        let begin = format!("channel {channel:>2}  ");
        let found = wrong.stdout.lines().find(|line| line.starts_with(&begin));
        found.unwrap_or_else(|| panic!("{}", wrong.stdout)).to_owned()
    };
    assert!(line(2).ends_with("swapped with channel 6"), "{}", wrong.stdout);
    assert!(line(6).ends_with("swapped with channel 2"), "{}", wrong.stdout);
    for channel in [1, 3, 4, 5] {
        assert!(line(channel).ends_with("ok"), "{}", wrong.stdout);
    }
    assert!(wrong.stdout.ends_with("Some motors are wrong\n"), "{}", wrong.stdout);
}

#[test]
fn scenario_priority_is_for_autopilots_on_the_wall_clock() {
    let scratch = Scratch::new();
    let refused = flown_by(&scratch, 3.0, &format!("ardupilot:{}", free_address()))
        .with(["--priority"])
        .run()
        .expect_code(2);
    let said = refused.stderr.join("\n");
    assert!(
        said.contains("--priority") && said.contains("flies in lockstep"),
        "{said}"
    );
    assert!(!scratch.path("run").exists(), "nothing was written");

    let peer = ScriptedBetaflight::start();
    let ended = flown_by(&scratch, 3.0, &format!("betaflight:{}", peer.port()))
        .with(["--priority=7"])
        .run();
    let said = ended.stderr.join("\n");
    if said.contains("cap_sys_nice") || said.contains("cap_ipc_lock") {
        return skip("this user has no right to real-time priority or to locked memory");
    }
    let ended = ended.expect_code(0);
    let said = format!("{}\n{said}", ended.stdout);
    assert!(said.contains("not lockstep: of "), "{said}");
}

#[test]
fn scenario_a_plant_is_examined_by_the_command() {
    let scratch = Scratch::new();
    // Our own.
    let at = free_address();
    let mut plant = flown_by(&scratch, 16.0, &format!("ardupilot:{at}"))
        .with(["--step-timeout", "2000"])
        .start();
    plant.line(|line| line.starts_with("Waiting for servo packets of ArduPilot: "));
    let examined = |at: SocketAddr| {
        let address = format!("plant:ardupilot:{at}");
        Call::new(&scratch, ["conform".to_owned(), address])
            .with(["--scenario", "autopilot-hover"])
            .run()
    };
    let right = examined(at).expect_code(0);
    assert!(right.stdout.ends_with("Conforms\n"), "{}", right.stdout);
    assert!(!right.stdout.contains("wrong  "), "{}", right.stdout);
    // The examiner is gone, which to our plant is an autopilot that fell silent.
    plant.end(PATIENCE).expect_code(1);

    // One that never moves and whose specific force is upside down.
    let wrong = UdpSocket::bind("127.0.0.1:0").expect("a free port");
    let at = wrong.local_addr().expect("it is bound");
    wrong
        .set_read_timeout(Some(Duration::from_millis(100)))
        .expect("a time-out");
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let (mut buffer, mut frames) = ([0; 200], 0);
            while !stop.load(Ordering::Relaxed) {
                let Ok((_, from)) = wrong.recv_from(&mut buffer) else {
                    continue;
                };
                frames += 1;
                let line = format!(
                    "\n{{\"timestamp\":{:.3},\"imu\":{{\"gyro\":[0,0,0],\"accel_body\":[0,0,9.80665]}},\"position\":[0,0,0],\
                     \"attitude\":[0,0,0],\"velocity\":[0,0,0]}}\n",
                    0.001 * f64::from(frames)
                );
                wrong.send_to(line.as_bytes(), from).expect("it is there");
            }
        });
        let told = examined(at);
        stop.store(true, Ordering::Relaxed);
        let told = told.expect_code(1);
        assert!(told.stdout.ends_with("Does not conform\n"), "{}", told.stdout);
        let force = told.stdout.lines().find(|line| line.contains("accel_body"));
        assert!(
            force.is_some_and(|line| line.starts_with("wrong")),
            "the force points down: {}",
            told.stdout
        );
    });

    // Nobody.
    let nobody = free_address();
    let told = examined(nobody).expect_code(1);
    assert!(
        told.stderr.iter().any(|line| line.contains(&nobody.to_string())),
        "{:?}",
        told.stderr
    );
}
