//! A viewer that speaks Foxglove's WebSocket protocol, written from its specification, not from our server.

use crate::websocket::WebSocket;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::net::TcpStream;
use std::time::Duration;

/// Timeout of a message.
const PATIENCE: Duration = Duration::from_secs(30);

/// A channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Id assigned by the server.
    pub id: u64,
    /// Full name of the message.
    pub schema_name: String,
    /// Serialized descriptors.
    pub schema: Vec<u8>,
}

/// Content after the handshake.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// A message: topic, time (ns), bytes.
    Message(String, u64, Vec<u8>),
    /// The server's time, ns.
    Time(u64),
    /// Text: `status`.
    Text(Value),
    /// The server has closed.
    End,
}

/// A viewer.
#[derive(Debug)]
pub struct Viewer {
    socket: WebSocket,
    /// The first message.
    pub info: Value,
    /// By topic.
    pub channels: BTreeMap<String, Channel>,
    subscribed: BTreeMap<u32, String>,
}

impl Viewer {
    /// Connects and receives the channel list.
    ///
    /// # Panics
    /// The server violates the protocol.
    pub fn connect(address: &str, path: &str, protocol: &str) -> Self {
        let stream = TcpStream::connect(address).unwrap_or_else(|error| panic!("{address}: {error}"));
        stream.set_read_timeout(Some(PATIENCE)).expect("an option");
        let socket = WebSocket::open_on(stream, address, path, &[("sec-websocket-protocol", protocol)]);
        let mut socket = socket.unwrap_or_else(|refusal| panic!("{address}{path}: {refusal:?}"));
        let info = socket.next_message().expect("serverInfo");
        assert_eq!(info["op"], "serverInfo");
        let said = socket.next_message().expect("advertise");
        assert_eq!(said["op"], "advertise");
        let text = |value: &Value| value.as_str().expect("text").to_owned();
        let channels = said["channels"].as_array().expect("channels").iter().map(|channel| {
            assert_eq!(channel["encoding"], "protobuf");
            assert_eq!(channel["schemaEncoding"], "protobuf");
            let known = Channel {
                id: channel["id"].as_u64().expect("a number"),
                schema_name: text(&channel["schemaName"]),
                schema: base64(&text(&channel["schema"])),
            };
            (text(&channel["topic"]), known)
        });
        Self {
            channels: channels.collect(),
            info,
            socket,
            subscribed: BTreeMap::new(),
        }
    }

    /// Subscribes to topics, with ids from `first` on.
    ///
    /// # Panics
    /// Unknown topic.
    pub fn subscribe(&mut self, first: u32, topics: &[&str]) {
        let wishes: Vec<Value> = (first..)
            .zip(topics)
            .map(|(id, topic)| {
                self.subscribed.insert(id, (*topic).to_owned());
                json!({ "id": id, "channelId": self.channels[*topic].id })
            })
            .collect();
        self.socket.say(&json!({ "op": "subscribe", "subscriptions": wishes }));
    }

    /// Sends any message.
    pub fn say(&mut self, message: &Value) {
        self.socket.say(message);
    }

    /// The next message.
    ///
    /// # Panics
    /// There is none, or it violates the protocol.
    pub fn hear(&mut self) -> Heard {
        let number = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().expect("8 bytes"));
        match self.socket.frame() {
            (8, _) => Heard::End,
            (1, text) => Heard::Text(serde_json::from_slice(&text).expect("JSON")),
            (2, bytes) => match bytes[0] {
                1 => {
                    let id = u32::from_le_bytes(bytes[1..5].try_into().expect("4 bytes"));
                    Heard::Message(
                        self.subscribed[&id].clone(),
                        number(&bytes[5..13]),
                        bytes[13..].to_vec(),
                    )
                }
                2 => Heard::Time(number(&bytes[1..])),
                other => panic!("no message of kind {other}"),
            },
            (kind, _) => panic!("no frame of kind {kind}"),
        }
    }
}

/// RFC 4648, section 4.
fn base64(text: &str) -> Vec<u8> {
    const LETTERS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let letters = text.bytes().filter(|letter| *letter != b'=');
    let values: Vec<u32> = letters
        .map(|letter| {
            LETTERS
                .iter()
                .position(|known| *known == letter)
                .expect("a letter of base64") as u32
        })
        .collect();
    values
        .chunks(4)
        .flat_map(|four| {
            let bits = four.iter().fold(0, |bits, value| bits << 6 | value) << (6 * (4 - four.len()));
            bits.to_be_bytes()[1..four.len()].to_vec()
        })
        .collect()
}
