//! Shipped and user configuration, found by name: `reference-flight` is a scenario wherever the program runs.
//!
//! A name is looked up in the folders of [`search_path`], first match wins, then among the files of `config/` embedded in the program.
//! Those are extracted on demand ([`shipped`]), so that a name is equivalent to a path from there on.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::shipped;

/// Environment variable with additional folders laid out as `config/`, separated as in `PATH`.
pub const SEARCH_PATH_VARIABLE: &str = "ROTORTWIN_CONFIG";

/// Below this similarity (Jaro–Winkler, 0 to 1) a name is not suggested as a misspelling of another.
const SIMILAR: f64 = 0.75;

/// A folder of the configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Scenarios.
    Scenario,
    /// Vehicles.
    Vehicle,
    /// Blade sets.
    Blades,
    /// User-defined effects.
    Effect,
    /// Campaigns: grids and random draws of flights.
    Campaign,
    /// Column mappings of log formats.
    LogMapping,
    /// Trained networks.
    Classifier,
}

impl Kind {
    /// All kinds, in display order.
    pub const ALL: [Self; 7] = [
        Self::Scenario,
        Self::Vehicle,
        Self::Blades,
        Self::Effect,
        Self::Campaign,
        Self::LogMapping,
        Self::Classifier,
    ];

    /// Its folder below `config/`; also its argument of `rotortwin list`.
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

    /// Singular noun.
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

    /// File extension.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Classifier => "json",
            _ => "toml",
        }
    }
}

/// A file found by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Without folder and extension.
    pub name: String,
    /// Its path.
    pub path: PathBuf,
    /// Embedded in the program: no folder of the search path has a file with this name.
    pub shipped: bool,
}

/// Why a name could not be resolved.
#[derive(Debug)]
pub enum NameError {
    /// Nothing of this kind has this name.
    Unknown {
        /// Kind requested.
        kind: Kind,
        /// Name requested.
        name: String,
        /// The closest existing name.
        nearest: Option<String>,
    },
    /// The embedded files cannot be extracted.
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
            Self::Shipped(error) => write!(out, "the program's own configuration cannot be written: {error}"),
        }
    }
}

impl std::error::Error for NameError {}

/// Folders searched before the embedded files: `./config`, those of [`SEARCH_PATH_VARIABLE`], the user's
/// (`$XDG_CONFIG_HOME/rotortwin`, otherwise `~/.config/rotortwin`). Some may not exist.
pub fn search_path() -> Vec<PathBuf> {
    let listed = std::env::var_os(SEARCH_PATH_VARIABLE);
    let user =
        shipped::variable_path("XDG_CONFIG_HOME").or_else(|| Some(shipped::variable_path("HOME")?.join(".config")));
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

/// Whether a text is a name rather than a path: no folder and no extension.
pub fn is_name(text: &str) -> bool {
    !text.is_empty() && !text.contains(['/', '\\', '.', '@'])
}

/// Most bytes of the name of a document.
pub const LONGEST: usize = 64;

/// Whether a name can be that of a folder, and needs no quotes: letters, digits, '-', '_' and '.', begun by a letter or digit.
pub fn is_plain(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    text.len() <= LONGEST && text.starts_with(|c: char| c.is_ascii_alphanumeric()) && text.chars().all(plain)
}

/// The file with this name.
///
/// # Errors
/// Nothing of this kind has this name, or the embedded files cannot be extracted.
pub fn find(kind: Kind, name: &str) -> Result<PathBuf, NameError> {
    find_in(&search_path(), kind, name)
}

/// What to type for a document: its name where that leads to this file, otherwise the path.
pub fn typed(kind: Kind, path: &Path) -> String {
    let name = path.file_stem().and_then(|stem| stem.to_str());
    let found = name.filter(|name| is_name(name) && find(kind, name).is_ok_and(|found| found == path));
    found.map_or_else(|| path.display().to_string(), str::to_owned)
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

/// All files of a kind, by name.
///
/// # Errors
/// The embedded files cannot be extracted.
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

/// Resolves `text` in a document: a path relative to its `directory`, or otherwise a name. An unknown name stays a path, so that the
/// error can point to its key.
pub fn meant(kind: Kind, directory: &Path, text: &str) -> PathBuf {
    let path = directory.join(text);
    if path.exists() || !is_name(text) {
        return path;
    }
    // Files next to the document take precedence: a folder laid out as `config/` is self-contained.
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

/// The closest match of a kind for a misspelt `name`.
pub fn nearest_of(kind: Kind, name: &str) -> Option<String> {
    let known = list(kind).ok()?;
    nearest(name, known.iter().map(|named| named.name.as_str())).map(str::to_owned)
}

/// The closest match in `known` for a misspelt `name`.
pub fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let length = |text: &str| text.chars().count();
    known
        // The measure is high for any text that begins with the few letters of a short one.
        .filter(|other| 2 * length(other) > length(name))
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
        // A name never escapes the folders.
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
