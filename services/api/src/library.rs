//! Scenarios and vehicles that the server has: a folder laid out as `config/` of the project. A submission names them; it cannot make
//! the server read another file.

use crate::artifacts::{Artifacts, files_below};
use crate::problem::Problem;
use rotortwin_plant::{Classifier, Scenario, VehicleDocuments};
use std::io;
use std::path::{Component, Path, PathBuf};

/// Keys of a scenario that are paths of files.
const PATHS: [&str; 3] = ["vehicle", "fdi", "effect_files"];

/// A file of a library is a document; what is larger is none.
const LARGEST_FILE: u64 = 16 << 20;

/// The folder.
#[derive(Debug, Clone)]
pub(crate) struct Library {
    root: PathBuf,
}

impl Library {
    /// # Errors
    /// There is no such folder, or it has no `scenarios`.
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

    /// Names of the files with an ending, without it, in order.
    fn files(&self, kind: &str, ending: &str) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(self.root.join(kind)) else {
            return Vec::new();
        };
        let mut names: Vec<String> = entries
            .filter_map(Result::ok)
            .map(|entry| entry.path())
            .filter(|path| path.extension().is_some_and(|extension| extension == ending))
            .filter_map(|path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned()))
            .collect();
        names.sort();
        names
    }

    /// The text of a document.
    ///
    /// # Errors
    /// 404.
    pub(crate) fn text(&self, kind: &str, name: &str) -> Result<String, Problem> {
        let known = self.names(kind);
        if !known.iter().any(|other| other == name) {
            let singular = kind.trim_end_matches('s');
            return Err(Problem::not_found(format!(
                "there is no {singular} '{name}'; expected one of {}",
                known.join(", ")
            )));
        }
        std::fs::read_to_string(self.root.join(kind).join(format!("{name}.toml")))
            .map_err(|error| Problem::internal(&error))
    }

    /// A scenario by name with keys set.
    ///
    /// # Errors
    /// 404 for the name; 422 for what cannot be flown, and for a path that leads out of the library.
    pub(crate) fn scenario(&self, name: &str, set: &[String]) -> Result<Scenario, Problem> {
        self.text("scenarios", name)?;
        for setting in set {
            stays_inside(setting)?;
        }
        let path = self.root.join("scenarios").join(format!("{name}.toml"));
        let set: Vec<&str> = set.iter().map(String::as_str).collect();
        Scenario::load_with(&path, &set).map_err(|error| self.refusal(&error))
    }

    /// A scenario from a text, as it would stand in `scenarios/`.
    ///
    /// # Errors
    /// 422.
    pub(crate) fn parse(&self, text: &str) -> Result<Scenario, Problem> {
        // A text that is no TOML is refused below, with the line.
        if let Ok(table) = toml::from_str::<toml::Table>(text) {
            for key in PATHS {
                table.get(key).map_or(Ok(()), every_path_inside)?;
            }
        }
        Scenario::parse(text, self.root.join("scenarios")).map_err(|error| self.refusal(&error))
    }

    /// Whether every path in a document stays in the library; `name` and `description` are words.
    ///
    /// # Errors
    /// 422.
    pub(crate) fn check_paths(document: &toml::Table) -> Result<(), Problem> {
        document
            .iter()
            .filter(|(key, _)| !["name", "description"].contains(&key.as_str()))
            .try_for_each(|(_, value)| every_path_inside(value))
    }

    /// Where it is.
    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    /// Puts a copy of the library into the artifact store, under the hash of all that is in it, and gives its key: a job that is done on
    /// another host, or tomorrow, reads what was there when it was submitted.
    ///
    /// # Errors
    /// A file cannot be read or written.
    pub(crate) async fn snapshot(&self, artifacts: &Artifacts) -> io::Result<String> {
        let mut hash = xxhash_rust::xxh3::Xxh3::new();
        let mut files = Vec::new();
        for file in files_below(&self.root)? {
            if file.size > LARGEST_FILE {
                continue;
            }
            let bytes = std::fs::read(self.root.join(&file.path))?;
            hash.update(file.path.as_bytes());
            hash.update(&(bytes.len() as u64).to_le_bytes());
            hash.update(&bytes);
            files.push((file.path, bytes));
        }
        let key = format!("library/{:032x}", hash.digest128());
        let marker = "snapshot.complete";
        if artifacts.file(&key, marker).await?.is_some() {
            return Ok(key);
        }
        // The marker last: a copy that was cut off is made again.
        files.push((marker.to_owned(), b"complete\n".to_vec()));
        for (path, bytes) in files {
            let target = artifacts.place(&key).join(&path);
            let beside = target.with_extension(crate::jobs::queue::new_id());
            std::fs::create_dir_all(target.parent().unwrap_or(&target))?;
            std::fs::write(&beside, bytes)?;
            std::fs::rename(&beside, &target)?;
        }
        artifacts.publish(&key).await?;
        Ok(key)
    }

    /// A vehicle by name, with its blades.
    ///
    /// # Errors
    /// 404 for the name; 422 for what cannot fly.
    pub(crate) fn vehicle_documents(&self, name: &str) -> Result<VehicleDocuments, Problem> {
        self.text("vehicles", name)?;
        let path = self.root.join("vehicles").join(format!("{name}.toml"));
        VehicleDocuments::load(path).map_err(|error| self.refusal(&error))
    }

    /// A vehicle from a text, as it would stand in `vehicles/`.
    ///
    /// # Errors
    /// 422.
    pub(crate) fn parse_vehicle(&self, text: &str) -> Result<VehicleDocuments, Problem> {
        // A text that is no TOML is refused below, with the line.
        let table = toml::from_str::<toml::Table>(text).unwrap_or_default();
        if let Some(blades) = table.get("rotors").and_then(|rotors| rotors.get("blades")) {
            every_path_inside(blades)?;
        }
        VehicleDocuments::parse(text, self.root.join("vehicles")).map_err(|error| self.refusal(&error))
    }

    /// A classifier by name.
    ///
    /// # Errors
    /// 404 for the name; 422 for a file that is none.
    pub(crate) fn classifier(&self, name: &str) -> Result<Classifier, Problem> {
        let known = self.files("classifiers", "json");
        if !known.iter().any(|other| other == name) {
            return Err(Problem::not_found(format!(
                "there is no classifier '{name}'; expected one of {}",
                known.join(", ")
            )));
        }
        let path = self.root.join("classifiers").join(format!("{name}.json"));
        Classifier::read(&path).map_err(|error| self.refusal(&error))
    }

    /// A refusal without the server's paths.
    pub(crate) fn refusal(&self, error: &dyn std::fmt::Display) -> Problem {
        let root = format!("{}/", self.root.display());
        Problem::unprocessable(error.to_string().replace(&root, ""))
    }
}

/// The value of a setting `key=value` with a path's key must lead to a file of the library.
fn stays_inside(setting: &str) -> Result<(), Problem> {
    let Some((key, value)) = setting.split_once('=') else {
        return Ok(());
    };
    let first = key
        .split('.')
        .next()
        .unwrap_or_default()
        .trim()
        .trim_matches(['"', '\'']);
    if !PATHS.contains(&first) {
        return Ok(());
    }
    // As the scenario reads it: a TOML value, or a bare word.
    let value = value.trim();
    match toml::from_str::<toml::Table>(&format!("value = {value}")) {
        Ok(table) => table.values().try_for_each(every_path_inside),
        Err(_) => inside(value),
    }
}

fn every_path_inside(value: &toml::Value) -> Result<(), Problem> {
    match value {
        toml::Value::String(text) => inside(text),
        toml::Value::Array(values) => values.iter().try_for_each(every_path_inside),
        toml::Value::Table(table) => table.values().try_for_each(every_path_inside),
        _ => Ok(()),
    }
}

/// Relative to `scenarios/`, and not out of the library.
fn inside(path: &str) -> Result<(), Problem> {
    let mut depth = 1_i32; // scenarios/
    let mut inside = !path.contains('\\');
    for part in Path::new(path).components() {
        match part {
            Component::ParentDir => depth -= 1,
            Component::Normal(_) => depth += 1,
            Component::CurDir => {}
            Component::RootDir | Component::Prefix(_) => inside = false,
        }
        inside &= depth >= 0;
    }
    if inside {
        return Ok(());
    }
    Err(Problem::unprocessable(format!(
        "'{path}' leads out of the library; expected a path such as ../vehicles/f550.toml"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_paths_stay_in_the_library() {
        for good in [
            "vehicle=../vehicles/f550.toml",
            "fdi.network='../classifiers/a.json'",
            "seed=3",
            "name='/x'",
        ] {
            assert_eq!(stays_inside(good), Ok(()), "{good}");
        }
        for bad in [
            "vehicle=/etc/passwd",
            "vehicle='../../secret.toml'",
            "fdi.network=\"..\\\\..\\\\x\"",
            "effect_files=['a.toml', '../../../x.toml']",
            "fdi={network='/x'}",
            "vehicle=../vehicles/../../x",
        ] {
            let refusal = stays_inside(bad).expect_err(bad);
            assert_eq!(refusal.status, 422, "{bad}");
        }
    }
}
