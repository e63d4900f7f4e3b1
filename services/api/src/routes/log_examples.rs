//! Example logs for a first visit: flown by the independent simulator in a process of its own, with the truth kept
//! separate.

use super::facts::{ExampleFacts, JobFacts};
use super::jobs::{self, JobView, Shared, Terms};
use super::tasks::{Draft, LIBRARY, OUT, done, laid_out};
use crate::access::Caller;
use crate::json_object::JsonObject;
use crate::problem::Problem;
use axum::Json;
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_blind::error::BlindError;
use rotortwin_blind::example::{self, Example};
use rotortwin_blind::hidden::Hidden;
use rotortwin_blind::truth::Truth;
use rotortwin_blind::vehicle::Vehicle;
use rotortwin_jobs::{JobKind, LogExample, StoredJob};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What is hidden, among the files of the log.
const TRUTH: &str = "truth.json";
/// Taken where no vehicle is named.
const USUAL_VEHICLE: &str = "f550";
/// s.
const DURATION_S: [f64; 2] = [10.0, 600.0];

/// Purpose of an example.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ExamplePreset {
    /// One effect that the vehicle's model lacks.
    HiddenEffect,
    /// One rotor that loses some of its thrust in mid-flight.
    DamagedBlade,
    /// A vehicle that agrees with its model.
    Healthy,
}

impl From<ExamplePreset> for Example {
    fn from(preset: ExamplePreset) -> Self {
        match preset {
            ExamplePreset::HiddenEffect => Self::HiddenEffect,
            ExamplePreset::DamagedBlade => Self::DamagedBlade,
            ExamplePreset::Healthy => Self::Healthy,
        }
    }
}

/// An example to fly: a preset, or an effect.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ExampleSubmission {
    /// Preset.
    preset: Option<ExamplePreset>,
    /// Hidden effect: an id, with size and rotor drawn from the seed, or `id:parameter=value,…`.
    #[schema(max_length = 200)]
    effect: Option<String>,
    /// Seed of all random streams and draws; by default a new one each time, of a preset alone one of which the diagnosis was checked.
    seed: Option<u64>,
    /// Name of one of the library's vehicles; default `f550`.
    vehicle: Option<String>,
    /// Length of the flight, s; default 60.
    #[schema(minimum = 10, maximum = 600)]
    duration_s: Option<f64>,
}

/// Generates an example log with the independent simulator, with or without a hidden effect: a log like any other.
///
/// The job does not reveal what is hidden; `GET /api/v1/logs/{id}/truth` does.
#[utoipa::path(post, path = "/api/v1/logs/generate", tag = "logs", operation_id = "generate_log", request_body = ExampleSubmission,
    params(("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key and body returns the existing log")),
    responses(
        (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = JobView,
         headers(("Location" = String, description = "URL of the log"))),
        (status = 200, description = "already accepted under this Idempotency-Key", body = JobView),
        (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "vehicle not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "this Idempotency-Key was used with a different body", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "the example cannot be flown with these settings", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn generate(
    app: Shared,
    caller: Caller,
    headers: HeaderMap,
    body: Result<JsonObject<ExampleSubmission>, Problem>,
) -> Result<Response, Problem> {
    let JsonObject(body) = body?;
    let hash = jobs::request_hash(&body);
    if let Some(answer) = jobs::before(&app, &caller, JobKind::Log, &headers, &hash, JobView::from).await? {
        return Ok(answer);
    }
    if body.preset.is_some() == body.effect.is_some() {
        return Err(Problem::unprocessable("expected either `preset` or `effect`"));
    }
    let duration_s = body.duration_s.unwrap_or(example::SHOWN_S);
    if !(DURATION_S[0]..=DURATION_S[1]).contains(&duration_s) {
        return Err(Problem::unprocessable(format!(
            "`duration_s` is {duration_s}; expected {} to {}",
            DURATION_S[0], DURATION_S[1]
        )));
    }
    let library = app.library(&caller).await?;
    let name = body.vehicle.as_deref().unwrap_or(USUAL_VEHICLE);
    library.text("vehicles", name)?;
    let seed = body.seed.unwrap_or_else(|| a_seed(&body));
    if let Some(effect) = &body.effect {
        // What the simulator would refuse is refused now.
        let refused = |error: BlindError| library.refusal(&error);
        let path = library.root().join("vehicles").join(format!("{name}.toml"));
        let vehicle = app.readers.read(|| Vehicle::load(&path)).await.map_err(refused)?;
        example::effect(effect, vehicle.rotors.len(), seed).map_err(refused)?;
    }
    let example = LogExample {
        vehicle: format!("{LIBRARY}/vehicles/{name}.toml").into(),
        preset: body.preset.map(Example::from),
        effect: body.effect.clone(),
        seed,
        duration_s,
        case: None,
        out: OUT.into(),
    };
    let draft = Draft {
        kind: JobKind::Log,
        name: format!("example-{:04x}.parquet", rand::random::<u16>()),
        facts: JobFacts::Example(ExampleFacts {
            example: true,
            vehicle: name.to_owned(),
            duration_s,
            case: None,
        }),
        stored: StoredJob {
            job: rotortwin_jobs::Job::LogExample(example),
            inputs: vec![laid_out(&app, &library).await?],
        },
        terms: Terms::default(),
    };
    draft.submit(&app, &caller, &headers, &body, Vec::new()).await
}

/// A seed that was not given: of an example of a first visit one of those that were flown through the whole loop.
fn a_seed(body: &ExampleSubmission) -> u64 {
    let random = rand::random::<u32>();
    let alone = body.vehicle.is_none() && body.duration_s.is_none();
    let shown = body
        .preset
        .filter(|_| alone)
        .map(|preset| Example::from(preset).seeds());
    let one_of = |seeds: &[u64]| seeds.get(random as usize % seeds.len().max(1)).copied();
    shown.and_then(one_of).unwrap_or(u64::from(random))
}

/// What was hidden in an example.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct HiddenTruth {
    /// Hidden effects; empty: none.
    effects: Vec<Hidden>,
    /// Name of the vehicle.
    vehicle: String,
    /// Seed of all random streams.
    seed: u64,
    /// s.
    duration_s: f64,
    /// Charge at the start, fraction.
    state_of_charge: f64,
    /// Lift bias of each rotor, N: a nuisance parameter of the comparison.
    lift_biases_n: Vec<f64>,
}

impl From<Truth> for HiddenTruth {
    fn from(truth: Truth) -> Self {
        Self {
            effects: truth.effects,
            vehicle: truth.vehicle,
            seed: truth.seed,
            duration_s: truth.duration_s,
            state_of_charge: truth.state_of_charge,
            lift_biases_n: truth.lift_biases_n,
        }
    }
}

/// Returns the hidden effects of an example log.
#[utoipa::path(get, path = "/api/v1/logs/{id}/truth", tag = "logs", operation_id = "log_truth", params(("id" = String, Path)), responses(
    (status = 200, description = "the truth", body = HiddenTruth),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "log not found, or its truth is unknown", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the job is not done", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn truth(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<HiddenTruth>, Problem> {
    let Path(id) = id?;
    let job = done(&app, &caller, JobKind::Log, &id).await?;
    let folder = job.folder.unwrap_or_default();
    let file = app.artifacts.file(&folder, TRUTH).await;
    let file = file.map_err(|error| Problem::of_files(&error))?.ok_or_else(|| {
        Problem::not_found(format!(
            "the log {id} is not an example: its hidden effects are not known"
        ))
    })?;
    let truth = Truth::load(&file).map_err(|error| Problem::internal(&error))?;
    Ok(Json(truth.into()))
}
