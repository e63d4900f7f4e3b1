//! Wakes those who wait: workers for a run in the queue, watchers for an event. Nothing is sent here but "look again", so that nobody can
//! miss anything: what there is stands in the database.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::{Notify, watch};

/// Wakes workers and watchers.
#[derive(Debug, Default)]
pub(crate) struct Hub {
    /// One permit a queued run.
    pub(crate) queue: Notify,
    runs: Mutex<HashMap<String, watch::Sender<u64>>>,
}

impl Hub {
    /// Tells the watchers of a run to look again.
    pub(crate) fn wake(&self, id: &str) {
        let mut runs = self.runs.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(sender) = runs.get(id) {
            sender.send_modify(|count| *count += 1);
            if sender.receiver_count() == 0 {
                runs.remove(id);
            }
        }
    }

    /// Changes whenever there is something new about a run.
    pub(crate) fn watch(self: &Arc<Self>, id: &str) -> watch::Receiver<u64> {
        let mut runs = self.runs.lock().unwrap_or_else(PoisonError::into_inner);
        runs.entry(id.to_owned())
            .or_insert_with(|| watch::channel(0).0)
            .subscribe()
    }
}
