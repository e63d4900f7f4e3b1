//! Arguments of `rotortwin token`; executed by `rotortwin-network`.

use clap::{Parser, Subcommand};
use std::path::PathBuf;

/// Arguments of `rotortwin token`.
#[derive(Debug, Parser)]
pub struct Args {
    /// What is done.
    #[command(subcommand)]
    pub what: What,
    /// Data folder of the server
    #[arg(long, value_name = "DIR", default_value = "data", global = true)]
    pub data: PathBuf,
    /// Database of the server [default: SQLite in the data folder]
    #[arg(
        long,
        value_name = "URL",
        env = "DATABASE_URL",
        hide_env_values = true,
        global = true
    )]
    pub database_url: Option<String>,
}

/// What is done with tokens.
#[derive(Debug, Subcommand)]
pub enum What {
    /// Create a token; it is printed once and not stored
    Create {
        /// Name of its owner, for people
        name: String,
        /// Tenant that owns its jobs
        #[arg(long, default_value = "local")]
        tenant: String,
        /// read: see the tenant's jobs; write: submit, cancel, delete; admin: everything of every tenant
        #[arg(long, value_delimiter = ',', default_value = "read,write", value_parser = ["read", "write", "admin"])]
        scopes: Vec<String>,
        /// Lifetime in days; 0: it does not expire
        #[arg(long, value_name = "DAYS", default_value_t = 90, value_parser = clap::value_parser!(i64).range(0..=3650))]
        days: i64,
    },
    /// List all tokens, without their secrets
    List,
    /// Revoke a token
    Revoke {
        /// The part between `rtw_` and the next `_`
        id: String,
    },
}
