//! Printing to a reader who may have gone: `rotortwin effects | head -1` ends quietly, and a flight goes on without its progress.
//!
//! The macros of the standard library panic where a write fails. Those at the top of this crate have the same names and come here.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write as _};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Nobody reads the standard output any more.
static CLOSED: AtomicBool = AtomicBool::new(false);

/// Why the standard output could not be written, other than that nobody reads it.
static FAILURE: OnceLock<String> = OnceLock::new();

/// Writes to the standard output.
pub fn print(text: Arguments<'_>) {
    note(std::io::stdout().lock().write_fmt(text));
}

/// Writes to the standard error. There is nobody to tell if that fails.
pub fn print_error(text: Arguments<'_>) {
    std::io::stderr().lock().write_fmt(text).ok();
}

/// Writes a line that a program reads as soon as it is there.
pub fn line(text: &str) {
    let mut out = std::io::stdout().lock();
    note(writeln!(out, "{text}").and_then(|()| out.flush()));
}

/// The reader of the standard output has closed it: what only tells may stop.
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

/// Why the answer of this command could not be written, other than that nobody reads it: a full disk, for instance.
pub fn failure() -> Option<&'static str> {
    note(std::io::stdout().lock().flush());
    FAILURE.get().map(String::as_str)
}
