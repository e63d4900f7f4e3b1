//! Autopilot addresses, as written on the command line.
//!
//! | Text | Autopilot |
//! |---|---|
//! | `ardupilot`, `ardupilot:PORT`, `ardupilot:IP:PORT`, and `@rc=US/US/…` behind each | ArduPilot's JSON backend; UDP 127.0.0.1:9002; with the pulses of a transmitter's channels from 1 on |
//! | `px4`, `px4:PORT`, `px4:IP:PORT` | PX4's simulator link; TCP 127.0.0.1:4560 |
//! | `betaflight`, `betaflight:PORT`, `betaflight:IP:PORT`, and `@SPEED` behind each | Betaflight; states to UDP 127.0.0.1:9003, at `SPEED` times the wall clock (1) |

use super::servo_packet::RcChannels;
use super::{ardupilot, px4};
use std::net::{Ipv4Addr, SocketAddr};

/// A protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// JSON backend.
    ArduPilot,
    /// MAVLink over TCP.
    Px4,
    /// UDP, paced on the wall clock.
    Betaflight,
}

impl Protocol {
    const ALL: [Self; 3] = [Self::ArduPilot, Self::Px4, Self::Betaflight];

    /// The protocol that an address starts with, if it is an autopilot address.
    pub fn of_address(text: &str) -> Option<Self> {
        let name = text.split([':', '@']).next()?;
        Self::ALL.into_iter().find(|protocol| protocol.name() == name)
    }

    /// Name in an address.
    pub fn name(self) -> &'static str {
        match self {
            Self::ArduPilot => "ardupilot",
            Self::Px4 => "px4",
            Self::Betaflight => "betaflight",
        }
    }

    fn default_address(self) -> &'static str {
        match self {
            Self::ArduPilot => ardupilot::DEFAULT_ADDRESS,
            Self::Px4 => px4::DEFAULT_ADDRESS,
            Self::Betaflight => BETAFLIGHT_ADDRESS,
        }
    }

    /// True if it waits for us in each of its steps.
    pub fn lockstep(self) -> bool {
        self != Self::Betaflight
    }
}

/// Syntax of autopilot addresses.
pub const ADDRESSES: &str = "ardupilot[:ADDR][@rc=US/US/…], px4[:ADDR] or betaflight[:ADDR][@SPEED]";
/// Default destination of Betaflight's states.
const BETAFLIGHT_ADDRESS: &str = "127.0.0.1:9003";
/// Slowest and fastest simulated time over wall clock.
const SPEEDS: std::ops::RangeInclusive<f64> = 0.05..=4.0;

/// See the module documentation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AutopilotAddress {
    /// Protocol.
    pub protocol: Protocol,
    /// Address to listen on; for Betaflight, where states are sent.
    pub address: SocketAddr,
    /// Simulated time over wall clock, where the autopilot is not in lockstep.
    pub speed: f64,
    /// The transmitter of an ArduPilot; none: empty.
    pub rc: RcChannels,
}

impl std::str::FromStr for AutopilotAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Some(protocol) = Protocol::of_address(text) else {
            return Err(format!("'{text}': expected {ADDRESSES}"));
        };
        let (place, option) = match text.split_once('@') {
            Some((place, option)) => (place, Some(option)),
            None => (text, None),
        };
        let rest = place.split_once(':').map(|(_, rest)| rest);
        let default = protocol.default_address();
        let (mut speed, mut rc) = (1.0, RcChannels::default());
        match (option, protocol) {
            (None, _) => {}
            (Some(option), Protocol::Betaflight) => speed = speed_of(text, option)?,
            (Some(option), _) => {
                let channels = option.strip_prefix("rc=").filter(|_| protocol == Protocol::ArduPilot);
                let Some(channels) = channels else {
                    let instead = match protocol {
                        Protocol::ArduPilot => "; expected @rc=US/US/…",
                        _ => "",
                    };
                    let name = protocol.name();
                    return Err(if option.parse::<f64>().is_ok() {
                        format!("'{text}': {name} is in lockstep and has no @SPEED{instead}")
                    } else {
                        format!("'{text}': {name} has no option '@{option}'{instead}")
                    });
                };
                rc = channels.parse().map_err(|sentence| format!("'{text}': {sentence}"))?;
            }
        }
        let wanted = rest.unwrap_or(default);
        let address = wanted.parse().or_else(|_| {
            wanted
                .parse()
                .map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port)))
        });
        match address {
            Ok(address) => Ok(Self {
                protocol,
                address,
                speed,
                rc,
            }),
            Err(_) => Err(format!(
                "'{text}': expected a port or IP:PORT after {0}:, such as {0}:{default}",
                protocol.name()
            )),
        }
    }
}

/// What stands behind the @ of `text`, as a speed.
fn speed_of(text: &str, option: &str) -> Result<f64, String> {
    let speed = option.parse().ok().filter(|speed| SPEEDS.contains(speed));
    speed.ok_or_else(|| {
        format!(
            "'{text}': expected {} to {} after @, simulated time over wall clock",
            SPEEDS.start(),
            SPEEDS.end()
        )
    })
}

impl std::fmt::Display for AutopilotAddress {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{}:{}", self.protocol.name(), self.address)?;
        if self.speed != 1.0 {
            write!(out, "@{}", self.speed)?;
        }
        if !self.rc.pulses_us().is_empty() {
            write!(out, "@rc={}", self.rc)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_addresses_as_people_write_them() {
        let text = |text: &str| text.parse::<AutopilotAddress>().map(|address| address.to_string());
        assert_eq!(text("ardupilot"), Ok("ardupilot:127.0.0.1:9002".to_owned()));
        assert_eq!(text("px4"), Ok("px4:127.0.0.1:4560".to_owned()));
        assert_eq!(text("px4:4570"), Ok("px4:127.0.0.1:4570".to_owned()));
        assert_eq!(text("ardupilot:0.0.0.0:9012"), Ok("ardupilot:0.0.0.0:9012".to_owned()));
        assert_eq!(
            text("px4:nowhere"),
            Err("'px4:nowhere': expected a port or IP:PORT after px4:, such as px4:127.0.0.1:4560".to_owned())
        );
        assert!(text("inav").is_err());
        assert_eq!(text("betaflight"), Ok("betaflight:127.0.0.1:9003".to_owned()));
        assert_eq!(text("betaflight@0.5"), Ok("betaflight:127.0.0.1:9003@0.5".to_owned()));
        assert_eq!(
            text("betaflight:9103@0.5"),
            Ok("betaflight:127.0.0.1:9103@0.5".to_owned())
        );
        assert_eq!(
            text("betaflight@0"),
            Err("'betaflight@0': expected 0.05 to 4 after @, simulated time over wall clock".to_owned())
        );
        assert_eq!(
            text("px4@2"),
            Err("'px4@2': px4 is in lockstep and has no @SPEED".to_owned())
        );
        assert_eq!(
            text("ardupilot@2"),
            Err("'ardupilot@2': ardupilot is in lockstep and has no @SPEED; expected @rc=US/US/…".to_owned())
        );
        for given in [
            "ardupilot:127.0.0.1:9002@rc=1500/1500/1000/1500",
            "ardupilot:127.0.0.1:9012@rc=1500",
        ] {
            assert_eq!(text(given), Ok(given.to_owned()));
        }
        assert_eq!(
            text("ardupilot@rc=1500/1500"),
            Ok("ardupilot:127.0.0.1:9002@rc=1500/1500".to_owned())
        );
        let said = text("ardupilot@rc=1500/9000").unwrap_err();
        assert!(
            said.starts_with("'ardupilot@rc=1500/9000': '1500/9000': expected the pulses of 1 to 12 channels"),
            "{said}"
        );
        assert!(text("px4@rc=1500").is_err() && text("betaflight@rc=1500").is_err());
    }
}
