//! Arguments of `rotortwin router`; executed by `rotortwin-network`.

use clap::Parser;
use std::path::PathBuf;

/// Arguments of `rotortwin router`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Endpoint to listen on, e.g. tls/0.0.0.0:7447
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/127.0.0.1:7447")]
    pub listen: String,
    /// File with certificates, users and permissions: docs/hosts.md
    #[arg(long, value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
}
