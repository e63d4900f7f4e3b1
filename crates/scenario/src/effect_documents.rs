//! Effect documents: user-defined effects, in files that a scenario references.

use std::path::Path;

use rotortwin_plant::effects::EffectDocument;

use crate::error::ConfigError;
use crate::names::{Kind, meant};
use crate::toml_document::Document;

/// Reads and checks the document at `path`.
pub fn load(path: impl AsRef<Path>) -> Result<EffectDocument, ConfigError> {
    checked(&Document::read(path.as_ref())?)
}

/// As [`load`], from a text that errors refer to as `name`.
pub fn parse(name: &str, text: &str) -> Result<EffectDocument, ConfigError> {
    checked(&Document::from_text(name, text)?)
}

fn checked(document: &Document) -> Result<EffectDocument, ConfigError> {
    let parsed: EffectDocument = document.parse()?;
    parsed.declaration().map_err(|refusal| document.refuse(refusal))?;
    Ok(parsed)
}

/// The documents listed in `effect_files` of a scenario, relative to `directory`.
pub(crate) fn named(
    scenario: &Document,
    files: &[String],
    directory: &Path,
) -> Result<Vec<EffectDocument>, ConfigError> {
    let read = |(i, path): (usize, &String)| {
        let document = scenario.follow(&format!("effect_files[{i}]"), &meant(Kind::Effect, directory, path))?;
        checked(&document)
    };
    files.iter().enumerate().map(read).collect()
}
