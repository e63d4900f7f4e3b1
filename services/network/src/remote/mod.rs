//! `rotortwin --server URL …`: the same commands, executed by a server.
//!
//! ```text
//!  command ─▶ http (patience, refusals) ─▶ server
//!     │  │       ▲
//!     │  │    events (without gaps, over broken connections)
//!     │  └▶ flights (logs of this machine, uploaded once)
//!     └──▶ fetch (files, resumed) ─▶ run folder, table: as if flown here
//! ```
//! A scenario is read and checked here and sent with all its documents, so that the server flies this machine's version, whatever its
//! library holds. A submission carries an idempotency key: a retry cannot create a second run.

mod blind;
mod campaign;
mod events;
mod fetch;
mod flights;
mod fly;
pub(crate) mod http;
mod jobs;
mod library;
mod results;
mod stop;
mod task;
mod twin;

use http::Remote;
use rotortwin_cli::network::remote::{JobArgs, ServerArgs};
use rotortwin_cli::{Command, output};
use std::process::ExitCode;

pub(crate) use http::RemoteError;

/// Default server of `runs` and similar commands, without `--server`.
const HERE: &str = "http://127.0.0.1:8400";

/// Runs a command on the server.
pub(crate) fn run(server: &ServerArgs, command: &Command) -> ExitCode {
    match command {
        Command::Fly(args) => fly::run(server, args),
        Command::Show(args) => results::show(server, args),
        Command::Replay(args) => results::replay(server, args),
        Command::Campaign(args) => campaign::run(server, args),
        Command::Blind(args) => blind::run(server, args),
        Command::Compare(args) => twin::compare(server, args),
        Command::Diagnose(args) => twin::diagnose(server, args),
        Command::Improve(args) => twin::improve(server, args),
        Command::Log(args) => twin::log(server, args),
        Command::Check(args) => library::check(server, args),
        Command::Train(args) => library::train(server, args),
        Command::Runs(args) => jobs(server, "runs", args),
        Command::Campaigns(args) => jobs(server, "campaigns", args),
        Command::BlindBenches(args) => jobs(server, "blind-benches", args),
        _ => output::bad_input(
            "--server: this command works on this machine only; expected fly, campaign, blind, show, replay, check, compare, diagnose, \
             improve, log import, train, runs, campaigns or blind-benches after --server URL",
        ),
    }
}

/// `rotortwin runs …`
pub(crate) fn jobs(server: &ServerArgs, kind: &'static str, args: &JobArgs) -> ExitCode {
    jobs::run(server, kind, args)
}

/// Runs an operation on a server; its error becomes the exit code.
fn with_server(server: &ServerArgs, work: impl AsyncFnOnce(&Remote) -> Result<ExitCode, RemoteError>) -> ExitCode {
    let done = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| RemoteError::Failed(format!("the network cannot be used: {error}")))
        .and_then(|runtime| {
            runtime.block_on(async {
                let remote = Remote::open(server)?;
                work(&remote).await
            })
        });
    match done {
        Ok(code) => code,
        Err(RemoteError::BadInput(sentence)) => output::bad_input(sentence),
        Err(RemoteError::Failed(sentence)) => output::failed(sentence),
    }
}
