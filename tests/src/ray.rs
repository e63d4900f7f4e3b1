//! A Ray cluster on this machine: an idle head, and two nodes with one CPU each.

use crate::python::{bytecode_folder, client_folder, environment};
use serde_json::Value;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Python with Ray, Dask and the dependencies of the client's executor tests. `None`: it cannot be created here, and a line says why.
pub fn executors_environment() -> Option<PathBuf> {
    let client = client_folder().display().to_string();
    let packages = [
        "--editable",
        &client,
        "ray[default]==2.60.0",
        "distributed==2026.8.0",
        "pyarrow>=15",
        "pytest>=8",
    ];
    environment("executors-environment", &packages)
}

/// Held by a test as long as it has a cluster: with two clusters on one host, neither started any more parts (observed with Ray 2.60; cause unknown).
pub fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The cluster; stopped on drop.
#[derive(Debug)]
pub struct RayCluster {
    child: Child,
    stdin: Option<ChildStdin>,
    stdout: BufReader<ChildStdout>,
    dashboard: String,
}

impl RayCluster {
    /// Starts it, which takes about ten seconds. `None`: Ray is not available here.
    ///
    /// # Panics
    /// It does not start.
    pub fn start() -> Option<Self> {
        Self::start_with(&[], None)
    }

    /// [`start`](Self::start) with environment variables, and a port for its dashboard.
    ///
    /// # Panics
    /// It does not start.
    pub fn start_with(environment: &[(&str, &str)], port: Option<u16>) -> Option<Self> {
        let programs = executors_environment()?;
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/src/ray_cluster.py");
        let mut child = Command::new(programs.join("python"))
            .arg(script)
            .args(port.map(|port| port.to_string()))
            .envs(environment.iter().copied())
            .env("RAY_USAGE_STATS_ENABLED", "0")
            .env("PYTHONPYCACHEPREFIX", bytecode_folder())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("Python starts");
        let mut cluster = Self {
            stdin: child.stdin.take(),
            stdout: BufReader::new(child.stdout.take().expect("it is piped")),
            child,
            dashboard: String::new(),
        };
        let said = cluster.line();
        said["dashboard"]
            .as_str()
            .expect("the cluster starts")
            .clone_into(&mut cluster.dashboard);
        Some(cluster)
    }

    /// Its next output line. (Ray itself may print as well.)
    fn line(&mut self) -> Value {
        loop {
            let mut line = String::new();
            let read = self.stdout.read_line(&mut line).expect("it can be read");
            assert_ne!(read, 0, "the cluster has ended");
            if let Ok(value) = serde_json::from_str(&line) {
                return value;
            }
        }
    }

    /// Port of the dashboard on this host.
    ///
    /// # Panics
    /// Its address contains none.
    pub fn port(&self) -> u16 {
        let port = self.dashboard.rsplit(':').next().and_then(|port| port.parse().ok());
        port.expect("a port")
    }

    /// URL of its dashboard.
    pub fn url(&self) -> &str {
        &self.dashboard
    }

    /// `kill -9` of the raylet of a node, 0 or 1.
    ///
    /// # Panics
    /// The cluster has ended.
    pub fn kill_node(&mut self, number: usize) {
        self.order(&format!("kill {number}"));
    }

    /// Another node in place of one that was killed.
    ///
    /// # Panics
    /// The cluster has ended.
    pub fn add_node(&mut self, number: usize) {
        self.order(&format!("add {number}"));
    }

    fn order(&mut self, words: &str) {
        let stdin = self.stdin.as_mut().expect("it is open");
        writeln!(stdin, "{words}").expect("it listens");
        let said = self.line();
        assert_eq!(said["done"], words);
    }
}

impl Drop for RayCluster {
    fn drop(&mut self) {
        drop(self.stdin.take());
        if let Err(error) = self.child.wait() {
            eprintln!("the Ray cluster does not end: {error}");
        }
    }
}
