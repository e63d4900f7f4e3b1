//! Autopilot frames: which output drives which motor (`config/autopilots/*.toml`), and the mapping to a vehicle's rotors.

use rotortwin_plant::error::{Refusal, in_range};
use rotortwin_plant::vehicle::model::{SpinDirection, VehicleModel};
use serde::{Deserialize, Serialize};

use crate::error::ConfigError;
use crate::toml_document::Document;

/// A motor matches a rotor within this azimuth difference, degrees.
const TOLERANCE_DEG: f64 = 5.0;

/// The autopilot that the outputs belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AutopilotKind {
    /// ArduPilot Copter.
    ArduPilot,
    /// PX4.
    Px4,
    /// Betaflight.
    Betaflight,
}

impl AutopilotKind {
    /// Display name.
    pub fn name(self) -> &'static str {
        match self {
            Self::ArduPilot => "ArduPilot",
            Self::Px4 => "PX4",
            Self::Betaflight => "Betaflight",
        }
    }
}

/// A document of `config/autopilots`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AutopilotFrame {
    /// File name without extension.
    pub name: String,
    /// Human-readable text: which autopilot settings select this frame.
    pub description: String,
    /// The autopilot that the outputs belong to.
    pub autopilot: AutopilotKind,
    /// Its own name of the frame.
    pub frame: String,
    /// Range of the outputs.
    pub pulse: PulseRange,
    /// Motors, in any order.
    pub motor: Vec<Motor>,
}

/// `[pulse]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PulseRange {
    /// Motor stopped, µs.
    pub min_us: f64,
    /// Full duty, µs.
    pub max_us: f64,
}

/// `[[motor]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// From 1.
    pub channel: u32,
    /// Clockwise from the nose, seen from above, degrees.
    pub azimuth_deg: f64,
    /// Rotation sense, seen from above.
    pub spin: SpinDirection,
}

/// Built-in documents.
const BUILT_IN: [(&str, &str); 16] = [
    (
        "ardupilot-hexa-x",
        include_str!("../../../config/autopilots/ardupilot-hexa-x.toml"),
    ),
    (
        "ardupilot-hexa-plus",
        include_str!("../../../config/autopilots/ardupilot-hexa-plus.toml"),
    ),
    ("px4-hexa-x", include_str!("../../../config/autopilots/px4-hexa-x.toml")),
    (
        "betaflight-hex6x",
        include_str!("../../../config/autopilots/betaflight-hex6x.toml"),
    ),
    (
        "ardupilot-quad-x",
        include_str!("../../../config/autopilots/ardupilot-quad-x.toml"),
    ),
    (
        "ardupilot-quad-plus",
        include_str!("../../../config/autopilots/ardupilot-quad-plus.toml"),
    ),
    ("px4-quad-x", include_str!("../../../config/autopilots/px4-quad-x.toml")),
    (
        "betaflight-quadx",
        include_str!("../../../config/autopilots/betaflight-quadx.toml"),
    ),
    (
        "ardupilot-octo-x",
        include_str!("../../../config/autopilots/ardupilot-octo-x.toml"),
    ),
    (
        "ardupilot-octo-plus",
        include_str!("../../../config/autopilots/ardupilot-octo-plus.toml"),
    ),
    (
        "ardupilot-octo-cw-x",
        include_str!("../../../config/autopilots/ardupilot-octo-cw-x.toml"),
    ),
    ("px4-octo-x", include_str!("../../../config/autopilots/px4-octo-x.toml")),
    (
        "ardupilot-octaquad-x",
        include_str!("../../../config/autopilots/ardupilot-octaquad-x.toml"),
    ),
    (
        "px4-octaquad-x",
        include_str!("../../../config/autopilots/px4-octaquad-x.toml"),
    ),
    (
        "betaflight-octoflatx",
        include_str!("../../../config/autopilots/betaflight-octoflatx.toml"),
    ),
    (
        "betaflight-octoflatx-reversed",
        include_str!("../../../config/autopilots/betaflight-octoflatx-reversed.toml"),
    ),
];

impl AutopilotFrame {
    /// Reads and checks a text that errors refer to as `name`.
    ///
    /// # Errors
    /// Reports file, line and key.
    pub fn parse(name: &str, text: &str) -> Result<Self, ConfigError> {
        let document = Document::from_text(name, text)?;
        let frame: Self = document.parse()?;
        frame.check().map_err(|refusal| document.refuse(refusal))?;
        Ok(frame)
    }

    /// The frames of `config/autopilots`.
    pub fn built_in() -> Vec<Self> {
        let read = |(name, text): &(&str, &str)| Self::parse(name, text).expect("shipped documents are tested");
        BUILT_IN.iter().map(read).collect()
    }

    /// The built-in frame of an autopilot that fits a vehicle, and our rotor, from 0, of each of its channels.
    ///
    /// # Errors
    /// Explains why none fits.
    pub fn of_vehicle(autopilot: AutopilotKind, vehicle: &VehicleModel) -> Result<(Self, Vec<usize>), String> {
        let mut reasons = Vec::new();
        for frame in Self::built_in()
            .into_iter()
            .filter(|frame| frame.autopilot == autopilot)
        {
            match frame.rotors(vehicle) {
                Ok(rotors) => return Ok((frame, rotors)),
                Err(reason) => reasons.push(format!("{}: {reason}", frame.name)),
            }
        }
        Err(format!(
            "no frame of {} fits the vehicle {} ({})",
            autopilot.name(),
            vehicle.name,
            reasons.join("; ")
        ))
    }

    /// Our rotor, from 0, of each channel.
    ///
    /// # Errors
    /// Names the first motor that the vehicle lacks, or that turns the other way on it.
    pub fn rotors(&self, vehicle: &VehicleModel) -> Result<Vec<usize>, String> {
        let placements = vehicle.rotors.layout.placements();
        if placements.len() != self.motor.len() {
            return Err(format!(
                "it has {} motors, the vehicle {}",
                self.motor.len(),
                placements.len()
            ));
        }
        let mut rotors = vec![0; self.motor.len()];
        for motor in &self.motor {
            let near = |position: [f64; 3]| {
                let azimuth = position[1].atan2(position[0]).to_degrees();
                let away = (azimuth - motor.azimuth_deg).rem_euclid(360.0);
                away.min(360.0 - away) < TOLERANCE_DEG
            };
            let mut there = (0..placements.len())
                .filter(|rotor| near(placements[*rotor].position_body))
                .peekable();
            let Some(&first) = there.peek() else {
                let Motor {
                    channel, azimuth_deg, ..
                } = motor;
                return Err(format!(
                    "its motor {channel} at {azimuth_deg}° matches no rotor of the vehicle"
                ));
            };
            // Of two on one axis, that which turns as the motor does.
            let Some(rotor) = there.find(|rotor| placements[*rotor].spin == motor.spin) else {
                return Err(format!(
                    "its motor {} spins opposite to rotor {} of the vehicle",
                    motor.channel,
                    first + 1
                ));
            };
            rotors[motor.channel as usize - 1] = rotor;
        }
        Ok(rotors)
    }

    fn check(&self) -> Result<(), Refusal> {
        let pulse = &self.pulse;
        in_range("pulse.min_us", pulse.min_us, 500.0, 2000.0, "µs")?;
        in_range("pulse.max_us", pulse.max_us, pulse.min_us + 100.0, 2500.0, "µs")?;
        let count = self.motor.len();
        if !(3..=16).contains(&count) {
            return Err(Refusal::new("motor", format!("expected 3 to 16 motors, got {count}")));
        }
        let mut seen = vec![false; count];
        for (i, motor) in self.motor.iter().enumerate() {
            in_range(
                &format!("motor[{i}].azimuth_deg"),
                motor.azimuth_deg,
                -360.0,
                360.0,
                "degrees",
            )?;
            let place = (motor.channel as usize)
                .checked_sub(1)
                .and_then(|place| seen.get_mut(place));
            match place {
                Some(taken) if !*taken => *taken = true,
                _ => {
                    let reason = format!("expected each channel from 1 to {count} once, got {}", motor.channel);
                    return Err(Refusal::new(format!("motor[{i}].channel"), reason));
                }
            }
        }
        Ok(())
    }
}
