//! Changes of the caller's FDI sessions, for clients that watch but do not feed them.

use super::fdi::OpenSessions;
use crate::App;
use crate::access::Caller;
use crate::fdi::sessions::SessionView;
use crate::problem::Problem;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use utoipa::{IntoParams, ToSchema};

/// Pause after a report: a session that receives 400 samples per second changes as often, and its watcher is a screen.
const PAUSE: Duration = Duration::from_millis(100);
/// A session that ends because it is idle tells nobody.
const LOOK: Duration = Duration::from_secs(1);

/// Whether to stay.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct WatchQuery {
    /// `false`: end after `open`.
    #[param(default = true)]
    wait: Option<bool>,
}

/// An event of the stream.
#[derive(ToSchema)]
#[expect(dead_code, reason = "for the OpenAPI document: axum writes the fields")]
pub(crate) struct SessionEvent {
    /// `open`, `session` or `closed`.
    event: String,
    /// A JSON object: all open sessions, as in `GET /fdi/sessions`; the changed one, as in `GET /fdi/sessions/ID`; or
    /// a `ClosedSession`.
    data: String,
}

/// A session that was closed or that ended because it was idle.
#[derive(Serialize, ToSchema)]
pub(crate) struct ClosedSession {
    /// Its id.
    id: String,
}

/// Your FDI sessions as they change (server-sent events). The scope `read` is enough, and watching does not keep
/// a session alive.
///
/// The stream begins with `open`: all sessions that are open now. Then come `session`, for a session that was
/// opened or fed since, at most ten times per second, and `closed`. Events are not numbered: a client that
/// reconnects gets a new `open`, which is the complete state.
#[utoipa::path(get, path = "/api/v1/fdi/events", tag = "fdi", operation_id = "fdi_session_events", params(WatchQuery), responses(
    (status = 200, description = "a stream", body = SessionEvent, content_type = "text/event-stream"),
    (status = 400, description = "unknown parameter", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn events(
    State(app): State<Arc<App>>,
    caller: Caller,
    query: Result<Query<WatchQuery>, QueryRejection>,
) -> Result<Response, Problem> {
    let Query(query) = query?;
    let (sender, receiver) = mpsc::channel(64);
    let watcher = Watcher {
        // Subscribed before the first look: a change in between is seen by one or the other.
        news: app.fdi.watch(),
        ending: app.context.ending.subscribe(),
        app,
        caller,
        sender,
        told: BTreeMap::new(),
    };
    tokio::spawn(watcher.serve(query.wait.unwrap_or(true)));
    let keep_alive = KeepAlive::new().interval(Duration::from_secs(15));
    let stream = tokio_stream::wrappers::ReceiverStream::new(receiver);
    Ok(Sse::new(stream).keep_alive(keep_alive).into_response())
}

/// Nobody listens any more.
struct Gone;

struct Watcher {
    app: Arc<App>,
    caller: Caller,
    sender: mpsc::Sender<Result<Event, Infallible>>,
    /// Sessions that were reported, and which version of each.
    told: BTreeMap<String, u64>,
    news: watch::Receiver<u64>,
    ending: watch::Receiver<bool>,
}

impl Watcher {
    /// Tells what changes until the listener is gone or the server ends.
    async fn serve(mut self, stays: bool) {
        if self.begin().await.is_err() || !stays {
            return;
        }
        while !*self.ending.borrow() {
            tokio::select! {
                _ = self.news.changed() => {}
                _ = self.ending.changed() => return,
                () = tokio::time::sleep(LOOK) => {}
                () = self.sender.closed() => return,
            }
            self.news.mark_unchanged();
            if self.look().await.is_err() {
                return;
            }
            tokio::time::sleep(PAUSE).await;
        }
    }

    async fn begin(&mut self) -> Result<(), Gone> {
        let found = self.app.fdi.changed_since(&self.caller, &self.told);
        self.told.extend(
            found
                .changed
                .iter()
                .map(|(version, one)| (one.id().to_owned(), *version)),
        );
        let items: Vec<SessionView> = found.changed.into_iter().map(|(_, one)| one).collect();
        self.tell("open", &OpenSessions::of(items)).await
    }

    async fn look(&mut self) -> Result<(), Gone> {
        let found = self.app.fdi.changed_since(&self.caller, &self.told);
        for id in found.gone {
            self.told.remove(&id);
            self.tell("closed", &ClosedSession { id }).await?;
        }
        for (version, one) in found.changed {
            self.tell("session", &one).await?;
            self.told.insert(one.id().to_owned(), version);
        }
        Ok(())
    }

    async fn tell(&self, kind: &str, data: &impl serde::Serialize) -> Result<(), Gone> {
        let event = Event::default().event(kind).json_data(data).map_err(|error| {
            tracing::error!(%error, "an event of a session cannot be written; its watcher is disconnected");
            Gone
        })?;
        self.sender.send(Ok(event)).await.map_err(|_closed| Gone)
    }
}
