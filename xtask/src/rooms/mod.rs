//! `cargo xtask rooms`: which crate and which module uses which, as a picture, and the circles among them.
//!
//! A room is a crate or a module: a file, or a directory with all that is in it. Rooms of one directory may not use each other in a
//! circle. A directory's own file (`mod.rs`, `lib.rs`) is no room of its own: it may use what is in the directory and be used by it.
//!
//! Today's circles are listed in `xtask/circles.txt`. A circle that is not listed fails the check, and so does a listed circle that
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

/// The list of today's circles, relative to the root.
const LIST: &str = "xtask/circles.txt";
/// The file that holds the picture, relative to the root.
const PAGE: &str = "ARCHITECTURE.md";
/// The Python package, relative to the root.
const PYTHON: &str = "clients/python/src/rotortwin";

/// One directory of modules: where it is, relative to the root, and who uses whom in it.
struct Directory {
    place: String,
    graph: Graph,
    /// False for a directory inside of another one.
    is_top: bool,
}

/// Prints the picture and writes it into `ARCHITECTURE.md`; fails on a circle that is not listed.
pub(crate) fn write(root: &Path) -> Result<()> {
    let (picture, circles) = look(root)?;
    println!("{picture}");
    let page = root.join(PAGE);
    let text = std::fs::read_to_string(&page).context(PAGE)?;
    std::fs::write(&page, picture::inserted(&text, &picture).context(PAGE)?).context(PAGE)?;
    compare_with_list(root, &circles)
}

/// Fails on a circle that is not listed, on a listed circle that is gone, and on a picture that is out of date.
pub(crate) fn check(root: &Path) -> Result<()> {
    let (picture, circles) = look(root)?;
    compare_with_list(root, &circles)?;
    let text = std::fs::read_to_string(root.join(PAGE)).context(PAGE)?;
    if picture::inserted(&text, &picture).context(PAGE)? != text {
        bail!("the picture in {PAGE} is not that of the tree; run `cargo xtask rooms` and commit the result");
    }
    Ok(())
}

/// The picture of the tree, and all circles: a line for each.
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
