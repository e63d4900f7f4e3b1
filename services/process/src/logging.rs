//! Logs go to standard error, so that standard output stays for events and results.

use std::io::IsTerminal as _;
use tracing_subscriber::EnvFilter;

/// Starts logging at `warn`, or at what `ROTORTWIN_LOG` asks for (e.g. `info`, `rotortwin_wire=debug`).
///
/// `ROTORTWIN_LOG_FORMAT=json`: a JSON object a line, for programs. Called once by a process; a second call changes nothing.
pub fn start_logging() {
    let filter = EnvFilter::try_from_env("ROTORTWIN_LOG").unwrap_or_else(|_| EnvFilter::new("warn,zenoh=error"));
    let lines = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        // It would complain on standard error that standard error cannot be written, and panic.
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
