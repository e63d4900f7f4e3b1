//! How controllers and FDI engines on other hosts join a run.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A part of a run that may be on another host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SeatRole {
    /// The controller.
    Controller,
    /// The FDI engine.
    Fdi,
}

impl SeatRole {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Controller, Self::Fdi];

    /// Name in commands, events and the database.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Controller => "controller",
            Self::Fdi => "fdi",
        }
    }

    /// By its name; `None`: it is of a later version.
    pub fn parse(text: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.as_str() == text)
    }
}

/// How an external peer joins a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Ticket {
    /// `controller` or `fdi`.
    #[schema(value_type = String)]
    pub role: SeatRole,
    /// Address of the plant: `zenoh:connect=tcp/HOST:PORT`.
    pub link: String,
    /// 16 hex digits; part of all topics of the run.
    pub run_id: String,
    /// Version of the messages of `proto/` that the plant uses.
    pub messages: u32,
    /// Longest wait of the plant for all peers to join, ms from the event `join`.
    pub join_timeout_ms: u64,
    /// Longest wait of the plant for the reply of a running peer, ms.
    pub step_timeout_ms: u64,
    /// Command that starts the built-in peer there.
    pub command: String,
}

/// The tickets of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Tickets {
    #[expect(missing_docs, reason = "the API document has no words for it")]
    pub peers: Vec<Ticket>,
}

/// Written by the process of a run once its plant waits for external peers.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Invitation {
    /// These can join now.
    Join(Tickets),
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As written by earlier versions: stored with a run, and read by clients.
    #[test]
    fn val_an_invitation_is_written_as_clients_read_it() {
        let tickets = Tickets {
            peers: vec![Ticket {
                role: SeatRole::Fdi,
                link: "zenoh:connect=tcp/a:1".to_owned(),
                run_id: "0000000000000001".to_owned(),
                messages: 1,
                join_timeout_ms: 2,
                step_timeout_ms: 3,
                command: "rotortwin fdi".to_owned(),
            }],
        };
        let line = r#"{"event":"join","peers":[{"role":"fdi","link":"zenoh:connect=tcp/a:1","run_id":"0000000000000001","messages":1,"join_timeout_ms":2,"step_timeout_ms":3,"command":"rotortwin fdi"}]}"#;
        let invitation = Invitation::Join(tickets.clone());
        assert_eq!(serde_json::to_string(&invitation).unwrap(), line);
        assert_eq!(serde_json::from_str::<Invitation>(line).unwrap(), invitation);
        // The event is stored as it is, and its tickets are read from it.
        assert_eq!(serde_json::from_str::<Tickets>(line).unwrap(), tickets);
        for role in SeatRole::ALL {
            assert_eq!(SeatRole::parse(role.as_str()), Some(role));
            assert_eq!(serde_json::to_value(role).unwrap(), role.as_str());
        }
    }
}
