//! Autopilots of flights: where to listen for them, and who commands them.

use crate::failure::Failure;
use rotortwin_bridge::autopilot::address::{AutopilotAddress, Protocol};
use rotortwin_bridge::autopilot::ardupilot::ArduPilot;
use rotortwin_bridge::autopilot::betaflight::Betaflight;
use rotortwin_bridge::autopilot::pilot::{self, Pilot, PilotAddress, Piloted};
use rotortwin_bridge::autopilot::px4::Px4;
use rotortwin_bridge::autopilot::{OutputMap, Patience};
use rotortwin_process::Supervisor;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::autopilot_frame::{AutopilotFrame, AutopilotKind};
use std::path::Path;
use std::time::Duration;

/// Commander of an autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PilotChoice {
    /// An external program.
    Nobody,
    /// Our pilot, at this address.
    At(PilotAddress),
}

impl std::str::FromStr for PilotChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "none" => Ok(Self::Nobody),
            _ => text.parse().map(Self::At),
        }
    }
}

/// A port opened for an autopilot, with a way to stop waiting.
pub enum OpenedAutopilot {
    /// ArduPilot's JSON build.
    ArduPilot(Box<Piloted<ArduPilot>>, Supervisor),
    /// PX4's simulator build.
    Px4(Box<Piloted<Px4>>, Supervisor),
    /// Betaflight's SITL build.
    Betaflight(Box<Betaflight>, Supervisor),
}

/// Time-outs for an autopilot.
#[derive(Clone, Copy, Debug)]
pub struct Waits {
    /// For its first message.
    pub join: Duration,
    /// For any later one.
    pub step: Duration,
}

/// Why an autopilot cannot be used; the message is one sentence.
pub enum Refused {
    /// The scenario is not suitable.
    Scenario(String),
    /// An argument is invalid.
    Argument(String),
    /// Its port is in use, or the like.
    Place(String),
}

impl Refused {
    /// The error for this scenario.
    pub fn into_failure(self, scenario: &Path) -> Failure {
        match self {
            Self::Scenario(sentence) => Failure::Input(format!("{}: {sentence}", scenario.display())),
            Self::Argument(sentence) => Failure::Input(sentence),
            Self::Place(sentence) => Failure::Failed(sentence),
        }
    }
}

/// Autopilot of the output frames.
pub fn autopilot_kind(protocol: Protocol) -> AutopilotKind {
    match protocol {
        Protocol::ArduPilot => AutopilotKind::ArduPilot,
        Protocol::Px4 => AutopilotKind::Px4,
        Protocol::Betaflight => AutopilotKind::Betaflight,
    }
}

/// Opens the port for an autopilot to fly this scenario, and determines its commander.
///
/// # Errors
/// The scenario is not suitable, its pilot does not support this autopilot, or its port is in use.
pub fn open_autopilot(
    autopilot: &AutopilotAddress,
    pilot: Option<PilotChoice>,
    waits: Waits,
    scenario: &Scenario,
    seed: u64,
) -> Result<OpenedAutopilot, Refused> {
    let mut simulation = scenario
        .simulation(seed)
        .map_err(|error| Refused::Scenario(error.to_string()))?;
    simulation
        .begin_prelude()
        .map_err(|refusal| Refused::Scenario(format!("key `{}`: {}", refusal.key, refusal.reason)))?;
    let kind = autopilot_kind(autopilot.protocol);
    let (frame, rotor_of_channel) = AutopilotFrame::of_vehicle(kind, scenario.vehicle()).map_err(Refused::Scenario)?;
    let map = OutputMap {
        rotor_of_channel,
        pulse_min_us: frame.pulse.min_us,
        pulse_max_us: frame.pulse.max_us,
    };
    let supervisor =
        Supervisor::watch(false).map_err(|error| Refused::Place(format!("Ctrl-C cannot be handled: {error}")))?;
    let patience = Patience {
        join: waits.join,
        step: waits.step,
        stop: supervisor.stop_flag(),
    };
    let at = match pilot {
        Some(PilotChoice::Nobody) => None,
        Some(PilotChoice::At(at)) if autopilot.protocol == Protocol::Betaflight => {
            return Err(Refused::Argument(format!(
                "--pilot {at}: Betaflight takes no commands over MAVLink, its sticks are held by this program; expected none, or no --pilot"
            )));
        }
        Some(PilotChoice::At(at)) => Some(at),
        None => pilot::default_address(autopilot.protocol),
    };
    let commander = at
        .map(|at| Pilot::new(autopilot.protocol, at, pilot::MEET))
        .transpose()
        .map_err(Refused::Place)?;
    match autopilot.protocol {
        Protocol::ArduPilot => ArduPilot::listen(autopilot.address, map, patience)
            .map(|link| link.with_rc(autopilot.rc))
            .map(|link| OpenedAutopilot::ArduPilot(Box::new(Piloted::new(link, commander)), supervisor)),
        Protocol::Px4 => Px4::listen(autopilot.address, map, patience)
            .map(|link| OpenedAutopilot::Px4(Box::new(Piloted::new(link, commander)), supervisor)),
        Protocol::Betaflight => {
            let piloted = pilot != Some(PilotChoice::Nobody);
            Betaflight::listen(autopilot, piloted, map, patience)
                .map(|link| OpenedAutopilot::Betaflight(Box::new(link), supervisor))
        }
    }
    .map_err(Refused::Place)
}
