//! Resolution of model version names.

use rotortwin_twin::model::store::{MAIN, Place};
use rotortwin_twin::model::{ModelStore, ModelVersion, StoreError};
use std::path::Path;

/// The version named by a text.
pub fn find(store: &ModelStore, text: &str) -> Result<ModelVersion, StoreError> {
    store.find(text).map(|found| found.version)
}

/// MODEL and BRANCH of a text that must not contain a version number.
pub fn model_and_branch(text: &str) -> (&str, &str) {
    text.split_once('@').unwrap_or((text, MAIN))
}

/// A model of the store at the head of a branch; a vehicle or version file creates one with its name.
pub fn find_or_begin(store: &ModelStore, text: &str) -> Result<(ModelVersion, String), StoreError> {
    let head = Head::find(store, text)?;
    head.begin(store)?;
    Ok((head.version, head.branch))
}

/// Position of an existing or new model.
pub struct Head {
    /// The version.
    pub version: ModelVersion,
    /// Its branch.
    pub branch: String,
    /// The store does not contain the model yet.
    is_new: bool,
}

impl Head {
    /// Creates the model if it is new.
    pub fn begin(&self, store: &ModelStore) -> Result<(), StoreError> {
        if self.is_new {
            store.create(&self.version)?;
        }
        Ok(())
    }

    /// The versions from the first to this one.
    pub fn line(&self, store: &ModelStore) -> Result<Vec<ModelVersion>, StoreError> {
        if self.is_new {
            return Ok(vec![self.version.clone()]);
        }
        let history = store.history(&self.version.name)?;
        let head = store.head(&self.version.name, &self.branch)?;
        let line = history.line_to(head);
        Ok(line
            .iter()
            .filter_map(|number| history.versions.get(number).cloned())
            .collect())
    }

    /// Looks it up without writing anything.
    pub fn find(store: &ModelStore, text: &str) -> Result<Self, StoreError> {
        let named = store.vehicle_named(text);
        let path = named.as_deref().unwrap_or(Path::new(text));
        if path.is_file() {
            let version = ModelVersion::load(path)?;
            let mut first = ModelVersion::first(version.name.clone(), version.documents());
            // A vehicle from a log starts with its accompanying intervals.
            first.constant.clone_from(&version.constant);
            if version != first {
                return Err(StoreError::Refused(format!(
                    "{text}: expected a model of {}; import this version with 'rotortwin model import {text}'",
                    store.root().display()
                )));
            }
            let branch = MAIN.to_owned();
            if !store.has(&first.name) {
                return Ok(Self {
                    version: first,
                    branch,
                    is_new: true,
                });
            }
            let begun = store.find(&format!("{}@v0", first.name))?.version;
            if begun != first {
                return Err(StoreError::Refused(format!(
                    "{text}: a model {} of another vehicle already exists; import this one with 'rotortwin model import {text} --name NAME'",
                    first.name
                )));
            }
            let version = store.find(&first.name)?.version;
            return Ok(Self {
                version,
                branch,
                is_new: false,
            });
        }
        let (_, branch) = model_and_branch(text);
        let found = store.find(text)?;
        match found.place {
            Some(Place { branch: Some(_), .. }) => Ok(Self {
                version: found.version,
                branch: branch.to_owned(),
                is_new: false,
            }),
            _ => Err(StoreError::Refused(format!(
                "{text}: expected a branch, because a version never changes; create one with 'rotortwin model branch {text} NAME'"
            ))),
        }
    }
}
