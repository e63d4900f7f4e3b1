//! Telemetry over HTTP, held against the Parquet file of the run as a reader of rows sees it.

use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::server::Server;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// All values of a run's file, read row by row: no code of the server's.
fn recorded(data: &Path, id: &str) -> BTreeMap<String, Vec<f64>> {
    let path = data.join("runs").join(id).join("1/telemetry.parquet");
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

    // A picture of the whole run: no channel loses an extreme, and the time rises.
    let whole = server.get(&format!("/api/v1/runs/{id}/telemetry?channels=*&points=64"));
    assert_eq!((&whole["rows"], &whole["decimated"]), (&json!(64), &json!(true)));
    assert!(numbers(&whole, "time_s").windows(2).all(|pair| pair[0] < pair[1]));
    for (name, written) in &file {
        // Masks are decimated by bits.
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

    // The other formats, by name and by header, and two runs at once.
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
        ("channels=yaw_rad&points=1", 422, "at least 2"),
        ("channels=yaw_rad&from_s=3&to_s=2", 422, "from_s ≤ to_s"),
        ("channels=yaw_rad&from_s=NaN", 422, "from_s ≤ to_s"),
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
