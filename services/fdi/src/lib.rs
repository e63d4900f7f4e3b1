//! The FDI process: receives sensors and motor commands, sends residuals and verdicts, over any link.
//!
//! It knows neither vehicle nor scenario; all parameters come with the handshake. To run your own FDI engine instead, implement the
//! messages of `proto/rotortwin/v1` (or [`rotortwin_wire::link::FdiPeer`]) and start the run with
//! `rotortwin fly … --external fdi`. The same engine for flights flown elsewhere, over zenoh: `rotortwin_zenoh::fdi_topic`.

use clap::Parser;
use rotortwin_process::PeerArgs;
use rotortwin_wire::peers::FdiEnginePeer;
use std::process::ExitCode;

/// The FDI process of a run.
#[derive(Debug, Parser)]
#[command(name = "rotortwin-fdi", version)]
pub struct Args {
    /// Which run, where, how long to wait.
    #[command(flatten)]
    pub peer: PeerArgs,
}

/// Serves one run; exit code 0 if it succeeded, 1 if it failed, 2 if it could not be joined.
pub fn run(args: Args) -> ExitCode {
    args.peer.serve_fdi("rotortwin-fdi", &mut FdiEnginePeer::default())
}
