//! Parts that a Ray cluster does: handed over through Ray's job API, an attempt of a part being a submission.
//!
//! ```text
//!  queue ──claim──▶ slot ──POST /api/jobs/ (submission id = attempt)──▶ Ray ──places──▶ node: `rotortwin part`
//!                    │ ◀── pending, running, failed (a node died) ───────┘                │
//!                    │                                                                    │ ticket
//!  job table ◀──heartbeat──┘      routes/parts ◀── inputs, events, files, end ────────────┘
//! ```
//! * The server looks after an attempt: it holds the claim, asks Ray how the submission stands, and begins another attempt where Ray says that
//!   its node is gone. What comes of it, the node itself delivers to this server ([`super::handed`]).
//! * A server that was killed finds its attempts in the job table, and by their ids in Ray: nothing is flown twice.
//! * A Ray that does not answer costs nothing for [`AWAY`]: the flights go on, and are delivered.

mod client;
mod config;

pub use config::RayConfig;

use super::handed::{self, Ticket};
use super::{ATTEMPTS, ATTEMPTS_OF_DEAD_WORKERS, LEASE, LOOK, Workshop, failed, forget_attempts_before, fresh_folder};
use crate::jobs::queue::Takes;
use crate::jobs::{Job, Outcome, Status};
use client::{Client, RayError, RayJob, RayStatus};
use rotortwin_jobs::part::{CA_VARIABLE, TICKET_VARIABLE, URL_VARIABLE};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;
use tokio::time::Instant;

/// Between two looks at a submission, and at Ray itself.
const ASK: Duration = Duration::from_millis(1500);
/// Signs of life to the database, and looks for a wish to cancel.
const HEARTBEAT: Duration = Duration::from_millis(250);
/// At its start the server waits for Ray so long.
const START: Duration = Duration::from_secs(10);
/// Ray may be away for so long before an attempt is given up.
const AWAY: Duration = Duration::from_secs(600);
/// Ray is asked for the end of a submission for so long.
const STOP: Duration = Duration::from_secs(5);
/// A node whose process has ended well has delivered before; its answer may be under way for so long.
const DELIVERED: Duration = Duration::from_secs(10);
/// A node stops its part at its limit of wall time; after so much more the server does.
const BEYOND_LIMIT: Duration = Duration::from_secs(120);

/// A Ray cluster.
#[derive(Debug)]
pub(crate) struct Ray {
    pub(crate) config: RayConfig,
    client: Client,
    /// PEM.
    ca: Option<String>,
    /// Where its nodes find this server.
    callback: OnceLock<String>,
    state: Mutex<State>,
    pending: AtomicUsize,
    running: AtomicUsize,
}

#[derive(Debug, Clone)]
enum State {
    Up { version: String },
    Away { since: Instant, why: String },
}

/// How an attempt ended, as far as this server sees it.
enum Ended {
    /// For good.
    Outcome(Outcome),
    /// It failed: again, [`ATTEMPTS`] times in all.
    Failed(String),
    /// Ray could not go on with it, through no fault of its own: again.
    Released(String),
    /// Delivered, or somebody else's.
    Gone,
    /// This process ends; whoever comes after it takes the attempt up.
    Left,
}

/// Why nobody looks after an attempt any more.
enum Reason {
    Canceled,
    Gone,
    Left,
}

/// Counts an attempt in one of two states.
struct Counted<'a> {
    ray: &'a Ray,
    running: bool,
}

impl<'a> Counted<'a> {
    fn new(ray: &'a Ray) -> Self {
        ray.pending.fetch_add(1, Ordering::Relaxed);
        Self { ray, running: false }
    }

    fn runs(&mut self, runs: bool) {
        if runs != self.running {
            self.counter().fetch_sub(1, Ordering::Relaxed);
            self.running = runs;
            self.counter().fetch_add(1, Ordering::Relaxed);
        }
    }

    fn counter(&self) -> &'a AtomicUsize {
        if self.running {
            &self.ray.running
        } else {
            &self.ray.pending
        }
    }
}

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        self.counter().fetch_sub(1, Ordering::Relaxed);
    }
}

impl Ray {
    /// Finds the cluster.
    ///
    /// # Errors
    /// One sentence that names Ray and its address.
    pub(crate) async fn open(config: RayConfig) -> Result<Self, String> {
        let client = Client::new(&config)?;
        let ca = match &config.ca {
            None => None,
            Some(path) => Some(
                std::fs::read_to_string(path)
                    .map_err(|error| format!("--ray-ca {}: cannot be read: {error}", path.display()))?,
            ),
        };
        let begun = Instant::now();
        let version = loop {
            match client.version().await {
                Ok(version) => break version,
                Err(RayError::Away(_)) if begun.elapsed() < START => tokio::time::sleep(Duration::from_millis(500)).await,
                Err(RayError::Away(why)) => {
                    return Err(format!(
                        "--executor ray={}: {} did not answer within {} s: {why}; expected the address of its dashboard, such as \
                         http://HEAD:8265",
                        config.url,
                        config.name(),
                        START.as_secs()
                    ));
                }
                Err(RayError::Refused(why)) => {
                    return Err(format!("--executor ray={}: {}: {why}", config.url, config.name()));
                }
            }
        };
        Ok(Self {
            config,
            client,
            ca,
            callback: OnceLock::new(),
            state: Mutex::new(State::Up { version }),
            pending: AtomicUsize::new(0),
            running: AtomicUsize::new(0),
        })
    }

    /// Says where this server listens, for the nodes.
    ///
    /// # Errors
    /// One sentence: nobody else finds it there.
    pub(crate) fn listens(&self, url: &str, everywhere: bool) -> Result<(), String> {
        if self.config.callback.is_none() && everywhere {
            return Err(format!(
                "--executor ray={}: {url} is no address at which Ray's nodes find this server; expected --ray-callback URL, such as \
                 https://bench.example:8443",
                self.config.url
            ));
        }
        let callback = self.config.callback.as_deref().unwrap_or(url).trim_end_matches('/');
        self.callback.get_or_init(|| callback.to_owned());
        Ok(())
    }

    fn state(&self) -> State {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Whether it answered when it was asked last.
    pub(crate) fn is_up(&self) -> bool {
        matches!(self.state(), State::Up { .. })
    }

    /// One line for people.
    pub(crate) fn in_short(&self) -> String {
        let name = self.config.name();
        match self.state() {
            State::Up { version } => format!("{name} (version {version}) answers"),
            State::Away { since, why } => format!(
                "{name} has not answered for {} s: {why}; parts of campaigns and blind benches wait for it",
                since.elapsed().as_secs()
            ),
        }
    }

    /// Parts that wait for a place there, and that are done there, as far as this server looks after them.
    pub(crate) fn parts(&self) -> (usize, usize) {
        (
            self.pending.load(Ordering::Relaxed),
            self.running.load(Ordering::Relaxed),
        )
    }

    /// Of an attempt. The job's id is random enough for clusters that several servers use.
    fn submission(job: &Job) -> String {
        format!("rotortwin-{}-{}", job.id, job.attempts)
    }

    async fn submit(&self, job: &Job, ticket: &Ticket) -> Result<(), RayError> {
        let callback = self.callback.get().map(String::as_str).unwrap_or_default();
        let mut variables = serde_json::json!({
            URL_VARIABLE: format!("{callback}{}", handed::path(job)),
            TICKET_VARIABLE: ticket.secret,
        });
        if let Some(ca) = &self.ca {
            variables[CA_VARIABLE] = ca.as_str().into();
        }
        let program = self.config.program.replace('\'', "'\\''");
        let entrypoint = format!("exec '{program}' part");
        self.client
            .submit(&self.config, &Self::submission(job), &entrypoint, &variables)
            .await
    }

    /// Asks for the end of a submission. That it goes on where Ray is away costs only time: it finds its ticket worth nothing, and ends.
    async fn stop(&self, submission: &str) {
        let asked = async {
            while let Err(error) = self.client.stop(submission).await {
                tracing::warn!(submission, ?error, "a submission cannot be stopped; trying again");
                tokio::time::sleep(Duration::from_millis(500)).await;
            }
        };
        if tokio::time::timeout(STOP, asked).await.is_err() {
            tracing::warn!(submission, "Ray was not told to stop a submission; its node ends it itself");
        }
    }
}

/// Looks whether Ray answers until the process ends.
pub(crate) async fn look_after(shop: Arc<Workshop>, ray: Arc<Ray>) {
    let mut ending = shop.ending.subscribe();
    while !*ending.borrow() {
        let state = match ray.client.version().await {
            Ok(version) => State::Up { version },
            Err(RayError::Away(why) | RayError::Refused(why)) => State::Away {
                since: match ray.state() {
                    State::Away { since, .. } => since,
                    State::Up { .. } => Instant::now(),
                },
                why,
            },
        };
        let was_up = ray.is_up();
        *ray.state.lock().unwrap_or_else(PoisonError::into_inner) = state;
        if was_up != ray.is_up() {
            tracing::warn!("{}", ray.in_short());
            shop.database.hub.queue.notify_waiters();
        }
        tokio::select! {
            _ = ending.changed() => {}
            () = tokio::time::sleep(ASK) => {}
        }
    }
}

/// Hands one part at a time to Ray, and looks after it, until the process ends.
pub(crate) async fn hand_over(shop: Arc<Workshop>, ray: Arc<Ray>) {
    let mut ending = shop.ending.subscribe();
    while !*ending.borrow() {
        shop.pulse.beat();
        match next(&shop, &ray).await {
            Ok(Some((job, token))) => {
                let ended = attempt(&shop, &ray, &job, &token).await;
                conclude(&shop, &job, &token, ended).await;
                continue;
            }
            Ok(None) => {}
            Err(error) => tracing::error!(%error, "the queue cannot be read for Ray"),
        }
        tokio::select! {
            () = shop.database.hub.queue.notified() => {}
            _ = ending.changed() => {}
            () = tokio::time::sleep(LOOK) => {}
        }
    }
}

/// An attempt that nobody looks after, or else the next part of the queue.
async fn next(shop: &Workshop, ray: &Ray) -> Result<Option<(Job, String)>, sqlx::Error> {
    if let Some(adopted) = shop.database.adopt(&shop.name, LEASE).await? {
        tracing::info!(job = adopted.0.id, attempt = adopted.0.attempts, "taken up again");
        return Ok(Some(adopted));
    }
    // What cannot be submitted, or kept, would only use its attempts up.
    if !ray.is_up() || !shop.artifacts.has_room() {
        return Ok(None);
    }
    let claimed = shop.database.claim(&shop.name, LEASE, shop.share, Takes::Parts).await?;
    if let Some((job, _)) = &claimed {
        tracing::info!(job = job.id, attempt = job.attempts, "handed to Ray");
    }
    Ok(claimed)
}

async fn attempt(shop: &Workshop, ray: &Ray, job: &Job, token: &str) -> Ended {
    let ticket = match &job.ticket {
        Some(text) => match Ticket::parse(text) {
            Some(ticket) if ticket.executor == ray.config.url => ticket,
            _ => return Ended::Released("it was handed to another cluster than this server has now".to_owned()),
        },
        None => {
            forget_attempts_before(shop, job).await;
            let folder = shop.artifacts.place(&super::attempt_key(job));
            if let Err(error) = fresh_folder(&folder) {
                return Ended::Failed(format!("{}: cannot be made: {error}", folder.display()));
            }
            let ticket = Ticket::new(&ray.config.url);
            match shop.database.set_ticket(&job.id, token, Some(&ticket.to_json())).await {
                Ok(true) => ticket,
                Ok(false) => return Ended::Gone,
                // The claim runs out, and the part is queued again.
                Err(error) => {
                    tracing::error!(job = job.id, %error, "the ticket of a part cannot be written");
                    return Ended::Released("its ticket could not be written".to_owned());
                }
            }
        }
    };
    let submission = Ray::submission(job);
    let span = shop.traces.attempt(job, &format!("{} {submission}", ray.config.name()));
    let ended = tokio::select! {
        ended = follow(ray, job, &ticket, &submission) => ended,
        reason = hold(shop, job, token) => match reason {
            Reason::Left => Ended::Left,
            Reason::Gone => {
                let now = shop.database.get(&job.id).await;
                // Unless it has delivered, or another server looks after this very attempt, nobody wants it.
                let in_vain = now.is_ok_and(|now| {
                    now.is_none_or(|now| now.status != Status::Done && (now.status != Status::Running || now.attempts != job.attempts))
                });
                if in_vain {
                    ray.stop(&submission).await;
                }
                Ended::Gone
            }
            Reason::Canceled => {
                ray.stop(&submission).await;
                Ended::Outcome(Outcome { status: Status::Canceled, ..failed(job, "canceled".to_owned()) })
            }
        },
    };
    let (outcome, error) = match &ended {
        Ended::Outcome(outcome) => (outcome.status.as_str(), outcome.error.as_deref()),
        Ended::Failed(why) => ("failed", Some(why.as_str())),
        Ended::Released(why) => ("requeued", Some(why.as_str())),
        Ended::Gone => ("delivered", None),
        Ended::Left => ("left", None),
    };
    span.end(outcome, error);
    ended
}

/// Holds the claim.
async fn hold(shop: &Workshop, job: &Job, token: &str) -> Reason {
    let mut ending = shop.ending.subscribe();
    loop {
        shop.pulse.beat();
        if *ending.borrow() {
            return Reason::Left;
        }
        match shop.database.heartbeat(&job.id, token, LEASE).await {
            Ok(Some(true)) => return Reason::Canceled,
            Ok(Some(false)) => {}
            Ok(None) => return Reason::Gone,
            Err(error) => tracing::error!(job = job.id, %error, "a sign of life cannot be written"),
        }
        tokio::select! {
            _ = ending.changed() => {}
            () = tokio::time::sleep(HEARTBEAT) => {}
        }
    }
}

/// Submits an attempt unless it is there, and asks how it stands until that says that nothing more will come.
async fn follow(ray: &Ray, job: &Job, ticket: &Ticket, submission: &str) -> Ended {
    let name = ray.config.name();
    let limit = Duration::from_millis(u64::try_from(job.new.wall_limit_ms).unwrap_or(0)) + BEYOND_LIMIT;
    let (mut seen, mut counted) = (false, Counted::new(ray));
    let (mut away, mut running, mut over) = (None::<Instant>, None::<Instant>, None::<Instant>);
    loop {
        let asked = match ray.client.job(submission).await {
            Ok(None) if seen => {
                return Ended::Released(format!("{name} knows nothing of submission {submission} any more; was it started afresh?"));
            }
            Ok(None) => ray.submit(job, ticket).await.map(|()| None),
            other => other,
        };
        match asked {
            Err(RayError::Refused(why)) => {
                return Ended::Outcome(failed(job, format!("{name} does not take submission {submission}: {why}")));
            }
            Err(RayError::Away(why)) => {
                let since = *away.get_or_insert_with(Instant::now);
                tracing::warn!(job = job.id, "{name} does not answer: {why}");
                if since.elapsed() > AWAY {
                    return Ended::Failed(format!("{name} has not answered for {} s: {why}", AWAY.as_secs()));
                }
            }
            Ok(None) => away = None,
            Ok(Some(there)) => {
                (seen, away) = (true, None);
                counted.runs(there.status == RayStatus::Running);
                match there.status {
                    RayStatus::Pending => {}
                    RayStatus::Running => {
                        if running.get_or_insert_with(Instant::now).elapsed() > limit {
                            ray.stop(submission).await;
                            let why = format!("{name}: it took longer than {} s of wall time and was stopped", job.new.wall_limit_ms / 1000);
                            return Ended::Outcome(failed(job, why));
                        }
                    }
                    RayStatus::Succeeded => {
                        if over.get_or_insert_with(Instant::now).elapsed() > DELIVERED {
                            return Ended::Failed(format!("{name}: submission {submission} ended well and has delivered nothing"));
                        }
                    }
                    RayStatus::Stopped => {
                        return Ended::Failed(format!("{name}: somebody stopped submission {submission} there"));
                    }
                    RayStatus::Failed => return why_failed(ray, submission, &there),
                }
            }
        }
        tokio::time::sleep(ASK).await;
    }
}

fn why_failed(ray: &Ray, submission: &str, job: &RayJob) -> Ended {
    let (name, node) = (ray.config.name(), job.node());
    let message = job.message.as_deref().unwrap_or_default();
    let lines = message.lines().map(str::trim).filter(|line| !line.is_empty());
    let (first, last) = (lines.clone().next().unwrap_or("it says no reason"), lines.clone().next_back());
    let short = |text: &str| text.chars().take(300).collect::<String>();
    match (job.error_type.as_deref(), job.driver_exit_code) {
        (Some("JOB_SUPERVISOR_ACTOR_DIED"), _) => {
            Ended::Released(format!("{name}: the node {node} of submission {submission} died: {}", short(first)))
        }
        (Some("JOB_SUPERVISOR_ACTOR_START_TIMEOUT" | "JOB_SUPERVISOR_ACTOR_UNSCHEDULABLE"), _) => {
            Ended::Released(format!("{name} found no place for submission {submission}: {}", short(first)))
        }
        (_, Some(126 | 127)) => Ended::Failed(format!(
            "{name}: the node {node} has no program '{}' that can be started; expected rotortwin on every node, or --ray-program PATH",
            ray.config.program
        )),
        _ => {
            let last = last.unwrap_or("it says no reason");
            let why = short(last.strip_prefix("rotortwin: ").unwrap_or(last));
            Ended::Failed(format!("{name}: submission {submission} failed on node {node}: {why}"))
        }
    }
}

/// Writes down how an attempt ended. Files stay: what the node has delivered meanwhile counts, and of what does not count, the next attempt
/// makes an end.
async fn conclude(shop: &Workshop, job: &Job, token: &str, ended: Ended) {
    let written = match ended {
        Ended::Gone | Ended::Left => return,
        Ended::Outcome(outcome) => shop.database.finish(&job.id, token, &outcome).await,
        Ended::Failed(why) if job.failures + 1 >= ATTEMPTS => {
            let outcome = failed(job, format!("{why} ({} attempts)", job.failures + 1));
            shop.database.finish(&job.id, token, &outcome).await
        }
        Ended::Failed(why) => {
            tracing::warn!(job = job.id, "{why}");
            let pause = super::pause_after_failure(job);
            shop.database.release(&job.id, token, &why, Some(pause)).await
        }
        Ended::Released(why) if job.attempts >= ATTEMPTS_OF_DEAD_WORKERS => {
            let outcome = failed(job, format!("{why} ({} attempts)", job.attempts));
            shop.database.finish(&job.id, token, &outcome).await
        }
        Ended::Released(why) => {
            tracing::warn!(job = job.id, "{why}");
            shop.database.release(&job.id, token, &why, None).await
        }
    };
    match written {
        Ok(true) => {}
        Ok(false) => tracing::debug!(job = job.id, "it was delivered, or somebody else has it"),
        // Its claim runs out, and it is taken up again.
        Err(error) => tracing::error!(job = job.id, %error, "the end of a part cannot be written"),
    }
}
