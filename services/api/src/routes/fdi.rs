//! FDI as a service: sessions that are opened, fed in chunks, read and closed.

use crate::App;
use crate::access::Caller;
use crate::fdi::samples::{self, Form, SampleBody};
use crate::fdi::sessions::{Entry, SessionView};
use crate::json_object::JsonObject;
use crate::library::Library;
use crate::problem::Problem;
use axum::Json;
use axum::body::Bytes;
use axum::extract::rejection::{BytesRejection, PathRejection, QueryRejection};
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use rotortwin_fdi_session::session::{LONGEST_BRIDGE, LONGEST_CHUNK, REMEMBERED};
use rotortwin_fdi_session::{Chunk, Refusal};
use rotortwin_scenario::settings::NominalThrustModel;
use rotortwin_scenario::{DetectorSettings, Detectors};
use rotortwin_verdicts::view::ChunkAnswer;
use rotortwin_zenoh::fdi_topic::{measurement_topic, report_topic};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use utoipa::{IntoParams, ToSchema};

/// Longer chunks are parsed and judged away from the threads that serve everybody.
const SHORT_BODY: usize = 64 << 10;

/// Rotor model of the residual generators.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum RotorModel {
    /// Thrust map at once, as in the paper.
    Static,
    /// Thrust map through the vehicle's lag.
    Lagged,
    /// Full thrust times duty.
    Linear,
}

/// Settings of the detectors, as in the `[fdi]` table of a scenario; absent keys are as the classifier was
/// trained, otherwise the scenario defaults.
#[derive(Debug, Clone, Default, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct SettingsBody {
    /// Samples of 2.5 ms per decision.
    #[schema(minimum = 2, maximum = 1000)]
    window_samples: Option<u16>,
    /// Gain of the residual generators, 1/s.
    observer_gain_1_s: Option<f64>,
    /// Rotor model of the residual generators.
    nominal_thrust: Option<RotorModel>,
    /// Significance of the T-test's detection.
    alpha_detect: Option<f64>,
    /// Significance of the T-test's isolation.
    alpha_isolate: Option<f64>,
    /// Start of the calibration, s.
    calibration_start_s: Option<f64>,
    /// End of the calibration, s.
    calibration_end_s: Option<f64>,
}

impl From<SettingsBody> for DetectorSettings {
    fn from(body: SettingsBody) -> Self {
        Self {
            window_samples: body.window_samples,
            observer_gain_1_s: body.observer_gain_1_s,
            nominal_thrust: body.nominal_thrust.map(|model| match model {
                RotorModel::Static => NominalThrustModel::Static,
                RotorModel::Lagged => NominalThrustModel::Lagged,
                RotorModel::Linear => NominalThrustModel::Linear,
            }),
            alpha_detect: body.alpha_detect,
            alpha_isolate: body.alpha_isolate,
            calibration_start_s: body.calibration_start_s,
            calibration_end_s: body.calibration_end_s,
        }
    }
}

/// A session to open.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SessionBody {
    /// Name of one of the server's vehicles; or give `vehicle_text`.
    #[serde(default)]
    vehicle: Option<String>,
    /// A vehicle document (TOML), as in the library's `vehicles`.
    #[serde(default)]
    vehicle_text: Option<String>,
    /// Name of one of the server's classifiers; without one the network gives no verdict.
    #[serde(default)]
    classifier: Option<String>,
    /// Settings of the detectors.
    #[serde(default)]
    settings: SettingsBody,
    /// Also take measurements over zenoh; the server must have been started with `--fdi-link`.
    #[serde(default)]
    topic: bool,
}

/// A field of a sample.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct FieldView {
    /// Name in JSON.
    name: &'static str,
    /// Columns in CSV.
    columns: &'static str,
    /// Unit.
    unit: &'static str,
    /// Meaning.
    meaning: &'static str,
}

const FIELDS: [FieldView; 7] = [
    FieldView {
        name: "velocity_ned_m_s",
        columns: "velocity_north_m_s, velocity_east_m_s, velocity_down_m_s",
        unit: "m/s",
        meaning: "over ground, world NED",
    },
    FieldView {
        name: "attitude_rad",
        columns: "roll_rad, pitch_rad, yaw_rad",
        unit: "rad",
        meaning: "Euler angles ZYX, body in NED",
    },
    FieldView {
        name: "body_rates_rad_s",
        columns: "roll_rate_rad_s, pitch_rate_rad_s, yaw_rate_rad_s",
        unit: "rad/s",
        meaning: "p, q, r, body FRD",
    },
    FieldView {
        name: "duty",
        columns: "duty_1, duty_2, …",
        unit: "fraction",
        meaning: "commanded to each rotor, held from this sample to the next",
    },
    FieldView {
        name: "battery_voltage_v",
        columns: "battery_voltage_v",
        unit: "V",
        meaning: "at the terminals",
    },
    FieldView {
        name: "position_ned_m",
        columns: "position_north_m, position_east_m, position_down_m",
        unit: "m",
        meaning: "optional; the detectors do not use it",
    },
    FieldView {
        name: "time_s",
        columns: "time_s",
        unit: "s",
        meaning: "optional; by any clock, finds wrong rates and unnoticed gaps",
    },
];

/// Input format and endpoints of a session.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct FeedView {
    /// POST chunks here with `?first_step=N`.
    measurements: String,
    /// WebSocket.
    stream: String,
    /// zenoh topic for `FdiMeasurements` (proto/rotortwin/v1/fdi_service.proto), if requested.
    measurement_topic: Option<String>,
    /// zenoh topic of `FdiVerdicts`.
    report_topic: Option<String>,
    /// Fields of a sample.
    fields: Vec<FieldView>,
    /// Maximum number of samples in a chunk.
    longest_chunk: usize,
    /// Number of recent chunks that may be sent again; they get the same response.
    remembered_chunks: usize,
    /// Maximum number of lost steps that are bridged (`after_gap`); longer gaps restart the calibration.
    longest_bridge: u64,
}

/// A session that was opened.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct OpenedSession {
    /// Its state.
    session: SessionView,
    /// What to send.
    feed: FeedView,
}

/// The detectors that a request means.
pub(crate) fn detectors(
    library: &Library,
    vehicle: Option<&str>,
    vehicle_text: Option<&str>,
    classifier: Option<&str>,
    settings: &DetectorSettings,
) -> Result<Detectors, Problem> {
    let vehicle = match (vehicle, vehicle_text) {
        (Some(name), None) => library.vehicle_documents(name)?,
        (None, Some(text)) => library.parse_vehicle(text)?,
        _ => {
            return Err(Problem::unprocessable(
                "expected either `vehicle`, the name of one of the server's vehicles, or `vehicle_text`, a vehicle document",
            ));
        }
    };
    let classifier = classifier.map(|name| library.classifier(name)).transpose()?;
    Detectors::new(vehicle, settings, classifier)
        .map_err(|refusal| Problem::unprocessable(format!("`{}`: {}", refusal.key, refusal.reason)))
}

/// Opens a session.
#[utoipa::path(post, path = "/api/v1/fdi/sessions", tag = "fdi", operation_id = "open_fdi_session", request_body = SessionBody, responses(
    (status = 201, description = "opened; closes after its idle time or when the server shuts down", body = OpenedSession,
     headers(("Location" = String, description = "URL of the session"))),
    (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "vehicle or classifier not found", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
    (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "no detectors can be built for this model", body = Problem, content_type = "application/problem+json"),
    (status = 429, description = "more requests or open sessions than are allowed", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "other tenants have too many sessions open, or the server is shutting down", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn open(
    State(app): State<Arc<App>>,
    caller: Caller,
    body: Result<JsonObject<SessionBody>, Problem>,
) -> Result<Response, Problem> {
    let JsonObject(body) = body?;
    if app.is_ending() {
        return Err(Problem::unavailable("the server is ending"));
    }
    let library = app.library(&caller).await?;
    let (vehicle, text) = (body.vehicle.as_deref(), body.vehicle_text.as_deref());
    let (classifier, settings) = (body.classifier.as_deref(), body.settings.into());
    let made = || detectors(&library, vehicle, text, classifier, &settings);
    let detectors = app.readers.read(made).await?;
    if body.topic && !app.fdi.has_link() {
        return Err(Problem::unprocessable(
            "`topic` is true, but this server accepts no measurements over zenoh; start it with --fdi-link",
        ));
    }
    let entry = app.fdi.open(&caller, &detectors)?;
    if body.topic {
        let (app, entry) = (Arc::clone(&app), Arc::clone(&entry));
        tokio::task::spawn_blocking(move || app.fdi.give_topic(&entry))
            .await
            .map_err(|error| Problem::internal(&error))??;
    }
    let address = format!("/api/v1/fdi/sessions/{}", entry.id);
    let topic = |name: fn(&str) -> String| body.topic.then(|| name(&entry.id));
    let feed = FeedView {
        measurements: format!("{address}/measurements"),
        stream: format!("{address}/stream"),
        measurement_topic: topic(measurement_topic),
        report_topic: topic(report_topic),
        fields: Vec::from(FIELDS),
        longest_chunk: LONGEST_CHUNK,
        remembered_chunks: REMEMBERED,
        longest_bridge: LONGEST_BRIDGE,
    };
    let session = app.fdi.view(&entry);
    Ok((
        StatusCode::CREATED,
        [(header::LOCATION, address)],
        Json(OpenedSession { session, feed }),
    )
        .into_response())
}

/// The session of this id.
pub(crate) fn find(app: &App, caller: &Caller, id: Result<Path<String>, PathRejection>) -> Result<Arc<Entry>, Problem> {
    let Path(id) = id?;
    app.fdi.get(caller, &id)
}

/// Open sessions.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct OpenSessions {
    items: Vec<SessionView>,
}

impl OpenSessions {
    pub(super) fn of(items: Vec<SessionView>) -> Self {
        Self { items }
    }
}

/// Your open sessions. Listing them does not keep them alive.
#[utoipa::path(get, path = "/api/v1/fdi/sessions", tag = "fdi", operation_id = "list_fdi_sessions", responses(
    (status = 200, description = "the sessions", body = OpenSessions)
))]
pub(crate) async fn list(State(app): State<Arc<App>>, caller: Caller) -> Json<OpenSessions> {
    Json(OpenSessions {
        items: app.fdi.list(&caller),
    })
}

/// A session and its state.
#[utoipa::path(get, path = "/api/v1/fdi/sessions/{id}", tag = "fdi", operation_id = "get_fdi_session", params(("id" = String, Path)), responses(
    (status = 200, description = "the session", body = SessionView),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "session not found", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn get(
    State(app): State<Arc<App>>,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<SessionView>, Problem> {
    let entry = find(&app, &caller, id)?;
    Ok(Json(app.fdi.view(&entry)))
}

/// Closes a session.
#[utoipa::path(delete, path = "/api/v1/fdi/sessions/{id}", tag = "fdi", operation_id = "close_fdi_session", params(("id" = String, Path)), responses(
    (status = 204, description = "closed"),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "session not found", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn close(
    State(app): State<Arc<App>>,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<StatusCode, Problem> {
    let Path(id) = id?;
    let entry = app.fdi.close(&caller, &id)?;
    // Its topic is undeclared when the last one lets go, which may wait for the network.
    tokio::task::spawn_blocking(move || drop(entry))
        .await
        .map_err(|error| Problem::internal(&error))?;
    Ok(StatusCode::NO_CONTENT)
}

/// Where a chunk belongs.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct Place {
    /// Step of the chunk's first sample; each chunk continues where the one before ended.
    first_step: u64,
    /// The steps between the last chunk and this one are permanently lost. Without it a gap is rejected.
    #[serde(default)]
    #[param(default = false)]
    after_gap: bool,
}

/// What a refusal of a session is in HTTP.
fn problem(refusal: &Refusal) -> Problem {
    match refusal {
        Refusal::Gap { .. } | Refusal::Past { .. } => Problem::conflict(refusal.to_string()),
        _ => Problem::unprocessable(refusal.to_string()),
    }
}

/// Accepts a chunk of measurements and returns the verdicts of the windows that end in it.
///
/// A chunk is accepted or rejected as a whole. Recent chunks may be sent again: they get the same response.
#[utoipa::path(post, path = "/api/v1/fdi/sessions/{id}/measurements", tag = "fdi", operation_id = "feed_fdi_session", params(("id" = String, Path), Place),
    request_body(description = "samples at 400 Hz", content(
        (Vec<SampleBody> = "application/json"), (String = "application/x-ndjson"), (String = "text/csv"))),
    responses(
        (status = 200, description = "accepted", body = ChunkAnswer),
        (status = 400, description = "empty text, or invalid parameter", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "session not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "not the next expected step", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "neither JSON, JSON lines nor CSV", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "malformed sample, impossible value, or another rate", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn feed(
    State(app): State<Arc<App>>,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    place: Result<Query<Place>, QueryRejection>,
    headers: HeaderMap,
    body: Result<Bytes, BytesRejection>,
) -> Result<Json<ChunkAnswer>, Problem> {
    let entry = find(&app, &caller, id)?;
    let Query(place) = place?;
    let form = Form::of(headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()))?;
    let body = body?;
    let work = move || -> Result<ChunkAnswer, Problem> {
        let chunk = Chunk {
            first_step: place.first_step,
            after_gap: place.after_gap,
            samples: samples::read(form, &body, entry.rotor_count)?,
        };
        entry.feed(&chunk).map_err(|(refusal, _)| problem(&refusal))
    };
    // A short chunk takes less time than to hand it over.
    if headers
        .get(header::CONTENT_LENGTH)
        .and_then(|value| value.to_str().ok()?.parse::<usize>().ok())
        .is_some_and(|length| length <= SHORT_BODY)
    {
        return work().map(Json);
    }
    let answer = tokio::task::spawn_blocking(work).await;
    answer.map_err(|error| Problem::internal(&error))?.map(Json)
}
