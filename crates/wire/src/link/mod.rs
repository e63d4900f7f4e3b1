//! The plant's link to its peers, independent of the transport.
//!
//! [`PlantLink`] is the plant's view of its two peers; [`ControllerPeer`] and [`FdiPeer`] are implemented by the peers. Between
//! them:
//!
//! * [`in_process`]: a function call;
//! * iceoryx2: shared memory between processes of one host (crate `rotortwin-links`);
//! * zenoh: TCP between hosts, with or without a router (crate `rotortwin-zenoh`).
//!
//! # The protocol
//! ```text
//!  peer ── Join ──▶ plant ── Setup ──▶ peer ── Ready ──▶ plant      before step 0
//!  plant ── SensorFrame k ──▶ controller ── CommandFrame k ──▶ plant, fdi
//!  plant ── SensorFrame k ──▶ fdi ── FdiReport k ──▶ plant          at most `fdi_window` steps behind
//!  plant ── Finish ──▶ both                                         however the run ends
//! ```
//! The plant waits for command k before it proceeds to step k+1. The FDI engine's reports are not fed back, so it may trail by up
//! to `fdi_window` steps through a bounded queue: nothing is lost, results do not depend on how far it trails, and the loop runs
//! about twice as fast. A window of 0 waits for each report.
//!
//! # When a peer dies
//! Every wait has a time-out. A peer whose process ends is reported at once ([`LinkError::PeerDied`]), one that is alive but silent
//! after the time-out ([`LinkError::PeerSilent`]); both with the last step answered and the duration of the silence.

use crate::autopilot::Identity;
use crate::frames::{CommandFrame, FdiReport, SensorFrame};
use rotortwin_proto::{ControllerSetup, FdiSetup, Role};
use std::time::Duration;

pub mod in_process;

/// The plant's view of the controller and the FDI engine of its run.
pub trait PlantLink {
    /// Waits for both peers to connect, sends their parameters and waits until both are ready.
    fn open(&mut self, setup: &RunSetup) -> Result<(), LinkError>;

    /// Sends the sensors of a step to both peers and waits for the controller's command of this step.
    ///
    /// Returns early with an error if a peer dies, is silent for too long, or violates the protocol.
    fn exchange(&mut self, sensors: &SensorFrame) -> Result<CommandFrame, LinkError>;

    /// The FDI report of the oldest step not yet taken, if available. Waits for it if the engine would otherwise trail
    /// by more than the window, or if `wait` is set (after the last step).
    fn next_report(&mut self, wait: bool) -> Result<Option<FdiReport>, LinkError>;

    /// Unexpected messages since the link was opened.
    fn strays(&self) -> Strays {
        Strays::default()
    }

    /// Identity of the controller, as far as reported; valid after the link was opened.
    fn controller(&self) -> Option<Identity> {
        None
    }

    /// Process id of a peer visible under the plant's kernel; valid after the link was opened.
    fn process(&self, _role: Role) -> Option<u32> {
        None
    }

    /// Notifies both peers of the end of the run; `failure` is the reason if it failed. Never blocks for longer than 100 ms.
    fn finish(&mut self, steps: u64, failure: Option<&str>);
}

/// Messages received but not used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Strays {
    /// Commands for steps already answered.
    pub repeated: u64,
}

/// Implementation of a controller.
pub trait ControllerPeer {
    /// Accepts the parameters of a run, or returns an error message if it cannot fly with them.
    fn setup(&mut self, setup: &ControllerSetup) -> Result<(), String>;

    /// Computes the command of one step. Called once for each step, in order.
    fn step(&mut self, sensors: &SensorFrame) -> CommandFrame;

    /// Its name and version.
    fn program(&self) -> String {
        "a controller in the process of the plant".to_owned()
    }
}

/// Implementation of an FDI engine.
pub trait FdiPeer {
    /// Accepts the parameters of a run, or returns an error message if it cannot work with them.
    fn setup(&mut self, setup: &FdiSetup) -> Result<(), String>;

    /// Computes the report of one step. Called once for each step, in order.
    fn step(&mut self, sensors: &SensorFrame, command: &CommandFrame) -> FdiReport;
}

/// Parameters sent to the peers before step 0.
#[derive(Clone, Debug)]
pub struct RunSetup {
    /// Identity of this execution, never 0.
    pub run_id: u64,
    /// Name of the scenario, for messages.
    pub scenario: String,
    /// Content hash of the vehicle model.
    pub model_hash: String,
    /// Steps of the run.
    pub step_count: u64,
    /// For the controller.
    pub controller: ControllerSetup,
    /// For the FDI engine.
    pub fdi: FdiSetup,
}

/// Time-outs, and how far the FDI engine may trail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkTiming {
    /// For both peers to join and be ready.
    pub join: Duration,
    /// For the answer of a live peer to one step.
    pub step: Duration,
    /// Steps that the FDI engine may trail; 0: wait for its report in each step.
    pub fdi_window: u64,
    /// Number of steps between wake-ups of the FDI engine, at most `max(fdi_window, 1)`.
    pub fdi_batch: u64,
}

impl Default for LinkTiming {
    fn default() -> Self {
        Self {
            join: Duration::from_secs(10),
            step: Duration::from_secs(5),
            fdi_window: 128,
            fdi_batch: 32,
        }
    }
}

/// Why a link failed. Each message names the peer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LinkError {
    /// The process of a peer ended.
    #[error("the {} ({program}) died {}{}", role_name(*role), after(*last_step), silent(*silence))]
    PeerDied {
        /// Which peer.
        role: Role,
        /// Program and process id, as far as known.
        program: String,
        /// Last step answered.
        last_step: Option<u64>,
        /// Time since its last message.
        silence: Duration,
    },
    /// A peer is alive, or its death is not observable, and did not answer in time.
    #[error("the {} ({program}) did not answer {}: silent for {} ms, allowed are {} ms{}", role_name(*role), after(*last_step), silence.as_millis(), limit.as_millis(), told(unused.as_deref()))]
    PeerSilent {
        /// Which peer.
        role: Role,
        /// Program and process id, as far as known.
        program: String,
        /// Last step answered.
        last_step: Option<u64>,
        /// Time since its last message.
        silence: Duration,
        /// Time-out that expired.
        limit: Duration,
        /// Why a message of it, received meanwhile, was not an answer.
        unused: Option<String>,
    },
    /// A peer never connected.
    #[error("the {} did not join run {run_id:016x} over {address} within {} ms{}", role_name(*role), limit.as_millis(), told(unused.as_deref()))]
    PeerMissing {
        /// Which peer.
        role: Role,
        /// The run it should have joined.
        run_id: u64,
        /// Address where it was expected.
        address: String,
        /// Time-out that expired.
        limit: Duration,
        /// Why a message of it, received meanwhile, was not a request to join.
        unused: Option<String>,
    },
    /// A peer rejected its parameters, or uses another protocol version.
    #[error("the {} refused to start: {reason}", role_name(*role))]
    Refused {
        /// Which peer.
        role: Role,
        /// Its error message.
        reason: String,
    },
    /// Protocol violation by a peer.
    #[error("the {} answered step {step} wrongly: {reason}", role_name(*role))]
    ProtocolViolation {
        /// Which peer.
        role: Role,
        /// Step that was answered.
        step: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// A message of a peer cannot be read, nor therefore its step. Whoever knows the step that was due says it:
    /// [`LinkError::at_step`].
    #[error("the {} sent a message that cannot be read: {reason}", role_name(*role))]
    Unreadable {
        /// Which peer.
        role: Role,
        /// What is wrong with it.
        reason: String,
    },
    /// The plant ended the run as failed.
    #[error("the plant ended the run after {steps} steps: {failure}")]
    RunFailed {
        /// Steps that were executed.
        steps: u64,
        /// The plant's reason.
        failure: String,
    },
    /// This side was asked to stop while waiting; nobody is at fault.
    #[error("stopped while waiting")]
    Stopped,
    /// The transport itself failed.
    #[error("{transport}: {action} failed: {reason}")]
    Transport {
        /// "iceoryx2" or "zenoh".
        transport: &'static str,
        /// Attempted action.
        action: String,
        /// The transport's error message.
        reason: String,
    },
}

impl LinkError {
    /// An unreadable message of `sender` as the wrong answer to step `due`; any other error as it is.
    #[must_use]
    pub fn at_step(self, sender: Role, due: u64) -> Self {
        match self {
            Self::Unreadable { role, reason } if role == sender => Self::ProtocolViolation {
                role,
                step: due,
                reason,
            },
            other => other,
        }
    }
}

/// The end of a sentence about silence: what came instead of an answer.
fn told(unused: Option<&str>) -> String {
    unused.map_or_else(String::new, |reason| {
        format!("; a message of it was not used: {reason}")
    })
}

/// Display name of a role.
pub fn role_name(role: Role) -> &'static str {
    match role {
        Role::Plant => "plant",
        Role::Controller => "controller",
        Role::Fdi => "FDI engine",
        Role::Unspecified => "unknown peer",
    }
}

/// How long it had been silent when its end was noticed; empty if that was immediate.
fn silent(silence: Duration) -> String {
    match silence.as_millis() {
        0 => String::new(),
        silence_ms => format!(": silent for {silence_ms} ms"),
    }
}

fn after(last_step: Option<u64>) -> String {
    match last_step {
        Some(step) => format!("after step {step}"),
        None => "before its first step".to_owned(),
    }
}
