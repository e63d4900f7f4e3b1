//! FDI as a service behind HTTP: the sessions that are open, and logs that are judged.
//!
//! ```text
//!  routes::fdi ─▶ FdiSessions ─▶ Entry{FdiSession, verdicts that changed}
//!  routes::fdi_reports ─▶ a process of `rotortwin fdi-log`
//! ```
//! * [`samples`]: what comes in as JSON, lines of JSON, or CSV. * [`sessions`]: who is open, for how long. What goes out as JSON stands in
//!   [`rotortwin_verdicts::view`].
//!
//! Sessions live in the memory of the server and end with it.

pub(crate) mod samples;
pub mod sessions;

pub(crate) use sessions::FdiSessions;
