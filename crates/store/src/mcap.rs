//! Telemetry → `run.mcap`: the run as streams, for Foxglove, Lichtblick and other MCAP readers.
//!
//! Topics and messages: [`crate::streams`]. The log time is simulated time, ns since the start of the run, so that equal runs produce equal
//! files.

use crate::error::{Result, StoreError, io};
use crate::spool::{Chunk, SpoolHeader};
use crate::streams::{Streams, Topic};
use crate::summary::Summary;
use crate::telemetry::Column;
use mcap::records::{MessageHeader, Metadata, Record};
use mcap::sans_io::{LinearReadEvent, LinearReader};
use mcap::{Compression, McapError, WriteOptions, Writer};
use prost::Message as _;
use rotortwin_proto::foxglove;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read as _, Seek, Write};
use std::path::{Path, PathBuf};

/// Writes chunks of telemetry as MCAP.
pub(crate) struct McapSink<W: Write + Seek> {
    writer: Writer<W>,
    path: PathBuf,
    streams: Streams,
    /// Channel ids of the topics.
    channels: [u16; Topic::ALL.len()],
    failure: Option<String>,
    last_time_ns: u64,
}

impl<W: Write + Seek> McapSink<W> {
    /// Starts a file.
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
        let mut writer = create(writer).map_err(wrap)?;
        let channels = add_channels(&mut writer).map_err(wrap)?;
        writer.write_metadata(&metadata(summary)).map_err(wrap)?;
        Ok(Self {
            writer,
            path: path.to_path_buf(),
            streams: Streams::new(header, columns),
            channels,
            failure: summary.failure.as_ref().map(|failure| failure.sentence.clone()),
            last_time_ns: 0,
        })
    }

    /// Writes the messages of the next rows.
    pub(crate) fn push(&mut self, chunk: &Chunk) -> Result<()> {
        for row in 0..chunk.len {
            let sequence = (chunk.first_row + row as u64) as u32;
            let (writer, channels) = (&mut self.writer, &self.channels);
            let time_ns = self.streams.row(
                |place| chunk.columns[place][row],
                |topic, time_ns, message| write(writer, channels, topic, (time_ns, sequence), message),
            );
            self.last_time_ns = time_ns.map_err(|source| StoreError::Mcap {
                path: self.path.clone(),
                source,
            })?;
        }
        Ok(())
    }

    /// Completes the file.
    pub(crate) fn finish(mut self) -> Result<W> {
        let path = self.path.clone();
        let wrap = |source| StoreError::Mcap { path, source };
        if let Some(sentence) = self.failure.take() {
            let (writer, channels) = (&mut self.writer, &self.channels);
            let said = self
                .streams
                .end(self.last_time_ns, &sentence, |topic, time_ns, message| {
                    write(writer, channels, topic, (time_ns, 0), message)
                });
            if let Err(error) = said {
                return Err(wrap(error));
            }
        }
        if let Err(error) = self.writer.finish() {
            return Err(wrap(error));
        }
        Ok(self.writer.into_inner())
    }
}

/// Copies a file with one more topic of texts, or with other texts in that topic.
///
/// * `path`: file to copy   * `topic`: `foxglove.KeyValuePair`, `key` in each   * `texts`: simulated time, ns, and `value`, ascending
pub(crate) fn with_texts<W: Write + Seek>(
    path: &Path,
    writer: W,
    topic: &str,
    key: &str,
    texts: &[(u64, String)],
) -> Result<W> {
    let source = File::open(path).map_err(io(path, "cannot open the file"))?;
    let unwritten = |source| StoreError::Mcap {
        path: path.to_path_buf(),
        source,
    };
    let unread = |source| StoreError::McapRead {
        path: path.to_path_buf(),
        source,
    };
    let mut source = BufReader::new(source);
    let mut copy = create(writer).map_err(unwritten)?;
    let schema = copy
        .add_schema("foxglove.KeyValuePair", "protobuf", foxglove::FILE_DESCRIPTOR_SET)
        .map_err(unwritten)?;
    let own = copy
        .add_channel(schema, topic, "protobuf", &BTreeMap::new())
        .map_err(unwritten)?;
    let (mut schemas, mut channels) = (BTreeMap::new(), BTreeMap::new());
    let mut texts = texts.iter().peekable();
    let mut say = |copy: &mut Writer<W>, until_ns: u64| {
        while let Some((time_ns, value)) = texts.next_if(|(time_ns, _)| *time_ns <= until_ns) {
            let header = MessageHeader {
                channel_id: own,
                sequence: 0,
                log_time: *time_ns,
                publish_time: *time_ns,
            };
            let pair = foxglove::KeyValuePair {
                key: key.to_owned(),
                value: value.clone(),
            };
            copy.write_to_known_channel(&header, &pair.encode_to_vec())?;
        }
        Ok(())
    };
    let mut reader = LinearReader::new();
    while let Some(event) = reader.next_event() {
        let (opcode, data) = match event.map_err(unread)? {
            LinearReadEvent::ReadRequest(bytes) => {
                let read = source
                    .read(reader.insert(bytes))
                    .map_err(io(path, "cannot read the file"))?;
                reader.notify_read(read);
                continue;
            }
            LinearReadEvent::Record { opcode, data } => (opcode, data),
        };
        match mcap::parse_record(opcode, data).map_err(unread)? {
            Record::Schema { header, data } => {
                let id = copy
                    .add_schema(&header.name, &header.encoding, &data)
                    .map_err(unwritten)?;
                schemas.insert(header.id, id);
            }
            Record::Channel(channel) if channel.topic != topic => {
                let schema = schemas.get(&channel.schema_id).copied().unwrap_or(0);
                let id = copy
                    .add_channel(schema, &channel.topic, &channel.message_encoding, &channel.metadata)
                    .map_err(unwritten)?;
                channels.insert(channel.id, id);
            }
            Record::Message { mut header, data } => {
                // Of no known channel: what this topic said before.
                let Some(&id) = channels.get(&header.channel_id) else {
                    continue;
                };
                say(&mut copy, header.log_time).map_err(unwritten)?;
                header.channel_id = id;
                copy.write_to_known_channel(&header, &data).map_err(unwritten)?;
            }
            Record::Metadata(metadata) => copy.write_metadata(&metadata).map_err(unwritten)?,
            // The indices that follow are written anew.
            Record::DataEnd(_) => break,
            _ => {}
        }
    }
    say(&mut copy, u64::MAX).map_err(unwritten)?;
    copy.finish().map_err(unwritten)?;
    Ok(copy.into_inner())
}

fn create<W: Write + Seek>(writer: W) -> std::result::Result<Writer<W>, McapError> {
    WriteOptions::new()
        .library(format!("rotortwin-store {}", env!("CARGO_PKG_VERSION")))
        .compression(Some(Compression::Zstd))
        .compression_level(1)
        .compression_threads(0)
        .create(writer)
}

fn write<W: Write + Seek>(
    writer: &mut Writer<W>,
    channels: &[u16],
    topic: Topic,
    (time_ns, sequence): (u64, u32),
    message: &[u8],
) -> std::result::Result<(), McapError> {
    let header = MessageHeader {
        channel_id: channels[topic as usize],
        sequence,
        log_time: time_ns,
        publish_time: time_ns,
    };
    writer.write_to_known_channel(&header, message)
}

fn add_channels<W: Write + Seek>(writer: &mut Writer<W>) -> std::result::Result<[u16; Topic::ALL.len()], McapError> {
    let none = BTreeMap::new();
    let mut channels = [0; Topic::ALL.len()];
    for topic in Topic::ALL {
        let (name, descriptors) = topic.schema();
        let schema = writer.add_schema(name, "protobuf", descriptors)?;
        channels[topic as usize] = writer.add_channel(schema, topic.name(), "protobuf", &none)?;
    }
    Ok(channels)
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
