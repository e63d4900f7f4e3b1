//! Betaflight as the plant sees it: states and sticks by UDP, motors back, on the wall clock. It keeps running from run to run.

use super::leveller::{Leveller, channels, motors};
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// First port that is tried: below those of the system's own choice.
const PORTS: std::ops::Range<u16> = 21_000..31_000;

/// A peer in a thread, which ends when this is dropped.
pub(crate) struct ScriptedBetaflight {
    stop: Arc<AtomicBool>,
    silent: Arc<AtomicBool>,
    states: Arc<AtomicU64>,
    port: u16,
    thread: Option<JoinHandle<()>>,
}

impl ScriptedBetaflight {
    /// At free ports: motors are sent to the first, states come to the third, sticks to the fourth.
    pub(crate) fn start() -> Self {
        let at = |port: u16| UdpSocket::bind(("127.0.0.1", port));
        let own = u16::try_from(std::process::id() % 1000).expect("below 1000");
        let (port, states_in, sticks_in) = (PORTS.start + 10 * own..PORTS.end)
            .step_by(4)
            .chain(PORTS.step_by(4))
            .find_map(|base| match (at(base), at(base + 2), at(base + 3)) {
                (Ok(_), Ok(states), Ok(sticks)) => Some((base + 2, states, sticks)),
                _ => None,
            })
            .expect("four free ports");
        let (stop, silent, states) = (
            Arc::<AtomicBool>::default(),
            Arc::<AtomicBool>::default(),
            Arc::<AtomicU64>::default(),
        );
        let shared = (Arc::clone(&stop), Arc::clone(&silent), Arc::clone(&states));
        let thread = std::thread::spawn(move || run(&states_in, &sticks_in, &shared.0, &shared.1, &shared.2));
        Self {
            stop,
            silent,
            states,
            port,
            thread: Some(thread),
        }
    }

    /// Where it takes states.
    pub(crate) fn port(&self) -> u16 {
        self.port
    }

    /// Stops or resumes sending motors.
    pub(crate) fn silence(&self, silent: bool) {
        self.silent.store(silent, Ordering::Relaxed);
    }

    /// States that came.
    pub(crate) fn states(&self) -> u64 {
        self.states.load(Ordering::Relaxed)
    }
}

impl Drop for ScriptedBetaflight {
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

fn run(states_in: &UdpSocket, sticks_in: &UdpSocket, stop: &AtomicBool, silent: &AtomicBool, states: &AtomicU64) {
    let mut leveller = Leveller::default();
    states_in
        .set_read_timeout(Some(Duration::from_millis(5)))
        .expect("a time-out");
    sticks_in.set_nonblocking(true).expect("a socket");
    let mut buffer = [0; 256];
    while !stop.load(Ordering::Relaxed) {
        while let Ok(length) = sticks_in.recv(&mut buffer) {
            leveller.take(channels(&buffer[..length]));
        }
        let Ok((length, from)) = states_in.recv_from(&mut buffer) else {
            continue;
        };
        assert_eq!(length, 144);
        states.fetch_add(1, Ordering::Relaxed);
        if !silent.load(Ordering::Relaxed) {
            // Without a plant nobody listens there.
            let _sent = states_in.send_to(&motors(leveller.pulses(&buffer)), from);
        }
    }
}
