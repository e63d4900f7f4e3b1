//! Checks that everything accepted by a server is neither lost, duplicated nor stuck.

use crate::server::Server;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Accepted runs: id and seed by key.
pub type Accepted = BTreeMap<String, (String, u64)>;

/// Valid reasons for a run to fail after three disturbances: reported, not lost.
const REASONS: [&str; 5] = ["attempts", "died", "killed by signal", "space", "full"];

/// Submits a run under a key until it is accepted; returns the id.
///
/// # Panics
/// It is not accepted within two minutes, or the answer is 500.
pub fn submit_for_sure(address: &str, key: &str, run: &Value) -> String {
    let body = run.to_string();
    let request = format!(
        "POST /api/v1/runs HTTP/1.0\r\ncontent-type: application/json\r\nidempotency-key: {key}\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    );
    let begun = Instant::now();
    let mut last = String::new();
    loop {
        assert!(begun.elapsed() < Duration::from_secs(120), "nobody takes {key}: {last}");
        let answer = TcpStream::connect(address).and_then(|mut stream| {
            stream.set_read_timeout(Some(Duration::from_secs(20)))?;
            stream.write_all(request.as_bytes())?;
            let mut text = String::new();
            stream.read_to_string(&mut text)?;
            Ok(text)
        });
        match answer {
            Ok(answer) => {
                if (answer.starts_with("HTTP/1.0 202") || answer.starts_with("HTTP/1.0 200"))
                    && let Some((_, body)) = answer.split_once("\r\n\r\n")
                    && let Ok(run) = serde_json::from_str::<Value>(body)
                {
                    return run["id"].as_str().expect("an id").to_owned();
                }
                // Whatever dies, a server must answer that it is temporarily unavailable. 500 would mean an unexpected error.
                assert!(
                    !answer.starts_with("HTTP/1.0 500"),
                    "{key}: a fault of the server: {answer}"
                );
                last = answer;
            }
            Err(error) => last = error.to_string(),
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// A short flight in separate processes.
pub fn short_run(seed: u64) -> Value {
    json!({ "scenario": "short-hover", "seed": seed })
}

/// Invariants whatever was killed: as many runs as keys, each ended once, equal seeds with identical results. Returns how many failed.
///
/// # Panics
/// They do not hold.
pub fn nothing_lost_and_nothing_doubled(server: &Server, accepted: &Accepted) -> usize {
    let mut hashes: BTreeMap<u64, Value> = BTreeMap::new();
    let (mut failed, mut reasons) = (0, BTreeMap::<String, usize>::new());
    for (key, (id, seed)) in accepted {
        let run = server.ended(id);
        if run["status"] == "failed" {
            assert!(
                run["error"]
                    .as_str()
                    .is_some_and(|why| REASONS.iter().any(|words| why.contains(words))),
                "{run}"
            );
            failed += 1;
            *reasons.entry(run["error"].to_string()).or_default() += 1;
            continue;
        }
        assert_eq!(run["status"], "done", "{key}: {run}");
        assert_eq!(
            hashes.entry(*seed).or_insert_with(|| run["run_hash"].clone()),
            &run["run_hash"],
            "{key}"
        );
        let mut events = String::new();
        server
            .send("GET", &format!("/api/v1/runs/{id}/events"), &[], "")
            .read_to_string(&mut events)
            .expect("events");
        assert_eq!(events.matches("event: ended").count(), 1, "{key}");
    }
    let mut runs = 0;
    let mut cursor = String::new();
    loop {
        let page = server.get(&format!("/api/v1/runs?limit=1000{cursor}"));
        runs += page["items"].as_array().map_or(0, Vec::len);
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => break,
        }
    }
    assert_eq!(runs, accepted.len());
    eprintln!(
        "{runs} runs accepted, {} done, {failed} failed with the reason, 0 lost, 0 doubled, 0 stuck",
        runs - failed
    );
    for (reason, times) in reasons {
        eprintln!("  {times} × {reason}");
    }
    failed
}
