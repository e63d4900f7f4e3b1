//! Embeds the page: every file of `web/dist` becomes a line of a table in `$OUT_DIR/page.rs`.
//!
//! The bundle is committed, so that building the server only needs Rust.

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let dist = Path::new(&std::env::var("CARGO_MANIFEST_DIR")?).join("../../web/dist");
    println!("cargo::rerun-if-changed={}", dist.display());
    let mut files = Vec::new();
    collect(&dist, &mut files)
        .map_err(|error| format!("{}: expected the bundle of the page: {error}", dist.display()))?;
    files.sort();
    let mut table = String::from("&[\n");
    for file in &files {
        let name = file
            .strip_prefix(&dist)?
            .to_str()
            .ok_or_else(|| format!("{}: expected a name in UTF-8", file.display()))?;
        writeln!(
            table,
            "    (\"/{}\", include_bytes!({:?})),",
            name.escape_default(),
            file.canonicalize()?
        )?;
    }
    table.push_str("]\n");
    std::fs::write(PathBuf::from(std::env::var("OUT_DIR")?).join("page.rs"), table)?;
    Ok(())
}

/// All plain files below a folder.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        println!("cargo::rerun-if-changed={}", entry.path().display());
        if entry.file_type()?.is_dir() {
            collect(&entry.path(), files)?;
        } else {
            files.push(entry.path());
        }
    }
    Ok(())
}
