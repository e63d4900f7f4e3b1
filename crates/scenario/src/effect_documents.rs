//! Effect documents: effects of users, as files and as a scenario names them.

use std::path::Path;

use rotortwin_plant::effects::EffectDocument;

use crate::error::ConfigError;
use crate::names::{Kind, meant};
use crate::toml_document::Document;

/// Reads and checks the document at `path`.
pub fn load(path: impl AsRef<Path>) -> Result<EffectDocument, ConfigError> {
    checked(&Document::read(path.as_ref())?)
}

/// As [`load`], from a text that errors call `name`.
pub fn parse(name: &str, text: &str) -> Result<EffectDocument, ConfigError> {
    checked(&Document::from_text(name, text)?)
}

fn checked(document: &Document) -> Result<EffectDocument, ConfigError> {
    let parsed: EffectDocument = document.parse()?;
    parsed.declaration().map_err(|refusal| document.refuse(refusal))?;
    Ok(parsed)
}

/// The documents that `effect_files` of a scenario names, relative to `directory`.
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
