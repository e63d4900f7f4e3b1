//! Logs go to standard error; standard output is reserved for events and results.

use std::io::IsTerminal as _;
use tracing_subscriber::EnvFilter;

/// Starts logging at `warn`, or at the level in `ROTORTWIN_LOG` (e.g. `info`, `rotortwin_wire=debug`).
///
/// `ROTORTWIN_LOG_FORMAT=json`: one JSON object per line, for programs. Called once per process; further calls have no
/// effect.
pub fn start_logging() {
    let filter = EnvFilter::try_from_env("ROTORTWIN_LOG").unwrap_or_else(|_| EnvFilter::new("warn,zenoh=error"));
    let lines = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        // Otherwise it would report on standard error that standard error cannot be written, and panic.
        .log_internal_errors(false)
        .with_target(false);
    let started = if std::env::var_os("ROTORTWIN_LOG_FORMAT").is_some_and(|format| format == "json") {
        lines.json().flatten_event(true).try_init()
    } else {
        lines.try_init()
    };
    if started.is_err() {
        tracing::debug!("logging was started before");
    }
}
