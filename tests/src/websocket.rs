//! A minimal WebSocket (RFC 6455) client for a server under test: unfragmented messages.

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
    /// Opens one; `Err`: status and body of the rejection.
    ///
    /// # Panics
    /// There is no HTTP answer.
    pub fn open(server: &Server, path: &str) -> Result<Self, (u16, Value)> {
        Self::open_from(server, path, &[])
    }

    /// [`open`](Self::open) with more headers, as a browser sends them.
    ///
    /// # Panics
    /// There is no HTTP answer.
    pub fn open_from(server: &Server, path: &str, headers: &[(&str, &str)]) -> Result<Self, (u16, Value)> {
        Self::open_on(server.connect(), server.address(), path, headers)
    }

    /// [`open_from`](Self::open_from) for any server, over an existing connection.
    ///
    /// # Panics
    /// There is no HTTP answer.
    pub fn open_on(
        mut stream: TcpStream,
        host: &str,
        path: &str,
        headers: &[(&str, &str)],
    ) -> Result<Self, (u16, Value)> {
        stream.set_nodelay(true).expect("an option");
        let more: String = headers
            .iter()
            .map(|(name, value)| format!("{name}: {value}\r\n"))
            .collect();
        let request = format!(
            "GET {path} HTTP/1.1\r\nhost: {host}\r\n{more}connection: upgrade\r\nupgrade: websocket\r\n\
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

    /// The next frame: its kind (1 text, 2 binary, 8 close), and content.
    ///
    /// # Panics
    /// The connection breaks, or nothing comes in time.
    pub fn frame(&mut self) -> (u8, Vec<u8>) {
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
        (head[0] & 0x0f, payload)
    }

    /// The next text message, as JSON; `None`: the server has closed it.
    ///
    /// # Panics
    /// The connection breaks, or nothing comes in time.
    pub fn next_message(&mut self) -> Option<Value> {
        loop {
            match self.frame() {
                (1, payload) => return Some(serde_json::from_slice(&payload).expect("JSON")),
                (8, _) => return None,
                _ => {}
            }
        }
    }

    /// The next message, text or binary.
    ///
    /// # Panics
    /// The server closes instead.
    pub fn receive(&mut self) -> Vec<u8> {
        let (kind, payload) = self.frame();
        assert!(
            matches!(kind, 1 | 2),
            "kind {kind}: {}",
            String::from_utf8_lossy(&payload)
        );
        payload
    }

    /// All messages up to the close.
    pub fn rest(&mut self) -> Vec<Value> {
        std::iter::from_fn(|| self.next_message()).collect()
    }

    /// True if the server closes next.
    pub fn closed(&mut self) -> bool {
        self.frame().0 == 8
    }

    /// Sends JSON as a text message.
    pub fn say(&mut self, message: &Value) {
        self.send_text(&message.to_string());
    }

    /// Sends a text message.
    pub fn send_text(&mut self, text: &str) {
        self.send(1, text.as_bytes());
    }

    /// Sends a binary message.
    pub fn send_binary(&mut self, bytes: &[u8]) {
        self.send(2, bytes);
    }

    fn send(&mut self, kind: u8, payload: &[u8]) {
        let mut frame = vec![0x80 | kind];
        match payload.len() {
            length @ 0..126 => frame.push(0x80 | u8::try_from(length).expect("it is below 126")),
            length @ 126..0x1_0000 => {
                frame.push(0x80 | 126);
                frame.extend(u16::try_from(length).expect("it fits").to_be_bytes());
            }
            length => {
                frame.push(0x80 | 127);
                frame.extend((length as u64).to_be_bytes());
            }
        }
        // A client must mask; a mask of zeros leaves the payload as it is.
        frame.extend([0; 4]);
        frame.extend(payload);
        self.stream.write_all(&frame).expect("the server takes it");
    }
}
