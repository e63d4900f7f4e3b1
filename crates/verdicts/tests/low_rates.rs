//! Logs of 200, 100 and 50 Hz made from flights of the independent generator: every second, fourth, eighth row of 400
//! Hz, and nothing in between; and uneven ones, as autopilots write them.

use rotortwin_blind::bench::faults::{Class, End, FaultCase, FaultRow, draw_cases, fly_case, score};
use rotortwin_blind::bench::sheet::Share;
use rotortwin_blind::flight::Row;
use rotortwin_scenario::{DetectorSettings, Detectors, VehicleDocuments};
use rotortwin_twin::log::{FlightLog, names};
use rotortwin_verdicts::log::{LogReport, judge};
use rotortwin_verdicts::view::VerdictKind;

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
    cases_with(class, n, seed, LOSS)
}

/// Cases of a class, with every loss of this share.
fn cases_with(class: Class, n: usize, seed: u64, lost: f64) -> Vec<FaultCase> {
    let cases = draw_cases(n, seed, 60.0, &[(VEHICLE.to_owned(), 6)]);
    let mut cases: Vec<FaultCase> = cases.into_iter().filter(|case| case.class == class).collect();
    let effects = cases.iter_mut().flat_map(|case| &mut case.effects);
    for effect in effects.filter(|effect| effect.id == "rotor-thrust-scale") {
        effect.parameters.insert("share".to_owned(), -lost);
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

/// Rows of the streams of an autopilot's log, each with straight lines between its values.
#[derive(Clone, Copy)]
struct Streams {
    /// Rows from one reading of the inertial sensor to the next, which is the log's time base.
    inertial: usize,
    attitude: usize,
    velocity: usize,
    duty: usize,
    voltage: usize,
}

/// ArduCopter's log with its fast streams: inertial sensor and attitude at its loop's 400 Hz, motors and battery at 10 Hz, velocity at 25 Hz.
const FAST: Streams = Streams {
    inertial: 1,
    attitude: 1,
    velocity: 16,
    duty: 40,
    voltage: 40,
};
/// The same by its default: inertial sensor at 25 Hz, attitude at 10 Hz.
const DEFAULT: Streams = Streams {
    inertial: 16,
    attitude: 40,
    ..FAST
};

impl Streams {
    /// The log of a flight; stamps are whole milliseconds, and lines are straight over these.
    fn read(&self, rows: &[Row]) -> FlightLog {
        let stamp = |place: usize| (1e3 * rows[place].time + 1e-6).floor() * 1e-3;
        let places: Vec<usize> = (0..rows.len()).step_by(self.inertial).collect();
        let drawn = |every: usize, value: &dyn Fn(&Row) -> f64| -> Vec<f64> {
            places
                .iter()
                .map(|place| {
                    let before = place - place % every;
                    let after = (before + every).min(rows.len() - 1);
                    let share = match stamp(after) - stamp(before) {
                        0.0 => 0.0,
                        interval => (stamp(*place) - stamp(before)) / interval,
                    };
                    value(&rows[before]) * (1.0 - share) + value(&rows[after]) * share
                })
                .collect()
        };
        let mut columns = vec![(
            names::BATTERY_VOLTAGE.to_owned(),
            drawn(self.voltage, &|row| row.voltage),
        )];
        for axis in 0..3 {
            let of_axis = [
                (names::VELOCITY, drawn(self.velocity, &|row| row.velocity[axis])),
                (names::ATTITUDE, drawn(self.attitude, &|row| row.euler[axis])),
                (names::RATES, drawn(self.inertial, &|row| row.rates[axis])),
                (names::ACCEL, drawn(self.inertial, &|row| row.accel[axis])),
            ];
            columns.extend(of_axis.map(|(names, values)| (names[axis].to_owned(), values)));
        }
        for rotor in 0..6 {
            let duty = drawn(self.duty, &|row| row.duties[rotor].clamp(0.0, 1.0));
            columns.push((names::duty(rotor + 1), duty));
        }
        let stamps = places.iter().map(|place| stamp(*place));
        FlightLog::from_columns("autopilot", stamps.collect(), columns).expect("a good log")
    }
}

/// From ten seconds after the loss on: windows with a verdict, and those that call the flight healthy although the loss exceeds the size that they say would
/// be seen.
fn untrue(case: &FaultCase, report: &LogReport) -> [usize; 2] {
    let fault = &case.effects[0];
    let (rotor, onset_s) = (fault.rotor.expect("a rotor"), fault.onset_s.expect("an onset"));
    let late = report.windows.iter().filter(|window| {
        window.time_s > onset_s + 10.0 && window.sequential.verdict.verdict != VerdictKind::CannotJudge
    });
    let lost = -fault.parameters["share"];
    late.fold([0; 2], |[of, untrue], window| {
        let is_healthy = window.sequential.verdict.verdict == VerdictKind::Healthy && !window.sequential.is_unclear();
        let is_seen = window
            .smallest_loss
            .get(rotor - 1)
            .is_some_and(|least| lost > f64::from(*least));
        [of + 1, untrue + usize::from(is_healthy && is_seen)]
    })
}

fn judged(case: &FaultCase, log: &FlightLog) -> FaultRow {
    scored(case, &judge(log, &detectors(), true).expect("judged"))
}

fn scored(case: &FaultCase, report: &LogReport) -> FaultRow {
    score(case, &serde_json::to_string(report).expect("JSON")).expect("scored")
}

fn flown(class: Class, n: usize, seed: u64) -> Vec<(FaultCase, Vec<Row>)> {
    flights_of(cases(class, n, seed))
}

fn flights_of(cases: Vec<FaultCase>) -> Vec<(FaultCase, Vec<Row>)> {
    cases
        .into_iter()
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

#[test]
fn val_in_the_streams_of_an_autopilot_no_loss_that_would_be_seen_is_called_healthy() {
    let (mut judged, mut right) = (0, 0);
    for (case, rows) in flights_of(cases_with(Class::Step, 4, 301_166, 0.1)) {
        for streams in [FAST, DEFAULT] {
            let report = judge(&streams.read(&rows), &detectors(), true).expect("judged");
            let said = report.lacks.iter().any(|lack| lack.columns.contains(&names::duty(1)));
            assert!(said, "slow duties are not mentioned: {:?}", report.lacks);
            let [of, untrue] = untrue(&case, &report);
            let row = scored(&case, &report);
            assert_eq!(
                (untrue, row.false_alarms, row.healthy_named, row.false_load),
                (0, 0, false, false),
                "{case:?}"
            );
            judged += of;
            right += usize::from(row.end == Some(End::Right));
        }
    }
    assert!(
        judged > 2000 && right >= 3,
        "{judged} windows, {right} right at the end"
    );
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

/// Logs with the streams of an autopilot: steps of 5 and 10 %, healthy flights, healthy ones with five unknown effects.
#[test]
#[ignore = "a measurement: cargo test --release -p rotortwin-verdicts --test low_rates -- --ignored --nocapture bench_"]
fn bench_autopilot_streams() {
    let number =
        |name: &str, default: usize| std::env::var(name).map_or(default, |text| text.parse().expect("a number"));
    let (n, seed) = (number("ROTORTWIN_FAULTS_N", 24), number("ROTORTWIN_FAULTS_SEED", 1));
    for (class, lost) in [
        (Class::Step, 0.1),
        (Class::Step, 0.05),
        (Class::Healthy, 0.0),
        (Class::FiveHealthy, 0.0),
    ] {
        let flights = flights_of(cases_with(class, n, seed as u64, lost));
        for (name, streams) in [("fast", FAST), ("default", DEFAULT)] {
            let mut windows = [0; 2];
            let mut rows = Vec::new();
            for (case, flight) in &flights {
                let report = judge(&streams.read(flight), &detectors(), true).expect("judged");
                if class == Class::Step {
                    let [of, false_ones] = untrue(case, &report);
                    windows = [windows[0] + of, windows[1] + false_ones];
                }
                let row = scored(case, &report);
                if row.false_alarms > 0 || row.false_load || row.healthy_named {
                    println!(
                        "  {name} {class:?} {} {}: alarms {}, load {}, named {}",
                        case.flight, case.index, row.false_alarms, row.false_load, row.healthy_named
                    );
                }
                rows.push(row);
            }
            let count = |is: &dyn Fn(&FaultRow) -> bool| rows.iter().filter(|row| is(row)).count();
            let found = |s: f64| count(&|row| row.first_s.is_some_and(|first_s| first_s <= s));
            let hours: f64 = rows.iter().map(|row| row.healthy_s).sum::<f64>() / 3600.0;
            println!(
                "{name}, {class:?} {lost}: {} flights; found in 5 s {}, in 10 s {}; right at the end {}; inside {} of {}; missed at the end {}; announced {} of {} misses; \
                 a healthy rotor named {}; false loads {}; false alarms {} in {hours:.2} h; healthy against their own smallest loss {} of {} windows; judged {:.0} %",
                rows.len(),
                found(5.0),
                found(10.0),
                count(&|row| row.end == Some(End::Right)),
                count(&|row| row.inside == Some(true)),
                count(&|row| row.inside.is_some()),
                count(&|row| row.end == Some(End::Missed)),
                count(&|row| row.announced == Some(true)),
                count(&|row| row.announced.is_some()),
                count(&|row| row.healthy_named),
                count(&|row| row.false_load),
                rows.iter().map(|row| row.false_alarms).sum::<usize>(),
                windows[1],
                windows[0],
                rows.iter().map(|row| row.decided_s).sum::<f64>() / 0.6 / rows.len() as f64,
            );
        }
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
