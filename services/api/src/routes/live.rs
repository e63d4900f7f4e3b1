//! Live telemetry: a WebSocket that sends samples while a run flies.
//!
//! ```text
//!  rotortwin job ─ lines ─▶ worker ─▶ hub ─ broadcast ─▶ one task a watcher ─▶ WebSocket
//! ```
//! The flight does not wait: a watcher that is too slow loses samples and is told how many. With `from_s` it first gets
//! the stored part of the flight ([`crate::jobs::live`]), and again what it was too slow for: there is no gap. Nothing
//! is stored on disk; the recording is in the telemetry once the run has ended.

use crate::App;
use crate::access::Caller;
use crate::jobs::Job;
use crate::jobs::live::Past;
use crate::problem::Problem;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Path, Query, State};
use axum::response::Response;
use rotortwin_jobs::Status;
use rotortwin_store::query::{Channel, matching};
use rotortwin_store::telemetry_columns;
use rotortwin_wire::events::LiveSample;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::broadcast::{Receiver, error::RecvError};
use tokio::time::Instant;
use utoipa::{IntoParams, ToSchema};

/// Default number of samples per second.
const DEFAULT_RATE_HZ: f64 = 20.0;
/// A sample in 100 s.
const LOWEST_RATE_HZ: f64 = 0.01;
/// The flight has no more data.
const HIGHEST_RATE_HZ: f64 = 100.0;
/// What a client says is not longer.
const LONGEST_MESSAGE: usize = 64 << 10;
/// How often to check whether the run has ended, in case no notification arrives.
const LOOK: Duration = Duration::from_secs(2);

/// Samples that came late count as on time if they are not later than this.
const CREDIT: Duration = Duration::from_millis(500);
/// Rows of a message with those before.
const ROWS: usize = 1000;

/// What to send; a client may also say it later, as a JSON message.
#[derive(Debug, Clone, Default, Deserialize, Serialize, ToSchema, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct Subscription {
    /// Comma-separated names; one `*` per name matches anything (`duty_*`). Default: all.
    #[param(example = "roll_rad,duty_*")]
    channels: Option<String>,
    /// Maximum samples per second of wall clock, up to 100; default 20.
    #[param(minimum = 0.01, maximum = 100)]
    rate_hz: Option<f64>,
    /// Start with the recorded samples after this simulated time, s; 0: all of them. Default: the next sample.
    from_s: Option<f64>,
}

/// Messages of the stream: JSON text, distinguished by `type`.
#[derive(Serialize, ToSchema)]
#[serde(tag = "type", rename_all = "lowercase")]
pub(crate) enum LiveMessage {
    /// What will be sent; repeated after each change.
    Start {
        /// Id of the run.
        run: String,
        /// State of the run.
        status: Status,
        /// In the order of the columns of the telemetry.
        channels: Vec<LiveChannel>,
        /// Maximum samples per second of wall clock.
        rate_hz: f64,
    },
    /// Recorded samples, some rows at a time; `sample` continues after them without a gap.
    History {
        /// Simulated time of each row.
        time_s: Vec<f64>,
        /// Step number of each row.
        step: Vec<u64>,
        /// Values by channel, one per row; `null`: no value.
        values: BTreeMap<String, Vec<Option<f64>>>,
        /// Decimation factor of a long flight: one of this many samples was kept.
        thinned: bool,
    },
    /// One sample.
    Sample {
        /// Simulated time.
        time_s: f64,
        /// Step number. It restarts if the run is flown again.
        step: u64,
        /// Value by channel; `null`: no value.
        values: BTreeMap<String, Option<f64>>,
    },
    /// The client was too slow to receive some samples.
    Lost {
        /// Number of lost samples since the last such message.
        count: u64,
    },
    /// A message of the client is invalid; the state is unchanged.
    Error {
        /// One sentence.
        detail: String,
    },
    /// End of the stream.
    End {
        /// State of the run.
        status: Status,
        /// Number of samples sent.
        samples: u64,
        /// Number of samples lost because the client was too slow.
        lost: u64,
    },
}

/// A channel that is sent.
#[derive(Serialize, ToSchema)]
pub(crate) struct LiveChannel {
    /// Key in `values`.
    name: String,
    /// Unit of its values; `1`: dimensionless.
    unit: String,
}

/// What is sent to one client.
struct Selection {
    channels: Vec<Channel>,
    picked: Vec<usize>,
    rate_hz: f64,
}

impl Selection {
    fn new(rotors: usize) -> Self {
        let channels: Vec<Channel> = telemetry_columns(rotors).into_iter().map(Channel::from).collect();
        Self {
            picked: (0..channels.len()).collect(),
            channels,
            rate_hz: DEFAULT_RATE_HZ,
        }
    }

    /// Applies a client's settings; if they are invalid, none of them.
    fn change(&mut self, wish: &Subscription) -> Result<(), String> {
        let rate_hz = wish.rate_hz.unwrap_or(self.rate_hz);
        if !(LOWEST_RATE_HZ..=HIGHEST_RATE_HZ).contains(&rate_hz) {
            return Err(format!(
                "`rate_hz` is {rate_hz}; expected a number from {LOWEST_RATE_HZ} to {HIGHEST_RATE_HZ}"
            ));
        }
        if let Some(names) = &wish.channels {
            let mut picked = Vec::new();
            for name in names.split(',').map(str::trim).filter(|name| !name.is_empty()) {
                for place in matching(&self.channels, name).map_err(|error| error.to_string())? {
                    if !picked.contains(&place) {
                        picked.push(place);
                    }
                }
            }
            self.picked = picked;
        }
        self.rate_hz = rate_hz;
        Ok(())
    }

    fn start(&self, run: &Job) -> LiveMessage {
        let channels = self.picked.iter().map(|place| {
            let channel = &self.channels[*place];
            LiveChannel {
                name: channel.name.clone(),
                unit: channel.unit.clone(),
            }
        });
        LiveMessage::Start {
            run: run.id.clone(),
            status: run.status,
            channels: channels.collect(),
            rate_hz: self.rate_hz,
        }
    }

    fn history(&self, samples: &[Arc<LiveSample>], thinned: bool) -> LiveMessage {
        let values = self.picked.iter().map(|place| {
            let column = samples
                .iter()
                .map(|sample| sample.values.get(*place).copied().flatten());
            (self.channels[*place].name.clone(), column.collect())
        });
        LiveMessage::History {
            time_s: samples.iter().map(|sample| sample.sim_time_s).collect(),
            step: samples.iter().map(|sample| sample.step).collect(),
            values: values.collect(),
            thinned,
        }
    }

    fn sample(&self, sample: &LiveSample) -> LiveMessage {
        let values = self.picked.iter().map(|place| {
            let value = sample.values.get(*place).copied().flatten();
            (self.channels[*place].name.clone(), value)
        });
        LiveMessage::Sample {
            time_s: sample.sim_time_s,
            step: sample.step,
            values: values.collect(),
        }
    }
}

/// Live telemetry by WebSocket: `start`, then `sample` while the run flies, then `end`. A client that is too slow gets `lost`.
#[utoipa::path(get, path = "/api/v1/runs/{id}/live", tag = "telemetry", operation_id = "run_live", params(("id" = String, Path), Subscription), responses(
    (status = 101, description = "a WebSocket that delivers JSON text messages", body = LiveMessage),
    (status = 400, description = "not a WebSocket request, or an invalid parameter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "unknown channel or rate", body = Problem, content_type = "application/problem+json"),
    (status = 426, description = "not a WebSocket request", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn live(
    State(app): State<Arc<App>>,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    wish: Result<Query<Subscription>, QueryRejection>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    let Query(wish) = wish?;
    let run = super::runs::find(&app, &caller, id).await?;
    let mut selection = Selection::new(app.readers.read(|| rotors(&run)).await?);
    selection.change(&wish).map_err(Problem::unprocessable)?;
    let upgrade = upgrade?;
    if wish.from_s.is_some_and(f64::is_nan) {
        return Err(Problem::unprocessable("`from_s` is not a number; expected seconds"));
    }
    // Before it is looked whether the run has ended: an end in between is seen.
    let (past, samples) = app.database.hub.live.watch(&run.id);
    let watcher = Watcher {
        app,
        run,
        selection,
        sent: 0,
        lost: 0,
        due: None,
        // Nothing is before the start.
        seen_s: wish
            .from_s
            .map(|from| if from <= 0.0 { f64::NEG_INFINITY } else { from }),
    };
    Ok(upgrade
        .max_message_size(LONGEST_MESSAGE)
        .on_upgrade(move |socket| watcher.serve(socket, past, samples)))
}

/// Rotors of the run's vehicle: they decide which channels there are.
fn rotors(run: &Job) -> Result<usize, Problem> {
    let scenario = super::submissions::recorded(&super::runs::flight_of(run)?)?;
    Ok(scenario.vehicle().rotor_count())
}

struct Watcher {
    app: Arc<App>,
    run: Job,
    selection: Selection,
    sent: u64,
    lost: u64,
    /// Earlier samples are passed over; the first one that comes starts the clock.
    due: Option<Instant>,
    /// For a client that wants no gap: the simulated time up to which it has everything, s.
    seen_s: Option<f64>,
}

/// The client is gone, or cannot be told.
struct Gone;

impl Watcher {
    async fn serve(mut self, mut socket: WebSocket, past: Past, samples: Receiver<Arc<LiveSample>>) {
        if self.tell(&mut socket, past, samples).await.is_ok() {
            let end = LiveMessage::End {
                status: self.run.status,
                samples: self.sent,
                lost: self.lost,
            };
            if send(&mut socket, &end).await.is_ok() {
                // The client hears a close, or has closed itself.
                drop(socket.send(Message::Close(None)).await);
            }
        }
    }

    /// Sends samples until the run or the server ends.
    async fn tell(
        &mut self,
        socket: &mut WebSocket,
        past: Past,
        mut samples: Receiver<Arc<LiveSample>>,
    ) -> Result<(), Gone> {
        let mut ending = self.app.context.ending.subscribe();
        let mut look = tokio::time::interval(LOOK);
        send(socket, &self.selection.start(&self.run)).await?;
        self.catch_up(socket, &past).await?;
        loop {
            tokio::select! {
                sample = samples.recv() => match sample {
                    Ok(sample) => self.pass_on(socket, &sample).await?,
                    Err(RecvError::Lagged(_)) if self.seen_s.is_some() => {
                        let past;
                        (past, samples) = self.app.database.hub.live.watch(&self.run.id);
                        self.catch_up(socket, &past).await?;
                    }
                    Err(RecvError::Lagged(count)) => {
                        self.lost += count;
                        send(socket, &LiveMessage::Lost { count }).await?;
                    }
                    Err(RecvError::Closed) => {
                        if self.has_ended().await {
                            return Ok(());
                        }
                        // It was queued again, and flies from the start.
                        let past;
                        (past, samples) = self.app.database.hub.live.watch(&self.run.id);
                        self.seen_s = self.seen_s.map(|_| f64::NEG_INFINITY);
                        self.catch_up(socket, &past).await?;
                    }
                },
                message = socket.recv() => match message {
                    Some(Ok(Message::Text(text))) => self.hear(socket, text.as_str()).await?,
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

    /// Sends the buffered samples not yet seen to a client that wants no gap.
    async fn catch_up(&mut self, socket: &mut WebSocket, past: &Past) -> Result<(), Gone> {
        let Some(seen) = self.seen_s else { return Ok(()) };
        let unseen = past.samples.partition_point(|sample| sample.sim_time_s <= seen);
        for rows in past.samples[unseen..].chunks(ROWS) {
            send(socket, &self.selection.history(rows, past.every > 1)).await?;
            self.sent += rows.len() as u64;
            self.seen_s = rows.last().map(|last| last.sim_time_s);
        }
        Ok(())
    }

    async fn pass_on(&mut self, socket: &mut WebSocket, sample: &LiveSample) -> Result<(), Gone> {
        let now = Instant::now();
        let due = self.due.unwrap_or(now);
        if now < due {
            return Ok(());
        }
        let period = Duration::from_secs_f64(1.0 / self.selection.rate_hz);
        // In step with the rate; samples that arrive late and all together are passed on as if they had arrived in
        // time.
        let earliest = now.checked_sub(CREDIT).unwrap_or(now);
        self.due = Some(due.max(earliest) + period);
        self.sent += 1;
        self.seen_s = self.seen_s.map(|_| sample.sim_time_s);
        send(socket, &self.selection.sample(sample)).await
    }

    async fn hear(&mut self, socket: &mut WebSocket, text: &str) -> Result<(), Gone> {
        let wish = serde_json::from_str::<Subscription>(text).map_err(|error| error.to_string());
        match wish.and_then(|wish| self.selection.change(&wish)) {
            Ok(()) => {
                self.due = None;
                send(socket, &self.selection.start(&self.run)).await
            }
            Err(detail) => send(socket, &LiveMessage::Error { detail }).await,
        }
    }

    /// Nothing more will come from this run.
    async fn has_ended(&mut self) -> bool {
        match self.app.database.get(&self.run.id).await {
            Ok(Some(run)) => {
                self.run = run;
                self.run.status.is_final()
            }
            // Deleted.
            Ok(None) => true,
            Err(error) => {
                tracing::error!(%error, "a run cannot be looked up for a client of its live samples");
                false
            }
        }
    }
}

async fn send(socket: &mut WebSocket, message: &LiveMessage) -> Result<(), Gone> {
    let text = serde_json::to_string(message).map_err(|error| {
        tracing::error!(%error, "a message with live samples cannot be written");
        Gone
    })?;
    socket.send(Message::text(text)).await.map_err(|_closed| Gone)
}
