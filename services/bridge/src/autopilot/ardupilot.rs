//! ArduPilot's JSON backend: we are the UDP server, it sends servo packets as requests and waits for each answer.
//!
//! ```text
//!  ArduPilot ── servo packet n ──▶ hold its pulses for 1 ms ──▶ answer n with the readings after it ──▶ servo packet n + 1
//! ```
//! It repeats a packet, with the same number, after each second without an answer. A repeated packet sent before our answer is dropped:
//! a second answer would stay in its socket, and it would fly on stale readings from then on. Only a packet repeated after our answer means
//! that the answer was lost; it is answered again with the same line.
//!
//! A packet 0 means that it has restarted: allowed before the flight, in flight it ends the run. The clock is ours; its requested frame
//! rate is ignored.

use super::servo_packet::{LONGEST, RcChannels, ServoPacket, write_answer};
use super::{OutputMap, Patience, Wait};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_wire::autopilot::{Autopilot, AutopilotError, Identity, Readings};
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// Default address that ArduPilot sends to.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:9002";
/// Two parts of 0.5 ms: its loop needs 720 Hz and more.
const INTERVAL_PARTS: u32 = 2;
/// A packet repeated within this time after our answer was already in flight when we answered; it repeats once a second.
const CROSSING: Duration = Duration::from_millis(300);
/// After this much silence of a peer, one from another port may take its place.
const GONE: Duration = Duration::from_secs(2);
/// Maximum datagrams processed before an answer is sent; more are left for the following wait.
const MOST_DRAINED: usize = 1000;
/// Maximum frames that may arrive before their predecessor was answered: the remainder of a duplicate answer.
const MOST_UNANSWERED: u32 = 10;

/// The link to one ArduPilot.
#[derive(Debug)]
pub struct ArduPilot {
    socket: UdpSocket,
    map: OutputMap,
    patience: Patience,
    rc: RcChannels,
    peer: Option<SocketAddr>,
    /// The latest packet, and when it came.
    latest: Option<(ServoPacket, Instant)>,
    /// The latest packet has not been answered yet.
    owed: bool,
    /// The latest packet has not been processed yet.
    fresh: bool,
    answer: String,
    answered: Option<Instant>,
    unanswered: u32,
    in_flight: bool,
    /// Invalid datagrams in this wait: their number, and the error of the last one.
    foreign: (u64, String),
    /// All that were ignored since it listens.
    ignored: u64,
}

/// Classification of a datagram.
enum Verdict {
    Next,
    Repeated,
    Nothing,
}

impl ArduPilot {
    /// Listens on `address`.
    ///
    /// # Errors
    /// The port is in use, or not permitted.
    pub fn listen(address: SocketAddr, map: OutputMap, patience: Patience) -> Result<Self, String> {
        let socket = UdpSocket::bind(address)
            .map_err(|error| format!("cannot open UDP {address} to wait for ArduPilot: {error}"))?;
        Ok(Self {
            socket,
            map,
            patience,
            rc: RcChannels::default(),
            peer: None,
            latest: None,
            owed: false,
            fresh: false,
            answer: String::new(),
            answered: None,
            unanswered: 0,
            in_flight: false,
            foreign: (0, String::new()),
            ignored: 0,
        })
    }

    /// With a transmitter, for builds that take `rc` (upstream since its pull request 30732 of July 2025).
    #[must_use]
    pub fn with_rc(self, rc: RcChannels) -> Self {
        Self { rc, ..self }
    }

    /// Datagrams since it listens that are no servo packets, or come from another sender than its peer.
    pub fn ignored(&self) -> u64 {
        self.ignored
    }

    fn ignore(&mut self, what: String) -> Verdict {
        self.ignored += 1;
        self.foreign = (self.foreign.0 + 1, what);
        Verdict::Nothing
    }

    /// Where it listens.
    pub fn local_address(&self) -> Option<SocketAddr> {
        self.socket.local_addr().ok()
    }

    fn name(&self) -> String {
        match self.peer {
            Some(peer) => format!("ArduPilot at {peer}"),
            None => "ArduPilot".to_owned(),
        }
    }

    fn frame(&self) -> Option<u32> {
        self.latest.map(|(packet, _)| packet.frame)
    }

    /// Answers the latest packet, unless the peer has moved on without the answer.
    fn answer(&mut self, readings: &Readings) -> Result<(), AutopilotError> {
        write_answer(&mut self.answer, readings, &self.rc);
        self.socket.set_nonblocking(true).map_err(|error| self.broken(&error))?;
        let moved_on = self.drain();
        self.socket
            .set_nonblocking(false)
            .map_err(|error| self.broken(&error))?;
        if moved_on? {
            return Ok(());
        }
        self.owed = false;
        self.send_answer()
    }

    /// Processes what arrived before the answer: repetitions of its packet are dropped. True: the next packet has already arrived.
    fn drain(&mut self) -> Result<bool, AutopilotError> {
        let mut buffer = [0; 2 * LONGEST];
        for _ in 0..MOST_DRAINED {
            let Ok((length, from)) = self.socket.recv_from(&mut buffer) else {
                return Ok(false);
            };
            if let Verdict::Next = self.judge(&buffer[..length], from)? {
                self.unanswered += 1;
                if self.unanswered > MOST_UNANSWERED {
                    let frame = self.frame().unwrap_or(0);
                    let sentence = format!(
                        "{} does not wait for replies: frame {frame} is one of more than {MOST_UNANSWERED} that arrived before their \
                         predecessor was answered",
                        self.name()
                    );
                    return Err(AutopilotError::wrong(sentence));
                }
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn send_answer(&mut self) -> Result<(), AutopilotError> {
        let Some(peer) = self.peer else {
            return Ok(());
        };
        match self.socket.send_to(self.answer.as_bytes(), peer) {
            Ok(_) => {}
            // The peer is gone; the wait for its next packet reports it, or its successor connects.
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
            Err(error) => return Err(self.broken(&error)),
        }
        self.answered = Some(Instant::now());
        Ok(())
    }

    /// Waits for the next packet.
    fn next(&mut self) -> Result<(), AutopilotError> {
        let wait = Wait::new(match self.peer {
            Some(_) => self.patience.step,
            None => self.patience.join,
        });
        self.foreign = (0, String::new());
        let mut buffer = [0; 2 * LONGEST];
        loop {
            if self.patience.stopped() {
                return Err(AutopilotError::stopped());
            }
            let Some(slice) = wait.slice() else {
                return Err(self.silent(&wait));
            };
            self.socket
                .set_read_timeout(Some(slice))
                .map_err(|error| self.broken(&error))?;
            match self.socket.recv_from(&mut buffer) {
                Ok((length, from)) => match self.judge(&buffer[..length], from)? {
                    Verdict::Next => return Ok(()),
                    Verdict::Repeated => self.answer_again()?,
                    Verdict::Nothing => {}
                },
                Err(error) if is_nothing_yet(&error) => {}
                Err(error) => return Err(self.broken(&error)),
            }
        }
    }

    /// The answer to the repeated packet was lost, unless both crossed.
    fn answer_again(&mut self) -> Result<(), AutopilotError> {
        match self.answered {
            Some(at) if at.elapsed() >= CROSSING => self.send_answer(),
            _ => Ok(()),
        }
    }

    /// Classifies a datagram; the next packet is stored.
    fn judge(&mut self, bytes: &[u8], from: SocketAddr) -> Result<Verdict, AutopilotError> {
        let packet = match ServoPacket::decode(bytes) {
            Ok(packet) => packet,
            Err(reason) => {
                return Ok(self.ignore(format!("the last from {from} has {reason}")));
            }
        };
        let Some((latest, came)) = self.latest else {
            return self.keep(packet, from);
        };
        let restarted = packet.frame < latest.frame && packet.frame == 0;
        if Some(from) != self.peer {
            if restarted || came.elapsed() > GONE {
                return self.restarted(packet, from);
            }
            return Ok(self.ignore(format!("the last is a servo packet from {from}, another sender")));
        }
        match packet.frame.wrapping_sub(latest.frame) {
            0 => Ok(Verdict::Repeated),
            1 => self.keep(packet, from),
            _ if restarted => self.restarted(packet, from),
            // An overtaken packet.
            ahead if ahead > u32::MAX / 2 => Ok(Verdict::Nothing),
            _ => {
                let sentence = format!(
                    "{} sent frame {} after frame {}: it did not wait for the replies between them",
                    self.name(),
                    packet.frame,
                    latest.frame
                );
                Err(AutopilotError::wrong(sentence))
            }
        }
    }

    fn restarted(&mut self, packet: ServoPacket, from: SocketAddr) -> Result<Verdict, AutopilotError> {
        if self.in_flight {
            let sentence = format!(
                "{} restarted in flight: its frame {} was followed by frame {} from {from}",
                self.name(),
                self.frame().unwrap_or(0),
                packet.frame
            );
            return Err(AutopilotError::lost(sentence, Duration::ZERO));
        }
        tracing::warn!(%from, "ArduPilot restarted before the flight");
        self.keep(packet, from)
    }

    fn keep(&mut self, packet: ServoPacket, from: SocketAddr) -> Result<Verdict, AutopilotError> {
        self.peer = Some(from);
        self.latest = Some((packet, Instant::now()));
        (self.owed, self.fresh) = (true, true);
        if let Some((channel, pulse)) = packet.impossible_pulse(self.map.rotor_of_channel.len()) {
            let sentence = format!(
                "{}, frame {}: channel {channel} has a pulse of {pulse} µs, expected 0 (none) or 400 to 2600",
                self.name(),
                packet.frame
            );
            return Err(AutopilotError::wrong(sentence));
        }
        Ok(Verdict::Next)
    }

    fn silent(&self, wait: &Wait) -> AutopilotError {
        let (silence, limit) = (wait.silence(), wait.limit.as_millis());
        let besides = match &self.foreign {
            (0, _) => String::new(),
            (1, what) => format!("; 1 other datagram came: {what}"),
            (count, what) => format!("; {count} other datagrams came: {what}"),
        };
        let sentence = match self.frame() {
            Some(frame) => format!(
                "{} sent nothing new after frame {frame}: silent for {} ms, allowed are {limit} ms (--step-timeout){besides}",
                self.name(),
                silence.as_millis()
            ),
            None => format!(
                "no servo packet of ArduPilot came to UDP {} within {limit} ms (--join-timeout){besides}",
                self.local_address()
                    .map_or_else(String::new, |address| address.to_string())
            ),
        };
        AutopilotError::lost(sentence, silence)
    }

    fn broken(&self, error: &std::io::Error) -> AutopilotError {
        let frame = self
            .frame()
            .map_or_else(String::new, |frame| format!(" after frame {frame}"));
        AutopilotError::wrong(format!("the socket to {} failed{frame}: {error}", self.name()))
    }
}

/// The time is over, or a signal arrived; or, on an unconnected socket, an answer found no receiver.
fn is_nothing_yet(error: &std::io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::ConnectionRefused
    )
}

impl Autopilot for ArduPilot {
    fn interval_parts(&self) -> u32 {
        INTERVAL_PARTS
    }

    fn exchange(&mut self, readings: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
        self.fresh = false;
        if self.owed {
            self.answer(readings)?;
        }
        if !self.fresh {
            self.next()?;
        }
        let pulses = self.latest.map_or([0; 32], |(packet, _)| packet.pulses_us);
        Ok(self.map.duties(|channel| self.map.duty(f64::from(pulses[channel]))))
    }

    fn identity(&self) -> Identity {
        Identity {
            peer: self.name(),
            version: None,
            lockstep: true,
        }
    }

    fn flight_begins(&mut self) {
        self.in_flight = true;
    }
}
