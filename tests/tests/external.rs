//! External peers, started with the command that the run prints: on another host, or third-party ones.

use rotortwin_tests::process::wait_until;
use rotortwin_tests::program::{Call, Link, PATIENCE, Run, text};
use rotortwin_tests::scratch::{Scratch, announced_flight, short_flight};
use rustix::process::Signal;

/// Arguments of the command that a run prints for `who`, without the name of the program.
fn printed_command(run: &mut Run, who: &str) -> Vec<String> {
    let start = format!("  rotortwin {who} ");
    let line = run.line(|line| line.starts_with(&start));
    line.split_ascii_whitespace().skip(1).map(str::to_owned).collect()
}

#[test]
fn scenario_external_peers_join_with_the_printed_command() {
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    let here = Call::fly(&scratch, Link::InProcess, &scenario, "here")
        .run()
        .expect_code(0);
    for link in Link::BETWEEN_PROCESSES {
        for who in [&["controller"][..], &["fdi"], &["controller", "fdi"]] {
            for json in [&[][..], &["--json"]] {
                let name = format!("{}-{}{}", link.name(), who.concat(), json.concat());
                let call = Call::fly(&scratch, link, &scenario, &name).with(["--external", &who.join(",")]);
                let mut run = call.with(json).start();
                let peers: Vec<Run> = who
                    .iter()
                    .map(|who| Call::new(&scratch, printed_command(&mut run, who)).start())
                    .collect();
                let ended = run.end(PATIENCE).expect_code(0);
                assert_eq!(ended.run_hash(), here.run_hash(), "{name}");
                for peer in peers {
                    let ended = peer.end(PATIENCE).expect_code(0);
                    assert_eq!(
                        (ended.stdout.as_str(), ended.stderr.len()),
                        ("", 0),
                        "{name}: {:?}",
                        ended.stderr
                    );
                }
                if !json.is_empty() {
                    let summary: serde_json::Value = serde_json::from_str(&ended.stdout).expect("nothing but JSON");
                    assert_eq!(summary, ended.summary(), "{name}");
                }
            }
        }
    }
}

/// An external peer is monitored like any other, and learns why its run has ended.
#[test]
fn scenario_external_peer_killed() {
    let scratch = Scratch::new();
    let scenario = scratch.write("long.toml", announced_flight(60));
    for link in Link::BETWEEN_PROCESSES {
        let call = Call::fly(&scratch, link, &scenario, link.name()).with(["--external", "controller,fdi"]);
        let mut run = call.with(["--pace", "real-time"]).start();
        let controller = Call::new(&scratch, printed_command(&mut run, "controller")).start();
        let fdi = Call::new(&scratch, printed_command(&mut run, "fdi")).start();
        run.line(|line| line.contains("truth"));
        controller.supervisor().signal(Signal::KILL);
        let ended = run.end(PATIENCE).expect_code(1);
        assert_eq!(text(&ended.summary(), "/failure/peer"), "controller");
        let served = fdi.end(PATIENCE).expect_code(1);
        let reason = text(&ended.summary(), "/failure/sentence").to_owned();
        assert!(
            served.stderr.concat().contains(&reason),
            "{:?} does not say: {reason}",
            served.stderr
        );
        assert_eq!(controller.end(PATIENCE).code, None);
        let tidy = wait_until(PATIENCE, || scratch.shared_memory().is_empty());
        assert!(tidy.is_some(), "shared memory is left: {:?}", scratch.shared_memory());
    }
}

/// Joining a run that does not exist fails with a sentence that says what was looked for and where.
#[test]
fn scenario_peer_without_a_run() {
    let scratch = Scratch::new();
    for who in ["controller", "fdi"] {
        let link = format!("iceoryx2:{}", scratch.domain());
        let args = [who, "--link", &link, "--run-id", "abc", "--join-timeout", "300"];
        let ended = Call::new(&scratch, args).run().expect_code(1);
        assert_eq!(ended.stderr.len(), 1, "{:?}", ended.stderr);
        let sentence = &ended.stderr[0];
        for word in [who, "the plant did not", "0000000000000abc", "iceoryx2"] {
            assert!(sentence.contains(word), "{word:?} is not in: {sentence}");
        }
        assert!(scratch.shared_memory().is_empty(), "{:?}", scratch.shared_memory());
    }
}

/// Conformance test of a controller that joins by itself: ours passes, one that misses a bound too tight for any fails.
#[test]
fn scenario_conform_over_zenoh() {
    let scratch = Scratch::new();
    for (within_ms, code, words) in [("0", 0, "\nConforms\n"), ("0.000001", 1, "FAULT  latency")] {
        let args = ["conform", "zenoh", "--answer-within", within_ms].map(str::to_owned);
        let mut run = Call::new(&scratch, args.to_vec()).start();
        let controller = Call::new(&scratch, printed_command(&mut run, "controller")).start();
        let ended = run.end(PATIENCE).expect_code(code);
        assert!(ended.stdout.contains(words), "{}", ended.stdout);
        controller.end(PATIENCE).expect_code(0);
    }
}
