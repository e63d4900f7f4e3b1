//! What the tests of this crate fly: shipped vehicles, without a scenario document.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::config::SimulationConfig;
use crate::effects::Catalogue;
use crate::nearest_step;
use crate::powertrain::blades::BladeSet;
use crate::powertrain::faults::{FaultEntry, FaultPlan};
use crate::sensing::faults::SensorFaultPlan;
use crate::sensing::sensors::SensorModel;
use crate::trajectory::Trajectory;
use crate::vehicle::load::LoadPlan;
use crate::vehicle::mismatch::{MismatchModel, MismatchPreset};
use crate::vehicle::model::VehicleModel;

fn vehicles() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles")
}

fn read<T: DeserializeOwned>(path: PathBuf) -> T {
    toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A shipped vehicle.
pub(crate) fn vehicle(name: &str) -> VehicleModel {
    read(vehicles().join(format!("{name}.toml")))
}

/// A shipped vehicle with the landing gear of the F550 on skids.
pub(crate) fn vehicle_on_skids(name: &str) -> VehicleModel {
    VehicleModel {
        landing_gear: vehicle("f550-skids").landing_gear,
        ..vehicle(name)
    }
}

/// The blades of a shipped vehicle.
pub(crate) fn blades(vehicle: &VehicleModel) -> BladeSet {
    read(vehicles().join(&vehicle.rotors.blades))
}

/// A preset of the mismatch as it is.
pub(crate) fn preset(preset: MismatchPreset) -> MismatchModel {
    MismatchModel {
        preset,
        ..MismatchModel::default()
    }
}

/// Faults of a flight of `config`.
pub(crate) fn faults(config: &SimulationConfig, entries: &[FaultEntry]) -> FaultPlan {
    let vehicle = &config.vehicle;
    let nominal = &vehicle.rotors.nominal_blade;
    FaultPlan::new(
        entries,
        vehicle.rotor_count(),
        &blades(vehicle),
        nominal,
        config.duration_steps,
    )
    .unwrap()
}

/// The F550, hovering for 5 s with the mismatch of the paper.
pub(crate) fn hover() -> SimulationConfig {
    let vehicle = vehicle("f550");
    SimulationConfig {
        nominal_blade: blades(&vehicle).blade[&vehicle.rotors.nominal_blade],
        vehicle,
        duration_steps: nearest_step(5.0),
        integrator_substeps: 1,
        state_of_charge: 0.9,
        starts_trimmed: true,
        trajectory: Trajectory::Hover {
            position_ned_m: [0.0, 0.0, -5.0],
            yaw_rad: 0.0,
        },
        mismatch: MismatchModel::default(),
        sensors: SensorModel::default(),
        wind: None,
        ground_down_m: None,
        ground_contact: None,
        starts_on_ground: false,
        faults: FaultPlan::default(),
        loads: LoadPlan::default(),
        sensor_faults: SensorFaultPlan::default(),
        catalogue: Catalogue::built_in(),
        effects: Vec::new(),
    }
}
