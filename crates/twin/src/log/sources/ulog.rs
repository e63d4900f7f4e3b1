//! PX4 ULog: self-describing binary log (format version 1, PX4 user guide, "ULog File Format").
//!
//! ```text
//! header 16 B │ definitions: B F I P … │ data: A (topic ↔ id) D (sample) O (drop-out) S (sync) …
//! message = u16 length, u8 type, payload
//! ```
//! Topics become streams; nested types are flattened to `outer.inner`, arrays to `name[i]`. Text fields are left out.
//!
//! Limits: a topic may have [`MAX_COLUMNS`] numbers and texts, and types may nest [`MAX_DEPTH`] deep; the rest is in [`Room`].

use super::{Cursor, MAX_COLUMNS, Number, RawStream, Room, SourceLog};
use super::{MOST_CHANGES, ParameterChange};
use std::collections::BTreeMap;

pub(super) const MAGIC: &[u8] = &[b'U', b'L', b'o', b'g', 0x01, 0x12, 0x35];
/// Sync message: found again after damage.
const SYNC: &[u8] = &[8, 0, b'S', 0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];
const HEADER_BYTES: usize = 16;
const MESSAGE_TYPES: &[u8] = b"BFIMPQARDLCSO";
const MAX_DEPTH: usize = 8;

/// One place in a sample.
#[derive(Clone, Debug)]
enum Item {
    Number(String, Number),
    Skip(usize),
}

/// A field of a format as written: type, count, name.
struct Field {
    kind: String,
    count: usize,
    name: String,
}

struct Topic {
    items: Vec<Item>,
    stream: RawStream,
    short_samples: usize,
}

fn number(kind: &str) -> Option<Number> {
    Some(match kind {
        "int8_t" => Number::I8,
        "uint8_t" | "bool" => Number::U8,
        "int16_t" => Number::I16,
        "uint16_t" => Number::U16,
        "int32_t" => Number::I32,
        "uint32_t" => Number::U32,
        "int64_t" => Number::I64,
        "uint64_t" => Number::U64,
        "float" => Number::F32,
        "double" => Number::F64,
        _ => return None,
    })
}

/// `name:type field;type[n] field;…`
fn parse_format(payload: &[u8]) -> Option<(String, Vec<Field>)> {
    let text = std::str::from_utf8(payload).ok()?;
    let (name, fields) = text.split_once(':')?;
    let fields = fields
        .split(';')
        .filter(|field| !field.trim().is_empty())
        // One more than a topic may have is as good as all.
        .take(MAX_COLUMNS + 1)
        .map(|field| {
            let (kind, name) = field.trim().split_once(' ')?;
            let (kind, count) = match kind.split_once('[') {
                Some((kind, count)) => (kind, count.strip_suffix(']')?.parse().ok()?),
                None => (kind, 1),
            };
            Some(Field {
                kind: kind.to_owned(),
                count,
                name: name.to_owned(),
            })
        })
        .collect::<Option<_>>()?;
    Some((name.to_owned(), fields))
}

/// Appends the places of a type; `None` if it is unknown, too deep or too long. A type without a number counts, too: nested ones could
/// be gone through forever.
fn flatten(
    formats: &BTreeMap<String, Vec<Field>>,
    kind: &str,
    prefix: &str,
    depth: usize,
    visits: &mut usize,
    items: &mut Vec<Item>,
) -> Option<()> {
    if depth > MAX_DEPTH {
        return None;
    }
    for field in formats.get(kind)? {
        if field.kind == "char" {
            items.push(Item::Skip(field.count));
            if items.len() > MAX_COLUMNS {
                return None;
            }
            continue;
        }
        if field.count > MAX_COLUMNS {
            return None;
        }
        for index in 0..field.count {
            *visits += 1;
            let name = if field.count == 1 {
                format!("{prefix}{}", field.name)
            } else {
                format!("{prefix}{}[{index}]", field.name)
            };
            match number(&field.kind) {
                Some(number) if field.name.starts_with("_padding") => items.push(Item::Skip(number.bytes())),
                Some(number) => items.push(Item::Number(name, number)),
                None => flatten(formats, &field.kind, &format!("{name}."), depth + 1, visits, items)?,
            }
            if items.len().max(*visits) > MAX_COLUMNS {
                return None;
            }
        }
    }
    Some(())
}

struct Parser {
    formats: BTreeMap<String, Vec<Field>>,
    topics: BTreeMap<u16, Topic>,
    finished: Vec<RawStream>,
    log: SourceLog,
    /// Of the last sample of any topic, s.
    now_s: f64,
    /// As they were set last.
    set: BTreeMap<String, f64>,
    dropouts: usize,
    dropout_ms: u64,
    unknown_types: usize,
    appended: Vec<u64>,
    room: Room,
}

/// Parses a ULog file.
pub(super) fn parse(bytes: &[u8], room: Room) -> Result<SourceLog, String> {
    if bytes.len() < HEADER_BYTES {
        return Err("the file ends in the ULog header".to_owned());
    }
    let mut parser = Parser {
        formats: BTreeMap::new(),
        topics: BTreeMap::new(),
        finished: Vec::new(),
        log: SourceLog::default(),
        now_s: f64::NEG_INFINITY,
        set: BTreeMap::new(),
        dropouts: 0,
        dropout_ms: 0,
        unknown_types: 0,
        appended: Vec::new(),
        room,
    };
    let mut at = HEADER_BYTES;
    let mut damaged_bytes = 0;
    while at + 3 <= bytes.len() {
        let length = usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
        let kind = bytes[at + 2];
        let end = at + 3 + length;
        // Data appended after a crash begin at a known place; the message before it may be cut.
        if let Some(place) = parser.appended.first().and_then(|place| usize::try_from(*place).ok())
            && at < place
            && end > place
            && place < bytes.len()
        {
            parser.appended.remove(0);
            at = place;
            continue;
        }
        if !MESSAGE_TYPES.contains(&kind) || end > bytes.len() {
            let rest = &bytes[at + 1..];
            match rest.windows(SYNC.len()).position(|window| window == SYNC) {
                Some(offset) => {
                    damaged_bytes += offset + 1;
                    at += offset + 1;
                    continue;
                }
                None => {
                    damaged_bytes += bytes.len() - at;
                    break;
                }
            }
        }
        parser.message(kind, &bytes[at + 3..end])?;
        at = end;
    }
    parser.finish(damaged_bytes)
}

impl Parser {
    fn message(&mut self, kind: u8, payload: &[u8]) -> Result<(), String> {
        match kind {
            b'B' if payload.len() >= 40 => {
                let (offsets, _) = payload[16..40].as_chunks::<8>();
                let offsets = offsets.iter().map(|offset| u64::from_le_bytes(*offset));
                self.appended = offsets.filter(|offset| *offset > 0).collect();
            }
            b'F' => {
                self.room.format()?;
                if let Some((name, fields)) = parse_format(payload) {
                    self.formats.insert(name, fields);
                }
            }
            b'P' => self.parameter(payload)?,
            b'A' => self.subscribe(payload)?,
            b'D' => self.sample(payload)?,
            b'O' => {
                if let Some(duration) = (Cursor { bytes: payload }).u16() {
                    self.dropouts += 1;
                    self.dropout_ms += u64::from(duration);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// `u8 key length, "type name", value`; the first value of a parameter is the one at the start of the log.
    fn parameter(&mut self, payload: &[u8]) -> Result<(), String> {
        let mut cursor = Cursor { bytes: payload };
        let read = || -> Option<(String, f64)> {
            let length = usize::from(cursor.u8()?);
            let key = std::str::from_utf8(cursor.take(length)?).ok()?;
            let (kind, name) = key.split_once(' ')?;
            Some((name.to_owned(), number(kind)?.read(&mut cursor)?))
        };
        let mut read = read;
        if let Some((name, value)) = read() {
            Room::parameter(self.log.parameters.len())?;
            let before = self.set.insert(name.clone(), value);
            if let Some(before) = before.filter(|before| *before != value && self.now_s.is_finite())
                && self.log.parameter_changes.len() < MOST_CHANGES
            {
                self.log.parameter_changes.push(ParameterChange {
                    time_s: self.now_s,
                    name: name.clone(),
                    before,
                    after: value,
                });
            }
            self.log.parameters.entry(name).or_insert(value);
        }
        Ok(())
    }

    fn subscribe(&mut self, payload: &[u8]) -> Result<(), String> {
        let mut cursor = Cursor { bytes: payload };
        let (Some(instance), Some(id)) = (cursor.u8(), cursor.u16()) else {
            return Ok(());
        };
        let Ok(name) = std::str::from_utf8(cursor.bytes) else {
            return Ok(());
        };
        let (mut items, mut visits) = (Vec::new(), 0);
        if flatten(&self.formats, name, "", 0, &mut visits, &mut items).is_none() {
            self.unknown_types += 1;
            return Ok(());
        }
        self.room.stream(items.len())?;
        let fields = items.iter().filter_map(|item| match item {
            Item::Number(name, _) if name != "timestamp" => Some((name.clone(), Vec::new())),
            _ => None,
        });
        let stream = RawStream {
            name: name.to_owned(),
            instance: u16::from(instance),
            time_s: Vec::new(),
            fields: fields.collect(),
            ..RawStream::default()
        };
        let topic = Topic {
            items,
            stream,
            short_samples: 0,
        };
        if let Some(old) = self.topics.insert(id, topic) {
            self.finished.push(old.stream);
        }
        Ok(())
    }

    fn sample(&mut self, payload: &[u8]) -> Result<(), String> {
        let mut cursor = Cursor { bytes: payload };
        let Some(topic) = cursor.u16().and_then(|id| self.topics.get_mut(&id)) else {
            return Ok(());
        };
        self.room.sample(1 + topic.stream.fields.len())?;
        let mut time_us = None;
        let mut values = Vec::with_capacity(topic.stream.fields.len());
        for item in &topic.items {
            match item {
                // The padding of the last field is not written.
                Item::Skip(count) => drop(cursor.take(*count)),
                Item::Number(name, number) => match number.read(&mut cursor) {
                    Some(value) if name == "timestamp" => time_us = Some(value),
                    Some(value) => values.push(value),
                    None => break,
                },
            }
        }
        match time_us {
            Some(time_us) if values.len() == topic.stream.fields.len() => {
                self.now_s = time_us * 1e-6;
                topic.stream.time_s.push(self.now_s);
                for ((_, column), value) in topic.stream.fields.iter_mut().zip(values) {
                    column.push(value);
                }
            }
            _ => topic.short_samples += 1,
        }
        Ok(())
    }

    fn finish(self, damaged_bytes: usize) -> Result<SourceLog, String> {
        let mut log = self.log;
        if self.formats.is_empty() {
            return Err("a ULog header, but no message format after it; the file is cut or damaged".to_owned());
        }
        if damaged_bytes > 0 {
            log.notes
                .push(format!("{damaged_bytes} bytes could not be read (cut or damaged file)"));
        }
        if self.dropouts > 0 {
            log.notes.push(format!(
                "the logger reports {} drop-outs, {} ms in all",
                self.dropouts, self.dropout_ms
            ));
        }
        if self.unknown_types > 0 {
            log.notes.push(format!(
                "{} topics have formats that the file does not describe",
                self.unknown_types
            ));
        }
        log.streams = self.finished;
        for (_, topic) in self.topics {
            if topic.short_samples > 0 {
                log.notes.push(format!(
                    "{}: {} samples are shorter than their format and are left out",
                    topic.stream.label(),
                    topic.short_samples
                ));
            }
            log.streams.push(topic.stream);
        }
        Ok(log)
    }
}
