//! A vehicle from flight logs, mass and arm: submitted as a job, and saved in the library after review.

use super::asked;
use super::documents::{self, checked_name};
use super::facts::{IdentificationFacts, JobFacts};
use super::jobs::{self, JobView, Shared, Terms};
use super::tasks::{Draft, OUT, done};
use crate::App;
use crate::access::Caller;
use crate::json_object::JsonObject;
use crate::library::DocumentKind;
use crate::library::own::{Precondition, Written};
use crate::problem::Problem;
use axum::Json;
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use rotortwin_jobs::submission::Flights;
use rotortwin_jobs::{Identification, Input, JobKind, StoredJob};
use rotortwin_twin::identify::{ARM_M, CAPACITY_AH, CELLS, MASS_KG};
use serde::{Deserialize, Serialize};
use std::fmt::Display;
use std::ops::RangeInclusive;
use utoipa::ToSchema;

super::collection!(
    identifications,
    rotortwin_jobs::JobKind::Identification,
    IdentificationResult,
    "identification",
    "/api/v1/identifications",
    "/api/v1/identifications/{id}",
    "/api/v1/identifications/{id}/cancel",
    "/api/v1/identifications/{id}/events",
    "/api/v1/identifications/{id}/artifacts",
    "/api/v1/identifications/{id}/artifacts/{*path}"
);

/// A vehicle to identify.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct IdentificationSubmission {
    /// Name of the vehicle in the library, if it is kept.
    #[schema(min_length = 1, max_length = 64, pattern = "^[a-z0-9][a-z0-9._-]*$")]
    name: String,
    /// Flights of the vehicle, all with the same rotors.
    flights: Flights,
    /// Mass including battery, kg.
    #[schema(minimum = 0.02, maximum = 200)]
    mass_kg: f64,
    /// Distance from the centre of the vehicle to the farthest rotor, m.
    #[schema(minimum = 0.02, maximum = 5)]
    arm_m: f64,
    /// Frame, if the log does not state it, such as `quad-x` (numbers as in ArduPilot).
    #[schema(max_length = 40)]
    frame: Option<String>,
    /// Use this frame even if the motion contradicts it; otherwise the job fails, with the evidence.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    trust_frame: bool,
    /// Capacity of the battery, A h.
    #[schema(minimum = 0.05, maximum = 1000)]
    capacity_ah: Option<f64>,
    /// Cells of the battery in series.
    #[schema(minimum = 1, maximum = 24)]
    cells: Option<u32>,
    /// Thrust-bench tables of one rotor, or datasheet tables, as for `--bench` of the command; at most 1 MiB.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schema(max_items = 16)]
    bench: Vec<BenchTable>,
    /// Fit each half of each flight and score it on the other, too.
    #[serde(default)]
    held_out: bool,
}

/// A thrust-bench table.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct BenchTable {
    /// File name, used in the result.
    #[schema(min_length = 1, max_length = 100)]
    name: String,
    /// The file: a header, then one row per reading.
    text: String,
}

/// Most tables of a bench, and bytes of them together.
const MOST_TABLES: usize = 16;
const MOST_TABLE_BYTES: usize = 1 << 20;

impl BenchTable {
    /// Where the job finds it.
    fn path(&self, place: usize) -> String {
        format!("bench/{place}/{}", self.name)
    }
}

/// Checks a number of the body.
fn within<T: PartialOrd + Display>(key: &str, value: Option<T>, range: &RangeInclusive<T>) -> Result<(), Problem> {
    match value.filter(|value| !range.contains(value)) {
        None => Ok(()),
        Some(value) => Err(Problem::unprocessable(format!(
            "`{key}` is {value}; expected {} to {}",
            range.start(),
            range.end()
        ))),
    }
}

impl IdentificationSubmission {
    fn check(&self) -> Result<(), Problem> {
        checked_name(&self.name)?;
        within("mass_kg", Some(self.mass_kg), &MASS_KG)?;
        within("arm_m", Some(self.arm_m), &ARM_M)?;
        within("capacity_ah", self.capacity_ah, &CAPACITY_AH)?;
        within("cells", self.cells, &CELLS)?;
        let plain = |frame: &String| frame.len() <= 40 && frame.chars().all(|c| c.is_ascii_alphanumeric() || c == '-');
        if let Some(frame) = self.frame.as_ref().filter(|frame| !plain(frame)) {
            return Err(Problem::unprocessable(format!(
                "`frame` is '{frame}'; expected one such as quad-x"
            )));
        }
        self.check_bench()
    }

    fn check_bench(&self) -> Result<(), Problem> {
        if self.bench.len() > MOST_TABLES {
            return Err(Problem::unprocessable(format!(
                "`bench` has {} tables; expected at most {MOST_TABLES}",
                self.bench.len()
            )));
        }
        let bytes: usize = self.bench.iter().map(|table| table.text.len()).sum();
        if bytes > MOST_TABLE_BYTES {
            return Err(Problem::unprocessable(format!(
                "`bench` has {bytes} bytes; expected at most {MOST_TABLE_BYTES}"
            )));
        }
        let plain = |name: &str| {
            (1..=100).contains(&name.len())
                && !name.starts_with(['.', '-', ' '])
                && name.chars().all(|c| c.is_ascii_alphanumeric() || "._- ()+".contains(c))
        };
        match self.bench.iter().find(|table| !plain(&table.name)) {
            Some(table) => Err(Problem::unprocessable(format!(
                "`bench` has a table of the name '{}'; expected a file name of at most 100 letters, digits and . _ - ( ) +",
                table.name.escape_debug()
            ))),
            None => Ok(()),
        }
    }
}

/// Identifies a vehicle from flight logs, its mass and its arm length, which no log contains.
///
/// The result contains each value with its 95 % interval and source, and the documents of the vehicle and its
/// blades.
#[utoipa::path(post, path = "/api/v1/identifications", tag = "identifications", operation_id = "submit_identification", request_body = IdentificationSubmission,
    params(("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key and body returns the existing job")),
    responses(
        (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = JobView,
         headers(("Location" = String, description = "URL of the job"))),
        (status = 200, description = "already accepted under this Idempotency-Key", body = JobView),
        (status = 400, description = "malformed request, or invalid name", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "log or run not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "this Idempotency-Key was used with a different body, or a flight is not done", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "the job cannot be done with these inputs", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn submit(
    app: Shared,
    caller: Caller,
    headers: HeaderMap,
    body: Result<JsonObject<IdentificationSubmission>, Problem>,
) -> Result<Response, Problem> {
    let JsonObject(body) = body?;
    let hash = jobs::request_hash(&body);
    if let Some(answer) = jobs::before(&app, &caller, JobKind::Identification, &headers, &hash, JobView::from).await? {
        return Ok(answer);
    }
    body.check()?;
    let (logs, mut inputs) = asked::flights(&app, &caller, &body.flights).await?;
    let tables = || body.bench.iter().enumerate();
    inputs.extend(tables().map(|(place, table)| Input::text(table.path(place), table.text.clone())));
    let job = Identification {
        logs,
        mass_kg: body.mass_kg,
        arm_m: body.arm_m,
        frame: body.frame.clone(),
        trust_frame: body.trust_frame,
        capacity_ah: body.capacity_ah,
        cells: body.cells,
        held_out: body.held_out,
        bench: tables().map(|(place, table)| table.path(place).into()).collect(),
        out: Some(format!("{OUT}/{}.toml", body.name).into()),
    };
    let draft = Draft {
        kind: JobKind::Identification,
        name: body.name.clone(),
        facts: JobFacts::Identification(IdentificationFacts {
            vehicle: body.name.clone(),
            flights: body.flights.clone(),
            mass_kg: body.mass_kg,
            arm_m: body.arm_m,
        }),
        stored: StoredJob {
            job: rotortwin_jobs::Job::Identification(job),
            inputs,
        },
        terms: Terms::default(),
    };
    draft.submit(&app, &caller, &headers, &body, Vec::new()).await
}

/// A vehicle stored in the library.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct KeptVehicle {
    /// Its name under `/api/v1/vehicles`, and that of its blades under `/api/v1/blades`.
    vehicle: String,
}

/// What is needed of the result.
#[derive(Deserialize)]
struct Texts {
    vehicle: String,
    blades: String,
}

/// Stores the identified vehicle and its blades in the library, for your tenant; an existing one of the same name
/// is replaced.
#[utoipa::path(post, path = "/api/v1/identifications/{id}/keep", tag = "identifications", operation_id = "keep_identification",
    params(("id" = String, Path), ("If-Match" = Option<String>, Header), ("If-None-Match" = Option<String>, Header)), responses(
    (status = 201, description = "stored in the library", body = KeptVehicle, headers(("Location" = String, description = "URL of the vehicle"))),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "identification not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the job is not done", body = Problem, content_type = "application/problem+json"),
    (status = 412, description = "`If-Match` or `If-None-Match` does not hold for the vehicle", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the documents were rejected", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full, or quota of documents exceeded", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn keep(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    given: HeaderMap,
) -> Result<Response, Problem> {
    let Path(id) = id?;
    let precondition = documents::precondition(&given)?;
    let job = done(&app, &caller, JobKind::Identification, &id).await?;
    documents::check_precondition(&app, &caller, DocumentKind::Vehicle, &job.new.name, &precondition).await?;
    let texts: Texts =
        serde_json::from_str(&job.result.unwrap_or_default()).map_err(|error| Problem::internal(&error))?;
    let (name, folder) = (job.new.name, job.folder.unwrap_or_default());
    // Beside each other where the job wrote them, in two folders in the library.
    let vehicle = texts.vehicle.replace(
        &format!("\"{name}.blades.toml\""),
        &format!("\"../blades/{name}.toml\""),
    );
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/toml"));
    documents::put(&app, &caller, DocumentKind::Blades, &name, &headers, &texts.blades).await?;
    for condition in [header::IF_MATCH, header::IF_NONE_MATCH] {
        if let Some(value) = given.get(&condition) {
            headers.insert(condition, value.clone());
        }
    }
    documents::put(&app, &caller, DocumentKind::Vehicle, &name, &headers, &vehicle).await?;
    // With them the diagnosis knows which values are guesses.
    if let Some(intervals) = intervals_of(&app, &folder, &name).await? {
        let database = &app.database;
        let written = database
            .put_document(
                &caller.tenant,
                DocumentKind::Intervals,
                &name,
                &intervals,
                &Precondition::None,
            )
            .await?;
        if written == Written::Full {
            return Err(Problem::disk_full(format!(
                "'{}' has reached its quota of documents; delete some that are no longer needed",
                caller.tenant
            )));
        }
    }
    let location = format!("/api/v1/vehicles/{name}");
    let kept = KeptVehicle { vehicle: name };
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], Json(kept)).into_response())
}

/// What an identification knows of its constants; none where its files were deleted.
async fn intervals_of(app: &App, folder: &str, name: &str) -> Result<Option<String>, Problem> {
    let file = app.artifacts.file(folder, &format!("{name}.intervals.toml")).await;
    let Some(file) = file.map_err(|error| Problem::of_files(&error))? else {
        return Ok(None);
    };
    let text = tokio::fs::read_to_string(file).await;
    text.map(Some).map_err(|error| Problem::internal(&error))
}
