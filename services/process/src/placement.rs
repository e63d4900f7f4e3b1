//! Default placement of a flight's processes on processors.
//!
//! A flight in lockstep is a chain: at any time one of its processes has work, and finishes it by waking the next. On one processor that is a
//! context switch, between two it is an interrupt to a sleeping processor, which takes longer (rates: docs/decisions/0002). Such a flight
//! therefore runs on one processor, chosen from
//!
//! 1. those in the affinity mask, which cpusets and containers narrow,
//! 2. those used by the fewest other flights (abstract sockets, one per processor, that end with their owner),
//! 3. the one where the kernel has placed this process: at its start that was the idlest.
//!
//! During the flight, [`Placement::review`] compares the load of other processes on that processor with the idle time on the others, and
//! moves the flight if it gains markedly. Moving does not change the results of a run: time is data.

use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};
use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::{Duration, Instant};

/// Minimum interval of reviews, which cost some system calls.
const REVIEW_PAUSE: Duration = Duration::from_millis(250);

/// Minimum pause after a move; doubles with each move.
const PAUSE_AFTER_MOVE: Duration = Duration::from_secs(1);

/// Minimum gain of a move, fraction of a processor.
const WORTH_A_MOVE: f64 = 0.25;

/// Maximum number of flights per core; further ones run where the kernel has placed their supervisor.
const MOST_ON_A_CORE: usize = 64;

/// Placement of one flight's processes, with the reason.
#[derive(Debug)]
pub struct Placement(How);

#[derive(Debug)]
enum How {
    /// On one processor, by choice; held as long as the value lives.
    Chosen(Chosen),
    /// On one processor, set by the user.
    Given(usize),
    /// On any processor of the affinity mask; with the reason.
    Kernel(String),
}

#[derive(Debug)]
struct Chosen {
    cpu: usize,
    allowed: Vec<usize>,
    _claim: Option<UnixDatagram>,
    moved_from: Option<usize>,
    seen: Option<Seen>,
    pause: Duration,
}

impl Placement {
    /// The best processor available now.
    pub fn chosen() -> Self {
        let Ok(allowed) = allowed() else {
            return Self::kernel("the affinity mask cannot be read");
        };
        let (cpu, claim) = choose(&cores(&allowed, siblings), sched_getcpu(), claim);
        Self(How::Chosen(Chosen {
            cpu,
            allowed,
            _claim: claim,
            moved_from: None,
            seen: None,
            pause: REVIEW_PAUSE,
        }))
    }

    /// The processor named by the user; this process already runs there, and its children inherit it.
    pub fn given(cpu: usize) -> Self {
        Self(How::Given(cpu))
    }

    /// Wherever the kernel puts them; `why` follows "left to the kernel: ".
    pub fn kernel(why: impl Into<String>) -> Self {
        Self(How::Kernel(why.into()))
    }

    /// Starts processes in place: those started by `spawn` inherit this thread's mask, which is restored afterwards.
    pub fn start<T>(&self, spawn: impl FnOnce() -> T) -> T {
        let How::Chosen(chosen) = &self.0 else { return spawn() };
        let Ok(before) = sched_getaffinity(None) else {
            return spawn();
        };
        if let Err(error) = sched_setaffinity(None, &set(&[chosen.cpu])) {
            tracing::warn!(%error, cpu = chosen.cpu, "the flight is not pinned to one processor");
        }
        let started = spawn();
        if let Err(error) = sched_setaffinity(None, &before) {
            tracing::warn!(%error, "this thread stays pinned to one processor");
        }
        started
    }

    /// Moves the running processes `pids` of a flight if they gain markedly on another processor. Call it often.
    pub fn review(&mut self, pids: &[u32]) {
        let How::Chosen(chosen) = &mut self.0 else { return };
        if chosen
            .seen
            .as_ref()
            .is_some_and(|seen| seen.at.elapsed() < chosen.pause)
        {
            return;
        }
        let now = Seen::now(pids);
        let before = std::mem::replace(&mut chosen.seen, now);
        let (Some(before), Some(now)) = (before, &chosen.seen) else {
            return;
        };
        // A cpuset may have changed meanwhile.
        chosen.allowed = allowed().unwrap_or_else(|_| std::mem::take(&mut chosen.allowed));
        chosen.pause = REVIEW_PAUSE.max(chosen.pause / 2);
        let Some(better) = better(chosen.cpu, &chosen.allowed, &before, now) else {
            return;
        };
        let core = siblings(better).into_iter().min().unwrap_or(better);
        let claim = match claim(core, 0) {
            Claim::Held(socket) => Some(socket),
            Claim::Taken => return,
            Claim::Unknown => None,
        };
        set_all(pids, &set(&[better]));
        tracing::info!(from = chosen.cpu, to = better, "moved to a processor with more room");
        *chosen = Chosen {
            cpu: better,
            allowed: std::mem::take(&mut chosen.allowed),
            _claim: claim,
            moved_from: Some(chosen.cpu),
            seen: None,
            pause: (chosen.pause * 4).clamp(PAUSE_AFTER_MOVE, 16 * PAUSE_AFTER_MOVE),
        };
    }

    /// The chain has ended: the remaining work of `pids` may run anywhere.
    pub fn release(&self, pids: &[u32]) {
        if let How::Chosen(chosen) = &self.0 {
            set_all(pids, &set(&chosen.allowed));
        }
    }

    /// One-line description for the user.
    pub fn sentence(&self) -> String {
        match &self.0 {
            How::Given(cpu) => format!("all processes on CPU {cpu}, as --cpu says"),
            How::Kernel(why) => format!("left to the kernel: {why}"),
            How::Chosen(Chosen { cpu, allowed, .. }) if allowed.len() == 1 => {
                format!("all processes on CPU {cpu}, the only one allowed")
            }
            How::Chosen(Chosen { cpu, moved_from, .. }) => {
                let moved = moved_from.map_or_else(String::new, |from| format!(", moved from busy CPU {from}"));
                format!("all processes on CPU {cpu}, chosen{moved}; --cpu overrides")
            }
        }
    }
}

/// One physical core: its lowest processor number, and its allowed processors.
#[derive(Debug, PartialEq)]
struct Core {
    name: usize,
    cpus: Vec<usize>,
}

fn cores(allowed: &[usize], siblings: impl Fn(usize) -> Vec<usize>) -> Vec<Core> {
    let mut cores: Vec<Core> = Vec::new();
    for cpu in allowed.iter().copied() {
        let name = siblings(cpu).into_iter().min().unwrap_or(cpu);
        match cores.iter_mut().find(|core| core.name == name) {
            Some(core) => core.cpus.push(cpu),
            None => cores.push(Core { name, cpus: vec![cpu] }),
        }
    }
    cores
}

/// Result of requesting a slot on a core.
enum Claim<T> {
    Held(T),
    Taken,
    /// This machine does not support such sockets.
    Unknown,
}

/// The first free slot: first one flight on each core, the core of processor `here` before the others, then two on each.
fn choose<T>(cores: &[Core], here: usize, mut claim: impl FnMut(usize, usize) -> Claim<T>) -> (usize, Option<T>) {
    let mut order: Vec<&Core> = cores.iter().collect();
    order.sort_by_key(|core| !core.cpus.contains(&here));
    for place in 0..MOST_ON_A_CORE {
        for core in &order {
            let cpu = core.cpus[place % core.cpus.len()];
            match claim(core.name, place) {
                Claim::Held(held) => return (cpu, Some(held)),
                Claim::Taken => {}
                Claim::Unknown => return (cpu, None),
            }
        }
    }
    (here, None)
}

/// Holds a slot on a core as long as the socket lives, however its owner ends. Other hosts, and containers with their own network, do not
/// see it.
fn claim(core: usize, place: usize) -> Claim<UnixDatagram> {
    let name = format!("rotortwin-core-{core}-{place}");
    match SocketAddr::from_abstract_name(name).and_then(|address| UnixDatagram::bind_addr(&address)) {
        Ok(socket) => Claim::Held(socket),
        Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => Claim::Taken,
        Err(error) => {
            tracing::debug!(%error, "no cores can be reserved");
            Claim::Unknown
        }
    }
}

/// Processor times at one instant, in kernel ticks.
#[derive(Debug)]
struct Seen {
    at: Instant,
    /// By number: busy ticks, and all ticks.
    cpus: Vec<(usize, [u64; 2])>,
    /// Ticks of this flight's processes.
    own: u64,
}

impl Seen {
    fn now(pids: &[u32]) -> Option<Self> {
        let stat = std::fs::read_to_string("/proc/stat").ok()?;
        Some(Self {
            at: Instant::now(),
            cpus: processor_times(&stat),
            own: pids.iter().filter_map(|pid| process_time(*pid)).sum(),
        })
    }

    /// Fraction of `cpu` in use since `before`, and the ticks elapsed there.
    fn use_since(&self, before: &Self, cpu: usize) -> Option<[f64; 2]> {
        let find = |seen: &Self| {
            seen.cpus
                .iter()
                .find(|(number, _)| *number == cpu)
                .map(|(_, times)| *times)
        };
        let ([used_0, all_0], [used, all]) = (find(before)?, find(self)?);
        let passed = all.checked_sub(all_0).filter(|passed| *passed > 0)? as f64;
        Some([used.saturating_sub(used_0) as f64 / passed, passed])
    }
}

/// A processor that offers the flight markedly more than `here`; none if the kernel provides no data.
fn better(here: usize, allowed: &[usize], before: &Seen, now: &Seen) -> Option<usize> {
    let offered = match now.use_since(before, here) {
        Some([used, passed]) if allowed.contains(&here) => {
            let own = now.own.saturating_sub(before.own) as f64 / passed;
            1.0 - (used - own).clamp(0.0, 1.0)
        }
        Some(_) => 0.0,
        None => return None,
    };
    let others = allowed.iter().copied().filter(|cpu| *cpu != here);
    let (cpu, free) = others
        .filter_map(|cpu| Some((cpu, 1.0 - now.use_since(before, cpu)?[0])))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    (free - offered > WORTH_A_MOVE).then_some(cpu)
}

/// From `/proc/stat`: for each processor, the ticks in which a process (or another guest of the host) ran there, and all ticks. Interrupts
/// count as idle: those of a local TCP link are work of the flight itself.
fn processor_times(stat: &str) -> Vec<(usize, [u64; 2])> {
    let line = |line: &str| {
        // The line of the total, "cpu  …", has no number.
        let (number, fields) = line.strip_prefix("cpu")?.split_once(' ')?;
        let number = number.parse().ok()?;
        // user, nice, system, idle, iowait, irq, softirq, steal; guests are part of user.
        let times: Vec<u64> = fields
            .split_ascii_whitespace()
            .take(8)
            .map_while(|field| field.parse().ok())
            .collect();
        let [user, nice, system, _, _, _, _, steal] = times.as_slice() else {
            return None;
        };
        Some((number, [user + nice + system + steal, times.iter().sum()]))
    };
    stat.lines().filter_map(line).collect()
}

/// Ticks that a process has run, all its threads.
fn process_time(pid: u32) -> Option<u64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in brackets may contain anything; after it, utime and stime are fields 12 and 13.
    let fields = stat.rsplit_once(')')?.1.split_ascii_whitespace();
    fields.skip(11).take(2).map(|field| field.parse::<u64>().ok()).sum()
}

/// Processors that share a core with `cpu`, including itself.
fn siblings(cpu: usize) -> Vec<usize> {
    let file = format!("/sys/devices/system/cpu/cpu{cpu}/topology/thread_siblings_list");
    std::fs::read_to_string(file).map_or_else(|_| vec![cpu], |text| number_list(&text))
}

/// `0,8` or `0-1`.
fn number_list(text: &str) -> Vec<usize> {
    let ranges = text.trim().split(',').filter_map(|range| {
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        Some(first.parse().ok()?..=last.parse().ok()?)
    });
    ranges.flatten().collect()
}

/// Processors that this thread may run on.
fn allowed() -> rustix::io::Result<Vec<usize>> {
    let mask = sched_getaffinity(None)?;
    Ok((0..CpuSet::MAX_CPU).filter(|cpu| mask.is_set(*cpu)).collect())
}

fn set(cpus: &[usize]) -> CpuSet {
    let mut set = CpuSet::new();
    for cpu in cpus {
        set.set(*cpu);
    }
    set
}

/// All threads of the processes. Twice: a thread started meanwhile may have the old mask.
fn set_all(pids: &[u32], set: &CpuSet) {
    for pid in pids.iter().chain(pids) {
        let Ok(threads) = std::fs::read_dir(format!("/proc/{pid}/task")) else {
            continue;
        };
        for thread in threads.filter_map(Result::ok) {
            let number = thread.file_name().to_str().and_then(|name| name.parse().ok());
            if let Some(thread) = number.and_then(rustix::thread::Pid::from_raw) {
                // It may have ended.
                sched_setaffinity(Some(thread), set).ok();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// Flights that hold their slots as long as the set does.
    fn flights(cores: &[Core], here: usize, count: usize) -> Vec<usize> {
        let mut held = BTreeSet::new();
        let mut flight = || {
            let claim = |core, place| match held.insert((core, place)) {
                true => Claim::Held(()),
                false => Claim::Taken,
            };
            choose(cores, here, claim).0
        };
        (0..count).map(|_| flight()).collect()
    }

    #[test]
    fn val_flights_spread_over_cores_then_over_their_threads() {
        // Four cores of two threads; 3 and 7 are one core.
        let cores = cores(&[0, 1, 2, 3, 4, 5, 6, 7], |cpu| vec![cpu % 4, cpu % 4 + 4]);
        assert_eq!(cores.len(), 4);
        assert_eq!(flights(&cores, 7, 9), [3, 0, 1, 2, 7, 4, 5, 6, 3]);
    }

    #[test]
    fn val_what_is_not_allowed_is_not_chosen() {
        let cores = cores(&[2, 5], |cpu| vec![cpu]);
        assert_eq!(flights(&cores, 0, 3), [2, 5, 2]);
        assert_eq!(choose(&cores, 5, |_, _| Claim::<()>::Unknown), (5, None));
    }

    fn seen(ticks: &[[u64; 2]], own: u64) -> Seen {
        Seen {
            at: Instant::now(),
            cpus: ticks.iter().copied().enumerate().collect(),
            own,
        }
    }

    #[test]
    fn val_a_flight_moves_where_it_gets_more() {
        let before = seen(&[[0, 0]; 3], 0);
        let after = |used: [u64; 3], own| seen(&used.map(|used| [used, 100]), own);
        // All the load here is the flight itself.
        assert_eq!(better(0, &[0, 1, 2], &before, &after([100, 0, 0], 100)), None);
        // It gets half of its processor, and another is idle, but not allowed.
        let shared = after([100, 30, 0], 50);
        assert_eq!(better(0, &[0, 1, 2], &before, &shared), Some(2));
        assert_eq!(better(0, &[0], &before, &shared), None);
        assert_eq!(better(0, &[0, 1], &before, &shared), None, "0.2 are not worth it");
        // All are busy.
        assert_eq!(better(0, &[0, 1, 2], &before, &after([100, 100, 90], 50)), None);
        // Removed by a cpuset.
        assert_eq!(better(0, &[1, 2], &before, &after([100, 60, 50], 100)), Some(2));
        // The kernel provides no data.
        assert_eq!(better(0, &[0, 1], &before, &seen(&[], 0)), None);
    }

    #[test]
    fn val_the_kernels_tables() {
        let stat = "cpu  9 9 9 9 9 9 9 9 9 9\ncpu0 10 1 5 80 2 1 3 4 10 0\ncpu12 1 0 0 9 0 0 0 0 0 0\nintr 5 0\n";
        assert_eq!(processor_times(stat), [(0, [20, 106]), (12, [1, 10])]);
        assert_eq!(number_list("0,8\n"), [0, 8]);
        assert_eq!(number_list("2-4"), [2, 3, 4]);
        assert!(process_time(std::process::id()).is_some());
        assert!(Seen::now(&[]).is_some_and(|seen| !seen.cpus.is_empty()));
    }

    #[test]
    fn val_a_thread_is_free_again_after_the_start() {
        let before = allowed().unwrap();
        let placement = Placement::chosen();
        let during = placement.start(|| allowed().unwrap());
        assert_eq!(during.len(), 1);
        assert!(before.contains(&during[0]));
        assert_eq!(allowed().unwrap(), before);
        assert!(
            placement.sentence().contains(&format!("CPU {}", during[0])),
            "{}",
            placement.sentence()
        );
    }
}
