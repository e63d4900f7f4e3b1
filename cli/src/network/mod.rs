//! Commands that need other hosts: what they are asked for, and the program that does them.
//!
//! `rotortwin` flies, compares, diagnoses and judges on this machine. HTTP server and client, workers and zenoh are four fifths of all that
//! would be compiled with it, so they are in `rotortwin-network`, which knows all commands of this one as well. Whoever asks this program for
//! one of them is answered by that one, in its place: docs/decisions/0062.

pub mod autopilot;
pub mod health;
pub mod part;
pub mod remote;
pub mod router;
pub mod serve;
pub mod token;

use crate::{Command, fly, output};
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::ExitCode;

/// The program that can do them.
pub const PROGRAM: &str = "rotortwin-network";

/// What `rotortwin-network` does with a command that only it can do.
pub type Perform = fn(&remote::ServerArgs, &Command) -> ExitCode;

/// Does a command by code that is in `rotortwin-network` only: here, if this is that program.
pub(crate) fn perform(perform: Option<Perform>, server: &remote::ServerArgs, command: &Command) -> ExitCode {
    match perform {
        Some(perform) => perform(server, command),
        None => hand_over(),
    }
}

/// True for what is done here, but over zenoh or a WebSocket, of which this program may know nothing.
pub(crate) fn is_over_network(command: &Command) -> bool {
    match command {
        Command::Fly(args) => args.link == fly::LinkKind::Zenoh || args.foxglove.is_some(),
        Command::Conform(args) => args.is_over_zenoh(),
        Command::Job(args) => args.is_over_zenoh(),
        Command::Sim(args) => args.link.transport() == "zenoh",
        Command::Controller(args) => args.peer.link.transport() == "zenoh",
        Command::Fdi(args) => args.peer.link.transport() == "zenoh",
        _ => false,
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
            "servers, zenoh and viewers are in a program of their own, {PROGRAM}, which is neither beside this one nor on the search path; expected \
             ./run, which builds it, or `cargo build --release --package rotortwin --package {PROGRAM}`"
        ));
    }
    output::failed(format!("{} cannot be started: {error}", program.display()))
}
