//! Starts the processes of a run, watches them, and cleans up.
//!
//! ```text
//!  rotortwin fly ── spawns ──▶ sim, controller, fdi
//!        ◀── events, one JSON line each, on the plant's standard output
//! ```
//! Who notices and records which failure:
//!
//! | What dies or stalls | Noticed by | Recorded by |
//! |---|---|---|
//! | controller, FDI engine | the plant, by its link | the plant |
//! | a peer before it has joined | the supervisor, by the child's exit | the plant, informed by the supervisor |
//! | the plant | the supervisor, by the child's exit or its silence; its peers, by their link | the supervisor |
//! | the supervisor | the plant, by the end of its standard input; the kernel ends the peers | the plant |
//!
//! Children run in their own process group, so that Ctrl-C reaches the supervisor alone; it then asks the plant to end the run in an
//! orderly way. Whatever remains after [`GRACE`] is killed.

use crate::placement::Placement;
use crate::supervisor::{StopRequest, request_line};
use anyhow::{Context, Result};
use rotortwin_wire::events::RunEvent;
use std::ffi::OsString;
use std::fs::File;
use std::io::{BufRead, BufReader, Write as _};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Time for the other processes to exit by themselves once one of them has.
const GRACE: Duration = Duration::from_millis(800);

/// Polling interval of the children while no event arrives.
const POLL: Duration = Duration::from_millis(20);

/// Time for the plant's word that all have joined to arrive, when a process is found to have ended and the plant has not said so.
const NEWS_ON_ITS_WAY: Duration = Duration::from_millis(100);

/// One process to start.
pub struct Part {
    /// `sim`, `controller` or `fdi`: the subcommand, and the name of its log.
    pub name: &'static str,
    /// Arguments after the subcommand.
    pub args: Vec<OsString>,
}

/// How the processes ended.
#[derive(Debug)]
pub struct Ending {
    /// How the plant ended.
    plant: ExitStatus,
    /// Process id of the plant.
    plant_pid: u32,
    /// It was unresponsive for this long and was killed.
    stalled: Option<Duration>,
    /// Time from the plant's last sign of life to the detection of its end.
    pub plant_silence: Duration,
    /// Last complete step reported by the plant.
    pub last_step: Option<u64>,
}

impl Ending {
    /// How the plant ended, without a full stop.
    pub fn plant_text(&self) -> String {
        let plant = format!("the plant (rotortwin sim, process {})", self.plant_pid);
        match self.stalled {
            Some(limit) => format!(
                "{plant} did not respond for more than {} ms and was killed",
                limit.as_millis()
            ),
            None => format!("{plant} {}", exit_text(self.plant)),
        }
    }
}

/// Runs the processes of one run until all have ended. `on_event` receives every event of the plant.
///
/// * `log_dir`: receives one log per process
/// * `silence_limit`: a plant that is unresponsive for this long during the flight is killed
/// * `placement`: processors to run on
///
/// The first part is the plant.
pub fn run(
    parts: &[Part],
    log_dir: &Path,
    silence_limit: Duration,
    placement: &mut Placement,
    mut on_event: impl FnMut(&RunEvent),
) -> Result<Ending> {
    let interrupted = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&interrupted)).context("registering for Ctrl-C")?;
    }
    let (mut plant, mut peers) = placement.start(|| -> Result<_> {
        let plant = Process::spawn(&parts[0], log_dir, true)?;
        let peers: Result<Vec<_>> = parts[1..]
            .iter()
            .map(|part| Process::spawn(part, log_dir, false))
            .collect();
        Ok((plant, peers?))
    })?;
    let pids: Vec<u32> = std::iter::once(&plant)
        .chain(&peers)
        .map(|part| part.child.id())
        .collect();
    let events = read_events(&mut plant.child)?;
    let plant_pid = plant.child.id();
    let mut flight = FlightWatch::new(plant_pid);
    let mut asked = false;
    let mut stalled = None;
    let mut found_ended: Option<Instant> = None;

    let plant_status = loop {
        match events.recv_timeout(POLL) {
            Ok(event) => {
                flight.hear(&event);
                if matches!(event, RunEvent::Recording { .. }) {
                    placement.release(&pids);
                }
                on_event(&event);
            }
            Err(RecvTimeoutError::Timeout) => {}
            // The pipe closes a moment before the process can be reaped.
            Err(RecvTimeoutError::Disconnected) => std::thread::sleep(Duration::from_millis(1)),
        }
        if let Some(status) = plant.child.try_wait().context("waiting for the plant")? {
            break status;
        }
        if flight.stage == Stage::Flight {
            placement.review(&pids);
        }
        let request = if interrupted.load(Ordering::Relaxed) {
            Some(StopRequest::Cancel)
        } else if flight.stage == Stage::Join {
            let ended = find_early_end(&mut peers)?;
            // It may have joined, and the plant's word of that be on its way.
            ended.filter(|_| found_ended.get_or_insert_with(Instant::now).elapsed() >= NEWS_ON_ITS_WAY)
        } else {
            // The plant notices the death of a peer itself.
            None
        };
        if let Some(request) = request
            && !std::mem::replace(&mut asked, true)
        {
            plant.request(&request);
        }
        let limit = flight.limit(silence_limit, asked);
        if flight.silence() > limit {
            stalled = Some(limit);
            plant
                .child
                .kill()
                .context("killing the plant, which does not respond")?;
            break plant.child.wait().context("waiting for the plant")?;
        }
    };
    let plant_silence = flight.last_sign.elapsed();
    // Its last events may still be in the pipe.
    while let Ok(event) = events.recv_timeout(POLL) {
        flight.hear(&event);
        on_event(&event);
    }
    // Before the flight there is nothing to shut down in order.
    end_peers(
        &mut peers,
        if flight.stage == Stage::Join {
            Duration::ZERO
        } else {
            GRACE
        },
    );
    Ok(Ending {
        plant: plant_status,
        plant_pid,
        stalled,
        plant_silence,
        last_step: flight.last_step,
    })
}

/// Stage of the run, as reported by the plant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Waiting for the peers.
    Join,
    /// In flight.
    Flight,
    /// The folder is being written; no events meanwhile.
    Recording,
}

/// Monitors the plant for signs of life.
struct FlightWatch {
    pid: u32,
    stage: Stage,
    last_step: Option<u64>,
    last_sign: Instant,
    /// Kernel counters at the last check.
    noted: Option<Vec<String>>,
}

impl FlightWatch {
    fn new(pid: u32) -> Self {
        Self {
            pid,
            stage: Stage::Join,
            last_step: None,
            last_sign: Instant::now(),
            noted: None,
        }
    }

    fn hear(&mut self, event: &RunEvent) {
        self.last_sign = Instant::now();
        match event {
            RunEvent::Waiting => {}
            RunEvent::Progress(progress) => {
                self.stage = Stage::Flight;
                self.last_step = progress.step.checked_sub(1);
            }
            RunEvent::Change(_) | RunEvent::Sample(_) => self.stage = Stage::Flight,
            RunEvent::Recording { steps } => {
                self.stage = Stage::Recording;
                self.last_step = steps.checked_sub(1);
            }
            RunEvent::Finished => self.stage = Stage::Recording,
        }
    }

    /// Time since the last sign of life. With a slow peer there may be no event for long; it then counts whether the plant has run at
    /// all: it polls at least 20 times a second.
    fn silence(&mut self) -> Duration {
        const ASK_THE_KERNEL_AFTER: Duration = Duration::from_millis(200);
        let silence = self.last_sign.elapsed();
        if silence < ASK_THE_KERNEL_AFTER {
            return silence;
        }
        // Processor time and context-switch counts: unchanged only if it has not run since.
        let read = |file: &str| std::fs::read_to_string(format!("/proc/{}/{file}", self.pid));
        let noted = read("stat").and_then(|stat| Ok(ran(&stat, &read("status")?))).ok();
        if noted.is_none() || noted != self.noted {
            self.noted = noted;
            self.last_sign = Instant::now();
        }
        self.last_sign.elapsed()
    }

    /// Maximum silence allowed now; shorter once the plant was asked to stop.
    fn limit(&self, in_flight: Duration, asked: bool) -> Duration {
        match self.stage {
            Stage::Recording => in_flight.max(Duration::from_secs(60)),
            Stage::Flight if asked => in_flight.min(GRACE),
            Stage::Flight => in_flight,
            // Opening a link may block for some seconds.
            Stage::Join => in_flight.max(Duration::from_secs(10)),
        }
    }
}

/// Evidence that a process has run: its processor time in `/proc/PID/stat`, and its context-switch counts in `/proc/PID/status`.
/// All other fields there may change while it is stopped: its memory when the kernel reclaims pages, and `SigQ` whenever any process of
/// the same user gets a signal.
fn ran(stat: &str, status: &str) -> Vec<String> {
    // The name in brackets may contain anything, including brackets; after it, state is the first field, utime and stime are 12 and 13.
    let fields = stat
        .rsplit_once(')')
        .map_or("", |(_, rest)| rest)
        .split_ascii_whitespace();
    let switches = status.lines().filter(|line| line.contains("voluntary_ctxt_switches"));
    fields.skip(11).take(2).chain(switches).map(str::to_owned).collect()
}

/// One child.
struct Process {
    name: &'static str,
    child: Child,
    log: PathBuf,
}

impl Process {
    fn spawn(part: &Part, log_dir: &Path, is_plant: bool) -> Result<Self> {
        let log = log_dir.join(format!("{}.log", part.name));
        let log_file = File::create(&log).with_context(|| format!("creating {}", log.display()))?;
        let mut command = Command::new(own_program()?);
        command.arg(part.name).stderr(log_file).process_group(0);
        if is_plant {
            command.arg("--supervised").stdin(Stdio::piped()).stdout(Stdio::piped());
        } else {
            command
                .args(["--supervisor-pid", &std::process::id().to_string()])
                .stdin(Stdio::null())
                .stdout(Stdio::null());
        }
        command.args(&part.args);
        let child = command
            .spawn()
            .with_context(|| format!("starting the {} process", part.name))?;
        Ok(Self {
            name: part.name,
            child,
            log,
        })
    }

    fn has_ended(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(Some(_)))
    }

    /// Asks the plant to stop; the first request counts.
    fn request(&mut self, request: &StopRequest) {
        let Some(line) = request_line(request) else { return };
        // Borrowed, not closed: the end of the pipe would mean that this process is dead.
        if let Some(stdin) = self.child.stdin.as_mut()
            && let Err(error) = stdin.write_all(line.as_bytes())
        {
            tracing::debug!(%error, "the plant no longer accepts requests");
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if !self.has_ended()
            && let Err(error) = self.child.kill().and_then(|()| self.child.wait().map(|_| ()))
        {
            tracing::warn!(name = self.name, %error, "could not end the process");
        }
    }
}

/// The program file of this process. If it has been replaced since, the kernel's copy of it: all processes of a run are from one
/// build.
fn own_program() -> Result<PathBuf> {
    let path = std::env::current_exe().context("finding the program file of rotortwin")?;
    Ok(if path.exists() { path } else { "/proc/self/exe".into() })
}

/// Events of the plant, read by a thread until its standard output closes.
fn read_events(plant: &mut Child) -> Result<Receiver<RunEvent>> {
    let stdout = plant.stdout.take().context("the plant's standard output is piped")?;
    let (sender, receiver) = channel();
    std::thread::Builder::new()
        .name("plant-events".to_owned())
        .spawn(move || {
            for line in BufReader::new(stdout).lines() {
                let Ok(line) = line else { break };
                match serde_json::from_str(&line) {
                    Ok(event) => {
                        if sender.send(event).is_err() {
                            break;
                        }
                    }
                    Err(error) => tracing::warn!(%line, %error, "the plant printed something that is not an event"),
                }
            }
        })?;
    Ok(receiver)
}

/// Message for the plant about a peer that ended before the run began.
fn find_early_end(peers: &mut [Process]) -> Result<Option<StopRequest>> {
    for peer in peers {
        if let Some(status) = peer
            .child
            .try_wait()
            .with_context(|| format!("waiting for the {}", peer.name))?
        {
            let words = last_line(&peer.log).map(|line| format!(": {line}")).unwrap_or_default();
            return Ok(Some(StopRequest::Fail {
                peer: peer.name.to_owned(),
                sentence: format!(
                    "the {} process {} before it had joined{words}",
                    peer.name,
                    exit_text(status)
                ),
            }));
        }
    }
    Ok(None)
}

/// Gives the peers time to exit by themselves, then kills them.
fn end_peers(peers: &mut Vec<Process>, grace: Duration) {
    let deadline = Instant::now() + grace;
    while !peers.iter_mut().all(Process::has_ended) && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(2));
    }
    // Dropping a process kills it.
    peers.clear();
}

/// "exit code 1" or "killed by signal 9".
fn exit_text(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("ended with exit code {code}"),
        (None, Some(signal)) => format!("was killed by signal {signal}"),
        (None, None) => "ended in an unknown way".to_owned(),
    }
}

/// Last non-empty line of a log.
fn last_line(log: &Path) -> Option<String> {
    let text = std::fs::read_to_string(log).ok()?;
    text.lines()
        .rev()
        .map(str::trim)
        .find(|line| !line.is_empty())
        .map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAT: &str =
        "17 (rotortwin (sim)) T 1 17 17 0 -1 4194304 900 0 3 0 41 7 0 0 20 0 16 0 5000 900000 2100 1 1 0";
    const STATUS: &str = "Name:\trotortwin\nState:\tT (stopped)\nVmRSS:\t8400 kB\nSigQ:\t2/96365\nvoluntary_ctxt_switches:\t120\n\
                          nonvoluntary_ctxt_switches:\t4\n";

    /// `SigQ` counts the signals of all processes of the user: with it, a stopped plant appeared alive while other processes were busy.
    #[test]
    fn regress_only_what_a_process_does_itself_is_a_sign_of_life() {
        let noted = ran(STAT, STATUS);
        assert_eq!(
            noted,
            [
                "41",
                "7",
                "voluntary_ctxt_switches:\t120",
                "nonvoluntary_ctxt_switches:\t4"
            ]
        );
        let elsewhere = STATUS.replace("2/96365", "3/96365").replace("8400 kB", "7000 kB");
        assert_eq!(noted, ran(&STAT.replace(" 2100 ", " 1750 "), &elsewhere));
        for (stat, status) in [
            (STAT.replace(" 41 7 ", " 42 7 "), STATUS.to_owned()),
            (STAT.replace(" 41 7 ", " 41 8 "), STATUS.to_owned()),
            (STAT.to_owned(), STATUS.replace("120", "121")),
            (STAT.to_owned(), STATUS.replace("\t4\n", "\t5\n")),
        ] {
            assert_ne!(noted, ran(&stat, &status));
        }
    }

    #[test]
    fn val_the_kernel_says_of_this_process_what_is_looked_for() {
        let read = |file: &str| std::fs::read_to_string(format!("/proc/self/{file}")).unwrap();
        assert_eq!(ran(&read("stat"), &read("status")).len(), 4);
    }
}
