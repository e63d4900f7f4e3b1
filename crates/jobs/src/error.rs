//! Why a row is rejected.

/// A row that this version cannot read; the message is one sentence.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("this version of rotortwin does not understand the job: {0}")]
pub struct NotUnderstood(pub(crate) String);
