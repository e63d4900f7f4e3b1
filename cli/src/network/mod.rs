//! Commands that need other hosts: their arguments, and the program that executes them.
//!
//! `rotortwin` flies, compares, diagnoses and evaluates on this machine. HTTP server and client, workers and zenoh would be four fifths of
//! its code, so they are in `rotortwin-network`, which also supports all commands of this program. This program replaces itself with
//! that one for such commands: docs/decisions/0062.

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

/// The program that supports them.
pub const PROGRAM: &str = "rotortwin-network";

/// Implementation of commands that only `rotortwin-network` supports.
pub type Perform = fn(&remote::ServerArgs, &Command) -> ExitCode;

/// Executes a command with code that is only in `rotortwin-network`: here, if this is that program.
pub(crate) fn perform(perform: Option<Perform>, server: &remote::ServerArgs, command: &Command) -> ExitCode {
    match perform {
        Some(perform) => perform(server, command),
        None => hand_over(),
    }
}

/// True for local commands that use zenoh or a WebSocket, which this program may not support.
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

/// Executes `rotortwin-network` with this command line: next to this program, or on the search path.
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
            "servers, zenoh and viewers are in a separate program, {PROGRAM}, which is neither in the folder of this program nor on the search path; expected \
             ./run, which builds it, or `cargo build --release --package rotortwin --package {PROGRAM}`"
        ));
    }
    output::failed(format!("{} cannot be started: {error}", program.display()))
}
