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

/// `fly` with a file, into the test's folder `run`.
fn fly(scratch: &Scratch, server: &Server, scenario: &Path) -> Call {
    remote(scratch, server, ["fly", "--out", "run"]).with([scenario])
}

/// The lines between the head line and the facts, which must be the same from both machines.
fn table(ended: &Ended) -> Vec<&str> {
    let same = |line: &&str| {
        ![
            "Speed",
            "Files",
            "Placement",
            "             report.html",
            "             campaign",
        ]
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
        ended.stderr.iter().any(|line| line.contains("restarts the flight")),
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
        (vec!["--server", &url, "show", "../secret"], 2, "is not the id of a run"),
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
    assert!(refused.stderr[0].contains("--jobs"), "{:?}", refused.stderr);
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

/// A hover flown locally: its run folder, and its telemetry as a log without a side file.
fn flown_here(scratch: &Scratch) -> [&'static str; 2] {
    let scenario = scratch.path("hover.toml");
    std::fs::write(&scenario, short_flight()).expect("it can be written");
    Call::fly(scratch, Link::InProcess, &scenario, "flown")
        .run()
        .expect_code(0);
    std::fs::copy(scratch.path("flown/telemetry.parquet"), scratch.path("alone.parquet")).expect("copied");
    ["flown", "alone.parquet"]
}

fn vehicle() -> String {
    repository().join("config/vehicles/f550.toml").display().to_string()
}

/// Numbers of a file, without the locations of its logs.
fn result(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut value: Value = serde_json::from_str(&text).expect("JSON");
    forget_places(&mut value);
    value
}

fn forget_places(value: &mut Value) {
    match value {
        Value::Object(fields) => {
            // A log's location, kind of file and processing time.
            for key in ["path", "source", "content_hash", "hash", "timing", "kind"] {
                fields.remove(key);
            }
            fields.values_mut().for_each(forget_places);
        }
        Value::Array(items) => items.iter_mut().for_each(forget_places),
        _ => {}
    }
}

#[test]
fn scenario_logs_of_this_machine_are_compared_and_diagnosed_there_as_here() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let [run, log] = flown_here(&scratch);
    let vehicle = vehicle();
    // A run folder is converted to the canonical form, of which a part is taken; a single file is sent as it is.
    let part = format!("{run}@1:4");
    let compare = ["compare", &part, log, "--model", &vehicle, "--out"];
    let here = Call::new(&scratch, compare).with(["here"]).run().expect_code(0);
    let there = remote(&scratch, &server, compare).with(["there"]).run().expect_code(0);
    assert_eq!(table(&there), table(&here));
    assert_eq!(
        result(&scratch.path("there/comparison.json")),
        result(&scratch.path("here/comparison.json"))
    );
    for file in ["report.html", "residuals-alone.parquet", "comparison.txt"] {
        assert!(scratch.path("there").join(file).exists(), "{file}");
    }

    // Several models at once.
    let compare = [
        "compare", log, "--model", &vehicle, &vehicle, "--label", "before", "--label", "after",
    ];
    let here = Call::new(&scratch, compare).run().expect_code(0);
    let there = remote(&scratch, &server, compare).run().expect_code(0);
    assert!(table(&here).concat().contains("after"), "{:?}", table(&here));
    assert_eq!(table(&there), table(&here));

    let diagnose = ["diagnose", log, "--model", &vehicle];
    let here = Call::new(&scratch, diagnose).run().expect_code(0);
    let there = remote(&scratch, &server, diagnose).run().expect_code(0);
    let words = |ended: &Ended| -> Vec<String> {
        let lines = ended.stdout.lines().filter(|line| !line.starts_with("Took"));
        lines.map(str::to_owned).collect()
    };
    assert_eq!(words(&there), words(&here));
    assert!(
        there.stderr.iter().any(|line| line.contains("is already there")),
        "{:?}",
        there.stderr
    );
    assert_eq!(server.get("/api/v1/logs")["items"].as_array().map(Vec::len), Some(2));

    // The server's own items are named by id and need no local file.
    let id = server.get("/api/v1/logs")["items"][0]["id"]
        .as_str()
        .expect("an id")
        .to_owned();
    let ended = remote(&scratch, &server, ["compare", &id, "--model", &vehicle, "--json"])
        .run()
        .expect_code(0);
    let comparison: Value = serde_json::from_str(&ended.stdout).expect("JSON, nothing else");
    assert_eq!(comparison["logs"][0]["log"]["name"], "alone");
}

#[test]
fn scenario_a_model_is_improved_there_and_its_versions_are_kept_here() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let [_, log] = flown_here(&scratch);
    let vehicle = vehicle();
    let improve = ["improve", log, "--model", &vehicle, "--yes", "--models"];
    Call::new(&scratch, improve)
        .with(["models-here", "--final", "here.toml", "--out", "here"])
        .run()
        .expect_code(0);
    remote(&scratch, &server, improve)
        .with(["models-there", "--final", "there.toml", "--out", "there"])
        .run()
        .expect_code(0);
    let final_version = |name: &str| std::fs::read_to_string(scratch.path(name)).expect("it was written");
    assert_eq!(final_version("there.toml"), final_version("here.toml"));
    assert_eq!(
        result(&scratch.path("there/improvement.json")),
        result(&scratch.path("here/improvement.json"))
    );
    let kept = |store: &str| -> Vec<(String, String)> {
        let folder = scratch.path(store).join("f550");
        let mut files: Vec<(String, String)> = std::fs::read_dir(folder)
            .expect("a model")
            .map(|entry| entry.expect("an entry").path())
            .map(|path| {
                let name = path.file_name().expect("a name").to_string_lossy().into_owned();
                (name, std::fs::read_to_string(path).expect("a text"))
            })
            .collect();
        files.sort();
        files
    };
    assert_eq!(kept("models-there"), kept("models-here"));
}

#[test]
fn scenario_a_log_is_imported_there_and_fetched() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let [_, log] = flown_here(&scratch);
    let import = ["log", "import", log, "--rate", "100", "--out"];
    let here = Call::new(&scratch, import).with(["here"]).run().expect_code(0);
    let there = remote(&scratch, &server, import).with(["there"]).run().expect_code(0);
    assert_eq!(
        there.stdout.replace("→ there", "→ here"),
        here.stdout,
        "{:?}",
        there.stderr
    );
    for ending in ["parquet", "import.json", "toml"] {
        assert!(
            scratch.path("there").join(format!("alone.{ending}")).exists(),
            "{ending}"
        );
    }
    let shown = ["here", "there"].map(|folder| {
        let shown = Call::new(&scratch, ["log", "show", &format!("{folder}/alone.parquet")]);
        // It reports where it was imported from: there the upload has another name.
        shown
            .run()
            .expect_code(0)
            .stdout
            .replace("source: log.parquet", "source: alone.parquet")
    });
    assert_eq!(shown[0], shown[1]);
    let again = remote(&scratch, &server, import).with(["there"]).run().expect_code(2);
    assert!(again.stderr.iter().any(|line| line.contains("already exists")));
}

#[test]
fn scenario_a_scenario_is_checked_with_the_servers_library() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let hover = shipped_scenario("short-hover");
    let hover = hover.to_str().expect("UTF-8");
    for more in [&[][..], &["--json"]] {
        let here = Call::new(&scratch, ["check", hover]).with(more).run().expect_code(0);
        let there = remote(&scratch, &server, ["check", hover])
            .with(more)
            .run()
            .expect_code(0);
        assert_eq!(there.stdout, here.stdout);
    }
    let text = std::fs::read_to_string(hover).expect("a scenario");
    let wrong = scratch.write("wrong.toml", text.replace("duration_s = 5.0", "duration_s = -5.0"));
    let refused = remote(&scratch, &server, ["check", wrong.to_str().expect("UTF-8")])
        .run()
        .expect_code(2);
    assert!(
        refused.stderr.iter().any(|line| line.contains("duration_s")),
        "{:?}",
        refused.stderr
    );
}

#[test]
fn scenario_work_that_a_server_cannot_do_is_refused_in_one_sentence() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let [run, log] = flown_here(&scratch);
    let vehicle = vehicle();
    let other = scratch.write(
        "short-hover.toml",
        short_flight().replace("duration_s = ", "duration_s = 1"),
    );
    let other = other.to_str().expect("UTF-8");
    for (arguments, words) in [
        (vec!["compare", "missing.csv", "--model", &vehicle], "missing.csv"),
        (vec!["improve", log, "--model", &vehicle], "--yes"),
        (
            vec!["improve", log, "--model", &vehicle, "--yes", "--truth", "x.toml"],
            "--truth",
        ),
        (vec!["log", "show", log], "leave out --server"),
        (vec!["log", "import", log, "--truth"], "--take-truth"),
        (vec!["log", "import", run], "run folder"),
        (vec!["train", "--out", "x.json", "--threads", "1"], "--jobs"),
        (
            vec!["train", "--out", "x.json", "--scenario", other],
            "a different scenario",
        ),
        (
            vec!["compare", "0123456789abcdef0123456789abcdef", "--model", &vehicle],
            "not a log or run on",
        ),
    ] {
        let ended = remote(&scratch, &server, arguments.iter().copied())
            .run()
            .expect_code(2);
        let told = ended.stderr.join("\n");
        assert!(told.contains(words), "{arguments:?}: {told}");
    }
}

#[test]
fn scenario_a_classifier_trained_there_is_the_one_trained_here() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let scenario = shipped_scenario("reference-flight");
    let train = [
        "train",
        "--seeds",
        "1",
        "--scenario",
        scenario.to_str().expect("UTF-8"),
        "--out",
    ];
    let here = Call::new(&scratch, train).with(["here.json"]).run().expect_code(0);
    let there = remote(&scratch, &server, train)
        .with(["there.json"])
        .run()
        .expect_code(0);
    assert_eq!(there.stdout.replace("there.json", "here.json"), here.stdout);
    let network = |name: &str| -> Value {
        let text = std::fs::read_to_string(scratch.path(name)).expect("it was written");
        let mut file: Value = serde_json::from_str(&text).expect("JSON");
        // It names the scenario by its path.
        file["provenance"]["command"] = Value::Null;
        file
    };
    assert_eq!(network("there.json"), network("here.json"));
}
