//! ArduPilot's JSON backend against a scripted peer, written from docs/autopilots.md alone: normal flight, and all kinds of faulty
//! datagrams. No autopilot is needed.
#![expect(clippy::unwrap_used, reason = "a scripted peer that cannot send has failed its test")]

mod autopilots;
mod failures;
mod inside;
mod links;

use autopilots::{HEXAROTOR, Watch, scenario_of};
use failures::sentence;
use inside::{Pilot, channels, patience};
use links::{flown, outputs};
use rotortwin_bridge::autopilot::Patience;
use rotortwin_bridge::autopilot::ardupilot::ArduPilot;
use rotortwin_bridge::autopilot::servo_packet::ServoPacket;
use rotortwin_flight::autopilot::AutopilotOutcome;
use rotortwin_flight::conform::{SpinReport, spin_test};
use rotortwin_flight::lockstep::FlightEnd;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::autopilot_frame::AutopilotKind;
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

    fn send(&self, packet: &ServoPacket) {
        self.socket.send_to(&packet.encode(), self.to).unwrap();
    }

    /// Repeats the packet until it is answered; `None`: no more answers.
    fn ask(&mut self, packet: &ServoPacket) -> Option<String> {
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
        let mut before = None;
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
            let packet = ServoPacket {
                frame_rate_hz: 1000,
                frame: self.frame,
                channels: self.channels,
                pulses_us: std::array::from_fn(|i| if i < self.channels { pulses_us[i] } else { 0 }),
            };
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
            let packet = ServoPacket {
                frame_rate_hz: 1,
                frame: 77,
                channels: 16,
                pulses_us: [2000; 32],
            };
            while !stop.load(Ordering::Relaxed) {
                // Not before the peer is known: until then the first comer is.
                for _ in 0..if known.load(Ordering::Relaxed) { 2 } else { 0 } {
                    socket.send_to(&packet.encode(), to).unwrap();
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

/// On the stand, over the link, with the autopilot's outputs connected to the motors of `map`, our rotors from 1.
fn on_the_stand(map: [usize; 6]) -> SpinReport {
    let scenario = scenario_of(HEXAROTOR, 5.0, "");
    let outputs = outputs(AutopilotKind::ArduPilot, &scenario);
    let table = outputs.rotor_of_channel.clone();
    let mut link = ArduPilot::listen(([127, 0, 0, 1], 0).into(), outputs, patience()).unwrap();
    let mut peer = Peer::new(&scenario, link.local_address().unwrap());
    peer.map = map.to_vec();
    let peer = std::thread::spawn(move || peer.run(|_| Act::Normal));
    let report = spin_test(&mut link, &scenario, 1, &table, &mut |_, _| {}).unwrap();
    drop(link);
    peer.join().unwrap();
    report
}

#[test]
fn scenario_swapped_motors_are_named_over_the_link() {
    let right = on_the_stand([2, 5, 6, 3, 1, 4]);
    assert!(right.is_right(), "{right:?}");
    // Wires of channels 2 and 6 swapped.
    let swapped = on_the_stand([2, 4, 6, 3, 1, 5]);
    let wrong: Vec<[usize; 3]> = swapped
        .motors
        .iter()
        .filter(|motor| !motor.is_right())
        .map(|motor| [motor.channel, motor.rotor, motor.answers_as])
        .collect();
    assert_eq!(wrong, [[2, 5, 4], [6, 4, 5]], "{swapped:?}");
}
