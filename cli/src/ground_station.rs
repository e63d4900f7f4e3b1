//! `fly --mavlink udp:ADDR`: a MAVLink ground station displays the flight; verdicts are sent as texts.
//!
//! Based on the plant's events during the flight: telemetry samples and changes, over any link.

use rotortwin_bridge::mavlink::broadcast::{Broadcast, Shown};
use rotortwin_plant::sensing::home::Home;
use rotortwin_scenario::Scenario;
use rotortwin_store::telemetry::telemetry_columns;
use rotortwin_wire::events::{Change, LiveSample};
use std::collections::HashMap;
use std::net::SocketAddr;

/// Default samples per second of simulated time.
pub(crate) const RATE_HZ: f64 = 25.0;
/// MAV_SEVERITY.
const CRITICAL: u8 = 2;
const WARNING: u8 = 4;
const NOTICE: u8 = 5;

/// Address of a ground station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address(SocketAddr);

impl std::str::FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refuse = |_| format!("'{text}': expected udp:IP:PORT, such as udp:127.0.0.1:14550");
        let address = text.strip_prefix("udp:").unwrap_or_default();
        address.parse().map(Self).map_err(refuse)
    }
}

/// One ground station.
pub(crate) struct GroundStation {
    broadcast: Broadcast,
    place: HashMap<String, usize>,
    rotors: usize,
    home: Home,
    charge: Option<f64>,
}

impl GroundStation {
    /// # Errors
    /// No port can be opened.
    pub(crate) fn new(at: Address, scenario: &Scenario) -> Result<Self, String> {
        let rotors = scenario.vehicle().rotor_count();
        let columns = telemetry_columns(rotors);
        let names = columns.iter().enumerate().map(|(i, column)| (column.name.clone(), i));
        let home = scenario
            .document()
            .instruments
            .as_ref()
            .map_or_else(Home::default, |instruments| instruments.home);
        Ok(Self {
            broadcast: Broadcast::new(at.0, rotors)?,
            place: names.collect(),
            rotors,
            home,
            charge: None,
        })
    }

    /// Stores the charge, which no sensor measures.
    pub(crate) fn charge(&mut self, charge: f64) {
        self.charge = Some(charge);
    }

    /// A row of the telemetry: the sensed values.
    pub(crate) fn sample(&mut self, sample: &LiveSample) {
        let value = |name: &str| {
            let place = self.place.get(name)?;
            sample.values.get(*place).copied().flatten()
        };
        let three = |names: [&str; 3]| names.map(|name| value(name).unwrap_or(0.0));
        let position = three(["position_north_m", "position_east_m", "position_down_m"]);
        let shown = Shown {
            time_s: sample.sim_time_s,
            position_ned_m: position,
            geodetic: self.home.geodetic(position),
            velocity_ned_m_s: three(["velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"]),
            attitude_rad: three(["roll_rad", "pitch_rad", "yaw_rad"]),
            body_rates_rad_s: three(["roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"]),
            duty: (1..=self.rotors)
                .map(|rotor| value(&format!("duty_{rotor}")).unwrap_or(0.0))
                .collect(),
            battery_voltage_v: value("battery_voltage_v").unwrap_or(0.0),
            battery_current_a: value("battery_current_a").unwrap_or(0.0),
            state_of_charge: self.charge,
        };
        self.broadcast.show(&shown);
    }

    /// A line about a change.
    pub(crate) fn change(&mut self, change: &Change, line: &str) {
        let severity = match change {
            Change::Verdict { sequential: 0 | -2, .. } | Change::HandOver { .. } => NOTICE,
            Change::Verdict { .. } | Change::Ground { .. } => CRITICAL,
            Change::Truth { .. } | Change::Load { .. } | Change::Words { .. } | Change::Severity { .. } => WARNING,
        };
        let words = line.split_whitespace().collect::<Vec<_>>().join(" ");
        self.broadcast.say(severity, &words);
    }
}
