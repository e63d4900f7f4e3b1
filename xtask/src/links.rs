//! Dead links and file names in Markdown.
//!
//! Checked: relative links `[text](target)`, including the heading if the target has one; paths anywhere in the text that begin with
//! a folder of the root (`crates/plant/src/vector.rs`); and, in code spans, names of Rust files (`vector.rs`) and ends of paths of
//! source files (`src/vector.rs`). Not checked: web addresses; names with wildcards or placeholders; file names in
//! `CHANGELOG.md`, which names removed files.

use anyhow::{Context, Result, bail};
use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

/// Names that look like files here but are not.
const NO_FILES: [&str; 7] = [
    // Not in Git.
    "deploy/secrets",
    "fuzz/artifacts",
    "fuzz/corpus",
    // A Kubernetes deployment.
    "deploy/api",
    // A file of iceoryx2 in its working folder.
    "config/iceoryx2.toml",
    // Created by the preceding command; an example of an error message.
    "config/vehicles/short-lag.toml",
    "config/blades/none.toml",
];

/// Fails with a line for each dead link or name.
///
/// * `files`: all files of the tree, absolute
pub(crate) fn check(root: &Path, files: &[PathBuf]) -> Result<()> {
    let tree = Tree::new(root, files);
    let mut complaints = Vec::new();
    for file in tree
        .files
        .iter()
        .filter(|file| file.extension().is_some_and(|e| e == "md"))
    {
        if file.starts_with("third_party") {
            continue;
        }
        let text = std::fs::read_to_string(root.join(file)).with_context(|| file.display().to_string())?;
        for (number, line) in text.lines().enumerate() {
            let dead_links = links(line).filter(|target| !tree.has_link(root, file, target));
            let dead_names = names(line).filter(|name| file != Path::new("CHANGELOG.md") && !tree.has_name(file, name));
            for dead in dead_links.chain(dead_names) {
                complaints.push(format!("{}:{}: {dead} leads nowhere", file.display(), number + 1));
            }
        }
    }
    if complaints.is_empty() {
        return Ok(());
    }
    bail!("dead links or file names\n  {}", complaints.join("\n  "))
}

/// Files and folders of the tree, relative to the root.
struct Tree {
    files: BTreeSet<PathBuf>,
    folders: BTreeSet<PathBuf>,
}

impl Tree {
    fn new(root: &Path, files: &[PathBuf]) -> Self {
        let files: BTreeSet<PathBuf> = files
            .iter()
            .filter_map(|file| Some(file.strip_prefix(root).ok()?.to_path_buf()))
            .filter(|file| root.join(file).exists())
            .collect();
        let folders = files
            .iter()
            .flat_map(|file| file.ancestors().skip(1))
            .map(Path::to_path_buf)
            .collect();
        Self { files, folders }
    }

    fn has(&self, path: &Path) -> bool {
        self.files.contains(path) || self.folders.contains(path)
    }

    /// True if a link in a file leads to an existing file or folder, and to an existing heading if it names one.
    fn has_link(&self, root: &Path, file: &Path, target: &str) -> bool {
        let (path, heading) = target
            .split_once('#')
            .map_or((target, None), |(path, heading)| (path, Some(heading)));
        let path = if path.is_empty() {
            file.to_path_buf()
        } else {
            joined(file, path)
        };
        match heading {
            Some(heading) if path.extension().is_some_and(|e| e == "md") => std::fs::read_to_string(root.join(&path))
                .is_ok_and(|text| text.lines().any(|line| line.starts_with('#') && slug(line) == heading)),
            _ => self.has(&path),
        }
    }

    /// True if a name in the text of a file is that of a file or folder: from the root, from the file's folder, or, if it does not
    /// begin with a folder of the root, the end of any file's path.
    fn has_name(&self, file: &Path, name: &str) -> bool {
        if NO_FILES.iter().any(|none| Path::new(name).starts_with(none)) {
            return true;
        }
        let is_from_root = name.split_once('/').is_some_and(|(first, _)| FOLDERS.contains(&first));
        expanded(name).iter().all(|name| {
            let name = name.trim_end_matches('/');
            let is_end_of_path = || !is_from_root && self.files.iter().any(|path| path.ends_with(name));
            self.has(Path::new(name)) || self.has(&joined(file, name)) || is_end_of_path()
        })
    }
}

/// Targets of the relative links of a line.
fn links(line: &str) -> impl Iterator<Item = String> {
    line.split("](").skip(1).filter_map(|rest| {
        let target = rest.split([')', ' ']).next()?;
        let is_relative = !target.contains("://") && !target.starts_with("mailto:") && !target.starts_with('/');
        is_relative.then(|| target.to_owned())
    })
}

/// Folders of the root that file names begin with.
const FOLDERS: [&str; 16] = [
    "cli",
    "clients",
    "config",
    "crates",
    "deploy",
    "docs",
    "examples",
    "firmware",
    "fuzz",
    "proto",
    "services",
    "tests",
    "third_party",
    "tools",
    "web",
    "xtask",
];

/// Extensions of source files checked in code spans.
const SOURCES: [&str; 5] = [".rs", ".proto", ".py", ".ts", ".tsx"];

/// File names of a line: paths from the root, and source files in code spans.
fn names(line: &str) -> impl Iterator<Item = String> {
    let is_part = |c: char| c.is_alphanumeric() || "_-./{},*<>…$".contains(c);
    let paths = line.split(move |c| !is_part(c)).filter_map(|word| {
        let word = word.trim_end_matches(['.', ',']);
        let (first, rest) = word.split_once('/')?;
        let is_plain = !rest.contains(['*', '<', '>', '…', '$']) && !rest.contains("..") && !rest.is_empty();
        // NAME in capitals is a placeholder.
        let is_placeholder = |part: &str| {
            let stem = part.split('.').next().unwrap_or(part);
            stem.len() > 1 && stem != "README" && stem.chars().all(|c| c.is_ascii_uppercase() || c == '_')
        };
        (FOLDERS.contains(&first) && is_plain && !rest.split('/').any(is_placeholder)).then(|| word.to_owned())
    });
    let spans = line.split('`').skip(1).step_by(2).filter(|span| {
        // A name without a folder may be another project's script.
        let endings = if span.contains('/') {
            &SOURCES[..]
        } else {
            &SOURCES[..1]
        };
        let is_source = endings
            .iter()
            .any(|ending| span.len() > ending.len() && span.ends_with(ending));
        let is_plain = span.chars().all(|c| c.is_alphanumeric() || "_-./{},".contains(c)) && !span.starts_with('/');
        // Names that begin with a folder of the root are already among the paths.
        let is_path = span.split_once('/').is_some_and(|(first, _)| FOLDERS.contains(&first));
        is_source && is_plain && !is_path
    });
    paths.chain(spans.map(str::to_owned))
}

/// `a/{b,c}` → `a/b`, `a/c`.
fn expanded(name: &str) -> Vec<String> {
    let Some((before, rest)) = name.split_once('{') else {
        return vec![name.to_owned()];
    };
    let Some((choices, after)) = rest.split_once('}') else {
        return vec![name.to_owned()];
    };
    choices
        .split(',')
        .flat_map(|choice| expanded(&format!("{before}{choice}{after}")))
        .collect()
}

/// A path from the folder of a file, without `.` and `..`.
fn joined(file: &Path, path: &str) -> PathBuf {
    let mut at = file.parent().unwrap_or(Path::new("")).to_path_buf();
    for part in Path::new(path).components() {
        match part {
            Component::ParentDir => {
                at.pop();
            }
            Component::Normal(name) => at.push(name),
            _ => {}
        }
    }
    at
}

/// The anchor of a heading.
fn slug(heading: &str) -> String {
    let text = heading.trim_start_matches('#').trim().to_lowercase();
    text.chars()
        .filter(|c| c.is_alphanumeric() || " -_".contains(*c))
        .map(|c| if c == ' ' { '-' } else { c })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_links_and_names_of_a_line() {
        let line = "See [a](x/y.md#z) and [b](https://c.d) in `crates/p/{a,b}.rs`, `c.rs`, config/NAME.toml or docs/*.md, tests/x.";
        assert_eq!(links(line).collect::<Vec<_>>(), ["x/y.md#z"]);
        assert_eq!(
            names(line).collect::<Vec<_>>(),
            ["crates/p/{a,b}.rs", "tests/x", "c.rs"]
        );
        let spans = "`link/{a,b}.rs`, `x y.rs`, `/etc/c.py`, `.rs`, `d.py`, `e/d.py`, `found/e.json`";
        assert_eq!(names(spans).collect::<Vec<_>>(), ["link/{a,b}.rs", "e/d.py"]);
        assert_eq!(expanded("a/{b,c}.rs"), ["a/b.rs", "a/c.rs"]);
    }

    #[test]
    fn val_dead_links_are_found() {
        let root = std::env::temp_dir().join(format!("rotortwin-links-{}", std::process::id()));
        std::fs::create_dir_all(root.join("docs")).unwrap();
        let (page, other) = (root.join("docs/page.md"), root.join("README.md"));
        std::fs::write(
            &page,
            "# A `title`, here\n[up](../README.md) [own](#a-title-here) docs/page.md",
        )
        .unwrap();
        std::fs::write(
            &other,
            "[gone](docs/gone.md) [heading](docs/page.md#b) `gone.rs`\ndocs/gone.toml\n`old/here.rs` `now/here.rs` `here.rs`",
        )
        .unwrap();
        std::fs::create_dir_all(root.join("docs/now")).unwrap();
        let source = root.join("docs/now/here.rs");
        std::fs::write(&source, "").unwrap();
        let complaints = check(&root, &[page, other, source]).unwrap_err().to_string();
        std::fs::remove_dir_all(&root).unwrap();
        let dead: Vec<&str> = complaints.lines().skip(1).map(str::trim).collect();
        let expected = ["docs/gone.md", "docs/page.md#b", "docs/gone.md", "gone.rs"]
            .map(|name| format!("README.md:1: {name} leads nowhere"));
        assert_eq!(dead[..4], expected);
        assert_eq!(
            dead[4..],
            [
                "README.md:2: docs/gone.toml leads nowhere",
                "README.md:3: old/here.rs leads nowhere"
            ]
        );
    }
}
