//! From a scenario to the setup that the peers of a flight receive before its first step.

use crate::run_hash::model_hash;
use rotortwin_plant::Simulation;
use rotortwin_proto::Ground;
use rotortwin_scenario::Scenario;
use rotortwin_wire::link::RunSetup;
use rotortwin_wire::setup::{self, Trim};

/// Setup for the peers of a run, sent before step 0. `simulation` must be at its first step.
pub fn run_setup(scenario: &Scenario, simulation: &Simulation, run_id: u64) -> RunSetup {
    let trim = scenario.starts_trimmed().then(|| Trim {
        duty: simulation.hover_duty(),
        battery_voltage: simulation.truth().battery_voltage_v as f32,
    });
    let network = scenario.classifier().map(|classifier| {
        setup::network_setup(
            classifier.inputs.rotor_count,
            &classifier.network_weights(),
            classifier.inputs.self_calibrated,
        )
    });
    RunSetup {
        run_id,
        scenario: scenario.name().to_owned(),
        model_hash: model_hash(scenario),
        step_count: scenario.duration_steps(),
        controller: setup::controller_setup(&scenario.controller_config(), trim),
        fdi: setup::fdi_setup(&scenario.fdi_config(), network, ground(scenario)),
    }
}

/// The ground under the vehicle, for detectors, which only decide in the air.
pub fn ground(scenario: &Scenario) -> Option<Ground> {
    let config = scenario.simulation_config();
    let (contact, down) = (config.ground_contact.as_ref()?, config.ground_down_m?);
    let gear = config.vehicle.landing_gear.as_ref()?;
    let at = |north: f64, east: f64| contact.height(down, [north, east, 0.0]);
    let deepest = gear.feet_body_m.iter().fold(0.0, |most: f64, foot| most.max(foot[2]));
    Some(Ground {
        down_m: at(0.0, 0.0) as f32,
        slope_north: (at(1.0, 0.0) - at(0.0, 0.0)) as f32,
        slope_east: (at(0.0, 1.0) - at(0.0, 0.0)) as f32,
        // Its feet rest on the slope: their height is along the normal.
        standing_height_m: (deepest / contact.slope_deg.to_radians().cos()) as f32,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenario_network_reaches_the_fdi_engine_bit_for_bit() {
        for (name, self_calibrated) in [("reference-flight", false), ("lag-aware-reference-flight", true)] {
            let path = format!("{}/../../config/scenarios/{name}.toml", env!("CARGO_MANIFEST_DIR"));
            let scenario = Scenario::load(path).expect("a good scenario");
            let simulation = scenario.simulation(1).expect("a good scenario");
            let sent = run_setup(&scenario, &simulation, 1).fdi;
            let received = setup::fdi_config(&sent).expect("good parameters");
            let network = received.network.expect("the scenario names a classifier");
            assert_eq!(Some(network), scenario.fdi_config().network);
            assert_eq!(network.self_calibrated(), self_calibrated);
        }
    }
}
