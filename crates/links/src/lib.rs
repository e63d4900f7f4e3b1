//! Links between processes: transports for the messages of `rotortwin-wire` to another process or host.
//!
//! * [`endpoint`]: one process's end of a link, independent of the transport: handshake, order, time-outs, failures;
//! * [`iox2`]: shared memory between processes of one host (iceoryx2);
//! * [`zenoh`]: endpoints of links over TCP between hosts; the link itself is in `rotortwin-zenoh`;
//! * [`security`]: authentication and access control for those links.
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
