//! `rotortwin`: see the library of this package.

fn main() -> std::process::ExitCode {
    rotortwin_cli::run(None)
}
