//! Rust code from `proto/`, without a `protoc` binary. The result is committed; `--check` says whether it is up to date.

use anyhow::{Context, Result, bail};
use prost::Message as _;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Folder of the generated files, relative to the root.
const TARGET: &str = "proto/src";

/// Foxglove messages that we write, and their dependencies: proto/foxglove.
const FOXGLOVE: [&str; 4] = ["FrameTransform", "PoseInFrame", "SceneUpdate", "Log"];

/// File name → content of all generated files.
fn generate(root: &Path) -> Result<BTreeMap<String, Vec<u8>>> {
    let include = root.join("proto");
    let mut sources: Vec<_> = std::fs::read_dir(include.join("rotortwin/v1"))
        .context("reading proto/rotortwin/v1")?
        .collect::<std::io::Result<Vec<_>>>()?
        .into_iter()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "proto"))
        .collect();
    sources.sort();
    let foxglove = FOXGLOVE.map(|name| include.join(format!("foxglove/{name}.proto")));
    let mut files = package(&include, &sources, "descriptor.bin").context("proto/rotortwin/v1")?;
    files.extend(package(&include, &foxglove, "foxglove.bin").context("proto/foxglove")?);
    Ok(files)
}

/// The Rust code of each package among the sources, and their descriptors in one file.
fn package(include: &Path, sources: &[PathBuf], descriptors_file: &str) -> Result<BTreeMap<String, Vec<u8>>> {
    let mut descriptors = protox::compile(sources, [include]).context("compiling")?;
    let out = std::env::temp_dir().join(format!("rotortwin-codegen-{}", std::process::id()));
    std::fs::create_dir_all(&out)?;
    prost_build::Config::new()
        .out_dir(&out)
        .btree_map(["."])
        // Two of Google's messages do not justify a library.
        .compile_well_known_types()
        .compile_fds(descriptors.clone())
        .context("generating Rust code")?;
    let mut files = BTreeMap::new();
    for entry in std::fs::read_dir(&out)? {
        let entry = entry?;
        files.insert(
            entry.file_name().to_string_lossy().into_owned(),
            std::fs::read(entry.path())?,
        );
    }
    std::fs::remove_dir_all(&out)?;
    // Descriptors without source positions: comments would triple the size of the file.
    for file in &mut descriptors.file {
        file.source_code_info = None;
    }
    files.insert(descriptors_file.to_owned(), descriptors.encode_to_vec());
    Ok(files)
}

/// Writes the generated files.
pub(crate) fn write(root: &Path) -> Result<()> {
    let target = root.join(TARGET);
    std::fs::create_dir_all(&target)?;
    for (name, content) in generate(root)? {
        std::fs::write(target.join(&name), content)?;
        println!("{TARGET}/{name}");
    }
    Ok(())
}

/// Fails if a generated file differs from the output for `proto/`.
pub(crate) fn check(root: &Path) -> Result<()> {
    for (name, content) in generate(root)? {
        let path = root.join(TARGET).join(&name);
        if std::fs::read(&path).ok().as_ref() != Some(&content) {
            bail!("{TARGET}/{name} is not what proto/ gives; run `cargo xtask codegen` and commit the result");
        }
    }
    Ok(())
}
