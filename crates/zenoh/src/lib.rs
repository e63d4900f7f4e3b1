//! Everything that uses zenoh: the link of a run between hosts, a router, and other topics.
//!
//! * [`endpoint`]: one process's end of a run's link, and the router;
//! * [`topics`]: plain topics, for services that are not part of a flight;
//! * [`fdi_topic`]: an FDI session fed over such topics, and its client.
//!
//! A separate crate because zenoh takes minutes to compile and a flight over shared memory does not need it. [`provide`] enables
//! zenoh in a program.

pub mod endpoint;
pub mod fdi_topic;
pub mod topics;

use rotortwin_links::zenoh::Opener;

/// Enables links over zenoh in this program.
pub fn provide() {
    const OPEN: Opener = |role, run_id, options| Ok(Box::new(endpoint::ZenohEndpoint::new(role, run_id, options)?));
    rotortwin_links::zenoh::provide(OPEN);
}
