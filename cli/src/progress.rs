//! How far a long calculation is: a line on a terminal that is written over, or events for the server that started the process.

use serde_json::json;
use std::io::{IsTerminal as _, Write as _};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Between two events.
const PAUSE: Duration = Duration::from_millis(250);

/// Where progress is told.
pub(crate) struct Progress {
    shown: bool,
    events: Option<Mutex<Option<Instant>>>,
}

impl Progress {
    /// `quiet`: nothing on the terminal; `events`: JSON lines on standard output.
    pub(crate) fn new(quiet: bool, events: bool) -> Self {
        Self {
            shown: !quiet && std::io::stderr().is_terminal(),
            events: events.then(Mutex::default),
        }
    }

    /// What is done now, and the share that is done of all.
    pub(crate) fn tell(&self, text: &str, share: f64) {
        if self.shown {
            // A terminal that went away ends the command elsewhere.
            write!(std::io::stderr(), "\r\x1b[K{:3.0} % {text}", 100.0 * share).ok();
        }
        if let Some(events) = &self.events {
            let mut last = events.lock().unwrap_or_else(PoisonError::into_inner);
            if last.is_none_or(|last| last.elapsed() >= PAUSE) {
                *last = Some(Instant::now());
                println!("{}", json!({ "event": "progress", "share": share, "text": text }));
            }
        }
    }

    /// Room for other words.
    pub(crate) fn clear(&self) {
        if self.shown {
            eprint!("\r\x1b[K");
        }
    }
}
