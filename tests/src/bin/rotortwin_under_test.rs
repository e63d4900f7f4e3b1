//! `rotortwin-network`, which supports all commands, as started by the system tests.

fn main() -> std::process::ExitCode {
    rotortwin_network::run()
}
