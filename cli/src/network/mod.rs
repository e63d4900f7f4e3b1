//! Commands that need other hosts: what they are asked for, and the program that does them.
//!
//! `rotortwin` flies, compares, diagnoses and judges on this machine. HTTP server and client, workers and zenoh are four fifths of all that
//! would be compiled with it, so they are in `rotortwin-network`, which knows all commands of this one as well. Whoever asks this program for
//! one of them is answered by that one, in its place: docs/decisions/0062.

pub mod autopilot;
pub mod health;
pub mod remote;
pub mod router;
pub mod serve;
pub mod token;

use crate::{Cli, Command, fly, output};
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::ExitCode;

/// The program that can do them.
pub const PROGRAM: &str = "rotortwin-network";

/// What `rotortwin-network` does with a command that only it can do.
pub type Perform = fn(&remote::ServerArgs, &Command) -> ExitCode;

/// How a command is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Needs {
    /// By this machine alone.
    Nothing,
    /// As on this machine alone, but over zenoh.
    Zenoh,
    /// By code that is in `rotortwin-network` only.
    Network,
}

pub(crate) fn needs(cli: &Cli) -> Needs {
    if cli.server.server.is_some() {
        return Needs::Network;
    }
    let link = |address: &rotortwin_process::LinkAddress| match address.transport() {
        "zenoh" => Needs::Zenoh,
        _ => Needs::Nothing,
    };
    match &cli.command {
        Command::Serve(_)
        | Command::Worker(_)
        | Command::Token(_)
        | Command::Router(_)
        | Command::Health(_)
        | Command::FdiService(_)
        | Command::Runs(_)
        | Command::Campaigns(_)
        | Command::BlindBenches(_) => Needs::Network,
        Command::Fly(args) if args.link == fly::LinkKind::Zenoh => Needs::Zenoh,
        Command::Conform(args) if args.is_over_zenoh() => Needs::Zenoh,
        Command::Sim(args) => link(&args.link),
        Command::Controller(args) => link(&args.peer.link),
        Command::Fdi(args) => link(&args.peer.link),
        _ => Needs::Nothing,
    }
}

/// Lets `rotortwin-network` do what this process was asked for: beside this program, or else on the search path.
pub(crate) fn hand_over() -> ExitCode {
    let beside = std::env::current_exe().ok().map(|own| own.with_file_name(PROGRAM));
    let program = beside
        .filter(|path| path.is_file())
        .unwrap_or_else(|| PathBuf::from(PROGRAM));
    let error = std::process::Command::new(&program)
        .args(std::env::args_os().skip(1))
        .exec();
    if error.kind() == std::io::ErrorKind::NotFound {
        return output::bad_input(format!(
            "servers and zenoh are in a program of their own, {PROGRAM}, which is neither beside this one nor on the search path; expected \
             ./run, which builds it, or `cargo build --release --package rotortwin --package {PROGRAM}`"
        ));
    }
    output::failed(format!("{} cannot be started: {error}", program.display()))
}
