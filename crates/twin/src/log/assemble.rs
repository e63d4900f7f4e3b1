//! Streams of different rate → one table on one time base.
//!
//! ```text
//! SourceLog ─▶ rows of the mapping that the log can serve ─▶ units, frames ─▶ time base ─▶ Table
//! ```
//! The time base is the stream that the mapping prefers, otherwise the fastest one in use. The others are interpolated
//! linearly onto it (angles the short way round, quaternions normalised), commands are held. No filter is applied: a
//! stream that is faster than the base aliases, one that is slower is correlated from row to row; the report says which
//! is which.

use super::mapping::{Frame, Level, MappingFile, Row, Target};
use super::report::{Flown, ImportReport, Stream, UnusedColumn};
use super::resample::{Between, at_times, median, usual_rate_hz};
use super::sources::{RawStream, SourceLog};
use super::table::Table;
use super::units::{self, Dimension};
use super::{GAP_FACTOR, Origin, happenings, names, outputs, utc};
use rotortwin_flight_core::MAX_ROTORS;
use std::collections::BTreeSet;

/// Result of [`assemble`].
pub(crate) struct Assembled {
    pub(crate) table: Table,
    pub(crate) report: ImportReport,
    pub(crate) origin: Option<Origin>,
}

/// One row of the mapping that the log can serve.
struct Served<'a> {
    row: &'a Row,
    target: Target,
    stream: usize,
    fields: Vec<usize>,
}

/// Mean radius of the Earth: the radius of curvature is within 0.4 % of it everywhere on the ellipsoid, m.
const EARTH_RADIUS_M: f64 = 6_371_000.0;

/// Puts a parsed log on one time base; the error is the reason without the file's name.
pub(crate) fn assemble(log: &SourceLog, mapping: &MappingFile, most_cells: usize) -> Result<Assembled, String> {
    let mut report = ImportReport {
        notes: log.notes.clone(),
        ..ImportReport::default()
    };
    let served = serve(log, mapping, &mut report);
    let base = base_stream(log, mapping, &served).ok_or_else(|| nothing_served(log))?;
    let start_s = log.streams[base].time_s[0];
    let base_s = &log.streams[base].time_s;
    // A column may be long if it is resampled to the base's time, or if its fields come from many mapping rows.
    let columns: usize = 1 + served.iter().map(|served| served.fields.len()).sum::<usize>();
    if base_s.len() > most_cells / columns {
        return Err(format!(
            "{} rows of {columns} columns are more than this program takes",
            base_s.len()
        ));
    }
    report.clock_start_s = Some(log.clock_s + start_s);
    report.flown = utc::of_source(log).map(|flown| Flown {
        unix_s: flown.unix_s + start_s,
        ..flown
    });
    report.happenings = happenings::of(log, start_s);
    report.other_vehicle = outputs::other_vehicle(log);
    let mut table = Table::default();
    table.push(names::TIME, base_s.iter().map(|time| time - start_s).collect());
    let mut origin = None;
    for served in &served {
        for (name, values, between) in convert(log, served, &mut report, &mut origin)? {
            if values.iter().all(|value| value.is_nan()) {
                report
                    .notes
                    .push(format!("{name}: no valid sample in {}, left out", served.row.from));
                continue;
            }
            let stream = &log.streams[served.stream];
            let values = if served.stream == base {
                values
            } else {
                let gap_s = GAP_FACTOR / usual_rate_hz(&stream.time_s);
                at_times(&stream.time_s, &values, base_s, between, gap_s)
            };
            table.push(&name, values);
        }
    }
    normalise_quaternion(&mut table);
    describe_streams(log, &served, base, &mut report);
    if mapping.keep_rest {
        keep_rest(&log.streams[base], base, &served, &mut table);
    } else {
        list_unused(log, &served, &mut report);
    }
    Ok(Assembled { table, report, origin })
}

/// Why a log is refused in which no mapping row finds a field, and how to fix it: with the names of its fields if
/// possible.
fn nothing_served(log: &SourceLog) -> String {
    /// Topics, and fields of each, that are listed.
    const TOPICS: usize = 12;
    const FIELDS: usize = 8;
    if log.streams.is_empty() {
        return "no field of this log is in the mapping (topics: none): it holds no message that this program reads"
            .to_owned();
    }
    let fields = |stream: &RawStream| {
        let names: Vec<&str> = stream
            .fields
            .iter()
            .map(|(name, _)| name.as_str())
            .take(FIELDS)
            .collect();
        let more = if stream.fields.len() > FIELDS { ", …" } else { "" };
        format!("{}:{}{more}", stream.label(), names.join(","))
    };
    let mut found: Vec<String> = log.streams.iter().take(TOPICS).map(fields).collect();
    if log.streams.len() > TOPICS {
        found.push(format!("{} more topics", log.streams.len() - TOPICS));
    }
    format!(
        "no field of this log is in the mapping (its fields: {}); if motor outputs, rotor speeds, body rates or an accelerometer are among them, a file \
         with rows such as `to = \"rates\"`, `from = \"topic:field,field,field\"` names them: `--mapping FILE`",
        found.join("; ")
    )
}

/// The first row of each target whose fields are in the log and hold numbers.
fn serve<'a>(log: &SourceLog, mapping: &'a MappingFile, report: &mut ImportReport) -> Vec<Served<'a>> {
    let mut taken: BTreeSet<&str> = BTreeSet::new();
    let mut served: Vec<Served<'_>> = Vec::new();
    // Motor outputs that stand still; another instance of the topic may be the one that flies the vehicle.
    let mut still: Option<Served<'_>> = None;
    for row in &mapping.rows {
        // Euler angles and quaternion carry the same information; the first one found is used.
        let key = if row.to == "quaternion" {
            "attitude"
        } else {
            row.to.as_str()
        };
        if taken.contains(key) {
            continue;
        }
        let Some(place) = row.place() else {
            taken.insert(key);
            continue;
        };
        let target = Target::of(&row.to);
        let found = log
            .streams
            .iter()
            .position(|stream| stream.is_called(place.topic, place.instance));
        let Some(index) = found else { continue };
        let stream = &log.streams[index];
        let fields = find_fields(stream, &place.fields);
        let enough = match &target {
            Target::Columns(columns, _) => fields.len() == columns.len(),
            Target::Own(_) => fields.len() == 1,
            Target::Duty | Target::RotorSpeed => !fields.is_empty(),
        };
        // A field that is 0 or empty throughout was never written.
        let written = fields.iter().any(|field| {
            stream.fields[*field]
                .1
                .iter()
                .any(|value| value.is_finite() && *value != 0.0)
        });
        if !enough || stream.time_s.len() < 2 {
            continue;
        }
        if !written && row.to != "duty" {
            report.notes.push(format!("{}: only zeros, left out", row.from));
            continue;
        }
        let measured = |field: &usize| {
            let values = &stream.fields[*field].1;
            values
                .iter()
                .any(|value| value.is_finite() && !is_unmeasured(row, *value))
        };
        if !fields.iter().any(measured) {
            report.notes.push(format!(
                "{}: the autopilot reports that it is not measured: left out",
                row.from
            ));
            continue;
        }
        let found = Served {
            row,
            target,
            stream: index,
            fields,
        };
        if row.to == "duty" {
            let varies = |field: &usize| {
                let values = &stream.fields[*field].1;
                let mut finite = values.iter().filter(|value| value.is_finite());
                finite.next().is_some_and(|first| finite.any(|value| value != first))
            };
            let moves = found.fields.iter().any(varies);
            match &still {
                None if !moves => {
                    still = Some(found);
                    continue;
                }
                Some(first) => {
                    let same = log.streams[first.stream].name == stream.name && first.stream != index;
                    if !moves || !same {
                        continue;
                    }
                    report.notes.push(format!(
                        "{}: its outputs stand still, those of {} move and are read",
                        log.streams[first.stream].label(),
                        stream.label()
                    ));
                }
                None => {}
            }
        }
        taken.insert(key);
        served.push(found);
    }
    served.extend(still.filter(|_| !taken.contains("duty")));
    served
}

/// Numbers that mean "not measured", in the unit of the source: for PX4's and MAVLink's current −1, for MAVLink's
/// voltage all bits set.
fn is_unmeasured(row: &Row, value: f64) -> bool {
    match row.to.as_str() {
        names::BATTERY_CURRENT => value == -1.0,
        names::BATTERY_VOLTAGE => value == f64::from(u16::MAX),
        _ => false,
    }
}

/// Indices of the fields; a name with `[]` counts up from 0 as far as there are fields, `{}` from 1.
fn find_fields(stream: &RawStream, wanted: &[&str]) -> Vec<usize> {
    let index = |name: &str| stream.fields.iter().position(|(field, _)| field == name);
    let mut found = Vec::new();
    for name in wanted {
        if name.contains("[]") {
            found.extend((0..).map_while(|number| index(&name.replace("[]", &format!("[{number}]")))));
        } else if name.contains("{}") {
            found.extend((1..).map_while(|number| index(&name.replace("{}", &number.to_string()))));
        } else {
            match index(name) {
                Some(index) => found.push(index),
                None => return Vec::new(),
            }
        }
    }
    found
}

fn base_stream(log: &SourceLog, mapping: &MappingFile, served: &[Served<'_>]) -> Option<usize> {
    let used: BTreeSet<usize> = served.iter().map(|served| served.stream).collect();
    let rate = |index: &usize| usual_rate_hz(&log.streams[*index].time_s);
    let fastest = used.iter().map(rate).fold(0.0, f64::max);
    // A preferred stream that is much slower than the fastest would throw samples away.
    const SLOWEST_SHARE: f64 = 0.5;
    mapping
        .base
        .iter()
        .filter_map(|name| {
            let means = |index: &&usize| {
                let stream = &log.streams[**index];
                stream.label() == *name || stream.is_called(name, 0)
            };
            used.iter().find(means)
        })
        .find(|index| rate(index) >= SLOWEST_SHARE * fastest)
        .copied()
        .or_else(|| used.iter().copied().max_by(|a, b| rate(a).total_cmp(&rate(b))))
}

type Converted = Vec<(String, Vec<f64>, Between)>;

/// The columns of one row on the stream's own time, in SI, NED and FRD.
fn convert(
    log: &SourceLog,
    served: &Served<'_>,
    report: &mut ImportReport,
    origin: &mut Option<Origin>,
) -> Result<Converted, String> {
    let stream = &log.streams[served.stream];
    let row = served.row;
    let mut values: Vec<Vec<f64>> = served
        .fields
        .iter()
        .map(|field| stream.fields[*field].1.clone())
        .collect();
    // Infinite values mean "none" in several logs.
    for value in values.iter_mut().flatten() {
        if value.is_infinite() || is_unmeasured(row, *value) {
            *value = f64::NAN;
        }
    }
    if let Some(valid) = &row.valid
        && let Some((_, flags)) = stream.fields.iter().find(|(name, _)| name == valid)
    {
        for column in &mut values {
            for (value, flag) in column.iter_mut().zip(flags) {
                if *flag == 0.0 {
                    *value = f64::NAN;
                }
            }
        }
    }
    if row.frame == Some(Frame::Geodetic) {
        local_tangent(&mut values, origin, report);
    } else {
        let (unit, factor) = unit_of(row, stream, &values)?;
        let factor = factor * row.factor.unwrap_or(1.0);
        scale(&mut values, factor);
        describe_conversion(row, stream, unit, report);
    }
    if let Some(frame) = row.frame {
        turn(&row.to, frame, &mut values);
    }
    Ok(match &served.target {
        Target::Columns(columns, _) => columns
            .iter()
            .zip(values)
            .map(|(name, values)| ((*name).to_owned(), values, Between::of(name)))
            .collect(),
        Target::Own(name) => vec![(name.clone(), values.swap_remove(0), Between::Hold)],
        Target::Duty => duties(log, row, values, report)?,
        Target::RotorSpeed => ordered(row, values)?
            .into_iter()
            .enumerate()
            .map(|(rotor, values)| (names::rotor_speed(rotor + 1), values, Between::Linear))
            .collect(),
    })
}

/// Rows over which a vibration averages out, so that gravity remains.
const RUN_ROWS: usize = 256;

/// The unit of a row: that of another field of its message, otherwise the first that is consistent with the data.
fn unit_of<'a>(row: &'a Row, stream: &RawStream, values: &[Vec<f64>]) -> Result<(&'a str, f64), String> {
    let place = row.unit_as.as_ref().and_then(|other| {
        let (_, values) = stream.fields.iter().find(|(name, _)| *name == other.field)?;
        let (chosen, _) = fitting_unit(other.unit.list(), std::slice::from_ref(values)).ok()?;
        other.unit.list().iter().position(|name| name == chosen)
    });
    match place.and_then(|place| row.unit.list().get(place)) {
        Some(name) => units::unit(name)
            .map(|(factor, _)| (name.as_str(), factor))
            .ok_or_else(|| format!("unit '{name}' is not known")),
        None => chosen_unit(row, values),
    }
}

/// The first unit of a row that is consistent with the data.
pub(super) fn chosen_unit<'a>(row: &'a Row, values: &[Vec<f64>]) -> Result<(&'a str, f64), String> {
    fitting_unit(row.unit.list(), values).map_err(|found| {
        format!(
            "{}: the unit cannot be right: {found}; set the unit of '{}' in a mapping",
            row.from, row.to
        )
    })
}

/// The first of several units that is consistent with the data, with its factor; otherwise the median in each unit.
///
/// A vehicle may shake by more than gravity: if no unit fits the samples of an accelerometer, their means over
/// [`RUN_ROWS`] decide.
fn fitting_unit<'a>(units: &'a [String], values: &[Vec<f64>]) -> Result<(&'a str, f64), String> {
    let mut tried = Vec::new();
    for run in [1, RUN_ROWS] {
        for name in units {
            let (factor, dimension) = units::unit(name).ok_or_else(|| format!("unit '{name}' is not known"))?;
            let Some(range) = units::plausible_median(dimension) else {
                return Ok((name, factor));
            };
            if run > 1 && dimension != Dimension::Acceleration {
                continue;
            }
            let Some(median) = median_size(values, factor, run) else {
                return Ok((name, factor));
            };
            // A battery that is not connected reads 0: this says nothing about the unit.
            if range.contains(&median)
                || median == 0.0
                || (dimension == Dimension::Voltage && median < 1.0 && units.len() == 1)
            {
                return Ok((name, factor));
            }
            if run == 1 {
                tried.push(format!("{median:.4} in {name}"));
            }
        }
    }
    Err(format!("the median is {}", tried.join(", ")))
}

/// Median of the length of the mean vector over runs of rows.
fn median_size(values: &[Vec<f64>], factor: f64, run: usize) -> Option<f64> {
    let samples = values.first().map_or(0, Vec::len);
    let size = |first: usize| {
        let rows = first..(first + run).min(samples);
        let mean = |column: &Vec<f64>| column[rows.clone()].iter().sum::<f64>() / rows.len() as f64;
        factor * values.iter().map(|column| mean(column).powi(2)).sum::<f64>().sqrt()
    };
    let mut sizes: Vec<f64> = (0..samples)
        .step_by(run)
        .map(size)
        .filter(|size| size.is_finite())
        .collect();
    median(&mut sizes)
}

pub(super) fn scale(values: &mut [Vec<f64>], factor: f64) {
    for value in values.iter_mut().flatten() {
        *value *= factor;
    }
}

fn negate(values: &mut [f64]) {
    for value in values {
        *value = -*value;
    }
}

/// Turns vectors, Euler angles and quaternions into NED and FRD.
pub(super) fn turn(to: &str, frame: Frame, values: &mut [Vec<f64>]) {
    match (frame, to) {
        (Frame::Enu, _) => {
            values.swap(0, 1);
            negate(&mut values[2]);
        }
        (Frame::Flu | Frame::Nwu, _) | (Frame::NwuFlu, "attitude") => {
            negate(&mut values[1]);
            negate(&mut values[2]);
        }
        (Frame::EnuFlu, "attitude") => {
            negate(&mut values[1]);
            for yaw in &mut values[2] {
                *yaw = super::resample::wrapped(std::f64::consts::FRAC_PI_2 - *yaw);
            }
        }
        (Frame::NwuFlu, _) => {
            // q_ned_frd = x q x⁻¹ with the half turn about x that exchanges both frames.
            negate(&mut values[2]);
            negate(&mut values[3]);
        }
        (Frame::EnuFlu, _) => {
            // R_ned_frd = P R_enu_flu D, P exchanges x and y and negates z, D negates y and z; P = half turn about (1,
            // 1, 0)/√2.
            let half = std::f64::consts::FRAC_1_SQRT_2;
            for sample in 0..values[0].len() {
                let [w, x, y, z] = [0, 1, 2, 3].map(|part| values[part][sample]);
                // (0, h, h, 0) ⊗ q ⊗ (0, 1, 0, 0), sign free.
                let product = [-half * (x + y), half * (w + z), half * (w - z), half * (y - x)];
                let [a, b, c, d] = product;
                let turned = [-b, a, d, -c];
                for part in 0..4 {
                    values[part][sample] = turned[part];
                }
            }
        }
        (Frame::Frd | Frame::Ned | Frame::NedFrd | Frame::Geodetic, _) => {}
    }
    if to == "quaternion" {
        // Neighbours must not differ by the sign, which is arbitrary for a rotation.
        for sample in 1..values[0].len() {
            let same: f64 = (0..4).map(|part| values[part][sample] * values[part][sample - 1]).sum();
            if same < 0.0 {
                for column in values.iter_mut() {
                    column[sample] = -column[sample];
                }
            }
        }
    }
}

/// Latitude, longitude, altitude → NED about the first fix.
fn local_tangent(values: &mut [Vec<f64>], origin: &mut Option<Origin>, report: &mut ImportReport) {
    let first = (0..values[0].len())
        .find(|sample| values.iter().all(|column| column[*sample].is_finite()) && values[0][*sample] != 0.0);
    let Some(first) = first else { return };
    let zero = Origin {
        latitude_deg: values[0][first],
        longitude_deg: values[1][first],
        altitude_m: values[2][first],
    };
    let to_m = EARTH_RADIUS_M * std::f64::consts::PI / 180.0;
    let east_m = to_m * (zero.latitude_deg.to_radians()).cos();
    for sample in 0..values[0].len() {
        values[0][sample] = (values[0][sample] - zero.latitude_deg) * to_m;
        values[1][sample] = (values[1][sample] - zero.longitude_deg) * east_m;
        values[2][sample] = zero.altitude_m - values[2][sample];
    }
    origin.get_or_insert(zero);
    report
        .conversions
        .push("position: latitude, longitude, altitude → NED about the first fix (sphere)".to_owned());
}

fn describe_conversion(row: &Row, stream: &RawStream, unit: &str, report: &mut ImportReport) {
    let si = units::unit(unit).is_none_or(|(factor, _)| factor == 1.0);
    let turned = row
        .frame
        .filter(|frame| !matches!(frame, Frame::Frd | Frame::Ned | Frame::NedFrd));
    let frame = turned.map_or_else(String::new, |frame| format!(", from {} axes", frame.name()));
    let unit = if si { String::new() } else { format!(", from {unit}") };
    let sign = row.factor.map_or_else(String::new, |factor| format!(", × {factor}"));
    let fields = row.from.split_once(':').map_or("", |(_, fields)| fields);
    report
        .conversions
        .push(format!("{} ← {}:{fields}{unit}{frame}{sign}", row.to, stream.label()));
}

fn level(log: &SourceLog, level: Option<&Level>, default: f64) -> f64 {
    match level {
        None => default,
        Some(Level::Number(number)) => *number,
        Some(Level::Parameter { parameter, default }) => parameter
            .iter()
            .filter_map(|name| log.parameters.get(name))
            .copied()
            // 0 means that the autopilot uses another one: MOT_PWM_MIN 0 is the range of the throttle channel.
            .find(|level| *level != 0.0)
            .unwrap_or(*default),
    }
}

/// Fields in the rotor order of the vehicle file; unused trailing outputs are dropped.
fn ordered(row: &Row, mut values: Vec<Vec<f64>>) -> Result<Vec<Vec<f64>>, String> {
    if let Some(order) = &row.order {
        return order
            .iter()
            .map(|field| {
                let field = values.get(field - 1);
                field
                    .cloned()
                    .ok_or_else(|| format!("{}: order names a field that is not there", row.from))
            })
            .collect();
    }
    let used = |column: &Vec<f64>| column.iter().any(|value| value.is_finite() && *value != 0.0);
    while values.last().is_some_and(|column| !used(column)) {
        values.pop();
    }
    values.truncate(MAX_ROTORS);
    Ok(values)
}

fn duties(log: &SourceLog, row: &Row, values: Vec<Vec<f64>>, report: &mut ImportReport) -> Result<Converted, String> {
    let low = level(log, row.low.as_ref(), 0.0);
    let high = level(log, row.high.as_ref(), 1.0);
    let (low, high) = match raw_commands(&values, low, high) {
        Some(range) => {
            report.notes.push(format!(
                "{}: numbers beyond {MOST_PULSE_US} are no pulses of {low} to {high} µs: taken as raw commands of ESCs on a CAN bus, {} to {}",
                row.from, range.0, range.1
            ));
            range
        }
        None => (low, high),
    };
    if high.total_cmp(&low).is_le() {
        return Err(format!(
            "{}: {high} means duty 1 and {low} duty 0; the first must be larger",
            row.from
        ));
    }
    let duty_of = |value: f64| (value - low) / (high - low);
    if let Some(vehicle) = report.other_vehicle.as_ref().filter(|_| row.order.is_none()) {
        let reason = format!(
            "of {vehicle}: its outputs are servos as well, and no rotors; an order of a mapping says which are"
        );
        report.notes.push(format!("{}: left out: {reason}", row.from));
        report.unused_columns.push(UnusedColumn {
            column: format!("outputs 1 to {}", values.len()),
            reason,
        });
        return Ok(Vec::new());
    }
    let values = if row.order.is_none() {
        let duties: Vec<Vec<f64>> = values
            .iter()
            .map(|column| column.iter().map(|value| duty_of(*value)).collect())
            .collect();
        let rotors = if outputs::are_motors(&row.from) {
            outputs::all(duties.len())
        } else {
            outputs::rotors(&duties, &log.parameters)
        };
        only_rotors(row, values, &rotors, report)
    } else {
        values
    };
    let mut limited = 0_usize;
    let mut columns = Vec::new();
    for (rotor, mut column) in ordered(row, values)?.into_iter().enumerate() {
        for value in &mut column {
            let duty = duty_of(*value);
            limited += usize::from(!(0.0..=1.0).contains(&duty) && !duty.is_nan());
            *value = if duty.is_nan() { duty } else { duty.clamp(0.0, 1.0) };
        }
        columns.push((names::duty(rotor + 1), column, Between::Hold));
    }
    if row.low.is_some() || row.high.is_some() {
        report.conversions.push(format!("duty 0 at {low}, 1 at {high}"));
    }
    if limited > 0 {
        report.notes.push(format!(
            "{}: {limited} values outside of {low} to {high} are taken as duty 0 or 1",
            row.from
        ));
    }
    Ok(columns)
}

/// Longest pulse of a servo or an ESC, µs.
const MOST_PULSE_US: f64 = 2500.0;

/// The range of raw commands of ESCs on a CAN bus (`uavcan.equipment.esc.RawCommand`, 14 bits with a sign), if a range
/// of pulses is requested and the numbers are outside any such range.
fn raw_commands(values: &[Vec<f64>], low: f64, high: f64) -> Option<(f64, f64)> {
    const RAW: (f64, f64) = (0.0, 8191.0);
    let pulses = (700.0..1500.0).contains(&low) && (1500.0..=MOST_PULSE_US).contains(&high);
    let finite = values.iter().flatten().copied().filter(|value| value.is_finite());
    let most = finite.fold(f64::NEG_INFINITY, f64::max);
    (pulses && most > MOST_PULSE_US && most <= RAW.1).then_some(RAW)
}

/// The outputs that drive rotors, in their order; reports which those are and what is left out.
fn only_rotors(
    row: &Row,
    mut values: Vec<Vec<f64>>,
    rotors: &outputs::Rotors,
    report: &mut ImportReport,
) -> Vec<Vec<f64>> {
    report.rotor_outputs = rotors.outputs.iter().map(|output| output + 1).collect();
    if report.rotor_outputs.iter().copied().eq(1..=values.len()) {
        return values;
    }
    let list = |outputs: &[usize]| outputs.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let others: Vec<usize> = (1..=values.len())
        .filter(|output| !report.rotor_outputs.contains(output))
        .collect();
    report.notes.push(format!(
        "{}: rotors 1 to {} are the outputs {}",
        row.from,
        rotors.outputs.len(),
        list(&report.rotor_outputs)
    ));
    if !others.is_empty() {
        report.unused_columns.push(UnusedColumn {
            column: format!("outputs {}", list(&others)),
            reason: rotors.why.to_owned(),
        });
    }
    rotors
        .outputs
        .iter()
        .map(|output| std::mem::take(&mut values[*output]))
        .collect()
}

fn normalise_quaternion(table: &mut Table) {
    let places: Vec<usize> = names::QUATERNION
        .iter()
        .filter_map(|name| table.columns.iter().position(|column| column.name == *name))
        .collect();
    let [w, ..] = places.as_slice() else { return };
    if places.len() != 4 {
        return;
    }
    // Interpolation shortens a quaternion slightly; a length far from 1 must remain visible.
    const INTERPOLATED: std::ops::Range<f64> = 0.9..1.02;
    for row in 0..table.columns[*w].values.len() {
        let length = places
            .iter()
            .map(|place| table.columns[*place].values[row].powi(2))
            .sum::<f64>()
            .sqrt();
        if INTERPOLATED.contains(&length) {
            for place in &places {
                table.columns[*place].values[row] /= length;
            }
        }
    }
}

fn describe_streams(log: &SourceLog, served: &[Served<'_>], base: usize, report: &mut ImportReport) {
    let used: BTreeSet<usize> = served.iter().map(|served| served.stream).collect();
    let base_hz = usual_rate_hz(&log.streams[base].time_s);
    for index in used {
        let stream = &log.streams[index];
        let rate_hz = usual_rate_hz(&stream.time_s);
        let resampling = if index == base {
            "gives the time base".to_owned()
        } else if rate_hz > 1.2 * base_hz {
            "faster than the time base: interpolated without a filter, so it folds".to_owned()
        } else if rate_hz < base_hz / 1.2 {
            "slower than the time base: interpolated, so neighbouring rows are correlated".to_owned()
        } else {
            "interpolated onto the time base".to_owned()
        };
        if stream.dropped > 0 {
            report.notes.push(format!(
                "{}: {} samples whose time does not increase are left out",
                stream.label(),
                stream.dropped
            ));
        }
        report.streams.push(Stream {
            name: stream.label(),
            samples: stream.time_s.len(),
            sample_rate_hz: rate_hz,
            resampling,
        });
    }
}

fn keep_rest(stream: &RawStream, base: usize, served: &[Served<'_>], table: &mut Table) {
    let used: BTreeSet<usize> = served
        .iter()
        .filter(|served| served.stream == base)
        .flat_map(|served| served.fields.iter().copied())
        .collect();
    for (index, (name, values)) in stream.fields.iter().enumerate() {
        if !used.contains(&index) && !table.columns.iter().any(|column| column.name == *name) {
            table.push(name, values.clone());
        }
    }
}

fn list_unused(log: &SourceLog, served: &[Served<'_>], report: &mut ImportReport) {
    report
        .unused_columns
        .extend(log.unread.iter().map(|unread| UnusedColumn {
            column: unread.name.clone(),
            reason: unread.reason.clone(),
        }));
    let used: BTreeSet<usize> = served.iter().map(|served| served.stream).collect();
    for (index, stream) in log.streams.iter().enumerate() {
        if !used.contains(&index) {
            report.unused_columns.push(UnusedColumn {
                column: stream.label(),
                reason: format!(
                    "no row of the mapping uses this topic ({} samples)",
                    stream.time_s.len()
                ),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::mapping::{self, SourceName};

    /// 10 s at 50 Hz of one topic, each field by its number.
    fn stream(name: &str, fields: &[&str], of: impl Fn(usize, f64) -> f64) -> RawStream {
        let time_s: Vec<f64> = (0..500).map(|k| 0.02 * f64::from(k)).collect();
        let values = |field: usize| time_s.iter().map(|time| of(field, *time)).collect();
        RawStream {
            name: name.to_owned(),
            fields: fields
                .iter()
                .enumerate()
                .map(|(field, name)| ((*name).to_owned(), values(field)))
                .collect(),
            time_s,
            ..RawStream::default()
        }
    }

    fn assembled(log: &SourceLog, source: SourceName) -> Result<Assembled, String> {
        assemble(log, &mapping::load(source, None).unwrap(), 1 << 20)
    }

    /// Its attitude was reported "missing", though two estimators had logged it.
    #[test]
    fn regress_an_ardupilot_log_without_att_has_the_attitude_of_its_estimator() {
        let angles = ["Roll", "Pitch", "Yaw"];
        let of = |names: &[&str]| {
            let streams = names.iter().map(|name| {
                let scale = if *name == "AHR2" { 2.0 } else { 1.0 };
                stream(name, &angles, move |field, time| {
                    scale * (10.0 + field as f64 + (3.0 * time).sin())
                })
            });
            let log = SourceLog {
                streams: streams.collect(),
                ..SourceLog::default()
            };
            let table = assembled(&log, SourceName::ArdupilotDataflash).unwrap().table;
            let roll = table
                .columns
                .iter()
                .find(|column| column.name == names::ATTITUDE[0])
                .unwrap();
            roll.values[0].to_degrees()
        };
        assert!((of(&["AHR2", "XKF1"]) - 10.0).abs() < 1e-9);
        assert!((of(&["AHR2"]) - 20.0).abs() < 1e-9);
    }

    /// Three servos of an aeroplane were reported as "3 rotors".
    #[test]
    fn regress_outputs_of_an_aeroplane_are_no_rotors() {
        let outputs = ["output[0]", "output[1]", "output[2]", "output[3]"];
        let mut log = SourceLog {
            streams: vec![
                stream(
                    "sensor_combined",
                    &["gyro_rad[0]", "gyro_rad[1]", "gyro_rad[2]"],
                    |field, time| (3.0 * time + field as f64).sin(),
                ),
                stream("actuator_outputs", &outputs, |field, time| {
                    1500.0 + 300.0 * (time + field as f64).sin()
                }),
            ],
            ..SourceLog::default()
        };
        let duties = |log: &SourceLog| {
            let found = assembled(log, SourceName::Px4Ulog).unwrap();
            let count = found
                .table
                .columns
                .iter()
                .filter(|column| column.name.starts_with("duty_"))
                .count();
            (count, found.report)
        };
        assert_eq!(duties(&log).0, 4);
        log.parameters.insert("MAV_TYPE".to_owned(), 1.0);
        let (count, report) = duties(&log);
        assert_eq!(count, 0);
        assert!(report.other_vehicle.is_some_and(|other| other.contains("aeroplane")));
        assert!(
            report.notes.iter().any(|note| note.contains("servos as well")),
            "{:?}",
            report.notes
        );
    }

    /// ESCs on a CAN bus: the pulse outputs were read, all zero, and "no flight in this log" was reported.
    #[test]
    fn regress_outputs_of_another_instance_are_read_where_the_first_stand_still() {
        let outputs = ["output[0]", "output[1]", "output[2]", "output[3]", "output[4]"];
        let mut raw = stream("actuator_outputs", &outputs, |field, time| {
            if field < 4 {
                4096.0 + 100.0 * (3.0 * time + field as f64).sin()
            } else {
                0.0
            }
        });
        raw.instance = 1;
        let log = |first: f64| SourceLog {
            streams: vec![
                stream("actuator_outputs", &outputs, move |field, time| {
                    first * (1500.0 + 100.0 * (3.0 * time + field as f64).sin())
                }),
                raw.clone(),
            ],
            ..SourceLog::default()
        };
        let duty = |log: &SourceLog| {
            let found = assembled(log, SourceName::Px4Ulog).unwrap();
            let of = |name: &str| found.table.columns.iter().find(|column| column.name == name).cloned();
            (
                of("duty_1").map(|column| column.values[0]),
                of("duty_5").is_some(),
                found.report,
            )
        };
        let (first, fifth, report) = duty(&log(0.0));
        assert!((first.unwrap() - 4096.0 / 8191.0).abs() < 1e-9 && !fifth);
        let told = report.notes.join("\n");
        assert!(
            told.contains("actuator_outputs#1 move") && told.contains("CAN bus"),
            "{told}"
        );
        // Outputs of the first instance that move stay what they were.
        let (first, _, _) = duty(&log(1.0));
        assert!((first.unwrap() - 0.5).abs() < 1e-9);
    }

    #[test]
    fn regress_a_log_of_foreign_topics_is_told_what_helps() {
        let log = SourceLog {
            streams: vec![stream("LightControl", &["level", "mode"], |_, time| time)],
            ..SourceLog::default()
        };
        let Err(reason) = assembled(&log, SourceName::Px4Ulog) else {
            panic!("nothing of it can be read");
        };
        assert!(
            reason.contains("LightControl:level,mode") && reason.contains("--mapping"),
            "{reason}"
        );
    }
}
