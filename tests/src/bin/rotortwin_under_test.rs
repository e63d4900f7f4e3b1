//! `rotortwin-network`, which knows all commands, as the system tests start it.

fn main() -> std::process::ExitCode {
    rotortwin_network::run()
}
