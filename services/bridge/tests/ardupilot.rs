//! ArduPilot's JSON backend against a scripted peer, written from docs/autopilots.md alone: normal flight, and all kinds of faulty
//! datagrams. No autopilot is needed.
#![expect(clippy::unwrap_used, reason = "a scripted peer that cannot send has failed its test")]

mod autopilots;
mod failures;
mod inside;
mod links;

use autopilots::{HEXAROTOR, Watch, scenario_of};
use failures::sentence;
use inside::{Pilot, channels, patience, wrong};
use links::{flown, outputs};
use rotortwin_bridge::autopilot::Patience;
use rotortwin_bridge::autopilot::ardupilot::ArduPilot;
use rotortwin_bridge::autopilot::servo_packet::ServoPacket;
use rotortwin_flight::autopilot::AutopilotOutcome;
use rotortwin_flight::conform::{SpinReport, spin_test};
use rotortwin_flight::lockstep::FlightEnd;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::autopilot_frame::AutopilotKind;
use rotortwin_wire::autopilot::{Autopilot as _, Readings};
use std::net::{SocketAddr, UdpSocket};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The peer's action for one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Act {
    Normal,
    SendTwice,
    /// Loses the answer, and repeats the request a second later.
    LoseAnswer,
    /// The previous packet arrives again, after this one.
    Overtaken,
    Garbage,
    Sleep(Duration),
    Stop,
    Restart,
    /// A pulse on channel 3.
    Pulse(u16),
    /// The frame number jumps by this much.
    Jump(u32),
    /// Does not wait for the answer.
    Rush,
}

/// Its action for each frame.
type Script = Box<dyn Fn(u32) -> Act + Send>;

/// Frame at which it arms.
const ARMS_AT: u32 = 2000;

/// Run hash of a flight without disturbances, and a frame 2.5 s after its hand-over.
fn plain() -> &'static (String, u32) {
    static PLAIN: OnceLock<(String, u32)> = OnceLock::new();
    PLAIN.get_or_init(|| {
        let flown = short(|_| Act::Normal);
        assert_eq!(flown.outcome.flight.end, FlightEnd::Done);
        assert_eq!(flown.outcome.flight.steps, 2000);
        (
            flown.outcome.flight.run_hash,
            ((flown.outcome.prelude_s + 2.5) * 1000.0) as u32,
        )
    })
}

struct Peer {
    socket: UdpSocket,
    to: SocketAddr,
    frame: u32,
    channels: usize,
    pilot: Pilot,
    map: Vec<usize>,
    sent: u64,
    answers: u64,
}

fn socket() -> UdpSocket {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(1))).unwrap();
    socket
}

/// A servo packet, byte by byte as the protocol is described: packed and little endian, u16 magic (18458 is 48 1A in hexadecimal, 29569 of the
/// wide one 73 81), u16 frame rate, u32 frame count, u16 pulse of each of 16 or 32 channels. Not by the codec under test.
fn servo_packet(frame_rate_hz: u16, frame: u32, pulses_us: &[u16]) -> Vec<u8> {
    let low_first = |number: u32, bytes: u32| (0..bytes).map(move |byte| (number >> (8 * byte) & 0xff) as u8);
    let magic: [u8; 2] = match pulses_us.len() {
        16 => [0x1a, 0x48],
        32 => [0x81, 0x73],
        other => panic!("{other} channels"),
    };
    let mut packet = magic.to_vec();
    packet.extend(low_first(u32::from(frame_rate_hz), 2));
    packet.extend(low_first(frame, 4));
    for pulse in pulses_us {
        packet.extend(low_first(u32::from(*pulse), 2));
    }
    packet
}

/// Three numbers after a key, found by searching, without a space in between.
fn vector(line: &str, key: &str) -> [f64; 3] {
    let start = line.find(&format!("\"{key}\":[")).unwrap() + key.len() + 4;
    let numbers = &line[start..start + line[start..].find(']').unwrap()];
    let parsed: Vec<f64> = numbers.split(',').map(|x| x.parse().unwrap()).collect();
    parsed.try_into().unwrap()
}

impl Peer {
    fn new(scenario: &Scenario, to: SocketAddr) -> Self {
        Self {
            socket: socket(),
            to,
            frame: 0,
            channels: 16,
            pilot: Pilot::new(scenario, f64::from(ARMS_AT) * 0.001),
            map: channels(scenario).to_vec(),
            sent: 0,
            answers: 0,
        }
    }

    fn send(&self, packet: &[u8]) {
        self.socket.send_to(packet, self.to).unwrap();
    }

    /// Repeats the packet until it is answered; `None`: no more answers.
    fn ask(&mut self, packet: &[u8]) -> Option<String> {
        let mut buffer = [0; 2048];
        for _ in 0..4 {
            self.send(packet);
            self.sent += 1;
            if let Ok((length, _)) = self.socket.recv_from(&mut buffer) {
                self.answers += 1;
                return Some(String::from_utf8(buffer[..length].to_vec()).unwrap());
            }
        }
        None
    }

    /// Flies until there are no more answers, following the script. Returns answers, and frames sent.
    fn run(mut self, script: impl Fn(u32) -> Act) -> (u64, u64) {
        let mut duty = [0.0_f32; 16];
        let mut before: Option<Vec<u8>> = None;
        let (mut total, mut rushed, mut time_s) = (0, 0, 0.0);
        loop {
            let act = script(total);
            let mut pulses_us = [1000; 32];
            for (channel, rotor) in self.map.iter().enumerate() {
                pulses_us[channel] = (1000.0 + 1000.0 * duty[rotor - 1]).round() as u16;
            }
            // No pulses for some frames, as observed.
            if (1900..1905).contains(&total) {
                pulses_us = [0; 32];
            }
            if let Act::Pulse(pulse) = act {
                pulses_us[2] = pulse;
            }
            let packet = servo_packet(1000, self.frame, &pulses_us[..self.channels]);
            match act {
                Act::SendTwice => self.send(&packet),
                Act::Overtaken => {
                    self.send(&packet);
                    before.iter().for_each(|before| self.send(before));
                }
                Act::Garbage => {
                    for bytes in [&b"hello"[..], &[0; 40], &[7; 72], &[]] {
                        self.socket.send_to(bytes, self.to).unwrap();
                    }
                }
                Act::Sleep(time) => std::thread::sleep(time),
                Act::Stop => return (self.answers, self.sent),
                Act::Rush => {
                    rushed += 1;
                    if rushed > 3000 {
                        return (self.answers, self.sent);
                    }
                    self.send(&packet);
                    self.frame += 1;
                    total += 1;
                    continue;
                }
                _ => {}
            }
            let answer = if act == Act::Overtaken {
                // Sent above.
                let mut buffer = [0; 2048];
                let length = self.socket.recv(&mut buffer).unwrap();
                self.answers += 1;
                self.sent += 1;
                Some(String::from_utf8(buffer[..length].to_vec()).unwrap())
            } else if act == Act::LoseAnswer {
                let lost = self.ask(&packet);
                std::thread::sleep(Duration::from_secs(1));
                lost.and_then(|_| self.ask(&packet))
            } else {
                self.ask(&packet)
            };
            let Some(line) = answer else {
                return (self.answers, self.sent);
            };
            assert!(line.starts_with('\n') && line.ends_with("}\n"), "{line}");
            let start = line.find("\"timestamp\":").unwrap() + 12;
            let end = start + line[start..].find(',').unwrap();
            time_s = f64::max(time_s, line[start..end].parse().unwrap());
            let [position, velocity, attitude, rates] =
                ["position", "velocity", "attitude", "gyro"].map(|key| vector(&line, key));
            duty = self.pilot.duties(time_s, position, velocity, attitude, rates);
            before = Some(packet);
            total += 1;
            self.frame += match act {
                Act::Jump(frames) => frames,
                _ => 1,
            };
            if act == Act::Restart {
                self.socket = socket();
                self.frame = 0;
            }
        }
    }
}

struct Flown {
    outcome: AutopilotOutcome,
    watch: Watch,
    answers: u64,
    sent: u64,
}

/// A flight of `duration_s` with a scripted peer.
fn fly(
    duration_s: f64,
    more: &str,
    script: impl Fn(u32) -> Act + Send,
    channels: usize,
    pause: Option<(u64, Duration)>,
) -> Flown {
    fly_in(&scenario_of(HEXAROTOR, duration_s, more), script, channels, pause)
}

fn fly_in(
    scenario: &Scenario,
    script: impl Fn(u32) -> Act + Send,
    channels: usize,
    pause: Option<(u64, Duration)>,
) -> Flown {
    let map = outputs(AutopilotKind::ArduPilot, scenario);
    let mut link = ArduPilot::listen("127.0.0.1:0".parse().unwrap(), map, patience()).unwrap();
    let mut peer = Peer::new(scenario, link.local_address().unwrap());
    peer.channels = channels;
    let mut watch = Watch {
        pause,
        ..Watch::default()
    };
    std::thread::scope(|scope| {
        let peer = scope.spawn(move || peer.run(script));
        let outcome = flown(scenario, &mut link, &mut watch);
        drop(link);
        let (answers, sent) = peer.join().unwrap();
        Flown {
            outcome,
            watch,
            answers,
            sent,
        }
    })
}

fn short(script: impl Fn(u32) -> Act + Send) -> Flown {
    fly(5.0, "", script, 16, None)
}

fn at(frame: u32, act: Act) -> impl Fn(u32) -> Act + Send {
    move |now| if now == frame { act } else { Act::Normal }
}

/// Hexadecimal digits, two per byte.
fn bytes_of(hex: &str) -> Vec<u8> {
    let digits: String = hex.split_whitespace().collect();
    let byte = |at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap();
    (0..digits.len()).step_by(2).map(byte).collect()
}

/// 16 and 32 channels as they go over the wire, written by hand. Pulse n of frame 74565 (0x12345) at 1200 Hz (0x4b0) is 1000 + n µs (0x3e8 + n).
#[test]
fn val_servo_packets_are_the_bytes_of_the_protocol() {
    let head = "b004 45230100";
    let first = "e803 e903 ea03 eb03 ec03 ed03 ee03 ef03 f003 f103 f203 f303 f403 f503 f603 f703";
    let second = "f803 f903 fa03 fb03 fc03 fd03 fe03 ff03 0004 0104 0204 0304 0404 0504 0604 0704";
    for (bytes, channels) in [
        (format!("1a48 {head} {first}"), 16),
        (format!("8173 {head} {first} {second}"), 32),
    ] {
        let bytes = bytes_of(&bytes);
        assert_eq!(bytes.len(), 8 + 2 * channels);
        let pulses: Vec<u16> = (1000..).take(channels).collect();
        assert_eq!(servo_packet(1200, 0x1_2345, &pulses), bytes, "the scripted peer");
        let packet = ServoPacket::decode(&bytes).unwrap();
        assert_eq!(
            (packet.frame_rate_hz, packet.frame, packet.channels),
            (1200, 0x1_2345, channels)
        );
        assert_eq!(packet.pulses_us[..channels], pulses);
        assert!(packet.pulses_us[channels..].iter().all(|pulse| *pulse == 0));
        assert_eq!(packet.encode(), bytes);
        // The other magic, and the same bytes in the other order, are refused.
        for magic in [[0x1a, 0x48], [0x81, 0x73], [0x48, 0x1a], [0x73, 0x81]] {
            let mut other = bytes.clone();
            other[..2].copy_from_slice(&magic);
            assert_eq!(ServoPacket::decode(&other).is_ok(), magic == bytes[..2], "{magic:?}");
        }
    }
}

#[test]
fn scenario_takes_off_holds_and_the_damaged_propeller_is_isolated() {
    let fault = "[[fault]]\ntime_s = 12.0\nrotor = 3\nthrust_loss_percent = 10.0";
    let flown = fly(18.0, fault, |_| Act::Normal, 16, None);
    assert_eq!(flown.outcome.flight.end, FlightEnd::Done);
    assert_eq!(flown.outcome.flight.steps, 7200);
    assert!(flown.watch.farthest_m < 0.3, "{} m", flown.watch.farthest_m);
    assert_eq!(flown.watch.verdict, 3);
    assert!(
        (2.0..15.0).contains(&flown.outcome.prelude_s),
        "{} s",
        flown.outcome.prelude_s
    );
}

#[test]
fn scenario_a_quadrotor_takes_off_holds_and_the_damaged_propeller_is_isolated() {
    let fault = "[[fault]]\ntime_s = 12.0\nrotor = 2\nthrust_loss_percent = 10.0";
    let flown = fly_in(&scenario_of("quad-x-skids", 18.0, fault), |_| Act::Normal, 16, None);
    assert_eq!(flown.outcome.flight.end, FlightEnd::Done);
    assert!(flown.watch.farthest_m < 0.3, "{} m", flown.watch.farthest_m);
    assert_eq!(flown.watch.verdict, 2);
}

#[test]
fn scenario_an_octorotor_takes_off_holds_and_the_damaged_propeller_is_isolated() {
    let fault = "[[fault]]\ntime_s = 12.0\nrotor = 2\nthrust_loss_percent = 10.0";
    let flown = fly_in(&scenario_of("octo-x-skids", 18.0, fault), |_| Act::Normal, 16, None);
    assert_eq!(flown.outcome.flight.end, FlightEnd::Done);
    assert!(flown.watch.farthest_m < 0.3, "{} m", flown.watch.farthest_m);
    assert_eq!(flown.watch.verdict, 2);
}

#[test]
fn scenario_what_happens_to_datagrams_changes_nothing() {
    let (hash, in_flight) = plain().clone();
    let second = Duration::from_millis(1100);
    let scripts: [(&str, Script); 6] = [
        ("again", Box::new(|_| Act::Normal)),
        (
            "sent twice",
            Box::new(|n| if n % 97 == 5 { Act::SendTwice } else { Act::Normal }),
        ),
        (
            "answers lost",
            Box::new(move |n| {
                if n == 50 || n == in_flight {
                    Act::LoseAnswer
                } else {
                    Act::Normal
                }
            }),
        ),
        (
            "late",
            Box::new(move |n| {
                if n == 3 || n == in_flight {
                    Act::Sleep(second)
                } else {
                    Act::Normal
                }
            }),
        ),
        (
            "overtaken",
            Box::new(|n| if n % 89 == 3 { Act::Overtaken } else { Act::Normal }),
        ),
        (
            "garbage",
            Box::new(|n| if n % 83 == 1 { Act::Garbage } else { Act::Normal }),
        ),
    ];
    for (name, script) in scripts {
        let flown = short(script);
        assert_eq!(flown.outcome.flight.end, FlightEnd::Done, "{name}");
        assert_eq!(flown.outcome.flight.run_hash, hash, "{name}");
    }
    let wide = fly(5.0, "", |_| Act::Normal, 32, None);
    assert_eq!(wide.outcome.flight.run_hash, hash, "32 channels");
}

#[test]
fn scenario_a_repeated_packet_that_waited_for_us_is_answered_once() {
    // We compute for 3.2 s: it requests the same frame four times, and must not find four answers.
    let flown = fly(5.0, "", |_| Act::Normal, 16, Some((400, Duration::from_millis(3200))));
    assert_eq!(flown.outcome.flight.end, FlightEnd::Done);
    // The last packet has no answer: the run is over. It is sent four times.
    let repeated = flown.sent - flown.answers;
    assert_eq!(repeated, 3 + 4, "{} sent, {} answered", flown.sent, flown.answers);
    assert_eq!(
        flown.outcome.flight.run_hash,
        short(|_| Act::Normal).outcome.flight.run_hash
    );
}

#[test]
fn scenario_a_flood_from_elsewhere_changes_nothing() {
    let quiet = fly(3.0, "", |_| Act::Normal, 16, None).outcome.flight;
    let scenario = scenario_of(HEXAROTOR, 3.0, "");
    let map = outputs(AutopilotKind::ArduPilot, &scenario);
    let mut link = ArduPilot::listen("127.0.0.1:0".parse().unwrap(), map, patience()).unwrap();
    let to = link.local_address().unwrap();
    let peer = Peer::new(&scenario, to);
    let (known, stop) = (AtomicBool::new(false), AtomicBool::new(false));
    std::thread::scope(|scope| {
        let (known, stop) = (&known, &stop);
        let peer = scope.spawn(move || {
            peer.run(|frame| {
                known.store(frame > 0, Ordering::Relaxed);
                Act::Normal
            })
        });
        scope.spawn(move || {
            let socket = socket();
            let packet = servo_packet(1, 77, &[2000; 16]);
            while !stop.load(Ordering::Relaxed) {
                // Not before the peer is known: until then the first comer is.
                for _ in 0..if known.load(Ordering::Relaxed) { 2 } else { 0 } {
                    socket.send_to(&packet, to).unwrap();
                    socket.send_to(b"noise", to).unwrap();
                }
                std::thread::sleep(Duration::from_millis(1));
            }
        });
        let outcome = flown(&scenario, &mut link, &mut Watch::default());
        stop.store(true, Ordering::Relaxed);
        let ignored = link.ignored();
        drop(link);
        peer.join().unwrap();
        assert_eq!((&outcome.flight.end, &quiet.end), (&FlightEnd::Done, &FlightEnd::Done));
        assert_eq!(outcome.flight.run_hash, quiet.run_hash);
        assert!(ignored > 100, "only {ignored} foreign datagrams came");
    });
}

#[test]
fn scenario_an_autopilot_that_pauses_for_three_seconds_costs_no_simulated_time() {
    let (hash, in_flight) = plain().clone();
    let scenario = scenario_of(HEXAROTOR, 5.0, "");
    let map = outputs(AutopilotKind::ArduPilot, &scenario);
    // As on the command line.
    let patient = Patience {
        step: Duration::from_secs(5),
        ..patience()
    };
    let mut link = ArduPilot::listen("127.0.0.1:0".parse().unwrap(), map, patient).unwrap();
    let peer = Peer::new(&scenario, link.local_address().unwrap());
    std::thread::scope(|scope| {
        let peer = scope.spawn(move || peer.run(at(in_flight, Act::Sleep(Duration::from_secs(3)))));
        let outcome = flown(&scenario, &mut link, &mut Watch::default());
        drop(link);
        peer.join().unwrap();
        assert_eq!((outcome.flight.end, outcome.flight.run_hash), (FlightEnd::Done, hash));
    });
}

#[test]
fn scenario_a_transmitter_is_in_every_answer() {
    let scenario = scenario_of(HEXAROTOR, 3.0, "");
    let map = outputs(AutopilotKind::ArduPilot, &scenario);
    for (rc, expected) in [
        ("", None),
        (
            "1500/1500/1000",
            Some("\"rc\":{\"rc_1\":1500,\"rc_2\":1500,\"rc_3\":1000}"),
        ),
    ] {
        let link = ArduPilot::listen("127.0.0.1:0".parse().unwrap(), map.clone(), patience()).unwrap();
        let mut link = match expected {
            Some(_) => link.with_rc(rc.parse().unwrap()),
            None => link,
        };
        let to = link.local_address().unwrap();
        let peer = std::thread::spawn(move || {
            let (socket, mut buffer) = (socket(), [0; 2048]);
            let packets: Vec<Vec<u8>> = (0..4).map(|frame| servo_packet(1000, frame, &[1000; 16])).collect();
            for packet in &packets[..3] {
                socket.send_to(packet, to).unwrap();
                let length = socket.recv(&mut buffer).unwrap();
                let line = std::str::from_utf8(&buffer[..length]).unwrap();
                match expected {
                    Some(rc) => assert!(line.contains(rc), "{line}"),
                    None => assert!(!line.contains("rc"), "{line}"),
                }
            }
            // The last exchange waits for it.
            socket.send_to(&packets[3], to).unwrap();
        });
        for _ in 0..4 {
            link.exchange(&Readings::default()).unwrap();
        }
        peer.join().unwrap();
    }
}

#[test]
fn scenario_restarts() {
    // Restart of the autopilot on the ground: allowed.
    assert_eq!(short(at(1000, Act::Restart)).outcome.flight.end, FlightEnd::Done);
    // In flight: the run ends.
    let in_flight = plain().1;
    let flown = short(at(in_flight, Act::Restart));
    let said = sentence(&flown.outcome);
    assert!(
        said.contains(&format!(
            "restarted in flight: its frame {in_flight} was followed by frame 0 from 127.0.0.1:"
        )),
        "{said}"
    );
}

#[test]
fn scenario_the_plant_comes_back_while_the_autopilot_waits() {
    let scenario = scenario_of(HEXAROTOR, 3.0, "");
    let map = outputs(AutopilotKind::ArduPilot, &scenario);
    let first = ArduPilot::listen("127.0.0.1:0".parse().unwrap(), map.clone(), patience()).unwrap();
    let to = first.local_address().unwrap();
    let peer = Peer::new(&scenario, to);
    std::thread::scope(|scope| {
        let peer = scope.spawn(move || peer.run(|_| Act::Normal));
        // The first plant dies without answering the packet.
        std::thread::sleep(Duration::from_millis(300));
        drop(first);
        std::thread::sleep(Duration::from_millis(300));
        let mut link = ArduPilot::listen(to, map, patience()).unwrap();
        let outcome = flown(&scenario, &mut link, &mut Watch::default());
        drop(link);
        assert_eq!(outcome.flight.end, FlightEnd::Done);
        peer.join().unwrap();
    });
}

#[test]
fn scenario_failures_name_peer_and_frame() {
    let in_flight = plain().1;
    let said = |act: Act| sentence(&short(at(in_flight, act)).outcome).to_owned();
    let silent = said(Act::Stop);
    assert!(silent.starts_with("ArduPilot at 127.0.0.1:"), "{silent}");
    assert!(
        silent.contains(&format!(
            "sent nothing new after frame {}: silent for 25",
            in_flight - 1
        )),
        "{silent}"
    );
    assert!(silent.ends_with("allowed are 2500 ms (--step-timeout)"), "{silent}");
    let pulse = said(Act::Pulse(65_535));
    assert!(
        pulse.ends_with(&format!(
            "frame {in_flight}: channel 3 has a pulse of 65535 µs, expected 0 (none) or 400 to 2600"
        )),
        "{pulse}"
    );
    let jump = said(Act::Jump(5));
    assert!(
        jump.ends_with(&format!(
            "sent frame {} after frame {in_flight}: it did not wait for the replies between them",
            in_flight + 5
        )),
        "{jump}"
    );
    let rush = sentence(&short(move |n| if n >= in_flight { Act::Rush } else { Act::Normal }).outcome).to_owned();
    assert!(
        rush.contains("does not wait for replies") || rush.contains("did not wait for the replies"),
        "{rush}"
    );
}

#[test]
fn scenario_nobody_comes() {
    let scenario = scenario_of(HEXAROTOR, 3.0, "");
    let map = outputs(AutopilotKind::ArduPilot, &scenario);
    let impatient = Patience {
        join: Duration::from_millis(400),
        ..patience()
    };
    let mut link = ArduPilot::listen("127.0.0.1:0".parse().unwrap(), map.clone(), impatient).unwrap();
    let to = link.local_address().unwrap();
    socket().send_to(&[1; 12], to).unwrap();
    let outcome = flown(&scenario, &mut link, &mut Watch::default());
    let said = sentence(&outcome);
    assert!(
        said.starts_with(&format!("no servo packet of ArduPilot came to UDP {to} within 400 ms (--join-timeout); 1 other datagram came: the last from")),
        "{said}"
    );
    assert!(
        said.ends_with("has 12 bytes, expected 40 (16 channels) or 72 (32 channels)"),
        "{said}"
    );
    // Port in use: an error message, immediately.
    let busy = ArduPilot::listen(to, map, patience()).unwrap_err();
    assert!(
        busy.starts_with(&format!("cannot open UDP {to} to wait for ArduPilot: ")),
        "{busy}"
    );
}

#[test]
fn scenario_never_leaving_the_ground_ends_the_prelude() {
    // It never arms: pulses stay at 1000.
    let scenario = scenario_of(HEXAROTOR, 3.0, "");
    let map = outputs(AutopilotKind::ArduPilot, &scenario);
    let mut link = ArduPilot::listen("127.0.0.1:0".parse().unwrap(), map, patience()).unwrap();
    let mut peer = Peer::new(&scenario, link.local_address().unwrap());
    peer.pilot = Pilot::new(&scenario, 1e9);
    std::thread::scope(|scope| {
        let peer = scope.spawn(move || peer.run(|_| Act::Normal));
        let outcome = flown(&scenario, &mut link, &mut Watch::default());
        drop(link);
        peer.join().unwrap();
        let said = sentence(&outcome);
        assert!(
            said.contains("did not come to rest within 0.5 m of the first point of the trajectory in 30 s"),
            "{said}"
        );
        assert!(said.ends_with("it is 1.3 m away at 0.0 m/s, on the ground"), "{said}");
    });
}

/// On the stand, over the link: our rotor, from 1, that each channel of the autopilot means, and those that it takes to turn the other way.
fn on_the_stand(scenario: &Scenario, means: &[usize], reversed: &[usize]) -> SpinReport {
    let outputs = outputs(AutopilotKind::ArduPilot, scenario);
    let table = outputs.rotor_of_channel.clone();
    let mut link = ArduPilot::listen(([127, 0, 0, 1], 0).into(), outputs, patience()).unwrap();
    let mut peer = Peer::new(scenario, link.local_address().unwrap());
    peer.map = means.to_vec();
    peer.pilot = Pilot::with_spins(scenario, f64::from(ARMS_AT) * 0.001, reversed);
    let peer = std::thread::spawn(move || peer.run(|_| Act::Normal));
    let report = spin_test(&mut link, scenario, 1, &table, &mut |_, _| {}).unwrap();
    drop(link);
    peer.join().unwrap();
    report
}

#[test]
fn scenario_swapped_motors_are_named_over_the_link() {
    let scenario = scenario_of(HEXAROTOR, 5.0, "");
    let right = on_the_stand(&scenario, &[2, 5, 6, 3, 1, 4], &[]);
    assert!(right.is_right(), "{right:?}");
    // Wires of channels 2 and 6 swapped.
    let swapped = on_the_stand(&scenario, &[2, 4, 6, 3, 1, 5], &[]);
    assert_eq!(wrong(&swapped), [[2, 5, 4], [6, 4, 5]], "{swapped:?}");
}

#[test]
fn scenario_a_reversed_motor_is_named_over_the_link() {
    let scenario = scenario_of(HEXAROTOR, 5.0, "");
    let reversed = on_the_stand(&scenario, channels(&scenario), &[3]);
    // Our rotor 3 is on channel 4.
    assert_eq!(wrong(&reversed), [[4, 3, 3]], "{reversed:?}");
}
