//! What `rotortwin health` is asked for; done by `rotortwin-network`.

use clap::Parser;
use std::path::PathBuf;

/// Arguments of `rotortwin health`.
#[derive(Debug, Parser)]
pub struct Args {
    /// http://HOST:PORT/PATH or https://…: answers with 200; tcp/HOST:PORT or tls/HOST:PORT: takes connections
    pub place: String,
    /// https: certificates that are believed (PEM)
    #[arg(long, value_name = "FILE")]
    pub ca: Option<PathBuf>,
}
