//! Telemetry over HTTP, live and as whole runs, compared with the run's Parquet file read row by row.

use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;
use rotortwin_tests::program::Call;
use rotortwin_tests::python::environment;
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::server::{Answer, Server};
use rotortwin_tests::websocket::WebSocket;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::Read as _;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// All values of a run's file, read row by row without the server's code.
fn recorded(data: &Path, id: &str) -> BTreeMap<String, Vec<f64>> {
    let path = data.join("jobs").join(id).join("1/out/telemetry.parquet");
    let reader = SerializedFileReader::new(std::fs::File::open(path).expect("it is there")).expect("it is Parquet");
    let mut columns: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for row in reader.get_row_iter(None).expect("it has rows") {
        for (name, field) in row.expect("a row").get_column_iter() {
            let value = match field {
                Field::Double(value) => *value,
                Field::Float(value) => f64::from(*value),
                Field::Int(value) => f64::from(*value),
                Field::ULong(value) => *value as f64,
                other => panic!("{name}: {other:?}"),
            };
            columns.entry(name.clone()).or_default().push(value);
        }
    }
    columns
}

fn numbers(answer: &Value, channel: &str) -> Vec<f64> {
    let values = answer["data"][channel]
        .as_array()
        .unwrap_or_else(|| panic!("{channel}"));
    values.iter().map(|value| value.as_f64().unwrap_or(f64::NAN)).collect()
}

#[test]
fn scenario_telemetry_over_http_is_what_the_file_holds() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start(&data);
    let ids =
        [1, 2].map(|seed| server.submit(&json!({ "scenario": "short-hover", "seed": seed, "link": "in-process" })));
    for id in &ids {
        assert_eq!(server.ended(id)["status"], "done");
    }
    let id = &ids[0];
    let file = recorded(&data, id);

    let channels = server.get(&format!("/api/v1/runs/{id}/channels"));
    let listed: Vec<&str> = channels["items"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|item| item["name"].as_str())
        .collect();
    assert_eq!(channels["rows"], file["time_s"].len());
    assert!(listed.len() == file.len() && listed.iter().all(|name| file.contains_key(*name)));
    let duty = channels["items"]
        .as_array()
        .and_then(|items| items.iter().find(|item| item["name"] == "duty_1"));
    assert_eq!(
        duty.map(|duty| (&duty["unit"], &duty["kind"])),
        Some((&json!("1"), &json!("f32")))
    );

    // Every row of an interval, bit for bit in the column's own precision.
    let part = server.get(&format!(
        "/api/v1/runs/{id}/telemetry?channels=roll_rad,duty_*,true_position_down_m,verdict_t_test&from_s=1&to_s=1.5"
    ));
    let (first, last) = (400, 600);
    assert_eq!((&part["rows"], &part["decimated"]), (&json!(201), &json!(false)));
    for (name, column) in part["data"].as_object().expect("columns") {
        let written = &file[name][first..=last];
        let same = numbers(&part, name).iter().zip(written).all(|(answer, written)| {
            let single = channels["items"]
                .as_array()
                .is_some_and(|items| items.iter().any(|item| item["name"] == **name && item["kind"] == "f32"));
            if single {
                *answer as f32 == *written as f32
            } else {
                answer == written
            }
        });
        assert!(same, "{name}: {column}");
    }
    assert!(part["data"].get("duty_4").is_some(), "a pattern gives all that fit");

    // A plot of the whole run: no channel loses an extreme, and time increases.
    let whole = server.get(&format!("/api/v1/runs/{id}/telemetry?channels=*&points=64"));
    assert_eq!((&whole["rows"], &whole["decimated"]), (&json!(64), &json!(true)));
    assert!(numbers(&whole, "time_s").windows(2).all(|pair| pair[0] < pair[1]));
    for (name, written) in &file {
        // Masks are decimated bit by bit.
        if ["faulty_rotors", "saturated_rotors", "sensor_faults", "suspect_rotors"].contains(&name.as_str()) {
            continue;
        }
        let ends = |values: &[f64]| {
            let fold = |pick: fn(f64, f64) -> f64| values.iter().copied().fold(f64::NAN, pick) as f32;
            (fold(f64::min), fold(f64::max))
        };
        let (answer, expected) = (ends(&numbers(&whole, name)), ends(written));
        assert!(
            answer == expected || expected.0.is_nan() && answer.0.is_nan(),
            "{name}: {answer:?} {expected:?}"
        );
    }

    // The other formats, by parameter and by header, and two runs together.
    let address = format!("/api/v1/runs/{id}/telemetry?channels=yaw_rad&points=10");
    let csv = server.ask("GET", &address, &[("accept", "text/csv")], "");
    assert!(csv.body.starts_with(b"time_s,yaw_rad\n0.0,") && csv.headers.contains("text/csv"));
    let both = format!(
        "/api/v1/telemetry?runs={},{}&channels=yaw_rad&points=10",
        ids[0], ids[1]
    );
    let parquet = server.ask("GET", &format!("{both}&format=parquet"), &[], "");
    let copy = scratch.write("both.parquet", &parquet.body);
    let reader = SerializedFileReader::new(std::fs::File::open(copy).expect("it is there")).expect("it is Parquet");
    assert_eq!(reader.metadata().file_metadata().num_rows(), 20);
    let two = server.get(&both);
    assert_eq!(
        (&two["items"][0]["run"], &two["items"][1]["run"]),
        (&json!(ids[0]), &json!(ids[1]))
    );
    assert_ne!(
        numbers(&two["items"][0], "yaw_rad"),
        numbers(&two["items"][1], "yaw_rad")
    );

    for (query, status, words) in [
        ("channels=rol_rad", 422, "roll_rad"),
        ("channels=yaw_rad&points=1", 400, "at least 2"),
        ("channels=yaw_rad&from_s=3&to_s=2", 422, "from_s ≤ to_s"),
        ("channels=yaw_rad&from_s=NaN", 400, "from_s"),
        ("channels=yaw_rad&points=-1", 400, "points"),
        ("channels=yaw_rad&format=xml", 400, "xml"),
        ("points=100", 400, "channels"),
    ] {
        let answer = server.ask("GET", &format!("/api/v1/runs/{id}/telemetry?{query}"), &[], "");
        let problem = answer.json();
        assert_eq!(answer.status, status, "{query}: {problem}");
        assert!(
            problem["detail"].as_str().is_some_and(|detail| detail.contains(words)),
            "{query}: {problem}"
        );
    }
    let nowhere = server.ask("GET", "/api/v1/telemetry?runs=none&channels=yaw_rad", &[], "");
    assert_eq!(nowhere.status, 404);
}

#[test]
fn scenario_a_run_that_flies_has_no_telemetry_yet() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let id = server.submit(&json!({ "scenario": "short-hover", "pace": "real-time", "set": ["duration_s=60"] }));
    for address in ["channels", "telemetry?channels=yaw_rad"] {
        let answer = server.ask("GET", &format!("/api/v1/runs/{id}/{address}"), &[], "");
        assert_eq!(answer.status, 409, "{}", answer.json());
    }
    assert_eq!(
        server.ask("POST", &format!("/api/v1/runs/{id}/cancel"), &[], "").status,
        202
    );
    server.ended(&id);
}

#[test]
fn scenario_live_samples_come_while_a_run_flies_and_end_with_it() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start(&data);
    let id = server.submit(&json!({ "scenario": "short-hover", "pace": "real-time", "set": ["duration_s=3"] }));
    let address = format!("/api/v1/runs/{id}/live");
    let mut live = WebSocket::open(
        &server,
        &format!("{address}?channels=roll_rad,true_position_down_m&rate_hz=50"),
    )
    .expect("it is opened");
    // Another client asks for less, then changes its mind, with an invalid message in between.
    let mut other = WebSocket::open(&server, &format!("{address}?channels=yaw_rad&rate_hz=2")).expect("it is opened");
    assert_eq!(
        other.next_message().expect("a start")["channels"],
        json!([{ "name": "yaw_rad", "unit": "rad" }])
    );
    other.say(&json!({ "channels": "yew_rad" }));
    other.say(&json!({ "channels": "duty_*", "rate_hz": 10 }));

    let start = live.next_message().expect("a start");
    assert_eq!(
        (&start["type"], &start["rate_hz"]),
        (&json!("start"), &json!(50.0)),
        "{start}"
    );
    let begun = Instant::now();
    let messages = live.rest();
    let most = begun.elapsed().as_secs_f64() * 50.0 + 2.0;
    let (end, samples) = messages.split_last().expect("an end");
    assert_eq!((&end["type"], &end["status"]), (&json!("end"), &json!("done")), "{end}");
    assert_eq!(
        (end["samples"].as_u64(), &end["lost"]),
        (Some(samples.len() as u64), &json!(0))
    );
    // 50 per second, with one at either end; the exact number depends on the machine.
    assert!(
        samples.len() >= 10 && samples.len() as f64 <= most,
        "{} of at most {most}",
        samples.len()
    );
    let file = recorded(&data, &id);
    let mut last = None;
    for sample in samples {
        let step = sample["step"].as_u64().expect("a step");
        assert!(Some(step) > last.replace(step), "samples come in order");
        let row = usize::try_from(step).expect("a step");
        let value = |name: &str| sample["values"][name].as_f64().expect("a number");
        assert_eq!(value("roll_rad") as f32, file["roll_rad"][row] as f32);
        assert_eq!(value("true_position_down_m"), file["true_position_down_m"][row]);
        assert_eq!(sample["values"].as_object().map(serde_json::Map::len), Some(2));
    }

    let heard = other.rest();
    let first = |kind: &str| heard.iter().find(|message| message["type"] == kind);
    assert!(
        first("error").is_some_and(|error| error["detail"].to_string().contains("yaw_rad")),
        "{heard:?}"
    );
    assert_eq!(
        first("start").map(|start| start["channels"].as_array().map(Vec::len)),
        Some(Some(6))
    );
    assert!(heard.iter().any(|message| message["values"].get("duty_6").is_some()));
    assert!(heard.last().is_some_and(|end| end["type"] == "end"));

    // Samples are not stored: no event mentions them.
    let mut events = String::new();
    let mut stream = server.send("GET", &format!("/api/v1/runs/{id}/events"), &[], "");
    stream.read_to_string(&mut events).expect("events");
    assert!(
        events.contains("event: ended") || events.contains("event:ended"),
        "{events}"
    );
    assert!(!events.contains("sample"));

    // A finished run: a start and an end. Invalid requests are refused before.
    let messages = WebSocket::open(&server, &address).expect("it is opened").rest();
    assert_eq!(
        messages.iter().map(|message| &message["type"]).collect::<Vec<_>>(),
        ["start", "end"]
    );
    for (path, status) in [
        (format!("{address}?rate_hz=0"), 400),
        (format!("{address}?rate_hz=1e-300"), 400),
        (format!("{address}?channels=nothing_like_it"), 422),
        (format!("{address}?speed=9"), 400),
        ("/api/v1/runs/none/live".to_owned(), 404),
    ] {
        let refusal = WebSocket::open(&server, &path).map(|_| ()).expect_err("it is refused");
        assert_eq!(refusal.0, status, "{path}: {}", refusal.1);
    }
    let plain = server.ask("GET", &address, &[], "");
    let told = plain.json();
    assert_eq!(
        (plain.status, &told["type"]),
        (400, &json!("/problems/bad-request")),
        "{told}"
    );
    assert!(told["detail"].to_string().contains("expected a WebSocket"), "{told}");
}

#[test]
fn scenario_a_watcher_that_does_not_listen_holds_no_flight_up() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let id = server.submit(&json!({ "scenario": "short-hover", "pace": "real-time", "set": ["duration_s=4"] }));
    let address = format!("/api/v1/runs/{id}/live?rate_hz=100");
    // All channels, never read.
    let deaf: Vec<WebSocket> = (0..20)
        .filter_map(|_| WebSocket::open(&server, &address).ok())
        .collect();
    assert_eq!(deaf.len(), 20);
    let run = server.ended(&id);
    assert_eq!(run["status"], "done", "{run}");
    let wall_s = run["summary"]["wall_s"].as_f64().expect("a time");
    // The pace is the wall clock's; a flight that waited for them would never have ended.
    assert!(wall_s < 30.0, "{wall_s}");
    drop(deaf);
}

/// Prints what PX4's own reader finds in a log: samples and some values of each topic, info fields, log messages.
const READ_WITH_PYULOG: &str = r"
import json, sys
from pyulog import ULog
log = ULog(sys.argv[1])
def some(values): return [float(v) for v in values[:3]] + [float(values[-1])]
print(json.dumps({
    'corrupt': log.file_corruption, 'last_us': int(log.last_timestamp),
    'rows': {t.name: len(t.data['timestamp']) for t in log.data_list},
    'topics': {t.name: {key: some(values) for key, values in t.data.items()} for t in log.data_list},
    'facts': log.msg_info_dict, 'lines': [m.message for m in log.logged_messages]}).replace('NaN', 'null'))
";

#[test]
fn val_a_whole_run_as_ulog_is_what_px4s_own_reader_reads() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start(&data);
    let id = server.submit(&json!({ "scenario": "short-hover", "link": "in-process" }));
    let run = server.ended(&id);
    let export = |format: &str, headers: &[(&str, &str)]| {
        server.ask("GET", &format!("/api/v1/runs/{id}/export?format={format}"), headers, "")
    };
    let folder = data.join("jobs").join(&id).join("1/out");

    // The same bytes over HTTP and from the command line; a part is a part of the whole; no temporary files remain.
    let ulog = export("ulog", &[]);
    assert!(
        ulog.status == 200 && ulog.headers.contains(&format!("{id}.ulg")),
        "{}",
        ulog.headers
    );
    let out = scratch.path("run.ulg");
    let words = |out: &Path, format: &str| {
        let mut words: Vec<OsString> = vec!["export".into(), folder.clone().into(), "--format".into()];
        words.extend([format.into(), "--out".into(), out.into()]);
        words
    };
    Call::new(&scratch, words(&out, "ulog")).run().expect_code(0);
    assert!(std::fs::read(&out).expect("it is there") == ulog.body);
    Call::new(&scratch, words(&out, "ulog")).run().expect_code(2);
    let part = export("ulog", &[("range", "bytes=1000-1999")]);
    assert!(part.status == 206 && part.body == ulog.body[1000..2000]);
    // A download that broke off goes on: the run's export is the same file each time it is made.
    let tag = |answer: &Answer| {
        let line = answer
            .headers
            .lines()
            .find(|line| line.to_ascii_lowercase().starts_with("etag:"));
        line.and_then(|line| line.split_once(": "))
            .map(|(_, tag)| tag.trim().to_owned())
    };
    let first = tag(&ulog).expect("an entity tag");
    std::thread::sleep(std::time::Duration::from_millis(1100));
    let rest = export("ulog", &[("range", "bytes=2000-"), ("if-range", &first)]);
    assert!(rest.status == 206 && rest.body == ulog.body[2000..], "{}", rest.headers);
    assert_eq!(tag(&rest), Some(first));
    // Not as a part of another file.
    let other = export("ulog", &[("range", "bytes=2000-"), ("if-range", "\"another\"")]);
    assert!(other.status == 200 && other.body == ulog.body, "{}", other.headers);
    assert_eq!(export("mcap", &[("range", "bytes=1-4")]).body, b"MCAP");
    // A range beyond the end, and another version than the one asked for, are told as problems.
    let refused = |answer: &Answer, status: u16, words: &str| {
        let text = String::from_utf8_lossy(&answer.body).into_owned();
        assert!(
            answer.status == status && text.contains(words),
            "{}: {text}",
            answer.status
        );
        assert!(
            answer.headers.contains("application/problem+json"),
            "{}",
            answer.headers
        );
    };
    let beyond = export("ulog", &[("range", "bytes=99999999-")]);
    refused(&beyond, 416, "none in the range asked for");
    assert!(
        beyond.headers.contains(&format!("bytes */{}", ulog.body.len())),
        "{}",
        beyond.headers
    );
    let artifact = format!("/api/v1/runs/{id}/artifacts/summary.json");
    let summary = server.ask("GET", &artifact, &[], "");
    let own = tag(&summary).expect("an entity tag");
    let held = server.ask("GET", &artifact, &[("if-match", &own)], "");
    assert!(held.status == 200 && held.body == summary.body, "{}", held.headers);
    refused(
        &server.ask("GET", &artifact, &[("if-match", "\"another\"")], ""),
        412,
        "If-Match",
    );
    assert!(export("parquet", &[]).body == std::fs::read(folder.join("telemetry.parquet")).expect("it is there"));
    assert_eq!(
        std::fs::read_dir(data.join("exports")).map(Iterator::count).ok(),
        Some(0)
    );

    let file = recorded(&data, &id);
    let csv = String::from_utf8(export("csv", &[]).body).expect("text");
    let mut lines = csv.lines();
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    assert_eq!((names.len(), lines.clone().count()), (file.len(), file["time_s"].len()));
    for (row, line) in lines.enumerate().step_by(100) {
        for (name, cell) in names.iter().zip(line.split(',')) {
            let (value, written) = (cell.parse().unwrap_or(f64::NAN), file[*name][row]);
            let same = value == written || value as f32 == written as f32 && f64::from(written as f32) == written;
            assert!(
                same || value.is_nan() && written.is_nan(),
                "{name} row {row}: {cell}, {written}"
            );
        }
    }
    assert_eq!(export("avi", &[]).status, 400);

    let Some(programs) = environment("python-pyulog", &["pyulog==1.3.0"]) else {
        return;
    };
    let output = Command::new(programs.join("python"))
        .args(["-c", READ_WITH_PYULOG])
        .arg(&out)
        .output()
        .expect("Python starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let rows = file["time_s"].len();
    assert_eq!(
        (&read["corrupt"], read["last_us"].as_u64()),
        (&json!(false), Some((rows as u64 - 1) * 2500))
    );
    let counts = read["rows"].as_object().expect("topics");
    assert!(
        counts.len() == 13 && counts.values().all(|count| *count == rows),
        "{counts:?}"
    );
    assert_eq!(read["facts"]["rotortwin_run_hash"], run["run_hash"]);
    assert!(read["lines"].to_string().contains("truth: no rotor is faulty"));
    for (topic, field, column) in [
        ("sensor_combined", "gyro_rad[2]", "yaw_rate_rad_s"),
        ("sensor_combined", "accelerometer_m_s2[0]", "accel_x_m_s2"),
        ("vehicle_local_position", "z", "position_down_m"),
        ("vehicle_local_position_setpoint", "z", "reference_down_m"),
        ("actuator_motors", "control[5]", "duty_6"),
        ("battery_status", "voltage_v", "battery_voltage_v"),
        ("rotortwin_truth", "thrust_n[2]", "true_thrust_3_n"),
        ("rotortwin_truth", "state_of_charge", "true_state_of_charge"),
        ("rotortwin_fdi", "residual_yaw_nms[4]", "residual_5_yaw_nms"),
        ("rotortwin_fdi", "verdict_sequential", "verdict_sequential"),
    ] {
        let written = &file[column];
        let expected = [written[0], written[1], written[2], written[rows - 1]];
        let found = read["topics"][topic][field]
            .as_array()
            .unwrap_or_else(|| panic!("{topic} {field}"));
        for (found, expected) in found.iter().zip(expected) {
            let same = found.as_f64().map_or(expected.is_nan(), |found| found == expected);
            assert!(same, "{topic} {field}: {found}, {expected}");
        }
    }
}
