//! PX4's simulator link against a scripted peer, written from docs/autopilots.md alone: it sees sensors only, estimates its state from them,
//! and flies with our own PID. Normal flight, and all kinds of connection failures. No autopilot is needed.
#![expect(clippy::unwrap_used, reason = "a scripted peer that cannot send has failed its test")]

mod autopilots;
mod failures;
mod inside;
mod links;
mod px4_estimate;

use autopilots::{HEXAROTOR, Watch, scenario_of};
use failures::sentence;
use inside::{Pilot, channels, patience};
use links::{flown, outputs};
use px4_estimate::Estimate;
use rotortwin_bridge::autopilot::Patience;
use rotortwin_bridge::autopilot::px4::Px4;
use rotortwin_bridge::mavlink::frame::{Decoder, encode};
use rotortwin_bridge::mavlink::messages::{HEARTBEAT, HIL_ACTUATOR_CONTROLS, HilActuatorControls, HilGps, HilSensor};
use rotortwin_flight::autopilot::AutopilotOutcome;
use rotortwin_flight::lockstep::FlightEnd;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::autopilot_frame::AutopilotKind;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// The peer's action for one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Act {
    Normal,
    SendTwice,
    /// The previous answer arrives again, before this one.
    Stale,
    Garbage,
    /// A whole second of other messages before the answer.
    Chatter,
    Damaged,
    Sleep(Duration),
    Stop,
    Restart,
    NotANumber,
    Future,
}

/// Its action for each sample.
type Script = Box<dyn Fn(u64) -> Act + Send>;

/// Samples: armed 2 s after the start; in flight from about 6 s.
const ARMS_S: f64 = 2.0;
const IN_FLIGHT: u64 = 2200;
/// First answer: some 70 ms after the first sample.
const FIRST_ANSWER: u64 = 18;

struct Peer {
    to: SocketAddr,
    pilot: Pilot,
    channels: &'static [usize],
    answers: u64,
}

impl Peer {
    fn new(scenario: &Scenario, to: SocketAddr) -> Self {
        Self {
            to,
            pilot: Pilot::new(scenario, ARMS_S),
            channels: channels(scenario),
            answers: 0,
        }
    }

    fn connect(&self) -> Option<TcpStream> {
        for _ in 0..200 {
            if let Ok(stream) = TcpStream::connect(self.to) {
                stream.set_nodelay(true).unwrap();
                stream.set_read_timeout(Some(Duration::from_secs(4))).unwrap();
                return Some(stream);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        None
    }

    /// Flies until the connection is gone; returns the number of answers.
    fn run(mut self, script: impl Fn(u64) -> Act) -> u64 {
        let mut estimate = Estimate::new();
        let (mut samples, mut last_us) = (0, None);
        while let Some(mut stream) = self.connect() {
            let hello = encode(0, 1, 1, HEARTBEAT, &[0, 0, 0, 0, 2, 12, 0, 0, 3]);
            if stream.write_all(&hello).is_err() {
                return self.answers;
            }
            match self.serve(&mut stream, &script, &mut estimate, &mut samples, &mut last_us) {
                Act::Restart => {}
                _ => return self.answers,
            }
        }
        self.answers
    }

    fn serve(
        &mut self,
        stream: &mut TcpStream,
        script: &impl Fn(u64) -> Act,
        estimate: &mut Estimate,
        samples: &mut u64,
        last_us: &mut Option<u64>,
    ) -> Act {
        let mut decoder = Decoder::default();
        let mut before: Option<Vec<u8>> = None;
        let mut buffer = [0; 4096];
        let mut since = 0;
        loop {
            let Ok(length) = stream.read(&mut buffer) else {
                return Act::Stop;
            };
            if length == 0 {
                return Act::Stop;
            }
            decoder.push(&buffer[..length]);
            while let Some(frame) = decoder.next_frame() {
                if let Some(fix) = HilGps::read(&frame) {
                    assert_eq!((fix.fix_type, fix.course), (3, 65535));
                    estimate.satellites(&fix);
                }
                let Some(sample) = HilSensor::read(&frame) else {
                    continue;
                };
                assert_eq!(sample.fields_updated & 0x3f, 0x3f);
                assert_eq!(
                    sample.fields_updated & 0x1c0 != 0,
                    samples.is_multiple_of(2),
                    "compass at 125 Hz"
                );
                assert_eq!(
                    sample.fields_updated & 0x1a00 != 0,
                    samples.is_multiple_of(5),
                    "barometer at 50 Hz"
                );
                let interval = last_us.map_or(0.004, |last| (sample.time_usec - last) as f64 * 1e-6);
                assert!((interval - 0.004).abs() < 1e-9, "{interval}");
                *last_us = Some(sample.time_usec);
                estimate.inertial(&sample, interval);
                (*samples, since) = (*samples + 1, since + 1);
                if since < FIRST_ANSWER {
                    continue;
                }
                let act = script(*samples);
                let time_s = sample.time_usec as f64 * 1e-6;
                let rates = sample.gyro.map(f64::from);
                let duty = self
                    .pilot
                    .duties(time_s, estimate.position, estimate.velocity, estimate.euler(), rates);
                let mut answer = HilActuatorControls {
                    time_usec: sample.time_usec,
                    flags: 1,
                    mode: if time_s >= ARMS_S { 129 } else { 1 },
                    ..HilActuatorControls::default()
                };
                for (channel, rotor) in self.channels.iter().enumerate() {
                    answer.controls[channel] = duty[rotor - 1];
                }
                match act {
                    Act::NotANumber => answer.controls[2] = f32::NAN,
                    Act::Future => answer.time_usec += 1_000_000,
                    Act::Sleep(time) => std::thread::sleep(time),
                    Act::Stop => {
                        // Alive but silent.
                        std::thread::sleep(Duration::from_secs(3));
                        return Act::Stop;
                    }
                    Act::Restart => return Act::Restart,
                    _ => {}
                }
                let bytes = encode(0, 1, 1, HIL_ACTUATOR_CONTROLS, &answer.encode());
                let mut out = Vec::new();
                match act {
                    Act::SendTwice => out.extend(&bytes),
                    Act::Stale => out.extend(before.iter().flatten()),
                    Act::Garbage => out.extend([0xfd, 0xfd, 3, 0, 9, 255, 1]),
                    Act::Damaged => {
                        let mut damaged = bytes.clone();
                        damaged[12] ^= 0x40;
                        out.extend(damaged);
                    }
                    Act::Chatter => {
                        (0..2000).for_each(|_| out.extend(encode(0, 1, 1, HEARTBEAT, &[0, 0, 0, 0, 2, 12, 0, 0, 3])))
                    }
                    _ => {}
                }
                out.extend(&bytes);
                self.answers += 1;
                if stream.write_all(&out).is_err() {
                    return Act::Stop;
                }
                before = Some(bytes);
            }
        }
    }
}

struct Flown {
    outcome: AutopilotOutcome,
    watch: Watch,
}

fn fly(duration_s: f64, more: &str, script: impl Fn(u64) -> Act + Send, pause: Option<(u64, Duration)>) -> Flown {
    fly_in(&scenario_of(HEXAROTOR, duration_s, more), script, pause)
}

fn fly_in(scenario: &Scenario, script: impl Fn(u64) -> Act + Send, pause: Option<(u64, Duration)>) -> Flown {
    let map = outputs(AutopilotKind::Px4, scenario);
    let mut link = Px4::listen("127.0.0.1:0".parse().unwrap(), map, patience()).unwrap();
    let peer = Peer::new(scenario, link.local_address().unwrap());
    let mut watch = Watch {
        pause,
        ..Watch::default()
    };
    std::thread::scope(|scope| {
        let peer = scope.spawn(move || peer.run(script));
        let outcome = flown(scenario, &mut link, &mut watch);
        drop(link);
        peer.join().unwrap();
        Flown { outcome, watch }
    })
}

fn short(script: impl Fn(u64) -> Act + Send) -> Flown {
    fly(5.0, "", script, None)
}

fn at(sample: u64, act: Act) -> impl Fn(u64) -> Act + Send {
    move |now| if now == sample { act } else { Act::Normal }
}

#[test]
fn scenario_takes_off_holds_and_the_damaged_propeller_is_isolated() {
    let fault = "[[fault]]\ntime_s = 12.0\nrotor = 3\nthrust_loss_percent = 10.0";
    let flown = fly(18.0, fault, |_| Act::Normal, None);
    assert_eq!(flown.outcome.flight.end, FlightEnd::Done);
    assert_eq!(flown.outcome.flight.steps, 7200);
    assert!(flown.watch.farthest_m < 0.6, "{} m", flown.watch.farthest_m);
    assert_eq!(flown.watch.verdict, 3);
}

#[test]
fn scenario_a_quadrotor_takes_off_holds_and_the_damaged_propeller_is_isolated() {
    let fault = "[[fault]]\ntime_s = 12.0\nrotor = 2\nthrust_loss_percent = 10.0";
    let flown = fly_in(&scenario_of("quad-x-skids", 18.0, fault), |_| Act::Normal, None);
    assert_eq!(flown.outcome.flight.end, FlightEnd::Done);
    assert!(flown.watch.farthest_m < 0.6, "{} m", flown.watch.farthest_m);
    assert_eq!(flown.watch.verdict, 2);
}

#[test]
fn scenario_an_octorotor_takes_off_holds_and_the_damaged_propeller_is_isolated() {
    let fault = "[[fault]]\ntime_s = 12.0\nrotor = 2\nthrust_loss_percent = 10.0";
    let flown = fly_in(&scenario_of("octo-x-skids", 18.0, fault), |_| Act::Normal, None);
    assert_eq!(flown.outcome.flight.end, FlightEnd::Done);
    assert!(flown.watch.farthest_m < 0.6, "{} m", flown.watch.farthest_m);
    assert_eq!(flown.watch.verdict, 2);
}

#[test]
fn scenario_what_happens_to_answers_changes_nothing() {
    let hash = |flown: &Flown| {
        assert_eq!(flown.outcome.flight.end, FlightEnd::Done);
        flown.outcome.flight.run_hash.clone()
    };
    let plain = hash(&short(|_| Act::Normal));
    let late = Duration::from_millis(1500);
    let scripts: [(&str, Script); 7] = [
        ("again", Box::new(|_| Act::Normal)),
        (
            "sent twice",
            Box::new(|n| if n % 97 == 5 { Act::SendTwice } else { Act::Normal }),
        ),
        (
            "stale",
            Box::new(|n| if n % 89 == 3 { Act::Stale } else { Act::Normal }),
        ),
        (
            "late",
            Box::new(move |n| {
                if n == 100 || n == IN_FLIGHT {
                    Act::Sleep(late)
                } else {
                    Act::Normal
                }
            }),
        ),
        (
            "garbage",
            Box::new(|n| if n % 83 == 1 { Act::Garbage } else { Act::Normal }),
        ),
        (
            "chatter",
            Box::new(|n| if n % 500 == 99 { Act::Chatter } else { Act::Normal }),
        ),
        (
            "damaged",
            Box::new(|n| if n % 79 == 1 { Act::Damaged } else { Act::Normal }),
        ),
    ];
    for (name, script) in scripts {
        assert_eq!(hash(&short(script)), plain, "{name}");
    }
    let paused = fly(5.0, "", |_| Act::Normal, Some((400, Duration::from_secs(3))));
    assert_eq!(hash(&paused), plain, "we think for 3 s");
}

#[test]
fn scenario_restarts() {
    assert_eq!(short(at(300, Act::Restart)).outcome.flight.end, FlightEnd::Done);
    let flown = short(at(IN_FLIGHT, Act::Restart));
    let said = sentence(&flown.outcome);
    assert!(said.starts_with("PX4 at 127.0.0.1:"), "{said}");
    assert!(
        said.contains("closed the connection after its answer to the sample of 8."),
        "{said}"
    );
}

#[test]
fn scenario_failures_name_peer_and_sample() {
    let said = |act: Act| sentence(&short(at(IN_FLIGHT, act)).outcome).to_owned();
    let silent = said(Act::Stop);
    assert!(
        silent.contains("sent nothing after its answer to the sample of 8.7"),
        "{silent}"
    );
    assert!(silent.ends_with("allowed are 2500 ms (--step-timeout)"), "{silent}");
    let nan = said(Act::NotANumber);
    assert!(nan.ends_with("with NaN in control 3, expected 0 to 1"), "{nan}");
    let future = said(Act::Future);
    assert!(
        future.contains("that was never sent, the latest is that of 8.8"),
        "{future}"
    );
}

#[test]
fn scenario_nobody_comes_or_nobody_answers() {
    let scenario = scenario_of(HEXAROTOR, 3.0, "");
    let map = outputs(AutopilotKind::Px4, &scenario);
    let impatient = Patience {
        join: Duration::from_millis(400),
        ..patience()
    };
    let mut link = Px4::listen("127.0.0.1:0".parse().unwrap(), map.clone(), impatient.clone()).unwrap();
    let to = link.local_address().unwrap();
    let outcome = flown(&scenario, &mut link, &mut Watch::default());
    assert_eq!(
        sentence(&outcome),
        format!("PX4 did not connect to TCP {to} within 400 ms (--join-timeout)")
    );
    let busy = Px4::listen(to, map.clone(), patience()).unwrap_err();
    assert!(
        busy.starts_with(&format!("cannot open TCP {to} to wait for PX4: ")),
        "{busy}"
    );
    drop(link);

    let mut link = Px4::listen("127.0.0.1:0".parse().unwrap(), map, impatient).unwrap();
    let mut silent = TcpStream::connect(link.local_address().unwrap()).unwrap();
    silent.write_all(b"GET / HTTP/1.0\r\n\r\n").unwrap();
    let outcome = flown(&scenario, &mut link, &mut Watch::default());
    let said = sentence(&outcome);
    assert!(said.contains("is connected and has answered none of "), "{said}");
    assert!(said.contains("18 bytes that are not MAVLink 2"), "{said}");
}
