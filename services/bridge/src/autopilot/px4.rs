//! PX4's simulator link: we listen on TCP, it connects; MAVLink 2, lockstep by the time stamps of our samples.
//!
//! ```text
//!  HIL_SENSOR t (250 Hz; HIL_GPS with each fix) ──▶ PX4 ──▶ HIL_ACTUATOR_CONTROLS t
//! ```
//! PX4's clock is the time of our samples. Each sample has exactly one answer, with the same time; the first arrives some 70 ms after the
//! first sample. Until then nothing is awaited, and samples are sent at wall-clock pace. Answers to earlier samples are dropped.
//!
//! A connection that ends before the flight may be replaced by another; in flight it ends the run. A second one beside it waits, unread,
//! until then.
//!
//! MAVLink 2 omits zeros at the end of a payload, so a message that was cut short reads like one that says "disarmed". PX4 always sets a bit
//! of the mode, the last byte: an answer without it is refused, unless nothing contradicts it.

use super::{OutputMap, Patience, Wait};
use crate::mavlink::frame::{Decoder, encode};
use crate::mavlink::messages::{HIL_GPS, HIL_SENSOR, HilActuatorControls, HilGps, HilSensor};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_wire::autopilot::{Autopilot, AutopilotError, Fix, Identity, Readings};
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

/// Default address that PX4 connects to.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:4560";
/// Eight parts of 0.5 ms: 250 Hz. At 500 Hz some samples are not answered.
const INTERVAL_PARTS: u32 = 8;
/// Wall-clock interval between samples that are not answered yet.
const PACE: Duration = Duration::from_millis(4);
/// Compass at 125 Hz, barometer at 50 Hz.
const SAMPLES_PER_FIELD: u64 = 2;
const SAMPLES_PER_PRESSURE: u64 = 5;
/// Maximum reads per poll.
const MOST_READS: usize = 16;
/// We are system 1, as PX4 is.
const SYSTEM: u8 = 1;
const COMPONENT: u8 = 1;

/// One connection.
#[derive(Debug)]
struct Connection {
    stream: TcpStream,
    peer: SocketAddr,
    decoder: Decoder,
    /// Time of the last sample that was answered, µs.
    answered_us: Option<u64>,
    /// One of its answers had a mode.
    tells_mode: bool,
    /// Since its last answer: other messages, and answers to other samples among them.
    others: [u64; 2],
}

/// The link to one PX4.
#[derive(Debug)]
pub struct Px4 {
    listener: TcpListener,
    map: OutputMap,
    patience: Patience,
    connection: Option<Connection>,
    /// The last connected peer.
    last_peer: Option<SocketAddr>,
    /// How the last connection was lost, one sentence.
    last_loss: Option<String>,
    controls: HilActuatorControls,
    sequence: u8,
    samples: u64,
    /// Since when samples have been sent without any answer.
    unanswered_since: Option<Instant>,
    in_flight: bool,
}

/// Result of polling the connection.
enum Look {
    /// With the length of its payload.
    Answer(HilActuatorControls, usize),
    Nothing,
    Closed,
}

impl Px4 {
    /// Listens on `address`.
    ///
    /// # Errors
    /// The port is in use, or not permitted.
    pub fn listen(address: SocketAddr, map: OutputMap, patience: Patience) -> Result<Self, String> {
        let listener = TcpListener::bind(address)
            .and_then(|listener| listener.set_nonblocking(true).map(|()| listener))
            .map_err(|error| format!("cannot open TCP {address} to wait for PX4: {error}"))?;
        Ok(Self {
            listener,
            map,
            patience,
            connection: None,
            last_peer: None,
            last_loss: None,
            controls: HilActuatorControls::default(),
            sequence: 0,
            samples: 0,
            unanswered_since: None,
            in_flight: false,
        })
    }

    /// Where it listens.
    pub fn local_address(&self) -> Option<SocketAddr> {
        self.listener.local_addr().ok()
    }

    fn name(&self) -> String {
        match self.connection.as_ref().map(|c| c.peer).or(self.last_peer) {
            Some(peer) => format!("PX4 at {peer}"),
            None => "PX4".to_owned(),
        }
    }

    /// "after its answer to the sample of 1.234 s", or that there was none.
    fn after(&self) -> String {
        match self.connection.as_ref().and_then(|c| c.answered_us) {
            Some(time) => format!("after its answer to the sample of {:.3} s", time as f64 * 1e-6),
            None => "before its first answer".to_owned(),
        }
    }

    /// Waits for a connection.
    fn connect(&mut self) -> Result<(), AutopilotError> {
        let wait = Wait::new(self.patience.join);
        loop {
            if self.patience.stopped() {
                return Err(AutopilotError::stopped());
            }
            match self.listener.accept() {
                Ok((stream, peer)) => return self.take(stream, peer),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
                Err(error) => return Err(AutopilotError::wrong(format!("waiting for PX4 failed: {error}"))),
            }
            let Some(slice) = wait.slice() else {
                let address = self
                    .local_address()
                    .map_or_else(String::new, |address| address.to_string());
                let limit = wait.limit.as_millis();
                let sentence = match &self.last_loss {
                    Some(loss) => {
                        format!("{loss}, and no other one to TCP {address} came within {limit} ms (--join-timeout)")
                    }
                    None => format!("PX4 did not connect to TCP {address} within {limit} ms (--join-timeout)"),
                };
                return Err(AutopilotError::lost(sentence, wait.silence()));
            };
            std::thread::sleep(slice.min(Duration::from_millis(2)));
        }
    }

    fn take(&mut self, stream: TcpStream, peer: SocketAddr) -> Result<(), AutopilotError> {
        stream
            .set_nonblocking(false)
            .and_then(|()| stream.set_nodelay(true))
            .and_then(|()| stream.set_write_timeout(Some(self.patience.step)))
            .map_err(|error| AutopilotError::wrong(format!("the connection to PX4 at {peer} failed: {error}")))?;
        self.connection = Some(Connection {
            stream,
            peer,
            decoder: Decoder::default(),
            answered_us: None,
            tells_mode: false,
            others: [0; 2],
        });
        self.last_peer = Some(peer);
        self.controls = HilActuatorControls::default();
        self.unanswered_since = None;
        Ok(())
    }

    /// The connection is lost: before the flight another one may follow.
    fn lose(&mut self, why: &str) -> Result<(), AutopilotError> {
        let sentence = format!("{} {why} {}", self.name(), self.after());
        self.connection = None;
        self.controls = HilActuatorControls::default();
        if self.in_flight {
            return Err(AutopilotError::lost(sentence, Duration::ZERO));
        }
        tracing::warn!("{sentence}, before the flight");
        self.last_loss = Some(sentence);
        Ok(())
    }

    /// Sends a sample; false: the connection is gone.
    fn send(&mut self, readings: &Readings, time_usec: u64) -> Result<bool, AutopilotError> {
        let mut bytes = self.frame(HIL_SENSOR, &sensor(readings, time_usec, self.samples).encode());
        if let Some(fix) = &readings.gps {
            bytes.extend(self.frame(HIL_GPS, &gps(fix, time_usec).encode()));
        }
        self.samples += 1;
        let Some(connection) = &mut self.connection else {
            return Ok(false);
        };
        match connection.stream.write_all(&bytes) {
            Ok(()) => Ok(true),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                let limit = self.patience.step.as_millis();
                let sentence = format!(
                    "{} has taken no sample for {limit} ms (--step-timeout) {}",
                    self.name(),
                    self.after()
                );
                Err(AutopilotError::lost(sentence, self.patience.step))
            }
            Err(_) => self.lose("closed the connection").map(|()| false),
        }
    }

    fn frame(&mut self, message: u32, payload: &[u8]) -> Vec<u8> {
        let bytes = encode(self.sequence, SYSTEM, COMPONENT, message, payload);
        self.sequence = self.sequence.wrapping_add(1);
        bytes
    }

    /// Blocks for at most `slice` and processes received data; the answer to `time_usec` ends the poll.
    fn look(&mut self, time_usec: u64, slice: Duration) -> Result<Look, AutopilotError> {
        let Some(connection) = &mut self.connection else {
            return Ok(Look::Closed);
        };
        let mut buffer = [0; 4096];
        let mut closed = false;
        // A sender that never pauses must not block us here: the caller checks the time again.
        for _ in 0..MOST_READS {
            while let Some(frame) = connection.decoder.next_frame() {
                connection.others[0] += 1;
                let Some(controls) = HilActuatorControls::read(&frame) else {
                    continue;
                };
                if controls.time_usec == time_usec {
                    connection.answered_us = Some(time_usec);
                    connection.others = [0; 2];
                    return Ok(Look::Answer(controls, frame.length));
                }
                connection.others[1] += 1;
                if controls.time_usec > time_usec {
                    let sentence = format!(
                        "{} answered a sample of {:.3} s that was never sent, the latest is that of {:.3} s",
                        self.name(),
                        controls.time_usec as f64 * 1e-6,
                        time_usec as f64 * 1e-6
                    );
                    return Err(AutopilotError::wrong(sentence));
                }
            }
            let ready = connection
                .stream
                .set_read_timeout(Some(slice.max(Duration::from_micros(100))))
                .and_then(|()| connection.stream.read(&mut buffer));
            match ready {
                Ok(0) => closed = true,
                Ok(length) => connection.decoder.push(&buffer[..length]),
                Err(error) if is_nothing_yet(&error) => break,
                Err(_) => closed = true,
            }
            if closed {
                break;
            }
        }
        Ok(if closed { Look::Closed } else { Look::Nothing })
    }

    /// Waits for the answer to a sample.
    fn await_answer(&mut self, time_usec: u64) -> Result<(), AutopilotError> {
        let begun = self.connection.as_ref().is_some_and(|c| c.answered_us.is_some());
        let wait = Wait::new(if begun { self.patience.step } else { PACE });
        loop {
            if self.patience.stopped() {
                return Err(AutopilotError::stopped());
            }
            let Some(slice) = wait.slice() else {
                return if begun {
                    Err(self.silent(&wait, time_usec))
                } else {
                    self.not_begun()
                };
            };
            match self.look(time_usec, slice)? {
                Look::Answer(controls, length) => {
                    self.unanswered_since = None;
                    self.check(&controls, length)?;
                    if let Some(connection) = &mut self.connection {
                        connection.tells_mode |= controls.mode != 0;
                    }
                    self.controls = controls;
                    return Ok(());
                }
                Look::Nothing => {}
                Look::Closed => return self.lose("closed the connection"),
            }
        }
    }

    /// No answer yet, as usual at the beginning.
    fn not_begun(&mut self) -> Result<(), AutopilotError> {
        let since = *self.unanswered_since.get_or_insert_with(Instant::now);
        if since.elapsed() < self.patience.join {
            return Ok(());
        }
        let sentence = format!(
            "{} is connected and has answered none of {} samples within {} ms (--join-timeout){}",
            self.name(),
            self.samples,
            self.patience.join.as_millis(),
            self.noise()
        );
        Err(AutopilotError::lost(sentence, since.elapsed()))
    }

    fn silent(&self, wait: &Wait, time_usec: u64) -> AutopilotError {
        let what = match self.connection.as_ref().map(|connection| connection.others) {
            None | Some([0, _]) => format!("sent nothing {}: silent", self.after()),
            Some([messages, answers]) => format!(
                "did not answer the sample of {:.3} s (other messages since: {messages}, answers to earlier samples among them: {answers}): \
                 awaited",
                time_usec as f64 * 1e-6
            ),
        };
        let sentence = format!(
            "{} {what} for {} ms, allowed are {} ms (--step-timeout){}",
            self.name(),
            wait.silence().as_millis(),
            wait.limit.as_millis(),
            self.noise()
        );
        AutopilotError::lost(sentence, wait.silence())
    }

    /// Other data received.
    fn noise(&self) -> String {
        match self.connection.as_ref().map(|c| (c.decoder.noise, c.decoder.corrupt)) {
            None | Some((0, 0)) => String::new(),
            Some((noise, corrupt)) => {
                format!("; {noise} bytes that are not MAVLink 2 and {corrupt} frames with a wrong checksum came")
            }
        }
    }

    fn check(&self, controls: &HilActuatorControls, length: usize) -> Result<(), AutopilotError> {
        let told = self.connection.as_ref().is_some_and(|connection| connection.tells_mode);
        if length < HilActuatorControls::LENGTH && (told || controls.controls.iter().any(|control| *control != 0.0)) {
            let sentence = format!(
                "{} answered the sample of {:.3} s with a payload of {length} bytes, expected {} (HIL_ACTUATOR_CONTROLS): its last one, the \
                 mode, is missing",
                self.name(),
                controls.time_usec as f64 * 1e-6,
                HilActuatorControls::LENGTH
            );
            return Err(AutopilotError::wrong(sentence));
        }
        let used = &controls.controls[..self.map.rotor_of_channel.len().min(16)];
        // Below 0 is a reversed motor by the message's definition, which a motor of ours answers by standing still.
        let Some(channel) = used.iter().position(|control| !(-1.0..=1.0).contains(control)) else {
            return Ok(());
        };
        let sentence = format!(
            "{} answered the sample of {:.3} s with {} in control {}, expected 0 to 1",
            self.name(),
            controls.time_usec as f64 * 1e-6,
            used[channel],
            channel + 1
        );
        Err(AutopilotError::wrong(sentence))
    }
}

fn is_nothing_yet(error: &std::io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
    )
}

fn sensor(readings: &Readings, time_usec: u64, number: u64) -> HilSensor {
    let single = |v: [f64; 3]| v.map(|x| x as f32);
    let mut fields_updated = HilSensor::ACCELERATION | HilSensor::GYRO;
    if number.is_multiple_of(SAMPLES_PER_FIELD) {
        fields_updated |= HilSensor::MAGNETIC;
    }
    if number.is_multiple_of(SAMPLES_PER_PRESSURE) {
        fields_updated |= HilSensor::BAROMETER;
    }
    HilSensor {
        time_usec,
        acceleration: single(readings.specific_force_m_s2),
        gyro: single(readings.body_rates_rad_s),
        magnetic: single(readings.magnetic_field_gauss),
        absolute_pressure: readings.pressure_hpa as f32,
        differential_pressure: 0.0,
        pressure_altitude: readings.pressure_altitude_m as f32,
        temperature: readings.temperature_c as f32,
        fields_updated,
        id: 0,
    }
}

fn gps(fix: &Fix, time_usec: u64) -> HilGps {
    let [north, east, _] = fix.velocity_ned_m_s;
    HilGps {
        time_usec,
        latitude: (fix.latitude_deg * 1e7).round() as i32,
        longitude: (fix.longitude_deg * 1e7).round() as i32,
        altitude: (fix.altitude_m * 1e3).round() as i32,
        horizontal_error: 30,
        vertical_error: 40,
        speed: (100.0 * north.hypot(east)).round() as u16,
        velocity: fix.velocity_ned_m_s.map(|v| (100.0 * v).round() as i16),
        course: u16::MAX,
        fix_type: 3,
        satellites: 10,
    }
}

impl Autopilot for Px4 {
    fn interval_parts(&self) -> u32 {
        INTERVAL_PARTS
    }

    fn exchange(&mut self, readings: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
        if self.connection.is_none() {
            self.connect()?;
        }
        // A clock at 0 counts as not started.
        let time_usec = readings.time_ns / 1000 + 4000;
        if self.send(readings, time_usec)? {
            self.await_answer(time_usec)?;
        }
        if self.controls.mode & HilActuatorControls::ARMED == 0 {
            return Ok([0.0; MAX_ROTORS]);
        }
        let controls = self.controls.controls;
        Ok(self
            .map
            .duties(|channel| controls.get(channel).map_or(0.0, |control| f64::from(*control))))
    }

    fn identity(&self) -> Identity {
        Identity {
            peer: self.name(),
            version: None,
            lockstep: true,
        }
    }

    fn flight_begins(&mut self) {
        self.in_flight = true;
    }
}
