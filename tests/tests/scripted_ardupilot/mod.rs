//! ArduPilot as the plant sees it, written from docs/autopilots.md alone: servo packets by UDP, a reply to each, our own PID inside. Like
//! the real one it keeps running from run to run: a plant whose time goes back is a new one.

use super::scripted_pilot::{Motion, Pilot, Plan};
use rotortwin_scenario::Scenario;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Our rotor of each channel: hexarotor X.
pub(crate) const ROTOR_OF_CHANNEL: [usize; 6] = [2, 5, 6, 3, 1, 4];
/// Simulated time at which it arms, s.
const ARMS_S: f64 = 0.5;

/// A peer in a thread, which ends when this is dropped.
pub(crate) struct ScriptedArduPilot {
    stop: Arc<AtomicBool>,
    silent: Arc<AtomicBool>,
    frames: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl ScriptedArduPilot {
    /// Sends to the plant at `to`, and hovers at `height_m` over the origin.
    pub(crate) fn start(to: SocketAddr, scenario: &Scenario, height_m: f64) -> Self {
        Self::start_for(to, scenario, height_m, None)
    }

    /// The same, with a tour from `tour_s` of simulated time on.
    pub(crate) fn start_for(to: SocketAddr, scenario: &Scenario, height_m: f64, tour_s: Option<f64>) -> Self {
        Self::start_wired(to, scenario, height_m, tour_s, ROTOR_OF_CHANNEL)
    }

    /// The same, with the rotors from 1 that its channels drive.
    pub(crate) fn start_wired(
        to: SocketAddr,
        scenario: &Scenario,
        height_m: f64,
        tour_s: Option<f64>,
        wires: [usize; 6],
    ) -> Self {
        let (stop, silent, frames) = (
            Arc::<AtomicBool>::default(),
            Arc::<AtomicBool>::default(),
            Arc::default(),
        );
        let plan = Plan {
            arms_s: ARMS_S,
            height_m,
            tour_s,
        };
        let pilot = Pilot::new(scenario, plan);
        let shared = (Arc::clone(&stop), Arc::clone(&silent), Arc::clone(&frames));
        let thread = std::thread::spawn(move || run(to, pilot, wires, &shared.0, &shared.1, &shared.2));
        Self {
            stop,
            silent,
            frames,
            thread: Some(thread),
        }
    }

    /// Stops or resumes sending.
    pub(crate) fn silence(&self, silent: bool) {
        self.silent.store(silent, Ordering::Relaxed);
    }

    /// Frames that were answered.
    pub(crate) fn answered(&self) -> u64 {
        self.frames.load(Ordering::Relaxed)
    }
}

impl Drop for ScriptedArduPilot {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let ended = thread.join();
            if !std::thread::panicking() {
                ended.expect("the peer understood the plant");
            }
        }
    }
}

fn run(
    to: SocketAddr,
    mut pilot: Pilot,
    wires: [usize; 6],
    stop: &AtomicBool,
    silent: &AtomicBool,
    frames: &AtomicU64,
) {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a free port");
    socket
        .set_read_timeout(Some(Duration::from_millis(100)))
        .expect("a time-out");
    let mut buffer = [0; 2048];
    let mut last_s = 0.0;
    while !stop.load(Ordering::Relaxed) {
        if silent.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20));
            continue;
        }
        let frame = frames.load(Ordering::Relaxed);
        let packet = servo_packet(u32::try_from(frame).expect("a short flight"), &pilot.duty, wires);
        // Without a plant nothing listens there; it sends the same frame again.
        let Ok(length) = socket.send_to(&packet, to).and_then(|_| socket.recv(&mut buffer)) else {
            std::thread::sleep(Duration::from_millis(20));
            continue;
        };
        let line = std::str::from_utf8(&buffer[..length]).expect("a line of ASCII");
        last_s = take(&mut pilot, line, last_s);
        frames.fetch_add(1, Ordering::Relaxed);
    }
}

/// u16 magic, u16 frame rate, u32 frame, u16 pulse\[16\]; little endian.
fn servo_packet(frame: u32, duty: &[f64; 6], wires: [usize; 6]) -> Vec<u8> {
    let mut pulses = [1000_u16; 16];
    for (channel, rotor) in wires.into_iter().enumerate() {
        pulses[channel] = (1000.0 + 1000.0 * duty[rotor - 1]).round() as u16;
    }
    let mut packet = [18458_u16, 1000].map(u16::to_le_bytes).concat();
    packet.extend(frame.to_le_bytes());
    packet.extend(pulses.into_iter().flat_map(u16::to_le_bytes));
    packet
}

/// Numbers after a key, found by searching, without a space in between.
fn numbers(line: &str, key: &str) -> Vec<f64> {
    let start = line.find(&format!("\"{key}\":")).expect("the key") + key.len() + 3;
    let rest = line[start..].trim_start_matches('[');
    let end = rest.find([']', '}']).expect("an end");
    let parsed = rest[..end].split(',').map_while(|number| number.parse().ok());
    parsed.collect()
}

/// One step with the plant's state; returns its time.
fn take(pilot: &mut Pilot, line: &str, last_s: f64) -> f64 {
    let time_s = numbers(line, "timestamp")[0];
    if time_s < last_s {
        pilot.restart();
    }
    let three = |key: &str| {
        let values = numbers(line, key);
        [values[0], values[1], values[2]]
    };
    let motion = Motion {
        position: three("position"),
        velocity: three("velocity"),
        attitude: three("attitude"),
        body_rates: three("gyro"),
    };
    pilot.fly(time_s, &motion);
    time_s
}
