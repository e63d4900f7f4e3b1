//! What the tests of a link share: outputs, time-outs, and a small pilot with our own PID inside of the scripted autopilot.

use super::autopilots::{HEIGHT_M, Watch};
use rotortwin_bridge::autopilot::{OutputMap, Patience};
use rotortwin_flight::autopilot::{AutopilotOutcome, HandOver, fly};
use rotortwin_flight::setup::run_setup;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::control::Controller;
use rotortwin_flight_core::frames::{EulerAngles, Vec3};
use rotortwin_flight_core::signals::{NavState, Reference};
use rotortwin_plant::sensing::instruments::InstrumentModel;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::autopilot_frame::{AutopilotFrame, AutopilotKind};
use rotortwin_wire::autopilot::Autopilot;
use std::time::Duration;

/// Outputs of an autopilot on the vehicle of a scenario.
pub(crate) fn outputs(kind: AutopilotKind, scenario: &Scenario) -> OutputMap {
    let (frame, rotor_of_channel) = AutopilotFrame::of_vehicle(kind, scenario.vehicle()).expect("it fits");
    OutputMap {
        rotor_of_channel,
        pulse_min_us: frame.pulse.min_us,
        pulse_max_us: frame.pulse.max_us,
    }
}

/// Our rotor, from 1, of each channel of ArduPilot and PX4, from their own tables of frames.
pub(crate) fn channels(scenario: &Scenario) -> &'static [usize] {
    match scenario.vehicle().rotors.layout.placements().len() {
        4 => &[1, 3, 4, 2],
        8 => &[1, 5, 2, 4, 8, 6, 7, 3],
        _ => &[2, 5, 6, 3, 1, 4],
    }
}

/// Time-outs that a test can wait for.
pub(crate) fn patience() -> Patience {
    Patience {
        join: Duration::from_secs(5),
        step: Duration::from_millis(2500),
        ..Patience::default()
    }
}

/// Flies a scenario with an autopilot that is already listened for.
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

/// The pilot and controller inside of a scripted autopilot: waits, arms, climbs at 1 m/s to the hover point, and holds.
pub(crate) struct Pilot {
    controller: Controller,
    duty: [f32; MAX_ROTORS],
    next_s: f64,
    /// Time of arming, s of its own clock.
    arms_s: f64,
}

impl Pilot {
    pub(crate) fn new(scenario: &Scenario, arms_s: f64) -> Self {
        Self {
            controller: Controller::new(scenario.controller_config()).expect("a good controller"),
            duty: [0.0; MAX_ROTORS],
            next_s: arms_s,
            arms_s,
        }
    }

    /// Duties by rotor at `time_s`; 0 before it arms.
    pub(crate) fn duties(
        &mut self,
        time_s: f64,
        position: [f64; 3],
        velocity: [f64; 3],
        attitude: [f64; 3],
        rates: [f64; 3],
    ) -> [f32; MAX_ROTORS] {
        // The controller of flight-core counts in steps of 2.5 ms.
        while time_s >= self.next_s {
            self.next_s += 0.0025;
            let single = |v: [f64; 3]| Vec3::from_array(v.map(|x| x as f32));
            let height = (0.179 + (time_s - self.arms_s)).min(HEIGHT_M);
            let nav = NavState {
                position_ned: single(position),
                velocity_ned: single(velocity),
                attitude: EulerAngles {
                    roll: attitude[0] as f32,
                    pitch: attitude[1] as f32,
                    yaw: attitude[2] as f32,
                },
                body_rates: Vec3::from_array(rates.map(|x| x as f32)),
            };
            let reference = Reference {
                position_ned: single([0.0, 0.0, -height]),
                velocity_ned: single([0.0, 0.0, if height < HEIGHT_M { -1.0 } else { 0.0 }]),
                yaw: 0.0,
            };
            self.duty = self.controller.step(&nav, &reference, 15.5).command.duty;
        }
        self.duty
    }
}
