//! Common parts of the scripted autopilots of these tests: a scenario that starts on the ground, and an observer.

use rotortwin_flight::lockstep::{FlightObserver, StopReason};
use rotortwin_flight::sample::Sample;
use rotortwin_scenario::Scenario;
use std::path::Path;
use std::time::Duration;

/// Height of the hover over the origin, m.
pub(crate) const HEIGHT_M: f64 = 1.5;

/// A vehicle on feet.
pub(crate) const HEXAROTOR: &str = "f550-skids";

/// A hover of `duration_s` after the hand-over, from the ground, with more lines of the document.
pub(crate) fn scenario_of(vehicle: &str, duration_s: f64, more: &str) -> Scenario {
    let text = format!(
        "name = 'autopilot'\ndescription = 'hover'\nvehicle = '../vehicles/{vehicle}.toml'\nduration_s = {duration_s:?}\n\
         [initial]\nstart = 'on-ground'\n[trajectory]\nkind = 'hover'\nposition_ned_m = [0.0, 0.0, -{HEIGHT_M:?}]\n\
         [ground]\ndown_m = 0.0\n[ground.contact]\n{more}"
    );
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/scenarios");
    Scenario::parse(&text, folder).expect("a good scenario")
}

/// Observes every sample.
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
