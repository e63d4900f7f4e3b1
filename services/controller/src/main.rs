//! `rotortwin-controller`: the PID controller process.

use clap::Parser as _;

fn main() -> std::process::ExitCode {
    rotortwin_controller::run(rotortwin_controller::Args::parse())
}
