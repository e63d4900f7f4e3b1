//! The plant's link to a board.
//!
//! ```text
//!  open:      Hello ─▶ Identity;  Begin, Chunk …, Commit ─▶ Ready{hash}
//!  exchange:  Sensors k ─▶ Reply k (repeated after `Line::retry` without an answer, until the time-out)
//! ```
//! One request is outstanding at a time. If the reply does not arrive, the same request is sent again, with the same sequence number,
//! and the board gives the same answer: a lost frame costs time and changes nothing. A board that has lost its parameters (it
//! restarted) rejects the step, and the run ends with its error message.

use crate::line::Line;
pub use crate::shadow::Difference;
use crate::shadow::Shadow;
use prost::Message as _;
use rotortwin_board::PROTOCOL_VERSION;
use rotortwin_board::frame::{Decoder, LineStatistics, MAX_ENCODED, MAX_PAYLOAD, encode};
use rotortwin_board::message::{Begin, Options, Reply, Report, Sensors, Verdicts, Writer, hash, kind};
use rotortwin_board::parameters;
use rotortwin_flight_core::fdi::Residuals;
use rotortwin_flight_core::geometry::Geometry;
use rotortwin_proto::Role;
use rotortwin_wire::convert;
use rotortwin_wire::frames::{CommandFrame, FdiReport, LossEstimate, SensorFrame};
use rotortwin_wire::link::{FdiPeer, LinkError, PlantLink, RunSetup};
use rotortwin_wire::peers::FdiEnginePeer;
use rotortwin_wire::setup;
use std::collections::VecDeque;
use std::time::Duration;

/// Bytes of a download in one frame.
const CHUNK: usize = 384;

/// Options of a session.
#[derive(Clone, Copy, Debug)]
pub struct SessionOptions {
    /// Options for the board.
    pub board: Options,
    /// For the board to answer the first request.
    pub join: Duration,
    /// For the answer to any later request.
    pub step: Duration,
    /// Also runs the same peers here, and compares every bit of their output with the board's.
    pub compare: bool,
}

impl Default for SessionOptions {
    fn default() -> Self {
        Self {
            board: Options::default(),
            join: Duration::from_secs(10),
            step: Duration::from_secs(5),
            compare: false,
        }
    }
}

/// Observations about a board and its line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SessionReport {
    /// Name reported by the board.
    pub board: String,
    /// Bytes of parameters, and their hash.
    pub download: (usize, u64),
    /// Round trip of every step, s.
    pub round_trip_s: Vec<f32>,
    /// Repeated requests.
    pub retries: u64,
    /// Received from the board: good frames, CRC errors, garbage.
    pub line: LineStatistics,
    /// Bytes of the longest step, to the board and from it.
    pub longest: [usize; 2],
    /// The board's final report.
    pub report: Option<Report>,
    /// First bit in which the board and the host differ, if they were compared.
    pub difference: Option<Difference>,
    /// Steps compared.
    pub compared: u64,
}

/// Why a request has no answer.
enum Trouble {
    Silent(Duration),
    Refused(String),
    Broken(String),
}

/// See the module documentation.
pub struct BoardLink<L> {
    line: L,
    address: String,
    options: SessionOptions,
    decoder: Decoder,
    sequence: u16,
    run_id: u64,
    last_step: Option<u64>,
    geometry: Option<Geometry>,
    rotor_count: usize,
    verdicts: Verdicts,
    host_fdi: FdiEnginePeer,
    reports: VecDeque<FdiReport>,
    shadow: Option<Shadow>,
    report: SessionReport,
    /// An answer has arrived since the last failure, so that the status can be requested.
    healthy: bool,
}

impl<L: Line> BoardLink<L> {
    /// A link to the board behind `line`; `address` is for messages.
    pub fn new(line: L, address: &str, options: SessionOptions) -> Self {
        Self {
            line,
            address: address.to_owned(),
            options,
            decoder: Decoder::default(),
            sequence: 0,
            run_id: 0,
            last_step: None,
            geometry: None,
            rotor_count: 0,
            verdicts: Verdicts::default(),
            host_fdi: FdiEnginePeer::default(),
            reports: VecDeque::with_capacity(4),
            shadow: options.compare.then(Shadow::default),
            report: SessionReport::default(),
            healthy: false,
        }
    }

    /// Report so far.
    pub fn report(&self) -> SessionReport {
        SessionReport {
            line: self.decoder.statistics(),
            difference: self.shadow.as_ref().and_then(Shadow::first_difference),
            compared: self.shadow.as_ref().map_or(0, Shadow::compared),
            ..self.report.clone()
        }
    }

    /// The line, for instance to look at its state.
    pub fn line(&self) -> &L {
        &self.line
    }

    /// Requests the board's name and status. For `rotortwin board info`.
    pub fn inquire(&mut self) -> Result<(String, Report), LinkError> {
        self.hello()?;
        let payload = self
            .request(kind::STATUS, &[], kind::REPORT, self.options.step)
            .map_err(|trouble| self.error(trouble))?;
        let report =
            Report::read(&payload).ok_or_else(|| self.protocol_violation("its report does not follow the protocol"))?;
        Ok((self.report.board.clone(), report))
    }

    /// Asks the board to restart into its boot loader.
    pub fn enter_boot_loader(&mut self) -> Result<(), LinkError> {
        self.hello()?;
        self.request(kind::BOOT_LOADER, &[], kind::ACKNOWLEDGE, self.options.step)
            .map(|_| ())
            .map_err(|trouble| self.error(trouble))
    }

    fn hello(&mut self) -> Result<(), LinkError> {
        let join = self.options.join;
        let identity = self
            .request(kind::HELLO, &[], kind::IDENTITY, join)
            .map_err(|trouble| match trouble {
                Trouble::Silent(_) => LinkError::PeerMissing {
                    role: Role::Controller,
                    run_id: self.run_id,
                    address: self.address.clone(),
                    limit: join,
                    unused: None,
                },
                other => self.error(other),
            })?;
        self.report.board = String::from_utf8_lossy(identity.get(1..).unwrap_or_default()).into_owned();
        self.healthy = true;
        Ok(())
    }

    /// Repeats a request until it is answered; returns the payload of an answer of kind `expected`.
    fn request(&mut self, request: u8, payload: &[u8], expected: u8, limit: Duration) -> Result<Vec<u8>, Trouble> {
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = [0; MAX_ENCODED + 1];
        let body: &mut [u8; MAX_ENCODED] = (&mut frame[1..]).try_into().expect("one byte longer");
        let length = encode(request, self.sequence, payload, body);
        let start = self.line.now();
        let mut first = true;
        let mut buffer = [0; 1024];
        loop {
            // A leading zero terminates the remainder of an interrupted frame.
            let from = usize::from(first && request != kind::HELLO);
            self.line.send(&frame[from..=length]).map_err(Trouble::Broken)?;
            if !std::mem::replace(&mut first, false) {
                self.report.retries += 1;
            }
            let again = self.line.now() + self.line.retry();
            loop {
                let now = self.line.now();
                if now >= start + limit {
                    return Err(Trouble::Silent(now - start));
                }
                if now >= again {
                    break;
                }
                let wait = again.min(start + limit) - now;
                let count = self.line.receive(&mut buffer, wait).map_err(Trouble::Broken)?;
                for byte in &buffer[..count] {
                    let Some((header, answer)) = self.decoder.push(*byte) else {
                        continue;
                    };
                    if header.sequence != self.sequence {
                        continue;
                    }
                    if header.version != PROTOCOL_VERSION {
                        return Err(Trouble::Refused(format!(
                            "the board uses version {} of the link protocol, this program uses version {PROTOCOL_VERSION}",
                            header.version
                        )));
                    }
                    if header.kind == expected {
                        return Ok(answer.to_vec());
                    }
                    if header.kind == kind::REFUSAL {
                        let sentence = answer.get(1..).unwrap_or_default();
                        return Err(Trouble::Refused(String::from_utf8_lossy(sentence).into_owned()));
                    }
                    return Err(Trouble::Refused(format!(
                        "it replied with a message of kind {:#04x}, expected {expected:#04x}",
                        header.kind
                    )));
                }
            }
        }
    }

    fn program(&self) -> String {
        if self.report.board.is_empty() {
            format!("board at {}", self.address)
        } else {
            format!("board {} at {}", self.report.board, self.address)
        }
    }

    fn error(&mut self, trouble: Trouble) -> LinkError {
        self.healthy = false;
        match trouble {
            Trouble::Silent(silence) => LinkError::PeerSilent {
                role: Role::Controller,
                program: self.program(),
                last_step: self.last_step,
                silence,
                limit: self.options.step,
                unused: None,
            },
            Trouble::Refused(reason) => LinkError::Refused {
                role: Role::Controller,
                reason: format!("{}: {reason}", self.program()),
            },
            Trouble::Broken(reason) => LinkError::Transport {
                transport: "board",
                action: self.address.clone(),
                reason,
            },
        }
    }

    fn protocol_violation(&self, reason: &str) -> LinkError {
        LinkError::ProtocolViolation {
            role: Role::Controller,
            step: self.last_step.map_or(0, |step| step + 1),
            reason: format!("{}: {reason}", self.program()),
        }
    }

    fn download(&mut self, setup: &RunSetup) -> Result<(), LinkError> {
        let controller = setup.controller.encode_to_vec();
        let length = u32::try_from(controller.len()).expect("16 rotors take some hundred bytes");
        let mut bytes = length.to_le_bytes().to_vec();
        bytes.extend(controller);
        bytes.extend(setup.fdi.encode_to_vec());
        if bytes.len() > parameters::MAX_LENGTH {
            return Err(self.protocol_violation(&format!("{} bytes of parameters do not fit", bytes.len())));
        }
        let hash = hash(&bytes);
        self.report.download = (bytes.len(), hash);
        let mut payload = [0; MAX_PAYLOAD];
        let mut writer = Writer::new(&mut payload);
        Begin {
            length: u32::try_from(bytes.len()).expect("checked above"),
            hash,
            options: self.options.board,
        }
        .write(&mut writer);
        let written = writer.len();
        let limit = self.options.step;
        self.request(kind::BEGIN, &payload[..written], kind::ACKNOWLEDGE, limit)
            .map_err(|trouble| self.error(trouble))?;
        for (index, chunk) in bytes.chunks(CHUNK).enumerate() {
            let offset = u32::try_from(index * CHUNK).expect("checked above");
            let mut piece = offset.to_le_bytes().to_vec();
            piece.extend(chunk);
            self.request(kind::CHUNK, &piece, kind::ACKNOWLEDGE, limit)
                .map_err(|trouble| self.error(trouble))?;
        }
        let ready = self
            .request(kind::COMMIT, &[], kind::READY, limit)
            .map_err(|trouble| self.error(trouble))?;
        if ready != hash.to_le_bytes() {
            return Err(self.protocol_violation("it acknowledged parameters with another hash than those sent"));
        }
        Ok(())
    }

    fn fdi_report(&mut self, reply: &Reply) -> Option<FdiReport> {
        let fdi = reply.fdi.as_ref()?;
        if let Some(verdicts) = fdi.verdicts {
            self.verdicts = verdicts;
        }
        let v = &self.verdicts;
        let residuals_nms = match (fdi.residuals, &self.geometry) {
            (Some(residuals), _) => residuals,
            // The engine's own projection, of the same numbers.
            (None, Some(geometry)) => Residuals::from_wrench(geometry, &fdi.wrench_residual).component,
            (None, None) => return None,
        };
        let report = FdiReport {
            stamp: Default::default(),
            residuals_nms,
            wrench_residual: fdi.wrench_residual,
            t_test: v.codes[0].into(),
            network: v.codes[1].into(),
            sequential: v.codes[2].into(),
            sequential_probability: v.probability,
            thrust_loss: LossEstimate::from_values(v.loss[0]),
            second_thrust_loss: LossEstimate::from_values(v.loss[1]),
            suspect_rotors: v.suspect_rotors.into(),
            hypothesis_count: v.hypothesis_count.into(),
            hypothesis_rotors: v.hypotheses.map(u32::from),
            window_end: fdi.window_end.into(),
        };
        Some(report.canonical())
    }
}

impl<L: Line> PlantLink for BoardLink<L> {
    fn open(&mut self, setup: &RunSetup) -> Result<(), LinkError> {
        self.run_id = setup.run_id;
        self.rotor_count = setup.controller.rotors.len();
        let refused = |role| move |reason| LinkError::Refused { role, reason };
        if u32::try_from(setup.step_count).is_err() {
            return Err(self.protocol_violation("a board counts up to 2^32 steps"));
        }
        self.geometry = Some(setup::fdi_config(&setup.fdi).map_err(refused(Role::Fdi))?.geometry);
        if self.options.board.fdi && setup.fdi.ground.is_some() {
            return Err(refused(Role::Fdi)(
                "a board's detectors calibrate by its clock, also on the ground, which this scenario has: --fdi host judges on this \
                 computer, in the air only"
                    .to_owned(),
            ));
        }
        if !self.options.board.fdi {
            self.host_fdi.setup(&setup.fdi).map_err(refused(Role::Fdi))?;
        }
        if let Some(shadow) = &mut self.shadow {
            shadow.setup(setup)?;
        }
        self.hello()?;
        self.download(setup)
    }

    fn exchange(&mut self, sensors: &SensorFrame) -> Result<CommandFrame, LinkError> {
        let step = sensors.stamp.step;
        let sensors = sensors.canonical();
        convert::check_sensors(&sensors).map_err(|error| LinkError::ProtocolViolation {
            role: Role::Plant,
            step,
            reason: error.to_string(),
        })?;
        let mut payload = [0; Sensors::LENGTH];
        let mut writer = Writer::new(&mut payload);
        message(&sensors).write(&mut writer);
        let start = self.line.now();
        let answer = self
            .request(kind::SENSORS, &payload, kind::REPLY, self.options.step)
            .map_err(|trouble| match trouble {
                Trouble::Refused(reason) => {
                    self.healthy = false;
                    self.protocol_violation(&reason)
                }
                other => self.error(other),
            })?;
        self.report.round_trip_s.push((self.line.now() - start).as_secs_f32());
        self.report.longest[0] = Sensors::LENGTH;
        self.report.longest[1] = self.report.longest[1].max(answer.len());
        let reply = Reply::read(&answer)
            .filter(|reply| u64::from(reply.step) == step && usize::from(reply.rotor_count) == self.rotor_count)
            .ok_or_else(|| self.protocol_violation("its reply does not follow the protocol"))?;
        let command = CommandFrame {
            stamp: sensors.stamp,
            duty: reply.duty,
            attitude_setpoint_rad: reply.attitude_setpoint,
            saturated_rotors: reply.saturated_rotors.into(),
        }
        .canonical();
        convert::check_command(&command, self.rotor_count)
            .map_err(|error| self.protocol_violation(&error.to_string()))?;
        let mut report = if self.options.board.fdi {
            self.fdi_report(&reply)
                .ok_or_else(|| self.protocol_violation("its reply has no residuals, but it was asked for them"))?
        } else {
            self.host_fdi.step(&sensors, &command).canonical()
        };
        report.stamp = sensors.stamp;
        convert::check_report(&report, self.rotor_count).map_err(|error| LinkError::ProtocolViolation {
            role: Role::Fdi,
            step,
            reason: error.to_string(),
        })?;
        if let Some(shadow) = &mut self.shadow {
            shadow.compare(&sensors, &command, &report);
        }
        self.reports.push_back(report);
        self.last_step = Some(step);
        Ok(command)
    }

    fn next_report(&mut self, _wait: bool) -> Result<Option<FdiReport>, LinkError> {
        Ok(self.reports.pop_front())
    }

    fn finish(&mut self, _steps: u64, _failure: Option<&str>) {
        if !self.healthy {
            return;
        }
        let limit = Duration::from_millis(500).max(self.line.retry() * 2);
        match self.request(kind::STATUS, &[], kind::REPORT, limit) {
            Ok(payload) => self.report.report = Report::read(&payload),
            Err(_) => tracing::warn!(board = self.program(), "no report at the end of the run"),
        }
        if self.request(kind::FINISH, &[], kind::ACKNOWLEDGE, limit).is_err() {
            tracing::warn!(board = self.program(), "the end of the run was not acknowledged");
        }
    }
}

/// Run and time are not sent: the board counts steps.
fn message(sensors: &SensorFrame) -> Sensors {
    let groups = [
        sensors.position_ned_m,
        sensors.velocity_ned_m_s,
        sensors.attitude_rad,
        sensors.body_rates_rad_s,
        sensors.reference_position_ned_m,
        sensors.reference_velocity_ned_m_s,
    ];
    let mut values = [0.0; 20];
    values[..18].copy_from_slice(groups.as_flattened());
    values[18] = sensors.reference_yaw_rad;
    values[19] = sensors.battery_voltage_v;
    Sensors {
        // Checked when the run was opened.
        step: sensors.stamp.step as u32,
        values,
    }
}
