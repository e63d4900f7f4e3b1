//! A vehicle without a scenario: the vehicle document and its blades, read and checked together.
//!
//! Used by the twin to compare with flight logs; a [`crate::Scenario`] checks the same pair with the same function.

use std::path::Path;

use rotortwin_flight_core::thrust_map::ThrustMap;
use serde::{Deserialize, Serialize};

use crate::complaints::complaints;
use crate::error::ConfigError;
use crate::names::{Kind, meant};
use crate::toml_document::Document;
use rotortwin_plant::error::Refusal;
use rotortwin_plant::powertrain::blades::{Blade, BladeSet};
use rotortwin_plant::vehicle::model::VehicleModel;

/// A vehicle and its blades.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleDocuments {
    /// The vehicle.
    pub vehicle: VehicleModel,
    /// The blades that its rotors can carry.
    pub blades: BladeSet,
}

impl VehicleDocuments {
    /// Reads and checks the vehicle document at `path` and the blade document that it names.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        Self::resolve(&Document::read(path)?, path.parent().unwrap_or(Path::new("")))
    }

    /// As [`VehicleDocuments::load`], from a text that errors refer to as "vehicle"; the blades' path is relative to
    /// `directory`.
    pub fn parse(text: &str, directory: impl AsRef<Path>) -> Result<Self, ConfigError> {
        Self::resolve(&Document::from_text("vehicle", text)?, directory.as_ref())
    }

    /// All errors of a text that [`VehicleDocuments::parse`] rejects; empty if it can fly.
    pub fn complaints(text: &str, directory: impl AsRef<Path>) -> Vec<ConfigError> {
        const GOOD: &str = include_str!("../../../config/vehicles/f550-skids.toml");
        complaints("vehicle", text, GOOD, |text| {
            Self::parse(text, directory.as_ref()).map(|_| ())
        })
    }

    fn resolve(vehicle: &Document, directory: &Path) -> Result<Self, ConfigError> {
        let model: VehicleModel = vehicle.parse()?;
        let blades_path = meant(Kind::Blades, directory, &model.rotors.blades);
        let blades = vehicle.follow("rotors.blades", &blades_path)?;
        let set: BladeSet = blades.parse()?;
        check_together(&model, vehicle, &set, &blades)?;
        Ok(Self {
            vehicle: model,
            blades: set,
        })
    }

    /// Checks documents already in memory; keys are relative to this pair, such as `vehicle.body.mass_kg`.
    pub fn check(&self) -> Result<(), Refusal> {
        self.blades.check().map_err(|r| r.under("blades"))?;
        self.vehicle.check(&self.blades).map_err(|r| r.under("vehicle"))?;
        nominal_map(&self.vehicle, &self.blades)
            .map(|_| ())
            .map_err(|r| r.under("blades"))
    }

    /// The blade of a healthy rotor.
    pub fn nominal_blade(&self) -> &Blade {
        &self.blades.blade[&self.vehicle.rotors.nominal_blade]
    }

    /// Number of rotors.
    pub fn rotor_count(&self) -> usize {
        self.vehicle.rotor_count()
    }
}

/// Reads and checks a blade document from a text that errors refer to as `name`.
pub fn parse_blades(name: &str, text: &str) -> Result<BladeSet, ConfigError> {
    let document = Document::from_text(name, text)?;
    let set: BladeSet = document.parse()?;
    set.check().map_err(|refusal| document.refuse(refusal))?;
    Ok(set)
}

/// Eq. 19 of the nominal blade; errors are relative to the blade document.
fn nominal_map(vehicle: &VehicleModel, blades: &BladeSet) -> Result<ThrustMap, Refusal> {
    let nominal = &vehicle.rotors.nominal_blade;
    let blade = blades.blade[nominal];
    ThrustMap::new(blade.coefficients.map(|a| a as f32), blade.voltage_offset_v as f32)
        .map_err(|error| Refusal::new(format!("blade.{nominal}"), error.to_string()))
}

/// Checks a vehicle and its blades; each error names the document concerned.
pub(crate) fn check_together(
    vehicle: &VehicleModel,
    vehicle_document: &Document,
    blades: &BladeSet,
    blade_document: &Document,
) -> Result<(), ConfigError> {
    blades.check().map_err(|r| blade_document.refuse(r))?;
    vehicle.check(blades).map_err(|r| vehicle_document.refuse(r))?;
    nominal_map(vehicle, blades)
        .map(|_| ())
        .map_err(|r| blade_document.refuse(r))
}
