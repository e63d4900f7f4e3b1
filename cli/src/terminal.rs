//! Printing to a possibly closed pipe: `rotortwin effects | head -1` ends quietly, and a flight continues without its progress
//! output.
//!
//! The macros of the standard library panic if a write fails. Those at the top of this crate have the same names and use this
//! module.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write as _};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// The reader of standard output has closed it.
static CLOSED: AtomicBool = AtomicBool::new(false);

/// Why standard output could not be written, other than a closed pipe.
static FAILURE: OnceLock<String> = OnceLock::new();

/// Writes to the standard output.
pub fn print(text: Arguments<'_>) {
    note(std::io::stdout().lock().write_fmt(text));
}

/// Writes to standard error. A failure cannot be reported.
pub fn print_error(text: Arguments<'_>) {
    std::io::stderr().lock().write_fmt(text).ok();
}

/// Writes and flushes a line for a program.
pub fn line(text: &str) {
    let mut out = std::io::stdout().lock();
    note(writeln!(out, "{text}").and_then(|()| out.flush()));
}

/// The reader of standard output has closed it: purely informative output may stop.
pub fn is_closed() -> bool {
    CLOSED.load(Ordering::Relaxed)
}

fn note(written: std::io::Result<()>) {
    match written {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::BrokenPipe => CLOSED.store(true, Ordering::Relaxed),
        Err(error) => {
            FAILURE.get_or_init(|| error.to_string());
        }
    }
}

/// Why the output of this command could not be written, other than a closed pipe: a full disk, for instance.
pub fn failure() -> Option<&'static str> {
    note(std::io::stdout().lock().flush());
    FAILURE.get().map(String::as_str)
}
