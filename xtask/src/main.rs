//! Repository tasks: `cargo xtask <task>`. Needs nothing outside the workspace.

use anyhow::{Context as _, Result, bail};
use std::path::{Path, PathBuf};

mod bench;
mod branches;
mod check;
mod codegen;
mod command;
mod dist;
mod elf;
mod figures;
mod firmware;
mod lines;
mod links;
mod peers;
mod px4;
mod rooms;
mod stack;
mod telemetry_bench;
mod thumb;
mod web;

const USAGE: &str = "usage: cargo xtask TASK

  check             what the gate asks of the tree: format, generated code, circles among modules, house rules, dead links,
                    repeated figures, web page, lints, no_std build
                    (--lint-while-compiling: without lints, which run while the tests are compiled)
  codegen [--check] Rust code from proto/ (--check: only say whether it is up to date)
  rooms [--check]   which crate and module uses which: the picture in ARCHITECTURE.md; fails on a circle that is not in xtask/circles.txt
                    (--check: only say whether the picture is up to date)
  figures           whether figures that one page repeats from another are still the same there
  lines [COMMIT]    lines of Rust by crate, tests apart; with COMMIT: before and after
  thumb             build flight-core and board for the Pixhawk's Cortex-M7 (thumbv7em-none-eabihf)
  web [--check]     the web page: types from the OpenAPI document, check, bundle into web/dist by a locked npm ci
                    (--check: unit tests, and whether web/dist is up to date)
  firmware [--keep] build the programs of the boards, print and check their sizes, search their steps for panics
                    (--keep: remember the sizes in firmware/sizes.txt)
  dist [--small]    what people install who do not build, in target/packages: archive, Debian package, Python wheel,
                    container image, list of parts; from what is built
                    (--small: a program a quarter smaller and as fast, which takes a build of its own)
  seeds [SCENARIO]  the evaluators over 100 seeds of a scenario: delays, false alarms, correct windows
  detector WHAT [SCENARIO] [key=value …]
                    the sequential detector: protocol, healthy, smallest, pairs, coverage, early (crates/campaign/examples/detector_study.rs)
  bench [--quick]   speed: closed loop in one process, lockstep through three processes, against the bare link and a futex, the placement that a
                    flight chooses against others, a campaign on one core and on two
  bench --side-by-side
                    flights side by side against one after another
  bench --telemetry answers of the server to queries for telemetry
  bench --peers [ENVIRONMENTS]
                    crazyflow, RotorPy and gym-pybullet-drones beside ours, each in a throw-away Python environment (or in
                    ENVIRONMENTS/PACKAGE, made before)";

fn main() -> std::process::ExitCode {
    match run_task() {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("xtask: {error:#}");
            std::process::ExitCode::FAILURE
        }
    }
}

fn run_task() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let root = root()?;
    match args.as_slice() {
        ["check"] => check::run(&root, check::Lints::Now),
        ["check", "--lint-while-compiling"] => check::run(&root, check::Lints::WhileCompiling),
        ["codegen"] => codegen::write(&root),
        ["codegen", "--check"] => codegen::check(&root),
        ["rooms"] => rooms::write(&root),
        ["rooms", "--check"] => rooms::check(&root),
        ["figures"] => figures::check(&root),
        ["lines"] => lines::run(&root, None),
        ["lines", commit] => lines::run(&root, Some(commit)),
        ["firmware"] => firmware::run(&root, false),
        ["firmware", "--keep"] => firmware::run(&root, true),
        ["web"] => web::write(&root),
        ["web", "--check"] => web::check(&root),
        ["dist"] => dist::run(&root, dist::Build::Ordinary),
        ["dist", "--small"] => dist::run(&root, dist::Build::Small),
        ["thumb"] => thumb::run(&root),
        ["seeds"] => seeds(&root, "config/scenarios/reference-flight.toml"),
        ["seeds", scenario] => seeds(&root, scenario),
        ["detector", what, settings @ ..] => example(&root, "detector_study", [&[*what], settings].concat().as_slice()),
        ["bench"] => bench::run(&root, false),
        ["bench", "--quick"] => bench::run(&root, true),
        ["bench", "--side-by-side"] => bench::side_by_side_only(&root),
        ["bench", "--telemetry"] => telemetry_bench::run(&root),
        ["bench", "--peers"] => peers::run(&root, None, 5.0),
        ["bench", "--peers", environments] => peers::run(&root, Some(Path::new(environments)), 5.0),
        _ => bail!("{USAGE}"),
    }
}

/// The root of the tree that the task is run in: this program may have been built in another one.
fn root() -> Result<PathBuf> {
    let here = std::env::current_dir().context("the current directory")?;
    let root = here
        .ancestors()
        .find(|folder| folder.join("xtask/Cargo.toml").is_file());
    root.map(Path::to_path_buf)
        .with_context(|| format!("{}: expected a folder in a checkout of rotortwin", here.display()))
}

/// Flies a scenario with seeds 1 to 100 and prints the evaluators' results.
fn seeds(root: &Path, scenario: &str) -> Result<()> {
    example(root, "seed_study", &[scenario, "100"])
}

/// Builds and runs an example.
fn example(root: &Path, name: &str, settings: &[&str]) -> Result<()> {
    command::build(root, &["--example", name])?;
    let mut command = std::process::Command::new(root.join("target/release/examples").join(name));
    command::run(name, command.current_dir(root).args(settings))
}
