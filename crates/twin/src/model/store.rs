//! Models as plain folders: one file per version, one small file per branch.
//!
//! ```text
//! models/f550/v0.toml  v1.toml  v2.toml     versions, numbered over all branches; never changed or deleted
//!             main.branch                   one line: the version that the branch stands at, such as v2
//!             windy.branch
//! ```
//!
//! *Undo* moves a branch back to the parent of its version; the file stays and can be named by its number. A version is named
//! `f550` (its branch `main`), `f550@windy`, `f550@v1`, or by the path of its file.
//!
//! Each write is a new file that gets its name when it is complete. Two programs that add at the same time get two
//! numbers; the branch then points to the later of the two.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use rotortwin_scenario::ConfigError;
use rotortwin_scenario::names::{self, Kind};

use super::ModelVersion;
use super::document::is_plain_name;

/// Branch where none is named.
pub const MAIN: &str = "main";

/// Why an operation of a store failed.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A version's file is invalid.
    #[error("{0}")]
    Document(#[from] ConfigError),
    /// The request or the folder is wrong.
    #[error("{0}")]
    Refused(String),
    /// The file system refuses.
    #[error("{action} {path}: {source}")]
    Io {
        /// What was tried, such as `writing`.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

fn refused<T>(sentence: impl Into<String>) -> Result<T, StoreError> {
    Err(StoreError::Refused(sentence.into()))
}

/// A folder of models.
#[derive(Debug, Clone)]
pub struct ModelStore {
    root: PathBuf,
}

/// A version and where it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The version.
    pub version: ModelVersion,
    /// Its file.
    pub path: PathBuf,
    /// Its place in the store; absent for a file outside of it.
    pub place: Option<Place>,
}

/// A place in the store.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Model.
    pub model: String,
    /// Version.
    pub number: u32,
    /// Branch through which it was named; absent where the number was given.
    pub branch: Option<String>,
}

impl Found {
    /// `f550@v2`, the name of a vehicle of the program's own, or the path of a file outside of the store.
    pub fn label(&self) -> String {
        if let Some(place) = &self.place {
            return format!("{}@v{}", place.model, place.number);
        }
        let own = |named: &names::Named| named.shipped && named.path == self.path;
        match names::list(Kind::Vehicle).unwrap_or_default().into_iter().find(own) {
            Some(named) => named.name,
            None => self.path.display().to_string(),
        }
    }
}

/// Everything in a model's folder.
#[derive(Debug, Clone)]
pub struct History {
    /// Versions by number.
    pub versions: BTreeMap<u32, ModelVersion>,
    /// Version of each branch, by name.
    pub branches: BTreeMap<String, u32>,
}

impl History {
    /// Number of the parent of a version.
    pub fn parent_of(&self, number: u32) -> Option<u32> {
        let parent = self.versions.get(&number)?.parent.as_ref()?;
        self.versions
            .iter()
            .find(|(_, version)| version.hash() == *parent)
            .map(|(&number, _)| number)
    }

    /// Numbers from version 0 to `number`.
    pub fn line_to(&self, number: u32) -> Vec<u32> {
        let mut line = vec![number];
        while let Some(parent) = self.parent_of(line[line.len() - 1]) {
            // A hash is of everything before it, so a cycle cannot be written; a forged one ends here.
            if line.contains(&parent) {
                break;
            }
            line.push(parent);
        }
        line.reverse();
        line
    }
}

impl ModelStore {
    /// The store in `root`, which need not exist yet.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// Folder of all models.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Names of the models, sorted.
    pub fn names(&self) -> Result<Vec<String>, StoreError> {
        let mut names = Vec::new();
        let entries = match std::fs::read_dir(&self.root) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(names),
            Err(source) => return Err(self.io("reading", &self.root, source)),
        };
        for entry in entries {
            let entry = entry.map_err(|source| self.io("reading", &self.root, source))?;
            let name = entry.file_name().to_string_lossy().into_owned();
            if is_plain_name(&name) && entry.path().join("v0.toml").is_file() {
                names.push(name);
            }
        }
        names.sort();
        Ok(names)
    }

    /// Whether there is a model of this name.
    pub fn has(&self, model: &str) -> bool {
        is_plain_name(model) && self.version_path(model, 0).is_file()
    }

    /// All versions and branches of a model.
    pub fn history(&self, model: &str) -> Result<History, StoreError> {
        let folder = self.folder(model)?;
        let mut history = History {
            versions: BTreeMap::new(),
            branches: BTreeMap::new(),
        };
        for entry in std::fs::read_dir(&folder).map_err(|source| self.io("reading", &folder, source))? {
            let path = entry.map_err(|source| self.io("reading", &folder, source))?.path();
            let name = path
                .file_name()
                .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
            if let Some(number) = name.strip_suffix(".toml").and_then(version_number) {
                history.versions.insert(number, ModelVersion::load(&path)?);
            } else if let Some(branch) = name.strip_suffix(".branch") {
                history.branches.insert(branch.to_owned(), self.head(model, branch)?);
            }
        }
        Ok(history)
    }

    /// A vehicle of the configuration ([`names`]) that a text names, if no file and no model of the store is called so.
    pub fn vehicle_named(&self, text: &str) -> Option<PathBuf> {
        if !names::is_name(text) || Path::new(text).is_file() || self.has(text) {
            return None;
        }
        names::find(Kind::Vehicle, text).ok()
    }

    /// The version that `text` names: `model`, `model@branch`, `model@v3`, or the path of a file.
    pub fn find(&self, text: &str) -> Result<Found, StoreError> {
        let path = Path::new(text);
        if path.is_file() {
            let version = ModelVersion::load(path)?;
            return Ok(Found {
                version,
                path: path.to_owned(),
                place: None,
            });
        }
        if let Some(path) = self.vehicle_named(text) {
            return self.find(&path.to_string_lossy());
        }
        let (model, at) = text.split_once('@').unwrap_or((text, MAIN));
        if !self.has(model) {
            let known = self.names()?;
            let known = if known.is_empty() {
                String::new()
            } else {
                format!("; models: {}", known.join(", "))
            };
            let nearest = names::nearest_of(Kind::Vehicle, text)
                .map_or_else(String::new, |name| format!("; did you mean the vehicle '{name}'?"));
            return refused(format!(
                "{text}: expected a model in {}, a model version or a vehicle file; none has this name{known}{nearest}",
                self.root.display()
            ));
        }
        let (number, branch) = match version_number(at) {
            Some(number) => (number, None),
            None => (self.head(model, at)?, Some(at.to_owned())),
        };
        let path = self.version_path(model, number);
        if !path.is_file() {
            return refused(format!(
                "{text}: expected a version of {model}, there is no {}",
                path.display()
            ));
        }
        let version = ModelVersion::load(&path)?;
        Ok(Found {
            version,
            path,
            place: Some(Place {
                model: model.to_owned(),
                number,
                branch,
            }),
        })
    }

    /// Makes a model with `version` as its version 0, whatever the version was elsewhere.
    pub fn create(&self, version: &ModelVersion) -> Result<Place, StoreError> {
        let model = &version.name;
        if self.has(model) {
            return refused(format!(
                "{}: a model with this name already exists",
                self.root.join(model).display()
            ));
        }
        Self::check(version)?;
        let folder = self.root.join(model);
        std::fs::create_dir_all(&folder).map_err(|source| self.io("creating", &folder, source))?;
        let number = self.write_next(model, version)?;
        self.set_head(model, MAIN, number)?;
        Ok(Place {
            model: model.clone(),
            number,
            branch: Some(MAIN.to_owned()),
        })
    }

    /// Writes `version` after the version at the head of a branch, which must be its parent.
    pub fn append(&self, branch: &str, version: &ModelVersion) -> Result<Place, StoreError> {
        let model = &version.name;
        let head = self.find(&format!("{model}@{branch}"))?;
        if version.parent.as_deref() != Some(head.version.hash().as_str()) {
            return refused(format!(
                "{model}@{branch}: the branch is at {}, which is not the version that the new one was made from; nothing was written",
                head.label()
            ));
        }
        Self::check(version)?;
        let number = self.write_next(model, version)?;
        self.set_head(model, branch, number)?;
        Ok(Place {
            model: model.clone(),
            number,
            branch: Some(branch.to_owned()),
        })
    }

    /// Rejects a version that no store accepts, and writes nothing.
    ///
    /// # Errors
    /// A key and what is wrong with it.
    pub fn check(version: &ModelVersion) -> Result<(), StoreError> {
        version.check().map_err(|refusal| {
            StoreError::Refused(format!(
                "model {}, key `{}`: {}",
                version.name, refusal.key, refusal.reason
            ))
        })
    }

    /// Moves a branch back to the parent of its version; returns the version left and the version reached.
    pub fn undo(&self, model: &str, branch: &str) -> Result<(u32, u32), StoreError> {
        let head = self.head(model, branch)?;
        match self.history(model)?.parent_of(head) {
            Some(parent) => {
                self.set_head(model, branch, parent)?;
                Ok((head, parent))
            }
            None => refused(format!(
                "{model}@{branch}: v{head} is the first version; there is nothing to undo"
            )),
        }
    }

    /// Makes a branch at a version.
    pub fn branch(&self, model: &str, branch: &str, at: u32) -> Result<(), StoreError> {
        let path = self.branch_path(model, branch)?;
        if path.exists() {
            return refused(format!("{}: a branch with this name already exists", path.display()));
        }
        if version_number(branch).is_some() {
            return refused(format!(
                "branch {branch}: expected a name that cannot be mistaken for a version"
            ));
        }
        let version = self.version_path(model, at);
        if !version.is_file() {
            return refused(format!(
                "{model}: expected an existing version for the branch, there is no {}",
                version.display()
            ));
        }
        self.set_head(model, branch, at)
    }

    /// Version at which a branch stands.
    pub fn head(&self, model: &str, branch: &str) -> Result<u32, StoreError> {
        let path = self.branch_path(model, branch)?;
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                return refused(format!(
                    "{model}@{branch}: expected a branch or a version such as v1, there is no {}",
                    path.display()
                ));
            }
            Err(source) => return Err(self.io("reading", &path, source)),
        };
        match version_number(text.trim()) {
            Some(number) if self.version_path(model, number).is_file() => Ok(number),
            Some(number) => refused(format!(
                "{}: expected an existing version; there is no v{number}.toml in its folder",
                path.display()
            )),
            None => refused(format!(
                "{}: expected one version such as v1, got {:?}",
                path.display(),
                text.trim()
            )),
        }
    }

    fn folder(&self, model: &str) -> Result<PathBuf, StoreError> {
        if self.has(model) {
            return Ok(self.root.join(model));
        }
        refused(format!(
            "{model}: expected a model in {}; none has this name",
            self.root.display()
        ))
    }

    fn version_path(&self, model: &str, number: u32) -> PathBuf {
        self.root.join(model).join(format!("v{number}.toml"))
    }

    fn branch_path(&self, model: &str, branch: &str) -> Result<PathBuf, StoreError> {
        if is_plain_name(branch) {
            return Ok(self.folder(model)?.join(format!("{branch}.branch")));
        }
        refused(format!(
            "branch {branch:?}: expected 1 to 64 letters, digits, '-', '_' and '.' that begin with a letter or digit"
        ))
    }

    /// Writes a version under the next free number.
    fn write_next(&self, model: &str, version: &ModelVersion) -> Result<u32, StoreError> {
        let folder = self.root.join(model);
        let draft = folder.join(format!(".draft-{}", std::process::id()));
        self.write_file(&draft, &version.to_toml())?;
        for number in 0.. {
            let path = self.version_path(model, number);
            // A link fails where the name is taken, so that a version is complete from the first and never overwritten.
            match std::fs::hard_link(&draft, &path) {
                Ok(()) => {
                    std::fs::remove_file(&draft).map_err(|source| self.io("removing", &draft, source))?;
                    return Ok(number);
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(source) => return Err(self.io("writing", &path, source)),
            }
        }
        refused(format!("{}: all version numbers are taken", folder.display()))
    }

    fn set_head(&self, model: &str, branch: &str, number: u32) -> Result<(), StoreError> {
        let path = self.branch_path(model, branch)?;
        let draft = path.with_extension(format!("draft-{}", std::process::id()));
        self.write_file(&draft, &format!("v{number}\n"))?;
        std::fs::rename(&draft, &path).map_err(|source| self.io("writing", &path, source))
    }

    fn write_file(&self, path: &Path, text: &str) -> Result<(), StoreError> {
        let write = || -> std::io::Result<()> {
            let mut file = std::fs::File::create(path)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()
        };
        write().map_err(|source| self.io("writing", path, source))
    }

    fn io(&self, action: &'static str, path: &Path, source: std::io::Error) -> StoreError {
        StoreError::Io {
            action,
            path: path.to_owned(),
            source,
        }
    }
}

/// 3 for `v3`; `None`: the text names no version.
pub fn version_number(text: &str) -> Option<u32> {
    let digits = text.strip_prefix('v')?;
    let plain =
        !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit()) && (digits == "0" || !digits.starts_with('0'));
    plain.then(|| digits.parse().ok()).flatten()
}
