//! `rotortwin conform`: simulates the plant for a third-party controller, and identifies its errors.

use crate::output;
use crate::trial::Trial;
use clap::Parser;
use rotortwin_bridge::address::BoardAddress;
use rotortwin_bridge::autopilot::address::{AutopilotAddress, Protocol};
use rotortwin_bridge::autopilot::plant_check;
use rotortwin_bridge::session::{BoardLink, SessionOptions};
use rotortwin_flight::conform::{Demands, Report, conform};
use rotortwin_jobs::SeatRole;
use rotortwin_links::endpoint::EndpointLink;
use rotortwin_links::host_name;
use rotortwin_process::{AnyEndpoint, LinkAddress, PeerArgs};
use rotortwin_proto::Role;
use rotortwin_runner::flight::{free_port, invitation, new_run_id};
use rotortwin_scenario::Scenario;
use rotortwin_scenario::autopilot_frame::{AutopilotFrame, AutopilotKind};
use rotortwin_wire::link::LinkTiming;
use rotortwin_wire::peers::FdiEnginePeer;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

/// Settings that make any scenario suitable for probing a controller: a hover, long enough, without events.
const HOVER: [&str; 4] = [
    "duration_s=60",
    "trajectory={kind=\"hover\", position_ned_m=[0.0, 0.0, -5.0], yaw_rad=0.0}",
    "initial.start=\"trimmed\"",
    "fault=[]",
];
/// Links for a controller that joins by itself.
const LINKS: &str = "iceoryx2[:DOMAIN], zenoh[:listen=ENDPOINT|:connect=ENDPOINT]";
/// A board is either connected or not; it does not have to be started first.
const LONGEST_BOARD_JOIN: Duration = Duration::from_secs(10);
/// A step of the wall clock.
const STEP_MS: f64 = 2.5;

/// Arguments of `rotortwin conform`.
#[derive(Debug, Parser)]
pub struct Args {
    /// The controller: iceoryx2[:DOMAIN], zenoh[:listen=tcp/IP:PORT|:connect=ENDPOINT] for one that joins by itself; serial:PORT[@BAUD],
    /// pty, qemu, virtual[:KEY=NUMBER,...] for a board. The reverse: plant:ardupilot[:ADDR] plays ArduPilot to a plant that listens there
    endpoint: Endpoint,
    /// Scenario whose vehicle is flown: a file, or a name that 'rotortwin list scenarios' shows
    #[arg(long, value_parser = crate::named::scenario(), default_value = "short-hover")]
    scenario: PathBuf,
    #[command(flatten)]
    trial: Trial,
    /// The median response time must not exceed this, ms of wall clock; 0: no limit [default: 2.5; emulated and virtual boards: 0]
    #[arg(long, value_name = "MS", value_parser = milliseconds)]
    answer_within: Option<f64>,
    /// Print the report as JSON, nothing else
    #[arg(long)]
    json: bool,
}

fn milliseconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(time) if (0.0..=60_000.0).contains(&time) => Ok(time),
        _ => Err("expected 0 to 60000 ms".to_owned()),
    }
}

impl Args {
    /// True if the controller is connected over zenoh.
    pub(crate) fn is_over_zenoh(&self) -> bool {
        match &self.endpoint {
            Endpoint::Link(Some(address)) => address.transport() == "zenoh",
            Endpoint::Link(None) => true,
            Endpoint::Board(_) | Endpoint::Plant(_) => false,
        }
    }
}

/// Location of the controller.
#[derive(Clone, Debug)]
enum Endpoint {
    /// It joins by itself; `None`: over zenoh, at a free port.
    Link(Option<LinkAddress>),
    Board(BoardAddress),
    /// A plant behind ArduPilot's JSON backend.
    Plant(AutopilotAddress),
}

impl std::str::FromStr for Endpoint {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "zenoh" {
            return Ok(Self::Link(None));
        }
        if text.starts_with("zenoh") || text.starts_with("iceoryx2") {
            return text
                .parse()
                .map(|address| Self::Link(Some(address)))
                .map_err(|error: rotortwin_process::LinkAddressError| error.to_string());
        }
        if let Some(plant) = text.strip_prefix("plant:") {
            let address: AutopilotAddress = plant.parse()?;
            return match address.protocol {
                Protocol::ArduPilot if address.rc.pulses_us().is_empty() => Ok(Self::Plant(address)),
                Protocol::ArduPilot => Err(format!(
                    "'{text}': expected no @rc: a plant sends the channels of a transmitter, it does not get them"
                )),
                _ => Err(format!(
                    "'{text}': expected plant:ardupilot[:ADDR]; the links of the other autopilots are not supported yet"
                )),
            };
        }
        if let Ok(autopilot) = text.parse::<AutopilotAddress>() {
            return Err(format!(
                "{autopilot} cannot be probed in a hover that is held still; see 'rotortwin spin-test' for order and spin of its motors"
            ));
        }
        text.parse()
            .map(Self::Board)
            .map_err(|sentence: String| format!("{sentence}, {LINKS}, or plant:ardupilot[:ADDR]"))
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    if let Endpoint::Plant(address) = &args.endpoint {
        return examine_plant(args, address);
    }
    let scenario = match Scenario::load_with(&args.scenario, &HOVER) {
        Ok(scenario) => scenario,
        Err(error) => return output::bad_input(error),
    };
    let examined = match &args.endpoint {
        Endpoint::Board(address) => match address.open() {
            Ok(line) => {
                let mut options = SessionOptions {
                    join: args.trial.join().min(LONGEST_BOARD_JOIN),
                    step: args.trial.step(),
                    ..SessionOptions::default()
                };
                options.board.fdi = false;
                let mut link = BoardLink::new(line, &address.to_string(), options);
                let real = matches!(address, BoardAddress::Serial { .. });
                let demands = demands(args, real);
                conform(&mut link, &scenario, args.trial.seed, new_run_id(), &demands)
            }
            Err(sentence) => return output::bad_input(sentence),
        },
        Endpoint::Plant(_) => Err("a plant is examined elsewhere".to_owned()),
        Endpoint::Link(address) => {
            let address = match address.clone().map_or_else(free_address, Ok) {
                Ok(address) => address,
                Err(sentence) => return output::failed(sentence),
            };
            if let Err(sentence) = address.probe() {
                return output::bad_input(sentence);
            }
            over_link(args, &scenario, &address)
        }
    };
    match examined {
        Ok(report) => {
            if args.json {
                output::line(&serde_json::to_string_pretty(&report).unwrap_or_default());
            } else {
                print!("{}", output::fitted(&text(&report)));
            }
            if report.conforms() {
                ExitCode::SUCCESS
            } else {
                ExitCode::from(rotortwin_process::EXIT_FAILED)
            }
        }
        Err(sentence) => output::failed(sentence),
    }
}

fn demands(args: &Args, real: bool) -> Demands {
    let limit_ms = args.answer_within.unwrap_or(if real { STEP_MS } else { 0.0 });
    Demands {
        answer: (limit_ms > 0.0).then(|| Duration::from_secs_f64(1e-3 * limit_ms)),
    }
}

fn free_address() -> Result<LinkAddress, String> {
    format!("zenoh:listen=tcp/127.0.0.1:{}", free_port()?)
        .parse()
        .map_err(|error: rotortwin_process::LinkAddressError| error.to_string())
}

/// A controller that joins by itself; the FDI engine of the run is ours, in a thread.
fn over_link(args: &Args, scenario: &Scenario, address: &LinkAddress) -> Result<Report, String> {
    let run_id = new_run_id();
    let timing = LinkTiming {
        join: args.trial.join(),
        step: args.trial.step(),
        ..LinkTiming::default()
    };
    let endpoint = AnyEndpoint::open(address, Role::Plant, run_id, timing.join).map_err(|error| error.to_string())?;
    let fdi = PeerArgs {
        link: address.for_peers("127.0.0.1"),
        run_id,
        join_timeout: args.trial.join_timeout,
        step_timeout: args.trial.step_timeout,
        cpu: None,
        priority: None,
        supervisor_pid: None,
    };
    // It ends when the run is finished.
    std::thread::spawn(move || fdi.serve_fdi("rotortwin-conform", &mut FdiEnginePeer::default()));
    eprintln!("Waiting for the controller to join:");
    let link = address.for_peers(&host_name()).to_string();
    eprintln!(
        "  {}",
        invitation(
            SeatRole::Controller,
            &link,
            run_id,
            args.trial.join_timeout,
            args.trial.step_timeout
        )
    );
    let demands = demands(args, true);
    match endpoint {
        AnyEndpoint::Iox2(endpoint) => conform(
            &mut EndpointLink::new(*endpoint, timing),
            scenario,
            args.trial.seed,
            run_id,
            &demands,
        ),
        AnyEndpoint::Zenoh(endpoint) => conform(
            &mut EndpointLink::new(endpoint, timing),
            scenario,
            args.trial.seed,
            run_id,
            &demands,
        ),
    }
}

/// Sends the outputs of ArduPilot's matching frame to a plant.
fn examine_plant(args: &Args, address: &AutopilotAddress) -> ExitCode {
    let scenario = match Scenario::load(&args.scenario) {
        Ok(scenario) => scenario,
        Err(error) => return output::bad_input(error),
    };
    let frame = match AutopilotFrame::of_vehicle(AutopilotKind::ArduPilot, scenario.vehicle()) {
        Ok((frame, _)) => frame,
        Err(sentence) => return output::bad_input(sentence),
    };
    let mut azimuths = vec![0.0; frame.motor.len()];
    for motor in &frame.motor {
        azimuths[motor.channel as usize - 1] = motor.azimuth_deg;
    }
    let seen = match plant_check::examine(address.address, &azimuths) {
        Ok(seen) => seen,
        Err(sentence) => return output::failed(sentence),
    };
    let wrong = seen.iter().filter(|observation| !observation.right).count();
    if args.json {
        let list: Vec<_> = seen
            .iter()
            .map(|o| serde_json::json!({ "key": o.key, "right": o.right, "sentence": o.sentence }))
            .collect();
        output::line(&serde_json::json!({ "frame": frame.name, "observations": list }).to_string());
    } else {
        for observation in &seen {
            let mark = if observation.right { "ok   " } else { "wrong" };
            print!(
                "{}",
                output::fitted(&format!("{mark}  {:<11} {}\n", observation.key, observation.sentence))
            );
        }
        println!("{}", if wrong == 0 { "Conforms" } else { "Does not conform" });
    }
    if wrong == 0 {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(rotortwin_process::EXIT_FAILED)
    }
}

/// Human-readable report.
fn text(report: &Report) -> String {
    let mut text = String::new();
    for check in &report.checks {
        let mark = if check.passed { "ok   " } else { "wrong" };
        text.push_str(&format!("{mark}  {:<28} {}\n", check.name, check.evidence));
    }
    let [median, most] = report.answer_ms;
    text.push_str(&format!(
        "{} steps; response time: median {median:.2} ms, 99th percentile {most:.2} ms\n",
        report.steps
    ));
    for finding in &report.findings {
        text.push_str(&format!(
            "\nFAULT  {} · {}: {}\n",
            finding.fault.name(),
            finding.field,
            finding.sentence
        ));
        text.push_str(&format!("       {}\n", finding.evidence));
        for other in &finding.others {
            text.push_str(&format!("       or: {other}\n"));
        }
    }
    text.push_str(&match report.findings.len() {
        0 => "\nConforms\n".to_owned(),
        1 => "\nDoes not conform: 1 fault\n".to_owned(),
        count => format!("\nDoes not conform: {count} faults\n"),
    });
    text
}
