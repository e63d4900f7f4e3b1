//! Answers to questions, except those to SQL, which are streamed ([`crate::sql`]).

use crate::failure::Failure;
use crate::{log_verdict, sandbox};
use rotortwin_jobs::{EffectPicture, LogVerdict, MappingDraft};
use rotortwin_twin::log::{Draft, draft};

/// What the detectors say of logs, as JSON.
///
/// # Errors
/// See [`log_verdict::judge`].
pub fn log_verdict(question: &LogVerdict) -> Result<String, Failure> {
    log_verdict::judged::json_of(&log_verdict::judge(question)?).map_err(Failure::failed)
}

/// What an effect does to a flight, as JSON.
///
/// # Errors
/// See [`sandbox::of`].
pub fn effect_picture(question: &EffectPicture) -> Result<String, Failure> {
    let picture = sandbox::of(question).map_err(Failure::Input)?;
    serde_json::to_string(&picture).map_err(Failure::failed)
}

/// The draft of a mapping.
///
/// # Errors
/// The file cannot be read, or is no table.
pub fn mapping_draft(question: &MappingDraft) -> Result<Draft, Failure> {
    let file = &question.file;
    let bytes = std::fs::read(file)
        .map_err(|error| Failure::Input(format!("{}: cannot read the log: {error}", file.display())))?;
    draft(file, &bytes).map_err(Failure::input)
}
