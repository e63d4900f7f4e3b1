//! Storage of the server's files: a bucket that several hosts share, and a full disk.

use rotortwin_tests::bucket::Bucket;
use rotortwin_tests::disk::Disk;
use rotortwin_tests::postgres::Postgres;
use rotortwin_tests::process::wait_until;
use rotortwin_tests::scratch::{Scratch, repository};
use rotortwin_tests::server::Server;
use serde_json::json;
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::time::Duration;

fn server_on(bucket: &Bucket, data: &Path) -> Server {
    let environment = bucket.environment();
    let environment = environment.each_ref().map(|(name, value)| (*name, value.as_str()));
    Server::start_in(
        &environment,
        "127.0.0.1:0",
        data,
        &["--artifacts", &bucket.address("bench")],
    )
}

#[test]
fn scenario_files_in_a_bucket_outlive_the_host() {
    let Some(bucket) = Bucket::start() else { return };
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let mut server = server_on(&bucket, &data);
    let id = server.submit(&json!({ "scenario": "short-hover", "link": "in-process" }));
    let run = server.ended(&id);
    assert_eq!(run["status"], "done", "{run}");
    // Files in the bucket are not kept on the host that flew; requested ones are kept as a copy.
    let copies = data.join("cache/jobs").join(&id);
    let left = wait_until(Duration::from_secs(10), || !copies.join("1/out/report.html").exists());
    assert!(left.is_some(), "the worker keeps its files");
    let report = format!("/api/v1/runs/{id}/artifacts/report.html");
    let before = server.ask("GET", &report, &[], "");
    assert_eq!(before.status, 200);
    assert!(copies.join("1/out/report.html").is_file());
    let keys = bucket.keys();
    assert!(keys.iter().any(|key| key.ends_with("/out/report.html")), "{keys:?}");
    assert!(keys.iter().all(|key| key.starts_with("bench/")), "{keys:?}");

    // A task reads another job's output through the bucket.
    let comparison = json!({ "model": { "vehicle": "f550" }, "flights": { "runs": [&id] } });
    let compared = server.submit_to("comparisons", &comparison);
    let compared = server.ended_in("comparisons", &compared);
    assert_eq!(compared["status"], "done", "{compared}");

    // The next process begins without copies.
    assert_eq!(server.stop(), Some(0));
    let server = server_on(&bucket, &data);
    assert!(!copies.exists());
    let after = server.ask("GET", &report, &[], "");
    let before_body = before.body;
    assert_eq!((after.status, &after.body), (200, &before_body));
    let range = server.ask("GET", &report, &[("range", "bytes=0-14")], "");
    assert_eq!((range.status, range.body.len()), (206, 15));
    let another = [("range", "bytes=0-14"), ("if-range", "\"another\"")];
    let whole = server.ask("GET", &report, &another, "");
    assert_eq!((whole.status, &whole.body), (200, &before_body));
    let lines = server.ask("GET", &report, &[("range", "lines=1-2")], "");
    assert_eq!(
        (lines.status, &lines.body),
        (200, &before_body),
        "an unknown unit is ignored"
    );
    let telemetry = server.ask(
        "GET",
        &format!("/api/v1/runs/{id}/telemetry?channels=position_ned_m_z&points=10"),
        &[],
        "",
    );
    assert_ne!(telemetry.status, 500, "{}", telemetry.json());
    let verify = || {
        server
            .ask(
                "POST",
                &format!("/api/v1/runs/{id}/verify"),
                &[("idempotency-key", "again")],
                "",
            )
            .json()
    };
    let again = verify();
    assert_eq!(again["same"], true, "{again}");

    assert_eq!(server.ask("DELETE", &format!("/api/v1/runs/{id}"), &[], "").status, 204);
    assert_eq!(verify(), again, "the same key is the same job, also without its run");
    let left = bucket.keys();
    assert!(!left.iter().any(|key| key.contains(&format!("jobs/{id}"))), "{left:?}");
}

#[test]
fn scenario_a_bucket_that_is_gone_is_named() {
    let Some(bucket) = Bucket::start() else { return };
    let scratch = Scratch::new();
    let server = server_on(&bucket, &scratch.path("data"));
    drop(bucket);
    let ready = server.ask("GET", "/readyz", &[], "");
    assert_eq!(ready.status, 503);
    assert!(
        ready.json()["detail"]
            .as_str()
            .is_some_and(|why| why.contains("file store")),
        "{}",
        ready.json()
    );
    assert_eq!(server.ask("GET", "/healthz", &[], "").status, 200, "it lives");
}

/// Until the disk is full, and after space has been freed.
#[test]
fn scenario_a_full_disk_is_a_clear_refusal_and_loses_nothing() {
    let scratch = Scratch::new();
    let Some(disk) = Disk::new(scratch.path("disk"), "16m") else {
        return;
    };
    let data = disk.path().join("data");
    let mut server = Server::start(&data);
    let flight = json!({ "scenario": "short-hover", "link": "in-process" });
    let first = server.submit(&flight);
    let first = server.ended(&first);
    assert_eq!(first["status"], "done", "{first}");

    // A foreign file leaves less space than a run needs, then none.
    let ballast = disk.path().join("ballast");
    let fill = |bytes: usize| {
        let mut file = std::fs::OpenOptions::new()
            .create(true)
            .append(true)
            .open(&ballast)
            .expect("it can be opened");
        // Fails when the disk is full.
        let _full = file.write_all(&vec![0; bytes]);
    };
    fill(16 << 20);
    let (mut accepted, mut refused) = (Vec::new(), 0);
    for _ in 0..40 {
        let answer = server.ask("POST", "/api/v1/runs", &[], &flight.to_string());
        match answer.status {
            202 => accepted.push(answer.json()["id"].as_str().expect("an id").to_owned()),
            507 => refused += 1,
            other => panic!("{other}: {}", answer.json()),
        }
        fill(1 << 20);
    }
    assert!(refused > 0, "{} accepted", accepted.len());
    let body = vec![b'x'; 1 << 20];
    let upload = server.ask_bytes(
        "POST",
        "/api/v1/logs?name=flight.csv",
        &[("content-type", "application/octet-stream")],
        &body,
    );
    assert_eq!(upload.status, 507, "{}", upload.json());
    // Requests that need a copy of the library or a row of their own say so, too: each was a 500.
    fill(1 << 20);
    let comparison = json!({ "model": { "vehicle": "f550" }, "flights": { "runs": [first["id"]] } });
    for (address, body) in [
        ("logs/generate", json!({ "preset": "healthy" })),
        ("campaigns", json!({ "campaign": "detector-ideal" })),
        ("blind-benches", json!({ "presets": ["singles"], "n": 1 })),
        ("comparisons", comparison),
    ] {
        let answer = server.ask("POST", &format!("/api/v1/{address}"), &[], &body.to_string());
        let told = answer.json();
        assert!(
            answer.status == 507
                && told["detail"]
                    .to_string()
                    .contains("the disk of the data folder is full"),
            "{address}: {} {told}",
            answer.status
        );
    }
    // Existing items are readable; watchdogs are told that there is no space.
    let id = first["id"].as_str().expect("an id").to_owned();
    let report = format!("/api/v1/runs/{id}/artifacts/report.html");
    assert_eq!(server.ask("GET", &report, &[], "").status, 200);
    let ready = server.ask("GET", "/readyz", &[], "");
    assert_eq!(ready.status, 503, "{}", String::from_utf8_lossy(&ready.body));
    assert!(
        ready.json()["detail"].to_string().contains("is not writable"),
        "{}",
        ready.json()
    );
    assert_eq!(server.ask("GET", "/healthz", &[], "").status, 200, "it lives");
    // It starts again on the full disk.
    assert_eq!(server.stop(), Some(0));
    server = Server::start(&data);
    fill(1 << 20);
    assert_eq!(server.ask("GET", &report, &[], "").status, 200);
    // Without one free byte the database cannot even record a deletion, and says so; nothing is lost.
    let full = server.ask("POST", "/api/v1/runs", &[], &flight.to_string());
    assert_eq!(full.status, 507, "{}", full.json());
    let deleted = server.ask("DELETE", &format!("/api/v1/runs/{id}"), &[], "");
    assert!(
        matches!(deleted.status, 204 | 507),
        "{}",
        String::from_utf8_lossy(&deleted.body)
    );
    let there = if deleted.status == 507 { 200 } else { 404 };
    assert_eq!(server.ask("GET", &report, &[], "").status, there);
    // With a little space, too little for a job to start, deleting makes room.
    let file = std::fs::File::options()
        .write(true)
        .open(&ballast)
        .expect("it is there");
    let length = file.metadata().expect("it has a length").len();
    file.set_len(length - (512 << 10)).expect("it can be cut");
    // An open file would keep its space when it is removed.
    drop(file);
    if there == 200 {
        let deleted = server.ask("DELETE", &format!("/api/v1/runs/{id}"), &[], "");
        assert_eq!(deleted.status, 204, "{}", String::from_utf8_lossy(&deleted.body));
    }
    assert_eq!(server.ask("GET", &report, &[], "").status, 404);
    assert!(!data.join("jobs").join(&id).exists(), "its files are gone");

    std::fs::remove_file(&ballast).expect("it can be removed");
    let ready = server.ask("GET", "/readyz", &[], "");
    assert_eq!(ready.status, 200, "{}", String::from_utf8_lossy(&ready.body));
    for id in &accepted {
        let run = server.ended(id);
        // Done, or failed with the reason: never lost.
        let why = run["error"].as_str().unwrap_or_default();
        assert!(
            run["status"] == "done" || why.contains("space") || why.contains("full"),
            "{run}"
        );
    }
    let last = server.submit(&flight);
    assert_eq!(server.ended(&last)["run_hash"], first["run_hash"]);
    assert_eq!(server.stop(), Some(0));
    let server = Server::start(&data);
    let runs = server.get("/api/v1/runs?limit=100")["items"].as_array().map(Vec::len);
    assert_eq!(runs, Some(accepted.len() + 1), "the database is whole");
}

/// A worker whose disk is full starts nothing: a job does not use up its attempts there, and is done once there is
/// space.
#[test]
fn scenario_a_worker_waits_for_room() {
    let scratch = Scratch::new();
    let Some(disk) = Disk::new(scratch.path("disk"), "64m") else {
        return;
    };
    let artifacts = disk.path().join("artifacts").display().to_string();
    let words = ["--workers", "1", "--artifacts", artifacts.as_str()];
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &words);
    assert!(disk.fill(), "nobody writes");
    let id = server.submit(&json!({ "scenario": "short-hover", "link": "in-process" }));
    std::thread::sleep(Duration::from_secs(4));
    let waits = server.get(&format!("/api/v1/runs/{id}"));
    assert_eq!(
        (&waits["status"], &waits["attempts"]),
        (&json!("queued"), &json!(0)),
        "{waits}"
    );
    let ready = server.ask("GET", "/readyz", &[], "");
    assert_eq!(ready.status, 503, "{}", ready.json());
    assert!(disk.resize("64m"), "there is room again");
    assert_eq!(server.ask("GET", "/readyz", &[], "").status, 200);
    let run = server.ended(&id);
    assert_eq!((&run["status"], &run["attempts"]), (&json!("done"), &json!(1)), "{run}");
}

fn upload(server: &Server, name: &str, headers: &[(&str, &str)], bytes: usize) -> rotortwin_tests::server::Answer {
    let headers = [headers, &[("content-type", "application/octet-stream")]].concat();
    server.ask_bytes(
        "POST",
        &format!("/api/v1/logs?name={name}"),
        &headers,
        &vec![b'x'; bytes],
    )
}

/// Contents of the folder of uploads.
fn uploads(data: &Path) -> Vec<String> {
    let entries =
        std::fs::read_dir(data.join("uploads")).map(|entries| entries.filter_map(Result::ok).collect::<Vec<_>>());
    let mut names: Vec<String> = entries
        .unwrap_or_default()
        .into_iter()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// A file counts from its acceptance until its log is deleted, whatever the outcome of the import.
#[test]
fn scenario_uploads_that_wait_fill_an_account() {
    const MEGABYTE: usize = 1_000_000;
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let words = ["--workers", "0", "--tenant-gigabytes", "1", "--largest-upload", "300"];
    let server = Server::start_at("127.0.0.1:0", &data, &words);
    let mut logs = Vec::new();
    for number in 0..3 {
        let log = upload(&server, "flight.csv", &[], 300 * MEGABYTE);
        assert_eq!(log.status, 202, "{number}: {}", log.json());
        assert_eq!(log.json()["bytes"], 300 * MEGABYTE);
        logs.push(log.json()["id"].as_str().expect("an id").to_owned());
    }
    assert_eq!(server.get("/api/v1/limits")["bytes"], 900 * MEGABYTE);
    let full = upload(&server, "flight.csv", &[], 101 * MEGABYTE);
    let told = full.json()["detail"].to_string();
    assert_eq!(full.status, 507, "{told}");
    for words in ["900000000 bytes of files", "101000000", "delete jobs"] {
        assert!(told.contains(words), "{words} is not in: {told}");
    }
    assert_eq!(uploads(&data).len(), 3, "what was refused is not kept");
    // A smaller one still fits, and then there is no room even for a flight.
    assert_eq!(upload(&server, "flight.csv", &[], 100 * MEGABYTE).status, 202);
    let flight = json!({ "scenario": "short-hover", "link": "in-process" }).to_string();
    assert_eq!(server.ask("POST", "/api/v1/runs", &[], &flight).status, 507);
    for action in ["POST", "DELETE"] {
        let cancel = if action == "POST" { "/cancel" } else { "" };
        let answer = server.ask(action, &format!("/api/v1/logs/{}{cancel}", logs[0]), &[], "");
        assert!(answer.status < 300, "{action}: {}", answer.status);
        let bytes = if action == "POST" { 1000 } else { 700 };
        assert_eq!(server.get("/api/v1/limits")["bytes"], bytes * MEGABYTE, "{action}");
    }
    assert_eq!(server.ask("POST", "/api/v1/runs", &[], &flight).status, 202);
}

/// Half an upload leaves nothing behind: neither when its client disconnects, nor when its server is killed in the
/// middle.
#[test]
fn scenario_half_an_upload_leaves_nothing() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let mut server = Server::start_at("127.0.0.1:0", &data, &["--workers", "0"]);
    let whole = upload(&server, "flight.csv", &[("idempotency-key", "whole")], 1000);
    assert_eq!(whole.status, 202, "{}", whole.json());
    let kept = uploads(&data);
    assert_eq!(kept.len(), 1);
    let begin = |server: &Server| {
        let mut stream = server.connect();
        let head = "POST /api/v1/logs?name=half.csv HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/octet-stream\r\n\
                    content-length: 1000000\r\n\r\n";
        stream.write_all(head.as_bytes()).expect("it takes the head");
        stream.write_all(&[b'x'; 400_000]).expect("it takes the first part");
        stream
    };
    let half_there = |data: &Path| uploads(data).len() == 2;
    let only_whole = || wait_until(Duration::from_secs(20), || uploads(&data) == kept);

    // The client disconnects.
    let stream = begin(&server);
    wait_until(Duration::from_secs(20), || half_there(&data)).expect("it is written as it comes");
    drop(stream);
    only_whole().unwrap_or_else(|| panic!("left by a client: {:?}", uploads(&data)));
    // The same file again: the second copy is removed.
    assert_eq!(
        upload(&server, "flight.csv", &[("idempotency-key", "whole")], 1000).status,
        200
    );
    assert_eq!(uploads(&data), kept);

    // The server is killed, twice: the next start removes what it finds.
    for _ in 0..2 {
        let _stream = begin(&server);
        wait_until(Duration::from_secs(20), || half_there(&data)).expect("it is written as it comes");
        server.kill();
        assert!(half_there(&data), "nobody could tidy up");
        server = Server::start_at("127.0.0.1:0", &data, &["--workers", "0"]);
        assert_eq!(uploads(&data), kept, "the whole one is kept, the half one is not");
        let marks = std::fs::read_dir(data.join("incoming")).map(Iterator::count);
        assert_eq!(marks.unwrap_or(0), 0);
    }
}

/// Two servers on one folder of files: one that starts does not touch uploads in progress on the other.
#[test]
fn scenario_a_start_leaves_the_uploads_of_another_server_alone() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(&scratch.path("")) else {
        return;
    };
    let (url, files) = (postgres.url(), scratch.path("files"));
    let place = files.display().to_string();
    let words = [
        "--workers",
        "0",
        "--database-url",
        url.as_str(),
        "--artifacts",
        place.as_str(),
    ];
    let one = Server::start_at("127.0.0.1:0", &scratch.path("one"), &words);
    let mut stream = one.connect();
    let head = "POST /api/v1/logs?name=slow.csv HTTP/1.0\r\ncontent-type: application/octet-stream\r\ncontent-length: 2000\r\n\r\n";
    stream.write_all(head.as_bytes()).expect("it takes the head");
    stream.write_all(&[b'x'; 1000]).expect("it takes the first half");
    wait_until(Duration::from_secs(20), || uploads(&files).len() == 1).expect("it is written as it comes");
    let _two = Server::start_at("127.0.0.1:0", &scratch.path("two"), &words);
    assert_eq!(uploads(&files).len(), 1);
    stream.write_all(&[b'x'; 1000]).expect("it takes the second half");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    assert!(answer.starts_with("HTTP/1.0 202"), "{answer}");
    assert_eq!(uploads(&files).len(), 1);
}

/// Copies of the library are made for jobs: those that no job names go at the next start, as does what a killed process left.
#[test]
fn scenario_a_start_removes_the_copies_of_the_library_that_no_job_names() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let mut server = Server::start_at("127.0.0.1:0", &data, &["--workers", "0"]);
    let copies = || {
        let entries = std::fs::read_dir(data.join("library")).expect("there are copies");
        let mut names: Vec<String> = entries
            .map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    };
    let blades = std::fs::read_to_string(repository().join("config/blades/t9545.toml")).expect("it is there");
    let campaign =
        "name = \"two\"\ndescription = \"two flights\"\nscenario = \"../scenarios/short-hover.toml\"\nflights = 2\n";
    // A job for each of two states of the library.
    let submitted = ["one", "two"].map(|state| {
        let text = format!("{blades}\n# {state}\n");
        let toml = [("content-type", "application/toml")];
        let put = server.ask("PUT", "/api/v1/blades/mine", &toml, &text);
        assert!(
            matches!(put.status, 200 | 201),
            "{}",
            String::from_utf8_lossy(&put.body)
        );
        let before = if state == "one" { Vec::new() } else { copies() };
        let id = server.submit_to("campaigns", &json!({ "text": campaign }));
        let now = copies();
        assert_eq!(now.len(), before.len() + 1, "{now:?}");
        let new = now.into_iter().find(|name| !before.contains(name));
        (id, new.expect("there is one more"))
    });
    let [(deleted, of_deleted), (kept, of_kept)] = &submitted;
    let address = format!("/api/v1/campaigns/{deleted}");
    assert_eq!(server.ask("POST", &format!("{address}/cancel"), &[], "").status, 202);
    assert_eq!(server.ask("DELETE", &address, &[], "").status, 204);
    assert!(copies().contains(of_deleted), "another job may be about to name it");

    // A copy that was never completed, a temporary one, and what is none.
    let [half, temporary, none] = [
        &*format!("library/{}", "0".repeat(32)),
        "temporary-library-x",
        "library/vehicles",
    ]
    .map(|name| data.join(name));
    for folder in [&half, &temporary, &none] {
        std::fs::create_dir(folder).expect("made");
        std::fs::write(folder.join("f550.toml"), "").expect("written");
    }
    server.kill();
    let server = Server::start_at("127.0.0.1:0", &data, &["--workers", "1"]);
    assert_eq!(copies(), [of_kept.as_str(), "vehicles"]);
    assert!(!temporary.exists() && none.join("f550.toml").exists());
    let job = server.ended_in("campaigns", kept);
    assert_eq!(job["status"], "done", "{job}");
}
