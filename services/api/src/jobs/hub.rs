//! Wakes waiting tasks: workers for a queued job, watchers for an event. Only "look again" is signalled, so that nothing can be missed:
//! the state is in the database.
//!
//! Live samples ([`LiveRuns`]) are the exception: they are not stored in the database.

use super::live::LiveRuns;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, watch};

/// Wakes workers and watchers.
#[derive(Debug, Default)]
pub(crate) struct Hub {
    /// One permit per queued job.
    pub(crate) queue: Notify,
    /// Samples of running flights.
    pub(crate) live: LiveRuns,
    jobs: Mutex<HashMap<String, watch::Sender<u64>>>,
    any: watch::Sender<u64>,
}

impl Hub {
    /// Wakes the watchers of a job.
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

    /// Wakes everyone.
    pub(crate) fn wake_all(&self) {
        self.any.send_modify(|count| *count += 1);
        self.lock().retain(|_, sender| {
            sender.send_modify(|count| *count += 1);
            sender.receiver_count() > 0
        });
        self.queue.notify_one();
    }

    /// Changes on any job's update.
    pub(crate) fn watch_any(&self) -> watch::Receiver<u64> {
        self.any.subscribe()
    }

    /// Changes on a job's update.
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
