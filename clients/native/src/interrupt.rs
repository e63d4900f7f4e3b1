//! Ctrl-C in long calls: Python only notes the signal, and a call that never returns to it would have to be killed.

use pyo3::prelude::*;
use std::cell::Cell;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, Builder};
use std::time::{Duration, Instant};

/// Longest time until a signal is noticed.
const NOTICED_WITHIN: Duration = Duration::from_millis(50);
/// Stack of the thread that works, bytes: as the main thread of a program usually has.
const STACK_BYTES: usize = 8 << 20;
/// What a reading of [`Clock`] adds once the work is to stop, s, and the limit of time that only such a reading exceeds.
const AGES_S: f64 = 1e12;
pub(crate) const TIME_LIMIT_S: f64 = 1e11;

/// Does `work` on another thread, without Python's lock. On a signal whose handler raises (Ctrl-C: `KeyboardInterrupt`), tells `work` to
/// stop, waits for it, and raises; what it found is discarded.
///
/// Signals are handled by Python's main thread only: called from another one, the work is completed.
pub(crate) fn interruptible<T: Send>(py: Python<'_>, work: impl FnOnce(&AtomicBool) -> T + Send) -> PyResult<T> {
    let (stop, ended, caller) = (AtomicBool::new(false), AtomicBool::new(false), thread::current());
    thread::scope(|scope| {
        let worker = Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, || {
            let result = work(&stop);
            ended.store(true, Ordering::Release);
            caller.unpark();
            result
        })?;
        let mut raised = None;
        // A worker that panics is finished without saying so.
        while !ended.load(Ordering::Acquire) && !worker.is_finished() {
            py.detach(|| thread::park_timeout(NOTICED_WITHIN));
            if let Err(error) = py.check_signals() {
                stop.store(true, Ordering::Relaxed);
                raised.get_or_insert(error);
            }
        }
        // Its last instructions need no lock; those of a panic are few.
        let result = worker.join().unwrap_or_else(|panic| resume_unwind(panic));
        raised.map_or(Ok(result), Err)
    })
}

/// Takes `steps` steps, at most `at_once` at a time without Python's lock, and raises after a signal whose handler does (Ctrl-C): what was
/// taken until then stays. `part` takes some, and says whether there are more.
pub(crate) fn in_parts(
    py: Python<'_>,
    steps: u64,
    at_once: u64,
    mut part: impl FnMut(u64) -> PyResult<bool> + Send,
) -> PyResult<()> {
    let mut left = steps;
    while left > 0 {
        let now = left.min(at_once);
        let goes_on = py.detach(|| part(now))?;
        py.check_signals()?;
        left = if goes_on { left - now } else { 0 };
    }
    Ok(())
}

/// The clock of a search: seconds since it was made, and beyond [`TIME_LIMIT_S`] between any two readings once `stop` is set.
pub(crate) struct Clock<'a> {
    start: Instant,
    stop: &'a AtomicBool,
    aged_s: Cell<f64>,
}

impl<'a> Clock<'a> {
    pub(crate) fn new(stop: &'a AtomicBool) -> Self {
        Self {
            start: Instant::now(),
            stop,
            aged_s: Cell::new(0.0),
        }
    }

    /// s.
    pub(crate) fn read(&self) -> f64 {
        if self.stop.load(Ordering::Relaxed) {
            self.aged_s.set(self.aged_s.get() + AGES_S);
        }
        self.start.elapsed().as_secs_f64() + self.aged_s.get()
    }
}
