//! The data folder: `rotortwin.sqlite`, `jobs/ID/N` (one folder per attempt), `lock`.
//!
//! One process at a time: the lock is held as long as the process lives, and released however it dies.

use rustix::fs::{FlockOperation, flock};
use std::fs::{File, Permissions};
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Accessible to this user only.
pub(crate) const OWN_FOLDER: u32 = 0o700;
/// Accessible to this user only.
pub(crate) const OWN_FILE: u32 = 0o600;
/// Longest wait for the lock of a server that has just been killed.
const LOCK_TIMEOUT: Duration = Duration::from_secs(1);

/// The data folder, locked.
#[derive(Debug)]
pub(crate) struct DataFolder {
    path: PathBuf,
    _lock: File,
}

/// Locks the file. A killed process may have left a child between `fork` and `exec`, which holds the lock for a moment longer.
fn take(lock: &File) -> Result<(), rustix::io::Errno> {
    let end = Instant::now() + LOCK_TIMEOUT;
    loop {
        match flock(lock, FlockOperation::NonBlockingLockExclusive) {
            Err(rustix::io::Errno::WOULDBLOCK) if Instant::now() < end => std::thread::sleep(Duration::from_millis(20)),
            taken => return taken,
        }
    }
}

impl DataFolder {
    /// Creates the folder if missing, and locks it.
    ///
    /// # Errors
    /// It cannot be written, or another server holds it.
    pub(crate) fn open(path: &Path) -> Result<Self, String> {
        let told = |error: std::io::Error| format!("{}: cannot be used as data folder: {error}", path.display());
        std::fs::create_dir_all(path).map_err(told)?;
        let path = path.canonicalize().map_err(told)?;
        // Logs, results and token hashes are private. The permissions of a mounted folder may not be ours to change.
        if let Err(error) = std::fs::set_permissions(&path, Permissions::from_mode(OWN_FOLDER)) {
            tracing::debug!(%error, path = %path.display(), "the permissions of the data folder stay");
        }
        let lock = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .mode(OWN_FILE)
            .open(path.join("lock"))
            .map_err(told)?;
        take(&lock).map_err(|error| {
            if error == rustix::io::Errno::WOULDBLOCK {
                format!("{}: another rotortwin server uses this data folder", path.display())
            } else {
                told(error.into())
            }
        })?;
        Ok(Self { path, _lock: lock })
    }

    /// Path of the folder.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The database's file.
    pub(crate) fn database(&self) -> PathBuf {
        self.path.join("rotortwin.sqlite")
    }
}
