//! ArduPilot DataFlash, binary (`.bin`).
//!
//! ```text
//! message = 0xA3 0x95, u8 type, payload; type 128 (FMT) describes the others: type, length, name[4], format[16], labels[64]
//! ```
//! Format characters c C e E are hundredths, L is 1e-7 degrees; text fields are left out. A message with an instance field (`I`,
//! `Instance`, or `C` of the estimator cores) becomes a stream per instance. Bytes that are no message are skipped and counted.

use super::{Cursor, Number, RawStream, Room, SourceLog};
use super::{MOST_CHANGES, ParameterChange};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

const HEAD: [u8; 2] = [0xa3, 0x95];
const FMT_TYPE: u8 = 128;
const FMT_BYTES: usize = 89;
/// How a file begins: the FMT message that describes FMT.
pub(super) const FORMAT_MESSAGE: [u8; 3] = [HEAD[0], HEAD[1], FMT_TYPE];

/// One place in a message.
#[derive(Clone, Debug)]
enum Item {
    Number(Number, f64),
    Skip(usize),
    Name,
}

/// A message type.
#[derive(Clone, Debug)]
pub(super) struct Message {
    pub(super) name: String,
    items: Vec<Item>,
    pub(super) labels: Vec<String>,
    length: usize,
}

fn item(code: char) -> Option<Item> {
    const HUNDREDTH: f64 = 0.01;
    Some(match code {
        'b' => Item::Number(Number::I8, 1.0),
        'B' | 'M' => Item::Number(Number::U8, 1.0),
        'h' => Item::Number(Number::I16, 1.0),
        'H' => Item::Number(Number::U16, 1.0),
        'i' => Item::Number(Number::I32, 1.0),
        'I' => Item::Number(Number::U32, 1.0),
        'q' => Item::Number(Number::I64, 1.0),
        'Q' => Item::Number(Number::U64, 1.0),
        'f' => Item::Number(Number::F32, 1.0),
        'd' => Item::Number(Number::F64, 1.0),
        'g' => Item::Number(Number::F16, 1.0),
        'c' => Item::Number(Number::I16, HUNDREDTH),
        'C' => Item::Number(Number::U16, HUNDREDTH),
        'e' => Item::Number(Number::I32, HUNDREDTH),
        'E' => Item::Number(Number::U32, HUNDREDTH),
        'L' => Item::Number(Number::I32, 1e-7),
        'a' => Item::Skip(64),
        'n' => Item::Skip(4),
        'N' => Item::Name,
        'Z' => Item::Skip(64),
        _ => return None,
    })
}

fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).trim().to_owned()
}

/// The message type that a FMT payload (86 bytes) describes; `None` if its length does not fit its format.
fn described(payload: &[u8]) -> Option<(u8, Message)> {
    let mut cursor = Cursor { bytes: payload };
    let kind = cursor.u8()?;
    let length = usize::from(cursor.u8()?);
    let name = text(cursor.take(4)?);
    let format = text(cursor.take(16)?);
    let labels = text(cursor.take(64)?);
    let items: Vec<Item> = format.chars().map(item).collect::<Option<_>>()?;
    let bytes: usize = items
        .iter()
        .map(|item| match item {
            Item::Number(number, _) => number.bytes(),
            Item::Skip(count) => *count,
            Item::Name => 16,
        })
        .sum();
    (bytes + 3 == length).then_some(())?;
    let mut labels: Vec<String> = labels.split(',').map(|label| label.trim().to_owned()).collect();
    labels.resize(items.len(), String::new());
    let message = Message {
        name,
        items,
        labels,
        length,
    };
    Some((kind, message))
}

/// Parses a binary DataFlash log.
pub(super) fn parse(bytes: &[u8], room: Room) -> Result<SourceLog, String> {
    let mut messages: BTreeMap<u8, Message> = BTreeMap::new();
    let mut gathered = Gathered::new(room);
    let mut at = 0;
    let mut damaged_bytes = 0;
    while at < bytes.len() {
        let rest = &bytes[at..];
        let kind = (rest.len() >= 3 && rest[..2] == HEAD).then(|| rest[2]);
        let length = kind.and_then(|kind| {
            if kind == FMT_TYPE {
                Some(FMT_BYTES)
            } else {
                messages.get(&kind).map(|message| message.length)
            }
        });
        match (kind, length) {
            (Some(kind), Some(length)) if length <= rest.len() => {
                let payload = &rest[3..length];
                if kind == FMT_TYPE {
                    if let Some((kind, message)) = described(payload) {
                        messages.insert(kind, message);
                    }
                } else if let Some(message) = messages.get(&kind) {
                    read_message(message, payload, &mut gathered)?;
                }
                at += length;
            }
            _ => {
                damaged_bytes += 1;
                at += 1;
            }
        }
    }
    if messages.is_empty() {
        return Err("no message format in this DataFlash log; the file is cut or damaged".to_owned());
    }
    let mut log = gathered.finish();
    if damaged_bytes > 0 {
        log.notes.push(format!(
            "{damaged_bytes} bytes are not part of a message (cut or damaged file)"
        ));
    }
    Ok(log)
}

fn read_message(message: &Message, payload: &[u8], gathered: &mut Gathered) -> Result<(), String> {
    let mut cursor = Cursor { bytes: payload };
    let mut values = Vec::with_capacity(message.items.len());
    let mut name = None;
    for (item, label) in message.items.iter().zip(&message.labels) {
        match item {
            Item::Number(number, scale) => match number.read(&mut cursor) {
                // Division keeps 123 hundredths the same number as the text "1.23".
                Some(value) => values.push((
                    label.as_str(),
                    if *scale == 0.01 { value / 100.0 } else { value * scale },
                )),
                None => return Ok(()),
            },
            Item::Skip(count) => drop(cursor.take(*count)),
            Item::Name => name = cursor.take(16).map(text),
        }
    }
    gathered.push(&message.name, &values, name.as_deref())
}

/// Messages on their way into streams, in the order of the file.
pub(super) struct Gathered {
    streams: BTreeMap<(String, u16), Gathering>,
    parameters: BTreeMap<String, f64>,
    /// As they were set last.
    set: BTreeMap<String, f64>,
    changes: Vec<ParameterChange>,
    /// Messages so far.
    order: usize,
    room: Room,
}

#[derive(Default)]
struct Gathering {
    stream: RawStream,
    /// Place of each sample in the file.
    order: Vec<usize>,
    clock: Option<Clock>,
}

/// What a message says about time.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Clock {
    /// Field index.
    field: usize,
    /// Seconds of one unit.
    unit_s: f64,
}

impl Clock {
    fn of(name: &str, labels: &[&str]) -> Option<Self> {
        let find = |wanted: &str, unit_s| {
            labels
                .iter()
                .position(|label| *label == wanted)
                .map(|field| Self { field, unit_s })
        };
        // GPS messages before 2014 have the time of the week in TimeMS and the board's clock in T.
        let board = (name == "GPS").then(|| find("T", 1e-3)).flatten();
        board.or_else(|| find("TimeUS", 1e-6)).or_else(|| find("TimeMS", 1e-3))
    }
}

impl Gathered {
    pub(super) fn new(room: Room) -> Self {
        Self {
            streams: BTreeMap::new(),
            parameters: BTreeMap::new(),
            set: BTreeMap::new(),
            changes: Vec::new(),
            order: 0,
            room,
        }
    }

    /// Adds one message; `name` is its text field, if it has one.
    ///
    /// # Errors
    /// More than there is room for.
    pub(super) fn push(&mut self, message: &str, values: &[(&str, f64)], name: Option<&str>) -> Result<(), String> {
        self.order += 1;
        if message == "PARM" {
            if let (Some(name), Some((_, value))) = (name, values.iter().find(|(label, _)| *label == "Value")) {
                Room::parameter(self.parameters.len())?;
                self.parameters.entry(name.to_owned()).or_insert(*value);
                let before = self.set.insert(name.to_owned(), *value);
                let time_us = values.iter().find(|(label, _)| *label == "TimeUS");
                if let (Some(before), Some((_, time_us))) = (before.filter(|before| before != value), time_us)
                    && self.changes.len() < MOST_CHANGES
                {
                    self.changes.push(ParameterChange {
                        time_s: 1e-6 * time_us,
                        name: name.to_owned(),
                        before,
                        after: *value,
                    });
                }
            }
            return Ok(());
        }
        let instance = values
            .iter()
            .find(|(label, _)| match *label {
                // The integral term of a controller is not an instance number.
                "I" => !message.starts_with("PID"),
                "C" => message.starts_with("XK"),
                other => other == "Instance",
            })
            .map_or(0, |(_, value)| *value as u16);
        let gathering = match self.streams.entry((message.to_owned(), instance)) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => {
                self.room.stream(values.len())?;
                let labels: Vec<&str> = values.iter().map(|(label, _)| *label).collect();
                place.insert(Gathering {
                    stream: RawStream {
                        name: message.to_owned(),
                        instance,
                        time_s: Vec::new(),
                        fields: labels.iter().map(|label| ((*label).to_owned(), Vec::new())).collect(),
                        ..RawStream::default()
                    },
                    order: Vec::new(),
                    clock: Clock::of(message, &labels),
                })
            }
        };
        // A message type that is described twice keeps its first form.
        if gathering.stream.fields.len() != values.len() {
            return Ok(());
        }
        self.room.sample(1 + values.len())?;
        gathering.order.push(self.order);
        for ((_, column), (_, value)) in gathering.stream.fields.iter_mut().zip(values) {
            column.push(*value);
        }
        Ok(())
    }

    /// Assigns times to each stream.
    ///
    /// Old logs have messages without a time. Their position in the file between two messages with one gives it: the
    /// board's clock, otherwise GPS time, otherwise the nominal 10 Hz of ATT.
    pub(super) fn finish(mut self) -> SourceLog {
        let mut log = SourceLog {
            parameters: std::mem::take(&mut self.parameters),
            parameter_changes: std::mem::take(&mut self.changes),
            ..SourceLog::default()
        };
        let untimed = self
            .streams
            .values()
            .filter(|gathering| gathering.clock.is_none())
            .count();
        let anchors = if untimed > 0 {
            self.anchors(&mut log.notes)
        } else {
            Vec::new()
        };
        for (_, gathering) in self.streams {
            let Gathering {
                mut stream,
                order,
                clock,
            } = gathering;
            match clock {
                Some(clock) => {
                    let times = stream.fields[clock.field].1.iter();
                    stream.time_s = times.map(|value| value * clock.unit_s).collect();
                }
                None => {
                    let times: Vec<Option<f64>> = order.iter().map(|place| between(&anchors, *place)).collect();
                    for (_, values) in &mut stream.fields {
                        let mut times = times.iter();
                        values.retain(|_| times.next().is_some_and(Option::is_some));
                    }
                    stream.time_s = times.into_iter().flatten().collect();
                }
            }
            log.streams.push(stream);
        }
        log
    }

    /// Places in the file whose time is known, s.
    fn anchors(&self, notes: &mut Vec<String>) -> Vec<(usize, f64)> {
        /// Fewer than this cannot carry a clock.
        const FEWEST: usize = 4;
        let increasing = |pairs: Vec<(usize, f64)>| {
            let mut last = f64::NEG_INFINITY;
            pairs
                .into_iter()
                .filter(|(_, time)| {
                    let later = *time > last;
                    last = last.max(*time);
                    later
                })
                .collect::<Vec<_>>()
        };
        let timed: Option<&Gathering> = self
            .streams
            .values()
            .filter(|gathering| gathering.clock.is_some())
            .max_by_key(|gathering| gathering.order.len());
        if let Some(gathering) = timed
            && let Some(clock) = gathering.clock
        {
            let times = gathering.stream.fields[clock.field]
                .1
                .iter()
                .map(|value| value * clock.unit_s);
            let anchors = increasing(gathering.order.iter().copied().zip(times).collect());
            if anchors.len() >= FEWEST {
                notes.push(format!(
                    "some messages have no time; it is taken from their place between {} messages",
                    gathering.stream.name
                ));
                return anchors;
            }
        }
        let gps = self.streams.get(&("GPS".to_owned(), 0));
        let gps_time = gps.and_then(|gathering| {
            let (_, times) = gathering.stream.fields.iter().find(|(name, _)| name == "Time")?;
            let pairs = gathering
                .order
                .iter()
                .copied()
                .zip(times.iter().map(|value| value * 1e-3));
            let anchors = increasing(pairs.filter(|(_, time)| *time > 0.0).collect());
            (anchors.len() >= FEWEST).then_some(anchors)
        });
        if let Some(anchors) = gps_time {
            notes.push(
                "the messages have no time; it is taken from their place between GPS messages, good to about one GPS interval"
                    .to_owned(),
            );
            return anchors;
        }
        const NOMINAL_RATE_HZ: f64 = 10.0;
        let Some(attitude) = self.streams.get(&("ATT".to_owned(), 0)) else {
            return Vec::new();
        };
        notes.push(format!(
            "no message has a time; ATT is taken to come at its nominal {NOMINAL_RATE_HZ} Hz and the others from their place in the file"
        ));
        let times = (0..attitude.order.len()).map(|sample| sample as f64 / NOMINAL_RATE_HZ);
        attitude.order.iter().copied().zip(times).collect()
    }
}

/// Time of a place in the file, straight between the anchors; `None` before the first and after the last.
fn between(anchors: &[(usize, f64)], place: usize) -> Option<f64> {
    let next = anchors.partition_point(|(anchor, _)| *anchor < place);
    let (after, after_s) = *anchors.get(next)?;
    if after == place {
        return Some(after_s);
    }
    let (before, before_s) = *anchors.get(next.checked_sub(1)?)?;
    Some(before_s + (after_s - before_s) * (place - before) as f64 / (after - before) as f64)
}
