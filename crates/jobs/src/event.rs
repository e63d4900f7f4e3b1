//! Events of a running job, one line of JSON each. Those of a flight are `rotortwin_wire::events`.

use rotortwin_blind::bench::cases::Preset;
use rotortwin_blind::bench::score::Outcome;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Messages of a job in progress. In JSON, `event` says which.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum JobEvent {
    /// Progress of the job.
    Progress(Progress),
    /// A case of a blind bench is done.
    Case(CaseDone),
}

/// Progress of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = JobProgress)]
#[serde(untagged)]
pub enum Progress {
    /// As a fraction of its work.
    Share {
        /// Completed fraction.
        share: f64,
        /// Current activity.
        text: String,
    },
    /// As flights of a campaign.
    Flights {
        /// Flights that did not reach their end.
        failed: u64,
        /// False alarms.
        false_alarms: u64,
        /// Flights done, including earlier ones.
        flights: u64,
        /// Requested flights.
        of: u64,
    },
}

/// A case of a blind bench, scored.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = BlindCaseDone)]
pub struct CaseDone {
    /// Number within its preset.
    pub case: usize,
    /// The effect named.
    pub named: String,
    /// Score of the answer.
    pub outcome: Outcome,
    /// Preset of the case.
    pub preset: Preset,
    /// The hidden effect.
    pub truth: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As written by earlier versions: they are stored in databases, and clients read them.
    #[test]
    fn val_events_are_written_as_clients_read_them() {
        let share = JobEvent::Progress(Progress::Share {
            share: 0.5,
            text: "fit".to_owned(),
        });
        let flights = JobEvent::Progress(Progress::Flights {
            failed: 1,
            false_alarms: 2,
            flights: 64,
            of: 96,
        });
        let case = JobEvent::Case(CaseDone {
            case: 3,
            named: "mass".to_owned(),
            outcome: Outcome::Right,
            preset: Preset::Mixed,
            truth: "mass".to_owned(),
        });
        for (event, line) in [
            (share, r#"{"event":"progress","share":0.5,"text":"fit"}"#),
            (
                flights,
                r#"{"event":"progress","failed":1,"false_alarms":2,"flights":64,"of":96}"#,
            ),
            (
                case,
                r#"{"event":"case","case":3,"named":"mass","outcome":"right","preset":"mixed","truth":"mass"}"#,
            ),
        ] {
            assert_eq!(serde_json::to_string(&event).unwrap(), line);
            assert_eq!(serde_json::from_str::<JobEvent>(line).unwrap(), event);
        }
    }
}
