//! Which Ray cluster, and what a part takes there.

use std::collections::BTreeMap;
use std::path::PathBuf;

/// A Ray cluster that parts are handed to.
#[derive(Debug, Clone, PartialEq)]
pub struct RayConfig {
    /// Of its dashboard: `http://HEAD:8265`.
    pub url: String,
    /// A token of the cluster, if it asks for one.
    pub token: Option<String>,
    /// Parts that are handed over at the same time.
    pub parts: usize,
    /// Processors of a part.
    pub cpus: f64,
    /// Memory that Ray sets aside for a part, bytes; none: Ray does not count it.
    pub memory: Option<u64>,
    /// What else a part takes, by the names that the cluster has given.
    pub resources: BTreeMap<String, f64>,
    /// `rotortwin` on the nodes.
    pub program: String,
    /// How the nodes reach this server; none: where it listens.
    pub callback: Option<String>,
    /// Certificates by which the nodes know this server (PEM); none: those that they believe anyway.
    pub ca: Option<PathBuf>,
}

impl RayConfig {
    /// As sentences name it.
    pub(crate) fn name(&self) -> String {
        format!("Ray at {}", self.url)
    }
}
