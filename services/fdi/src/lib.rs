//! The FDI process: takes sensors and motor commands, gives residuals and verdicts, over any link.
//!
//! It holds no vehicle and no scenario; everything it needs comes with the hand-shake. To run an FDI engine of your own instead, speak
//! the messages of `proto/rotortwin/v1` (or implement [`rotortwin_wire::link::FdiPeer`]) and start the run with
//! `rotortwin fly … --external fdi`. The same engine for flights that somebody else flies, over zenoh: `rotortwin_zenoh::fdi_topic`.

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

/// Serves one run; exit code 0 if it ended well, 1 if it failed, 2 if it could not be met.
pub fn run(args: Args) -> ExitCode {
    args.peer.serve_fdi("rotortwin-fdi", &mut FdiEnginePeer::default())
}
