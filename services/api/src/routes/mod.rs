//! The addresses of the API, version 1, and the OpenAPI document that describes them.

mod artifacts;
mod events;
mod exports;
mod library;
mod live;
mod runs;
mod server;
mod telemetry;

use crate::App;
use crate::problem::Problem;
use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::{HeaderName, Method, Uri};
use std::sync::Arc;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{NotForContentType, Predicate as _, SizeAbove};
use tower_http::request_id::{MakeRequestUuid, PropagateRequestIdLayer, SetRequestIdLayer};
use tower_http::trace::TraceLayer;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// No request is larger.
const LARGEST_BODY: usize = 2 << 20;

#[derive(OpenApi)]
#[openapi(
    info(
        title = "rotortwin",
        description = "Submit flights of multirotors, watch them, fetch results. Every refusal is `application/problem+json`."
    ),
    tags(
        (name = "runs", description = "Flights: submit, list, watch, stop, compare"),
        (name = "telemetry", description = "What was recorded: channels, intervals, decimated so that a picture is true"),
        (name = "library", description = "Scenarios and vehicles that the server has"),
        (name = "server", description = "How the server is")
    )
)]
struct Api;

fn described() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::with_openapi(Api::openapi())
        .routes(routes!(runs::submit, runs::list))
        .routes(routes!(runs::get, runs::delete))
        .routes(routes!(runs::cancel))
        .routes(routes!(runs::fork))
        .routes(routes!(runs::verify))
        .routes(routes!(events::events))
        .routes(routes!(artifacts::list))
        .routes(routes!(artifacts::get))
        .routes(routes!(telemetry::channels))
        .routes(routes!(telemetry::telemetry))
        .routes(routes!(telemetry::compare))
        .routes(routes!(exports::export))
        .routes(routes!(live::live))
        .routes(routes!(library::scenarios))
        .routes(routes!(library::scenario))
        .routes(routes!(library::validate))
        .routes(routes!(library::vehicles))
        .routes(routes!(library::vehicle))
        .routes(routes!(server::healthz))
        .routes(routes!(server::readyz))
        .routes(routes!(server::metrics))
}

/// The OpenAPI 3.1 document, as served at `/api/v1/openapi.json`.
pub fn openapi_document() -> String {
    let (_, api) = described().split_for_parts();
    // The router's way to say "the rest of the path"; OpenAPI has none.
    let mut text = api.to_pretty_json().unwrap_or_default().replace("{*path}", "{path}");
    text.push('\n');
    text
}

/// Everything that is served.
pub(crate) fn router(app: Arc<App>) -> Router {
    let request_id = HeaderName::from_static("x-request-id");
    let (router, _) = described().split_for_parts();
    // Events must not wait in a compressor, and Parquet does not shrink.
    let compressible = SizeAbove::new(1024)
        .and(NotForContentType::new("text/event-stream"))
        .and(NotForContentType::new("application/octet-stream"))
        .and(NotForContentType::new("application/vnd.apache.parquet"));
    router
        .route("/", axum::routing::get(server::front))
        .route("/api/v1/openapi.json", axum::routing::get(server::openapi))
        .fallback(no_such_address)
        .method_not_allowed_fallback(wrong_method)
        .layer(DefaultBodyLimit::max(LARGEST_BODY))
        .layer(CompressionLayer::new().compress_when(compressible))
        .layer(PropagateRequestIdLayer::new(request_id.clone()))
        .layer(TraceLayer::new_for_http())
        .layer(SetRequestIdLayer::new(request_id, MakeRequestUuid))
        .with_state(app)
}

async fn no_such_address(uri: Uri) -> Problem {
    Problem::not_found(format!(
        "nothing is served at {}; /api/v1/openapi.json lists what is",
        uri.path()
    ))
}

async fn wrong_method(method: Method, uri: Uri) -> Problem {
    Problem::method_not_allowed(format!("{method} does not belong to {}", uri.path()))
}
