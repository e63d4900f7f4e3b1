//! The plant as a separate process: arguments, signals, events on standard output.

use crate::session::{self, SessionConfig};
use clap::Parser;
use rotortwin_flight::pace::Pace;
use rotortwin_links::endpoint::{Endpoint, EndpointLink};
use rotortwin_process::priority::{self, DEFAULT_PRIORITY, parse_priority};
use rotortwin_process::{
    AnyEndpoint, EXIT_BAD_INPUT, EXIT_FAILED, LinkAddress, Supervisor, complain, parse_run_id, pin_to_cpu,
    start_logging,
};
use rotortwin_proto::Role;
use rotortwin_scenario::{Documents, Scenario};
use rotortwin_store::run_folder::RunFolder;
use rotortwin_store::summary::{Status, Summary};
use rotortwin_wire::events::RunEvent;
use rotortwin_wire::link::LinkTiming;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

/// Program name in error messages.
const PROGRAM: &str = "rotortwin-sim";

/// The plant process of a run.
#[derive(Clone, Debug, Parser)]
#[command(name = "rotortwin-sim", version)]
pub struct Args {
    /// Scenario file
    pub scenario: PathBuf,
    /// Run folder to write; must not exist or be empty
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Link to the peers: iceoryx2, iceoryx2:DOMAIN, zenoh:listen=ENDPOINT or zenoh:connect=ENDPOINT,
    /// the latter two with ,config=FILE
    #[arg(long)]
    pub link: LinkAddress,
    /// Identity of this run
    #[arg(long, value_name = "HEX", value_parser = parse_run_id)]
    pub run_id: u64,
    /// Seed of all noise and random draws [default: the scenario's]
    #[arg(long)]
    pub seed: Option<u64>,
    /// fast or real-time
    #[arg(long, default_value = "fast", value_parser = parse_pace)]
    pub pace: Pace,
    /// Longest wait for both peers to join, ms
    #[arg(long, value_name = "MS", default_value_t = 10_000)]
    pub join_timeout: u64,
    /// Longest wait for the reply of a running peer, ms
    #[arg(long, value_name = "MS", default_value_t = 5_000)]
    pub step_timeout: u64,
    /// Steps that the FDI engine may trail behind
    #[arg(long, value_name = "STEPS", default_value_t = LinkTiming::default().fdi_window)]
    pub fdi_window: u64,
    /// Run on this CPU
    #[arg(long, value_name = "CPU")]
    pub cpu: Option<usize>,
    /// Real-time priority, 1 to 99, and all memory locked; with --pace real-time
    #[arg(long, value_name = "1-99", num_args = 0..=1, require_equals = true, default_missing_value = DEFAULT_PRIORITY, value_parser = parse_priority)]
    pub priority: Option<u8>,
    /// Effective configuration instead of the scenario file: the text from a run's summary
    #[arg(long, value_name = "FILE")]
    pub documents: Option<PathBuf>,
    /// Report samples of the telemetry as events, at this rate in Hz of simulated time
    #[arg(long, value_name = "HZ", value_parser = parse_rate)]
    pub live: Option<f64>,
    /// Read requests from standard input; its end means that the supervisor has died
    #[arg(long, hide = true)]
    pub supervised: bool,
}

fn parse_pace(text: &str) -> Result<Pace, String> {
    match text {
        "fast" => Ok(Pace::Fast),
        "real-time" => Ok(Pace::RealTime),
        _ => Err("expected fast or real-time".to_owned()),
    }
}

/// A sample rate, Hz: more than 0, at most one per step.
///
/// # Errors
/// States what was expected.
pub fn parse_rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(rate) if rate > 0.0 && rate <= 400.0 => Ok(rate),
        _ => Err("expected a number of Hz above 0, at most 400".to_owned()),
    }
}

/// Flies one scenario; exit code 0 if the flight was completed, 1 if it failed, 2 for bad input.
pub fn run(args: Args) -> ExitCode {
    start_logging();
    let (scenario, seed) = match checked_scenario(&args) {
        Ok(pair) => pair,
        Err(sentence) => return complain(PROGRAM, sentence, EXIT_BAD_INPUT),
    };
    // The supervisor has created the folder, which contains its logs.
    let folder = match if args.supervised {
        RunFolder::open(&args.out)
    } else {
        RunFolder::create(&args.out)
    } {
        Ok(folder) => folder,
        Err(error) => return complain(PROGRAM, error, EXIT_BAD_INPUT),
    };
    match fly(&args, &scenario, seed, &folder) {
        Ok(summary) if summary.status == Status::Done => ExitCode::SUCCESS,
        Ok(summary) => match summary.failure {
            Some(failure) => complain(PROGRAM, failure.sentence, EXIT_FAILED),
            None => complain(PROGRAM, "the run was canceled", EXIT_FAILED),
        },
        Err(sentence) => complain(PROGRAM, sentence, EXIT_FAILED),
    }
}

fn checked_scenario(args: &Args) -> Result<(Scenario, u64), String> {
    args.cpu.map_or(Ok(()), pin_to_cpu)?;
    if let Some(priority) = args.priority {
        if args.pace != Pace::RealTime {
            return Err(priority::NEEDS_PACE.to_owned());
        }
        // Before the link and the recorder start threads, which inherit it.
        priority::take(priority).map_err(|error| error.to_string())?;
    }
    // The supervisor has already probed it.
    if !args.supervised {
        args.link.probe().map_err(|sentence| format!("--link: {sentence}"))?;
    }
    let scenario = match &args.documents {
        None => Scenario::load(&args.scenario),
        Some(path) => std::fs::read_to_string(path)
            .map_err(|error| format!("{}: expected a readable file: {error}", path.display()))
            .map(|text| Documents::from_toml(&path.display().to_string(), &text))?
            .and_then(|documents| Scenario::from_documents(&documents)),
    }
    .map_err(|error| error.to_string())?;
    let seed = args.seed.unwrap_or_else(|| scenario.seed());
    scenario.simulation(seed).map_err(|error| error.to_string())?;
    Ok((scenario, seed))
}

fn fly(args: &Args, scenario: &Scenario, seed: u64, folder: &RunFolder) -> Result<Summary, String> {
    let supervisor =
        Supervisor::watch(args.supervised).map_err(|error| format!("requests to stop cannot be received: {error}"))?;
    let config = SessionConfig {
        scenario_path: args.scenario.clone(),
        seed,
        link_name: args.link.transport().to_owned(),
        pace: args.pace,
        run_id: args.run_id,
        priority: args.priority,
        live_hz: args.live,
    };
    let timing = LinkTiming {
        join: Duration::from_millis(args.join_timeout),
        step: Duration::from_millis(args.step_timeout),
        fdi_window: args.fdi_window,
        // At 400 Hz of wall clock there is time to answer each step, and viewers want live results.
        fdi_batch: if args.pace == Pace::RealTime {
            1
        } else {
            LinkTiming::default().fdi_batch
        },
    };
    match AnyEndpoint::open(&args.link, Role::Plant, args.run_id, timing.join) {
        Ok(AnyEndpoint::Iox2(endpoint)) => fly_over(*endpoint, timing, scenario, &config, folder, &supervisor),
        Ok(AnyEndpoint::Zenoh(endpoint)) => fly_over(endpoint, timing, scenario, &config, folder, &supervisor),
        Err(error) => session::never_opened(scenario, &config, folder, &error).map_err(|error| error.to_string()),
    }
}

fn fly_over(
    endpoint: impl Endpoint,
    timing: LinkTiming,
    scenario: &Scenario,
    config: &SessionConfig,
    folder: &RunFolder,
    supervisor: &Supervisor,
) -> Result<Summary, String> {
    let mut link = EndpointLink::new(endpoint, timing).with_stop(supervisor.stop_flag());
    let mut stop = || session::stop_reason(supervisor);
    session::fly(scenario, config, &mut link, folder, &mut print_event, &mut stop).map_err(|error| error.to_string())
}

/// One line of JSON on standard output. A missing reader is not a reason to end the run: its death is noticed
/// elsewhere.
fn print_event(event: RunEvent) {
    let Ok(line) = serde_json::to_string(&event) else {
        return;
    };
    let mut out = std::io::stdout().lock();
    if let Err(error) = writeln!(out, "{line}").and_then(|()| out.flush()) {
        tracing::debug!(%error, "no process reads the events");
    }
}
