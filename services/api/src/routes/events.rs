//! Events of a job as they happen (server-sent events).

use super::jobs::Shared;
use crate::App;
use crate::access::Caller;
use crate::jobs::hub::Watch;
use crate::jobs::{Event as JobEvent, Job};
use crate::problem::Problem;
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::http::HeaderMap;
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse as _, Response};
use rotortwin_jobs::QueueEventKind;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio_stream::Stream;
use utoipa::ToSchema;

/// Events requested from the database at a time.
const BATCH: i64 = 500;

/// An event of a stream.
#[derive(ToSchema)]
#[expect(dead_code, reason = "for the OpenAPI document: axum writes the fields")]
pub(crate) struct StreamEvent {
    /// Number, from 1, without gaps.
    id: String,
    /// Kind, such as `progress`.
    event: String,
    /// Content: a JSON object.
    data: String,
}

/// All events of a run, from the first or after `Last-Event-ID`, without gaps; ends after `ended`.
///
/// Kinds: `queued`, `started`, `waiting`, `join` (waiting for external peers), `progress`, `change` (truth or verdict), `recording`, `finished`, `requeued`, `ended`.
#[utoipa::path(get, path = "/api/v1/runs/{id}/events", tag = "runs", operation_id = "run_events",
    params(("id" = String, Path), ("Last-Event-ID" = Option<u64>, Header, description = "number of the last event received")),
    responses(
        (status = 200, description = "stream of events", body = StreamEvent, content_type = "text/event-stream"),
        (status = 400, description = "Last-Event-ID is not a number", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn events(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let run = super::runs::find(&app, &caller, id).await?;
    of(&app, &run, &headers)
}

/// The events of a job as a stream.
///
/// # Errors
/// 400: `Last-Event-ID` is no number.
pub(super) fn of(app: &Arc<App>, job: &Job, headers: &HeaderMap) -> Result<Response, Problem> {
    let last = match headers.get("last-event-id") {
        None => 0,
        Some(value) => value
            .to_str()
            .ok()
            .and_then(|text| text.parse::<u64>().ok())
            // No event has a larger one.
            .map(|seq| i64::try_from(seq).unwrap_or(i64::MAX))
            .ok_or_else(|| Problem::bad_request("Last-Event-ID: expected the number of an event"))?,
    };
    let watcher = Watcher {
        // Subscribed before the first look: an event in between is seen by one or the other.
        news: app.database.hub.watch(&job.id),
        ending: app.context.ending.subscribe(),
        app: Arc::clone(app),
        id: job.id.clone(),
        last,
        ready: VecDeque::new(),
        ended: false,
    };
    let keep_alive = KeepAlive::new().interval(Duration::from_secs(15));
    Ok(Sse::new(futures_of(watcher)).keep_alive(keep_alive).into_response())
}

struct Watcher {
    app: Arc<App>,
    id: String,
    last: i64,
    ready: VecDeque<JobEvent>,
    ended: bool,
    news: Watch,
    ending: watch::Receiver<bool>,
}

impl Watcher {
    /// The next event; `None`: there will be no more.
    async fn next(&mut self) -> Option<JobEvent> {
        loop {
            if let Some(event) = self.ready.pop_front() {
                self.last = event.seq;
                self.ended = event.kind == QueueEventKind::Ended.as_str();
                return Some(event);
            }
            if self.ended || *self.ending.borrow() {
                return None;
            }
            self.news.mark_unchanged();
            match self.app.database.events_after(&self.id, self.last, BATCH).await {
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
            // A watcher that comes back after the end: nothing will ever be new.
            match self.app.database.get(&self.id).await {
                Ok(Some(run)) if !run.status.is_final() => {}
                _ => {
                    let late = self
                        .app
                        .database
                        .events_after(&self.id, self.last, BATCH)
                        .await
                        .unwrap_or_default();
                    if late.is_empty() {
                        return None;
                    }
                    self.ready = late.into();
                    continue;
                }
            }
            tokio::select! {
                () = self.news.changed() => {}
                _ = self.ending.changed() => {}
                // Another process may have written.
                () = tokio::time::sleep(Duration::from_secs(2)) => {}
            }
        }
    }
}

fn futures_of(watcher: Watcher) -> impl Stream<Item = Result<Event, Infallible>> {
    let (sender, receiver) = tokio::sync::mpsc::channel(64);
    tokio::spawn(async move {
        let mut watcher = watcher;
        loop {
            let next = tokio::select! {
                next = watcher.next() => next,
                () = sender.closed() => None,
            };
            let Some(event) = next else { return };
            let event = Event::default()
                .id(event.seq.to_string())
                .event(event.kind)
                .data(event.data.replace(['\n', '\r'], " "));
            if sender.send(Ok(event)).await.is_err() {
                return;
            }
        }
    });
    tokio_stream::wrappers::ReceiverStream::new(receiver)
}
