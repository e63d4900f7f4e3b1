//! `rotortwin campaign`: killed and resumed, stopped, refused, single flights repeated, memory.

use rotortwin_tests::process::wait_until;
use rotortwin_tests::program::{Call, Ended, PATIENCE, Run};
use rotortwin_tests::scratch::{Scratch, short_flight};
use rustix::process::Signal;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Files that must be byte-identical, however the campaign was completed.
const RESULTS: [&str; 4] = ["campaign.parquet", "campaign.csv", "summary.json", "report.html"];

/// A campaign over the short flight.
fn campaign(scratch: &Scratch, flights: u32, duration_s: f64) -> PathBuf {
    scratch.write("short.toml", short_flight());
    let text = format!(
        "name = 'c'\ndescription = 'of the system tests'\nscenario = 'short.toml'\nseed = 5\nflights = {flights}\n\
         [set]\nduration_s = {duration_s:?}\n\
         [[axis]]\nname = 'charge'\nkey = 'initial.state_of_charge'\nvalues = [0.4, 0.9]\n\
         [[axis]]\nname = 'rotor'\nkey = 'fault[0].rotor'\nrotors = true\npick = 'any'\n\
         [[axis]]\nname = 'loss'\nkey = 'fault[0].thrust_loss_percent'\nlog_uniform = [2.0, 30.0]\n\
         [operating_curve]\nevidence_nats = [15.0, 40.0]\n"
    );
    scratch.write("c.toml", text)
}

fn call(scratch: &Scratch, file: &Path, out: &str, more: &[&str]) -> Call {
    let call = Call::new(scratch, ["campaign".into(), file.as_os_str().to_owned()]);
    call.with(["--out".into(), scratch.path(out).into_os_string()])
        .with(more)
}

fn shards(scratch: &Scratch, out: &str) -> usize {
    let entries = std::fs::read_dir(scratch.path(out).join("shards"));
    let is_whole = |entry: &std::fs::DirEntry| entry.path().extension().is_some_and(|extension| extension == "parquet");
    entries.map_or(0, |entries| entries.flatten().filter(is_whole).count())
}

/// Waits until a run has written this many shards.
fn wait_for_shards(run: &mut Run, scratch: &Scratch, out: &str, count: usize) {
    let reached = wait_until(PATIENCE, || shards(scratch, out) >= count || run.has_ended());
    assert!(reached.is_some(), "{count} shards did not appear");
}

#[track_caller]
fn assert_same_results(scratch: &Scratch, one: &str, other: &str) {
    for name in RESULTS {
        let [one, other] = [one, other].map(|out| std::fs::read(scratch.path(out).join(name)).expect("it was written"));
        assert!(one == other, "{name} differs");
    }
}

#[track_caller]
fn assert_refused(ended: &Ended, words: &[&str]) {
    let printed = ended.stderr.join("\n");
    assert_eq!((ended.code, ended.stdout.as_str()), (Some(2), ""), "{printed}");
    assert_eq!(ended.stderr.len(), 1, "one sentence is expected: {printed}");
    for word in words {
        assert!(printed.contains(word), "{word:?} is not in: {printed}");
    }
}

#[test]
fn scenario_killed_twice_and_gone_on_with_gives_the_same_bytes() {
    let scratch = Scratch::new();
    let file = campaign(&scratch, 320, 20.0);
    call(&scratch, &file, "whole", &["--threads", "2"]).run().expect_code(0);
    assert_eq!(shards(&scratch, "whole"), 10);
    for at in [2, 5] {
        let mut run = call(&scratch, &file, "killed", &["--threads", "1"]).start();
        wait_for_shards(&mut run, &scratch, "killed", at);
        run.supervisor().signal(Signal::KILL);
        assert_eq!(run.end(PATIENCE).code, None);
    }
    assert!(
        (5..10).contains(&shards(&scratch, "killed")),
        "it was not killed half-way"
    );
    // Left by a kill during the writing of a shard.
    scratch.write("killed/shards/000009.part", "half");
    call(&scratch, &file, "killed", &["--threads", "3"])
        .run()
        .expect_code(0);
    assert_same_results(&scratch, "whole", "killed");
    assert!(!scratch.path("killed/shards/000009.part").exists());
    // Nothing left to do: the same result.
    call(&scratch, &file, "killed", &[]).run().expect_code(0);
    assert_same_results(&scratch, "whole", "killed");
}

#[test]
fn scenario_interrupted_says_how_to_go_on_and_leaves_what_is_there() {
    let scratch = Scratch::new();
    let file = campaign(&scratch, 320, 20.0);
    let mut run = call(&scratch, &file, "stopped", &["--threads", "1"]).start();
    wait_for_shards(&mut run, &scratch, "stopped", 2);
    run.supervisor().signal(Signal::INT);
    let ended = run.end(PATIENCE).expect_code(1);
    let lines: Vec<&str> = ended.stdout.lines().collect();
    assert!(
        matches!(lines.as_slice(), [.., why, command]
            if why.starts_with("Stopped: ") && why.ends_with("To resume:") && command.starts_with("rotortwin campaign ")),
        "{lines:?}"
    );
    let summary = summary(&scratch, "stopped");
    let flights = summary["flights"].as_u64().expect("a number");
    assert!(
        summary["complete"] == false && (64..320).contains(&flights),
        "{flights}"
    );
    let flown = format!("Speed        {flights} flights in ");
    assert!(
        ended.stdout.contains(&flown),
        "what was flown is kept: {}",
        ended.stdout
    );
    assert!(scratch.path("stopped/report.html").is_file());
    call(&scratch, &file, "stopped", &["--limit", "100"]).run();
    call(&scratch, &file, "stopped", &[]).run().expect_code(0);
    call(&scratch, &file, "whole", &[]).run().expect_code(0);
    assert_same_results(&scratch, "whole", "stopped");
}

/// It said that the whole budget had been searched, that most flights had not reached their end, and exit code 0.
#[test]
fn regress_a_hunt_that_is_stopped_counts_only_what_was_flown() {
    let scratch = Scratch::new();
    let file = campaign(&scratch, 320, 20.0);
    let more = ["--hunt", "--hunt-budget", "100000", "--json"];
    let run = call(&scratch, &file, "hunted", &more).start();
    let begun = wait_until(PATIENCE, || scratch.path("hunted").is_dir());
    assert!(begun.is_some(), "it does not begin");
    // Signals are caught right after the folder has been made.
    std::thread::sleep(Duration::from_secs(1));
    run.supervisor().signal(Signal::INT);
    let ended = run.end(PATIENCE).expect_code(1);
    let found: serde_json::Value = serde_json::from_str(&ended.stdout).expect("JSON");
    assert_eq!(found["stopped"], true, "{found}");
    let flights = found["flights"].as_u64().expect("a number");
    assert!(flights < 100_000, "{flights} were not flown within a second");
}

fn summary(scratch: &Scratch, out: &str) -> serde_json::Value {
    let text = std::fs::read_to_string(scratch.path(out).join("summary.json")).expect("it was written");
    serde_json::from_str(&text).expect("JSON")
}

#[test]
fn scenario_one_flight_again_is_the_flight_of_the_campaign() {
    let scratch = Scratch::new();
    let file = campaign(&scratch, 40, 6.0);
    call(&scratch, &file, "all", &[]).run().expect_code(0);
    let table = std::fs::read_to_string(scratch.path("all/campaign.csv")).expect("it was written");
    let row = table.lines().find(|line| line.starts_with("37,")).expect("flight 37");
    call(&scratch, &file, "one", &["--flight", "37"]).run().expect_code(0);
    let hash = summary(&scratch, "one")["run_hash"]
        .as_str()
        .expect("a hash")
        .to_owned();
    assert!(hash.len() == 32 && row.contains(&hash), "{hash} is not in {row}");
    assert_refused(
        &call(&scratch, &file, "none", &["--flight", "40"]).run(),
        &["--flight: expected a number from 0 to 39, got 40"],
    );
}

#[test]
fn scenario_folder_of_something_else_is_refused_untouched() {
    let scratch = Scratch::new();
    let file = campaign(&scratch, 32, 6.0);
    call(&scratch, &file, "out", &[]).run().expect_code(0);
    let before = std::fs::read(scratch.path("out/campaign.parquet")).expect("it was written");

    let text = std::fs::read_to_string(&file).expect("it was written");
    let changed = scratch.write("changed.toml", text.replace("seed = 5", "seed = 6"));
    assert_refused(
        &call(&scratch, &changed, "out", &[]).run(),
        &["out: holds flights of another campaign", "changed.toml", "--out"],
    );
    // The base scenario counts as well as the campaign.
    scratch.write("short.toml", short_flight().replace("time_s = 5.0", "time_s = 5.5"));
    assert_refused(
        &call(&scratch, &file, "out", &[]).run(),
        &["another campaign", "has changed since"],
    );
    scratch.write("short.toml", short_flight());

    let manifest = scratch.path("out/campaign.json");
    let good = std::fs::read_to_string(&manifest).expect("it was written");
    scratch.write("out/campaign.json", good.replace("rotortwin 0.", "rotortwin 99."));
    assert_refused(
        &call(&scratch, &file, "out", &[]).run(),
        &["was created by rotortwin 99."],
    );
    scratch.write("out/campaign.json", &good);

    scratch.write("other/notes.txt", "mine");
    assert_refused(
        &call(&scratch, &file, "other", &[]).run(),
        &["other: holds files that are not those of a campaign"],
    );
    scratch.write("out/shards/000000.parquet", "not Parquet");
    assert_refused(
        &call(&scratch, &file, "out", &[]).run(),
        &["000000.parquet: not a whole Parquet file"],
    );
    assert_eq!(
        std::fs::read(scratch.path("out/campaign.parquet")).expect("untouched"),
        before
    );
}

#[test]
fn scenario_bad_campaigns_are_refused_up_front() {
    let scratch = Scratch::new();
    let good = std::fs::read_to_string(campaign(&scratch, 32, 6.0)).expect("it was written");
    for (from, to, words) in [
        (
            "flights = 32",
            "flight = 32",
            vec!["bad.toml, line 5, key `flight`: unknown key"],
        ),
        (
            "'short.toml'",
            "'gone.toml'",
            vec!["line 3, key `scenario`", "found none at"],
        ),
        (
            "log_uniform = [2.0, 30.0]",
            "log_uniform = [2.0, 130.0]",
            vec![
                "key `axis[2]`",
                "loss = 130",
                "`fault[0].thrust_loss_percent`",
                "from -30 to 100 %, got 130",
            ],
        ),
        (
            "'initial.state_of_charge'",
            "'initial.charge'",
            vec!["key `axis[0]`", "charge = 0.4", "`initial.charge`: unknown key"],
        ),
        (
            "'fault[0].rotor'",
            "'fault[3].rotor'",
            vec!["`fault[3].rotor`: there is no entry [3], the list has 1"],
        ),
        (
            "duration_s = 6.0",
            "duration_s = 4.0",
            vec!["`fault[0].time_s`: this fault cannot have an effect"],
        ),
        (
            "rotors = true",
            "range = [6, 7]",
            vec!["rotor = 7", "expected a rotor from 1 to 6, got 7"],
        ),
    ] {
        assert!(good.contains(from), "{from}");
        let file = scratch.write("bad.toml", good.replace(from, to));
        let before = scratch.listing();
        let ended = call(&scratch, &file, "out", &[]).run();
        assert_refused(&ended, &words);
        assert_eq!(scratch.listing(), before, "{to}: something was written");
    }
}

/// A failed flight is a row with its reason, and the others are flown.
#[test]
fn scenario_lost_vehicle_is_a_row_with_its_reason() {
    let scratch = Scratch::new();
    scratch.write("short.toml", short_flight());
    let text = "name = 'lost'\ndescription = 'd'\nscenario = 'short.toml'\n\
                [set]\nduration_s = 12.0\nvehicle = 'VEHICLE'\nfault = [{ time_s = 5.0, rotor = 1, thrust_loss_percent = 5.0 }]\n\
                [[axis]]\nname = 'loss'\nkey = 'fault[0].thrust_loss_percent'\nvalues = [5.0, 100.0]\n";
    let vehicle = rotortwin_tests::scratch::repository().join("config/vehicles/quad-x.toml");
    let file = scratch.write("lost.toml", text.replace("VEHICLE", &vehicle.display().to_string()));
    let ended = call(&scratch, &file, "out", &[]).run().expect_code(0);
    assert!(ended.stdout.contains("the vehicle was lost at"), "{}", ended.stdout);
    let summary = summary(&scratch, "out");
    assert_eq!((&summary["done"], &summary["failed"]), (&1.into(), &1.into()));
    // Named before the vehicle tumbles.
    assert_eq!(summary["detectors"]["sequential"]["isolated"]["flights"], 2);
}

/// A fault before the end of the detectors' calibration is accepted, but with a warning.
#[test]
fn scenario_faults_inside_the_calibration_are_warned_of() {
    let scratch = Scratch::new();
    let file = campaign(&scratch, 32, 6.0);
    let ended = call(&scratch, &file, "out", &["--check"]).run().expect_code(0);
    assert!(ended.stderr.is_empty(), "{:?}", ended.stderr);
    scratch.write("short.toml", short_flight().replace("time_s = 5.0", "time_s = 2.0"));
    let ended = call(&scratch, &file, "out", &["--check"]).run().expect_code(0);
    let printed = ended.stderr.join("\n");
    assert!(
        printed.contains("32 of the 32 flights tried")
            && printed.contains("before the calibration of the detectors ends"),
        "{printed}"
    );
}

/// Growth of peak memory from 32 to 1024 flights, kB: a few shards of records and the buffers of one row group of the
/// table.
const GROWTH_KB: u64 = 40_000;

#[test]
fn scenario_memory_does_not_grow_with_the_flights() {
    let scratch = Scratch::new();
    let peak = |flights: u32| {
        let file = campaign(&scratch, flights, 5.5);
        let out = format!("out-{flights}");
        let mut run = call(&scratch, &file, &out, &["--threads", "2"]).start();
        let status = format!("/proc/{}/status", run.supervisor().pid);
        let mut peak = 0;
        while !run.has_ended() {
            let text = std::fs::read_to_string(&status).unwrap_or_default();
            let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
            let now = line.and_then(|line| line.trim().trim_end_matches("kB").trim().parse().ok());
            peak = peak.max(now.unwrap_or(0));
            std::thread::sleep(Duration::from_millis(2));
        }
        run.end(PATIENCE).expect_code(0);
        peak
    };
    let (few, many) = (peak(32), peak(1024));
    assert!(
        few > 0 && many < few + GROWTH_KB,
        "{few} kB for 32 flights, {many} kB for 1024"
    );
}

#[test]
fn scenario_shards_flown_apart_give_the_bytes_of_one_machine() {
    let scratch = Scratch::new();
    let file = campaign(&scratch, 160, 20.0);
    call(&scratch, &file, "whole", &[]).run().expect_code(0);
    for (out, shards) in [("late", "3..5"), ("early", "0..2"), ("again", "1..4")] {
        call(&scratch, &file, out, &["--shards", shards]).run().expect_code(0);
    }
    let merge = |folders: &[&str]| {
        Call::new(
            &scratch,
            ["campaign".into(), "merge".into(), file.as_os_str().to_owned()],
        )
        .with(folders.iter().map(|name| scratch.path(name).into_os_string()))
        .with(["--out".into(), scratch.path("merged").into_os_string()])
        .run()
    };
    let ended = merge(&["late", "early"]);
    assert_eq!(ended.code, Some(1), "{:?}", ended.stderr);
    let said = ended.stderr.join("\n");
    assert!(said.contains("1 of 5 shards are missing: 2..3"), "{said}");
    merge(&["again"]).expect_code(0);
    assert_same_results(&scratch, "whole", "merged");
    // Any number of times, in any order.
    merge(&["again", "early", "late"]).expect_code(0);
    assert_same_results(&scratch, "whole", "merged");

    std::fs::copy(
        scratch.path("again/shards/000002.parquet"),
        scratch.path("again/shards/000001.parquet"),
    )
    .expect("copied");
    assert_refused(&merge(&["again"]), &["again", "shard 1 differs from that in", "merged"]);
    assert_refused(&merge(&["nowhere"]), &["nowhere", "'rotortwin campaign' has written"]);
    assert_refused(&merge(&["merged"]), &["is the folder of the whole"]);
    let other = scratch.path("other.toml");
    let text = std::fs::read_to_string(&file).expect("it was written");
    std::fs::write(&other, text.replace("seed = 5", "seed = 6")).expect("written");
    call(&scratch, &other, "other", &["--shards", "0..1"])
        .run()
        .expect_code(0);
    assert_refused(&merge(&["other"]), &["other", "holds flights of another campaign"]);
    // A shard in the middle is read, too, before the campaign goes on.
    scratch.write("whole/shards/000002.parquet", "not Parquet");
    assert_refused(
        &call(&scratch, &file, "whole", &["--shards", "0..5"]).run(),
        &["000002.parquet: not a whole Parquet file"],
    );
}
