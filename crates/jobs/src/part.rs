//! Part of a job executed by a node of a third-party cluster: what the node fetches from the server, and what it returns.
//!
//! ```text
//!  server ──GET order, inputs──▶ node: `rotortwin part` ──starts──▶ `rotortwin job FILE`
//!     ◀── events, files, end ─────┘
//! ```
//! Both sides come from one build; a node of another version reads [`PartOrder::program`] first, and reports the mismatch in its
//! [`PartEnd`].

use serde::{Deserialize, Serialize};

/// Environment variable of the node's process: URL of its part, such as `https://bench:8443/executor/v1/parts/ID/ATTEMPT`.
pub const URL_VARIABLE: &str = "ROTORTWIN_PART_URL";
/// Environment variable of the node's process: the secret of this attempt.
pub const TICKET_VARIABLE: &str = "ROTORTWIN_PART_TICKET";
/// Environment variable of the node's process: trusted certificates (PEM), if the server uses a private CA.
pub const CA_VARIABLE: &str = "ROTORTWIN_PART_CA";

/// Instructions for a node.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PartOrder {
    /// The server's version of the program.
    pub program: String,
    /// Display name.
    pub name: String,
    /// The job, as [`JobFile`](crate::JobFile) writes it.
    pub file: String,
    /// Files to lay out in the folder in which the job is executed.
    pub inputs: Vec<PartInput>,
    /// Subfolder whose files are to be returned.
    pub out: String,
    /// Files there that are not to be returned.
    pub leftovers: Vec<String>,
    /// It is stopped after this wall time, s.
    pub wall_limit_s: u64,
    /// Memory limit of its process, bytes.
    pub memory: u64,
    /// Processor time limit of its process, s.
    pub cpu_s: u64,
}

/// A file that a part reads.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartInput {
    /// Its path.
    pub path: String,
    /// Its content; unset: to be fetched by its path, because it is long or not text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
}

/// An output file of a part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartFile {
    /// Below [`PartOrder::out`].
    pub path: String,
    /// Bytes.
    pub size: u64,
}

/// Progress of a part: lines written by its process, each a JSON object with a key `event`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartEvents {
    /// In order; an empty list is a heartbeat.
    pub lines: Vec<String>,
}

/// How a part ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartEnd {
    /// Name of the node.
    pub node: String,
    /// The node's process can take another part.
    #[serde(default)]
    pub wants_more: bool,
    /// Result.
    #[serde(flatten)]
    pub how: PartHow,
}

/// The server's reply to a [`PartEnd`].
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartAccepted {
    /// The next part for this process, if it can take one and there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<NextPart>,
}

/// Another part for a process that has finished one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NextPart {
    /// Its path on the same server: `/executor/v1/parts/ID/ATTEMPT`.
    pub path: String,
    /// The secret of its attempt.
    pub ticket: String,
}

/// See [`PartEnd`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "how", rename_all = "kebab-case")]
pub enum PartHow {
    /// Completed, with its files.
    Done {
        /// JSON, as printed by its process.
        result: String,
        /// All output files.
        files: Vec<PartFile>,
    },
    /// A retry would fail the same way.
    Refused {
        /// Error message.
        why: String,
    },
    /// A retry may succeed.
    Failed {
        /// Error message.
        why: String,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_an_end_is_read_as_it_was_written() {
        let end = PartEnd {
            node: "a".to_owned(),
            wants_more: true,
            how: PartHow::Refused { why: "no".to_owned() },
        };
        let text = serde_json::to_string(&end).unwrap();
        assert_eq!(text, r#"{"node":"a","wants_more":true,"how":"refused","why":"no"}"#);
        assert_eq!(serde_json::from_str::<PartEnd>(&text).unwrap(), end);
    }
}
