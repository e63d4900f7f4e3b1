//! Progress of a long calculation: an updated line on a terminal, now and then a line in a file or a pipe, or events for the server that
//! started the process.

use crate::output;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use rotortwin_jobs::{JobEvent, Progress as Told};
use std::fmt::Write as FormatWrite;
use std::io::{IsTerminal as _, Write as _};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Minimum interval between events.
const PAUSE: Duration = Duration::from_millis(250);
/// Minimum interval between events that count flights.
const PAUSE_OF_FLIGHTS: Duration = Duration::from_millis(500);

/// Interval between lines if standard error is not a terminal: frequent enough to show activity, rare enough for a log
/// file.
const PAUSE_OF_A_PIPE: Duration = Duration::from_secs(15);

/// Progress output.
pub(crate) struct Progress {
    shown: Shown,
    lines: Option<Lines>,
}

/// What standard error is given.
enum Shown {
    Nothing,
    /// One line that is updated.
    Updated,
    /// Lines of their own, and when the last one was written.
    Lines(Mutex<Instant>),
}

impl Progress {
    /// `quiet`: nothing on the terminal; `events`: JSON lines on standard output.
    pub(crate) fn new(quiet: bool, events: bool) -> Self {
        let shown = if quiet || events {
            Shown::Nothing
        } else if std::io::stderr().is_terminal() {
            Shown::Updated
        } else {
            Shown::Lines(Mutex::new(Instant::now()))
        };
        Self {
            shown,
            lines: events.then(Lines::new),
        }
    }

    /// Current activity, and the completed fraction.
    pub(crate) fn tell(&self, event: &JobEvent) {
        if let JobEvent::Progress(Told::Share { share, text }) = event {
            let percent = 100.0 * share;
            // A reader that has gone ends the command elsewhere.
            match &self.shown {
                Shown::Nothing => {}
                Shown::Updated => {
                    write!(std::io::stderr(), "\r\x1b[K{percent:3.0} % {text}").ok();
                }
                Shown::Lines(last) => {
                    let mut last = last.lock().unwrap_or_else(PoisonError::into_inner);
                    if last.elapsed() >= PAUSE_OF_A_PIPE {
                        *last = Instant::now();
                        writeln!(std::io::stderr(), "{percent:3.0} % {text}").ok();
                    }
                }
            }
        }
        if let Some(lines) = &self.lines {
            lines.tell(event);
        }
    }

    /// Clears the line for other output.
    pub(crate) fn clear(&self) {
        if matches!(self.shown, Shown::Updated) {
            eprint!("\r\x1b[K");
        }
    }
}

/// Events as JSON lines on standard output: progress at intervals, all others immediately.
pub(crate) struct Lines {
    begun: Instant,
    last: Mutex<Option<Instant>>,
}

impl Lines {
    pub(crate) fn new() -> Self {
        Self {
            begun: Instant::now(),
            last: Mutex::default(),
        }
    }

    pub(crate) fn tell(&self, event: &JobEvent) {
        if let JobEvent::Progress(progress) = event {
            let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
            let due = match progress {
                Told::Share { .. } => last.is_none_or(|last| last.elapsed() >= PAUSE),
                Told::Flights { flights, of, .. } => {
                    flights >= of || last.unwrap_or(self.begun).elapsed() >= PAUSE_OF_FLIGHTS
                }
            };
            if !due {
                return;
            }
            *last = Some(Instant::now());
        }
        match serde_json::to_string(event) {
            Ok(line) => output::line(&line),
            Err(error) => tracing::error!(%error, "an event cannot be written"),
        }
    }
}

/// A progress bar for work of which `present` of `wanted` parts were done before. In addition to the keys of `indicatif`, `template` may
/// contain `{rate}`, parts per second, and `{left}`, the remaining time; both refer to the work done now.
pub(crate) fn resumed_bar(template: &str, hidden: bool, wanted: u64, present: u64) -> ProgressBar {
    let target = if hidden {
        ProgressDrawTarget::hidden()
    } else {
        ProgressDrawTarget::stderr()
    };
    let start = Instant::now();
    let done = move |state: &ProgressState| state.pos().saturating_sub(present);
    let style = ProgressStyle::with_template(template)
        .expect("the template is well formed")
        .progress_chars("━╸─")
        .with_key("rate", move |state: &ProgressState, out: &mut dyn FormatWrite| {
            let rate = done(state) as f64 / start.elapsed().as_secs_f64().max(1e-3);
            write!(out, "{rate:.1}/s").ok();
        })
        .with_key("left", move |state: &ProgressState, out: &mut dyn FormatWrite| {
            let missing = wanted.saturating_sub(state.pos());
            match time_left(done(state), missing, start.elapsed()) {
                Some(left) => write!(out, "{} left", HumanDuration(left)).ok(),
                None => write!(out, "time not known yet").ok(),
            };
        });
    let bar = ProgressBar::with_draw_target(Some(wanted), target).with_style(style);
    bar.set_position(present);
    bar
}

/// Remaining time at the pace of the work done in `elapsed`; `None` before any.
fn time_left(done: u64, missing: u64, elapsed: Duration) -> Option<Duration> {
    (done > 0).then(|| elapsed.mul_f64(missing as f64 / done as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 900 of 1000 parts existed, 10 were done in 5 s: the library's bar counted the 900 as work of these 5 s.
    #[test]
    fn regress_the_estimate_counts_what_is_done_now() {
        let second = Duration::from_secs(1);
        assert_eq!(time_left(10, 90, 5 * second), Some(45 * second));
        assert_eq!(time_left(0, 100, 5 * second), None);
        let bar = resumed_bar("{rate} {left}", true, 1000, 900);
        bar.inc(10);
        assert_eq!((bar.position(), bar.length()), (910, Some(1000)));
    }
}
