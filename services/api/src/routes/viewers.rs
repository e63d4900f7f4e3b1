//! A live run in Foxglove and Lichtblick: their WebSocket protocol, as in `rotortwin fly --foxglove`.
//!
//! The flight does not wait: a viewer that is too slow loses rows and is told how many. Earlier log messages are sent
//! when a viewer subscribes to them.

use crate::App;
use crate::access::Caller;
use crate::jobs::Job;
use crate::jobs::live::Past;
use crate::problem::Problem;
use axum::extract::rejection::PathRejection;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Path, State};
use axum::response::Response;
use rotortwin_foxglove::protocol::{self, LONGEST_MESSAGE, SUBPROTOCOLS};
use rotortwin_foxglove::{Encoder, Viewer};
use rotortwin_scenario::{Documents, Scenario};
use rotortwin_sim::session::telemetry_header;
use rotortwin_store::streams::Topic;
use rotortwin_wire::events::LiveSample;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::broadcast::{Receiver, error::RecvError};

/// How often to check whether the run has ended, in case no notification arrives.
const LOOK: Duration = Duration::from_secs(2);
/// A viewer that receives nothing for this long is gone.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);

/// A run, live in Foxglove and Lichtblick, over Foxglove's WebSocket protocol.
#[utoipa::path(get, path = "/api/v1/runs/{id}/foxglove", tag = "telemetry", operation_id = "run_foxglove", params(("id" = String, Path)), responses(
    (status = 101, description = "a WebSocket with the subprotocol foxglove.sdk.v1 or foxglove.websocket.v1"),
    (status = 400, description = "not a WebSocket request with one of these subprotocols", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "this version cannot display the run", body = Problem, content_type = "application/problem+json"),
    (status = 426, description = "not a WebSocket request", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn view(
    State(app): State<Arc<App>>,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    let run = super::runs::find(&app, &caller, id).await?;
    let flight = super::runs::flight_of(&run)?;
    let recorded = || {
        Documents::from_toml("the recorded scenario", &flight.documents)
            .and_then(|documents| Scenario::from_documents(&documents))
    };
    let scenario = app.readers.read(recorded).await.map_err(|error| {
        Problem::unprocessable(format!(
            "this version cannot show a run that another version accepted: {error}"
        ))
    })?;
    let upgrade = upgrade?.protocols(SUBPROTOCOLS);
    if upgrade.selected_protocol().is_none() {
        return Err(Problem::bad_request(format!(
            "`Sec-WebSocket-Protocol` offers no Foxglove protocol; expected {}",
            SUBPROTOCOLS.join(" or ")
        )));
    }
    // Before it is looked whether the run has ended: an end in between is seen.
    let (past, samples) = app.database.hub.live.watch(&run.id);
    let show = Show {
        app,
        run,
        encoder: Encoder::new(&telemetry_header(&scenario)),
        viewer: Viewer::default(),
        log: Vec::new(),
    };
    let name = format!("rotortwin: {}", scenario.name());
    Ok(upgrade
        .max_message_size(LONGEST_MESSAGE)
        .on_upgrade(async move |mut socket| {
            if show.serve(&mut socket, &name, past, samples).await.is_ok() {
                // The viewer hears a close, or has closed itself.
                drop(socket.send(Message::Close(None)).await);
            }
        }))
}

struct Show {
    app: Arc<App>,
    run: Job,
    encoder: Encoder,
    viewer: Viewer,
    /// Lines that were, with their simulated times, ns.
    log: Vec<(u64, Vec<u8>)>,
}

/// The viewer is gone.
struct Gone;

impl Show {
    /// Sends rows until the run or the server ends.
    async fn serve(
        mut self,
        socket: &mut WebSocket,
        name: &str,
        past: Past,
        mut samples: Receiver<Arc<LiveSample>>,
    ) -> Result<(), Gone> {
        let mut ending = self.app.context.ending.subscribe();
        let mut look = tokio::time::interval(LOOK);
        send(socket, Message::text(protocol::server_info(name, &self.run.id))).await?;
        send(socket, Message::text(protocol::advertise())).await?;
        let mut shown = self.remember(&past);
        loop {
            tokio::select! {
                sample = samples.recv() => match sample {
                    // What is kept may hold the first ones that come.
                    Ok(sample) if shown.is_some_and(|step| sample.step <= step) => {}
                    Ok(sample) => {
                        shown = None;
                        self.show(socket, &sample).await?;
                    }
                    Err(RecvError::Lagged(count)) => {
                        let sentence = format!("{count} rows were dropped: this viewer is too slow");
                        send(socket, Message::text(protocol::status(&sentence))).await?;
                    }
                    Err(RecvError::Closed) => {
                        if self.has_ended().await {
                            return Ok(());
                        }
                        // It was queued again, and flies from the start.
                        samples = self.app.database.hub.live.watch(&self.run.id).1;
                        self.log.clear();
                    }
                },
                message = socket.recv() => match message {
                    Some(Ok(Message::Text(text))) => self.hear(socket, text.as_str()).await?,
                    Some(Ok(Message::Binary(_))) => {
                        send(socket, Message::text(protocol::status("messages from viewers are not accepted"))).await?;
                    }
                    Some(Ok(Message::Close(_)) | Err(_)) | None => return Err(Gone),
                    Some(Ok(_)) => {}
                },
                _ = look.tick() => if self.has_ended().await {
                    return Ok(());
                },
                _ = ending.changed() => return Ok(()),
            }
        }
    }

    /// What was before: the trail, and the log; gives the step of the last row.
    fn remember(&mut self, past: &Past) -> Option<u64> {
        for sample in &past.samples {
            let row = self.encoder.row(sample);
            let lines = row.messages.into_iter().filter(|(topic, _)| *topic == Topic::Log);
            self.log.extend(lines.map(|(_, line)| (row.time_ns, line)));
        }
        past.samples.last().map(|last| last.step)
    }

    async fn show(&mut self, socket: &mut WebSocket, sample: &LiveSample) -> Result<(), Gone> {
        let row = self.encoder.row(sample);
        for frame in self.viewer.frames(&row) {
            send(socket, Message::binary(frame)).await?;
        }
        let lines = row.messages.into_iter().filter(|(topic, _)| *topic == Topic::Log);
        self.log.extend(lines.map(|(_, line)| (row.time_ns, line)));
        Ok(())
    }

    async fn hear(&mut self, socket: &mut WebSocket, text: &str) -> Result<(), Gone> {
        match self.viewer.hear(text) {
            Ok(topics) if topics.contains(&Topic::Log) => {
                for (time_ns, line) in &self.log {
                    let frames: Vec<_> = self.viewer.of(Topic::Log, *time_ns, line).collect();
                    for frame in frames {
                        send(socket, Message::binary(frame)).await?;
                    }
                }
                Ok(())
            }
            Ok(_) => Ok(()),
            Err(sentence) => send(socket, Message::text(protocol::status(&sentence))).await,
        }
    }

    /// Nothing more will come from this run.
    async fn has_ended(&mut self) -> bool {
        match self.app.database.get(&self.run.id).await {
            Ok(Some(run)) => run.status.is_final(),
            // Deleted.
            Ok(None) => true,
            Err(error) => {
                tracing::error!(%error, "a run cannot be looked up for a viewer");
                false
            }
        }
    }
}

async fn send(socket: &mut WebSocket, message: Message) -> Result<(), Gone> {
    match tokio::time::timeout(SEND_TIMEOUT, socket.send(message)).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(_)) | Err(_) => Err(Gone),
    }
}
