//! The side file `NAME.toml` next to `NAME.csv`: vehicle, origin, licence, segments.

use super::{LogError, Origin, Segment, error};
use serde::Deserialize;
use std::path::Path;

/// Content of a side file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SideFile {
    /// Vehicle file, as written.
    pub(crate) vehicle: Option<String>,
    /// Licence of the data.
    pub(crate) licence: Option<String>,
    /// Where the data come from.
    pub(crate) source: Option<String>,
    /// Origin of the position.
    pub(crate) origin: Option<Origin>,
    /// Named parts.
    #[serde(default, rename = "segment")]
    pub(crate) segments: Vec<Segment>,
}

/// Table that every vehicle file has, and no side file.
const OF_A_VEHICLE: &str = "body";

/// Reads `NAME.toml` next to the log, if it exists and is no vehicle file of the same name.
pub(crate) fn read_beside(log: &Path) -> Result<Option<SideFile>, LogError> {
    let path = log.with_extension("toml");
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(missing) if missing.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(error::io(&path, "cannot read the log's side file")(source)),
    };
    if text
        .parse::<toml::Table>()
        .is_ok_and(|table| table.contains_key(OF_A_VEHICLE))
    {
        return Ok(None);
    }
    let side: SideFile = toml::from_str(&text).map_err(|bad| {
        let line = bad
            .span()
            .map_or(1, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
        LogError::format(&path, format!("line {line}: {}", bad.message()))
    })?;
    for segment in &side.segments {
        let ordered = segment.start_s.is_finite() && segment.end_s.is_finite() && segment.start_s < segment.end_s;
        if !ordered {
            return Err(LogError::format(
                &path,
                format!(
                    "segment '{}' goes from {} s to {} s; the end must be after the start",
                    segment.name, segment.start_s, segment.end_s
                ),
            ));
        }
    }
    Ok(Some(side))
}
