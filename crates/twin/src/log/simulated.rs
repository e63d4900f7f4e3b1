//! Whether a simulator wrote a log: then a comparison is between two models, and nobody should mistake it for a real
//! flight.
//!
//! ArduPilot's simulator logs what it simulates (`SIM`) and has parameters `SIM_…`; PX4's publishes the truth (`…_groundtruth`); runs of
//! this program have columns `true_…`. PX4's simulator build, on any plant, logs as rotor speeds its own commands times 6000 rpm. A simulator that leaves no trace of itself is not recognised.

use super::names;
use super::sources::SourceLog;
use super::table::Table;

/// Parameters of ArduPilot's simulator; a vehicle has none.
const PARAMETER: &str = "SIM_";
/// Fewest of them.
const FEWEST_PARAMETERS: usize = 5;

/// Rotor speeds that equal a constant times the duty to this rms share are not measured: a rotor lags, and its speed is
/// not proportional to the duty.
const SAME_SHARE: f64 = 5e-3;
/// Standard deviation of the duty over its mean: at one duty every speed is a constant times it.
const LEAST_SPREAD: f64 = 0.15;
/// Constants of two rotors differ by less than this share.
const SAME_FACTOR: f64 = 0.01;

fn note(by: &str) -> String {
    format!("A SIMULATOR WROTE THIS LOG ({by}): it shows how a model compares with another model, not with a vehicle")
}

/// What the streams of an autopilot's log say.
pub(super) fn of_streams(log: &SourceLog) -> Option<String> {
    if let Some(stream) = log.streams.iter().find(|s| s.name.ends_with("_groundtruth")) {
        return Some(note(&format!("it holds the truth, {}", stream.name)));
    }
    if log.streams.iter().any(|s| s.kind.starts_with("rotortwin.v1.")) {
        return Some(note("it is the recording of a run of this program"));
    }
    if log.streams.iter().any(|s| s.name == "SIM" || s.name == "SIM2") {
        return Some(note("it holds messages SIM of ArduPilot's simulator"));
    }
    let parameters = log.parameters.keys().filter(|name| name.starts_with(PARAMETER)).count();
    (parameters >= FEWEST_PARAMETERS).then(|| note(&format!("{parameters} parameters {PARAMETER}…")))
}

/// rad/s at full duty, if a speed is a constant times the duty.
fn factor(duty: &[f64], speed: &[f64]) -> Option<f64> {
    let pairs = || {
        let pairs = duty.iter().zip(speed);
        pairs.filter(|(duty, speed)| duty.is_finite() && speed.is_finite())
    };
    let count = pairs().count() as f64;
    let mean = pairs().map(|(duty, _)| duty).sum::<f64>() / count;
    let squares = pairs().map(|(duty, _)| duty * duty).sum::<f64>();
    let factor = pairs().map(|(duty, speed)| duty * speed).sum::<f64>() / squares;
    let spread = (squares / count - mean * mean).max(0.0).sqrt();
    let rest = pairs()
        .map(|(duty, speed)| (speed - factor * duty).powi(2))
        .sum::<f64>();
    let all = pairs().map(|(_, speed)| speed * speed).sum::<f64>();
    // Without a value these are not numbers, and nothing is smaller than them.
    (spread > LEAST_SPREAD * mean && rest < SAME_SHARE * SAME_SHARE * all && factor > 0.0).then_some(factor)
}

/// Takes rotor speeds out that are the commands times a constant, and says so.
pub(super) fn take_made_up_speeds(table: &mut Table) -> Option<String> {
    let of = |rotor: fn(&str) -> Option<usize>| {
        let columns = table.columns.iter();
        columns.filter(move |column| rotor(&column.name).is_some())
    };
    let mut factors = Vec::new();
    for speed in of(names::speed_rotor) {
        // A mapping may order one of them and not the other.
        let found = of(names::duty_rotor).find_map(|duty| factor(&duty.values, &speed.values));
        factors.push(found?);
    }
    let first = *factors.first()?;
    if factors.iter().any(|factor| (factor / first - 1.0).abs() > SAME_FACTOR) {
        return None;
    }
    table
        .columns
        .retain(|column| names::speed_rotor(&column.name).is_none());
    Some(note(&format!(
        "its rotor speeds are the duties times {first:.1} rad/s, so that they are left out"
    )))
}

/// What the columns of a canonical table say.
pub(super) fn of_columns(table: &Table) -> Option<String> {
    let truth = table.columns.iter().find(|column| column.name.starts_with("true_"))?;
    Some(note(&format!("it holds the truth, {}", truth.name)))
}

#[cfg(test)]
mod tests {
    use super::super::sources::RawStream;
    use super::*;

    fn with(stream: &str, parameters: usize) -> SourceLog {
        SourceLog {
            streams: vec![RawStream {
                name: stream.to_owned(),
                ..RawStream::default()
            }],
            parameters: (0..parameters).map(|i| (format!("SIM_P{i}"), 1.0)).collect(),
            ..SourceLog::default()
        }
    }

    /// Duties from standstill to hover, and the response of a rotor with a lag of `lag` rows, `full` rad/s at full
    /// duty.
    fn with_speeds(lag: f64, full: f64) -> Table {
        let mut table = Table::default();
        table.push("time_s", (0..2000).map(|row| f64::from(row) * 0.004).collect());
        for rotor in 1..=4 {
            let duty = |row: i32| match row {
                ..500 => 0.0,
                _ => 0.4 + 0.02 * (f64::from(row) * 0.05 + f64::from(rotor)).sin(),
            };
            let mut now = 0.0;
            let speeds = (0..2000).map(|row| {
                now += (full * duty(row) - now) / (1.0 + lag);
                now
            });
            table.push(&format!("rotor_speed_{rotor}_rad_s"), speeds.collect());
            // In another order than the speeds.
            table.push(&format!("duty_{}", 5 - rotor), (0..2000).map(duty).collect());
        }
        table
    }

    #[test]
    fn regress_speeds_that_a_simulator_made_of_the_duties_are_no_measurement() {
        let mut table = with_speeds(0.0, 628.3);
        let said = take_made_up_speeds(&mut table).expect("they are found");
        assert!(
            said.contains("(its rotor speeds are the duties times 628.3 rad/s, so that"),
            "{said}"
        );
        assert_eq!(table.columns.len(), 5);
        // A rotor with a lag of 40 ms is one.
        let mut table = with_speeds(10.0, 628.3);
        assert_eq!(take_made_up_speeds(&mut table), None);
        assert_eq!(table.columns.len(), 9);
        assert_eq!(take_made_up_speeds(&mut Table::default()), None);
    }

    #[test]
    fn val_simulators_are_told_from_vehicles() {
        for log in [with("SIM", 0), with("vehicle_attitude_groundtruth", 0), with("IMU", 20)] {
            assert!(of_streams(&log).is_some_and(|note| note.starts_with("A SIMULATOR")));
        }
        // A vehicle with a parameter of a simulated battery.
        assert!(of_streams(&with("IMU", 1)).is_none());
        let mut table = Table::default();
        table.push("time_s", vec![0.0]);
        assert!(of_columns(&table).is_none());
        table.push("true_roll_rad", vec![0.0]);
        assert!(of_columns(&table).is_some());
    }
}
