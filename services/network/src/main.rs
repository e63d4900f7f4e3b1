//! `rotortwin-network`: see the library of this package.

fn main() -> std::process::ExitCode {
    rotortwin_network::run()
}
