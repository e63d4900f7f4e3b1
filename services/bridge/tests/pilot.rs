//! The pilot against scripted autopilots commanded over MAVLink, written from docs/autopilots.md alone.
#![expect(clippy::unwrap_used, reason = "a scripted peer that cannot send has failed its test")]

mod autopilots;
mod failures;

use autopilots::{HEIGHT_M, HEXAROTOR, Watch, scenario_of};
use failures::sentence;
use rotortwin_bridge::autopilot::address::Protocol;
use rotortwin_bridge::autopilot::pilot::{Pilot, PilotAddress, Piloted};
use rotortwin_bridge::mavlink::catalogue::{AUTOPILOT_VERSION, COMMAND_ACK, HEARTBEAT, LOCAL_POSITION_NED, STATUSTEXT};
use rotortwin_bridge::mavlink::frame::{Decoder, Frame, encode};
use rotortwin_bridge::mavlink::steering::{
    Acknowledgement, AutopilotVersion, Battery, Command, Heartbeat, LocalPosition, PositionTarget, StatusText,
};
use rotortwin_flight::autopilot::{AutopilotOutcome, HandOver, fly};
use rotortwin_flight::lockstep::{FlightEnd, FlightObserver, StopReason};
use rotortwin_flight::sample::Sample;
use rotortwin_flight::setup::run_setup;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::control::Controller;
use rotortwin_flight_core::frames::{EulerAngles, Vec3};
use rotortwin_flight_core::signals::{NavState, Reference};
use rotortwin_plant::sensing::instruments::InstrumentModel;
use rotortwin_scenario::Scenario;
use rotortwin_wire::autopilot::{Autopilot, AutopilotError, Identity, Readings, Wanted};
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::time::Duration;

/// Its origin differs from ours.
const ORIGIN: [f64; 3] = [12.5, -7.25, 3.5];
/// It rejects arming until then, s.
const READY_S: f64 = 9.0;

/// Deviation from a correct autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    None,
    /// Never arms.
    Refuses,
    /// Closes its connection this long after the first position target, s.
    Closes(f64),
    /// Disarms itself once after it armed, before it takes off.
    DisarmsOnce,
    /// Ignores the climb command.
    Stays,
}

enum Line {
    Listening(TcpListener),
    Tcp(TcpStream),
    Udp(UdpSocket, SocketAddr),
    Closed,
}

/// An autopilot with our PID inside, which obeys MAVLink.
struct Scripted {
    protocol: Protocol,
    line: Line,
    decoder: Decoder,
    controller: Controller,
    fault: Fault,
    time_s: f64,
    beat_s: f64,
    positions: bool,
    armed: bool,
    mode: u32,
    /// Height of its reference above its origin, and its climb target.
    height: f64,
    climb_to: f64,
    target: Option<PositionTarget>,
    targets: u64,
    first_target_s: Option<f64>,
    on_ground_s: f64,
    /// Last battery message received, and their number.
    battery: Option<Battery>,
    batteries: u64,
}

const GUIDED: u32 = 4;
const LAND: u32 = 9;
const fn px4(main: u32, sub: u32) -> u32 {
    main << 16 | sub << 24
}

impl Scripted {
    fn new(scenario: &Scenario, protocol: Protocol, line: Line, fault: Fault) -> Self {
        Self {
            protocol,
            line,
            decoder: Decoder::default(),
            controller: Controller::new(scenario.controller_config()).unwrap(),
            fault,
            time_s: 0.0,
            beat_s: -1.0,
            positions: false,
            armed: false,
            mode: 0,
            height: 0.0,
            climb_to: 0.0,
            target: None,
            targets: 0,
            first_target_s: None,
            on_ground_s: 0.0,
            battery: None,
            batteries: 0,
        }
    }

    fn send(&mut self, message: u32, payload: &[u8]) {
        let bytes = encode(0, 1, 1, message, payload);
        match &mut self.line {
            Line::Tcp(stream) => stream.write_all(&bytes).unwrap(),
            Line::Udp(socket, to) => drop(socket.send_to(&bytes, *to).unwrap()),
            Line::Listening(_) | Line::Closed => {}
        }
    }

    fn answer(&mut self, command: u16, result: u8) {
        self.send(COMMAND_ACK, &Acknowledgement { command, result }.encode());
    }

    fn receive(&mut self) {
        let mut buffer = [0; 4096];
        match &mut self.line {
            Line::Listening(listener) => {
                if let Ok((stream, _)) = listener.accept() {
                    stream.set_nonblocking(true).unwrap();
                    self.line = Line::Tcp(stream);
                }
            }
            Line::Tcp(stream) => {
                while let Ok(length) = stream.read(&mut buffer) {
                    if length == 0 {
                        self.line = Line::Closed;
                        break;
                    }
                    self.decoder.push(&buffer[..length]);
                }
            }
            Line::Udp(socket, _) => {
                while let Ok(length) = socket.recv(&mut buffer) {
                    self.decoder.push(&buffer[..length]);
                }
            }
            Line::Closed => {}
        }
        while let Some(frame) = self.decoder.next_frame() {
            self.obey(&frame);
        }
    }

    fn obey(&mut self, frame: &Frame) {
        if let Some(battery) = Battery::read(frame) {
            // PX4 only accepts the battery of its own vehicle, from a component other than itself.
            assert_eq!([frame.system, frame.component], [1, 180]);
            self.battery = Some(battery);
            self.batteries += 1;
            return;
        }
        if let Some(target) = PositionTarget::read(frame) {
            self.target = Some(target);
            self.targets += 1;
            self.first_target_s.get_or_insert(self.time_s);
            return;
        }
        let Some(command) = Command::read(frame) else {
            return;
        };
        assert_eq!(command.target, [1, 1]);
        match command.command {
            Command::MESSAGE_INTERVAL => {
                assert_eq!(command.params[0], LOCAL_POSITION_NED as f32);
                self.positions = true;
            }
            Command::REQUEST_MESSAGE => {
                assert_eq!(command.params[0], AUTOPILOT_VERSION as f32);
                let version = match self.protocol {
                    // As reported by a PX4 built from 6a1c5329838729823ba03a28d550a9437018b6d7.
                    Protocol::Px4 => AutopilotVersion {
                        version: [1, 18, 0, 0],
                        commit: [0, 0, 0, 0x83, 0x29, 0x53, 0x1c, 0x6a],
                    },
                    _ => AutopilotVersion {
                        version: [4, 7, 0, 0],
                        commit: *b"0a1b2c3d",
                    },
                };
                self.send(AUTOPILOT_VERSION, &version.encode());
            }
            Command::SET_MODE => {
                let [one, main, sub] = [0, 1, 2].map(|i| command.params[i] as u32);
                assert_eq!(one, 1);
                self.mode = match self.protocol {
                    Protocol::ArduPilot => main,
                    Protocol::Px4 | Protocol::Betaflight => px4(main, sub),
                };
                if self.mode == px4(4, 2) && self.protocol == Protocol::Px4 {
                    self.climb_to = 2.5;
                }
                self.answer(command.command, 0);
            }
            Command::ARM if self.time_s < READY_S || self.fault == Fault::Refuses => {
                let text = StatusText {
                    severity: 2,
                    text: "Arm: Gyros inconsistent".to_owned(),
                };
                self.send(STATUSTEXT, &text.encode());
                self.answer(command.command, 4);
            }
            Command::ARM => {
                assert_eq!(command.params[0], 1.0);
                self.armed = true;
                self.answer(command.command, 0);
            }
            Command::TAKE_OFF if self.fault == Fault::DisarmsOnce => {
                self.fault = Fault::None;
                self.armed = false;
            }
            Command::TAKE_OFF if self.fault == Fault::Stays => self.answer(command.command, 4),
            Command::TAKE_OFF => {
                assert!(self.armed && self.mode == GUIDED);
                self.climb_to = f64::from(command.params[6]);
                self.answer(command.command, 0);
            }
            other => panic!("command {other}"),
        }
    }

    fn tell(&mut self, readings: &Readings) {
        if self.time_s - self.beat_s < 0.1 {
            return;
        }
        self.beat_s = self.time_s;
        let heartbeat = Heartbeat {
            custom_mode: self.mode,
            vehicle: 13,
            autopilot: if self.protocol == Protocol::Px4 { 12 } else { 3 },
            base_mode: if self.armed { 0x81 } else { 1 },
            system_status: 4,
        };
        self.send(HEARTBEAT, &heartbeat.encode());
        if self.positions {
            let local = LocalPosition {
                time_boot_ms: (1e3 * self.time_s) as u32,
                position: [0, 1, 2].map(|i| (readings.position_ned_m[i] + ORIGIN[i]) as f32),
                velocity: readings.velocity_ned_m_s.map(|v| v as f32),
            };
            self.send(LOCAL_POSITION_NED, &local.encode());
        }
    }

    /// Reference of its own controller; `None`: motors off.
    fn reference(&mut self, readings: &Readings) -> Option<Reference> {
        let follows = match self.protocol {
            Protocol::ArduPilot => self.mode == GUIDED && self.targets > 0,
            Protocol::Px4 | Protocol::Betaflight => self.mode == px4(6, 0),
        };
        let lands = self.mode == LAND || self.mode == px4(4, 6);
        let position = readings.position_ned_m;
        let mut wanted = [0.0, 0.0, -self.height];
        let (mut velocity, mut yaw) = ([0.0; 3], 0.0);
        if lands {
            self.height -= 0.5 * 0.0025;
            wanted = [position[0], position[1], -self.height];
            velocity[2] = 0.5;
            // Standing on its feet, the vehicle's origin is 0.179 m above the ground.
            self.on_ground_s = if position[2] > -0.19 {
                self.on_ground_s + 0.0025
            } else {
                0.0
            };
            if self.on_ground_s > 1.0 {
                self.armed = false;
            }
        } else if follows {
            let target = self.target.unwrap();
            wanted = [0, 1, 2].map(|i| f64::from(target.position[i]) - ORIGIN[i]);
            velocity = target.velocity.map(f64::from);
            yaw = target.yaw;
            self.height = -wanted[2];
        } else if self.climb_to > self.height {
            self.height = (self.height + 0.0025).min(self.climb_to);
        }
        let single = |v: [f64; 3]| Vec3::from_array(v.map(|x| x as f32));
        (self.armed && self.height != 0.0).then(|| Reference {
            position_ned: single(wanted),
            velocity_ned: single(velocity),
            yaw,
        })
    }
}

impl Autopilot for Scripted {
    fn interval_parts(&self) -> u32 {
        5
    }

    fn exchange(&mut self, readings: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
        self.time_s = readings.time_ns as f64 * 1e-9;
        self.receive();
        self.tell(readings);
        if let (Fault::Closes(after_s), Some(first_s)) = (self.fault, self.first_target_s)
            && self.time_s > first_s + after_s
        {
            self.line = Line::Closed;
        }
        let Some(reference) = self.reference(readings) else {
            return Ok([0.0; MAX_ROTORS]);
        };
        let single = |v: [f64; 3]| Vec3::from_array(v.map(|x| x as f32));
        let rates = Vec3::from_array(readings.body_rates_rad_s.map(|x| x as f32));
        let [roll, pitch, yaw] = readings.attitude_rad.map(|x| x as f32);
        let nav = NavState {
            position_ned: single(readings.position_ned_m),
            velocity_ned: single(readings.velocity_ned_m_s),
            attitude: EulerAngles { roll, pitch, yaw },
            body_rates: rates,
        };
        Ok(self.controller.step(&nav, &reference, 15.5).command.duty.map(f64::from))
    }

    fn identity(&self) -> Identity {
        Identity::default()
    }
}

/// Records messages.
#[derive(Default)]
struct Listener {
    watch: Watch,
    words: Vec<String>,
}

impl FlightObserver for Listener {
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        self.watch.sample(sample)
    }

    fn stop_requested(&mut self) -> Option<StopReason> {
        None
    }

    fn words(&mut self, _: f64, text: String) {
        self.words.push(text);
    }
}

/// Records the duties, or plays them back.
struct Recording<A> {
    autopilot: A,
    duties: Vec<[f64; MAX_ROTORS]>,
}

impl<A: Autopilot> Autopilot for Recording<A> {
    fn interval_parts(&self) -> u32 {
        5
    }
    fn exchange(&mut self, readings: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
        let duty = self.autopilot.exchange(readings)?;
        self.duties.push(duty);
        Ok(duty)
    }
    fn identity(&self) -> Identity {
        self.autopilot.identity()
    }
    fn steer(&mut self, wanted: &Wanted) {
        self.autopilot.steer(wanted);
    }
    fn words(&mut self) -> Option<String> {
        self.autopilot.words()
    }
    fn flight_ends(&mut self) -> bool {
        self.autopilot.flight_ends()
    }
    fn landed(&self) -> bool {
        self.autopilot.landed()
    }
}

struct Replay(std::vec::IntoIter<[f64; MAX_ROTORS]>);

impl Autopilot for Replay {
    fn interval_parts(&self) -> u32 {
        5
    }
    fn exchange(&mut self, _: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
        Ok(self.0.next().unwrap())
    }
    fn identity(&self) -> Identity {
        Identity::default()
    }
}

struct Flown {
    outcome: AutopilotOutcome,
    listener: Listener,
    duties: Vec<[f64; MAX_ROTORS]>,
    version: Option<String>,
    targets: u64,
    battery: Option<Battery>,
    batteries: u64,
}

fn fly_it(scenario: &Scenario, autopilot: &mut impl Autopilot, listener: &mut Listener) -> AutopilotOutcome {
    let mut simulation = scenario.simulation(1).unwrap();
    let setup = run_setup(scenario, &simulation, 1);
    let model = InstrumentModel::default();
    fly(
        &mut simulation,
        autopilot,
        &setup,
        (&model, 1),
        HandOver::default(),
        listener,
    )
}

fn piloted(protocol: Protocol, fault: Fault) -> Flown {
    let scenario = scenario_of(HEXAROTOR, 6.0, "");
    let meet = Duration::from_secs(20);
    let (pilot, line) = match protocol {
        Protocol::ArduPilot => {
            let listener = TcpListener::bind("127.0.0.1:0").unwrap();
            listener.set_nonblocking(true).unwrap();
            let at = PilotAddress::Tcp(listener.local_addr().unwrap());
            (Pilot::new(protocol, at, meet).unwrap(), Line::Listening(listener))
        }
        Protocol::Px4 | Protocol::Betaflight => {
            let pilot = Pilot::new(protocol, "udp:127.0.0.1:0".parse().unwrap(), meet).unwrap();
            let PilotAddress::Udp(to) = pilot.address() else {
                panic!("it is a UDP line");
            };
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            socket.set_nonblocking(true).unwrap();
            (pilot, Line::Udp(socket, to))
        }
    };
    let scripted = Scripted::new(&scenario, protocol, line, fault);
    let mut autopilot = Recording {
        autopilot: Piloted::new(scripted, Some(pilot)),
        duties: Vec::new(),
    };
    let mut listener = Listener::default();
    let outcome = fly_it(&scenario, &mut autopilot, &mut listener);
    Flown {
        outcome,
        listener,
        version: autopilot.identity().version,
        targets: autopilot.autopilot.autopilot().targets,
        battery: autopilot.autopilot.autopilot().battery,
        batteries: autopilot.autopilot.autopilot().batteries,
        duties: autopilot.duties,
    }
}

fn flies(protocol: Protocol, version: &str, mode: &str) -> Flown {
    let flown = piloted(protocol, Fault::None);
    let said = &flown.listener.words;
    assert_eq!(flown.outcome.flight.end, FlightEnd::Done, "{said:?}");
    assert_eq!(flown.outcome.flight.steps, 2400);
    let farthest = flown.listener.watch.farthest_m;
    assert!(farthest < 0.3, "{farthest} m away from {HEIGHT_M} m");
    assert!(flown.outcome.prelude_s > READY_S, "{} s", flown.outcome.prelude_s);
    let landing_s = flown.outcome.landing_s.expect("it has landed");
    assert!((2.0..30.0).contains(&landing_s), "{landing_s} s");
    // Rejected, with its message shown once, then armed, followed, landed.
    assert_eq!(
        said.iter()
            .filter(|text| *text == "\"Arm: Gyros inconsistent\"")
            .count(),
        1,
        "{said:?}"
    );
    for text in [
        "\"arming: FAILED\"",
        "armed",
        &format!("follows the scenario in {mode}"),
    ] {
        assert!(said.iter().any(|said| said == text), "{text}: {said:?}");
    }
    assert!(said.last().unwrap().starts_with("landed, motors off, "), "{said:?}");
    assert_eq!(flown.version.as_deref(), Some(version));
    // 50 per second of simulated time, from the climb on.
    assert!(flown.targets >= 6 * 50, "{}", flown.targets);
    // The pilot's effect is in the duties: they alone reproduce the run.
    let scenario = scenario_of(HEXAROTOR, 6.0, "");
    let again = fly_it(
        &scenario,
        &mut Replay(flown.duties.clone().into_iter()),
        &mut Listener::default(),
    );
    assert_eq!(again.flight.run_hash, flown.outcome.flight.run_hash);
    assert_eq!(again.landing_s, None);
    flown
}

#[test]
fn scenario_ardupilot_is_armed_flown_and_landed() {
    let flown = flies(Protocol::ArduPilot, "ArduPilot 4.7.0 dev (0a1b2c3d)", "GUIDED");
    // It has its battery from its own link.
    assert_eq!(flown.batteries, 0);
}

#[test]
fn scenario_px4_is_armed_flown_and_landed() {
    let flown = flies(Protocol::Px4, "PX4 1.18.0 dev (6a1c532983)", "OFFBOARD");
    // The plant's battery under load, ten times per second throughout the flight: PX4's simulator link carries none of it.
    let battery = flown.battery.expect("it was told of its battery");
    assert!(
        (14.0..16.6).contains(&battery.voltage_v) && battery.current_a >= 0.0,
        "{battery:?}"
    );
    assert!(flown.batteries >= 150, "{}", flown.batteries);
}

#[test]
fn scenario_one_that_disarms_itself_is_armed_again() {
    let flown = piloted(Protocol::ArduPilot, Fault::DisarmsOnce);
    assert_eq!(flown.outcome.flight.end, FlightEnd::Done);
    let said = &flown.listener.words;
    assert!(
        said.iter().any(|text| text == "disarmed itself before it had climbed"),
        "{said:?}"
    );
    assert_eq!(said.iter().filter(|text| *text == "armed").count(), 2, "{said:?}");
}

#[test]
fn scenario_failures_are_told_in_its_words() {
    let said = |fault| sentence(&piloted(Protocol::ArduPilot, fault).outcome).to_owned();
    assert_eq!(
        said(Fault::Refuses),
        "ArduPilot did not arm within 240 s of simulated time; it said \"Arm: Gyros inconsistent\", \"arming: FAILED\""
    );
    assert_eq!(
        said(Fault::Stays),
        "ArduPilot has armed and climbed 0.0 m of 1.3 m within 60 s of simulated time; it said \"taking off: FAILED\""
    );
    assert_eq!(
        said(Fault::Closes(4.0)),
        "ArduPilot closed the pilot's connection in flight"
    );
}

#[test]
fn scenario_nobody_is_there() {
    let scenario = scenario_of(HEXAROTOR, 6.0, "");
    let probe = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = probe.local_addr().unwrap();
    drop(probe);
    let pilot = Pilot::new(Protocol::ArduPilot, PilotAddress::Tcp(at), Duration::from_millis(300)).unwrap();
    let scripted = Scripted::new(&scenario, Protocol::ArduPilot, Line::Closed, Fault::None);
    let mut autopilot = Piloted::new(scripted, Some(pilot));
    let outcome = fly_it(&scenario, &mut autopilot, &mut Listener::default());
    assert_eq!(
        sentence(&outcome),
        format!(
            "the pilot waited 0 s for a heartbeat of ArduPilot at tcp:{at}: nothing is there; --pilot names another address, and --pilot none leaves \
             the flying to another pilot"
        )
    );
}
