//! Just enough WebSocket (RFC 6455) to listen to a server under test: text messages, unfragmented.

use crate::server::Server;
use serde_json::Value;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;

/// An open WebSocket.
#[derive(Debug)]
pub struct WebSocket {
    stream: TcpStream,
}

impl WebSocket {
    /// Opens one; `Err`: the status and the body of the refusal.
    ///
    /// # Panics
    /// No HTTP answer comes.
    pub fn open(server: &Server, path: &str) -> Result<Self, (u16, Value)> {
        let mut stream = server.connect();
        let request = format!(
            "GET {path} HTTP/1.1\r\nhost: localhost\r\nconnection: upgrade\r\nupgrade: websocket\r\n\
             sec-websocket-version: 13\r\nsec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        );
        stream.write_all(request.as_bytes()).expect("it takes the request");
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            stream.read_exact(&mut byte).expect("an answer");
            head.push(byte[0]);
        }
        let head = String::from_utf8_lossy(&head).to_lowercase();
        let status = head
            .split(' ')
            .nth(1)
            .and_then(|code| code.parse().ok())
            .expect("a status");
        if status == 101 {
            return Ok(Self { stream });
        }
        let length = head.lines().find_map(|line| line.strip_prefix("content-length: "));
        let mut body = vec![0; length.and_then(|text| text.parse().ok()).unwrap_or(0)];
        stream.read_exact(&mut body).expect("the whole answer");
        Err((status, serde_json::from_slice(&body).unwrap_or_default()))
    }

    /// The next message; `None`: the server has closed it.
    ///
    /// # Panics
    /// The connection breaks, or nothing comes in time.
    pub fn next_message(&mut self) -> Option<Value> {
        loop {
            let mut head = [0; 2];
            self.stream.read_exact(&mut head).expect("a frame");
            let length = match head[1] & 0x7f {
                126 => {
                    let mut bytes = [0; 2];
                    self.stream.read_exact(&mut bytes).expect("a length");
                    usize::from(u16::from_be_bytes(bytes))
                }
                127 => {
                    let mut bytes = [0; 8];
                    self.stream.read_exact(&mut bytes).expect("a length");
                    usize::try_from(u64::from_be_bytes(bytes)).expect("a length")
                }
                short => usize::from(short),
            };
            let mut payload = vec![0; length];
            self.stream.read_exact(&mut payload).expect("a payload");
            match head[0] & 0x0f {
                1 => return Some(serde_json::from_slice(&payload).expect("JSON")),
                8 => return None,
                _ => {}
            }
        }
    }

    /// All messages up to the close.
    pub fn rest(&mut self) -> Vec<Value> {
        std::iter::from_fn(|| self.next_message()).collect()
    }

    /// Says something short.
    ///
    /// # Panics
    /// It is longer than 125 bytes, or the server does not take it.
    pub fn say(&mut self, message: &Value) {
        let text = message.to_string();
        let length = u8::try_from(text.len())
            .ok()
            .filter(|length| *length < 126)
            .expect("a short message");
        // A mask of zeros leaves the text as it is.
        let frame = [&[0x81, 0x80 | length, 0, 0, 0, 0], text.as_bytes()].concat();
        self.stream.write_all(&frame).expect("it takes the message");
    }
}
