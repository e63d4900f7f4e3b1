//! Autopilots with their own instruments and clock, each with the protocol of its simulator build.
//!
//! * [`address`] parses `ardupilot:127.0.0.1:9002`.
//! * [`ardupilot`]: JSON backend over UDP, lockstep by frame number.
//! * [`servo_packet`]: encoding of that protocol.
//! * [`px4`]: MAVLink over TCP, lockstep by the time of our samples.
//! * [`pilot`]: arms them, flies the scenario, lands them.
//! * [`plant_check`]: the reverse: acts as ArduPilot towards an unknown plant.
//! * [`betaflight`]: UDP, paced on the wall clock, not lockstep; its pilot controls sticks.
//!
//! All wait with time-outs that name the peer and its last frame; none advances a step by itself.

pub mod address;
pub mod ardupilot;
pub mod betaflight;
pub mod pilot;
pub mod plant_check;
pub mod px4;
pub mod servo_packet;
mod sticks;

use rotortwin_flight_core::MAX_ROTORS;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Longest time before a stop request is noticed.
const STOP_NOTICE: Duration = Duration::from_millis(100);

/// Time-outs for an autopilot.
#[derive(Clone, Debug)]
pub struct Patience {
    /// For its first message.
    pub join: Duration,
    /// For any later one.
    pub step: Duration,
    /// Set externally: stop waiting.
    pub stop: Arc<AtomicBool>,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            join: Duration::from_secs(10),
            step: Duration::from_secs(5),
            stop: Arc::default(),
        }
    }
}

impl Patience {
    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// One wait, with its remaining time.
struct Wait {
    start: Instant,
    limit: Duration,
}

impl Wait {
    fn new(limit: Duration) -> Self {
        Self {
            start: Instant::now(),
            limit,
        }
    }

    fn silence(&self) -> Duration {
        self.start.elapsed()
    }

    /// How long to block now; `None`: the time is over.
    fn slice(&self) -> Option<Duration> {
        let left = self.limit.saturating_sub(self.start.elapsed());
        (!left.is_zero()).then(|| left.min(STOP_NOTICE))
    }
}

/// Which of our rotors each output channel of an autopilot drives, and its range.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputMap {
    /// Our rotor, from 0, for each channel from the first on.
    pub rotor_of_channel: Vec<usize>,
    /// Pulse at which a motor stops, µs.
    pub pulse_min_us: f64,
    /// Pulse at full duty, µs.
    pub pulse_max_us: f64,
}

impl OutputMap {
    /// Converts fractions by channel to duties by rotor.
    fn duties(&self, of_channel: impl Fn(usize) -> f64) -> [f64; MAX_ROTORS] {
        let mut duty = [0.0; MAX_ROTORS];
        for (channel, &rotor) in self.rotor_of_channel.iter().enumerate() {
            duty[rotor] = of_channel(channel).clamp(0.0, 1.0);
        }
        duty
    }

    /// Duty of a pulse; a pulse of 0 means no pulse, and stops the motor.
    fn duty(&self, pulse_us: f64) -> f64 {
        if pulse_us == 0.0 {
            return 0.0;
        }
        (pulse_us - self.pulse_min_us) / (self.pulse_max_us - self.pulse_min_us)
    }
}
