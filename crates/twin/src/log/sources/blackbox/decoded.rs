//! The CSV that `blackbox_decode` makes of a blackbox log.
//!
//! One line per frame of the main stream, names as in the log, with the unit after a name where the tool has converted
//! it: `time (us)`, `vbatLatest (V)`, `amperageLatest (A)`, `gyroADC[0] (deg/s)`. Header lines are lost, so their
//! content is inferred from the numbers: counts per g from the accelerometer's most frequent magnitude, the range of
//! the motors from the values they reach; rotor speeds assume the firmware's usual number of magnet poles.
//!
//! Limits: the scale of a gyroscope that logs counts (before Betaflight 3.0) is lost; 1 count is taken as 1 deg/s.

use super::super::csv_table::{cells, number};
use super::super::{MAX_COLUMNS, RawStream, Room, SourceLog};
use super::fields;

/// How far the header line may reach.
const SEARCH_BYTES: usize = 16_384;
/// Motor values up to here are microseconds of PWM.
const MOST_PWM: f64 = 2000.5;
/// DShot values of least throttle and most.
const DSHOT: (f64, f64) = (48.0, 2047.0);
/// Lowest PWM value of a turning motor; below, it is not PWM.
const LEAST_PWM: f64 = 900.0;

/// A header line with the two fields that every such file begins with.
pub(in crate::log) fn looks_like(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(SEARCH_BYTES)];
    let line = head.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let text = String::from_utf8_lossy(line);
    let mut names = cells(text.trim_start_matches('\u{feff}').trim(), ',').into_iter();
    names.next() == Some("loopIteration") && names.next().is_some_and(|name| split(name).0 == "time")
}

/// Name and unit of `name (unit)`.
fn split(name: &str) -> (&str, Option<&str>) {
    match name.strip_suffix(')').and_then(|name| name.rsplit_once(" (")) {
        Some((name, unit)) => (name, Some(unit)),
        None => (name, None),
    }
}

/// Parses a decoded log.
pub(in crate::log) fn parse(bytes: &[u8], mut room: Room) -> Result<SourceLog, String> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = text.trim_start_matches('\u{feff}').lines();
    let header = cells(lines.next().unwrap_or_default().trim(), ',');
    if header.len() > MAX_COLUMNS {
        return Err(format!(
            "more than {MAX_COLUMNS} columns in the header; a decoded blackbox log was expected"
        ));
    }
    room.stream(header.len())?;
    let mut columns: Vec<Vec<f64>> = vec![Vec::new(); header.len()];
    let mut short = 0_usize;
    for line in lines.filter(|line| !line.trim().is_empty()) {
        let cells = cells(line, ',');
        if cells.len() != header.len() {
            short += 1;
            continue;
        }
        room.sample(1 + header.len())?;
        for (column, cell) in columns.iter_mut().zip(cells) {
            // Flags are words.
            column.push(number(cell, '.').unwrap_or(f64::NAN));
        }
    }
    let mut log = SourceLog::default();
    if short > 0 {
        log.notes.push(format!(
            "{short} lines have not as many cells as the header and are left out"
        ));
    }
    let mut stream = RawStream {
        name: "main".to_owned(),
        ..RawStream::default()
    };
    for (name, values) in header.iter().zip(columns) {
        let (plain, unit) = split(name);
        if plain == "time" {
            let factor = if unit == Some("s") { 1.0 } else { 1e-6 };
            stream.time_s = values.iter().map(|time| time * factor).collect();
        }
        stream.fields.push((plain.to_owned(), values));
        if let Some((to, factor)) = unit.and_then(|unit| converted(plain, unit)) {
            let column = stream.fields.last().map_or(&[] as &[f64], |(_, values)| values);
            let scaled = column.iter().map(|value| factor * value).collect();
            stream.fields.push((to, scaled));
        }
    }
    if stream.time_s.len() < 2 || stream.time_s.iter().any(|time| time.is_nan()) {
        return Err("no two lines with a time; a log decoded by blackbox_decode was expected".to_owned());
    }
    counts(&mut stream, &mut log);
    battery(&mut stream, &mut log);
    motors(&stream, &mut log);
    fields::rotor_speeds(None, &mut stream, &mut log);
    log.notes.push(
        "decoded blackbox log: the scales in its header are lost and inferred from the numbers; the .bbl itself holds them"
            .to_owned(),
    );
    log.streams.push(stream);
    Ok(log)
}

/// Field and factor of a column that the tool has put in units.
fn converted(name: &str, unit: &str) -> Option<(String, f64)> {
    let axis = |from: &str, to: &str| name.strip_prefix(from).map(|axis| format!("{to}{axis}"));
    match unit {
        "V" if name.starts_with("vbat") => Some(("voltage_v".to_owned(), 1.0)),
        "mV" if name.starts_with("vbat") => Some(("voltage_v".to_owned(), 1e-3)),
        "A" if name.starts_with("amperage") => Some(("current_a".to_owned(), 1.0)),
        "mA" if name.starts_with("amperage") => Some(("current_a".to_owned(), 1e-3)),
        "deg/s" => Some((axis("gyroADC", "gyro")?, 1.0)),
        "rad/s" => Some((axis("gyroADC", "gyro")?, 180.0 / std::f64::consts::PI)),
        "g" => Some((axis("accSmooth", "acc")?, 1.0)),
        "m/s/s" | "m/s2" => Some((axis("accSmooth", "acc")?, 1.0 / 9.806_65)),
        _ => None,
    }
}

fn has(stream: &RawStream, name: &str) -> bool {
    stream.fields.iter().any(|(field, _)| field == name)
}

/// Gyroscope and accelerometer of the log in counts, where the tool left them so.
fn counts(stream: &mut RawStream, log: &mut SourceLog) {
    if !has(stream, "gyro[0]") && has(stream, "gyroADC[0]") {
        fields::add(stream, "gyroADC", "gyro", &[1.0; 3]);
        log.notes
            .push("gyroADC: taken as degrees per second, as firmware since 2016 logs it".to_owned());
    }
    if !has(stream, "acc[0]") && has(stream, "accSmooth[0]") {
        let one_g = fields::rest_level(stream);
        fields::add(stream, "accSmooth", "acc", &[1.0 / one_g; 3]);
        log.notes.push(format!("accSmooth: 1 g taken as {one_g} counts"));
    }
}

/// The tool scales voltage and current by the rules of one firmware; its result for another is not trusted.
fn battery(stream: &mut RawStream, log: &mut SourceLog) {
    /// Less than one cell under load, more than any stack of a multirotor, V.
    const VOLTS: std::ops::RangeInclusive<f64> = 2.5..=100.0;
    let Some((_, volts)) = stream.fields.iter().find(|(name, _)| name == "voltage_v") else {
        return;
    };
    let mut finite: Vec<f64> = volts.iter().copied().filter(|volts| volts.is_finite()).collect();
    let Some(median) = crate::log::resample::median(&mut finite) else {
        return;
    };
    // 0 V: no battery is connected to the sensor; this is not a matter of scale.
    if median == 0.0 || VOLTS.contains(&median) {
        return;
    }
    stream
        .fields
        .retain(|(name, _)| !["voltage_v", "current_a"].contains(&name.as_str()));
    log.notes.push(format!(
        "voltage and current left out: the tool that decoded the log wrote a median of {median:.2} V, which flies nothing; the .bbl itself has them"
    ));
}

/// The range of the motors according to the values reached.
fn motors(stream: &RawStream, log: &mut SourceLog) {
    let values = || {
        let motors = stream.fields.iter().filter(|(name, _)| name.starts_with("motor["));
        motors
            .flat_map(|(_, values)| values)
            .copied()
            .filter(|value| *value > 0.0)
    };
    let (least, most) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    if !least.is_finite() {
        return;
    }
    let (low, high) = if least < LEAST_PWM || most > MOST_PWM {
        DSHOT
    } else {
        (1000.0, 2000.0)
    };
    log.parameters.insert("motor_low".to_owned(), low);
    log.parameters.insert("motor_high".to_owned(), high);
    log.notes.push(format!(
        "motor: {least} to {most} in the log, so {low} is taken as zero throttle and {high} as full"
    ));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(rows: usize) -> String {
        let mut text =
            "loopIteration, time (us), gyroADC[0], gyroADC[1], gyroADC[2], accSmooth[0], accSmooth[1], accSmooth[2], \
                        motor[0], motor[1], motor[2], motor[3], vbatLatest (V), flightModeFlags (flags)\n"
                .to_owned();
        for k in 0..rows {
            let time = 1_000_000 + 1000 * k;
            text += &format!(
                "{k}, {time}, {}, 0, 0, 10, -5, 2040, 300, 1500, 700, 2047, 15.3, ANGLE_MODE|HORIZON\n",
                k % 7
            );
        }
        text
    }

    #[test]
    fn val_units_come_from_the_names_and_scales_from_the_numbers() {
        let text = text(50);
        assert!(looks_like(text.as_bytes()) && !looks_like(b"time_s,duty_1\n0,1\n"));
        let log = parse(text.as_bytes(), Room::new(1 << 16)).unwrap();
        let stream = &log.streams[0];
        let of = |name: &str| &stream.fields.iter().find(|(field, _)| field == name).unwrap().1;
        assert!((stream.time_s[1] - 1.001).abs() < 1e-9);
        assert_eq!(of("gyro[0]")[3], 3.0);
        assert_eq!(of("acc[2]")[0], 2040.0 / 2048.0);
        assert_eq!(of("voltage_v")[0], 15.3);
        assert_eq!(
            (log.parameters["motor_low"], log.parameters["motor_high"]),
            (48.0, 2047.0)
        );
    }

    #[test]
    fn val_electrical_turns_of_a_decoded_log_are_rotor_speeds() {
        for field in ["eRPM[0]", "eRPM(/100)[0]"] {
            let text = text(20).replace("vbatLatest (V)", field).replace("15.3", "210");
            let log = parse(text.as_bytes(), Room::new(1 << 16)).unwrap();
            let rpm = log.streams[0].fields.iter().find(|(name, _)| name == "rpm[0]");
            // 14 poles.
            assert_eq!(rpm.map(|(_, rpm)| rpm[0]), Some(3000.0), "{field}");
            assert!(
                log.notes.iter().any(|note| note.contains("14 are taken")),
                "{:?}",
                log.notes
            );
        }
    }

    #[test]
    fn regress_a_voltage_of_another_firmwares_scale_does_not_cost_the_log() {
        let log = parse(text(50).replace("15.3", "1.53").as_bytes(), Room::new(1 << 16)).unwrap();
        assert!(!has(&log.streams[0], "voltage_v") && has(&log.streams[0], "gyro[0]"));
        assert!(log.notes.iter().any(|note| note.contains("1.53 V")), "{:?}", log.notes);
        let flat = parse(text(50).replace("15.3", "0").as_bytes(), Room::new(1 << 16)).unwrap();
        assert!(has(&flat.streams[0], "voltage_v"));
    }

    #[test]
    fn prop_cut_files_break_nothing() {
        let text = text(20);
        for end in 0..text.len() {
            drop(parse(&text.as_bytes()[..end], Room::new(1 << 16)));
        }
        assert!(parse(text.as_bytes(), Room::new(40)).is_err());
    }
}
