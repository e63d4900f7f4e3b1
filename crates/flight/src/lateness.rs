//! Which process made a real-time flight late, and why, from the kernel's accounting at every step.
//!
//! Linux keeps two counters for each thread (`/proc/PID/schedstat`): its computing time, and its time waiting for a processor while
//! runnable. Their increments between the commands of two steps show where the time went. A missed deadline is attributed to the largest
//! of them: a summary, not a trace; use `perf sched` for those.

use serde::{Deserialize, Serialize};
use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::time::Duration;

/// A process of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Who {
    /// The plant, and everything in its process.
    Plant,
    /// The controller.
    Controller,
    /// The FDI engine: its reports, which no deadline depends on.
    Fdi,
}

/// Cause of the delay.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Why {
    /// Runnable, but waiting for a processor used by others.
    Scheduler,
    /// Computing.
    Computing,
    /// Neither, or its kernel cannot be queried: a paused virtual machine, a disk, a network.
    Unknown,
}

/// Late steps with the same cause.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Late {
    /// Process.
    pub who: Who,
    /// Cause.
    pub why: Why,
    /// Number of steps.
    pub steps: u64,
    /// Largest overrun of the deadline, ms.
    pub worst_ms: f64,
}

/// Time that a thread has spent computing and waiting for a processor since it started, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Spent {
    computing: u64,
    waiting: u64,
}

impl Spent {
    fn since(self, before: Self) -> Self {
        Self {
            computing: self.computing.saturating_sub(before.computing),
            waiting: self.waiting.saturating_sub(before.waiting),
        }
    }

    /// From the content of `schedstat`: ns on a processor, ns in the queue, turns.
    fn parse(text: &str) -> Option<Self> {
        let mut fields = text.split_ascii_whitespace().map(str::parse);
        Some(Self {
            computing: fields.next()?.ok()?,
            waiting: fields.next()?.ok()?,
        })
    }
}

/// A thread's kernel counters.
#[derive(Debug)]
struct Clocks {
    schedstat: File,
    before: Spent,
    gained: Spent,
}

impl Clocks {
    /// `None`: this kernel does not provide them.
    fn open(path: &str) -> Option<Self> {
        let schedstat = File::open(path).ok()?;
        let before = read(&schedstat)?;
        Some(Self {
            schedstat,
            before,
            gained: Spent::default(),
        })
    }

    fn look(&mut self) {
        // A process that has ended has no increments; the link reports its end.
        let now = read(&self.schedstat).unwrap_or(self.before);
        self.gained = now.since(self.before);
        self.before = now;
    }
}

fn read(schedstat: &File) -> Option<Spent> {
    let mut bytes = [0; 96];
    let length = schedstat.read_at(&mut bytes, 0).ok()?;
    Spent::parse(std::str::from_utf8(bytes.get(..length)?).ok()?)
}

/// Tracks the processes of a flight and records delays.
#[derive(Debug, Default)]
pub struct Lateness {
    plant: Option<Clocks>,
    controller: Option<Clocks>,
    fdi: Option<Clocks>,
    late: Vec<Late>,
    /// Cause of the last missed deadline.
    blamed: Option<(Who, Why)>,
}

impl Lateness {
    /// Tracks the calling thread as the plant, and these processes if their kernel counters are readable.
    pub fn follow(controller: Option<u32>, fdi: Option<u32>) -> Self {
        let of = |pid: Option<u32>| pid.and_then(|pid| Clocks::open(&format!("/proc/{pid}/schedstat")));
        Self {
            plant: Clocks::open("/proc/thread-self/schedstat"),
            controller: of(controller),
            fdi: of(fdi),
            late: Vec::new(),
            blamed: None,
        }
    }

    /// Call once per step when its command has arrived. `begun_late`: lateness of the step's start; `answer`: time from there to the command;
    /// `passed`: time since the previous command; `over`: overrun of the command.
    ///
    /// A step that was already late before the previous command arrived only inherits the delay: the cause of the first late step also
    /// accounts for those that catch up.
    pub fn step(&mut self, begun_late: Duration, answer: Duration, passed: Duration, over: Option<Duration>) {
        for clocks in [&mut self.plant, &mut self.controller, &mut self.fdi] {
            clocks.as_mut().into_iter().for_each(Clocks::look);
        }
        let Some(over) = over else {
            self.blamed = None;
            return;
        };
        let late = begun_late.saturating_add(answer);
        let inherited = late.saturating_sub(passed);
        let blamed = match self.blamed {
            Some(blamed) if inherited > passed => blamed,
            _ => self.blame(begun_late, answer, passed),
        };
        self.blamed = Some(blamed);
        self.note(blamed.0, blamed.1, over);
    }

    /// The engine's reports are late by `over`.
    pub fn report(&mut self, over: Duration) {
        let why = match &self.fdi {
            Some(clocks) => largest(&[
                (Why::Scheduler, clocks.gained.waiting),
                (Why::Computing, clocks.gained.computing),
            ]),
            None => Why::Unknown,
        };
        self.note(Who::Fdi, why, over);
    }

    fn blame(&self, begun_late: Duration, answer: Duration, passed: Duration) -> (Who, Why) {
        let known = [(Who::Plant, &self.plant), (Who::Controller, &self.controller)];
        let mut shares: Vec<((Who, Why), u64)> = Vec::with_capacity(5);
        for (who, clocks) in known {
            if let Some(clocks) = clocks {
                shares.push(((who, Why::Scheduler), clocks.gained.waiting));
                shares.push(((who, Why::Computing), clocks.gained.computing));
            }
        }
        let told: u64 = shares.iter().map(|(_, time)| time).sum();
        let passed = nanoseconds(passed.min(begun_late.saturating_add(answer)));
        let waited_for = if begun_late > answer {
            Who::Plant
        } else {
            Who::Controller
        };
        shares.push(((waited_for, Why::Unknown), passed.saturating_sub(told)));
        largest(&shares)
    }

    fn note(&mut self, who: Who, why: Why, over: Duration) {
        let worst_ms = over.as_secs_f64() * 1e3;
        match self.late.iter_mut().find(|late| (late.who, late.why) == (who, why)) {
            Some(late) => {
                late.steps += 1;
                late.worst_ms = late.worst_ms.max(worst_ms);
            }
            None => self.late.push(Late {
                who,
                why,
                steps: 1,
                worst_ms,
            }),
        }
    }

    /// All delays, the most frequent first.
    pub fn report_all(mut self) -> Vec<Late> {
        self.late.sort_by(|a, b| b.steps.cmp(&a.steps).then(a.who.cmp(&b.who)));
        self.late
    }
}

/// The largest; ties go to the first.
fn largest<T: Copy>(shares: &[(T, u64)]) -> T {
    let mut best = shares[0];
    for share in shares {
        if share.1 > best.1 {
            best = *share;
        }
    }
    best.0
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: fn(u64) -> Duration = Duration::from_millis;

    fn clocks(computing_ms: u64, waiting_ms: u64) -> Option<Clocks> {
        Some(Clocks {
            schedstat: File::open("/proc/self/schedstat").expect("Linux tells"),
            before: Spent::default(),
            gained: Spent {
                computing: computing_ms * 1_000_000,
                waiting: waiting_ms * 1_000_000,
            },
        })
    }

    fn blamed(plant: Option<Clocks>, controller: Option<Clocks>, begun_late: u64, answer: u64) -> (Who, Why) {
        let lateness = Lateness {
            plant,
            controller,
            ..Lateness::default()
        };
        lateness.blame(MS(begun_late), MS(answer), MS(begun_late + answer))
    }

    #[test]
    fn val_the_largest_share_is_to_blame() {
        assert_eq!(blamed(clocks(1, 9), clocks(0, 0), 9, 1), (Who::Plant, Why::Scheduler));
        assert_eq!(blamed(clocks(8, 1), clocks(0, 0), 9, 1), (Who::Plant, Why::Computing));
        assert_eq!(
            blamed(clocks(0, 0), clocks(1, 9), 0, 10),
            (Who::Controller, Why::Scheduler)
        );
        assert_eq!(
            blamed(clocks(0, 0), clocks(9, 1), 0, 10),
            (Who::Controller, Why::Computing)
        );
        // No process used or waited for a processor.
        assert_eq!(blamed(clocks(0, 0), clocks(0, 0), 20, 1), (Who::Plant, Why::Unknown));
        assert_eq!(
            blamed(clocks(0, 0), clocks(0, 0), 1, 20),
            (Who::Controller, Why::Unknown)
        );
        // A controller on another host cannot be queried.
        assert_eq!(blamed(clocks(1, 0), None, 0, 30), (Who::Controller, Why::Unknown));
    }

    #[test]
    fn val_schedstat_is_read_as_the_kernel_writes_it() {
        let spent = Spent::parse("3141592 2718281 42\n").expect("three numbers");
        assert_eq!((spent.computing, spent.waiting), (3_141_592, 2_718_281));
        assert_eq!(Spent::parse(""), None);
        assert_eq!(Spent::parse("1"), None);
        assert_eq!(Spent::parse("a b c"), None);
    }

    /// The kernel's counters for a computation of known length: at least half of it is counted, as the counter advances with the scheduler
    /// tick.
    #[test]
    fn val_computing_is_told_as_such() {
        let mut lateness = Lateness::follow(None, None);
        lateness.step(Duration::ZERO, Duration::ZERO, Duration::ZERO, None);
        let begun = std::time::Instant::now();
        let mut sum = 0_u64;
        let computed = || {
            let clock = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
            Duration::new(
                u64::try_from(clock.tv_sec).unwrap_or(0),
                u32::try_from(clock.tv_nsec).unwrap_or(0),
            )
        };
        let before = computed();
        while computed() - before < MS(60) {
            assert!(
                begun.elapsed() < Duration::from_secs(30),
                "60 ms of processor time did not come"
            );
            sum = std::hint::black_box(sum.wrapping_add(1));
        }
        lateness.step(begun.elapsed(), Duration::ZERO, begun.elapsed(), None);
        let gained = lateness.plant.as_ref().expect("Linux tells").gained;
        assert!((30_000_000..200_000_000).contains(&gained.computing), "{gained:?}");
    }

    /// One step is late by 40 ms; the following ones catch up with the schedule, 1 ms apart.
    #[test]
    fn regress_steps_that_catch_up_have_the_cause_of_the_first() {
        let mut lateness = Lateness::default();
        lateness.step(MS(1), MS(40), MS(42), Some(MS(38)));
        lateness.step(MS(38), MS(1), MS(1), Some(MS(36)));
        lateness.step(MS(36), MS(1), MS(1), Some(MS(34)));
        let told = lateness.report_all();
        assert_eq!(told.len(), 1, "{told:?}");
        assert_eq!((told[0].who, told[0].steps), (Who::Controller, 3));
    }

    #[test]
    fn val_the_most_frequent_comes_first() {
        let mut lateness = Lateness::default();
        lateness.note(Who::Controller, Why::Scheduler, MS(3));
        lateness.note(Who::Plant, Why::Computing, MS(1));
        lateness.note(Who::Plant, Why::Computing, MS(7));
        let told = lateness.report_all();
        assert_eq!(
            (told[0].who, told[0].why, told[0].steps, told[0].worst_ms),
            (Who::Plant, Why::Computing, 2, 7.0)
        );
        assert_eq!((told[1].who, told[1].steps), (Who::Controller, 1));
    }
}
