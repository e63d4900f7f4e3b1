//! Who stands on the other side of the plant, whatever carries the messages.
//!
//! [`PlantLink`] is the plant's view of its two peers; [`ControllerPeer`] and [`FdiPeer`] are what the peers do. Between them:
//!
//! * [`in_process`]: a function call;
//! * iceoryx2: shared memory between processes of one host (crate `rotortwin-links`);
//! * zenoh: TCP between hosts, with or without a router (the same crate).
//!
//! # The protocol
//! ```text
//!  peer ── Join ──▶ plant ── Setup ──▶ peer ── Ready ──▶ plant      before step 0
//!  plant ── SensorFrame k ──▶ controller ── CommandFrame k ──▶ plant, fdi
//!  plant ── SensorFrame k ──▶ fdi ── FdiReport k ──▶ plant          at most `fdi_window` steps behind
//!  plant ── Finish ──▶ both                                         however the run ends
//! ```
//! The plant waits for command k before it goes to step k+1. The FDI engine's reports feed nothing back, so it may trail by up
//! to `fdi_window` steps through a bounded queue: nothing is lost, results do not depend on how far it trails, and the loop runs
//! about twice as fast. A window of 0 waits for each report.
//!
//! # When something dies
//! Every wait has a time-out. A peer whose process ends is named at once ([`LinkError::PeerDied`]), a peer that is alive and silent
//! after the time-out ([`LinkError::PeerSilent`]); both with the last step it answered and the length of its silence.

use crate::autopilot::Identity;
use crate::frames::{CommandFrame, FdiReport, SensorFrame};
use rotortwin_proto::{ControllerSetup, FdiSetup, Role};
use std::time::Duration;

pub mod in_process;

/// The plant's view of the controller and the FDI engine of its run.
pub trait PlantLink {
    /// Waits until both peers are there, hands them their parameters and waits until both are ready.
    fn open(&mut self, setup: &RunSetup) -> Result<(), LinkError>;

    /// Sends the sensors of a step to both peers and waits for the controller's command of this step.
    ///
    /// Returns early with an error if a peer dies, is silent for too long, or answers nonsense.
    fn exchange(&mut self, sensors: &SensorFrame) -> Result<CommandFrame, LinkError>;

    /// The FDI report of the oldest step not yet taken, if it is there. Waits for it if the engine would otherwise trail
    /// by more than the window, or if `wait` is set (after the last step).
    fn next_report(&mut self, wait: bool) -> Result<Option<FdiReport>, LinkError>;

    /// What came beside the answers that were waited for, since the link was opened.
    fn strays(&self) -> Strays {
        Strays::default()
    }

    /// Who flies, as far as it has said; of use once the link was opened.
    fn controller(&self) -> Option<Identity> {
        None
    }

    /// Process id of a peer that runs under the kernel of the plant and can be seen there; of use once the link was opened.
    fn process(&self, _role: Role) -> Option<u32> {
        None
    }

    /// Tells both peers that the run is over; `failure` is the reason if it failed. Never blocks for longer than 100 ms.
    fn finish(&mut self, steps: u64, failure: Option<&str>);
}

/// What came and was not used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Strays {
    /// Commands for steps that the controller had answered before.
    pub repeated: u64,
}

/// What a controller does.
pub trait ControllerPeer {
    /// Takes the parameters of a run; a sentence if it cannot fly with them.
    fn setup(&mut self, setup: &ControllerSetup) -> Result<(), String>;

    /// The command of one step. Called once for each step, in order.
    fn step(&mut self, sensors: &SensorFrame) -> CommandFrame;

    /// What it calls itself: name and version.
    fn program(&self) -> String {
        "a controller in the process of the plant".to_owned()
    }
}

/// What an FDI engine does.
pub trait FdiPeer {
    /// Takes the parameters of a run; a sentence if it cannot work with them.
    fn setup(&mut self, setup: &FdiSetup) -> Result<(), String>;

    /// The report of one step. Called once for each step, in order.
    fn step(&mut self, sensors: &SensorFrame, command: &CommandFrame) -> FdiReport;
}

/// What the plant hands to its peers before step 0.
#[derive(Clone, Debug)]
pub struct RunSetup {
    /// Identity of this execution, never 0.
    pub run_id: u64,
    /// Name of the scenario, for messages to people.
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

/// How long to wait, and how far the FDI engine may trail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkTiming {
    /// For both peers to join and be ready.
    pub join: Duration,
    /// For the answer to one step, of a peer that is alive.
    pub step: Duration,
    /// Steps that the FDI engine may be behind; 0: its report is waited for in each step.
    pub fdi_window: u64,
    /// The FDI engine is woken once every so many steps, at most `max(fdi_window, 1)`.
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

/// Why a link gave up. Each text names the peer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LinkError {
    /// The process of a peer ended.
    #[error("the {} ({program}) died {}{}", role_name(*role), after(*last_step), silent(*silence))]
    PeerDied {
        /// Which peer.
        role: Role,
        /// Program and process id, as far as known.
        program: String,
        /// Last step that it answered.
        last_step: Option<u64>,
        /// Time since its last message.
        silence: Duration,
    },
    /// A peer is alive, or its death cannot be seen, and did not answer in time.
    #[error("the {} ({program}) did not answer {}: silent for {} ms, allowed are {} ms", role_name(*role), after(*last_step), silence.as_millis(), limit.as_millis())]
    PeerSilent {
        /// Which peer.
        role: Role,
        /// Program and process id, as far as known.
        program: String,
        /// Last step that it answered.
        last_step: Option<u64>,
        /// Time since its last message.
        silence: Duration,
        /// Time-out that ran out.
        limit: Duration,
    },
    /// A peer never came.
    #[error("the {} did not join run {run_id:016x} over {address} within {} ms", role_name(*role), limit.as_millis())]
    PeerMissing {
        /// Which peer.
        role: Role,
        /// The run it should have joined.
        run_id: u64,
        /// Where it was waited for.
        address: String,
        /// Time-out that ran out.
        limit: Duration,
    },
    /// A peer refused its parameters, or speaks another version.
    #[error("the {} refused to start: {reason}", role_name(*role))]
    Refused {
        /// Which peer.
        role: Role,
        /// Its sentence.
        reason: String,
    },
    /// A peer answered something that no correct peer answers.
    #[error("the {} answered step {step} wrongly: {reason}", role_name(*role))]
    Nonsense {
        /// Which peer.
        role: Role,
        /// Step that was answered.
        step: u64,
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
    /// This side was asked to stop while it waited; nobody is to blame.
    #[error("stopped while waiting")]
    Stopped,
    /// The transport itself failed.
    #[error("{transport}: {action} failed: {reason}")]
    Transport {
        /// "iceoryx2" or "zenoh".
        transport: &'static str,
        /// What was being done.
        action: String,
        /// The transport's own words.
        reason: String,
    },
}

/// The field's word for a role, for messages to people.
pub fn role_name(role: Role) -> &'static str {
    match role {
        Role::Plant => "plant",
        Role::Controller => "controller",
        Role::Fdi => "FDI engine",
        Role::Unspecified => "unknown peer",
    }
}

/// How long it had been silent when its end was noticed; nothing if that was at once.
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
