//! A pilot for an autopilot that is commanded over MAVLink: arms, climbs, follows the reference of the scenario, lands.
//!
//! ```text
//!  meet ─▶ arm ─▶ climb ─▶ follow ───────────────▶ land
//!           ▲       │        SET_POSITION_TARGET_LOCAL_NED at 50 Hz
//!           └───────┘ disarmed by itself
//! ```
//! It is called after each exchange with the autopilot ([`Piloted`]), uses simulated time, and never waits: a slow pilot costs nothing, and
//! the autopilot's response to its commands is in the recorded pulses, so that a replay needs no pilot.
//!
//! An autopilot measures positions from its own origin, usually that of its first fix. The pilot determines the offset between that
//! position and the true one while the vehicle stands on the ground; any later drift of the estimator is the autopilot's.
//!
//! Rejections are retried, and reported with the autopilot's messages.

mod dialect;
mod line;

pub use dialect::default_address;
pub use line::PilotAddress;

use super::address::Protocol;
use crate::mavlink::catalogue::{
    AUTOPILOT_VERSION, BATTERY_STATUS, COMMAND_LONG, HEARTBEAT, LOCAL_POSITION_NED, SET_POSITION_TARGET_LOCAL_NED,
};
use crate::mavlink::frame::{Decoder, Frame, encode};
use crate::mavlink::steering::{
    Acknowledgement, AutopilotVersion, Battery, Command, Heartbeat, LocalPosition, PositionTarget, StatusText,
};
use dialect::{Dialect, Mode};
use line::Line;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_wire::autopilot::{Autopilot, AutopilotError, Identity, Readings, Wanted};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Ground stations are system 255.
const OUR_SYSTEM: u8 = 255;
const OUR_COMPONENT: u8 = 190;
/// Default wall-clock time from its first exchange until it must respond on the pilot's line.
pub const MEET: Duration = Duration::from_secs(30);
/// Simulated boot time, s, before a mode may be set; an earlier one is overridden by the first reading of its mode switch.
const BOOT_S: f64 = 3.5;
/// Simulated time limits, s: for arming; for climbing.
const ARM_S: f64 = 240.0;
const CLIMB_S: f64 = 60.0;
/// Simulated time limit, s, without a heartbeat.
const SILENT_S: f64 = 20.0;
/// Simulated time, s, between attempts, heartbeats, and position targets.
const RETRY_S: f64 = 2.0;
const HEARTBEAT_S: f64 = 1.0;
const TARGET_S: f64 = 0.02;
/// Simulated time, s, between battery messages, to an autopilot that takes them from the pilot's line.
const BATTERY_S: f64 = 0.1;
/// Position targets are sent for this long before the mode that needs them is set.
const FIRST_TARGETS_S: f64 = 1.0;
/// Requested interval of its position estimates, µs.
const POSITION_INTERVAL_US: f32 = 100_000.0;
/// Number of its own position estimates on the ground to average.
const POSITIONS: usize = 20;
/// Height above which it counts as airborne, m, and speed at which a climb is over, m/s.
const CLIMBED_M: f64 = 0.8;
const CLIMBED_M_S: f64 = 0.2;
/// Minimum commanded climb height, m.
const LOWEST_M: f64 = 1.0;
/// Minimum interval before the same text is shown again, s of simulated time.
const REPEATED_S: f64 = 30.0;
/// Maximum number of stored texts.
const MOST_WORDS: usize = 100;

/// An autopilot with a pilot; without one it is commanded externally.
#[derive(Debug)]
pub struct Piloted<A> {
    autopilot: A,
    pilot: Option<Pilot>,
}

impl<A: Autopilot> Piloted<A> {
    /// Attaches a pilot to an autopilot.
    pub fn new(autopilot: A, pilot: Option<Pilot>) -> Self {
        Self { autopilot, pilot }
    }

    /// The autopilot.
    pub fn autopilot(&self) -> &A {
        &self.autopilot
    }
}

impl<A: Autopilot> Autopilot for Piloted<A> {
    fn interval_parts(&self) -> u32 {
        self.autopilot.interval_parts()
    }

    fn exchange(&mut self, readings: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
        let duty = self.autopilot.exchange(readings);
        let Some(pilot) = &mut self.pilot else {
            return duty;
        };
        match duty {
            Ok(duty) => pilot.step(readings).map(|()| duty),
            Err(error) if error.lost => Err(AutopilotError {
                sentence: format!("{}{}", error.sentence, pilot.unconnected()),
                ..error
            }),
            Err(error) => Err(error),
        }
    }

    fn identity(&self) -> Identity {
        let version = self.pilot.as_ref().and_then(|pilot| {
            pilot
                .version
                .map(|version| format!("{} {}", pilot.dialect.name, version.text()))
        });
        Identity {
            version,
            ..self.autopilot.identity()
        }
    }

    fn steer(&mut self, wanted: &Wanted) {
        if let Some(pilot) = &mut self.pilot {
            pilot.wanted = *wanted;
        }
        self.autopilot.steer(wanted);
    }

    fn words(&mut self) -> Option<String> {
        let ours = self.pilot.as_mut().and_then(|pilot| pilot.words.pop_front());
        ours.or_else(|| self.autopilot.words())
    }

    fn flight_begins(&mut self) {
        self.autopilot.flight_begins();
    }

    fn flight_ends(&mut self) -> bool {
        match &mut self.pilot {
            Some(pilot) => {
                pilot.enter(Stage::Land);
                true
            }
            None => self.autopilot.flight_ends(),
        }
    }

    fn landed(&self) -> bool {
        match &self.pilot {
            Some(pilot) => pilot.stage == Stage::Land && !pilot.heartbeat.armed(),
            None => self.autopilot.landed(),
        }
    }

    fn finish(&mut self) {
        self.autopilot.finish();
    }
}

/// Stage of a pilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Meet,
    Arm,
    Climb,
    Follow,
    Land,
}

/// See the module documentation.
#[derive(Debug)]
pub struct Pilot {
    line: Line,
    /// Wall clock.
    meet: Duration,
    decoder: Decoder,
    dialect: Dialect,
    sequence: u8,
    stage: Stage,
    wanted: Wanted,
    /// Plant time, s; start of the stage; when each message was last sent.
    now_s: f64,
    since_s: f64,
    tried_s: f64,
    heartbeat_s: f64,
    battery_s: f64,
    target_s: f64,
    /// Wall clock of the first step.
    begun: Option<Instant>,
    /// System and component of the autopilot.
    peer: [u8; 2],
    /// Its latest heartbeat, with its arrival time; arrival time of the first.
    heartbeat: Heartbeat,
    heard_s: f64,
    met_s: f64,
    /// The command to climb was accepted.
    climbing: bool,
    version: Option<AutopilotVersion>,
    /// Its own position minus the true one, on the ground.
    offsets: VecDeque<[f64; 3]>,
    /// True position and speed, and height of the ground below it, m, NED.
    position: [f64; 3],
    speed: f64,
    ground: f64,
    /// Recent messages with their times; the rejections among them are kept for the error message.
    heard: VecDeque<(f64, String)>,
    words: VecDeque<String>,
}

impl Pilot {
    /// Opens the line to an autopilot, which must respond there within `meet` of wall clock from its first exchange on.
    ///
    /// # Errors
    /// The port is in use, or not permitted, or the autopilot does not support such commands.
    pub fn new(protocol: Protocol, address: PilotAddress, meet: Duration) -> Result<Self, String> {
        let dialect =
            Dialect::of(protocol).ok_or_else(|| format!("{} takes no commands over MAVLink", protocol.name()))?;
        Ok(Self {
            line: Line::open(address)?,
            meet,
            decoder: Decoder::default(),
            dialect,
            sequence: 0,
            stage: Stage::Meet,
            wanted: Wanted::default(),
            now_s: 0.0,
            since_s: 0.0,
            tried_s: f64::NEG_INFINITY,
            heartbeat_s: f64::NEG_INFINITY,
            battery_s: f64::NEG_INFINITY,
            target_s: f64::NEG_INFINITY,
            begun: None,
            peer: [1, 1],
            heartbeat: Heartbeat::default(),
            heard_s: 0.0,
            met_s: 0.0,
            climbing: false,
            version: None,
            offsets: VecDeque::new(),
            position: [0.0; 3],
            speed: 0.0,
            ground: 0.0,
            heard: VecDeque::new(),
            words: VecDeque::new(),
        })
    }

    /// Address of the line to the autopilot.
    pub fn address(&self) -> PilotAddress {
        self.line.address()
    }

    fn unconnected(&self) -> String {
        if self.line.connected() {
            return String::new();
        }
        format!("; the pilot found no autopilot at {} (--pilot)", self.address())
    }

    fn step(&mut self, readings: &Readings) -> Result<(), AutopilotError> {
        self.now_s = readings.time_ns as f64 * 1e-9;
        self.position = readings.position_ned_m;
        let v = readings.velocity_ned_m_s;
        self.speed = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        self.listen()?;
        if self.now_s - self.heartbeat_s >= HEARTBEAT_S {
            self.heartbeat_s = self.now_s;
            self.send(HEARTBEAT, &Heartbeat::of_ground_station().encode());
        }
        self.tell_battery(readings);
        match self.stage {
            Stage::Meet => self.meet(),
            Stage::Arm => self.arm(),
            Stage::Climb => self.climb(),
            Stage::Follow => self.follow(),
            Stage::Land => self.land(),
        }
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        self.since_s = self.now_s;
        self.tried_s = f64::NEG_INFINITY;
        self.climbing = false;
    }

    fn in_stage_s(&self) -> f64 {
        self.now_s - self.since_s
    }

    /// True once per [`RETRY_S`].
    fn try_now(&mut self) -> bool {
        let due = self.now_s - self.tried_s >= RETRY_S;
        if due {
            self.tried_s = self.now_s;
        }
        due
    }

    fn meet(&mut self) -> Result<(), AutopilotError> {
        let begun = *self.begun.get_or_insert_with(Instant::now);
        if begun.elapsed() < self.meet {
            return Ok(());
        }
        let what = if self.line.connected() {
            "something is connected there, but sends no heartbeat"
        } else {
            "nothing is there"
        };
        let sentence = format!(
            "the pilot waited {:.0} s for a heartbeat of {} at {}: {what}; --pilot names another address, and --pilot none leaves the flying to another pilot",
            self.meet.as_secs_f64(),
            self.dialect.name,
            self.address()
        );
        Err(AutopilotError::lost(sentence, begun.elapsed()))
    }

    fn arm(&mut self) -> Result<(), AutopilotError> {
        if self.heartbeat.armed() {
            self.say("armed".to_owned());
            self.enter(Stage::Climb);
            return Ok(());
        }
        self.ground = self.position[2];
        if self.in_stage_s() > ARM_S {
            let refusals = self.refusals();
            let sentence = format!(
                "{} did not arm within {ARM_S} s of simulated time{refusals}",
                self.dialect.name
            );
            return Err(AutopilotError::wrong(sentence));
        }
        if self.now_s - self.met_s < BOOT_S || !self.try_now() {
            return Ok(());
        }
        if self.offsets.is_empty() {
            self.command(
                Command::MESSAGE_INTERVAL,
                [LOCAL_POSITION_NED as f32, POSITION_INTERVAL_US],
            );
        }
        if self.version.is_none() {
            self.command(Command::REQUEST_MESSAGE, [AUTOPILOT_VERSION as f32, 0.0]);
        }
        match self.dialect.before_arming {
            Some(mode) if self.heartbeat.custom_mode != mode.custom_mode => self.set_mode(mode),
            // Without an origin, positions are meaningless.
            _ if self.offsets.len() < POSITIONS => {}
            _ => self.command(Command::ARM, [1.0, 0.0]),
        }
        Ok(())
    }

    fn climb(&mut self) -> Result<(), AutopilotError> {
        if !self.heartbeat.armed() {
            self.say("disarmed itself before it had climbed".to_owned());
            self.enter(Stage::Arm);
            return Ok(());
        }
        let height = self.ground - self.position[2];
        let wanted = (self.ground - self.wanted.position_ned_m[2]).max(LOWEST_M);
        if height > CLIMBED_M.min(0.8 * wanted) && self.speed < CLIMBED_M_S && self.in_stage_s() > 1.0 {
            self.enter(Stage::Follow);
            return Ok(());
        }
        if self.in_stage_s() > CLIMB_S {
            let sentence = format!(
                "{} has armed and climbed {height:.1} m of {wanted:.1} m within {CLIMB_S} s of simulated time{}",
                self.dialect.name,
                self.refusals()
            );
            return Err(AutopilotError::wrong(sentence));
        }
        if self.climbing || !self.try_now() {
            return Ok(());
        }
        match self.dialect.climb {
            Some(mode) if self.heartbeat.custom_mode != mode.custom_mode => self.set_mode(mode),
            Some(_) => {}
            None => {
                let mut command = self.blank(Command::TAKE_OFF);
                command.params[6] = wanted as f32;
                self.send(COMMAND_LONG, &command.encode());
            }
        }
        Ok(())
    }

    fn follow(&mut self) -> Result<(), AutopilotError> {
        if self.now_s - self.heard_s > SILENT_S {
            let sentence = format!(
                "the pilot received no heartbeat of {} at {} for {SILENT_S} s of simulated time",
                self.dialect.name,
                self.address()
            );
            return Err(AutopilotError::lost(sentence, Duration::from_secs_f64(SILENT_S)));
        }
        if self.now_s - self.target_s >= TARGET_S {
            self.target_s = self.now_s;
            self.send_target();
        }
        // In flight the autopilot may leave the mode for its own reasons, which is a result.
        if !self.climbing && self.in_stage_s() > FIRST_TARGETS_S {
            if self.heartbeat.custom_mode == self.dialect.follow.custom_mode {
                self.climbing = true;
                self.say(format!("follows the scenario in {}", self.dialect.follow.name));
            } else if self.try_now() {
                self.set_mode(self.dialect.follow);
            }
        }
        Ok(())
    }

    fn land(&mut self) -> Result<(), AutopilotError> {
        if self.heartbeat.custom_mode != self.dialect.land.custom_mode && self.heartbeat.armed() && self.try_now() {
            self.set_mode(self.dialect.land);
        }
        Ok(())
    }

    /// Processes received messages.
    fn listen(&mut self) -> Result<(), AutopilotError> {
        let decoder = &mut self.decoder;
        if self.line.receive(|bytes| decoder.push(bytes)) {
            self.decoder = Decoder::default();
            if matches!(self.stage, Stage::Climb | Stage::Follow) {
                let sentence = format!("{} closed the pilot's connection in flight", self.dialect.name);
                return Err(AutopilotError::lost(sentence, Duration::ZERO));
            }
            self.enter(Stage::Meet);
            self.begun = None;
        }
        while let Some(frame) = self.decoder.next_frame() {
            self.hear(&frame);
        }
        Ok(())
    }

    fn hear(&mut self, frame: &Frame) {
        if let Some(heartbeat) = Heartbeat::read(frame) {
            // Cameras and other ground stations send heartbeats, too.
            if heartbeat.autopilot == self.dialect.autopilot && frame.component == 1 {
                self.beat(heartbeat, [frame.system, frame.component]);
            }
            return;
        }
        if frame.system != self.peer[0] {
            return;
        }
        if let Some(text) = StatusText::read(frame) {
            if text.severity <= StatusText::WARNING {
                self.heard(text.text);
            }
        } else if let Some(answer) = Acknowledgement::read(frame) {
            if answer.command == Command::TAKE_OFF && answer.result == 0 {
                self.climbing = true;
            }
            let what = match answer.command {
                Command::TAKE_OFF => "taking off",
                Command::SET_MODE => "the mode",
                Command::ARM => "arming",
                _ => return,
            };
            if !matches!(answer.result, 0 | 5) {
                self.heard(format!("{what}: {}", answer.word()));
            }
        } else if let Some(local) = LocalPosition::read(frame) {
            self.locate(&local);
        } else if let Some(version) = AutopilotVersion::read(frame)
            && self.version.is_none()
        {
            self.version = Some(version);
            self.say(format!("is {} {}", self.dialect.name, version.text()));
        }
    }

    fn beat(&mut self, heartbeat: Heartbeat, peer: [u8; 2]) {
        let before = self.heartbeat;
        (self.heartbeat, self.heard_s, self.peer) = (heartbeat, self.now_s, peer);
        match self.stage {
            Stage::Meet => {
                self.met_s = self.now_s;
                self.offsets.clear();
                self.enter(Stage::Arm);
            }
            Stage::Follow if self.climbing => {
                if before.armed() && !heartbeat.armed() {
                    self.say("disarmed in flight".to_owned());
                }
                if before.custom_mode != heartbeat.custom_mode {
                    self.say(format!(
                        "is now in mode {}; the pilot commands {}",
                        heartbeat.custom_mode, self.dialect.follow.name
                    ));
                }
            }
            _ => {}
        }
    }

    /// Determines its origin.
    fn locate(&mut self, local: &LocalPosition) {
        if self.stage != Stage::Arm || self.heartbeat.armed() {
            return;
        }
        let offset = [0, 1, 2].map(|i| f64::from(local.position[i]) - self.position[i]);
        if offset.iter().all(|x| x.is_finite()) {
            self.offsets.push_back(offset);
        }
        if self.offsets.len() > POSITIONS {
            self.offsets.pop_front();
        }
    }

    fn send_target(&mut self) {
        let count = self.offsets.len().max(1) as f64;
        let offset = [0, 1, 2].map(|i| self.offsets.iter().map(|offset| offset[i]).sum::<f64>() / count);
        let wanted = &self.wanted;
        let target = PositionTarget {
            time_boot_ms: (1e3 * self.now_s) as u32,
            position: [0, 1, 2].map(|i| (wanted.position_ned_m[i] + offset[i]) as f32),
            velocity: wanted.velocity_ned_m_s.map(|v| v as f32),
            yaw: wanted.yaw_rad as f32,
            target: self.peer,
        };
        self.send(SET_POSITION_TARGET_LOCAL_NED, &target.encode());
    }

    fn blank(&self, command: u16) -> Command {
        Command {
            params: [0.0; 7],
            command,
            target: self.peer,
        }
    }

    fn command(&mut self, command: u16, [first, second]: [f32; 2]) {
        let mut command = self.blank(command);
        (command.params[0], command.params[1]) = (first, second);
        self.send(COMMAND_LONG, &command.encode());
    }

    fn set_mode(&mut self, mode: Mode) {
        let mut command = self.blank(Command::SET_MODE);
        let [main, sub] = mode.params.map(f32::from);
        command.params[..3].copy_from_slice(&[1.0, main, sub]);
        self.send(COMMAND_LONG, &command.encode());
    }

    /// Sends voltage and current of the plant's battery: otherwise its own battery model would be in its log.
    fn tell_battery(&mut self, readings: &Readings) {
        let due = self.stage != Stage::Meet && self.now_s - self.battery_s >= BATTERY_S;
        if !self.dialect.takes_battery || !due || readings.battery_voltage_v <= 0.0 {
            return;
        }
        self.battery_s = self.now_s;
        let battery = Battery {
            voltage_v: readings.battery_voltage_v,
            current_a: readings.battery_current_a,
        };
        // It only accepts the battery of its own vehicle, so this one is a component of that.
        self.send_as([self.peer[0], Battery::COMPONENT], BATTERY_STATUS, &battery.encode());
    }

    fn send(&mut self, message: u32, payload: &[u8]) {
        self.send_as([OUR_SYSTEM, OUR_COMPONENT], message, payload);
    }

    fn send_as(&mut self, [system, component]: [u8; 2], message: u32, payload: &[u8]) {
        let bytes = encode(self.sequence, system, component, message, payload);
        self.sequence = self.sequence.wrapping_add(1);
        self.line.send(&bytes);
    }

    fn say(&mut self, text: String) {
        if self.words.len() < MOST_WORDS {
            self.words.push_back(text);
        }
    }

    /// Shows its message, unless it was just shown.
    fn heard(&mut self, text: String) {
        let now_s = self.now_s;
        self.heard.retain(|(time_s, _)| now_s - time_s < REPEATED_S);
        if text.is_empty() || self.heard.len() >= MOST_WORDS || self.heard.iter().any(|(_, known)| *known == text) {
            return;
        }
        self.say(format!("\"{text}\""));
        self.heard.push_back((now_s, text));
    }

    /// "; it said "PreArm: …", …", or that it sent nothing.
    fn refusals(&self) -> String {
        if self.heard.is_empty() {
            return "; it gave no reason".to_owned();
        }
        let texts: Vec<_> = self.heard.iter().map(|(_, text)| format!("\"{text}\"")).collect();
        format!("; it said {}", texts.join(", "))
    }
}
