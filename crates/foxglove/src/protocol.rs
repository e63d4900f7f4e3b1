//! The WebSocket messages, independent of the socket.
//!
//! | from | message | here |
//! |---|---|---|
//! | server | `serverInfo`, `advertise`, `status` (JSON) | [`server_info`], [`advertise`], [`status`] |
//! | server | 1: u32 subscription, u64 time (ns), message; 2: u64 time (ns); little-endian | [`Viewer::frames`] |
//! | viewer | `subscribe`, `unsubscribe` (JSON) | [`Viewer::hear`] |
//!
//! Source: the protocol's specification (github.com/foxglove/ws-protocol, docs/spec.md). Times are simulated. Parameters, services, assets
//! and messages from the viewer are not supported: a viewer that sends one gets a `status` reply.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use rotortwin_store::streams::{Streams, Topic};
use rotortwin_store::{SpoolHeader, telemetry_columns};
use rotortwin_wire::events::LiveSample;
use serde::Deserialize;
use serde_json::json;
use std::convert::Infallible;

/// Subprotocols of Foxglove, and of Lichtblick and older versions; the part used here is the same in both.
pub const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Maximum size of a viewer's message.
pub const LONGEST_MESSAGE: usize = 64 << 10;
/// Maximum subscriptions per viewer.
const MOST_SUBSCRIPTIONS: usize = 1000;

/// The messages of one row of telemetry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Simulated time, ns.
    pub time_ns: u64,
    /// Protobuf-encoded.
    pub messages: Vec<(Topic, Vec<u8>)>,
}

/// Encodes samples as rows.
#[derive(Debug)]
pub struct Encoder(Streams);

impl Encoder {
    /// * `header`: of the run of the samples
    pub fn new(header: &SpoolHeader) -> Self {
        Self(Streams::new(header, &telemetry_columns(header.rotor_count)))
    }

    /// The messages of a sample.
    pub fn row(&mut self, sample: &LiveSample) -> Row {
        let mut messages = Vec::new();
        let at = |place: usize| sample.values.get(place).copied().flatten().unwrap_or(f64::NAN);
        let time = self.0.row(at, |topic, _, message| {
            messages.push((topic, message.to_vec()));
            Ok::<_, Infallible>(())
        });
        let Ok(time_ns) = time;
        Row { time_ns, messages }
    }
}

/// The first message of a server.
///
/// * `session`: different for each run, so that a reconnecting viewer starts anew
pub fn server_info(name: &str, session: &str) -> String {
    json!({
        "op": "serverInfo", "name": name, "capabilities": ["time"], "supportedEncodings": [], "metadata": {}, "sessionId": session,
    })
    .to_string()
}

/// The second one: the available topics, with their message schemas.
pub fn advertise() -> String {
    let channels = Topic::ALL.map(|topic| {
        let (schema_name, descriptors) = topic.schema();
        json!({
            "id": topic as usize, "topic": topic.name(), "encoding": "protobuf", "schemaName": schema_name,
            "schema": STANDARD.encode(descriptors), "schemaEncoding": "protobuf",
        })
    });
    json!({ "op": "advertise", "channels": channels }).to_string()
}

/// A text that the viewer shows as a warning.
pub fn status(sentence: &str) -> String {
    const WARNING: u8 = 1;
    json!({ "op": "status", "level": WARNING, "message": sentence }).to_string()
}

/// A viewer's message.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
enum Said {
    Subscribe { subscriptions: Vec<Subscription> },
    Unsubscribe { subscription_ids: Vec<u32> },
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: usize,
}

/// Subscriptions of one viewer.
#[derive(Debug, Default)]
pub struct Viewer {
    wanted: Vec<(u32, Topic)>,
}

impl Viewer {
    /// Processes a viewer's message; returns the newly subscribed topics.
    ///
    /// # Errors
    /// A message for the viewer ([`status`]); the subscriptions are unchanged.
    pub fn hear(&mut self, text: &str) -> Result<Vec<Topic>, String> {
        match serde_json::from_str(text).map_err(|error| format!("invalid message: {error}"))? {
            Said::Subscribe { subscriptions } => {
                let wanted = subscriptions.iter().map(|wish| {
                    let topic = Topic::ALL.get(wish.channel_id).copied();
                    let topic = topic.ok_or_else(|| {
                        format!("unknown channel {}; expected one of those advertised", wish.channel_id)
                    })?;
                    Ok((wish.id, topic))
                });
                let wanted = wanted.collect::<Result<Vec<_>, String>>()?;
                if self.wanted.len() + wanted.len() > MOST_SUBSCRIPTIONS {
                    return Err(format!("expected at most {MOST_SUBSCRIPTIONS} subscriptions"));
                }
                if let Some((id, _)) = wanted
                    .iter()
                    .find(|(id, _)| self.wanted.iter().any(|(known, _)| known == id))
                {
                    return Err(format!("subscription {id} already exists; expected a unique id"));
                }
                let topics = wanted.iter().map(|(_, topic)| *topic).collect();
                self.wanted.extend(wanted);
                Ok(topics)
            }
            Said::Unsubscribe { subscription_ids } => {
                self.wanted.retain(|(id, _)| !subscription_ids.contains(id));
                Ok(Vec::new())
            }
        }
    }

    /// The binary messages of a row for this viewer: the time, and its subscribed topics.
    pub fn frames(&self, row: &Row) -> Vec<Vec<u8>> {
        const TIME: u8 = 2;
        let mut time = vec![TIME];
        time.extend(row.time_ns.to_le_bytes());
        let messages = row
            .messages
            .iter()
            .flat_map(|(topic, message)| self.of(*topic, row.time_ns, message));
        std::iter::once(time).chain(messages).collect()
    }

    /// The same of one message.
    pub fn of<'a>(&'a self, topic: Topic, time_ns: u64, message: &'a [u8]) -> impl Iterator<Item = Vec<u8>> + 'a {
        const MESSAGE: u8 = 1;
        let ids = self.wanted.iter().filter(move |(_, wanted)| *wanted == topic);
        ids.map(move |(id, _)| {
            let mut frame = Vec::with_capacity(13 + message.len());
            frame.push(MESSAGE);
            frame.extend(id.to_le_bytes());
            frame.extend(time_ns.to_le_bytes());
            frame.extend(message);
            frame
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Encoding by hand according to the specification.
    #[test]
    fn val_frames_are_those_of_the_specification() {
        let mut viewer = Viewer::default();
        let row = Row {
            time_ns: 0x0102_0304_0506_0708,
            messages: vec![(Topic::Nav, vec![0xaa, 0xbb]), (Topic::Log, vec![0xcc])],
        };
        let time = vec![2, 8, 7, 6, 5, 4, 3, 2, 1];
        assert_eq!(viewer.frames(&row), std::slice::from_ref(&time));
        let nav = Topic::Nav as usize;
        let wish = format!(r#"{{"op":"subscribe","subscriptions":[{{"id":258,"channelId":{nav}}}]}}"#);
        assert_eq!(viewer.hear(&wish), Ok(vec![Topic::Nav]));
        let frame = vec![1, 2, 1, 0, 0, 8, 7, 6, 5, 4, 3, 2, 1, 0xaa, 0xbb];
        assert_eq!(viewer.frames(&row), [time.clone(), frame]);
        assert!(viewer.hear(&wish).unwrap_err().contains("258"), "the same number twice");
        assert_eq!(
            viewer.hear(r#"{"op":"unsubscribe","subscriptionIds":[258]}"#),
            Ok(vec![])
        );
        assert_eq!(viewer.frames(&row), [time]);
    }

    #[test]
    fn val_what_makes_no_sense_is_answered_and_changes_nothing() {
        let mut viewer = Viewer::default();
        for wrong in [
            "",
            "[]",
            r#"{"op":"setParameters","parameters":[]}"#,
            r#"{"op":"subscribe"}"#,
            r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":0},{"id":2,"channelId":999}]}"#,
            r#"{"op":"subscribe","subscriptions":[{"id":-1,"channelId":0}]}"#,
        ] {
            viewer.hear(wrong).expect_err(wrong);
            assert!(viewer.wanted.is_empty(), "{wrong}");
        }
    }

    #[test]
    fn val_topics_are_advertised_by_their_place() {
        let said: serde_json::Value = serde_json::from_str(&advertise()).unwrap();
        for (place, topic) in Topic::ALL.into_iter().enumerate() {
            assert_eq!(topic as usize, place);
            assert_eq!(said["channels"][place]["id"], place);
            assert_eq!(said["channels"][place]["topic"], topic.name());
        }
    }
}
