//! Common arguments of the commands that test a third-party controller: seed and time-outs.

use clap::Args;
use std::time::Duration;

/// Longest time-out, ms.
const LONGEST_MS: u64 = 3_600_000;

/// Seed and time-outs.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct Trial {
    /// Seed of the noise of sensors and instruments
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Longest wait for the controller to join, ms
    #[arg(long, value_name = "MS", default_value_t = 600_000, value_parser = clap::value_parser!(u64).range(1..=LONGEST_MS))]
    pub(crate) join_timeout: u64,
    /// Longest wait for a reply, ms
    #[arg(long, value_name = "MS", default_value_t = 5_000, value_parser = clap::value_parser!(u64).range(1..=LONGEST_MS))]
    pub(crate) step_timeout: u64,
}

impl Trial {
    /// Longest wait for the controller to join.
    pub(crate) fn join(&self) -> Duration {
        Duration::from_millis(self.join_timeout)
    }

    /// Longest wait for an answer.
    pub(crate) fn step(&self) -> Duration {
        Duration::from_millis(self.step_timeout)
    }
}
