//! Crazyflie micro-SD log ("usdlog"), versions 1 and 2.
//!
//! ```text
//! 0xBC │ u16 version │ u16 event types │ each: u16 id, name\0, u16 variables, "name(c)\0" … │ records │ CRC-32
//! record = u16 id, time (version 1: u32 ms, version 2: u64 µs), packed little-endian values
//! ```
//! `c` is a character of Python's `struct`: b B h H i I l L q Q e f d. The CRC-32 (IEEE) is over everything before it.

use super::{Cursor, MAX_COLUMNS, Number, RawStream, Room, SourceLog};
use crc::Crc;
use std::collections::BTreeMap;

pub(super) const MAGIC: u8 = 0xbc;
const CRC_BYTES: usize = 4;

struct Event {
    numbers: Vec<Number>,
    stream: RawStream,
}

/// Version, and the event types by their id.
type Header = (u16, BTreeMap<u16, Event>);

fn number(code: &str) -> Option<Number> {
    Some(match code {
        "b" => Number::I8,
        "B" | "?" => Number::U8,
        "h" => Number::I16,
        "H" => Number::U16,
        "i" | "l" => Number::I32,
        "I" | "L" => Number::U32,
        "q" => Number::I64,
        "Q" => Number::U64,
        "e" => Number::F16,
        "f" => Number::F32,
        "d" => Number::F64,
        _ => return None,
    })
}

/// CRC-32 as zlib's.
pub(super) const CRC_32: Crc<u32> = Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// Parses a usdlog. With `accept_damaged`, a wrong CRC is a note instead of a refusal.
pub(super) fn parse(bytes: &[u8], accept_damaged: bool, mut room: Room) -> Result<SourceLog, String> {
    let mut log = SourceLog::default();
    let mut cursor = Cursor { bytes };
    let (version, mut events) =
        header(&mut cursor, &mut room)?.ok_or_else(|| "the file ends in the usdlog header".to_owned())?;

    let intact = bytes
        .split_last_chunk::<CRC_BYTES>()
        .is_some_and(|(content, crc)| CRC_32.checksum(content) == u32::from_le_bytes(*crc));
    if intact {
        let records = cursor.bytes.len().saturating_sub(CRC_BYTES);
        cursor.bytes = &cursor.bytes[..records];
    } else if !accept_damaged {
        return Err("the CRC-32 at the end does not fit the content: the file is damaged or cut (`rotortwin log import --damaged` takes what can be read)".to_owned());
    }
    while !cursor.bytes.is_empty() {
        let before = cursor.bytes.len();
        if record(&mut cursor, version, &mut events, &mut room)?.is_none() {
            if intact {
                return Err(format!(
                    "{before} bytes before the CRC-32 are not a record; the header does not fit the records"
                ));
            }
            log.notes
                .push(format!("wrong CRC-32; {before} bytes at the end could not be read"));
            break;
        }
    }
    log.streams = events.into_values().map(|event| event.stream).collect();
    Ok(log)
}

/// `Ok(None)`: the file ends too early.
fn header(cursor: &mut Cursor<'_>, room: &mut Room) -> Result<Option<Header>, String> {
    let (Some(_), Some(version), Some(count)) = (cursor.u8(), cursor.u16(), cursor.u16()) else {
        return Ok(None);
    };
    if !(1..=2).contains(&version) {
        return Err(format!("usdlog version {version}; versions 1 and 2 are known"));
    }
    let mut events = BTreeMap::new();
    for _ in 0..count {
        let (Some(id), Some(name), Some(variables)) = (cursor.u16(), cursor.c_string(), cursor.u16()) else {
            return Ok(None);
        };
        let mut event = Event {
            numbers: Vec::new(),
            stream: RawStream {
                name: name.to_owned(),
                ..RawStream::default()
            },
        };
        if usize::from(variables) > MAX_COLUMNS {
            return Err(format!(
                "event '{name}' has {variables} variables; at most {MAX_COLUMNS} are taken"
            ));
        }
        room.stream(usize::from(variables))?;
        for _ in 0..variables {
            let Some(text) = cursor.c_string() else {
                return Ok(None);
            };
            let parts = text.strip_suffix(')').and_then(|text| text.rsplit_once('('));
            let Some((name, number)) = parts.and_then(|(name, code)| Some((name, number(code)?))) else {
                return Err(format!(
                    "variable '{text}' of event '{}' has no known type",
                    event.stream.name
                ));
            };
            event.numbers.push(number);
            event.stream.fields.push((name.to_owned(), Vec::new()));
        }
        events.insert(id, event);
    }
    Ok(Some((version, events)))
}

/// `Ok(None)`: what follows is not a record.
fn record(
    cursor: &mut Cursor<'_>,
    version: u16,
    events: &mut BTreeMap<u16, Event>,
    room: &mut Room,
) -> Result<Option<()>, String> {
    let begun = |cursor: &mut Cursor<'_>| {
        let id = cursor.u16()?;
        let time_s = match version {
            1 => Number::U32.read(cursor)? * 1e-3,
            _ => Number::U64.read(cursor)? * 1e-6,
        };
        Some((id, time_s))
    };
    let Some((event, time_s)) = begun(cursor).and_then(|(id, time_s)| Some((events.get_mut(&id)?, time_s))) else {
        return Ok(None);
    };
    let bytes = event.numbers.iter().map(|number| number.bytes()).sum();
    let Some(bytes) = cursor.take(bytes) else {
        return Ok(None);
    };
    room.sample(1 + event.numbers.len())?;
    let mut values = Cursor { bytes };
    event.stream.time_s.push(time_s);
    for (number, (_, column)) in event.numbers.iter().zip(&mut event.stream.fields) {
        // As many bytes were taken as the numbers have.
        column.push(number.read(&mut values).unwrap_or(f64::NAN));
    }
    Ok(Some(()))
}
