//! Flights live in Foxglove and Lichtblick: `rotortwin fly --foxglove`, and runs of a server.

use prost::Message as _;
use rotortwin_proto::foxglove::{FrameTransform, Log, PoseInFrame, SceneUpdate};
use rotortwin_tests::foxglove::{Heard, Viewer};
use rotortwin_tests::program::{Call, Link};
use rotortwin_tests::scratch::{Scratch, hover};
use rotortwin_tests::server::Server;
use serde_json::json;
use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;

const FAULT: &str = "[[fault]]\ntime_s = 1.5\nrotor = 3\nthrust_loss_percent = 20.0\n";

fn scenario(scratch: &Scratch, duration_s: f64) -> PathBuf {
    let path = scratch.path("shown.toml");
    std::fs::write(&path, hover("shown", duration_s, FAULT)).expect("it can be written");
    path
}

/// Address for viewers, from the line that announces it.
fn address(line: &str) -> String {
    let (_, address) = line.split_once("ws://").expect("an address");
    address.trim().to_owned()
}

/// Bytes by topic and time, ns.
type Messages = BTreeMap<(String, u64), Vec<Vec<u8>>>;

#[test]
fn scenario_a_viewer_sees_live_what_is_recorded() {
    let scratch = Scratch::new();
    let flight = scenario(&scratch, 4.0);
    let call = Call::fly(&scratch, Link::Iceoryx2, &flight, "run");
    let mut run = call.with(["--pace", "real-time", "--foxglove", "127.0.0.1:0"]).start();
    let address = address(&run.line(|line| line.contains("ws://")));
    let mut viewer = Viewer::connect(&address, "/", "foxglove.sdk.v1");
    assert_eq!(viewer.info["name"], "rotortwin: shown");
    let topics: Vec<String> = viewer.channels.keys().cloned().collect();
    let names: Vec<&str> = topics.iter().map(String::as_str).collect();
    viewer.subscribe(40, &names);
    viewer.say(&json!({ "op": "setParameters", "parameters": [] }));

    // A late viewer gets the earlier log messages.
    let late_address = address.clone();
    run.line(|line| line.contains("truth"));
    let mut late = Viewer::connect(&late_address, "/", "x, foxglove.websocket.v1");
    late.subscribe(7, &["/log"]);
    let early = loop {
        if let Heard::Message(_, time_ns, bytes) = late.hear() {
            break (time_ns, Log::decode(&bytes[..]).expect("a log").message);
        }
    };
    assert_eq!(early, (1_500_000_000, "rotor 3: −20 % thrust".to_owned()));

    let (mut live, mut status, mut last_ns) = (Messages::new(), Vec::new(), 0);
    loop {
        match viewer.hear() {
            Heard::Message(topic, time_ns, bytes) => live.entry((topic, time_ns)).or_default().push(bytes),
            Heard::Time(time_ns) => {
                assert!(time_ns >= last_ns, "in the order of time");
                last_ns = time_ns;
            }
            Heard::Text(text) => status.push(text),
            Heard::End => break,
        }
    }
    let ended = run.end(std::time::Duration::from_secs(60)).expect_code(0);
    assert!(last_ns > 3_900_000_000, "up to the end: {last_ns}");
    assert_eq!(status.len(), 1, "{status:?}");
    assert!(
        status[0]["message"]
            .as_str()
            .is_some_and(|text| text.contains("setParameters")),
        "{status:?}"
    );

    let bytes = std::fs::read(ended.out().join("run.mcap")).expect("it was written");
    let mut recorded = Messages::new();
    for message in mcap::MessageStream::new(&bytes).expect("it is MCAP") {
        let message = message.expect("it can be read");
        let schema = message.channel.schema.as_ref().expect("a schema");
        // Said after the flight.
        if message.channel.topic.starts_with("/detectors/") {
            continue;
        }
        let channel = &viewer.channels[&message.channel.topic];
        assert_eq!(
            (&channel.schema_name, &channel.schema[..]),
            (&schema.name, &schema.data[..])
        );
        let key = (message.channel.topic.clone(), message.log_time);
        recorded.entry(key).or_default().push(message.data.to_vec());
    }
    // Poses and scenes have their own rates: compare at common times.
    let mut same: BTreeMap<&str, usize> = BTreeMap::new();
    for ((topic, time_ns), bytes) in live
        .iter()
        .filter(|((topic, _), _)| topic != "/trail" && topic != "/log")
    {
        match recorded.get(&(topic.clone(), *time_ns)) {
            Some(known) => {
                assert_eq!(bytes, known, "{topic} at {time_ns} ns");
                *same.entry(topic).or_default() += 1;
            }
            None => assert!(
                ["/tf", "/pose", "/reference_pose", "/scene"].contains(&topic.as_str()),
                "{topic}"
            ),
        }
    }
    for topic in ["/nav", "/reference", "/command", "/truth", "/battery", "/fdi"] {
        assert!(same[topic] > 150, "{topic}: {same:?}");
    }
    for topic in ["/tf", "/pose", "/reference_pose", "/scene"] {
        assert!(same[topic] > 20, "{topic}: {same:?}");
    }
    // The scene: a vehicle at 5 m with six rotors, one of them reported as faulty.
    let last = |topic: &str| {
        live.range((topic.to_owned(), 0)..=(topic.to_owned(), u64::MAX))
            .next_back()
            .expect("one")
            .1
    };
    let pose = PoseInFrame::decode(&last("/pose")[0][..]).expect("a pose");
    let height = pose.pose.expect("a pose").position.expect("a place").z;
    assert!((4.0..6.0).contains(&height), "{height}");
    let transform = FrameTransform::decode(&last("/tf")[0][..]).expect("a transform");
    assert_eq!(
        (&*transform.parent_frame_id, &*transform.child_frame_id),
        ("world", "vehicle")
    );
    let scene = SceneUpdate::decode(&last("/scene")[0][..]).expect("a scene");
    assert_eq!(
        (scene.entities[0].cylinders.len(), scene.entities[0].arrows.len()),
        (6, 6)
    );
    let trail = SceneUpdate::decode(&last("/trail")[0][..]).expect("a scene");
    assert!(trail.entities[0].lines[0].points.len() > 20);

    // Viewers have not changed the flight.
    let alone = Call::fly(&scratch, Link::Iceoryx2, &flight, "alone")
        .run()
        .expect_code(0);
    assert_eq!(alone.run_hash(), ended.run_hash());
}

#[test]
fn scenario_strangers_and_the_gone_do_not_end_the_flight() {
    let scratch = Scratch::new();
    let flight = scenario(&scratch, 3.0);
    let call = Call::fly(&scratch, Link::InProcess, &flight, "run");
    let mut run = call.with(["--pace", "real-time", "--foxglove", "127.0.0.1:0"]).start();
    let address = address(&run.line(|line| line.contains("ws://")));
    let mut gone = Viewer::connect(&address, "/", "foxglove.sdk.v1");
    gone.subscribe(1, &["/nav", "/scene"]);
    drop(gone);
    let mut rude = TcpStream::connect(&address).expect("it listens");
    rude.write_all(b"\x00\xff not HTTP\r\n\r\n").expect("it takes it");
    let mut browser = TcpStream::connect(&address).expect("it listens");
    let request = format!("GET / HTTP/1.1\r\nHost: {address}\r\n\r\n");
    browser.write_all(request.as_bytes()).expect("it takes it");
    let mut page = String::new();
    browser.read_to_string(&mut page).expect("it answers and closes");
    assert!(
        page.starts_with("HTTP/1.1 426 ") && page.contains("Open connection, Foxglove WebSocket"),
        "{page}"
    );
    let _silent: Vec<TcpStream> = (0..40)
        .map(|_| TcpStream::connect(&address).expect("it listens"))
        .collect();
    let ended = run.end(std::time::Duration::from_secs(60)).expect_code(0);
    let alone = Call::fly(&scratch, Link::InProcess, &flight, "alone")
        .run()
        .expect_code(0);
    assert_eq!(alone.run_hash(), ended.run_hash());
}

#[test]
fn val_an_address_that_cannot_be_had_is_told_before_anything_is_written() {
    let scratch = Scratch::new();
    let flight = scenario(&scratch, 3.0);
    let taken = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = taken.local_addr().expect("it is bound").to_string();
    let refused = Call::fly(&scratch, Link::InProcess, &flight, "run")
        .with(["--foxglove", &address])
        .run()
        .expect_code(2);
    let said = refused.stderr.join("\n");
    assert!(
        said.contains(&address) && said.contains("in use") && said.contains("127.0.0.1:0 takes any"),
        "{said}"
    );
    assert!(!refused.out().exists());
    let refused = Call::new(&scratch, ["fly", "--foxglove", "hover"]).run().expect_code(2);
    let said = refused.stderr.join("\n");
    assert!(
        said.contains("'hover': expected IP:PORT") && said.contains("before --foxglove"),
        "{said}"
    );
    let elsewhere = ["--server", "http://127.0.0.1:1", "fly", "hover", "--foxglove"];
    let said = Call::new(&scratch, elsewhere).run().expect_code(2).stderr.join("\n");
    assert!(said.contains("--foxglove belongs to flights on this machine"), "{said}");
}

#[test]
fn scenario_a_run_of_a_server_is_shown() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start(&data);
    let id = server.submit(&json!({ "scenario": "short-hover", "pace": "real-time", "set": ["duration_s=4"] }));
    let path = format!("/api/v1/runs/{id}/foxglove");
    let mut viewer = Viewer::connect(server.address(), &path, "foxglove.websocket.v1, foxglove.sdk.v1");
    assert_eq!(viewer.info["sessionId"], id.as_str());
    viewer.subscribe(0, &["/scene", "/nav"]);
    let (mut scenes, mut last_ns) = (0, 0);
    loop {
        match viewer.hear() {
            Heard::Message(topic, time_ns, bytes) if topic == "/scene" => {
                let scene = SceneUpdate::decode(&bytes[..]).expect("a scene");
                assert_eq!(scene.entities[0].cylinders.len(), 6);
                (scenes, last_ns) = (scenes + 1, time_ns);
            }
            Heard::Message(..) | Heard::Time(_) => {}
            Heard::Text(text) => panic!("{text}"),
            Heard::End => break,
        }
    }
    assert!(
        scenes > 10 && last_ns > 3_000_000_000,
        "{scenes} scenes, the last at {last_ns} ns"
    );

    // No WebSocket, no such run, no such protocol.
    assert_eq!(server.ask("GET", &path, &[], "").status, 400);
    assert_eq!(server.ask("GET", "/api/v1/runs/none/foxglove", &[], "").status, 404);
    let stream = server.connect();
    let refusal =
        rotortwin_tests::websocket::WebSocket::open_on(stream, server.address(), &path, &[]).expect_err("no protocol");
    assert_eq!(refusal.0, 400);
    assert!(
        refusal.1["detail"]
            .as_str()
            .is_some_and(|text| text.contains("foxglove.sdk.v1")),
        "{refusal:?}"
    );
}
