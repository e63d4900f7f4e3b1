//! Scenarios, vehicles, effects and models that a caller can name: a folder laid out as `config/` of the project. A submission cannot make
//! the server read any other file.

pub(crate) mod own;
mod paths;
pub(crate) mod unused;
pub(crate) mod versions;

use self::paths::{PATHS, every_path_inside, stays_inside};
use crate::artifacts::{Artifacts, files_below};
use crate::problem::Problem;
use rotortwin_plant::effects::{Catalogue, EffectDocument};
use rotortwin_plant::error::Refusal;
use rotortwin_scenario::complaints::complaints;
use rotortwin_scenario::toml_document::too_much;
use rotortwin_scenario::{Classifier, ConfigError, Scenario, VehicleDocuments, effect_documents, vehicle_documents};
use rotortwin_twin::model::ModelVersion;
use serde::Serialize;
use std::io;
use std::path::{Path, PathBuf};
use utoipa::ToSchema;

/// How the name of a file of intervals ends, before its extension.
const INTERVALS: &str = ".intervals";
/// Folder of the copies for jobs, in the file store ([`Library::snapshot`]).
const COPIES: &str = "library";
/// Prefix of temporary copies, in the data folder ([`Library::with_files`]).
const TEMPORARY: &str = "temporary-library-";
/// Maximum size of a library file.
const LARGEST_FILE: u64 = 16 << 20;

/// Kinds of documents that clients can store in the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DocumentKind {
    Scenario,
    Vehicle,
    Blades,
    Effect,
    /// A version of a model, as `rotortwin model export` writes it.
    Model,
    /// How well the constants of a vehicle of the same name are known; kept with an identified vehicle, and in no list.
    Intervals,
}

impl DocumentKind {
    /// Folder in the library.
    pub(crate) const fn folder(self) -> &'static str {
        match self {
            Self::Scenario => "scenarios",
            Self::Vehicle => "vehicles",
            Self::Blades => "blades",
            Self::Effect => "effects",
            Self::Model => "models",
            Self::Intervals => "intervals",
        }
    }

    /// Path of a document in the library. Intervals are in the same folder as their vehicle: who loads the one gets the other with it.
    pub(crate) fn path(folder: &str, name: &str) -> String {
        if folder == Self::Intervals.folder() {
            return format!("{}/{name}{INTERVALS}.toml", Self::Vehicle.folder());
        }
        format!("{folder}/{name}.toml")
    }
}

/// An error in a document.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub(crate) struct Complaint {
    /// Dotted path of the key; absent: the whole document.
    pub(crate) key: Option<String>,
    /// Line of the text, from 1.
    pub(crate) line: Option<usize>,
    /// The complete message in one sentence: where, what was expected, what was found.
    pub(crate) sentence: String,
}

/// The library.
#[derive(Debug, Clone)]
pub(crate) struct Library {
    root: PathBuf,
}

impl Library {
    /// # Errors
    /// The folder does not exist, or has no `scenarios`.
    pub(crate) fn open(root: &Path) -> Result<Self, String> {
        let told = |error| format!("{}: cannot be used as library: {error}", root.display());
        let root = root.canonicalize().map_err(told)?;
        if !root.join("scenarios").is_dir() {
            return Err(format!(
                "{}: expected a folder 'scenarios' in the library, as in config/ of the project",
                root.display()
            ));
        }
        Ok(Self { root })
    }

    /// Names in a folder of the library, in order.
    pub(crate) fn names(&self, kind: &str) -> Vec<String> {
        self.files(kind, "toml")
    }

    /// Names of the files with an extension, without it, in order.
    fn files(&self, kind: &str, ending: &str) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(self.root.join(kind)) else {
            return Vec::new();
        };
        let mut names: Vec<String> = entries
            .filter_map(Result::ok)
            .map(|entry| entry.path())
            .filter(|path| path.extension().is_some_and(|extension| extension == ending))
            .filter_map(|path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned()))
            .filter(|name| !name.ends_with(INTERVALS))
            .collect();
        names.sort();
        names
    }

    /// Whether it has a document.
    pub(crate) fn has(&self, kind: &str, name: &str) -> bool {
        self.names(kind).iter().any(|known| known == name)
    }

    /// The text of a document.
    ///
    /// # Errors
    /// 404.
    pub(crate) fn text(&self, kind: &str, name: &str) -> Result<String, Problem> {
        if !self.has(kind, name) {
            let known = self.names(kind);
            let singular = kind.trim_end_matches('s');
            return Err(Problem::not_found(match known.as_slice() {
                [] => format!("there is no {singular} '{name}': the library has no {kind} yet"),
                known => format!("there is no {singular} '{name}'; expected one of {}", known.join(", ")),
            }));
        }
        std::fs::read_to_string(self.file(kind, name, "toml")).map_err(|error| Problem::internal(&error))
    }

    /// A scenario by name with overridden keys.
    ///
    /// # Errors
    /// 404 for the name; 422 for an unflyable scenario, and for a path that leads out of the library.
    pub(crate) fn scenario(&self, name: &str, set: &[String]) -> Result<Scenario, Problem> {
        self.text("scenarios", name)?;
        if let Some(reason) = too_much(&set.join("\n")) {
            return Err(Problem::unprocessable(format!("`set`: {reason}")));
        }
        for setting in set {
            stays_inside(setting)?;
        }
        let path = self.file("scenarios", name, "toml");
        let set: Vec<&str> = set.iter().map(String::as_str).collect();
        Scenario::load_with(&path, &set).map_err(|error| self.refusal(&error))
    }

    /// A scenario from a text, with paths relative to `scenarios/`.
    ///
    /// # Errors
    /// 422.
    pub(crate) fn parse(&self, text: &str) -> Result<Scenario, Problem> {
        paths_inside(DocumentKind::Scenario, &table_of(text))?;
        Scenario::parse(text, self.root.join("scenarios"))
            .map_err(|error| self.refused(DocumentKind::Scenario, text, &error))
    }

    /// All errors of a document, checked as part of the library; empty if valid.
    pub(crate) fn complaints(&self, kind: DocumentKind, text: &str) -> Vec<Complaint> {
        if let Err(problem) = paths_inside(kind, &table_of(text)) {
            return vec![Complaint {
                key: None,
                line: None,
                sentence: problem.detail,
            }];
        }
        let folder = self.root.join(kind.folder());
        let found = match kind {
            DocumentKind::Scenario => Scenario::complaints(text, folder),
            DocumentKind::Vehicle => VehicleDocuments::complaints(text, folder),
            DocumentKind::Blades => complaints("blades", text, "", |text| {
                vehicle_documents::parse_blades("blades", text).map(|_| ())
            }),
            DocumentKind::Effect => complaints("effect", text, "", |text| {
                effect_documents::parse("effect", text).map(|_| ())
            }),
            DocumentKind::Model => complaints("model", text, "", |text| {
                ModelVersion::parse("model", text, &folder).map(|_| ())
            }),
            // Nobody sends them: an identification writes them.
            DocumentKind::Intervals => Vec::new(),
        };
        found.iter().map(|error| self.complaint(error)).collect()
    }

    fn complaint(&self, error: &ConfigError) -> Complaint {
        Complaint {
            key: error.key().map(str::to_owned),
            line: error.line(),
            sentence: self.without_root(error),
        }
    }

    /// 422 with all errors of a document.
    fn refused(&self, kind: DocumentKind, text: &str, error: &ConfigError) -> Problem {
        let all = self.complaints(kind, text);
        self.refusal(error)
            .with_complaints(all.into_iter().map(|complaint| complaint.sentence).collect())
    }

    /// The effect documents of the library.
    ///
    /// # Errors
    /// 422: one is invalid.
    pub(crate) fn effect_documents(&self) -> Result<Vec<EffectDocument>, Problem> {
        self.names(DocumentKind::Effect.folder())
            .iter()
            .map(|name| {
                let path = self.root.join("effects").join(format!("{name}.toml"));
                effect_documents::load(path).map_err(|error| self.refusal(&error))
            })
            .collect()
    }

    /// The built-in effects, with the documents of the library.
    ///
    /// # Errors
    /// 422: a document is invalid.
    pub(crate) fn catalogue(&self) -> Result<Catalogue, Problem> {
        Catalogue::with_documents(&self.effect_documents()?)
            .map_err(|refusal: Refusal| Problem::unprocessable(refusal.reason))
    }

    /// A version of a model by name.
    ///
    /// # Errors
    /// 404 for the name; 422 for an invalid file.
    pub(crate) fn model(&self, name: &str) -> Result<ModelVersion, Problem> {
        self.text("models", name)?;
        let path = self.root.join("models").join(format!("{name}.toml"));
        ModelVersion::load(path).map_err(|error| self.refusal(&error))
    }

    /// A version of a model from a self-contained text.
    ///
    /// # Errors
    /// 422.
    pub(crate) fn parse_model(&self, text: &str) -> Result<ModelVersion, Problem> {
        paths_inside(DocumentKind::Model, &table_of(text))?;
        ModelVersion::parse("version", text, &self.root.join("models"))
            .map_err(|error| self.refused(DocumentKind::Model, text, &error))
    }

    /// Whether every path in a document stays in the library; `name` and `description` are free text.
    ///
    /// # Errors
    /// 422.
    pub(crate) fn check_paths(document: &toml::Table) -> Result<(), Problem> {
        document
            .iter()
            .filter(|(key, _)| !["name", "description"].contains(&key.as_str()))
            .try_for_each(|(_, value)| every_path_inside(value))
    }

    /// Path of the document with this name, if it exists.
    pub(crate) fn file(&self, kind: &str, name: &str, ending: &str) -> PathBuf {
        self.root.join(kind).join(format!("{name}.{ending}"))
    }

    /// Path of the library.
    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    /// Copies the library into the artifact store, under the hash of its content, and returns the key: a job executed later or on another
    /// host reads what was there at its submission.
    ///
    /// # Errors
    /// A file cannot be read or written.
    pub(crate) async fn snapshot(&self, artifacts: &Artifacts) -> io::Result<String> {
        let (root, store) = (self.root.clone(), artifacts.clone());
        let marker = "snapshot.complete";
        let read = tokio::task::spawn_blocking(move || read_all(&root)).await;
        let (key, mut files) = read.map_err(io::Error::other)??;
        if artifacts.file(&key, marker).await?.is_some() {
            return Ok(key);
        }
        // The marker last: an interrupted copy is repeated.
        files.push((marker.to_owned(), b"complete\n".to_vec()));
        // Not all that lies there: another request may be writing the same copy, and its files beside these are gone in a moment.
        let paths: Vec<String> = files.iter().map(|(path, _)| path.clone()).collect();
        let place = store.place(&key);
        let written = tokio::task::spawn_blocking(move || {
            files.into_iter().try_for_each(|(path, bytes)| {
                let target = place.join(&path);
                let beside = target.with_extension(crate::jobs::queue::new_id());
                std::fs::create_dir_all(target.parent().unwrap_or(&target))?;
                std::fs::write(&beside, bytes)?;
                std::fs::rename(&beside, &target)
            })
        });
        written.await.map_err(io::Error::other)??;
        for path in &paths {
            artifacts.publish_file(&key, path).await?;
        }
        Ok(key)
    }

    /// A copy with additional files, each at a path within it, in a temporary folder that is removed on drop.
    ///
    /// # Errors
    /// A file cannot be read or written.
    pub(crate) fn with_files(
        &self,
        beside: &Path,
        files: &[(String, String)],
    ) -> io::Result<(Self, tempfile::TempDir)> {
        let folder = tempfile::Builder::new().prefix(TEMPORARY).tempdir_in(beside)?;
        copy_all(&self.root, folder.path())?;
        for (path, text) in files {
            let target = folder.path().join(path);
            std::fs::create_dir_all(target.parent().unwrap_or(&target))?;
            std::fs::write(target, text)?;
        }
        let root = folder.path().canonicalize()?;
        Ok((Self { root }, folder))
    }

    /// A vehicle by name, with its blades.
    ///
    /// # Errors
    /// 404 for the name; 422 for an unflyable vehicle.
    pub(crate) fn vehicle_documents(&self, name: &str) -> Result<VehicleDocuments, Problem> {
        self.text("vehicles", name)?;
        VehicleDocuments::load(self.file("vehicles", name, "toml")).map_err(|error| self.refusal(&error))
    }

    /// Version 0 of the model of a vehicle, with the intervals of its constants where they are known.
    ///
    /// # Errors
    /// 404 for the name; 422 for an unflyable vehicle.
    pub(crate) fn first_version(&self, name: &str) -> Result<ModelVersion, Problem> {
        self.text("vehicles", name)?;
        let mut version =
            ModelVersion::load(self.file("vehicles", name, "toml")).map_err(|error| self.refusal(&error))?;
        name.clone_into(&mut version.name);
        Ok(version)
    }

    /// A vehicle from a text, with paths relative to `vehicles/`.
    ///
    /// # Errors
    /// 422.
    pub(crate) fn parse_vehicle(&self, text: &str) -> Result<VehicleDocuments, Problem> {
        paths_inside(DocumentKind::Vehicle, &table_of(text))?;
        VehicleDocuments::parse(text, self.root.join("vehicles"))
            .map_err(|error| self.refused(DocumentKind::Vehicle, text, &error))
    }

    /// A classifier by name.
    ///
    /// # Errors
    /// 404 for the name; 422 for an invalid file.
    pub(crate) fn classifier(&self, name: &str) -> Result<Classifier, Problem> {
        let known = self.files("classifiers", "json");
        if !known.iter().any(|other| other == name) {
            return Err(Problem::not_found(format!(
                "there is no classifier '{name}'; expected one of {}",
                known.join(", ")
            )));
        }
        Classifier::read(&self.file("classifiers", name, "json")).map_err(|error| self.refusal(&error))
    }

    /// An error without the server's paths.
    pub(crate) fn refusal(&self, error: &dyn std::fmt::Display) -> Problem {
        Problem::unprocessable(self.without_root(error))
    }

    /// A text without the server's paths.
    pub(crate) fn without_root(&self, error: &dyn std::fmt::Display) -> String {
        let root = format!("{}/", self.root.display());
        error.to_string().replace(&root, "")
    }
}

/// The table that a text is; empty for one that is not TOML, or too much to be looked at: the reader of its kind refuses it with the reason.
fn table_of(text: &str) -> toml::Table {
    match too_much(text) {
        None => toml::from_str(text).unwrap_or_default(),
        Some(_) => toml::Table::new(),
    }
}

/// Whether the paths in a document lead to files of the library.
fn paths_inside(kind: DocumentKind, document: &toml::Table) -> Result<(), Problem> {
    let inside = |value: Option<&toml::Value>| value.map_or(Ok(()), every_path_inside);
    match kind {
        DocumentKind::Scenario => PATHS.iter().try_for_each(|key| inside(document.get(*key))),
        DocumentKind::Vehicle => inside(document.get("rotors").and_then(|rotors| rotors.get("blades"))),
        DocumentKind::Model if document.contains_key("vehicle_file") => Err(Problem::unprocessable(
            "key `vehicle_file`: expected a self-contained version, with `[vehicle]` and `[blades]`, as `rotortwin model export` writes it",
        )),
        DocumentKind::Model | DocumentKind::Blades | DocumentKind::Effect | DocumentKind::Intervals => Ok(()),
    }
}

/// A file's path and bytes.
type Content = (String, Vec<u8>);

/// All documents below a folder, and the key of a copy of them.
fn read_all(root: &Path) -> io::Result<(String, Vec<Content>)> {
    let mut hash = xxhash_rust::xxh3::Xxh3::new();
    let mut files = Vec::new();
    for file in files_below(root)? {
        if file.size > LARGEST_FILE {
            continue;
        }
        let bytes = std::fs::read(root.join(&file.path))?;
        hash.update(file.path.as_bytes());
        hash.update(&(bytes.len() as u64).to_le_bytes());
        hash.update(&bytes);
        files.push((file.path, bytes));
    }
    Ok((format!("{COPIES}/{:032x}", hash.digest128()), files))
}

/// Copies every plain file below a folder.
fn copy_all(from: &Path, to: &Path) -> io::Result<()> {
    for file in files_below(from)? {
        let target = to.join(&file.path);
        std::fs::create_dir_all(target.parent().unwrap_or(&target))?;
        std::fs::copy(from.join(&file.path), target)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_what_would_take_too_much_is_refused_before_it_is_parsed() {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let library = Library::open(&config).expect("the project's own");
        let long = format!("a = 1 # {}", "x".repeat(1 << 20));
        let many = format!("a = 1\n{}", "[b]\n".repeat(100_001));
        for (text, words) in [
            (&long, "at most 1048576 bytes"),
            (&many, "at most 100000 of `[`, `{` and `.`"),
        ] {
            assert_eq!(table_of(text), toml::Table::new());
            let refusals = [
                library.parse(text).map(drop),
                library.parse_vehicle(text).map(drop),
                library.parse_model(text).map(drop),
            ];
            for refusal in refusals {
                let problem = refusal.expect_err("too much");
                assert_eq!((problem.status, problem.complaints.len()), (422, 1), "{problem:?}");
                assert!(problem.detail.contains(words), "{}", problem.detail);
            }
        }
        let set = |setting: String| {
            library
                .scenario("short-hover", &[setting])
                .map(drop)
                .expect_err("too much")
                .detail
        };
        let deep = |parts: usize| format!("a{} = 1", ".a".repeat(parts));
        assert!(set(deep(1000)).contains("a key of at most 80 parts"));
        assert!(set(deep(200_000)).starts_with("`set`: expected a document with at most 100000 of"));
        assert!(
            set(format!("vehicle = \"{}\"", "a".repeat(1 << 20))).starts_with("`set`: expected a document of at most")
        );
    }

    /// First submissions of many clients at once.
    #[tokio::test(flavor = "multi_thread", worker_threads = 4)]
    async fn regress_requests_that_copy_the_same_library_at_once_do_not_disturb_each_other() {
        let scratch = tempfile::tempdir().expect("a folder");
        let artifacts = Artifacts::open(&scratch.path().join("artifacts"), None).expect("it opens");
        let root = scratch.path().join("library");
        std::fs::create_dir_all(root.join("scenarios")).expect("made");
        for turn in 0..5 {
            for file in 0..40 {
                let text = format!("turn = {turn}\n");
                std::fs::write(root.join(format!("scenarios/{file}.toml")), text).expect("written");
            }
            let library = Library { root: root.clone() };
            let copies = (0..8).map(|_| {
                let (library, artifacts) = (library.clone(), artifacts.clone());
                tokio::spawn(async move { library.snapshot(&artifacts).await })
            });
            let keys: Vec<_> = futures_util::future::join_all(copies)
                .await
                .into_iter()
                .map(|key| key.expect("no panic").expect("copied"))
                .collect();
            assert!(keys.iter().all(|key| *key == keys[0]));
            let files = artifacts.list(&keys[0]).await.expect("listed");
            assert_eq!(files.len(), 41, "the files and the marker, nothing else: {files:?}");
        }
    }
}
