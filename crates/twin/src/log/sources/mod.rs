//! Log files of autopilots, each parsed into streams; nothing is converted here.
//!
//! ```text
//! bytes ─▶ detect ─▶ ulog · dataflash · dataflash_text · usdlog · blackbox · tlog · ros · csv_table ─▶ SourceLog{streams, parameters, notes} ─▶ mapping
//! ```
//! Each parser accepts any bytes: it never panics, and its allocations are bounded by [`Room`], which rejects a file
//! that needs more before the memory is taken. A damaged or truncated file yields what can be read before and after the
//! damage, with a note that says how much was lost.

mod blackbox;
pub(crate) mod csv_table;
mod dataflash;
mod dataflash_text;
mod ros;
mod tlog;
mod ulog;
mod usdlog;

use super::MAX_COLUMNS;
use std::collections::{BTreeMap, BTreeSet};

/// Most descriptions of messages, streams, and topics that are logged twice; logs of real flights have some hundreds.
const MOST_STREAMS: usize = 4096;
/// Most numbers of all streams' samples together; logs of real flights have some thousands.
const MOST_FIELDS: usize = 1 << 16;
/// Most parameters; real vehicles have some thousands.
pub(crate) const MOST_PARAMETERS: usize = 1 << 14;

/// Most changes of parameters, and most events of all kinds, that are kept of a log.
pub(crate) const MOST_CHANGES: usize = 10_000;

/// A parameter that changed while it was logged, on the clock of the streams.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ParameterChange {
    pub(crate) time_s: f64,
    pub(crate) name: String,
    pub(crate) before: f64,
    pub(crate) after: f64,
}

/// Remaining budget for what a file may expand to. Each is charged where it would grow; the error is the reason of the
/// rejection.
#[derive(Clone, Copy, Debug)]
struct Room {
    cells: usize,
    formats: usize,
    streams: usize,
    fields: usize,
}

impl Room {
    fn new(most_cells: usize) -> Self {
        Self {
            cells: most_cells,
            formats: MOST_STREAMS,
            streams: MOST_STREAMS,
            fields: MOST_FIELDS,
        }
    }

    fn take(place: &mut usize, count: usize, what: &str, most: usize) -> Result<(), String> {
        *place = place
            .checked_sub(count)
            .ok_or_else(|| format!("more than {most} {what}; a log of a flight was expected"))?;
        Ok(())
    }

    /// A sample of this many numbers.
    fn sample(&mut self, numbers: usize) -> Result<(), String> {
        self.cells = self
            .cells
            .checked_sub(numbers)
            .ok_or("more samples than this program takes; cut the log into parts")?;
        Ok(())
    }

    /// A description of a message.
    fn format(&mut self) -> Result<(), String> {
        Self::take(&mut self.formats, 1, "message formats", MOST_STREAMS)
    }

    /// A stream whose samples have this many numbers.
    fn stream(&mut self, fields: usize) -> Result<(), String> {
        if fields > MAX_COLUMNS {
            return Err(format!(
                "a message of {fields} numbers; at most {MAX_COLUMNS} are taken"
            ));
        }
        Self::take(&mut self.streams, 1, "subscriptions and instances", MOST_STREAMS)?;
        Self::take(
            &mut self.fields,
            fields,
            "numbers in all messages together",
            MOST_FIELDS,
        )
    }

    /// Parameters so far, before another one.
    fn parameter(known: usize) -> Result<(), String> {
        if known < MOST_PARAMETERS {
            return Ok(());
        }
        Err(format!(
            "more than {MOST_PARAMETERS} parameters; a log of a flight was expected"
        ))
    }
}

/// Kinds of autopilot logs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Ulog,
    DataFlash,
    DataFlashText,
    Usdlog,
    Blackbox,
    BlackboxCsv,
    Tlog,
    /// Recording of ROS 2.
    Mcap,
    /// The same in SQLite.
    Db3,
    /// `run.mcap` of this program.
    RunMcap,
    /// Not read; each is rejected with advice on converting it to a log.
    Ros1Bag,
    Zstd,
}

/// What a mapping requires of a file, and how it is to be read.
#[derive(Clone, Debug, Default)]
pub(crate) struct Asked<'a> {
    pub(crate) accept_damaged: bool,
    pub(crate) most_cells: usize,
    /// Topics and types that the mapping names; sources with many more are read for these only.
    pub(crate) places: BTreeSet<&'a str>,
    /// Beginnings of topic names that are taken before others of their type.
    pub(crate) topics: Vec<String>,
}

impl Asked<'_> {
    fn wants(&self, place: &str) -> bool {
        self.places.contains(place)
    }
}

/// A parsed file.
#[derive(Clone, Debug, Default)]
pub(crate) struct SourceLog {
    pub(crate) streams: Vec<RawStream>,
    pub(crate) parameters: BTreeMap<String, f64>,
    /// In chronological order.
    pub(crate) parameter_changes: Vec<ParameterChange>,
    pub(crate) notes: Vec<String>,
    /// What is in the file and was not read.
    pub(crate) unread: Vec<Unread>,
    /// What the file's clock says at 0 s of the streams.
    pub(crate) clock_s: f64,
    /// Seconds since 1970 UTC at 0 s of the streams, and the evidence for it, if the format has a field for it.
    pub(crate) utc: Option<(f64, &'static str)>,
}

/// A stream that was not read, and why.
#[derive(Clone, Debug)]
pub(crate) struct Unread {
    pub(crate) name: String,
    pub(crate) reason: String,
}

/// Samples of one topic (or message, or event), as in the file.
#[derive(Clone, Debug, Default)]
pub(crate) struct RawStream {
    /// Topic name.
    pub(crate) name: String,
    /// Type of its messages, where topics have names of their own; mappings name either.
    pub(crate) kind: String,
    /// 0 for the first instance.
    pub(crate) instance: u16,
    /// Time of each sample, s, on the file's clock.
    pub(crate) time_s: Vec<f64>,
    /// Field names and values; all as long as `time_s`.
    pub(crate) fields: Vec<(String, Vec<f64>)>,
    /// Samples left out because their time does not increase.
    pub(crate) dropped: usize,
}

impl RawStream {
    /// True if a mapping that names this means this stream.
    pub(crate) fn is_called(&self, name: &str, instance: u16) -> bool {
        if self.kind.is_empty() {
            self.name == name && self.instance == instance
        } else {
            // A topic's own name is never of several.
            (self.name == name && instance == 0) || (self.kind == name && self.instance == instance)
        }
    }

    pub(crate) fn label(&self) -> String {
        if self.instance == 0 || !self.kind.is_empty() {
            self.name.clone()
        } else {
            format!("{}#{}", self.name, self.instance)
        }
    }

    /// Drops samples whose time does not increase; says how many.
    fn keep_increasing(&mut self) -> usize {
        let mut last = f64::NEG_INFINITY;
        let keep: Vec<bool> = self
            .time_s
            .iter()
            .map(|time| {
                let later = *time > last;
                if later {
                    last = *time;
                }
                later
            })
            .collect();
        let dropped = keep.iter().filter(|keep| !**keep).count();
        if dropped > 0 {
            let filter = |values: &mut Vec<f64>| {
                let mut keep = keep.iter();
                values.retain(|_| keep.next() == Some(&true));
            };
            filter(&mut self.time_s);
            for (_, values) in &mut self.fields {
                filter(values);
            }
        }
        dropped
    }
}

impl SourceLog {
    /// Drops empty streams, and samples that go back in time.
    fn finish(mut self) -> Self {
        for stream in &mut self.streams {
            stream.dropped = stream.keep_increasing();
        }
        self.streams.retain(|stream| !stream.time_s.is_empty());
        self.streams
            .sort_by(|a, b| (&a.name, a.instance).cmp(&(&b.name, b.instance)));
        self
    }
}

/// Kind of an autopilot's log, from its first bytes; `None` for anything else.
pub(crate) fn detect(bytes: &[u8]) -> Option<Format> {
    if bytes.starts_with(ulog::MAGIC) {
        Some(Format::Ulog)
    } else if bytes.starts_with(&dataflash::FORMAT_MESSAGE) {
        Some(Format::DataFlash)
    } else if bytes.first() == Some(&usdlog::MAGIC) {
        Some(Format::Usdlog)
    } else if bytes.starts_with(blackbox::MAGIC) {
        Some(Format::Blackbox)
    } else if blackbox::decoded::looks_like(bytes) {
        Some(Format::BlackboxCsv)
    } else if bytes.starts_with(ros::mcap::MAGIC) {
        Some(if ros::mcap::is_own(bytes) {
            Format::RunMcap
        } else {
            Format::Mcap
        })
    } else if bytes.starts_with(b"#ROSBAG V") {
        Some(Format::Ros1Bag)
    } else if bytes.starts_with(ros::sqlite::MAGIC) {
        Some(Format::Db3)
    } else if bytes.starts_with(&[0x28, 0xb5, 0x2f, 0xfd]) {
        Some(Format::Zstd)
    } else if tlog::looks_like(bytes) {
        Some(Format::Tlog)
    } else {
        dataflash_text::looks_like(bytes).then_some(Format::DataFlashText)
    }
}

/// Parses a file; the error is the reason without the file's name.
pub(crate) fn parse(format: Format, bytes: &[u8], asked: &Asked<'_>) -> Result<SourceLog, String> {
    let room = Room::new(asked.most_cells);
    let log = match format {
        Format::Ulog => ulog::parse(bytes, room),
        Format::DataFlash => dataflash::parse(bytes, room),
        Format::DataFlashText => dataflash_text::parse(bytes, room),
        Format::Usdlog => usdlog::parse(bytes, asked.accept_damaged, room),
        Format::Blackbox => blackbox::parse(bytes, room),
        Format::BlackboxCsv => blackbox::decoded::parse(bytes, room),
        Format::Tlog => tlog::parse(bytes, room),
        Format::Mcap | Format::RunMcap => ros::mcap::parse(bytes, asked),
        Format::Db3 => ros::db3::parse(bytes, asked),
        Format::Ros1Bag => Err(
            "a bag of ROS 1; 'rosbags-convert --src FILE --dst FOLDER' makes a recording of ROS 2 of it, which is read"
                .to_owned(),
        ),
        Format::Zstd => Err("the whole file is compressed; 'zstd -d FILE' unpacks it".to_owned()),
    }?;
    Ok(log.finish())
}

/// Parses a CSV of whatever columns, as a mapping says.
pub(crate) fn parse_table(bytes: &[u8], layout: &csv_table::Layout, most_cells: usize) -> Result<SourceLog, String> {
    Ok(csv_table::parse(bytes, layout, Room::new(most_cells))?.finish())
}

/// A table whose columns are numbers already, as a mapping says.
pub(crate) fn of_columns(table: super::table::Table, layout: &csv_table::Layout) -> Result<SourceLog, String> {
    Ok(csv_table::of_columns(table, layout)?.finish())
}

/// Bytes taken from the front, never past the end.
#[derive(Clone, Copy)]
struct Cursor<'a> {
    bytes: &'a [u8],
}

impl<'a> Cursor<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (front, rest) = self.bytes.split_at_checked(count)?;
        self.bytes = rest;
        Some(front)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u8(&mut self) -> Option<u8> {
        self.array::<1>().map(|[byte]| byte)
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    /// Text up to a NUL byte, which is consumed.
    fn c_string(&mut self) -> Option<&'a str> {
        let length = self.bytes.iter().position(|byte| *byte == 0)?;
        let text = self.take(length)?;
        self.take(1)?;
        std::str::from_utf8(text).ok()
    }
}

/// A number as stored in a file, little endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
}

impl Number {
    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 | Self::F16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    fn read(self, cursor: &mut Cursor<'_>) -> Option<f64> {
        Some(match self {
            Self::I8 => f64::from(i8::from_le_bytes(cursor.array()?)),
            Self::U8 => f64::from(cursor.u8()?),
            Self::I16 => f64::from(i16::from_le_bytes(cursor.array()?)),
            Self::U16 => f64::from(cursor.u16()?),
            Self::I32 => f64::from(i32::from_le_bytes(cursor.array()?)),
            Self::U32 => f64::from(u32::from_le_bytes(cursor.array()?)),
            Self::I64 => i64::from_le_bytes(cursor.array()?) as f64,
            Self::U64 => u64::from_le_bytes(cursor.array()?) as f64,
            Self::F16 => half_to_f64(u16::from_le_bytes(cursor.array()?)),
            Self::F32 => f64::from(f32::from_le_bytes(cursor.array()?)),
            Self::F64 => f64::from_le_bytes(cursor.array()?),
        })
    }
}

/// IEEE 754 half precision.
fn half_to_f64(bits: u16) -> f64 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let fraction = f64::from(bits & 0x3ff);
    sign * match (bits >> 10) & 0x1f {
        0 => fraction * (-24.0_f64).exp2(),
        0x1f if fraction == 0.0 => f64::INFINITY,
        0x1f => f64::NAN,
        exponent => (1.0 + fraction / 1024.0) * (f64::from(exponent) - 15.0).exp2(),
    }
}

#[cfg(test)]
mod tests;
