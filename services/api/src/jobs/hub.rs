//! Wakes those who wait: workers for a job in the queue, watchers for an event. Nothing is sent here but "look again", so that nobody can
//! miss anything: what there is stands in the database.
//!
//! Live samples are the exception: they stand nowhere, and who is too slow for them loses some.

use rotortwin_sim::events::{LiveSample, RunEvent};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, broadcast, watch};

/// Samples that wait for a slow watcher before it loses the oldest: some seconds.
const LIVE_BACKLOG: usize = 256;
/// How a line with a live sample begins.
const LIVE_LINE: &str = r#"{"event":"sample""#;

/// Wakes workers and watchers.
#[derive(Debug, Default)]
pub(crate) struct Hub {
    /// One permit a queued job.
    pub(crate) queue: Notify,
    jobs: Mutex<HashMap<String, watch::Sender<u64>>>,
    live: Mutex<HashMap<String, broadcast::Sender<Arc<LiveSample>>>>,
}

impl Hub {
    /// Tells the watchers of a job to look again.
    pub(crate) fn wake(&self, id: &str) {
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
        self.lock().retain(|_, sender| {
            sender.send_modify(|count| *count += 1);
            sender.receiver_count() > 0
        });
        self.queue.notify_one();
    }

    /// Takes a line of a flight's standard output if it is a live sample, and hands it to who looks on; `false`: it is something else.
    ///
    /// Never waits. The only place that live samples come through.
    pub(crate) fn take_live(&self, id: &str, line: &str) -> bool {
        if !line.starts_with(LIVE_LINE) {
            return false;
        }
        let mut live = self.live.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(sender) = live.get(id) else { return true };
        if sender.receiver_count() == 0 {
            live.remove(id);
        } else if let Ok(RunEvent::Sample(sample)) = serde_json::from_str(line) {
            // Nobody is there any more: nothing is lost.
            drop(sender.send(Arc::new(sample)));
        }
        true
    }

    /// Samples of a run from now on; the channel closes when an attempt to fly it has ended.
    pub(crate) fn watch_live(&self, id: &str) -> broadcast::Receiver<Arc<LiveSample>> {
        let mut live = self.live.lock().unwrap_or_else(PoisonError::into_inner);
        live.entry(id.to_owned())
            .or_insert_with(|| broadcast::channel(LIVE_BACKLOG).0)
            .subscribe()
    }

    /// An attempt to fly a run has ended.
    pub(crate) fn end_live(&self, id: &str) {
        self.live.lock().unwrap_or_else(PoisonError::into_inner).remove(id);
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
