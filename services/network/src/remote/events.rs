//! Events of a job from the first to `ended`, over as many connections as it takes, without a gap.

use super::http::{Ask, Patience, Remote, causes};
use super::{RemoteError, fetch};
use reqwest::Response;
use rotortwin_jobs::{JobEvent, QueueEvent, QueueEventKind, Status};
use serde::Deserialize as _;
use serde_json::Value;
use std::collections::VecDeque;
use std::time::Duration;

/// The server sends something every 15 s: after this long a silent connection is dead.
const SILENCE: Duration = Duration::from_secs(40);

/// An event.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Event {
    /// From 1, without gaps.
    pub id: u64,
    /// `queued`, `started`, …, `ended`.
    pub kind: String,
    /// Its content.
    pub data: Value,
}

impl Event {
    /// As one of the server's queue; `None`: it is of the job itself.
    pub(crate) fn of_queue(&self) -> Option<QueueEvent> {
        QueueEvent::read(&self.kind, &self.data)
    }

    /// As one of a job other than a flight; `None`: it is none, or of a later version.
    pub(crate) fn of_job(&self) -> Option<JobEvent> {
        JobEvent::deserialize(&self.data).ok()
    }

    /// There will be no more.
    fn is_last(&self) -> bool {
        self.kind == QueueEventKind::Ended.as_str()
    }
}

/// Follows one job. Dropping a call of [`next`](Self::next) loses nothing.
#[derive(Debug)]
pub(crate) struct Follow<'a> {
    remote: &'a Remote,
    /// Address of the job.
    path: String,
    /// Number of the last event returned.
    last: u64,
    connection: Option<Response>,
    parser: Parser,
    ready: VecDeque<Event>,
    /// The connection has delivered something.
    news: bool,
    over: bool,
    patience: Patience,
}

impl<'a> Follow<'a> {
    /// `path`: of the job; starts with the events after number `after`.
    pub(crate) fn new(remote: &'a Remote, path: String, after: u64) -> Self {
        Self {
            remote,
            path,
            last: after,
            connection: None,
            parser: Parser::default(),
            ready: VecDeque::new(),
            news: false,
            over: false,
            patience: Patience::new(),
        }
    }

    /// The next event; `None`: there will be no more.
    pub(crate) async fn next(&mut self) -> Result<Option<Event>, RemoteError> {
        loop {
            while let Some(event) = self.ready.pop_front() {
                if event.id <= self.last {
                    continue;
                }
                if event.id > self.last + 1 {
                    // Never seen; a retry would resolve it.
                    self.connection = None;
                    self.ready.clear();
                    break;
                }
                (self.last, self.news, self.over) = (event.id, true, event.is_last());
                self.patience = Patience::new();
                return Ok(Some(event));
            }
            if self.over {
                return Ok(None);
            }
            let Some(connection) = &mut self.connection else {
                self.connect().await?;
                continue;
            };
            let lost = match tokio::time::timeout(SILENCE, connection.chunk()).await {
                Ok(Ok(Some(chunk))) => {
                    self.ready.extend(self.parser.feed(&chunk));
                    continue;
                }
                Ok(Ok(None)) => None,
                Ok(Err(error)) => Some(causes(&error)),
                Err(_) => Some(format!("silence for {} s", SILENCE.as_secs())),
            };
            self.connection = None;
            let pause = match lost {
                Some(words) => self.remote.pause_or_loss(&words, &mut self.patience)?,
                None if !self.news && self.has_ended().await? => return Ok(None),
                None => Duration::from_millis(100),
            };
            tokio::time::sleep(pause).await;
        }
    }

    async fn connect(&mut self) -> Result<(), RemoteError> {
        let ask = Ask::get(format!("{}/events", self.path))
            .header("accept", "text/event-stream")
            .header("last-event-id", self.last.to_string());
        let pause = match self.remote.once(&ask).await {
            Ok(answer) if answer.status().is_success() => {
                self.connection = Some(answer);
                (self.parser, self.news) = (Parser::default(), false);
                return Ok(());
            }
            Ok(answer) => self.remote.pause_or_refusal(answer, &mut self.patience).await?,
            Err(words) => self.remote.pause_or_loss(&words, &mut self.patience)?,
        };
        tokio::time::sleep(pause).await;
        Ok(())
    }

    async fn has_ended(&self) -> Result<bool, RemoteError> {
        let job = self.remote.json(&Ask::get(&self.path)).await?;
        Ok(!matches!(fetch::status(&job), Some(Status::Queued | Status::Running)))
    }
}

/// Server-sent events from bytes (WHATWG HTML, 9.2.6), as far as this server uses them: one `data` line an event, LF or CRLF.
#[derive(Debug, Default)]
struct Parser {
    rest: Vec<u8>,
    id: u64,
    kind: String,
    data: Option<Value>,
}

impl Parser {
    fn feed(&mut self, chunk: &[u8]) -> Vec<Event> {
        self.rest.extend_from_slice(chunk);
        let mut events = Vec::new();
        while let Some(end) = self.rest.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.rest.drain(..=end).collect();
            let line = String::from_utf8_lossy(&line);
            let line = line.trim_end_matches(['\n', '\r']);
            if line.is_empty() {
                if let Some(data) = self.data.take() {
                    let kind = std::mem::take(&mut self.kind);
                    events.push(Event {
                        id: self.id,
                        kind,
                        data,
                    });
                }
                continue;
            }
            let (name, value) = line.split_once(':').unwrap_or((line, ""));
            let value = value.strip_prefix(' ').unwrap_or(value);
            match name {
                "id" => self.id = value.parse().unwrap_or(self.id),
                "event" => value.clone_into(&mut self.kind),
                "data" => self.data = Some(serde_json::from_str(value).unwrap_or(Value::Null)),
                _ => {}
            }
        }
        events
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_events_in_pieces_of_any_size() {
        let stream = ": hello\n\nid: 1\nevent: queued\ndata: {}\n\nevent: change\r\nid: 2\r\ndata: {\"text\":\"ä\u{2028}\"}\r\n\r\nid: 3\n";
        for size in [1, 2, 7, stream.len()] {
            let mut parser = Parser::default();
            let events: Vec<Event> = stream
                .as_bytes()
                .chunks(size)
                .flat_map(|chunk| parser.feed(chunk))
                .collect();
            let expected = [
                (1, "queued", serde_json::json!({})),
                (2, "change", serde_json::json!({ "text": "ä\u{2028}" })),
            ];
            let expected = expected.map(|(id, kind, data)| Event {
                id,
                kind: kind.to_owned(),
                data,
            });
            assert_eq!(events, expected, "{size}");
        }
    }
}
