//! From a scenario to what the peers of a flight are told before its first step.

use crate::run_hash::model_hash;
use rotortwin_plant::{Scenario, Simulation};
use rotortwin_wire::link::RunSetup;
use rotortwin_wire::setup::{self, Trim};

/// What the peers of a run are told before step 0. `simulation` is at its first step.
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
        fdi: setup::fdi_setup(&scenario.fdi_config(), network),
    }
}
