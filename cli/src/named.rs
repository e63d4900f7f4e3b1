//! Arguments that accept the path of a document or its name: `config/scenarios/hover.toml` or `hover`.

use crate::nearest::file_of;
use clap::builder::{OsStringValueParser, TypedValueParser};
use rotortwin_runner::named::resolved;
use rotortwin_scenario::names::Kind;
use std::path::PathBuf;

fn parser(kind: Kind) -> impl TypedValueParser<Value = PathBuf> {
    OsStringValueParser::new().try_map(move |text| {
        resolved(kind, &text).map_err(|error| {
            // `fly mine` next to mine.toml: a name is not a path.
            let beside = text.to_str().and_then(|name| file_of(name, kind.extension()));
            beside.map_or_else(
                || error.to_string(),
                |file| format!("{error}; did you mean the {file}?"),
            )
        })
    })
}

/// Of a scenario.
pub(crate) fn scenario() -> impl TypedValueParser<Value = PathBuf> {
    parser(Kind::Scenario)
}

/// A vehicle.
pub(crate) fn vehicle() -> impl TypedValueParser<Value = PathBuf> {
    parser(Kind::Vehicle)
}

/// A campaign.
pub(crate) fn campaign() -> impl TypedValueParser<Value = PathBuf> {
    parser(Kind::Campaign)
}

/// A file with effects.
pub(crate) fn effect() -> impl TypedValueParser<Value = PathBuf> {
    parser(Kind::Effect)
}

/// A column mapping.
pub(crate) fn log_mapping() -> impl TypedValueParser<Value = PathBuf> {
    parser(Kind::LogMapping)
}

/// A classifier.
pub(crate) fn classifier() -> impl TypedValueParser<Value = PathBuf> {
    parser(Kind::Classifier)
}
