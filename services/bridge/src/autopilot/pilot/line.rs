//! The line between a pilot and its autopilot: TCP, where we connect and retry until the peer listens, or UDP, where we receive.
//!
//! Nothing here blocks: a flight waits for the autopilot's own link, not for this one.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

/// Interval of connection attempts.
const AGAIN: Duration = Duration::from_millis(100);
/// Timeout of a connection attempt.
const ATTEMPT: Duration = Duration::from_secs(1);
/// After this much silence of a sender, one from another port may take its place.
const GONE: Duration = Duration::from_secs(2);
/// Maximum reads per poll.
const MOST_READS: usize = 32;
/// Maximum bytes waiting to be sent; more means that the peer has stopped reading, and they are dropped.
const MOST_WAITING: usize = 1 << 16;

/// Command address of an autopilot, as written on the command line: `tcp:127.0.0.1:5760`, `udp:127.0.0.1:14540`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PilotAddress {
    /// It listens there, we connect.
    Tcp(SocketAddr),
    /// It sends to there, we listen.
    Udp(SocketAddr),
}

impl std::str::FromStr for PilotAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let sentence = || {
            format!(
                "'{text}': expected tcp:IP:PORT where the autopilot listens, udp:IP:PORT where it sends to, or none"
            )
        };
        let (kind, rest) = text.split_once(':').ok_or_else(sentence)?;
        let Ok(address) = rest.parse() else {
            return Err(sentence());
        };
        match kind {
            "tcp" => Ok(Self::Tcp(address)),
            "udp" => Ok(Self::Udp(address)),
            _ => Err(sentence()),
        }
    }
}

impl std::fmt::Display for PilotAddress {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Tcp(address) => write!(out, "tcp:{address}"),
            Self::Udp(address) => write!(out, "udp:{address}"),
        }
    }
}

/// An open line.
#[derive(Debug)]
pub(super) struct Line {
    address: PilotAddress,
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    Connecting {
        arrival: Receiver<TcpStream>,
        _leash: Leash,
    },
    Tcp(TcpStream, Vec<u8>),
    Udp(UdpSocket, Option<(SocketAddr, Instant)>),
}

/// Ends the thread that connects when it is dropped.
#[derive(Debug)]
struct Leash(Arc<AtomicBool>);

impl Drop for Leash {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Line {
    /// # Errors
    /// The UDP port is in use, or not permitted.
    pub(super) fn open(address: PilotAddress) -> Result<Self, String> {
        let kind = match address {
            PilotAddress::Tcp(to) => connect(to),
            PilotAddress::Udp(at) => {
                let socket = UdpSocket::bind(at)
                    .and_then(|socket| socket.set_nonblocking(true).map(|()| socket))
                    .map_err(|error| format!("cannot open UDP {at} for the pilot (--pilot): {error}"))?;
                Kind::Udp(socket, None)
            }
        };
        Ok(Self { address, kind })
    }

    /// Its address: for a UDP line the port that was opened.
    pub(super) fn address(&self) -> PilotAddress {
        match &self.kind {
            Kind::Udp(socket, _) => socket.local_addr().map_or(self.address, PilotAddress::Udp),
            _ => self.address,
        }
    }

    /// True if a peer is connected.
    pub(super) fn connected(&self) -> bool {
        match &self.kind {
            Kind::Connecting { .. } => false,
            Kind::Tcp(..) => true,
            Kind::Udp(_, peer) => peer.is_some(),
        }
    }

    /// Passes received data on piece by piece. True: the peer has closed; a new connection is attempted.
    pub(super) fn receive(&mut self, mut take: impl FnMut(&[u8])) -> bool {
        let mut buffer = [0; 4096];
        match &mut self.kind {
            Kind::Connecting { arrival, .. } => match arrival.try_recv() {
                Ok(stream) => self.kind = Kind::Tcp(stream, Vec::new()),
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => {}
            },
            Kind::Tcp(stream, _) => {
                for _ in 0..MOST_READS {
                    match stream.read(&mut buffer) {
                        Ok(0) => return self.reconnect(),
                        Ok(length) => take(&buffer[..length]),
                        Err(error) if is_nothing_yet(&error) => break,
                        Err(_) => return self.reconnect(),
                    }
                }
            }
            Kind::Udp(socket, peer) => {
                for _ in 0..MOST_READS {
                    let Ok((length, from)) = socket.recv_from(&mut buffer) else {
                        break;
                    };
                    match peer {
                        Some((known, last)) if *known != from && last.elapsed() < GONE => continue,
                        _ => *peer = Some((from, Instant::now())),
                    }
                    take(&buffer[..length]);
                }
            }
        }
        false
    }

    /// Sends as much as possible without waiting.
    pub(super) fn send(&mut self, bytes: &[u8]) {
        match &mut self.kind {
            Kind::Connecting { .. } => {}
            Kind::Tcp(stream, waiting) => {
                if waiting.len() + bytes.len() <= MOST_WAITING {
                    waiting.extend(bytes);
                }
                while !waiting.is_empty() {
                    match stream.write(waiting) {
                        Ok(0) => break,
                        Ok(length) => drop(waiting.drain(..length)),
                        Err(error) if error.kind() == ErrorKind::Interrupted => {}
                        // Full, or closed: the next poll finds out.
                        Err(_) => break,
                    }
                }
            }
            Kind::Udp(socket, peer) => {
                if let Some((to, _)) = peer
                    && let Err(error) = socket.send_to(bytes, *to)
                {
                    tracing::debug!(%error, "a message of the pilot was not sent");
                }
            }
        }
    }

    fn reconnect(&mut self) -> bool {
        if let PilotAddress::Tcp(to) = self.address {
            self.kind = connect(to);
        }
        true
    }
}

fn is_nothing_yet(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Retries until the peer listens, in parallel with the flight: some autopilots send nothing before a client connects.
fn connect(to: SocketAddr) -> Kind {
    let (sender, arrival) = channel();
    let stop = Arc::new(AtomicBool::new(false));
    let leash = Leash(stop.clone());
    std::thread::spawn(move || {
        while !stop.load(Ordering::Relaxed) {
            let connected = TcpStream::connect_timeout(&to, ATTEMPT).and_then(|stream| {
                stream.set_nodelay(true)?;
                stream.set_nonblocking(true)?;
                Ok(stream)
            });
            match connected {
                // No receiver: the flight is over.
                Ok(stream) => return drop(sender.send(stream)),
                Err(_) => std::thread::sleep(AGAIN),
            }
        }
    });
    Kind::Connecting { arrival, _leash: leash }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    #[test]
    fn val_addresses_as_people_write_them() {
        let text = |text: &str| text.parse::<PilotAddress>().map(|address| address.to_string());
        assert_eq!(text("tcp:127.0.0.1:5760"), Ok("tcp:127.0.0.1:5760".to_owned()));
        assert_eq!(text("udp:0.0.0.0:14550"), Ok("udp:0.0.0.0:14550".to_owned()));
        for bad in ["5760", "tcp:5760", "serial:/dev/ttyACM0", "udp:nowhere:1"] {
            let said = text(bad).unwrap_err();
            assert!(said.starts_with(&format!("'{bad}': expected tcp:IP:PORT")), "{said}");
        }
    }

    fn until(line: &mut Line, mut done: impl FnMut(&mut Line) -> bool) {
        let start = Instant::now();
        while !done(line) {
            assert!(start.elapsed() < Duration::from_secs(10), "{line:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn val_tcp_is_tried_until_somebody_listens_and_again_after_it_closed() {
        let probe = TcpListener::bind("127.0.0.1:0").unwrap();
        let at = probe.local_addr().unwrap();
        drop(probe);
        let mut line = Line::open(PilotAddress::Tcp(at)).unwrap();
        assert!(!line.connected());
        let listener = TcpListener::bind(at).unwrap();
        for _ in 0..2 {
            let (mut stream, _) = listener.accept().unwrap();
            until(&mut line, |line| {
                line.receive(|_| {});
                line.connected()
            });
            line.send(b"hello");
            let mut five = [0; 5];
            stream.read_exact(&mut five).unwrap();
            assert_eq!(&five, b"hello");
            stream.write_all(b"answer").unwrap();
            let mut got: Vec<u8> = Vec::new();
            until(&mut line, |line| {
                line.receive(|bytes| got.extend(bytes));
                got == b"answer"
            });
            drop(stream);
            until(&mut line, |line| line.receive(|_| {}));
            assert!(!line.connected());
        }
    }

    #[test]
    fn val_udp_answers_whom_it_heard_and_nobody_else() {
        let mut line = Line::open("udp:127.0.0.1:0".parse().unwrap()).unwrap();
        let PilotAddress::Udp(at) = line.address() else {
            panic!("it is a UDP line");
        };
        let [peer, stranger] = [0; 2].map(|_| UdpSocket::bind("127.0.0.1:0").unwrap());
        peer.send_to(b"a", at).unwrap();
        let mut got: Vec<u8> = Vec::new();
        until(&mut line, |line| {
            line.receive(|bytes| got.extend(bytes));
            got == b"a"
        });
        stranger.send_to(b"b", at).unwrap();
        peer.send_to(b"c", at).unwrap();
        until(&mut line, |line| {
            line.receive(|bytes| got.extend(bytes));
            got == b"ac"
        });
        line.send(b"answer");
        let mut buffer = [0; 16];
        assert_eq!(peer.recv(&mut buffer).unwrap(), 6);
        let busy = Line::open(PilotAddress::Udp(at)).unwrap_err();
        assert!(
            busy.starts_with(&format!("cannot open UDP {at} for the pilot (--pilot)")),
            "{busy}"
        );
    }
}
