//! A flight to submit.

use super::named::ModelChoice;
use crate::flight::{Controller, Link, Pace, Place, join_timeout};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Peers from outside are waited for at most this long, ms.
const LONGEST_JOIN_MS: u64 = 3_600_000;

/// A flight to submit.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[schema(as = Submission)]
#[serde(deny_unknown_fields)]
pub struct RunSubmission {
    /// Name of one of the server's scenarios; or give `text`.
    #[serde(default)]
    pub scenario: Option<String>,
    /// A scenario document (TOML), as in the library's `scenarios`.
    #[serde(default)]
    pub text: Option<String>,
    /// All documents of a flight (TOML), as in the summary of a run: nothing is looked up in the library.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub documents: Option<String>,
    /// Id of a classifier that was trained here: the network of the FDI engine, instead of that of the scenario.
    #[serde(default)]
    pub classifier: Option<String>,
    /// This model flies, with its vehicle and effects, instead of the scenario's vehicle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<ModelChoice>,
    /// The model assumed by the detectors, as far as their parameters can represent it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fdi_model: Option<ModelChoice>,
    /// Keys to set on the named scenario: `key=value`, such as `initial.state_of_charge=0.4`.
    #[serde(default)]
    pub set: Vec<String>,
    /// Seed of all noise; default: the scenario's.
    #[serde(default)]
    pub seed: Option<u64>,
    /// How plant, controller and FDI engine are connected.
    #[serde(default)]
    pub link: Link,
    /// As fast as possible, or 400 steps per second of wall clock.
    #[serde(default)]
    pub pace: Pace,
    /// From −100 to 100; larger values run first.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    pub priority: i64,
    /// Controller: the built-in one with the plant, the built-in one on a worker that offers it, a third-party one
    /// that joins with the run's ticket, or an autopilot by its name.
    #[serde(default)]
    pub controller: Controller,
    /// FDI engine: same choices as for the controller.
    #[serde(default)]
    pub fdi: Place,
    /// Longest wait for external peers, ms.
    #[serde(default = "join_timeout")]
    #[schema(minimum = 1, maximum = 3_600_000)]
    pub join_timeout_ms: u64,
    /// Time limit of an attempt, s of wall time; default 6 h.
    #[serde(default)]
    #[schema(minimum = 1, maximum = 86_400)]
    pub max_wall_s: Option<u64>,
    /// Longest flight to accept, s of simulated time.
    #[serde(default)]
    pub max_sim_s: Option<f64>,
}

/// What holds where nothing is said; without a scenario.
impl Default for RunSubmission {
    fn default() -> Self {
        Self {
            scenario: None,
            text: None,
            documents: None,
            classifier: None,
            model: None,
            fdi_model: None,
            set: Vec::new(),
            seed: None,
            link: Link::default(),
            pace: Pace::default(),
            priority: 0,
            controller: Controller::default(),
            fdi: Place::default(),
            join_timeout_ms: join_timeout(),
            max_wall_s: None,
            max_sim_s: None,
        }
    }
}

impl RunSubmission {
    /// Parts elsewhere are reached over zenoh only, and waited for within limits.
    ///
    /// # Errors
    /// One sentence.
    pub fn check_places(&self) -> Result<(), String> {
        if !(1..=LONGEST_JOIN_MS).contains(&self.join_timeout_ms) {
            return Err(format!(
                "`join_timeout_ms` is {}; expected 1 to {LONGEST_JOIN_MS}",
                self.join_timeout_ms
            ));
        }
        for (name, place) in [
            ("controller", self.controller.place().unwrap_or_default()),
            ("fdi", self.fdi),
        ] {
            if place != Place::Beside && self.link != Link::Zenoh {
                return Err(format!(
                    "`{name}` runs outside this server, and `link` is {}; expected `link: zenoh`",
                    self.link.as_str()
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the routes read and what the command line writes is one type: an empty body is its default.
    #[test]
    fn val_a_body_without_fields_is_the_default() {
        assert_eq!(
            serde_json::from_str::<RunSubmission>("{}").unwrap(),
            RunSubmission::default()
        );
        assert!(serde_json::from_str::<RunSubmission>(r#"{"seeds":1}"#).is_err());
    }

    /// Its text is hashed to recognise a repeated request, also by a server that was updated in between.
    #[test]
    fn regress_the_text_of_a_submission_stays() {
        let body = RunSubmission {
            documents: Some("d".to_owned()),
            seed: Some(7),
            controller: Controller::Autopilot("bench".to_owned()),
            ..RunSubmission::default()
        };
        assert_eq!(
            serde_json::to_string(&body).unwrap(),
            "{\"scenario\":null,\"text\":null,\"documents\":\"d\",\"classifier\":null,\"set\":[],\"seed\":7,\"link\":\"iceoryx2\",\
             \"pace\":\"fast\",\"priority\":0,\"controller\":{\"autopilot\":\"bench\"},\"fdi\":\"beside\",\"join_timeout_ms\":60000,\
             \"max_wall_s\":null,\"max_sim_s\":null}"
        );
    }

    #[test]
    fn val_a_peer_elsewhere_needs_zenoh_and_a_limit() {
        let elsewhere = RunSubmission {
            fdi: Place::External,
            ..RunSubmission::default()
        };
        assert_eq!(
            elsewhere.check_places(),
            Err("`fdi` runs outside this server, and `link` is iceoryx2; expected `link: zenoh`".to_owned())
        );
        let over_zenoh = RunSubmission {
            link: Link::Zenoh,
            ..elsewhere
        };
        assert_eq!(over_zenoh.check_places(), Ok(()));
        let never = RunSubmission {
            join_timeout_ms: 0,
            ..over_zenoh
        };
        assert_eq!(
            never.check_places(),
            Err("`join_timeout_ms` is 0; expected 1 to 3600000".to_owned())
        );
    }
}
