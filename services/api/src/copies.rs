//! Copies of a bucket's files on this host: how much space they may take, and which are removed first.
//!
//! A file is a copy once the bucket has it: downloaded from there, or uploaded to it. Files that a job is still writing
//! are not copies.

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Most that copies take, bytes, and the share of the disk.
const MOST: u64 = 4 << 30;
const SHARE_OF_DISK: u64 = 4;
/// A copy that was requested this recently may be in use.
const RECENT: Duration = Duration::from_secs(600);

/// A copy.
#[derive(Debug, Clone, Copy)]
struct Copy {
    size: u64,
    used: Instant,
}

/// The copies below a folder.
#[derive(Debug)]
pub(crate) struct Copies {
    most: u64,
    known: Mutex<HashMap<PathBuf, Copy>>,
}

impl Copies {
    /// Begins with an empty folder: what another process knew of its copies ended with it.
    ///
    /// # Errors
    /// The folder cannot be emptied.
    pub(crate) fn below(root: &Path) -> io::Result<Self> {
        for entry in std::fs::read_dir(root)? {
            let path = entry?.path();
            if path.is_dir() {
                std::fs::remove_dir_all(path)?;
            } else {
                std::fs::remove_file(path)?;
            }
        }
        let disk = rustix::fs::statvfs(root).map_or(u64::MAX, |space| space.f_blocks.saturating_mul(space.f_frsize));
        let share = if disk == 0 { MOST } else { disk / SHARE_OF_DISK };
        Ok(Self::of_at_most(MOST.min(share)))
    }

    fn of_at_most(most: u64) -> Self {
        Self {
            most,
            known: Mutex::default(),
        }
    }

    /// Notes that a file is a copy, and in use now; removes the least recently used ones if all together take too much.
    pub(crate) fn note(&self, path: &Path, now: Instant) {
        let Ok(size) = std::fs::metadata(path).map(|file| file.len()) else {
            return;
        };
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        known.insert(path.to_owned(), Copy { size, used: now });
        Self::shrink(&mut known, self.most, now);
    }

    /// Notes the use of a copy.
    pub(crate) fn used(&self, path: &Path, now: Instant) {
        if let Some(copy) = self.known.lock().unwrap_or_else(PoisonError::into_inner).get_mut(path) {
            copy.used = now;
        }
    }

    /// Removes every copy that is not in use: the disk is full.
    pub(crate) fn make_room(&self, now: Instant) {
        Self::shrink(&mut self.known.lock().unwrap_or_else(PoisonError::into_inner), 0, now);
    }

    /// Forgets the copies below a folder that is removed.
    pub(crate) fn forget(&self, folder: &Path) {
        self.known
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .retain(|path, _| !path.starts_with(folder));
    }

    fn shrink(known: &mut HashMap<PathBuf, Copy>, most: u64, now: Instant) {
        let mut all: u64 = known.values().map(|copy| copy.size).sum();
        if all <= most {
            return;
        }
        let mut oldest: Vec<(Instant, PathBuf)> = known.iter().map(|(path, copy)| (copy.used, path.clone())).collect();
        oldest.sort();
        for (used, path) in oldest {
            if all <= most || now.saturating_duration_since(used) < RECENT {
                return;
            }
            if let Err(error) = std::fs::remove_file(&path) {
                tracing::debug!(path = %path.display(), %error, "a copy is gone already");
            }
            all -= known.remove(&path).map_or(0, |copy| copy.size);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_least_recently_used_copies_go_first_and_none_in_use() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, [0; 100]).unwrap();
            path
        };
        let copies = Copies::of_at_most(250);
        let begin = Instant::now();
        let later = |s: u64| begin + Duration::from_secs(s);
        let (a, b, c) = (write("a"), write("b"), write("c"));
        copies.note(&a, begin);
        copies.note(&b, later(1));
        copies.used(&a, later(700));
        // 300 bytes, and only b has not been requested lately.
        copies.note(&c, later(800));
        assert_eq!([a.exists(), b.exists(), c.exists()], [true, false, true]);
        // Too much, but all in use.
        let d = write("d");
        copies.note(&d, later(810));
        assert!(a.exists() && c.exists() && d.exists());
        copies.make_room(later(1405));
        assert_eq!([a.exists(), c.exists(), d.exists()], [false, false, true]);
    }

    #[test]
    fn val_a_new_process_begins_without_copies() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("jobs")).unwrap();
        std::fs::write(folder.path().join("jobs/x"), "left").unwrap();
        Copies::below(folder.path()).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
