//! Logs of 200, 100 and 50 Hz made from flights of the independent generator: every second, fourth, eighth row of 400
//! Hz, and nothing in between; and uneven ones, as autopilots write them.

use rotortwin_blind::bench::faults::{Class, End, FaultCase, FaultRow, draw_cases, fly_case, score};
use rotortwin_blind::bench::sheet::Share;
use rotortwin_blind::flight::Row;
use rotortwin_scenario::{DetectorSettings, Detectors, VehicleDocuments};
use rotortwin_twin::log::{FlightLog, names};
use rotortwin_verdicts::log::judge;

const VEHICLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/vehicles/f550.toml");
/// Lost share of every step.
const LOSS: f64 = 0.05;
/// A step has to be found within this many seconds.
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

/// A log of some rows of a flight, with values of other rows: those from which the row's own values follow.
struct Log<'a> {
    rows: Vec<&'a Row>,
    velocity: Vec<&'a Row>,
    attitude: Vec<&'a Row>,
    voltage: Vec<&'a Row>,
}

impl<'a> Log<'a> {
    /// Every `nth` row, as a log that has never had the others.
    fn even(rows: &'a [Row], nth: usize) -> Self {
        let rows: Vec<&Row> = rows.iter().step_by(nth).collect();
        let [velocity, attitude, voltage] = [rows.clone(), rows.clone(), rows.clone()];
        Self {
            rows,
            velocity,
            attitude,
            voltage,
        }
    }

    /// Rows at 100 Hz with up to 5 ms of jitter, the other values held: velocities at 10 Hz, attitudes at 50 Hz, the
    /// voltage at 2 Hz, depending on `causes`.
    fn uneven(rows: &'a [Row], causes: [bool; 4]) -> Self {
        let [jitter, velocity, attitude, voltage] = causes;
        let late = if jitter { [0, 2, 1, 0, 1] } else { [0; 5] };
        let places: Vec<usize> = (0..rows.len() / 4).map(|k| 4 * k + late[k % 5]).collect();
        let held = |is: bool, every: usize| {
            let every = if is { every } else { 1 };
            places.iter().map(|place| &rows[place - place % every]).collect()
        };
        Self {
            rows: held(false, 1),
            velocity: held(velocity, 40),
            attitude: held(attitude, 8),
            voltage: held(voltage, 200),
        }
    }

    fn read(&self) -> FlightLog {
        let of = |rows: &[&Row], value: &dyn Fn(&Row) -> f64| rows.iter().map(|row| value(row)).collect::<Vec<f64>>();
        let mut columns = vec![(names::BATTERY_VOLTAGE.to_owned(), of(&self.voltage, &|row| row.voltage))];
        for axis in 0..3 {
            columns.push((
                names::VELOCITY[axis].to_owned(),
                of(&self.velocity, &|row| row.velocity[axis]),
            ));
            columns.push((
                names::ATTITUDE[axis].to_owned(),
                of(&self.attitude, &|row| row.euler[axis]),
            ));
            columns.push((names::RATES[axis].to_owned(), of(&self.rows, &|row| row.rates[axis])));
            columns.push((names::ACCEL[axis].to_owned(), of(&self.rows, &|row| row.accel[axis])));
        }
        for rotor in 0..6 {
            let duty = of(&self.rows, &|row| row.duties[rotor].clamp(0.0, 1.0));
            columns.push((names::duty(rotor + 1), duty));
        }
        FlightLog::from_columns("thinned", of(&self.rows, &|row| row.time), columns).expect("a good log")
    }
}

fn judged(case: &FaultCase, log: &FlightLog) -> FaultRow {
    let report = judge(log, &detectors(), true).expect("judged");
    score(case, &serde_json::to_string(&report).expect("JSON")).expect("scored")
}

fn flown(class: Class, n: usize, seed: u64) -> Vec<(FaultCase, Vec<Row>)> {
    let cases = cases(class, n, seed).into_iter();
    cases
        .filter_map(|case| fly_case(&case).ok().map(|rows| (case, rows)))
        .collect()
}

fn is_found(row: &FaultRow) -> bool {
    row.first_s.is_some_and(|s| s <= WITHIN_S)
}

#[test]
fn val_a_loss_of_5_percent_is_found_at_100_hz_and_healthy_flights_stay_healthy() {
    let rows = |class: Class| -> Vec<FaultRow> {
        let flights = flown(class, 8, 7);
        let read = |rows: &[Row]| Log::even(rows, 4).read();
        flights.iter().map(|(case, rows)| judged(case, &read(rows))).collect()
    };
    let (steps, healthy) = (rows(Class::Step), rows(Class::Healthy));
    let found = steps.iter().filter(|row| is_found(row)).count();
    assert!(found >= 7, "{found} of {}", steps.len());
    for row in steps.iter().chain(&healthy) {
        assert_eq!((row.false_alarms, row.healthy_named), (0, false), "{:?}", row.case);
    }
}

#[test]
fn val_a_loss_of_5_percent_is_found_in_uneven_rows_of_slow_velocity_and_voltage() {
    let judged_all = |class: Class, n: usize| -> Vec<FaultRow> {
        let flights = flown(class, n, 7);
        let read = |rows: &[Row]| Log::uneven(rows, [true; 4]).read();
        flights.iter().map(|(case, rows)| judged(case, &read(rows))).collect()
    };
    let (steps, healthy) = (judged_all(Class::Step, 8), judged_all(Class::Healthy, 4));
    let found = steps.iter().filter(|row| is_found(row)).count();
    assert!(found >= 5, "{found} of {}", steps.len());
    for row in steps.iter().chain(&healthy) {
        assert_eq!((row.false_alarms, row.healthy_named), (0, false), "{:?}", row.case);
    }
}

/// Steps of 5 % of the size and healthy flights, and healthy ones with five unknown effects.
struct Flights {
    steps: Vec<(FaultCase, Vec<Row>)>,
    healthy: Vec<(FaultCase, Vec<Row>)>,
    five: Vec<(FaultCase, Vec<Row>)>,
}

impl Flights {
    /// `ROTORTWIN_FAULTS_N` of each, `ROTORTWIN_FAULTS_SEED`.
    fn fly() -> Self {
        let number =
            |name: &str, default: usize| std::env::var(name).map_or(default, |text| text.parse().expect("a number"));
        let (n, seed) = (number("ROTORTWIN_FAULTS_N", 24), number("ROTORTWIN_FAULTS_SEED", 1));
        let [steps, healthy, five] =
            [Class::Step, Class::Healthy, Class::FiveHealthy].map(|class| flown(class, n, seed as u64));
        Self { steps, healthy, five }
    }

    fn print(&self, name: &str, log: impl Fn(&[Row]) -> FlightLog) {
        let rows = |flights: &[(FaultCase, Vec<Row>)]| -> Vec<FaultRow> {
            flights.iter().map(|(case, rows)| judged(case, &log(rows))).collect()
        };
        let [steps, healthy, five] = [&self.steps, &self.healthy, &self.five].map(|flights| rows(flights));
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
        let alarms = |rows: &mut dyn Iterator<Item = &FaultRow>| {
            let (count, hours) = rows.fold((0, 0.0), |(count, hours), row| {
                (count + row.false_alarms, hours + row.healthy_s / 3600.0)
            });
            format!("{count} in {hours:.2} h")
        };
        let decided = |rows: &[FaultRow]| {
            let decided: f64 = rows.iter().map(|row| row.decided_s).sum();
            100.0 * decided / (60.0 * rows.len() as f64)
        };
        let inside: Vec<FaultRow> = steps.iter().filter(|row| row.inside.is_some()).cloned().collect();
        let mut first: Vec<f64> = steps.iter().filter_map(|row| row.first_s).collect();
        first.sort_by(f64::total_cmp);
        println!(
            "{name}: found within 5 s {}, median {:.2} s; right at the end {}; inside {}; a healthy rotor named {} with a step, {} healthy, {} with five \
             effects; false alarms {}, {} with five effects; judged {:.0} %, {:.0} % of healthy flights, {:.0} % with five effects",
            share(&steps, &is_found),
            first.get(first.len() / 2).copied().unwrap_or(f64::NAN),
            share(&steps, &|row| row.end == Some(End::Right)),
            share(&inside, &|row| row.inside == Some(true)),
            share(&steps, &|row| row.healthy_named),
            share(&healthy, &|row| row.healthy_named),
            share(&five, &|row| row.healthy_named),
            alarms(&mut steps.iter().chain(&healthy)),
            alarms(&mut five.iter()),
            decided(&steps),
            decided(&healthy),
            decided(&five),
        );
    }
}

/// The figures of docs/detector.md of low rates; each flight is flown once and judged at every rate.
#[test]
#[ignore = "a measurement: cargo test --release -p rotortwin-verdicts --test low_rates -- --ignored --nocapture bench_"]
fn bench_low_rates() {
    let flights = Flights::fly();
    for nth in [1, 2, 4, 8] {
        flights.print(&format!("{:>3} Hz", 400 / nth), |rows| Log::even(rows, nth).read());
    }
}

/// The same of uneven logs, and of each cause alone.
#[test]
#[ignore = "a measurement: cargo test --release -p rotortwin-verdicts --test low_rates -- --ignored --nocapture bench_"]
fn bench_uneven_rows() {
    let flights = Flights::fly();
    let causes = [
        ("uneven", [true; 4]),
        ("jitter", [true, false, false, false]),
        ("slow velocity", [false, true, false, false]),
        ("slow attitude", [false, false, true, false]),
        ("slow voltage", [false, false, false, true]),
    ];
    for (name, causes) in causes {
        flights.print(name, |rows| Log::uneven(rows, causes).read());
    }
    flights.print("uneven, no accelerometer", |rows| {
        let mut log = Log::uneven(rows, [true; 4]).read();
        log.columns.remove(names::ACCEL[2]);
        log
    });
}
