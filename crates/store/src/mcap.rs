//! Telemetry → `run.mcap`: the run as streams, for Foxglove, Lichtblick and other MCAP readers.
//!
//! Topics and messages: [`crate::streams`]. The log time is simulated time, ns since the start of the run, so that equal runs produce equal
//! files.

use crate::error::{Result, StoreError};
use crate::spool::{Chunk, SpoolHeader};
use crate::streams::{Streams, Topic};
use crate::summary::Summary;
use crate::telemetry::Column;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::io::{Seek, Write};
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
        let mut writer = WriteOptions::new()
            .library(format!("rotortwin-store {}", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            .create(writer)
            .map_err(wrap)?;
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
