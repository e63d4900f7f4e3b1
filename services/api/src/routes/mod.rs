//! The addresses of the API, version 1, and the OpenAPI document that describes them.

mod all_events;
mod artifacts;
mod asked;
mod autopilots;
mod blind_benches;
mod blind_cases;
mod campaign_flights;
mod campaigns;
mod classifiers;
mod collection;
mod controllers;
mod documents;
mod events;
mod exports;
mod facts;
mod fdi;
mod fdi_events;
mod fdi_reports;
mod fdi_stream;
mod flights;
mod geometry;
mod identifications;
mod jobs;
mod library;
mod live;
mod log_examples;
mod log_mapping;
mod log_telemetry;
mod logs;
mod model_views;
mod models;
mod next_flights;
mod openapi;
mod parts;
mod queries;
mod residuals;
mod results;
mod runs;
mod sandbox;
mod server;
mod session;
mod stated;
mod submissions;
mod table;
mod tasks;
mod telemetry;
mod twin;
mod uploads;
mod verifications;
mod viewers;

pub(crate) use collection::collection;
pub(crate) use documents::documents;

use crate::App;
use crate::problem::Problem;
use crate::routes::stated::Stated;
use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::{HeaderName, HeaderValue, Method, Uri, header};
use std::sync::Arc;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{NotForContentType, Predicate as _, SizeAbove};
use tower_http::cors::CorsLayer;
use tower_http::request_id::{MakeRequestUuid, PropagateRequestIdLayer, SetRequestIdLayer};
use tower_http::timeout::RequestBodyTimeoutLayer;
use tower_http::trace::TraceLayer;
use utoipa::openapi::security::{ApiKey, ApiKeyValue, HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::{Modify, OpenApi};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// No request is larger.
const LARGEST_BODY: usize = 2 << 20;

#[derive(OpenApi)]
#[openapi(
    info(
        title = "rotortwin",
        description = "Submit multirotor flights, follow their progress and fetch results. Every error is `application/problem+json`."
    ),
    tags(
        (name = "runs", description = "Flights: submit, list, follow, cancel, compare"),
        (name = "autopilots", description = "Autopilots that operators have configured; runs select them by name"),
        (name = "telemetry", description = "Recorded data: channels and intervals, decimated without hiding extremes"),
        (name = "queries", description = "SQL over the files of runs, campaigns and blind benches"),
        (name = "campaigns", description = "Many flights, with statistics of the detectors"),
        (name = "blind_benches", description = "Tests of the diagnosis: logs with hidden effects, diagnosed and scored"),
        (name = "classifiers", description = "Neural networks trained on the server"),
        (name = "logs", description = "Flight logs: upload and import"),
        (name = "comparisons", description = "A model compared with flight logs"),
        (name = "diagnoses", description = "Which physical effect a model lacks"),
        (name = "improvements", description = "Compare, diagnose, extend the model, compare again"),
        (name = "next_flights", description = "The manoeuvre that would distinguish two effects"),
        (name = "identifications", description = "A vehicle identified from flight logs, its mass and its arm length"),
        (name = "models", description = "Versioned models: add, undo, branch, compare versions"),
        (name = "fdi", description = "Fault detection as a service: sessions that take measurements, and verdicts on whole logs"),
        (name = "library", description = "Scenarios, vehicles, blades, effects and models that jobs can name: the server's and your own"),
        (name = "verifications", description = "Runs flown a second time to compare their hashes"),
        (name = "server", description = "Health, limits and metrics of the server")
    ),
    components(schemas(
        rotortwin_jobs::JobFile, rotortwin_jobs::JobEvent, rotortwin_jobs::QueueEvent, rotortwin_wire::events::RunEvent, all_events::AnyEventData,
        fdi_events::ClosedSession, fdi_stream::FdiRefusal
    )),
    modifiers(&SignIn),
    security((), ("token" = []), ("session" = []))
)]
struct Api;

/// How a caller authenticates, where the server asks for it at all.
struct SignIn;

impl Modify for SignIn {
    fn modify(&self, document: &mut utoipa::openapi::OpenApi) {
        let token = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some(
            "A token of `rotortwin token create`; not needed until the first token has been created",
        ));
        let session = ApiKeyValue::with_description(
            crate::sessions::COOKIE,
            "A browser session, which `POST /api/v1/session` gives in exchange for a token",
        );
        let parts = document.components.get_or_insert_default();
        parts.add_security_scheme("token", SecurityScheme::Http(token.build()));
        parts.add_security_scheme("session", SecurityScheme::ApiKey(ApiKey::Cookie(session)));
    }
}

fn described() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::with_openapi(Api::openapi())
        .routes(routes!(submissions::submit, runs::list))
        .routes(routes!(runs::get, runs::delete))
        .routes(routes!(runs::cancel))
        .routes(routes!(submissions::fork))
        .routes(routes!(verifications::verify))
        .merge(verifications::verifications::routes())
        .routes(routes!(runs::ticket))
        .routes(routes!(autopilots::list))
        .routes(routes!(controllers::compare))
        .routes(routes!(table::table))
        .routes(routes!(queries::query))
        .routes(routes!(events::events))
        .routes(routes!(artifacts::list))
        .routes(routes!(artifacts::get))
        .routes(routes!(telemetry::channels))
        .routes(routes!(telemetry::telemetry))
        .routes(routes!(telemetry::compare))
        .routes(routes!(exports::export))
        .routes(routes!(live::live))
        .routes(routes!(viewers::view))
        .routes(routes!(campaigns::submit))
        .merge(campaigns::campaigns::routes())
        .routes(routes!(campaign_flights::list))
        .routes(routes!(campaign_flights::fly))
        .routes(routes!(blind_benches::submit))
        .merge(blind_benches::blind_benches::routes())
        .routes(routes!(blind_cases::list))
        .routes(routes!(blind_cases::get))
        .routes(routes!(blind_cases::log))
        .routes(routes!(classifiers::submit))
        .routes(routes!(classifiers::evaluate))
        .merge(classifiers::classifiers::routes())
        .routes(routes!(log_examples::generate))
        .routes(routes!(log_examples::truth))
        .routes(routes!(flights::of_log))
        .routes(routes!(sandbox::picture))
        .routes(routes!(flights::of_run))
        .routes(routes!(log_telemetry::channels))
        .routes(routes!(log_telemetry::telemetry))
        .routes(routes!(log_mapping::draft))
        .routes(routes!(logs::again))
        .routes(routes!(logs::submit))
        .merge(logs::logs::routes())
        .routes(routes!(twin::compare))
        .routes(routes!(residuals::series))
        .routes(routes!(residuals::conditions))
        .merge(twin::comparisons::routes())
        .routes(routes!(twin::diagnose))
        .merge(twin::diagnoses::routes())
        .routes(routes!(twin::improve))
        .merge(twin::improvements::routes())
        .routes(routes!(next_flights::submit))
        .merge(next_flights::next_flights::routes())
        .routes(routes!(identifications::submit))
        .routes(routes!(identifications::keep))
        .merge(identifications::identifications::routes())
        .routes(routes!(fdi::open, fdi::list))
        .routes(routes!(fdi::get, fdi::close))
        .routes(routes!(fdi::feed))
        .routes(routes!(fdi_stream::stream))
        .routes(routes!(fdi_events::events))
        .routes(routes!(fdi_reports::judge))
        .routes(routes!(fdi_reports::score))
        .merge(library::scenarios::routes())
        .routes(routes!(library::validate_scenario))
        .merge(library::vehicles::routes())
        .routes(routes!(library::validate_vehicle))
        .merge(library::blades::routes())
        .routes(routes!(library::validate_blades))
        .merge(library::effects::routes())
        .routes(routes!(library::validate_effect))
        .merge(library::models::routes())
        .routes(routes!(library::validate_model))
        .routes(routes!(geometry::of_vehicle))
        .routes(routes!(geometry::of_run))
        .routes(routes!(geometry::of_model))
        .routes(routes!(models::create))
        .routes(routes!(models::history))
        .routes(routes!(models::add))
        .routes(routes!(models::undo))
        .routes(routes!(models::branch))
        .routes(routes!(models::diff))
        .routes(routes!(models::version))
        .routes(routes!(library::catalogue))
        .routes(routes!(library::campaigns))
        .routes(routes!(all_events::events))
        .routes(routes!(session::get, session::sign_in, session::sign_out))
        .routes(routes!(server::limits))
        .routes(routes!(server::healthz))
        .routes(routes!(server::readyz))
        .routes(routes!(server::metrics))
}

/// The OpenAPI 3.1 document, as served at `/api/v1/openapi.json`.
pub fn openapi_document() -> String {
    let (_, mut api) = described().split_for_parts();
    openapi::complete(&mut api);
    // The router's way to say "the rest of the path"; OpenAPI has none.
    let mut text = api.to_pretty_json().unwrap_or_default().replace("{*path}", "{path}");
    text.push('\n');
    text
}

/// Everything that is served.
pub(crate) fn router(app: Arc<App>) -> Router {
    let request_id = HeaderName::from_static("x-request-id");
    let (router, mut api) = described().split_for_parts();
    openapi::complete(&mut api);
    let stated = Arc::new(Stated::of(&api));
    // Events must not wait in a compressor, and Parquet does not shrink.
    let compressible = SizeAbove::new(1024)
        .and(NotForContentType::new("text/event-stream"))
        .and(NotForContentType::new("application/octet-stream"))
        .and(NotForContentType::new("application/vnd.apache.parquet"));
    let router = router
        .layer(axum::middleware::from_fn_with_state(stated, stated::hold))
        .route("/api/v1/openapi.json", axum::routing::get(server::openapi))
        .merge(parts::routes())
        .merge(crate::manual::routes())
        .fallback(crate::web::page)
        .method_not_allowed_fallback(wrong_method)
        .layer(axum::middleware::from_fn_with_state(
            Arc::clone(&app),
            crate::access::authorize,
        ))
        .layer(axum::middleware::from_fn_with_state(
            Arc::clone(&app),
            crate::metrics::measure,
        ))
        .layer(DefaultBodyLimit::max(LARGEST_BODY))
        .layer(RequestBodyTimeoutLayer::new(crate::connections::BODY_PAUSE))
        .layer(cors(&app))
        .layer(CompressionLayer::new().compress_when(compressible));
    let router = router
        .layer(axum::middleware::from_fn_with_state(
            Arc::clone(&app),
            crate::browsers::guard,
        ))
        .layer(axum::middleware::from_fn(crate::connections::fit))
        .layer(axum::middleware::from_fn(crate::browsers::mark));
    let router = if app.context.traces.are_on() {
        let traced = axum::middleware::from_fn_with_state(Arc::clone(&app), crate::traces::request);
        router.layer(traced)
    } else {
        router
    };
    router
        .layer(PropagateRequestIdLayer::new(request_id.clone()))
        .layer(TraceLayer::new_for_http())
        .layer(SetRequestIdLayer::new(request_id, MakeRequestUuid))
        .with_state(app)
}

/// Off unless origins are named.
fn cors(app: &App) -> CorsLayer {
    let origins: Vec<HeaderValue> = app
        .config
        .cors_origins
        .iter()
        .filter_map(|origin| HeaderValue::from_str(origin).ok())
        .collect();
    if origins.is_empty() {
        return CorsLayer::new();
    }
    CorsLayer::new()
        .allow_origin(origins)
        .allow_methods([Method::GET, Method::POST, Method::PUT, Method::DELETE])
        .allow_headers([
            header::AUTHORIZATION,
            header::CONTENT_TYPE,
            header::IF_MATCH,
            header::IF_NONE_MATCH,
            HeaderName::from_static("idempotency-key"),
            HeaderName::from_static("last-event-id"),
        ])
        .expose_headers([header::LOCATION, header::ETAG, HeaderName::from_static("x-request-id")])
}

async fn wrong_method(method: Method, uri: Uri) -> Problem {
    Problem::method_not_allowed(format!("method {method} is not allowed for {}", uri.path()))
}
