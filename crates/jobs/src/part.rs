//! A part of a job that is done by a node of somebody else's cluster: what the node fetches from the server, and what it gives back.
//!
//! ```text
//!  server ──GET order, inputs──▶ node: `rotortwin part` ──starts──▶ `rotortwin job FILE`
//!     ◀── events, files, end ─────┘
//! ```
//! Both sides are of one build; a node of another version reads [`PartOrder::program`] first, and says so in its [`PartEnd`].

use serde::{Deserialize, Serialize};

/// Variable of the node's process: where its part is, such as `https://bench:8443/executor/v1/parts/ID/ATTEMPT`.
pub const URL_VARIABLE: &str = "ROTORTWIN_PART_URL";
/// Variable of the node's process: the secret of this attempt.
pub const TICKET_VARIABLE: &str = "ROTORTWIN_PART_TICKET";
/// Variable of the node's process: certificates that are believed (PEM), if the server has one of its own authority.
pub const CA_VARIABLE: &str = "ROTORTWIN_PART_CA";

/// What a node is to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PartOrder {
    /// The server's version of the program.
    pub program: String,
    /// For people.
    pub name: String,
    /// The job, as [`JobFile`](crate::JobFile) writes it.
    pub file: String,
    /// What is to be laid out in the folder in which the job is done.
    pub inputs: Vec<PartInput>,
    /// Folder below that one whose files are wanted.
    pub out: String,
    /// Files there that nobody wants.
    pub leftovers: Vec<String>,
    /// It is stopped after so long, s of wall time.
    pub wall_limit_s: u64,
    /// Memory that its process may take, bytes.
    pub memory: u64,
    /// Processor time that its process may take, s.
    pub cpu_s: u64,
}

/// A file that a part reads.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartInput {
    /// Where it is to be.
    pub path: String,
    /// What is in it; unset: it is fetched by its path, being long or no text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
}

/// A file that a part leaves.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartFile {
    /// Below [`PartOrder::out`].
    pub path: String,
    /// Bytes.
    pub size: u64,
}

/// What a part says on its way: lines that its process wrote, each a JSON object with a key `event`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartEvents {
    /// In order; none: it lives.
    pub lines: Vec<String>,
}

/// How a part ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartEnd {
    /// Name of the node.
    pub node: String,
    /// The node's process would do another part.
    #[serde(default)]
    pub wants_more: bool,
    /// How.
    #[serde(flatten)]
    pub how: PartHow,
}

/// What the server says to a [`PartEnd`].
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartAccepted {
    /// The next part of this process, if it wants one and there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<NextPart>,
}

/// Another part for a process that has done one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NextPart {
    /// Where it is on the same server: `/executor/v1/parts/ID/ATTEMPT`.
    pub path: String,
    /// The secret of its attempt.
    pub ticket: String,
}

/// See [`PartEnd`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "how", rename_all = "kebab-case")]
pub enum PartHow {
    /// All is done, and its files are there.
    Done {
        /// JSON, as its process printed it.
        result: String,
        /// All of them.
        files: Vec<PartFile>,
    },
    /// Another try would end alike.
    Refused {
        /// One sentence.
        why: String,
    },
    /// Another try may end well.
    Failed {
        /// One sentence.
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
