//! A disk that is soon full.

use crate::skip::skip;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A small disk; unmounted when it is dropped.
#[derive(Debug)]
pub struct Disk(PathBuf);

impl Disk {
    /// One of this size, such as `8m`, at a folder. `None`: nothing can be mounted here, and a line says so.
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

    /// Leaves nothing of it, whatever is there now; `false`: somebody wrote meanwhile, and there is room.
    ///
    /// # Panics
    /// The kernel does not say what is there.
    pub fn fill(&self) -> bool {
        let space = rustix::fs::statvfs(&self.0).expect("it is mounted");
        // A size of 0 would be no limit at all.
        let used = (space.f_blocks - space.f_bfree).max(1);
        self.resize(&(used * space.f_frsize).to_string())
    }

    /// Makes it another size, such as `64m`, not smaller than what is there.
    pub fn resize(&self, size: &str) -> bool {
        Command::new("mount")
            .args(["-o", &format!("remount,size={size}")])
            .arg(&self.0)
            .output()
            .is_ok_and(|output| output.status.success())
    }

    /// Where it is.
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
