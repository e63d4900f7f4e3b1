//! The application of a board: bytes in, bytes out.
//!
//! ```text
//!   Idle ──Begin──▶ Download ──Commit──▶ Flight ⟲ Sensors
//!    ▲                  │ refused          │
//!    └──Hello, Finish───┴──────────────────┘
//! ```
//! One [`Application`] in static memory; [`Application::receive`] takes a byte and returns data to send, if any. Sensors of the next step
//! trigger one step of controller and FDI engine; those of a step already answered get the same answer again; a step too far ahead is
//! rejected.

use crate::frame::{Decoder, Header, MAX_ENCODED, MAX_PAYLOAD, crc32, encode};
use crate::message::{
    Begin, Cost, CostUnit, FdiPart, Options, Reply, Report, Sensors, Verdicts, Writer, hash, kind, refusal,
};
use crate::{PROTOCOL_VERSION, parameters};
use core::fmt::Write as _;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::control::Controller;
use rotortwin_flight_core::fdi::{FdiEngine, FdiOutput, LossEstimate};
use rotortwin_flight_core::frames::{EulerAngles, Vec3};
use rotortwin_flight_core::signals::{Measurement, NavState, Reference};

/// Hardware interface of the application.
pub trait Board {
    /// Name, as in `rotortwin board list`.
    const NAME: &'static str;
    /// What [`Board::counter`] counts.
    const UNIT: CostUnit;

    /// A free-running counter.
    fn counter(&mut self) -> u32;
    /// Instructions or cycles between two values of the counter.
    fn cost(&self, start: u32, end: u32) -> u32;
    /// Processor clock, Hz; 0 if meaningless.
    fn clock_hz(&self) -> u32;
    /// Maximum stack use in flight and before it, and stack size, bytes.
    fn stack(&self) -> [u32; 3];
    /// Why it started; see [`Report::reset_cause`].
    fn reset_cause(&self) -> u8;
    /// Registers of the fault before the start; see [`Report::fault`].
    fn fault(&self) -> [u32; 5] {
        [0; 5]
    }
    /// Sets the LEDs.
    fn show(&mut self, state: State);
    /// Restart into the boot loader once the answer is out; false if there is none.
    fn boot_loader(&mut self) -> bool;
}

/// State of the application.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Waiting for a host.
    Idle,
    /// Receiving parameters.
    Download,
    /// Answering steps.
    Flight,
    /// The last request was rejected.
    Refused,
}

/// See the module documentation.
pub struct Application {
    decoder: Decoder,
    state: State,
    begin: Slot<Begin>,
    received: usize,
    download: [u8; parameters::MAX_LENGTH],
    options: Options,
    /// Used only if `has_controller`.
    controller: Controller,
    has_controller: bool,
    /// Used only if `has_engine`. Not an `Option`: it is configured in place, as there is no room for a second one.
    engine: FdiEngine,
    has_engine: bool,
    next_step: u32,
    /// Sequence number and CRC-32 of the request answered by `answer`.
    last_request: Slot<(Header, u32)>,
    answer: [u8; MAX_ENCODED],
    answer_length: usize,
    report: Report,
}

impl Application {
    /// Idle. All bits are 0, so that a board keeps it in static memory without an image in flash or a copy on the stack.
    pub const fn new() -> Self {
        Self {
            decoder: Decoder::new(),
            state: State::Idle,
            begin: Slot::Empty,
            received: 0,
            download: [0; parameters::MAX_LENGTH],
            options: Options::NONE,
            controller: Controller::BLANK,
            has_controller: false,
            engine: FdiEngine::BLANK,
            has_engine: false,
            next_step: 0,
            last_request: Slot::Empty,
            answer: [0; MAX_ENCODED],
            answer_length: 0,
            report: Report::NONE,
        }
    }
}

impl Default for Application {
    fn default() -> Self {
        Self::new()
    }
}

/// An `Option` whose empty form is all zeros (an `Option` may use niches of its content).
#[repr(u8)]
enum Slot<T> {
    Empty = 0,
    Full(T) = 1,
}

impl<T> Slot<T> {
    fn get(&self) -> Option<&T> {
        match self {
            Self::Empty => None,
            Self::Full(content) => Some(content),
        }
    }
}

/// Response to a request.
struct Answer<'a> {
    kind: u8,
    payload: Writer<'a>,
}

impl Answer<'_> {
    fn refuse(&mut self, code: u8, sentence: core::fmt::Arguments<'_>) {
        self.kind = kind::REFUSAL;
        self.payload.put(&[code]);
        // A text that does not fit is truncated; writing into memory does not fail otherwise.
        if self.payload.write_fmt(sentence).is_err() {
            self.payload.put(b"...");
        }
    }

    fn malformed(&mut self, what: &str) {
        self.refuse(
            refusal::MALFORMED,
            format_args!("{what} does not have the length required by the protocol"),
        );
    }
}

impl Application {
    /// Current state.
    pub fn state(&self) -> State {
        self.state
    }

    /// Discards a partial frame, as after the line was lost.
    pub fn line_lost(&mut self) {
        self.decoder.reset();
    }

    /// Processes one byte; returns a frame to send, if it completed a request.
    #[inline]
    pub fn receive<B: Board>(&mut self, byte: u8, board: &mut B) -> Option<&[u8]> {
        let mut request = [0; MAX_PAYLOAD];
        let (header, length) = {
            let (header, payload) = self.decoder.push(byte)?;
            let length = payload.len().min(MAX_PAYLOAD);
            request[..length].copy_from_slice(&payload[..length]);
            (header, length)
        };
        self.answer(header, &request[..length], board);
        Some(&self.answer[..self.answer_length.min(MAX_ENCODED)])
    }

    fn answer<B: Board>(&mut self, header: Header, request: &[u8], board: &mut B) {
        let identity = (header, crc32(request));
        if self.last_request.get() == Some(&identity) && header.kind != kind::HELLO {
            self.report.repeated = self.report.repeated.wrapping_add(1);
            return;
        }
        let mut payload = [0; MAX_PAYLOAD];
        let mut answer = Answer {
            kind: kind::ACKNOWLEDGE,
            payload: Writer::new(&mut payload),
        };
        let state = if header.version == PROTOCOL_VERSION {
            self.handle(header.kind, request, &mut answer, board)
        } else {
            answer.refuse(
                refusal::VERSION,
                format_args!(
                    "the host uses version {} of the link protocol, this board uses version {PROTOCOL_VERSION}",
                    header.version
                ),
            );
            State::Refused
        };
        if state != self.state {
            self.state = state;
            board.show(state);
        }
        let (kind, length) = (answer.kind, answer.payload.len());
        self.answer_length = encode(
            kind,
            header.sequence,
            &payload[..length.min(MAX_PAYLOAD)],
            &mut self.answer,
        );
        self.last_request = Slot::Full(identity);
    }

    #[inline]
    fn handle<B: Board>(&mut self, request_kind: u8, request: &[u8], answer: &mut Answer<'_>, board: &mut B) -> State {
        match request_kind {
            kind::SENSORS => self.step(request, answer, board),
            kind::HELLO => {
                self.forget();
                answer.kind = kind::IDENTITY;
                answer.payload.put(&[MAX_ROTORS as u8]);
                answer.payload.put(B::NAME.as_bytes());
                answer.payload.put(b" ");
                answer.payload.put(env!("CARGO_PKG_VERSION").as_bytes());
                State::Idle
            }
            kind::BEGIN => match Begin::read(request) {
                Some(begin) if begin.length as usize <= parameters::MAX_LENGTH => {
                    self.forget();
                    self.begin = Slot::Full(begin);
                    State::Download
                }
                Some(begin) => {
                    answer.refuse(
                        refusal::PARAMETERS,
                        format_args!(
                            "{} bytes of parameters, room for {}",
                            begin.length,
                            parameters::MAX_LENGTH
                        ),
                    );
                    State::Refused
                }
                None => {
                    answer.malformed("Begin");
                    State::Refused
                }
            },
            kind::CHUNK => self.take_chunk(request, answer),
            kind::COMMIT => match self.commit(answer) {
                Ok(()) => State::Flight,
                Err(()) => {
                    self.forget();
                    State::Refused
                }
            },
            kind::STATUS => {
                answer.kind = kind::REPORT;
                let line = self.decoder.statistics();
                self.report.line = [line.frames, line.crc_errors, line.garbage];
                self.report.unit = B::UNIT;
                [self.report.stack_used, self.report.stack_before, self.report.stack_size] = board.stack();
                self.report.clock_hz = board.clock_hz();
                self.report.reset_cause = board.reset_cause();
                self.report.fault = board.fault();
                self.report.write(&mut answer.payload);
                self.state
            }
            kind::FINISH => {
                self.forget();
                State::Idle
            }
            kind::BOOT_LOADER => {
                if board.boot_loader() {
                    return State::Idle;
                }
                answer.refuse(refusal::MALFORMED, format_args!("{} has no boot loader", B::NAME));
                self.state
            }
            other => {
                answer.refuse(refusal::MALFORMED, format_args!("{other} is not a kind of request"));
                self.state
            }
        }
    }

    fn forget(&mut self) {
        self.begin = Slot::Empty;
        self.received = 0;
        self.has_controller = false;
        self.has_engine = false;
        self.next_step = 0;
    }

    fn take_chunk(&mut self, request: &[u8], answer: &mut Answer<'_>) -> State {
        let Some((offset, bytes)) = request.split_first_chunk::<4>() else {
            answer.malformed("Chunk");
            return State::Refused;
        };
        let offset = u32::from_le_bytes(*offset) as usize;
        let end = offset.saturating_add(bytes.len());
        let length = self.begin.get().map_or(0, |begin| begin.length as usize);
        match self.download.get_mut(offset..end) {
            Some(place) if offset == self.received && end <= length => {
                place.copy_from_slice(bytes);
                self.received = end;
                State::Download
            }
            _ => {
                answer.refuse(
                    refusal::PARAMETERS,
                    format_args!(
                        "bytes {offset} to {end} of {length} do not follow the {} received",
                        self.received
                    ),
                );
                State::Refused
            }
        }
    }

    #[inline(never)]
    fn commit(&mut self, answer: &mut Answer<'_>) -> Result<(), ()> {
        let download = self.download.get(..self.received).unwrap_or_default();
        let found = hash(download);
        let Some(begin) = self.begin.get().copied() else {
            answer.refuse(refusal::PARAMETERS, format_args!("no parameters were announced"));
            return Err(());
        };
        if begin.hash != found || self.received != begin.length as usize {
            answer.refuse(
                refusal::HASH,
                format_args!(
                    "the parameters received have the hash {found:016x} ({} bytes), announced was {:016x} ({} bytes)",
                    self.received, begin.hash, begin.length
                ),
            );
            return Err(());
        }
        if let Err(error) = self.load(begin.options) {
            answer.refuse(refusal::PARAMETERS, format_args!("{error}"));
            return Err(());
        }
        self.report.steps = 0;
        self.report.cost = [Cost::default(); 3];
        answer.kind = kind::READY;
        answer.payload.put(&found.to_le_bytes());
        Ok(())
    }

    fn load(&mut self, options: Options) -> Result<(), parameters::ParameterError> {
        use parameters::ParameterError;
        let (controller, fdi) = parameters::split(self.download.get(..self.received).unwrap_or_default())?;
        let mut trim = None;
        self.controller.configure(|config| {
            trim = parameters::controller(controller, config)?;
            Ok::<(), ParameterError>(())
        })?;
        if let Some((duty, voltage)) = trim {
            self.controller.trim(duty, voltage);
        }
        if options.fdi {
            self.engine.configure(|config| parameters::fdi(fdi, config))?;
            self.engine.set_detectors(options.detectors);
            self.has_engine = true;
        }
        self.has_controller = true;
        self.options = options;
        Ok(())
    }

    /// Executes the next step, or rejects it.
    #[inline]
    fn step<B: Board>(&mut self, request: &[u8], answer: &mut Answer<'_>, board: &mut B) -> State {
        let Some(sensors) = Sensors::read(request) else {
            answer.malformed("Sensors");
            return self.state;
        };
        if !self.has_controller {
            answer.refuse(
                refusal::NO_PARAMETERS,
                format_args!(
                    "no parameters for step {}: the board has restarted, or was never started",
                    sensors.step
                ),
            );
            return State::Refused;
        }
        if sensors.step != self.next_step {
            answer.refuse(
                refusal::STEP_GAP,
                format_args!("received step {}, expected step {}", sensors.step, self.next_step),
            );
            return self.state;
        }
        let length = self.advance(&sensors, answer.payload.room(), board);
        answer.payload.advance(length);
        answer.kind = kind::REPLY;
        State::Flight
    }

    /// Runs controller and FDI engine once, and writes the reply to `out`; returns its length. `cargo xtask firmware` searches the linked
    /// image for panic paths starting at this function, by name.
    #[inline(never)]
    fn advance<B: Board>(&mut self, sensors: &Sensors, out: &mut [u8], board: &mut B) -> usize {
        let controller = &mut self.controller;
        let start = board.counter();
        let (nav, reference, battery_voltage) = signals(&sensors.values);
        let mut output = controller.step(&nav, &reference, battery_voltage);
        // −0 does not pass the links between processes, either.
        for duty in &mut output.command.duty {
            *duty += 0.0;
        }
        let middle = board.counter();
        let engine_output = self.has_engine.then(|| {
            self.engine.step(&Measurement {
                nav,
                command: output.command,
                battery_voltage,
            })
        });
        let end = board.counter();
        let costs = [
            board.cost(start, middle),
            board.cost(middle, end),
            board.cost(start, end),
        ];
        for (cost, counted) in self.report.cost.iter_mut().zip(costs) {
            cost.push(sensors.step, counted);
        }
        self.report.steps = self.report.steps.wrapping_add(1);
        self.next_step = self.next_step.wrapping_add(1);
        let setpoint = output.attitude_setpoint;
        let reply = Reply {
            step: sensors.step,
            rotor_count: controller.config().geometry.rotor_count() as u8,
            duty: output.command.duty,
            attitude_setpoint: [setpoint.roll, setpoint.pitch, setpoint.yaw],
            saturated_rotors: output.saturated_rotors as u16,
            fdi: engine_output.map(|output| fdi_part(&output, self.options.residuals, sensors.step == 0)),
        };
        let mut writer = Writer::new(out);
        reply.write(&mut writer);
        writer.len()
    }
}

#[inline]
fn signals(values: &[f32; 20]) -> (NavState, Reference, f32) {
    let [
        px,
        py,
        pz,
        vx,
        vy,
        vz,
        roll,
        pitch,
        yaw,
        p,
        q,
        r,
        rx,
        ry,
        rz,
        rvx,
        rvy,
        rvz,
        reference_yaw,
        battery_voltage,
    ] = *values;
    let nav = NavState {
        position_ned: Vec3::new(px, py, pz),
        velocity_ned: Vec3::new(vx, vy, vz),
        attitude: EulerAngles { roll, pitch, yaw },
        body_rates: Vec3::new(p, q, r),
    };
    let reference = Reference {
        position_ned: Vec3::new(rx, ry, rz),
        velocity_ned: Vec3::new(rvx, rvy, rvz),
        yaw: reference_yaw,
    };
    (nav, reference, battery_voltage)
}

#[inline]
fn fdi_part(output: &FdiOutput, residuals: bool, first: bool) -> FdiPart {
    let loss = |loss: &LossEstimate| {
        let share = loss.share();
        [loss.loss, loss.low, loss.high, share[0], share[1], share[2]]
    };
    FdiPart {
        wrench_residual: output.wrench_residual,
        residuals: residuals.then_some(output.residuals.component),
        window_end: output.window_end,
        // A verdict changes at the end of a window only.
        verdicts: (first || output.window_end).then(|| Verdicts {
            codes: [output.t_test, output.network, output.sequential].map(|verdict| verdict.code() as i16),
            probability: output.sequential_probability,
            loss: [loss(&output.thrust_loss[0]), loss(&output.thrust_loss[1])],
            suspect_rotors: output.suspects.rotors as u16,
            hypothesis_count: output.suspects.hypothesis_count,
            hypotheses: output.suspects.hypotheses.map(|set| set as u16),
        }),
    }
}
