//! `flight-core` built for the Pixhawk's processor: proof that nothing in it needs `std`.

use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::Command;

/// Target of the STM32H743 (Cortex-M7 with FPU).
const TARGET: &str = "thumbv7em-none-eabihf";

/// Finds or installs a toolchain for the target, then builds.
pub(crate) fn run(root: &Path) -> Result<()> {
    let output = Command::new("tools/thumb-toolchain.sh")
        .current_dir(root)
        .stderr(std::process::Stdio::inherit())
        .output()
        .context("starting tools/thumb-toolchain.sh")?;
    if !output.status.success() {
        bail!("no toolchain for {TARGET}; the sentence above says why");
    }
    let toolchain = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    let mut command = Command::new("cargo");
    if !toolchain.is_empty() {
        command.arg(toolchain);
    }
    crate::run(
        "no_std build of flight-core for the Cortex-M7",
        command
            .current_dir(root)
            // The variables of the cargo that runs this task would override the chosen toolchain.
            .env_remove("RUSTUP_TOOLCHAIN")
            .env_remove("CARGO")
            .env_remove("RUSTC")
            .env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS", "-Ctarget-cpu=cortex-m7")
            .args([
                "build",
                "--quiet",
                "--release",
                "--locked",
                "--package",
                "rotortwin-flight-core",
                "--target",
                TARGET,
            ])
            .args(["--target-dir", "target/thumb"]),
    )
}
