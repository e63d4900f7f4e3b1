//! All that goes over zenoh: the link of a run between hosts, a router, and other topics.
//!
//! * [`endpoint`]: one process's end of a run's link, and the router;
//! * [`topics`]: plain topics, for services that are not part of a flight;
//! * [`fdi_topic`]: an FDI session fed over such topics, and its client.
//!
//! A crate of its own because zenoh takes minutes to compile and a flight over shared memory does not need it. [`provide`] makes a
//! program speak zenoh.

pub mod endpoint;
pub mod fdi_topic;
pub mod topics;

use rotortwin_links::zenoh::Opener;

/// From now on this program opens links over zenoh.
pub fn provide() {
    const OPEN: Opener = |role, run_id, options| Ok(Box::new(endpoint::ZenohEndpoint::new(role, run_id, options)?));
    rotortwin_links::zenoh::provide(OPEN);
}
