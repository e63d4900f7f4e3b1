//! PX4's simulator link against a scripted peer, written from docs/autopilots.md alone: it sees sensors only, estimates its state from them,
//! and flies with our own PID. Normal flight, and all kinds of connection failures. No autopilot is needed.
#![expect(clippy::unwrap_used, reason = "a scripted peer that cannot send has failed its test")]

mod autopilots;
mod failures;
mod inside;
mod links;
mod px4_estimate;
mod rate_loop;

use autopilots::{HEXAROTOR, Watch, scenario_of};
use failures::sentence;
use inside::{Pilot, channels, patience, wrong};
use links::{flown, outputs};
use px4_estimate::Estimate;
use rate_loop::RateLoop;
use rotortwin_bridge::autopilot::Patience;
use rotortwin_bridge::autopilot::px4::Px4;
use rotortwin_bridge::mavlink::frame::{Decoder, encode};
use rotortwin_bridge::mavlink::messages::{HEARTBEAT, HIL_ACTUATOR_CONTROLS, HilActuatorControls, HilGps, HilSensor};
use rotortwin_flight::autopilot::AutopilotOutcome;
use rotortwin_flight::conform::{SpinReport, spin_test};
use rotortwin_flight::lockstep::FlightEnd;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::autopilot_frame::AutopilotKind;
use rotortwin_wire::autopilot::{Autopilot as _, Readings};
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::sync::{Mutex, OnceLock};
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
    /// No answer, but a heartbeat.
    Missing,
    /// The payload ends after this many bytes, with a checksum that fits.
    Short(usize),
    /// Three more bytes, as of a newer catalogue.
    Long,
    Restart,
    NotANumber,
    /// A motor at this control.
    Control(f32),
    Future,
}

/// Its action for each sample.
type Script = Box<dyn Fn(u64) -> Act + Send>;

/// Samples: armed 2 s after the start; in flight from about 6 s.
const ARMS_S: f64 = 2.0;
const IN_FLIGHT: u64 = 2200;
/// First answer: some 70 ms after the first sample.
const FIRST_ANSWER: u64 = 18;

/// Run hash of a flight without disturbances.
fn plain() -> &'static str {
    static PLAIN: OnceLock<String> = OnceLock::new();
    PLAIN.get_or_init(|| hash(&short(|_| Act::Normal)))
}

fn hash(flown: &Flown) -> String {
    assert_eq!(flown.outcome.flight.end, FlightEnd::Done);
    flown.outcome.flight.run_hash.clone()
}

fn heartbeat() -> Vec<u8> {
    encode(0, 1, 1, HEARTBEAT, &[0, 0, 0, 0, 2, 12, 0, 0, 3])
}

fn patient() -> Patience {
    // As on the command line.
    Patience {
        step: Duration::from_secs(5),
        ..patience()
    }
}

struct Peer {
    scenario: Scenario,
    to: SocketAddr,
    pilot: Pilot,
    /// In place of the pilot's own loop.
    rate_loop: Option<RateLoop>,
    channels: Vec<usize>,
    /// Connects again, and begins anew, when the plant closes the connection.
    returns: bool,
}

/// The samples seen so far.
#[derive(Default)]
struct Seen {
    samples: u64,
    last_us: Option<u64>,
    /// Samples with a compass and with a barometer, the last of each.
    compass: Option<u64>,
    barometer: Option<u64>,
}

impl Seen {
    /// Takes in a sample and returns the time since the one before, s. Each instrument keeps its rate.
    fn take(&mut self, sample: &HilSensor) -> f64 {
        assert_eq!(sample.fields_updated & 0x3f, 0x3f);
        let now = self.samples;
        let every = |last: &mut Option<u64>, bits: u32, samples: u64| {
            let since = last.map(|last| now - last);
            if sample.fields_updated & bits != 0 {
                assert!(since.is_none_or(|since| since == samples), "{since:?} of {samples}");
                *last = Some(now);
            } else {
                assert!(since.is_none_or(|since| since < samples), "{since:?} of {samples}");
            }
        };
        // 125 Hz and 50 Hz.
        every(&mut self.compass, 0x1c0, 2);
        every(&mut self.barometer, 0x1a00, 5);
        let interval = self
            .last_us
            .map_or(0.004, |last| (sample.time_usec - last) as f64 * 1e-6);
        assert!((interval - 0.004).abs() < 1e-9, "{interval}");
        self.last_us = Some(sample.time_usec);
        self.samples += 1;
        interval
    }
}

impl Peer {
    fn new(scenario: &Scenario, to: SocketAddr) -> Self {
        Self {
            scenario: scenario.clone(),
            to,
            pilot: Pilot::new(scenario, ARMS_S),
            rate_loop: None,
            channels: channels(scenario).to_vec(),
            returns: false,
        }
    }

    fn connect(&self) -> Option<TcpStream> {
        for _ in 0..1000 {
            if let Ok(stream) = TcpStream::connect(self.to) {
                stream.set_nodelay(true).unwrap();
                stream.set_read_timeout(Some(Duration::from_secs(4))).unwrap();
                return Some(stream);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        None
    }

    /// Flies until the connection is gone.
    fn run(mut self, script: impl Fn(u64) -> Act) {
        let (mut estimate, mut seen) = (Estimate::new(), Seen::default());
        while let Some(mut stream) = self.connect() {
            if stream.write_all(&heartbeat()).is_err() {
                return;
            }
            match self.serve(&mut stream, &script, &mut estimate, &mut seen) {
                Act::Restart => {}
                _ if self.returns => {
                    self.pilot = Pilot::new(&self.scenario, ARMS_S);
                    (estimate, seen) = (Estimate::new(), Seen::default());
                }
                _ => return,
            }
        }
    }

    fn serve(
        &mut self,
        stream: &mut TcpStream,
        script: &impl Fn(u64) -> Act,
        estimate: &mut Estimate,
        seen: &mut Seen,
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
                let interval = seen.take(&sample);
                estimate.inertial(&sample, interval);
                since += 1;
                if since < FIRST_ANSWER {
                    continue;
                }
                let act = script(seen.samples);
                let answer = self.answer(&sample, estimate, act);
                match act {
                    Act::Sleep(time) => std::thread::sleep(time),
                    Act::Stop => {
                        // Alive but silent.
                        std::thread::sleep(Duration::from_secs(3));
                        return Act::Stop;
                    }
                    Act::Restart => return Act::Restart,
                    _ => {}
                }
                let mut payload = answer.encode();
                match act {
                    Act::Short(bytes) => payload.truncate(bytes),
                    Act::Long => payload.extend([7; 3]),
                    _ => {}
                }
                let bytes = encode(0, 1, 1, HIL_ACTUATOR_CONTROLS, &payload);
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
                    Act::Chatter => (0..2000).for_each(|_| out.extend(heartbeat())),
                    Act::Missing => out.extend(heartbeat()),
                    _ => {}
                }
                if act != Act::Missing {
                    out.extend(&bytes);
                }
                if stream.write_all(&out).is_err() {
                    return Act::Stop;
                }
                before = Some(bytes);
            }
        }
    }

    fn answer(&mut self, sample: &HilSensor, estimate: &Estimate, act: Act) -> HilActuatorControls {
        let time_s = sample.time_usec as f64 * 1e-6;
        let rates = sample.gyro.map(f64::from);
        let (position, velocity, attitude) = (estimate.position, estimate.velocity, estimate.euler());
        let duty = match &mut self.rate_loop {
            Some(rate_loop) => rate_loop.duties(time_s, (position[2], velocity[2]), attitude, rates),
            None => self.pilot.duties(time_s, position, velocity, attitude, rates),
        };
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
            Act::Control(value) => answer.controls[2] = value,
            Act::Future => answer.time_usec += 1_000_000,
            _ => {}
        }
        answer
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
    fly_with(scenario, patience(), script, pause)
}

/// A link that listens, and the peer that will connect to it.
fn pair(scenario: &Scenario, patience: Patience) -> (Px4, Peer) {
    let map = outputs(AutopilotKind::Px4, scenario);
    let link = Px4::listen("127.0.0.1:0".parse().unwrap(), map, patience).unwrap();
    let peer = Peer::new(scenario, link.local_address().unwrap());
    (link, peer)
}

fn fly_with(
    scenario: &Scenario,
    patience: Patience,
    script: impl Fn(u64) -> Act + Send,
    pause: Option<(u64, Duration)>,
) -> Flown {
    let (mut link, peer) = pair(scenario, patience);
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
    let plain = plain();
    let late = Duration::from_millis(1500);
    let scripts: [(&str, Script); 8] = [
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
        // Bytes that a newer catalogue may have added are ignored, as the standard says.
        (
            "longer",
            Box::new(|n| if n % 73 == 2 { Act::Long } else { Act::Normal }),
        ),
    ];
    for (name, script) in scripts {
        assert_eq!(hash(&short(script)), plain, "{name}");
    }
    let paused = fly(5.0, "", |_| Act::Normal, Some((400, Duration::from_secs(3))));
    assert_eq!(hash(&paused), plain, "we think for 3 s");
}

#[test]
fn scenario_an_autopilot_that_pauses_for_three_seconds_costs_no_simulated_time() {
    let scenario = scenario_of(HEXAROTOR, 5.0, "");
    let paused = Act::Sleep(Duration::from_secs(3));
    assert_eq!(
        hash(&fly_with(&scenario, patient(), at(IN_FLIGHT, paused), None)),
        plain()
    );
}

#[test]
fn scenario_a_second_connection_gets_nothing_and_changes_nothing() {
    let scenario = scenario_of(HEXAROTOR, 5.0, "");
    let (mut link, peer) = pair(&scenario, patience());
    let to = link.local_address().unwrap();
    let (second, read_nothing) = (Mutex::new(None), Mutex::new(false));
    std::thread::scope(|scope| {
        let (second, read_nothing) = (&second, &read_nothing);
        let peer = scope.spawn(move || {
            peer.run(|sample| {
                if sample == 100 {
                    let mut stream = TcpStream::connect(to).unwrap();
                    let wrong = HilActuatorControls {
                        time_usec: u64::MAX,
                        controls: [f32::NAN; 16],
                        mode: 129,
                        ..HilActuatorControls::default()
                    };
                    stream.write_all(&heartbeat()).unwrap();
                    stream
                        .write_all(&encode(0, 1, 1, HIL_ACTUATOR_CONTROLS, &wrong.encode()))
                        .unwrap();
                    stream.set_nonblocking(true).unwrap();
                    *second.lock().unwrap() = Some(stream);
                }
                if sample == IN_FLIGHT {
                    let mut stream: TcpStream = second.lock().unwrap().take().unwrap();
                    let read = stream.read(&mut [0; 16]).map_err(|error| error.kind());
                    *read_nothing.lock().unwrap() = read == Err(ErrorKind::WouldBlock);
                }
                Act::Normal
            });
        });
        let outcome = flown(&scenario, &mut link, &mut Watch::default());
        drop(link);
        peer.join().unwrap();
        assert_eq!(outcome.flight.end, FlightEnd::Done);
        assert_eq!(outcome.flight.run_hash, plain());
    });
    assert!(
        *read_nothing.lock().unwrap(),
        "the second connection was read from or closed"
    );
}

#[test]
fn scenario_a_second_connection_takes_over_before_the_flight() {
    let scenario = scenario_of(HEXAROTOR, 3.0, "");
    let (mut link, peer) = pair(&scenario, patience());
    // Connected first, it never answers.
    let first = TcpStream::connect(link.local_address().unwrap()).unwrap();
    std::thread::scope(|scope| {
        let peer = scope.spawn(move || peer.run(|_| Act::Normal));
        scope.spawn(move || {
            std::thread::sleep(Duration::from_millis(500));
            drop(first);
        });
        let outcome = flown(&scenario, &mut link, &mut Watch::default());
        drop(link);
        peer.join().unwrap();
        assert_eq!(outcome.flight.end, FlightEnd::Done);
    });
}

#[test]
fn scenario_the_plant_comes_back_while_the_autopilot_waits() {
    let scenario = scenario_of(HEXAROTOR, 5.0, "");
    let (mut first, mut peer) = pair(&scenario, patience());
    let to = first.local_address().unwrap();
    peer.returns = true;
    std::thread::scope(|scope| {
        let peer = scope.spawn(move || peer.run(|_| Act::Normal));
        // The first plant dies 0.4 s after its start, in the middle of the exchange.
        for sample in 0..100 {
            let readings = Readings {
                time_ns: sample * 4_000_000,
                ..Readings::default()
            };
            first.exchange(&readings).unwrap();
        }
        drop(first);
        std::thread::sleep(Duration::from_millis(300));
        let map = outputs(AutopilotKind::Px4, &scenario);
        // Another test may have the port for a moment.
        let mut tries = 0;
        let mut link = loop {
            match Px4::listen(to, map.clone(), patience()) {
                Ok(link) => break link,
                Err(refused) => assert!(tries < 40, "{refused}"),
            }
            tries += 1;
            std::thread::sleep(Duration::from_millis(100));
        };
        let outcome = flown(&scenario, &mut link, &mut Watch::default());
        drop(link);
        peer.join().unwrap();
        assert_eq!(outcome.flight.end, FlightEnd::Done);
        assert_eq!(outcome.flight.run_hash, plain());
    });
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
    let missing = said(Act::Missing);
    assert!(
        missing.contains("did not answer the sample of 8.8")
            && missing.contains("s (other messages since: 1, answers to earlier samples among them: 0): awaited for "),
        "{missing}"
    );
    assert!(missing.ends_with("allowed are 2500 ms (--step-timeout)"), "{missing}");
    let nan = said(Act::NotANumber);
    assert!(nan.ends_with("with NaN in control 3, expected 0 to 1"), "{nan}");
    let beyond = said(Act::Control(7.5));
    assert!(beyond.ends_with("with 7.5 in control 3, expected 0 to 1"), "{beyond}");
    let future = said(Act::Future);
    assert!(
        future.contains("that was never sent, the latest is that of 8.8"),
        "{future}"
    );
}

#[test]
fn scenario_an_answer_cut_short_is_no_disarmed_one() {
    // Time, flags and all motors of a hexarotor; those of one; none.
    for bytes in [40, 20, 9] {
        let flown = short(at(IN_FLIGHT, Act::Short(bytes)));
        let said = sentence(&flown.outcome);
        assert!(
            said.starts_with("PX4 at 127.0.0.1:") && said.contains("answered the sample of 8.8"),
            "{said}"
        );
        assert!(
            said.ends_with(&format!(
                "with a payload of {bytes} bytes, expected 81 (HIL_ACTUATOR_CONTROLS): its last one, the mode, is missing"
            )),
            "{said}"
        );
    }
    // Cut within its time it is the answer to an earlier sample.
    let flown = short(at(IN_FLIGHT, Act::Short(2)));
    let said = sentence(&flown.outcome);
    assert!(
        said.contains("did not answer the sample of 8.8")
            && said.contains("(other messages since: 1, answers to earlier samples among them: 1)"),
        "{said}"
    );
}

/// Answers each sample that arrives with the payload that `answer` gives for its time, µs; `None` closes the connection.
fn answers(to: SocketAddr, answer: impl Fn(u64) -> Option<Vec<u8>>) {
    let mut stream = TcpStream::connect(to).unwrap();
    stream.set_nodelay(true).unwrap();
    let (mut decoder, mut buffer) = (Decoder::default(), [0; 4096]);
    while let Ok(length) = stream.read(&mut buffer)
        && length > 0
    {
        decoder.push(&buffer[..length]);
        while let Some(frame) = decoder.next_frame() {
            let Some(sample) = HilSensor::read(&frame) else {
                continue;
            };
            let Some(payload) = answer(sample.time_usec) else {
                return;
            };
            let bytes = encode(0, 1, 1, HIL_ACTUATOR_CONTROLS, &payload);
            if stream.write_all(&bytes).is_err() {
                return;
            }
        }
    }
}

/// MAVLink 2 lets a sender omit zeros at the end. Without a mode that ever came, short answers without motors are those of a disarmed autopilot.
#[test]
fn scenario_an_answer_without_a_mode_is_disarmed_until_one_had_a_mode() {
    let scenario = scenario_of(HEXAROTOR, 3.0, "");
    let map = outputs(AutopilotKind::Px4, &scenario);
    for zeros_at_the_end in [false, true] {
        let mut link = Px4::listen("127.0.0.1:0".parse().unwrap(), map.clone(), patience()).unwrap();
        let to = link.local_address().unwrap();
        let peer = std::thread::spawn(move || {
            answers(to, |time_usec| {
                let mut answer = HilActuatorControls {
                    time_usec,
                    flags: 1,
                    ..HilActuatorControls::default()
                };
                match time_usec {
                    // Disarmed, all zeros.
                    ..1_000_000 => {}
                    1_000_000..2_000_000 => (answer.controls, answer.mode) = ([0.5; 16], 129),
                    // The mode is cut off, or everything behind the flags.
                    _ if zeros_at_the_end => answer.mode = 0,
                    _ => answer.controls = [0.5; 16],
                }
                Some(answer.encode())
            });
        });
        let mut ask = |sample: u64| {
            link.exchange(&Readings {
                time_ns: sample * 4_000_000,
                ..Readings::default()
            })
        };
        // Sample n has the time 4 (n + 1) ms.
        for sample in 0..249 {
            assert_eq!(ask(sample).unwrap()[..6], [0.0; 6], "sample {sample}");
        }
        for sample in 249..499 {
            assert_eq!(ask(sample).unwrap()[..6], [0.5; 6], "sample {sample}");
        }
        let said = ask(499).unwrap_err().sentence;
        let length = if zeros_at_the_end { 9 } else { 80 };
        assert!(
            said.ends_with(&format!(
                "answered the sample of 2.000 s with a payload of {length} bytes, expected 81 (HIL_ACTUATOR_CONTROLS): its last one, the \
                 mode, is missing"
            )),
            "{said}"
        );
        drop(link);
        peer.join().unwrap();
    }
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

/// It came, answered and left before the flight, and nobody comes again.
#[test]
fn scenario_a_peer_that_leaves_before_the_flight_is_named() {
    let scenario = scenario_of(HEXAROTOR, 3.0, "");
    let map = outputs(AutopilotKind::Px4, &scenario);
    let impatient = Patience {
        join: Duration::from_millis(400),
        ..patience()
    };
    let mut link = Px4::listen("127.0.0.1:0".parse().unwrap(), map, impatient).unwrap();
    let to = link.local_address().unwrap();
    let peer = std::thread::spawn(move || {
        answers(to, |time_usec| {
            (time_usec < 40_000).then(|| {
                let answer = HilActuatorControls {
                    time_usec,
                    ..HilActuatorControls::default()
                };
                answer.encode()
            })
        });
    });
    let mut sample = 0;
    let said = loop {
        sample += 1;
        let readings = Readings {
            time_ns: sample * 4_000_000,
            ..Readings::default()
        };
        if let Err(error) = link.exchange(&readings) {
            break error.sentence;
        }
    };
    peer.join().unwrap();
    assert!(said.starts_with("PX4 at 127.0.0.1:"), "{said}");
    assert!(
        said.contains(" closed the connection after its answer to the sample of 0.036 s, "),
        "{said}"
    );
    assert!(
        said.ends_with(&format!(
            "and no other one to TCP {to} came within 400 ms (--join-timeout)"
        )),
        "{said}"
    );
}

/// On the stand, over the link: the peer with these changes.
fn tested(scenario: &Scenario, change: impl FnOnce(&mut Peer)) -> Result<SpinReport, String> {
    let table = outputs(AutopilotKind::Px4, scenario).rotor_of_channel;
    let (mut link, mut peer) = pair(scenario, patience());
    change(&mut peer);
    let peer = std::thread::spawn(move || peer.run(|_| Act::Normal));
    let report = spin_test(&mut link, scenario, 1, &table, &mut |_, _| {});
    drop(link);
    peer.join().unwrap();
    report
}

/// Our rotor, from 1, that each channel of the autopilot means, and those that it takes to turn the other way.
fn on_the_stand(scenario: &Scenario, means: &[usize], reversed: &[usize]) -> SpinReport {
    let changed = tested(scenario, |peer| {
        peer.channels = means.to_vec();
        peer.pilot = Pilot::with_spins(scenario, ARMS_S, reversed);
    });
    changed.unwrap()
}

#[test]
fn scenario_the_stand_does_not_blame_right_motors_and_names_swapped_and_reversed_ones() {
    // Vehicle; two channels whose wires are swapped; a rotor that is taken to turn the other way.
    for (vehicle, [a, b], reversed) in [(HEXAROTOR, [2, 6], 3), ("octo-x-skids", [1, 2], 6)] {
        let scenario = scenario_of(vehicle, 5.0, "");
        let right = channels(&scenario);
        let report = on_the_stand(&scenario, right, &[]);
        assert!(report.is_right(), "{vehicle}: {report:?}");

        let mut means = right.to_vec();
        means.swap(a - 1, b - 1);
        let report = on_the_stand(&scenario, &means, &[]);
        let (rotor_a, rotor_b) = (right[a - 1], right[b - 1]);
        let expected = [[a, rotor_a, rotor_b], [b, rotor_b, rotor_a]];
        assert_eq!(wrong(&report), expected, "{vehicle}: {report:?}");
        assert!(
            report.motors.iter().all(|motor| !motor.reversed),
            "{vehicle}: {report:?}"
        );

        let report = on_the_stand(&scenario, right, &[reversed]);
        let channel = right.iter().position(|rotor| *rotor == reversed).unwrap() + 1;
        assert_eq!(wrong(&report), [[channel, reversed, reversed]], "{vehicle}: {report:?}");
    }
}

/// The attitude is prescribed, so that the integrators of the body rates go to their bounds and motors to their limits.
#[test]
fn scenario_integrators_that_wind_up_on_the_stand_never_blame_a_right_motor() {
    let scenario = scenario_of("octo-x-skids", 5.0, "");
    let mut open = 0;
    for wanted in [
        [-0.05, 0.0, -0.03],
        [0.05, 0.05, 0.05],
        [0.03, -0.05, 0.0],
        [0.0, 0.0, 0.0],
    ] {
        let outcome = tested(&scenario, |peer| {
            peer.rate_loop = Some(RateLoop::new(&scenario, ARMS_S, wanted, true));
        });
        match outcome {
            Ok(report) => assert!(report.is_right(), "{wanted:?}: {report:?}"),
            Err(sentence) => {
                assert!(sentence.starts_with("cannot tell"), "{wanted:?}: {sentence}");
                assert!(sentence.contains("at their limits"), "{wanted:?}: {sentence}");
                assert!(sentence.contains("px4-stand.env"), "{wanted:?}: {sentence}");
                open += 1;
            }
        }
    }
    assert!(open > 0, "no integrator has driven motors to their limits");
}

/// As with the settings for the stand.
#[test]
fn scenario_without_integrators_the_same_loop_is_judged() {
    let scenario = scenario_of("octo-x-skids", 5.0, "");
    let right = channels(&scenario);
    let report = |means: &[usize]| {
        let outcome = tested(&scenario, |peer| {
            peer.channels = means.to_vec();
            peer.rate_loop = Some(RateLoop::new(&scenario, ARMS_S, [-0.02, 0.0, -0.02], false));
        });
        outcome.unwrap()
    };
    let as_wired = report(right);
    assert!(as_wired.is_right(), "{as_wired:?}");
    let mut means = right.to_vec();
    means.swap(0, 1);
    let swapped = report(&means);
    let expected = [[1, right[0], right[1]], [2, right[1], right[0]]];
    assert_eq!(wrong(&swapped), expected, "{swapped:?}");
}
