//! For nodes of an external cluster that execute parts: what they fetch, and deliver. Not for users, and undocumented:
//! both ends come from one build ([`crate::worker::handed`]).

use crate::App;
use crate::json_object::JsonObject;
use crate::problem::Problem;
use crate::routes::uploads::Upload;
use crate::worker::handed::{self, Delivery};
use crate::worker::ray;
use axum::body::Body;
use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::routing::{get, post, put};
use axum::{Json, Router};
use rotortwin_jobs::{PartAccepted, PartEnd, PartEvents, PartHow, PartOrder};
use std::num::NonZeroUsize;
use std::sync::Arc;

type Attempt = Path<(String, i64)>;
type FileOfAttempt = Path<(String, i64, String)>;

pub(super) fn routes() -> Router<Arc<App>> {
    Router::new()
        .route("/executor/v1/parts/{id}/{attempt}", get(order))
        .route("/executor/v1/parts/{id}/{attempt}/inputs/{*path}", get(input))
        .route(
            "/executor/v1/parts/{id}/{attempt}/files/{*path}",
            put(file).layer(DefaultBodyLimit::disable()),
        )
        .route("/executor/v1/parts/{id}/{attempt}/events", post(events))
        .route("/executor/v1/parts/{id}/{attempt}/end", post(end))
}

fn ticket(headers: &HeaderMap) -> Result<&str, Problem> {
    let value = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
    value
        .and_then(|value| value.strip_prefix("Bearer "))
        .ok_or_else(|| Problem::unauthorized("expected `Authorization: Bearer TICKET`, the ticket of this attempt"))
}

async fn order(
    State(app): State<Arc<App>>,
    Path((id, attempt)): Attempt,
    headers: HeaderMap,
) -> Result<Json<PartOrder>, Problem> {
    let (job, _) = handed::find(&app.context, &id, attempt, ticket(&headers)?).await?;
    let cpus = app.context.ray.as_ref().map_or(1.0, |ray| ray.config.cpus);
    let threads = NonZeroUsize::new(cpus as usize).unwrap_or(NonZeroUsize::MIN);
    Ok(Json(handed::order(&app.context, &job, threads).await?))
}

async fn input(
    State(app): State<Arc<App>>,
    Path((id, attempt, path)): FileOfAttempt,
    headers: HeaderMap,
) -> Result<Vec<u8>, Problem> {
    let (job, _) = handed::find(&app.context, &id, attempt, ticket(&headers)?).await?;
    let file = handed::input(&app.context, &job, &path).await?;
    tokio::fs::read(file).await.map_err(|error| Problem::of_files(&error))
}

async fn file(
    State(app): State<Arc<App>>,
    Path((id, attempt, path)): FileOfAttempt,
    headers: HeaderMap,
    body: Body,
) -> Result<StatusCode, Problem> {
    let secret = ticket(&headers)?;
    let (job, _) = handed::find(&app.context, &id, attempt, secret).await?;
    let delivery = Delivery::begin(&app.context, &job, &path)?;
    let upload = Upload {
        most: handed::LARGEST_DELIVERY,
        too_large: "the file is larger than a part may deliver",
        broken: "the file arrived incomplete",
        full: "the file cannot be kept: the disk is full",
    };
    let written = upload
        .write(body, tokio::fs::File::create(&delivery.beside).await, |_| {})
        .await;
    // The attempt may have ended meanwhile, and its files count or are gone.
    let still = match written {
        Ok(_) => handed::find(&app.context, &id, attempt, secret).await.map(drop),
        Err(problem) => Err(problem),
    };
    match still {
        Ok(()) => delivery.keep().map(|()| StatusCode::NO_CONTENT),
        Err(problem) => {
            delivery.discard();
            Err(problem)
        }
    }
}

async fn events(
    State(app): State<Arc<App>>,
    Path((id, attempt)): Attempt,
    headers: HeaderMap,
    body: Result<JsonObject<PartEvents>, Problem>,
) -> Result<StatusCode, Problem> {
    let (job, claim) = handed::find(&app.context, &id, attempt, ticket(&headers)?).await?;
    let JsonObject(body) = body?;
    handed::events(&app.context, &job, &claim, &body.lines).await?;
    Ok(StatusCode::NO_CONTENT)
}

async fn end(
    State(app): State<Arc<App>>,
    Path((id, attempt)): Attempt,
    headers: HeaderMap,
    body: Result<JsonObject<PartEnd>, Problem>,
) -> Result<Json<PartAccepted>, Problem> {
    let secret = ticket(&headers)?;
    let JsonObject(body) = body?;
    let ticket = handed::end(&app.context, &id, attempt, secret, &body).await?;
    let next = match &app.context.ray {
        Some(ray) if body.wants_more && matches!(body.how, PartHow::Done { .. }) => {
            ray::hand_on(&app.context, ray, &ticket).await
        }
        _ => None,
    };
    Ok(Json(PartAccepted { next }))
}
