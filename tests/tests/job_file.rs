//! `rotortwin job FILE`: what a worker does for a server, from a file and without the server (docs/jobs.md).

use rotortwin_tests::program::{Call, Ended, Link, read_json};
use rotortwin_tests::scratch::{Scratch, repository, short_flight};
use serde_json::{Value, json};

/// Runs a job in the scratch folder.
fn job(scratch: &Scratch, job: &Value) -> Ended {
    let file = scratch.write("job.json", json!({ "version": 2, "job": job }).to_string());
    Call::new(scratch, ["job".into(), file.into_os_string()]).run()
}

/// Events, then the result.
fn said(ended: &Ended) -> (Vec<Value>, Value) {
    let is_event = |line: &&str| line.starts_with("{\"event\"") || line.contains("\"event\":");
    let events = ended.stdout.lines().take_while(is_event);
    let events: Vec<Value> = events
        .map(|line| serde_json::from_str(line).expect("a line of JSON"))
        .collect();
    let rest: Vec<&str> = ended.stdout.lines().skip(events.len()).collect();
    (
        events,
        serde_json::from_str(&rest.join("\n")).expect("the result as JSON"),
    )
}

/// A flight has the same run hash as with the command; verifying it gives the answer of the command.
#[test]
fn scenario_a_job_from_a_file_flies_and_verifies_as_the_commands_do() {
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    let flown = Call::fly(&scratch, Link::InProcess, &scenario, "by-command")
        .run()
        .expect_code(0);
    let summary = flown.summary();
    let ended = job(
        &scratch,
        &json!({
            "job": "run", "documents": summary.pointer("/scenario/text"), "seed": summary["seed"].to_string(),
            "link": "in-process", "pace": "fast",
        }),
    )
    .expect_code(0);
    let (events, result) = said(&ended);
    assert_eq!(result["run_hash"], summary["run_hash"]);
    assert_eq!(
        read_json(&scratch.path("out/summary.json"))["run_hash"],
        summary["run_hash"]
    );
    let kinds: Vec<&str> = events.iter().filter_map(|event| event["event"].as_str()).collect();
    assert!(
        kinds.contains(&"change") && kinds.last() == Some(&"finished"),
        "{kinds:?}"
    );

    let verified = job(&scratch, &json!({ "job": "verification", "run": "out" })).expect_code(0);
    let replayed = Call::new(&scratch, ["replay", "out", "--json"]).run().expect_code(0);
    assert_eq!(verified.stdout, replayed.stdout);
}

/// The other quick kinds: the result is what the command prints.
#[test]
fn scenario_a_job_from_a_file_reads_logs_as_the_commands_do() {
    let scratch = Scratch::new();
    let example = json!({ "job": "log-example", "vehicle": "f550", "seed": 3, "duration_s": 30.0, "out": "logs" });
    let (_, account) = said(&job(&scratch, &example).expect_code(0));
    assert_eq!(account, read_json(&scratch.path("logs/log.import.json")));

    let import = json!({ "job": "log-import", "file": "logs/log.parquet", "out": "again", "rate_hz": 50.0 });
    let (_, account) = said(&job(&scratch, &import).expect_code(0));
    assert_eq!(account, read_json(&scratch.path("again/log.import.json")));

    let vehicle = repository().join("config/vehicles/f550.toml");
    let comparison = json!({
        "job": "comparison", "logs": ["logs/log.parquet"], "model": [vehicle], "models": "models", "out": "compared",
    });
    let by_job = job(&scratch, &comparison).expect_code(0);
    let words = ["compare", "logs/log.parquet", "--json", "--model"].map(Into::into);
    let by_command = Call::new(&scratch, words.into_iter().chain([vehicle.into_os_string()])).run();
    assert_eq!(said(&by_job).1, said(&by_command.expect_code(0)).1);
    assert!(scratch.path("compared/comparison.txt").is_file());
}

/// One sentence, and exit code 2.
#[test]
fn scenario_a_job_from_a_file_is_refused_with_a_reason() {
    let scratch = Scratch::new();
    let verification = json!({ "job": "verification", "run": "there/is/none" });
    for (text, words) in [
        ("{".to_owned(), "job.json: this version of rotortwin does not understand the job: EOF"),
        (json!({ "version": 3, "job": verification }).to_string(), "a later version"),
        (
            json!({ "version": 2, "job": verification, "inputs": [{ "path": "x", "content": { "text": "" } }] }).to_string(),
            "it requires x as input",
        ),
        (json!({ "version": 2, "job": verification }).to_string(), "there/is/none"),
        (
            json!({ "version": 2, "job": { "job": "training", "method": "paper", "scenario": "no-such-flight", "seeds": 1, "first_seed": 1,
                "out": "x.json" } })
            .to_string(),
            "no-such-flight",
        ),
    ] {
        let file = scratch.write("job.json", text);
        let ended = Call::new(&scratch, ["job".into(), file.into_os_string()]).run().expect_code(2);
        assert!(ended.stderr.join("\n").contains(words), "{:?}", ended.stderr);
        assert_eq!(ended.stdout, "");
    }
}
