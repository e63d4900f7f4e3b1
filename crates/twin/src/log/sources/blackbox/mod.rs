//! Betaflight and INAV blackbox (`.bbl`, `.bfl`, `.TXT`): the flight recorder of the Cleanflight family, data version 2.
//!
//! ```text
//! "H name:value\n" … │ frames: I (whole), P (against the frames before), S (slow), G H (GPS), E (event) …
//! ```
//! Header lines give each field's name, encoding and predictor ([`encoding`], [`frame`]). The main stream becomes the
//! topic `main`, with the fields as named there, and a few in units ([`fields`]). A frame that does not decode, or is
//! not followed by another, is skipped up to the next whole one. A file may hold several flights, one header each: the
//! longest is used, with a note.
//!
//! Limits: GPS frames are skipped over by their own definition and not kept; data version 1 (before 2014) is refused.

pub(super) mod decoded;
mod encoding;
mod fields;
mod frame;

use super::{Cursor, RawStream, Room, SourceLog};
use frame::{Definition, History};
use std::collections::BTreeMap;

/// How a flight begins.
pub(super) const MAGIC: &[u8] = b"H Product:Blackbox";
/// Most numbers of a file per byte of it; real logs have one or two.
const MOST_CELLS_PER_BYTE: usize = 4;
/// Longest header line, bytes; real ones have up to 1000.
const LONGEST_LINE: usize = 1 << 14;
/// Most header lines of a flight; real ones have some hundreds.
const MOST_LINES: usize = 4096;

/// What the header lines of one flight say.
#[derive(Default)]
struct Header {
    values: BTreeMap<String, String>,
}

impl Header {
    fn text(&self, key: &str) -> &str {
        self.values.get(key).map_or("", String::as_str)
    }

    fn number(&self, key: &str) -> Option<f64> {
        let text = self.values.get(key)?.trim();
        match text.strip_prefix("0x") {
            Some(bits) => u32::from_str_radix(bits, 16)
                .ok()
                .map(|bits| f64::from(f32::from_bits(bits))),
            None => text.split(['/', ',']).next()?.trim().parse().ok(),
        }
    }

    fn pair(&self, key: &str) -> Option<(f64, f64)> {
        let (a, b) = self.text(key).split_once(',')?;
        Some((a.trim().parse().ok()?, b.trim().parse().ok()?))
    }
}

/// Parses a file; of several flights the one with the most frames.
pub(super) fn parse(bytes: &[u8], mut room: Room) -> Result<SourceLog, String> {
    // A frame may take one byte for any number of fields: a flight never does so on average.
    room.cells = room.cells.min(bytes.len().saturating_mul(MOST_CELLS_PER_BYTE));
    let starts = starts(bytes);
    let mut best: Option<(usize, Flight)> = None;
    let mut failed = None;
    for (number, start) in starts.iter().enumerate() {
        let end = starts.get(number + 1).copied().unwrap_or(bytes.len());
        match Flight::read(&bytes[*start..end], &mut room) {
            Ok(flight) => {
                if best.as_ref().is_none_or(|(_, best)| flight.rows() > best.rows()) {
                    best = Some((number, flight));
                }
            }
            Err(Refused::Flight(reason)) => failed = Some(reason),
            Err(Refused::File(reason)) => return Err(reason),
        }
    }
    let (number, flight) = best
        .filter(|(_, flight)| flight.rows() > 1)
        .ok_or_else(|| failed.unwrap_or_else(|| "no frame of this blackbox log can be read".to_owned()))?;
    let mut log = flight.into_log();
    if starts.len() > 1 {
        log.notes.push(format!(
            "the file holds {} flights; number {}, the longest, is taken",
            starts.len(),
            number + 1
        ));
    }
    Ok(log)
}

/// Where flights begin.
fn starts(bytes: &[u8]) -> Vec<usize> {
    /// Most flights of one file.
    const MOST: usize = 1000;
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(place) = bytes[at..].windows(MAGIC.len()).position(|window| window == MAGIC) {
        found.push(at + place);
        at += place + MAGIC.len();
        if found.len() == MOST {
            break;
        }
    }
    found
}

/// Why there is no flight: this one, or the whole file.
enum Refused {
    Flight(String),
    File(String),
}

/// One flight of a file.
struct Flight {
    header: Header,
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
    time: usize,
    lost_bytes: usize,
}

impl Flight {
    fn rows(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    fn read(bytes: &[u8], room: &mut Room) -> Result<Self, Refused> {
        let mut cursor = Cursor { bytes };
        let header = header(&mut cursor).map_err(Refused::Flight)?;
        let main = Definition::main(&header.values).map_err(Refused::Flight)?;
        let time = main
            .names
            .iter()
            .position(|name| name == "time")
            .ok_or_else(|| Refused::Flight("the blackbox log has no field `time`".to_owned()))?;
        room.stream(main.names.len()).map_err(Refused::File)?;
        let slow = Definition::of(&header.values, 'S');
        let gps = Definition::of(&header.values, 'G');
        let home = Definition::of(&header.values, 'H');
        let mut flight = Self {
            columns: vec![Vec::new(); main.names.len()],
            names: main.names.clone(),
            header,
            time,
            lost_bytes: 0,
        };
        let mut history = History::new(&flight.header);
        let mut scratch = Vec::new();
        while !cursor.bytes.is_empty() {
            let mut next = cursor;
            let kind = next.u8();
            let done = match kind {
                Some(b'I') => history.whole(&main, &mut next, &mut scratch),
                Some(b'P') => history.against(&main, &mut next, &mut scratch),
                Some(b'S') => slow.as_ref().and_then(|slow| slow.skip(&mut next)),
                Some(b'G') => gps.as_ref().and_then(|gps| gps.skip(&mut next)),
                Some(b'H') => home.as_ref().and_then(|home| home.skip(&mut next)),
                Some(b'E') => match history.event(&mut next) {
                    Some(true) => break,
                    Some(false) => Some(()),
                    None => None,
                },
                _ => None,
            };
            // A frame that is followed by no frame was read wrong.
            let followed = next.bytes.first().is_none_or(|byte| b"IPSGHE".contains(byte));
            if done.is_none() || !followed {
                history.lose();
                flight.lost_bytes += 1;
                cursor.take(1);
                continue;
            }
            if matches!(kind, Some(b'I' | b'P')) {
                if history.take(&main, &scratch, time) {
                    room.sample(1 + scratch.len()).map_err(Refused::File)?;
                    for (column, value) in flight.columns.iter_mut().zip(&scratch) {
                        column.push(*value as f64);
                    }
                } else {
                    flight.lost_bytes += cursor.bytes.len() - next.bytes.len();
                }
            }
            cursor = next;
        }
        Ok(flight)
    }

    fn into_log(self) -> SourceLog {
        let mut log = SourceLog::default();
        let mut stream = RawStream {
            name: "main".to_owned(),
            time_s: self.columns[self.time].iter().map(|time| time * 1e-6).collect(),
            fields: self.names.into_iter().zip(self.columns).collect(),
            ..RawStream::default()
        };
        if self.lost_bytes > 0 {
            log.notes.push(format!(
                "{} bytes are not part of a frame that could be read (cut or damaged file)",
                self.lost_bytes
            ));
        }
        let begin_s = stream.time_s.first().copied().unwrap_or(0.0);
        log.utc = crate::log::calendar::of_rfc3339(self.header.text("Log start datetime"))
            .map(|unix_s| (unix_s - begin_s, "the header line \"Log start datetime\""));
        fields::in_units(&self.header, &mut stream, &mut log);
        log.streams.push(stream);
        log
    }
}

/// Header lines up to the first frame.
fn header(cursor: &mut Cursor<'_>) -> Result<Header, String> {
    let mut header = Header::default();
    let mut lines = 0;
    while cursor.bytes.starts_with(b"H ") {
        let window = &cursor.bytes[..cursor.bytes.len().min(LONGEST_LINE)];
        let Some(length) = window.iter().position(|byte| *byte == b'\n') else {
            break;
        };
        let line = cursor.take(length + 1).unwrap_or_default();
        lines += 1;
        if lines > MOST_LINES {
            return Err(format!(
                "more than {MOST_LINES} header lines; a blackbox log was expected"
            ));
        }
        if let Some((key, value)) = String::from_utf8_lossy(&line[2..length]).split_once(':') {
            header.values.insert(key.trim().to_owned(), value.trim().to_owned());
        }
    }
    match header.number("Data version") {
        Some(2.0) => Ok(header),
        other => Err(format!(
            "blackbox data version {}; 2 is known",
            other.map_or_else(|| "not given".to_owned(), |version| version.to_string())
        )),
    }
}

#[cfg(test)]
mod tests;
