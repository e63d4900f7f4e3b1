//! `rotortwin fly`: one flight, in this process or in three.

use crate::destination::{self, ResultFolder};
use crate::ground_station::GroundStation;
use crate::output;
use clap::{Parser, ValueEnum};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use rotortwin_bridge::address::{AnyLine, BoardAddress};
use rotortwin_bridge::autopilot::address::{ADDRESSES, AutopilotAddress, Protocol};
use rotortwin_bridge::autopilot::ardupilot::ArduPilot;
use rotortwin_bridge::autopilot::betaflight::Betaflight;
use rotortwin_bridge::autopilot::pilot::{self, Pilot, PilotAddress, Piloted};
use rotortwin_bridge::autopilot::px4::Px4;
use rotortwin_bridge::autopilot::{OutputMap, Patience};
use rotortwin_bridge::session::{BoardLink, SessionOptions, SessionReport};
use rotortwin_flight::pace::Pace;
use rotortwin_links::endpoint::PeerOptions;
use rotortwin_links::host_name;
use rotortwin_process::launch::{self, Part};
use rotortwin_process::priority::{self, DEFAULT_PRIORITY, parse_priority};
use rotortwin_process::{AnyEndpoint, LinkAddress, Placement, Supervisor};
use rotortwin_scenario::autopilot_frame::{AutopilotFrame, AutopilotKind};
use rotortwin_scenario::{ConfigError, Documents, Scenario};
use rotortwin_sim::session::{self, DeadPlant, SessionConfig};
use rotortwin_store::run_folder::RunFolder;
use rotortwin_store::summary::{Status, Summary, load_summary, verdict_text};
use rotortwin_twin::model::ModelStore;
use rotortwin_wire::autopilot::Autopilot;
use rotortwin_wire::events::{Change, Mishap, Progress, RunEvent};
use rotortwin_wire::link::LinkTiming;
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io::IsTerminal as _;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// In the run folder: scenario, vehicle, models and blades as flown, for the plant's process.
const DOCUMENTS_FILE: &str = "documents.toml";

/// How long parts that are started by hand are waited for where nothing is said.
const EXTERNAL_JOIN_TIMEOUT_MS: u64 = 600_000;

/// Arguments of `rotortwin fly`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Scenario: a file, or a name that 'rotortwin list scenarios' shows
    #[arg(value_parser = crate::named::scenario())]
    pub scenario: PathBuf,
    /// How plant, controller and FDI engine are connected
    #[arg(long, value_enum, default_value_t = LinkKind::Iceoryx2)]
    pub link: LinkKind,
    /// zenoh: the plant listens here, e.g. tcp/0.0.0.0:7447 [default: a free port of 127.0.0.1]
    #[arg(long, value_name = "ENDPOINT", conflicts_with = "connect")]
    pub listen: Option<String>,
    /// zenoh: all processes connect to this router instead, e.g. tcp/10.0.0.1:7447
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Option<String>,
    /// zenoh: file with certificates, user and password: docs/hosts.md [default for endpoints tls/…: $ROTORTWIN_ZENOH_CONFIG]
    #[arg(long, value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
    /// iceoryx2: runs in different domains do not see each other [default: default]
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
    /// As fast as possible, or 400 steps per second of wall clock
    #[arg(long, value_enum, default_value_t = PaceArg::Fast)]
    pub pace: PaceArg,
    /// Seed of all noise and random draws [default: the scenario's]
    #[arg(long, value_parser = whole_number(0..=u64::MAX))]
    pub seed: Option<u64>,
    /// Set a key of the scenario before it is checked, such as initial.state_of_charge=0.4; may be given several times
    #[arg(long, value_name = "KEY=VALUE", conflicts_with = "documents")]
    pub set: Vec<String>,
    /// Run folder to write; must not exist or be empty [default: runs/SCENARIO-SEED, with a number if that exists]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Do not start these processes: they join by themselves, with the command that is printed
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHO")]
    pub external: Vec<External>,
    /// Longest wait for both peers to join, ms [default: 10000, with --external 600000]
    #[arg(long, value_name = "MS", value_parser = whole_number(1..=3_600_000))]
    pub join_timeout: Option<u64>,
    /// Longest wait for the answer of a peer that is alive, ms
    #[arg(long, value_name = "MS", default_value_t = 5_000, value_parser = whole_number(1..=3_600_000))]
    pub step_timeout: u64,
    /// Steps that the FDI engine may trail behind the plant; 0: wait for each report
    #[arg(long, value_name = "STEPS", default_value_t = LinkTiming::default().fdi_window, value_parser = whole_number(0..=256))]
    pub fdi_window: u64,
    /// Run every process on this CPU [default: a free one while the pace is fast and all processes are started here]
    #[arg(long, value_name = "CPU", value_parser = cpu_number())]
    pub cpu: Option<usize>,
    /// Real-time priority (SCHED_FIFO) and locked memory for all processes of the flight, 1 to 99; with --pace real-time [default: none;
    /// without a number: 40]
    #[arg(long, value_name = "1-99", num_args = 0..=1, require_equals = true, default_missing_value = DEFAULT_PRIORITY, value_parser = parse_priority)]
    pub priority: Option<u8>,
    /// Fly the vehicle and effects of this model instead of the scenario's vehicle: MODEL, MODEL@v2 or a file
    #[arg(long, value_name = "MODEL")]
    pub model: Option<String>,
    /// The detectors believe in this model, as far as their parameters can hold it
    #[arg(long, value_name = "MODEL")]
    pub fdi_model: Option<String>,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    pub models: PathBuf,
    /// A flight board stands where controller and FDI engine stand: serial:/dev/ttyACM0[@BAUD], pty, qemu, qemu-uart,
    /// virtual[:KEY=NUMBER,...]. Or an autopilot's simulator build flies, which is waited for: ardupilot[:ADDR], px4[:ADDR],
    /// betaflight[:ADDR][@SPEED]
    #[arg(long, value_name = "BOARD|AUTOPILOT", conflicts_with_all = ["link", "listen", "connect", "zenoh_config", "domain", "external", "fdi_window"])]
    pub controller: Option<Foreign>,
    /// With --server: an autopilot that the server's operator has listed flies ('GET /api/v1/autopilots')
    #[arg(long, value_name = "NAME", conflicts_with_all = ["controller", "link", "pace"])]
    pub autopilot: Option<String>,
    /// With an autopilot: where it takes commands over MAVLink, tcp:IP:PORT or udp:IP:PORT; there it is armed, flown and landed. none:
    /// somebody else does that. Betaflight: none, or nothing: we hold its sticks [default: ardupilot tcp:127.0.0.1:5760, px4
    /// udp:127.0.0.1:14540]
    #[arg(long, value_name = "ADDR|none", requires = "controller")]
    pub pilot: Option<PilotChoice>,
    /// With --controller: where the FDI engine runs
    #[arg(long, value_enum, default_value_t = FdiPlace::Board, requires = "controller")]
    pub fdi: FdiPlace,
    /// With --controller: compare every bit of the board with the host, and say where they part first
    #[arg(long, requires = "controller")]
    pub compare: bool,
    /// Show the flight to a ground station that speaks MAVLink, such as udp:127.0.0.1:14550 for QGroundControl; verdicts come as texts. At
    /// the speed of the flight: see --pace
    #[arg(long, value_name = "udp:IP:PORT")]
    pub mavlink: Option<crate::ground_station::Address>,
    /// Print the summary as JSON, nothing else
    #[arg(long)]
    pub json: bool,
    /// SCENARIO holds all documents of a run, as its summary does
    #[arg(long, conflicts_with_all = ["model", "fdi_model"])]
    pub documents: bool,
    /// Print each event of the run as a JSON line, nothing else; end when the standard input does
    #[arg(long, conflicts_with = "json")]
    pub events: bool,
    /// With --events: also samples of the telemetry, so many a second of simulated time, at most 100 a second of wall clock
    #[arg(long, value_name = "HZ", requires = "events", value_parser = rotortwin_sim::process::parse_rate)]
    pub live: Option<f64>,
}

impl Args {
    /// Samples a second that the plant is to tell.
    fn live_hz(&self) -> Option<f64> {
        let shown = self.mavlink.map(|_| crate::ground_station::RATE_HZ);
        self.live.or(shown)
    }

    /// The plant's process cannot read the scenario's file: it says less than what is flown.
    fn whole_documents(&self) -> bool {
        self.documents || !self.set.is_empty() || self.model.is_some() || self.fdi_model.is_some()
    }
}

/// What is not of ours and stands in the place of the controller.
#[derive(Clone, Debug, PartialEq)]
pub enum Foreign {
    /// A flight board.
    Board(BoardAddress),
    /// An autopilot of its own clock.
    Autopilot(AutopilotAddress),
}

impl std::str::FromStr for Foreign {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if Protocol::of_address(text).is_some() {
            return text.parse().map(Self::Autopilot);
        }
        text.parse()
            .map(Self::Board)
            .map_err(|sentence: String| format!("{sentence}, or an autopilot: {ADDRESSES}"))
    }
}

/// Who commands an autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PilotChoice {
    /// Somebody else.
    Nobody,
    /// We do, there.
    At(PilotAddress),
}

impl std::str::FromStr for PilotChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "none" => Ok(Self::Nobody),
            _ => text.parse().map(Self::At),
        }
    }
}

/// Where the FDI engine of a run with a board is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FdiPlace {
    /// On the board
    Board,
    /// In this process
    Host,
}

/// Takes a whole number of a range, and says which one it expected otherwise.
fn whole_number(range: RangeInclusive<u64>) -> impl Fn(&str) -> Result<u64, String> + Clone {
    move |text| match text.parse() {
        Ok(number) if range.contains(&number) => Ok(number),
        _ => Err(format!(
            "expected a whole number from {} to {}",
            range.start(),
            range.end()
        )),
    }
}

/// The number of a processor.
fn cpu_number() -> impl Fn(&str) -> Result<usize, String> + Clone {
    |text| usize::try_from(whole_number(0..=1023)(text)?).map_err(|error| error.to_string())
}

/// How the processes are connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LinkKind {
    /// Function calls in this process
    InProcess,
    /// Three processes, shared memory of this host
    Iceoryx2,
    /// Three processes, TCP
    Zenoh,
}

/// How fast.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PaceArg {
    /// As fast as possible
    Fast,
    /// 400 Hz of wall clock
    RealTime,
}

impl From<PaceArg> for Pace {
    fn from(pace: PaceArg) -> Self {
        match pace {
            PaceArg::Fast => Self::Fast,
            PaceArg::RealTime => Self::RealTime,
        }
    }
}

/// A process that somebody else starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum External {
    /// The controller
    Controller,
    /// The FDI engine
    Fdi,
}

impl External {
    fn name(self) -> &'static str {
        match self {
            Self::Controller => "controller",
            Self::Fdi => "fdi",
        }
    }
}

/// Runs the command.
pub fn run(args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    if args.autopilot.is_some() {
        return output::bad_input(
            "--autopilot names one of a server's: expected --server URL; here it is --controller ADDRESS",
        );
    }
    let scenario = match load(args) {
        Ok(scenario) => scenario,
        Err(error) => return output::bad_input(error),
    };
    let scenario = match with_models(scenario, args) {
        Ok(scenario) => scenario,
        Err(code) => return code,
    };
    let seed = args.seed.unwrap_or_else(|| scenario.seed());
    if let Err(error) = scenario.simulation(seed) {
        return output::bad_input(error);
    }
    // Before anything is written.
    let foreign = match args
        .controller
        .as_ref()
        .map(|foreign| open(args, foreign, &scenario, seed))
    {
        Some(Err(code)) => return code,
        Some(Ok(opened)) => Some(opened),
        None => None,
    };
    let (address, folder) =
        match settle(args).and_then(|address| Ok((address, run_folder(args, scenario.name(), seed)?))) {
            Ok(settled) => settled,
            Err(sentence) => return output::bad_input(sentence),
        };
    for warning in scenario.warnings() {
        eprintln!("{}: {warning}", args.scenario.display());
    }
    if args.events {
        end_with_standard_input();
    }
    let station = match args.mavlink.map(|at| GroundStation::new(at, &scenario)).transpose() {
        Ok(station) => station,
        Err(sentence) => return output::failed(sentence),
    };
    let screen = Screen::new(args.json, args.events)
        .with_samples(args.live.is_some())
        .with_station(station);
    let config = SessionConfig {
        scenario_path: args.scenario.clone(),
        seed,
        link_name: match &args.controller {
            Some(Foreign::Board(board)) => format!("board {board}"),
            Some(Foreign::Autopilot(autopilot)) => {
                let how = if autopilot.protocol.lockstep() {
                    "lockstep"
                } else {
                    "not lockstep"
                };
                format!("{}{autopilot}, {how}", session::AUTOPILOT_LINK)
            }
            None => link_name(args.link).to_owned(),
        },
        pace: args.pace.into(),
        run_id: new_run_id(),
        priority: args.priority,
        live_hz: args.live_hz(),
    };
    if let Some(priority) = args.priority
        && address.is_none()
        && let Err(error) = priority::take(priority)
    {
        return destination::failed_at(folder.path(), error.to_string());
    }
    let (mut board, mut placed) = (None, None);
    let result = match (address, foreign) {
        (_, Some(Opened::Board(address, line))) => {
            fly_board(args, (address, line), &scenario, &config, &folder, &screen).map(|(summary, report)| {
                board = Some((report, address));
                summary
            })
        }
        (_, Some(Opened::Autopilot(OpenedAutopilot::ArduPilot(mut link, supervisor)))) => {
            screen.line(&format!(
                "Waiting for servo packets of ArduPilot: {}",
                address_text(link.autopilot().local_address())
            ));
            fly_autopilot(&mut *link, &supervisor, &scenario, &config, &folder, &screen)
        }
        (_, Some(Opened::Autopilot(OpenedAutopilot::Px4(mut link, supervisor)))) => {
            screen.line(&format!(
                "Waiting for PX4 to connect: {}",
                address_text(link.autopilot().local_address())
            ));
            fly_autopilot(&mut *link, &supervisor, &scenario, &config, &folder, &screen)
        }
        (_, Some(Opened::Autopilot(OpenedAutopilot::Betaflight(mut link, supervisor)))) => {
            screen.line(&format!("Sending states to Betaflight: {}", link.states_to()));
            fly_autopilot(&mut *link, &supervisor, &scenario, &config, &folder, &screen)
        }
        (None, None) => fly_here(&scenario, &config, &folder, &screen),
        (Some(address), None) => {
            let mut placement = placement(args);
            let flown = fly_in_processes(args, &scenario, &config, &address, &folder, &mut placement, &screen);
            placed = Some(placement.sentence());
            flown
        }
    };
    screen.close();
    match result {
        Ok(summary) => {
            if args.json {
                print!("{}", summary.to_json());
            } else if !args.events {
                print!("{}", output::summary_text(&summary, Some(folder.path())));
                if let Some(placed) = placed {
                    print!("{}", output::fitted(&format!("Placement    {placed}\n")));
                }
            }
            if let Some((report, address)) = board {
                eprint!("{}", crate::board::session_text(&report, Some(address)));
                if let Some(difference) = &report.difference {
                    return output::failed(difference);
                }
            }
            output::exit_code(&summary)
        }
        Err(sentence) => destination::failed_at(folder.path(), sentence),
    }
}

/// The scenario that the arguments mean, with what they set.
pub fn load(args: &Args) -> Result<Scenario, ConfigError> {
    if !args.documents {
        let set: Vec<&str> = args.set.iter().map(String::as_str).collect();
        return Scenario::load_with(&args.scenario, &set);
    }
    let name = args.scenario.display().to_string();
    let text = std::fs::read_to_string(&args.scenario)
        .map_err(|error| ConfigError::new(&name, None, None, format!("cannot be read: {error}")))?;
    Scenario::from_documents(&Documents::from_toml(&name, &text)?)
}

/// Who started this holds our standard input open as long as it lives: its end is a wish to stop.
pub fn end_with_standard_input() {
    std::thread::spawn(|| {
        let ended = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        tracing::debug!(?ended, "the standard input has ended");
        if let Err(error) = signal_hook::low_level::raise(signal_hook::consts::SIGTERM) {
            tracing::error!(%error, "the run cannot be told to end");
        }
    });
}

/// The scenario with the models that were asked for: their vehicle and effects in the plant, their constants in the detectors.
pub fn with_models(scenario: Scenario, args: &Args) -> Result<Scenario, ExitCode> {
    let store = ModelStore::new(&args.models);
    let find = |text: &str| store.find(text).map_err(|error| crate::versions::store_failed(&error));
    let mut scenario = scenario;
    if let Some(text) = &args.model {
        let version = find(text)?.version;
        scenario = version
            .flown_in(&scenario)
            .map_err(|error| output::bad_input(format!("{} with model {text}: {error}", args.scenario.display())))?;
    }
    if let Some(text) = &args.fdi_model {
        let refuse = |refusal: rotortwin_plant::error::Refusal| {
            output::bad_input(format!(
                "model {text} for the detectors, key `{}`: {}",
                refusal.key, refusal.reason
            ))
        };
        let vehicle = find(text)?.version.for_detectors().map_err(refuse)?;
        if !vehicle.not_carried.is_empty() {
            eprintln!(
                "rotortwin: the detectors have no parameter for {}: not carried into their model",
                vehicle.not_carried.join(", ")
            );
        }
        scenario = scenario.with_fdi_vehicle(vehicle.documents).map_err(refuse)?;
    }
    Ok(scenario)
}

/// Tries everything that can be tried before something is written: the CPU, and where the processes are to meet.
fn settle(args: &Args) -> Result<Option<LinkAddress>, String> {
    if let Some(cpu) = args.cpu {
        // The processes that this one starts inherit it.
        rotortwin_process::pin_to_cpu(cpu)?;
    }
    if let Some(priority) = args.priority {
        if args.pace != PaceArg::RealTime {
            return Err(priority::NEEDS_PACE.to_owned());
        }
        priority::probe(priority).map_err(|error| error.to_string())?;
    }
    let option = if args.connect.is_some() {
        "--connect"
    } else {
        "--listen"
    };
    let address = address(args)?;
    if let Some(address) = &address {
        address.probe().map_err(|sentence| format!("{option}: {sentence}"))?;
    }
    Ok(address)
}

/// Makes the folder of the run, and makes sure that files can be written there.
pub fn run_folder(args: &Args, name: &str, seed: u64) -> Result<RunFolder, String> {
    let path = args.out.clone().map_or_else(|| next_free_folder(name, seed), Ok)?;
    ResultFolder::create(&path).map(ResultFolder::keep)
}

fn link_name(link: LinkKind) -> &'static str {
    match link {
        LinkKind::InProcess => "in-process",
        LinkKind::Iceoryx2 => "iceoryx2",
        LinkKind::Zenoh => "zenoh",
    }
}

/// Where the processes meet; `None`: there is only this one.
fn address(args: &Args) -> Result<Option<LinkAddress>, String> {
    if args.controller.is_some() {
        return Ok(None);
    }
    let endpoint_given = args.listen.is_some() || args.connect.is_some() || args.zenoh_config.is_some();
    if args.link != LinkKind::Zenoh && endpoint_given {
        return Err(format!(
            "--listen, --connect and --zenoh-config belong to --link zenoh, the link is {}",
            link_name(args.link)
        ));
    }
    if args.link == LinkKind::InProcess && !args.external.is_empty() {
        return Err("--external needs separate processes; expected --link iceoryx2 or --link zenoh".to_owned());
    }
    if args.link != LinkKind::Iceoryx2 && args.domain.is_some() {
        return Err(format!(
            "--domain belongs to --link iceoryx2, the link is {}",
            link_name(args.link)
        ));
    }
    let text = match (args.link, &args.listen, &args.connect) {
        (LinkKind::InProcess, ..) => return Ok(None),
        (LinkKind::Iceoryx2, ..) => args
            .domain
            .as_ref()
            .map_or_else(|| "iceoryx2".to_owned(), |name| format!("iceoryx2:{name}")),
        (LinkKind::Zenoh, Some(endpoint), _) => format!("zenoh:listen={endpoint}"),
        (LinkKind::Zenoh, None, Some(endpoint)) => format!("zenoh:connect={endpoint}"),
        (LinkKind::Zenoh, None, None) => {
            let protocol = match &args.zenoh_config {
                Some(file) if rotortwin_process::zenoh_config::load(file)?.tls.is_some() => "tls",
                _ => "tcp",
            };
            format!("zenoh:listen={protocol}/127.0.0.1:{}", free_port()?)
        }
    };
    text.parse()
        .map(|address: LinkAddress| match &args.zenoh_config {
            Some(file) => Some(address.with_config(file.clone())),
            None => Some(address),
        })
        .map_err(|error: rotortwin_process::LinkAddressError| {
            let option = if args.link == LinkKind::Iceoryx2 {
                "--domain"
            } else {
                "--listen or --connect"
            };
            format!("{option}: {error}")
        })
}

/// A TCP port of the loopback address that nobody listens on now.
pub fn free_port() -> Result<u16, String> {
    std::net::TcpListener::bind("127.0.0.1:0")
        .and_then(|listener| listener.local_addr())
        .map(|address| address.port())
        .map_err(|error| format!("no free TCP port on 127.0.0.1: {error}"))
}

/// `runs/NAME-SEED`, or the first of `runs/NAME-SEED-2`, `-3`, … that does not exist.
fn next_free_folder(name: &str, seed: u64) -> Result<PathBuf, String> {
    let base = Path::new("runs").join(format!("{name}-{seed}"));
    (1..10_000)
        .map(|number| {
            if number == 1 {
                base.clone()
            } else {
                base.with_file_name(format!("{name}-{seed}-{number}"))
            }
        })
        .find(|path| !path.exists())
        .ok_or_else(|| {
            format!(
                "{} and 9998 numbered ones exist; name a folder with --out",
                base.display()
            )
        })
}

/// A number that no other execution has; 0 is kept for "none".
pub fn new_run_id() -> u64 {
    rand::random::<u64>().max(1)
}

/// The whole flight in this process.
fn fly_here(
    scenario: &Scenario,
    config: &SessionConfig,
    folder: &RunFolder,
    screen: &Screen,
) -> Result<Summary, String> {
    let supervisor = Supervisor::watch(false).map_err(|error| format!("Ctrl-C cannot be handled: {error}"))?;
    let mut link = session::in_process_link();
    let mut stop = || session::stop_reason(&supervisor);
    session::fly(
        scenario,
        config,
        &mut link,
        folder,
        &mut |event| screen.show(&event),
        &mut stop,
    )
    .map_err(|error| error.to_string())
}

/// What stands in the place of the controller, opened.
enum Opened<'a> {
    Board(&'a BoardAddress, AnyLine),
    Autopilot(OpenedAutopilot),
}

/// An autopilot that is waited for, and what can stop the waiting.
pub(crate) enum OpenedAutopilot {
    ArduPilot(Box<Piloted<ArduPilot>>, Supervisor),
    Px4(Box<Piloted<Px4>>, Supervisor),
    Betaflight(Box<Betaflight>, Supervisor),
}

/// How long an autopilot is waited for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Waits {
    /// For its first message.
    pub(crate) join: Duration,
    /// For any later one.
    pub(crate) step: Duration,
}

/// Why an autopilot is not waited for; one sentence.
pub(crate) enum Refused {
    /// The scenario cannot be flown with it.
    Scenario(String),
    /// An argument is wrong.
    Argument(String),
    /// Its port is taken, or the like.
    Place(String),
}

impl Refused {
    /// Says it, of this scenario.
    pub(crate) fn told(self, scenario: &Path) -> ExitCode {
        match self {
            Self::Scenario(sentence) => output::bad_input(format!("{}: {sentence}", scenario.display())),
            Self::Argument(sentence) => output::bad_input(sentence),
            Self::Place(sentence) => output::failed(sentence),
        }
    }
}

/// Whose frames they are.
pub fn autopilot_kind(protocol: Protocol) -> AutopilotKind {
    match protocol {
        Protocol::ArduPilot => AutopilotKind::ArduPilot,
        Protocol::Px4 => AutopilotKind::Px4,
        Protocol::Betaflight => AutopilotKind::Betaflight,
    }
}

/// An address of this host.
fn address_text(address: Option<std::net::SocketAddr>) -> String {
    address.map_or_else(|| "an unknown address".to_owned(), |address| address.to_string())
}

/// Opens the line to a board, or the port where an autopilot is waited for.
fn open<'a>(args: &Args, foreign: &'a Foreign, scenario: &Scenario, seed: u64) -> Result<Opened<'a>, ExitCode> {
    let autopilot = match foreign {
        Foreign::Board(address) => {
            if args.pilot.is_some() {
                return Err(output::bad_input(format!(
                    "--pilot belongs to autopilots, the controller is the board {address}"
                )));
            }
            let line = address.open().map_err(output::bad_input)?;
            return Ok(Opened::Board(address, line));
        }
        Foreign::Autopilot(autopilot) => autopilot,
    };
    if args.compare || args.fdi != FdiPlace::Board || args.pace != PaceArg::Fast {
        let sentence = format!("--compare, --fdi and --pace belong to boards, the controller is {autopilot}");
        return Err(output::bad_input(sentence));
    }
    let waits = Waits {
        join: Duration::from_millis(args.join_timeout.unwrap_or(EXTERNAL_JOIN_TIMEOUT_MS)),
        step: Duration::from_millis(args.step_timeout),
    };
    open_autopilot(autopilot, args.pilot, waits, scenario, seed)
        .map(Opened::Autopilot)
        .map_err(|refused| refused.told(&args.scenario))
}

/// Opens the port where an autopilot is waited for that is to fly this scenario, and finds out who commands it.
pub(crate) fn open_autopilot(
    autopilot: &AutopilotAddress,
    pilot: Option<PilotChoice>,
    waits: Waits,
    scenario: &Scenario,
    seed: u64,
) -> Result<OpenedAutopilot, Refused> {
    let mut simulation = scenario
        .simulation(seed)
        .map_err(|error| Refused::Scenario(error.to_string()))?;
    simulation
        .begin_prelude()
        .map_err(|refusal| Refused::Scenario(format!("key `{}`: {}", refusal.key, refusal.reason)))?;
    let kind = autopilot_kind(autopilot.protocol);
    let (frame, rotor_of_channel) = AutopilotFrame::of_vehicle(kind, scenario.vehicle()).map_err(Refused::Scenario)?;
    let map = OutputMap {
        rotor_of_channel,
        pulse_min_us: frame.pulse.min_us,
        pulse_max_us: frame.pulse.max_us,
    };
    let supervisor =
        Supervisor::watch(false).map_err(|error| Refused::Place(format!("Ctrl-C cannot be handled: {error}")))?;
    let patience = Patience {
        join: waits.join,
        step: waits.step,
        stop: supervisor.stop_flag(),
    };
    let at = match pilot {
        Some(PilotChoice::Nobody) => None,
        Some(PilotChoice::At(at)) if autopilot.protocol == Protocol::Betaflight => {
            return Err(Refused::Argument(format!(
                "--pilot {at}: Betaflight takes no commands over MAVLink, its sticks are held here; expected none, or no --pilot"
            )));
        }
        Some(PilotChoice::At(at)) => Some(at),
        None => pilot::default_address(autopilot.protocol),
    };
    let commander = at
        .map(|at| Pilot::new(autopilot.protocol, at, pilot::MEET))
        .transpose()
        .map_err(Refused::Place)?;
    match autopilot.protocol {
        Protocol::ArduPilot => ArduPilot::listen(autopilot.address, map, patience)
            .map(|link| OpenedAutopilot::ArduPilot(Box::new(Piloted::new(link, commander)), supervisor)),
        Protocol::Px4 => Px4::listen(autopilot.address, map, patience)
            .map(|link| OpenedAutopilot::Px4(Box::new(Piloted::new(link, commander)), supervisor)),
        Protocol::Betaflight => {
            let piloted = pilot != Some(PilotChoice::Nobody);
            Betaflight::listen(autopilot, piloted, map, patience)
                .map(|link| OpenedAutopilot::Betaflight(Box::new(link), supervisor))
        }
    }
    .map_err(Refused::Place)
}

/// The flight in this process, with an autopilot of its own clock in the place of the controller.
fn fly_autopilot(
    autopilot: &mut impl Autopilot,
    supervisor: &Supervisor,
    scenario: &Scenario,
    config: &SessionConfig,
    folder: &RunFolder,
    screen: &Screen,
) -> Result<Summary, String> {
    let mut show = |event: RunEvent| screen.show(&event);
    let mut stop = || session::stop_reason(supervisor);
    session::fly_autopilot(scenario, config, autopilot, folder, &mut show, &mut stop).map_err(|error| error.to_string())
}

/// The flight in this process, with a board in the place of controller and FDI engine.
fn fly_board(
    args: &Args,
    (address, line): (&BoardAddress, AnyLine),
    scenario: &Scenario,
    config: &SessionConfig,
    folder: &RunFolder,
    screen: &Screen,
) -> Result<(Summary, SessionReport), String> {
    let supervisor = Supervisor::watch(false).map_err(|error| format!("Ctrl-C cannot be handled: {error}"))?;
    let mut options = SessionOptions {
        join: Duration::from_millis(args.join_timeout.unwrap_or(10_000)),
        step: Duration::from_millis(args.step_timeout),
        compare: args.compare,
        ..SessionOptions::default()
    };
    options.board.fdi = args.fdi == FdiPlace::Board;
    // A slow line carries the four numbers behind the residuals; the bits are the same.
    options.board.residuals = address.baud().is_none();
    let mut link = BoardLink::new(line, &address.to_string(), options);
    let mut stop = || session::stop_reason(&supervisor);
    let summary = session::fly(
        scenario,
        config,
        &mut link,
        folder,
        &mut |event| screen.show(&event),
        &mut stop,
    )
    .map_err(|error| error.to_string())?;
    Ok((summary, link.report()))
}

/// On which processors the processes of a flight run. In lockstep they wait for each other, and the rest of the machine is left to other
/// flights; at the pace of the wall clock they do not hold each other up where each finds a processor of its own.
fn placement(args: &Args) -> Placement {
    match args.cpu {
        Some(cpu) => Placement::given(cpu),
        None if args.pace == PaceArg::RealTime => Placement::kernel("real-time pace"),
        None if !args.external.is_empty() => Placement::kernel("not all processes are started here"),
        None => Placement::chosen(),
    }
}

/// The flight in three processes; this one watches.
fn fly_in_processes(
    args: &Args,
    scenario: &Scenario,
    config: &SessionConfig,
    address: &LinkAddress,
    folder: &RunFolder,
    placement: &mut Placement,
    screen: &Screen,
) -> Result<Summary, String> {
    if args.whole_documents() {
        // The plant's process reads the scenario by itself, and the file knows nothing of the models.
        let path = folder.path().join(DOCUMENTS_FILE);
        std::fs::write(&path, scenario.documents().to_toml())
            .map_err(|error| format!("{}: cannot be written: {error}", path.display()))?;
    }
    let external: BTreeSet<External> = args.external.iter().copied().collect();
    let parts = parts(args, config, address, folder, &external);
    if !external.is_empty() {
        invite(args, config, address, &external);
    }
    let start = std::time::Instant::now();
    let silence_limit = PeerOptions::new(
        "",
        &LinkTiming {
            step: Duration::from_millis(args.step_timeout),
            ..LinkTiming::default()
        },
    )
    .idle;
    let ending = launch::run(&parts, folder.path(), silence_limit, placement, |event| {
        screen.show(event)
    })
    .map_err(|error| format!("{error:#}"))?;
    let summary = match load_summary(folder.path()) {
        Ok(summary) => summary,
        // The plant could not write it: it died, or it stalled and was killed.
        Err(_) => {
            let dead = DeadPlant {
                how: ending.plant_text(),
                silence: ending.plant_silence,
                last_step: ending.last_step,
                wall: start.elapsed(),
            };
            session::finalise_dead_plant(scenario, config, folder, &dead).map_err(|error| error.to_string())?
        }
    };
    if summary.status != Status::Done {
        AnyEndpoint::tidy(address);
    }
    Ok(summary)
}

fn parts(
    args: &Args,
    config: &SessionConfig,
    address: &LinkAddress,
    folder: &RunFolder,
    external: &BTreeSet<External>,
) -> Vec<Part> {
    let join_timeout = args.join_timeout.unwrap_or(if external.is_empty() {
        10_000
    } else {
        EXTERNAL_JOIN_TIMEOUT_MS
    });
    let mut common = ArgList::default();
    common.option("--run-id", format!("{:016x}", config.run_id));
    common
        .option("--join-timeout", join_timeout.to_string())
        .option("--step-timeout", args.step_timeout.to_string());
    if let Some(priority) = args.priority {
        common.flag(format!("--priority={priority}"));
    }
    let mut sim = common.clone();
    sim.option("--link", address.to_string())
        .option("--seed", config.seed.to_string());
    sim.option("--fdi-window", args.fdi_window.to_string());
    sim.option(
        "--pace",
        if args.pace == PaceArg::Fast {
            "fast"
        } else {
            "real-time"
        },
    );
    if let Some(rate_hz) = args.live_hz() {
        sim.option("--live", rate_hz.to_string());
    }
    if args.whole_documents() {
        sim.option("--documents", folder.path().join(DOCUMENTS_FILE));
    }
    sim.option("--out", folder.path()).option("--", &args.scenario);
    let mut parts = vec![Part {
        name: "sim",
        args: sim.0,
    }];
    for who in [External::Controller, External::Fdi] {
        if !external.contains(&who) {
            let mut peer = common.clone();
            peer.option("--link", address.for_peers("127.0.0.1").to_string());
            parts.push(Part {
                name: who.name(),
                args: peer.0,
            });
        }
    }
    parts
}

/// Arguments of a process; paths need not be UTF-8.
#[derive(Clone, Default)]
struct ArgList(Vec<OsString>);

impl ArgList {
    fn option(&mut self, name: &str, value: impl Into<OsString>) -> &mut Self {
        self.0.extend([name.into(), value.into()]);
        self
    }

    fn flag(&mut self, flag: impl Into<OsString>) -> &mut Self {
        self.0.push(flag.into());
        self
    }
}

/// The command that starts our own program in that place.
pub fn invitation(who: External, link: &str, run_id: u64, step_timeout: u64) -> String {
    format!(
        "rotortwin {} --link {link} --run-id {run_id:016x} --step-timeout {step_timeout}",
        who.name()
    )
}

/// Says with which commands the parts join that are not started here.
fn invite(args: &Args, config: &SessionConfig, address: &LinkAddress, external: &BTreeSet<External>) {
    let link = address.for_peers(&host_name()).to_string();
    let run_id = format!("{:016x}", config.run_id);
    let command = |who: &External| {
        let command = invitation(*who, &link, config.run_id, args.step_timeout);
        match args.priority {
            Some(priority) => format!("{command} --priority={priority}"),
            None => command,
        }
    };
    if args.events {
        let peers: Vec<_> = external
            .iter()
            .map(|who| {
                serde_json::json!({
                    "role": who.name(), "link": link, "run_id": run_id, "step_timeout_ms": args.step_timeout,
                    "join_timeout_ms": args.join_timeout.unwrap_or(EXTERNAL_JOIN_TIMEOUT_MS),
                    "messages": rotortwin_wire::PROTOCOL_VERSION, "command": command(who),
                })
            })
            .collect();
        output::line(&serde_json::json!({ "event": "join", "peers": peers }).to_string());
        return;
    }
    let names: Vec<&str> = external.iter().map(|who| who.name()).collect();
    eprintln!("Waiting for {} to join:", names.join(" and "));
    for who in external {
        eprintln!("  {}", command(who));
    }
}

/// The progress bar, and lines above it.
pub struct Screen {
    bar: ProgressBar,
    quiet: bool,
    /// Events as JSON lines instead.
    events: bool,
    /// Among these the samples.
    samples: bool,
    station: RefCell<Option<GroundStation>>,
}

impl Screen {
    /// * `quiet`: prints nothing; `events`: prints events as JSON lines instead
    pub fn new(quiet: bool, events: bool) -> Self {
        let bar = ProgressBar::with_draw_target(
            None,
            if quiet || events {
                ProgressDrawTarget::hidden()
            } else {
                ProgressDrawTarget::stderr()
            },
        );
        let style = ProgressStyle::with_template("{bar:28.cyan/blue} {percent:>3} %  {msg}")
            .expect("the template is well formed");
        bar.set_style(style.progress_chars("━╸─"));
        Self {
            bar,
            quiet,
            events,
            samples: true,
            station: RefCell::default(),
        }
    }

    /// Samples are asked for by somebody who reads the events, not for a ground station alone.
    fn with_samples(self, samples: bool) -> Self {
        Self { samples, ..self }
    }

    fn with_station(self, station: Option<GroundStation>) -> Self {
        Self {
            station: RefCell::new(station),
            ..self
        }
    }

    /// Passes an event on to the ground station.
    fn show_afar(&self, event: &RunEvent) {
        let mut station = self.station.borrow_mut();
        let Some(station) = station.as_mut() else { return };
        match event {
            RunEvent::Progress(progress) => station.charge(progress.state_of_charge),
            RunEvent::Sample(sample) => station.sample(sample),
            RunEvent::Change(change) => {
                if let Some(line) = change_line(change) {
                    station.change(change, &line);
                }
            }
            RunEvent::Waiting | RunEvent::Recording { .. } | RunEvent::Finished => {}
        }
    }

    /// Shows an event.
    pub fn show(&self, event: &RunEvent) {
        self.show_afar(event);
        if self.events {
            if matches!(event, RunEvent::Sample(_)) && !self.samples {
                return;
            }
            match serde_json::to_string(event) {
                Ok(line) => output::line(&line),
                Err(error) => tracing::error!(%error, "an event cannot be written"),
            }
            return;
        }
        match event {
            RunEvent::Waiting => self.bar.set_message("waiting for controller and FDI engine"),
            RunEvent::Progress(progress) => {
                self.bar.set_length(progress.step_count);
                self.bar.set_position(progress.step);
                self.bar.set_message(live_line(progress));
            }
            RunEvent::Change(change) => {
                if let Some(text) = change_line(change) {
                    self.line(&text);
                }
            }
            RunEvent::Recording { .. } => self.bar.set_message("writing the run folder"),
            RunEvent::Finished | RunEvent::Sample(_) => {}
        }
    }

    /// Prints a line above the bar.
    pub fn line(&self, text: &str) {
        if self.quiet {
            return;
        }
        if std::io::stderr().is_terminal() {
            self.bar.println(text);
        } else {
            eprintln!("{text}");
        }
    }

    /// Takes the bar away.
    pub fn close(&self) {
        self.bar.finish_and_clear();
    }
}

/// Time, battery, verdict.
fn live_line(progress: &Progress) -> String {
    format!(
        "t {:5.1} s  {:5.2} V  {:4.1} %  truth: {}  T-test: {}  sequential: {}",
        progress.sim_time_s,
        progress.battery_voltage_v,
        100.0 * progress.state_of_charge,
        truth_text(progress.fault_label),
        verdict_text(progress.t_test),
        verdict_text(progress.sequential)
    )
}

fn truth_text(fault_label: i32) -> String {
    match fault_label {
        0 => "healthy".to_owned(),
        -1 => "several rotors faulty".to_owned(),
        rotor => format!("rotor {rotor} faulty"),
    }
}

/// One line about a change; none for the detector's state before it is calibrated.
fn change_line(change: &Change) -> Option<String> {
    match change {
        Change::Truth {
            sim_time_s,
            fault_label,
        } => Some(format!(
            "t {sim_time_s:7.3} s  truth       {}",
            truth_text(*fault_label)
        )),
        Change::Verdict { sequential: -2, .. } => None,
        Change::Verdict {
            sim_time_s,
            sequential: sequential @ 1..,
            probability,
            thrust_loss_n,
            thrust_loss_low_n,
            thrust_loss_high_n,
            ..
        } => Some(format!(
            "t {sim_time_s:7.3} s  sequential  {} (probability {probability:.4}, loses {thrust_loss_n:.3} N \
             [{thrust_loss_low_n:.3}, {thrust_loss_high_n:.3}])",
            verdict_text(*sequential)
        )),
        Change::Verdict {
            sim_time_s,
            sequential: -3,
            suspect_rotors,
            ..
        } => {
            let rotors: Vec<String> = (0..32)
                .filter(|i| suspect_rotors >> i & 1 == 1)
                .map(|i| (i + 1).to_string())
                .collect();
            Some(format!(
                "t {sim_time_s:7.3} s  sequential  ambiguous: among rotors {}",
                rotors.join(", ")
            ))
        }
        Change::Verdict {
            sim_time_s, sequential, ..
        } => Some(format!(
            "t {sim_time_s:7.3} s  sequential  {}",
            verdict_text(*sequential)
        )),
        Change::HandOver { prelude_s } => Some(format!(
            "t   0.000 s  hand-over   {prelude_s:.1} s after the start of the plant"
        )),
        Change::Words { plant_time_s, text } => Some(format!("plant {plant_time_s:5.1} s  autopilot   {text}")),
        Change::Ground { sim_time_s, mishap } => {
            let what = match mishap {
                Mishap::HardLanding { speed_m_s } => format!("hard landing at {speed_m_s:.2} m/s"),
                Mishap::TipOver { tilt_rad } => {
                    format!("tipped over, {:.0}° against the ground", tilt_rad.to_degrees())
                }
                Mishap::RotorStrike { rotor } => format!("rotor {rotor} strikes the ground"),
            };
            Some(format!("t {sim_time_s:7.3} s  ground      {what}"))
        }
    }
}
