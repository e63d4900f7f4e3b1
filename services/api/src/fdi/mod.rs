//! FDI as a service behind HTTP: the sessions that are open, and logs that are judged.
//!
//! ```text
//!  routes::fdi ─▶ FdiSessions ─▶ Entry{FdiSession, verdicts that changed}
//!  routes::fdi_reports, rotortwin fdi-log ─▶ log ─▶ FdiSession ─▶ LogReport
//! ```
//! * [`answers`]: what goes out as JSON. * [`samples`]: what comes in as JSON, lines of JSON, or CSV. * [`sessions`]: who is open, for how
//!   long. * [`log`]: a whole flight log.
//!
//! Sessions live in the memory of the server and end with it.

pub mod answers;
pub mod log;
pub(crate) mod samples;
pub mod sessions;

pub(crate) use sessions::FdiSessions;
