//! The crates of the workspace and their dependencies, from cargo.

use super::graph::Graph;
use anyhow::{Context, Result, bail};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The first of each pair must not depend on the second, not even indirectly.
const APART: [(&str, &str); 5] = [
    ("controller", "plant"),
    ("fdi", "plant"),
    ("campaign", "links"),
    ("store", "plant"),
    ("blind", "flight-core"),
];

/// The crates of the workspace, by the name of their folder.
pub(super) struct Crates {
    /// Folder, relative to the root.
    pub(super) folders: BTreeMap<String, String>,
    /// Dependencies of each; tests may use more.
    pub(super) graph: Graph,
}

/// Asks cargo.
pub(super) fn read(root: &Path) -> Result<Crates> {
    let output = crate::command::cargo(root)
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .output()
        .context("cargo metadata")?;
    if !output.status.success() {
        bail!(
            "cargo metadata failed: {}",
            String::from_utf8_lossy(&output.stderr).trim()
        );
    }
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).context("cargo metadata")?;
    let folder_of = |manifest: &str| -> Option<String> {
        let folder = Path::new(manifest).parent()?.strip_prefix(root).ok()?;
        Some(folder.display().to_string())
    };
    let (mut folders, mut graph) = (BTreeMap::new(), Graph::default());
    for package in metadata["packages"]
        .as_array()
        .context("cargo metadata lists no packages")?
    {
        let folder = package["manifest_path"].as_str().and_then(folder_of);
        let folder = folder.context("a package outside of the repository")?;
        let built_from: BTreeSet<String> = package["dependencies"]
            .as_array()
            .into_iter()
            .flatten()
            .filter(|dependency| dependency["kind"].is_null())
            .filter_map(|dependency| Path::new(dependency["path"].as_str()?).strip_prefix(root).ok())
            .map(|path| short(&path.display().to_string()))
            .collect();
        graph.0.insert(short(&folder), built_from);
        folders.insert(short(&folder), folder);
    }
    for (user, used) in APART {
        if graph.reach(user).contains(used) {
            bail!("{user} is built from {used}; the two are kept apart on purpose (ARCHITECTURE.md)");
        }
    }
    Ok(Crates { folders, graph })
}

fn short(folder: &str) -> String {
    folder.rsplit('/').next().unwrap_or(folder).to_owned()
}
