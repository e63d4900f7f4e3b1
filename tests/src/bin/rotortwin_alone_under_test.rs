//! `rotortwin`, which delegates everything that needs other hosts to `rotortwin-network`.

fn main() -> std::process::ExitCode {
    rotortwin_cli::run(None)
}
