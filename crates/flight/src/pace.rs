//! Pace of a run: as fast as its peers answer, or 400 steps per second of wall clock.
//!
//! The pace does not affect the simulated world. In real time each step is due at `start + k · period`; the report states how late the plant
//! woke up (jitter), how often the command of a step arrived after the next step was due (a missed deadline), and which process was late
//! and why ([`crate::lateness`]).

use crate::lateness::{Late, Lateness};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// Pace of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pace {
    /// As fast as the peers answer.
    Fast,
    /// One step every 2.5 ms of wall clock.
    RealTime,
}

/// Jitter and missed deadlines of a real-time run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RealTimeReport {
    /// Period of the loop, µs.
    pub period_us: f64,
    /// Steps measured.
    pub steps: u64,
    /// Median lateness of the start of a step, µs.
    pub jitter_p50_us: f64,
    /// 99th percentile of the lateness, µs.
    pub jitter_p99_us: f64,
    /// Largest lateness, µs.
    pub jitter_max_us: f64,
    /// Median time from the start of a step to its command, µs.
    pub answer_p50_us: f64,
    /// 99th percentile of that time, µs.
    pub answer_p99_us: f64,
    /// Largest such time, µs.
    pub answer_max_us: f64,
    /// Steps whose command arrived after the next step was due.
    pub deadline_misses: u64,
    /// Largest overrun of a command, µs; 0 if there was none.
    pub overrun_max_us: f64,
    /// Missed deadlines and late reports, by process and cause.
    pub late: Vec<Late>,
}

/// Paces a run and measures its timing.
pub struct Pacer {
    pace: Pace,
    period: Duration,
    start: Instant,
    step_started: Instant,
    due: Instant,
    /// When the previous command arrived.
    answered: Instant,
    lateness_ns: Vec<u64>,
    answer_ns: Vec<u64>,
    deadline_misses: u64,
    overrun_max_ns: u64,
    lateness: Lateness,
}

impl Pacer {
    /// A pacer whose first step is due now.
    pub fn new(pace: Pace, period: Duration) -> Self {
        if pace == Pace::RealTime {
            wake_up_promptly();
        }
        let now = Instant::now();
        Self {
            pace,
            period,
            start: now,
            step_started: now,
            due: now,
            answered: now,
            lateness_ns: Vec::new(),
            answer_ns: Vec::new(),
            deadline_misses: 0,
            overrun_max_ns: 0,
            lateness: Lateness::default(),
        }
    }

    /// Tracks these processes of the flight and this thread, so that the report can name the late one.
    pub fn follow(&mut self, controller: Option<u32>, fdi: Option<u32>) {
        if self.pace == Pace::RealTime {
            self.lateness = Lateness::follow(controller, fdi);
        }
    }

    /// Waits until `step` is due.
    #[inline]
    pub fn begin_step(&mut self, step: u64) {
        if self.pace == Pace::RealTime {
            self.wait_until_due(step);
        }
    }

    fn wait_until_due(&mut self, step: u64) {
        let since_start = u64::try_from(self.period.as_nanos())
            .expect("a period is below 584 years")
            .saturating_mul(step);
        self.due = self.start + Duration::from_nanos(since_start);
        let wait = self.due.saturating_duration_since(Instant::now());
        if !wait.is_zero() {
            std::thread::sleep(wait);
        }
        self.step_started = Instant::now();
        self.lateness_ns
            .push(nanoseconds(self.step_started.saturating_duration_since(self.due)));
    }

    /// Records the arrival of the current step's command.
    #[inline]
    pub fn end_step(&mut self) {
        if self.pace == Pace::RealTime {
            let now = Instant::now();
            let answer = now.duration_since(self.step_started);
            self.answer_ns.push(nanoseconds(answer));
            let over = now
                .checked_duration_since(self.due + self.period)
                .filter(|over| !over.is_zero());
            if let Some(over) = over {
                self.deadline_misses += 1;
                self.overrun_max_ns = self.overrun_max_ns.max(nanoseconds(over));
            }
            let passed = now.duration_since(self.answered);
            self.answered = now;
            let begun_late = self.step_started.saturating_duration_since(self.due);
            self.lateness.step(begun_late, answer, passed, over);
        }
    }

    /// Records how many reports of earlier steps are missing once a step's command has arrived and all available reports were taken: the
    /// previous step's report has had a whole period.
    #[inline]
    pub fn reports_missing(&mut self, count: usize) {
        if self.pace == Pace::RealTime && count > 0 {
            self.lateness
                .report(self.period * u32::try_from(count).unwrap_or(u32::MAX));
        }
    }

    /// The report, if the pace was real time and at least one step was flown.
    pub fn report(mut self) -> Option<RealTimeReport> {
        if self.lateness_ns.is_empty() {
            return None;
        }
        self.lateness_ns.sort_unstable();
        self.answer_ns.sort_unstable();
        Some(RealTimeReport {
            period_us: self.period.as_secs_f64() * 1e6,
            steps: self.lateness_ns.len() as u64,
            jitter_p50_us: quantile_us(&self.lateness_ns, 0.5),
            jitter_p99_us: quantile_us(&self.lateness_ns, 0.99),
            jitter_max_us: quantile_us(&self.lateness_ns, 1.0),
            answer_p50_us: quantile_us(&self.answer_ns, 0.5),
            answer_p99_us: quantile_us(&self.answer_ns, 0.99),
            answer_max_us: quantile_us(&self.answer_ns, 1.0),
            deadline_misses: self.deadline_misses,
            overrun_max_us: self.overrun_max_ns as f64 / 1e3,
            late: self.lateness.report_all(),
        })
    }
}

/// Asks the kernel not to batch this thread's wake-ups with later ones: by default it may delay them by 50 µs to save power.
fn wake_up_promptly() {
    let one_nanosecond = std::num::NonZeroU64::MIN;
    if rustix::thread::set_current_timer_slack(Some(one_nanosecond)).is_err() {
        // A failure does not matter: the report shows the actual lateness.
    }
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// Nearest-rank quantile of sorted nanoseconds, in µs; 0 if empty.
fn quantile_us(sorted_ns: &[u64], q: f64) -> f64 {
    let Some(last) = sorted_ns.len().checked_sub(1) else {
        return 0.0;
    };
    let rank = (q * sorted_ns.len() as f64).ceil() as usize;
    sorted_ns[rank.saturating_sub(1).min(last)] as f64 / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_quantiles_are_nearest_rank() {
        let sorted: Vec<u64> = (1..=100).map(|i| i * 1000).collect();
        assert_eq!(
            (
                quantile_us(&sorted, 0.5),
                quantile_us(&sorted, 0.99),
                quantile_us(&sorted, 1.0)
            ),
            (50.0, 99.0, 100.0)
        );
        assert_eq!(quantile_us(&[], 0.5), 0.0);
    }

    #[test]
    fn scenario_real_time_is_neither_early_nor_skipped() {
        let period = Duration::from_millis(2);
        let mut pacer = Pacer::new(Pace::RealTime, period);
        let start = Instant::now();
        for step in 0..20 {
            pacer.begin_step(step);
            assert!(start.elapsed() + Duration::from_millis(1) >= period * u32::try_from(step).expect("small"));
            pacer.end_step();
        }
        let report = pacer.report().expect("steps were flown");
        assert_eq!(report.steps, 20);
        assert!(report.jitter_p50_us <= report.jitter_p99_us && report.jitter_p99_us <= report.jitter_max_us);
    }
}
