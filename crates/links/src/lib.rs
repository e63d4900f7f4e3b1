//! Links between processes: what carries the messages of `rotortwin-wire` to another process or host.
//!
//! * [`endpoint`]: one process's end of a link, and all that does not depend on the transport: hand-shake, order, time-outs, deaths;
//! * [`iox2`]: shared memory between processes of one host (iceoryx2);
//! * [`zenoh`]: where a link over TCP between hosts is met; the link itself is in `rotortwin-zenoh`;
//! * [`security`]: who is let in there, and what each may say and hear.
//!
//! The link within one process is `rotortwin_wire::link::in_process`; a campaign needs no other and does not compile this crate.
//! All give the same answers, so a run has the same hash over each of them: `crates/zenoh/tests/conformance.rs`.

pub mod endpoint;
pub mod iox2;
pub mod security;
mod shared_frame;
mod watch;
pub mod zenoh;

pub use watch::host_name;
