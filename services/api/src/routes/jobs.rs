//! Operations common to all kinds of jobs: accept, find, list, cancel, delete.

use super::facts::{JobFacts, UploadFacts};
use crate::App;
use crate::access::Caller;
use crate::jobs::queue::{Deleted, Submitted};
use crate::jobs::store::Filter;
use crate::jobs::{Job, NewJob};
use crate::problem::Problem;
use axum::Json;
use axum::extract::Path;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use rotortwin_jobs::{JobKind, Status};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use utoipa::{IntoParams, ToSchema};

/// The key of a submission is not longer.
const LONGEST_KEY: usize = 200;
/// An attempt takes at most this long, s.
pub(super) const LONGEST_WALL_S: u64 = 24 * 3600;
/// An attempt takes at most this long where nothing is said, s.
const USUAL_WALL_S: u64 = 6 * 3600;

/// A job other than a run: a campaign, a diagnosis, …
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct JobView {
    /// Later jobs have larger ids.
    id: String,
    /// What it is.
    kind: JobKind,
    /// Name of the campaign, of the log, …
    name: String,
    /// Its tenant.
    tenant: String,
    /// Its state.
    status: Status,
    /// Jobs of a tenant with larger values run first.
    priority: i64,
    /// Short form of the request.
    #[schema(value_type = JobFacts)]
    facts: serde_json::Value,
    /// The job that it was made from.
    parent: Option<String>,
    /// Parts that are not done.
    waits_for: i64,
    /// ms since 1970, UTC.
    submitted_ms: i64,
    /// ms since 1970, UTC.
    started_ms: Option<i64>,
    /// ms since 1970, UTC.
    finished_ms: Option<i64>,
    /// Number of attempts.
    attempts: i64,
    /// Worker that executes or executed the job.
    worker: Option<String>,
    /// A cancellation has been requested.
    cancel_requested: bool,
    /// Size of its files, including an upload, bytes.
    bytes: i64,
    /// Why it failed, one sentence.
    error: Option<String>,
    /// The result. Not in lists.
    #[schema(value_type = Option<serde_json::Value>)]
    result: Option<serde_json::Value>,
}

impl From<Job> for JobView {
    fn from(job: Job) -> Self {
        Self {
            id: job.id,
            kind: job.new.kind,
            name: job.new.name,
            tenant: job.new.tenant,
            status: job.status,
            priority: job.new.priority,
            facts: serde_json::from_str(&job.new.facts).unwrap_or_default(),
            parent: job.new.parent,
            waits_for: job.waits_for,
            submitted_ms: job.submitted_ms,
            started_ms: job.started_ms,
            finished_ms: job.finished_ms,
            attempts: job.attempts,
            worker: job.worker,
            cancel_requested: job.cancel_requested,
            bytes: job.bytes,
            error: job.error,
            result: job.result.and_then(|text| serde_json::from_str(&text).ok()),
        }
    }
}

/// A page, latest first.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct JobPage {
    items: Vec<JobView>,
    /// `cursor` of the next page; absent on the last one.
    next: Option<String>,
}

/// Which jobs.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct ListQuery {
    /// Only those in this state.
    pub(super) status: Option<Status>,
    /// Only those of this name.
    pub(super) name: Option<String>,
    /// Only those derived from this one: forks of a run, flights of a campaign, …
    pub(super) parent: Option<String>,
    /// Only those of this vehicle: runs by its name, logs by the name given on submission.
    pub(super) vehicle: Option<String>,
    /// Only runs with this final verdict of the sequential detector: 0 healthy, a rotor from 1, 100 i + j two rotors, −1 unknown fault,
    /// −2 not ready, −3 ambiguous.
    pub(super) verdict: Option<i32>,
    /// Only those submitted at or after this time, ms since 1970, UTC.
    pub(super) from_ms: Option<i64>,
    /// Only those submitted before this time, ms since 1970, UTC.
    pub(super) to_ms: Option<i64>,
    /// `next` of the previous page.
    #[param(pattern = "^[0-9a-f-]{1,64}$")]
    pub(super) cursor: Option<String>,
    /// Items per page, 1 to 1000.
    #[param(minimum = 1, maximum = 1000, default = 50)]
    pub(super) limit: Option<i64>,
}

impl ListQuery {
    pub(super) fn filter<'a>(&'a self, caller: &'a Caller, kind: JobKind) -> Filter<'a> {
        Filter {
            kind: Some(kind),
            tenant: caller.tenant_filter(),
            status: self.status,
            name: self.name.as_deref(),
            parent: self.parent.as_deref(),
            vehicle: self.vehicle.as_deref(),
            verdict: self.verdict,
            from_ms: self.from_ms,
            to_ms: self.to_ms,
            before: self.cursor.as_deref(),
        }
    }
}

/// What every submission can say besides its subject.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Terms {
    /// Larger values run first.
    pub(super) priority: i64,
    /// An attempt takes at most this long, s of wall time.
    pub(super) max_wall_s: Option<u64>,
}

impl Terms {
    /// # Errors
    /// 422: out of range.
    pub(super) fn check(&self) -> Result<i64, Problem> {
        if !(-100..=100).contains(&self.priority) {
            return Err(Problem::unprocessable(format!(
                "`priority` is {}; expected -100 to 100",
                self.priority
            )));
        }
        let wall = self.max_wall_s.unwrap_or(USUAL_WALL_S);
        if !(1..=LONGEST_WALL_S).contains(&wall) {
            return Err(Problem::unprocessable(format!(
                "`max_wall_s` is {wall}; expected 1 to {LONGEST_WALL_S}"
            )));
        }
        Ok(i64::try_from(wall * 1000).unwrap_or(i64::MAX))
    }
}

/// The hash of a submission, by which a repeated one is known.
pub(super) fn request_hash(body: &impl Serialize) -> String {
    let text = serde_json::to_string(body).unwrap_or_default();
    format!("{:032x}", xxhash_rust::xxh3::xxh3_128(text.as_bytes()))
}

/// The client's name for a submission.
///
/// # Errors
/// 400.
pub(super) fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(value) = headers.get("idempotency-key") else {
        return Ok(None);
    };
    match value.to_str() {
        // For `to_str` a tab is printable.
        Ok(text) if (1..=LONGEST_KEY).contains(&text.len()) && !text.contains('\t') => Ok(Some(text.to_owned())),
        _ => Err(Problem::bad_request(format!(
            "Idempotency-Key: expected 1 to {LONGEST_KEY} printable ASCII characters"
        ))),
    }
}

/// The answer to a submission that was already accepted under its key: 200 with the existing job, or 409 if the body
/// differs. Checked before limits and documents: the inputs of the job may have changed or gone since, but the job
/// exists.
///
/// # Errors
/// 400, 409, 503.
/// 400, 409, 503.
pub(super) async fn before<V: Serialize>(
    app: &App,
    caller: &Caller,
    kind: JobKind,
    headers: &HeaderMap,
    request_hash: &str,
    view: impl FnOnce(Job) -> V,
) -> Result<Option<Response>, Problem> {
    match idempotency_key(headers)? {
        Some(key) => before_under(app, caller, kind, &key, request_hash, view).await,
        None => Ok(None),
    }
}

/// The same under a key that the server gives.
///
/// # Errors
/// 409, 503.
pub(super) async fn before_under<V: Serialize>(
    app: &App,
    caller: &Caller,
    kind: JobKind,
    key: &str,
    request_hash: &str,
    view: impl FnOnce(Job) -> V,
) -> Result<Option<Response>, Problem> {
    let job = job_before(app, caller, kind, key, request_hash).await?;
    Ok(job.map(|job| (StatusCode::OK, Json(view(job))).into_response()))
}

/// The job that was accepted under a key.
///
/// # Errors
/// 409, 503.
pub(super) async fn job_before(
    app: &App,
    caller: &Caller,
    kind: JobKind,
    key: &str,
    request_hash: &str,
) -> Result<Option<Job>, Problem> {
    match app.database.by_key(&caller.tenant, kind, key).await? {
        Some(job) if job.new.request_hash != request_hash => Err(another_body()),
        job => Ok(job),
    }
}

fn another_body() -> Problem {
    Problem::conflict("another body was submitted under this Idempotency-Key; expected the same body, or a new key")
}

/// Puts a job into the queue: 202 with its address, or 200 with the one that is there under this key.
///
/// # Errors
/// 404, 409, 429, 503, 507.
pub(super) async fn accept<V: Serialize>(
    app: &App,
    new: NewJob,
    view: impl FnOnce(Job) -> V,
) -> Result<Response, Problem> {
    let collection = new.kind.collection();
    let (job, is_new) = admit(app, new).await?;
    if !is_new {
        return Ok((StatusCode::OK, Json(view(job))).into_response());
    }
    let location = format!("/api/v1/{collection}/{}", job.id);
    Ok((StatusCode::ACCEPTED, [(header::LOCATION, location)], Json(view(job))).into_response())
}

/// Puts a job into the queue, unless there is one under its key; the job, and whether it is new.
///
/// # Errors
/// 404: a job whose files it reads was deleted meanwhile. 409, 429, 503, 507.
pub(super) async fn admit(app: &App, mut new: NewJob) -> Result<(Job, bool), Problem> {
    if app.is_ending() {
        return Err(Problem::unavailable("the server is ending"));
    }
    let (open, bytes) = app.database.account(&new.tenant).await?;
    let most = i64::try_from(app.config.most_bytes).unwrap_or(i64::MAX);
    if bytes >= most || bytes + new.upload_bytes > most {
        let more = match new.upload_bytes {
            0 => String::new(),
            upload => format!(", and the file that was sent has {upload}"),
        };
        return Err(Problem::disk_full(format!(
            "'{}' has {bytes} bytes of files{more}; expected at most {most}: delete jobs that are no longer needed",
            new.tenant
        )));
    }
    if open + 1 + new.parts.len() as i64 > i64::from(app.config.most_open) {
        return Err(Problem::too_many(format!(
            "'{}' has {open} jobs queued or running; expected at most {} including the {} of this one",
            new.tenant,
            app.config.most_open,
            1 + new.parts.len()
        )));
    }
    app.context.traces.carry(&mut new);
    match app.database.submit(&new).await? {
        Submitted::New(job) => Ok((*job, true)),
        Submitted::Before(job) => Ok((*job, false)),
        Submitted::Other => Err(another_body()),
        Submitted::InputGone(id) => Err(Problem::not_found(format!(
            "the job {id}, whose files this one reads, was deleted in the meantime"
        ))),
    }
}

/// The job of this id.
///
/// # Errors
/// 400, 404.
pub(super) async fn find(
    app: &App,
    caller: &Caller,
    kind: JobKind,
    id: Result<Path<String>, PathRejection>,
) -> Result<Job, Problem> {
    let Path(id) = id?;
    app.database
        .get(&id)
        .await?
        .filter(|job| job.new.kind == kind && caller.sees(job))
        .ok_or_else(|| Problem::not_found(format!("there is no {} {id}", kind.as_str())))
}

/// A page of jobs.
///
/// # Errors
/// 400.
pub(super) async fn page(
    app: &App,
    caller: &Caller,
    kind: JobKind,
    query: Result<axum::extract::Query<ListQuery>, QueryRejection>,
) -> Result<(Vec<Job>, Option<String>), Problem> {
    let axum::extract::Query(query) = query?;
    let limit = query.limit.unwrap_or(50);
    let mut jobs = app.database.list(&query.filter(caller, kind), limit + 1).await?;
    let more = jobs.len() as i64 > limit;
    jobs.truncate(usize::try_from(limit).unwrap_or(usize::MAX));
    let next = jobs.last().filter(|_| more).map(|job| job.id.clone());
    Ok((jobs, next))
}

/// A page of jobs that are no runs.
///
/// # Errors
/// 400.
pub(super) async fn page_of_views(
    app: &App,
    caller: &Caller,
    kind: JobKind,
    query: Result<axum::extract::Query<ListQuery>, QueryRejection>,
) -> Result<Json<JobPage>, Problem> {
    let (jobs, next) = page(app, caller, kind, query).await?;
    Ok(Json(JobPage {
        items: jobs.into_iter().map(JobView::from).collect(),
        next,
    }))
}

/// Wants a job stopped.
///
/// # Errors
/// 404, 409.
pub(super) async fn cancel(app: &App, job: &Job) -> Result<Job, Problem> {
    let gone = || Problem::not_found(format!("there is no {} {}", job.new.kind.as_str(), job.id));
    if job.status.is_final() {
        return Err(Problem::conflict(format!(
            "the {} has ended already: {}",
            job.new.kind.as_str(),
            job.status.as_str()
        )));
    }
    app.database.cancel(&job.id).await?.ok_or_else(gone)
}

/// Deletes a job that has ended, with its parts and files.
///
/// # Errors
/// 409: it has not ended, or another one that has not reads its files.
pub(super) async fn delete(app: &App, job: &Job) -> Result<StatusCode, Problem> {
    let kind = job.new.kind.as_str();
    let ids = match app.database.delete(&job.id).await? {
        Deleted::Gone(ids) => ids,
        Deleted::NotEnded => {
            return Err(Problem::conflict(format!(
                "the {kind} is {}; cancel it before deleting it",
                job.status.as_str()
            )));
        }
        Deleted::Needed(by) => {
            return Err(Problem::in_use(format!(
                "the {} {} is {} and reads the files of this {kind}; wait until it ends, or cancel it first",
                by.new.kind.as_str(),
                by.id,
                by.status.as_str()
            )));
        }
    };
    let mut keys: Vec<String> = ids.iter().map(|id| format!("jobs/{id}")).collect();
    // Runs of version 1 of the database lie elsewhere.
    keys.extend(
        job.folder
            .as_ref()
            .and_then(|folder| folder.strip_prefix("runs/"))
            .map(|_| format!("runs/{}", job.id)),
    );
    keys.extend(UploadFacts::of(&job.new.facts).map(|facts| facts.upload));
    for key in keys {
        if let Err(error) = app.artifacts.delete(&key).await {
            tracing::warn!(key, %error, "files of a deleted job cannot be deleted");
        }
    }
    Ok(StatusCode::NO_CONTENT)
}

/// `App` behind routes.
pub(super) type Shared = axum::extract::State<Arc<App>>;
