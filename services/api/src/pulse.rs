//! Liveness of this process: the file `alive` in its data folder, touched every few seconds as long as all its tasks make progress.
//!
//! ```text
//!  each job slot ──beat──▶ Pulse ──all have beaten recently──▶ data/alive ◀── `rotortwin health worker:DATA`
//! ```
//! A process that is frozen or whose threads are all stuck touches nothing; neither does one with a single stuck slot, so that a watchdog
//! restarts it. An unavailable database does not count: a restart would not help.

use crate::data_folder::OWN_FILE;
use std::fs::{File, Permissions};
use std::io::{self, Write as _};
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// File name in the data folder.
const FILE: &str = "alive";
/// Touch interval.
const EVERY: Duration = Duration::from_secs(2);
/// A slot without a beat for this long is stuck. Its work between two beats, such as storing the files of a job, takes less.
const STUCK: Duration = Duration::from_secs(900);

tokio::task_local! {
    static PLACE: Arc<AtomicU64>;
}

/// Last beat of each slot.
#[derive(Debug)]
pub(crate) struct Pulse {
    start: Instant,
    places: Mutex<Vec<Arc<AtomicU64>>>,
}

impl Pulse {
    pub(crate) fn new() -> Self {
        Self {
            start: Instant::now(),
            places: Mutex::default(),
        }
    }

    /// Runs `work` as a slot that is expected to beat.
    pub(crate) async fn watched<T>(&self, work: impl Future<Output = T>) -> T {
        let place = Arc::new(AtomicU64::new(self.now_ms()));
        self.places().push(Arc::clone(&place));
        let done = PLACE.scope(Arc::clone(&place), work).await;
        self.places().retain(|other| !Arc::ptr_eq(other, &place));
        done
    }

    /// Beat of the calling slot.
    pub(crate) fn beat(&self) {
        // Outside a slot, no beat is expected.
        let beaten = PLACE.try_with(|place| place.store(self.now_ms(), Ordering::Relaxed));
        if let Err(error) = beaten {
            tracing::trace!(%error, "no place");
        }
    }

    fn goes_on(&self) -> bool {
        self.silence_ms() < u64::try_from(STUCK.as_millis()).unwrap_or(u64::MAX)
    }

    /// Silence of the slot that has been silent for longest.
    fn silence_ms(&self) -> u64 {
        let now = self.now_ms();
        let last = self.places().iter().map(|place| place.load(Ordering::Relaxed)).min();
        now.saturating_sub(last.unwrap_or(now))
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    fn places(&self) -> std::sync::MutexGuard<'_, Vec<Arc<AtomicU64>>> {
        self.places.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Touches the file in `data` until the process ends.
    pub(crate) async fn show(&self, data: PathBuf, mut ending: tokio::sync::watch::Receiver<bool>) {
        let path = data.join(FILE);
        while !*ending.borrow() {
            if self.goes_on() {
                if let Err(error) = touch(&path) {
                    tracing::warn!(path = %path.display(), %error, "the heartbeat file cannot be written");
                }
            } else {
                tracing::error!(
                    "a job has made no progress for {} s: no heartbeat is written",
                    self.silence_ms() / 1000
                );
            }
            tokio::select! {
                _ = ending.changed() => {}
                () = tokio::time::sleep(EVERY) => {}
            }
        }
    }
}

/// Writes the number of this process, for its user alone.
fn touch(path: &Path) -> io::Result<()> {
    let mut file = File::options()
        .create(true)
        .truncate(true)
        .write(true)
        .mode(OWN_FILE)
        .open(path)?;
    // One that an earlier version wrote.
    file.set_permissions(Permissions::from_mode(OWN_FILE))?;
    file.write_all(std::process::id().to_string().as_bytes())
}

/// Whether the server or worker with this data folder has shown liveness within `silence`.
///
/// # Errors
/// It has not.
pub fn alive(data: &Path, silence: Duration) -> Result<(), String> {
    let path = data.join(FILE);
    let modified = std::fs::metadata(&path).and_then(|file| file.modified());
    let modified = modified.map_err(|error| format!("{}: no heartbeat: {error}", path.display()))?;
    match modified.elapsed() {
        Ok(age) if age > silence => Err(format!(
            "{}: the last heartbeat is {:.0} s old; expected one every {} s",
            path.display(),
            age.as_secs_f64(),
            EVERY.as_secs()
        )),
        // A recent time by a clock that was set back since.
        Ok(_) | Err(_) => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn val_a_place_that_stands_still_is_seen_and_one_that_has_ended_is_not_missed() {
        let pulse = Pulse::new();
        assert!(pulse.goes_on(), "nobody is expected to beat");
        pulse
            .watched(async {
                tokio::time::sleep(Duration::from_millis(300)).await;
                assert!(pulse.silence_ms() >= 300);
                pulse.beat();
                assert!(pulse.silence_ms() < 300);
            })
            .await;
        tokio::time::sleep(Duration::from_millis(300)).await;
        assert_eq!(pulse.silence_ms(), 0);
        pulse.beat();
    }

    #[test]
    fn val_an_old_sign_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let missing = alive(folder.path(), Duration::from_secs(1)).unwrap_err();
        assert!(missing.contains("no heartbeat"), "{missing}");
        let file = std::fs::File::create(folder.path().join(FILE)).unwrap();
        assert_eq!(alive(folder.path(), Duration::from_secs(30)), Ok(()));
        let long_ago = file.metadata().unwrap().modified().unwrap() - Duration::from_secs(100);
        file.set_modified(long_ago).unwrap();
        let old = alive(folder.path(), Duration::from_secs(30)).unwrap_err();
        assert!(old.contains("100 s old"), "{old}");
        assert_eq!(alive(folder.path(), Duration::from_secs(200)), Ok(()));
    }
}
