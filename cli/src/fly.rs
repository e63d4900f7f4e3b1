//! `rotortwin fly`: one flight, in this process or in three.

use crate::foxglove::{self, Viewers};
use crate::ground_station::GroundStation;
use crate::output;
use clap::{Parser, ValueEnum};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use rotortwin_bridge::address::BoardAddress;
use rotortwin_bridge::autopilot::address::{ADDRESSES, AutopilotAddress, Protocol};
use rotortwin_flight::pace::Pace;
use rotortwin_jobs::{Invitation, SeatRole, Tickets};
use rotortwin_process::priority::{self, DEFAULT_PRIORITY, parse_priority};
use rotortwin_process::{LinkAddress, Placement};
use rotortwin_runner::autopilot::{PilotChoice, Waits, open_autopilot};
use rotortwin_runner::destination::ResultFolder;
use rotortwin_runner::failure::Failure;
use rotortwin_runner::flight::{
    self, Board, EXTERNAL_JOIN_TIMEOUT_MS, FlightEvent, Order, Peers, Processes, free_port,
};
use rotortwin_scenario::{ConfigError, Documents, Scenario};
use rotortwin_store::run_folder::RunFolder;
use rotortwin_store::summary::verdict_text;
use rotortwin_twin::model::ModelStore;
use rotortwin_wire::events::{Change, Mishap, Progress, RunEvent};
use rotortwin_wire::link::LinkTiming;
use std::cell::RefCell;
use std::io::IsTerminal as _;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// Arguments of `rotortwin fly`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Scenario: a file, or a name that 'rotortwin list scenarios' shows; with --server also @NAME, one of the server's library
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
    /// iceoryx2: runs in different domains are isolated from each other [default: default]
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
    /// Do not start these processes; start them with the printed command
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHO")]
    pub external: Vec<External>,
    /// Longest wait for both peers to join, ms [default: 10000, with --external 600000]
    #[arg(long, value_name = "MS", value_parser = whole_number(1..=3_600_000))]
    pub join_timeout: Option<u64>,
    /// Longest wait for the reply of a running peer, ms
    #[arg(long, value_name = "MS", default_value_t = 5_000, value_parser = whole_number(1..=3_600_000))]
    pub step_timeout: u64,
    /// Steps that the FDI engine may trail behind the plant; 0: wait for each report
    #[arg(long, value_name = "STEPS", default_value_t = LinkTiming::default().fdi_window, value_parser = whole_number(0..=256))]
    pub fdi_window: u64,
    /// Run every process on this CPU [default: a free one while the pace is fast and all processes are started here]
    #[arg(long, value_name = "CPU", value_parser = cpu_number())]
    pub cpu: Option<usize>,
    /// Real-time priority (SCHED_FIFO) and locked memory for all processes of the flight that are started here, 1 to 99; with --pace
    /// real-time or --controller betaflight [default: none; without a number: 40]
    #[arg(long, value_name = "1-99", num_args = 0..=1, require_equals = true, default_missing_value = DEFAULT_PRIORITY, value_parser = parse_priority)]
    pub priority: Option<u8>,
    /// Fly the vehicle and effects of this model instead of the scenario's vehicle: MODEL, MODEL@v2 or a file; with --server also @MODEL,
    /// one of the server
    #[arg(long, value_name = "MODEL")]
    pub model: Option<String>,
    /// The model assumed by the detectors, as far as their parameters can represent it
    #[arg(long, value_name = "MODEL")]
    pub fdi_model: Option<String>,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    pub models: PathBuf,
    /// A flight board takes the place of controller and FDI engine: serial:/dev/ttyACM0[@BAUD], pty, qemu, qemu-uart,
    /// virtual[:KEY=NUMBER,...]. Or an autopilot's simulator build, which connects to this program: ardupilot[:ADDR], px4[:ADDR],
    /// betaflight[:ADDR][@SPEED]
    #[arg(long, value_name = "BOARD|AUTOPILOT", conflicts_with_all = ["link", "listen", "connect", "zenoh_config", "domain", "external", "fdi_window"])]
    pub controller: Option<Foreign>,
    /// With --server: fly with this autopilot of the server ('GET /api/v1/autopilots')
    #[arg(long, value_name = "NAME", conflicts_with_all = ["controller", "link", "pace"])]
    pub autopilot: Option<String>,
    /// With an autopilot: where it accepts MAVLink commands, tcp:IP:PORT or udp:IP:PORT; rotortwin arms, flies and lands it there. none: another
    /// program does that. Betaflight: none, or leave it out: rotortwin moves its sticks [default: ardupilot tcp:127.0.0.1:5760, px4
    /// udp:127.0.0.1:14540]
    #[arg(long, value_name = "ADDR|none", requires = "controller")]
    pub pilot: Option<PilotChoice>,
    /// With --controller: where the FDI engine runs
    #[arg(long, value_enum, default_value_t = FdiPlace::Board, requires = "controller")]
    pub fdi: FdiPlace,
    /// With --controller: compare every bit of the board with the host, and report the first difference
    #[arg(long, requires = "controller")]
    pub compare: bool,
    /// Show the flight to a ground station that speaks MAVLink, such as udp:127.0.0.1:14550 for QGroundControl; verdicts are sent as texts.
    /// At the speed of the flight: see --pace
    #[arg(long, value_name = "udp:IP:PORT")]
    pub mavlink: Option<crate::ground_station::Address>,
    /// Show the flight live in Foxglove and Lichtblick, which connect there [default address: 127.0.0.1:8765]. At the speed of the flight:
    /// see --pace
    #[arg(long, value_name = "IP:PORT", num_args = 0..=1, default_missing_value = foxglove::DEFAULT_ADDRESS, value_parser = foxglove::parse_address)]
    pub foxglove: Option<std::net::SocketAddr>,
    /// Print the summary as JSON, nothing else
    #[arg(long)]
    pub json: bool,
    /// SCENARIO contains all documents of a run, as its summary does
    #[arg(long, conflicts_with_all = ["model", "fdi_model"])]
    pub documents: bool,
    /// Print each event of the run as a JSON line, nothing else; end when standard input is closed
    #[arg(long, conflicts_with = "json")]
    pub events: bool,
    /// With --events: also samples of the telemetry, at this rate in Hz of simulated time, at most 100 a second of wall clock
    #[arg(long, value_name = "HZ", requires = "events", value_parser = rotortwin_sim::process::parse_rate)]
    pub live: Option<f64>,
}

impl Args {
    /// Samples per second that the plant reports.
    fn live_hz(&self) -> Option<f64> {
        let shown = self.mavlink.map(|_| crate::ground_station::RATE_HZ);
        self.live.or(self.foxglove.map(|_| foxglove::RATE_HZ)).or(shown)
    }

    /// The plant's process cannot read the scenario's file, which differs from what is flown.
    fn whole_documents(&self) -> bool {
        self.documents || !self.set.is_empty() || self.model.is_some() || self.fdi_model.is_some()
    }
}

/// Third-party controller.
#[derive(Clone, Debug, PartialEq)]
pub enum Foreign {
    /// A flight board.
    Board(BoardAddress),
    /// An autopilot with its own clock.
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

/// Where the FDI engine of a run with a board is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FdiPlace {
    /// On the board
    Board,
    /// In this process
    Host,
}

/// Parses an integer in a range, with an error message that states the range.
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

/// A process that is started by hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum External {
    /// The controller
    Controller,
    /// The FDI engine
    Fdi,
}

impl From<External> for SeatRole {
    fn from(who: External) -> Self {
        match who {
            External::Controller => Self::Controller,
            External::Fdi => Self::Fdi,
        }
    }
}

/// What begins with @: a document of a server.
fn of_a_server(args: &Args) -> Option<String> {
    let scenario = args.scenario.to_string_lossy().into_owned();
    [Some(scenario), args.model.clone(), args.fdi_model.clone()]
        .into_iter()
        .flatten()
        .find(|text| text.starts_with('@'))
}

/// Runs the command.
pub fn run(args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    if args.autopilot.is_some() {
        return output::bad_input(
            "--autopilot names one of a server's: expected --server URL; here it is --controller ADDRESS",
        );
    }
    if let Some(name) = of_a_server(args) {
        return output::bad_input(format!("'{name}' is of a server's library: expected --server URL"));
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
    let viewers = match args
        .foxglove
        .map(|at| foxglove::open(at, &scenario, flight::new_run_id()))
        .transpose()
    {
        Ok(viewers) => viewers,
        Err(sentence) => return output::bad_input(sentence),
    };
    let settled = args
        .controller
        .as_ref()
        .map(|foreign| open(args, foreign, &scenario, seed))
        .transpose()
        .and_then(|foreign| {
            Ok((
                settle(args, foreign)?,
                run_folder(args, scenario.name(), seed).map_err(Failure::Input)?,
            ))
        });
    let (peers, folder) = match settled {
        Ok(settled) => settled,
        Err(failure) => return output::told(&failure),
    };
    for warning in scenario.warnings() {
        output::say_aside(format!("{}: {warning}", args.scenario.display()));
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
        .with_station(station)
        .with_viewers(viewers);
    let order = Order {
        scenario: &scenario,
        path: &args.scenario,
        whole_documents: args.whole_documents(),
        seed,
        pace: args.pace.into(),
        priority: args.priority,
        live_hz: args.live_hz(),
        join_timeout_ms: args.join_timeout,
        step_timeout_ms: args.step_timeout,
        peers,
    };
    let flown = flight::fly(order, &folder, &|event| screen.tell(event));
    screen.close();
    let flown = match flown {
        Ok(flown) => flown,
        Err(failure) => return output::told(&failure),
    };
    let summary = &flown.summary;
    if args.json {
        print!("{}", summary.to_json());
    } else if !args.events {
        print!("{}", output::summary_text(summary, Some(folder.path())));
        if let Some(placed) = flown.placed {
            print!("{}", output::fitted(&format!("Placement    {placed}\n")));
        }
    }
    if let Some((report, address)) = &flown.board {
        eprint!("{}", output::fitted(&crate::board::session_text(report, Some(address))));
        if let Some(difference) = &report.difference {
            return output::failed(difference);
        }
    }
    output::exit_code(summary)
}

/// The scenario specified by the arguments, with their overrides.
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

/// The parent process holds our standard input open as long as it lives: its end is a stop request.
pub fn end_with_standard_input() {
    std::thread::spawn(|| {
        let ended = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        tracing::debug!(?ended, "the standard input has ended");
        if let Err(error) = signal_hook::low_level::raise(signal_hook::consts::SIGTERM) {
            tracing::error!(%error, "the request to stop cannot be sent to the run");
        }
    });
}

/// The scenario with the requested models: their vehicle and effects in the plant, their parameters in the detectors.
pub fn with_models(scenario: Scenario, args: &Args) -> Result<Scenario, ExitCode> {
    let store = ModelStore::new(&args.models);
    let find = |text: &str| store.find(text).map_err(|error| output::told(&error.into()));
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
            output::say_aside(format!(
                "rotortwin: the detectors have no parameter for {}: ignored by the detectors",
                vehicle.not_carried.join(", ")
            ));
        }
        scenario = scenario.with_fdi_vehicle(vehicle.documents).map_err(refuse)?;
    }
    Ok(scenario)
}

/// Only a flight with deadlines may have a priority: at real-time pace, or with an autopilot that is itself paced by the wall clock.
fn check_pace_of_priority(pace: PaceArg, foreign: Option<&Peers>) -> Result<(), Failure> {
    match foreign {
        Some(Peers::Autopilot(autopilot, _)) if autopilot.protocol.lockstep() => Err(Failure::input(format!(
            "--priority applies to flights at the pace of the wall clock, {autopilot} flies in lockstep"
        ))),
        Some(Peers::Autopilot(..)) => Ok(()),
        _ if pace == PaceArg::RealTime => Ok(()),
        _ => Err(Failure::input(format!(
            "{} or --controller betaflight",
            priority::NEEDS_PACE
        ))),
    }
}

/// Checks everything possible before anything is written: the CPU, and the meeting point of the processes.
fn settle(args: &Args, foreign: Option<Peers>) -> Result<Peers, Failure> {
    if let Some(cpu) = args.cpu {
        // Inherited by the processes that this one starts.
        rotortwin_process::pin_to_cpu(cpu).map_err(Failure::Input)?;
    }
    if let Some(priority) = args.priority {
        check_pace_of_priority(args.pace, foreign.as_ref())?;
        priority::probe(priority).map_err(Failure::input)?;
    }
    if let Some(foreign) = foreign {
        return Ok(foreign);
    }
    let option = if args.connect.is_some() {
        "--connect"
    } else {
        "--listen"
    };
    let Some(address) = address(args).map_err(Failure::Input)? else {
        return Ok(Peers::Here);
    };
    address
        .probe()
        .map_err(|sentence| Failure::input(format!("{option}: {sentence}")))?;
    Ok(Peers::Processes(Processes {
        link: link_name(args.link),
        address,
        external: args.external.iter().copied().map(SeatRole::from).collect(),
        fdi_window: args.fdi_window,
        placement: placement(args),
    }))
}

/// Creates the folder of the run, and makes sure that it is writable.
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

/// Meeting point of the processes; `None`: there is only this one.
fn address(args: &Args) -> Result<Option<LinkAddress>, String> {
    let endpoint_given = args.listen.is_some() || args.connect.is_some() || args.zenoh_config.is_some();
    if args.link != LinkKind::Zenoh && endpoint_given {
        return Err(format!(
            "--listen, --connect and --zenoh-config apply to --link zenoh only, the link is {}",
            link_name(args.link)
        ));
    }
    if args.link == LinkKind::InProcess && !args.external.is_empty() {
        return Err("--external needs separate processes; expected --link iceoryx2 or --link zenoh".to_owned());
    }
    if args.link != LinkKind::Iceoryx2 && args.domain.is_some() {
        return Err(format!(
            "--domain applies to --link iceoryx2 only, the link is {}",
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

/// Opens the line to a board, or the port for an autopilot.
fn open(args: &Args, foreign: &Foreign, scenario: &Scenario, seed: u64) -> Result<Peers, Failure> {
    let autopilot = match foreign {
        Foreign::Board(address) => {
            if args.pilot.is_some() {
                return Err(Failure::input(format!(
                    "--pilot applies to autopilots only, the controller is the board {address}"
                )));
            }
            return Ok(Peers::Board(Board {
                line: address.open().map_err(Failure::input)?,
                address: address.clone(),
                with_fdi: args.fdi == FdiPlace::Board,
                compare: args.compare,
            }));
        }
        Foreign::Autopilot(autopilot) => autopilot,
    };
    if args.compare || args.fdi != FdiPlace::Board || args.pace != PaceArg::Fast {
        return Err(Failure::input(format!(
            "--compare, --fdi and --pace apply to boards only, the controller is {autopilot}"
        )));
    }
    let waits = Waits {
        join: Duration::from_millis(args.join_timeout.unwrap_or(EXTERNAL_JOIN_TIMEOUT_MS)),
        step: Duration::from_millis(args.step_timeout),
    };
    open_autopilot(autopilot, args.pilot, waits, scenario, seed)
        .map(|opened| Peers::Autopilot(*autopilot, opened))
        .map_err(|refused| refused.into_failure(&args.scenario))
}

/// Processors for the processes of a flight. In lockstep they wait for each other, and the rest of the machine is left to other
/// flights; at real-time pace they do not delay each other if each finds its own processor.
fn placement(args: &Args) -> Placement {
    match args.cpu {
        Some(cpu) => Placement::given(cpu),
        None if args.pace == PaceArg::RealTime => Placement::kernel("real-time pace"),
        None if !args.external.is_empty() => Placement::kernel("not all processes are started here"),
        None => Placement::chosen(),
    }
}

/// The progress bar, and lines above it.
pub struct Screen {
    bar: ProgressBar,
    quiet: bool,
    /// Print events as JSON lines instead.
    events: bool,
    /// Including samples.
    samples: bool,
    station: RefCell<Option<GroundStation>>,
    viewers: RefCell<Option<Box<dyn Viewers>>>,
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
            viewers: RefCell::default(),
        }
    }

    /// Samples are requested by a reader of the events, not only for a ground station.
    pub(crate) fn with_samples(self, samples: bool) -> Self {
        Self { samples, ..self }
    }

    fn with_station(self, station: Option<GroundStation>) -> Self {
        Self {
            station: RefCell::new(station),
            ..self
        }
    }

    /// Prints the viewers' address, whatever consumes the other output.
    fn with_viewers(self, viewers: Option<Box<dyn Viewers>>) -> Self {
        if let Some(viewers) = &viewers {
            eprintln!("Foxglove     {}", viewers.url());
        }
        Self {
            viewers: RefCell::new(viewers),
            ..self
        }
    }

    /// Forwards an event to viewers and the ground station.
    fn show_afar(&self, event: &RunEvent) {
        if let (Some(viewers), RunEvent::Sample(sample)) = (self.viewers.borrow_mut().as_mut(), event) {
            viewers.sample(sample);
        }
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

    /// Shows an event of a local flight.
    pub fn tell(&self, event: &FlightEvent<'_>) {
        match event {
            FlightEvent::Run(event) => self.show(event),
            FlightEvent::Waiting(text) => self.line(text),
            FlightEvent::Join(tickets) => self.invite(tickets),
        }
    }

    /// Prints the commands with which external parts join.
    fn invite(&self, tickets: &Tickets) {
        if self.events {
            output::line(&invitation_line(tickets));
            return;
        }
        let names: Vec<&str> = tickets.peers.iter().map(|peer| peer.role.as_str()).collect();
        eprintln!("Waiting for {} to join:", names.join(" and "));
        for peer in &tickets.peers {
            eprintln!("  {}", peer.command);
        }
    }

    /// Removes the bar.
    pub fn close(&self) {
        self.bar.finish_and_clear();
    }
}

/// The event with which a server, or a script, learns who can join.
fn invitation_line(tickets: &Tickets) -> String {
    serde_json::to_value(Invitation::Join(tickets.clone()))
        .expect("strings and numbers are JSON")
        .to_string()
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
        Change::Load { sim_time_s, mass_kg } => Some(format!(
            "t {sim_time_s:7.3} s  truth       drops a load of {mass_kg} kg"
        )),
        Change::Verdict { sequential: -2, .. } => None,
        Change::Verdict {
            sim_time_s,
            sequential: sequential @ 1..,
            probability,
            ..
        } => Some(format!(
            "t {sim_time_s:7.3} s  sequential  {} (probability {probability:.4})",
            verdict_text(*sequential)
        )),
        Change::Severity {
            sim_time_s,
            sequential,
            thrust_loss_n,
            thrust_loss_low_n,
            thrust_loss_high_n,
        } => Some(format!(
            "t {sim_time_s:7.3} s  severity    {}: loses {thrust_loss_n:.3} N [{thrust_loss_low_n:.3}, {thrust_loss_high_n:.3}]",
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
