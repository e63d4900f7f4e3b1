//! Wakes those who wait: workers for a job in the queue, watchers for an event. Nothing is sent here but "look again", so that nobody can
//! miss anything: what there is stands in the database.
//!
//! Live samples ([`LiveRuns`]) are the exception: they stand in no database.

use super::live::LiveRuns;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, watch};

/// Wakes workers and watchers.
#[derive(Debug, Default)]
pub(crate) struct Hub {
    /// One permit a queued job.
    pub(crate) queue: Notify,
    /// Samples of runs that fly.
    pub(crate) live: LiveRuns,
    jobs: Mutex<HashMap<String, watch::Sender<u64>>>,
    any: watch::Sender<u64>,
}

impl Hub {
    /// Tells the watchers of a job to look again.
    pub(crate) fn wake(&self, id: &str) {
        self.any.send_modify(|count| *count += 1);
        let mut jobs = self.lock();
        if let Some(sender) = jobs.get(id) {
            sender.send_modify(|count| *count += 1);
            if sender.receiver_count() == 0 {
                jobs.remove(id);
            }
        }
    }

    /// Tells everybody to look again.
    pub(crate) fn wake_all(&self) {
        self.any.send_modify(|count| *count += 1);
        self.lock().retain(|_, sender| {
            sender.send_modify(|count| *count += 1);
            sender.receiver_count() > 0
        });
        self.queue.notify_one();
    }

    /// Changes whenever there is something new about any job.
    pub(crate) fn watch_any(&self) -> watch::Receiver<u64> {
        self.any.subscribe()
    }

    /// Changes whenever there is something new about a job.
    pub(crate) fn watch(self: &Arc<Self>, id: &str) -> watch::Receiver<u64> {
        self.lock()
            .entry(id.to_owned())
            .or_insert_with(|| watch::channel(0).0)
            .subscribe()
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<String, watch::Sender<u64>>> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
