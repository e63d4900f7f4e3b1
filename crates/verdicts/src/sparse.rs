//! A battery voltage of a log that has it in some of its rows only, as where several streams share a table.
//!
//! Between two values it is a straight line, as an autopilot's log is read; before the first and after the last it is
//! held. Both end after [`GAP_FACTOR`] of its own usual intervals: a voltage that stopped is not known. A column whose
//! values usually follow each other in every row is left as it is: its empty cells are lost steps, as in every column.

use rotortwin_twin::log::{FlightLog, GAP_FACTOR, names};

/// Fewest values that have a usual interval.
const FEWEST: usize = 8;
/// Usual interval from which a column is slower than the rows, in intervals of the rows.
const SLOWER: f64 = 1.5;

/// The log with the voltage in every row, and a note that says so; `None`: it needs none.
pub(crate) fn with_voltage_in_every_row(log: &FlightLog) -> Option<(FlightLog, String)> {
    let voltage = log.column(names::BATTERY_VOLTAGE)?;
    let known: Vec<usize> = (0..voltage.len()).filter(|row| !voltage[*row].is_nan()).collect();
    if known.len() < FEWEST || known.len() == voltage.len() {
        return None;
    }
    let interval_s = |pair: &[usize]| log.time_s[pair[1]] - log.time_s[pair[0]];
    let mut intervals: Vec<f64> = known.windows(2).map(interval_s).collect();
    let middle = intervals.len() / 2;
    let usual_s = *intervals.select_nth_unstable_by(middle, f64::total_cmp).1;
    if usual_s * log.sample_rate_hz() < SLOWER {
        return None;
    }
    let longest_s = GAP_FACTOR * usual_s;
    let mut filled = voltage.to_vec();
    for pair in known.windows(2).filter(|pair| interval_s(pair) <= longest_s) {
        let [before, after] = [pair[0], pair[1]];
        for row in before + 1..after {
            let share = (log.time_s[row] - log.time_s[before]) / (log.time_s[after] - log.time_s[before]);
            filled[row] = voltage[before] + share * (voltage[after] - voltage[before]);
        }
    }
    let (first, last) = (known[0], known[known.len() - 1]);
    let near = |row: usize, end: usize| (log.time_s[row] - log.time_s[end]).abs() <= longest_s;
    for row in (0..first).filter(|row| near(*row, first)) {
        filled[row] = voltage[first];
    }
    for row in (last + 1..voltage.len()).filter(|row| near(*row, last)) {
        filled[row] = voltage[last];
    }
    let note = format!(
        "{} has values in {} of {} rows ({:.1} Hz in rows of {:.1} Hz): interpolated linearly between them",
        names::BATTERY_VOLTAGE,
        known.len(),
        voltage.len(),
        1.0 / usual_s,
        log.sample_rate_hz()
    );
    let mut log = log.clone();
    log.columns.insert(names::BATTERY_VOLTAGE.to_owned(), filled);
    Some((log, note))
}
