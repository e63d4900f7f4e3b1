//! The process of a job: its limits, its events, heartbeats to the database, its end.
//!
//! A job reads third-party files. Its process, and each of its children, has limited memory, processor time and disk, so that a malicious
//! file can only break this one job. It gets none of our secrets.

use super::{LEASE, WorkerContext};
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

/// Exit code of a command with bad input: another try would end alike.
pub(super) const BAD_INPUT: i32 = rotortwin_process::EXIT_BAD_INPUT as i32;

/// Interval of heartbeats, and of checks for cancellation.
const HEARTBEAT: Duration = Duration::from_millis(250);
/// Time for a process to exit after a request before it is killed.
const GRACE: Duration = Duration::from_millis(900);
/// How long writing an event is retried.
const EVENT_TIMEOUT: Duration = Duration::from_secs(10);
/// Minimum interval between live samples sent to servers in other processes.
const LIVE_NOTICE: Duration = Duration::from_millis(100);
/// Events of a part also reported for the whole: a completed case of a bench.
const TOLD_TO_WHOLE: &[&str] = &["case"];
/// Maximum output of a process other than events, bytes.
const MOST_WORDS: usize = 64 << 20;

/// Maximum size of a file written by a job, bytes.
pub(super) const LARGEST_FILE: u64 = 64 << 30;
/// The setting of the memory of a job, at the end of the sentence about it.
pub(crate) const MEMORY_OPTION: &str = " (`--job-memory`)";
/// Last message of the standard library when out of memory.
const NO_MEMORY: &str = "memory allocation of";
/// Prefixes of environment variables that contain passwords, keys and tokens of this process or its exporters.
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

/// Limits of a job's process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Limits {
    /// Memory of its own, bytes; each of its children may use as much.
    pub(super) memory: u64,
    /// Processor time, s.
    pub(super) cpu_s: u64,
}

impl Limits {
    pub(super) fn of(context: &WorkerContext, job: &Job) -> Self {
        // Applies to each of its threads: it ends even if no process is left to enforce the wall-clock limit.
        let wall_s = u64::try_from(job.new.wall_limit_ms / 1000).unwrap_or(0) + 1;
        Self {
            memory: context.job_memory,
            cpu_s: wall_s.saturating_mul(context.threads as u64 + 2),
        }
    }

    /// Applies the limits to a process.
    pub(super) fn hold(self, child: &Child) -> std::io::Result<()> {
        self.hold_process(child.id().unwrap_or(0))
    }

    /// As [`hold`](Self::hold), by its id.
    pub(super) fn hold_process(self, id: u32) -> std::io::Result<()> {
        let pid = Pid::from_raw(id.cast_signed());
        for (resource, most) in [
            // Not the address space, of which shared memory and stacks reserve much without using it.
            (Resource::Data, self.memory),
            (Resource::Cpu, self.cpu_s),
            (Resource::Fsize, LARGEST_FILE),
            (Resource::Core, 0),
        ] {
            let limit = Rlimit {
                current: Some(most),
                // At the hard limit of processor time no signal indicates the reason.
                maximum: Some(if resource == Resource::Cpu { most + 5 } else { most }),
            };
            // Its death is noticed elsewhere.
            match pid.map(|pid| prlimit(Some(pid), resource, limit)) {
                Some(Err(error)) if error != rustix::io::Errno::SRCH => return Err(error.into()),
                _ => {}
            }
        }
        Ok(())
    }
}

/// Removes from a command's environment what only this process needs to know.
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

/// The limit that ended a process, as an error message; a retry would fail the same way.
pub(super) fn limit_reached(context: &WorkerContext, status: Option<ExitStatus>, complaints: &Path) -> Option<String> {
    let said = std::fs::read_to_string(complaints).unwrap_or_default();
    limit_of(status?, &said, context.job_memory)
}

/// As [`limit_reached`], for a process with `memory` bytes that `said` this.
pub(super) fn limit_of(status: ExitStatus, said: &str, memory: u64) -> Option<String> {
    let signal = status.signal()?;
    if signal == Signal::XCPU.as_raw() {
        return Some("the job exceeded its limit of processor time".to_owned());
    }
    if signal == Signal::XFSZ.as_raw() {
        return Some(format!("the job wrote a file of more than {} GiB", LARGEST_FILE >> 30));
    }
    (signal == Signal::ABORT.as_raw() && said.contains(NO_MEMORY)).then(|| {
        format!(
            "the job needs more than the {} MB of memory allowed{MEMORY_OPTION}",
            memory / 1_000_000
        )
    })
}

/// Why a process ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reason {
    /// By itself.
    Itself,
    /// Cancellation was requested.
    Canceled,
    /// It took too long.
    TooLong,
    /// The claim was lost.
    Lost,
    /// This process is shutting down.
    WorkerEnds,
}

/// How a process ended.
pub(super) struct End {
    pub(super) reason: Reason,
    pub(super) status: Option<ExitStatus>,
    /// Its output other than events.
    pub(super) words: String,
}

/// Handles an event before it is stored.
pub(super) trait Listener {
    async fn event(&mut self, kind: &str, event: &Value);
}

/// For a process without special events.
pub(super) struct Everything;

impl Listener for Everything {
    async fn event(&mut self, _: &str, _: &Value) {}
}

/// Starts a process in its own group, within its limits, with standard error in a file.
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

/// Reads a process's output until it has ended, and ends it on request.
pub(super) async fn watch(
    context: &WorkerContext,
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
    // Kept open until this ends: the process treats its closing as our death.
    let _stdin = child.stdin.take();
    let mut lines = BufReader::new(stdout).lines();
    let mut heartbeat = tokio::time::interval(HEARTBEAT);
    let mut ending = context.ending.subscribe();
    let limit = Duration::from_millis(u64::try_from(job.new.wall_limit_ms).unwrap_or(0));
    let (mut kill_at, begun, mut told) = (None::<Instant>, Instant::now(), Instant::now());
    loop {
        context.pulse.beat();
        tokio::select! {
            line = lines.next_line() => match line {
                Ok(Some(line)) if context.database.hub.live.take(&job.id, &line) => {
                    if context.database.is_shared() && told.elapsed() >= LIVE_NOTICE {
                        told = Instant::now();
                        context.database.tell_live(&job.id, &line).await;
                    }
                }
                Ok(Some(line)) => {
                    let event = serde_json::from_str::<Value>(&line).ok();
                    let kind = event.as_ref().and_then(|event| event.get("event")).and_then(Value::as_str);
                    match (kind, &event) {
                        (Some(kind), Some(event)) => {
                            listener.event(kind, event).await;
                            let claim_holds = write_event(context, job, token, kind, &line).await;
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
            _ = heartbeat.tick() => match context.database.heartbeat(&job.id, token, LEASE).await {
                Ok(Some(true)) if end.reason == Reason::Itself => end.reason = Reason::Canceled,
                Ok(Some(_)) => {}
                Ok(None) => end.reason = Reason::Lost,
                Err(error) => tracing::error!(job = job.id, %error, "a lease cannot be renewed"),
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
    context.database.hub.live.end(&job.id);
    match child.wait().await {
        Ok(status) => end.status = Some(status),
        Err(error) => tracing::error!(job = job.id, %error, "waiting for a process failed"),
    }
    end
}

/// `false`: the claim is lost. A temporarily unavailable database loses no event.
async fn write_event(context: &WorkerContext, job: &Job, token: &str, kind: &str, line: &str) -> bool {
    let begun = Instant::now();
    loop {
        match context.database.event(&job.id, token, kind, line).await {
            Ok(held) => {
                tell_whole(context, job, token, kind, line).await;
                return held;
            }
            Err(error) if begun.elapsed() < EVENT_TIMEOUT => {
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

/// Shows the progress of a part to watchers of the whole. A failure to write it has no other effect.
pub(super) async fn tell_whole(context: &WorkerContext, job: &Job, token: &str, kind: &str, line: &str) {
    let Some(whole) = job.part_of.as_deref().filter(|_| TOLD_TO_WHOLE.contains(&kind)) else {
        return;
    };
    let told = context.database.event_of_whole(&job.id, token, whole, kind, line).await;
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

/// The last line of an error file.
pub(super) fn last_words(complaints: &Path) -> String {
    last_line(&std::fs::read_to_string(complaints).unwrap_or_default())
}

/// The last non-empty line.
pub(super) fn last_line(text: &str) -> String {
    text.lines()
        .rev()
        .find(|line| !line.trim().is_empty())
        .unwrap_or("it said nothing")
        .chars()
        .take(500)
        .collect()
}
