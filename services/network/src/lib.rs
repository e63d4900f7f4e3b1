//! `rotortwin` with everything that talks to other hosts: the HTTP server and its client, workers, tokens, zenoh.
//!
//! It knows every command of [`rotortwin_cli`], whose program starts this one for those it cannot run itself.

#[macro_use]
extern crate rotortwin_cli;

mod campaign_store;
mod fdi_service;
mod foxglove;
mod health;
mod part;
mod remote;
mod router;
mod serve;
mod token;

use rotortwin_cli::network::remote::ServerArgs;
use rotortwin_cli::{Command, network};
use std::process::ExitCode;

/// Runs the command line of this process.
pub fn run() -> ExitCode {
    rotortwin_zenoh::provide();
    rotortwin_cli::foxglove::provide(foxglove::open);
    rotortwin_cli::run(Some(perform))
}

fn perform(server: &ServerArgs, command: &Command) -> ExitCode {
    match command {
        Command::Campaigns(args) => remote::jobs(server, "campaigns", args),
        Command::BlindBenches(args) => remote::jobs(server, "blind-benches", args),
        Command::Runs(args) => remote::jobs(server, "runs", args),
        command if server.server.is_some() => remote::run(server, command),
        Command::Serve(args) => serve::run(args),
        Command::Worker(args) => serve::work(args),
        Command::Part(_) => part::run(),
        Command::Token(args) => token::run(args),
        Command::Router(args) => router::run(args),
        Command::Health(args) => health::run(args),
        Command::Campaign(args) => rotortwin_cli::campaign::run(args, Some(&campaign_store::Buckets)),
        Command::FdiService(args) => fdi_service::run(args),
        _ => rotortwin_cli::output::failed(format!("{} does not know this command", network::PROGRAM)),
    }
}
