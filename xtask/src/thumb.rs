//! Builds `flight-core` for the Pixhawk's processor: proof that nothing in it needs `std`.

use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::Command;

/// Target of the STM32H743 (Cortex-M7 with FPU).
const TARGET: &str = "thumbv7em-none-eabihf";

/// Finds or installs a toolchain for the target: returns the argument that cargo needs, if any.
pub(crate) fn toolchain(root: &Path) -> Result<String> {
    let output = Command::new("tools/thumb-toolchain.sh")
        .current_dir(root)
        .stderr(std::process::Stdio::inherit())
        .output()
        .context("starting tools/thumb-toolchain.sh")?;
    if !output.status.success() {
        bail!("no toolchain for {TARGET}; the sentence above says why");
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Cargo of that toolchain.
pub(crate) fn cargo(toolchain: &str) -> Command {
    let mut command = Command::new("cargo");
    if !toolchain.is_empty() {
        // Debian's compiler does not include a linker.
        command
            .arg(toolchain)
            .env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", "ld.lld-22");
    }
    // The environment of the cargo that runs this task would override the chosen toolchain.
    command
        .env_remove("RUSTUP_TOOLCHAIN")
        .env_remove("CARGO")
        .env_remove("RUSTC");
    command
}

/// Builds `flight-core` and `board` for the target.
pub(crate) fn run(root: &Path) -> Result<()> {
    let toolchain = toolchain(root)?;
    crate::command::run(
        "no_std build of flight-core and board for the Cortex-M7",
        cargo(&toolchain)
            .current_dir(root)
            .env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS", "-Ctarget-cpu=cortex-m7")
            .args(["build", "--quiet", "--release", "--locked"])
            .args(["--package", "rotortwin-flight-core", "--package", "rotortwin-board"])
            .args(["--target", TARGET, "--target-dir", "target/thumb"]),
    )
}
