//! Inputs of a job that is executed on a different machine from where it was requested.

use serde::{Deserialize, Serialize};

/// A file or folder that a job reads.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// Its path relative to the folder in which the job is executed. The job refers to it by this path.
    pub path: String,
    /// Its content.
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

    /// The output of the parts of the job.
    pub fn parts(path: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            content: Content::Parts,
        }
    }
}

/// Source of an input.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Content {
    /// This text.
    Text(String),
    /// A file of the artifact store.
    File(String),
    /// Everything below this key of the artifact store.
    Folder(String),
    /// For a job that waits for parts: the output of all parts, merged into one folder.
    Parts,
}
