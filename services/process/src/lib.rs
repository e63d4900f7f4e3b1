//! What all processes of a run share: where the link is, logging, exit codes, and what to do when the supervisor dies.

mod address;
mod logging;
mod peer;
mod supervisor;
pub mod zenoh_config;

pub use address::{LinkAddress, LinkAddressError};
pub use logging::start_logging;
pub use peer::{AnyEndpoint, PeerArgs, parse_run_id, pin_to_cpu};
pub use supervisor::{StopRequest, Supervisor, request_line};

/// Exit code of a process whose run failed.
pub const EXIT_FAILED: u8 = 1;

/// Exit code of a process that was given something wrong; nothing was written.
pub const EXIT_BAD_INPUT: u8 = 2;
