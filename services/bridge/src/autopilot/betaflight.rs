//! Betaflight's simulator build: UDP, no lockstep, its clock follows ours through the wall clock.
//!
//! ```text
//!  state, 144 bytes, every 2 ms ──▶ port 9003
//!  sticks, 40 bytes, 100 Hz ──────▶ port 9004 (where the pilot flies)
//!  port 9001 ◀── motors, 68 bytes, at most one for each state
//! ```
//! Its clock is wall time × (step of our time stamps ÷ wall time between our last two packets). So packets are sent evenly spaced; a late one
//! delays those after it (a slip), because a burst would make its clock jump. So would two states that it reads at the same moment because its
//! own thread was late: a state is held back until the one before it is answered, for ten spacings at most. If no motors arrive in time the latest ones
//! stay in force, and of several the last counts. Two flights with the same seed therefore differ; the recorded commands repeat each of them.
//!
//! Betaflight's axes, from FRD: rates (p, q, −r), specific force (−ax, ay, az). Its compass is derived from the quaternion, which its Gazebo
//! bridge conjugates about the first axis ([`compass_quaternion`]).

use super::address::AutopilotAddress;
use super::sticks::{Sticks, Telling};
use super::{OutputMap, Patience, Wait};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_wire::autopilot::{Autopilot, AutopilotError, Identity, Readings, Wanted};
use std::collections::VecDeque;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// Four parts of 0.5 ms.
const INTERVAL_PARTS: u32 = 4;
const STEP_S: f64 = 0.002;
/// Every fifth packet is followed by sticks: 100 Hz.
const STATES_PER_STICKS: u64 = 5;
/// Lateness above which a state is counted as late, fraction of the spacing.
const LATE: f64 = 0.5;
/// Spacings for which a state is held back until the one before it is answered.
const HELD_BACK: u32 = 10;
/// Maximum datagrams processed before a state is sent; a flood never delays it.
const MOST_WAITING: u32 = 2000;
/// A motor of an armed vehicle turns above this, µs.
const ARMED_US: f32 = 1030.0;
/// Length of its motor packet, and its values.
const MOTORS_BYTES: usize = 68;
const MOTORS: usize = 16;
/// Range of a motor's pulse, µs; 0 before its mixer runs.
const PULSES_US: std::ops::RangeInclusive<f32> = 0.0..=2600.0;

/// Quality of the pacing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PaceReport {
    /// States sent.
    pub states: u64,
    /// States sent more than half a spacing late.
    pub late: u64,
    /// States without motors before the next one.
    pub unanswered: u64,
    /// Longest time between two states.
    pub longest: Duration,
}

/// The link to one Betaflight.
#[derive(Debug)]
pub struct Betaflight {
    socket: UdpSocket,
    states_to: SocketAddr,
    sticks_to: SocketAddr,
    map: OutputMap,
    patience: Patience,
    /// Wall clock between two states.
    spacing: Duration,
    /// When the next state is due, and when the last one was sent.
    due: Option<Instant>,
    sent: Option<Instant>,
    /// When motors were last received.
    heard: Option<Instant>,
    motors_us: [f32; MOTORS],
    /// Counter for the time stamps: keeps counting while the plant waits.
    states: u64,
    sticks: Option<Sticks>,
    wanted: Wanted,
    pace: PaceReport,
    /// Datagrams of a different length: their number, and the last length.
    foreign: (u64, usize),
    words: VecDeque<String>,
}

impl Betaflight {
    /// Opens the port for incoming motors. `piloted`: we control the sticks.
    ///
    /// # Errors
    /// The port is in use, or not permitted.
    pub fn listen(
        autopilot: &AutopilotAddress,
        piloted: bool,
        map: OutputMap,
        patience: Patience,
    ) -> Result<Self, String> {
        let address = autopilot.address;
        let port = |offset: i32| {
            u16::try_from(i32::from(address.port()) + offset)
                .ok()
                .filter(|port| *port > 0)
        };
        let (Some(motors), Some(sticks)) = (port(-2), port(1)) else {
            return Err(format!(
                "port {} leaves no adjacent ports for motors and sticks",
                address.port()
            ));
        };
        let at = SocketAddr::new(address.ip(), motors);
        let socket = UdpSocket::bind(at)
            .map_err(|error| format!("cannot open UDP {at} to receive the motors of Betaflight: {error}"))?;
        Ok(Self {
            socket,
            states_to: address,
            sticks_to: SocketAddr::new(address.ip(), sticks),
            map,
            patience,
            spacing: Duration::from_secs_f64(STEP_S / autopilot.speed),
            due: None,
            sent: None,
            heard: None,
            motors_us: [0.0; MOTORS],
            states: 0,
            sticks: piloted.then(Sticks::default),
            wanted: Wanted::default(),
            pace: PaceReport::default(),
            foreign: (0, 0),
            words: VecDeque::new(),
        })
    }

    /// Where states are sent to.
    pub fn states_to(&self) -> SocketAddr {
        self.states_to
    }

    /// Quality of the pacing so far.
    pub fn pace(&self) -> PaceReport {
        self.pace
    }

    fn name(&self) -> String {
        format!("Betaflight at {}", self.states_to)
    }

    fn broken(&self, error: &std::io::Error) -> AutopilotError {
        AutopilotError::wrong(format!("the socket to {} failed: {error}", self.name()))
    }

    /// Sends a state when it is due, and sticks with every fifth.
    fn send(&mut self, readings: &Readings) -> Result<(), AutopilotError> {
        let now = Instant::now();
        let due = self.due.unwrap_or(now);
        std::thread::sleep(due.saturating_duration_since(now));
        let now = Instant::now();
        let late = now.saturating_duration_since(due);
        if late > self.spacing.mul_f64(LATE) {
            self.pace.late += 1;
        }
        if let Some(sent) = self.sent {
            self.pace.longest = self.pace.longest.max(now - sent);
        }
        // Late: the schedule slips, so that the next one is a whole spacing away.
        self.due = Some(if late > self.spacing.mul_f64(LATE) { now } else { due } + self.spacing);
        self.sent = Some(now);
        let time_s = self.states as f64 * STEP_S;
        self.transmit(&state_packet(time_s, readings), self.states_to)?;
        if self.states.is_multiple_of(STATES_PER_STICKS) {
            let armed = self.motors_us[..self.map.rotor_of_channel.len().min(MOTORS)]
                .iter()
                .any(|pulse| *pulse > ARMED_US);
            if let Some(sticks) = &mut self.sticks {
                let telling = Telling {
                    dt_s: STEP_S * STATES_PER_STICKS as f64,
                    armed,
                    readings,
                    wanted: &self.wanted,
                };
                let channels = sticks.step(&telling).map_err(AutopilotError::wrong)?;
                self.words.extend(sticks.take_words());
                self.transmit(&sticks_packet(time_s, &channels), self.sticks_to)?;
            }
        }
        self.states += 1;
        self.pace.states += 1;
        Ok(())
    }

    fn transmit(&self, bytes: &[u8], to: SocketAddr) -> Result<(), AutopilotError> {
        match self.socket.send_to(bytes, to) {
            Ok(_) => Ok(()),
            // No receiver, according to the reply to an earlier packet.
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => Ok(()),
            Err(error) => Err(self.broken(&error)),
        }
    }

    /// Processes pending datagrams: motors that arrived late or twice never delay later ones.
    fn take_waiting(&mut self) -> Result<(), AutopilotError> {
        self.socket.set_nonblocking(true).map_err(|error| self.broken(&error))?;
        let mut buffer = [0; 256];
        let mut left = MOST_WAITING;
        while let (1.., Ok((length, _))) = (left, self.socket.recv_from(&mut buffer)) {
            self.take(&buffer[..length])?;
            left -= 1;
        }
        self.socket.set_nonblocking(false).map_err(|error| self.broken(&error))
    }

    /// Processes one datagram; true: motors.
    fn take(&mut self, bytes: &[u8]) -> Result<bool, AutopilotError> {
        let Some(motors_us) = decode_motors(bytes) else {
            self.foreign = (self.foreign.0 + 1, bytes.len());
            return Ok(false);
        };
        self.check(&motors_us)?;
        self.motors_us = motors_us;
        self.heard = Some(Instant::now());
        Ok(true)
    }

    /// Receives motors until `until`; true if any arrived.
    fn take_motors(&mut self, until: Instant) -> Result<bool, AutopilotError> {
        let mut buffer = [0; 256];
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(false);
            }
            self.socket
                .set_read_timeout(Some(left))
                .map_err(|error| self.broken(&error))?;
            match self.socket.recv_from(&mut buffer) {
                Ok((length, _)) => {
                    if self.take(&buffer[..length])? {
                        return Ok(true);
                    }
                }
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::WouldBlock
                            | ErrorKind::TimedOut
                            | ErrorKind::Interrupted
                            | ErrorKind::ConnectionRefused
                    ) => {}
                Err(error) => return Err(self.broken(&error)),
            }
        }
    }

    fn check(&self, motors_us: &[f32; MOTORS]) -> Result<(), AutopilotError> {
        let used = &motors_us[..self.map.rotor_of_channel.len().min(MOTORS)];
        let Some(channel) = used.iter().position(|pulse| !PULSES_US.contains(pulse)) else {
            return Ok(());
        };
        Err(AutopilotError::wrong(format!(
            "{}, after state {}: motor {} has a pulse of {} µs, expected 0 to 2600",
            self.name(),
            self.states,
            channel + 1,
            used[channel]
        )))
    }

    /// Sends the same state until motors arrive.
    fn join(&mut self, readings: &Readings) -> Result<(), AutopilotError> {
        let wait = Wait::new(self.patience.join);
        loop {
            if self.patience.stopped() {
                return Err(AutopilotError::stopped());
            }
            if wait.slice().is_none() {
                let at = self
                    .socket
                    .local_addr()
                    .map_or_else(|_| String::new(), |at| at.to_string());
                let sentence = format!(
                    "no motors of Betaflight came to UDP {at} within {} ms (--join-timeout) of states to {}{}",
                    wait.limit.as_millis(),
                    self.states_to,
                    self.other_datagrams()
                );
                return Err(AutopilotError::lost(sentence, wait.silence()));
            }
            self.send(readings)?;
            if self.take_motors(self.due.unwrap_or_else(Instant::now))? {
                self.pace = PaceReport::default();
                return Ok(());
            }
        }
    }

    fn other_datagrams(&self) -> String {
        match self.foreign {
            (0, _) => String::new(),
            (count, length) => {
                format!("; {count} datagrams of another size came, the last of {length} bytes, expected {MOTORS_BYTES}")
            }
        }
    }
}

impl Autopilot for Betaflight {
    fn interval_parts(&self) -> u32 {
        INTERVAL_PARTS
    }

    fn exchange(&mut self, readings: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
        if self.heard.is_none() {
            self.join(readings)?;
        }
        if self.patience.stopped() {
            return Err(AutopilotError::stopped());
        }
        self.take_waiting()?;
        self.send(readings)?;
        let due = self.due.unwrap_or_else(Instant::now);
        if !self.take_motors(due)? {
            self.pace.unanswered += 1;
            // Two states that lie in its socket are read at the same moment, and its clock runs a hundred times too fast until the next one.
            if self.take_motors(due + self.spacing * HELD_BACK)? {
                self.due = Some(Instant::now() + self.spacing);
            }
            let silence = self.heard.map_or(Duration::ZERO, |heard| heard.elapsed());
            if silence > self.patience.step {
                let sentence = format!(
                    "{} sent no motors after state {}: silent for {} ms, allowed are {} ms (--step-timeout){}",
                    self.name(),
                    self.states,
                    silence.as_millis(),
                    self.patience.step.as_millis(),
                    self.other_datagrams()
                );
                return Err(AutopilotError::lost(sentence, silence));
            }
        }
        let motors_us = self.motors_us;
        Ok(self.map.duties(|channel| {
            motors_us
                .get(channel)
                .map_or(0.0, |pulse| self.map.duty(f64::from(*pulse)))
        }))
    }

    fn identity(&self) -> Identity {
        Identity {
            peer: self.name(),
            version: None,
            lockstep: false,
        }
    }

    fn steer(&mut self, wanted: &Wanted) {
        self.wanted = *wanted;
    }

    fn words(&mut self) -> Option<String> {
        self.words.pop_front()
    }

    fn flight_begins(&mut self) {
        self.pace = PaceReport::default();
        if let Some(sticks) = &mut self.sticks {
            sticks.flight_begins();
        }
    }

    fn flight_ends(&mut self) -> bool {
        let PaceReport {
            states,
            late,
            unanswered,
            longest,
        } = self.pace;
        self.words.push_back(format!(
            "not lockstep: of {states} states in flight {late} were sent late and {unanswered} got no motors in time; longest gap {:.1} ms",
            1e3 * longest.as_secs_f64()
        ));
        match &mut self.sticks {
            Some(sticks) => {
                sticks.land();
                true
            }
            None => false,
        }
    }

    fn landed(&self) -> bool {
        self.sticks.as_ref().is_some_and(Sticks::landed)
    }
}

/// Decodes its motor packet, µs by channel; `None` if it is something else.
pub fn decode_motors(bytes: &[u8]) -> Option<[f32; MOTORS]> {
    let values = (bytes.len() == MOTORS_BYTES).then(|| &bytes[4..])?;
    Some(std::array::from_fn(|i| {
        f32::from_le_bytes([values[4 * i], values[4 * i + 1], values[4 * i + 2], values[4 * i + 3]])
    }))
}

/// Eighteen numbers: time, rates, specific force, quaternion, velocity (east, north, up), position (degrees, degrees, m up), pressure (Pa).
pub fn state_packet(time_s: f64, readings: &Readings) -> Vec<u8> {
    let [p, q, r] = readings.body_rates_rad_s;
    let [ax, ay, az] = readings.specific_force_m_s2;
    let [w, x, y, z] = compass_quaternion(readings.attitude_rad);
    let [north, east, down] = readings.velocity_ned_m_s;
    // Its virtual satellite receiver is not used: no degrees.
    let up_m = -readings.position_ned_m[2];
    let pressure_pa = 100.0 * readings.pressure_hpa;
    let numbers = [
        time_s,
        p,
        q,
        -r,
        -ax,
        ay,
        az,
        w,
        x,
        y,
        z,
        east,
        north,
        -down,
        0.0,
        0.0,
        up_m,
        pressure_pa,
    ];
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// Time and sixteen channels, µs: roll, pitch, throttle, yaw, AUX1, …
pub fn sticks_packet(time_s: f64, channels: &[u16; 16]) -> Vec<u8> {
    let mut bytes = time_s.to_le_bytes().to_vec();
    bytes.extend(channels.iter().flat_map(|channel| channel.to_le_bytes()));
    bytes
}

/// Quaternion w, x, y, z from which Betaflight derives its compass: of the attitude in east-north-up and forward-left-up, with the second and
/// third axis negated, as its Gazebo bridge sends it. `attitude_rad`: roll, pitch, yaw of FRD in NED.
pub fn compass_quaternion(attitude_rad: [f64; 3]) -> [f64; 4] {
    let [(sr, cr), (sp, cp), (sy, cy)] = attitude_rad.map(|angle| (0.5 * angle).sin_cos());
    // FRD in NED.
    let w = cr * cp * cy + sr * sp * sy;
    let x = sr * cp * cy - cr * sp * sy;
    let y = cr * sp * cy + sr * cp * sy;
    let z = cr * cp * sy - sr * sp * cy;
    // FLU in north-west-up is that, rotated by half a turn about x on both sides; east-north-up is a quarter turn back from there.
    let (y, z) = (-y, -z);
    let k = std::f64::consts::FRAC_1_SQRT_2;
    [k * (w + z), k * (x + y), -k * (y - x), -k * (z - w)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn val_packets_have_the_bytes_of_the_protocol() {
        let readings = Readings {
            body_rates_rad_s: [0.1, 0.2, 0.3],
            specific_force_m_s2: [0.5, 0.25, -9.81],
            velocity_ned_m_s: [1.0, 2.0, 3.0],
            position_ned_m: [4.0, 5.0, -6.0],
            pressure_hpa: 955.0,
            ..Readings::default()
        };
        let bytes = state_packet(1.5, &readings);
        assert_eq!(bytes.len(), 144);
        let number = |i: usize| f64::from_le_bytes(bytes[8 * i..8 * i + 8].try_into().unwrap());
        let got: Vec<f64> = (0..18).map(number).collect();
        assert_eq!(got[..7], [1.5, 0.1, 0.2, -0.3, -0.5, 0.25, -9.81]);
        assert_eq!(got[11..], [2.0, 1.0, -3.0, 0.0, 0.0, 6.0, 95_500.0]);
        let mut channels = [1500; 16];
        channels[4] = 2000;
        let sticks = sticks_packet(1.5, &channels);
        assert_eq!((sticks.len(), &sticks[16..18]), (40, &2000_u16.to_le_bytes()[..]));
    }

    #[test]
    fn val_the_compass_is_read_back_as_betaflight_reads_it() {
        // Its use of the quaternion: second and third axis negated, then a quarter turn; that is FLU in north-west-up.
        let read = |[w, x, y, z]: [f64; 4]| {
            let (y, z) = (-y, -z);
            let k = std::f64::consts::FRAC_1_SQRT_2;
            [k * (w - z), k * (x - y), k * (y + x), k * (z + w)]
        };
        // Level, nose to the north: zero. Nose to the east: a quarter turn to the right, which is −90° about up.
        let [w, x, y, z] = read(compass_quaternion([0.0, 0.0, 0.0]));
        assert!((w - 1.0).abs() < 1e-12 && x.abs() + y.abs() + z.abs() < 1e-12);
        let [w, _, _, z] = read(compass_quaternion([0.0, 0.0, std::f64::consts::FRAC_PI_2]));
        assert!((w - z.abs()).abs() < 1e-12 && w * z < 0.0);
        // Roll to the right stays so about the same x; nose up is reversed about the left axis.
        let [w, x, ..] = read(compass_quaternion([0.2, 0.0, 0.0]));
        assert!((x / w - 0.1_f64.tan()).abs() < 1e-12);
        let [w, _, y, _] = read(compass_quaternion([0.0, 0.2, 0.0]));
        assert!((y / w + 0.1_f64.tan()).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn prop_only_whole_packets_of_motors_are_read(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            prop_assert_eq!(decode_motors(&bytes).is_some(), bytes.len() == 68);
        }
    }
}
