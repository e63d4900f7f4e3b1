//! One stream of the events of all jobs of the caller: browsers open few connections, and a page shows many jobs.

use super::jobs::Shared;
use crate::App;
use crate::access::Caller;
use crate::jobs::{EventPlace, PlacedEvent};
use crate::problem::Problem;
use axum::extract::Query;
use axum::extract::rejection::QueryRejection;
use axum::http::HeaderMap;
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse as _, Response};
use rotortwin_jobs::JobKind;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio_stream::Stream;
use utoipa::{IntoParams, ToSchema};

/// Events requested from the database at a time.
const BATCH: i64 = 500;
/// Another process may have written, or an event may have waited for a transaction concurrent with its own.
const LOOK: Duration = Duration::from_secs(1);

/// Which events.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct StreamQuery {
    /// Resume after this event (an `id` of the stream), as with `Last-Event-ID`.
    #[param(pattern = "^[0-9]{1,18}[.][0-9]{1,18}$")]
    after: Option<String>,
    /// `false`: without the kind `progress`.
    #[param(default = true)]
    progress: Option<bool>,
    /// `false`: end the stream after the current events.
    #[param(default = true)]
    wait: Option<bool>,
}

/// An event of the stream.
#[derive(ToSchema)]
#[expect(dead_code, reason = "for the OpenAPI document: axum writes the fields")]
pub(crate) struct AnyEvent {
    /// Position in the stream: the value for `Last-Event-ID` and `after`.
    id: String,
    /// Kind, such as `ended`; `open` belongs to the stream itself and gives the position at which it begins.
    event: String,
    /// A JSON object as [`AnyEventData`] has it; empty for `open`.
    data: String,
}

/// What an event of the stream says: the JSON object in its `data`.
#[derive(Serialize, ToSchema)]
pub(crate) struct AnyEventData {
    /// Id of the job.
    job: String,
    /// Its collection, such as `runs`.
    collection: &'static str,
    /// Its kind.
    kind: JobKind,
    /// Number of the event in the stream of that job.
    seq: i64,
    /// What the event says there.
    #[schema(value_type = Object)]
    data: Value,
}

/// The events of all jobs of the caller as they happen (server-sent), whatever their kind.
///
/// The first event is `open`, whose id is the current position: a list fetched after it misses nothing. With `Last-Event-ID` the
/// stream resumes after that event, without gaps or repetition, even across restarts of the server. Parts of campaigns and benches are left out.
#[utoipa::path(get, path = "/api/v1/events", tag = "server", operation_id = "all_events",
    params(StreamQuery, ("Last-Event-ID" = Option<String>, Header, pattern = "^[0-9]{1,18}[.][0-9]{1,18}$", description = "id of the last event received")),
    responses(
        (status = 200, description = "stream of events", body = AnyEvent, content_type = "text/event-stream"),
        (status = 400, description = "invalid event id, or unknown parameter", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn events(
    app: Shared,
    caller: Caller,
    query: Result<Query<StreamQuery>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Query(query) = query?;
    let last = match headers.get("last-event-id") {
        Some(value) => Some(value.to_str().unwrap_or("(unreadable)").to_owned()),
        None => query.after,
    };
    // Subscribed before the first look: an event in between is seen by one or the other.
    let news = app.database.hub.watch_any();
    let (place, opened) = match last {
        Some(text) => (text.parse().map_err(Problem::bad_request)?, None),
        None => {
            let place = app.database.last_place().await?;
            (place, Some(place))
        }
    };
    let watcher = Watcher {
        news,
        ending: app.context.ending.subscribe(),
        tenant: caller.tenant_filter().map(str::to_owned),
        app: Arc::clone(&app),
        place,
        progress: query.progress.unwrap_or(true),
        wait: query.wait.unwrap_or(true),
        ready: VecDeque::new(),
    };
    let keep_alive = KeepAlive::new().interval(Duration::from_secs(15));
    Ok(Sse::new(stream_of(watcher, opened))
        .keep_alive(keep_alive)
        .into_response())
}

struct Watcher {
    app: Arc<App>,
    tenant: Option<String>,
    place: EventPlace,
    progress: bool,
    wait: bool,
    ready: VecDeque<PlacedEvent>,
    news: watch::Receiver<u64>,
    ending: watch::Receiver<bool>,
}

impl Watcher {
    /// The next event; `None`: the stream ends.
    async fn next(&mut self) -> Option<PlacedEvent> {
        loop {
            if let Some(event) = self.ready.pop_front() {
                self.place = event.place;
                return Some(event);
            }
            if *self.ending.borrow() {
                return None;
            }
            self.news.mark_unchanged();
            let database = &self.app.database;
            match database
                .all_events_after(self.tenant.as_deref(), self.place, self.progress, BATCH)
                .await
            {
                Ok(events) if events.is_empty() => {}
                Ok(events) => {
                    self.ready = events.into();
                    continue;
                }
                Err(error) => {
                    tracing::error!(%error, "events cannot be read; the stream is closed, the client may reconnect");
                    return None;
                }
            }
            if !self.wait {
                return None;
            }
            tokio::select! {
                _ = self.news.changed() => {}
                _ = self.ending.changed() => {}
                () = tokio::time::sleep(LOOK) => {}
            }
        }
    }
}

fn told(event: PlacedEvent) -> Result<Event, axum::Error> {
    let told = AnyEventData {
        job: event.job,
        collection: event.job_kind.collection(),
        kind: event.job_kind,
        seq: event.event.seq,
        data: serde_json::from_str(&event.event.data).unwrap_or_default(),
    };
    Event::default()
        .id(event.place.to_string())
        .event(event.event.kind)
        .json_data(&told)
}

fn stream_of(watcher: Watcher, opened: Option<EventPlace>) -> impl Stream<Item = Result<Event, Infallible>> {
    let (sender, receiver) = tokio::sync::mpsc::channel(64);
    tokio::spawn(async move {
        let mut watcher = watcher;
        if let Some(place) = opened {
            let open = Event::default().id(place.to_string()).event("open").data("{}");
            if sender.send(Ok(open)).await.is_err() {
                return;
            }
        }
        loop {
            let next = tokio::select! {
                next = watcher.next() => next,
                () = sender.closed() => None,
            };
            let Some(event) = next else { return };
            let event = match told(event) {
                Ok(event) => event,
                Err(error) => {
                    tracing::error!(%error, "an event cannot be written; the stream is closed, the client may reconnect");
                    return;
                }
            };
            if sender.send(Ok(event)).await.is_err() {
                return;
            }
        }
    });
    tokio_stream::wrappers::ReceiverStream::new(receiver)
}
