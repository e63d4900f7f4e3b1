//! `rotortwin`, as the system tests start it.

fn main() -> std::process::ExitCode {
    rotortwin_cli::run()
}
