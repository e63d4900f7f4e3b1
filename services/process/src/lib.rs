//! Common parts of all processes of a run: link address, logging, exit codes, behaviour when the supervisor dies; and [`launch`], which
//! starts and watches them.

mod address;
pub mod launch;
mod logging;
mod peer;
mod placement;
pub mod priority;
mod supervisor;
pub mod zenoh_config;

pub use address::{LinkAddress, LinkAddressError};
pub use logging::start_logging;
pub use peer::{AnyEndpoint, PeerArgs, parse_run_id, pin_to_cpu};
pub use placement::Placement;
pub use supervisor::{StopRequest, Supervisor, request_line};

/// Exit code of a process whose run failed.
pub const EXIT_FAILED: u8 = 1;

/// Exit code of a process with invalid input; nothing was written.
pub const EXIT_BAD_INPUT: u8 = 2;

/// Reports an error of `program` on standard error, and returns the exit code for it. Continues even if standard error cannot be written.
pub fn complain(program: &str, sentence: impl std::fmt::Display, code: u8) -> std::process::ExitCode {
    use std::io::Write as _;
    writeln!(std::io::stderr(), "{program}: {sentence}").ok();
    std::process::ExitCode::from(code)
}
