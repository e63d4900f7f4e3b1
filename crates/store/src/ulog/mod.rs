//! Telemetry → ULog, the log format of PX4 (version 1, PX4 user guide, "ULog File Format"): for Flight Review, PlotJuggler, pyulog.
//!
//! ```text
//! header 16 B │ B flag bits · I facts · F one format per topic · A topic ↔ id │ D one sample per topic and step · L changes · S one mark per
//! second message = u16 length of the payload, u8 type, payload
//! ```
//! Time is simulated time, µs since the start of the run. Every column of the telemetry is in one of the [`topics`], each at the full rate;
//! quantities that PX4 stores in single precision (including the true motion) are in single precision. Changes of the truth and of the
//! sequential detector's verdict are log messages.

mod topics;

use crate::query::{QueryError, TelemetryFile};
use crate::summary::verdict_text;
use std::collections::HashMap;
use std::io::Write;
use topics::{Number, Topic, Value};

const MAGIC: [u8; 8] = *b"ULog\x01\x12\x35\x01";
/// Sync marker from which reading can resume after damage.
const SYNC: [u8; 8] = [0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];
/// Rows between two marks: 1 s at 400 Hz.
const ROWS_PER_SYNC: u64 = 400;
/// Facts of the run included in the log if they fit into a message.
const FACTS: [&str; 9] = [
    "run",
    "scenario",
    "vehicle",
    "seed",
    "status",
    "run_hash",
    "model_hash",
    "rotor_count",
    "scenario_text",
];
/// Maximum payload of a message.
const LONGEST_PAYLOAD: usize = u16::MAX as usize;

/// Writes a run's telemetry as ULog.
///
/// # Errors
/// The file lacks a required column or is damaged, or the log cannot be written.
pub(crate) fn write_ulog(file: &TelemetryFile, out: &mut impl Write) -> Result<(), QueryError> {
    let names: Vec<&str> = file.channels().iter().map(|channel| channel.name.as_str()).collect();
    let places: HashMap<&str, usize> = names.iter().enumerate().map(|(at, name)| (*name, at)).collect();
    let rotors = names.iter().filter(|name| name.starts_with("duty_")).count();
    let place = |name: &str| {
        let found = places.get(name).copied();
        found.ok_or_else(|| QueryError::unknown(name, file.channels()))
    };
    let topics = topics::topics(rotors, place)?;
    let (time, label, verdict) = (place("time_s")?, place("fault_label")?, place("verdict_sequential")?);

    let mut log = Log::default();
    log.definitions(file, &topics);
    let mut last = None;
    let mut row = 0u64;
    file.for_each_block(&names, |block| {
        for at in 0..block.first().map_or(0, Vec::len) {
            let time_us = (block[time][at] * 1e6).round() as u64;
            for (id, topic) in topics.iter().enumerate() {
                log.sample(id, topic, time_us, |place| block[place][at]);
            }
            let now = (block[label][at] as i32, block[verdict][at] as i32);
            if last != Some(now) {
                let (label, verdict) = now;
                if last.map(|(label, _)| label) != Some(label) {
                    log.words(time_us, &format!("truth: {}", truth_text(label)));
                }
                if last.map(|(_, verdict)| verdict) != Some(verdict) {
                    log.words(time_us, &format!("sequential detector: {}", verdict_text(verdict)));
                }
                last = Some(now);
            }
            row += 1;
            if row.is_multiple_of(ROWS_PER_SYNC) {
                log.message(b'S', &SYNC);
            }
        }
        log.flush(out)
    })?;
    log.flush(out)?;
    out.flush().map_err(|source| QueryError::Output { source })
}

fn truth_text(label: i32) -> String {
    match label {
        -1 => "several rotors are faulty".to_owned(),
        0 => "no rotor is faulty".to_owned(),
        rotor => format!("rotor {rotor} is faulty"),
    }
}

/// Buffered messages.
#[derive(Default)]
struct Log {
    bytes: Vec<u8>,
    payload: Vec<u8>,
}

impl Log {
    fn message(&mut self, kind: u8, payload: &[u8]) {
        let length = u16::try_from(payload.len()).expect("facts that do not fit are left out, all else is short");
        self.bytes.extend_from_slice(&length.to_le_bytes());
        self.bytes.push(kind);
        self.bytes.extend_from_slice(payload);
    }

    fn definitions(&mut self, file: &TelemetryFile, topics: &[Topic]) {
        self.bytes.extend_from_slice(&MAGIC);
        self.bytes.extend_from_slice(&0u64.to_le_bytes());
        // No incompatible flags, nothing appended.
        self.message(b'B', &[0; 40]);
        self.fact("sys_name", "rotortwin");
        self.fact("ver_sw", env!("CARGO_PKG_VERSION"));
        for name in FACTS {
            if let Some(value) = file.fact(name) {
                self.fact(&format!("rotortwin_{name}"), value);
            }
        }
        for topic in topics {
            self.message(b'F', topic.format.as_bytes());
        }
        for (id, topic) in topics.iter().enumerate() {
            let mut payload = vec![0];
            payload.extend_from_slice(&(id as u16).to_le_bytes());
            payload.extend_from_slice(topic.name.as_bytes());
            self.message(b'A', &payload);
        }
    }

    /// `u8 key length, "char[n] name", text`
    fn fact(&mut self, name: &str, text: &str) {
        let key = format!("char[{}] {name}", text.len());
        let Ok(length) = u8::try_from(key.len()) else { return };
        let payload = [&[length], key.as_bytes(), text.as_bytes()].concat();
        if payload.len() <= LONGEST_PAYLOAD {
            self.message(b'I', &payload);
        }
    }

    /// A log message at level "info".
    fn words(&mut self, time_us: u64, text: &str) {
        let payload = [&b"6"[..], &time_us.to_le_bytes(), text.as_bytes()].concat();
        self.message(b'L', &payload);
    }

    fn sample(&mut self, id: usize, topic: &Topic, time_us: u64, column: impl Fn(usize) -> f64) {
        let mut payload = std::mem::take(&mut self.payload);
        payload.clear();
        payload.extend_from_slice(&(id as u16).to_le_bytes());
        Number::U64.write(time_us as f64, &mut payload);
        for (number, value) in &topic.values {
            match value {
                Value::Column(place) => number.write(column(*place), &mut payload),
                Value::Constant(value) => number.write(*value, &mut payload),
                Value::Quaternion(angles) => {
                    for part in quaternion(angles.map(&column)) {
                        number.write(part, &mut payload);
                    }
                }
            }
        }
        self.message(b'D', &payload);
        self.payload = payload;
    }

    fn flush(&mut self, out: &mut impl Write) -> Result<(), QueryError> {
        let written = out.write_all(&self.bytes);
        self.bytes.clear();
        written.map_err(|source| QueryError::Output { source })
    }
}

/// ZYX Euler angles (roll, pitch, yaw, rad) as quaternion w x y z, from body to world.
fn quaternion([roll, pitch, yaw]: [f64; 3]) -> [f64; 4] {
    let (sr, cr) = (0.5 * roll).sin_cos();
    let (sp, cp) = (0.5 * pitch).sin_cos();
    let (sy, cy) = (0.5 * yaw).sin_cos();
    [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_every_column_of_a_run_is_in_a_topic() {
        for rotors in [4, 6, 16] {
            let columns = crate::telemetry_columns(rotors);
            let place = |name: &str| {
                let found = columns.iter().position(|column| column.name == name);
                Ok(found.unwrap_or_else(|| panic!("there is no column {name}")))
            };
            let topics = topics::topics(rotors, place).unwrap();
            let mut seen = vec![false; columns.len()];
            for (_, value) in topics.iter().flat_map(|topic| &topic.values) {
                match value {
                    Value::Column(place) => seen[*place] = true,
                    Value::Quaternion(places) => places.iter().for_each(|place| seen[*place] = true),
                    Value::Constant(_) => {}
                }
            }
            // The time is the first field of every sample.
            seen[0] = true;
            let missing: Vec<&str> = columns
                .iter()
                .zip(seen)
                .filter(|(_, seen)| !seen)
                .map(|(column, _)| column.name.as_str())
                .collect();
            assert!(missing.is_empty(), "{missing:?}");
        }
    }

    #[test]
    fn val_formats_are_those_of_px4() {
        let columns = crate::telemetry_columns(6);
        let place = |name: &str| Ok(columns.iter().position(|column| column.name == name).unwrap());
        let topics = topics::topics(6, place).unwrap();
        let format = |name: &str| &topics.iter().find(|topic| topic.name == name).unwrap().format;
        assert_eq!(
            format("vehicle_attitude"),
            "vehicle_attitude:uint64_t timestamp;float[4] q;"
        );
        assert_eq!(
            format("actuator_motors"),
            "actuator_motors:uint64_t timestamp;float[12] control;"
        );
        assert_eq!(
            format("sensor_combined"),
            "sensor_combined:uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;"
        );
        assert!(format("rotortwin_truth").contains("double[6] thrust_n;"));
    }

    #[test]
    fn val_quaternions_of_known_turns() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let quarter = std::f64::consts::FRAC_PI_2;
        for (angles, expected) in [
            ([0.0; 3], [1.0, 0.0, 0.0, 0.0]),
            ([quarter, 0.0, 0.0], [half, half, 0.0, 0.0]),
            ([0.0, quarter, 0.0], [half, 0.0, half, 0.0]),
            ([0.0, 0.0, quarter], [half, 0.0, 0.0, half]),
            ([quarter, 0.0, quarter], [0.5; 4]),
        ] {
            // Rounding of a handful of products.
            let near = quaternion(angles)
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-15);
            assert!(near, "{angles:?}: {:?}", quaternion(angles));
        }
    }
}
