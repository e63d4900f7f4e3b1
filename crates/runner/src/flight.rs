//! Execution of one flight: in this process, in three, with a board, or with an autopilot.

use crate::autopilot::{OpenedAutopilot, PilotChoice, Waits, open_autopilot};
use crate::destination::ResultFolder;
use crate::failure::Failure;
use rotortwin_bridge::address::{AnyLine, BoardAddress};
use rotortwin_bridge::autopilot::address::AutopilotAddress;
use rotortwin_bridge::session::{BoardLink, SessionOptions, SessionReport};
use rotortwin_flight::pace::Pace;
use rotortwin_jobs::flight::{self, Flight, Link, Place};
use rotortwin_jobs::{FlightHere, Meeting, SeatRole, Ticket, Tickets};
use rotortwin_links::endpoint::PeerOptions;
use rotortwin_links::host_name;
use rotortwin_process::launch::{self, Part};
use rotortwin_process::{AnyEndpoint, LinkAddress, Placement, Supervisor, priority};
use rotortwin_scenario::{Documents, Scenario};
use rotortwin_sim::session::{self, DeadPlant, SessionConfig};
use rotortwin_store::run_folder::RunFolder;
use rotortwin_store::summary::{Status, Summary, load_summary};
use rotortwin_wire::autopilot::Autopilot;
use rotortwin_wire::events::RunEvent;
use rotortwin_wire::link::{LinkTiming, PlantLink};
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// In the run folder: scenario, vehicle, models and blades as flown, for the plant's process.
const DOCUMENTS_FILE: &str = "documents.toml";
/// Default output folder of a job's flight.
const OUT: &str = "out";
/// Default time-out for peers started here to join, ms.
const OWN_JOIN_TIMEOUT_MS: u64 = 10_000;
/// Default time-out for parts started by hand to join, ms.
pub const EXTERNAL_JOIN_TIMEOUT_MS: u64 = 600_000;
/// Default time-out for the answer of a live peer, ms.
pub const STEP_TIMEOUT_MS: u64 = 5_000;

/// A flight with all its settings.
pub struct Order<'a> {
    /// Scenario.
    pub scenario: &'a Scenario,
    /// Its path, for messages and the summary.
    pub path: &'a Path,
    /// The file there differs from what is flown: the plant's process gets all documents.
    pub whole_documents: bool,
    /// Seed of all noise and random draws.
    pub seed: u64,
    /// Pace.
    pub pace: Pace,
    /// Real-time priority of all processes of the flight (`rotortwin_process::priority`), with their memory locked.
    pub priority: Option<u8>,
    /// Samples to report per second of simulated time.
    pub live_hz: Option<f64>,
    /// Time-out for the peers to join, ms; unset: the default of their kind.
    pub join_timeout_ms: Option<u64>,
    /// Time-out for the answer of a live peer, ms.
    pub step_timeout_ms: u64,
    /// Controller and FDI engine.
    pub peers: Peers,
}

/// Controller and FDI engine.
pub enum Peers {
    /// Ours, as function calls in this process.
    Here,
    /// Separate processes.
    Processes(Processes),
    /// A flight board.
    Board(Board),
    /// An autopilot in place of the controller.
    Autopilot(AutopilotAddress, OpenedAutopilot),
}

/// Separate processes, supervised by this one.
pub struct Processes {
    /// Name of the link, for the summary.
    pub link: &'static str,
    /// Their meeting point.
    pub address: LinkAddress,
    /// Started externally.
    pub external: BTreeSet<SeatRole>,
    /// Steps that the FDI engine may trail behind the plant.
    pub fdi_window: u64,
    /// Processors to run on.
    pub placement: Placement,
}

/// A flight board, opened.
pub struct Board {
    /// Address.
    pub address: BoardAddress,
    /// The line to it.
    pub line: AnyLine,
    /// The FDI engine is on the board, too.
    pub with_fdi: bool,
    /// Compare every bit with the host.
    pub compare: bool,
}

/// Event of a flight.
#[derive(Debug)]
pub enum FlightEvent<'a> {
    /// These processes can join now.
    Join(Tickets),
    /// Waiting for something.
    Waiting(String),
    /// Of the plant.
    Run(&'a RunEvent),
}

/// Receiver of events.
pub type Tell<'a> = &'a dyn Fn(&FlightEvent<'_>);

/// Result of a flight.
pub struct Flown {
    /// Its summary.
    pub summary: Summary,
    /// Session report of a board.
    pub board: Option<(SessionReport, BoardAddress)>,
    /// Processors it ran on.
    pub placed: Option<String>,
}

/// Executes the flight of a job.
///
/// * `folder`: working folder of the job; the summary names the scenario as a file there
///
/// # Errors
/// The documents cannot be flown, peers cannot connect, or the run folder cannot be written.
pub fn perform(job: &Flight, here: &FlightHere, folder: &Path, tell: Tell<'_>) -> Result<Flown, Failure> {
    let path = folder.join(DOCUMENTS_FILE);
    let documents = Documents::from_toml(&path.display().to_string(), &job.documents).map_err(Failure::input)?;
    let scenario = Scenario::from_documents(&documents).map_err(Failure::input)?;
    let seed = job.seed.parse().map_err(|_not_a_number: std::num::ParseIntError| {
        Failure::input(format!(
            "key `seed`: '{}'; expected a whole number from 0 to {}",
            job.seed,
            u64::MAX
        ))
    })?;
    scenario.simulation(seed).map_err(Failure::input)?;
    let peers = peers(job, here, &scenario, seed, &path)?;
    let out = here.out.clone().unwrap_or_else(|| PathBuf::from(OUT));
    let out = ResultFolder::create(&out).map_err(Failure::Input)?.keep();
    for warning in scenario.warnings() {
        tracing::warn!("{}: {warning}", path.display());
    }
    let own = matches!(job.controller.place(), Some(Place::Beside)) && job.fdi == Place::Beside;
    let order = Order {
        scenario: &scenario,
        path: &path,
        whole_documents: true,
        seed,
        pace: match job.pace {
            flight::Pace::Fast => Pace::Fast,
            flight::Pace::RealTime => Pace::RealTime,
        },
        priority: None,
        live_hz: here.live_hz,
        // Ours connect immediately, or never.
        join_timeout_ms: (!own).then_some(job.join_timeout_ms),
        step_timeout_ms: STEP_TIMEOUT_MS,
        peers,
    };
    fly(order, &out, tell)
}

fn peers(job: &Flight, here: &FlightHere, scenario: &Scenario, seed: u64, path: &Path) -> Result<Peers, Failure> {
    if let Some(name) = job.controller.autopilot() {
        let Some(listed) = &here.autopilot else {
            return Err(Failure::input(format!(
                "the address of the autopilot '{name}' is missing; expected `here.flight.autopilot`"
            )));
        };
        let address: AutopilotAddress = listed.address.parse().map_err(Failure::Input)?;
        let pilot = listed.pilot.as_deref().map(str::parse::<PilotChoice>).transpose();
        let waits = Waits {
            join: Duration::from_millis(job.join_timeout_ms),
            step: Duration::from_millis(STEP_TIMEOUT_MS),
        };
        return open_autopilot(&address, pilot.map_err(Failure::Input)?, waits, scenario, seed)
            .map(|opened| Peers::Autopilot(address, opened))
            .map_err(|refused| refused.into_failure(path));
    }
    let external: BTreeSet<SeatRole> = [
        (SeatRole::Controller, job.controller.place().unwrap_or_default()),
        (SeatRole::Fdi, job.fdi),
    ]
    .into_iter()
    .filter(|(_, place)| *place != Place::Beside)
    .map(|(who, _)| who)
    .collect();
    let text = match (job.link, &here.meeting) {
        (Link::InProcess, _) if external.is_empty() => return Ok(Peers::Here),
        (Link::InProcess, _) => {
            return Err(Failure::input(
                "`link` is in-process, and a part of the flight is elsewhere; expected iceoryx2 or zenoh",
            ));
        }
        (Link::Iceoryx2, _) => "iceoryx2".to_owned(),
        (Link::Zenoh, Some(Meeting::Listen(endpoint))) => format!("zenoh:listen={endpoint}"),
        (Link::Zenoh, Some(Meeting::Connect(endpoint))) => format!("zenoh:connect={endpoint}"),
        (Link::Zenoh, None) => format!("zenoh:listen=tcp/127.0.0.1:{}", free_port().map_err(Failure::Failed)?),
    };
    let address: LinkAddress = text.parse().map_err(Failure::input)?;
    address
        .probe()
        .map_err(|sentence| Failure::input(format!("the meeting point of the flight's processes: {sentence}")))?;
    let placement = match job.pace {
        flight::Pace::RealTime => Placement::kernel("real-time pace"),
        flight::Pace::Fast if !external.is_empty() => Placement::kernel("not all processes are started here"),
        flight::Pace::Fast => Placement::chosen(),
    };
    Ok(Peers::Processes(Processes {
        link: job.link.as_str(),
        address,
        external,
        fdi_window: LinkTiming::default().fdi_window,
        placement,
    }))
}

/// Flies, and writes a run folder.
///
/// # Errors
/// The run folder cannot be written, or a process cannot be started. The failure of a peer is a result.
pub fn fly(order: Order<'_>, folder: &RunFolder, tell: Tell<'_>) -> Result<Flown, Failure> {
    fly_with(order, folder, tell).map_err(|sentence| Failure::writing(folder.path(), sentence))
}

fn fly_with(order: Order<'_>, folder: &RunFolder, tell: Tell<'_>) -> Result<Flown, String> {
    let config = SessionConfig {
        scenario_path: order.path.to_path_buf(),
        seed: order.seed,
        link_name: link_name(&order.peers),
        pace: order.pace,
        run_id: new_run_id(),
        priority: order.priority,
        live_hz: order.live_hz,
    };
    let flight = Running {
        scenario: order.scenario,
        whole_documents: order.whole_documents,
        join_timeout_ms: order.join_timeout_ms,
        step_timeout_ms: order.step_timeout_ms,
        config,
        folder,
        tell,
    };
    if let Some(priority) = order.priority
        && !matches!(order.peers, Peers::Processes(_))
    {
        priority::take(priority).map_err(|error| error.to_string())?;
    }
    let alone = |summary: Summary| Flown {
        summary,
        board: None,
        placed: None,
    };
    match order.peers {
        Peers::Here => flight.here().map(alone),
        Peers::Processes(processes) => flight.in_processes(processes),
        Peers::Board(board) => flight.with_board(board),
        Peers::Autopilot(_, OpenedAutopilot::ArduPilot(mut link, supervisor)) => {
            let place = address_text(link.autopilot().local_address());
            tell(&FlightEvent::Waiting(format!(
                "Waiting for servo packets of ArduPilot: {place}"
            )));
            flight.with_autopilot(&mut *link, &supervisor).map(alone)
        }
        Peers::Autopilot(_, OpenedAutopilot::Px4(mut link, supervisor)) => {
            let place = address_text(link.autopilot().local_address());
            tell(&FlightEvent::Waiting(format!("Waiting for PX4 to connect: {place}")));
            flight.with_autopilot(&mut *link, &supervisor).map(alone)
        }
        Peers::Autopilot(_, OpenedAutopilot::Betaflight(mut link, supervisor)) => {
            let place = link.states_to();
            tell(&FlightEvent::Waiting(format!("Sending states to Betaflight: {place}")));
            flight.with_autopilot(&mut *link, &supervisor).map(alone)
        }
    }
}

/// Name of the link in the summary.
fn link_name(peers: &Peers) -> String {
    match peers {
        Peers::Here => Link::InProcess.as_str().to_owned(),
        Peers::Processes(processes) => processes.link.to_owned(),
        Peers::Board(board) => format!("board {}", board.address),
        Peers::Autopilot(autopilot, _) => {
            let how = if autopilot.protocol.lockstep() {
                "lockstep"
            } else {
                "not lockstep"
            };
            format!("{}{autopilot}, {how}", session::AUTOPILOT_LINK)
        }
    }
}

/// An address of this host.
fn address_text(address: Option<std::net::SocketAddr>) -> String {
    address.map_or_else(|| "an unknown address".to_owned(), |address| address.to_string())
}

/// A currently free TCP port of the loopback address.
///
/// # Errors
/// There is none.
pub fn free_port() -> Result<u16, String> {
    std::net::TcpListener::bind("127.0.0.1:0")
        .and_then(|listener| listener.local_addr())
        .map(|address| address.port())
        .map_err(|error| format!("no free TCP port on 127.0.0.1: {error}"))
}

/// A unique run id; 0 is reserved for "none".
pub fn new_run_id() -> u64 {
    rand::random::<u64>().max(1)
}

fn watched() -> Result<Supervisor, String> {
    Supervisor::watch(false).map_err(|error| format!("Ctrl-C cannot be handled: {error}"))
}

/// A running flight.
struct Running<'a> {
    scenario: &'a Scenario,
    whole_documents: bool,
    join_timeout_ms: Option<u64>,
    step_timeout_ms: u64,
    config: SessionConfig,
    folder: &'a RunFolder,
    tell: Tell<'a>,
}

impl Running<'_> {
    fn show(&self, event: &RunEvent) {
        (self.tell)(&FlightEvent::Run(event));
    }

    /// The whole flight in this process.
    fn here(&self) -> Result<Summary, String> {
        self.over(&mut session::in_process_link())
    }

    /// The plant in this process, with its peers over a link.
    fn over(&self, link: &mut impl PlantLink) -> Result<Summary, String> {
        let supervisor = watched()?;
        session::fly(
            self.scenario,
            &self.config,
            link,
            self.folder,
            &mut |event| self.show(&event),
            &mut || session::stop_reason(&supervisor),
        )
        .map_err(|error| error.to_string())
    }

    /// The flight in this process, with an autopilot that has its own clock in place of the controller.
    fn with_autopilot(&self, autopilot: &mut impl Autopilot, supervisor: &Supervisor) -> Result<Summary, String> {
        let mut show = |event: RunEvent| self.show(&event);
        let mut stop = || session::stop_reason(supervisor);
        session::fly_autopilot(
            self.scenario,
            &self.config,
            autopilot,
            self.folder,
            &mut show,
            &mut stop,
        )
        .map_err(|error| error.to_string())
    }

    /// The flight in this process, with a board in place of controller and FDI engine.
    fn with_board(&self, board: Board) -> Result<Flown, String> {
        let Board { address, line, .. } = board;
        let mut options = SessionOptions {
            join: Duration::from_millis(self.join_timeout_ms.unwrap_or(OWN_JOIN_TIMEOUT_MS)),
            step: Duration::from_millis(self.step_timeout_ms),
            compare: board.compare,
            ..SessionOptions::default()
        };
        options.board.fdi = board.with_fdi;
        // A slow line transmits the four numbers behind the residuals; the result is bit-identical.
        options.board.residuals = address.baud().is_none();
        let mut link = BoardLink::new(line, &address.to_string(), options);
        let summary = self.over(&mut link)?;
        Ok(Flown {
            summary,
            board: Some((link.report(), address)),
            placed: None,
        })
    }

    /// The flight in three processes, supervised by this one.
    fn in_processes(&self, mut processes: Processes) -> Result<Flown, String> {
        if self.whole_documents {
            // The plant's process reads the scenario itself, and the file does not contain the models.
            let path = self.folder.path().join(DOCUMENTS_FILE);
            std::fs::write(&path, self.scenario.documents().to_toml())
                .map_err(|error| format!("{}: cannot be written: {error}", path.display()))?;
        }
        let parts = self.parts(&processes);
        if !processes.external.is_empty() {
            (self.tell)(&FlightEvent::Join(self.tickets(&processes)));
        }
        let start = std::time::Instant::now();
        let silence_limit = PeerOptions::new(
            "",
            &LinkTiming {
                step: Duration::from_millis(self.step_timeout_ms),
                ..LinkTiming::default()
            },
        )
        .idle;
        let placement = &mut processes.placement;
        let ending = launch::run(&parts, self.folder.path(), silence_limit, placement, |event| {
            self.show(event);
        })
        .map_err(|error| format!("{error:#}"))?;
        let summary = match load_summary(self.folder.path()) {
            Ok(summary) => summary,
            // The plant could not write it: it died, or stalled and was killed.
            Err(_) => {
                let dead = DeadPlant {
                    how: ending.plant_text(),
                    silence: ending.plant_silence,
                    last_step: ending.last_step,
                    wall: start.elapsed(),
                };
                session::finalise_dead_plant(self.scenario, &self.config, self.folder, &dead)
                    .map_err(|error| error.to_string())?
            }
        };
        if summary.status != Status::Done {
            AnyEndpoint::tidy(&processes.address);
        }
        Ok(Flown {
            summary,
            board: None,
            placed: Some(processes.placement.sentence()),
        })
    }

    fn parts(&self, processes: &Processes) -> Vec<Part> {
        let join_timeout = self.join_timeout_ms.unwrap_or(if processes.external.is_empty() {
            OWN_JOIN_TIMEOUT_MS
        } else {
            EXTERNAL_JOIN_TIMEOUT_MS
        });
        let mut common = ArgList::default();
        common.option("--run-id", format!("{:016x}", self.config.run_id));
        common
            .option("--join-timeout", join_timeout.to_string())
            .option("--step-timeout", self.step_timeout_ms.to_string());
        if let Some(priority) = self.config.priority {
            // Its value is optional, and must therefore be in the same argument.
            common.plain(format!("--priority={priority}"));
        }
        let mut sim = common.clone();
        sim.option("--link", processes.address.to_string())
            .option("--seed", self.config.seed.to_string());
        sim.option("--fdi-window", processes.fdi_window.to_string());
        sim.option(
            "--pace",
            match self.config.pace {
                Pace::Fast => "fast",
                Pace::RealTime => "real-time",
            },
        );
        if let Some(rate_hz) = self.config.live_hz {
            sim.option("--live", rate_hz.to_string());
        }
        if self.whole_documents {
            sim.option("--documents", self.folder.path().join(DOCUMENTS_FILE));
        }
        sim.option("--out", self.folder.path())
            .option("--", &self.config.scenario_path);
        let mut parts = vec![Part {
            name: "sim",
            args: sim.0,
        }];
        for who in SeatRole::ALL {
            if !processes.external.contains(&who) {
                let mut peer = common.clone();
                peer.option("--link", processes.address.for_peers("127.0.0.1").to_string());
                parts.push(Part {
                    name: who.as_str(),
                    args: peer.0,
                });
            }
        }
        parts
    }

    /// Everything needed to start a part externally.
    fn tickets(&self, processes: &Processes) -> Tickets {
        let link = processes.address.for_peers(&host_name()).to_string();
        let ticket = |role: &SeatRole| {
            let join_timeout_ms = self.join_timeout_ms.unwrap_or(EXTERNAL_JOIN_TIMEOUT_MS);
            let command = invitation(*role, &link, self.config.run_id, join_timeout_ms, self.step_timeout_ms);
            Ticket {
                role: *role,
                link: link.clone(),
                run_id: format!("{:016x}", self.config.run_id),
                messages: rotortwin_wire::PROTOCOL_VERSION,
                join_timeout_ms,
                step_timeout_ms: self.step_timeout_ms,
                command: match self.config.priority {
                    Some(priority) => format!("{command} --priority={priority}"),
                    None => command,
                },
            }
        };
        Tickets {
            peers: processes.external.iter().map(ticket).collect(),
        }
    }
}

/// Arguments of a process; paths need not be UTF-8.
#[derive(Clone, Default)]
struct ArgList(Vec<OsString>);

impl ArgList {
    fn option(&mut self, name: &str, value: impl Into<OsString>) -> &mut Self {
        self.0.extend([name.into(), value.into()]);
        self
    }

    fn plain(&mut self, word: impl Into<OsString>) {
        self.0.push(word.into());
    }
}

/// The command that starts our own program in that place. It waits as long as the plant does for all peers to join.
pub fn invitation(role: SeatRole, link: &str, run_id: u64, join_timeout_ms: u64, step_timeout_ms: u64) -> String {
    format!(
        "rotortwin {} --link {link} --run-id {run_id:016x} --join-timeout {join_timeout_ms} --step-timeout {step_timeout_ms}",
        role.as_str()
    )
}
