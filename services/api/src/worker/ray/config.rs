//! Configuration of the Ray cluster, and resources of a part.

use std::collections::BTreeMap;
use std::path::PathBuf;

/// A Ray cluster that executes parts.
#[derive(Debug, Clone, PartialEq)]
pub struct RayConfig {
    /// URL of its dashboard: `http://HEAD:8265`.
    pub url: String,
    /// A token of the cluster, if required.
    pub token: Option<String>,
    /// Maximum number of concurrently submitted parts.
    pub parts: usize,
    /// CPUs of a part.
    pub cpus: f64,
    /// Memory that Ray reserves for a part, bytes; none: not accounted.
    pub memory: Option<u64>,
    /// Other resources of a part, by their names in the cluster.
    pub resources: BTreeMap<String, f64>,
    /// `rotortwin` on the nodes.
    pub program: String,
    /// URL of this server for the nodes; none: its listening address.
    pub callback: Option<String>,
    /// Certificates with which the nodes verify this server (PEM); none: their default trust store.
    pub ca: Option<PathBuf>,
}

impl RayConfig {
    /// Name in messages.
    pub(crate) fn name(&self) -> String {
        format!("Ray at {}", self.url)
    }
}
