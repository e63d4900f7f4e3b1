//! What all processes of a run share: where the link is, logging, exit codes, what to do when the supervisor dies; and [`launch`], which
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

/// Exit code of a process that was given something wrong; nothing was written.
pub const EXIT_BAD_INPUT: u8 = 2;

/// Says on standard error what went wrong with `program`, and gives the exit code for it. A process goes on to its end although nobody reads that.
pub fn complain(program: &str, sentence: impl std::fmt::Display, code: u8) -> std::process::ExitCode {
    use std::io::Write as _;
    writeln!(std::io::stderr(), "{program}: {sentence}").ok();
    std::process::ExitCode::from(code)
}
