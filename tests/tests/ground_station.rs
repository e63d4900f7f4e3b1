//! `fly --mavlink` read by an independent MAVLink client: pymavlink, in its own environment; counted as skipped where it is not
//! available.

use rotortwin_tests::program::{Call, Link};
use rotortwin_tests::python::environment;
use rotortwin_tests::scratch::{Scratch, shipped_scenario};
use serde_json::Value;
use std::io::{BufRead as _, BufReader, Read as _};
use std::net::UdpSocket;
use std::path::Path;
use std::process::{Command, Stdio};

#[test]
fn val_pymavlink_reads_a_flight_as_it_was() {
    let Some(programs) = environment("python-mavlink", &["pymavlink>=2.4.41,<3"]) else {
        return;
    };
    let port = UdpSocket::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
    let port = port.expect("a free port").port().to_string();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/listen_mavlink.py");
    let mut station = Command::new(programs.join("python"))
        .arg(script)
        .args([&port, "3"])
        .stdout(Stdio::piped())
        .spawn()
        .expect("Python starts");
    let mut said = BufReader::new(station.stdout.take().expect("it is piped"));
    let mut line = String::new();
    said.read_line(&mut line).expect("it says that it listens");
    assert_eq!(line, "listening\n");

    let scratch = Scratch::new();
    let fault = "fault=[{time_s=11.0, rotor=3, thrust_loss_percent=20.0}]";
    let call = Call::fly(&scratch, Link::InProcess, &shipped_scenario("hover"), "shown");
    let flown = call
        .with(["--pace", "real-time", "--mavlink", &format!("udp:127.0.0.1:{port}")])
        .with(["--set", "duration_s=14", "--set", fault, "--seed", "1"])
        .run()
        .expect_code(0);
    let mut text = String::new();
    said.read_to_string(&mut text).expect("it is text");
    assert!(station.wait().expect("it ends").success());
    let seen: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!((&seen["wrong"], &seen["missed"]), (&0.into(), &0.into()), "{seen}");
    // 25 Hz, the slow ones 1 or 2 Hz; a busy machine loses none, but may finish late.
    for (kind, count) in [
        ("ATTITUDE", 300),
        ("LOCAL_POSITION_NED", 300),
        ("GLOBAL_POSITION_INT", 300),
        ("SERVO_OUTPUT_RAW", 300),
        ("HEARTBEAT", 10),
        ("SYS_STATUS", 10),
        ("GPS_RAW_INT", 10),
    ] {
        assert!(
            seen["counts"][kind].as_u64() >= Some(count),
            "{kind}: {}",
            seen["counts"]
        );
    }
    let number = |path: &str| {
        seen.pointer(path)
            .and_then(Value::as_f64)
            .unwrap_or_else(|| panic!("{path}: {seen}"))
    };
    // The hover point is 5 m over the origin; home is the scenario's.
    assert!((number("/last/LOCAL_POSITION_NED/z") + 5.0).abs() < 0.3, "{seen}");
    assert!(
        (number("/last/GLOBAL_POSITION_INT/relative_alt") - 5000.0).abs() < 300.0,
        "{seen}"
    );
    assert!(
        (number("/last/GPS_RAW_INT/lat") * 1e-7 - 47.397_742).abs() < 1e-5,
        "{seen}"
    );
    let charge = flown.summary()["battery"]["state_of_charge_end"]
        .as_f64()
        .expect("a charge");
    assert!(
        (number("/last/SYS_STATUS/battery_remaining") - 100.0 * charge).abs() <= 1.5,
        "{seen}"
    );
    for rotor in 1..=6 {
        let pulse = number(&format!("/last/SERVO_OUTPUT_RAW/servo{rotor}_raw"));
        assert!((1200.0..1700.0).contains(&pulse), "rotor {rotor}: {pulse} µs");
    }
    let texts = seen["texts"].as_array().expect("texts");
    assert!(
        texts
            .iter()
            .any(|text| text.as_str().is_some_and(|text| text.contains("sequential rotor 3"))),
        "{texts:?}"
    );
}
