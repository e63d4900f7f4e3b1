//! What a job reads, where it is done on another machine than it was asked for.

use serde::{Deserialize, Serialize};

/// A file or folder that a job reads.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// Where it is to be, relative to the folder in which the job is done. The job names it by this path.
    pub path: String,
    /// What is to be there.
    pub content: Content,
}

impl Input {
    /// A text.
    pub fn text(path: impl Into<String>, text: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            content: Content::Text(text.into()),
        }
    }

    /// A file of the artifact store.
    pub fn file(path: impl Into<String>, key: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            content: Content::File(key.into()),
        }
    }

    /// A folder of the artifact store, such as a run or a copy of the library.
    pub fn folder(path: impl Into<String>, key: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            content: Content::Folder(key.into()),
        }
    }

    /// What the parts of the job have left.
    pub fn parts(path: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            content: Content::Parts,
        }
    }
}

/// Where an input comes from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Content {
    /// This text.
    Text(String),
    /// A file of the artifact store.
    File(String),
    /// Everything below this key of the artifact store.
    Folder(String),
    /// For a job that waits for parts: everything that each part has left, merged into one folder.
    Parts,
}
