//! What is said of logs whose columns are not what they seem: a voltage in a few rows only, rates in deg/s, exchanged duties.

use rotortwin_blind::bench::faults::{Class, FaultCase, draw_cases, fly_case};
use rotortwin_blind::flight::Row;
use rotortwin_blind::hidden::Hidden;
use rotortwin_scenario::{DetectorSettings, Detectors, VehicleDocuments};
use rotortwin_twin::log::{FlightLog, names};
use rotortwin_verdicts::log::{LogReport, judge};

const VEHICLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/vehicles/f550.toml");
const ROTORS: usize = 6;

fn detectors() -> Detectors {
    let documents = VehicleDocuments::load(VEHICLE).expect("shipped");
    Detectors::new(documents, &DetectorSettings::default(), None).expect("a good configuration")
}

/// A flight with these effects on it, every `nth` row.
fn flown(flight: &str, seed: u64, effects: &[&str], nth: usize) -> Vec<Row> {
    let cases = draw_cases(1, seed, 60.0, &[(VEHICLE.to_owned(), ROTORS)]);
    let healthy = cases
        .into_iter()
        .find(|case| case.class == Class::Healthy)
        .expect("a case");
    let case = FaultCase {
        flight: flight.to_owned(),
        effects: effects
            .iter()
            .map(|text| Hidden::parse(text).expect("an effect"))
            .collect(),
        ..healthy
    };
    let rows = fly_case(&case).expect("flown");
    rows.into_iter().step_by(nth).collect()
}

/// The columns of a log without an accelerometer.
fn columns(rows: &[Row]) -> Vec<(String, Vec<f64>)> {
    let of = |value: &dyn Fn(&Row) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
    let mut columns = vec![(names::BATTERY_VOLTAGE.to_owned(), of(&|row| row.voltage))];
    for axis in 0..3 {
        columns.push((names::VELOCITY[axis].to_owned(), of(&|row| row.velocity[axis])));
        columns.push((names::ATTITUDE[axis].to_owned(), of(&|row| row.euler[axis])));
        columns.push((names::RATES[axis].to_owned(), of(&|row| row.rates[axis])));
    }
    for rotor in 0..ROTORS {
        columns.push((names::duty(rotor + 1), of(&|row| row.duties[rotor].clamp(0.0, 1.0))));
    }
    columns
}

fn log(rows: &[Row], columns: Vec<(String, Vec<f64>)>) -> FlightLog {
    FlightLog::from_columns("flight", rows.iter().map(|row| row.time).collect(), columns).expect("a good log")
}

fn judged(log: &FlightLog) -> Result<LogReport, String> {
    judge(log, &detectors(), false).map_err(|refusal| refusal.to_string())
}

#[test]
fn val_a_voltage_in_every_twentieth_row_is_interpolated_and_said() {
    let rows = flown("hover", 5, &["rotor-thrust-scale:share=-0.08,rotor=2,onset_s=30"], 2);
    let mut sparse = columns(&rows);
    for (row, voltage) in sparse[0].1.iter_mut().enumerate() {
        if row % 20 != 7 {
            *voltage = f64::NAN;
        }
    }
    let report = judged(&log(&rows, sparse)).expect("judged");
    let whole = judged(&log(&rows, columns(&rows))).expect("judged");
    assert_eq!((report.lost_steps, whole.lost_steps), (0, 0));
    assert!(
        (report.decided_s - whole.decided_s).abs() < 1.0,
        "{} s",
        report.decided_s
    );
    for report in [&report, &whole] {
        let last = report.final_window.as_ref().expect("a window");
        assert_eq!(last.sequential.verdict.rotors, vec![2], "{:?}", last.sequential);
        let loss = &last.sequential.thrust_loss[0];
        assert!(loss.share_low < 0.08 && 0.08 < loss.share_high, "{loss:?}");
    }
    let is_told = |report: &LogReport| {
        report
            .notes
            .iter()
            .any(|note| note.contains("(10.0 Hz in rows of 200.0 Hz)"))
    };
    assert!(is_told(&report) && !is_told(&whole), "{:?}", report.notes);
}

#[test]
fn val_a_voltage_that_stops_and_single_empty_cells_are_lost() {
    let rows = flown("hover", 5, &[], 2);
    let mut stopped = columns(&rows);
    // 10 Hz until 40 s, and nothing from then on.
    for (row, voltage) in stopped[0].1.iter_mut().enumerate() {
        if row % 20 != 0 || rows[row].time > 40.0 {
            *voltage = f64::NAN;
        }
    }
    let report = judged(&log(&rows, stopped)).expect("judged");
    let lost_s = report.lost_steps as f64 / report.judged_rate_hz;
    // The last value holds for three and a half intervals, and the mean over 10 s of a slow voltage for 5 s after that.
    let end_s = rows.last().expect("rows").time;
    assert!(
        (lost_s - (end_s - 45.35)).abs() < 0.2,
        "{lost_s} s of {end_s} s are lost"
    );
    let mut single = columns(&rows);
    for voltage in single[0].1.iter_mut().step_by(500) {
        *voltage = f64::NAN;
    }
    let report = judged(&log(&rows, single)).expect("judged");
    assert_eq!(report.lost_steps as usize, rows.len().div_ceil(500));
}

#[test]
fn val_rates_in_degrees_are_told_in_a_still_hover() {
    for seed in [5, 6, 7, 8] {
        let rows = flown("hover", seed, &[], 4);
        let in_degrees = |log: &FlightLog| {
            let report = judged(log).expect("judged");
            report
                .suspicions
                .iter()
                .any(|suspicion| suspicion.blocks && suspicion.finding.contains("deg/s"))
        };
        let mut turned = columns(&rows);
        for (name, values) in &mut turned {
            if names::RATES.contains(&name.as_str()) {
                values.iter_mut().for_each(|value| *value = value.to_degrees());
            }
        }
        assert!(in_degrees(&log(&rows, turned)), "seed {seed}, deg/s");
        assert!(!in_degrees(&log(&rows, columns(&rows))), "seed {seed}, rad/s");
        // An attitude that is all noise does not tell: each row's comes from elsewhere in the flight.
        let mut noise = columns(&rows);
        for (name, values) in &mut noise {
            if names::ATTITUDE.contains(&name.as_str()) {
                let from = values.clone();
                let count = from.len();
                values
                    .iter_mut()
                    .enumerate()
                    .for_each(|(row, value)| *value = from[(row * 7919 + 13) % count]);
            } else if names::RATES.contains(&name.as_str()) {
                values.iter_mut().for_each(|value| *value = value.to_degrees());
            }
        }
        assert!(!in_degrees(&log(&rows, noise)), "seed {seed}, noise");
    }
}

/// What a flight whose columns of two duties are exchanged is refused with.
fn exchanged(rows: &[Row], one: usize, other: usize) -> Option<String> {
    let mut columns = columns(rows);
    let place = |rotor: usize| 9 + rotor;
    let values = columns[place(one)].1.clone();
    columns[place(one)].1 = std::mem::replace(&mut columns[place(other)].1, values);
    judged(&log(rows, columns)).err()
}

#[test]
fn val_two_exchanged_duties_are_refused_and_right_ones_are_not() {
    let air: &[&str] = &[
        "wind:north_m_s=4,east_m_s=-3",
        "gusts:rms_m_s=1,correlation_s=2",
        "flapping-moment:moment_n_s=0.006",
    ];
    let loss: &[&str] = &["rotor-thrust-scale:share=-0.3,rotor=2,onset_s=20"];
    let (mut refused, mut of) = (0, 0);
    for (flight, seed, effects) in [
        ("hover", 5, &[][..]),
        ("hover", 6, air),
        ("helix", 7, &[]),
        ("waypoint", 8, air),
        ("hover", 9, loss),
    ] {
        for nth in [1, 4] {
            let rows = flown(flight, seed, effects, nth);
            assert_eq!(judged(&log(&rows, columns(&rows))).err(), None, "{flight} {seed} {nth}");
            for (one, other) in [(1, 2), (3, 4), (5, 6), (2, 5)] {
                of += 1;
                let told = exchanged(&rows, one, other);
                refused += usize::from(told.is_some());
                // Whoever refuses, by the right names.
                if let Some(told) = told {
                    let [one, other] = [one, other].map(|rotor| format!("duty_{rotor}"));
                    assert!(told.contains(&one) && told.contains(&other), "{told}");
                }
            }
        }
    }
    assert!(10 * refused >= 9 * of, "{refused} of {of} refused");
}
