//! Arguments that accept the path of a document or its name: `config/scenarios/hover.toml` or `hover`.

use clap::builder::{OsStringValueParser, TypedValueParser};
use rotortwin_runner::named::resolved;
use rotortwin_scenario::names::Kind;
use std::path::PathBuf;

fn parser(kind: Kind) -> impl TypedValueParser<Value = PathBuf> {
    OsStringValueParser::new().try_map(move |text| resolved(kind, &text))
}

/// A scenario.
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
