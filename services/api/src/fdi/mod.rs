//! FDI as an HTTP service: open sessions, and log evaluation.
//!
//! ```text
//!  routes::fdi ─▶ FdiSessions ─▶ Entry{FdiSession, verdicts that changed}
//!  routes::fdi_reports ─▶ a process of `rotortwin fdi-log`
//! ```
//! * [`samples`]: input as JSON, JSON lines, or CSV. * [`sessions`]: open sessions and their lifetime. The JSON output is defined in
//!   [`rotortwin_verdicts::view`].
//!
//! Sessions live in the memory of the server and end with it.

pub(crate) mod samples;
pub mod sessions;

pub(crate) use sessions::FdiSessions;
