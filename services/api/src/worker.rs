//! Workers: each takes one run at a time from the queue and flies it in processes of its own, `rotortwin fly`, which start plant,
//! controller and FDI engine.
//!
//! ```text
//!  queue ──claim──▶ worker ──spawns──▶ rotortwin fly ──spawns──▶ sim, controller, fdi
//!                     │ ◀── events, a JSON line each ──┘
//!                     └──▶ events, outcome (with the claim's token) ──▶ database
//! ```
//! * Each attempt has a folder of its own, so that a worker that was presumed dead cannot overwrite another's files.
//! * The flight ends when its standard input closes: no process outlives a server that was killed.
//! * A flight that leaves no summary, or blames one of our own processes, is tried again, [`ATTEMPTS`] times in all. The same seed gives
//!   the same bits, so a second execution is harmless.

use crate::App;
use crate::data_folder::DataFolder;
use crate::store::{Outcome, RunRow, RunStatus};
use rotortwin_store::summary::{Status, Summary, load_summary};
use rustix::process::{Pid, Signal, kill_process, kill_process_group};
use std::path::Path;
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, Command};
use tokio::time::Instant;

/// How long a claim holds without a sign of life.
pub(crate) const LEASE: Duration = Duration::from_secs(15);
/// Signs of life, and looks for a wish to cancel.
const HEARTBEAT: Duration = Duration::from_millis(250);
/// How often a run is begun before it counts as failed.
const ATTEMPTS: i64 = 3;
/// A flight that was asked to end may take this long before it is killed.
const GRACE: Duration = Duration::from_millis(900);
/// Live samples a second of simulated time; the flight itself bounds what comes a second of wall clock.
const LIVE_HZ: &str = "100";
/// No flight may take longer than this in wall time.
const LONGEST: Duration = Duration::from_secs(6 * 3600);

/// Flies runs until the server ends.
pub(crate) async fn work(app: Arc<App>) {
    let mut ending = app.ending.subscribe();
    loop {
        if *ending.borrow() {
            return;
        }
        let claimed = app.store.claim(LEASE).await;
        match claimed {
            Ok(Some((run, token))) => {
                app.hub.wake(&run.id);
                fly_claimed(&app, &run, &token).await;
                app.hub.end_live(&run.id);
                app.hub.wake(&run.id);
                continue;
            }
            Ok(None) => {}
            Err(error) => tracing::error!(%error, "a worker cannot read the queue"),
        }
        tokio::select! {
            () = app.hub.queue.notified() => {}
            _ = ending.changed() => {}
            () = tokio::time::sleep(Duration::from_secs(2)) => {}
        }
    }
}

/// Queues again what workers have left that say nothing any more.
pub(crate) async fn look_after_claims(app: Arc<App>) {
    let mut ending = app.ending.subscribe();
    while !*ending.borrow() {
        match app.store.requeue_abandoned(crate::clock::now_ms()).await {
            Ok(ids) => {
                for id in ids {
                    tracing::warn!(run = id, "its worker is gone: queued again");
                    app.hub.wake(&id);
                    app.hub.queue.notify_one();
                }
            }
            Err(error) => tracing::error!(%error, "abandoned runs cannot be looked for"),
        }
        tokio::select! {
            _ = ending.changed() => {}
            () = tokio::time::sleep(LEASE / 3) => {}
        }
    }
}

async fn fly_claimed(app: &App, run: &RunRow, token: &str) {
    let written = match fly(app, run, token).await {
        Ended::Lost => {
            tracing::warn!(run = run.id, "another worker has this run: its result counts");
            return;
        }
        Ended::Requeue(why) if run.attempts < ATTEMPTS => app.store.release(&run.id, token, &why).await,
        Ended::Requeue(why) => {
            let outcome = Outcome {
                status: RunStatus::Failed,
                folder: DataFolder::attempt(&run.id, run.attempts),
                run_hash: None,
                error: Some(format!("{why} ({} attempts)", run.attempts)),
                summary: None,
            };
            app.store.finish(&run.id, token, &outcome).await
        }
        Ended::ServerEnds => app.store.release(&run.id, token, "the server was stopped").await,
        Ended::Outcome(outcome) => app.store.finish(&run.id, token, &outcome).await,
    };
    match written {
        Ok(true) => {}
        Ok(false) => tracing::warn!(run = run.id, "another worker has this run: its result counts"),
        // The claim runs out and the run is flown again: nothing is lost.
        Err(error) => {
            tracing::error!(run = run.id, %error, "the end of a run cannot be written; it will be flown again")
        }
    }
    app.hub.queue.notify_one();
}

enum Ended {
    Outcome(Outcome),
    /// Nobody is to blame but us: try again.
    Requeue(String),
    /// The claim is somebody else's now.
    Lost,
    ServerEnds,
}

/// Flies one attempt.
async fn fly(app: &App, run: &RunRow, token: &str) -> Ended {
    let relative = DataFolder::attempt(&run.id, run.attempts);
    let folder = app.folder.path().join(&relative);
    let mut child = match start(app, run, &folder) {
        Ok(child) => child,
        Err(error) => return Ended::Requeue(format!("the flight could not be started: {error}")),
    };
    let reason = watch(app, run, token, &mut child).await;
    match reason {
        Reason::Lost => return Ended::Lost,
        Reason::ServerEnds => return Ended::ServerEnds,
        Reason::Itself | Reason::Canceled | Reason::TooLong => {}
    }
    let Ok(summary) = load_summary(&folder) else {
        let text = match reason {
            Reason::Canceled => {
                return Ended::Outcome(Outcome {
                    status: RunStatus::Canceled,
                    folder: relative,
                    run_hash: None,
                    error: Some("canceled before it had flown".to_owned()),
                    summary: None,
                });
            }
            Reason::TooLong => format!(
                "it flew longer than {} h of wall time and was killed",
                LONGEST.as_secs() / 3600
            ),
            _ => last_words(&folder),
        };
        return Ended::Requeue(format!("the flight ended without a result: {text}"));
    };
    if let (Status::Failed, Some(failure)) = (summary.status, &summary.failure)
        && run.attempts < ATTEMPTS
        && matches!(failure.peer.as_str(), "controller" | "fdi" | "plant")
        && failure.silence_ms > 0
    {
        return Ended::Requeue(failure.sentence.clone());
    }
    Ended::Outcome(outcome(&summary, relative))
}

fn outcome(summary: &Summary, folder: String) -> Outcome {
    let status = match summary.status {
        Status::Done => RunStatus::Done,
        Status::Failed => RunStatus::Failed,
        Status::Canceled => RunStatus::Canceled,
    };
    Outcome {
        status,
        folder,
        run_hash: Some(summary.run_hash.clone()).filter(|_| status == RunStatus::Done),
        error: summary.failure.as_ref().map(|failure| failure.sentence.clone()),
        summary: Some(summary.to_json()),
    }
}

fn start(app: &App, run: &RunRow, folder: &Path) -> std::io::Result<Child> {
    // A folder of this attempt can only be there if the server was killed between making it and claiming; nobody else writes there.
    if folder.exists() {
        std::fs::remove_dir_all(folder)?;
    }
    let parent = folder.parent().unwrap_or(folder);
    std::fs::create_dir_all(parent)?;
    let documents = parent.join(format!("documents-{}.toml", run.attempts));
    std::fs::write(&documents, &run.documents)?;
    let words = std::fs::File::create(parent.join(format!("fly-{}.log", run.attempts)))?;
    Command::new(&app.config.program)
        .args(["fly", "--documents", "--events", "--live", LIVE_HZ])
        .args([
            "--seed",
            &run.seed.to_string(),
            "--link",
            &run.link,
            "--pace",
            &run.pace,
        ])
        .arg("--out")
        .arg(folder)
        .arg("--")
        .arg(&documents)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(words)
        .process_group(0)
        .kill_on_drop(true)
        .spawn()
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Reason {
    Itself,
    Canceled,
    TooLong,
    Lost,
    ServerEnds,
}

/// Reads the events of a flight until it has ended, and ends it if somebody wants that.
async fn watch(app: &App, run: &RunRow, token: &str, child: &mut Child) -> Reason {
    let Some(stdout) = child.stdout.take() else {
        return Reason::Itself;
    };
    // Open until this ends: the flight takes its closing for our death.
    let _stdin = child.stdin.take();
    let mut lines = BufReader::new(stdout).lines();
    let mut heartbeat = tokio::time::interval(HEARTBEAT);
    let mut ending = app.ending.subscribe();
    let (mut reason, mut kill_at, start) = (Reason::Itself, None::<Instant>, Instant::now());
    loop {
        tokio::select! {
            line = lines.next_line() => match line {
                Ok(Some(line)) if app.hub.take_live(&run.id, &line) => {}
                Ok(Some(line)) => {
                    let Ok(value) = serde_json::from_str::<serde_json::Value>(&line) else { continue };
                    let kind = value.get("event").and_then(serde_json::Value::as_str).unwrap_or("message").to_owned();
                    match app.store.event(&run.id, token, &kind, &line).await {
                        Ok(true) => app.hub.wake(&run.id),
                        Ok(false) => reason = Reason::Lost,
                        Err(error) => tracing::error!(run = run.id, %error, "an event cannot be written"),
                    }
                }
                Ok(None) | Err(_) => break,
            },
            _ = heartbeat.tick() => match app.store.heartbeat(&run.id, token, LEASE).await {
                Ok(Some(true)) if reason == Reason::Itself => reason = Reason::Canceled,
                Ok(Some(_)) => {}
                Ok(None) => reason = Reason::Lost,
                Err(error) => tracing::error!(run = run.id, %error, "a sign of life cannot be written"),
            },
            _ = ending.changed() => {}
        }
        if reason == Reason::Itself && *ending.borrow() {
            reason = Reason::ServerEnds;
        }
        if reason == Reason::Itself && start.elapsed() > LONGEST {
            reason = Reason::TooLong;
        }
        if reason != Reason::Itself {
            let now = Instant::now();
            match kill_at {
                None => {
                    signal(child, Signal::TERM, false);
                    kill_at = Some(now + GRACE);
                }
                Some(at) if now >= at => signal(child, Signal::KILL, true),
                Some(_) => {}
            }
        }
    }
    if let Err(error) = child.wait().await {
        tracing::error!(run = run.id, %error, "a flight cannot be waited for");
    }
    reason
}

/// To the flight's first process, or to its whole group.
fn signal(child: &Child, signal: Signal, group: bool) {
    let Some(pid) = child.id().and_then(|id| Pid::from_raw(id.cast_signed())) else {
        return;
    };
    let sent = if group {
        kill_process_group(pid, signal)
    } else {
        kill_process(pid, signal)
    };
    if let Err(error) = sent {
        tracing::debug!(%error, "the flight has ended already");
    }
}

/// The last line that a flight wrote to its log.
fn last_words(folder: &Path) -> String {
    let attempt = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let log = folder.with_file_name(format!("fly-{attempt}.log"));
    let text = std::fs::read_to_string(log).unwrap_or_default();
    text.lines()
        .rev()
        .find(|line| !line.trim().is_empty())
        .unwrap_or("it said nothing")
        .chars()
        .take(500)
        .collect()
}
