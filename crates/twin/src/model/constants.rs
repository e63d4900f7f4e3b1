//! How well the constants of a vehicle are known: intervals that an identification wrote next to the vehicle document.
//!
//! `rotortwin vehicle from-log` writes `NAME.toml` and `NAME.intervals.toml`; loading the first also loads the second,
//! and every version that is made from it keeps them as `[[constant]]`. A constant that was edited since is taken as
//! exact: whoever typed a number is assumed to know it.
//!
//! In: the file next to a vehicle. Out: [`ConstantInterval`]s, which comparison and diagnosis use as priors.

use std::path::Path;

use rotortwin_plant::error::Refusal;
use rotortwin_plant::vehicle::mismatch::Size;
use rotortwin_plant::vehicle::model::VehicleModel;
use rotortwin_scenario::ConfigError;
use rotortwin_scenario::toml_document::Document;
use serde::{Deserialize, Serialize};

/// How the description of a vehicle ends that an identification wrote.
pub const FROM_LOG: &str = "; mass and arm as entered";

/// Source of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
#[schema(as = ConstantSource)]
pub enum Source {
    /// The user said it.
    Entered,
    /// The user said how exact it is ([`super::tolerances`]).
    Stated,
    /// Estimated from the measurements of the log.
    Log,
    /// The log narrows the class default; neither alone decides.
    LogAndClass,
    /// A parameter of the autopilot, stored in the log.
    Parameter,
    /// Measured on a thrust bench, or from a datasheet; combined with the log if both determine it.
    Bench,
    /// Typical of vehicles of this size: a guess with a wide interval.
    Class,
    /// What every vehicle document of this kind assumes and no flight determines: equal rotors, the centre of mass in
    /// their middle.
    Assumed,
}

impl Source {
    /// In words, for people.
    pub fn words(self) -> &'static str {
        match self {
            Self::Entered => "entered",
            Self::Stated => "as stated",
            Self::Log => "log",
            Self::LogAndClass => "log + class default",
            Self::Parameter => "parameter in the log",
            Self::Bench => "bench",
            Self::Class => "CLASS DEFAULT",
            Self::Assumed => "assumed",
        }
    }

    /// True where a better log, or none but a bench, would give another value: the class has a say in it.
    pub fn is_guess(self) -> bool {
        matches!(self, Self::Class | Self::LogAndClass)
    }
}

/// A constant of a vehicle document with its 95 % interval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstantInterval {
    /// Key of the vehicle document (`body.mass_kg`), or a name of its own if the document has no key for it.
    pub key: String,
    /// In words.
    pub name: String,
    /// SI unit; empty for a ratio.
    pub unit: String,
    /// As the document has it.
    pub value: f64,
    /// Lower end of the 95 % interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Source.
    pub source: Source,
    /// How it was found.
    pub how: String,
    /// How to improve it; empty if not needed.
    pub better: String,
}

/// `NAME.intervals.toml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[expect(
        dead_code,
        reason = "for people: the intervals stand beside the vehicle that they belong to"
    )]
    vehicle: String,
    #[expect(dead_code, reason = "for people")]
    logs: Vec<String>,
    #[serde(default)]
    value: Vec<ConstantInterval>,
}

/// Relative difference between a document and its intervals up to which they mean the same number: documents have four digits.
const SAME: f64 = 1e-3;

impl ConstantInterval {
    /// A constant with its name and unit, known to this half width.
    pub(super) fn about(key: &str, (name, unit): (&str, &str), value: f64, half_width: f64, source: Source) -> Self {
        Self {
            key: key.to_owned(),
            name: name.to_owned(),
            unit: unit.to_owned(),
            value,
            low: value - half_width,
            high: value + half_width,
            source,
            how: String::new(),
            better: String::new(),
        }
    }

    /// Rejects an invalid interval.
    pub(super) fn check(&self) -> Result<(), Refusal> {
        let ordered = self.low <= self.value && self.value <= self.high;
        if ordered && self.low.is_finite() && self.high.is_finite() {
            return Ok(());
        }
        let (low, value, high) = (self.low, self.value, self.high);
        let reason = format!("expected finite numbers with low ≤ value ≤ high, got {low}, {value} and {high}");
        Err(Refusal::new("value", reason))
    }
}

/// The intervals next to the vehicle document at `path`, without those of constants that were edited since; none if
/// there is no file.
///
/// # Errors
/// An existing file is invalid: one sentence with file, line and key.
pub(super) fn beside(path: &Path, vehicle: &VehicleModel) -> Result<Vec<ConstantInterval>, ConfigError> {
    let path = path.with_extension("intervals.toml");
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let document = Document::read(&path)?;
    let mut values = document.parse::<File>()?.value;
    for (place, value) in values.iter().enumerate() {
        let under = format!("value[{place}]");
        value
            .check()
            .map_err(|refusal| document.refuse(refusal.under(&under)))?;
    }
    values.retain(|value| {
        written(vehicle, &value.key).is_none_or(|now| (now - value.value).abs() <= SAME * value.value.abs())
    });
    Ok(values)
}

/// Names and units of constants. The level of the thrust curve has no single number in the document.
const NAMED: [(&str, &str, &str); 10] = [
    ("body.mass_kg", "mass", "kg"),
    ("body.inertia_body_kg_m2[0]", "inertia, roll", "kg·m²"),
    ("body.inertia_body_kg_m2[1]", "inertia, pitch", "kg·m²"),
    ("body.inertia_body_kg_m2[2]", "inertia, yaw", "kg·m²"),
    ("rotors.thrust_lag_s", "lag of the thrust", "s"),
    (LEVEL, "thrust over that of the thrust curve", ""),
    ("rotors.moment_ratio_m", "torque over thrust of a rotor", "m"),
    (ARM, "arm", "m"),
    ("battery.capacity_ah", "capacity", "Ah"),
    ("battery.internal_resistance_ohm", "internal resistance", "Ω"),
];

const LEVEL: &str = "rotors.thrust_level";
const ARM: &str = "rotors.arm_m";

/// Name, unit and value of a constant; `None` if it has none.
pub(super) fn named(vehicle: &VehicleModel, key: &str) -> Option<(&'static str, &'static str, f64)> {
    let (_, name, unit) = NAMED.into_iter().find(|(one, ..)| *one == key)?;
    let value = if key == LEVEL { 1.0 } else { written(vehicle, key)? };
    Some((name, unit, value))
}

/// The constants of a vehicle with their intervals; those without one as the vehicle document has them, without a width.
pub(crate) fn with_exact(vehicle: &VehicleModel, intervals: &[ConstantInterval]) -> Vec<ConstantInterval> {
    let missing = NAMED
        .iter()
        .filter(|(key, ..)| intervals.iter().all(|known| known.key != *key))
        .filter_map(|(key, ..)| {
            let (name, unit, value) = named(vehicle, key)?;
            Some(ConstantInterval::about(key, (name, unit), value, 0.0, Source::Assumed))
        });
    intervals.iter().cloned().chain(missing).collect()
}

/// The vehicle document's value for a key; `None` if it has no single number for it.
fn written(vehicle: &VehicleModel, key: &str) -> Option<f64> {
    let (body, battery) = (&vehicle.body, &vehicle.battery);
    match key {
        "body.mass_kg" => Some(body.mass_kg),
        "body.inertia_body_kg_m2[0]" => Some(body.inertia_body_kg_m2[0]),
        "body.inertia_body_kg_m2[1]" => Some(body.inertia_body_kg_m2[1]),
        "body.inertia_body_kg_m2[2]" => Some(body.inertia_body_kg_m2[2]),
        "body.linear_drag_kg_s" => Some(body.linear_drag_kg_s),
        "rotors.thrust_lag_s" => Some(vehicle.rotors.thrust_lag_s),
        "rotors.reaction_s" => Some(vehicle.rotors.reaction_s),
        "rotors.drag_kg_s" => Some(vehicle.rotors.drag_kg_s),
        ARM => Some(Size::of(vehicle).arm_m),
        "rotors.moment_ratio_m" => vehicle.rotors.layout.placements().first().map(|p| p.moment_ratio),
        "battery.capacity_ah" => Some(battery.capacity_ah),
        "battery.internal_resistance_ohm" => Some(battery.internal_resistance_ohm),
        "battery.power_coefficient_w_per_n15" => Some(battery.power_coefficient_w_per_n15),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ModelVersion;

    const INTERVALS: &str = r#"
vehicle = "own.toml"
logs = ["a.bin"]

[[value]]
key = "body.inertia_body_kg_m2[0]"
name = "inertia, roll"
unit = "kg·m²"
value = 2.66001e-2
low = 2.0e-2
high = 3.5e-2
source = "class"
how = ""
better = ""

[[value]]
key = "rotors.thrust_lag_s"
name = "lag and delay together"
unit = "s"
value = 3.0e-2
low = 2.0e-2
high = 4.0e-2
source = "log"
how = ""
better = ""
"#;

    /// The F550 with a file of these intervals next to it.
    fn with(intervals: &str) -> Result<ModelVersion, ConfigError> {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let folder = tempfile::tempdir().unwrap();
        let vehicle = std::fs::read_to_string(config.join("vehicles/f550.toml")).unwrap();
        let blades = config.join("blades").canonicalize().unwrap();
        let vehicle = vehicle.replace("../blades", &blades.to_string_lossy());
        std::fs::write(folder.path().join("own.toml"), vehicle).unwrap();
        std::fs::write(folder.path().join("own.intervals.toml"), intervals).unwrap();
        ModelVersion::load(folder.path().join("own.toml"))
    }

    #[test]
    fn regress_intervals_beside_a_vehicle_come_with_it_and_stay_in_its_versions() {
        let version = with(INTERVALS).unwrap();
        // The lag of the F550 is 50 ms: a user who changed it from 30 ms knows it.
        let keys: Vec<&str> = version.constant.iter().map(|c| c.key.as_str()).collect();
        assert_eq!(keys, ["body.inertia_body_kg_m2[0]"]);
        let back = ModelVersion::parse("own", &version.to_toml(), Path::new("")).unwrap();
        assert_eq!(back, version);
        let plain = ModelVersion {
            constant: Vec::new(),
            ..version.clone()
        };
        assert_ne!(plain.hash(), version.hash());
    }

    #[test]
    fn regress_an_interval_that_is_none_is_refused_with_its_place() {
        let error = with(&INTERVALS.replace("low = 2.0e-2\nhigh = 3.5e-2", "low = 3.0e-2\nhigh = 3.5e-2"));
        let text = error.unwrap_err().to_string();
        assert!(
            text.contains("own.intervals.toml") && text.contains("low ≤ value ≤ high"),
            "{text}"
        );
    }
}
