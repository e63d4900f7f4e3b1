//! Live samples of runs: passed to viewers, and stored for later ones, within a memory limit.
//!
//! A run keeps at most [`MOST_KEPT`] samples. When there are more, every second one is dropped, and from then on only every second new one
//! is kept: the stored samples always start with the first one of the attempt and are evenly spaced, only coarser. Nothing is written to
//! disk; once the run has ended, the recording is in its telemetry.

use rotortwin_wire::events::{LiveSample, RunEvent};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::broadcast;

/// Queue length of a slow viewer before it loses the oldest samples: some seconds.
const BACKLOG: usize = 256;
/// Maximum samples per run: 82 s at the maximum rate of 100 per second; then half as many per second, and so on.
const MOST_KEPT: usize = 8192;
/// Runs without samples for this long are forgotten: their worker is gone.
const SILENCE: Duration = Duration::from_secs(600);
/// Prefix of a line with a live sample.
const LINE: &str = r#"{"event":"sample""#;

/// Stored samples of a run, from the first one on.
#[derive(Debug, Clone)]
pub(crate) struct Past {
    /// In the order of their steps.
    pub(crate) samples: Vec<Arc<LiveSample>>,
    /// Only one in this many was kept.
    pub(crate) every: u64,
}

#[derive(Debug)]
struct Run {
    sender: broadcast::Sender<Arc<LiveSample>>,
    samples: Vec<Arc<LiveSample>>,
    every: u64,
    /// Samples received.
    count: u64,
    heard: Instant,
}

impl Run {
    fn new() -> Self {
        Self {
            sender: broadcast::channel(BACKLOG).0,
            samples: Vec::new(),
            every: 1,
            count: 0,
            heard: Instant::now(),
        }
    }

    fn take(&mut self, sample: Arc<LiveSample>) {
        if self.samples.last().is_some_and(|last| sample.step <= last.step) {
            // The run was restarted.
            (self.samples, self.every, self.count) = (Vec::new(), 1, 0);
        }
        if self.count.is_multiple_of(self.every) {
            if self.samples.len() >= MOST_KEPT {
                let mut place = 0_usize;
                self.samples.retain(|_| {
                    place += 1;
                    place % 2 == 1
                });
                self.every *= 2;
            }
            if self.count.is_multiple_of(self.every) {
                self.samples.push(Arc::clone(&sample));
            }
        }
        self.count += 1;
        self.heard = Instant::now();
        // No viewers: nothing is lost.
        drop(self.sender.send(sample));
    }
}

/// Live samples of all runs that fly.
#[derive(Debug, Default)]
pub(crate) struct LiveRuns(Mutex<HashMap<String, Run>>);

impl LiveRuns {
    /// Processes a line of a flight's standard output if it is a live sample; `false` otherwise. Never waits.
    pub(crate) fn take(&self, id: &str, line: &str) -> bool {
        if !line.starts_with(LINE) {
            return false;
        }
        if let Ok(RunEvent::Sample(sample)) = serde_json::from_str(line) {
            let mut runs = self.lock();
            if !runs.contains_key(id) {
                runs.retain(|_, run| run.heard.elapsed() < SILENCE || run.sender.receiver_count() > 0);
            }
            runs.entry(id.to_owned())
                .or_insert_with(Run::new)
                .take(Arc::new(sample));
        }
        true
    }

    /// The stored samples of a run, and a channel for the following ones, which closes when the attempt has ended.
    pub(crate) fn watch(&self, id: &str) -> (Past, broadcast::Receiver<Arc<LiveSample>>) {
        let mut runs = self.lock();
        let run = runs.entry(id.to_owned()).or_insert_with(Run::new);
        let past = Past {
            samples: run.samples.clone(),
            every: run.every,
        };
        (past, run.sender.subscribe())
    }

    /// The attempt of a run has ended.
    pub(crate) fn end(&self, id: &str) {
        self.lock().remove(id);
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<String, Run>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(step: u64) -> String {
        let sample = LiveSample {
            step,
            sim_time_s: 0.0025 * step as f64,
            values: vec![Some(1.0), None],
        };
        serde_json::to_string(&RunEvent::Sample(sample)).expect("JSON")
    }

    #[test]
    fn val_who_comes_late_sees_all_from_the_first_sample_and_nothing_twice() {
        let runs = LiveRuns::default();
        for step in 0..100 {
            assert!(runs.take("a", &line(4 * step)));
        }
        let (past, mut coming) = runs.watch("a");
        assert_eq!((past.samples.len(), past.every, past.samples[0].step), (100, 1, 0));
        assert!(runs.take("a", &line(400)));
        assert_eq!(coming.try_recv().expect("it came").step, 400);
        assert!(coming.try_recv().is_err(), "nothing twice");
        assert!(!runs.take("a", r#"{"event":"progress"}"#), "something else");
        runs.end("a");
        assert!(runs.watch("a").0.samples.is_empty());
    }

    #[test]
    fn prop_memory_is_bounded_and_what_is_kept_is_evenly_spaced() {
        let runs = LiveRuns::default();
        for step in 0..40_000 {
            runs.take("a", &line(4 * step));
        }
        let (past, _) = runs.watch("a");
        assert!(past.samples.len() <= MOST_KEPT && past.samples.len() >= MOST_KEPT / 2);
        assert_eq!((past.samples[0].step, past.every), (0, 8));
        let steps: Vec<u64> = past.samples.windows(2).map(|two| two[1].step - two[0].step).collect();
        assert!(steps.iter().all(|gap| *gap == 32), "no hole");
        let last = past.samples[past.samples.len() - 1].step;
        assert!(last + 32 > 4 * 39_999, "up to now");
    }

    #[test]
    fn val_a_flight_that_is_begun_again_forgets_the_one_before() {
        let runs = LiveRuns::default();
        for step in [0, 4, 8, 0, 4] {
            runs.take("a", &line(step));
        }
        let steps: Vec<u64> = runs.watch("a").0.samples.iter().map(|sample| sample.step).collect();
        assert_eq!(steps, [0, 4]);
    }
}
