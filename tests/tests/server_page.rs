//! What the page needs of the server: comparison plots, geometry, live flights without gaps, one event stream, sign-in sessions.

use rotortwin_tests::program::Call;
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::server::{Answer, Server};
use rotortwin_tests::websocket::WebSocket;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader};
use std::time::{Duration, Instant};

fn done(server: &Server, collection: &str, body: &Value) -> (String, Value) {
    let id = server.submit_to(collection, body);
    let job = server.ended_in(collection, &id);
    assert_eq!(job["status"], "done", "{collection}: {job}");
    (id, job)
}

fn numbers(value: &Value) -> Vec<Option<f64>> {
    let list = value.as_array().unwrap_or_else(|| panic!("a list: {value}"));
    list.iter().map(Value::as_f64).collect()
}

#[test]
fn scenario_what_a_comparison_draws_comes_as_numbers() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let log = server.generated(&json!({ "effect": "rotor-drag:drag_n_s_m=0.25", "seed": 2, "duration_s": 40 }));

    // The log itself.
    let channels = server.get(&format!("/api/v1/logs/{log}/channels"));
    let names: Vec<&str> = channels["items"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|c| c["name"].as_str())
        .collect();
    assert!(names.contains(&"duty_1") && names.contains(&"time_s"), "{names:?}");
    let samples = server.get(&format!(
        "/api/v1/logs/{log}/telemetry?channels=duty_1&points=100&from_s=10&to_s=20"
    ));
    assert_eq!(
        samples["data"]["duty_1"].as_array().map(Vec::len),
        Some(100),
        "{samples}"
    );

    let flights = json!({ "logs": [log] });
    let (id, job) = done(
        &server,
        "comparisons",
        &json!({ "model": { "vehicle": "f550" }, "flights": flights }),
    );
    let path = |more: &str| format!("/api/v1/comparisons/{id}/{more}");
    // Sample by sample: predicted plus residual is the measured value, and the RMS is that of the result.
    let series = server.get(&path("series?channel=fx&points=20000"));
    assert_eq!(
        (&series["unit"], &series["models"][0]["label"]),
        (&json!("m/s²"), &json!("f550"))
    );
    let measured = numbers(&series["measured"]["mean"]);
    let predicted = numbers(&series["models"][0]["predicted"]["mean"]);
    let residual = numbers(&series["models"][0]["residual"]["mean"]);
    let (mut square, mut count) = (0.0, 0.0);
    for ((m, p), r) in measured.iter().zip(&predicted).zip(&residual) {
        if let (Some(m), Some(p), Some(r)) = (m, p, r) {
            assert!((m - p - r).abs() < 1e-5, "{m} {p} {r}");
            square += r * r;
            count += 1.0;
        }
    }
    let told = job["result"]["logs"][0]["models"][0]["channels"][0].clone();
    let rms = told["rms"].as_f64().expect("a number");
    assert!(
        ((square / count).sqrt() / rms - 1.0).abs() < 1e-4,
        "{} {rms}",
        (square / count).sqrt()
    );
    let noise = series["noise"]["sample"].as_f64().expect("a number");
    assert!((noise / told["noise"].as_f64().expect("a number") - 1.0).abs() < 1e-9);
    // Buckets: no spike is lost, and an interval is exact.
    let coarse = server.get(&path("series?channel=fx&points=50"));
    let extreme =
        |value: &Value, pick: fn(f64, f64) -> f64| numbers(value).into_iter().flatten().reduce(pick).expect("some");
    let highest = extreme(&coarse["models"][0]["residual"]["high"], f64::max);
    assert!((highest - extreme(&series["models"][0]["residual"]["mean"], f64::max)).abs() < 1e-12);
    let part = server.get(&path("series?channel=mz&from_s=10&to_s=12&points=900"));
    assert!(
        numbers(&part["time_s"])
            .iter()
            .flatten()
            .all(|t| (10.0..=12.0).contains(t))
    );
    let conditions = server.get(&path("conditions?points=50"));
    assert_eq!(conditions["time_s"], coarse["time_s"], "the same buckets");
    assert!(
        conditions["items"]
            .as_array()
            .expect("a list")
            .iter()
            .any(|c| c["name"] == "forward_speed"),
        "{conditions}"
    );
    for (query, status) in [
        ("series?channel=none", 422),
        ("series?channel=fx&log=7", 404),
        ("series?channel=fx&from_s=2&to_s=1", 422),
        ("series?channel=fx&points=0", 400),
        ("series", 400),
        ("conditions?colour=red", 400),
    ] {
        assert_eq!(server.ask("GET", &path(query), &[], "").status, status, "{query}");
    }

    // Plot of the finding: without the effect the residual is its contribution, with it nothing remains.
    let (_, diagnosis) = done(
        &server,
        "diagnoses",
        &json!({ "model": { "vehicle": "f550" }, "flights": flights }),
    );
    let picture = &diagnosis["result"]["effects"][0]["picture"];
    let bins = picture["bins"]
        .as_array()
        .unwrap_or_else(|| panic!("a picture: {diagnosis}"));
    assert!(bins.len() >= 6, "{picture}");
    for bin in bins {
        let value = |key: &str| bin[key].as_f64().expect("a number");
        assert!((value("before") - value("at")).abs() < 3.0 * value("band_95"), "{bin}");
        assert!(value("after").abs() < 3.0 * value("band_95"), "{bin}");
    }
    let reach = bins[bins.len() - 1]["at"]
        .as_f64()
        .zip(bins[0]["at"].as_f64())
        .map(|(b, a)| b - a);
    assert!(
        reach.is_some_and(|reach| reach > 10.0 * bins[0]["band_95"].as_f64().expect("a number")),
        "{picture}"
    );
}

#[test]
fn val_the_geometry_of_a_hover_carries_its_weight() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let run = server.submit(&json!({ "scenario": "short-hover", "link": "in-process" }));
    server.ended(&run);
    for path in [
        "vehicles/f550/geometry".to_owned(),
        "vehicles/octo-x/geometry".to_owned(),
        "vehicles/hexa-h/geometry".to_owned(),
        "models/quad-x/geometry".to_owned(),
        format!("runs/{run}/geometry"),
    ] {
        let geometry = server.get(&format!("/api/v1/{path}"));
        let thrust: Vec<f64> = numbers(&geometry["hover"]["rotor_thrust_n"])
            .into_iter()
            .flatten()
            .collect();
        let rows = geometry["effectiveness"]["matrix"].as_array().expect("rows");
        let wrench: Vec<f64> = rows
            .iter()
            .map(|row| {
                numbers(row)
                    .into_iter()
                    .flatten()
                    .zip(&thrust)
                    .map(|(a, b)| a * b)
                    .sum()
            })
            .collect();
        let weight = geometry["mass_kg"]
            .as_f64()
            .zip(geometry["gravity_m_s2"].as_f64())
            .map(|(m, g)| m * g);
        // The allocation is in single precision.
        assert!(
            (wrench[0] - weight.expect("numbers")).abs() < 1e-4 * wrench[0],
            "{path}: {wrench:?}"
        );
        assert!(
            wrench[1..].iter().all(|torque| torque.abs() < 1e-4),
            "{path}: {wrench:?}"
        );
        let duties = numbers(&geometry["hover"]["duty"]);
        assert!(
            duties.iter().flatten().all(|duty| (0.1..0.95).contains(duty)),
            "{path}: {duties:?}"
        );
        let rotors = geometry["rotors"].as_array().expect("rotors");
        assert_eq!(
            (rotors.len(), &rotors[0]["number"]),
            (thrust.len(), &json!(1)),
            "{path}"
        );
        assert!(
            rotors
                .iter()
                .all(|rotor| rotor["spin"] == "cw" || rotor["spin"] == "ccw")
        );
    }
    assert_eq!(server.ask("GET", "/api/v1/vehicles/none/geometry", &[], "").status, 404);
}

/// Times of the rows until the end or for this long.
fn live_times(live: &mut WebSocket, at_least_s: f64) -> Vec<f64> {
    let mut times = Vec::new();
    while times.last().is_none_or(|last| *last < at_least_s) {
        let Some(message) = live.next_message() else { break };
        match message["type"].as_str() {
            Some("history") => times.extend(numbers(&message["time_s"]).into_iter().flatten()),
            Some("sample") => times.extend(message["time_s"].as_f64()),
            Some("end") => break,
            _ => {}
        }
    }
    times
}

#[test]
fn scenario_who_looks_on_late_or_again_sees_the_flight_without_a_hole() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let body =
        json!({ "scenario": "short-hover", "link": "in-process", "pace": "real-time", "set": ["duration_s=8.0"] });
    let id = server.submit(&body);
    std::thread::sleep(Duration::from_millis(2500));
    let open = |from: &str| {
        WebSocket::open(
            &server,
            &format!("/api/v1/runs/{id}/live?channels=roll_rad&rate_hz=100&from_s={from}"),
        )
        .expect("it opens")
    };
    let mut late = open("0");
    let first = live_times(&mut late, 4.0);
    assert!(first[0] < 0.02, "from the start: {}", first[0]);
    drop(late);
    let seen = first[first.len() - 1];
    let mut again = open(&seen.to_string());
    let mut whole = open("0");
    let second = live_times(&mut again, f64::INFINITY);
    assert!(second[0] > seen, "nothing twice");
    let all: Vec<f64> = first.into_iter().chain(second).collect();
    assert!(all.windows(2).all(|two| two[1] > two[0]), "in order");
    assert!(all[all.len() - 1] > 7.5, "to the end: {:?}", all.last());
    // Compared with the flight as stored up to the second look. A sample that follows another one too soon for the requested rate is
    // dropped, two in a row are not.
    let start = whole.next_message().expect("a start");
    assert_eq!(start["type"], "start", "{start}");
    let kept = whole.next_message().expect("what was before");
    assert_eq!(
        (&kept["type"], &kept["thinned"]),
        (&json!("history"), &json!(false)),
        "{kept}"
    );
    let kept: Vec<f64> = numbers(&kept["time_s"]).into_iter().flatten().collect();
    assert!(kept.len() > 50 && kept[0] < 0.02, "{} rows", kept.len());
    let has = |time: f64| all.iter().any(|other| (other - time).abs() < 1e-9);
    let hole = kept.windows(2).find(|two| !has(two[0]) && !has(two[1]));
    assert_eq!(hole, None, "a hole");
    assert_eq!(server.ended(&id)["status"], "done");
    assert_eq!(
        server
            .ask("GET", &format!("/api/v1/runs/{id}/live?from_s=x"), &[], "")
            .status,
        400
    );
}

/// An event of a stream: id, kind, data.
type Event = (String, String, Value);

/// Events of the stream until `enough` holds.
fn events(server: &Server, after: Option<&str>, enough: impl Fn(&[Event]) -> bool) -> Vec<Event> {
    let headers: Vec<(&str, &str)> = after.iter().map(|id| ("last-event-id", *id)).collect();
    let stream = server.send("GET", "/api/v1/events?progress=false", &headers, "");
    let mut lines = BufReader::new(stream).lines();
    let (mut all, mut event) = (Vec::new(), (String::new(), String::new(), Value::Null));
    let begun = Instant::now();
    while !enough(&all) {
        assert!(begun.elapsed() < Duration::from_secs(60), "{all:?}");
        let line = lines.next().expect("the stream goes on").expect("a line");
        match line.split_once(": ").or_else(|| line.split_once(':')) {
            Some(("id", id)) => event.0 = id.to_owned(),
            Some(("event", kind)) => event.1 = kind.to_owned(),
            Some(("data", data)) => event.2 = serde_json::from_str(data).expect("JSON"),
            _ if line.is_empty() && !event.1.is_empty() => {
                all.push(std::mem::replace(
                    &mut event,
                    (String::new(), String::new(), Value::Null),
                ));
            }
            _ => {}
        }
    }
    all
}

fn ended(all: &[Event]) -> usize {
    all.iter().filter(|(_, kind, _)| kind == "ended").count()
}

#[test]
fn scenario_one_stream_tells_all_jobs_and_goes_on_over_a_killed_server() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let mut server = Server::start(&data);
    let (before, _) = done(
        &server,
        "runs",
        &json!({ "scenario": "short-hover", "link": "in-process" }),
    );
    // It starts at the present.
    let opened = events(&server, None, |all| !all.is_empty());
    assert_eq!(opened[0].1, "open");
    let cursor = opened[0].0.clone();
    let run = server.submit(&json!({ "scenario": "short-hover", "link": "in-process", "seed": 5 }));
    let log = server.submit_to(
        "logs/generate",
        &json!({ "preset": "healthy", "seed": 1, "duration_s": 10 }),
    );
    let mut all = events(&server, Some(&cursor), |all| ended(all) == 2);
    // Killed in the middle of another run: the rest follows what was seen.
    let slow = server.submit(&json!({ "scenario": "short-hover", "link": "in-process", "pace": "real-time" }));
    let last = all[all.len() - 1].0.clone();
    let more = events(&server, Some(&last), |all| {
        all.iter().any(|(_, kind, _)| kind == "started")
    });
    all.extend(more);
    server.kill();
    server.start_again(&data);
    let last = all[all.len() - 1].0.clone();
    all.extend(events(&server, Some(&last), |all| ended(all) == 1));
    // None missed, none duplicated: for each job the events of its own stream, in order.
    let mut by_job: BTreeMap<String, Vec<u64>> = BTreeMap::new();
    for (_, kind, data) in &all {
        assert_ne!(kind, "progress");
        let job = data["job"].as_str().expect("a job").to_owned();
        by_job
            .entry(job)
            .or_default()
            .push(data["seq"].as_u64().expect("a number"));
    }
    assert!(!by_job.contains_key(&before), "what was before is not told");
    assert_eq!(by_job.len(), 3, "{by_job:?}");
    for (id, collection) in [(&run, "runs"), (&log, "logs"), (&slow, "runs")] {
        let own = server.ask("GET", &format!("/api/v1/{collection}/{id}/events"), &[], "");
        let text = String::from_utf8(own.body).expect("text");
        let told: Vec<u64> = text
            .split("\n\n")
            .filter(|event| !event.contains("event: progress"))
            .filter_map(|event| event.lines().find_map(|line| line.strip_prefix("id: ")?.parse().ok()))
            .collect();
        assert_eq!(by_job[id], told, "{collection}");
    }
    let of_log = all.iter().find(|(_, _, data)| data["job"] == json!(log)).expect("told");
    assert_eq!(
        (&of_log.2["collection"], &of_log.2["kind"]),
        (&json!("logs"), &json!("log"))
    );
    // Existing events, without waiting.
    let now = server.ask("GET", &format!("/api/v1/events?wait=false&after={cursor}"), &[], "");
    let text = String::from_utf8(now.body).expect("text");
    assert_eq!(text.matches("event: ended").count(), 3, "{text}");
    assert_eq!(server.ask("GET", "/api/v1/events?after=x", &[], "").status, 400);
}

fn token(scratch: &Scratch, data: &std::path::Path, words: &[&str]) -> String {
    let all = ["token", "create"].iter().chain(words).map(|word| (*word).to_owned());
    let folder = ["--data".to_owned(), data.display().to_string()];
    let ended = Call::new(scratch, all).with(folder).run().expect_code(0);
    ended.stdout.trim().lines().last().unwrap_or_default().to_owned()
}

fn header(answer: &Answer, name: &str) -> String {
    let line = answer
        .headers
        .lines()
        .find_map(|line| line.split_once(": ").filter(|(key, _)| key.eq_ignore_ascii_case(name)));
    line.map_or(String::new(), |(_, value)| value.trim().to_owned())
}

#[test]
fn scenario_a_browser_signs_in_with_a_cookie_that_its_token_ends() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start(&data);
    let session = server.get("/api/v1/session");
    assert_eq!(
        (&session["needs_token"], &session["signed_in"]),
        (&json!(false), &json!(true))
    );
    let text = token(&scratch, &data, &["page", "--tenant", "a"]);
    let session = server.get("/api/v1/session");
    assert_eq!(
        (&session["needs_token"], &session["signed_in"]),
        (&json!(true), &json!(false))
    );
    let sign_in = |token: &str| server.ask("POST", "/api/v1/session", &[], &json!({ "token": token }).to_string());
    assert_eq!(sign_in("rtw_x_y").status, 401);
    let answer = sign_in(&text);
    assert_eq!((answer.status, &answer.json()["tenant"]), (200, &json!("a")));
    let set = header(&answer, "set-cookie");
    for part in ["HttpOnly", "SameSite=Strict", "Path=/"] {
        assert!(set.contains(part), "{set}");
    }
    assert!(!set.contains(&text), "the token itself is not in it");
    let cookie = set.split(';').next().expect("a pair").to_owned();
    // All requests for which a browser cannot set a header.
    let with = [("cookie", cookie.as_str())];
    assert_eq!(server.ask("GET", "/api/v1/runs", &with, "").status, 200);
    assert_eq!(
        server.ask("GET", "/api/v1/session", &with, "").json()["signed_in"],
        json!(true)
    );
    assert_eq!(server.ask("GET", "/api/v1/events?wait=false", &with, "").status, 200);
    let run = server.ask(
        "POST",
        "/api/v1/runs",
        &with,
        r#"{"scenario":"short-hover","link":"in-process"}"#,
    );
    assert_eq!((run.status, &run.json()["tenant"]), (202, &json!("a")));
    let id = run.json()["id"].as_str().expect("an id").to_owned();
    assert!(WebSocket::open_from(&server, &format!("/api/v1/runs/{id}/live"), &with).is_ok());
    // Useless from another origin and for another host name.
    let foreign = [with[0], ("origin", "http://evil.example")];
    assert_eq!(
        server
            .ask("POST", "/api/v1/runs", &foreign, r#"{"scenario":"short-hover"}"#)
            .status,
        403
    );
    assert!(WebSocket::open_from(&server, &format!("/api/v1/runs/{id}/live"), &foreign).is_err());
    // Signing out is final, also for the old cookie.
    let out = server.ask("DELETE", "/api/v1/session", &with, "");
    assert_eq!(out.status, 204);
    assert!(header(&out, "set-cookie").contains("Max-Age=0"));
    assert_eq!(server.ask("GET", "/api/v1/runs", &with, "").status, 401);
    // A revoked token ends its sessions.
    let again = header(&sign_in(&text), "set-cookie");
    let cookie = again.split(';').next().expect("a pair").to_owned();
    let with = [("cookie", cookie.as_str())];
    assert_eq!(server.ask("GET", "/api/v1/runs", &with, "").status, 200);
    let token_id = text.split('_').nth(1).expect("an id").to_owned();
    let folder = ["--data".to_owned(), data.display().to_string()];
    let words = ["token", "revoke", &token_id].map(str::to_owned);
    Call::new(&scratch, words).with(folder).run().expect_code(0);
    assert_eq!(server.ask("GET", "/api/v1/runs", &with, "").status, 401);
    assert_eq!(
        server.ask("GET", "/api/v1/session", &with, "").json()["signed_in"],
        json!(false)
    );
}

#[test]
fn scenario_a_vehicle_is_identified_and_kept_and_an_upload_is_read_again() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let log = server.generated(&json!({ "preset": "healthy", "seed": 4, "duration_s": 60 }));
    let body = json!({ "name": "mine", "flights": { "logs": [log] }, "mass_kg": 1.55, "arm_m": 0.275 });
    let id = server.submit_to("identifications", &body);
    let job = server.ended_in("identifications", &id);
    assert_eq!(job["status"], "done", "{job}");
    assert!(
        job["result"]["identified"]["values"]
            .as_array()
            .is_some_and(|values| values.len() > 5),
        "{job}"
    );
    // The same with a bench: its output is in the result, and an invalid table fails the job with the table's name.
    let table = (2..=10).fold("throttle [%],thrust [g],torque [Nm]\n".to_owned(), |text, step| {
        let duty = 0.1 * f64::from(step);
        let thrust = 1100.0 * (0.4 * duty + 0.6 * duty * duty);
        text + &format!("{},{thrust},{}\n", 100.0 * duty, 0.017 * thrust * 9.80665e-3)
    });
    let mut with_bench = body.clone();
    with_bench["bench"] = json!([{ "name": "stand.csv", "text": table }]);
    let measured = server.submit_to("identifications", &with_bench);
    let measured = server.ended_in("identifications", &measured);
    assert_eq!(measured["status"], "done", "{measured}");
    let notes = measured["result"]["identified"]["notes"].to_string();
    assert!(notes.contains("stand.csv"), "{notes}");
    with_bench["bench"] = json!([{ "name": "stand.csv", "text": "a,b\n1,2\n" }]);
    let wrong = server.submit_to("identifications", &with_bench);
    let wrong = server.ended_in("identifications", &wrong);
    assert_eq!(wrong["status"], "failed", "{wrong}");
    assert!(wrong["error"].to_string().contains("stand.csv"), "{wrong}");
    let kept = server.ask("POST", &format!("/api/v1/identifications/{id}/keep"), &[], "");
    assert_eq!(kept.status, 201, "{}", kept.json());
    // An edited vehicle of that name is not lost to whoever asks for a new one.
    let absent = [("if-none-match", "*")];
    let again = server.ask("POST", &format!("/api/v1/identifications/{id}/keep"), &absent, "");
    assert_eq!(again.status, 412, "{}", again.json());
    let geometry = server.get("/api/v1/vehicles/mine/geometry");
    assert_eq!(geometry["rotors"].as_array().map(Vec::len), Some(6), "{geometry}");
    let flights = json!({ "model": { "vehicle": "mine" }, "flights": { "logs": [log] } });
    let (_, comparison) = done(&server, "comparisons", &flights);
    assert_eq!(comparison["result"]["models"][0]["label"], "mine");
    for (change, status) in [
        (json!({ "mass_kg": 0.0 }), 422),
        (json!({ "mass_kg": 1e6 }), 422),
        (json!({ "arm_m": 0.001 }), 422),
        (json!({ "flights": { "logs": [format!("{log}@60:20")] } }), 422),
        (json!({ "name": "a b" }), 400),
        (json!({ "frame": "--out" }), 422),
        (json!({ "cells": 99 }), 422),
        (json!({ "bench": [{ "name": "../out", "text": "" }] }), 422),
        (
            json!({ "bench": [{ "name": "a", "text": "x".repeat((1 << 20) + 1) }] }),
            422,
        ),
    ] {
        let mut body = body.clone();
        body.as_object_mut()
            .expect("an object")
            .extend(change.as_object().expect("one").clone());
        // A word that looks like an option is not a name of a frame: the job says so.
        let answer = server.ask("POST", "/api/v1/identifications", &[], &body.to_string());
        if change["frame"].is_null() {
            assert_eq!(answer.status, status, "{change}: {}", answer.json());
        } else {
            let id = answer.json()["id"].as_str().expect("an id").to_owned();
            assert_eq!(server.ended_in("identifications", &id)["status"], "failed");
        }
    }

    // An upload, imported again at another rate: another log of the same file.
    let file = server.ask("GET", &format!("/api/v1/logs/{log}/artifacts/log.parquet"), &[], "");
    let headers = [("content-type", "application/octet-stream")];
    let first = server.ask_bytes(
        "POST",
        "/api/v1/logs?name=fl%C3%BCg%20%5B1%5D.parquet&vehicle=f550",
        &headers,
        &file.body,
    );
    let first = first.json()["id"].as_str().expect("an id").to_owned();
    assert_eq!(server.ended_in("logs", &first)["status"], "done");
    let again = server.ask(
        "POST",
        &format!("/api/v1/logs/{first}/import"),
        &[],
        r#"{"rate_hz":100}"#,
    );
    assert_eq!(again.status, 202, "{}", again.json());
    assert_eq!(again.json()["parent"], json!(first));
    let second = again.json()["id"].as_str().expect("an id").to_owned();
    assert_eq!(
        server.ask("DELETE", &format!("/api/v1/logs/{first}"), &[], "").status,
        204
    );
    let job = server.ended_in("logs", &second);
    assert!(
        job["result"]["report"]["rows"].as_u64().is_some_and(|rows| rows < 7000),
        "{job}"
    );
    // Its name, as on its owner's disk, is that of the log in results.
    let flights = json!({ "model": { "vehicle": "f550" }, "flights": { "logs": [second] } });
    let (_, comparison) = done(&server, "comparisons", &flights);
    assert!(comparison["result"].to_string().contains("flüg [1]"), "{comparison}");
    let none = server.ask("POST", &format!("/api/v1/logs/{log}/import"), &[], "{}");
    assert_eq!(none.status, 404, "an example has no upload");
    let bad = server.ask(
        "POST",
        &format!("/api/v1/logs/{second}/import"),
        &[],
        r#"{"rate_hz":0}"#,
    );
    assert_eq!(bad.status, 422);

    // Lists by vehicle and time.
    let count = |query: &str| {
        server.get(&format!("/api/v1/logs?{query}"))["items"]
            .as_array()
            .map(Vec::len)
    };
    let at = server.get(&format!("/api/v1/logs/{log}"))["submitted_ms"]
        .as_i64()
        .expect("a time");
    assert_eq!((count("vehicle=f550"), count("vehicle=none")), (Some(2), Some(0)));
    assert_eq!(
        (
            count(&format!("to_ms={}", at + 1)),
            count(&format!("from_ms={}", at + 1))
        ),
        (Some(1), Some(1))
    );
}

#[test]
fn scenario_two_effects_that_look_alike_get_a_manoeuvre_that_tells() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let body = json!({ "model": { "vehicle": "f550" }, "between": ["mass", "air-density"] });
    let (id, job) = done(&server, "next-flights", &body);
    let best = &job["result"][0];
    assert!(best.is_object(), "{job}");
    let scenario = server.ask(
        "GET",
        &format!("/api/v1/next-flights/{id}/artifacts/next-flight.toml"),
        &[],
        "",
    );
    assert_eq!(scenario.status, 200);
    let text = String::from_utf8_lossy(&scenario.body).into_owned();
    assert!(text.contains("duration_s"), "a scenario: {text}");
    // It flies what lies beside it, and names no folder of the server.
    assert!(text.contains("vehicle = \"next-flight-vehicle.toml\""), "{text}");
    let folder = scratch.path("taken");
    std::fs::create_dir_all(&folder).expect("a folder");
    for name in [
        "next-flight.toml",
        "next-flight-vehicle.toml",
        "next-flight-blades.toml",
    ] {
        let file = server.ask("GET", &format!("/api/v1/next-flights/{id}/artifacts/{name}"), &[], "");
        assert_eq!(file.status, 200, "{name}");
        std::fs::write(folder.join(name), &file.body).expect("written");
    }
    Call::new(&scratch, ["check", "taken/next-flight.toml"])
        .run()
        .expect_code(0);
    // A vehicle that no model was made of may be asked for as a model, too; nothing else may.
    let body = json!({ "model": { "model": "f550" }, "between": ["mass", "air-density"] });
    let (_, job) = done(&server, "next-flights", &body);
    assert_eq!(job["result"][0], *best);
    let body = json!({ "model": { "model": "none" }, "between": ["mass", "air-density"] }).to_string();
    let refused = server.ask("POST", "/api/v1/next-flights", &[], &body);
    let why = String::from_utf8_lossy(&refused.body).into_owned();
    assert_eq!(refused.status, 404);
    assert!(
        why.contains("there is no model 'none': the library has no models yet"),
        "{why}"
    );
    let refused = |between: [&str; 2]| {
        let body = json!({ "model": { "vehicle": "f550" }, "between": between }).to_string();
        let answer = server.ask("POST", "/api/v1/next-flights", &[], &body);
        assert_eq!(answer.status, 422, "{between:?}");
        answer.json()["detail"].as_str().unwrap_or_default().to_owned()
    };
    let detail = refused(["mass", "mass"]);
    assert_eq!(detail, "`between`: expected two different effects, got mass twice");
    assert!(refused(["mass", "a b"]).contains("got `a b`; nearest: "));
    let detail = refused(["mass", "rotor-thrust-scale#7"]);
    assert_eq!(
        detail,
        "`between`: expected rotors 1 to 6 of f550, got rotor-thrust-scale#7"
    );
}

/// A CSV with custom column names: rejected, drafted as data, imported with the draft. A file that is not a table is
/// rejected under the name that its owner knows, and nothing reveals where the server stores it.
#[test]
fn scenario_a_table_of_another_program_is_drafted_and_imported() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start(&data);
    let headers = [("content-type", "application/octet-stream")];
    let sent = |name: &str, bytes: &[u8]| -> String {
        let answer = server.ask_bytes("POST", &format!("/api/v1/logs?name={name}"), &headers, bytes);
        answer.json()["id"].as_str().expect("an id").to_owned()
    };
    // A degree sign as written by old loggers (Latin-1) is not a reason to reject the table.
    let mut table =
        b"Clock [ms],GyrX [dps],GyrY [dps],GyrZ [dps],AccX,AccY,AccZ,Motor1,Motor2,Motor3,Motor4,Temp [\xb0C]\n"
            .to_vec();
    for k in 0..400 {
        table.extend(
            format!(
                "{},{}.5,0,1,0.01,0.02,0.998,{},1500,1498,1502,25\n",
                10 * k,
                k % 7,
                1500 + k % 9
            )
            .as_bytes(),
        );
    }
    let log = sent("logger.csv", &table);
    let refused = server.ended_in("logs", &log);
    assert_eq!(refused["status"], "failed", "{refused}");
    let answer = server.ask("GET", &format!("/api/v1/logs/{log}/mapping"), &[], "");
    assert_eq!(answer.status, 200, "{}", answer.json());
    let draft = answer.json();
    assert!(!draft.to_string().contains(&data.display().to_string()), "{draft}");
    assert!(
        draft["mapping"].as_str().expect("a text").contains("logger.csv"),
        "{draft}"
    );
    assert_eq!(draft["layout"]["clock_format"], "ms");
    assert_eq!(draft["columns"].as_array().map(Vec::len), Some(12));
    assert_eq!(draft["columns"][1]["unit"], "deg/s");
    let row = |to: &str| {
        let rows = draft["rows"].as_array().expect("rows");
        rows.iter().find(|row| row["to"] == to).cloned().unwrap_or_default()
    };
    assert_eq!(
        (&row("accel")["unit"], &row("accel")["frame"]),
        (&json!("g"), &json!("flu"))
    );
    assert_eq!(
        (&row("duty")["low"], &row("duty")["high"]),
        (&json!(1000.0), &json!(2000.0))
    );
    assert_eq!(draft["questions"][0]["about"], "duty");
    let body = json!({ "mapping": draft["mapping"] }).to_string();
    let again = server.ask("POST", &format!("/api/v1/logs/{log}/import"), &[], &body);
    assert_eq!(again.status, 202, "{}", again.json());
    let read = server.ended_in("logs", again.json()["id"].as_str().expect("an id"));
    assert_eq!(read["result"]["source"]["kind"], "mapped_csv", "{read}");
    assert_eq!(read["result"]["report"]["rows"], 400);
    // Drafted again of the log that was read: it is the same file.
    let id = read["id"].as_str().expect("an id");
    assert_eq!(
        server.get(&format!("/api/v1/logs/{id}/mapping"))["columns"],
        draft["columns"]
    );

    let picture = sent("picture.csv", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01");
    let refusal = server.ask("GET", &format!("/api/v1/logs/{picture}/mapping"), &[], "");
    assert_eq!(refusal.status, 422);
    let detail = refusal.json()["detail"].as_str().expect("a sentence").to_owned();
    assert!(detail.starts_with("picture.csv: not UTF-8 text"), "{detail}");
    let example = server.generated(&json!({ "preset": "healthy", "seed": 1 }));
    let none = server.ask("GET", &format!("/api/v1/logs/{example}/mapping"), &[], "");
    assert_eq!(none.status, 404, "an example has no upload");
}
