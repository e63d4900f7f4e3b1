//! Commands that a task runs.

use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::Command;

/// A `cargo` command in the repository root.
pub(crate) fn cargo(root: &Path) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root);
    // What `cargo run` has told this program about itself: to the build scripts of some libraries (ring) it is a change of the
    // environment, and they and all above them would be compiled anew each time that `cargo xtask` and `cargo` take turns.
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

/// Builds programs or examples with the features of the whole workspace, as `./run` and `./test` do: with those of one package alone
/// the large dependencies would be compiled once more.
pub(crate) fn build(root: &Path, targets: &[&str]) -> Result<()> {
    let mut command = cargo(root);
    command.args([
        "build",
        "--release",
        "--locked",
        "--quiet",
        "--workspace",
        "--exclude",
        "xtask",
    ]);
    run("build", command.args(targets))
}

/// Runs a command; what it prints goes to the terminal. An error names what was being done.
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
