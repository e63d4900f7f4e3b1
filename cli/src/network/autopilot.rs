//! Autopilots listed by a server's operator.

use rotortwin_bridge::autopilot::address::{AutopilotAddress, Protocol};
use rotortwin_bridge::autopilot::pilot::PilotAddress;

/// An autopilot listed on the command line.
#[derive(Clone, Debug)]
pub struct ListedAutopilot {
    /// Name used by runs.
    pub name: String,
    /// Its address and protocol.
    pub address: AutopilotAddress,
    /// Its command address; `none`; or the protocol's default.
    pub pilot: Option<String>,
}

impl std::str::FromStr for ListedAutopilot {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Some((name, rest)) = text.split_once('=') else {
            return Err("expected NAME=ADDRESS, such as bench-1=ardupilot:127.0.0.1:9002".to_owned());
        };
        let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
        if !(1..=64).contains(&name.len()) || !name.chars().all(plain) {
            return Err(format!(
                "the name '{name}': expected 1 to 64 letters, digits, '-', '_' and '.'"
            ));
        }
        let (address, pilot) = match rest.split_once(",pilot=") {
            Some((address, pilot)) => (address, Some(pilot)),
            None => (rest, None),
        };
        let address: AutopilotAddress = address.parse()?;
        match pilot {
            None | Some("none") => {}
            Some(pilot) if address.protocol == Protocol::Betaflight => {
                return Err(format!(
                    "pilot={pilot}: Betaflight takes no commands over MAVLink; expected none, or no pilot"
                ));
            }
            Some(pilot) => {
                pilot.parse::<PilotAddress>()?;
            }
        }
        Ok(Self {
            name: name.to_owned(),
            address,
            pilot: pilot.map(str::to_owned),
        })
    }
}
