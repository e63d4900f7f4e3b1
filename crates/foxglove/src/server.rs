//! A WebSocket server for the viewers of one flight: one thread accepts them, and one thread writes to each.
//!
//! Each viewer has a queue of [`QUEUE`] rows. Rows that do not fit are lost to it, and it is informed of their number. A viewer that
//! accepts nothing for [`SOCKET_TIMEOUT`] is disconnected. The flight never waits, except up to [`FLUSH_TIMEOUT`] at the end, so that the last rows
//! arrive.

use crate::protocol::{self, Encoder, LONGEST_MESSAGE, Row, SUBPROTOCOLS, Viewer};
use rotortwin_store::SpoolHeader;
use rotortwin_store::streams::Topic;
use rotortwin_wire::events::LiveSample;
use std::collections::VecDeque;
use std::io::{ErrorKind, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tungstenite::handshake::HandshakeError;
use tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tungstenite::http::{HeaderValue, StatusCode};
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Message, WebSocket};

/// Queue length of a viewer: 5 s at the usual rate.
const QUEUE: usize = 256;
/// Timeout of the handshake, and of each write.
const SOCKET_TIMEOUT: Duration = Duration::from_secs(2);
/// Polling interval for messages from a viewer.
const LOOK: Duration = Duration::from_millis(20);
/// Timeout of one poll.
const GLANCE: Duration = Duration::from_millis(1);
/// Time for the last rows of all viewers together.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(1);
/// Maximum simultaneous viewers.
const MOST_VIEWERS: usize = 16;
/// Log lines kept for later viewers.
const KEPT_LINES: usize = 200;

/// Serves one flight.
#[derive(Debug)]
pub struct Server {
    shared: Arc<Shared>,
    encoder: Encoder,
    address: SocketAddr,
}

#[derive(Debug)]
struct Shared {
    name: String,
    session: String,
    inside: Mutex<Inside>,
    over: AtomicBool,
}

#[derive(Debug, Default)]
struct Inside {
    viewers: Vec<Queue>,
    /// Simulated time, ns, and message.
    log: VecDeque<(u64, Vec<u8>)>,
}

/// The flight's end of a viewer's queue.
#[derive(Debug)]
struct Queue {
    rows: SyncSender<Arc<Row>>,
    lost: Arc<AtomicU64>,
    alive: Arc<AtomicBool>,
}

impl Server {
    /// Listens; viewers may connect and disconnect from now on.
    ///
    /// * `at`: port 0 chooses a free one   * `name`: shown by viewers   * `session`: unique to this run
    ///
    /// # Errors
    /// The address is not available.
    pub fn listen(at: SocketAddr, name: &str, session: &str, header: &SpoolHeader) -> Result<Self, String> {
        let refuse = |error: std::io::Error| match error.kind() {
            ErrorKind::AddrInUse => format!(
                "{at}: cannot listen for viewers: the port is in use; expected a free one, {} takes any",
                SocketAddr::new(at.ip(), 0)
            ),
            _ => format!("{at}: cannot listen for viewers: {error}"),
        };
        let listener = TcpListener::bind(at).map_err(refuse)?;
        let address = listener.local_addr().map_err(refuse)?;
        listener.set_nonblocking(true).map_err(refuse)?;
        let shared = Arc::new(Shared {
            name: name.to_owned(),
            session: session.to_owned(),
            inside: Mutex::default(),
            over: AtomicBool::new(false),
        });
        let ours = Arc::clone(&shared);
        std::thread::Builder::new()
            .name("foxglove".to_owned())
            .spawn(move || wait_for_viewers(&listener, &ours))
            .map_err(refuse)?;
        Ok(Self {
            shared,
            encoder: Encoder::new(header),
            address,
        })
    }

    /// Listening address.
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sends a sample to every viewer with space in its queue.
    pub fn show(&mut self, sample: &LiveSample) {
        let row = Arc::new(self.encoder.row(sample));
        let lines = row.messages.iter().filter(|(topic, _)| *topic == Topic::Log);
        let mut inside = locked(&self.shared.inside);
        inside.log.extend(lines.map(|(_, line)| (row.time_ns, line.clone())));
        let surplus = inside.log.len().saturating_sub(KEPT_LINES);
        inside.log.drain(..surplus);
        inside
            .viewers
            .retain(|viewer| match viewer.rows.try_send(Arc::clone(&row)) {
                Ok(()) => true,
                Err(TrySendError::Full(_)) => {
                    viewer.lost.fetch_add(1, Ordering::Relaxed);
                    true
                }
                Err(TrySendError::Disconnected(_)) => false,
            });
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.over.store(true, Ordering::Relaxed);
        let viewers = std::mem::take(&mut locked(&self.shared.inside).viewers);
        let alive: Vec<_> = viewers.into_iter().map(|viewer| viewer.alive).collect();
        let end = Instant::now() + FLUSH_TIMEOUT;
        while alive.iter().any(|alive| alive.load(Ordering::Relaxed)) && Instant::now() < end {
            std::thread::sleep(GLANCE);
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn wait_for_viewers(listener: &TcpListener, shared: &Arc<Shared>) {
    while !shared.over.load(Ordering::Relaxed) {
        match listener.accept() {
            Ok((stream, from)) => welcome(stream, from, shared),
            Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::sleep(LOOK),
            Err(error) => {
                // Too many open files, or a viewer that disconnected immediately.
                tracing::debug!(%error, "a viewer could not be accepted");
                std::thread::sleep(LOOK);
            }
        }
    }
}

fn welcome(stream: TcpStream, from: SocketAddr, shared: &Arc<Shared>) {
    let mut inside = locked(&shared.inside);
    inside.viewers.retain(|viewer| viewer.alive.load(Ordering::Relaxed));
    if inside.viewers.len() >= MOST_VIEWERS {
        tracing::warn!(%from, "a viewer was rejected: {MOST_VIEWERS} are connected");
        return;
    }
    let (rows, queue) = sync_channel(QUEUE);
    let (lost, alive) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicBool::new(true)));
    inside.viewers.push(Queue {
        rows,
        lost: Arc::clone(&lost),
        alive: Arc::clone(&alive),
    });
    // Earlier log messages; the rest arrives with its rows.
    let log: Vec<(u64, Vec<u8>)> = inside.log.iter().cloned().collect();
    drop(inside);
    let ours = Arc::clone(shared);
    let gone = Arc::clone(&alive);
    let serve = move || {
        if let Err(reason) = serve(stream, &ours, (&queue, &lost), log) {
            tracing::debug!(%from, reason, "a viewer is gone");
        }
        gone.store(false, Ordering::Relaxed);
    };
    if let Err(error) = std::thread::Builder::new()
        .name("foxglove viewer".to_owned())
        .spawn(serve)
    {
        tracing::warn!(%error, "a viewer was turned away");
        alive.store(false, Ordering::Relaxed);
    }
}

/// One viewer, from its handshake to its end or that of the flight.
///
/// * `log`: lines older than the rows of the queue
fn serve(
    stream: TcpStream,
    shared: &Shared,
    (queue, lost): (&Receiver<Arc<Row>>, &AtomicU64),
    mut log: Vec<(u64, Vec<u8>)>,
) -> Result<(), String> {
    let words = |error: std::io::Error| error.to_string();
    stream.set_nonblocking(false).map_err(words)?;
    stream.set_nodelay(true).map_err(words)?;
    stream.set_read_timeout(Some(SOCKET_TIMEOUT)).map_err(words)?;
    stream.set_write_timeout(Some(SOCKET_TIMEOUT)).map_err(words)?;
    let mut config = WebSocketConfig::default();
    config.max_message_size = Some(LONGEST_MESSAGE);
    config.max_frame_size = Some(LONGEST_MESSAGE);
    let answer = stream.try_clone().map_err(words)?;
    let mut socket = tungstenite::accept_hdr_with_config(stream, choose_protocol, Some(config)).map_err(|error| {
        if let HandshakeError::Failure(tungstenite::Error::Protocol(_)) = error {
            // A browser, for instance. It may be gone already.
            drop((&answer).write_all(no_viewer().as_bytes()));
        }
        format!("the hand-shake failed: {error}")
    })?;
    drop(answer);
    socket.get_ref().set_read_timeout(Some(GLANCE)).map_err(words)?;
    say(
        &mut socket,
        Message::text(protocol::server_info(&shared.name, &shared.session)),
    )?;
    say(&mut socket, Message::text(protocol::advertise()))?;
    let mut viewer = Viewer::default();
    let mut looked = Instant::now();
    loop {
        let over = match queue.recv_timeout(LOOK) {
            Ok(row) => {
                let lines = row.messages.iter().filter(|(topic, _)| *topic == Topic::Log);
                log.extend(lines.map(|(_, line)| (row.time_ns, line.clone())));
                for frame in viewer.frames(&row) {
                    socket
                        .write(Message::binary(frame))
                        .map_err(|error| error.to_string())?;
                }
                socket.flush().map_err(|error| error.to_string())?;
                false
            }
            Err(RecvTimeoutError::Timeout) => false,
            Err(RecvTimeoutError::Disconnected) => true,
        };
        let count = lost.swap(0, Ordering::Relaxed);
        if count > 0 {
            say(
                &mut socket,
                Message::text(protocol::status(&format!(
                    "{count} rows were dropped: this viewer is too slow"
                ))),
            )?;
        }
        if over {
            // The viewer receives a close, or has closed itself.
            drop(socket.close(None));
            drop(socket.flush());
            return Ok(());
        }
        if looked.elapsed() >= LOOK {
            listen_to(&mut socket, &mut viewer, &log)?;
            looked = Instant::now();
        }
    }
}

#[expect(clippy::result_large_err, reason = "the library's type")]
fn choose_protocol(request: &Request, mut response: Response) -> Result<Response, ErrorResponse> {
    const HEADER: &str = "sec-websocket-protocol";
    let offered = request.headers().get_all(HEADER).iter();
    let offered: Vec<&str> = offered
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .map(str::trim)
        .collect();
    match SUBPROTOCOLS.into_iter().find(|known| offered.contains(known)) {
        Some(known) => {
            response.headers_mut().insert(HEADER, HeaderValue::from_static(known));
            Ok(response)
        }
        None => {
            let mut refusal = ErrorResponse::new(Some(format!(
                "expected a viewer that offers the protocol {}\n",
                SUBPROTOCOLS.join(" or ")
            )));
            *refusal.status_mut() = StatusCode::BAD_REQUEST;
            Err(refusal)
        }
    }
}

/// The answer to a request that is none of a WebSocket.
fn no_viewer() -> String {
    let text = "This address is for Foxglove and Lichtblick: Open connection, Foxglove WebSocket, and this address with ws:// instead of http://\n";
    format!(
        "HTTP/1.1 426 Upgrade Required\r\nUpgrade: websocket\r\nConnection: close\r\nContent-Type: text/plain\r\nContent-Length: {}\r\n\r\n{text}",
        text.len()
    )
}

fn say(socket: &mut WebSocket<TcpStream>, message: Message) -> Result<(), String> {
    socket.send(message).map_err(|error| error.to_string())
}

/// Processes all messages received from a viewer meanwhile.
fn listen_to(socket: &mut WebSocket<TcpStream>, viewer: &mut Viewer, log: &[(u64, Vec<u8>)]) -> Result<(), String> {
    loop {
        let text = match socket.read() {
            Ok(Message::Text(text)) => text,
            Ok(Message::Close(_)) => return Err("it said so".to_owned()),
            Ok(Message::Binary(_)) => {
                say(
                    socket,
                    Message::text(protocol::status("messages from viewers are not accepted")),
                )?;
                continue;
            }
            Ok(_) => continue,
            Err(tungstenite::Error::Io(error))
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) =>
            {
                return Ok(());
            }
            Err(error) => return Err(error.to_string()),
        };
        match viewer.hear(&text) {
            Ok(topics) if topics.contains(&Topic::Log) => {
                for (time_ns, line) in log {
                    for frame in viewer.of(Topic::Log, *time_ns, line) {
                        say(socket, Message::binary(frame))?;
                    }
                }
            }
            Ok(_) => {}
            Err(sentence) => say(socket, Message::text(protocol::status(&sentence)))?,
        }
    }
}
