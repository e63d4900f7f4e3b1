//! A virtual serial line with a virtual board, in virtual time: no clock is read and nothing waits, so that minutes on a bad line take
//! milliseconds, and the same seed gives the same faults.
//!
//! ```text
//!  byte k leaves at max(now, end of byte k−1), takes 10/baud, arrives latency + jitter later, in order
//! ```
//! Each byte may be lost, corrupted or duplicated; a burst replaces several consecutive bytes by noise; unplugging loses everything in
//! transit, and may interrupt the board's power. The board computes in zero time.

use crate::line::{Line, VirtualBoard};
use rotortwin_board::application::Application;
use std::collections::VecDeque;
use std::time::Duration;

/// An unplugged cable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unplugged {
    /// Start, s of the line's time.
    pub at_s: f64,
    /// Duration, s.
    pub for_s: f64,
    /// The cable powers the board, which restarts.
    pub power: bool,
}

/// Model of the line.
#[derive(Clone, Debug, PartialEq)]
pub struct LineModel {
    /// Bits per second, ten per byte.
    pub baud: f64,
    /// From the end of a byte to its arrival, s.
    pub latency_s: f64,
    /// Maximum additional delay, s, drawn uniformly for each byte; order is kept.
    pub jitter_s: f64,
    /// Fraction of bytes lost.
    pub loss: f64,
    /// Fraction of bytes corrupted.
    pub corruption: f64,
    /// Fraction of bytes duplicated.
    pub duplication: f64,
    /// Fraction of bytes at which a noise burst starts.
    pub burst: f64,
    /// Bytes of a burst.
    pub burst_length: u32,
    /// Unplugging events.
    pub unplugged: Vec<Unplugged>,
    /// Seed of all draws.
    pub seed: u64,
    /// Time after which a request is repeated, s.
    pub retry_s: f64,
}

impl Default for LineModel {
    /// 921,600 baud, faultless.
    fn default() -> Self {
        Self {
            baud: 921_600.0,
            latency_s: 0.0,
            jitter_s: 0.0,
            loss: 0.0,
            corruption: 0.0,
            duplication: 0.0,
            burst: 0.0,
            burst_length: 20,
            unplugged: Vec::new(),
            seed: 1,
            retry_s: 0.02,
        }
    }
}

/// SplitMix64: sufficient for a handful of draws per byte.
#[derive(Clone, Copy, Debug)]
struct Draws(u64);

impl Draws {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }
    fn share(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// One direction.
struct Direction {
    draws: Draws,
    free_at: f64,
    last_arrival: f64,
    noise_left: u32,
}

impl Direction {
    fn new(seed: u64) -> Self {
        Self {
            draws: Draws(seed),
            free_at: 0.0,
            last_arrival: 0.0,
            noise_left: 0,
        }
    }

    /// Arrivals of a byte sent at `now`: time and value, up to twice.
    fn pass(&mut self, model: &LineModel, now: f64, byte: u8, arrived: &mut Vec<(f64, u8)>) {
        let sent = self.free_at.max(now) + 10.0 / model.baud;
        self.free_at = sent;
        let delay = model.latency_s + model.jitter_s * self.draws.share();
        let at = (sent + delay).max(self.last_arrival);
        self.last_arrival = at;
        let [lost, changed, doubled, burst] = [(); 4].map(|()| self.draws.share());
        let noise = self.draws.next() as u8;
        if burst < model.burst {
            self.noise_left = model.burst_length;
        }
        if unplugged(model, at).is_some() || lost < model.loss {
            return;
        }
        let mut byte = byte;
        if self.noise_left > 0 {
            self.noise_left -= 1;
            byte = noise;
        } else if changed < model.corruption {
            byte ^= noise.max(1);
        }
        arrived.push((at, byte));
        if doubled < model.duplication {
            arrived.push((at, byte));
        }
    }
}

fn unplugged(model: &LineModel, at: f64) -> Option<&Unplugged> {
    model
        .unplugged
        .iter()
        .find(|plug| at >= plug.at_s && at < plug.at_s + plug.for_s)
}

/// See the module documentation.
pub struct VirtualLine {
    model: LineModel,
    now: f64,
    to_board: Direction,
    to_host: Direction,
    on_the_way: VecDeque<(f64, u8)>,
    board: Box<Application>,
    /// Time of the last byte received by the board.
    board_time: f64,
    sent: u64,
}

impl VirtualLine {
    /// A fresh board behind such a line.
    pub fn new(model: LineModel) -> Self {
        Self {
            to_board: Direction::new(model.seed ^ 0xB0A2D),
            to_host: Direction::new(model.seed ^ 0x0457),
            model,
            now: 0.0,
            on_the_way: VecDeque::new(),
            board: Box::default(),
            board_time: 0.0,
            sent: 0,
        }
    }

    /// Bytes that the host has sent.
    pub fn sent(&self) -> u64 {
        self.sent
    }

    fn board_receives(&mut self, at: f64, byte: u8) {
        let powered_off = |plug: &&Unplugged| plug.power && plug.at_s > self.board_time && plug.at_s <= at;
        if self.model.unplugged.iter().any(|plug| powered_off(&plug)) {
            *self.board = Application::default();
        }
        self.board_time = at;
        let Some(answer) = self.board.receive(byte, &mut VirtualBoard) else {
            return;
        };
        let mut arrived = Vec::new();
        for byte in answer {
            self.to_host.pass(&self.model, at, *byte, &mut arrived);
        }
        self.on_the_way.extend(arrived);
    }
}

impl Line for VirtualLine {
    fn send(&mut self, bytes: &[u8]) -> Result<(), String> {
        let mut arrived = Vec::new();
        for byte in bytes {
            self.to_board.pass(&self.model, self.now, *byte, &mut arrived);
        }
        self.sent += bytes.len() as u64;
        for (at, byte) in arrived {
            self.board_receives(at, byte);
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> Result<usize, String> {
        let limit = self.now + wait.as_secs_f64();
        let Some((first, _)) = self.on_the_way.front().filter(|(at, _)| *at <= limit) else {
            self.now = limit;
            return Ok(0);
        };
        self.now = self.now.max(*first);
        let mut count = 0;
        while let Some((at, byte)) = self.on_the_way.front().copied()
            && at <= self.now
            && let Some(place) = buffer.get_mut(count)
        {
            *place = byte;
            count += 1;
            self.on_the_way.pop_front();
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        Duration::from_secs_f64(self.now)
    }

    fn retry(&self) -> Duration {
        Duration::from_secs_f64(self.model.retry_s)
    }
}
