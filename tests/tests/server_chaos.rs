//! Everything at once: hosts that vanish within a transaction, freeze or are cut off, clocks that step, a full disk, a Postgres that dies,
//! slow clients, killed servers and processes. `tools/chaos.sh MINUTES [SEED]` runs it for longer.

use rotortwin_tests::accepted::{Accepted, nothing_lost_and_nothing_doubled, submit_for_sure};
use rotortwin_tests::cable::Cable;
use rotortwin_tests::clock::Clock;
use rotortwin_tests::disk::Disk;
use rotortwin_tests::postgres::{Held, Postgres};
use rotortwin_tests::process::{Process, load_per_core, wait_until};
use rotortwin_tests::random::Random;
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::server::{Server, Worker};
use rustix::process::Signal;
use serde_json::json;
use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Workers of two jobs each: the last one reaches Postgres over a cable that is cut.
const WORKERS: usize = 3;
/// Longest time between two disturbances.
const PAUSE: Duration = Duration::from_millis(2500);
/// Interval of the checks.
const LOOK: Duration = Duration::from_millis(200);
/// Interval of submissions.
const SUBMITTED_EACH: Duration = Duration::from_secs(1);
/// Concurrent clients that send half a request.
const SLOW_CLIENTS: usize = 12;
/// From this length on every kind of disturbance has come.
const LONG: Duration = Duration::from_secs(300);
/// Duration of a host's freeze.
const FROZEN: Duration = Duration::from_secs(60);
/// Duration of a network outage.
const CUT: Duration = Duration::from_secs(30);
/// Idle time after which Postgres rolls back a transaction of ours.
const HELD: Duration = Duration::from_secs(5);
/// Duration of a full disk.
const FULL: Duration = Duration::from_secs(4);
/// Step of a clock, s.
const STEP: i64 = 3600;
/// Longest time from the loss of a host until its jobs are queued or restarted, whatever else happens meanwhile (15 s of silence until its
/// claims expire, 5 s until the row that it had locked is free, and room for a busy machine).
const RECOVERY: Duration = Duration::from_secs(30);
/// Size of the disk with all files.
const ROOM: &str = "6g";

const KINDS: [Kind; 8] = [
    Kind::VanishInTransaction,
    Kind::Cut,
    Kind::Freeze,
    Kind::StepClock,
    Kind::FillDisk,
    Kind::KillPostgres,
    Kind::KillServer,
    Kind::KillProcess,
];

/// A disturbance and its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    VanishInTransaction,
    Cut,
    Freeze,
    StepClock,
    FillDisk,
    KillPostgres,
    KillServer,
    KillProcess,
}

/// A disturbance that ends after a while.
enum Open {
    Transaction(Held),
    Cut,
    Frozen(usize),
    FullDisk,
}

/// A job whose host is lost.
#[derive(Debug)]
struct Loss {
    id: String,
    attempts: i64,
    kind: Kind,
    at: Instant,
}

struct Bench<'a> {
    scratch: &'a Scratch,
    artifacts: PathBuf,
    environment: Vec<(&'static str, String)>,
    postgres: Postgres,
    cable: Cable,
    clock: Option<Clock>,
    disk: Option<Disk>,
    server: Server,
    address: String,
    workers: Vec<Worker>,
    ahead: i64,
    open: Vec<(Instant, Open)>,
    losses: Vec<Loss>,
    done: BTreeMap<Kind, usize>,
    recoveries: Vec<(Duration, Kind)>,
    random: Random,
}

/// Duration of the test; `ROTORTWIN_CHAOS_S=600` for the long one.
fn length() -> Duration {
    let text = std::env::var("ROTORTWIN_CHAOS_S").ok();
    Duration::from_secs(text.map_or(12, |text| text.parse().expect("seconds")))
}

fn seed() -> u64 {
    let text = std::env::var("ROTORTWIN_CHAOS_SEED").ok();
    text.map_or(20, |text| text.parse().expect("a number"))
}

fn borrowed<'a>(environment: &'a [(&'static str, String)]) -> Vec<(&'a str, &'a str)> {
    environment
        .iter()
        .map(|(name, value)| (*name, value.as_str()))
        .collect()
}

fn server_at(
    address: &str,
    scratch: &Scratch,
    url: &str,
    artifacts: &Path,
    environment: &[(&'static str, String)],
) -> Server {
    let artifacts = artifacts.display().to_string();
    let words = ["--database-url", url, "--artifacts", &artifacts, "--workers", "0"];
    Server::start_in(&borrowed(environment), address, &scratch.path("server"), &words)
}

impl<'a> Bench<'a> {
    fn new(scratch: &'a Scratch) -> Option<Self> {
        let clock = Clock::new(&scratch.path(""));
        let environment: Vec<_> = clock.iter().flat_map(Clock::environment).collect();
        let postgres = Postgres::start_in(&environment, &scratch.path(""))?;
        let disk = Disk::new(scratch.path("disk"), ROOM);
        let artifacts = disk
            .as_ref()
            .map_or_else(|| scratch.path("artifacts"), |disk| disk.path().join("artifacts"));
        let server = server_at("127.0.0.1:0", scratch, &postgres.url(), &artifacts, &environment);
        let mut bench = Self {
            scratch,
            artifacts,
            environment,
            cable: Cable::to(postgres.port()),
            postgres,
            clock,
            disk,
            address: server.address().to_owned(),
            server,
            workers: Vec::new(),
            ahead: 0,
            open: Vec::new(),
            losses: Vec::new(),
            done: BTreeMap::new(),
            recoveries: Vec::new(),
            random: Random::new(seed()),
        };
        bench.workers = (0..WORKERS).map(|number| bench.worker(number)).collect();
        Some(bench)
    }

    fn worker(&self, number: usize) -> Worker {
        let mut url = self.postgres.url();
        if number == WORKERS - 1 {
            url = url.replace(
                &format!(":{}/", self.postgres.port()),
                &format!(":{}/", self.cable.port()),
            );
        }
        let artifacts = self.artifacts.display().to_string();
        let words = ["--database-url", &url, "--artifacts", &artifacts, "--workers", "2"];
        let folder = self.scratch.path(&format!("worker-{number}"));
        Worker::start_in(&borrowed(&self.environment), &folder, &words)
    }

    fn is_frozen(&self, number: usize) -> bool {
        self.open
            .iter()
            .any(|(_, open)| matches!(open, Open::Frozen(frozen) if *frozen == number))
    }

    fn is_open(&self, kind: Kind) -> bool {
        self.open.iter().any(|(_, open)| {
            matches!(
                (open, kind),
                (Open::Transaction(_), Kind::VanishInTransaction)
                    | (Open::Cut, Kind::Cut)
                    | (Open::Frozen(_), Kind::Freeze)
                    | (Open::FullDisk, Kind::FillDisk)
            )
        })
    }

    /// Jobs of a lost worker.
    fn note_losses(&mut self, number: usize, kind: Kind) -> Vec<String> {
        let pid = self.workers[number].process().pid;
        let asked = format!("SELECT id, attempts FROM job WHERE status = 'running' AND worker LIKE '%-{pid}'");
        let found = self.postgres.try_ask(&asked).unwrap_or_default();
        let at = Instant::now();
        let mut ids = Vec::new();
        for line in found.lines() {
            let (id, attempts) = line.split_once('|').expect("two columns");
            ids.push(id.to_owned());
            self.losses.push(Loss {
                id: id.to_owned(),
                attempts: attempts.parse().expect("a number"),
                kind,
                at,
            });
        }
        ids
    }

    /// Starts a disturbance if one is possible now.
    fn disturb(&mut self, kind: Kind) {
        if self.is_open(kind) {
            return;
        }
        let now = Instant::now();
        match kind {
            Kind::VanishInTransaction => {
                // Never the last working one: something has to continue.
                let number = usize::from(self.is_frozen(0));
                self.workers[number].process().signal(Signal::STOP);
                let ids = self.note_losses(number, kind);
                self.workers[number].kill();
                if let Some(id) = ids.first() {
                    let statement = format!("UPDATE job SET claim = claim WHERE id = '{id}'");
                    self.open
                        .push((now + HELD, Open::Transaction(self.postgres.hold(&statement))));
                }
                self.workers[number] = self.worker(number);
            }
            Kind::Cut => {
                self.cable.cut();
                self.note_losses(WORKERS - 1, kind);
                self.open.push((now + CUT, Open::Cut));
            }
            Kind::Freeze => {
                let number = usize::try_from(self.random.below(2)).expect("small");
                self.workers[number].process().signal(Signal::STOP);
                self.note_losses(number, kind);
                self.open.push((now + FROZEN, Open::Frozen(number)));
            }
            Kind::StepClock => {
                let Some(clock) = &self.clock else { return };
                self.ahead = if self.ahead == 0 && self.random.below(2) == 0 {
                    STEP
                } else {
                    self.ahead - STEP
                };
                clock.set_ahead(self.ahead);
            }
            Kind::FillDisk => {
                let Some(disk) = &self.disk else { return };
                if wait_until(Duration::from_secs(2), || disk.fill()).is_none() {
                    return;
                }
                self.open.push((now + FULL, Open::FullDisk));
            }
            Kind::KillPostgres => {
                self.postgres.kill();
                self.postgres.up();
            }
            Kind::KillServer => {
                self.server.kill();
                self.server = server_at(
                    &self.address,
                    self.scratch,
                    &self.postgres.url(),
                    &self.artifacts,
                    &self.environment,
                );
            }
            Kind::KillProcess => {
                let processes = Process::with_word(&format!("{}/jobs", self.artifacts.display()));
                if processes.is_empty() {
                    return;
                }
                let victim = self.random.below(processes.len() as u64);
                processes[usize::try_from(victim).expect("few")].signal(Signal::KILL);
            }
        }
        *self.done.entry(kind).or_default() += 1;
    }

    /// Ends disturbances that have lasted long enough, or all of them if `all`.
    fn mend(&mut self, all: bool) {
        let now = Instant::now();
        let (over, open): (Vec<_>, Vec<_>) = std::mem::take(&mut self.open)
            .into_iter()
            .partition(|(until, _)| all || *until <= now);
        self.open = open;
        for (_, what) in over {
            match what {
                Open::Transaction(held) => drop(held),
                Open::Cut => self.cable.mend(),
                Open::Frozen(number) => self.workers[number].process().signal(Signal::CONT),
                Open::FullDisk => {
                    let has_room = self.disk.as_ref().is_some_and(|disk| disk.resize(ROOM));
                    assert!(has_room, "the disk gets its room back");
                }
            }
        }
    }

    /// Checks which lost jobs have been taken over.
    fn look_after_losses(&mut self) {
        if self.losses.is_empty() {
            return;
        }
        let Ok(running) = self
            .postgres
            .try_ask("SELECT id, attempts FROM job WHERE status = 'running'")
        else {
            return;
        };
        let still: BTreeMap<&str, i64> = running
            .lines()
            .filter_map(|line| line.split_once('|'))
            .map(|(id, attempts)| (id, attempts.parse().expect("a number")))
            .collect();
        let recoveries = &mut self.recoveries;
        self.losses.retain(|loss| {
            let is_lost = still.get(loss.id.as_str()) == Some(&loss.attempts);
            if !is_lost {
                recoveries.push((loss.at.elapsed(), loss.kind));
            }
            is_lost
        });
    }
}

/// Sends half a request and waits until the connection closes.
fn be_slow(address: &str, number: usize, is_over: &AtomicBool, times: &AtomicU64) {
    let words = match number % 3 {
        0 => b"GET / HTTP/1.1\r\nhost: loc".to_vec(),
        1 => b"POST /api/v1/logs?name=a.csv HTTP/1.1\r\nhost: localhost\r\ncontent-type: text/csv\r\ncontent-length: 1000\r\n\r\ntime_s".to_vec(),
        // Responses that are never read.
        _ => b"GET /api/v1/docs/swagger-ui-bundle.js HTTP/1.1\r\nhost: localhost\r\n\r\n".repeat(30),
    };
    while !is_over.load(Ordering::Relaxed) {
        let Ok(mut stream) = TcpStream::connect(address) else {
            std::thread::sleep(Duration::from_millis(200));
            continue;
        };
        stream
            .set_read_timeout(Some(Duration::from_secs(1)))
            .expect("a time-out");
        if stream.write_all(&words).is_ok() {
            times.fetch_add(1, Ordering::Relaxed);
        }
        let mut byte = [0];
        while number % 3 != 2 && !is_over.load(Ordering::Relaxed) {
            match stream.read(&mut byte) {
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {}
                Ok(1) => {}
                _ => break,
            }
        }
        if number % 3 == 2 {
            std::thread::sleep(Duration::from_secs(2));
        }
    }
}

/// Submits runs until the end: fast ones, and some that take a while.
fn submit(address: &str, is_over: &AtomicBool) -> Accepted {
    let mut accepted = Accepted::new();
    for number in 0_u64.. {
        if is_over.load(Ordering::Relaxed) {
            break;
        }
        let (key, seed) = (format!("key-{number}"), number % 5);
        let mut run = json!({ "scenario": "short-hover", "seed": seed });
        if number % 2 == 0 {
            run["pace"] = json!("real-time");
            run["link"] = json!("in-process");
        }
        let id = submit_for_sure(address, &key, &run);
        accepted.insert(key, (id, seed));
        std::thread::sleep(SUBMITTED_EACH);
    }
    accepted
}

#[test]
fn scenario_everything_at_once() {
    let scratch = Scratch::new();
    let Some(mut bench) = Bench::new(&scratch) else { return };
    let (is_over, slow) = (AtomicBool::new(false), AtomicU64::new(0));
    let address = bench.address.clone();
    let begun = Instant::now();
    let accepted = std::thread::scope(|scope| {
        for number in 0..SLOW_CLIENTS {
            let (address, is_over, slow) = (&address, &is_over, &slow);
            scope.spawn(move || be_slow(address, number, is_over, slow));
        }
        let submitter = scope.spawn(|| submit(&address, &is_over));
        // A panic here must not leave the others waiting.
        let disturbed = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let mut next = Instant::now() + PAUSE;
            let mut turn = Vec::new();
            while begun.elapsed() < length() {
                bench.mend(false);
                bench.look_after_losses();
                if Instant::now() >= next {
                    if turn.is_empty() {
                        turn = KINDS.to_vec();
                    }
                    let chosen = usize::try_from(bench.random.below(turn.len() as u64)).expect("few");
                    bench.disturb(turn.swap_remove(chosen));
                    next = Instant::now() + bench.random.duration(PAUSE);
                }
                std::thread::sleep(LOOK);
            }
            // Lost hosts stay lost until others have taken over their jobs.
            wait_until(RECOVERY * 2, || {
                bench.mend(false);
                bench.look_after_losses();
                std::thread::sleep(LOOK);
                bench.losses.is_empty()
            })
        }));
        is_over.store(true, Ordering::Relaxed);
        bench.mend(true);
        let accepted = submitter.join();
        match disturbed {
            Ok(recovered) => assert!(
                recovered.is_some(),
                "stuck: {:?}; {:?}; {:?} after {:?}",
                bench.losses,
                bench.postgres.try_ask(
                    "SELECT id, status, attempts, claim_until_ms, not_before_ms, worker FROM job WHERE status <> 'done'"
                ),
                bench.recoveries.iter().max(),
                bench.done,
            ),
            Err(panic) => std::panic::resume_unwind(panic),
        }
        accepted.expect("the submitter goes on")
    });
    let length = begun.elapsed();
    let drained = Instant::now();
    let failed = nothing_lost_and_nothing_doubled(&bench.server, &accepted);
    let worst = bench.recoveries.iter().max().copied();
    eprintln!(
        "seed {}, {:.0} s: {:?}, {} slow requests; {} jobs of lost hosts were queued or begun again, at worst after {worst:?}; the rest ended within {:.0} s",
        seed(),
        length.as_secs_f64(),
        bench.done,
        slow.into_inner(),
        bench.recoveries.len(),
        drained.elapsed().as_secs_f64(),
    );
    // A run fails that was killed three times; far more would mean that disturbances take attempts which they need not.
    assert!(10 * failed <= accepted.len(), "{failed} of {} failed", accepted.len());
    if length >= LONG {
        for kind in KINDS {
            assert!(bench.done.contains_key(&kind), "{kind:?} never happened");
        }
    }
    if let Some((longest, kind)) = worst {
        // Where the machine has much else to do, every look at the jobs is late, too.
        let load = load_per_core();
        let most = if load > 2.0 { RECOVERY * 2 } else { RECOVERY };
        assert!(longest <= most, "{kind:?}: {longest:?}, load {load} a core");
    }
}
