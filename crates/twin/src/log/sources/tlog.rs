//! MAVLink telemetry log (`.tlog`), as ground stations write it: each frame behind the time at which it was received.
//!
//! ```text
//! u64 µs since 1970, big endian │ frame of MAVLink 1 (0xFE) or 2 (0xFD) │ …
//! ```
//! The messages of the table below become topics with their names and fields. The first autopilot that sends a `HEARTBEAT` is taken;
//! ground stations, gimbals and other vehicles are left out. Frames are checked by their CRC-16 (X.25) with the message's extra byte.
//!
//! Times are those of the autopilot's clock where the message has one; the others get the time of their reception on
//! that clock, minus the smallest delay observed.
//!
//! Limits: a telemetry link gives 1 to 20 samples per second and loses frames; signed frames are read without checking the signature.

use super::{Cursor, Number, RawStream, Room, SourceLog};
use super::{MOST_CHANGES, ParameterChange};
use crc::Crc;
use std::collections::BTreeMap;

/// 2005 and 2100, µs since 1970: the plausible range of a ground station's clock.
const TIMES_US: std::ops::Range<u64> = 1_104_537_600_000_000..4_102_444_800_000_000;
const STAMP_BYTES: usize = 8;
const CRC_BYTES: usize = 2;
const SIGNATURE_BYTES: usize = 13;
/// A signature follows (bit of the incompatibility flags of MAVLink 2).
const SIGNED: u8 = 1;
/// MAV_AUTOPILOT_INVALID: no flight controller.
const NO_AUTOPILOT: u8 = 8;
/// Time stamps of messages beyond this are not since the start of the autopilot, µs: ten days.
const LATEST_BOOT_US: f64 = 864e9;

/// Where the time of a message stands.
#[derive(Clone, Copy, PartialEq)]
enum Stamp {
    /// The first field, ms since the start of the autopilot.
    BootMs,
    /// The first field, µs since the start of the autopilot.
    BootUs,
    /// Nowhere.
    Received,
}

/// A message that is kept: identifier, name, extra byte of the CRC, clock, fields in the order of the wire (types by decreasing size;
/// extensions last).
struct Kind {
    id: u32,
    name: &'static str,
    extra: u8,
    stamp: Stamp,
    fields: &'static [(&'static str, Number)],
}

const F: Number = Number::F32;
const I16: Number = Number::I16;
const U16: Number = Number::U16;
const U32: Number = Number::U32;
const U8: Number = Number::U8;

/// MAVLink's `common.xml`.
const KINDS: [Kind; 12] = [
    Kind {
        id: 0,
        name: "HEARTBEAT",
        extra: 50,
        stamp: Stamp::Received,
        fields: &[
            ("custom_mode", U32),
            ("type", U8),
            ("autopilot", U8),
            ("base_mode", U8),
            ("system_status", U8),
        ],
    },
    Kind {
        id: 1,
        name: "SYS_STATUS",
        extra: 124,
        stamp: Stamp::Received,
        fields: &[
            ("onboard_control_sensors_present", U32),
            ("onboard_control_sensors_enabled", U32),
            ("onboard_control_sensors_health", U32),
            ("load", U16),
            ("voltage_battery", U16),
            ("current_battery", I16),
        ],
    },
    Kind {
        id: 22,
        name: "PARAM_VALUE",
        extra: 220,
        stamp: Stamp::Received,
        fields: &[("param_value", F)],
    },
    Kind {
        id: 26,
        name: "SCALED_IMU",
        extra: 170,
        stamp: Stamp::BootMs,
        fields: &[
            ("time_boot_ms", U32),
            ("xacc", I16),
            ("yacc", I16),
            ("zacc", I16),
            ("xgyro", I16),
            ("ygyro", I16),
            ("zgyro", I16),
        ],
    },
    Kind {
        id: 27,
        name: "RAW_IMU",
        extra: 144,
        stamp: Stamp::BootUs,
        fields: &[
            ("time_usec", Number::U64),
            ("xacc", I16),
            ("yacc", I16),
            ("zacc", I16),
            ("xgyro", I16),
            ("ygyro", I16),
            ("zgyro", I16),
        ],
    },
    Kind {
        id: 30,
        name: "ATTITUDE",
        extra: 39,
        stamp: Stamp::BootMs,
        fields: &[
            ("time_boot_ms", U32),
            ("roll", F),
            ("pitch", F),
            ("yaw", F),
            ("rollspeed", F),
            ("pitchspeed", F),
            ("yawspeed", F),
        ],
    },
    Kind {
        id: 32,
        name: "LOCAL_POSITION_NED",
        extra: 185,
        stamp: Stamp::BootMs,
        fields: &[
            ("time_boot_ms", U32),
            ("x", F),
            ("y", F),
            ("z", F),
            ("vx", F),
            ("vy", F),
            ("vz", F),
        ],
    },
    Kind {
        id: 33,
        name: "GLOBAL_POSITION_INT",
        extra: 104,
        stamp: Stamp::BootMs,
        fields: &[
            ("time_boot_ms", U32),
            ("lat", Number::I32),
            ("lon", Number::I32),
            ("alt", Number::I32),
            ("relative_alt", Number::I32),
            ("vx", I16),
            ("vy", I16),
            ("vz", I16),
        ],
    },
    Kind {
        id: 35,
        name: "RC_CHANNELS_RAW",
        extra: 244,
        stamp: Stamp::BootMs,
        fields: &[
            ("time_boot_ms", U32),
            ("chan1_raw", U16),
            ("chan2_raw", U16),
            ("chan3_raw", U16),
            ("chan4_raw", U16),
        ],
    },
    Kind {
        id: 65,
        name: "RC_CHANNELS",
        extra: 118,
        stamp: Stamp::BootMs,
        fields: &[
            ("time_boot_ms", U32),
            ("chan1_raw", U16),
            ("chan2_raw", U16),
            ("chan3_raw", U16),
            ("chan4_raw", U16),
        ],
    },
    Kind {
        id: 36,
        name: "SERVO_OUTPUT_RAW",
        extra: 222,
        stamp: Stamp::BootUs,
        fields: &[
            ("time_usec", U32),
            ("servo1_raw", U16),
            ("servo2_raw", U16),
            ("servo3_raw", U16),
            ("servo4_raw", U16),
            ("servo5_raw", U16),
            ("servo6_raw", U16),
            ("servo7_raw", U16),
            ("servo8_raw", U16),
            ("port", U8),
            ("servo9_raw", U16),
            ("servo10_raw", U16),
            ("servo11_raw", U16),
            ("servo12_raw", U16),
            ("servo13_raw", U16),
            ("servo14_raw", U16),
            ("servo15_raw", U16),
            ("servo16_raw", U16),
        ],
    },
    Kind {
        id: 105,
        name: "HIGHRES_IMU",
        extra: 93,
        stamp: Stamp::BootUs,
        fields: &[
            ("time_usec", Number::U64),
            ("xacc", F),
            ("yacc", F),
            ("zacc", F),
            ("xgyro", F),
            ("ygyro", F),
            ("zgyro", F),
        ],
    },
];

/// PARAM_VALUE: value (4 bytes), count and index (2 each), then the name.
const PARAMETER_NAME: std::ops::Range<usize> = 8..24;

/// A frame of either version.
struct Frame<'a> {
    received_us: u64,
    sender: (u8, u8),
    id: u32,
    payload: &'a [u8],
    /// What the CRC is over, without the message's extra byte.
    checked: &'a [u8],
    crc: u16,
}

/// Checksum of MAVLink frames.
const CHECKSUM: Crc<u16> = Crc::<u16>::new(&crc::CRC_16_MCRF4XX);

/// Checksum of a frame with the extra byte of its message.
fn checksum(checked: &[u8], extra: u8) -> u16 {
    let mut digest = CHECKSUM.digest();
    digest.update(checked);
    digest.update(&[extra]);
    digest.finalize()
}

impl<'a> Frame<'a> {
    /// The frame at the front of the cursor, which moves past it; `None` if there is none.
    fn read(cursor: &mut Cursor<'a>) -> Option<Self> {
        let mut next = *cursor;
        let received_us = u64::from_be_bytes(next.array::<STAMP_BYTES>()?);
        if !TIMES_US.contains(&received_us) {
            return None;
        }
        let magic = next.u8()?;
        let after_magic = next.bytes;
        let length = usize::from(next.u8()?);
        let (sender, id, signed) = match magic {
            0xfe => {
                let [_sequence, system, component, id] = next.array()?;
                ((system, component), u32::from(id), false)
            }
            0xfd => {
                let [flags, _compatible, _sequence, system, component, a, b, c] = next.array()?;
                let id = u32::from_le_bytes([a, b, c, 0]);
                ((system, component), id, flags & SIGNED != 0)
            }
            _ => return None,
        };
        let payload = next.take(length)?;
        let checked = &after_magic[..after_magic.len() - next.bytes.len()];
        let crc = u16::from_le_bytes(next.array::<CRC_BYTES>()?);
        if signed {
            next.take(SIGNATURE_BYTES)?;
        }
        *cursor = next;
        Some(Self {
            received_us,
            sender,
            id,
            payload,
            checked,
            crc,
        })
    }

    fn kind(&self) -> Option<(usize, &'static Kind)> {
        KINDS.iter().enumerate().find(|(_, kind)| kind.id == self.id)
    }

    fn is_intact(&self, kind: &Kind) -> bool {
        checksum(self.checked, kind.extra) == self.crc
    }

    /// Values of the fields; MAVLink 2 leaves zeros at the end away.
    fn values(&self, kind: &Kind) -> Vec<f64> {
        let bytes: usize = kind.fields.iter().map(|(_, number)| number.bytes()).sum();
        let mut whole = self.payload[..self.payload.len().min(bytes)].to_vec();
        whole.resize(bytes, 0);
        let mut cursor = Cursor { bytes: &whole };
        kind.fields
            .iter()
            .map(|(_, number)| number.read(&mut cursor).unwrap_or(f64::NAN))
            .collect()
    }
}

/// Two frames after one another, with times that a clock can say.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let mut cursor = Cursor { bytes };
    Frame::read(&mut cursor).is_some() && Frame::read(&mut cursor).is_some()
}

/// A message that is kept, before its time is known.
struct Sample {
    kind: usize,
    received_us: u64,
    values: Vec<f64>,
}

/// Parses a telemetry log.
pub(super) fn parse(bytes: &[u8], mut room: Room) -> Result<SourceLog, String> {
    let mut log = SourceLog::default();
    let mut cursor = Cursor { bytes };
    let (mut samples, mut vehicle) = (Vec::new(), None);
    let mut changes: Vec<(u64, ParameterChange)> = Vec::new();
    let (mut lost_bytes, mut broken, mut others) = (0_usize, 0_usize, 0_usize);
    while !cursor.bytes.is_empty() {
        let Some(frame) = Frame::read(&mut cursor) else {
            cursor.take(1);
            lost_bytes += 1;
            continue;
        };
        let Some((index, kind)) = frame.kind() else { continue };
        if !frame.is_intact(kind) {
            broken += 1;
            continue;
        }
        let values = frame.values(kind);
        if kind.name == "HEARTBEAT" && vehicle.is_none() && values[2] as u8 != NO_AUTOPILOT {
            vehicle = Some(frame.sender);
        }
        // What comes before the first heartbeat may be anybody's.
        if vehicle != Some(frame.sender) {
            others += usize::from(vehicle.is_some());
            continue;
        }
        if kind.name == "PARAM_VALUE" {
            let mut name = frame.payload.to_vec();
            name.resize(PARAMETER_NAME.end, 0);
            let name = &name[PARAMETER_NAME];
            let end = name.iter().position(|byte| *byte == 0).unwrap_or(name.len());
            if let Ok(name) = std::str::from_utf8(&name[..end])
                && !name.is_empty()
                && values[0].is_finite()
            {
                Room::parameter(log.parameters.len())?;
                let before = log.parameters.insert(name.to_owned(), values[0]);
                if let Some(before) = before.filter(|before| *before != values[0])
                    && changes.len() < MOST_CHANGES
                {
                    let change = ParameterChange {
                        time_s: 0.0,
                        name: name.to_owned(),
                        before,
                        after: values[0],
                    };
                    changes.push((frame.received_us, change));
                }
            }
            continue;
        }
        room.sample(1 + values.len())?;
        samples.push(Sample {
            kind: index,
            received_us: frame.received_us,
            values,
        });
    }
    if vehicle.is_none() {
        return Err("no heartbeat of an autopilot; the telemetry log of a flight was expected".to_owned());
    }
    if lost_bytes > 0 {
        log.notes
            .push(format!("{lost_bytes} bytes are not part of a frame that could be read"));
    }
    if broken > 0 {
        log.notes
            .push(format!("{broken} frames with a wrong checksum are left out"));
    }
    if others > 0 {
        log.notes.push(format!(
            "{others} messages of other senders (ground station, other vehicles) are left out"
        ));
    }
    log.notes.push(
        "a telemetry link: messages arrive late or not at all; the log on the vehicle's memory card holds far more"
            .to_owned(),
    );
    let (streams, unix_s) = streams(&samples);
    log.streams = streams;
    let on_the_clock = |(received_us, change): (u64, ParameterChange)| ParameterChange {
        time_s: 1e-6 * received_us as f64 - unix_s,
        ..change
    };
    log.parameter_changes = changes.into_iter().map(on_the_clock).collect();
    log.utc = Some((unix_s, "the ground station's clock"));
    Ok(log)
}

/// The time of a sample on the autopilot's clock, µs, if the message has it.
fn boot_us(sample: &Sample) -> Option<f64> {
    let time = match KINDS[sample.kind].stamp {
        Stamp::BootMs => 1e3 * sample.values[0],
        Stamp::BootUs => sample.values[0],
        Stamp::Received => return None,
    };
    (time > 0.0 && time < LATEST_BOOT_US).then_some(time)
}

/// Streams on the autopilot's clock, and seconds since 1970 at its 0 s.
fn streams(samples: &[Sample]) -> (Vec<RawStream>, f64) {
    let start = samples.iter().map(|sample| sample.received_us).min().unwrap_or(0);
    let since_start = |sample: &Sample| sample.received_us.saturating_sub(start) as f64;
    // The messages with the least delay determine the offset between the clocks.
    let offset = samples
        .iter()
        .filter_map(|sample| Some(since_start(sample) - boot_us(sample)?))
        .fold(f64::INFINITY, f64::min);
    let offset = if offset.is_finite() { offset } else { 0.0 };
    let mut streams: BTreeMap<usize, RawStream> = BTreeMap::new();
    for sample in samples {
        let kind = &KINDS[sample.kind];
        let stream = streams.entry(sample.kind).or_insert_with(|| RawStream {
            name: kind.name.to_owned(),
            fields: kind
                .fields
                .iter()
                .map(|(name, _)| ((*name).to_owned(), Vec::new()))
                .collect(),
            ..RawStream::default()
        });
        let time = boot_us(sample).unwrap_or_else(|| since_start(sample) - offset);
        stream.time_s.push(1e-6 * time);
        for ((_, column), value) in stream.fields.iter_mut().zip(&sample.values) {
            column.push(*value);
        }
    }
    (streams.into_values().collect(), 1e-6 * (start as f64 + offset))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A frame of MAVLink 2 behind its time.
    pub(crate) fn frame(received_us: u64, sender: (u8, u8), id: u32, payload: &[u8]) -> Vec<u8> {
        let [a, b, c, _] = id.to_le_bytes();
        let length = u8::try_from(payload.len()).unwrap();
        let mut out = received_us.to_be_bytes().to_vec();
        let mut checked = vec![length, 0, 0, 7, sender.0, sender.1, a, b, c];
        checked.extend(payload);
        let extra = KINDS.iter().find(|kind| kind.id == id).map_or(0, |kind| kind.extra);
        let crc = checksum(&checked, extra);
        out.push(0xfd);
        out.extend(checked);
        out.extend(crc.to_le_bytes());
        out
    }

    const START_US: u64 = 1_700_000_000_000_000;

    /// Ten seconds of an autopilot, and a ground station that talks in between.
    pub(crate) fn flight() -> Vec<u8> {
        let mut out = frame(START_US, (1, 1), 0, &[0, 0, 0, 0, 2, 3, 81, 4, 3]);
        for k in 0..100_u32 {
            let time_us = START_US + 100_000 * u64::from(k) + 5_000;
            let boot_ms = 60_000 + 100 * k;
            let angle = 0.2 * libm::sin(0.1 * f64::from(k)) as f32;
            let rate = 0.2 * libm::cos(0.1 * f64::from(k)) as f32;
            let mut payload = boot_ms.to_le_bytes().to_vec();
            for value in [angle, -angle, 1.0, rate, -rate, 0.0] {
                payload.extend(value.to_le_bytes());
            }
            out.extend(frame(time_us, (1, 1), 30, &payload));
            // Another vehicle's attitude is not ours.
            out.extend(frame(time_us, (2, 1), 30, &payload));
            let mut payload = (1000 * boot_ms).to_le_bytes().to_vec();
            for servo in [1400 + k as u16, 1500, 1510, 1490 + k as u16, 0, 0, 0, 0_u16] {
                payload.extend(servo.to_le_bytes());
            }
            out.extend(frame(time_us + 2_000, (1, 1), 36, &payload));
            let mut payload = vec![0; 14];
            payload.extend(15_200_u16.to_le_bytes());
            payload.extend(1_250_i16.to_le_bytes());
            out.extend(frame(time_us + 3_000, (1, 1), 1, &payload));
        }
        let mut parameter = 1100.0_f32.to_le_bytes().to_vec();
        parameter.extend([0; 4]);
        parameter.extend(b"MOT_PWM_MIN\0\0\0\0\0");
        parameter.push(9);
        out.extend(frame(START_US + 11_000_000, (1, 1), 22, &parameter));
        out
    }

    #[test]
    fn val_the_checksum_is_that_of_the_standard() {
        // CRC-16/MCRF4XX of "123456789".
        assert_eq!(CHECKSUM.checksum(b"123456789"), 0x6f91);
        // A heartbeat of a GCS in MAVLink 1, as recorded: sequence 0, system 255, component 0.
        let mut cursor = Cursor { bytes: &flight() };
        assert!(Frame::read(&mut cursor).is_some_and(|frame| frame.is_intact(&KINDS[0])));
    }

    #[test]
    fn val_times_are_the_autopilots_and_other_vehicles_stay_out() {
        let bytes = flight();
        assert!(looks_like(&bytes));
        let log = parse(&bytes, Room::new(1 << 20)).unwrap();
        let stream = |name: &str| log.streams.iter().find(|stream| stream.name == name).unwrap();
        let attitude = stream("ATTITUDE");
        assert_eq!(attitude.time_s.len(), 100);
        assert!((attitude.time_s[3] - 60.3).abs() < 1e-9);
        // Received 3 ms after the attitude, which is as late as the least late: the same moment on the autopilot's clock and 3 ms.
        assert!((stream("SYS_STATUS").time_s[3] - 60.303).abs() < 1e-9);
        let (name, volts) = &stream("SYS_STATUS").fields[4];
        assert_eq!((name.as_str(), volts[3]), ("voltage_battery", 15_200.0));
        assert_eq!(log.parameters["MOT_PWM_MIN"], 1100.0);
        assert!(
            log.notes
                .iter()
                .any(|note| note.starts_with("100 messages of other senders"))
        );
    }

    #[test]
    fn prop_cut_and_damaged_files_break_nothing() {
        let bytes = flight();
        for end in (0..bytes.len()).step_by(61) {
            drop(parse(&bytes[..end], Room::new(1 << 20)));
        }
        let mut damaged = bytes.clone();
        for at in (40..bytes.len()).step_by(97) {
            damaged[at] ^= 0x55;
        }
        let log = parse(&damaged, Room::new(1 << 20)).unwrap();
        assert!(
            log.notes
                .iter()
                .any(|note| note.contains("wrong checksum") || note.contains("not part of a frame"))
        );
        assert!(parse(&bytes, Room::new(100)).is_err());
    }
}
