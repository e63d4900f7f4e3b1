//! Common parts of the link tests: outputs and flights.

use super::autopilots::Watch;
use rotortwin_bridge::autopilot::OutputMap;
use rotortwin_flight::autopilot::{AutopilotOutcome, HandOver, fly};
use rotortwin_flight::setup::run_setup;
use rotortwin_plant::sensing::instruments::InstrumentModel;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::autopilot_frame::{AutopilotFrame, AutopilotKind};
use rotortwin_wire::autopilot::Autopilot;

/// Outputs of an autopilot on the vehicle of a scenario.
pub(crate) fn outputs(kind: AutopilotKind, scenario: &Scenario) -> OutputMap {
    let (frame, rotor_of_channel) = AutopilotFrame::of_vehicle(kind, scenario.vehicle()).expect("it fits");
    OutputMap {
        rotor_of_channel,
        pulse_min_us: frame.pulse.min_us,
        pulse_max_us: frame.pulse.max_us,
    }
}

/// Flies a scenario with an autopilot that is already listening.
pub(crate) fn flown(scenario: &Scenario, autopilot: &mut impl Autopilot, watch: &mut Watch) -> AutopilotOutcome {
    let mut simulation = scenario.simulation(1).expect("a good scenario");
    let setup = run_setup(scenario, &simulation, 1);
    let hand_over = HandOver {
        limit_s: 30.0,
        ..HandOver::default()
    };
    let model = InstrumentModel::default();
    fly(&mut simulation, autopilot, &setup, (&model, 1), hand_over, watch)
}
