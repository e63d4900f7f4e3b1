//! What the scripted autopilots of these tests share: a scenario that begins on the ground, and a small pilot with our own PID inside.

use rotortwin_bridge::autopilot::{OutputMap, Patience};
use rotortwin_flight::autopilot::{AutopilotOutcome, HandOver, fly};
use rotortwin_flight::lockstep::{FlightEnd, FlightObserver, StopReason};
use rotortwin_flight::sample::Sample;
use rotortwin_flight::setup::run_setup;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::control::Controller;
use rotortwin_flight_core::frames::{EulerAngles, Vec3};
use rotortwin_flight_core::signals::{NavState, Reference};
use rotortwin_plant::sensing::instruments::InstrumentModel;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::autopilot_frame::{AutopilotFrame, AutopilotKind};
use rotortwin_wire::autopilot::Autopilot;
use std::path::Path;
use std::time::Duration;

/// Height of the hover over the origin, m.
pub(crate) const HEIGHT_M: f64 = 1.5;

/// A hover of `duration_s` after the hand-over, from the ground, with more lines of the document.
pub(crate) fn scenario(duration_s: f64, more: &str) -> Scenario {
    let text = format!(
        "name = 'autopilot'\ndescription = 'hover'\nvehicle = '../vehicles/f550-skids.toml'\nduration_s = {duration_s:?}\n\
         [initial]\nstart = 'on-ground'\n[trajectory]\nkind = 'hover'\nposition_ned_m = [0.0, 0.0, -{HEIGHT_M:?}]\n\
         [ground]\ndown_m = 0.0\n[ground.contact]\n{more}"
    );
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/scenarios");
    Scenario::parse(&text, folder).expect("a good scenario")
}

/// Outputs of an autopilot on the vehicle of a scenario.
pub(crate) fn outputs(kind: AutopilotKind, scenario: &Scenario) -> OutputMap {
    let (frame, rotor_of_channel) = AutopilotFrame::of_vehicle(kind, scenario.vehicle()).expect("it fits");
    OutputMap {
        rotor_of_channel,
        pulse_min_us: frame.pulse.min_us,
        pulse_max_us: frame.pulse.max_us,
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

/// Looks at every sample.
#[derive(Default)]
pub(crate) struct Watch {
    /// Largest distance from the hover point, m.
    pub(crate) farthest_m: f64,
    /// Last verdict of the sequential detector.
    pub(crate) verdict: i32,
    /// Sleep once, at this step.
    pub(crate) pause: Option<(u64, Duration)>,
}

impl FlightObserver for Watch {
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        let p = sample.truth.position_ned_m;
        let away = (p[0] * p[0] + p[1] * p[1] + (p[2] + HEIGHT_M).powi(2)).sqrt();
        self.farthest_m = self.farthest_m.max(away);
        self.verdict = sample.report.sequential;
        if let Some((_, time)) = self.pause.filter(|(step, _)| *step == sample.sensors.stamp.step) {
            std::thread::sleep(time);
        }
        Ok(())
    }

    fn stop_requested(&mut self) -> Option<StopReason> {
        None
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

/// The sentence of a failed flight.
pub(crate) fn sentence(outcome: &AutopilotOutcome) -> &str {
    match &outcome.flight.end {
        FlightEnd::Failed(failure) => &failure.sentence,
        other => panic!("the flight should have failed: {other:?}"),
    }
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
