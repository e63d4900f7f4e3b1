//! `cargo xtask rooms`: dependencies between crates and modules, as a picture, and the cycles among them.
//!
//! A room is a crate or a module: a file, or a directory with its contents. Rooms of one directory must not form a cycle. A
//! directory's own file (`mod.rs`, `lib.rs`) is not a separate room: it may use the contents of the directory and be used by them.
//!
//! Existing cycles are listed in `xtask/circles.txt`. A cycle that is not listed fails the check, and so does a listed cycle that
//! has changed or is gone: the list may only shrink. The picture is a block of `ARCHITECTURE.md`, checked for drift.

mod crates;
mod graph;
mod picture;
mod python;
mod rust;

use anyhow::{Context, Result, bail};
use graph::Graph;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The list of existing cycles, relative to the root.
const LIST: &str = "xtask/circles.txt";
/// The file with the picture, relative to the root.
const PAGE: &str = "ARCHITECTURE.md";
/// The Python package, relative to the root.
const PYTHON: &str = "clients/python/src/rotortwin";

/// One directory of modules: its path relative to the root, and the dependencies in it.
struct Directory {
    place: String,
    graph: Graph,
    /// False for a nested directory.
    is_top: bool,
}

/// Prints the picture and writes it into `ARCHITECTURE.md`; fails on an unlisted cycle.
pub(crate) fn write(root: &Path) -> Result<()> {
    let (picture, circles) = look(root)?;
    println!("{picture}");
    let page = root.join(PAGE);
    let text = std::fs::read_to_string(&page).context(PAGE)?;
    std::fs::write(&page, picture::inserted(&text, &picture).context(PAGE)?).context(PAGE)?;
    compare_with_list(root, &circles)
}

/// Fails on an unlisted cycle, on a listed cycle that is gone, and on an outdated picture.
pub(crate) fn check(root: &Path) -> Result<()> {
    let (picture, circles) = look(root)?;
    compare_with_list(root, &circles)?;
    let text = std::fs::read_to_string(root.join(PAGE)).context(PAGE)?;
    if picture::inserted(&text, &picture).context(PAGE)? != text {
        bail!("the picture in {PAGE} is not that of the tree; run `cargo xtask rooms` and commit the result");
    }
    Ok(())
}

/// The picture of the tree, and all cycles, one line each.
fn look(root: &Path) -> Result<(String, BTreeSet<String>)> {
    let crates = crates::read(root)?;
    let mut directories = Vec::new();
    for folder in crates.folders.values() {
        let modules = rust::modules(&root.join(folder)).with_context(|| format!("modules of {folder}"))?;
        for (path, graph) in graph::by_directory(&modules) {
            directories.push(Directory {
                place: [&[format!("{folder}/src")], path.as_slice()].concat().join("/"),
                graph,
                is_top: path.is_empty(),
            });
        }
    }
    directories.push(Directory {
        place: PYTHON.to_owned(),
        graph: python::modules(&root.join(PYTHON)).context(PYTHON)?,
        is_top: true,
    });
    let mut circles = BTreeSet::new();
    for directory in &directories {
        for circle in directory.graph.circles() {
            circles.insert(format!("{}: {}", directory.place, circle.join(" ")));
        }
    }
    let tops: BTreeMap<&str, &Graph> = directories
        .iter()
        .filter(|directory| directory.is_top)
        .map(|directory| (directory.place.as_str(), &directory.graph))
        .collect();
    Ok((picture::draw(&crates, &tops), circles))
}

fn compare_with_list(root: &Path, circles: &BTreeSet<String>) -> Result<()> {
    let text = std::fs::read_to_string(root.join(LIST)).context(LIST)?;
    let listed: BTreeSet<String> = text
        .lines()
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .map(str::to_owned)
        .collect();
    let complaints: Vec<String> = circles
        .difference(&listed)
        .map(|line| format!("a circle that is not in {LIST}: {line}"))
        .chain(
            listed
                .difference(circles)
                .map(|line| format!("listed in {LIST} and gone, strike it out: {line}")),
        )
        .collect();
    if complaints.is_empty() {
        return Ok(());
    }
    bail!("circles among modules\n  {}", complaints.join("\n  "))
}
