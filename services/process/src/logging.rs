//! Logs go to standard error, so that standard output stays for events and results.

use std::io::IsTerminal as _;
use tracing_subscriber::EnvFilter;

/// Starts logging at `warn`, or at what `ROTORTWIN_LOG` asks for (e.g. `info`, `rotortwin_wire=debug`).
///
/// Called once by a process; a second call changes nothing.
pub fn start_logging() {
    let filter = EnvFilter::try_from_env("ROTORTWIN_LOG").unwrap_or_else(|_| EnvFilter::new("warn,zenoh=error"));
    let started = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .try_init();
    if started.is_err() {
        tracing::debug!("logging was started before");
    }
}
