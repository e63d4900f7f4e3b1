//! `rotortwin-fdi`: the FDI process.

use clap::Parser as _;

fn main() -> std::process::ExitCode {
    rotortwin_fdi::run(rotortwin_fdi::Args::parse())
}
