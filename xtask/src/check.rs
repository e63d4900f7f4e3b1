//! Checks of the source tree, before any test runs.

use crate::command::cargo;
use crate::{codegen, links, rooms, thumb, web};
use anyhow::{Context, Result, bail};
use std::path::Path;

/// When the lints run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lints {
    /// With the rest.
    Now,
    /// While the tests are compiled (`tools/lint-while-compiling.sh`).
    WhileCompiling,
}

/// Format, generated code, house rules, lints, `no_std` build; stops at the first failure.
pub(crate) fn run(root: &Path, lints: Lints) -> Result<()> {
    run_steps(root, lints)?;
    println!("-- the tree is in order");
    Ok(())
}

fn run_steps(root: &Path, lints: Lints) -> Result<()> {
    crate::command::run("format", cargo(root).args(["fmt", "--all", "--check"]))?;
    crate::command::run(
        "format of the firmware",
        cargo(root).args(["fmt", "--all", "--check", "--manifest-path", "firmware/Cargo.toml"]),
    )?;
    println!("-- generated code");
    codegen::check(root)?;
    println!("-- circles among modules");
    rooms::check(root)?;
    println!("-- house rules");
    house_rules(root)?;
    println!("-- links and file names in Markdown");
    links::check(root, &tracked_files(root)?)?;
    println!("-- figures that stand in two pages");
    crate::figures::check(root)?;
    web::check(root)?;
    if lints == Lints::Now {
        crate::command::run(
            "lints",
            cargo(root).args([
                "clippy",
                "--release",
                "--locked",
                "--workspace",
                "--all-targets",
                "--quiet",
                "--",
                "-D",
                "warnings",
            ]),
        )?;
    }
    thumb::run(root)
}

/// Rules without a lint; each was added after a violation had cost time.
fn house_rules(root: &Path) -> Result<()> {
    let mut complaints = Vec::new();
    for path in tracked_files(root)? {
        let name = path.strip_prefix(root).unwrap_or(&path).display().to_string();
        let is_text = ["rs", "toml", "md", "proto", "html", "js", "css"]
            .iter()
            .any(|e| name.ends_with(&format!(".{e}")));
        if !is_text || name.ends_with("xtask/src/check.rs") {
            continue;
        }
        let Ok(text) = std::fs::read_to_string(&path) else {
            continue;
        };
        for (number, line) in text.lines().enumerate() {
            let at = || format!("{name}:{}", number + 1);
            if name.ends_with(".rs") && (line.contains("todo!(") || line.contains("#[ignore]")) {
                complaints.push(format!("{}: unfinished or switched off; finish it or delete it", at()));
            }
            if name.starts_with("crates/flight-core/src") && line.contains("std::f32") {
                complaints.push(format!("{}: flight-core takes its mathematics from libm", at()));
            }
        }
    }
    if complaints.is_empty() {
        return Ok(());
    }
    bail!("house rules are broken:\n  {}", complaints.join("\n  "))
}

fn tracked_files(root: &Path) -> Result<Vec<std::path::PathBuf>> {
    let output = std::process::Command::new("git")
        .args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"])
        .current_dir(root)
        .output()
        .context("git ls-files (git is needed to know which files belong to the tree)")?;
    if !output.status.success() {
        bail!(
            "git ls-files failed: {}",
            String::from_utf8_lossy(&output.stderr).trim()
        );
    }
    Ok(output
        .stdout
        .split(|byte| *byte == 0)
        .filter(|name| !name.is_empty())
        .map(|name| root.join(String::from_utf8_lossy(name).as_ref()))
        .collect())
}
