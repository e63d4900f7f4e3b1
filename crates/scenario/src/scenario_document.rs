//! The scenario document: its keys, their defaults, and the checks that need only the vehicle.

use rotortwin_plant::body::environment::WindModel;
use rotortwin_plant::body::ground::GroundContact;
use rotortwin_plant::effects::{EffectInstance, Place, catalogue};
use rotortwin_plant::error::{Refusal, in_range};
use rotortwin_plant::powertrain::faults::FaultEntry;
use rotortwin_plant::sensing::faults::SensorFaultEntry;
use rotortwin_plant::sensing::instruments::InstrumentModel;
use rotortwin_plant::sensing::sensors::SensorModel;
use rotortwin_plant::trajectory::Trajectory;
use rotortwin_plant::vehicle::load::LoadDrop;
use rotortwin_plant::vehicle::mismatch::{MismatchModel, Size};
use rotortwin_plant::vehicle::model::VehicleModel;
use rotortwin_plant::{STEP_S, nearest_step};
use serde::{Deserialize, Serialize};

use crate::names;
use crate::settings::{ControllerSettings, FdiSettings};

/// Longest flight, s.
const MAX_DURATION_S: f64 = 86_400.0;

/// A scenario document as written, defaults filled in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenarioDocument {
    /// Display name, also used for run folders.
    pub name: String,
    /// Purpose of the flight.
    pub description: String,
    /// Path of the vehicle document, relative to the scenario document.
    pub vehicle: String,
    /// Length of the flight, s; rounded to steps of 2.5 ms.
    pub duration_s: f64,
    /// Seed of every random stream, unless overridden by the caller.
    #[serde(default = "first_seed")]
    pub seed: u64,
    /// Runge–Kutta steps per 2.5 ms.
    #[serde(default = "one")]
    pub integrator_substeps: u32,
    /// State at take-over.
    #[serde(default)]
    pub initial: Initial,
    /// Trajectory to follow.
    pub trajectory: Trajectory,
    /// Gains of the controller.
    #[serde(default)]
    pub controller: ControllerSettings,
    /// Settings of the detectors.
    #[serde(default)]
    pub fdi: FdiSettings,
    /// Deviation of the true vehicle from its document.
    #[serde(default)]
    pub mismatch: MismatchModel,
    /// Sensor noise.
    #[serde(default)]
    pub sensors: SensorModel,
    /// Instruments of a vehicle flown by an external autopilot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instruments: Option<InstrumentModel>,
    /// Wind; still air if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wind: Option<WindModel>,
    /// Ground; none in reach if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground: Option<Ground>,
    /// Paths of effect documents available to the scenario, relative to the scenario document.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effect_files: Vec<String>,
    /// Effects that the nominal vehicle lacks.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effect: Vec<EffectInstance>,
    /// Propeller faults and failures.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fault: Vec<FaultEntry>,
    /// Loads dropped in flight, which the vehicle's mass and inertia include.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub load_drop: Vec<LoadDrop>,
    /// Sensor faults.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sensor_fault: Vec<SensorFaultEntry>,
}

fn first_seed() -> u64 {
    1
}

fn one() -> u32 {
    1
}

/// `[ground]`: position of the ground. Effects depend on it; it carries a vehicle only with `[ground.contact]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ground {
    /// z of the ground below the origin, m, NED: 0 is the height of the origin.
    pub down_m: f64,
    /// Contact model; absent: a vehicle falls through.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<GroundContact>,
}

/// `[initial]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Initial {
    /// SoC at the start, fraction.
    pub state_of_charge: f64,
    /// State of the rotors.
    pub start: Start,
}

impl Default for Initial {
    fn default() -> Self {
        Self {
            state_of_charge: 0.9,
            start: Start::Trimmed,
        }
    }
}

/// Start of a flight: at rest at the first point of the trajectory, or on the ground below it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Start {
    /// Rotors at hover thrust, z integrator of the controller preset.
    Trimmed,
    /// Rotors at rest, integrators at 0: the vehicle drops before it climbs.
    MotorsOff,
    /// On the ground below the first point, rotors at rest, integrators at 0.
    OnGround,
}

impl ScenarioDocument {
    /// Length of the flight in steps.
    pub fn duration_steps(&self) -> u64 {
        nearest_step(self.duration_s)
    }

    pub(crate) fn check(&self, vehicle: &VehicleModel) -> Result<(), Refusal> {
        // It becomes a folder name.
        if !names::is_plain(&self.name) {
            let reason = format!(
                "expected a name of 1 to {} letters, digits, '-', '_' and '.' that begins with a letter or digit, got {:?}",
                names::LONGEST,
                self.name
            );
            return Err(Refusal::new("name", reason));
        }
        in_range("duration_s", self.duration_s, STEP_S, MAX_DURATION_S, "s")?;
        in_range(
            "integrator_substeps",
            f64::from(self.integrator_substeps),
            1.0,
            1000.0,
            "",
        )?;
        in_range("initial.state_of_charge", self.initial.state_of_charge, 0.01, 1.0, "")?;
        self.trajectory.check().map_err(|r| r.under("trajectory"))?;
        self.controller.check().map_err(|r| r.under("controller"))?;
        self.fdi.check().map_err(|r| r.under("fdi"))?;
        self.mismatch
            .check(Size::of(vehicle))
            .map_err(|r| r.under("mismatch"))?;
        self.sensors.check().map_err(|r| r.under("sensors"))?;
        if let Some(instruments) = &self.instruments {
            instruments.check().map_err(|r| r.under("instruments"))?;
        }
        if let Some(wind) = &self.wind {
            let drag = vehicle.body.linear_drag_kg_s + self.mismatch.magnitudes(Size::of(vehicle)).linear_drag_kg_s;
            let drag = if self.has_drag_effect() { f64::INFINITY } else { drag };
            wind.check(drag).map_err(|r| r.under("wind"))?;
        }
        if let Some(ground) = &self.ground {
            in_range("ground.down_m", ground.down_m, -10_000.0, 10_000.0, "m")?;
            if let Some(contact) = &ground.contact {
                contact.check().map_err(|r| r.under("ground.contact"))?;
            }
        }
        self.check_start()
    }

    fn contact(&self) -> Option<&GroundContact> {
        self.ground.as_ref()?.contact.as_ref()
    }

    fn check_start(&self) -> Result<(), Refusal> {
        if self.initial.start == Start::OnGround && self.contact().is_none() {
            let reason =
                "a flight that begins on the ground needs ground that carries the vehicle: give `[ground.contact]`";
            return Err(Refusal::new("initial.start", reason));
        }
        let (Some(ground), Some(contact)) = (&self.ground, self.contact()) else {
            return Ok(());
        };
        let first = self.trajectory.pose(0.0).0;
        let height = contact.height(ground.down_m, first);
        if self.initial.start != Start::OnGround && height <= 0.0 {
            let reason = format!(
                "expected a ground below the first point of the trajectory, it is {:.3} m above it",
                -height
            );
            return Err(Refusal::new("ground.down_m", reason));
        }
        Ok(())
    }

    /// True if an effect of the scenario is a drag, which some effects on the air act through.
    fn has_drag_effect(&self) -> bool {
        let on_the_air = catalogue()
            .iter()
            .filter(|declared| declared.places.contains(&Place::Wind));
        let drags: Vec<&str> = on_the_air.flat_map(|declared| declared.needs).copied().collect();
        self.effect.iter().any(|e| drags.contains(&e.effect.as_str()))
    }
}
