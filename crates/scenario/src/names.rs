//! Shipped and own configuration, found by name: `reference-flight` is a scenario wherever the program runs.
//!
//! A name is looked up in the folders of [`search_path`], the first that has it wins, then among the files of `config/` that are part of the
//! program. Those are laid out as files on demand ([`shipped`]), so that a name and a path are the same thing from there on.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::shipped;

/// Environment variable with folders laid out as `config/`, separated as in `PATH`.
pub const SEARCH_PATH_VARIABLE: &str = "ROTORTWIN_CONFIG";

/// Below this similarity (Jaro–Winkler, 0 to 1) a name is no likely misspelling of another.
const SIMILAR: f64 = 0.75;

/// A folder of the configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// What is flown.
    Scenario,
    /// Who flies.
    Vehicle,
    /// Sets of blades.
    Blades,
    /// Effects of a user.
    Effect,
    /// Grids and draws of flights.
    Campaign,
    /// Columns of log formats.
    LogMapping,
    /// Trained networks.
    Classifier,
}

impl Kind {
    /// All, in the order in which they are told.
    pub const ALL: [Self; 7] = [
        Self::Scenario,
        Self::Vehicle,
        Self::Blades,
        Self::Effect,
        Self::Campaign,
        Self::LogMapping,
        Self::Classifier,
    ];

    /// Its folder below `config/`; also the word of `rotortwin list`.
    pub const fn folder(self) -> &'static str {
        match self {
            Self::Scenario => "scenarios",
            Self::Vehicle => "vehicles",
            Self::Blades => "blades",
            Self::Effect => "effects",
            Self::Campaign => "campaigns",
            Self::LogMapping => "log-mappings",
            Self::Classifier => "classifiers",
        }
    }

    /// One of it, in a sentence.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Scenario => "scenario",
            Self::Vehicle => "vehicle",
            Self::Blades => "set of blades",
            Self::Effect => "effect file",
            Self::Campaign => "campaign",
            Self::LogMapping => "log mapping",
            Self::Classifier => "classifier",
        }
    }

    /// Ending of its files.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Classifier => "json",
            _ => "toml",
        }
    }
}

/// A file that a name stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Without folder and ending.
    pub name: String,
    /// Where it lies.
    pub path: PathBuf,
    /// It is part of the program: no folder of the search path has one of this name.
    pub shipped: bool,
}

/// Why a name stands for no file.
#[derive(Debug)]
pub enum NameError {
    /// Nothing of this kind is called so.
    Unknown {
        /// What was looked for.
        kind: Kind,
        /// As it was given.
        name: String,
        /// The likeliest that there is.
        nearest: Option<String>,
    },
    /// The program's own files cannot be laid out.
    Shipped(std::io::Error),
}

impl fmt::Display for NameError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown { kind, name, nearest } => {
                write!(out, "there is no {} '{name}'", kind.word())?;
                if let Some(nearest) = nearest {
                    write!(out, "; did you mean '{nearest}'?")?;
                }
                write!(out, " ('rotortwin list {}' shows all)", kind.folder())
            }
            Self::Shipped(error) => write!(out, "the program's own configuration cannot be laid out: {error}"),
        }
    }
}

impl std::error::Error for NameError {}

/// Folders that are searched before the program's own files: `config` here, those of [`SEARCH_PATH_VARIABLE`], the user's
/// (`$XDG_CONFIG_HOME/rotortwin`, else `~/.config/rotortwin`). Some may not exist.
pub fn search_path() -> Vec<PathBuf> {
    let listed = std::env::var_os(SEARCH_PATH_VARIABLE);
    let user = variable_path("XDG_CONFIG_HOME").or_else(|| Some(variable_path("HOME")?.join(".config")));
    std::iter::once(PathBuf::from("config"))
        .chain(
            listed
                .iter()
                .flat_map(std::env::split_paths)
                .filter(|path| !path.as_os_str().is_empty()),
        )
        .chain(user.map(|folder| folder.join("rotortwin")))
        .collect()
}

/// An absolute path that a variable holds; others are ignored, as the XDG specification wants it.
pub(crate) fn variable_path(variable: &str) -> Option<PathBuf> {
    std::env::var_os(variable)
        .map(PathBuf::from)
        .filter(|path| path.is_absolute())
}

/// Whether a text is a name, and no path: neither folders nor an ending.
pub fn is_name(text: &str) -> bool {
    !text.is_empty() && !text.contains(['/', '\\', '.', '@'])
}

/// The file that `name` stands for.
///
/// # Errors
/// Nothing of this kind is called so, or the program's files cannot be laid out.
pub fn find(kind: Kind, name: &str) -> Result<PathBuf, NameError> {
    find_in(&search_path(), kind, name)
}

fn find_in(folders: &[PathBuf], kind: Kind, name: &str) -> Result<PathBuf, NameError> {
    let file = format!("{}/{name}.{}", kind.folder(), kind.extension());
    if let Some(path) = folders
        .iter()
        .map(|folder| folder.join(&file))
        .find(|path| path.is_file())
    {
        return Ok(path);
    }
    if is_name(name) && shipped::has(&file) {
        return Ok(shipped::folder().map_err(NameError::Shipped)?.join(file));
    }
    let known = list_in(folders, kind)?;
    Err(NameError::Unknown {
        kind,
        name: name.to_owned(),
        nearest: nearest(name, known.iter().map(|named| named.name.as_str())).map(str::to_owned),
    })
}

/// What there is of a kind, by name.
///
/// # Errors
/// The program's files cannot be laid out.
pub fn list(kind: Kind) -> Result<Vec<Named>, NameError> {
    list_in(&search_path(), kind)
}

fn list_in(folders: &[PathBuf], kind: Kind) -> Result<Vec<Named>, NameError> {
    let own = shipped::folder().map_err(NameError::Shipped)?;
    let mut known: Vec<Named> = Vec::new();
    for folder in folders.iter().chain([&own]) {
        let Ok(entries) = std::fs::read_dir(folder.join(kind.folder())) else {
            continue;
        };
        for path in entries.filter_map(Result::ok).map(|entry| entry.path()) {
            let fits = path.extension().is_some_and(|extension| extension == kind.extension()) && path.is_file();
            let Some(name) = path.file_stem().and_then(|stem| stem.to_str()).filter(|_| fits) else {
                continue;
            };
            if !known.iter().any(|other| other.name == name) {
                known.push(Named {
                    name: name.to_owned(),
                    shipped: *folder == own,
                    path,
                });
            }
        }
    }
    known.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(known)
}

/// What a document means by `text`: a path relative to its `directory`, or else a name. A name that there is not stays a path, for the
/// refusal to be told where the key stands.
pub fn meant(kind: Kind, directory: &Path, text: &str) -> PathBuf {
    let path = directory.join(text);
    if path.exists() || !is_name(text) {
        return path;
    }
    // What stands beside the document goes first: a folder laid out as `config/` is closed in itself.
    let beside = directory
        .join("..")
        .join(kind.folder())
        .join(text)
        .with_extension(kind.extension());
    if beside.is_file() {
        return beside;
    }
    find(kind, text).unwrap_or(path)
}

/// The likeliest of a kind that a misspelt `name` means.
pub fn nearest_of(kind: Kind, name: &str) -> Option<String> {
    let known = list(kind).ok()?;
    nearest(name, known.iter().map(|named| named.name.as_str())).map(str::to_owned)
}

/// The likeliest of `known` that a misspelt `name` means.
pub fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    known
        .map(|other| (strsim::jaro_winkler(name, other), other))
        .filter(|(similarity, _)| *similarity >= SIMILAR)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, other)| other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_folder_of_the_user_goes_before_the_programs_files() {
        let own = tempfile::tempdir().unwrap();
        let folders = [own.path().to_owned()];
        let shipped = find_in(&folders, Kind::Scenario, "hover").unwrap();
        assert!(
            shipped.is_file() && !shipped.starts_with(own.path()),
            "{}",
            shipped.display()
        );
        std::fs::create_dir(own.path().join("scenarios")).unwrap();
        let mine = own.path().join("scenarios/hover.toml");
        std::fs::write(&mine, "").unwrap();
        assert_eq!(find_in(&folders, Kind::Scenario, "hover").unwrap(), mine);
        let known = list_in(&folders, Kind::Scenario).unwrap();
        assert_eq!(known.iter().filter(|named| named.name == "hover").count(), 1);
        assert!(known.iter().any(|named| named.name == "hover" && !named.shipped));
        assert!(
            known
                .iter()
                .any(|named| named.name == "reference-flight" && named.shipped)
        );
    }

    #[test]
    fn val_a_misspelt_name_is_answered_with_the_nearest() {
        let told = |name| find_in(&[], Kind::Scenario, name).unwrap_err().to_string();
        assert_eq!(
            told("referense-fligth"),
            "there is no scenario 'referense-fligth'; did you mean 'reference-flight'? ('rotortwin list scenarios' shows all)"
        );
        assert_eq!(
            told("zzz"),
            "there is no scenario 'zzz' ('rotortwin list scenarios' shows all)"
        );
        // A name never leads out of the folders.
        assert!(find_in(&[], Kind::Vehicle, "../vehicles/f550").is_err());
    }

    #[test]
    fn val_documents_name_paths_first_then_neighbours_then_names() {
        let own = tempfile::tempdir().unwrap();
        let scenarios = own.path().join("scenarios");
        std::fs::create_dir_all(own.path().join("vehicles")).unwrap();
        std::fs::create_dir(&scenarios).unwrap();
        let by_name = meant(Kind::Vehicle, &scenarios, "f550");
        assert!(by_name.is_file() && !by_name.starts_with(own.path()));
        std::fs::write(own.path().join("vehicles/f550.toml"), "").unwrap();
        assert!(meant(Kind::Vehicle, &scenarios, "f550").starts_with(own.path()));
        std::fs::write(scenarios.join("f550"), "").unwrap();
        assert_eq!(meant(Kind::Vehicle, &scenarios, "f550"), scenarios.join("f550"));
        assert_eq!(meant(Kind::Vehicle, &scenarios, "no-such"), scenarios.join("no-such"));
    }

    #[test]
    fn val_every_shipped_file_is_listed() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        for kind in Kind::ALL {
            let files = std::fs::read_dir(root.join(kind.folder())).unwrap().count();
            assert_eq!(list_in(&[], kind).unwrap().len(), files, "{}", kind.folder());
        }
    }
}
