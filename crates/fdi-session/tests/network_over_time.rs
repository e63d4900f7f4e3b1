//! The improved network over time in flights of the independent generator, in whose world it was not trained. Figures with intervals: docs/detector.md.

#[expect(dead_code, reason = "shared with tests of the sequential detector")]
mod foreign;

use foreign::{VEHICLE, cases_of, fed, seconds};
use rotortwin_blind::bench::faults::{Class, FaultCase, fly_case};
use rotortwin_blind::bench::sheet::Share;
use rotortwin_fdi_session::evidence::Evidence;
use rotortwin_fdi_session::{Calibration, FdiSession, NetworkOverTime, Window};
use rotortwin_flight_core::fdi::FdiConfig;
use rotortwin_flight_core::fdi::verdict_code::NOT_READY;
use rotortwin_scenario::{Classifier, DetectorSettings, Detectors, VehicleDocuments};
use serde_json::json;
use std::path::Path;

/// Detectors with a shipped classifier.
fn config(classifier: &str) -> FdiConfig {
    let path = format!(
        "{}/../../config/classifiers/{classifier}.json",
        env!("CARGO_MANIFEST_DIR")
    );
    let classifier = Classifier::read(Path::new(&path)).expect("shipped");
    let documents = VehicleDocuments::load(VEHICLE).expect("shipped");
    let detectors = Detectors::new(documents, &DetectorSettings::default(), Some(classifier)).expect("they fit");
    *detectors.config()
}

fn windows_with(config: &FdiConfig, case: &FaultCase) -> Option<Vec<Window>> {
    let rows = fly_case(case).ok()?;
    Some(fed(
        &mut FdiSession::new(*config, 1).expect("a good configuration"),
        &rows,
    ))
}

/// How often an alarm begins, of codes of windows; those without a verdict end one.
fn alarms(codes: impl Iterator<Item = i32>) -> usize {
    let mut before = false;
    let mut count = 0;
    for code in codes {
        let alarm = code > 0 || code == -1 || code == -3;
        count += usize::from(alarm && !before);
        before = alarm;
    }
    count
}

/// Rotor from 1, lost share and onset of a case.
fn fault(case: &FaultCase) -> Option<(i32, f64, f64)> {
    let effect = case.effects.iter().find(|effect| effect.id == "rotor-thrust-scale")?;
    Some((effect.rotor? as i32, -*effect.parameters.get("share")?, effect.onset_s?))
}

#[test]
fn val_healthy_flights_alarm_window_by_window_and_not_over_time() {
    let config = config("f550-improved");
    for case in cases_of(Class::Healthy, 4, 41, 60.0) {
        let windows = windows_with(&config, &case).expect("flown");
        let alone = alarms(windows.iter().map(|window| window.report.network));
        assert!(alone > 10, "{alone}: nothing to be improved");
        let over_time = alarms(windows.iter().map(|window| window.network_over_time.code));
        assert_eq!(over_time, 0, "{case:?}");
        let judged: Vec<&NetworkOverTime> = windows
            .iter()
            .map(|window| &window.network_over_time)
            .filter(|said| said.code != NOT_READY)
            .collect();
        // 50 of 60 s, 16 windows a second.
        assert!(judged.len() > 790, "{}", judged.len());
        for said in judged {
            let sum: f32 = said.probability.iter().sum();
            assert!((sum - 1.0).abs() < 1e-5 && said.probability.len() == 7, "{said:?}");
        }
    }
}

#[test]
fn val_a_step_is_named_within_two_seconds_and_released_as_soon_after_it_heals() {
    let config = config("f550-improved");
    for case in cases_of(Class::Recovery, 6, 42, 60.0) {
        let (rotor, share, onset_s) = fault(&case).expect("one fault");
        let windows = windows_with(&config, &case).expect("flown");
        let code_at = |time_s: f64| {
            let window = windows
                .iter()
                .find(|window| seconds(window) >= time_s)
                .expect("within the flight");
            window.network_over_time.code
        };
        assert_eq!(code_at(onset_s - 0.1), 0, "{case:?}");
        assert_eq!(code_at(onset_s + 2.0), rotor, "a loss of {share}: {case:?}");
        assert_eq!(code_at(onset_s + 14.9), rotor, "{case:?}");
        // Damage of 15 s.
        assert_eq!(code_at(onset_s + 17.0), 0, "{case:?}");
    }
}

#[test]
fn val_the_papers_network_says_nothing_over_time() {
    let case = &cases_of(Class::Step, 1, 43, 60.0)[0];
    let windows = windows_with(&config("f550-paper"), case).expect("flown");
    assert!(windows.iter().any(|window| window.report.network > 0));
    assert!(
        windows
            .iter()
            .all(|window| window.network_over_time == NetworkOverTime::NOT_READY)
    );
}

#[test]
fn val_evidence_adds_up_and_numbers_without_bounds_are_left_out() {
    let config = config("f550-improved");
    let mut evidence = Evidence::new(&config).expect("it calibrates itself");
    let quiet = |k: usize| {
        let sign = |bit: usize| if k >> bit & 1 == 0 { 1.0f32 } else { -1.0 };
        [0.002 * sign(0), 0.0004 * sign(1), 0.0004 * sign(2), 0.0002 * sign(3)]
    };
    // Too short a calibration.
    (0..31).for_each(|k| evidence.calibrate(&quiet(k)));
    assert_eq!(evidence.window(&quiet(0)), NetworkOverTime::NOT_READY);
    evidence.restart();
    (0..128).for_each(|k| evidence.calibrate(&quiet(k)));
    assert_eq!(evidence.window(&quiet(0)).code, 0);
    // A loss of rotor 3: up to now it lifted, Fz down, Mx from its place on the right.
    let lost = config
        .geometry
        .wrench_from_thrust(&std::array::from_fn(|rotor| if rotor == 2 { -0.03 } else { 0.0 }));
    let mut named_after = None;
    for k in 0..100 {
        let said = evidence.window(&std::array::from_fn(|axis| quiet(k)[axis] + lost[axis]));
        if said.code == 3 && named_after.is_none() {
            named_after = Some(k);
            assert!(said.of_verdict() > 0.99, "{said:?}");
        }
        assert!(said.code == 0 || said.code == 3, "{said:?}");
    }
    assert!(
        named_after.is_some_and(|k| (4..40).contains(&k)),
        "{named_after:?}: neither one window nor seconds"
    );
    let said = evidence.window(&[f32::NAN, 0.0, 0.0, 0.0]);
    assert_eq!(said.code, 3);
    evidence.hold();
    assert_eq!(evidence.window(&quiet(0)).code, 0);
}

/// Of one flight: the three detectors' alarms before the fault, hours without one, delay to the right name, whether a healthy rotor was named, windows right after the onset, all.
struct Counted {
    alarms: [usize; 3],
    hours: f64,
    found_s: [Option<f64>; 3],
    wrong: [bool; 3],
    right: [usize; 3],
    windows: [usize; 3],
}

fn count(case: &FaultCase, windows: &[Window]) -> Counted {
    let fault = fault(case);
    let onset_s = fault.map_or(f64::INFINITY, |(_, _, onset_s)| onset_s);
    let codes = |window: &Window| match window.obstacle {
        Some(_) => [-4; 3],
        None => [
            window.report.network,
            window.network_over_time.code,
            window.report.sequential,
        ],
    };
    let ready = windows
        .iter()
        .filter(|window| window.calibration == Calibration::Done && window.obstacle.is_none());
    let (before, after): (Vec<&Window>, Vec<&Window>) = ready.partition(|window| seconds(window) < onset_s);
    let (rotor, end_s) = (fault.map_or(0, |(rotor, ..)| rotor), onset_s + 0.0625);
    let after: Vec<&Window> = after.into_iter().filter(|window| seconds(window) > end_s).collect();
    let each = |of: &dyn Fn(usize) -> usize| std::array::from_fn(of);
    Counted {
        alarms: each(&|which| {
            alarms(
                windows
                    .iter()
                    .filter(|window| seconds(window) < onset_s)
                    .map(|window| codes(window)[which]),
            )
        }),
        hours: before.len() as f64 * 0.0625 / 3600.0,
        found_s: std::array::from_fn(|which| {
            let named = after.iter().find(|window| rotor > 0 && codes(window)[which] == rotor);
            named.map(|window| seconds(window) - onset_s)
        }),
        wrong: std::array::from_fn(|which| {
            after
                .iter()
                .any(|window| (1..100).contains(&codes(window)[which]) && codes(window)[which] != rotor)
        }),
        right: each(&|which| after.iter().filter(|window| codes(window)[which] == rotor).count()),
        windows: [after.len(); 3],
    }
}

/// The figures of docs/detector.md: `ROTORTWIN_FAULTS_CLASS` (healthy, step, five-healthy, five-step), `ROTORTWIN_FAULTS_N` flights of each, `ROTORTWIN_FAULTS_SEED`,
/// `ROTORTWIN_FAULTS_S` seconds each, `ROTORTWIN_FAULTS_LOSS` in place of the drawn share.
#[test]
#[ignore = "a measurement: cargo test --release -p rotortwin-fdi-session --test network_over_time -- --ignored --nocapture"]
fn bench_network_over_time() {
    let of = |name: &str, default: &str| std::env::var(name).unwrap_or_else(|_| default.to_owned());
    let number = |name: &str, default: &str| of(name, default).parse::<f64>().expect("a number");
    let (n, seed, duration_s) = (
        number("ROTORTWIN_FAULTS_N", "24") as usize,
        number("ROTORTWIN_FAULTS_SEED", "1") as u64,
        number("ROTORTWIN_FAULTS_S", "60"),
    );
    let loss: Option<f64> = std::env::var("ROTORTWIN_FAULTS_LOSS")
        .ok()
        .map(|loss| loss.parse().expect("a share"));
    let config = config("f550-improved");
    for class in of("ROTORTWIN_FAULTS_CLASS", "healthy,step").split(',') {
        let class: Class = serde_json::from_value(json!(class)).expect("a class");
        let mut cases = cases_of(class, n, seed, duration_s);
        for effect in cases
            .iter_mut()
            .flat_map(|case| &mut case.effects)
            .filter(|effect| effect.id == "rotor-thrust-scale")
        {
            if let Some(loss) = loss {
                effect.parameters.insert("share".to_owned(), -loss);
            }
        }
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let counted: Vec<Counted> = std::thread::scope(|scope| {
            let parts = cases.chunks(cases.len().div_ceil(cores).max(1));
            // A flight that the pilot loses four times counts nowhere.
            let judge = |case: &FaultCase| Some(count(case, &windows_with(&config, case)?));
            let parts: Vec<_> = parts
                .map(|part| scope.spawn(move || part.iter().filter_map(judge).collect::<Vec<_>>()))
                .collect();
            parts
                .into_iter()
                .flat_map(|part| part.join().expect("judged"))
                .collect()
        });
        let hours: f64 = counted.iter().map(|one| one.hours).sum();
        println!(
            "{}: {} flights, {hours:.2} h without a fault",
            class.words(),
            counted.len()
        );
        for (which, name) in ["network", "network over time", "sequential"].into_iter().enumerate() {
            let sum = |of: fn(&Counted) -> &[usize; 3]| counted.iter().map(|one| of(one)[which]).sum::<usize>();
            let mut delays: Vec<f64> = counted.iter().filter_map(|one| one.found_s[which]).collect();
            delays.sort_by(f64::total_cmp);
            let within = delays.iter().filter(|delay| **delay <= 10.0).count();
            println!(
                "  {name}: {} false alarms; found in 10 s {}, median {:.2} s; a healthy rotor named in {} flights; right {} of {} windows",
                sum(|one| &one.alarms),
                Share::new(within, counted.len()).text(),
                delays.get(delays.len() / 2).copied().unwrap_or(f64::NAN),
                counted.iter().filter(|one| one.wrong[which]).count(),
                sum(|one| &one.right),
                sum(|one| &one.windows),
            );
        }
    }
}
