//! Verdicts of sessions on faults in the world of the independent generator. Shares are asserted with a margin for
//! chance, at fixed seeds; figures with intervals come from `rotortwin blind --preset faults`.

mod foreign;

use foreign::{cases_of, detectors, fed, scored, seconds, windows_of};
use rotortwin_blind::bench::faults::{Class, End, FaultCase, FaultRow, fly_case, other_days};
use rotortwin_blind::bench::faults_sheet;
use rotortwin_blind::bench::sheet::Share;
use rotortwin_blind::flight::Row;
use rotortwin_blind::hidden::{Hidden, Profile};
use rotortwin_fdi_session::{Explained, ExplanationKind, FdiSession, Interval, Learner, Learnt, Window};
use serde_json::json;

/// Coverage promised for a 95 % interval, minus what chance allows with so few flights.
const LEAST_INSIDE: f64 = 0.88;

fn cases(class: Class, n: usize, seed: u64) -> Vec<FaultCase> {
    cases_of(class, n, seed, 60.0)
}

/// Verdict of a session on a flight.
fn windows(case: &FaultCase) -> Vec<Window> {
    windows_of(&fly_case(case).expect("flown"))
}

/// The same, scored.
fn judged(class: Class, n: usize, seed: u64) -> Vec<FaultRow> {
    cases(class, n, seed)
        .iter()
        .map(|case| scored(case, &windows(case)))
        .collect()
}

fn ends(rows: &[FaultRow], wanted: &[End]) -> usize {
    rows.iter()
        .filter(|row| row.end.is_some_and(|end| wanted.contains(&end)))
        .count()
}

#[test]
fn val_intervals_hold_the_loss_whether_it_stands_or_moves() {
    for class in [Class::Step, Class::Ramp, Class::Recovery, Class::BladeDrag] {
        let rows = judged(class, 12, 5);
        let inside = rows.iter().filter(|row| row.inside == Some(true)).count();
        assert!(
            ends(&rows, &[End::Right]) >= 11,
            "{class:?}: {:?}",
            rows.iter().map(|row| row.end).collect::<Vec<_>>()
        );
        let windows = rows.iter().fold([0; 4], |[a, b, c, d], row| {
            [
                a + row.still.inside,
                b + row.still.of,
                c + row.moving.inside,
                d + row.moving.of,
            ]
        });
        assert!(inside >= 10, "{class:?}: {inside} of 12 flights at the end");
        assert!(
            windows[0] as f64 > LEAST_INSIDE * windows[1] as f64,
            "{class:?}, still: {windows:?}"
        );
        assert!(
            windows[2] as f64 > 0.8 * windows[3] as f64,
            "{class:?}, moving: {windows:?}"
        );
    }
}

/// Steps of a vehicle whose blades flap, in wind.
fn flapping(moment_n_s: f64, n: usize, seed: u64) -> Vec<FaultCase> {
    let mut all = cases(Class::Step, n, seed);
    for (round, case) in all.iter_mut().enumerate() {
        case.flight = ["waypoint", "hover"][round % 2].to_owned();
        let more = [
            format!("flapping-moment:moment_n_s={moment_n_s}"),
            "wind:north_m_s=4,east_m_s=-3".to_owned(),
            "gusts:rms_m_s=1,correlation_s=2".to_owned(),
        ];
        let more = more.iter().map(|text| Hidden::parse(text).expect("an effect"));
        case.effects.extend(more);
    }
    all
}

#[test]
fn val_the_moment_of_flapping_blades_is_not_taken_for_a_rotor() {
    // Before it was a regressor, a healthy rotor was named in 5 of these, and 10,199 windows had a verdict with a size.
    let rows: Vec<FaultRow> = flapping(0.006, 24, 5)
        .iter()
        .map(|case| scored(case, &windows(case)))
        .collect();
    let named = rows.iter().filter(|row| row.healthy_named).count();
    let alarms: usize = rows.iter().map(|row| row.false_alarms).sum();
    assert!(
        named <= 1 && alarms == 0,
        "a healthy rotor named in {named} of 24, {alarms} alarms"
    );
    let [inside, of] = rows.iter().fold([0, 0], |[inside, of], row| {
        [inside + row.still.inside, of + row.still.of]
    });
    assert!(of > 10_800, "{of} windows with a size");
    assert!(inside as f64 > 0.95 * of as f64, "{inside} of {of} windows inside");
}

/// Rotor 3 loses thrust over `ramp_s` from 20 s on.
fn slow_ramp(flight: &str, share: f64, ramp_s: f64, seed: u64) -> FaultCase {
    let mut case = cases(Class::Healthy, 1, seed)[0].clone();
    case.class = Class::Ramp;
    case.flight = flight.to_owned();
    let fault = format!("rotor-thrust-scale:share=-{share},rotor=3,onset_s=20,ramp_s={ramp_s}");
    case.effects = vec![Hidden::parse(&fault).expect("an effect")];
    case
}

#[test]
fn regress_a_loss_that_grows_slowly_is_named_in_a_hover() {
    // The engine's filters follow it: over 15 s and more it was "healthy" to the end, over 8 s named after 7.
    for (share, ramp_s) in [(0.1, 8.0), (0.1, 15.0), (0.1, 30.0), (0.05, 20.0)] {
        for flight in ["hover", "waypoint"] {
            let case = slow_ramp(flight, share, ramp_s, 5);
            let row = scored(&case, &windows(&case));
            assert_eq!(
                (row.end, row.inside, row.healthy_named, row.false_alarms),
                (Some(End::Right), Some(true), false, 0),
                "{flight}, {share} over {ramp_s} s: {row:?}"
            );
            assert!(
                row.past_announced_s.is_some_and(|seconds| seconds <= 3.0),
                "{flight}, {share} over {ramp_s} s: {:?}",
                row.past_announced_s
            );
        }
    }
}

#[test]
fn val_what_looks_alike_is_a_set_and_no_healthy_rotor_is_named() {
    for (class, wanted) in [
        (Class::Gain, &[End::InSet][..]),
        (Class::ThreeRotors, &[End::InSet]),
        (Class::LoadDropped, &[End::Right, End::Open]),
    ] {
        let rows = judged(class, 12, 5);
        let good = ends(&rows, wanted);
        let named = rows.iter().filter(|row| row.healthy_named).count();
        assert!(
            good >= 11 && named == 0,
            "{class:?}: {good} of 12 ends are {wanted:?}, {named} flights name a healthy rotor"
        );
    }
}

#[test]
fn val_a_flight_in_gusts_has_one_alarm_at_most() {
    // Two of these fourteen meet gusts that the calibration did not have; each was four alarms.
    let rows = judged(Class::FiveHealthy, 14, 8801);
    let alarms: Vec<usize> = rows.iter().map(|row| row.false_alarms).collect();
    assert!(
        alarms.iter().all(|count| *count <= 1) && alarms.iter().sum::<usize>() <= 2,
        "{alarms:?}"
    );
}

#[test]
fn regress_a_model_that_fails_raises_no_alarm() {
    // Each was an alarm: a name reported immediately, one after 5 s in the air, sets; vortex rings, thrust curves of
    // another shape, lags, latencies.
    let fresh = cases(Class::FiveHealthy, 80, 27182);
    for round in [25, 47, 49, 53, 63, 65] {
        let row = scored(&fresh[round], &windows(&fresh[round]));
        assert_eq!(
            (row.false_alarms, row.healthy_named),
            (0, false),
            "{round}: {:?}",
            row.case
        );
    }
}

/// The figures of docs/detector.md of classes flown by hand: `ROTORTWIN_FAULTS_CLASS` (five-healthy, five-step), `ROTORTWIN_FAULTS_N` flights of each,
/// `ROTORTWIN_FAULTS_SEED`, `ROTORTWIN_FAULTS_S` seconds each.
#[test]
#[ignore = "a measurement: cargo test --release -p rotortwin-fdi-session --test foreign_world -- --ignored --nocapture bench_classes"]
fn bench_classes() {
    let of = |name: &str, default: &str| std::env::var(name).unwrap_or_else(|_| default.to_owned());
    let number = |name: &str, default: &str| of(name, default).parse::<usize>().expect("a number");
    let (n, seed) = (
        number("ROTORTWIN_FAULTS_N", "100"),
        number("ROTORTWIN_FAULTS_SEED", "1"),
    );
    let duration_s = number("ROTORTWIN_FAULTS_S", "60") as f64;
    for class in of("ROTORTWIN_FAULTS_CLASS", "five-healthy,five-step").split(',') {
        let class: Class = serde_json::from_value(json!(class)).expect("a class");
        let all = cases_of(class, n, seed as u64, duration_s);
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let rows: Vec<FaultRow> = std::thread::scope(|scope| {
            let parts = all.chunks(all.len().div_ceil(cores).max(1));
            let parts: Vec<_> = parts
                .map(|part| {
                    // A flight that the pilot loses four times counts nowhere.
                    let judge = |case: &FaultCase| {
                        let windows = windows_of(&fly_case(case).ok()?);
                        let row = scored(case, &windows);
                        list("", case, &row, &windows);
                        Some(row)
                    };
                    scope.spawn(move || part.iter().filter_map(judge).collect::<Vec<_>>())
                })
                .collect();
            parts
                .into_iter()
                .flat_map(|part| part.join().expect("judged"))
                .collect()
        });
        println!("{}", faults_sheet::text(&faults_sheet::sum_up(&rows)));
    }
}

/// The benefit of healthy flights of a vehicle for the detectors: five unknown effects, the same on three healthy days
/// with other weather and on the day of the fault. Printed without and with what was learnt: `ROTORTWIN_FAULTS_N`
/// vehicles of each class, `ROTORTWIN_FAULTS_SEED`, `ROTORTWIN_FAULTS_LOSS` (share; otherwise 5 to 10 %),
/// `ROTORTWIN_FAULTS_CLASS`, `ROTORTWIN_FAULTS_ONLY` (indices of cases, as `ROTORTWIN_FAULTS_LIST` prints them).
#[test]
#[ignore = "a measurement: cargo test --release -p rotortwin-fdi-session --test foreign_world -- --ignored --nocapture bench_learnt"]
fn bench_learnt() {
    let of = |name: &str| std::env::var(name).ok();
    let n = of("ROTORTWIN_FAULTS_N").map_or(50, |n| n.parse().expect("a number"));
    let seed = of("ROTORTWIN_FAULTS_SEED").map_or(1, |seed| seed.parse().expect("a number"));
    let loss: Option<f64> = of("ROTORTWIN_FAULTS_LOSS").map(|loss| loss.parse().expect("a share"));
    let classes = of("ROTORTWIN_FAULTS_CLASS").unwrap_or_else(|| "five-healthy,five-step".to_owned());
    for class in classes.split(',') {
        let class: Class = serde_json::from_value(json!(class)).expect("a class");
        let mut all = cases(class, n, seed);
        if let Some(only) = of("ROTORTWIN_FAULTS_ONLY") {
            all.retain(|case| only.split(',').any(|index| index.parse() == Ok(case.index)));
        }
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let rows: Vec<[FaultRow; 2]> = std::thread::scope(|scope| {
            let parts = all.chunks(all.len().div_ceil(cores).max(1));
            let parts: Vec<_> = parts
                .map(|part| {
                    scope.spawn(move || {
                        part.iter()
                            .filter_map(|case| without_and_with(case, loss))
                            .collect::<Vec<_>>()
                    })
                })
                .collect();
            parts
                .into_iter()
                .flat_map(|part| part.join().expect("judged"))
                .collect()
        });
        for (with, words) in ["the model alone", "after three healthy flights"].iter().enumerate() {
            let rows: Vec<FaultRow> = rows.iter().map(|row| row[with].clone()).collect();
            println!(
                "{words}, {} vehicles\n{}",
                rows.len(),
                faults_sheet::text(&faults_sheet::sum_up(&rows))
            );
        }
    }
}

/// A case scored by detectors that know the model, and by those that have learnt from three healthy days; nothing where a pilot loses one of the flights four times.
fn without_and_with(case: &FaultCase, loss: Option<f64>) -> Option<[FaultRow; 2]> {
    let mut case = case.clone();
    if let Some(loss) = loss {
        for effect in case
            .effects
            .iter_mut()
            .filter(|effect| effect.id == "rotor-thrust-scale")
        {
            effect.parameters.insert("share".to_owned(), -loss);
        }
    }
    let today = fly_case(&case).ok()?;
    let days: Option<Vec<Vec<Row>>> = other_days(&case, 3).iter().map(|day| fly_case(day).ok()).collect();
    let learnt = learnt_from(&days?);
    let mut session = FdiSession::with_learnt(detectors().config(), 1, &learnt).expect("a good configuration");
    let of = [
        ("the model alone", windows_of(&today)),
        ("learnt", fed(&mut session, &today)),
    ];
    Some(of.map(|(detector, windows)| {
        let row = scored(&case, &windows);
        list(detector, &case, &row, &windows);
        row
    }))
}

/// Prints a flight whose verdicts are amiss, if `ROTORTWIN_FAULTS_LIST` is set: how its windows were judged before the onset and in the ten seconds
/// after it, and, where a rotor was blamed wrongly, every change of the verdict.
fn list(detector: &str, case: &FaultCase, row: &FaultRow, windows: &[Window]) {
    let fault = case.effects.iter().find(|effect| effect.id == "rotor-thrust-scale");
    let onset_s = fault.and_then(|effect| effect.onset_s);
    let missed = onset_s.is_some() && row.first_s.is_none_or(|seconds| seconds > 10.0);
    if std::env::var_os("ROTORTWIN_FAULTS_LIST").is_none()
        || !(missed || row.false_alarms > 0 || row.healthy_named || row.inside == Some(false))
    {
        return;
    }
    let onset = onset_s.unwrap_or(f64::INFINITY);
    let tally = |from_s: f64, to_s: f64| {
        let mut counts = std::collections::BTreeMap::<String, usize>::new();
        for window in windows
            .iter()
            .filter(|window| (from_s..to_s).contains(&seconds(window)))
        {
            let word = match (&window.obstacle, window.report.sequential) {
                (Some(obstacle), _) => format!("{obstacle:?}")
                    .split([' ', '('])
                    .next()
                    .unwrap_or_default()
                    .to_owned(),
                (None, code) => code.to_string(),
            };
            *counts.entry(word).or_default() += 1;
        }
        counts
    };
    let rotor = fault.and_then(|effect| effect.rotor).unwrap_or(1);
    let smallest = windows
        .iter()
        .filter(|window| (onset..onset + 10.0).contains(&seconds(window)))
        .filter_map(|window| window.smallest_loss.get(rotor - 1));
    let smallest: Vec<f32> = smallest.copied().collect();
    let mean = smallest.iter().sum::<f32>() / smallest.len().max(1) as f32;
    println!(
        "{detector} #{} {:?} {} seed {} rotor {rotor} onset {onset:.1}: first {:?} end {:?} inside {:?} named {} alarms {}; smallest {mean:.3}; before {:?}; after \
         {:?}; {:?}",
        case.index,
        case.class,
        case.flight,
        case.seed,
        row.first_s,
        row.end,
        row.inside,
        row.healthy_named,
        row.false_alarms,
        tally(0.0, onset),
        tally(onset, onset + 10.0),
        case.effects
            .iter()
            .map(|effect| {
                format!(
                    "{} {:?} {:?}",
                    effect.id,
                    effect.parameters.values().collect::<Vec<_>>(),
                    effect.profile
                )
            })
            .collect::<Vec<_>>()
    );
    let mut before = None;
    for window in windows.iter().filter(|_| row.healthy_named || row.false_alarms > 0) {
        let now = (window.report.sequential, window.obstacle.is_some());
        if before != Some(now) {
            let report = &window.report;
            let loss = report.thrust_loss;
            println!(
                "    {:.3} s: {} p {:.3} [{:.3}, {:.3}] sets {:?} {}",
                seconds(window),
                report.sequential,
                report.sequential_probability,
                loss.share_low,
                loss.share_high,
                &report.hypothesis_rotors[..report.hypothesis_count as usize],
                window
                    .obstacle
                    .map_or_else(String::new, |obstacle| obstacle.to_string())
            );
        }
        before = Some(now);
    }
}

#[test]
fn val_three_healthy_flights_make_an_unknown_vehicle_better_known() {
    let rows: Vec<[FaultRow; 2]> = cases(Class::FiveStep, 12, 4031)
        .iter()
        .filter_map(|case| without_and_with(case, Some(0.05)))
        .collect();
    assert!(rows.len() >= 9, "{} flights", rows.len());
    for row in rows.as_flattened() {
        assert!(!row.healthy_named && row.false_alarms == 0, "{:?}", row.case);
    }
    // Strictly: a learner that learns nothing, or learns and changes nothing, fails each of these.
    let count = |is: &dyn Fn(&FaultRow) -> bool| [0, 1].map(|with| rows.iter().filter(|row| is(&row[with])).count());
    let found = count(&|row| row.first_s.is_some_and(|s| s <= 2.5));
    // Of those named at the end: a flight that ends ambiguous has no interval.
    let outside = count(&|row| row.inside == Some(false));
    assert!(
        found[1] > found[0] && found[1] + 2 >= rows.len(),
        "found {found:?} of {}",
        rows.len()
    );
    let inside = count(&|row| row.inside == Some(true));
    assert!(
        outside[0] > 0 && outside[1] == 0 && inside[1] >= inside[0],
        "inside {inside:?}, outside {outside:?} of {}",
        rows.len()
    );
    let windows = [0, 1].map(|with| {
        let still = rows.iter().map(|row| row[with].still);
        let [hold, of] = still.fold([0, 0], |[hold, of], count| [hold + count.inside, of + count.of]);
        hold as f64 / of as f64
    });
    assert!(windows[1] > windows[0] + 0.03, "windows inside {windows:?}");
}

/// One hidden effect on all days, and nothing else.
fn with_one_effect(text: &str) -> [FaultCase; 2] {
    let mut case = cases(Class::Healthy, 1, 60)[0].clone();
    case.effects = vec![Hidden::parse(text).expect("an effect")];
    let mut faulty = case.clone();
    faulty.class = Class::Step;
    faulty.flight = "waypoint".to_owned();
    let fault = "rotor-thrust-scale:share=-0.05,rotor=2,onset_s=22";
    faulty.effects.push(Hidden::parse(fault).expect("an effect"));
    [case, faulty]
}

fn learnt_of(case: &FaultCase) -> Learnt {
    let days: Vec<Vec<Row>> = other_days(case, 3)
        .iter()
        .map(|day| fly_case(day).expect("flown"))
        .collect();
    learnt_from(&days)
}

#[test]
fn val_an_inertia_that_is_off_is_learnt() {
    for (text, expected) in [
        ("inertia-roll:share=0.3", [1.3, 1.0, 1.0]),
        ("inertia-pitch:share=-0.2", [1.0, 0.8, 1.0]),
    ] {
        let learnt = learnt_of(&with_one_effect(text)[0]);
        let inertia = learnt.inertia();
        for axis in 0..3 {
            assert!((inertia[axis] - expected[axis]).abs() < 0.05, "{text}: {inertia:?}");
        }
    }
}

#[test]
fn val_a_moment_of_the_blown_rotors_is_learnt_and_a_smaller_loss_would_be_seen() {
    // The detectors have a regressor for it, whose size they have to learn anew in every flight.
    let [healthy, faulty] = with_one_effect("flapping-moment:moment_n_s=0.012");
    let today = fly_case(&faulty).expect("flown");
    let mut session =
        FdiSession::with_learnt(detectors().config(), 1, &learnt_of(&healthy)).expect("a good configuration");
    let [without, with] = [windows_of(&today), fed(&mut session, &today)];
    let smallest = |windows: &[Window]| {
        let before = windows.iter().filter(|window| seconds(window) < 22.0);
        let smallest: Vec<f64> = before
            .filter_map(|window| window.smallest_loss.get(1).map(|share| f64::from(*share)))
            .collect();
        smallest.iter().sum::<f64>() / smallest.len() as f64
    };
    let [model, learnt] = [&without, &with].map(|windows| smallest(windows));
    assert!(learnt < 0.8 * model && model > 0.035, "{model:.3} → {learnt:.3}");
    let [model, learnt] = [&without, &with].map(|windows| scored(&faulty, windows));
    assert!(
        learnt.still.of > model.still.of + 30 && learnt.inside == Some(true),
        "{model:?} → {learnt:?}"
    );
}

#[test]
fn prop_a_vehicle_that_is_its_model_teaches_nothing() {
    let case = &cases(Class::Step, 1, 12)[0];
    let days: Vec<Vec<Row>> = other_days(case, 3)
        .iter()
        .map(|day| fly_case(day).expect("flown"))
        .collect();
    let learnt = learnt_from(&days);
    assert_eq!(learnt.flights, 3);
    assert!(learnt.seconds > 100.0, "{learnt:?}");
    let today = fly_case(case).expect("flown");
    let mut session = FdiSession::with_learnt(detectors().config(), 1, &learnt).expect("a good configuration");
    let [without, with] = [windows_of(&today), fed(&mut session, &today)].map(|windows| scored(case, &windows));
    assert_eq!(
        (with.end, with.inside, with.false_alarms),
        (without.end, without.inside, 0)
    );
}

/// What healthy flights reveal about a vehicle.
fn learnt_from(flights: &[Vec<Row>]) -> Learnt {
    let config = *detectors().config();
    let mut learner = Learner::new(&config);
    for rows in flights {
        let mut session = FdiSession::new(config, 1)
            .expect("a good configuration")
            .that_learns(learner);
        fed(&mut session, rows);
        learner = session.into_learner().expect("it learns");
    }
    learner.learnt().expect("long enough")
}

#[test]
fn val_a_recovery_is_released_within_a_second() {
    let rows = judged(Class::Recovery, 12, 5);
    let released = rows
        .iter()
        .filter(|row| row.released_s.is_some_and(|seconds| seconds <= 1.0))
        .count();
    assert!(released >= 11, "{released} of 12");
}

#[test]
fn val_a_loss_of_the_size_that_would_be_seen_is_seen() {
    // What was announced before the onset is lost then: flown once to hear it, once with it.
    let (mut announced, mut found, mut half_found) = (0, 0, 0);
    for case in cases(Class::Step, 12, 5) {
        let (rotor, onset_s) = (
            case.effects[0].rotor.expect("a rotor"),
            case.effects[0].onset_s.expect("an onset"),
        );
        let time_s = |window: &Window| window.report.stamp.sim_time_ns as f64 * 1e-9;
        let before = windows(&case);
        let before = before
            .iter()
            .rfind(|window| time_s(window) < onset_s)
            .expect("a window");
        let Some(smallest) = before.smallest_loss.get(rotor - 1) else {
            continue;
        };
        announced += 1;
        let is_found = |share: f64| {
            let mut case = case.clone();
            case.effects[0].parameters.insert("share".to_owned(), -share);
            windows(&case).iter().any(|window| {
                (onset_s..onset_s + 10.0).contains(&time_s(window)) && window.report.sequential == rotor as i32
            })
        };
        found += usize::from(is_found(f64::from(*smallest)));
        half_found += usize::from(is_found(0.5 * f64::from(*smallest)));
    }
    assert!(announced >= 11, "{announced} of 12 flights announce a size");
    assert!(
        found + 1 >= announced,
        "{found} of {announced} losses of the announced size are found"
    );
    // Nor is the size merely cautious.
    assert!(
        half_found <= announced / 2,
        "{half_found} of {announced} losses of half the size are found"
    );
}

/// How often the truth is among the reported explanations, and its sizes inside their intervals.
#[derive(Clone, Copy, Debug, Default)]
struct Told {
    /// Windows with a verdict other than healthy, from a second after the onset on.
    windows: usize,
    /// With the truth among the explanations.
    listed: usize,
    /// First of them.
    first: usize,
    /// With all its sizes inside.
    inside: usize,
    /// With a rate, while a loss moves and is named; with its rate inside; which are said to move.
    moving: [usize; 3],
    /// With a rate, while a loss stands and is named; with 0 inside; which are said to move.
    still: [usize; 3],
}

impl Told {
    fn and(mut self, other: Self) -> Self {
        self.windows += other.windows;
        self.listed += other.listed;
        self.first += other.first;
        self.inside += other.inside;
        for k in 0..3 {
            self.moving[k] += other.moving[k];
            self.still[k] += other.still[k];
        }
        self
    }
}

fn holds(interval: &Interval, truth: f64) -> bool {
    f64::from(interval.low) <= truth && truth <= f64::from(interval.high)
}

/// The report on a flight with faults of one onset, next to the truth.
fn told(case: &FaultCase, windows: &[Window]) -> Told {
    let of = |id: &'static str| case.effects.iter().filter(move |effect| effect.id == id);
    let onset_s = case.effects[0].onset_s.expect("an onset");
    let parameter = |effect: &Hidden| effect.parameters["share"];
    let mut rotors: Vec<(usize, f64, &Hidden)> = of("rotor-thrust-scale")
        .map(|effect| (effect.rotor.expect("a rotor"), -parameter(effect), effect))
        .collect();
    rotors.sort_by_key(|(rotor, ..)| *rotor);
    let mask = rotors.iter().fold(0, |mask, (rotor, ..)| mask | 1 << (rotor - 1));
    let is_gain = rotors.iter().all(|(_, share, _)| *share < 0.0);
    let drag = of("rotor-moment-ratio").next().map(parameter);
    let is_truth = |e: &Explained| {
        e.rotors == mask
            && match e.kind {
                ExplanationKind::Gain => is_gain,
                ExplanationKind::LossWithDrag => !is_gain && drag.is_some(),
                ExplanationKind::Loss => !is_gain && drag.is_none(),
                ExplanationKind::Load => false,
            }
    };
    let mut told = Told::default();
    for window in windows.iter().filter(|window| seconds(window) > onset_s + 1.0) {
        let share = |(_, share, effect): &(usize, f64, &Hidden)| {
            let factor = effect
                .profile
                .map_or(1.0, |profile| profile.factor(seconds(window) - onset_s));
            share.abs() * factor
        };
        let explanations = &window.details.explanations;
        if explanations.is_empty() {
            continue;
        }
        told.windows += 1;
        if let Some(place) = explanations.iter().position(is_truth) {
            let found = &explanations[place];
            told.listed += 1;
            told.first += usize::from(place == 0);
            let sizes = found
                .shares
                .iter()
                .zip(&rotors)
                .all(|(told, truth)| holds(told, share(truth)));
            let drags = drag.is_none_or(|drag| found.drag.is_some_and(|told| holds(&told, drag)));
            told.inside += usize::from(sizes && drags);
        }
        let Some(Profile::Ramp { ramp_s }) = rotors[0].2.profile else {
            continue;
        };
        if let [motion] = window.details.motion[..]
            && window.report.sequential == rotors[0].0 as i32
        {
            let since_s = seconds(window) - onset_s;
            let (count, rate) = if since_s < ramp_s {
                (&mut told.moving, rotors[0].1 / ramp_s)
            } else if since_s > ramp_s + 4.5 {
                (&mut told.still, 0.0)
            } else {
                continue;
            };
            count[0] += 1;
            count[1] += usize::from(holds(&motion.rate_1_s, rate));
            count[2] += usize::from(motion.moves);
        }
    }
    told
}

/// Flights of a class: the report on each. Ramps of 5 and 20 s only, so that there is a rate.
fn told_of(class: Class, n: usize, seed: u64) -> Vec<Told> {
    let slow = |case: &&FaultCase| match case.effects[0].profile {
        Some(Profile::Ramp { ramp_s }) => ramp_s > 2.0,
        _ => true,
    };
    let flights = cases(class, n, seed);
    flights
        .iter()
        .filter(slow)
        .map(|case| told(case, &windows(case)))
        .collect()
}

const KINDS: [Class; 5] = [
    Class::Step,
    Class::Gain,
    Class::BladeDrag,
    Class::Ramp,
    Class::TwoRotors,
];

/// The figures of docs/detector.md of kinds and sizes: `ROTORTWIN_FAULTS_N` flights of each class, `ROTORTWIN_FAULTS_SEED`.
#[test]
#[ignore = "a measurement: cargo test --release -p rotortwin-fdi-session --test foreign_world -- --ignored --nocapture bench_kinds"]
fn bench_kinds() {
    let number =
        |name: &str, default: usize| std::env::var(name).map_or(default, |text| text.parse().expect("a number"));
    let (n, seed) = (number("ROTORTWIN_FAULTS_N", 24), number("ROTORTWIN_FAULTS_SEED", 1));
    for class in KINDS {
        let flights = told_of(class, n, seed as u64);
        let all = flights.iter().fold(Told::default(), |sum, told| sum.and(*told));
        let most = |of: fn(&Told) -> usize, over: fn(&Told) -> usize| {
            let good = flights.iter().filter(|told| 2 * of(told) > over(told)).count();
            let share = Share::new(good, flights.len());
            format!(
                "{good}/{} [{:.0}, {:.0}]",
                share.of,
                100.0 * share.low,
                100.0 * share.high
            )
        };
        println!(
            "{class:?}: most windows list it {}, first {}, sizes inside {}; windows {} listed {} first {} inside {}; moving {:?}, still {:?}",
            most(|told| told.listed, |told| told.windows),
            most(|told| told.first, |told| told.windows),
            most(|told| told.inside, |told| told.listed),
            all.windows,
            all.listed,
            all.first,
            all.inside,
            all.moving,
            all.still
        );
    }
}

#[test]
fn val_what_happened_to_a_rotor_is_told_by_kind_with_its_size() {
    for class in KINDS {
        let flights = told_of(class, 12, 5);
        let all = flights.iter().fold(Told::default(), |sum, told| sum.and(*told));
        let listed = flights.iter().filter(|told| 2 * told.listed > told.windows).count();
        let least = if class == Class::Ramp {
            3 * flights.len() / 4
        } else {
            flights.len() - 1
        };
        assert!(
            !flights.is_empty() && listed >= least,
            "{class:?}: told in {listed} of {} flights",
            flights.len()
        );
        assert!(
            10 * all.first > 8 * all.listed && all.inside as f64 > LEAST_INSIDE * all.listed as f64,
            "{class:?}: {all:?}"
        );
        if class == Class::Ramp {
            let [windows, inside, moves] = all.moving;
            assert!(windows > 100 && 2 * moves > windows, "{all:?}");
            assert!(inside as f64 > LEAST_INSIDE * windows as f64, "{all:?}");
            let [windows, inside, moves] = all.still;
            assert!(windows > 100 && 20 * moves < windows, "{all:?}");
            assert!(inside as f64 > LEAST_INSIDE * windows as f64, "{all:?}");
        }
    }
}
