//! Real-time priority of paced flights, and deadline misses.

use rotortwin_tests::program::{Call, Link, number};
use rotortwin_tests::scratch::{Scratch, hover};
use rotortwin_tests::skip;
use std::ffi::OsString;
use std::process::Command;

/// Flies two seconds.
fn flight(scratch: &Scratch) -> std::path::PathBuf {
    scratch.write("short.toml", hover("short", 2.0, ""))
}

#[test]
fn scenario_priority_without_a_pace_is_refused() {
    let scratch = Scratch::new();
    let ended = Call::fly(&scratch, Link::Iceoryx2, &flight(&scratch), "out")
        .with(["--priority"])
        .run()
        .expect_code(2);
    let said = ended.stderr.join("\n");
    assert!(said.contains("expected --pace real-time"), "{said}");
    assert!(!scratch.path("out").exists(), "nothing was written");
}

/// Without the capabilities and with the limits of an ordinary login: one sentence that names the missing right, and nothing
/// written.
#[test]
fn scenario_a_missing_right_is_named() {
    if !Command::new("setpriv")
        .arg("--version")
        .output()
        .is_ok_and(|output| output.status.success())
    {
        return skip("setpriv (util-linux) is not there: rights cannot be taken away");
    }
    let scratch = Scratch::new();
    let scenario = flight(&scratch);
    // One right at a time is taken away; anyone can lower the limits.
    for (limits, without, wanted) in [
        ("--rtprio=0", "--bounding-set=-sys_nice", ["cap_sys_nice", "ulimit -r"]),
        (
            "--memlock=65536",
            "--bounding-set=-ipc_lock",
            ["cap_ipc_lock", "ulimit -l"],
        ),
    ] {
        let ended = Call::fly(&scratch, Link::Iceoryx2, &scenario, "out")
            .with(["--pace", "real-time", "--priority"])
            .behind(["prlimit", limits, "setpriv", "--inh-caps=-all", without].map(OsString::from))
            .run();
        let said = ended.stderr.join("\n");
        if said.contains("setpriv:") || said.contains("prlimit:") {
            return skip("this user may not take rights away");
        }
        ended.expect_code(2);
        for word in wanted {
            assert!(said.contains(word), "{limits}: {said}");
        }
        assert!(!scratch.path("out").exists(), "nothing was written");
    }
}

/// The three processes have it, the flight is the same bit for bit, and the summary says so.
#[test]
fn scenario_all_processes_have_priority_and_no_bit_changes() {
    let scratch = Scratch::new();
    let scenario = scratch.write("long.toml", hover("long", 4.0, ""));
    let here = Call::fly(&scratch, Link::InProcess, &scenario, "here")
        .run()
        .expect_code(0);
    let mut run = Call::fly(&scratch, Link::Iceoryx2, &scenario, "out")
        .with(["--pace", "real-time", "--priority=7"])
        .start();
    let mut policies = Vec::new();
    for name in ["sim", "controller", "fdi"] {
        // It may be refused before any process starts.
        if run.has_ended() {
            break;
        }
        let pid = run.member(name).pid;
        let policy = || {
            let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            let fields: Vec<String> = stat
                .rsplit_once(')')
                .map_or("", |(_, rest)| rest)
                .split_ascii_whitespace()
                .map(str::to_owned)
                .collect();
            // rt_priority and policy, fields 40 and 41 of proc(5), 38 and 39 after the name.
            Some((fields.get(37)?.clone(), fields.get(38)?.clone()))
        };
        let fifo = Some(("7".to_owned(), "1".to_owned()));
        let found = rotortwin_tests::process::wait_until(std::time::Duration::from_secs(3), || policy() == fifo);
        policies.push((name, found.is_some()));
    }
    let ended = run.end(rotortwin_tests::program::PATIENCE);
    if ended
        .stderr
        .iter()
        .any(|line| line.contains("cap_sys_nice") || line.contains("cap_ipc_lock"))
    {
        return skip("this user has no right to real-time priority or to locked memory");
    }
    let ended = ended.expect_code(0);
    assert_eq!(policies, ["sim", "controller", "fdi"].map(|name| (name, true)));
    assert_eq!(ended.run_hash(), here.run_hash());
    let summary = ended.summary();
    assert!((number(&summary, "/real_time/priority") - 7.0).abs() < 1e-9);
    let late: f64 = summary["real_time"]["late"].as_array().map_or(0.0, |late| {
        let of_commands = late.iter().filter(|late| late["who"] != "fdi");
        of_commands.map(|late| number(late, "/steps")).sum()
    });
    assert!(
        (late - number(&summary, "/real_time/deadline_misses")).abs() < 1e-9,
        "{}",
        summary["real_time"]
    );
    assert!(ended.stdout.contains("SCHED_FIFO 7"), "{}", ended.stdout);
}
