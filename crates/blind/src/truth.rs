//! The truth of a generated log, in a file of its own that the diagnosis never gets.

use crate::error::{BlindError, Result};
use crate::flight::{FlightPlan, Nuisances};
use crate::hidden::Hidden;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The hidden effects of one log, and what a score needs in addition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Program and version.
    pub generator: String,
    /// Seed of the flight.
    pub seed: u64,
    /// Name of the vehicle.
    pub vehicle: String,
    /// Name of the flight.
    pub flight: String,
    /// s.
    pub duration_s: f64,
    /// Times Table 4.
    pub noise_scale: f64,
    /// Times the white force and torque of the generator.
    #[serde(default = "usual")]
    pub disturbance: f64,
    /// Hidden effects; empty: none.
    pub effects: Vec<Hidden>,
    /// Small deviations of all other parameters.
    pub clutter: Vec<Hidden>,
    /// Lift bias of each rotor, N.
    pub lift_biases_n: Vec<f64>,
    /// Charge at the start.
    pub state_of_charge: f64,
}

fn usual() -> f64 {
    1.0
}

impl Truth {
    /// The truth of a flown plan.
    pub fn new(plan: &FlightPlan, nuisances: &Nuisances) -> Self {
        Self {
            generator: concat!("rotortwin-blind ", env!("CARGO_PKG_VERSION")).to_owned(),
            seed: plan.seed,
            vehicle: plan.vehicle.name.clone(),
            flight: plan.script.name.clone(),
            duration_s: plan.duration,
            noise_scale: plan.noise_scale,
            disturbance: plan.disturbance,
            effects: plan.effects.clone(),
            clutter: plan.clutter.clone(),
            lift_biases_n: nuisances.lift_biases.clone(),
            state_of_charge: nuisances.state_of_charge,
        }
    }

    /// Writes the truth as JSON.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|error| BlindError::input(path.display().to_string(), error.to_string()))?;
        std::fs::write(path, text + "\n").map_err(|source| BlindError::file("writing the truth", path, source))
    }

    /// Reads it back.
    pub fn load(path: &Path) -> Result<Self> {
        let text =
            std::fs::read_to_string(path).map_err(|source| BlindError::file("reading the truth", path, source))?;
        serde_json::from_str(&text).map_err(|error| BlindError::input(path.display().to_string(), error.to_string()))
    }
}
