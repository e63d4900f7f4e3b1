//! `rotortwin --server URL …`: the same result as on this machine, whatever happens to the server meanwhile.

use rotortwin_tests::program::{Call, Ended, Link};
use rotortwin_tests::scratch::{Scratch, announced_flight, repository, shipped_scenario, short_flight};
use rotortwin_tests::server::Server;
use rustix::process::Signal;
use serde_json::{Value, json};
use std::path::Path;
use std::time::Duration;

fn remote<'a>(scratch: &Scratch, server: &Server, arguments: impl IntoIterator<Item = &'a str>) -> Call {
    Call::new(scratch, ["--server", &server.url()]).with(arguments)
}

/// `fly` of a file, into the folder `run` of the test.
fn fly(scratch: &Scratch, server: &Server, scenario: &Path) -> Call {
    remote(scratch, server, ["fly", "--out", "run"]).with([scenario])
}

/// What stands between the head line and the facts: what both machines must print alike.
fn table(ended: &Ended) -> Vec<&str> {
    let same = |line: &&str| {
        !["Speed", "Files", "             report.html", "             campaign"]
            .iter()
            .any(|start| line.starts_with(start))
    };
    ended.stdout.lines().filter(same).collect()
}

fn summary(scratch: &Scratch) -> Value {
    let text = std::fs::read_to_string(scratch.path("run/summary.json")).expect("a summary");
    serde_json::from_str(&text).expect("JSON")
}

#[test]
fn scenario_a_flight_elsewhere_leaves_what_a_flight_here_leaves() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    // A file that the server's library does not have.
    let scenario = scratch.path("mine.toml");
    std::fs::write(&scenario, short_flight()).expect("it can be written");
    let here = Call::fly(&scratch, Link::Iceoryx2, &scenario, "here")
        .with(["--seed", "7"])
        .run()
        .expect_code(0);
    let there = fly(&scratch, &server, &scenario)
        .with(["--seed", "7"])
        .run()
        .expect_code(0);
    assert_eq!(table(&there), table(&here));
    assert_eq!(summary(&scratch)["run_hash"], here.run_hash());
    for file in ["report.html", "telemetry.parquet", "run.mcap", "figures", "sim.log"] {
        assert!(scratch.path("run").join(file).exists(), "{file}");
    }
    assert!(
        there.stderr.iter().any(|line| line.contains("truth")),
        "{:?}",
        there.stderr
    );

    let runs = remote(&scratch, &server, ["runs", "list", "--json"])
        .run()
        .expect_code(0);
    let runs: Value = serde_json::from_str(&runs.stdout).expect("JSON");
    let id = runs[0]["id"].as_str().expect("an id");
    let shown = remote(&scratch, &server, ["show", id]).run().expect_code(0);
    assert_eq!(table(&shown), table(&here));
    let replayed = remote(&scratch, &server, ["replay", id, "--json"]).run().expect_code(0);
    assert!(replayed.stdout.contains(&here.run_hash()) && replayed.stdout.contains("\"same\":true"));
    remote(&scratch, &server, ["runs", "fetch", id, "--out", "again"])
        .run()
        .expect_code(0);
    let files =
        ["run", "again"].map(|name| std::fs::read(scratch.path(name).join("telemetry.parquet")).expect("it is there"));
    assert!(files[0] == files[1]);
    let events = remote(&scratch, &server, ["runs", "events", id, "--after", "2"])
        .run()
        .expect_code(0);
    let last: Value = serde_json::from_str(events.stdout.lines().last().expect("events")).expect("JSON");
    assert_eq!(
        (&last["kind"], &last["data"]["status"]),
        (&json!("ended"), &json!("done"))
    );
    remote(&scratch, &server, ["runs", "delete", id]).run().expect_code(0);
    remote(&scratch, &server, ["runs", "get", id]).run().expect_code(2);
}

#[test]
fn scenario_a_server_that_is_killed_in_mid_flight_and_comes_back_ends_well() {
    let scratch = Scratch::new();
    let mut server = Server::start(&scratch.path("data"));
    let scenario = scratch.path("announced.toml");
    std::fs::write(&scenario, announced_flight(6)).expect("it can be written");
    let mut run = fly(&scratch, &server, &scenario).with(["--pace", "real-time"]).start();
    run.line(|line| line.contains("truth"));
    server.kill();
    server.start_again(&scratch.path("data"));
    let ended = run.end(Duration::from_secs(60)).expect_code(0);
    assert!(
        ended.stderr.iter().any(|line| line.contains("again from the start")),
        "{:?}",
        ended.stderr
    );
    let here = Call::fly(&scratch, Link::InProcess, &scenario, "here")
        .run()
        .expect_code(0);
    assert_eq!(summary(&scratch)["run_hash"], here.run_hash());
}

#[test]
fn scenario_an_interrupt_cancels_the_flight_on_the_server() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let scenario = scratch.path("announced.toml");
    std::fs::write(&scenario, announced_flight(60)).expect("it can be written");
    let mut run = fly(&scratch, &server, &scenario).with(["--pace", "real-time"]).start();
    run.line(|line| line.contains("truth"));
    run.supervisor().signal(Signal::INT);
    let ended = run.end(Duration::from_secs(30)).expect_code(1);
    assert!(ended.stdout.contains("CANCELED"), "{}", ended.stdout);
    assert_eq!(server.get("/api/v1/runs")["items"][0]["status"], "canceled");
    assert_eq!(summary(&scratch)["status"], "canceled");
}

#[test]
fn scenario_what_cannot_be_done_is_one_sentence_and_leaves_nothing() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let hover = shipped_scenario("short-hover");
    let hover = hover.to_str().expect("UTF-8");
    let free = std::net::TcpListener::bind("127.0.0.1:0")
        .and_then(|listener| listener.local_addr())
        .expect("a port");
    let (nobody, url) = (format!("http://{free}"), server.url());
    let secure = url.replace("http:", "https:");
    for (arguments, code, words) in [
        (vec!["--server", "bench", "fly", hover], 2, "http://127.0.0.1:8400"),
        (
            vec!["--server", &nobody, "fly", hover, "--out", "run"],
            1,
            "cannot be reached",
        ),
        (vec!["--server", &secure, "runs", "list"], 1, "cannot be reached"),
        (vec!["--server", &url, "fly", hover, "--cpu", "0"], 2, "--cpu"),
        (vec!["--server", &url, "fly", "missing.toml"], 2, "missing.toml"),
        (vec!["--server", &url, "fly", hover, "--out", "."], 2, "not empty"),
        (vec!["--server", &url, "effects"], 2, "this machine only"),
        (vec!["--server", &url, "show", "0123"], 2, "no run 0123"),
        (vec!["--server", &url, "show", "../secret"], 2, "no id"),
        (vec!["--server", &url, "runs", "list", "--status", "odd"], 2, "odd"),
        (
            vec!["--server", &url, "--token-file", "missing", "runs", "list"],
            2,
            "missing",
        ),
        (vec!["--server", &url, "--ca", hover, "runs", "list"], 2, "PEM"),
    ] {
        let ended = Call::new(&scratch, &arguments).run().expect_code(code);
        assert_eq!(ended.stderr.len(), 1, "{arguments:?}: {:?}", ended.stderr);
        assert!(ended.stderr[0].contains(words), "{arguments:?}: {:?}", ended.stderr);
        assert!(
            !scratch.path("run").exists() && !scratch.path("runs").exists(),
            "{arguments:?}"
        );
    }
    assert_eq!(server.get("/api/v1/runs")["items"], json!([]));
}

#[test]
fn scenario_a_campaign_elsewhere_prints_what_it_prints_here() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let config = scratch.path("config");
    std::fs::create_dir_all(config.join("campaigns")).expect("it can be made");
    for folder in ["scenarios", "vehicles", "blades", "classifiers"] {
        std::os::unix::fs::symlink(repository().join("config").join(folder), config.join(folder)).expect("linked");
    }
    let file = config.join("campaigns/small.toml");
    let text = "name = 'small'\ndescription = 'two parts'\nscenario = '../scenarios/short-hover.toml'\nseed = 5\nflights = 40\n\
                [[axis]]\nname = 'charge'\nkey = 'initial.state_of_charge'\nuniform = [0.5, 1.0]\n";
    std::fs::write(&file, text).expect("it can be written");
    let there = remote(&scratch, &server, ["campaign", "--out", "there"])
        .with([&file])
        .run()
        .expect_code(0);
    let here = Call::new(&scratch, ["campaign", "--out", "here"])
        .with([&file])
        .run()
        .expect_code(0);
    assert_eq!(table(&there), table(&here));
    assert!(there.stdout.contains("40 of 40 flights"), "{}", there.stdout);
    assert!(scratch.path("there/report.html").exists());

    let listed = remote(&scratch, &server, ["campaigns", "list", "--json"])
        .run()
        .expect_code(0);
    let listed: Value = serde_json::from_str(&listed.stdout).expect("JSON");
    assert_eq!(
        (&listed[0]["name"], &listed[0]["status"]),
        (&json!("small"), &json!("done"))
    );
    let refused = remote(&scratch, &server, ["campaign", "--threads", "1"])
        .with([&file])
        .run()
        .expect_code(2);
    assert!(refused.stderr[0].contains("--threads"), "{:?}", refused.stderr);
}

#[test]
fn scenario_whole_documents_are_flown_and_half_ones_refused() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    for (body, words) in [
        (json!({ "documents": "x = 1" }), "documents"),
        (
            json!({ "documents": "", "scenario": "short-hover" }),
            "without `scenario`",
        ),
    ] {
        let answer = server.ask("POST", "/api/v1/runs", &[], &body.to_string());
        assert_eq!(answer.status, 422, "{body}");
        let problem = answer.json();
        assert!(
            problem["detail"].as_str().is_some_and(|detail| detail.contains(words)),
            "{problem}"
        );
    }
}
