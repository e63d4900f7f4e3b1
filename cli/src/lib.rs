//! `rotortwin`: fly scenarios, replay and show runs, from a terminal.
//!
//! Exit codes: 0 done, 1 the run failed, 2 bad input (nothing was written).

#![warn(clippy::print_stdout, clippy::print_stderr)]

// In this crate these four write through `terminal`: those of the standard library panic when the reader has closed the pipe.
/// Prints to standard output; a closed pipe is not an error.
#[macro_export]
macro_rules! print {
    ($($text:tt)*) => { $crate::terminal::print(format_args!($($text)*)) };
}
/// Prints a line to standard output; a closed pipe is not an error.
#[macro_export]
macro_rules! println {
    () => { $crate::terminal::print(format_args!("\n")) };
    ($($text:tt)*) => { $crate::terminal::print(format_args!("{}\n", format_args!($($text)*))) };
}
/// Prints to standard error; a closed pipe is not an error.
#[macro_export]
macro_rules! eprint {
    ($($text:tt)*) => { $crate::terminal::print_error(format_args!($($text)*)) };
}
/// Prints a line to standard error; a closed pipe is not an error.
#[macro_export]
macro_rules! eprintln {
    () => { $crate::terminal::print_error(format_args!("\n")) };
    ($($text:tt)*) => { $crate::terminal::print_error(format_args!("{}\n", format_args!($($text)*))) };
}

pub mod blind;
mod board;
pub mod campaign;
pub mod compare;
mod configuration;
mod conform;
mod controllers;
mod destinations;
pub mod diagnose;
mod effects;
mod examples;
mod export;
pub mod fdi_log;
mod fdi_models;
pub mod fdi_service;
mod features;
mod fit;
pub mod fleet;
pub mod fly;
pub mod foxglove;
mod ground_station;
pub mod improve;
mod job;
mod judge;
pub mod log;
mod log_example;
mod manual;
mod model;
mod named;
mod nearest;
pub mod network;
mod next_flight;
pub mod output;
mod progress;
mod query;
pub mod replay;
pub mod reproduce;
pub mod show;
mod spin_test;
pub mod terminal;
pub mod train;
mod trial;
mod vehicle;
mod vibration;

use clap::error::ErrorKind;
use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use std::ffi::OsString;
use std::process::ExitCode;

/// Co-simulation of multirotors with propeller fault detection and isolation.
#[derive(Debug, Parser)]
#[command(name = "rotortwin", bin_name = "rotortwin", version, propagate_version = true, max_term_width = 100, after_help = examples::FIRST)]
struct Cli {
    #[command(flatten)]
    server: network::remote::ServerArgs,
    /// Exit when standard input, held open by the parent process, is closed
    #[arg(long, hide = true)]
    end_with_stdin: bool,
    #[command(subcommand)]
    command: Command,
}

/// What is asked for.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Fly a scenario: plant, controller and FDI engine in lockstep; writes a run folder
    #[command(after_help = examples::FLY)]
    Fly(fly::Args),
    /// Fly a recorded run again, in this process, and compare the run hash
    #[command(after_help = examples::REPLAY)]
    Replay(replay::Args),
    /// Print the summary of a run folder
    #[command(after_help = examples::SHOW)]
    Show(show::Args),
    /// Add the verdicts of your own detector to a run: to its tables, plots and topics
    #[command(after_help = examples::JUDGE)]
    Judge(judge::Args),
    /// Write a whole run as one file: ULog, MCAP, Parquet, CSV
    #[command(after_help = examples::EXPORT)]
    Export(export::Args),
    /// Import flight logs, and show what they contain
    #[command(after_help = examples::LOG)]
    Log(log::Args),
    /// Run the detectors over a flight log: verdicts over time, severity, what the log lacks
    #[command(after_help = examples::FDI_LOG)]
    FdiLog(fdi_log::LogArgs),
    /// Thrust loss of each rotor over many flights of a vehicle, and which propeller to inspect
    #[command(after_help = examples::FLEET)]
    Fleet(fleet::Args),
    /// Vibration of a flight at the speed of each rotor, compared with healthy flights: finds chipped propellers
    #[command(after_help = examples::VIBRATION)]
    Vibration(vibration::Args),
    /// Run the detectors on measurements received over zenoh, and send verdicts back
    FdiService(fdi_service::ServiceArgs),
    /// Check a scenario and the files it names; prints every setting in effect
    #[command(after_help = examples::CHECK)]
    Check(show::CheckArgs),
    /// Reproduce the paper's tables and figures, with its numbers and ours
    #[command(after_help = examples::REPRODUCE)]
    Reproduce(reproduce::Args),
    /// Write the windows of a campaign's flights, with the truth, as a table to train on
    #[command(after_help = examples::FEATURES)]
    Features(features::Args),
    /// Compare models with flight logs: where, when and by how much they disagree
    #[command(after_help = examples::COMPARE)]
    Compare(compare::Args),
    /// Name the physical effect that a model lacks on flight logs, with evidence
    #[command(after_help = examples::DIAGNOSE)]
    Diagnose(diagnose::Args),
    /// Compare, diagnose, add what is missing, compare again, until the model agrees or the reason why it does not is known
    #[command(after_help = examples::IMPROVE)]
    Improve(improve::Args),
    /// Find the manoeuvre that would distinguish two effects, as a scenario, with its expected evidence
    #[command(after_help = examples::NEXT_FLIGHT)]
    NextFlight(next_flight::Args),
    /// The effects that a model may lack: list, equation, parameters; your own with --effects
    #[command(after_help = examples::EFFECTS)]
    Effects(effects::Args),
    /// Versions of a model as files: list, show, add, undo, branch, diff, export, import, log
    #[command(after_help = examples::MODEL)]
    Model(model::Args),
    /// Fly a campaign: many flights of grids and random draws, with statistics of the detectors
    #[command(after_help = examples::CAMPAIGN)]
    Campaign(campaign::Args),
    /// SQL over results: the Parquet files in folders or in an object store, as tables
    #[command(after_help = examples::QUERY)]
    Query(query::Args),
    /// Vehicle constants from bench measurements: thrust, battery, motor lag
    #[command(after_help = examples::FIT)]
    Fit(fit::Args),
    /// Your own vehicle: identify it from a flight log, mass and arm length; state how exact its file is
    #[command(after_help = examples::VEHICLE)]
    Vehicle(vehicle::Args),
    /// Blind bench of the diagnosis: logs with hidden effects from an independent simulator, and the score
    #[command(after_help = examples::BLIND)]
    Blind(Box<blind::Args>),
    /// Flight boards: list, info, doctor, measure (Table 11)
    #[command(after_help = examples::BOARD)]
    Board(board::Args),
    /// Simulate the plant for a third-party controller, and report errors: field, unit, sign, frame, motor order, spin, rate …
    #[command(after_help = examples::CONFORM)]
    Conform(conform::Args),
    /// Fly one scenario with several controllers, or take recorded flights, and compare them in one table
    #[command(after_help = examples::CONTROLLERS)]
    Controllers(controllers::Args),
    /// Put an autopilot's simulator build on a virtual test stand, swing it, and report which motors are swapped or reversed
    #[command(after_help = examples::SPIN_TEST)]
    SpinTest(spin_test::Args),
    /// Execute one job of any kind, described by a JSON file, as a worker does for a server
    #[command(after_help = examples::JOB)]
    Job(job::Args),
    /// A zenoh router that connects the processes of runs, with access control
    Router(network::router::Args),
    /// Serve jobs, runs and results over HTTP
    #[command(after_help = examples::SERVE)]
    Serve(network::serve::Args),
    /// Runs of a server: list, get, events, cancel, delete, fetch
    #[command(after_help = examples::RUNS)]
    Runs(network::remote::JobArgs),
    /// Campaigns of a server: the same as for runs
    Campaigns(network::remote::JobArgs),
    /// Blind benches of a server: the same as for runs
    BlindBenches(network::remote::JobArgs),
    /// Check that a server or router responds, or that a worker is alive: exit code 0 if so
    Health(network::health::Args),
    /// Manage access tokens: create, list, revoke
    Token(network::token::Args),
    /// Execute jobs for the servers that share a Postgres database, on this or another host
    Worker(network::serve::WorkerArgs),
    /// Execute a part of a campaign or blind bench that a server has passed to a Ray cluster; started by Ray
    Part(network::part::Args),
    /// Scenarios, vehicles, campaigns … that can be given by name instead of a file
    #[command(after_help = examples::LIST)]
    List(configuration::ListArgs),
    /// Create your own document as a copy of an existing one
    #[command(after_help = examples::NEW)]
    New(configuration::NewArgs),
    /// Folders in which documents are searched for by name, in order
    Config,
    /// Print the completion script of a shell
    #[command(after_help = examples::COMPLETIONS)]
    Completions(manual::CompletionsArgs),
    /// Print a manual page, or write all of them
    #[command(after_help = examples::MAN)]
    Man(manual::ManArgs),
    /// Train a classifier and write its file
    #[command(after_help = examples::TRAIN)]
    Train(Box<train::Args>),
    /// One process of a run, started by hand: the plant
    #[command(
        override_usage = "rotortwin sim [OPTIONS] --out <DIR> --link <LINK> --run-id <HEX>\n                     <SCENARIO>"
    )]
    Sim(rotortwin_sim::process::Args),
    /// One process of a run, started by hand (e.g. on another host): the PID controller
    Controller(rotortwin_controller::Args),
    /// One process of a run, started by hand (e.g. on another host): the FDI engine
    Fdi(rotortwin_fdi::Args),
}

/// All declarations, with the examples of every command.
fn command() -> clap::Command {
    examples::added_to(destinations::checked(Cli::command()))
}

/// * `words`: a whole command line, from the name of the program on
fn parsed(words: impl IntoIterator<Item = OsString>) -> Result<Cli, clap::Error> {
    let mut command = command();
    let matches = command.try_get_matches_from_mut(words)?;
    Cli::from_arg_matches(&matches).map_err(|error| error.format(&mut command))
}

/// Executes the command line of this process.
///
/// * `perform`: executes commands that need other hosts; `None` in a program that delegates them to `rotortwin-network`
pub fn run(perform: Option<network::Perform>) -> ExitCode {
    let code = run_command(perform);
    match terminal::failure() {
        Some(reason) => output::failed(format!("the standard output cannot be written: {reason}")),
        None => code,
    }
}

fn run_command(perform: Option<network::Perform>) -> ExitCode {
    let cli = match parsed(std::env::args_os()) {
        Ok(cli) => cli,
        Err(error) => return refuse(&error, std::env::args_os()),
    };
    if cli.end_with_stdin {
        fly::end_with_standard_input();
    }
    if cli.server.server.is_some() {
        return network::perform(perform, &cli.server, &cli.command);
    }
    if perform.is_none() && network::is_over_network(&cli.command) {
        return network::hand_over();
    }
    match cli.command {
        Command::Fly(args) => fly::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Show(args) => show::run(&args),
        Command::Judge(args) => judge::run(&args),
        Command::Features(args) => features::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Log(args) => log::run(&args),
        Command::FdiLog(args) => fdi_log::judge_logs(&args),
        Command::Fleet(args) => fleet::run(&args),
        Command::Vibration(args) => vibration::run(&args),
        Command::Check(args) => show::check(&args),
        Command::Reproduce(args) => reproduce::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Diagnose(args) => diagnose::run(&args),
        Command::Improve(args) => improve::run(&args),
        Command::NextFlight(args) => next_flight::run(&args),
        Command::Effects(args) => effects::run(&args),
        Command::Model(args) => model::run(&args),
        Command::Campaign(args) if args.is_in_a_store() => {
            network::perform(perform, &cli.server, &Command::Campaign(args))
        }
        Command::Campaign(args) => campaign::run(&args, None),
        Command::Query(args) => query::run(&args),
        Command::Fit(args) => fit::run(&args),
        Command::Vehicle(args) => vehicle::run(&args),
        Command::Blind(args) => blind::run(&args),
        Command::Board(args) => board::run(&args),
        Command::Conform(args) => conform::run(&args),
        Command::Controllers(args) => controllers::run(&args),
        Command::SpinTest(args) => spin_test::run(&args),
        Command::Job(args) => job::run(&args),
        Command::List(args) => configuration::list(&args),
        Command::New(args) => configuration::new(&args),
        Command::Config => configuration::config(),
        Command::Completions(args) => manual::completions(&args),
        Command::Man(args) => manual::man(&args),
        Command::Train(args) => train::run(&args),
        Command::Sim(args) => rotortwin_sim::process::run(args),
        Command::Controller(args) => rotortwin_controller::run(args),
        Command::Fdi(args) => rotortwin_fdi::run(args),
        command @ (Command::Serve(_)
        | Command::Worker(_)
        | Command::Part(_)
        | Command::Token(_)
        | Command::Router(_)
        | Command::Health(_)
        | Command::FdiService(_)
        | Command::Runs(_)
        | Command::Campaigns(_)
        | Command::BlindBenches(_)) => network::perform(perform, &cli.server, &command),
    }
}

/// Help and version go to standard output; a wrong argument is bad input with a one-sentence message like any other, and the relevant help.
fn refuse(error: &clap::Error, words: impl Iterator<Item = OsString>) -> ExitCode {
    let text = error.render().to_string();
    if !error.use_stderr() {
        print!("{text}");
        return ExitCode::SUCCESS;
    }
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return output::bad_input(format!("expected a command; see below\n\n{text}"));
    }
    let (root, words): (_, Vec<OsString>) = (command(), words.skip(1).collect());
    let names_one = words.iter().any(|word| root.find_subcommand(word).is_some());
    let command = command_of(&root, words.into_iter());
    let misplaced = command == "rotortwin" && names_one && error.kind() == ErrorKind::UnknownArgument;
    let lines = text
        .lines()
        .map(str::trim)
        .take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"))
        // An option of a command is like none of those before it.
        .filter(|line| !(misplaced && line.starts_with("tip:")));
    let sentence = lines
        // No command takes words that look like options: after `--` it would refuse them, too.
        .filter(|line| !line.is_empty() && !line.contains("as a value, use '--"))
        .fold(String::new(), |sentence, line| {
            let separator = if sentence.is_empty() || sentence.ends_with(':') {
                " "
            } else {
                "; "
            };
            // `[possible values: …]`, but not `… [--json]`.
            let inner = line.strip_prefix('[').and_then(|line| line.strip_suffix(']'));
            sentence + separator + inner.unwrap_or(line)
        });
    let sentence = sentence.trim().trim_start_matches("error: ").to_owned();
    let tip = if misplaced {
        "; put the options of a command after its name"
    } else {
        ""
    };
    output::bad_input(format!("{sentence}{tip}; see '{command} --help'"))
}

/// The command of a command line, such as `rotortwin model add`: as far as its words name commands. A clap error states
/// it only if an argument is missing or unknown, not if its value is invalid.
///
/// * `words`: without the name of the program
fn command_of(root: &clap::Command, words: impl Iterator<Item = OsString>) -> String {
    let mut root = root.clone();
    root.build();
    let mut command = &root;
    let mut path = root.get_name().to_owned();
    let mut words = words.filter_map(|word| word.into_string().ok());
    while let Some(word) = words.next() {
        if let Some(option) = word.strip_prefix("--") {
            let (name, value) = option
                .split_once('=')
                .map_or((option, None), |(name, value)| (name, Some(value)));
            let known = command.get_arguments().find(|argument| {
                let aliases = argument.get_all_aliases().unwrap_or_default();
                argument.get_long() == Some(name) || aliases.contains(&name)
            });
            let Some(known) = known else { break };
            if value.is_none() && known.get_action().takes_values() {
                words.next();
            }
        } else if let Some(below) = command.find_subcommand(&word) {
            command = below;
            path = format!("{path} {}", below.get_name());
        } else {
            break;
        }
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_words_of_a_command_line_name_its_command() {
        let of = |line: &str| command_of(&command(), line.split_whitespace().map(OsString::from));
        assert_eq!(of(""), "rotortwin");
        assert_eq!(of("flew"), "rotortwin");
        assert_eq!(of("fly hoover"), "rotortwin fly");
        assert_eq!(of("model add f550 undo"), "rotortwin model add");
        assert_eq!(of("model --models list show f550"), "rotortwin model show");
        assert_eq!(of("model --models=list show f550"), "rotortwin model show");
        assert_eq!(of("--server runs fleet add"), "rotortwin fleet add");
        assert_eq!(of("blind --preset generate"), "rotortwin blind");
        // Unknown to the program: the words after it do not tell what it belongs to.
        assert_eq!(of("--seed fly hover"), "rotortwin");
        assert_eq!(of("--seed 3 fly hover"), "rotortwin");
    }
}
