//! Arguments of `rotortwin health`; executed by `rotortwin-network`.

use clap::Parser;
use std::path::PathBuf;

/// Arguments of `rotortwin health`.
#[derive(Debug, Parser)]
pub struct Args {
    /// http://HOST:PORT/PATH or https://…: answers with 200; tcp/HOST:PORT or tls/HOST:PORT: takes connections; worker:DATA: the worker with
    /// this data folder on this host is alive
    pub place: String,
    /// worker:DATA: maximum age of its heartbeat, s
    #[arg(long, value_name = "S", default_value_t = 60, value_parser = clap::value_parser!(u64).range(4..=86_400))]
    pub silence: u64,
    /// https: trusted certificates (PEM)
    #[arg(long, value_name = "FILE")]
    pub ca: Option<PathBuf>,
}
