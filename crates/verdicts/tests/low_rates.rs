//! Logs of 200, 100 and 50 Hz of the independent generator's flights: every second, fourth, eighth row of 400 Hz, and nothing between.

use rotortwin_blind::bench::faults::{Class, End, FaultCase, FaultRow, draw_cases, fly_case, score};
use rotortwin_blind::bench::sheet::Share;
use rotortwin_blind::flight::Row;
use rotortwin_scenario::{DetectorSettings, Detectors, VehicleDocuments};
use rotortwin_twin::log::{FlightLog, names};
use rotortwin_verdicts::log::judge;

const VEHICLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/vehicles/f550.toml");
/// Lost share of every step.
const LOSS: f64 = 0.05;
/// A step is to be found within so many seconds.
const WITHIN_S: f64 = 5.0;

fn detectors() -> Detectors {
    let documents = VehicleDocuments::load(VEHICLE).expect("shipped");
    Detectors::new(documents, &DetectorSettings::default(), None).expect("a good configuration")
}

/// Cases of a class, with every loss [`LOSS`].
fn cases(class: Class, n: usize, seed: u64) -> Vec<FaultCase> {
    let cases = draw_cases(n, seed, 60.0, &[(VEHICLE.to_owned(), 6)]);
    let mut cases: Vec<FaultCase> = cases.into_iter().filter(|case| case.class == class).collect();
    let effects = cases.iter_mut().flat_map(|case| &mut case.effects);
    for effect in effects.filter(|effect| effect.id == "rotor-thrust-scale") {
        effect.parameters.insert("share".to_owned(), -LOSS);
    }
    cases
}

/// Every `nth` row, as a log that has never had the others.
fn thinned(rows: &[Row], nth: usize) -> FlightLog {
    let rows: Vec<&Row> = rows.iter().step_by(nth).collect();
    let of = |value: &dyn Fn(&Row) -> f64| rows.iter().map(|row| value(row)).collect::<Vec<f64>>();
    let mut columns = vec![(names::BATTERY_VOLTAGE.to_owned(), of(&|row| row.voltage))];
    for axis in 0..3 {
        columns.push((names::VELOCITY[axis].to_owned(), of(&|row| row.velocity[axis])));
        columns.push((names::ATTITUDE[axis].to_owned(), of(&|row| row.euler[axis])));
        columns.push((names::RATES[axis].to_owned(), of(&|row| row.rates[axis])));
    }
    for rotor in 0..6 {
        columns.push((names::duty(rotor + 1), of(&|row| row.duties[rotor].clamp(0.0, 1.0))));
    }
    FlightLog::from_columns("thinned", of(&|row| row.time), columns).expect("a good log")
}

fn judged(case: &FaultCase, rows: &[Row], nth: usize) -> FaultRow {
    let report = judge(&thinned(rows, nth), &detectors(), true).expect("judged");
    score(case, &serde_json::to_string(&report).expect("JSON")).expect("scored")
}

/// The figures of docs/detector.md of low rates: `ROTORTWIN_FAULTS_N` steps of 5 % and as many healthy flights, `ROTORTWIN_FAULTS_SEED`; each flight is flown
/// once and judged at every rate.
#[test]
#[ignore = "a measurement: cargo test --release -p rotortwin-verdicts --test low_rates -- --ignored --nocapture bench_"]
fn bench_low_rates() {
    let number =
        |name: &str, default: usize| std::env::var(name).map_or(default, |text| text.parse().expect("a number"));
    let (n, seed) = (number("ROTORTWIN_FAULTS_N", 24), number("ROTORTWIN_FAULTS_SEED", 1));
    let flown = |class: Class| -> Vec<(FaultCase, Vec<Row>)> {
        let cases = cases(class, n, seed as u64).into_iter();
        cases
            .filter_map(|case| fly_case(&case).ok().map(|rows| (case, rows)))
            .collect()
    };
    let (steps, healthy) = (flown(Class::Step), flown(Class::Healthy));
    for nth in [1, 2, 4, 8] {
        let rows = |flights: &[(FaultCase, Vec<Row>)]| -> Vec<FaultRow> {
            flights.iter().map(|(case, rows)| judged(case, rows, nth)).collect()
        };
        let (steps, healthy) = (rows(&steps), rows(&healthy));
        let share = |rows: &[FaultRow], is: &dyn Fn(&FaultRow) -> bool| {
            let share = Share::new(rows.iter().filter(|row| is(row)).count(), rows.len());
            format!(
                "{} of {} [{:.0}, {:.0}]",
                share.count,
                share.of,
                100.0 * share.low,
                100.0 * share.high
            )
        };
        let found = |row: &FaultRow| row.first_s.is_some_and(|s| s <= WITHIN_S);
        let inside: Vec<FaultRow> = steps.iter().filter(|row| row.inside.is_some()).cloned().collect();
        let mut first: Vec<f64> = steps.iter().filter_map(|row| row.first_s).collect();
        first.sort_by(f64::total_cmp);
        let both = || steps.iter().chain(&healthy);
        println!(
            "{:>3} Hz: found within 5 s {}, median {:.2} s; right at the end {}; inside {}; a healthy rotor named {} with a step, {} healthy; \
             false alarms {} in {:.2} h; judged {:.0} %",
            400 / nth,
            share(&steps, &found),
            first.get(first.len() / 2).copied().unwrap_or(f64::NAN),
            share(&steps, &|row| row.end == Some(End::Right)),
            share(&inside, &|row| row.inside == Some(true)),
            share(&steps, &|row| row.healthy_named),
            share(&healthy, &|row| row.healthy_named),
            both().map(|row| row.false_alarms).sum::<usize>(),
            both().map(|row| row.healthy_s).sum::<f64>() / 3600.0,
            100.0 * both().map(|row| row.decided_s).sum::<f64>() / (60.0 * both().count() as f64),
        );
    }
}
