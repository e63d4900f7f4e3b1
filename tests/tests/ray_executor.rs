//! A server whose campaigns are flown by a Ray cluster on this machine: nodes, server and the connection between them
//! die.

use rotortwin_tests::cable::Cable;
use rotortwin_tests::certificates::certificates;
use rotortwin_tests::postgres::Postgres;
use rotortwin_tests::process::wait_until;
use rotortwin_tests::program::{Call, program, read_json};
use rotortwin_tests::random::Random;
use rotortwin_tests::ray::{RayCluster, alone, executors_environment};
use rotortwin_tests::scratch::{Scratch, repository};
use rotortwin_tests::server::Server;
use serde_json::{Value, json};
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Longest wait for anything: Ray starts many programs for each part, which takes minutes on a crowded machine.
const PATIENCE: Duration = Duration::from_secs(600);
/// Parts of the campaign: one per shard.
const PARTS: u64 = 8;

/// A campaign with this many shards of flights of this duration.
fn campaign(name: &str, shards: u64, duration_s: f64) -> String {
    format!(
        "name = '{name}'\ndescription = 'by Ray'\nscenario = '../scenarios/short-hover.toml'\nseed = 5\nflights = {}\n\
         [set]\nduration_s = {duration_s:?}\n[[axis]]\nname = 'charge'\nkey = 'initial.state_of_charge'\nuniform = [0.5, 1.0]\n",
        32 * shards
    )
}

/// The command's results on this machine.
fn on_one_machine(scratch: &Scratch, text: &str) -> PathBuf {
    let config = scratch.path("config");
    for folder in ["scenarios", "vehicles", "blades", "classifiers", "campaigns"] {
        std::fs::create_dir_all(config.join(folder)).expect("made");
        for entry in std::fs::read_dir(repository().join("config").join(folder)).expect("readable") {
            let path = entry.expect("an entry").path();
            std::fs::copy(&path, config.join(folder).join(path.file_name().expect("a name"))).expect("copied");
        }
    }
    let file = config.join("campaigns/here.toml");
    std::fs::write(&file, text).expect("written");
    let out = scratch.path("here");
    let words = [
        "campaign".into(),
        file.into_os_string(),
        "--out".into(),
        out.clone().into_os_string(),
    ];
    Call::new(scratch, words).run().expect_code(0);
    out
}

/// A job that has ended.
fn job_ended(server: &Server, collection: &str, id: &str) -> Value {
    let path = format!("/api/v1/{collection}/{id}");
    wait_for(&path, || {
        !matches!(server.get(&path)["status"].as_str(), Some("queued" | "running"))
    });
    server.get(&path)
}

/// All submissions known to the cluster, not through the cable.
fn submissions(port: u16) -> Vec<Value> {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).expect("the dashboard listens");
    write!(stream, "GET /api/jobs/ HTTP/1.0\r\nhost: 127.0.0.1\r\n\r\n").expect("it takes the request");
    let mut text = String::new();
    stream.read_to_string(&mut text).expect("an answer");
    let body = text.split_once("\r\n\r\n").expect("a body").1;
    let all: Vec<Value> = serde_json::from_str(body).expect("JSON");
    all.into_iter().filter(|job| job["type"] == "SUBMISSION").collect()
}

fn text(server: &Server, path: &str) -> String {
    String::from_utf8(server.ask("GET", path, &[], "").body).expect("a text")
}

fn wait_for(what: &str, is_true: impl Fn() -> bool) {
    let reached = wait_until(PATIENCE, || {
        sleep(Duration::from_millis(100));
        is_true()
    });
    assert!(reached.is_some(), "{what}: not within {} s", PATIENCE.as_secs());
}

fn shards(server: &Server, status: &str) -> u64 {
    let start = format!("rotortwin_jobs{{kind=\"campaign-shard\",status=\"{status}\"}} ");
    let metrics = text(server, "/metrics");
    let line = metrics.lines().find_map(|line| line.strip_prefix(&start));
    line.map_or(0, |count| count.parse().expect("a number"))
}

/// From the server's database: numbers of attempts of all parts, and the reasons for the restarts.
fn attempts(programs: &Path, data: &Path) -> (Vec<u64>, Vec<String>) {
    let script = "import json, sqlite3, sys\n\
         rows = sqlite3.connect(sys.argv[1]).execute\n\
         print(json.dumps([[row[0] for row in rows('SELECT attempts FROM job WHERE part_of IS NOT NULL')],\n\
         [json.loads(row[0])['why'] for row in rows(\"SELECT data FROM job_event WHERE kind = 'requeued'\")]]))";
    let output = Command::new(programs.join("python"))
        .args(["-c", script])
        .arg(data.join("rotortwin.sqlite"))
        .output()
        .expect("Python starts");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}{}", String::from_utf8_lossy(&output.stderr)))
}

/// The ticket of a running attempt, as its node has it, gives access to that attempt only.
fn tickets_are_worth_one_attempt(server: &Server, submission: &Value) {
    let variables = &submission["runtime_env"]["env_vars"];
    let url = variables["ROTORTWIN_PART_URL"].as_str().expect("a text");
    let path = url.strip_prefix(&server.url()).expect("of this server");
    let own = format!(
        "Bearer {}",
        variables["ROTORTWIN_PART_TICKET"].as_str().expect("a text")
    );
    let (part, attempt) = path.rsplit_once('/').expect("an attempt");
    let next = format!("{part}/{}", attempt.parse::<u64>().expect("a number") + 1);
    let events = format!("{path}/events");
    let ended = r#"{"lines": ["{\"event\": \"ended\"}"]}"#;
    for (method, path, ticket, body, status) in [
        ("GET", path, own.as_str(), "", 200),
        ("GET", path, "Bearer 0123456789abcdef0123456789abcdef", "", 401),
        ("GET", path, "Basic x", "", 401),
        ("GET", &next, &own, "", 410),
        (
            "GET",
            &format!("{path}/inputs/library/../../../etc/passwd"),
            &own,
            "",
            404,
        ),
        ("GET", &format!("{path}/inputs/job.json"), &own, "", 404),
        ("PUT", &format!("{path}/files/%2e%2e/%2e%2e/x"), &own, "{}", 422),
        ("PUT", &format!("{path}/files/.x"), &own, "{}", 422),
        ("POST", &events, &own, ended, 422),
        ("POST", &events, &own, r#"{"lines": []}"#, 204),
        (
            "POST",
            &format!("{path}/end"),
            &own,
            r#"{"node": "n", "how": "done", "result": "{}", "files": [{"path": "a", "size": 1}]}"#,
            409,
        ),
    ] {
        let answer = server.ask(method, path, &[("authorization", ticket)], body);
        assert_eq!(
            answer.status,
            status,
            "{method} {path}: {}",
            String::from_utf8_lossy(&answer.body)
        );
    }
}

#[test]
fn scenario_a_campaign_by_ray_survives_the_death_of_a_node_and_of_the_server() {
    let _alone = alone();
    let Some(mut cluster) = RayCluster::start() else { return };
    let programs = executors_environment().expect("it was there a moment ago");
    let scratch = Scratch::new();
    let document = campaign("by-ray", PARTS, 120.0);
    let here = on_one_machine(&scratch, &document);

    let cable = Cable::to(cluster.port());
    let (data, executor) = (scratch.path("data"), format!("ray=http://127.0.0.1:{}", cable.port()));
    let program = program().display().to_string();
    let words = ["--workers", "1", "--executor", &executor, "--ray-program", &program];
    let mut server = Server::start_at("127.0.0.1:0", &data, &words);
    let address = server.address().to_owned();
    let ready = text(&server, "/readyz");
    assert!(
        ready.starts_with("ready\nRay at http://127.0.0.1:") && ready.contains("(version 2.60.0) answers"),
        "{ready}"
    );

    let id = server.submit_to("campaigns", &json!({ "text": document }));
    let running = |port: u16| {
        submissions(port)
            .iter()
            .filter(|job| job["status"] == "RUNNING")
            .count()
    };
    // Each node has a part, so the one that dies takes an attempt with it.
    let port = cluster.port();
    wait_for("parts are done", || running(port) == 2 && shards(&server, "done") >= 2);
    cluster.kill_node(1);
    server.kill();
    let done_before = {
        server = Server::start_at(&address, &data, &words);
        shards(&server, "done")
    };
    assert!(
        (2..PARTS).contains(&done_before),
        "{done_before}: it was not killed half-way"
    );
    // The server cannot reach Ray, and says so; the nodes continue and deliver.
    cable.cut();
    wait_for("readyz says that Ray is away", || {
        text(&server, "/readyz").contains("has not answered for")
    });
    assert!(text(&server, "/metrics").contains("rotortwin_ray_up 0\n"));
    cable.mend();
    let whole = job_ended(&server, "campaigns", &id);
    assert_eq!(whole["status"], "done", "{whole}");
    assert_eq!(whole["facts"]["parts"], PARTS, "{whole}");
    for file in ["campaign.parquet", "campaign.csv"] {
        let there = server.ask("GET", &format!("/api/v1/campaigns/{id}/artifacts/{file}"), &[], "");
        assert_eq!(there.status, 200, "{file}");
        assert!(
            there.body == std::fs::read(here.join(file)).expect("it is there"),
            "{file} differs"
        );
    }
    // Only the killed node's attempts were restarted: the killed server has found the rest.
    let (attempts, why) = attempts(&programs, &data);
    assert_eq!(
        (attempts.len() as u64, attempts.iter().sum()),
        (PARTS, PARTS + why.len() as u64),
        "{why:?}"
    );
    assert!(!why.is_empty(), "the killed node had nothing to do");
    for why in &why {
        assert!(
            why.contains("Ray at http://127.0.0.1:") && why.contains("died"),
            "{why}"
        );
    }

    // A delivered attempt is closed, whoever has its ticket.
    let all = submissions(cluster.port());
    let variables = &all.iter().find(|job| job["status"] == "SUCCEEDED").expect("one")["runtime_env"]["env_vars"];
    let url = variables["ROTORTWIN_PART_URL"].as_str().expect("a text");
    let ticket = format!(
        "Bearer {}",
        variables["ROTORTWIN_PART_TICKET"].as_str().expect("a text")
    );
    let path = url.strip_prefix(&server.url()).expect("of this server");
    assert_eq!(server.ask("GET", path, &[("authorization", &ticket)], "").status, 410);

    let over = ["SUCCEEDED", "FAILED", "STOPPED"];
    let ended = || {
        let all = submissions(port);
        all.iter().all(|job| over.iter().any(|over| job["status"] == *over))
    };
    wait_for("Ray has ended the first campaign", ended);

    // A cancel stops what Ray is running or has queued.
    let id = server.submit_to("campaigns", &json!({ "text": campaign("long", 4, 3000.0) }));
    wait_for("a part runs", || running(port) > 0);
    let all = submissions(cluster.port());
    let one = all.iter().find(|job| job["status"] == "RUNNING").expect("it runs");
    tickets_are_worth_one_attempt(&server, one);
    assert_eq!(
        server
            .ask("POST", &format!("/api/v1/campaigns/{id}/cancel"), &[], "")
            .status,
        202
    );
    let canceled = job_ended(&server, "campaigns", &id);
    assert_eq!(canceled["status"], "canceled", "{canceled}");
    wait_for("Ray has ended all of it", ended);
    wait_for("no part is looked after", || {
        let metrics = text(&server, "/metrics");
        metrics.contains("rotortwin_ray_parts{state=\"pending\"} 0\n")
            && metrics.contains("rotortwin_ray_parts{state=\"running\"} 0\n")
    });

    // A node without the program.
    assert_eq!(server.stop(), Some(0));
    let words = [
        "--workers",
        "1",
        "--executor",
        &executor,
        "--ray-program",
        "/nowhere/rotortwin",
    ];
    server = Server::start_at(&address, &data, &words);
    let id = server.submit_to("campaigns", &json!({ "text": campaign("nowhere", 1, 10.0) }));
    let failed = job_ended(&server, "campaigns", &id);
    let error = failed["error"].as_str().unwrap_or_default();
    assert!(
        error.contains("Ray at http://127.0.0.1:")
            && error.contains("has no program '/nowhere/rotortwin'")
            && error.contains("(3 attempts)"),
        "{failed}"
    );
}

/// Seed and length of the random deaths, s; `ROTORTWIN_RAY_SEED` and `ROTORTWIN_RAY_SECONDS` replace them.
const DEATHS: [(&str, u64); 2] = [("ROTORTWIN_RAY_SEED", 1), ("ROTORTWIN_RAY_SECONDS", 25)];

#[test]
fn scenario_random_deaths_of_nodes_server_and_postgres_change_no_byte() {
    let _alone = alone();
    let Some(mut cluster) = RayCluster::start() else { return };
    let scratch = Scratch::new();
    let Some(mut postgres) = Postgres::start(scratch.folder()) else {
        return;
    };
    let document = campaign("by-ray", PARTS, 120.0);
    let here = on_one_machine(&scratch, &document);
    let [seed, seconds] =
        DEATHS.map(|(name, usual)| std::env::var(name).map_or(usual, |text| text.parse().expect("a whole number")));
    let mut random = Random::new(seed);

    let data = scratch.path("data");
    let (url, artifacts) = (postgres.url(), scratch.path("artifacts").display().to_string());
    let executor = format!("ray={}", cluster.url());
    let program = program().display().to_string();
    let words = [
        "--database-url",
        &url,
        "--artifacts",
        &artifacts,
        "--workers",
        "1",
        "--executor",
        &executor,
        "--ray-program",
        &program,
    ];
    let mut server = Server::start_at("127.0.0.1:0", &data, &words);
    let address = server.address().to_owned();
    let ids: Vec<String> = (0..2)
        .map(|_| server.submit_to("campaigns", &json!({ "text": document })))
        .collect();

    let begun = Instant::now();
    let (mut dead, mut deaths) = ([false; 2], [0; 3]);
    // What happens next: each kind in each round, in an order by chance.
    let mut round = Vec::new();
    while begun.elapsed() < Duration::from_secs(seconds) || deaths.contains(&0) {
        if round.is_empty() {
            round = vec!["server", "Postgres", "node", "node"];
        }
        sleep(Duration::from_secs(2) + random.duration(Duration::from_secs(4)));
        match round.swap_remove(random.below(round.len() as u64) as usize) {
            "server" => {
                server.kill();
                sleep(random.duration(Duration::from_secs(2)));
                server = Server::start_at(&address, &data, &words);
                deaths[1] += 1;
            }
            "Postgres" => {
                postgres.kill();
                sleep(random.duration(Duration::from_secs(2)));
                postgres.up();
                deaths[2] += 1;
            }
            _ => {
                let node = random.below(2) as usize;
                if dead[node] {
                    cluster.add_node(node);
                } else {
                    cluster.kill_node(node);
                    deaths[0] += 1;
                }
                dead[node] = !dead[node];
            }
        }
    }
    for node in (0..2).filter(|node| dead[*node]) {
        cluster.add_node(node);
    }
    wait_for("the server is ready", || text(&server, "/readyz").starts_with("ready"));
    let expected = std::fs::read(here.join("campaign.parquet")).expect("it is there");
    for id in &ids {
        let whole = job_ended(&server, "campaigns", id);
        assert_eq!(whole["status"], "done", "{deaths:?}: {whole}");
        let there = file_there(&server, &format!("campaigns/{id}"), "campaign.parquet");
        assert!(
            there == expected,
            "campaign.parquet differs after {deaths:?} deaths of nodes, server, Postgres"
        );
    }
    println!("{deaths:?} deaths of nodes, server, Postgres (seed {seed})");
    assert!(
        deaths.iter().all(|count| *count > 0),
        "{deaths:?}: another seed or more time"
    );
}

/// The rows of a bench, in order, without the wall time.
fn rows_of(score: &Value) -> Vec<Value> {
    let mut rows = score["rows"].as_array().expect("rows").clone();
    for row in &mut rows {
        assert!(row.as_object_mut().expect("an object").remove("seconds").is_some());
    }
    rows
}

fn file_there(server: &Server, job: &str, file: &str) -> Vec<u8> {
    let answer = server.ask("GET", &format!("/api/v1/{job}/artifacts/{file}"), &[], "");
    assert_eq!(answer.status, 200, "{job}: {file}");
    answer.body
}

#[test]
fn scenario_ray_with_tokens_that_is_started_afresh_does_campaigns_and_blind_benches_over_tls_as_well() {
    let _alone = alone();
    let token = "hush-hush-0123456789abcdef0123456789abcdef";
    let with_token = [("RAY_AUTH_MODE", "token"), ("RAY_AUTH_TOKEN", token)];
    let Some(cluster) = RayCluster::start_with(&with_token, None) else {
        return;
    };
    let port = cluster.port();
    let scratch = Scratch::new();
    let executor = format!("ray={}", cluster.url());
    let program = program().display().to_string();
    let words = ["--workers", "1", "--executor", &executor, "--ray-program", &program];

    // Without a token, or with a wrong one, it does not start.
    for token in ["", "of-somebody-else"] {
        let call = ["serve", "--data", "none", "--listen", "127.0.0.1:0"];
        let said = Call::new(&scratch, call)
            .with(words)
            .behind(["env".into(), format!("ROTORTWIN_RAY_TOKEN={token}").into()])
            .run()
            .expect_code(2)
            .stderr
            .join("\n");
        assert!(
            said.contains("Ray at http://127.0.0.1:")
                && (said.contains("401") || said.contains("403"))
                && said.contains("expected a token of this cluster in ROTORTWIN_RAY_TOKEN"),
            "{said}"
        );
    }

    // The cluster dies in mid-flight, and another one is started at its address.
    let document = campaign("afresh", 4, 300.0);
    let here = on_one_machine(&scratch, &document);
    let bench = |out: &str| {
        let words = [
            "blind",
            "--preset",
            "mixed",
            "--n",
            "2",
            "--duration-s",
            "20",
            "--out",
            out,
        ];
        Call::new(&scratch, words)
    };
    bench("bench").run().expect_code(0);
    let ray_token = [("ROTORTWIN_RAY_TOKEN", token)];
    let data = scratch.path("data");
    let mut server = Server::start_in(&ray_token, "127.0.0.1:0", &data, &words);
    let flown = server.submit_to("campaigns", &json!({ "text": document }));
    wait_for("parts run", || {
        !text(&server, "/metrics").contains("rotortwin_ray_parts{state=\"running\"} 0\n")
    });
    let judged = server.submit_to(
        "blind-benches",
        &json!({ "presets": ["mixed"], "n": 2, "duration_s": 20 }),
    );
    drop(cluster);
    wait_for("readyz names Ray and what waits", || {
        let ready = text(&server, "/readyz");
        ready.contains("Ray at http://127.0.0.1:") && ready.contains("parts of campaigns and blind benches wait for it")
    });
    // A cancel needs no Ray.
    let unwanted = server.submit_to("campaigns", &json!({ "text": campaign("unwanted", 2, 3000.0) }));
    let cancel = format!("/api/v1/campaigns/{unwanted}/cancel");
    assert_eq!(server.ask("POST", &cancel, &[], "").status, 202);
    assert_eq!(job_ended(&server, "campaigns", &unwanted)["status"], "canceled");
    let cluster = RayCluster::start_with(&with_token, Some(port)).expect("it was there a moment ago");
    let whole = job_ended(&server, "campaigns", &flown);
    assert_eq!(whole["status"], "done", "{whole}");
    let flown = format!("campaigns/{flown}");
    for file in ["campaign.parquet", "campaign.csv"] {
        let same = file_there(&server, &flown, file) == std::fs::read(here.join(file)).expect("it is there");
        assert!(same, "{file} differs");
    }
    let programs = executors_environment().expect("it was there a moment ago");
    let (_, why) = attempts(&programs, &data);
    assert!(
        !why.is_empty() && why.iter().all(|why| why.contains("Ray at http://127.0.0.1:")),
        "{why:?}"
    );
    let whole = job_ended(&server, "blind-benches", &judged);
    assert_eq!(whole["status"], "done", "{whole}");
    let judged = format!("blind-benches/{judged}");
    let there = serde_json::from_slice(&file_there(&server, &judged, "score.json")).expect("JSON");
    assert_eq!(rows_of(&there), rows_of(&read_json(&scratch.path("bench/score.json"))));
    for file in ["truth/00000.json", "truth/00001.json"] {
        let own = std::fs::read(scratch.path("bench").join(file)).expect("it is there");
        assert!(file_there(&server, &judged, file) == own, "{file} differs");
    }
    assert_eq!(server.stop(), Some(0));

    // A server with HTTPS and tokens, whose nodes verify it by its CA certificate.
    let Some(folder) = certificates(&scratch, "certificates", &["bench,127.0.0.1"]) else {
        return;
    };
    let (cert, key, ca) = (
        folder.join("bench.pem").display().to_string(),
        folder.join("bench-key.pem").display().to_string(),
        folder.join("ca.pem").display().to_string(),
    );
    let data = scratch.path("secured");
    let made = Call::new(
        &scratch,
        [
            "token".into(),
            "create".into(),
            "--data".into(),
            data.clone().into_os_string(),
        ],
    )
    .with(["department"])
    .run()
    .expect_code(0);
    std::fs::write(scratch.path("token"), made.stdout).expect("written");
    let secured = ["--tls-cert", &cert, "--tls-key", &key, "--ray-ca", &ca];
    let more: Vec<&str> = words.iter().chain(&secured).copied().collect();
    let mut server = Server::start_in(&ray_token, "127.0.0.1:0", &data, &more);
    let url = server.url();
    assert!(url.starts_with("https://"), "{url}");
    let ended = bench("there")
        .with(["--server", &url, "--ca", &ca, "--token-file", "token"])
        .run()
        .expect_code(0);
    assert_eq!(
        rows_of(&read_json(&scratch.path("there/score.json"))),
        rows_of(&read_json(&scratch.path("bench/score.json"))),
        "{:?}",
        ended.stdout
    );
    assert_eq!(server.stop(), Some(0));
    drop(cluster);
}

#[test]
fn scenario_what_is_no_ray_cluster_is_refused_at_the_start() {
    let scratch = Scratch::new();
    let other = Server::start(&scratch.path("other"));
    let port = std::net::TcpListener::bind("127.0.0.1:0")
        .and_then(|free| free.local_addr())
        .expect("free")
        .port();
    for (executor, words) in [
        (
            "head:8265".to_owned(),
            "expected embedded, or ray=URL with the address of Ray's dashboard",
        ),
        (format!("ray=http://127.0.0.1:{port}"), "did not answer within 10 s"),
        (
            format!("ray={}", other.url()),
            "the responder is not the dashboard of a Ray cluster",
        ),
    ] {
        let call = [
            "serve",
            "--data",
            "data",
            "--listen",
            "127.0.0.1:0",
            "--executor",
            &executor,
        ];
        let ended = Call::new(&scratch, call).run().expect_code(2);
        let said = ended.stderr.join("\n");
        assert!(
            said.contains("--executor") && said.contains(words),
            "{executor}: {said}"
        );
        assert!(
            !executor.starts_with("ray=") || said.contains("Ray at http://127.0.0.1:"),
            "{said}"
        );
    }
    let call = Call::new(&scratch, ["part"]).run().expect_code(2);
    assert!(
        call.stderr.join("\n").contains("ROTORTWIN_PART_URL"),
        "{:?}",
        call.stderr
    );
}
