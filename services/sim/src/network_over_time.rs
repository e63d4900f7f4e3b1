//! The improved network over time as a detector of a run: it judges the measurements after the flight, and appears
//! under its own name.
//!
//! ```text
//!  telemetry ─▶ what was measured ─▶ FdiSession with a self-calibrating classifier ─▶ evidence of each rotor ─▶ a verdict per step
//! ```
//! The method is [`rotortwin_fdi_session::evidence`]; `rotortwin fdi-log` uses the same session, so both give the same
//! verdicts on a run. The engine of a run has only one network, that of its scenario; in this way a run with the
//! paper's network shows the improved one as well.
//!
//! Limits: a run without a network is not judged automatically (`rotortwin judge RUN --classifier NAME` does it), nor
//! is one for whose vehicle no self-calibrating classifier was trained.

use crate::measured::Measured;
use rotortwin_fdi_session::FdiSession;
use rotortwin_flight::run_hash::model_hash;
use rotortwin_flight_core::fdi::verdict_code::NOT_READY;
use rotortwin_scenario::names::{Kind, list};
use rotortwin_scenario::{Classifier, ConfigError, Scenario};
use rotortwin_store::own_detector::{Detector, Seen};

/// Its name in tables.
pub const NAME: &str = "improved network over time";

/// See the module.
#[derive(Debug)]
pub struct NetworkOverTime {
    session: FdiSession,
    measured: Measured,
    said: i32,
}

impl NetworkOverTime {
    /// For runs of a scenario, with a classifier that calibrates itself.
    ///
    /// # Errors
    /// One sentence: the classifier is another kind, or does not fit the vehicle.
    pub fn new(scenario: &Scenario, classifier: Classifier) -> Result<Self, String> {
        if !classifier.inputs.self_calibrated {
            return Err(format!(
                "the classifier '{}' does not calibrate itself; expected one of `rotortwin train --method improved`, such as f550-improved",
                classifier.name
            ));
        }
        let with_network = with_network(scenario, classifier).map_err(|error| error.to_string())?;
        let session = FdiSession::new(with_network.fdi_config(), 1).map_err(|error| error.to_string())?;
        Ok(Self {
            session,
            measured: Measured::default(),
            said: NOT_READY,
        })
    }

    /// For runs of a scenario that has a network: the scenario's own if that calibrates itself, else the first shipped or own one that was trained for this vehicle.
    pub fn beside_the_network(scenario: &Scenario) -> Option<Self> {
        let own = scenario.classifier()?;
        if own.inputs.self_calibrated {
            return Self::new(scenario, own.clone()).ok();
        }
        let model = model_hash(scenario);
        let known = list(Kind::Classifier).ok()?;
        let read = known.into_iter().filter_map(|named| Classifier::read(&named.path).ok());
        let mut fitting =
            read.filter(|classifier| classifier.inputs.self_calibrated && classifier.provenance.model_hash == model);
        fitting.find_map(|classifier| Self::new(scenario, classifier).ok())
    }
}

/// The scenario with another network and the residuals that it was trained on.
fn with_network(scenario: &Scenario, classifier: Classifier) -> Result<Scenario, ConfigError> {
    let mut documents = scenario.documents().clone();
    let settings = &mut documents.scenario.fdi;
    settings.nominal_thrust = classifier.inputs.nominal_thrust;
    settings.window_samples = classifier.inputs.window_samples;
    settings.observer_gain_1_s = classifier.inputs.observer_gain_1_s;
    settings.network = Some(classifier.name.clone());
    documents.classifier = Some(classifier);
    Scenario::from_documents(&documents)
}

impl Detector for NetworkOverTime {
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
                    self.said = match window.obstacle {
                        Some(_) => NOT_READY,
                        None => window.network_over_time.code,
                    };
                }
            }
            // A NaN sample: a gap, as in a log.
            Err(_refused) => self.said = NOT_READY,
        }
        self.said
    }
}
