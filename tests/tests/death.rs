//! When a process of a run dies or stalls at any moment, the others end within a second, the run folder says which one, at which
//! step and for how long it was silent, and nothing is left that hinders the next run.

use parquet::file::reader::{FileReader as _, SerializedFileReader};
use rotortwin_tests::process::{Process, load_per_core, wait_in_crowd, wait_until};
use rotortwin_tests::program::{Call, Ended, Link, MemberName, PATIENCE, Run, read_json, text, whole};
use rotortwin_tests::random::Random;
use rotortwin_tests::scratch::{Scratch, announced_flight, short_flight};
use rustix::process::Signal;
use serde_json::Value;
use std::net::TcpStream;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Requirement: from a death to the end of all the others, on a machine that does nothing else.
const END_WITHIN: Duration = Duration::from_secs(1);

/// Steps of 2.5 ms.
const STEPS_PER_S: f64 = 400.0;

/// When a process is killed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Moment {
    /// While the processes start and join.
    Join,
    /// Within 0.1 s of the first steps, in real time.
    Early,
    /// Somewhere in the first 1.5 s, in real time.
    RealTime,
    /// Half-way, as fast as possible.
    Middle,
    /// After three quarters, as fast as possible.
    Late,
}

impl Moment {
    const ALL: [Self; 5] = [Self::Join, Self::Early, Self::RealTime, Self::Middle, Self::Late];

    const fn pace(self) -> &'static str {
        match self {
            Self::Join | Self::Early | Self::RealTime => "real-time",
            Self::Middle | Self::Late => "fast",
        }
    }
}

/// Long enough to be killed in the last quarter, even if flown as fast as possible.
const fn flight_s(link: Link) -> u32 {
    match link {
        Link::Zenoh => 40,
        Link::InProcess | Link::Iceoryx2 => 60,
    }
}

/// Waits until a change at `time_s` or later is announced; the number of complete steps that this proves.
fn wait_for_announcement(run: &mut Run, time_s: f64) -> i64 {
    let time = |line: &str| {
        line.strip_prefix('t')?
            .split_once(" s  truth")?
            .0
            .trim()
            .parse::<f64>()
            .ok()
    };
    let line = run.line(|line| time(line).is_some_and(|time| time >= time_s));
    (time(&line).expect("it was just parsed") * STEPS_PER_S).round() as i64
}

/// Lower bound of the steps of a plant in real time that had done `complete` at `announced`: it is at most half a second late, and as
/// many times that as processes wait for each core.
fn certain_steps(complete: i64, announced: Instant) -> i64 {
    let late_s = 0.5 * load_per_core().max(1.0);
    let flown = (announced.elapsed().as_secs_f64() - late_s) * STEPS_PER_S;
    complete + (flown as i64).max(0)
}

/// Upper bound of the steps of a plant in real time: it was started after this moment.
fn possible_steps(started: Instant) -> i64 {
    (started.elapsed().as_secs_f64() * STEPS_PER_S) as i64
}

/// The failed process as the summary names it.
fn peer(victim: MemberName) -> &'static str {
    if victim == "sim" { "plant" } else { victim }
}

/// A kill and its outcome.
struct Kill {
    victim: MemberName,
    moment: Moment,
    /// Steps that were certainly complete when the signal was sent, and the most that the failure may name.
    steps: (i64, i64),
    /// From the signal to the end of the last process, and how long that may take on a machine as busy as it was.
    ended_after: (Duration, Duration),
    run_id: String,
    endpoint: Option<String>,
}

/// Flies, kills, and waits until all processes have ended. `None` if the flight ended first.
fn kill_one(
    scratch: &Scratch,
    link: Link,
    victim: MemberName,
    moment: Moment,
    random: &mut Random,
) -> Option<(Kill, Ended)> {
    let scenario = scratch.write("announced.toml", announced_flight(flight_s(link)));
    let started = Instant::now();
    let mut run = Call::fly(scratch, link, &scenario, "killed")
        .with(["--pace", moment.pace()])
        .start();
    let sim_args = run.member_args("sim");
    let after = |option: &str| sim_args.iter().skip_while(|arg| *arg != option).nth(1).cloned();
    let fewest = match moment {
        Moment::Join => {
            run.member(victim);
            std::thread::sleep(random.duration(Duration::from_millis(150)));
            0
        }
        Moment::Early | Moment::RealTime => {
            let complete = wait_for_announcement(&mut run, 0.0);
            let longest = if moment == Moment::Early { 100 } else { 1500 };
            let announced = Instant::now();
            std::thread::sleep(random.duration(Duration::from_millis(longest)));
            certain_steps(complete, announced)
        }
        Moment::Middle | Moment::Late => {
            let share = if moment == Moment::Middle { 0.5 } else { 0.75 };
            let complete = wait_for_announcement(&mut run, share * f64::from(flight_s(link)));
            std::thread::sleep(random.duration(Duration::from_millis(20)));
            complete
        }
    };
    let members = run.members();
    let target = run.member(victim);
    let killed = Instant::now();
    target.signal(Signal::KILL);
    let most = match moment.pace() {
        "real-time" => possible_steps(started),
        _ => i64::from(flight_s(link)) * STEPS_PER_S as i64 - 1,
    };
    let (all_ended, crowding) = wait_in_crowd(PATIENCE, || {
        run.has_ended() && members.iter().all(|member| !member.is_alive())
    });
    let kill = Kill {
        victim,
        moment,
        steps: (fewest, most),
        ended_after: (
            all_ended.unwrap_or_else(|| killed.elapsed()),
            crowding.stretch(END_WITHIN),
        ),
        run_id: after("--run-id").expect("the plant is told its run id"),
        endpoint: after("--link").and_then(|link| link.split_once("tcp/").map(|(_, endpoint)| endpoint.to_owned())),
    };
    let ended = run.end(PATIENCE);
    let survived = ended.out().join("summary.json").exists() && ended.summary()["status"] == "done";
    (!survived).then_some((kill, ended))
}

/// The run folder explains the failure, and its files are readable.
fn check_story(kill: &Kill, ended: &Ended) {
    let Kill {
        victim,
        moment,
        steps: (fewest, most),
        ..
    } = *kill;
    let summary = ended.summary();
    let failure = &summary["failure"];
    let story = format!("{victim} killed at {moment:?} ({fewest} to {most}): {failure}");
    assert_eq!(summary["status"], "failed", "{story}");
    assert_eq!(text(failure, "/peer"), peer(victim), "{story}");
    let (step, silence_ms) = (whole(failure, "/step"), whole(failure, "/silence_ms"));
    // A plant that dies loses what it has not yet passed on: the steps since its last progress event (0.2 s in real time), or the
    // rows still in the buffer of its spool (256 kB).
    let untold = match (victim, moment.pace()) {
        ("sim", "fast") => 512,
        ("sim", _) => (0.2 * STEPS_PER_S) as i64,
        _ => 0,
    };
    // The FDI engine may trail by 128 steps.
    let trail = 128;
    assert!((fewest - untold - trail..=most).contains(&step), "{story}");
    // Wall-clock time: a machine that freezes for seconds prolongs it by as much.
    assert!(
        (0..i64::try_from(PATIENCE.as_millis()).expect("a minute")).contains(&silence_ms),
        "{story}"
    );
    let sentence = text(failure, "/sentence");
    let word = if victim == "sim" { "plant" } else { victim };
    assert!(sentence.to_lowercase().contains(word), "{story}");
    if victim != "supervisor" && step > 0 {
        assert!(sentence.contains(&format!("after step {step}")), "{story}");
        // A death noticed within a millisecond has no silence.
        let silence = format!("silent for {silence_ms} ms");
        assert_eq!(sentence.contains(&silence), silence_ms > 0, "{story}");
    }
    let recorded = whole(&summary, "/steps");
    assert!(
        (step - trail - untold..=step + 1 + trail).contains(&recorded),
        "{recorded} steps recorded: {story}"
    );
    check_files(ended.out(), &summary);
    if victim == "supervisor" {
        assert_eq!(ended.code, None, "{story}");
    } else {
        assert_eq!(ended.code, Some(1), "{story}");
        assert!(
            ended.stdout.contains("FAILED") && ended.stdout.contains(sentence),
            "{}",
            ended.stdout
        );
    }
}

/// Every file of the run is complete: as many rows as the summary says, and no partial files.
fn check_files(out: &Path, summary: &Value) {
    let recorded = whole(summary, "/steps");
    let telemetry = out.join("telemetry.parquet");
    // Without a single sample there may be no telemetry.
    if telemetry.exists() || recorded > 0 {
        let file = std::fs::File::open(&telemetry).expect("it exists");
        let rows = SerializedFileReader::new(file)
            .expect("it is Parquet")
            .metadata()
            .file_metadata()
            .num_rows();
        assert_eq!(rows, recorded);
    }
    assert!(out.join("report.html").is_file());
    for entry in std::fs::read_dir(out).expect("the run folder exists").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        assert!(
            !name.ends_with(".part") && !name.ends_with(".spool"),
            "{name} is half-written"
        );
    }
}

/// The run leaves no process, no shared memory and no open port.
fn check_remains(scratch: &Scratch, kill: &Kill) {
    let what = format!("{} killed at {:?}", kill.victim, kill.moment);
    let processes = Process::with_word(&kill.run_id);
    assert!(processes.is_empty(), "{what}: {processes:?} are left");
    let memory = scratch.shared_memory();
    assert!(memory.is_empty(), "{what}: shared memory is left: {memory:?}");
    if let Some(endpoint) = &kill.endpoint {
        assert!(
            TcpStream::connect(endpoint).is_err(),
            "{what}: somebody still listens on {endpoint}"
        );
    }
}

/// The next run in the same place is not affected.
fn check_next_run(scratch: &Scratch, link: Link, what: &str) {
    let scenario = scratch.write("short.toml", short_flight());
    let fly = |link: Link| {
        let ended = Call::fly(scratch, link, &scenario, "next").run().expect_code(0);
        let hash = ended.run_hash();
        std::fs::remove_dir_all(ended.out()).expect("a run folder can be removed");
        hash
    };
    assert_eq!(fly(link), fly(Link::InProcess), "the run after: {what}");
    let memory = scratch.shared_memory();
    assert!(
        memory.is_empty(),
        "{what}: shared memory is left after the next run: {memory:?}"
    );
}

/// Kills one process of the run at every moment.
fn kill_at_every_moment(link: Link, victim: MemberName) {
    const ATTEMPTS: u32 = 5;
    let mut times = Vec::new();
    for (seed, moment) in (0..).zip(Moment::ALL) {
        let scratch = Scratch::new();
        let mut random = Random::new(seed);
        let (kill, ended) = (0..ATTEMPTS)
            .find_map(|_| {
                drop(std::fs::remove_dir_all(scratch.path("killed")));
                kill_one(&scratch, link, victim, moment, &mut random)
            })
            .expect("the kill comes before the end of the flight, sooner or later");
        check_story(&kill, &ended);
        check_remains(&scratch, &kill);
        times.push((kill.ended_after, moment));
        if matches!(moment, Moment::Join | Moment::RealTime) {
            check_next_run(&scratch, link, &format!("{victim} killed at {moment:?}"));
        }
    }
    eprintln!("{}, {victim} killed, all ended after: {times:?}", link.name());
    for ((time, limit), moment) in times {
        assert!(
            time <= limit,
            "{victim} killed at {moment:?}: the last process ended {time:?} later, expected {limit:?} on a machine this busy"
        );
    }
}

#[test]
fn scenario_controller_killed_over_shared_memory() {
    kill_at_every_moment(Link::Iceoryx2, "controller");
}

#[test]
fn scenario_controller_killed_over_tcp() {
    kill_at_every_moment(Link::Zenoh, "controller");
}

#[test]
fn scenario_fdi_killed_over_shared_memory() {
    kill_at_every_moment(Link::Iceoryx2, "fdi");
}

#[test]
fn scenario_fdi_killed_over_tcp() {
    kill_at_every_moment(Link::Zenoh, "fdi");
}

#[test]
fn scenario_sim_killed_over_shared_memory() {
    kill_at_every_moment(Link::Iceoryx2, "sim");
}

#[test]
fn scenario_sim_killed_over_tcp() {
    kill_at_every_moment(Link::Zenoh, "sim");
}

#[test]
fn scenario_supervisor_killed_over_shared_memory() {
    kill_at_every_moment(Link::Iceoryx2, "supervisor");
}

#[test]
fn scenario_supervisor_killed_over_tcp() {
    kill_at_every_moment(Link::Zenoh, "supervisor");
}

/// With all processes dead nothing can clean up; the next run does.
#[test]
fn scenario_all_killed_at_once() {
    for link in Link::BETWEEN_PROCESSES {
        let scratch = Scratch::new();
        let scenario = scratch.write("announced.toml", announced_flight(60));
        let mut run = Call::fly(&scratch, link, &scenario, "killed")
            .with(["--pace", "real-time"])
            .start();
        for name in ["sim", "controller", "fdi"] {
            run.member(name);
        }
        wait_for_announcement(&mut run, 0.0);
        let members = run.members();
        members.iter().for_each(|member| member.signal(Signal::STOP));
        members.iter().for_each(|member| member.signal(Signal::KILL));
        let (ended, crowding) = wait_in_crowd(PATIENCE, || {
            run.has_ended() && members.iter().all(|member| !member.is_alive())
        });
        let limit = crowding.stretch(END_WITHIN);
        assert!(
            ended.is_some_and(|time| time <= limit),
            "killed processes end: {ended:?}, expected {limit:?} on a machine this busy"
        );
        drop(run.end(PATIENCE));
        if link == Link::Iceoryx2 {
            assert!(!scratch.shared_memory().is_empty(), "there is something to tidy up");
        }
        check_next_run(&scratch, link, "all killed");
        let shown = Call::new(&scratch, ["show".as_ref(), scratch.path("killed").as_os_str()])
            .run()
            .expect_code(2);
        assert!(shown.stderr.concat().contains("interrupted"), "{:?}", shown.stderr);
    }
}

/// A stopped process is named like a dead one, after the time-out.
fn stall(link: Link) {
    const STEP_TIMEOUT_MS: i64 = 500;
    // The supervisor allows the plant 1.5 time-outs plus half a second; by then its peers have reported.
    const PLANT_TIMEOUT_MS: i64 = STEP_TIMEOUT_MS * 3 / 2 + 500;
    // How much later than the time-out the stall may be noticed.
    const NOTICE_MS: i64 = 500;
    for (victim, timeout_ms) in [
        ("controller", STEP_TIMEOUT_MS),
        ("fdi", STEP_TIMEOUT_MS),
        ("sim", PLANT_TIMEOUT_MS),
    ] {
        let scratch = Scratch::new();
        let scenario = scratch.write("announced.toml", announced_flight(60));
        let args = ["--pace", "real-time", "--step-timeout", &STEP_TIMEOUT_MS.to_string()];
        let started = Instant::now();
        let mut run = Call::fly(&scratch, link, &scenario, "stalled").with(args).start();
        let complete = wait_for_announcement(&mut run, 0.0);
        let announced = Instant::now();
        std::thread::sleep(Duration::from_millis(700));
        let members = run.members();
        // As for a kill: the plant reports progress every 64 steps, and at least 0.1 s apart.
        let fewest = certain_steps(complete, announced) - 128;
        run.member(victim).signal(Signal::STOP);
        let most = possible_steps(started);
        // The FDI engine is missed only once it trails by 128 steps.
        let trailing_ms = if victim == "fdi" { 320 } else { 0 };
        let noticed_ms = u64::try_from(timeout_ms + trailing_ms + NOTICE_MS).expect("it is positive");
        let stopped = Instant::now();
        let (gone, crowding) = wait_in_crowd(PATIENCE, || {
            run.has_ended() && members.iter().all(|member| !member.is_alive())
        });
        let limit = Duration::from_millis(noticed_ms) + crowding.stretch(END_WITHIN);
        assert!(gone.is_some(), "a stalled {victim} is named and killed");
        eprintln!(
            "{}, {victim} stopped, all ended after: {:?}",
            link.name(),
            stopped.elapsed()
        );
        assert!(stopped.elapsed() <= limit, "{victim}: {:?}", stopped.elapsed());
        let ended = run.end(PATIENCE).expect_code(1);
        let failure = &ended.summary()["failure"];
        assert_eq!(text(failure, "/peer"), peer(victim), "{failure}");
        let silence_ms = whole(failure, "/silence_ms");
        assert!(
            (timeout_ms..timeout_ms + trailing_ms + NOTICE_MS).contains(&silence_ms),
            "{failure}"
        );
        let step = whole(failure, "/step");
        assert!((fewest..=most).contains(&step), "{fewest} to {most}: {failure}");
        let sentence = text(failure, "/sentence");
        assert!(
            sentence.contains(&format!("after step {step}: silent for {silence_ms} ms")),
            "{sentence}"
        );
        check_files(ended.out(), &ended.summary());
        assert!(scratch.shared_memory().is_empty(), "{:?}", scratch.shared_memory());
        check_next_run(&scratch, link, &format!("{victim} stalled"));
    }
}

#[test]
fn scenario_stalled_over_shared_memory() {
    stall(Link::Iceoryx2);
}

#[test]
fn scenario_stalled_over_tcp() {
    stall(Link::Zenoh);
}

/// Signals sent to other processes of the same user until this is dropped: the kernel's count of them changes.
struct SignalsOfOthers {
    over: Arc<AtomicBool>,
    sender: Option<std::thread::JoinHandle<()>>,
}

impl SignalsOfOthers {
    fn begin() -> Self {
        let over = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&over);
        let sender = std::thread::spawn(move || {
            while !is_over.load(Ordering::Relaxed) {
                let mut other = Command::new("sleep").arg("60").spawn().expect("it starts");
                let process = Process::of_child(&other);
                // While stopped, it does not take the second signal, which stays queued until it is killed.
                process.signal(Signal::STOP);
                process.signal(Signal::USR1);
                std::thread::sleep(Duration::from_millis(150));
                other.kill().expect("it can be killed");
                other.wait().expect("it can be waited for");
                std::thread::sleep(Duration::from_millis(150));
            }
        });
        Self {
            over,
            sender: Some(sender),
        }
    }
}

impl Drop for SignalsOfOthers {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(sender) = self.sender.take() {
            sender.join().expect("it sends until the end");
        }
    }
}

/// They once counted as signs of life of a stopped plant, which was then killed late or never.
#[test]
fn regress_a_stalled_plant_among_signals_of_others() {
    let _signals = SignalsOfOthers::begin();
    stall(Link::Zenoh);
}

/// Ctrl-C and SIGTERM end a run cleanly.
#[test]
fn scenario_canceled() {
    for (link, signal) in [
        (Link::InProcess, Signal::INT),
        (Link::Iceoryx2, Signal::INT),
        (Link::Zenoh, Signal::INT),
        (Link::Iceoryx2, Signal::TERM),
    ] {
        let scratch = Scratch::new();
        let scenario = scratch.write("announced.toml", announced_flight(60));
        let mut run = Call::fly(&scratch, link, &scenario, "canceled")
            .with(["--pace", "real-time"])
            .start();
        let complete = wait_for_announcement(&mut run, 0.0);
        let members = run.members();
        run.supervisor().signal(signal);
        let (gone, crowding) = wait_in_crowd(PATIENCE, || {
            run.has_ended() && members.iter().all(|member| !member.is_alive())
        });
        eprintln!("{}, {signal:?}, all ended after: {gone:?}", link.name());
        let limit = crowding.stretch(END_WITHIN);
        assert!(
            gone.is_some_and(|time| time <= limit),
            "{}: {gone:?}, expected {limit:?} on a machine this busy",
            link.name()
        );
        let ended = run.end(PATIENCE).expect_code(1);
        let summary = ended.summary();
        assert_eq!(summary["status"], "canceled");
        assert!(
            summary.get("failure").is_none(),
            "nobody is to blame: {}",
            summary["failure"]
        );
        assert!(whole(&summary, "/steps") >= complete, "complete steps are kept");
        assert!(ended.stdout.contains("CANCELED"), "{}", ended.stdout);
        check_files(ended.out(), &summary);
        assert!(scratch.shared_memory().is_empty(), "{:?}", scratch.shared_memory());
    }
}

/// Ctrl-C also stops a run whose peers never come, and one whose plant does not respond.
#[test]
fn scenario_canceled_while_nothing_happens() {
    let scratch = Scratch::new();
    let scenario = scratch.write("announced.toml", announced_flight(60));
    let mut waiting = Call::fly(&scratch, Link::Iceoryx2, &scenario, "waiting")
        .with(["--external", "controller", "--json"])
        .start();
    waiting.member("fdi");
    std::thread::sleep(Duration::from_millis(300));
    waiting.supervisor().signal(Signal::INT);
    let (gone, crowding) = wait_in_crowd(PATIENCE, || waiting.has_ended());
    let limit = crowding.stretch(END_WITHIN);
    assert!(
        gone.is_some_and(|time| time <= limit),
        "a run without peers ends on Ctrl-C: {gone:?}, expected {limit:?} on a machine this busy"
    );
    let ended = waiting.end(PATIENCE).expect_code(1);
    assert_eq!(ended.summary()["status"], "canceled");
    let printed: Value = serde_json::from_str(&ended.stdout).expect("one JSON document");
    assert_eq!(printed, ended.summary());

    let mut stalled = Call::fly(&scratch, Link::Iceoryx2, &scenario, "stalled")
        .with(["--pace", "real-time"])
        .start();
    wait_for_announcement(&mut stalled, 0.0);
    let members = stalled.members();
    stalled.member("sim").signal(Signal::STOP);
    stalled.supervisor().signal(Signal::INT);
    // It gets the grace period to respond, then another process has to write its folder.
    let (gone, crowding) = wait_in_crowd(PATIENCE, || {
        stalled.has_ended() && members.iter().all(|member| !member.is_alive())
    });
    let limit = crowding.stretch(2 * END_WITHIN);
    assert!(
        gone.is_some_and(|time| time <= limit),
        "a plant that does not react to Ctrl-C is killed: {gone:?}, expected {limit:?} on a machine this busy"
    );
    let ended = stalled.end(PATIENCE).expect_code(1);
    assert_eq!(text(&ended.summary(), "/failure/peer"), "plant");
    assert!(scratch.shared_memory().is_empty(), "{:?}", scratch.shared_memory());
}

/// A plant that dies while writing its folder: the supervisor writes it again from the same rows.
#[test]
fn scenario_killed_while_the_folder_is_written() {
    for victim in ["sim", "supervisor"] {
        let scratch = Scratch::new();
        let scenario = scratch.write("announced.toml", announced_flight(60));
        let steps = 60 * STEPS_PER_S as i64;
        let whole_run = Call::fly(&scratch, Link::InProcess, &scenario, "whole")
            .run()
            .expect_code(0);
        let mut run = Call::fly(&scratch, Link::Iceoryx2, &scenario, "killed").start();
        let target = run.member(victim);
        let part = scratch.path("killed").join(".telemetry.parquet.part");
        assert!(
            wait_until(PATIENCE, || part.exists()).is_some(),
            "the folder is written in the end"
        );
        std::thread::sleep(Random::new(1).duration(Duration::from_millis(20)));
        let members = run.members();
        target.signal(Signal::KILL);
        // The survivors still have to write; the time that takes does not depend on the death.
        let gone = wait_until(PATIENCE, || {
            run.has_ended() && members.iter().all(|member| !member.is_alive())
        });
        eprintln!("{victim} killed while the folder was written, all ended after: {gone:?}");
        assert!(gone.is_some(), "{victim}: the folder is written in the end");
        let ended = run.end(PATIENCE);
        let summary = read_json(&scratch.path("killed").join("summary.json"));
        assert_eq!(whole(&summary, "/steps"), steps, "no row is lost");
        check_files(ended.out(), &summary);
        assert_eq!(
            summary["intervals"],
            whole_run.summary()["intervals"],
            "the same rows, the same story"
        );
        if victim == "sim" {
            assert_eq!((ended.code, text(&summary, "/failure/peer")), (Some(1), "plant"));
            assert_eq!(whole(&summary, "/failure/step"), steps - 1);
        } else {
            assert_eq!(
                (&summary["status"], &summary["run_hash"]),
                (&"done".into(), &whole_run.summary()["run_hash"])
            );
        }
    }
}
