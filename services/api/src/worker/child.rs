//! A process that does a job: its limits, its events, signs of life to the database, its end.
//!
//! A job reads what strangers have written. Its process, and each that it starts, may take so much memory, processor time and disk and no
//! more: what a file makes of itself costs this one job. It gets none of our secrets.

use super::{LEASE, Workshop};
use crate::jobs::Job;
use rustix::process::{Pid, Resource, Rlimit, Signal, kill_process, kill_process_group, prlimit};
use serde_json::Value;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, Command};
use tokio::time::Instant;

/// Signs of life, and looks for a wish to cancel.
const HEARTBEAT: Duration = Duration::from_millis(250);
/// A process that was asked to end may take this long before it is killed.
const GRACE: Duration = Duration::from_millis(900);
/// An event is tried to be written so long.
const EVENT_PATIENCE: Duration = Duration::from_secs(10);
/// Between two live samples that servers in other processes are told.
const LIVE_NOTICE: Duration = Duration::from_millis(100);
/// Events of a part that the whole has, too: a case of a bench is done.
const TOLD_TO_WHOLE: &[&str] = &["case"];
/// What a process may say that is no event, bytes.
const MOST_WORDS: usize = 64 << 20;

/// No file that a job writes is longer, bytes.
pub(super) const LARGEST_FILE: u64 = 64 << 30;
/// What a thread of the standard library says last when there is no memory.
const NO_MEMORY: &str = "memory allocation of";
/// How the names of variables begin that hold passwords, keys and tokens of this process, or of where it sends things.
const SECRETS: &[&str] = &[
    "DATABASE_URL",
    "PG",
    "AWS_",
    "OTEL_",
    "ROTORTWIN_TOKEN",
    "ROTORTWIN_RAY_TOKEN",
    "ROTORTWIN_PART_",
    "ROTORTWIN_ARTIFACTS",
];

/// What the process of a job may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Limits {
    /// Memory of its own, bytes; each process that it starts may take as much.
    pub(super) memory: u64,
    /// Processor time, s.
    pub(super) cpu_s: u64,
}

impl Limits {
    pub(super) fn of(shop: &Workshop, job: &Job) -> Self {
        // So long on each of its threads: it ends even where nobody is left to look at a clock.
        let wall_s = u64::try_from(job.new.wall_limit_ms / 1000).unwrap_or(0) + 1;
        Self {
            memory: shop.job_memory,
            cpu_s: wall_s.saturating_mul(shop.threads as u64 + 2),
        }
    }

    /// Puts a process within them.
    pub(super) fn hold(self, child: &Child) -> std::io::Result<()> {
        self.hold_process(child.id().unwrap_or(0))
    }

    /// As [`hold`](Self::hold), by its id.
    pub(super) fn hold_process(self, id: u32) -> std::io::Result<()> {
        let pid = Pid::from_raw(id.cast_signed());
        for (resource, most) in [
            // Not the address space, of which shared memory and stacks take much without using it.
            (Resource::Data, self.memory),
            (Resource::Cpu, self.cpu_s),
            (Resource::Fsize, LARGEST_FILE),
            (Resource::Core, 0),
        ] {
            let limit = Rlimit {
                current: Some(most),
                // At the harder limit of the processor time there is no signal that says why.
                maximum: Some(if resource == Resource::Cpu { most + 5 } else { most }),
            };
            // Its death is seen elsewhere.
            match pid.map(|pid| prlimit(Some(pid), resource, limit)) {
                Some(Err(error)) if error != rustix::io::Errno::SRCH => return Err(error.into()),
                _ => {}
            }
        }
        Ok(())
    }
}

/// Takes out of a command's environment what only this process needs to know.
pub(super) fn without_secrets(command: &mut Command) {
    for (name, _) in std::env::vars_os() {
        if name
            .to_str()
            .is_some_and(|name| SECRETS.iter().any(|start| name.starts_with(start)))
        {
            command.env_remove(name);
        }
    }
}

/// The limit that ended a process, as a sentence; another try would end alike.
pub(super) fn limit_reached(shop: &Workshop, status: Option<ExitStatus>, complaints: &Path) -> Option<String> {
    let said = std::fs::read_to_string(complaints).unwrap_or_default();
    limit_of(status?, &said, shop.job_memory)
}

/// As [`limit_reached`], of a process that had `memory` bytes and `said` this.
pub(super) fn limit_of(status: ExitStatus, said: &str, memory: u64) -> Option<String> {
    let signal = status.signal()?;
    if signal == Signal::XCPU.as_raw() {
        return Some("it took more processor time than a job may".to_owned());
    }
    if signal == Signal::XFSZ.as_raw() {
        return Some(format!("it wrote a file of more than {} GiB", LARGEST_FILE >> 30));
    }
    (signal == Signal::ABORT.as_raw() && said.contains(NO_MEMORY)).then(|| {
        format!(
            "it needs more than the {} MB of memory that a job may take (`--job-memory`)",
            memory / 1_000_000
        )
    })
}

/// Why a process ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reason {
    /// By itself.
    Itself,
    /// Somebody wanted the job stopped.
    Canceled,
    /// It took too long.
    TooLong,
    /// The claim is somebody else's.
    Lost,
    /// This process ends.
    WorkerEnds,
}

/// How a process ended.
pub(super) struct End {
    pub(super) reason: Reason,
    pub(super) status: Option<ExitStatus>,
    /// What it said beside its events.
    pub(super) words: String,
}

/// What is to be done with an event before it is written down.
pub(super) trait Listener {
    async fn event(&mut self, kind: &str, event: &Value);
}

/// For a process that says nothing special.
pub(super) struct Everything;

impl Listener for Everything {
    async fn event(&mut self, _: &str, _: &Value) {}
}

/// Starts a process in a group of its own, within its limits, with its complaints in a file.
pub(super) fn start(mut command: Command, limits: Limits, complaints: &Path) -> std::io::Result<Child> {
    without_secrets(&mut command);
    let child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(std::fs::File::create(complaints)?)
        .process_group(0)
        .kill_on_drop(true)
        .spawn()?;
    limits.hold(&child)?;
    Ok(child)
}

/// Reads a process until it has ended, and ends it if somebody wants that.
pub(super) async fn watch(
    shop: &Workshop,
    job: &Job,
    token: &str,
    mut child: Child,
    listener: &mut impl Listener,
) -> End {
    let mut end = End {
        reason: Reason::Itself,
        status: None,
        words: String::new(),
    };
    let Some(stdout) = child.stdout.take() else {
        return end;
    };
    // Open until this ends: the process takes its closing for our death.
    let _stdin = child.stdin.take();
    let mut lines = BufReader::new(stdout).lines();
    let mut heartbeat = tokio::time::interval(HEARTBEAT);
    let mut ending = shop.ending.subscribe();
    let limit = Duration::from_millis(u64::try_from(job.new.wall_limit_ms).unwrap_or(0));
    let (mut kill_at, begun, mut told) = (None::<Instant>, Instant::now(), Instant::now());
    loop {
        shop.pulse.beat();
        tokio::select! {
            line = lines.next_line() => match line {
                Ok(Some(line)) if shop.database.hub.live.take(&job.id, &line) => {
                    if shop.database.is_shared() && told.elapsed() >= LIVE_NOTICE {
                        told = Instant::now();
                        shop.database.tell_live(&job.id, &line).await;
                    }
                }
                Ok(Some(line)) => {
                    let event = serde_json::from_str::<Value>(&line).ok();
                    let kind = event.as_ref().and_then(|event| event.get("event")).and_then(Value::as_str);
                    match (kind, &event) {
                        (Some(kind), Some(event)) => {
                            listener.event(kind, event).await;
                            let claim_holds = write_event(shop, job, token, kind, &line).await;
                            end.reason = if claim_holds { end.reason } else { Reason::Lost };
                        }
                        _ if end.words.len() + line.len() < MOST_WORDS => {
                            end.words.push_str(&line);
                            end.words.push('\n');
                        }
                        _ => {}
                    }
                }
                Ok(None) | Err(_) => break,
            },
            _ = heartbeat.tick() => match shop.database.heartbeat(&job.id, token, LEASE).await {
                Ok(Some(true)) if end.reason == Reason::Itself => end.reason = Reason::Canceled,
                Ok(Some(_)) => {}
                Ok(None) => end.reason = Reason::Lost,
                Err(error) => tracing::error!(job = job.id, %error, "a sign of life cannot be written"),
            },
            _ = ending.changed() => {}
        }
        if end.reason == Reason::Itself && *ending.borrow() {
            end.reason = Reason::WorkerEnds;
        }
        if end.reason == Reason::Itself && begun.elapsed() > limit {
            end.reason = Reason::TooLong;
        }
        if end.reason != Reason::Itself {
            let now = Instant::now();
            match kill_at {
                None => {
                    signal(&child, Signal::TERM, false);
                    kill_at = Some(now + GRACE);
                }
                Some(at) if now >= at => signal(&child, Signal::KILL, true),
                Some(_) => {}
            }
        }
    }
    shop.database.hub.live.end(&job.id);
    match child.wait().await {
        Ok(status) => end.status = Some(status),
        Err(error) => tracing::error!(job = job.id, %error, "a process cannot be waited for"),
    }
    end
}

/// `false`: the claim is lost. A database that is away for a moment costs no event.
async fn write_event(shop: &Workshop, job: &Job, token: &str, kind: &str, line: &str) -> bool {
    let begun = Instant::now();
    loop {
        match shop.database.event(&job.id, token, kind, line).await {
            Ok(held) => {
                tell_whole(shop, job, token, kind, line).await;
                return held;
            }
            Err(error) if begun.elapsed() < EVENT_PATIENCE => {
                tracing::warn!(job = job.id, %error, "an event cannot be written; trying again");
                tokio::time::sleep(Duration::from_millis(250)).await;
            }
            Err(error) => {
                tracing::error!(job = job.id, %error, "an event cannot be written");
                return true;
            }
        }
    }
}

/// Shows the progress of a part to whoever watches the whole. One that cannot be written costs nothing but that.
pub(super) async fn tell_whole(shop: &Workshop, job: &Job, token: &str, kind: &str, line: &str) {
    let Some(whole) = job.part_of.as_deref().filter(|_| TOLD_TO_WHOLE.contains(&kind)) else {
        return;
    };
    let told = shop.database.event_of_whole(&job.id, token, whole, kind, line).await;
    if let Err(error) = told {
        tracing::warn!(job = whole, %error, "the progress of a part cannot be written");
    }
}

/// To the process, or to its whole group.
pub(super) fn signal(child: &Child, signal: Signal, group: bool) {
    let Some(pid) = child.id().and_then(|id| Pid::from_raw(id.cast_signed())) else {
        return;
    };
    let sent = if group {
        kill_process_group(pid, signal)
    } else {
        kill_process(pid, signal)
    };
    if let Err(error) = sent {
        tracing::debug!(%error, "the process has ended already");
    }
}

/// The last line of a file of complaints.
pub(super) fn last_words(complaints: &Path) -> String {
    last_line(&std::fs::read_to_string(complaints).unwrap_or_default())
}

/// The last line that says something.
pub(super) fn last_line(text: &str) -> String {
    text.lines()
        .rev()
        .find(|line| !line.trim().is_empty())
        .unwrap_or("it said nothing")
        .chars()
        .take(500)
        .collect()
}
