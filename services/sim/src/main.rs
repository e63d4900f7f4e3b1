//! `rotortwin-sim`: the plant process.

use clap::Parser as _;

fn main() -> std::process::ExitCode {
    rotortwin_sim::process::run(rotortwin_sim::process::Args::parse())
}
