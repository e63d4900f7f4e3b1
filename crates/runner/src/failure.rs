//! Why a job failed.

use crate::destination::{full_disk, is_of_a_full_disk};
use rotortwin_blind::error::BlindError;
use rotortwin_twin::model::StoreError;
use std::fmt::Display;
use std::path::Path;

/// Why a job failed; the message is one sentence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The request is invalid: a retry would fail the same way.
    Input(String),
    /// The request is valid, but failed here and now.
    Failed(String),
}

impl Failure {
    /// Bad input.
    pub fn input(sentence: impl Display) -> Self {
        Self::Input(sentence.to_string())
    }

    /// Any other failure.
    pub fn failed(sentence: impl Display) -> Self {
        Self::Failed(sentence.to_string())
    }

    /// A write error at `place`; a full disk is named.
    pub fn writing(place: &Path, sentence: impl Display) -> Self {
        let sentence = sentence.to_string();
        match full_disk(place, &sentence) {
            Some(disk) => Self::Failed(format!("{sentence}; {disk}")),
            None => Self::Failed(sentence),
        }
    }

    /// A folder at `place` that cannot be used: bad input, unless its disk is full, which is named.
    pub fn opening(place: &Path, sentence: String) -> Self {
        if is_of_a_full_disk(&sentence) {
            Self::writing(place, sentence)
        } else {
            Self::Input(sentence)
        }
    }
}

impl Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (Self::Input(sentence) | Self::Failed(sentence)) = self;
        f.write_str(sentence)
    }
}

impl std::error::Error for Failure {}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::Io { .. } => Self::failed(error),
            StoreError::Document(_) | StoreError::Refused(_) => Self::input(error),
        }
    }
}

impl From<BlindError> for Failure {
    fn from(error: BlindError) -> Self {
        match error {
            BlindError::Input { .. } => Self::input(error),
            _ => Self::failed(error),
        }
    }
}
