//! The container MCAP (<https://mcap.dev/spec>): records, some of them packed in chunks.
//!
//! ```text
//! magic │ u8 opcode, u64 bytes, content │ …      schema: id, name, encoding, text · channel: id, schema, topic, encoding · message: channel, …
//! ```
//! Chunks are unpacked by the crate `mcap`, and their CRC-32 is checked; a damaged one is left out, the rest is read. A
//! file that ends early, as after a power loss, is read up to that point. The index at the end is not needed.

use super::super::usdlog::CRC_32;
use super::super::{Asked, Cursor, SourceLog};
use super::{Recording, refused_encoding};
use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::BTreeMap;

pub(in super::super) const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// What `rotortwin-store` writes as the library of its files.
const LIBRARY: &str = "rotortwin-store";
/// Largest chunk, unpacked.
const MOST_CHUNK_BYTES: u64 = 1 << 28;
/// A chunk that unpacks to more than this times its bytes is not a genuine recording.
const MOST_RATIO: u64 = 4096;
/// All chunks together, unpacked, over the bytes of the file.
const MOST_OVERALL_RATIO: u64 = 256;
const SOME_BYTES: u64 = 1 << 20;
/// All texts of definitions together.
const MOST_DEFINITION_BYTES: usize = 1 << 26;

/// The front of a record.
struct Record<'a> {
    opcode: u8,
    content: &'a [u8],
    /// With opcode and length.
    whole: &'a [u8],
}

impl<'a> Record<'a> {
    /// `None`: the bytes end before the record does.
    fn read(cursor: &mut Cursor<'a>) -> Option<Self> {
        let mut next = *cursor;
        let opcode = next.u8()?;
        let length = usize::try_from(u64::from_le_bytes(next.array()?)).ok()?;
        let content = next.take(length)?;
        let whole = &cursor.bytes[..cursor.bytes.len() - next.bytes.len()];
        *cursor = next;
        Some(Self { opcode, content, whole })
    }
}

/// Text with its length before it.
fn text<'a>(cursor: &mut Cursor<'a>) -> Option<&'a str> {
    let length = u32::from_le_bytes(cursor.array()?) as usize;
    std::str::from_utf8(cursor.take(length)?).ok()
}

/// How the messages of some channels are described.
struct Schema {
    name: String,
    encoding: String,
    text: String,
}

struct Reader<'a> {
    recording: Recording<'a>,
    schemas: BTreeMap<u16, Schema>,
    /// Topics by their channel.
    channels: BTreeMap<u16, usize>,
    definition_bytes: usize,
    unpacked_bytes: u64,
    most_unpacked_bytes: u64,
    /// Records whose content does not match their kind.
    odd: usize,
}

impl Reader<'_> {
    /// A record outside of chunks or in one; `at`: where that begins in the file.
    fn record(&mut self, opcode: u8, content: &[u8], at: u64) -> Result<(), String> {
        let mut cursor = Cursor { bytes: content };
        let known = match opcode {
            op::SCHEMA => self.schema(&mut cursor)?,
            op::CHANNEL => self.channel(&mut cursor)?,
            op::MESSAGE => self.message(&mut cursor, at)?,
            _ => Some(()),
        };
        self.odd += usize::from(known.is_none());
        Ok(())
    }

    fn schema(&mut self, cursor: &mut Cursor<'_>) -> Result<Option<()>, String> {
        let mut read = || Some((cursor.u16()?, text(cursor)?, text(cursor)?, text(cursor)));
        let Some((id, name, encoding, text)) = read() else {
            return Ok(None);
        };
        if self.schemas.contains_key(&id) {
            return Ok(Some(()));
        }
        // Other encodings are binary; nothing of them is needed.
        let text = text.filter(|_| encoding == "ros2msg").unwrap_or("");
        self.definition_bytes += name.len() + text.len();
        if self.definition_bytes > MOST_DEFINITION_BYTES {
            return Err(format!(
                "more than {MOST_DEFINITION_BYTES} bytes of message definitions"
            ));
        }
        self.schemas.insert(
            id,
            Schema {
                name: name.to_owned(),
                encoding: encoding.to_owned(),
                text: text.to_owned(),
            },
        );
        Ok(Some(()))
    }

    fn channel(&mut self, cursor: &mut Cursor<'_>) -> Result<Option<()>, String> {
        let mut read = || Some((cursor.u16()?, cursor.u16()?, text(cursor)?, text(cursor)?));
        let Some((id, schema, topic, encoding)) = read() else {
            return Ok(None);
        };
        if self.channels.contains_key(&id) {
            return Ok(Some(()));
        }
        let schema = self.schemas.get(&schema);
        let kind = schema.map_or("unknown", |schema| schema.name.as_str());
        let place = match (encoding, schema) {
            ("protobuf", Some(schema)) if schema.name.starts_with(super::own::PACKAGE) => {
                self.recording.own_topic(topic, &schema.name)?
            }
            ("cdr", Some(schema)) if schema.encoding == "ros2msg" => {
                self.recording.topic(topic, kind, Ok(&schema.text))?
            }
            ("cdr", _) => {
                let reason = match schema.map(|schema| schema.encoding.as_str()) {
                    None | Some("") => "the recording holds no definition of its messages".to_owned(),
                    Some(other) => format!("the definition of its messages is in '{other}', not in 'ros2msg'"),
                };
                self.recording.topic(topic, kind, Err(reason))?
            }
            (other, _) => self.recording.topic(topic, kind, Err(refused_encoding(other)))?,
        };
        self.channels.insert(id, place);
        Ok(Some(()))
    }

    fn message(&mut self, cursor: &mut Cursor<'_>, at: u64) -> Result<Option<()>, String> {
        let mut read = || {
            let channel = cursor.u16()?;
            let _sequence: [u8; 4] = cursor.array()?;
            let recorded = u64::from_le_bytes(cursor.array()?);
            let _published: [u8; 8] = cursor.array()?;
            Some((channel, recorded))
        };
        let Some((channel, recorded)) = read() else {
            return Ok(None);
        };
        let (Some(topic), Ok(recorded)) = (self.channels.get(&channel), i64::try_from(recorded)) else {
            return Ok(None);
        };
        self.recording.message(*topic, recorded, at, cursor.bytes)?;
        Ok(Some(()))
    }

    /// Records of a chunk; the inner error says why nothing of it is read.
    fn chunk(&mut self, record: &Record<'_>, at: u64) -> Result<Result<(), String>, String> {
        let mut cursor = Cursor { bytes: record.content };
        let mut read = || {
            let _times: [u8; 16] = cursor.array()?;
            let unpacked = u64::from_le_bytes(cursor.array()?);
            let crc = u32::from_le_bytes(cursor.array()?);
            let compression = text(&mut cursor)?;
            let packed = usize::try_from(u64::from_le_bytes(cursor.array()?)).ok()?;
            Some((unpacked, crc, compression, cursor.take(packed)?))
        };
        let Some((unpacked, crc, compression, records)) = read() else {
            return Ok(Err("its header is damaged".to_owned()));
        };
        match compression {
            "" if crc != 0 && CRC_32.checksum(records) != crc => Ok(Err("its CRC-32 does not fit".to_owned())),
            "" => {
                let mut records = Cursor { bytes: records };
                while !records.bytes.is_empty() {
                    let Some(record) = Record::read(&mut records) else {
                        return Ok(Err("it ends within a record".to_owned()));
                    };
                    self.record(record.opcode, record.content, at)?;
                }
                Ok(Ok(()))
            }
            "zstd" => {
                let packed = records.len() as u64;
                if unpacked > MOST_CHUNK_BYTES.min(SOME_BYTES + MOST_RATIO * packed) {
                    return Ok(Err(format!("{packed} bytes that would unpack to {unpacked}")));
                }
                self.unpacked_bytes += unpacked;
                if self.unpacked_bytes > self.most_unpacked_bytes {
                    return Err(format!(
                        "its chunks would unpack to more than {} bytes",
                        self.most_unpacked_bytes
                    ));
                }
                self.packed(record.whole, at)
            }
            other => Err(format!(
                "its chunks are compressed with '{other}'; zstd or none was expected ('mcap compress --compression zstd IN -o OUT' packs it anew)"
            )),
        }
    }

    /// The same of a chunk that is compressed.
    fn packed(&mut self, mut whole: &[u8], at: u64) -> Result<Result<(), String>, String> {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(usize::try_from(MOST_CHUNK_BYTES).unwrap_or(usize::MAX));
        let mut reader = LinearReader::new_with_options(options);
        loop {
            let event = match reader.next_event() {
                None => return Ok(Ok(())),
                Some(Err(error)) => return Ok(Err(error.to_string())),
                Some(Ok(event)) => event,
            };
            match event {
                LinearReadEvent::Record { data, opcode } => self.record(opcode, data, at)?,
                LinearReadEvent::ReadRequest(wanted) => {
                    let (front, rest) = whole.split_at(wanted.min(whole.len()));
                    reader.insert(front.len()).copy_from_slice(front);
                    reader.notify_read(front.len());
                    whole = rest;
                }
            }
        }
    }
}

/// True for a file that this program wrote: its header names the library.
pub(in super::super) fn is_own(bytes: &[u8]) -> bool {
    let mut cursor = Cursor { bytes };
    cursor.take(MAGIC.len());
    let header = Record::read(&mut cursor).filter(|record| record.opcode == op::HEADER);
    header.is_some_and(|header| {
        let mut content = Cursor { bytes: header.content };
        let _profile = text(&mut content);
        text(&mut content).is_some_and(|library| library.starts_with(LIBRARY))
    })
}

/// Parses an MCAP file.
pub(in super::super) fn parse(bytes: &[u8], asked: &Asked<'_>) -> Result<SourceLog, String> {
    let mut cursor = Cursor { bytes };
    cursor.take(MAGIC.len());
    let mut reader = Reader {
        recording: Recording::new(asked),
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
        definition_bytes: 0,
        unpacked_bytes: 0,
        most_unpacked_bytes: MOST_CHUNK_BYTES.max(MOST_OVERALL_RATIO * bytes.len() as u64),
        odd: 0,
    };
    let (mut damaged, mut first) = (0_usize, String::new());
    let mut ended = false;
    while !cursor.bytes.is_empty() {
        let at = (bytes.len() - cursor.bytes.len()) as u64;
        let Some(record) = Record::read(&mut cursor) else {
            break;
        };
        // The rest is an index of what has been read.
        if record.opcode == op::DATA_END {
            ended = true;
            break;
        }
        if record.opcode != op::CHUNK {
            reader.record(record.opcode, record.content, at)?;
        } else if let Err(reason) = reader.chunk(&record, at)? {
            if damaged == 0 {
                first = format!("the one at byte {at}: {reason}");
            }
            damaged += 1;
        }
    }
    let mut recording = reader.recording;
    if !ended {
        recording.notes.push(format!(
            "the file ends early: its last {} of {} bytes are no whole record",
            cursor.bytes.len(),
            bytes.len()
        ));
    }
    if damaged > 0 {
        recording
            .notes
            .push(format!("{damaged} damaged chunks are left out, {first}"));
    }
    if reader.odd > 0 {
        recording.notes.push(format!(
            "{} records that could not be understood are left out",
            reader.odd
        ));
    }
    recording.finish()
}
