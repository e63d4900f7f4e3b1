//! Parts executed by a Ray cluster: submitted through Ray's job API, one submission per attempt of a part.
//!
//! ```text
//!  queue ──claim──▶ slot ──POST /api/jobs/ (submission id = attempt)──▶ Ray ──places──▶ node: `rotortwin part`
//!                    │ ◀── pending, running, failed (a node died) ───────┘                │
//!                    │                                                                    │ ticket
//!  job table ◀──heartbeat──┘      routes/parts ◀── inputs, events, files, end ────────────┘
//! ```
//! * A process that has completed its part gets the next one at once, for five minutes: a submission costs Ray a second of processor time. Each
//!   part still has its own attempt and ticket.
//! * The server supervises an attempt: it holds the claim, polls Ray for the submission's status, and starts another attempt if Ray reports
//!   that its node is gone. The node itself delivers the results to this server ([`super::handed`]).
//! * A restarted server finds its attempts in the job table, and by their ids in Ray: nothing is flown twice.
//! * An unresponsive Ray has no effect for [`AWAY`]: the flights continue, and are delivered.

mod client;
mod config;

pub use config::RayConfig;

use super::handed::{self, Ticket};
use super::{
    ATTEMPTS, ATTEMPTS_OF_DEAD_WORKERS, LEASE, LOOK, WorkerContext, failed, forget_attempts_before, fresh_folder,
};
use crate::jobs::queue::Takes;
use crate::jobs::{Job, Outcome};
use client::{Client, RayError, RayJob, RayStatus};
use rotortwin_jobs::part::{CA_VARIABLE, TICKET_VARIABLE, URL_VARIABLE};
use rotortwin_jobs::{NextPart, Status};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;
use tokio::time::Instant;

/// Polling interval of a submission: each poll costs the head some milliseconds.
const ASK: Duration = Duration::from_millis(2500);
/// Polling interval of Ray itself.
const PING: Duration = Duration::from_millis(1500);
/// Interval of heartbeats to the database.
const HEARTBEAT: Duration = Duration::from_secs(3);
/// Polling interval for cancellation requests.
const WISHES: Duration = Duration::from_millis(250);
/// Time that a starting server waits for Ray.
const START: Duration = Duration::from_secs(10);
/// How long Ray may be unavailable before an attempt is given up.
const AWAY: Duration = Duration::from_secs(600);
/// How long stopping a submission is retried.
const STOP: Duration = Duration::from_secs(5);
/// A node whose process has exited successfully has delivered before; its delivery may be in transit for this long.
const DELIVERED: Duration = Duration::from_secs(10);
/// A node stops its part at its wall time limit; the server does so this much later.
const BEYOND_LIMIT: Duration = Duration::from_secs(120);

/// A Ray cluster.
#[derive(Debug)]
pub(crate) struct Ray {
    pub(crate) config: RayConfig,
    client: Client,
    /// PEM.
    ca: Option<String>,
    /// URL of this server for its nodes.
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

/// End of an attempt, as far as known to this server.
enum Ended {
    /// Final.
    Outcome(Outcome),
    /// It failed: retry, [`ATTEMPTS`] times in all.
    Failed(String),
    /// Ray could not continue it, through no fault of its own: retry.
    Released(String),
    /// Delivered, or taken over.
    Gone,
    /// This process is shutting down; its successor takes over the attempt.
    Left,
}

/// Why the supervision of an attempt ends.
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
    /// Connects to the cluster.
    ///
    /// # Errors
    /// The message names Ray and its address.
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
                Err(RayError::Away(_)) if begun.elapsed() < START => {
                    tokio::time::sleep(Duration::from_millis(500)).await
                }
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

    /// Sets the address of this server for the nodes.
    ///
    /// # Errors
    /// Other hosts cannot reach it.
    pub(crate) fn listens(&self, url: &str, everywhere: bool) -> Result<(), String> {
        if self.config.callback.is_none() && everywhere {
            return Err(format!(
                "--executor ray={}: Ray's nodes cannot reach this server at {url}; expected --ray-callback URL, such as \
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

    /// Whether its last response was successful.
    pub(crate) fn is_up(&self) -> bool {
        matches!(self.state(), State::Up { .. })
    }

    /// One-line summary.
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

    /// Parts waiting and running there, supervised by this server.
    pub(crate) fn parts(&self) -> (usize, usize) {
        (
            self.pending.load(Ordering::Relaxed),
            self.running.load(Ordering::Relaxed),
        )
    }

    /// Submission id of an attempt that starts a process. The job's id is random enough for clusters shared by several servers.
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
            .submit(&self.config, &ticket.submission, &entrypoint, &variables)
            .await
    }

    /// Stops a submission. If Ray is unavailable it continues, which only costs time: it finds its ticket invalid, and ends.
    async fn stop(&self, submission: &str) {
        let asked = async {
            while let Err(error) = self.client.stop(submission).await {
                tracing::warn!(submission, ?error, "a submission cannot be stopped; trying again");
                tokio::time::sleep(Duration::from_millis(500)).await;
            }
        };
        if tokio::time::timeout(STOP, asked).await.is_err() {
            tracing::warn!(submission, "a submission could not be stopped in Ray; its node ends it");
        }
    }
}

/// Polls Ray until the process ends.
pub(crate) async fn look_after(context: Arc<WorkerContext>, ray: Arc<Ray>) {
    let mut ending = context.ending.subscribe();
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
            context.database.hub.queue.notify_waiters();
        }
        tokio::select! {
            _ = ending.changed() => {}
            () = tokio::time::sleep(PING) => {}
        }
    }
}

/// Submits one part at a time to Ray, and supervises it, until the process ends.
pub(crate) async fn hand_over(context: Arc<WorkerContext>, ray: Arc<Ray>) {
    let mut ending = context.ending.subscribe();
    while !*ending.borrow() {
        context.pulse.beat();
        match next(&context, &ray).await {
            Ok(Some((job, token))) => {
                let ended = attempt(&context, &ray, &job, &token).await;
                conclude(&context, &job, &token, ended).await;
                continue;
            }
            Ok(None) => {}
            Err(error) => tracing::error!(%error, "the queue cannot be read for Ray"),
        }
        tokio::select! {
            () = context.database.hub.queue.notified() => {}
            _ = ending.changed() => {}
            () = tokio::time::sleep(LOOK) => {}
        }
    }
}

/// The next part for a process in Ray that has delivered one.
pub(crate) async fn hand_on(context: &WorkerContext, ray: &Ray, done: &Ticket) -> Option<NextPart> {
    if *context.ending.borrow() || done.executor != ray.config.url || !context.artifacts.has_room() {
        return None;
    }
    let handed = async {
        let Some((job, token)) = context
            .database
            .claim(&context.name, LEASE, context.share, Takes::Parts)
            .await?
        else {
            return Ok(None);
        };
        forget_attempts_before(context, &job).await;
        if let Err(error) = fresh_folder(&context.artifacts.place(&super::attempt_key(&job))) {
            context
                .database
                .release(&job.id, &token, &error.to_string(), None)
                .await?;
            return Ok(None);
        }
        let ticket = Ticket::new(&ray.config.url, &done.submission);
        let is_ours = context.database.hand_on(&job.id, &token, &ticket.to_json()).await?;
        Ok::<_, sqlx::Error>(is_ours.then(|| NextPart {
            path: handed::path(&job),
            ticket: ticket.secret,
        }))
    };
    handed.await.unwrap_or_else(|error| {
        // A claimed part is queued again when its claim expires.
        tracing::error!(%error, "no further part can be submitted to Ray");
        None
    })
}

/// An unsupervised attempt, or else the next part of the queue.
async fn next(context: &WorkerContext, ray: &Ray) -> Result<Option<(Job, String)>, sqlx::Error> {
    if let Some(adopted) = context.database.adopt(&context.name, LEASE).await? {
        tracing::info!(job = adopted.0.id, attempt = adopted.0.attempts, "taken up again");
        return Ok(Some(adopted));
    }
    // A part that cannot be submitted or stored would only use up its attempts.
    if !ray.is_up() || !context.artifacts.has_room() {
        return Ok(None);
    }
    let claimed = context
        .database
        .claim(&context.name, LEASE, context.share, Takes::Parts)
        .await?;
    if let Some((job, _)) = &claimed {
        tracing::info!(job = job.id, attempt = job.attempts, "submitted to Ray");
    }
    Ok(claimed)
}

async fn attempt(context: &WorkerContext, ray: &Ray, job: &Job, token: &str) -> Ended {
    let ticket = match &job.ticket {
        Some(text) => match Ticket::parse(text) {
            Some(ticket) if ticket.executor == ray.config.url => ticket,
            _ => return Ended::Released("it was submitted to a cluster that this server no longer uses".to_owned()),
        },
        None => {
            forget_attempts_before(context, job).await;
            let folder = context.artifacts.place(&super::attempt_key(job));
            if let Err(error) = fresh_folder(&folder) {
                return Ended::Failed(format!("{}: cannot be made: {error}", folder.display()));
            }
            let ticket = Ticket::new(&ray.config.url, &Ray::submission(job));
            match context
                .database
                .set_ticket(&job.id, token, Some(&ticket.to_json()))
                .await
            {
                Ok(true) => ticket,
                Ok(false) => return Ended::Gone,
                // The claim expires, and the part is queued again.
                Err(error) => {
                    tracing::error!(job = job.id, %error, "the ticket of a part cannot be written");
                    return Ended::Released("its ticket could not be written".to_owned());
                }
            }
        }
    };
    let submission = &ticket.submission;
    let span = context
        .traces
        .attempt(job, &format!("{} {submission}", ray.config.name()));
    let ended = tokio::select! {
        ended = follow(ray, job, &ticket) => ended,
        reason = hold(context, job, token) => match reason {
            Reason::Left => Ended::Left,
            Reason::Gone => {
                let now = context.database.get(&job.id).await;
                // Unless it has delivered, or another server supervises this attempt, it is useless.
                let in_vain = now.is_ok_and(|now| {
                    now.is_none_or(|now| now.status != Status::Done && (now.status != Status::Running || now.attempts != job.attempts))
                });
                if in_vain {
                    ray.stop(submission).await;
                }
                Ended::Gone
            }
            Reason::Canceled => {
                ray.stop(submission).await;
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

/// Holds the claim. Many attempts are held at the same time, most of which are waiting: heartbeats are infrequent (SQLite makes each of them
/// durable), checks for cancellation frequent.
async fn hold(context: &WorkerContext, job: &Job, token: &str) -> Reason {
    let mut ending = context.ending.subscribe();
    let mut lived = None::<Instant>;
    loop {
        context.pulse.beat();
        if *ending.borrow() {
            return Reason::Left;
        }
        let writes = lived.is_none_or(|lived| lived.elapsed() >= HEARTBEAT);
        let wanted = if writes {
            context.database.heartbeat(&job.id, token, LEASE).await
        } else {
            context.database.wants_end(&job.id, token).await
        };
        match wanted {
            Ok(Some(true)) => return Reason::Canceled,
            Ok(Some(false)) => lived = if writes { Some(Instant::now()) } else { lived },
            Ok(None) => return Reason::Gone,
            Err(error) => tracing::error!(job = job.id, %error, "a lease cannot be renewed"),
        }
        tokio::select! {
            _ = ending.changed() => {}
            () = tokio::time::sleep(WISHES) => {}
        }
    }
}

/// Submits an attempt unless it exists, and polls its status until it is final.
async fn follow(ray: &Ray, job: &Job, ticket: &Ticket) -> Ended {
    let (name, submission) = (ray.config.name(), ticket.submission.as_str());
    // A process that executed an earlier part exists, or will not come back.
    let own = submission == Ray::submission(job);
    let limit = Duration::from_millis(u64::try_from(job.new.wall_limit_ms).unwrap_or(0)) + BEYOND_LIMIT;
    let (mut seen, mut counted) = (false, Counted::new(ray));
    let (mut away, mut running, mut over) = (None::<Instant>, None::<Instant>, None::<Instant>);
    loop {
        let asked = match ray.client.job(submission).await {
            Ok(None) if seen || !own => {
                return Ended::Released(format!(
                    "{name} no longer knows submission {submission}; was the cluster restarted?"
                ));
            }
            Ok(None) => ray.submit(job, ticket).await.map(|()| None),
            // A submission that was accepted once is not given up because of an unexpected response.
            Err(RayError::Refused(why)) => Err(RayError::Away(why)),
            other => other,
        };
        match asked {
            Err(RayError::Refused(why)) => {
                return Ended::Outcome(failed(job, format!("{name} rejected submission {submission}: {why}")));
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
                            let why = format!(
                                "{name}: the limit of {} s of wall time was exceeded",
                                job.new.wall_limit_ms / 1000
                            );
                            return Ended::Outcome(failed(job, why));
                        }
                    }
                    RayStatus::Succeeded => {
                        if over.get_or_insert_with(Instant::now).elapsed() > DELIVERED {
                            let why = format!("{name}: submission {submission} ended without delivering this part");
                            return if own { Ended::Failed(why) } else { Ended::Released(why) };
                        }
                    }
                    RayStatus::Stopped => {
                        let why = format!("{name}: submission {submission} was stopped in Ray");
                        return if own { Ended::Failed(why) } else { Ended::Released(why) };
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
    let (first, last) = (
        lines.clone().next().unwrap_or("it says no reason"),
        lines.clone().next_back(),
    );
    let short = |text: &str| text.chars().take(300).collect::<String>();
    match (job.error_type.as_deref(), job.driver_exit_code) {
        (Some("JOB_SUPERVISOR_ACTOR_DIED"), _) => Ended::Released(format!(
            "{name}: the node {node} of submission {submission} died: {}",
            short(last.unwrap_or(first))
        )),
        (Some("JOB_SUPERVISOR_ACTOR_START_TIMEOUT" | "JOB_SUPERVISOR_ACTOR_UNSCHEDULABLE"), _) => Ended::Released(
            format!("{name} could not schedule submission {submission}: {}", short(first)),
        ),
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

/// Stores the end of an attempt. Files stay: a delivery completed meanwhile counts, and the next attempt removes obsolete ones.
async fn conclude(context: &WorkerContext, job: &Job, token: &str, ended: Ended) {
    let written = match ended {
        Ended::Gone | Ended::Left => return,
        Ended::Outcome(outcome) => context.database.finish(&job.id, token, &outcome).await,
        Ended::Failed(why) if job.failures + 1 >= ATTEMPTS => {
            let outcome = failed(job, format!("{why} ({} attempts)", job.failures + 1));
            context.database.finish(&job.id, token, &outcome).await
        }
        Ended::Failed(why) => {
            tracing::warn!(job = job.id, "{why}");
            let pause = super::pause_after_failure(job);
            context.database.release(&job.id, token, &why, Some(pause)).await
        }
        Ended::Released(why) if job.attempts >= ATTEMPTS_OF_DEAD_WORKERS => {
            let outcome = failed(job, format!("{why} ({} attempts)", job.attempts));
            context.database.finish(&job.id, token, &outcome).await
        }
        Ended::Released(why) => {
            tracing::warn!(job = job.id, "{why}");
            context.database.release(&job.id, token, &why, None).await
        }
    };
    match written {
        Ok(true) => {}
        Ok(false) => tracing::debug!(job = job.id, "it was delivered, or another worker has it"),
        // Its claim expires, and it is taken over.
        Err(error) => tracing::error!(job = job.id, %error, "the end of a part cannot be written"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::NewJob;
    use axum::extract::{Path, State as Shared};
    use axum::http::{HeaderMap, StatusCode};
    use axum::routing::{get, post};
    use axum::{Json, Router};
    use rotortwin_jobs::JobKind;
    use serde_json::{Value, json};
    use std::collections::{BTreeMap, VecDeque};

    /// A fake cluster with scripted responses.
    #[derive(Default)]
    struct Fake {
        /// Responses after a submission, in order; the last one repeats.
        says: Mutex<VecDeque<(u16, Value)>>,
        submitted: Mutex<Vec<Value>>,
        stopped: Mutex<Vec<String>>,
        /// The first submission is accepted, but answered with an error.
        loses_answer: bool,
    }

    fn answer((status, body): (u16, Value)) -> (StatusCode, String) {
        let text = body.as_str().map_or_else(|| body.to_string(), str::to_owned);
        (StatusCode::from_u16(status).unwrap(), text)
    }

    async fn version(headers: HeaderMap) -> (StatusCode, String) {
        if headers
            .get("authorization")
            .is_none_or(|value| value != "Bearer of-ray")
        {
            return answer((401, "Unauthorized".into()));
        }
        answer((200, json!({ "ray_version": "2.60.0" })))
    }

    async fn job(Shared(fake): Shared<Arc<Fake>>, Path(id): Path<String>) -> (StatusCode, String) {
        if fake
            .submitted
            .lock()
            .unwrap()
            .iter()
            .all(|job| job["submission_id"] != id.as_str())
        {
            return answer((404, format!("Job {id} does not exist").into()));
        }
        let mut says = fake.says.lock().unwrap();
        let next = if says.len() > 1 {
            says.pop_front()
        } else {
            says.front().cloned()
        };
        answer(next.unwrap())
    }

    async fn submit(Shared(fake): Shared<Arc<Fake>>, Json(body): Json<Value>) -> (StatusCode, String) {
        let mut submitted = fake.submitted.lock().unwrap();
        if submitted
            .iter()
            .any(|job| job["submission_id"] == body["submission_id"])
        {
            let why = "RuntimeError: Request failed with status code 400: ValueError: Job with submission_id x already exists.";
            return answer((500, why.into()));
        }
        submitted.push(body);
        answer(if fake.loses_answer {
            (502, "lost".into())
        } else {
            (200, json!({ "submission_id": "x" }))
        })
    }

    async fn stop(Shared(fake): Shared<Arc<Fake>>, Path(id): Path<String>) -> (StatusCode, String) {
        fake.stopped.lock().unwrap().push(id);
        answer((200, json!({ "stopped": true })))
    }

    async fn start(fake: Fake) -> (Arc<Fake>, Ray) {
        let _chosen = rustls::crypto::ring::default_provider().install_default();
        let fake = Arc::new(fake);
        let router = Router::new()
            .route("/api/version", get(version))
            .route("/api/jobs/", post(submit))
            .route("/api/jobs/{id}", get(job))
            .route("/api/jobs/{id}/stop", post(stop))
            .with_state(Arc::clone(&fake));
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        tokio::spawn(async move { axum::serve(listener, router).await });
        let ray = Ray::open(RayConfig {
            url,
            token: Some("of-ray".to_owned()),
            parts: 1,
            cpus: 2.0,
            memory: Some(1 << 30),
            resources: BTreeMap::from([("flights".to_owned(), 0.5)]),
            program: "/opt/it's/rotortwin".to_owned(),
            callback: None,
            ca: None,
        });
        let ray = ray.await.unwrap();
        ray.listens("http://127.0.0.1:8400", false).unwrap();
        (fake, ray)
    }

    fn part() -> Job {
        Job {
            id: "id".to_owned(),
            status: Status::Running,
            new: NewJob {
                kind: JobKind::CampaignShard,
                name: "a 0..1".to_owned(),
                tenant: "local".to_owned(),
                priority: 0,
                spec: String::new(),
                facts: String::new(),
                parent: None,
                idempotency_key: None,
                request_hash: String::new(),
                wall_limit_ms: 60_000,
                autopilot: None,
                needs: Vec::new(),
                upload_bytes: 0,
                parts: Vec::new(),
            },
            part_of: Some("whole".to_owned()),
            waits_for: 0,
            submitted_ms: 0,
            started_ms: None,
            finished_ms: None,
            attempts: 2,
            failures: 0,
            worker: None,
            cancel_requested: false,
            ticket: None,
            folder: None,
            bytes: 0,
            run_hash: None,
            error: None,
            result: None,
            metrics: None,
            verdict: None,
        }
    }

    async fn follow_own(ray: &Ray) -> Ended {
        let job = part();
        let ticket = Ticket::new(&ray.config.url, &Ray::submission(&job));
        follow(ray, &job, &ticket).await
    }

    fn words(ended: &Ended) -> (&'static str, &str) {
        match ended {
            Ended::Outcome(outcome) => ("outcome", outcome.error.as_deref().unwrap_or_default()),
            Ended::Failed(why) => ("failed", why),
            Ended::Released(why) => ("released", why),
            Ended::Gone => ("gone", ""),
            Ended::Left => ("left", ""),
        }
    }

    /// A submission whose response was lost is not repeated, and Ray's absence has no effect.
    #[tokio::test]
    async fn regress_a_lost_answer_and_an_absent_ray_make_no_second_submission() {
        let stopped = (
            200,
            json!({ "status": "STOPPED", "message": "Job was intentionally stopped." }),
        );
        let says = [
            (503, "Bad gateway".into()),
            (200, json!({ "status": "RUNNING" })),
            stopped,
        ];
        let (fake, ray) = start(Fake {
            says: Mutex::new(says.into()),
            loses_answer: true,
            ..Fake::default()
        })
        .await;
        let ended = follow_own(&ray).await;
        let (how, why) = words(&ended);
        assert_eq!(how, "failed");
        assert!(
            why.starts_with("Ray at http://127.0.0.1:") && why.contains("submission rotortwin-id-2 was stopped in Ray"),
            "{why}"
        );
        let submitted = fake.submitted.lock().unwrap().clone();
        assert_eq!(submitted.len(), 1);
        let body = &submitted[0];
        assert_eq!(body["entrypoint"], "exec '/opt/it'\\''s/rotortwin' part");
        assert_eq!(
            (&body["entrypoint_num_cpus"], &body["entrypoint_memory"]),
            (&json!(2.0), &json!(1 << 30))
        );
        assert_eq!(body["entrypoint_resources"], json!({ "flights": 0.5 }));
        let variables = &body["runtime_env"]["env_vars"];
        assert_eq!(variables[URL_VARIABLE], "http://127.0.0.1:8400/executor/v1/parts/id/2");
        // Submitted once more, it exists: counts as success.
        let ticket = Ticket::new(&ray.config.url, "rotortwin-id-2");
        assert_eq!(ray.submit(&part(), &ticket).await, Ok(()));
        assert_eq!(fake.submitted.lock().unwrap().len(), 1);
        assert_eq!(ray.parts(), (0, 0));
    }

    #[tokio::test]
    async fn val_what_ray_says_of_an_end_is_one_sentence() {
        let says = |message: &str, error_type: &str, code: Option<i32>| {
            json!({ "status": "FAILED", "message": message, "error_type": error_type, "driver_exit_code": code,
                    "driver_agent_http_address": "http://10.0.0.3:52365" })
        };
        let died = "Job supervisor actor died: x\n\tpid: 1\n\tthe actor's node was terminated unexpectedly: health check failed";
        let command = "JOB_ENTRYPOINT_COMMAND_ERROR";
        let (fake, ray) = start(Fake::default()).await;
        for (body, how, expected) in [
            (
                says(died, "JOB_SUPERVISOR_ACTOR_DIED", None),
                "released",
                "the node 10.0.0.3 of submission rotortwin-id-2 died: the actor's node",
            ),
            (
                says("it waited", "JOB_SUPERVISOR_ACTOR_START_TIMEOUT", None),
                "released",
                "could not schedule submission rotortwin-id-2: it waited",
            ),
            (
                says("not found", command, Some(127)),
                "failed",
                "the node 10.0.0.3 has no program '/opt/it's/rotortwin'",
            ),
            (
                says("logs:\nrotortwin: no server\n", command, Some(1)),
                "failed",
                "failed on node 10.0.0.3: no server",
            ),
            (
                says("no such env", "RUNTIME_ENV_SETUP_FAILURE", None),
                "failed",
                "failed on node 10.0.0.3: no such env",
            ),
        ] {
            *fake.says.lock().unwrap() = [(200, body)].into();
            let ended = follow_own(&ray).await;
            let (kind, why) = words(&ended);
            assert_eq!(kind, how, "{why}");
            assert!(
                why.starts_with("Ray at http://127.0.0.1:") && why.contains(expected),
                "{why}"
            );
        }
        // From a process that executed an earlier part.
        *fake.says.lock().unwrap() = [(200, json!({ "status": "STOPPED" }))].into();
        let ticket = Ticket::new(&ray.config.url, "rotortwin-id-2");
        let next = Job {
            id: "next".to_owned(),
            ..part()
        };
        assert_eq!(words(&follow(&ray, &next, &ticket).await).0, "released");
        fake.submitted.lock().unwrap().clear();
        assert!(
            words(&follow(&ray, &next, &ticket).await)
                .1
                .contains("no longer knows submission rotortwin-id-2")
        );
        assert!(fake.submitted.lock().unwrap().is_empty());
        ray.stop("rotortwin-id-2").await;
        assert_eq!(*fake.stopped.lock().unwrap(), ["rotortwin-id-2"]);
    }
}
