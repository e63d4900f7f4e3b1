//! The plain configuration of one flight: numbers and models, no documents.
//!
//! `rotortwin-scenario` makes one of a scenario's documents and checks them with file, line and key. What is built by hand is taken as
//! it is, but for what [`Simulation::new`](crate::Simulation::new) cannot fly.

use crate::body::environment::WindModel;
use crate::body::ground::GroundContact;
use crate::effects::{Catalogue, EffectInstance};
use crate::powertrain::blades::Blade;
use crate::powertrain::faults::FaultPlan;
use crate::sensing::faults::SensorFaultPlan;
use crate::sensing::sensors::SensorModel;
use crate::trajectory::Trajectory;
use crate::vehicle::load::LoadPlan;
use crate::vehicle::mismatch::MismatchModel;
use crate::vehicle::model::VehicleModel;

/// One flight, but for its seed.
#[derive(Debug, Clone)]
pub struct SimulationConfig {
    /// The nominal vehicle; it has been checked with its blades.
    pub vehicle: VehicleModel,
    /// Blade of every healthy rotor.
    pub nominal_blade: Blade,
    /// Length of the flight in steps of 2.5 ms.
    pub duration_steps: u64,
    /// Runge–Kutta steps per 2.5 ms, at least 1.
    pub integrator_substeps: u32,
    /// SoC at the start, fraction.
    pub state_of_charge: f64,
    /// True: rotors at hover thrust at the start; false: at rest.
    pub starts_trimmed: bool,
    /// What to follow; the flight begins at rest at its first point, or on the ground below it.
    pub trajectory: Trajectory,
    /// How far the true vehicle is from the nominal one.
    pub mismatch: MismatchModel,
    /// Noise of the sensors.
    pub sensors: SensorModel,
    /// Wind; `None` for still air.
    pub wind: Option<WindModel>,
    /// z of the ground, m, NED; `None`: none in reach.
    pub ground_down_m: Option<f64>,
    /// How the ground carries the vehicle; `None`: it does not.
    pub ground_contact: Option<GroundContact>,
    /// True: the flight begins at rest on the ground below the first point.
    pub starts_on_ground: bool,
    /// Propeller faults and failures.
    pub faults: FaultPlan,
    /// Loads dropped in flight, which the vehicle's mass includes.
    pub loads: LoadPlan,
    /// Sensor faults.
    pub sensor_faults: SensorFaultPlan,
    /// The effects that [`SimulationConfig::effects`] may name.
    pub catalogue: Catalogue,
    /// Effects that the nominal vehicle lacks.
    pub effects: Vec<EffectInstance>,
}
