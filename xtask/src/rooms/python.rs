//! The modules of a Python package and their imports within the package.

use super::graph::Graph;
use anyhow::Result;
use std::path::Path;

/// Reads all modules of a package without subpackages; `__init__` is the package's own file.
///
/// Imports for type checkers only (`if TYPE_CHECKING:`) count like all others: readers follow them, too.
pub(super) fn modules(folder: &Path) -> Result<Graph> {
    let mut graph = Graph::default();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let Some(name) = path.file_name().and_then(|name| name.to_str()?.strip_suffix(".py")) else {
            continue;
        };
        if name == "__init__" {
            continue;
        }
        let text = std::fs::read_to_string(&path)?;
        let used = text.lines().filter_map(|line| {
            let (module, _) = line.trim_start().strip_prefix("from .")?.split_once(" import")?;
            Some(module.to_owned())
        });
        graph.0.insert(name.to_owned(), used.collect());
    }
    Ok(graph)
}
