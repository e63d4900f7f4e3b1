//! Processes of a run, found and disturbed through the kernel.

use rustix::process::{Pid, Signal, kill_process};
use std::time::{Duration, Instant};

/// One process, distinguished from a later one with the same id by its start time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Process {
    /// Process id.
    pub pid: u32,
    start_ticks: u64,
}

/// Content of `/proc/PID/stat`.
struct Stat {
    state: char,
    parent: u32,
    threads: u32,
    start_ticks: u64,
}

impl Stat {
    /// A process whose main thread has ended holds its files and locks until the last thread has.
    fn has_ended(&self) -> bool {
        matches!(self.state, 'Z' | 'X') && self.threads <= 1
    }
}

fn stat(pid: u32) -> Option<Stat> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in brackets may contain anything, including brackets; fields are counted after it.
    let fields: Vec<&str> = text.rsplit_once(')')?.1.split_ascii_whitespace().collect();
    Some(Stat {
        state: fields.first()?.chars().next()?,
        parent: fields.get(1)?.parse().ok()?,
        threads: fields.get(17)?.parse().ok()?,
        start_ticks: fields.get(19)?.parse().ok()?,
    })
}

fn command_line(pid: u32) -> Vec<String> {
    let bytes = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    bytes
        .split(|&byte| byte == 0)
        .map(|part| String::from_utf8_lossy(part).into_owned())
        .collect()
}

impl Process {
    /// The process with this id, if alive.
    pub fn find(pid: u32) -> Option<Self> {
        let stat = stat(pid).filter(|stat| !stat.has_ended())?;
        Some(Self {
            pid,
            start_ticks: stat.start_ticks,
        })
    }

    /// A child that has not been reaped; it may have ended.
    pub fn of_child(child: &std::process::Child) -> Self {
        let stat = stat(child.id()).expect("the kernel keeps a child until somebody waits for it");
        Self {
            pid: child.id(),
            start_ticks: stat.start_ticks,
        }
    }

    /// All live children of a process, each with its command line.
    pub fn children(parent: u32) -> Vec<(Self, Vec<String>)> {
        all_pids()
            .into_iter()
            .filter(|&pid| stat(pid).is_some_and(|stat| stat.parent == parent))
            .filter_map(|pid| Some((Self::find(pid)?, command_line(pid))))
            .collect()
    }

    /// All live processes with `word` in their command line.
    pub fn with_word(word: &str) -> Vec<Self> {
        let holds = |pid: &u32| command_line(*pid).iter().any(|argument| argument.contains(word));
        all_pids().into_iter().filter(holds).filter_map(Self::find).collect()
    }

    /// False once it has ended, even if not reaped.
    pub fn is_alive(&self) -> bool {
        Self::find(self.pid) == Some(*self)
    }

    /// Sends a signal; no effect if the process has ended.
    pub fn signal(&self, signal: Signal) {
        if !self.is_alive() {
            return;
        }
        let pid = i32::try_from(self.pid)
            .ok()
            .and_then(Pid::from_raw)
            .expect("the kernel gave this id");
        if let Err(error) = kill_process(pid, signal) {
            assert_eq!(error, rustix::io::Errno::SRCH, "a process of this user can be signaled");
        }
    }
}

fn all_pids() -> Vec<u32> {
    let entries = std::fs::read_dir("/proc").expect("/proc is mounted");
    entries
        .flatten()
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .collect()
}

/// How much slower than alone a process was while it was being awaited: other programs compete for the same cores, and
/// a virtual machine may be refused a core by its host.
#[derive(Debug)]
pub struct Crowding {
    cores: f64,
    /// Sum over the samples of the runnable threads per core, at least one each.
    per_core: f64,
    samples: f64,
    /// Time of all cores since the start of the machine, in ticks: all, and what the host withheld.
    ticks: Option<(f64, f64)>,
}

impl Crowding {
    /// Begins to sample.
    pub fn begin() -> Self {
        Self {
            cores: std::thread::available_parallelism()
                .map_or(1.0, |cores| f64::from(u32::try_from(cores.get()).unwrap_or(1))),
            per_core: 0.0,
            samples: 0.0,
            ticks: ticks(),
        }
    }

    fn sample(&mut self) {
        // "0.20 0.18 0.12 3/80 11206": 3 of 80 threads can run, one of them this one.
        let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
        let runnable = text
            .split_ascii_whitespace()
            .nth(3)
            .and_then(|field| field.split_once('/')?.0.parse::<f64>().ok());
        self.per_core += runnable.map_or(1.0, |runnable| ((runnable - 1.0) / self.cores).max(1.0));
        self.samples += 1.0;
    }

    /// The time that `limit` on a machine of its own is here: times runnable threads per core, divided by the share of the time that
    /// the host granted.
    pub fn stretch(&self, limit: Duration) -> Duration {
        let per_core = if self.samples > 0.0 {
            self.per_core / self.samples
        } else {
            1.0
        };
        let granted = self
            .ticks
            .zip(ticks())
            .map_or(1.0, |((all, stolen), (all_now, stolen_now))| {
                let all = all_now - all;
                if all > 0.0 {
                    1.0 - ((stolen_now - stolen) / all).clamp(0.0, 0.9)
                } else {
                    1.0
                }
            });
        limit.mul_f64(per_core / granted)
    }
}

/// All ticks of the machine, and those withheld by its host.
fn ticks() -> Option<(f64, f64)> {
    let text = std::fs::read_to_string("/proc/stat").ok()?;
    let fields: Vec<f64> = text
        .lines()
        .next()?
        .split_ascii_whitespace()
        .skip(1)
        .take(8)
        .filter_map(|field| field.parse().ok())
        .collect();
    Some((fields.iter().sum(), *fields.get(7)?))
}

/// As [`wait_until`], and how crowded the machine was meanwhile.
pub fn wait_in_crowd(limit: Duration, mut is_true: impl FnMut() -> bool) -> (Option<Duration>, Crowding) {
    let mut crowding = Crowding::begin();
    let time = wait_until(limit, || {
        crowding.sample();
        is_true()
    });
    (time, crowding)
}

/// Polls a condition every millisecond; returns the time taken, or `None` after `limit`.
pub fn wait_until(limit: Duration, mut is_true: impl FnMut() -> bool) -> Option<Duration> {
    let begin = Instant::now();
    loop {
        if is_true() {
            return Some(begin.elapsed());
        }
        if begin.elapsed() >= limit {
            return None;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Processes that are ready to run for each core, in the mean of the last minute.
pub fn load_per_core() -> f64 {
    let text = std::fs::read_to_string("/proc/loadavg").expect("Linux tells its load");
    let load: f64 = text
        .split(' ')
        .next()
        .and_then(|word| word.parse().ok())
        .expect("a load");
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    load / f64::from(u32::try_from(cores).expect("few cores"))
}
