//! Events that a queue writes about a job. Those of the job itself are [`JobEvent`](crate::JobEvent) and `rotortwin_wire::events`.

use crate::status::Status;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;

/// Kinds of events that only the queue writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QueueEventKind {
    /// The job was accepted.
    Queued,
    /// An attempt began.
    Started,
    /// It waits for another attempt.
    Requeued,
    /// One of its parts is done.
    Part,
    /// It has ended: its last event.
    Ended,
}

impl QueueEventKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Queued, Self::Started, Self::Requeued, Self::Part, Self::Ended];

    /// Name in the database and in streams of events.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Started => "started",
            Self::Requeued => "requeued",
            Self::Part => "part",
            Self::Ended => "ended",
        }
    }

    /// By its name; `None`: an event of the job itself.
    pub fn parse(text: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.as_str() == text)
    }
}

/// An event of the queue: its kind and its content, which is stored and sent as JSON.
///
/// In a stream of server-sent events `event` is the field of that name, and `data` the other one's JSON.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "event", content = "data", rename_all = "kebab-case")]
pub enum QueueEvent {
    /// The job was accepted.
    Queued {},
    /// An attempt began.
    Started {
        /// Number of the attempt; unset for a job in parts, which starts with its first part.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        attempt: Option<i64>,
        /// Name of that part.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Id of that part.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        part: Option<String>,
        /// Name of the worker.
        worker: Option<String>,
    },
    /// It waits for another attempt.
    Requeued {
        /// What ended the last one.
        why: String,
    },
    /// One of its parts is done.
    Part {
        /// Its name.
        name: String,
        /// Its id.
        part: String,
    },
    /// It has ended.
    Ended {
        /// Why it failed.
        error: Option<String>,
        /// Hash over all samples of a flight.
        run_hash: Option<String>,
        /// How it ended.
        status: Status,
    },
}

impl QueueEvent {
    /// Its kind.
    pub const fn kind(&self) -> QueueEventKind {
        match self {
            Self::Queued {} => QueueEventKind::Queued,
            Self::Started { .. } => QueueEventKind::Started,
            Self::Requeued { .. } => QueueEventKind::Requeued,
            Self::Part { .. } => QueueEventKind::Part,
            Self::Ended { .. } => QueueEventKind::Ended,
        }
    }

    /// Its content, one JSON object.
    ///
    /// # Errors
    /// It cannot be written, which none of them says of itself.
    pub fn data(&self) -> serde_json::Result<String> {
        serde_json::to_value(self).map(|event| event["data"].to_string())
    }

    /// An event of a stream; `None`: it is not of the queue, or of a later version.
    pub fn read(kind: &str, data: &Value) -> Option<Self> {
        serde_json::from_value(json!({ "event": kind, "data": data })).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As written by earlier versions: they are stored in databases, and clients read them.
    #[test]
    fn val_events_are_written_as_clients_read_them() {
        let some = |text: &str| Some(text.to_owned());
        let started = |attempt, name, part| QueueEvent::Started {
            attempt,
            name,
            part,
            worker: some("a"),
        };
        for (event, kind, data) in [
            (QueueEvent::Queued {}, QueueEventKind::Queued, "{}"),
            (
                started(Some(2), None, None),
                QueueEventKind::Started,
                r#"{"attempt":2,"worker":"a"}"#,
            ),
            (
                started(None, some("mixed 0..5"), some("p")),
                QueueEventKind::Started,
                r#"{"name":"mixed 0..5","part":"p","worker":"a"}"#,
            ),
            (
                QueueEvent::Requeued { why: "w".to_owned() },
                QueueEventKind::Requeued,
                r#"{"why":"w"}"#,
            ),
            (
                QueueEvent::Part {
                    name: "n".to_owned(),
                    part: "p".to_owned(),
                },
                QueueEventKind::Part,
                r#"{"name":"n","part":"p"}"#,
            ),
            (
                QueueEvent::Ended {
                    error: None,
                    run_hash: some("00"),
                    status: Status::Done,
                },
                QueueEventKind::Ended,
                r#"{"error":null,"run_hash":"00","status":"done"}"#,
            ),
        ] {
            assert_eq!((event.kind(), event.data().unwrap().as_str()), (kind, data));
            let tag = serde_json::to_value(&event).unwrap()["event"].clone();
            assert_eq!(tag, kind.as_str(), "its name is written twice in this file");
            let read = QueueEvent::read(kind.as_str(), &serde_json::from_str(data).unwrap());
            assert_eq!(read, Some(event));
            assert_eq!(QueueEventKind::parse(kind.as_str()), Some(kind));
        }
        assert_eq!(QueueEvent::read("progress", &json!({ "share": 0.5 })), None);
        assert_eq!(QueueEventKind::parse("progress"), None);
    }
}
