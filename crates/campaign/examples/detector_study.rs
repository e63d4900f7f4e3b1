//! Study of the sequential detector: the protocol of 48 flights, healthy hours, smallest loss, pairs of faults, coverage.
//!
//! `cargo xtask detector WHAT [SCENARIO] [key=value …]` with WHAT one of
//!
//! * `protocol`: the flights of the paper's data set (§5.2): correct windows by trajectory, delays, false alarms
//! * `healthy`: the same trajectories without a fault: hours and false alarms
//! * `smallest`: every trajectory with every rotor losing a small fraction of its thrust at 30 s: isolated within 10 s?
//! * `pairs`: every pair of rotors, simultaneously and in sequence: named, ambiguous, wrong?
//! * `coverage`: how often the 95 % interval of the loss contains the truth; faults begin anywhere in a window
//! * `early`: a fault present from the start, before the calibration ends
//!
//! SCENARIO provides vehicle, mismatch and noise (default: the reference flight); `key=value` overrides a key of it, such as
//! `vehicle=../vehicles/octo-x.toml` or `mismatch.rotor_gain=0.066`. `seeds=A-B` sets the seeds (default 101-101), `losses=0.5,1`
//! the losses in per cent (for `pairs`: of both rotors), `minutes=M` the length of healthy flights. With `SHOW_WRONG` in the environment
//! `pairs` lists the flights that are wrong, with `SHOW_CASES` `coverage` lists every estimate.

use rotortwin_campaign::paper::protocol::{self, Conduct, Course, FlightPlan};
use rotortwin_campaign::parallel;
use rotortwin_flight::lockstep::{self, FlightEnd, FlightObserver, StopReason};
use rotortwin_flight::pace::Pace;
use rotortwin_flight::sample::Sample;
use rotortwin_flight_core::fdi::verdict_code::of_pair;
use rotortwin_plant::STEP_S;
use rotortwin_plant::powertrain::faults::FaultEntry;
use rotortwin_plant::random::RandomStream;
use rotortwin_scenario::Scenario;
use rotortwin_wire::frames::FdiReport;
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};
use std::collections::BTreeMap;
use std::num::NonZeroUsize;

/// Length of a window, s.
const WINDOW_S: f64 = 25.0 * STEP_S;

/// One window of one flight.
#[derive(Clone, Copy)]
struct Window {
    /// End of its last step, s.
    end_s: f64,
    report: FdiReport,
    label: i32,
    faulty: u32,
}

#[derive(Default)]
struct Recorder(Vec<Window>);

impl FlightObserver for Recorder {
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        if sample.report.window_end != 0 {
            self.0.push(Window {
                end_s: sample.sensors.stamp.sim_time_ns as f64 * 1e-9 + STEP_S,
                report: sample.report,
                label: sample.truth.fault_label,
                faulty: sample.truth.faulty_rotors,
            });
        }
        Ok(())
    }

    fn stop_requested(&mut self) -> Option<StopReason> {
        None
    }
}

fn fly(scenario: &Scenario) -> Vec<Window> {
    let seed = scenario.document().seed;
    let mut simulation = scenario.simulation(seed).expect("the scenario is good");
    let setup = rotortwin_flight::setup::run_setup(scenario, &simulation, 1);
    let mut link = InProcessLink::new(PidPeer::default(), FdiEnginePeer::default());
    let mut recorder = Recorder::default();
    let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut recorder);
    if let FlightEnd::Failed(failure) = outcome.end {
        panic!("{}, seed {seed}: {}", scenario.name(), failure.sentence);
    }
    recorder.0
}

/// An abrupt loss of thrust.
fn loss(rotor: usize, time_s: f64, percent: f64) -> FaultEntry {
    FaultEntry {
        time_s,
        rotor: u32::try_from(rotor + 1).expect("at most 16 rotors"),
        thrust_loss_percent: Some(percent),
        ..FaultEntry::default()
    }
}

/// A flight over one of the trajectories with these faults.
fn scenario(
    base: &Scenario,
    course: Course,
    charge: f64,
    seed: u64,
    duration_s: f64,
    faults: Vec<FaultEntry>,
) -> Scenario {
    let plan = FlightPlan {
        course,
        charge,
        rotor: 0,
        seed,
    };
    let planned = protocol::flight_scenario(base, Conduct::STANDARD, &plan).expect("the scenario is good");
    let mut documents = planned.documents().clone();
    documents.scenario.duration_s = duration_s;
    documents.scenario.fault = faults;
    Scenario::from_documents(&documents).expect("the scenario is good")
}

struct Study {
    base: Scenario,
    seeds: Vec<u64>,
    losses: Vec<f64>,
    minutes: f64,
    threads: NonZeroUsize,
}

impl Study {
    fn rotor_count(&self) -> usize {
        self.base.vehicle().rotors.layout.placements().len()
    }

    fn map<J: Sync, R: Send>(&self, jobs: &[J], work: impl Fn(&J) -> R + Sync) -> Vec<R> {
        parallel::map_in_order(self.threads, jobs, work, &|| {})
    }

    /// A seed for each of `count` flights of a study.
    fn flight_seeds(&self, study: &str, seed: u64, count: usize) -> Vec<u64> {
        let mut random = RandomStream::new(seed, study);
        (0..count)
            .map(|_| (random.unit() * (1u64 << 53) as f64) as u64)
            .collect()
    }
}

fn main() {
    let mut args = std::env::args().skip(1).peekable();
    let what = args
        .next()
        .expect("first argument: protocol, healthy, smallest, pairs, coverage or early");
    let path = args
        .next_if(|arg| !arg.contains('='))
        .unwrap_or_else(|| "config/scenarios/reference-flight.toml".to_owned());
    let (mut overrides, mut seeds, mut losses, mut minutes, mut threads) = (Vec::new(), vec![101], Vec::new(), 1.5, 2);
    for arg in args {
        match arg.split_once('=').expect("further arguments: key=value") {
            ("seeds", range) => {
                let (first, last) = range.split_once('-').unwrap_or((range, range));
                seeds = (first.parse().expect("a seed")..=last.parse::<u64>().expect("a seed")).collect();
            }
            ("losses", list) => losses = list.split(',').map(|x| x.parse().expect("a number")).collect(),
            ("minutes", text) => minutes = text.parse().expect("a number"),
            ("threads", text) => threads = text.parse().expect("a number"),
            _ => overrides.push(arg),
        }
    }
    let overrides: Vec<&str> = overrides.iter().map(String::as_str).collect();
    let base = Scenario::load_with(&path, &overrides).unwrap_or_else(|error| panic!("{error}"));
    println!(
        "{what}: {path} {}, seeds {:?}",
        overrides.join(" "),
        (seeds.first(), seeds.last())
    );
    let study = Study {
        base,
        seeds,
        losses,
        minutes,
        threads: NonZeroUsize::new(threads).expect("one thread or more"),
    };
    match what.as_str() {
        "protocol" => run_protocol(&study),
        "healthy" => run_healthy(&study),
        "smallest" => run_smallest(&study),
        "pairs" => run_pairs(&study),
        "coverage" => run_coverage(&study),
        "early" => run_early(&study),
        other => panic!("no study is called {other}"),
    }
}

/// Verdict windows of a fault-free stretch that are not "healthy", as uninterrupted series.
fn alarms(windows: &[Window]) -> usize {
    let alarm = |w: &Window| w.label == 0 && w.report.sequential != 0 && w.report.sequential != -2;
    (0..windows.len())
        .filter(|&i| alarm(&windows[i]) && (i == 0 || !alarm(&windows[i - 1])))
        .count()
}

/// 95 % interval of a Poisson rate per hour for a number of events (Garwood, with Wilson and Hilferty's approximation of χ²).
fn rate(events: usize, hours: f64) -> String {
    let n = events as f64;
    let bound = |n: f64, z: f64| {
        if n == 0.0 {
            0.0
        } else {
            n * (1.0 - 1.0 / (9.0 * n) + z / (3.0 * n.sqrt())).powi(3)
        }
    };
    let upper = if events == 0 { 3.689 } else { bound(n + 1.0, 1.96) };
    format!(
        "{events} false alarms in {hours:.2} h healthy ({:.2} /h, 95 % [{:.2}, {:.2}])",
        n / hours,
        bound(n, -1.96) / hours,
        upper / hours
    )
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Isolation delay above which flights of the protocol are listed individually, s.
const SLOW_S: f64 = 1.0;

/// Number of incorrect windows, of about 1,280, above which they are listed too.
const NOTABLE_WINDOWS: u64 = 32;

/// A healthy rotor is named, alone or with another one.
fn names_healthy(w: &Window) -> bool {
    w.faulty != 0 && w.report.sequential > 0 && w.report.suspect_rotors & !w.faulty != 0
}

fn run_protocol(study: &Study) {
    let plans: Vec<FlightPlan> = study
        .seeds
        .iter()
        .flat_map(|seed| protocol::flight_plans(study.rotor_count(), *seed))
        .collect();
    let flights = study.map(&plans, |plan| {
        fly(&protocol::flight_scenario(&study.base, Conduct::STANDARD, plan).expect("the scenario is good"))
    });
    let mut total = (0u64, 0u64);
    let mut delays = Vec::new();
    let (mut healthy_s, mut alarm_count, mut others) = (0.0, 0, BTreeMap::<&str, u64>::new());
    for course in Course::ALL {
        let mut fold = (0u64, 0u64);
        for (plan, windows) in plans.iter().zip(&flights).filter(|(plan, _)| plan.course == course) {
            let before = fold;
            for w in windows.iter().filter(|w| w.report.sequential != -2) {
                fold.0 += u64::from(w.report.sequential == w.label);
                fold.1 += 1;
                if w.label != 0 && w.report.sequential != w.label {
                    let what = match w.report.sequential {
                        0 => "healthy",
                        -1 => "unknown",
                        -3 => "ambiguous",
                        100.. => "pair",
                        _ => "other rotor",
                    };
                    *others.entry(what).or_default() += 1;
                }
                healthy_s += if w.label == 0 { WINDOW_S } else { 0.0 };
            }
            let alarms = alarms(windows);
            alarm_count += alarms;
            let onset = windows.iter().find(|w| w.label != 0).map_or(f64::NAN, |w| w.end_s);
            let found = windows.iter().find(|w| w.label != 0 && w.report.sequential == w.label);
            let delay = found.map_or(f64::INFINITY, |w| w.end_s - onset + WINDOW_S);
            delays.push(delay);
            let healthy_named = windows.iter().filter(|w| names_healthy(w)).count();
            let missed = (fold.1 - before.1) - (fold.0 - before.0);
            if delay > SLOW_S || healthy_named > 0 || alarms > 0 || missed > NOTABLE_WINDOWS {
                println!(
                    "  {} charge {} rotor {} seed {}: isolated after {delay:.2} s, {missed} windows not right, \
                     a healthy rotor named in {healthy_named}, {alarms} false alarms",
                    plan.course.name(),
                    plan.charge,
                    plan.rotor + 1,
                    plan.seed,
                );
            }
        }
        println!(
            "  {:<10} {:>8.3} % of {} windows",
            course.name(),
            100.0 * fold.0 as f64 / fold.1 as f64,
            fold.1
        );
        total = (total.0 + fold.0, total.1 + fold.1);
    }
    let middle = median(&mut delays);
    println!(
        "  all        {:>8.3} % of {} windows of {} flights",
        100.0 * total.0 as f64 / total.1 as f64,
        total.1,
        plans.len()
    );
    println!(
        "  delay of the first isolation (5 % blade, to within a window) {middle:.3} s median, {:.3} s worst",
        delays[delays.len() - 1]
    );
    println!("  windows with a fault that are not right: {others:?}");
    println!("  {}", rate(alarm_count, healthy_s / 3600.0));
}

fn run_healthy(study: &Study) {
    let jobs: Vec<(Course, f64, u64)> = study
        .seeds
        .iter()
        .flat_map(|seed| {
            let seeds = study.flight_seeds("detector-study/healthy", *seed, 8);
            let cases = Course::ALL
                .into_iter()
                .flat_map(|course| protocol::CHARGES.map(|charge| (course, charge)));
            cases
                .zip(seeds)
                .map(|((course, charge), seed)| (course, charge, seed))
                .collect::<Vec<_>>()
        })
        .collect();
    let results = study.map(&jobs, |(course, charge, seed)| {
        let windows = fly(&scenario(
            &study.base,
            *course,
            *charge,
            *seed,
            60.0 * study.minutes,
            Vec::new(),
        ));
        let ready = windows.iter().filter(|w| w.report.sequential != -2).count();
        if alarms(&windows) > 0 {
            let first = windows
                .iter()
                .find(|w| w.report.sequential != 0 && w.report.sequential != -2)
                .expect("an alarm");
            println!(
                "  alarm: {} charge {charge} seed {seed}: {} at {:.2} s",
                course.name(),
                first.report.sequential,
                first.end_s
            );
        }
        (alarms(&windows), ready)
    });
    let hours = results.iter().map(|r| r.1).sum::<usize>() as f64 * WINDOW_S / 3600.0;
    println!("  {}", rate(results.iter().map(|r| r.0).sum(), hours));
}

fn run_smallest(study: &Study) {
    const ONSET_S: f64 = 30.0;
    const LIMIT_S: f64 = 10.0;
    let losses = if study.losses.is_empty() {
        vec![0.15, 0.2, 0.5, 1.0, 1.25, 1.5, 2.0]
    } else {
        study.losses.clone()
    };
    for percent in losses {
        let mut jobs = Vec::new();
        for seed in &study.seeds {
            let seeds = study.flight_seeds(
                "detector-study/smallest",
                *seed,
                Course::ALL.len() * study.rotor_count(),
            );
            let cases = Course::ALL
                .into_iter()
                .flat_map(|course| (0..study.rotor_count()).map(move |rotor| (course, rotor)));
            jobs.extend(cases.zip(seeds));
        }
        let delays = study.map(&jobs, |((course, rotor), seed)| {
            let charge = protocol::CHARGES[rotor % 2];
            let faults = vec![loss(*rotor, ONSET_S, percent)];
            let windows = fly(&scenario(
                &study.base,
                *course,
                charge,
                *seed,
                ONSET_S + LIMIT_S + 0.1,
                faults,
            ));
            let wrong = windows
                .iter()
                .any(|w| w.report.sequential > 0 && w.report.sequential != *rotor as i32 + 1);
            let found = windows.iter().find(|w| w.label != 0 && w.report.sequential == w.label);
            (
                found.map(|w| w.end_s - ONSET_S).filter(|delay| *delay <= LIMIT_S),
                wrong,
            )
        });
        let mut found: Vec<f64> = delays.iter().filter_map(|d| d.0).collect();
        let wrong = delays.iter().filter(|d| d.1).count();
        let middle = median(&mut found);
        println!(
            "  {percent:>5} %: isolated within 10 s in {} of {}, delay {middle:.2} s median, {:.2} s worst; another rotor or a pair named in {wrong}",
            found.len(),
            delays.len(),
            found.last().copied().unwrap_or(f64::NAN)
        );
    }
}

/// Result for one pair.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Outcome {
    Named,
    /// Both are among the suspects.
    Ambiguous,
    /// "Unknown fault": a fault is detected, no rotor is named.
    Unknown,
    /// Healthy: nothing is detected.
    Missed,
    /// One of the two is named, the other is missed.
    OneOfTwo,
    /// A healthy rotor is named, or the truth is not among the suspects.
    Wrong,
}

/// Probability above which a wrong verdict counts as confident.
const CONFIDENT: f32 = 0.95;

fn outcome(w: &Window, pair: [usize; 2]) -> Outcome {
    let truth = 1u32 << pair[0] | 1 << pair[1];
    let code = of_pair(pair[0] as i32 + 1, pair[1] as i32 + 1);
    match w.report.sequential {
        c if c == code => Outcome::Named,
        0 | -2 => Outcome::Missed,
        -1 => Outcome::Unknown,
        -3 if w.report.suspect_rotors & truth == truth => Outcome::Ambiguous,
        1..100 if w.report.suspect_rotors & !truth == 0 => Outcome::OneOfTwo,
        _ => Outcome::Wrong,
    }
}

fn run_pairs(study: &Study) {
    const SECOND_S: f64 = 50.0;
    let mut severities: Vec<[f64; 2]> = [2.0, 5.0, 10.0, 20.0].map(|percent| [percent; 2]).to_vec();
    severities.extend([
        [5.0, 2.0],
        [10.0, 2.0],
        [20.0, 2.0],
        [10.0, 5.0],
        [20.0, 5.0],
        [20.0, 10.0],
    ]);
    if !study.losses.is_empty() {
        severities = study.losses.iter().map(|percent| [*percent; 2]).collect();
    }
    let n = study.rotor_count();
    println!(
        "  20 s after the second onset; helix 1 and hover in turn; \"sure\": wrong with a probability of {CONFIDENT} or more; \"ever\": a healthy \
         rotor was named in some window"
    );
    println!(
        "  losses %   when         named ambiguous unknown one-of-two missed wrong sure | ever | suspects of ambiguous, mean"
    );
    let mut sums = [0usize; 9];
    for one_after_the_other in [false, true] {
        for severity in &severities {
            let mut jobs = Vec::new();
            for seed in &study.seeds {
                let seeds = study.flight_seeds("detector-study/pairs", *seed, n * n);
                for first in 0..n {
                    for second in 0..n {
                        // Unequal losses in both orders; also in sequence.
                        let once = severity[0] == severity[1] && !one_after_the_other;
                        if first != second && (!once || first < second) {
                            jobs.push((first, second, seeds[first * n + second]));
                        }
                    }
                }
            }
            let results = study.map(&jobs, |(first, second, seed)| {
                let course = [Course::Helix1, Course::Hover][(first + second) % 2];
                let later = if one_after_the_other { SECOND_S } else { 30.0 };
                let faults = vec![loss(*first, 30.0, severity[0]), loss(*second, later, severity[1])];
                let windows = fly(&scenario(&study.base, course, 0.9, *seed, later + 20.0, faults));
                let pair = [*first.min(second), *first.max(second)];
                let truth = 1u32 << pair[0] | 1 << pair[1];
                let ever = windows
                    .iter()
                    .any(|w| w.report.sequential > 0 && w.report.suspect_rotors & !truth != 0 && w.faulty != 0);
                let last = windows.last().expect("windows");
                let outcome = outcome(last, pair);
                if std::env::var_os("SHOW_WRONG").is_some()
                    && (outcome == Outcome::Wrong || outcome == Outcome::OneOfTwo)
                {
                    println!(
                        "    {:?} {severity:?} {}: rotors {} {} seed {seed}: {} suspects {:#b} {:?} {:?}",
                        outcome,
                        course.name(),
                        first + 1,
                        second + 1,
                        last.report.sequential,
                        last.report.suspect_rotors,
                        last.report.thrust_loss.values(),
                        last.report.second_thrust_loss.values()
                    );
                }
                let sure = outcome == Outcome::Wrong && last.report.sequential_probability >= CONFIDENT;
                (outcome, ever, last.report.suspect_rotors.count_ones(), sure)
            });
            let count = |what| results.iter().filter(|r| r.0 == what).count();
            let open: Vec<u32> = results
                .iter()
                .filter(|r| r.0 == Outcome::Ambiguous)
                .map(|r| r.2)
                .collect();
            let ever = results.iter().filter(|r| r.1).count();
            let row = [
                count(Outcome::Named),
                count(Outcome::Ambiguous),
                count(Outcome::Unknown),
                count(Outcome::OneOfTwo),
                count(Outcome::Missed),
                count(Outcome::Wrong),
                results.iter().filter(|r| r.3).count(),
                ever,
                results.len(),
            ];
            for (sum, value) in sums.iter_mut().zip(row) {
                *sum += value;
            }
            println!(
                "  {:>4} {:>4}   {:<12} {:>5} {:>9} {:>7} {:>10} {:>6} {:>5} {:>4} | {ever:>4} | {:.1}   of {}",
                severity[0],
                severity[1],
                if one_after_the_other { "20 s apart" } else { "together" },
                row[0],
                row[1],
                row[2],
                row[3],
                row[4],
                row[5],
                row[6],
                f64::from(open.iter().sum::<u32>()) / open.len().max(1) as f64,
                results.len()
            );
        }
    }
    println!(
        "  all                    {:>5} {:>9} {:>7} {:>10} {:>6} {:>5} {:>4} | {:>4} |       of {}",
        sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6], sums[7], sums[8]
    );
}

fn run_coverage(study: &Study) {
    let losses = if study.losses.is_empty() {
        vec![2.0, 5.0, 10.0, 20.0]
    } else {
        study.losses.clone()
    };
    println!("  loss %    1 s after isolation         10 s after isolation        width at 10 s (share, median)");
    for percent in losses {
        let mut jobs = Vec::new();
        for seed in &study.seeds {
            let seeds = study.flight_seeds(
                "detector-study/coverage",
                *seed,
                Course::ALL.len() * study.rotor_count(),
            );
            let cases = Course::ALL
                .into_iter()
                .flat_map(|course| (0..study.rotor_count()).map(move |rotor| (course, rotor)));
            jobs.extend(cases.zip(seeds));
        }
        let results = study.map(&jobs, |((course, rotor), seed)| {
            // Anywhere in a window: the detector takes a block's start for the first guess of the onset.
            let onset_s = 30.0 + WINDOW_S * RandomStream::new(*seed, "detector-study/onset").unit();
            let faults = vec![loss(*rotor, onset_s, percent)];
            let windows = fly(&scenario(&study.base, *course, 0.9, *seed, 52.0, faults));
            let code = *rotor as i32 + 1;
            let first = windows
                .iter()
                .find(|w| w.report.sequential == code && w.label != 0)?
                .end_s;
            let after = |delay: f64| {
                let w = windows
                    .iter()
                    .find(|w| w.end_s >= first + delay)
                    .or(windows.last())
                    .expect("windows");
                (w.report.sequential == code).then(|| {
                    let estimate = w.report.thrust_loss;
                    let truth = percent as f32 / 100.0;
                    let inside = estimate.share_low <= truth && truth <= estimate.share_high;
                    let width = estimate.share_high - estimate.share_low;
                    if std::env::var_os("SHOW_CASES").is_some() {
                        println!(
                            "    {percent} % {} rotor {code} seed {seed} after {delay} s: {} [{}, {}]",
                            course.name(),
                            estimate.share,
                            estimate.share_low,
                            estimate.share_high
                        );
                    }
                    let z = f64::from((estimate.share - truth) / (width / 3.92).max(1e-9));
                    (inside, z, f64::from(width))
                })
            };
            Some([after(1.0), after(10.0)])
        });
        print!("  {percent:>5} ");
        let mut widths = Vec::new();
        for k in 0..2 {
            let cases: Vec<(bool, f64, f64)> = results.iter().filter_map(|r| r.as_ref().and_then(|r| r[k])).collect();
            let inside = cases.iter().filter(|c| c.0).count();
            let n = cases.len() as f64;
            let mean = cases.iter().map(|c| c.1).sum::<f64>() / n;
            let deviation = (cases.iter().map(|c| (c.1 - mean).powi(2)).sum::<f64>() / n).sqrt();
            print!(
                "   {:>5.1} % of {} (z {mean:+.2} ± {deviation:.2})",
                100.0 * inside as f64 / n,
                cases.len()
            );
            widths = cases.iter().map(|c| c.2).collect();
        }
        println!("   {:.4}", median(&mut widths));
    }
}

fn run_early(study: &Study) {
    let losses = if study.losses.is_empty() {
        vec![2.0, 5.0, 10.0, 20.0]
    } else {
        study.losses.clone()
    };
    for percent in losses {
        let mut jobs = Vec::new();
        for seed in &study.seeds {
            let seeds = study.flight_seeds("detector-study/early", *seed, Course::ALL.len() * study.rotor_count());
            let cases = Course::ALL
                .into_iter()
                .flat_map(|course| (0..study.rotor_count()).map(move |rotor| (course, rotor)));
            jobs.extend(cases.zip(seeds));
        }
        let results = study.map(&jobs, |((course, rotor), seed)| {
            // Before the noise is measured, and in the middle of the calibration.
            let time_s = if seed % 2 == 0 { 1.0 } else { 6.0 };
            let windows = fly(&scenario(
                &study.base,
                *course,
                0.9,
                *seed,
                20.0,
                vec![loss(*rotor, time_s, percent)],
            ));
            let last = windows.last().expect("windows").report;
            let code = last.sequential;
            let inside = last.suspect_rotors >> rotor & 1 == 1;
            match code {
                0 => "healthy",
                -1 => "unknown",
                -3 if inside => "ambiguous, right among them",
                c if c == *rotor as i32 + 1 => "right",
                _ => "wrong",
            }
        });
        let mut counts = BTreeMap::<&str, usize>::new();
        for result in results {
            *counts.entry(result).or_default() += 1;
        }
        println!("  {percent:>5} %: {counts:?}");
    }
}
