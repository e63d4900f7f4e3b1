//! Wakes waiting tasks: workers for a queued job, watchers for an event. Only "look again" is signalled, so that nothing can be missed:
//! the state is in the database.
//!
//! Live samples ([`LiveRuns`]) are the exception: they are not stored in the database.

use super::live::LiveRuns;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, watch};

/// Watches one job. The hub knows a job only as long as somebody watches it: after its end nothing would make it forget.
#[derive(Debug)]
pub(crate) struct Watch {
    hub: Arc<Hub>,
    id: String,
    news: watch::Receiver<u64>,
}

impl Watch {
    /// Only later changes count for [`changed`](Self::changed).
    pub(crate) fn mark_unchanged(&mut self) {
        self.news.mark_unchanged();
    }

    /// Waits for a change of the job.
    pub(crate) async fn changed(&mut self) {
        // The sender lives as long as this does.
        if self.news.changed().await.is_err() {
            std::future::pending::<()>().await;
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let mut jobs = self.hub.lock();
        // This one's own receiver is still there.
        if jobs.get(&self.id).is_some_and(|sender| sender.receiver_count() <= 1) {
            jobs.remove(&self.id);
        }
    }
}

/// Wakes workers and watchers.
#[derive(Debug, Default)]
pub(crate) struct Hub {
    /// One permit per queued job.
    pub(crate) queue: Notify,
    /// Samples of running flights.
    pub(crate) live: LiveRuns,
    jobs: Mutex<BTreeMap<String, watch::Sender<u64>>>,
    any: watch::Sender<u64>,
}

impl Hub {
    /// Wakes the watchers of a job.
    pub(crate) fn wake(&self, id: &str) {
        self.any.send_modify(|count| *count += 1);
        if let Some(sender) = self.lock().get(id) {
            sender.send_modify(|count| *count += 1);
        }
    }

    /// Wakes everyone.
    pub(crate) fn wake_all(&self) {
        self.any.send_modify(|count| *count += 1);
        for sender in self.lock().values() {
            sender.send_modify(|count| *count += 1);
        }
        self.queue.notify_one();
    }

    /// Changes on any job's update.
    pub(crate) fn watch_any(&self) -> watch::Receiver<u64> {
        self.any.subscribe()
    }

    /// Changes on a job's update.
    pub(crate) fn watch(self: &Arc<Self>, id: &str) -> Watch {
        let mut jobs = self.lock();
        let sender = jobs.entry(id.to_owned()).or_insert_with(|| watch::channel(0).0);
        Watch {
            news: sender.subscribe(),
            hub: Arc::clone(self),
            id: id.to_owned(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, watch::Sender<u64>>> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::FutureExt as _;

    #[test]
    fn val_a_job_is_forgotten_with_its_last_watcher() {
        let hub = Arc::new(Hub::default());
        let (mut one, other) = (hub.watch("a"), hub.watch("a"));
        drop(other);
        assert!(one.changed().now_or_never().is_none());
        hub.wake("a");
        assert!(one.changed().now_or_never().is_some(), "the one that is left is woken");
        drop(one);
        // The last watcher of a job that has ended leaves after the last change.
        for job in 0..1000 {
            drop(hub.watch(&format!("job {job}")));
        }
        hub.wake("nobody watches this one");
        assert_eq!(hub.lock().len(), 0);
    }
}
