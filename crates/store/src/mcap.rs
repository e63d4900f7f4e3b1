//! Telemetry → `run.mcap`: the run as streams, for Foxglove, Lichtblick and everything else that reads MCAP.
//!
//! | topic | schema | rate |
//! |---|---|---|
//! | `/nav` `/reference` `/command` `/truth` `/battery` `/fdi` | `rotortwin.v1.*Telemetry` (protobuf, `proto/rotortwin/v1/telemetry.proto`) | each step |
//! | `/tf` | `foxglove.FrameTransform` (JSON): `world` → `vehicle`, `world` → `reference`, for 3-D panels | 40 Hz |
//! | `/log` | `foxglove.Log` (JSON): start and end of faults, every change of the sequential detector's verdict | when it happens |
//!
//! The log time is simulated time, ns since the start of the run, so that equal runs give equal files. 3-D panels want z up:
//! `/tf` is in north-west-up, the body frame is forward-left-up; all other topics are NED and FRD.

use crate::analysis::column;
use crate::error::{Result, StoreError};
use crate::spool::{Chunk, SpoolHeader};
use crate::summary::{Evaluator, Summary, verdict_text};
use crate::telemetry::Column;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions, Writer};
use prost::Message;
use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, NOT_READY};
use rotortwin_proto::{
    BatteryTelemetry, BodyVector, CommandTelemetry, EulerAngles, FILE_DESCRIPTOR_SET, FdiTelemetry, NavTelemetry,
    NedVector, ReferenceTelemetry, TruthTelemetry,
};
use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::path::{Path, PathBuf};

/// Steps between two transforms: 40 Hz at 2.5 ms.
const TRANSFORM_EVERY: u64 = 10;

/// JSON schema of `foxglove.Log`.
const LOG_SCHEMA: &str = r#"{"title":"foxglove.Log","description":"A log message","type":"object","properties":{"timestamp":{"type":"object","title":"time","properties":{"sec":{"type":"integer","minimum":0},"nsec":{"type":"integer","minimum":0,"maximum":999999999}}},"level":{"title":"foxglove.LogLevel","oneOf":[{"title":"UNKNOWN","const":0},{"title":"DEBUG","const":1},{"title":"INFO","const":2},{"title":"WARNING","const":3},{"title":"ERROR","const":4},{"title":"FATAL","const":5}]},"message":{"type":"string"},"name":{"type":"string"},"file":{"type":"string"},"line":{"type":"integer","minimum":0}}}"#;

/// JSON schema of `foxglove.FrameTransform`.
const TRANSFORM_SCHEMA: &str = r#"{"title":"foxglove.FrameTransform","description":"A transform between two reference frames in 3D space","type":"object","properties":{"timestamp":{"type":"object","title":"time","properties":{"sec":{"type":"integer","minimum":0},"nsec":{"type":"integer","minimum":0,"maximum":999999999}}},"parent_frame_id":{"type":"string"},"child_frame_id":{"type":"string"},"translation":{"title":"foxglove.Vector3","type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"}}},"rotation":{"title":"foxglove.Quaternion","type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"},"w":{"type":"number"}}}}}"#;

/// Places of the columns that are read.
struct Places {
    time: usize,
    nav: usize,
    duty: usize,
    battery_voltage: usize,
    reference: usize,
    truth: usize,
    label: usize,
    setpoint: usize,
    residuals: usize,
}

/// Channel numbers.
struct Channels {
    nav: u16,
    reference: u16,
    command: u16,
    truth: u16,
    battery: u16,
    fdi: u16,
    transform: u16,
    log: u16,
}

/// Writes chunks of telemetry as MCAP.
pub(crate) struct McapSink<W: Write + Seek> {
    writer: Writer<W>,
    path: PathBuf,
    header: SpoolHeader,
    places: Places,
    channels: Channels,
    buffer: Vec<u8>,
    /// Truth and sequential verdict of the row before, for the log.
    before: Option<(Vec<i32>, u64, i32)>,
    failure: Option<String>,
    last_time_ns: u64,
}

impl<W: Write + Seek> McapSink<W> {
    /// Begins a file.
    ///
    /// * `path`: for error messages
    pub(crate) fn new(
        writer: W,
        path: &Path,
        header: &SpoolHeader,
        columns: &[Column],
        summary: &Summary,
    ) -> Result<Self> {
        let wrap = |source| StoreError::Mcap {
            path: path.to_path_buf(),
            source,
        };
        let mut writer = WriteOptions::new()
            .library(format!("rotortwin-store {}", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            .create(writer)
            .map_err(wrap)?;
        let channels = add_channels(&mut writer).map_err(wrap)?;
        writer.write_metadata(&metadata(summary)).map_err(wrap)?;
        let place = |name: &str| column(columns, name);
        Ok(Self {
            writer,
            path: path.to_path_buf(),
            header: header.clone(),
            places: Places {
                time: place("time_s"),
                nav: place("position_north_m"),
                duty: place("duty_1"),
                battery_voltage: place("battery_voltage_v"),
                reference: place("reference_north_m"),
                truth: place("true_position_north_m"),
                label: place("fault_label"),
                setpoint: place("roll_setpoint_rad"),
                residuals: place("residual_1_arm_nms"),
            },
            channels,
            buffer: Vec::with_capacity(1024),
            before: None,
            failure: summary.failure.as_ref().map(|failure| failure.sentence.clone()),
            last_time_ns: 0,
        })
    }

    /// Writes the messages of the next rows.
    pub(crate) fn push(&mut self, chunk: &Chunk) -> Result<()> {
        for row in 0..chunk.len {
            self.push_row(chunk, row).map_err(|source| StoreError::Mcap {
                path: self.path.clone(),
                source,
            })?;
        }
        Ok(())
    }

    fn push_row(&mut self, chunk: &Chunk, row: usize) -> std::result::Result<(), McapError> {
        let n = self.header.rotor_count;
        let at = |place: usize| chunk.columns[place][row];
        let f = |place: usize| at(place) as f32;
        let many = |place: usize, count: usize, stride: usize| -> Vec<f32> {
            (0..count).map(|i| f(place + i * stride)).collect()
        };
        let ned = |p: usize| {
            Some(NedVector {
                north: f(p),
                east: f(p + 1),
                down: f(p + 2),
            })
        };
        let body = |p: usize| {
            Some(BodyVector {
                forward: f(p),
                right: f(p + 1),
                down: f(p + 2),
            })
        };
        let euler = |p: usize| {
            Some(EulerAngles {
                roll_rad: f(p),
                pitch_rad: f(p + 1),
                yaw_rad: f(p + 2),
            })
        };
        let Places {
            time,
            nav,
            duty,
            battery_voltage,
            reference,
            truth,
            label,
            setpoint,
            residuals,
        } = self.places;
        let thrust = truth + 12;
        let charge = thrust + n;
        let conditions = label + 2;
        let sensor_faults = conditions + n;
        let wrench = residuals + 3 * n;
        let verdicts = wrench + 4;
        let time_ns = (at(time) * 1e9).round() as u64;
        let sequence = (chunk.first_row + row as u64) as u32;
        let stamp = |channel_id: u16| MessageHeader {
            channel_id,
            sequence,
            log_time: time_ns,
            publish_time: time_ns,
        };

        let message = NavTelemetry {
            position_ned_m: ned(nav),
            velocity_ned_m_s: ned(nav + 3),
            attitude: euler(nav + 6),
            body_rates_rad_s: body(nav + 9),
        };
        self.write(stamp(self.channels.nav), &message)?;
        let message = ReferenceTelemetry {
            position_ned_m: ned(reference),
            velocity_ned_m_s: ned(reference + 3),
            yaw_rad: f(reference + 6),
            attitude_setpoint: euler(setpoint),
        };
        self.write(stamp(self.channels.reference), &message)?;
        let message = CommandTelemetry {
            duty: many(duty, n, 1),
            saturated_rotors: at(setpoint + 3) as u32,
        };
        self.write(stamp(self.channels.command), &message)?;
        let codes: Vec<i32> = (0..n).map(|i| at(conditions + i) as i32).collect();
        let message = TruthTelemetry {
            position_ned_m: ned(truth),
            velocity_ned_m_s: ned(truth + 3),
            attitude: euler(truth + 6),
            body_rates_rad_s: body(truth + 9),
            thrust_n: many(thrust, n, 1),
            wind_ned_m_s: ned(charge + 3),
            fault_label: at(label) as i32,
            faulty_rotors: at(label + 1) as u32,
            rotor_condition: codes.clone(),
            sensor_faults: at(sensor_faults) as u32,
        };
        self.write(stamp(self.channels.truth), &message)?;
        let message = BatteryTelemetry {
            voltage_v: f(battery_voltage),
            current_a: f(battery_voltage + 1),
            true_voltage_v: f(charge + 2),
            open_circuit_voltage_v: f(charge + 1),
            state_of_charge: f(charge),
        };
        self.write(stamp(self.channels.battery), &message)?;
        let sequential = at(verdicts + 2) as i32;
        let message = FdiTelemetry {
            residual_arm_nms: many(residuals, n, 3),
            residual_lever_nms: many(residuals + 1, n, 3),
            residual_yaw_nms: many(residuals + 2, n, 3),
            wrench_residual: many(wrench, 4, 1),
            verdict_t_test: at(verdicts) as i32,
            verdict_network: at(verdicts + 1) as i32,
            verdict_sequential: sequential,
            sequential_probability: f(verdicts + 3),
            thrust_loss_n: f(verdicts + 4),
            thrust_loss_low_n: f(verdicts + 5),
            thrust_loss_high_n: f(verdicts + 6),
            thrust_loss_share: f(verdicts + 7),
            thrust_loss_share_low: f(verdicts + 8),
            thrust_loss_share_high: f(verdicts + 9),
            second_thrust_loss_n: f(verdicts + 10),
            second_thrust_loss_low_n: f(verdicts + 11),
            second_thrust_loss_high_n: f(verdicts + 12),
            second_thrust_loss_share: f(verdicts + 13),
            second_thrust_loss_share_low: f(verdicts + 14),
            second_thrust_loss_share_high: f(verdicts + 15),
            hypothesis_count: at(verdicts + 16) as u32,
            suspect_rotors: at(verdicts + 17) as u32,
            window_end: at(verdicts + 18) > 0.5,
        };
        self.write(stamp(self.channels.fdi), &message)?;

        if (chunk.first_row + row as u64).is_multiple_of(TRANSFORM_EVERY) {
            let triple = |p: usize| [at(p), at(p + 1), at(p + 2)];
            let vehicle = transform("vehicle", time_ns, triple(truth), triple(truth + 6));
            self.writer
                .write_to_known_channel(&stamp(self.channels.transform), vehicle.as_bytes())?;
            let target = transform("reference", time_ns, triple(reference), [0.0, 0.0, at(reference + 6)]);
            self.writer
                .write_to_known_channel(&stamp(self.channels.transform), target.as_bytes())?;
        }
        self.last_time_ns = time_ns;
        self.log_changes(stamp(self.channels.log), codes, at(sensor_faults) as u64, sequential)
    }

    fn write(&mut self, header: MessageHeader, message: &impl Message) -> std::result::Result<(), McapError> {
        self.buffer.clear();
        message.encode(&mut self.buffer).expect("a Vec grows as needed");
        self.writer.write_to_known_channel(&header, &self.buffer)
    }

    fn log_changes(
        &mut self,
        header: MessageHeader,
        conditions: Vec<i32>,
        sensor_faults: u64,
        sequential: i32,
    ) -> std::result::Result<(), McapError> {
        const INFO: u8 = 2;
        const WARNING: u8 = 3;
        let n = self.header.rotor_count;
        let first = (vec![0; n], 0, NOT_READY);
        let (old_conditions, old_sensor_faults, old_sequential) = self.before.take().unwrap_or(first);
        let mut lines = Vec::new();
        for rotor in (0..n).filter(|rotor| conditions[*rotor] != old_conditions[*rotor]) {
            let code = conditions[rotor];
            let name = match self.header.conditions.get(&code) {
                Some(name) => name.clone(),
                None if code == 0 => "healthy".to_owned(),
                None => format!("condition {code}"),
            };
            lines.push((WARNING, "truth", format!("rotor {}: {name}", rotor + 1)));
        }
        for bit in (0..64).filter(|bit| (sensor_faults ^ old_sensor_faults) >> bit & 1 == 1) {
            let name = match self.header.sensor_faults.get(bit) {
                Some(name) => name.clone(),
                None => format!("sensor fault {}", bit + 1),
            };
            let verb = if sensor_faults >> bit & 1 == 1 {
                "begins"
            } else {
                "ends"
            };
            lines.push((WARNING, "truth", format!("{name} {verb}")));
        }
        if sequential != old_sequential {
            let level = if sequential == HEALTHY { INFO } else { WARNING };
            lines.push((level, Evaluator::Sequential.title(), verdict_text(sequential)));
        }
        for (level, name, text) in lines {
            self.log(header, level, name, &text)?;
        }
        self.before = Some((conditions, sensor_faults, sequential));
        Ok(())
    }

    fn log(&mut self, header: MessageHeader, level: u8, name: &str, text: &str) -> std::result::Result<(), McapError> {
        let line = serde_json::json!({
            "timestamp": timestamp(header.log_time), "level": level, "message": text, "name": name, "file": "", "line": 0,
        });
        self.writer.write_to_known_channel(&header, line.to_string().as_bytes())
    }

    /// Ends the file.
    pub(crate) fn finish(mut self) -> Result<W> {
        const FATAL: u8 = 5;
        let path = self.path.clone();
        let wrap = |source| StoreError::Mcap { path, source };
        if let Some(sentence) = self.failure.take() {
            let (channel_id, time) = (self.channels.log, self.last_time_ns);
            let header = MessageHeader {
                channel_id,
                sequence: 0,
                log_time: time,
                publish_time: time,
            };
            if let Err(error) = self.log(header, FATAL, "run", &sentence) {
                return Err(wrap(error));
            }
        }
        if let Err(error) = self.writer.finish() {
            return Err(wrap(error));
        }
        Ok(self.writer.into_inner())
    }
}

fn add_channels<W: Write + Seek>(writer: &mut Writer<W>) -> std::result::Result<Channels, McapError> {
    let none = BTreeMap::new();
    let protobuf = |writer: &mut Writer<W>, topic: &str, name: &str| {
        let schema = writer.add_schema(&format!("rotortwin.v1.{name}"), "protobuf", FILE_DESCRIPTOR_SET)?;
        writer.add_channel(schema, topic, "protobuf", &none)
    };
    Ok(Channels {
        nav: protobuf(writer, "/nav", "NavTelemetry")?,
        reference: protobuf(writer, "/reference", "ReferenceTelemetry")?,
        command: protobuf(writer, "/command", "CommandTelemetry")?,
        truth: protobuf(writer, "/truth", "TruthTelemetry")?,
        battery: protobuf(writer, "/battery", "BatteryTelemetry")?,
        fdi: protobuf(writer, "/fdi", "FdiTelemetry")?,
        transform: {
            let schema = writer.add_schema("foxglove.FrameTransform", "jsonschema", TRANSFORM_SCHEMA.as_bytes())?;
            writer.add_channel(schema, "/tf", "json", &none)?
        },
        log: {
            let schema = writer.add_schema("foxglove.Log", "jsonschema", LOG_SCHEMA.as_bytes())?;
            writer.add_channel(schema, "/log", "json", &none)?
        },
    })
}

fn metadata(summary: &Summary) -> Metadata {
    let facts = [
        ("run", summary.run.clone()),
        ("scenario", summary.scenario.name.clone()),
        ("scenario_text", summary.scenario.text.clone()),
        ("seed", summary.seed.to_string()),
        ("status", summary.status.as_str().to_owned()),
        ("run_hash", summary.run_hash.clone()),
        ("model_hash", summary.model_hash.clone()),
        ("program_version", summary.program_version.clone()),
    ];
    let metadata = facts.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    Metadata {
        name: "rotortwin".to_owned(),
        metadata,
    }
}

fn timestamp(time_ns: u64) -> serde_json::Value {
    serde_json::json!({ "sec": time_ns / 1_000_000_000, "nsec": time_ns % 1_000_000_000 })
}

/// A transform in north-west-up with a forward-left-up child, from a position in NED and ZYX Euler angles of an FRD body.
fn transform(child: &str, time_ns: u64, position_ned: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> String {
    let ((sr, cr), (sp, cp), (sy, cy)) = ((roll / 2.0).sin_cos(), (pitch / 2.0).sin_cos(), (yaw / 2.0).sin_cos());
    // ned_from_body as a quaternion; half a turn about the x axis on both sides only flips the signs of y and z.
    let w = cr * cp * cy + sr * sp * sy;
    let x = sr * cp * cy - cr * sp * sy;
    let y = -(cr * sp * cy + sr * cp * sy);
    let z = -(cr * cp * sy - sr * sp * cy);
    let [north, east, down] = position_ned;
    serde_json::json!({
        "timestamp": timestamp(time_ns),
        "parent_frame_id": "world",
        "child_frame_id": child,
        "translation": { "x": north, "y": -east, "z": -down },
        "rotation": { "x": x, "y": y, "z": z, "w": w },
    })
    .to_string()
}
