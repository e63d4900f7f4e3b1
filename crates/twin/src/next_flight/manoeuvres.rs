//! The manoeuvres: short flights that the simulator's controller follows within the vehicle's limits, each good for something else.

use rotortwin_plant::effects::{EffectInstance, Requirement, catalogue};
use rotortwin_scenario::Scenario;
use rotortwin_scenario::scenario::Documents;
use rotortwin_scenario::scenario_document::{Ground, ScenarioDocument};
use serde::Serialize;

use crate::model::ModelVersion;

/// A manoeuvre.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Manoeuvre {
    /// Key.
    pub name: &'static str,
    /// In words.
    pub description: &'static str,
    /// s, at most 30.
    pub duration_s: f64,
    /// `[trajectory]` and the other keys that the scenario needs.
    #[serde(skip)]
    pub document: &'static str,
}

/// All of them, gentle ones first.
pub const MANOEUVRES: &[Manoeuvre] = &[
    Manoeuvre {
        name: "hover",
        description: "hover on the spot",
        duration_s: 20.0,
        document: "[trajectory]\nkind = \"hover\"\nposition_ned_m = [0.0, 0.0, -5.0]\n",
    },
    Manoeuvre {
        name: "slow-circle",
        description: "circle of 3 m at 1.6 m/s, turning the nose",
        duration_s: 30.0,
        document: "[trajectory]\nkind = \"helix\"\nradius_m = 3.0\nturn_s = 12.0\nstart_height_m = 5.0\nclimb_amplitude_m = 0.5\n\
                   climb_period_s = 15.0\nyaw_amplitude_rad = 1.5\nyaw_period_s = 15.0\n",
    },
    Manoeuvre {
        name: "fast-circle",
        description: "circle of 5 m at 5.2 m/s",
        duration_s: 30.0,
        document: "[trajectory]\nkind = \"helix\"\nradius_m = 5.0\nturn_s = 6.0\nstart_height_m = 5.0\nclimb_amplitude_m = 0.5\n\
                   climb_period_s = 10.0\nyaw_amplitude_rad = 0.5\nyaw_period_s = 8.0\n",
    },
    Manoeuvre {
        name: "yaw-sweeps",
        description: "yaw to and fro by 1 rad every 3 s, on the spot",
        duration_s: 25.0,
        document: "[trajectory]\nkind = \"helix\"\nradius_m = 0.0\nturn_s = 10.0\nstart_height_m = 5.0\nclimb_amplitude_m = 0.3\n\
                   climb_period_s = 8.0\nyaw_amplitude_rad = 1.0\nyaw_period_s = 3.0\n",
    },
    Manoeuvre {
        name: "climbs",
        description: "climbs and descents at up to 2.6 m/s",
        duration_s: 30.0,
        document: "[trajectory]\nkind = \"helix\"\nradius_m = 0.0\nturn_s = 10.0\nstart_height_m = 3.0\nclimb_amplitude_m = 2.5\n\
                   climb_period_s = 6.0\nyaw_amplitude_rad = 0.3\nyaw_period_s = 5.0\n",
    },
    Manoeuvre {
        name: "speed-runs",
        description: "legs at 6 m/s with hard stops, at two heights",
        duration_s: 30.0,
        document: "[trajectory]\nkind = \"waypoints\"\npoints_ned_m = [[0.0, 0.0, -5.0], [20.0, 0.0, -5.0], [20.0, 20.0, -7.0], [0.0, 20.0, -7.0], \
                   [0.0, 0.0, -5.0], [20.0, 20.0, -5.0], [0.0, 0.0, -8.0]]\ninterval_s = 4.8\nspeed_m_s = 6.0\n",
    },
    Manoeuvre {
        name: "mixed-speeds",
        description: "legs of different length at 3 m/s: many starts and stops in all directions",
        duration_s: 30.0,
        document: "[trajectory]\nkind = \"waypoints\"\npoints_ned_m = [[0.0, 0.0, -5.0], [4.0, 0.0, -5.0], [4.0, 5.0, -6.5], [0.0, 1.0, -6.5], \
                   [-2.0, -4.0, -4.5], [3.0, -3.0, -4.5], [0.0, 2.0, -7.0], [-4.0, 0.0, -6.0], [0.0, 0.0, -4.0], [3.0, 3.0, -6.0], [-1.0, 0.0, -5.0], [2.0, -3.0, -5.0]]\n\
                   interval_s = 2.5\nspeed_m_s = 3.0\n",
    },
    Manoeuvre {
        name: "punches",
        description: "vertical punches: reference jumps of 5 m/s up and down",
        duration_s: 30.0,
        document: "[trajectory]\nkind = \"waypoints\"\npoints_ned_m = [[0.0, 0.0, -5.0], [0.0, 0.0, -9.0], [1.0, 0.0, -5.5], [1.0, 1.0, -10.0], \
                   [0.0, 1.0, -6.0], [0.0, 0.0, -11.0], [0.0, 1.0, -6.5], [1.0, 0.0, -11.0], [0.0, 0.0, -7.0], [0.0, 0.0, -11.0]]\n\
                   interval_s = 3.0\nspeed_m_s = 5.0\n",
    },
    Manoeuvre {
        name: "two-heights",
        description: "hover at 3 m and passes at 0.25 m to 0.6 m over the ground",
        duration_s: 30.0,
        document: "[ground]\ndown_m = 0.0\n[trajectory]\nkind = \"waypoints\"\npoints_ned_m = [[0.0, 0.0, -3.0], [0.0, 0.0, -0.3], [1.5, 0.0, -0.25], [0.0, 0.0, -0.6], \
                   [0.0, 0.0, -3.0], [1.0, 0.0, -0.3], [0.0, 0.0, -0.4], [0.0, 0.0, -2.0]]\ninterval_s = 3.8\nspeed_m_s = 1.0\n",
    },
    Manoeuvre {
        name: "tight-circle",
        description: "circle of 0.8 m in 2.4 s with yaw sweeps: roll, pitch and yaw rates together",
        duration_s: 30.0,
        document: "[trajectory]\nkind = \"helix\"\nradius_m = 0.8\nturn_s = 2.4\nstart_height_m = 5.0\nclimb_amplitude_m = 0.8\n\
                   climb_period_s = 5.0\nyaw_amplitude_rad = 1.2\nyaw_period_s = 3.1\n",
    },
    Manoeuvre {
        name: "climbing-turns",
        description: "circle of 4 m at 3.6 m/s with climbs and descents of 2 m/s and yaw sweeps",
        duration_s: 30.0,
        document: "[trajectory]\nkind = \"helix\"\nradius_m = 4.0\nturn_s = 7.0\nstart_height_m = 4.0\nclimb_amplitude_m = 2.0\n\
                   climb_period_s = 6.3\nyaw_amplitude_rad = 1.2\nyaw_period_s = 4.1\n",
    },
];

/// The scenario of a manoeuvre, without a ground, which only a scenario with a ground effect may have. `vehicle` is the path of a vehicle file as the scenario will see it; readings have the noise of
/// Table 4, the voltage 10 mV, and the rotors their ordinary biases.
pub fn scenario_text(manoeuvre: &Manoeuvre, vehicle: &str, seed: u64) -> String {
    format!(
        "# Written by `rotortwin next-flight`.\nname = \"{}\"\ndescription = \"{}\"\nvehicle = {}\nduration_s = {:?}\nseed = {seed}\n\n\
         [mismatch]\npreset = \"paper\"\nbattery_voltage_noise_v = 0.01\n\n{}",
        manoeuvre.name,
        manoeuvre.description,
        toml::Value::String(vehicle.to_owned()),
        manoeuvre.duration_s,
        manoeuvre.document.replace(
            "[ground]\ndown_m = 0.0\n",
            "# With a ground effect: [ground] down_m = 0.0\n"
        )
    )
}

impl Manoeuvre {
    /// The manoeuvre flown by a model, with `hidden` effects in the plant that are not in the model.
    ///
    /// # Errors
    /// One sentence: the vehicle cannot fly it, or an effect cannot act on it.
    pub fn scenario(&self, model: &ModelVersion, hidden: &[EffectInstance], seed: u64) -> Result<Scenario, String> {
        let text = scenario_text(self, "vehicle.toml", seed);
        let mut scenario: ScenarioDocument =
            toml::from_str(&text).map_err(|error| format!("{}: {}", self.name, error.message()))?;
        scenario.ground = self.ground_down_m().map(|down_m| Ground { down_m, contact: None });
        scenario.effect.extend(model.instances());
        scenario.effect.extend(hidden.iter().cloned());
        // A ground that nothing feels is refused.
        if !scenario.effect.iter().any(|e| feels_the_ground(&e.effect)) {
            scenario.ground = None;
        }
        let documents = Documents {
            scenario,
            vehicle: model.vehicle.clone(),
            blades: model.blades.clone(),
            classifier: None,
            effects: Vec::new(),
            fdi_vehicle: None,
        };
        Scenario::from_documents(&documents).map_err(|error| format!("{}: {error}", self.name))
    }

    /// z of the ground where the manoeuvre has one, m, NED.
    pub fn ground_down_m(&self) -> Option<f64> {
        self.document.contains("[ground]").then_some(0.0)
    }
}

/// True for an effect of the ground.
pub(crate) fn feels_the_ground(effect: &str) -> bool {
    let declared = catalogue().iter().find(|entry| entry.id == effect);
    declared.is_some_and(|entry| entry.search.requires.contains(&Requirement::HeightAboveGround))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn val_every_manoeuvre_is_a_scenario_of_at_most_30_s() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
        let model = ModelVersion::load(&path).unwrap();
        for manoeuvre in MANOEUVRES {
            let scenario = manoeuvre.scenario(&model, &[], 1).unwrap();
            assert!(scenario.duration_steps() <= 30 * 400, "{}", manoeuvre.name);
            let text = scenario_text(manoeuvre, &path.display().to_string(), 1);
            Scenario::parse(&text, ".").unwrap();
        }
    }
}
