//! One process's end of a link between processes, independent of the transport.
//!
//! An [`Endpoint`] moves [`Packet`]s: it has one inbox, can be waited on with a time-out, and notices when another end
//! disappears. The plant's side ([`EndpointLink`]) and the peers' side ([`serve_controller`], [`serve_fdi`]) are built on it
//! once for all transports: handshake, step order, checks, time-outs, and attribution of failures.
//!
//! ```text
//!   EndpointLink: PlantLink        serve_controller        serve_fdi          this module
//!  ─────────────────────────────────────────────────────────────────────────
//!              trait Endpoint: send, wake, poll, wait, is_gone
//!  ─────────────────────────────────────────────────────────────────────────
//!           iox2::Iox2Endpoint            zenoh::ZenohEndpoint                one file per transport
//! ```
//! # Limits
//! A peer joins a run once; one that died is not replaced within the run. Clocks are read only to bound how long a peer may be
//! silent.

use crate::watch::{ProcessWatch, host_name, process_space};
use rotortwin_proto::{Finish, Join, Ready, Role, Setup, setup::Parameters};
use rotortwin_wire::PROTOCOL_VERSION;
use rotortwin_wire::autopilot::Identity;
use rotortwin_wire::convert::{self, ConvertError};
use rotortwin_wire::frames::{CommandFrame, FdiReport, SensorFrame};
use rotortwin_wire::link::{ControllerPeer, FdiPeer, LinkError, LinkTiming, PlantLink, RunSetup, Strays, role_name};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Maximum number of steps that an FDI engine may trail; determines the length of the queues between the processes.
pub const MAX_FDI_WINDOW: u64 = 256;

/// Longest sleep before the other processes' liveness is checked again.
const LIFE_CHECK: Duration = Duration::from_millis(50);

/// The news that a peer is gone may overtake its last messages: they have this long to arrive.
const LAST_WORDS: Duration = Duration::from_millis(50);

/// How long a plant that gives up before the first step still answers latecomers.
const LATECOMERS: Duration = Duration::from_millis(80);

/// A peer repeats its join request after this time without an answer.
const JOIN_PERIOD: Duration = Duration::from_millis(100);

/// All messages between processes.
#[derive(Clone, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "a box would cost an allocation per step; packets are moved one at a time, never stored in numbers"
)]
pub enum Packet {
    /// Peer to plant: join request.
    Join(Join),
    /// Plant to one peer: its parameters.
    Setup(Box<Setup>),
    /// Peer to plant: accepted or rejected.
    Ready(Ready),
    /// Plant to both peers.
    Sensors(SensorFrame),
    /// Controller to plant and FDI engine.
    Command(CommandFrame),
    /// FDI engine to plant.
    Report(FdiReport),
    /// Plant to both peers: the run is over.
    Finish(Finish),
}

/// A role as part of the name of a topic, a service or a key.
pub fn slug(role: Role) -> &'static str {
    match role {
        Role::Plant => "plant",
        Role::Controller => "controller",
        Role::Fdi => "fdi",
        Role::Unspecified => "nobody",
    }
}

/// Result of sending a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// On its way to all recipients, as far as the transport can tell.
    Complete,
    /// A recipient is missing or its queue is full.
    Partial,
}

/// One process's end of a link: an inbox, and routes to the inboxes of the others.
///
/// Packets of one kind from one sender arrive in order, once, unless [`Delivery::Partial`] was reported. The order between
/// senders is not guaranteed.
pub trait Endpoint {
    /// Role of this end.
    fn role(&self) -> Role;

    /// The run that this end belongs to.
    fn run_id(&self) -> u64;

    /// "iceoryx2" or "zenoh".
    fn transport(&self) -> &'static str;

    /// Address where the others are met, for messages.
    fn address(&self) -> String;

    /// Puts a packet into its recipients' inboxes. Their owners may stay asleep until they are woken.
    fn send(&mut self, packet: &Packet) -> Result<Delivery, LinkError>;

    /// Wakes the owner of an inbox.
    fn wake(&mut self, role: Role) -> Result<(), LinkError>;

    /// The next packet of the inbox, if there is one.
    fn poll(&mut self) -> Result<Option<Packet>, LinkError>;

    /// Why the last message of the hand-shake that came from this role was dropped instead of being returned by `poll`.
    fn dropped(&self, _role: Role) -> Option<&str> {
        None
    }

    /// Sleeps until something may have arrived, at most for this long.
    fn wait(&mut self, at_most: Duration) -> Result<(), LinkError>;

    /// True if the end of this role was connected and has disappeared.
    ///
    /// * `thorough`: may take a millisecond; used where the kernel cannot be asked about the process
    fn is_gone(&mut self, role: Role, thorough: bool) -> bool;
}

impl<E: Endpoint + ?Sized> Endpoint for Box<E> {
    fn role(&self) -> Role {
        (**self).role()
    }

    fn run_id(&self) -> u64 {
        (**self).run_id()
    }

    fn transport(&self) -> &'static str {
        (**self).transport()
    }

    fn address(&self) -> String {
        (**self).address()
    }

    fn send(&mut self, packet: &Packet) -> Result<Delivery, LinkError> {
        (**self).send(packet)
    }

    fn wake(&mut self, role: Role) -> Result<(), LinkError> {
        (**self).wake(role)
    }

    fn poll(&mut self) -> Result<Option<Packet>, LinkError> {
        (**self).poll()
    }

    fn dropped(&self, role: Role) -> Option<&str> {
        (**self).dropped(role)
    }

    fn wait(&mut self, at_most: Duration) -> Result<(), LinkError> {
        (**self).wait(at_most)
    }

    fn is_gone(&mut self, role: Role, thorough: bool) -> bool {
        (**self).is_gone(role, thorough)
    }
}

/// The only clock of this crate.
fn now() -> Instant {
    Instant::now()
}

/// How much longer a peer may be silent.
///
/// Time during which this process itself was stopped (by Ctrl-Z, together with the others) does not count.
#[derive(Clone, Copy, Debug)]
struct Patience {
    left: Duration,
    last_look: Instant,
}

impl Patience {
    fn new(limit: Duration, at: Instant) -> Self {
        Self {
            left: limit,
            last_look: at,
        }
    }

    /// Called after every sleep of at most [`LIFE_CHECK`].
    fn is_over(&mut self, at: Instant) -> bool {
        let slept = at.saturating_duration_since(self.last_look);
        self.last_look = at;
        self.left = self.left.saturating_sub(slept.min(2 * LIFE_CHECK));
        self.left.is_zero()
    }
}

/// Why a message was no answer.
#[derive(Clone, Copy, Debug)]
enum Unused {
    /// It names another run.
    Run { named: u64 },
    /// It answers a step again that was answered before.
    Step { named: u64, due: u64 },
}

impl Unused {
    fn reason(self, run_id: u64) -> String {
        match self {
            Self::Run { named } => format!("it names run {named:016x}, this is run {run_id:016x}"),
            Self::Step { named, due } => format!("it answers step {named} again, step {due} is due"),
        }
    }
}

/// Another process, as seen from here.
#[derive(Debug)]
struct Other {
    role: Role,
    /// Program, process and host, for messages.
    program: String,
    present: bool,
    ready: bool,
    watch: Option<ProcessWatch>,
    /// Its process, if observable.
    pid: Option<u32>,
    last_step: Option<u64>,
    last_heard: Instant,
    /// Its last message, if that was no answer.
    unused: Option<Unused>,
}

impl Other {
    fn unknown(role: Role) -> Self {
        Self {
            role,
            program: "not yet known".to_owned(),
            present: false,
            ready: false,
            watch: None,
            pid: None,
            last_step: None,
            last_heard: now(),
            unused: None,
        }
    }

    fn meet(&mut self, program: String, pid: u32, space: u64) {
        self.program = program;
        self.watch = ProcessWatch::open(pid, space);
        self.pid = self.watch.is_some().then_some(pid);
        self.present = true;
        self.last_heard = now();
    }

    /// True if it was connected and has disappeared.
    ///
    /// * `thorough`: also ask the kernel (a system call), not only the transport
    fn is_gone(&self, endpoint: &mut impl Endpoint, thorough: bool) -> bool {
        if !self.present {
            return false;
        }
        match &self.watch {
            Some(watch) => endpoint.is_gone(self.role, false) || (thorough && watch.has_ended()),
            None => endpoint.is_gone(self.role, thorough),
        }
    }

    fn died(&self) -> LinkError {
        LinkError::PeerDied {
            role: self.role,
            program: self.program.clone(),
            last_step: self.last_step,
            silence: self.last_heard.elapsed(),
        }
    }

    /// Why its last message was no answer.
    fn unused(&self, endpoint: &impl Endpoint) -> Option<String> {
        let dropped = || endpoint.dropped(self.role).map(str::to_owned);
        self.unused
            .map(|unused| unused.reason(endpoint.run_id()))
            .or_else(dropped)
    }

    fn silent(&self, limit: Duration, endpoint: &impl Endpoint) -> LinkError {
        LinkError::PeerSilent {
            role: self.role,
            program: self.program.clone(),
            last_step: self.last_step,
            silence: self.last_heard.elapsed(),
            limit,
            unused: self.unused(endpoint),
        }
    }
}

#[cold]
fn protocol_violation(role: Role, step: u64, reason: impl ToString) -> LinkError {
    LinkError::ProtocolViolation {
        role,
        step,
        reason: reason.to_string(),
    }
}

/// [`PlantLink`] over an [`Endpoint`].
#[derive(Debug)]
pub struct EndpointLink<E: Endpoint> {
    endpoint: E,
    timing: LinkTiming,
    setup: Option<RunSetup>,
    rotor_count: usize,
    controller: Other,
    fdi: Other,
    /// Steps sent; also the number of the next one.
    sent: u64,
    /// The command of the current step, once received.
    command: Option<CommandFrame>,
    /// Reports received; also the step of the next one.
    reported: u64,
    /// Received reports not yet taken.
    reports: VecDeque<FdiReport>,
    /// Start of the current step or wait.
    clock: Instant,
    last_life_check: Instant,
    /// Set externally to end every wait.
    stop: Option<Arc<AtomicBool>>,
    finished: bool,
    strays: Strays,
}

impl<E: Endpoint> EndpointLink<E> {
    /// The plant's side over `endpoint`. The window is clamped to [`MAX_FDI_WINDOW`], the batch to the window.
    pub fn new(endpoint: E, timing: LinkTiming) -> Self {
        let fdi_window = timing.fdi_window.min(MAX_FDI_WINDOW);
        let fdi_batch = timing.fdi_batch.clamp(1, fdi_window.max(1));
        Self {
            endpoint,
            timing: LinkTiming {
                fdi_window,
                fdi_batch,
                ..timing
            },
            setup: None,
            rotor_count: 0,
            controller: Other::unknown(Role::Controller),
            fdi: Other::unknown(Role::Fdi),
            sent: 0,
            command: None,
            reported: 0,
            reports: VecDeque::with_capacity(64),
            clock: now(),
            last_life_check: now(),
            stop: None,
            finished: false,
            strays: Strays::default(),
        }
    }

    /// Ends every wait with [`LinkError::Stopped`] within 50 ms once `stop` is set.
    #[must_use]
    pub fn with_stop(mut self, stop: Arc<AtomicBool>) -> Self {
        self.stop = Some(stop);
        self
    }

    /// The timing in force, after the clamping in [`EndpointLink::new`].
    pub fn timing(&self) -> LinkTiming {
        self.timing
    }

    /// Steps sent whose reports have not been taken yet.
    fn untaken(&self) -> u64 {
        self.sent - self.reported + self.reports.len() as u64
    }

    /// Empties the inbox until the command of the current step has arrived, or nothing is left.
    fn drain(&mut self) -> Result<(), LinkError> {
        while self.command.is_none() {
            match self.poll()? {
                Some(packet) => self.take_in(packet)?,
                None => break,
            }
        }
        Ok(())
    }

    /// The next packet; one that cannot be read is an answer to the step that was due.
    fn poll(&mut self) -> Result<Option<Packet>, LinkError> {
        self.endpoint.poll().map_err(|error| {
            error
                .at_step(Role::Controller, self.sent.saturating_sub(1))
                .at_step(Role::Fdi, self.reported)
        })
    }

    fn take_in(&mut self, packet: Packet) -> Result<(), LinkError> {
        let run_id = self.endpoint.run_id();
        match packet {
            Packet::Command(command) => {
                let Some(expected) = self.sent.checked_sub(1) else {
                    return Ok(());
                };
                let step = command.stamp.step;
                let named = command.stamp.run_id;
                if named != run_id {
                    self.controller.unused = Some(Unused::Run { named });
                    return Ok(());
                }
                if step < expected || self.controller.last_step == Some(step) {
                    self.strays.repeated += 1;
                    self.controller.unused = Some(Unused::Step {
                        named: step,
                        due: expected,
                    });
                    return Ok(());
                }
                if step > expected {
                    return Err(protocol_violation(
                        Role::Controller,
                        step,
                        format!("the plant is only at step {expected}"),
                    ));
                }
                let command = command.canonical();
                convert::check_command(&command, self.rotor_count)
                    .map_err(|error| protocol_violation(Role::Controller, step, error))?;
                self.controller.last_step = Some(step);
                self.controller.unused = None;
                self.command = Some(command);
            }
            Packet::Report(report) => {
                let step = report.stamp.step;
                let (named, due) = (report.stamp.run_id, self.reported);
                if named != run_id {
                    self.fdi.unused = Some(Unused::Run { named });
                    return Ok(());
                }
                if step < due {
                    self.fdi.unused = Some(Unused::Step { named: step, due });
                    return Ok(());
                }
                if step > self.reported {
                    return Err(protocol_violation(
                        Role::Fdi,
                        step,
                        format!("the report of step {} never arrived", self.reported),
                    ));
                }
                if step >= self.sent {
                    return Err(protocol_violation(Role::Fdi, step, "the plant has not begun this step"));
                }
                let report = report.canonical();
                convert::check_report(&report, self.rotor_count)
                    .map_err(|error| protocol_violation(Role::Fdi, step, error))?;
                self.fdi.last_step = Some(step);
                self.fdi.last_heard = self.clock;
                self.fdi.unused = None;
                self.reported += 1;
                self.reports.push_back(report);
            }
            Packet::Join(join) => self.meet(&join)?,
            Packet::Ready(ready) => {
                let (role, named) = (ready.role(), ready.run_id);
                let Some(peer) = self.peer(role) else { return Ok(()) };
                if named != run_id {
                    peer.unused = Some(Unused::Run { named });
                    return Ok(());
                }
                if !ready.refusal.is_empty() {
                    return Err(LinkError::Refused {
                        role,
                        reason: ready.refusal,
                    });
                }
                peer.ready = true;
                peer.last_heard = now();
            }
            // From another process acting as the plant.
            Packet::Setup(_) | Packet::Sensors(_) | Packet::Finish(_) => {}
        }
        Ok(())
    }

    fn peer(&mut self, role: Role) -> Option<&mut Other> {
        match role {
            Role::Controller => Some(&mut self.controller),
            Role::Fdi => Some(&mut self.fdi),
            Role::Plant | Role::Unspecified => None,
        }
    }

    /// Handles a join request, possibly repeated because the Setup has not arrived.
    fn meet(&mut self, join: &Join) -> Result<(), LinkError> {
        let role = join.role();
        if self.sent > 0 {
            return Ok(());
        }
        let (named, run_id) = (join.run_id, self.endpoint.run_id());
        let Some(setup) = self.setup.clone() else { return Ok(()) };
        let Some(peer) = self.peer(role) else { return Ok(()) };
        if named != run_id {
            peer.unused = Some(Unused::Run { named });
            return Ok(());
        }
        if peer.ready {
            return Ok(());
        }
        peer.unused = None;
        let program = format!("{}, process {} on {}", join.program, join.pid, join.host);
        if peer.present && peer.program != program {
            let reason = format!("there are two of them: {} and {program}", peer.program);
            return Err(LinkError::Refused { role, reason });
        }
        peer.meet(program, join.pid, join.process_space);
        if join.protocol_version != PROTOCOL_VERSION {
            let reason = format!(
                "it ({}) uses version {} of the protocol, the plant uses version {PROTOCOL_VERSION}",
                peer.program, join.protocol_version
            );
            return Err(LinkError::Refused { role, reason });
        }
        let parameters = if role == Role::Controller {
            Parameters::Controller(setup.controller)
        } else {
            Parameters::Fdi(setup.fdi)
        };
        let packet = Packet::Setup(Box::new(Setup {
            run_id: setup.run_id,
            role: role.into(),
            protocol_version: PROTOCOL_VERSION,
            model_hash: setup.model_hash,
            step_count: setup.step_count,
            scenario: setup.scenario,
            fdi_batch: u32::try_from(self.timing.fdi_batch).expect("cut to MAX_FDI_WINDOW"),
            plant_pid: std::process::id(),
            plant_host: host_name(),
            plant_process_space: process_space(),
            parameters: Some(parameters),
        }));
        // A partial delivery is not a failure here: the peer asks again until it has its Setup.
        self.endpoint.send(&packet)?;
        self.endpoint.wake(role)
    }

    /// Fails if a peer is dead, or a stop was requested. Asks the kernel at most once per [`LIFE_CHECK`] unless `at_once`.
    fn check_life(&mut self, at: Instant, at_once: bool) -> Result<(), LinkError> {
        let thorough = at_once || at.saturating_duration_since(self.last_life_check) >= LIFE_CHECK;
        if thorough {
            self.last_life_check = at;
        }
        if self.stop.as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed)) {
            return Err(LinkError::Stopped);
        }
        let gone = [&self.controller, &self.fdi]
            .into_iter()
            .find_map(|peer| peer.is_gone(&mut self.endpoint, thorough).then(|| peer.died()));
        let Some(died) = gone else { return Ok(()) };
        // Before the first step it may have sent a reason.
        let begin = now();
        while self.sent == 0 && begin.elapsed() < LAST_WORDS {
            while let Some(packet) = self.poll()? {
                self.take_in(packet)?;
            }
            self.endpoint.wait(LAST_WORDS / 10)?;
        }
        Err(died)
    }

    /// Peers that join while the run is being aborted would otherwise wait for their Setup.
    fn tell_latecomers(&mut self, finish: &Packet) {
        let begin = now();
        while let Some(left) = LATECOMERS.checked_sub(begin.elapsed()) {
            let told = match self.endpoint.poll() {
                Ok(Some(Packet::Join(join))) => {
                    self.endpoint.send(finish).and_then(|_| self.endpoint.wake(join.role()))
                }
                Ok(Some(_)) => Ok(()),
                Ok(None) => self.endpoint.wait(left),
                Err(error) => Err(error),
            };
            if told.is_err() {
                return;
            }
        }
    }

    /// A peer accepted nothing: dead, or its queue is full.
    #[cold]
    fn undelivered(&mut self, what: &str, step: u64) -> LinkError {
        if let Err(dead) = self.check_life(now(), true) {
            return dead;
        }
        LinkError::Transport {
            transport: self.endpoint.transport(),
            action: format!("delivering {what} of step {step}"),
            reason: "a peer is connected but no longer receives".to_owned(),
        }
    }
}

impl<E: Endpoint> PlantLink for EndpointLink<E> {
    fn open(&mut self, setup: &RunSetup) -> Result<(), LinkError> {
        if setup.run_id == 0 || setup.run_id != self.endpoint.run_id() {
            return Err(protocol_violation(
                Role::Plant,
                0,
                format!(
                    "run {:016x} was requested from a link of run {:016x}",
                    setup.run_id,
                    self.endpoint.run_id()
                ),
            ));
        }
        self.rotor_count = setup.controller.rotors.len();
        self.setup = Some(setup.clone());
        let begin = now();
        let limit = self.timing.join;
        loop {
            self.drain()?;
            if self.controller.ready && self.fdi.ready {
                let at = now();
                self.controller.last_heard = at;
                self.fdi.last_heard = at;
                return Ok(());
            }
            let waited = begin.elapsed();
            self.check_life(now(), false)?;
            if waited >= limit {
                let missing = [&self.controller, &self.fdi].into_iter().find(|peer| !peer.present);
                if let Some(peer) = missing {
                    return Err(LinkError::PeerMissing {
                        role: peer.role,
                        run_id: setup.run_id,
                        address: self.endpoint.address(),
                        limit,
                        unused: peer.unused(&self.endpoint),
                    });
                }
                let unready = if self.controller.ready {
                    &self.fdi
                } else {
                    &self.controller
                };
                return Err(unready.silent(limit, &self.endpoint));
            }
            self.endpoint.wait(LIFE_CHECK.min(limit - waited))?;
        }
    }

    fn exchange(&mut self, sensors: &SensorFrame) -> Result<CommandFrame, LinkError> {
        let step = sensors.stamp.step;
        if step != self.sent || sensors.stamp.run_id != self.endpoint.run_id() {
            return Err(protocol_violation(
                Role::Plant,
                step,
                format!("step {} of this run was due", self.sent),
            ));
        }
        let begin = now();
        self.check_life(begin, false)?;
        self.clock = begin;
        self.controller.last_heard = begin;
        if self.reported == self.sent {
            self.fdi.last_heard = begin;
        }
        self.sent += 1;
        if self.endpoint.send(&Packet::Sensors(*sensors))? == Delivery::Partial {
            return Err(self.undelivered("the sensors", step));
        }
        self.endpoint.wake(Role::Controller)?;
        let mut patience = Patience::new(self.timing.step, begin);
        let mut has_slept = false;
        loop {
            self.drain()?;
            if let Some(command) = self.command.take() {
                return Ok(command);
            }
            // The clock is read only if a sleep brought nothing.
            if has_slept {
                let at = now();
                self.check_life(at, false)?;
                if patience.is_over(at) {
                    return Err(self.controller.silent(self.timing.step, &self.endpoint));
                }
            }
            self.endpoint.wait(LIFE_CHECK.min(self.timing.step))?;
            has_slept = true;
        }
    }

    fn next_report(&mut self, wait: bool) -> Result<Option<FdiReport>, LinkError> {
        if let Some(report) = self.reports.pop_front() {
            return Ok(Some(report));
        }
        if self.untaken() == 0 {
            return Ok(None);
        }
        let must_wait = wait || self.untaken() > self.timing.fdi_window;
        let mut patience: Option<Patience> = None;
        loop {
            // Not `drain`: one report is enough, the others stay queued.
            while let Some(packet) = self.poll()? {
                self.take_in(packet)?;
                if let Some(report) = self.reports.pop_front() {
                    return Ok(Some(report));
                }
            }
            if !must_wait {
                return Ok(None);
            }
            // The first sleep starts without checking the clock or the peers' liveness.
            match &mut patience {
                None => {
                    patience = Some(Patience::new(self.timing.step, now()));
                    if wait {
                        // The last steps may not fill a batch.
                        self.endpoint.wake(Role::Fdi)?;
                    }
                }
                Some(patience) => {
                    let at = now();
                    self.clock = at;
                    let is_over = patience.is_over(at);
                    self.check_life(at, false)?;
                    if is_over {
                        return Err(self.fdi.silent(self.timing.step, &self.endpoint));
                    }
                    self.endpoint.wake(Role::Fdi)?;
                }
            }
            self.endpoint.wait(LIFE_CHECK.min(self.timing.step))?;
        }
    }

    fn strays(&self) -> Strays {
        self.strays
    }

    fn controller(&self) -> Option<Identity> {
        // Its process and host identify only this execution.
        let program = self.controller.program.split(", process ").next()?;
        self.controller.present.then(|| Identity::of_program(program))
    }

    fn process(&self, role: Role) -> Option<u32> {
        match role {
            Role::Controller => self.controller.pid,
            Role::Fdi => self.fdi.pid,
            Role::Plant | Role::Unspecified => None,
        }
    }

    fn finish(&mut self, steps: u64, failure: Option<&str>) {
        if std::mem::replace(&mut self.finished, true) {
            return;
        }
        let finish = Finish {
            run_id: self.endpoint.run_id(),
            steps,
            failure: failure.map_or_else(String::new, |failure| {
                if failure.is_empty() {
                    "the plant gave no reason".to_owned()
                } else {
                    failure.to_owned()
                }
            }),
        };
        let finish = Packet::Finish(finish);
        if let Err(error) = self.endpoint.send(&finish) {
            tracing::warn!("notifying the peers of the end of the run: {error}");
        }
        for role in [Role::Controller, Role::Fdi] {
            if let Err(error) = self.endpoint.wake(role) {
                tracing::warn!("waking the {}: {error}", role_name(role));
            }
        }
        if failure.is_some() && !(self.controller.ready && self.fdi.ready) {
            self.tell_latecomers(&finish);
        }
    }
}

/// A plant that exits silently would leave its peers waiting.
impl<E: Endpoint> Drop for EndpointLink<E> {
    fn drop(&mut self) {
        self.finish(self.sent, Some("the plant gave up before the end of the run"));
    }
}

/// Program name and time-outs of a peer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PeerOptions {
    /// Program and version, for messages, e.g. "rotortwin-controller 0.1.0".
    pub program: String,
    /// For the plant's answer and its first step.
    pub join: Duration,
    /// For the next step of a live plant. Longer than the plant's own time-out for a step, so that the plant, which knows who
    /// is at fault, reports first.
    pub idle: Duration,
}

impl PeerOptions {
    /// Options matching a plant with this timing.
    pub fn new(program: impl Into<String>, timing: &LinkTiming) -> Self {
        let margin = Duration::from_millis(500);
        Self {
            program: program.into(),
            join: timing.join + margin,
            idle: timing.step + timing.step / 2 + margin,
        }
    }
}

/// The peer's side of the protocol, before the loop.
struct Peer<'a, E: Endpoint> {
    endpoint: &'a mut E,
    options: &'a PeerOptions,
    plant: Other,
    /// The plant has sent something since the last sleep.
    heard: bool,
    /// When the plant disappeared.
    gone: Option<Instant>,
    /// Steps answered; also the number of the next one.
    steps: u64,
    patience: Patience,
    last_sleep: Instant,
    last_life_check: Instant,
}

impl<'a, E: Endpoint> Peer<'a, E> {
    fn new(endpoint: &'a mut E, options: &'a PeerOptions) -> Self {
        let plant = Other::unknown(Role::Plant);
        Self {
            endpoint,
            options,
            plant,
            heard: false,
            gone: None,
            steps: 0,
            patience: Patience::new(options.join, now()),
            last_sleep: now(),
            last_life_check: now(),
        }
    }

    /// Joins the run and passes the parameters to `accept`, which returns its result or a rejection.
    fn join(&mut self, accept: impl FnOnce(Option<&Parameters>) -> Result<(), String>) -> Result<Setup, LinkError> {
        let role = self.endpoint.role();
        let run_id = self.endpoint.run_id();
        let join = Packet::Join(Join {
            run_id,
            role: role.into(),
            protocol_version: PROTOCOL_VERSION,
            program: self.options.program.clone(),
            host: host_name(),
            pid: std::process::id(),
            process_space: process_space(),
        });
        let begin = now();
        let mut next_join = begin;
        let setup = 'answered: loop {
            let at = now();
            if at >= next_join {
                // The plant may not be there yet.
                self.endpoint.send(&join)?;
                self.endpoint.wake(Role::Plant)?;
                next_join = at + JOIN_PERIOD;
            }
            while let Some(packet) = self.endpoint.poll()? {
                match packet {
                    Packet::Setup(setup) if setup.run_id == run_id && setup.role() == role => break 'answered setup,
                    Packet::Finish(finish) if finish.run_id == run_id => return Err(ended(finish)),
                    _ => {}
                }
            }
            let waited = begin.elapsed();
            if waited >= self.options.join {
                return Err(LinkError::PeerMissing {
                    role: Role::Plant,
                    run_id,
                    address: self.endpoint.address(),
                    limit: self.options.join,
                    unused: self.plant.unused(self.endpoint),
                });
            }
            self.endpoint.wait(JOIN_PERIOD.min(self.options.join - waited))?;
        };
        let plant = format!("process {} on {}", setup.plant_pid, setup.plant_host);
        self.plant.meet(plant, setup.plant_pid, setup.plant_process_space);
        let verdict = if setup.protocol_version == PROTOCOL_VERSION {
            accept(setup.parameters.as_ref())
        } else {
            Err(format!(
                "the plant uses version {} of the protocol, the {} ({}) uses version {PROTOCOL_VERSION}",
                setup.protocol_version,
                role_name(role),
                self.options.program
            ))
        };
        let refusal = verdict.err();
        let ready = Ready {
            run_id,
            role: role.into(),
            refusal: refusal.clone().unwrap_or_default(),
        };
        self.endpoint.send(&Packet::Ready(ready))?;
        self.endpoint.wake(Role::Plant)?;
        match refusal {
            None => Ok(*setup),
            Some(reason) => Err(LinkError::Refused { role, reason }),
        }
    }

    /// The next packet, if there is one.
    fn poll(&mut self) -> Result<Option<Packet>, LinkError> {
        let packet = self.endpoint.poll().map_err(|error| {
            error
                .at_step(Role::Plant, self.steps)
                .at_step(Role::Controller, self.steps)
        })?;
        self.heard |= packet.is_some();
        Ok(packet)
    }

    /// Sleeps until something may have arrived; the inbox is empty. Fails if the plant is dead or silent for too long.
    fn wait(&mut self) -> Result<(), LinkError> {
        let before = now();
        if let Some(since) = self.gone {
            if before.saturating_duration_since(since) >= LAST_WORDS {
                return Err(self.plant.died());
            }
            return self.endpoint.wait(LAST_WORDS / 10);
        }
        let limit = if self.steps == 0 {
            self.options.join
        } else {
            self.options.idle
        };
        if std::mem::take(&mut self.heard) {
            // It arrived during the last sleep, at the earliest.
            self.plant.last_heard = self.last_sleep;
            self.patience = Patience::new(limit, before);
        }
        self.last_sleep = before;
        if self.patience.is_over(before) {
            return Err(self.plant.silent(limit, self.endpoint));
        }
        let thorough = before.saturating_duration_since(self.last_life_check) >= LIFE_CHECK;
        if thorough {
            self.last_life_check = before;
        }
        if self.plant.is_gone(self.endpoint, thorough) {
            self.gone = Some(before);
            return Ok(());
        }
        self.endpoint.wait(LIFE_CHECK)
    }

    /// Sends an answer. Incomplete delivery to peers other than the plant is the plant's concern.
    fn answer(&mut self, packet: &Packet) -> Result<(), LinkError> {
        if self.endpoint.send(packet)? == Delivery::Partial
            && self.gone.is_none()
            && self.plant.is_gone(self.endpoint, true)
        {
            self.gone = Some(now());
        }
        Ok(())
    }

    /// Whether to answer the sensors of a step or drop a repetition.
    fn is_due(&self, what: &str, frame_run: u64, step: u64, expected: u64, sender: Role) -> Result<bool, LinkError> {
        if frame_run != self.endpoint.run_id() || step < expected {
            return Ok(false);
        }
        if step > expected {
            return Err(protocol_violation(
                sender,
                step,
                format!("{what} of step {expected} never arrived"),
            ));
        }
        Ok(true)
    }
}

/// The plant's final message, as a result.
fn ended(finish: Finish) -> LinkError {
    let failure = if finish.failure.is_empty() {
        "no reason given".to_owned()
    } else {
        finish.failure
    };
    LinkError::RunFailed {
        steps: finish.steps,
        failure,
    }
}

/// Rejection of a Setup without the right parameters.
fn wrong_parameters(role: Role) -> String {
    format!("the Setup for the {} holds no parameters for it", role_name(role))
}

/// Runs a controller until the plant ends the run. Returns the number of steps if the run succeeded.
pub fn serve_controller<E: Endpoint>(
    endpoint: &mut E,
    controller: &mut impl ControllerPeer,
    options: &PeerOptions,
) -> Result<u64, LinkError> {
    let mut peer = Peer::new(endpoint, options);
    let setup = peer.join(|parameters| match parameters {
        Some(Parameters::Controller(parameters)) => controller.setup(parameters),
        _ => Err(wrong_parameters(Role::Controller)),
    })?;
    let batch = u64::from(setup.fdi_batch).max(1);
    loop {
        match peer.poll()? {
            Some(Packet::Sensors(sensors)) => {
                let step = sensors.stamp.step;
                if !peer.is_due("the sensors", sensors.stamp.run_id, step, peer.steps, Role::Plant)? {
                    continue;
                }
                let sensors = sensors.canonical();
                convert::check_sensors(&sensors).map_err(|error| protocol_violation(Role::Plant, step, error))?;
                let mut command = controller.step(&sensors);
                command.stamp = sensors.stamp;
                peer.steps += 1;
                peer.plant.last_step = Some(step);
                peer.answer(&Packet::Command(command))?;
                // The FDI engine first: on a single core it then runs while the plant waits, not instead of it.
                if peer.steps.is_multiple_of(batch) || peer.steps >= setup.step_count {
                    peer.endpoint.wake(Role::Fdi)?;
                }
                peer.endpoint.wake(Role::Plant)?;
            }
            Some(Packet::Finish(finish)) if finish.run_id == peer.endpoint.run_id() => {
                return if finish.failure.is_empty() {
                    Ok(finish.steps)
                } else {
                    Err(ended(finish))
                };
            }
            Some(_) => {}
            None => peer.wait()?,
        }
    }
}

/// Runs an FDI engine until the plant ends the run. Returns the number of steps if the run succeeded.
pub fn serve_fdi<E: Endpoint>(
    endpoint: &mut E,
    fdi: &mut impl FdiPeer,
    options: &PeerOptions,
) -> Result<u64, LinkError> {
    let mut peer = Peer::new(endpoint, options);
    let mut rotor_count = 0;
    let setup = peer.join(|parameters| match parameters {
        Some(Parameters::Fdi(parameters)) => {
            rotor_count = parameters.rotors.len();
            fdi.setup(parameters)
        }
        _ => Err(wrong_parameters(Role::Fdi)),
    })?;
    let batch = u64::from(setup.fdi_batch).max(1);
    // Sensors and commands come from different senders: whichever arrives first waits for the other.
    let mut sensors_waiting: VecDeque<SensorFrame> = VecDeque::new();
    let mut commands_waiting: VecDeque<CommandFrame> = VecDeque::new();
    let mut unannounced = 0;
    loop {
        match peer.poll()? {
            Some(Packet::Sensors(sensors)) => {
                let (step, expected) = (sensors.stamp.step, peer.steps + sensors_waiting.len() as u64);
                if !peer.is_due("the sensors", sensors.stamp.run_id, step, expected, Role::Plant)? {
                    continue;
                }
                let sensors = sensors.canonical();
                convert::check_sensors(&sensors).map_err(|error| protocol_violation(Role::Plant, step, error))?;
                sensors_waiting.push_back(sensors);
            }
            Some(Packet::Command(command)) => {
                let (step, expected) = (command.stamp.step, peer.steps + commands_waiting.len() as u64);
                if !peer.is_due("the command", command.stamp.run_id, step, expected, Role::Controller)? {
                    continue;
                }
                let command = command.canonical();
                convert::check_command(&command, rotor_count)
                    .map_err(|error| protocol_violation(Role::Controller, step, error))?;
                commands_waiting.push_back(command);
            }
            Some(Packet::Finish(finish)) if finish.run_id == peer.endpoint.run_id() => {
                return if finish.failure.is_empty() {
                    Ok(finish.steps)
                } else {
                    Err(ended(finish))
                };
            }
            Some(_) => {}
            None => {
                if unannounced > 0 {
                    unannounced = 0;
                    peer.endpoint.wake(Role::Plant)?;
                }
                peer.wait()?;
            }
        }
        while !sensors_waiting.is_empty() && !commands_waiting.is_empty() {
            let (Some(sensors), Some(command)) = (sensors_waiting.pop_front(), commands_waiting.pop_front()) else {
                break;
            };
            let mut report = fdi.step(&sensors, &command);
            report.stamp = sensors.stamp;
            peer.plant.last_step = Some(sensors.stamp.step);
            peer.steps += 1;
            peer.answer(&Packet::Report(report))?;
            unannounced += 1;
            if unannounced >= batch {
                unannounced = 0;
                peer.endpoint.wake(Role::Plant)?;
            }
        }
    }
}

/// A message that could not be decoded, attributed to its sender. `step`: the step that it names, if it could be read.
pub fn malformed(sender: Role, step: Option<u64>, error: &ConvertError) -> LinkError {
    match step {
        Some(step) => protocol_violation(sender, step, error),
        None => LinkError::Unreadable {
            role: sender,
            reason: error.to_string(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_patience_counts_only_time_lived_through() {
        let begin = now();
        let at = |millis| begin + Duration::from_millis(millis);
        let mut patience = Patience::new(Duration::from_millis(300), begin);
        assert!(!patience.is_over(at(50)));
        // Stopped for an hour: counts as one long sleep of 100 ms.
        assert!(!patience.is_over(at(3_600_000)));
        assert!(!patience.is_over(at(3_600_100)));
        assert!(patience.is_over(at(3_600_150)));
        assert!(Patience::new(Duration::ZERO, begin).is_over(begin));
    }
}
