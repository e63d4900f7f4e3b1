//! A small disk for out-of-space tests.

use crate::skip::skip;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A small disk; unmounted when it is dropped.
#[derive(Debug)]
pub struct Disk(PathBuf);

impl Disk {
    /// A disk of this size, such as `8m`, mounted at a folder. `None`: mounting is not possible here, and a line says
    /// so.
    ///
    /// # Panics
    /// The folder cannot be made.
    pub fn new(folder: PathBuf, size: &str) -> Option<Self> {
        std::fs::create_dir_all(&folder).expect("it can be made");
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={size}"), "tmpfs"])
            .arg(&folder)
            .output();
        match mounted {
            Ok(output) if output.status.success() => Some(Self(folder)),
            other => {
                let why = other.map_or_else(
                    |error| error.to_string(),
                    |output| String::from_utf8_lossy(&output.stderr).into_owned(),
                );
                skip(&format!(
                    "no disk can be mounted ({}): a full one is not tried",
                    why.trim()
                ));
                None
            }
        }
    }

    /// Fills it completely; `false` if another process wrote meanwhile and there is space left.
    ///
    /// # Panics
    /// The kernel does not report the free space.
    pub fn fill(&self) -> bool {
        let space = rustix::fs::statvfs(&self.0).expect("it is mounted");
        // A size of 0 would mean no limit.
        let used = (space.f_blocks - space.f_bfree).max(1);
        self.resize(&(used * space.f_frsize).to_string())
    }

    /// Resizes it, e.g. to `64m`, not below its used space.
    pub fn resize(&self, size: &str) -> bool {
        Command::new("mount")
            .args(["-o", &format!("remount,size={size}")])
            .arg(&self.0)
            .output()
            .is_ok_and(|output| output.status.success())
    }

    /// Mount point.
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let ended = Command::new("umount").arg("--lazy").arg(&self.0).status();
        if !ended.is_ok_and(|status| status.success()) {
            eprintln!("{} cannot be unmounted", self.0.display());
        }
    }
}
