//! Shards of a campaign in an object store: flown in any order, killed and resumed, merged.

use rotortwin_tests::bucket::Bucket;
use rotortwin_tests::process::wait_until;
use rotortwin_tests::program::{Call, Ended, PATIENCE};
use rotortwin_tests::python::client_environment;
use rotortwin_tests::scratch::{Scratch, short_flight};
use rustix::process::Signal;
use serde_json::Value;
use std::ffi::OsString;
use std::path::PathBuf;

/// Files that must be byte-identical, wherever the flights were flown.
const RESULTS: [&str; 4] = ["campaign.parquet", "campaign.csv", "summary.json", "report.html"];

/// Shards of the campaign.
const SHARDS: usize = 10;

fn campaign(scratch: &Scratch, seed: u64) -> PathBuf {
    scratch.write("short.toml", short_flight());
    let text = format!(
        "name = 'c'\ndescription = 'of the system tests'\nscenario = 'short.toml'\nseed = {seed}\nflights = 320\n\
         [[axis]]\nname = 'loss'\nkey = 'fault[0].thrust_loss_percent'\nlog_uniform = [2.0, 30.0]\n"
    );
    scratch.write("c.toml", text)
}

fn call(scratch: &Scratch, bucket: &Bucket, words: &[&str]) -> Call {
    let environment = bucket.environment().map(|(name, value)| format!("{name}={value}"));
    let before = ["env".to_owned()].into_iter().chain(environment);
    Call::new(scratch, words.iter().copied()).behind(before.map(OsString::from))
}

fn shards(bucket: &Bucket, prefix: &str) -> usize {
    let below = format!("{prefix}/shards/");
    bucket.keys().iter().filter(|key| key.starts_with(&below)).count()
}

#[track_caller]
fn refused(ended: &Ended, words: &[&str]) {
    let printed = ended.stderr.join("\n");
    assert_eq!(ended.code, Some(2), "{printed}");
    for word in words {
        assert!(printed.contains(word), "{word:?} is not in: {printed}");
    }
}

#[test]
fn scenario_shards_in_a_bucket_are_the_bytes_of_one_machine() {
    let Some(bucket) = Bucket::start() else { return };
    let scratch = Scratch::new();
    let file = campaign(&scratch, 5);
    let file = file.to_str().expect("a text");
    let there = bucket.address("night");
    let there = there.as_str();
    let fly = |shards: &str| {
        let words = [
            "campaign", file, "--shards", shards, "--out", there, "--jobs", "1", "--json",
        ];
        call(&scratch, &bucket, &words)
    };
    let said = |ended: Ended| -> Value { serde_json::from_str(&ended.expect_code(0).stdout).expect("JSON") };
    Call::new(&scratch, ["campaign", file, "--out", "one"])
        .run()
        .expect_code(0);

    // The last ones first; then some that are killed on the way, twice; then all, most of which exist already.
    let last = said(fly("7..10").run());
    assert_eq!((&last["flights"], &last["complete"]), (&96.into(), &true.into()));
    for at in [4, 6] {
        let mut run = fly("0..8").start();
        let reached = wait_until(PATIENCE, || shards(&bucket, "night") >= at || run.has_ended());
        assert!(reached.is_some(), "{at} shards did not appear");
        run.supervisor().signal(Signal::KILL);
        assert_eq!(run.end(PATIENCE).code, None);
    }
    let before = shards(&bucket, "night");
    assert!((6..SHARDS).contains(&before), "{before}: it was not killed half-way");
    let merge = |out: &str, more: &[&str]| {
        let words = [&["campaign", "merge", file], more, &[there, "--out", out, "--json"]].concat();
        call(&scratch, &bucket, &words).run()
    };
    let early = merge("early", &[]);
    assert_eq!(early.code, Some(1));
    let missing = format!("{} of {SHARDS} shards are missing", SHARDS - before);
    assert!(early.stderr.join("\n").contains(&missing), "{:?}", early.stderr);
    let in_part = merge(there, &[]);
    assert_eq!((in_part.code, in_part.stdout.as_str()), (Some(1), ""));
    assert!(in_part.stderr.join("\n").contains(&missing), "{:?}", in_part.stderr);
    assert!(
        !bucket.keys().iter().any(|key| key.ends_with("summary.json")),
        "no part of the results"
    );
    let rest = said(fly("0..10").run());
    assert_eq!(
        rest["flights"],
        32 * (SHARDS - before),
        "what is there is not flown again"
    );
    assert_eq!(said(fly("0..10").run())["flights"], 0);

    // With and without a folder that holds some of them; twice into the same one.
    let part = ["campaign", file, "--shards", "2..4", "--out", "part"];
    Call::new(&scratch, part).run().expect_code(0);
    merge("whole", &[]).expect_code(0);
    merge("whole", &["part"]).expect_code(0);
    merge("early", &["part"]).expect_code(0);
    for out in ["whole", "early"] {
        for name in RESULTS {
            let [one, other] =
                ["one", out].map(|folder| std::fs::read(scratch.path(folder).join(name)).expect("it was written"));
            assert!(one == other, "{name} of {out} differs");
        }
    }

    // The results in the store, too: twice, which changes nothing, and not over others' bytes.
    merge(there, &[]).expect_code(0);
    merge(there, &["part"]).expect_code(0);
    bucket.put("strange/campaign.csv", "flight\n1\n");
    let strange = bucket.address("strange");
    refused(&merge(&strange, &[]), &[&strange, "campaign.csv", "another version"]);

    // Queried where they are stored.
    let Some(programs) = client_environment() else { return };
    let sql = "SELECT count(*) AS flights, count(DISTINCT run_hash) AS hashes, min(folder) AS folder FROM shards";
    let python = programs.join("python").display().to_string();
    let asked = call(&scratch, &bucket, &["query", sql, there, "--csv", "--python", &python]).run();
    assert_eq!(asked.expect_code(0).stdout, "flights,hashes,folder\n320,320,shards\n");
    let sql = "SELECT count(*) AS flights, count(DISTINCT run_hash) AS hashes FROM campaign";
    let asked = call(&scratch, &bucket, &["query", sql, there, "--csv", "--python", &python]).run();
    assert_eq!(asked.expect_code(0).stdout, "flights,hashes\n320,320\n");
}

#[test]
fn scenario_what_does_not_belong_into_a_bucket_is_refused() {
    let Some(bucket) = Bucket::start() else { return };
    let scratch = Scratch::new();
    let file = campaign(&scratch, 5);
    let file = file.to_str().expect("a text");
    let there = bucket.address("night");
    let there = there.as_str();
    let ask = |words: &[&str]| call(&scratch, &bucket, words).run();
    let one = ["campaign", file, "--shards", "0..1", "--out", there];
    refused(
        &ask(&["campaign", file, "--out", there]),
        &["an object store takes shards", "--shards FIRST..END"],
    );
    refused(&ask(&["campaign", "merge", file, "part", "--out", there]), &["part"]);
    refused(
        &ask(&["campaign", "merge", file, there, "--out", "empty"]),
        &[there, "has no campaign.json"],
    );
    assert_eq!(bucket.keys(), Vec::<String>::new(), "nothing was written");
    ask(&one).expect_code(0);

    // Not the bytes of these flights.
    bucket.put("night/shards/000001.parquet", "damaged");
    refused(
        &ask(&["campaign", "merge", file, there, "--out", "whole"]),
        &["night/shards/000001.parquet", "not a whole Parquet file"],
    );
    // A shard that another machine flew with other settings.
    ask(&["campaign", file, "--shards", "1..2", "--out", "part"]).expect_code(0);
    refused(
        &ask(&["campaign", "merge", file, "part", there, "--out", "other"]),
        &[there, "shard 1 differs"],
    );
    // The same name, different draws.
    campaign(&scratch, 6);
    refused(&ask(&one), &[there, "holds flights of another campaign"]);
    refused(
        &ask(&["campaign", "merge", file, there, "--out", "third"]),
        &["holds flights of another campaign"],
    );
}
