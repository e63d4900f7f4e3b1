//! The flight never waits for viewers.
#![expect(clippy::unwrap_used, reason = "a test that cannot connect has failed")]

use rotortwin_foxglove::Server;
use rotortwin_store::{SpoolHeader, telemetry_columns};
use rotortwin_wire::events::LiveSample;
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest as _;
use tungstenite::{Message, WebSocket};

const ROTORS: usize = 6;

fn header() -> SpoolHeader {
    SpoolHeader {
        rotor_count: ROTORS,
        step_ns: 2_500_000,
        rotor_positions_body_m: vec![[0.2, 0.1, 0.0]; ROTORS],
        hover_thrust_n: 2.5,
        ..SpoolHeader::default()
    }
}

fn sample(step: u64) -> LiveSample {
    let mut values = vec![Some(0.5); telemetry_columns(ROTORS).len()];
    let time_s = step as f64 * 0.02;
    values[0] = Some(time_s);
    LiveSample {
        step,
        sim_time_s: time_s,
        values,
    }
}

fn connect(address: SocketAddr) -> WebSocket<TcpStream> {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let mut request = format!("ws://{address}/").into_client_request().unwrap();
    request
        .headers_mut()
        .insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
    let (mut socket, answer) = tungstenite::client(request, stream).unwrap();
    assert_eq!(answer.headers()["sec-websocket-protocol"], "foxglove.sdk.v1");
    let wishes: Vec<String> = (0..12).map(|id| format!(r#"{{"id":{id},"channelId":{id}}}"#)).collect();
    let wish = format!(r#"{{"op":"subscribe","subscriptions":[{}]}}"#, wishes.join(","));
    socket.send(Message::text(wish)).unwrap();
    for op in ["serverInfo", "advertise"] {
        assert!(socket.read().unwrap().to_text().unwrap().contains(op));
    }
    socket
}

#[test]
fn scenario_a_viewer_that_reads_nothing_loses_rows_and_holds_nobody_up() {
    let columns = telemetry_columns(ROTORS);
    assert_eq!(columns[0].name, "time_s");
    let mut server = Server::listen("127.0.0.1:0".parse().unwrap(), "test", "1", &header()).unwrap();
    let mut stuck = connect(server.address());
    let mut quick = connect(server.address());
    let reader = std::thread::spawn(move || {
        let (mut binary, mut said) = (0, Vec::new());
        loop {
            match quick.read() {
                Ok(Message::Binary(_)) => binary += 1,
                Ok(Message::Text(text)) => said.push(text.to_string()),
                Ok(Message::Close(_)) | Err(_) => return (binary, said),
                Ok(_) => {}
            }
        }
    });
    // 2 minutes of a flight at twenty times its speed: more bytes than sockets buffer.
    let start = Instant::now();
    let mut longest = Duration::ZERO;
    for step in 0..6_000 {
        let before = Instant::now();
        server.show(&sample(step));
        longest = longest.max(before.elapsed());
        if step % 20 == 0 {
            std::thread::sleep(Duration::from_millis(20));
        }
    }
    // Waiting for the stuck one would take at least 2 s.
    assert!(longest < Duration::from_secs(1), "one row took {longest:?}");
    let end = Instant::now();
    drop(server);
    assert!(
        end.elapsed() < Duration::from_secs(2),
        "the end took {:?}",
        end.elapsed()
    );
    eprintln!("6000 rows in {:?}, the longest {longest:?}", start.elapsed());
    let (binary, said) = reader.join().unwrap();
    eprintln!("who reads got {binary} messages, and was told {said:?}");
    let mut rows = 0;
    while let Ok(message) = stuck.read() {
        rows += usize::from(message.is_binary());
    }
    assert!(
        rows < binary * 9 / 10,
        "who does not read has lost some: {rows} of {binary}"
    );
}

#[test]
fn scenario_who_was_slow_is_told_what_it_lost() {
    let mut server = Server::listen("127.0.0.1:0".parse().unwrap(), "test", "1", &header()).unwrap();
    let mut slow = connect(server.address());
    let mut step = 0;
    let mut show = |server: &mut Server, count: u64| {
        for _ in 0..count {
            server.show(&sample(step));
            step += 1;
        }
    };
    let deadline = Instant::now() + Duration::from_secs(60);
    let told = 'told: loop {
        assert!(Instant::now() < deadline, "nothing was said of lost rows");
        // More than its sockets buffer, and once more if its subscription had not arrived yet.
        show(&mut server, 4_000);
        for _ in 0..4_000 {
            show(&mut server, 1);
            if let Message::Text(text) = slow.read().unwrap() {
                break 'told text;
            }
        }
    };
    assert!(
        told.contains("rows were dropped") && told.contains(r#""op":"status""#),
        "{told}"
    );
}

#[test]
fn val_too_many_viewers_are_turned_away() {
    let server = Server::listen("127.0.0.1:0".parse().unwrap(), "test", "1", &header()).unwrap();
    let _there: Vec<_> = (0..16).map(|_| connect(server.address())).collect();
    let stream = TcpStream::connect(server.address()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let mut request = format!("ws://{}/", server.address()).into_client_request().unwrap();
    request
        .headers_mut()
        .insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
    tungstenite::client(request, stream).unwrap_err();
}
