//! What may have been meant by a path that leads nowhere.
//!
//! Every refusal of a missing file begins with its path and a colon: scenarios, vehicles, models, logs, runs, classifiers, tables. They come
//! from six crates, some of which also answer strangers, who are told nothing about other files. So what is near is added here, where
//! refusals are printed to the person who typed the path.

use rotortwin_scenario::names::nearest;
use std::path::{Path, PathBuf};

/// What refusals of missing files say after the path.
const MISSING: [&str; 7] = [
    "No such file or directory",
    "file not found",
    "no run here",
    "none of this name",
    "none has this name",
    "no such file",
    "no campaign.json",
];

/// The sentence, with the nearest existing path if it refuses one that does not exist.
pub(crate) fn with_nearest(sentence: &str) -> String {
    let told = sentence
        .split_once(": ")
        .filter(|(_, reason)| MISSING.iter().any(|missing| reason.contains(missing)))
        .and_then(|(path, _)| meant(Path::new(path)));
    match told {
        Some(path) => format!("{sentence}; did you mean the {}?", named(&path)),
        None => sentence.to_owned(),
    }
}

/// `file 'mine.toml'` for the name `mine`, if the working folder holds it.
pub(crate) fn file_of(name: &str, ending: &str) -> Option<String> {
    let path = PathBuf::from(format!("{name}.{ending}"));
    path.is_file().then(|| named(&path))
}

fn named(path: &Path) -> String {
    let what = if path.is_dir() { "folder" } else { "file" };
    format!("{what} '{}'", path.display())
}

/// The existing path most similar to `path`; none if `path` exists, or nothing is similar.
fn meant(path: &Path) -> Option<PathBuf> {
    (!path.exists()).then(|| mended(path)).flatten()
}

/// `path`, with each component that does not exist replaced by the nearest sibling.
fn mended(path: &Path) -> Option<PathBuf> {
    if path.as_os_str().is_empty() || path.exists() {
        return Some(path.to_owned());
    }
    let folder = mended(path.parent()?)?;
    let name = path.file_name()?.to_str()?;
    if folder.join(name).exists() {
        return Some(folder.join(name));
    }
    with_stem(&folder, name).or_else(|| {
        let beside = names_in(&folder);
        nearest(name, beside.iter().map(String::as_str)).map(|other| folder.join(other))
    })
}

/// The file of a folder that has this name but for its ending.
fn with_stem(folder: &Path, name: &str) -> Option<PathBuf> {
    let stem = |other: &String| Path::new(other).file_stem().is_some_and(|stem| stem == name);
    let found = names_in(folder)
        .into_iter()
        .find(|other| other != name && stem(other))?;
    Some(folder.join(found))
}

/// Names in a folder in alphabetical order, without hidden ones; the working folder for an empty path.
fn names_in(folder: &Path) -> Vec<String> {
    let folder = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter(|name| !name.starts_with('.')).collect();
    names.sort();
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_missing_path_is_answered_with_the_nearest() {
        let folder = tempfile::tempdir().unwrap();
        let here = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(here("runs/hover-1")).unwrap();
        for name in ["flight.ulg", "mine.toml", ".hidden.toml", "runs/hover-1/summary.json"] {
            std::fs::write(here(name), "").unwrap();
        }
        let told = |name: &str, reason: &str| {
            let path = here(name).display().to_string();
            let sentence = format!("{path}: {reason}");
            let said = with_nearest(&sentence);
            let added = said.strip_prefix(&sentence).expect("the sentence is kept").to_owned();
            added.replace(&format!("{}/", folder.path().display()), "")
        };
        let missing = "cannot read the log: No such file or directory (os error 2)";
        assert_eq!(told("fligth.ulg", missing), "; did you mean the file 'flight.ulg'?");
        assert_eq!(
            told("runs/hovr-1", "no run here"),
            "; did you mean the folder 'runs/hover-1'?"
        );
        assert_eq!(
            told("rusn/hover-1", "no run here"),
            "; did you mean the folder 'runs/hover-1'?"
        );
        assert_eq!(
            told("rusn/hover-1/sumary.json", "no run here"),
            "; did you mean the file 'runs/hover-1/summary.json'?"
        );
        assert_eq!(
            told("mine", "there is none of this name"),
            "; did you mean the file 'mine.toml'?"
        );
        // Nothing is near; a hidden file; it exists; the refusal is about something else.
        assert_eq!(told("zzz.bin", missing), "");
        assert_eq!(told("hidden.toml.x/y", missing), "");
        assert_eq!(told("flight.ulg", missing), "");
        assert_eq!(told("fligth.ulg", "cannot be written: read-only file system"), "");
    }
}
