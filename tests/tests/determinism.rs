//! The same scenario and seed give the same run, bit for bit: over every link, under any scheduling, and when repeated.

use rotortwin_tests::process::wait_until;
use rotortwin_tests::program::{Call, Link, PATIENCE, Run, number, whole};
use rotortwin_tests::random::Random;
use rotortwin_tests::scratch::{SHORT_FLIGHT_STEPS, Scratch, repository, shipped_scenario, short_flight};
use rotortwin_tests::telemetry::columns;
use rustix::process::Signal;
use std::path::Path;
use std::time::Duration;

/// Seeds that are flown over every link: 8, or as many as `ROTORTWIN_SEEDS` says.
fn seed_count() -> u64 {
    const USUAL: u64 = 8;
    let asked = std::env::var("ROTORTWIN_SEEDS").ok();
    asked.map_or(USUAL, |text| text.parse().expect("ROTORTWIN_SEEDS is a count"))
}

/// Longest time for which a process is stopped, and between stops.
const LONGEST_DELAY: Duration = Duration::from_millis(30);

/// Stops and continues random processes of a run for random times until it ends; the number of stops.
fn disturb(run: &mut Run, random: &mut Random) -> u32 {
    let mut stops = 0;
    while !run.has_ended() {
        let members = run.members();
        let victim = members[usize::try_from(random.below(members.len() as u64)).expect("a few")];
        victim.signal(Signal::STOP);
        std::thread::sleep(random.duration(LONGEST_DELAY));
        victim.signal(Signal::CONT);
        stops += 1;
        let pause = random.duration(LONGEST_DELAY);
        wait_until(pause, || run.has_ended());
    }
    stops
}

/// Flies one seed in one process and over `link`, the latter with disturbed scheduling, and compares. Returns the hash and the number
/// of stops.
fn same_hash_over(link: Link, seed: u64) -> (String, u32) {
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    let fly = |link: Link| Call::fly(&scratch, link, &scenario, link.name()).with(["--seed", &seed.to_string()]);
    let here = fly(Link::InProcess).run().expect_code(0);
    let mut run = fly(link).start();
    let stops = disturb(&mut run, &mut Random::new(seed));
    let there = run.end(PATIENCE).expect_code(0);
    assert_eq!(here.run_hash(), there.run_hash(), "seed {seed} over {}", link.name());
    assert_eq!(here.summary()["steps"], SHORT_FLIGHT_STEPS);
    let at_end = here.summary()["intervals"][1]["scores"]["sequential"]["verdict_at_end"].clone();
    assert_eq!(at_end, 3, "seed {seed}: the hash holds a verdict");
    assert_eq!(
        here.summary()["intervals"],
        there.summary()["intervals"],
        "seed {seed}: what the detectors said"
    );
    (here.run_hash(), stops)
}

/// Flies all seeds, a few at a time: runs side by side disturb each other, too.
fn same_hashes_over(link: Link) {
    const SIDE_BY_SIDE: u64 = 3;
    let count = seed_count();
    let flown: Vec<(String, u32)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..SIDE_BY_SIDE)
            .map(|worker| {
                let seeds = (1..=count).filter(move |seed| seed % SIDE_BY_SIDE == worker);
                scope.spawn(move || seeds.map(|seed| same_hash_over(link, seed)).collect::<Vec<_>>())
            })
            .collect();
        let join = |worker: std::thread::ScopedJoinHandle<'_, Vec<(String, u32)>>| match worker.join() {
            Ok(flown) => flown,
            Err(panic) => std::panic::resume_unwind(panic),
        };
        workers.into_iter().flat_map(join).collect()
    });
    let stops: u32 = flown.iter().map(|(_, stops)| stops).sum();
    eprintln!(
        "{}: {count} seeds, processes stopped and continued {stops} times",
        link.name()
    );
    assert!(
        u64::from(stops) > count,
        "the scheduling was hardly disturbed: {stops} stops"
    );
    let mut hashes: Vec<&String> = flown.iter().map(|(hash, _)| hash).collect();
    hashes.sort();
    hashes.dedup();
    assert_eq!(hashes.len() as u64, count, "another seed is another run");
}

#[test]
fn scenario_many_seeds_over_shared_memory_with_random_delays() {
    same_hashes_over(Link::Iceoryx2);
}

#[test]
fn scenario_many_seeds_over_tcp_with_random_delays() {
    same_hashes_over(Link::Zenoh);
}

/// A run is repeatable, and `replay` confirms it.
#[test]
fn scenario_the_same_seed_again_and_replayed() {
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    for link in [Link::InProcess, Link::Iceoryx2, Link::Zenoh] {
        let fly = |name: &str| {
            Call::fly(&scratch, link, &scenario, &format!("{name}-{}", link.name()))
                .run()
                .expect_code(0)
        };
        let (first, second) = (fly("first"), fly("second"));
        assert_eq!(first.run_hash(), second.run_hash(), "{}", link.name());
        let replay = Call::new(&scratch, ["replay".as_ref(), first.out().as_os_str()])
            .run()
            .expect_code(0);
        assert!(
            replay.stdout.starts_with("same: 2400 steps") && replay.stdout.contains(&first.run_hash()),
            "{}",
            replay.stdout
        );
    }
}

/// Pace, window and processors change when something happens, not what happens.
#[test]
fn scenario_settings_that_change_nothing() {
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    let here = Call::fly(&scratch, Link::InProcess, &scenario, "here")
        .run()
        .expect_code(0);
    let settings: [(Link, &[&str]); 6] = [
        (Link::Iceoryx2, &["--fdi-window", "0"]),
        (Link::Iceoryx2, &["--fdi-window", "256"]),
        (Link::Zenoh, &["--fdi-window", "1"]),
        (Link::Iceoryx2, &["--cpu", "0"]),
        (Link::InProcess, &["--cpu", "0"]),
        (Link::Iceoryx2, &["--pace", "real-time"]),
    ];
    for (index, (link, args)) in settings.into_iter().enumerate() {
        let name = format!("{index}");
        let there = Call::fly(&scratch, link, &scenario, &name)
            .with(args.iter().copied())
            .run()
            .expect_code(0);
        assert_eq!(there.run_hash(), here.run_hash(), "{} {args:?}", link.name());
        if args.contains(&"real-time") {
            let summary = there.summary();
            assert!(
                (5.99..7.0).contains(&number(&summary, "/wall_s")),
                "6 s take 6 s: {}",
                summary["wall_s"]
            );
            let p50 = number(&summary, "/real_time/jitter_us_p50");
            let max = number(&summary, "/real_time/jitter_us_max");
            assert!(0.0 <= p50 && p50 <= max, "{}", summary["real_time"]);
            assert!(whole(&summary, "/real_time/deadline_misses") >= 0);
        }
    }
}

/// Concurrent runs in one domain of shared memory, as when people start several at a time, do not see each other.
#[test]
fn scenario_runs_side_by_side() {
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    let here = Call::fly(&scratch, Link::InProcess, &scenario, "here")
        .run()
        .expect_code(0);
    let fly = |index: u32| Call::fly(&scratch, Link::Iceoryx2, &scenario, &format!("{index}")).start();
    let runs: Vec<Run> = (0..5).map(fly).collect();
    for run in runs {
        assert_eq!(run.end(PATIENCE).expect_code(0).run_hash(), here.run_hash());
    }
    assert!(scratch.shared_memory().is_empty(), "{:?}", scratch.shared_memory());
}

/// `replay` detects one changed bit of the recorded hash and one changed number of the recorded scenario.
#[test]
fn scenario_replay_tells_a_difference() {
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    let flown = Call::fly(&scratch, Link::InProcess, &scenario, "flown")
        .run()
        .expect_code(0);
    let summary = std::fs::read_to_string(flown.out().join("summary.json")).expect("it was written");
    let hash = flown.run_hash();
    let other_hash = format!("{}{}", if hash.starts_with('0') { '1' } else { '0' }, &hash[1..]);
    for (name, from, to) in [
        ("hash", hash.as_str(), other_hash.as_str()),
        ("fault", "percent = 20.0", "percent = 20.1"),
    ] {
        assert!(summary.contains(from), "{from} stands in the summary");
        let changed = scratch.write(&format!("{name}/summary.json"), summary.replace(from, to));
        let replay = Call::new(&scratch, ["replay".as_ref(), changed.as_os_str()])
            .run()
            .expect_code(1);
        assert!(replay.stdout.starts_with("DIFFERENT"), "{name}: {}", replay.stdout);
        let json = Call::new(&scratch, ["replay".as_ref(), changed.as_os_str(), "--json".as_ref()])
            .run()
            .expect_code(1);
        let json: serde_json::Value = serde_json::from_str(&json.stdout).expect("one JSON document");
        assert_eq!(json["same"], false, "{name}");
    }
}

/// Every shipped scenario flown by our own controller has the recorded hash over every link: a new hash means that every run differs.
/// Refresh with `ROTORTWIN_UPDATE_GOLDEN=1 cargo test --release -p rotortwin-tests --test determinism regress_`.
#[test]
fn regress_run_hashes_of_shipped_scenarios() {
    let file = repository().join("tests/golden/run-hashes.toml");
    let scratch = Scratch::new();
    let fly = |name: &str, link: Link| {
        Call::fly(
            &scratch,
            link,
            &shipped_scenario(name),
            &format!("{name}-{}", link.name()),
        )
        .run()
        .expect_code(0)
        .run_hash()
    };
    let names = flown_by_our_controller();
    assert!(names.len() >= 14, "{names:?}");
    let flown: Vec<(String, String)> = names
        .into_iter()
        .map(|name| {
            let here = fly(&name, Link::InProcess);
            for link in [Link::Iceoryx2, Link::Zenoh] {
                assert_eq!(here, fly(&name, link), "{name} over {}", link.name());
            }
            (name, here)
        })
        .collect();
    if std::env::var_os("ROTORTWIN_UPDATE_GOLDEN").is_some() {
        write_hashes(&file, &flown);
    }
    let recorded = std::fs::read_to_string(&file).expect("the file is part of the repository");
    let recorded: toml::Table = recorded.parse().expect("it is TOML");
    for (name, hash) in &flown {
        let expected = recorded.get(name).and_then(toml::Value::as_str);
        assert_eq!(
            Some(hash.as_str()),
            expected,
            "{name} flies differently; if that was meant, refresh the file"
        );
    }
    assert_eq!(
        recorded.len(),
        flown.len(),
        "a recorded scenario is not shipped any more"
    );
}

/// Names of shipped scenarios, except those that wait for an autopilot.
fn flown_by_our_controller() -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(repository().join("config/scenarios"))
        .expect("they are part of the repository")
        .filter_map(|entry| {
            let name = entry.expect("readable").file_name().into_string().expect("UTF-8");
            Some(name.strip_suffix(".toml")?.to_owned())
        })
        .filter(|name| !name.starts_with("autopilot-"))
        .collect();
    names.sort();
    names
}

fn write_hashes(file: &Path, flown: &[(String, String)]) {
    let mut text = "# Run hashes of shipped scenarios with their own seeds. Refresh after a change that is meant to change flights:\n\
                    # ROTORTWIN_UPDATE_GOLDEN=1 cargo test --release -p rotortwin-tests --test determinism regress_\n"
        .to_owned();
    for (name, hash) in flown {
        text.push_str(&format!("{name} = \"{hash}\"\n"));
    }
    std::fs::write(file, text).expect("the repository can be written");
}

/// The reference flight's helix from the ground and back to it: our own controller takes off, stays on its path, and ends at rest.
/// The detectors are silent on the ground, and do not take it for a fault.
#[test]
fn scenario_the_reference_flight_from_the_ground_is_the_same_over_every_link() {
    const FEET_M: f64 = 0.179;
    const NOT_READY: i32 = -2;
    let at = |t: f64| {
        let turn = std::f64::consts::TAU * t / 15.0;
        let down = -5.0 - 1.5 * (1.0 - (std::f64::consts::TAU * t / 45.0).cos());
        [2.0 * turn.cos(), 2.0 * turn.sin(), down]
    };
    let [north, east, _] = at(0.0);
    // One point per second: eight up, six turns, ten down.
    let mut points = vec![[north, east, -FEET_M]];
    points.extend((1..=8).map(|second| [north, east, -FEET_M - (5.0 - FEET_M) * f64::from(second) / 8.0]));
    points.extend((1..=90).map(|second| at(f64::from(second))));
    points.extend((1..=10).map(|second| [north, east, -5.0 + (5.0 - 0.1) * f64::from(second) / 10.0]));
    let scratch = Scratch::new();
    let mut document: toml::Table = std::fs::read_to_string(shipped_scenario("takeoff-and-land"))
        .expect("it is shipped")
        .parse()
        .expect("it is TOML");
    document.insert("name".into(), "helix-from-the-ground".into());
    document.insert(
        "vehicle".into(),
        repository()
            .join("config/vehicles/f550-skids.toml")
            .to_str()
            .expect("UTF-8")
            .into(),
    );
    document.insert("duration_s".into(), 115.0.into());
    let trajectory = document["trajectory"].as_table_mut().expect("a table");
    trajectory.insert("interval_s".into(), 1.0.into());
    trajectory.insert("speed_m_s".into(), 1.0.into());
    let points: Vec<toml::Value> = points
        .into_iter()
        .map(|point| toml::Value::from(point.to_vec()))
        .collect();
    trajectory.insert("points_ned_m".into(), points.into());
    let scenario = scratch.write("from-the-ground.toml", document.to_string());
    let fly = |link: Link| Call::fly(&scratch, link, &scenario, link.name()).run().expect_code(0);
    let here = fly(Link::InProcess);
    assert_eq!(here.run_hash(), fly(Link::Iceoryx2).run_hash());
    assert_eq!(here.run_hash(), fly(Link::Zenoh).run_hash());

    let [north, east, down, to_north, to_east, to_down, verdicts] = columns(
        here.out(),
        [
            "true_position_north_m",
            "true_position_east_m",
            "true_position_down_m",
            "reference_north_m",
            "reference_east_m",
            "reference_down_m",
            "verdict_sequential",
        ],
    );
    let highest = down.iter().copied().fold(0.0, f64::min);
    assert!(
        (-8.3..-7.7).contains(&highest),
        "highest point of the helix: {highest} m"
    );
    let worst = (400 * 20..400 * 98)
        .map(|k| {
            let error = [north[k] - to_north[k], east[k] - to_east[k], down[k] - to_down[k]];
            error.iter().map(|e| e * e).sum::<f64>().sqrt()
        })
        .fold(0.0, f64::max);
    assert!(worst < 0.5, "{worst} m away from the helix");
    let second = down.len() - 400..;
    assert!(
        down[second.clone()].iter().all(|z| (z + FEET_M).abs() < 0.005),
        "it stands on its feet for the last second"
    );

    let score = &here.summary()["intervals"][0]["scores"]["sequential"];
    assert_eq!(score["false_alarm_events"], 0, "{score}");
    assert_eq!(score["verdict_at_end"], 0, "{score}");
    assert!(
        verdicts[second].iter().all(|code| *code as i32 == NOT_READY),
        "after landing"
    );
}
