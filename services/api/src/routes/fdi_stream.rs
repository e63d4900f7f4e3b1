//! FDI as a service over a WebSocket: measurements in, verdicts out as they arise.
//!
//! A text message is one JSON object, `{"first_step": N, "after_gap": false, "samples": [{…}, …]}`; its answer is the
//! object that the HTTP route returns, or `{"refusal": "…", "next_step": N}`. A binary message is an encoded
//! `FdiMeasurements`, its answer an `FdiVerdicts`. One answer per message, in order. A session may be fed over several
//! connections; they share its steps.

use crate::App;
use crate::access::Caller;
use crate::fdi::samples::ChunkBody;
use crate::fdi::sessions::Entry;
use crate::problem::Problem;
use axum::extract::rejection::PathRejection;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::extract::{Path, State};
use axum::response::Response;
use prost::Message as _;
use rotortwin_zenoh::fdi_topic::answer_message;
use serde::Serialize;
use std::sync::Arc;
use tokio::sync::watch;
use utoipa::ToSchema;

/// No message is longer.
const LARGEST_MESSAGE: usize = 2 << 20;

/// A text message that was not taken; the session is as before.
#[derive(Serialize, ToSchema)]
pub(crate) struct FdiRefusal {
    /// One sentence.
    refusal: String,
    /// Number of the step that is expected next.
    next_step: u64,
}

/// Measurements in, verdicts out, over a WebSocket.
///
/// Text: `{"first_step": N, "samples": [...]}`; the reply is that of the `measurements` route, or an `FdiRefusal`. Binary: `FdiMeasurements`; the reply is `FdiVerdicts`
/// (proto/rotortwin/v1/fdi_service.proto).
#[utoipa::path(get, path = "/api/v1/fdi/sessions/{id}/stream", tag = "fdi", operation_id = "stream_fdi_session", params(("id" = String, Path)), responses(
    (status = 101, description = "WebSocket"),
    (status = 400, description = "not a WebSocket request", body = Problem, content_type = "application/problem+json"),
    (status = 403, description = "the token does not allow this", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "session not found", body = Problem, content_type = "application/problem+json"),
    (status = 426, description = "the connection cannot be upgraded", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn stream(
    State(app): State<Arc<App>>,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    caller.must_write("measurements change a session")?;
    let entry = super::fdi::find(&app, &caller, id)?;
    let upgrade = upgrade?
        .max_message_size(LARGEST_MESSAGE)
        .max_frame_size(LARGEST_MESSAGE);
    Ok(upgrade.on_upgrade(move |socket| serve(app, entry, socket)))
}

async fn serve(app: Arc<App>, entry: Arc<Entry>, mut socket: WebSocket) {
    let mut ending = app.context.ending.subscribe();
    loop {
        let (code, reason) = tokio::select! {
            message = tokio::time::timeout(app.fdi.idle(), socket.recv()) => match message {
                Ok(Some(Ok(message))) => match answer(&app, &entry, message) {
                    Ok(None) => continue,
                    Ok(Some(reply)) => match socket.send(reply).await {
                        Ok(()) => continue,
                        // There is no client to reply to.
                        Err(_) => return,
                    },
                    Err(closing) => closing,
                },
                Ok(None | Some(Err(_))) => return,
                // Another way may have fed it meanwhile.
                Err(_silence) if app.fdi.has(&entry.id) => continue,
                Err(_silence) => (close_code::POLICY, "the session ended: idle for too long"),
            },
            () = ended(&mut ending) => (close_code::RESTART, "the server is ending"),
        };
        let close = Message::Close(Some(CloseFrame {
            code,
            reason: reason.into(),
        }));
        if let Err(error) = socket.send(close).await {
            tracing::debug!(%error, "a stream was dropped before it was closed");
        }
        return;
    }
}

/// Ready once the server ends.
async fn ended(ending: &mut watch::Receiver<bool>) {
    // An error means that the server is gone.
    drop(ending.wait_for(|ends| *ends).await);
}

/// The reply to a message, none if it requires none; or why the stream ends.
fn answer(app: &App, entry: &Entry, message: Message) -> Result<Option<Message>, (u16, &'static str)> {
    let reply = match message {
        Message::Text(_) | Message::Binary(_) if !app.fdi.has(&entry.id) => {
            return Err((close_code::POLICY, "the session was closed"));
        }
        Message::Text(text) => Message::text(text_answer(entry, text.as_str())),
        Message::Binary(bytes) => {
            let (message, answer) = answer_message(&mut entry.session(), &bytes);
            if let Ok(answer) = &answer {
                entry.remember(answer);
            }
            Message::binary(message.encode_to_vec())
        }
        // Answered by the protocol itself.
        Message::Ping(_) | Message::Pong(_) | Message::Close(_) => return Ok(None),
    };
    Ok(Some(reply))
}

fn text_answer(entry: &Entry, text: &str) -> String {
    let fed = serde_json::from_str::<ChunkBody>(text)
        .map_err(|error| format!("the message is not a chunk of samples: {error}"))
        .and_then(|body| body.chunk(entry.rotor_count))
        .and_then(|chunk| entry.feed(&chunk).map_err(|(refusal, _)| refusal.to_string()));
    let json = match fed {
        Ok(answer) => serde_json::to_value(&answer),
        Err(refusal) => serde_json::to_value(FdiRefusal {
            refusal,
            next_step: entry.session().next_step(),
        }),
    };
    json.map(|value| value.to_string()).unwrap_or_default()
}
