//! Commands run by tasks.

use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::Command;

/// A `cargo` command in the repository root.
pub(crate) fn cargo(root: &Path) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root);
    // Variables that `cargo run` sets for this program: build scripts of some libraries (ring) treat them as a change of the
    // environment, so they and their dependents would be rebuilt whenever `cargo xtask` and `cargo` alternate.
    for (name, _) in std::env::vars_os() {
        let of_this_package = ["CARGO_PKG_", "CARGO_MANIFEST_"];
        if name
            .to_str()
            .is_some_and(|name| of_this_package.iter().any(|start| name.starts_with(start)))
        {
            command.env_remove(name);
        }
    }
    command
}

/// Builds programs or examples with the features of the whole workspace, as `./run` and `./test` do: with those of a single package
/// the large dependencies would be compiled again.
pub(crate) fn build(root: &Path, targets: &[&str]) -> Result<()> {
    build_as(root, "release", targets)
}

/// The same with another profile of Cargo.toml.
pub(crate) fn build_as(root: &Path, profile: &str, targets: &[&str]) -> Result<()> {
    let mut command = cargo(root);
    command.args([
        "build",
        "--profile",
        profile,
        "--locked",
        "--quiet",
        "--workspace",
        "--exclude",
        "xtask",
    ]);
    run("build", command.args(targets))
}

/// Runs a command with its output on the terminal. Errors name the action.
pub(crate) fn run(what: &str, command: &mut Command) -> Result<()> {
    println!("-- {what}");
    let status = command
        .status()
        .with_context(|| format!("{what}: cannot start {:?}", command.get_program()))?;
    if !status.success() {
        bail!("{what} failed ({status})");
    }
    Ok(())
}
