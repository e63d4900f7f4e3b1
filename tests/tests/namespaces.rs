//! A run over several hosts: network namespaces joined by cables, some bad, some pulled.

use rotortwin_tests::certificates::certificates;
use rotortwin_tests::hosts::Hosts;
use rotortwin_tests::postgres::Postgres;
use rotortwin_tests::program::{Call, Link, PATIENCE, Run, text};
use rotortwin_tests::scratch::{Scratch, announced_flight, hover, shipped_scenario, short_flight};
use rotortwin_tests::server::{Server, Worker};
use serde_json::{Value, json};
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};

const FLY: usize = 1;
const CONTROLLER: usize = 2;
const FDI: usize = 3;

/// A flight from host 1 with the controller on host 2 and the FDI engine on host 3, started with the printed commands.
fn fly(
    scratch: &Scratch,
    hosts: &Hosts,
    scenario: &Path,
    name: &str,
    protocol: &str,
    more: &[&str],
) -> (Run, Run, Run) {
    let listen = format!("{protocol}/{}:7447", Hosts::address(FLY));
    let call =
        Call::fly(scratch, Link::Zenoh, scenario, name).with(["--listen", &listen, "--external", "controller,fdi"]);
    let mut run = call.with(more.iter().copied()).behind(hosts.on(FLY)).start();
    let mut join = |who: &str, host: usize| {
        let start = format!("  rotortwin {who} ");
        let line = run.line(|line| line.starts_with(&start));
        let words = line.split_ascii_whitespace().skip(1).map(str::to_owned);
        Call::new(scratch, words).behind(hosts.on(host)).start()
    };
    let controller = join("controller", CONTROLLER);
    let fdi = join("fdi", FDI);
    (run, controller, fdi)
}

fn in_process_hash(scratch: &Scratch, scenario: &Path) -> String {
    let call = Call::fly(scratch, Link::InProcess, scenario, "in-process");
    call.run().expect_code(0).run_hash()
}

fn lands(flight: (Run, Run, Run)) -> String {
    let (run, controller, fdi) = flight;
    let ended = run.end(2 * PATIENCE).expect_code(0);
    controller.end(PATIENCE).expect_code(0);
    fdi.end(PATIENCE).expect_code(0);
    ended.run_hash()
}

#[test]
fn scenario_three_hosts_give_the_hash_of_one() {
    let Some(hosts) = Hosts::new(3) else { return };
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    let expected = in_process_hash(&scratch, &scenario);
    assert_eq!(lands(fly(&scratch, &hosts, &scenario, "plain", "tcp", &[])), expected);
    let Some(folder) = certificates(&scratch, "pki", &["bench,10.77.0.1"]) else {
        return;
    };
    let folder = folder.display();
    let file = scratch.write(
        "zenoh.toml",
        format!("[tls]\nca = '{folder}/ca.pem'\ncertificate = '{folder}/bench.pem'\nprivate_key = '{folder}/bench-key.pem'\n"),
    );
    let config: PathBuf = file;
    let more = [
        "--zenoh-config",
        config.to_str().expect("the folder of a test is UTF-8"),
    ];
    assert_eq!(
        lands(fly(&scratch, &hosts, &scenario, "encrypted", "tls", &more)),
        expected
    );
}

/// 2 ms each way and 1 % packet loss on the cable of the plant's host: slower, but the same bits.
#[test]
fn scenario_a_bad_cable_changes_no_bit() {
    let Some(mut hosts) = Hosts::new(3) else { return };
    let scratch = Scratch::new();
    let scenario = scratch.write("brief.toml", hover("brief", 1.0, ""));
    let expected = in_process_hash(&scratch, &scenario);
    hosts.disturb(2, 1);
    let flight = fly(&scratch, &hosts, &scenario, "bad-cable", "tcp", &[]);
    assert_eq!(lands(flight), expected);
}

/// A pulled cable closes no connection. The run ends before the step time-out and names the lost peers; the peers report that the plant
/// is gone.
#[test]
fn scenario_a_pulled_cable_is_named() {
    let Some(hosts) = Hosts::new(3) else { return };
    for (victim, name) in [(CONTROLLER, "controller"), (FDI, "fdi")] {
        let scratch = Scratch::new();
        let scenario = scratch.write("long.toml", announced_flight(60));
        let (mut run, controller, fdi) = fly(&scratch, &hosts, &scenario, name, "tcp", &["--pace", "real-time"]);
        run.line(|line| line.contains("truth"));
        hosts.cut(victim);
        let ended = run.end(PATIENCE).expect_code(1);
        let summary = ended.summary();
        assert_eq!(text(&summary, "/failure/peer"), name);
        let sentence = text(&summary, "/failure/sentence");
        let silence: u64 = sentence
            .split_once("silent for ")
            .and_then(|(_, rest)| rest.split_once(" ms"))
            .and_then(|(number, _)| number.parse().ok())
            .unwrap_or_else(|| panic!("no length of the silence in: {sentence}"));
        // A connection's lease is 2 s; the step time-out would be 5 s.
        assert!(silence < 5_000, "{sentence}");
        let (lost, other) = if victim == CONTROLLER {
            (controller, fdi)
        } else {
            (fdi, controller)
        };
        let lost = lost.end(PATIENCE).expect_code(1);
        assert!(lost.stderr.concat().contains("the plant"), "{:?}", lost.stderr);
        let other = other.end(PATIENCE).expect_code(1);
        assert!(
            other.stderr.concat().contains(sentence),
            "{:?} does not say: {sentence}",
            other.stderr
        );
        hosts.mend(victim);
    }
}

/// Server, database and the plant's worker on host 1; controller and FDI engine on host 2, whose cable is pulled in mid-run. The attempt
/// fails and names who is missing; host 3 takes over, and the job ends with the hash of a flight in one process.
#[test]
fn scenario_a_job_outlives_a_pulled_cable() {
    let Some(hosts) = Hosts::new(3) else { return };
    let scratch = Scratch::new();
    let call = Call::fly(&scratch, Link::InProcess, &shipped_scenario("short-hover"), "here").with(["--seed", "7"]);
    let expected = call.run().expect_code(0).run_hash();
    let Some(mut postgres) = hosts.visit(1, || Postgres::start(&scratch.path(""))) else {
        return;
    };
    hosts.visit(1, || postgres.open_to_other_hosts());
    let database = postgres.url_at(&Hosts::address(1));
    let artifacts = scratch.path("artifacts").display().to_string();
    let shared = ["--database-url", database.as_str(), "--artifacts", artifacts.as_str()];
    let with = |more: &[&'static str]| -> Vec<&str> { shared.iter().copied().chain(more.iter().copied()).collect() };
    let parts = |host: usize, name: &str| {
        hosts.visit(host, || {
            Worker::start(&scratch.path(name), &with(&["--roles", "controller,fdi"]))
        })
    };
    let server = hosts.visit(1, || {
        Server::start_at("127.0.0.1:0", &scratch.path("server"), &with(&["--workers", "0"]))
    });
    let listen = ["--workers", "1", "--zenoh-listen", "tcp/10.77.0.1:0"];
    let _plant = hosts.visit(1, || Worker::start(&scratch.path("plant"), &with(&listen)));
    let _near = parts(2, "near");
    let events = hosts.visit(1, || {
        let id = server.submit(&json!({
            "scenario": "short-hover", "seed": 7, "link": "zenoh", "controller": "worker", "fdi": "worker", "pace": "real-time"
        }));
        let stream = server.send("GET", &format!("/api/v1/runs/{id}/events"), &[], "");
        let mut events = BufReader::new(stream).lines().map_while(Result::ok);
        // It is flying.
        let flies = events.find(|line| line.contains("\"sim_time_s\""));
        assert!(flies.is_some(), "no progress was told");
        (id, events)
    });
    let (id, mut events) = events;
    hosts.cut(2);
    let _far = parts(3, "far");
    let mut why = None;
    for line in events.by_ref() {
        let data = line
            .strip_prefix("data:")
            .and_then(|data| serde_json::from_str::<Value>(data).ok());
        if let Some(Value::String(sentence)) = data.map(|mut data| data["why"].take()) {
            why = Some(sentence);
            break;
        }
    }
    let why = why.expect("the attempt that failed is told");
    assert!(
        why.contains("rotortwin-controller") || why.contains("rotortwin-fdi"),
        "{why}"
    );
    let run = hosts.visit(1, || server.ended(&id));
    assert_eq!(run["status"], "done", "{run}");
    assert_eq!(run["run_hash"], Value::String(expected), "{run}");
    hosts.visit(1, || drop(server));
    drop(postgres);
}
