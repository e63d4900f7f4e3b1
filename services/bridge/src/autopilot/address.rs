//! Which autopilot is waited for, and where, as it is written on a command line.
//!
//! | Text | Autopilot |
//! |---|---|
//! | `ardupilot`, `ardupilot:PORT`, `ardupilot:IP:PORT` | ArduPilot's JSON backend; UDP 127.0.0.1:9002 |
//! | `px4`, `px4:PORT`, `px4:IP:PORT` | PX4's simulator link; TCP 127.0.0.1:4560 |

use super::{ardupilot, px4};
use std::net::{Ipv4Addr, SocketAddr};

/// A protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// JSON backend.
    ArduPilot,
    /// MAVLink over TCP.
    Px4,
}

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AutopilotAddress {
    /// What is spoken.
    pub protocol: Protocol,
    /// Where it is waited for.
    pub address: SocketAddr,
}

impl std::str::FromStr for AutopilotAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, rest) = match text.split_once(':') {
            Some((name, rest)) => (name, Some(rest)),
            None => (text, None),
        };
        let (protocol, default) = match name {
            "ardupilot" => (Protocol::ArduPilot, ardupilot::DEFAULT_ADDRESS),
            "px4" => (Protocol::Px4, px4::DEFAULT_ADDRESS),
            _ => return Err(format!("'{text}': expected ardupilot[:ADDR] or px4[:ADDR]")),
        };
        let wanted = rest.unwrap_or(default);
        let address = wanted.parse().or_else(|_| {
            wanted
                .parse()
                .map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port)))
        });
        match address {
            Ok(address) => Ok(Self { protocol, address }),
            Err(_) => Err(format!(
                "'{text}': expected a port or IP:PORT after {name}:, such as {name}:{default}"
            )),
        }
    }
}

impl std::fmt::Display for AutopilotAddress {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = match self.protocol {
            Protocol::ArduPilot => "ardupilot",
            Protocol::Px4 => "px4",
        };
        write!(out, "{name}:{}", self.address)
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
    }
}
