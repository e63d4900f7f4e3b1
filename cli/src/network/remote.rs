//! Server selection, and commands for its jobs; executed by `rotortwin-network`.

use clap::{Parser, Subcommand};
use std::path::PathBuf;

/// The server, its certificate, and who asks.
#[derive(Debug, Clone, Parser)]
pub struct ServerArgs {
    /// Run on this server, such as http://bench:8400
    #[arg(long, value_name = "URL", global = true, help_heading = "Server")]
    pub server: Option<String>,
    /// With --server: file with the token [default: what ROTORTWIN_TOKEN holds]
    #[arg(long, value_name = "FILE", global = true, help_heading = "Server")]
    pub token_file: Option<PathBuf>,
    /// With --server: certificate (PEM) of the authority that signed the server's [default: those of this machine]
    #[arg(long, value_name = "FILE", global = true, help_heading = "Server")]
    pub ca: Option<PathBuf>,
}

/// Arguments of `rotortwin runs`.
#[derive(Debug, Parser)]
pub struct JobArgs {
    /// What is done.
    #[command(subcommand)]
    pub verb: Verb,
}

/// What is done with jobs of a server.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// List the latest ones
    List {
        /// Only those in this state: queued, running, done, failed, canceled
        #[arg(long, value_name = "STATE")]
        status: Option<String>,
        /// Only those with this name
        #[arg(long, value_name = "NAME")]
        name: Option<String>,
        /// Maximum number
        #[arg(long, value_name = "COUNT", default_value_t = 20)]
        limit: u64,
        /// Print them as JSON
        #[arg(long)]
        json: bool,
    },
    /// Print all details of one, as JSON
    Get {
        /// Its id
        id: String,
    },
    /// Print its events as JSON lines, until it has ended
    Events {
        /// Its id
        id: String,
        /// Only those after this number
        #[arg(long, value_name = "NUMBER", default_value_t = 0)]
        after: u64,
    },
    /// Cancel it; the results so far are kept
    Cancel {
        /// Its id
        id: String,
    },
    /// Delete one that has ended, with its files
    Delete {
        /// Its id
        id: String,
    },
    /// Download all its files
    Fetch {
        /// Its id
        id: String,
        /// Folder to write; must not exist or be empty [default: runs/NAME-SEED, with a number if that exists]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}
