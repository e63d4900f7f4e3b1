//! Answers to questions, except those to SQL, which are streamed ([`crate::sql`]).

use crate::failure::Failure;
use crate::{campaign, log_import, log_verdict, sandbox};
use rotortwin_campaign::study::Campaign;
use rotortwin_jobs::{CampaignCheck, EffectPicture, LogOverTime, LogVerdict, MappingDraft};
use rotortwin_twin::flight_picture::FlightPicture;
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

/// A log over time, as JSON.
///
/// # Errors
/// See [`log_import::read`].
pub fn log_over_time(question: &LogOverTime) -> Result<String, Failure> {
    let log = log_import::read(&question.file, &log_import::Reading::default()).map_err(Failure::Input)?;
    serde_json::to_string(&FlightPicture::of(&log)).map_err(Failure::failed)
}

/// What a campaign document says, or one of its flights, as JSON.
///
/// # Errors
/// It cannot be flown, or has no such flight.
pub fn campaign_check(question: &CampaignCheck) -> Result<String, Failure> {
    let flights = Campaign::load(&question.file).map_err(Failure::input)?;
    let checked = match question.flight {
        Some(flight) => serde_json::to_string(&campaign::checked_flight(&flights, flight)?),
        None => serde_json::to_string(&campaign::checked(&flights)?),
    };
    checked.map_err(Failure::failed)
}
