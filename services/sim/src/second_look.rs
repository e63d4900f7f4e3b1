//! The second look as a detector of a run: it judges the measurements after the flight, and appears under its own name.
//!
//! ```text
//!  telemetry ─▶ what was measured ─▶ FdiSession: the engine again, and the second look ─▶ a verdict per step, sizes per window
//! ```
//! The sequential detector of a run decides fast and takes each loss for a step: it gives the size that the loss had
//! when it was named, and knows neither rotors that give more thrust nor blades that drag more. The second look
//! ([`rotortwin_fdi_session::second_look`]) follows the size and weighs those, too. It is too large for a board, which
//! is why the run's engine, whose reports enter the run hash, does without; `rotortwin fdi-log` and sessions use it,
//! so both give the same verdicts on a run.

use crate::measured::Measured;
use rotortwin_fdi_session::{FdiSession, Window, words};
use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, NOT_READY};
use rotortwin_scenario::Scenario;
use rotortwin_store::analysis::severity;
use rotortwin_store::own_detector::{Detector, Seen};
use rotortwin_store::summary::Statement;

/// Its name in tables.
pub const NAME: &str = "Second look";

/// See the module.
#[derive(Debug)]
pub struct SecondLook {
    session: FdiSession,
    measured: Measured,
    said: i32,
    statement: Option<Statement>,
}

impl SecondLook {
    /// For runs of a scenario; `None`: its vehicle is none that a session takes.
    pub fn new(scenario: &Scenario) -> Option<Self> {
        Some(Self {
            session: FdiSession::new(scenario.fdi_config(), 1).ok()?,
            measured: Measured::default(),
            said: NOT_READY,
            statement: None,
        })
    }

    fn take(&mut self, window: &Window) {
        self.said = match window.obstacle {
            Some(_) => NOT_READY,
            None => window.report.sequential,
        };
        let report = &window.report;
        let wide = |values: [f32; 6]| values.map(f64::from);
        let losses = [&report.thrust_loss, &report.second_thrust_loss].map(|loss| wide(loss.values()));
        let suspects = match window.obstacle {
            Some(_) => 0,
            None => u64::from(report.suspect_rotors),
        };
        self.statement = Some(Statement {
            severity: severity(self.said, suspects, report.hypothesis_count, losses),
            text: match &window.load {
                // What is said of rotors allows for the load already.
                Some(load) if self.said == HEALTHY => format!("{}; {load}", words::verdict(window)),
                _ => words::verdict(window),
            },
        });
    }
}

impl Detector for SecondLook {
    fn name(&self) -> &str {
        NAME
    }

    fn begin(&mut self, _: usize) {
        self.measured = Measured::default();
    }

    fn step(&mut self, seen: &Seen) -> i32 {
        match self.session.feed(&self.measured.next(seen)) {
            Ok(answer) => {
                if let Some(window) = answer.windows.last() {
                    self.take(window);
                }
            }
            // A NaN sample: a gap, as in a log.
            Err(_refused) => (self.said, self.statement) = (NOT_READY, None),
        }
        self.said
    }

    fn statement(&self) -> Option<Statement> {
        self.statement.clone()
    }
}
