//! From a table to a log: every refusal of the canonical format, Euler angles, the import report.

use super::checks;
use super::report::{Gap, ImportReport, MissingCells, UnusedColumn};
use super::side_file::SideFile;
use super::table::{RawColumn, Table};
use super::{FlightLog, GAP_FACTOR, LogError, LogSource, names, resample, stamps};
use std::collections::BTreeMap;
use std::path::Path;

/// Why an empty column is not used.
const NO_NUMBER: &str = "no number in it";
/// Attitude quaternions may be this far from unit length (rounding of a printed quaternion is 1e-3).
const QUATERNION_TOLERANCE: f64 = 0.02;
/// Duties may leave 0…1 by this much (rounding of f32 and of PWM counts); they are limited to 0…1.
const DUTY_TOLERANCE: f64 = 1e-6;
/// The median specific force of a flight is near 9.81 m/s²; between these, in units of the column, it can only be g.
const ACCEL_IN_G: std::ops::Range<f64> = 0.7..1.4;
/// No pitch in radians is beyond ±π/2; rounding allowed.
const PITCH_LIMIT_RAD: f64 = std::f64::consts::FRAC_PI_2 + 1e-3;

/// No multirotor flies faster for half of a flight, m/s.
const FASTEST_M_S: f64 = 100.0;
/// Highest voltage of a flight over its cells, V: of an empty cell at rest to more than a full one of the high-voltage kind.
const CELL_V: std::ops::RangeInclusive<f64> = 3.2..=4.5;
/// Most cells in series.
const MOST_CELLS: u32 = 24;

/// Checks a table and makes a log of it.
pub(crate) fn accept(source: LogSource, table: Table, side: Option<SideFile>) -> Result<FlightLog, LogError> {
    let path = source.path.clone();
    let mut report = ImportReport::default();
    let mut columns = BTreeMap::new();
    let mut time = None;
    for column in table.columns {
        refuse_cells(&path, &column)?;
        if column.name == names::TIME {
            time = Some(column.values);
        } else if column.bad_cells > 0 && column.values.iter().all(|value| value.is_nan()) {
            report.unused_columns.push(UnusedColumn {
                column: column.name,
                reason: NO_NUMBER.to_owned(),
            });
        } else {
            if let Some((row, text)) = &column.bad {
                report.notes.push(format!(
                    "column {}: {} cells that are not numbers are treated as empty (first: '{text}' in row {row})",
                    column.name, column.bad_cells
                ));
            }
            columns.insert(column.name, column.values);
        }
    }
    let time_s = time.ok_or_else(|| {
        const SHOWN: usize = 8;
        let known: Vec<&str> = columns.keys().map(String::as_str).collect();
        let found = match known.len() {
            0 => "nothing".to_owned(),
            more if more > SHOWN => format!("{} and {} more", known[..SHOWN].join(", "), more - SHOWN),
            _ => known.join(", "),
        };
        LogError::format(
            &path,
            format!(
                "column {} is missing (found: {found}); {}",
                names::TIME,
                super::csv::DRAFT
            ),
        )
    })?;
    refuse_time(&path, &time_s)?;
    refuse_rotor_gaps(&path, &columns)?;
    limit_duties(&path, &mut columns)?;
    refuse_units(&path, &columns)?;
    euler_from_quaternion(&path, &mut columns, &mut report)?;

    report.rows = time_s.len();
    report.unknown_columns = columns
        .keys()
        .filter(|name| !names::is_canonical(name))
        .cloned()
        .collect();
    report.missing_cells = missing_cells(&columns);
    let side = side.unwrap_or_default();
    if let Some(origin) = side.source {
        report.notes.push(format!("source: {origin}"));
    }
    let mut log = FlightLog {
        name: path
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
        source,
        time_s,
        columns,
        segments: side.segments,
        vehicle: side.vehicle,
        origin: side.origin,
        licence: side.licence,
        parameters: std::collections::BTreeMap::new(),
        report,
    };
    stamps::regularise(&mut log);
    log.report.sample_rate_hz = resample::usual_rate_hz(&log.time_s);
    log.report.gaps = gaps(&log.time_s);
    leave_out_runaway_estimates(&mut log);
    leave_out_what_stopped(&mut log);
    leave_out_other_voltages(&mut log);
    leave_out_currents_of_no_flight(&mut log);
    checks::examine(&mut log);
    drop_empty_columns(&mut log);
    Ok(log)
}

/// An estimator that was logged without being flown by may run away, with speeds that no multirotor has: its velocity and position say nothing,
/// and rates, accelerometer and attitude are as good as ever. A velocity that follows the accelerometer by a
/// large factor did not run away: it is in another unit, which the checks report.
fn leave_out_runaway_estimates(log: &mut FlightLog) {
    let Some(velocity) = log.vector(names::VELOCITY) else {
        return;
    };
    let speed = |row: usize| velocity.iter().map(|axis| axis[row] * axis[row]).sum::<f64>().sqrt();
    let mut speeds: Vec<f64> = (0..log.time_s.len())
        .map(speed)
        .filter(|speed| speed.is_finite())
        .collect();
    let Some(median) = resample::median(&mut speeds).filter(|median| *median > FASTEST_M_S) else {
        return;
    };
    if checks::velocity_is_in_a_smaller_unit(log) {
        return;
    }
    let reason = format!("the estimator ran away: half of the time its speed is above {median:.0} m/s");
    leave_out(log, &[names::VELOCITY, names::POSITION].concat(), &reason);
}

/// A gyroscope or accelerometer that worked and then freezes for more than half of the log while the motors' commands
/// change: a model would be blamed for not following a frozen column.
fn leave_out_what_stopped(log: &mut FlightLog) {
    let span_s = log.time_s.last().unwrap_or(&0.0) - log.time_s.first().unwrap_or(&0.0);
    let stopped: Vec<(&str, f64, f64)> = names::RATES
        .iter()
        .chain(&names::ACCEL)
        .filter_map(|name| {
            let (start_s, end_s) = checks::stands_still(log, name)?;
            let commanded = end_s - start_s > 0.5 * span_s && checks::motors_change(log, start_s, end_s);
            commanded.then_some((*name, start_s, end_s))
        })
        .collect();
    for (name, start_s, end_s) in stopped {
        let reason = format!("it stands still from {start_s:.2} s to {end_s:.2} s: the sensor or its logging stopped");
        leave_out(log, &[name], &reason);
    }
}

/// A voltage that no number of LiPo cells has comes from another supply, or from a sensor that is not connected or not
/// scaled: no model of the battery can be compared with it.
fn leave_out_other_voltages(log: &mut FlightLog) {
    let Some(values) = log.column(names::BATTERY_VOLTAGE) else {
        return;
    };
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    });
    let of_cells = (1..=MOST_CELLS).any(|cells| CELL_V.contains(&(high / f64::from(cells))));
    if high < low || of_cells {
        return;
    }
    let reason = format!(
        "{low:.2} to {high:.2} V is the voltage of no number of LiPo cells ({} to {} V each at the highest): the sensor is not connected or not scaled",
        CELL_V.start(),
        CELL_V.end()
    );
    leave_out(log, &[names::BATTERY_VOLTAGE], &reason);
}

/// A current that is too small for the logged flight comes from a sensor that is not connected or not scaled; so does
/// one that is smaller than what the autopilot itself draws.
fn leave_out_currents_of_no_flight(log: &mut FlightLog) {
    let Some(current) = checks::idle_current(log) else {
        return;
    };
    let (most_a, where_it_is) = (current.most_a, current.where_it_is);
    let reason = if current.measures_nothing {
        format!(
            "at most {most_a:.3} A in {where_it_is}, and for half of that time less than an autopilot itself takes: the sensor is not connected \
             or not scaled"
        )
    } else if checks::moves_under_power(log) {
        format!(
            "at most {most_a:.2} A in {where_it_is}, and the motors are under load: the sensor is not connected or not scaled"
        )
    } else {
        return;
    };
    leave_out(log, &[names::BATTERY_CURRENT], &reason);
}

/// Takes columns out, with the reason.
fn leave_out(log: &mut FlightLog, columns: &[&str], reason: &str) {
    for column in columns {
        if log.columns.remove(*column).is_some() {
            log.report.missing_cells.retain(|missing| missing.column != *column);
            log.report.unused_columns.push(UnusedColumn {
                column: (*column).to_owned(),
                reason: reason.to_owned(),
            });
        }
    }
    log.report
        .notes
        .push(format!("{} left out: {reason}", columns.join(", ")));
}

/// A column without any value would replace one that can be computed from others: an empty accelerometer the force
/// computed from the velocity.
fn drop_empty_columns(log: &mut FlightLog) {
    let empty = |values: &[f64]| !values.is_empty() && values.iter().all(|value| value.is_nan());
    let names: Vec<String> = log
        .columns
        .iter()
        .filter(|(_, values)| empty(values))
        .map(|(name, _)| name.clone())
        .collect();
    for column in names {
        log.columns.remove(&column);
        log.report.unused_columns.push(UnusedColumn {
            column,
            reason: NO_NUMBER.to_owned(),
        });
    }
}

/// A canonical column holds numbers or nothing.
fn refuse_cells(path: &Path, column: &RawColumn) -> Result<(), LogError> {
    let Some((row, text)) = &column.bad else {
        return Ok(());
    };
    if !names::is_canonical(&column.name) {
        return Ok(());
    }
    let lower = text.to_ascii_lowercase();
    let word = lower.trim_start_matches(['-', '+']);
    let reason = if ["nan", "inf", "infinity"].contains(&word) {
        format!("'{text}' is not a finite number; leave a cell without a value empty")
    } else {
        format!("'{text}' is not a number")
    };
    Err(LogError::cell(path, *row, &column.name, reason))
}

fn refuse_time(path: &Path, time_s: &[f64]) -> Result<(), LogError> {
    if time_s.len() < 2 {
        let found = time_s.len();
        return Err(LogError::format(path, format!("{found} rows; a log has at least two")));
    }
    if let Some(row) = time_s.iter().position(|time| time.is_nan()) {
        return Err(LogError::cell(
            path,
            row + 1,
            names::TIME,
            "empty; every row needs a time",
        ));
    }
    for (index, pair) in time_s.windows(2).enumerate() {
        let row = index + 2;
        if pair[1] == pair[0] {
            return Err(LogError::cell(
                path,
                row,
                names::TIME,
                format!("the previous row has {} s as well; time must increase", pair[1]),
            ));
        }
        if pair[1] < pair[0] {
            return Err(LogError::cell(
                path,
                row,
                names::TIME,
                format!("{} s after {} s; time must increase", pair[1], pair[0]),
            ));
        }
    }
    Ok(())
}

/// `duty_1`, `duty_3` without `duty_2` is a mistake in a header, not a vehicle.
fn refuse_rotor_gaps(path: &Path, columns: &BTreeMap<String, Vec<f64>>) -> Result<(), LogError> {
    let count = columns
        .keys()
        .filter_map(|name| names::duty_rotor(name))
        .max()
        .unwrap_or(0);
    for rotor in 1..=count {
        let name = names::duty(rotor);
        if !columns.contains_key(&name) {
            return Err(LogError::column(
                path,
                &name,
                format!("missing, but {} is there", names::duty(count)),
            ));
        }
    }
    Ok(())
}

fn limit_duties(path: &Path, columns: &mut BTreeMap<String, Vec<f64>>) -> Result<(), LogError> {
    for (name, values) in columns.iter_mut().filter(|(name, _)| names::duty_rotor(name).is_some()) {
        for (index, value) in values.iter_mut().enumerate() {
            if *value < -DUTY_TOLERANCE || *value > 1.0 + DUTY_TOLERANCE {
                return Err(LogError::cell(
                    path,
                    index + 1,
                    name,
                    format!("{value} is not a duty; 0 to 1 was expected"),
                ));
            }
            if !value.is_nan() {
                *value = value.clamp(0.0, 1.0);
            }
        }
    }
    Ok(())
}

/// Units that cannot be right for any vehicle.
fn refuse_units(path: &Path, columns: &BTreeMap<String, Vec<f64>>) -> Result<(), LogError> {
    let accel: Vec<&Vec<f64>> = names::ACCEL.iter().filter_map(|name| columns.get(*name)).collect();
    if accel.len() == 3 {
        let norms = (0..accel[0].len()).map(|row| accel.iter().map(|axis| axis[row] * axis[row]).sum::<f64>().sqrt());
        refuse_g(path, "|accel|", norms.collect())?;
    } else if let Some(values) = columns.get(names::ACCEL[2]) {
        refuse_g(path, names::ACCEL[2], values.iter().map(|value| value.abs()).collect())?;
    }
    if let Some(values) = columns.get(names::ATTITUDE[1])
        && let Some(row) = values.iter().position(|pitch| pitch.abs() > PITCH_LIMIT_RAD)
    {
        return Err(LogError::cell(
            path,
            row + 1,
            names::ATTITUDE[1],
            format!("{} cannot be a pitch in radians (−π/2 to π/2); degrees?", values[row]),
        ));
    }
    Ok(())
}

fn refuse_g(path: &Path, what: &str, mut norms: Vec<f64>) -> Result<(), LogError> {
    norms.retain(|norm| !norm.is_nan());
    match resample::median(&mut norms) {
        Some(median) if ACCEL_IN_G.contains(&median) => Err(LogError::column(
            path,
            names::ACCEL[2],
            format!(
                "the median of {what} is {median:.3}, so the accelerometer is in g; m/s² was expected (about 9.81)"
            ),
        )),
        _ => Ok(()),
    }
}

/// Roll, pitch and yaw from the quaternion, where the file has only that.
fn euler_from_quaternion(
    path: &Path,
    columns: &mut BTreeMap<String, Vec<f64>>,
    report: &mut ImportReport,
) -> Result<(), LogError> {
    if !names::QUATERNION.iter().all(|name| columns.contains_key(*name)) {
        return Ok(());
    }
    let parts = names::QUATERNION.map(|name| columns[name].clone());
    let rows = parts[0].len();
    let mut angles = [vec![f64::NAN; rows], vec![f64::NAN; rows], vec![f64::NAN; rows]];
    for row in 0..rows {
        let quaternion = [parts[0][row], parts[1][row], parts[2][row], parts[3][row]];
        let length = quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
        if length.is_nan() {
            continue;
        }
        if (length - 1.0).abs() > QUATERNION_TOLERANCE {
            return Err(LogError::cell(
                path,
                row + 1,
                names::QUATERNION[0],
                format!("the quaternion has length {length:.4}; 1 was expected"),
            ));
        }
        for (angle, value) in angles.iter_mut().zip(euler(quaternion.map(|part| part / length))) {
            angle[row] = value;
        }
    }
    if names::ATTITUDE.iter().any(|name| columns.contains_key(*name)) {
        report
            .notes
            .push("both Euler angles and a quaternion are there; the Euler angles are used".to_owned());
        return Ok(());
    }
    for (name, values) in names::ATTITUDE.iter().zip(angles) {
        columns.insert((*name).to_owned(), values);
    }
    report
        .conversions
        .push("roll_rad, pitch_rad, yaw_rad from the quaternion".to_owned());
    Ok(())
}

/// Euler angles ZYX (roll, pitch, yaw), rad, of a unit quaternion (w, x, y, z), body → NED.
pub(crate) fn euler([w, x, y, z]: [f64; 4]) -> [f64; 3] {
    [
        (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
        (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin(),
        (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
    ]
}

fn gaps(time_s: &[f64]) -> Vec<Gap> {
    let rate = resample::usual_rate_hz(time_s);
    time_s
        .windows(2)
        .filter(|pair| (pair[1] - pair[0]) * rate > GAP_FACTOR)
        .map(|pair| Gap {
            start_s: pair[0],
            end_s: pair[1],
        })
        .collect()
}

fn missing_cells(columns: &BTreeMap<String, Vec<f64>>) -> Vec<MissingCells> {
    columns
        .iter()
        .map(|(name, values)| MissingCells {
            column: name.clone(),
            cells: values.iter().filter(|value| value.is_nan()).count(),
        })
        .filter(|missing| missing.cells > 0)
        .collect()
}
