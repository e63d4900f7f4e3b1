//! What sessions say of faults in the independent generator's world. Shares are asserted with room for chance, at fixed seeds; figures with
//! intervals come from `rotortwin blind --preset faults`.

use rotortwin_blind::bench::faults::{Class, End, FaultCase, FaultRow, draw_cases, fly_case, other_days, score};
use rotortwin_blind::bench::faults_sheet;
use rotortwin_blind::flight::Row;
use rotortwin_fdi_session::{Chunk, FdiSession, Learner, Learnt, Sample, Window};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_scenario::{DetectorSettings, Detectors, VehicleDocuments};
use serde_json::json;

const VEHICLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/vehicles/f550.toml");
/// Of an interval that is promised to hold 95 %, next to the chance of so few flights.
const LEAST_INSIDE: f64 = 0.88;

fn cases(class: Class, n: usize, seed: u64) -> Vec<FaultCase> {
    cases_of(class, n, seed, 60.0)
}

fn cases_of(class: Class, n: usize, seed: u64, duration_s: f64) -> Vec<FaultCase> {
    let cases = draw_cases(n, seed, duration_s, &[(VEHICLE.to_owned(), 6)]);
    cases.into_iter().filter(|case| case.class == class).collect()
}

/// What a session says of a flight.
fn windows(case: &FaultCase) -> Vec<Window> {
    windows_of(&fly_case(case).expect("flown"))
}

fn windows_of(rows: &[Row]) -> Vec<Window> {
    fed(&mut FdiSession::new(*detectors().config(), 1).expect("a good configuration"), rows)
}

/// The same, scored.
fn judged(class: Class, n: usize, seed: u64) -> Vec<FaultRow> {
    cases(class, n, seed)
        .iter()
        .map(|case| scored(case, &windows(case)))
        .collect()
}

fn scored(case: &FaultCase, windows: &[Window]) -> FaultRow {
    let views: Vec<_> = windows.iter().map(view).collect();
    let report = json!({ "log": { "start_s": 0.0 }, "windows": views });
    score(case, &report.to_string()).expect("scored")
}

fn sample(row: &Row) -> Sample {
    let numbers = |v: [f64; 3]| v.map(|x| x as f32);
    let mut duty = [0.0; MAX_ROTORS];
    for (to, from) in duty.iter_mut().zip(&row.duties) {
        *to = (*from as f32).clamp(0.0, 1.0);
    }
    Sample {
        position_ned_m: numbers(row.position.into()),
        velocity_ned_m_s: numbers(row.velocity.into()),
        attitude_rad: numbers(row.euler.into()),
        body_rates_rad_s: numbers(row.rates.into()),
        duty,
        battery_voltage_v: row.voltage as f32,
        time_s: None,
    }
}

/// As `fdi-log --windows` writes it.
fn view(window: &Window) -> serde_json::Value {
    let report = &window.report;
    let code = if window.obstacle.is_some() {
        -4
    } else {
        report.sequential
    };
    let rotors = match code {
        1..100 => vec![code],
        100.. => vec![code / 100, code % 100],
        _ => vec![],
    };
    let losses = rotors.iter().zip([report.thrust_loss, report.second_thrust_loss]);
    let losses = losses
        .map(|(rotor, loss)| json!({ "rotor": rotor, "share_low": loss.share_low, "share_high": loss.share_high }));
    let sets = report.hypothesis_rotors.iter().take(report.hypothesis_count as usize);
    let sets = sets.map(|mask| {
        (1..=16)
            .filter(|rotor| mask >> (rotor - 1) & 1 == 1)
            .collect::<Vec<u32>>()
    });
    json!({
        "smallest_loss": window.smallest_loss,
        "time_s": report.stamp.sim_time_ns as f64 * 1e-9,
        "sequential": {
            "code": code,
            "probability": report.sequential_probability,
            "thrust_loss": losses.collect::<Vec<_>>(),
            "hypotheses": sets.collect::<Vec<_>>(),
        },
    })
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

#[test]
fn val_what_looks_alike_is_a_set_and_no_healthy_rotor_is_named() {
    for (class, wanted) in [
        (Class::Gain, [End::InSet, End::Open]),
        (Class::ThreeRotors, [End::InSet, End::Open]),
        (Class::LoadDropped, [End::Right, End::Open]),
    ] {
        let rows = judged(class, 12, 5);
        let good = ends(&rows, &wanted);
        let named = rows.iter().filter(|row| row.healthy_named).count();
        assert!(
            good >= 11 && named <= 1,
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
    // Each was an alarm: a name at once, one after 5 s in the air, sets; vortex rings, thrust curves of another shape, lags, latencies.
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
#[ignore = "a measurement: cargo test --release -p rotortwin-fdi-session --test foreign_world -- --ignored --nocapture bench_"]
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
                    let judge = |case: &FaultCase| Some(scored(case, &windows_of(&fly_case(case).ok()?)));
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

#[test]
#[ignore]
fn explore() {
    let of = |name: &str, default: &str| std::env::var(name).unwrap_or_else(|_| default.to_owned());
    let n: usize = of("N", "60").parse().unwrap();
    let seed: u64 = of("SEED", "777").parse().unwrap();
    let loss: f64 = of("LOSS", "0.05").parse().unwrap();
    let verbose = of("VERBOSE", "") != "";
    let all = cases_of(if loss == 0.0 { Class::FiveHealthy } else { Class::FiveStep }, n, seed, 60.0);
    let cores = 2;
    let totals = std::sync::Mutex::new([[0.0f64; 8]; 2]);
    std::thread::scope(|scope| {
        for part in all.chunks(all.len().div_ceil(cores)) {
            let totals = &totals;
            scope.spawn(move || {
                for case in part {
                    let mut case = case.clone();
                    let last = case.effects.len() - 1;
                    if loss != 0.0 {
                        case.effects[last].parameters.insert("share".into(), -loss);
                    }
                    let Ok(rows) = fly_case(&case) else { continue };
                    let days: Vec<_> = other_days(&case, 3).iter().filter_map(|c| fly_case(c).ok()).collect();
                    if days.len() < 3 { continue; }
                    let (detectors, learnt) = learnt_from(&days);
                    let ids: Vec<String> = case.effects.iter().map(|e| e.id.clone()).collect();
                    let mut text = format!("case {} {} {ids:?}\n", case.index, case.flight);
                    if verbose { text += &format!("{learnt:?}\n"); }
                    for with in [false, true] {
                        let mut session = if with { FdiSession::with_learnt(detectors.config(), 1, &learnt) } else { FdiSession::new(*detectors.config(), 1) }.unwrap();
                        let mut w = fed(&mut session, &rows[..6000]);
                        let middle = session.debug();
                        for (part, rows) in rows[6000..].chunks(1000).enumerate() {
                            let chunk = Chunk { first_step: 6000 + 1000 * part as u64, after_gap: false, samples: rows.iter().map(sample).collect() };
                            w.extend(session.feed(&chunk).expect("taken").windows);
                        }
                        let mut why: std::collections::BTreeMap<String, usize> = Default::default();
                        for w in &w { if let Some(o) = w.obstacle { *why.entry(o.to_string().chars().take(25).collect()).or_default() += 1; } }
                        let row = scored(&case, &w);
                        let found = row.first_s.is_some_and(|s| s <= 10.0);
                        {
                            let mut t = totals.lock().unwrap();
                            let t = &mut t[usize::from(with)];
                            t[0] += 1.0; t[1] += f64::from(u8::from(found)); t[2] += row.false_alarms as f64; t[3] += row.healthy_s; t[4] += f64::from(u8::from(row.healthy_named));
                            if let Some(inside) = row.inside { t[5] += 1.0; t[6] += f64::from(u8::from(inside)); }
                            t[7] += row.decided_s;
                        }
                        let f = &case.effects[last];
                        let onset = f.onset_s.unwrap_or(20.0);
                        let t_of = |w: &Window| w.report.stamp.sim_time_ns as f64 * 1e-9;
                        let small = w.iter().rfind(|w| t_of(w) < onset).and_then(|w| w.smallest_loss.get(f.rotor.unwrap_or(1).saturating_sub(1)).copied()).unwrap_or(-1.0);
                        let lastw = w.last().map(|w| w.report.thrust_loss);
                        text += &format!("   {} found {found} first {:?} inside {:?} end {:?} fa {} hn {} small {small:.3} decided {:.0} last {:?}\n",
                            if with { "LEARNT" } else { "before" }, row.first_s, row.inside, row.end, row.false_alarms, row.healthy_named, row.decided_s,
                            lastw.map(|l| [l.share_low, l.share, l.share_high]));
                        text += &format!("      {middle}; why {why:?}\n");
                        if (!found && loss != 0.0 && with) && verbose {
                            for w in w.iter().step_by(8) {
                                let t = w.report.stamp.sim_time_ns as f64 * 1e-9;
                                if t > onset - 1.0 && t < onset + 10.0 {
                                    text += &format!(
                                        "      {:.1} engine {} p {:.2} said {} {:?} share {:.3} small {:.3}\n",
                                        t - onset, w.engine.sequential, w.engine.sequential_probability, w.report.sequential,
                                        w.obstacle.map(|o| o.to_string().chars().take(40).collect::<String>()),
                                        w.report.thrust_loss.share,
                                        w.smallest_loss.get(f.rotor.unwrap() - 1).copied().unwrap_or(-1.0)
                                    );
                                }
                            }
                        }
                    }
                    print!("{text}");
                }
            });
        }
    });
    for (t, name) in totals.lock().unwrap().iter().zip(["before", "learnt"]) {
        println!("TOTAL {name}: n {} found {} alarms {} healthy_s {} named {} inside {}/{} decided {:.0}", t[0], t[1], t[2], t[3], t[4], t[6], t[5], t[7]);
    }
}

fn detectors() -> Detectors {
    let documents = VehicleDocuments::load(VEHICLE).expect("shipped");
    Detectors::new(documents, &DetectorSettings::default(), None).expect("a good configuration")
}

fn fed(session: &mut FdiSession, rows: &[Row]) -> Vec<Window> {
    let mut windows = Vec::new();
    for (part, rows) in rows.chunks(1000).enumerate() {
        let chunk = Chunk {
            first_step: 1000 * part as u64,
            after_gap: false,
            samples: rows.iter().map(sample).collect(),
        };
        windows.extend(session.feed(&chunk).expect("taken").windows);
    }
    windows
}

/// What healthy flights say of a vehicle.
fn learnt_from(flights: &[Vec<Row>]) -> (Detectors, Learnt) {
    let detectors = detectors();
    let mut learner = Learner::new(detectors.config());
    for rows in flights {
        let mut session = FdiSession::new(*detectors.config(), 1).expect("a good configuration").that_learns(learner);
        fed(&mut session, rows);
        learner = session.into_learner().expect("it learns");
    }
    let learnt = learner.learnt().expect("long enough");
    (detectors, learnt)
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
    // The size is no idle caution either.
    assert!(
        half_found <= announced / 2,
        "{half_found} of {announced} losses of half the size are found"
    );
}
