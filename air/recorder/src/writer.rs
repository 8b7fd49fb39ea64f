//! Writes records into an MCAP file: protobuf channels with their schemas, zstd chunks. Knows no thread.
//!
//! A chunk is built in memory and reaches the sink whole and in order, so a killed writer leaves a file that is intact
//! but for its end, and the sink need not seek.

use std::collections::BTreeMap;
use std::io::{self, Write};

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{Compression, WriteOptions, Writer};

use crate::channel::Channel;

/// A chunk ends at this size, unpacked. Chosen by eye.
const CHUNK_BYTES: u64 = 1 << 20;

/// An open MCAP file. Dropped, it ends as one that was cut off: without a summary.
pub struct LogWriter<W: Write> {
    /// None: it is finished.
    writer: Option<Writer<NoSeek<W>>>,
    channels: BTreeMap<Channel, (u16, u32)>,
}

impl<W: Write> LogWriter<W> {
    /// Begins a file in `sink`.
    ///
    /// # Errors
    /// The sink refused the first bytes.
    pub fn new(sink: W) -> Result<Self, mcap::McapError> {
        let writer = WriteOptions::new()
            .compression(Some(Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            .disable_seeking(true)
            .chunk_size(Some(CHUNK_BYTES))
            .library(concat!("goshawk-recorder ", env!("CARGO_PKG_VERSION")))
            .create(NoSeek::new(sink))?;
        Ok(LogWriter { writer: Some(writer), channels: BTreeMap::new() })
    }

    /// Adds one record; `time_ns` is on the vehicle's monotonic clock.
    ///
    /// # Errors
    /// The sink refused.
    pub fn write(&mut self, channel: Channel, time_ns: u64, payload: &[u8]) -> Result<(), mcap::McapError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let (id, sequence) = if let Some((id, sequence)) = self.channels.get_mut(&channel) {
            *sequence = sequence.wrapping_add(1);
            (*id, *sequence)
        } else {
            let schema = writer.add_schema(channel.message, "protobuf", goshawk_proto::FILE_DESCRIPTOR_SET)?;
            let id = writer.add_channel(schema, channel.topic, "protobuf", &BTreeMap::new())?;
            self.channels.insert(channel, (id, 0));
            (id, 0)
        };
        let header = MessageHeader { channel_id: id, sequence, log_time: time_ns, publish_time: time_ns };
        writer.write_to_known_channel(&header, payload)
    }

    /// Ends the current chunk and hands it to the sink: what was written so far can be read after a crash.
    ///
    /// # Errors
    /// The sink refused.
    pub fn flush(&mut self) -> Result<(), mcap::McapError> {
        self.writer.as_mut().map_or(Ok(()), Writer::flush)
    }

    /// Writes the summary and gives the sink back.
    ///
    /// # Errors
    /// The sink refused.
    pub fn finish(mut self) -> Result<W, mcap::McapError> {
        let mut writer = self.writer.take().ok_or_else(|| io::Error::other("the log is finished"))?;
        let finished = writer.finish();
        let sink = writer.into_inner().into_inner();
        finished.map(|_| sink)
    }
}

impl<W: Write> Drop for LogWriter<W> {
    /// The library's writer would add the summary: a recording that an error ended would look whole.
    fn drop(&mut self) {
        if let Some(writer) = self.writer.take() {
            drop(writer.into_inner());
        }
    }
}
