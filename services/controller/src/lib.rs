//! The controller process: receives sensors and reference, sends motor commands, over any link.
//!
//! It knows neither vehicle nor scenario; all parameters come with the handshake. To fly your own controller instead, implement the
//! messages of `proto/rotortwin/v1` (or [`rotortwin_wire::link::ControllerPeer`]) and start the run with
//! `rotortwin fly … --external controller`.

use clap::Parser;
use rotortwin_process::PeerArgs;
use rotortwin_wire::peers::PidPeer;
use std::process::ExitCode;

/// The PID controller process of a run.
#[derive(Debug, Parser)]
#[command(name = "rotortwin-controller", version)]
pub struct Args {
    /// Which run, where, how long to wait.
    #[command(flatten)]
    pub peer: PeerArgs,
}

/// Serves one run; exit code 0 if it succeeded, 1 if it failed, 2 if it could not be joined.
pub fn run(args: Args) -> ExitCode {
    args.peer
        .serve_controller("rotortwin-controller", &mut PidPeer::default())
}
