//! Differences between autopilots commanded over MAVLink: the numbering of their modes.

use super::super::address::Protocol;
use super::line::PilotAddress;
use std::net::{Ipv4Addr, SocketAddr};

/// One way of numbering modes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Dialect {
    /// Display name.
    pub(super) name: &'static str,
    /// In its heartbeat.
    pub(super) autopilot: u8,
    /// Mode that follows positions.
    pub(super) follow: Mode,
    /// Mode before arming; `None`: any.
    pub(super) before_arming: Option<Mode>,
    /// Mode for climbing; `None`: a command with a height.
    pub(super) climb: Option<Mode>,
    pub(super) land: Mode,
    /// It takes the battery state from the pilot's line; others get it from the plant's own link, or not at all.
    pub(super) takes_battery: bool,
}

/// Params 2 and 3 of MAV_CMD_DO_SET_MODE, and the mode in a heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Mode {
    pub(super) name: &'static str,
    pub(super) params: [u8; 2],
    pub(super) custom_mode: u32,
}

/// ArduCopter: one number.
const fn ardupilot(name: &'static str, number: u8) -> Mode {
    Mode {
        name,
        params: [number, 0],
        custom_mode: number as u32,
    }
}

/// PX4: a main mode and one below it, in the two upper bytes.
const fn px4(name: &'static str, main: u8, sub: u8) -> Mode {
    Mode {
        name,
        params: [main, sub],
        custom_mode: (main as u32) << 16 | (sub as u32) << 24,
    }
}

const ARDUPILOT: Dialect = Dialect {
    name: "ArduPilot",
    autopilot: 3,
    follow: ardupilot("GUIDED", 4),
    before_arming: Some(ardupilot("GUIDED", 4)),
    climb: None,
    land: ardupilot("LAND", 9),
    takes_battery: false,
};

const PX4: Dialect = Dialect {
    name: "PX4",
    autopilot: 12,
    follow: px4("OFFBOARD", 6, 0),
    before_arming: None,
    climb: Some(px4("AUTO.TAKEOFF", 4, 2)),
    land: px4("AUTO.LAND", 4, 6),
    takes_battery: true,
};

impl Dialect {
    /// `None`: it takes no commands over MAVLink.
    pub(super) fn of(protocol: Protocol) -> Option<Self> {
        match protocol {
            Protocol::ArduPilot => Some(ARDUPILOT),
            Protocol::Px4 => Some(PX4),
            Protocol::Betaflight => None,
        }
    }
}

/// Default command address of an autopilot: ArduPilot's first serial port, PX4's link for a companion computer. `None`: it takes no commands
/// over MAVLink.
pub fn default_address(protocol: Protocol) -> Option<PilotAddress> {
    let local = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    match protocol {
        Protocol::ArduPilot => Some(PilotAddress::Tcp(local(5760))),
        Protocol::Px4 => Some(PilotAddress::Udp(local(14540))),
        Protocol::Betaflight => None,
    }
}
