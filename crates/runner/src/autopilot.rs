//! An autopilot that is to fly: where it is waited for, and who commands it.

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

/// Who commands an autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PilotChoice {
    /// Somebody else.
    Nobody,
    /// We do, there.
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

/// An autopilot that is waited for, and what can stop the waiting.
pub enum OpenedAutopilot {
    /// ArduPilot's JSON build.
    ArduPilot(Box<Piloted<ArduPilot>>, Supervisor),
    /// PX4's simulator build.
    Px4(Box<Piloted<Px4>>, Supervisor),
    /// Betaflight's SITL build.
    Betaflight(Box<Betaflight>, Supervisor),
}

/// How long an autopilot is waited for.
#[derive(Clone, Copy, Debug)]
pub struct Waits {
    /// For its first message.
    pub join: Duration,
    /// For any later one.
    pub step: Duration,
}

/// Why an autopilot is not waited for; one sentence.
pub enum Refused {
    /// The scenario cannot be flown with it.
    Scenario(String),
    /// An argument is wrong.
    Argument(String),
    /// Its port is taken, or the like.
    Place(String),
}

impl Refused {
    /// Says it, of this scenario.
    pub fn told(self, scenario: &Path) -> Failure {
        match self {
            Self::Scenario(sentence) => Failure::Input(format!("{}: {sentence}", scenario.display())),
            Self::Argument(sentence) => Failure::Input(sentence),
            Self::Place(sentence) => Failure::Failed(sentence),
        }
    }
}

/// Whose frames they are.
pub fn autopilot_kind(protocol: Protocol) -> AutopilotKind {
    match protocol {
        Protocol::ArduPilot => AutopilotKind::ArduPilot,
        Protocol::Px4 => AutopilotKind::Px4,
        Protocol::Betaflight => AutopilotKind::Betaflight,
    }
}

/// Opens the port where an autopilot is waited for that is to fly this scenario, and finds out who commands it.
///
/// # Errors
/// The scenario cannot be flown with it, its pilot is no such autopilot's, or its port is taken.
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
                "--pilot {at}: Betaflight takes no commands over MAVLink, its sticks are held here; expected none, or no --pilot"
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
