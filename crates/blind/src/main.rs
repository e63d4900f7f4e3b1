//! `rotortwin-blind`: the generator as a program of its own.

use clap::Parser;

fn main() -> std::process::ExitCode {
    rotortwin_blind::command::run(&rotortwin_blind::command::Cli::parse().command)
}
