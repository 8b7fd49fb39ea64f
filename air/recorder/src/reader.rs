//! Reads a flight log back, also one whose writer was killed: everything up to the first damaged chunk.

use std::path::{Path, PathBuf};

use mcap::read::Options;
use mcap::{Message, MessageStream};

use crate::channel::Channel;
use crate::error::RecorderError;

/// A log in memory.
pub struct LogReader {
    path: PathBuf,
    bytes: Vec<u8>,
}

/// One record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its topic.
    pub topic: String,
    /// The vehicle's monotonic clock.
    pub time_ns: u64,
    /// The encoded message.
    pub payload: Vec<u8>,
}

impl Entry {
    /// The record as a message of `channel`; none if it is of another channel or does not decode.
    #[must_use]
    pub fn decode<M: prost::Message + Default>(&self, channel: Channel) -> Option<M> {
        if self.topic == channel.topic { M::decode(self.payload.as_slice()).ok() } else { None }
    }
}

impl LogReader {
    /// Reads the file.
    ///
    /// # Errors
    /// It cannot be read, or does not begin as an MCAP file.
    pub fn open(path: &Path) -> Result<Self, RecorderError> {
        let bytes = std::fs::read(path).map_err(|source| RecorderError::Read { path: path.to_owned(), source })?;
        if !bytes.starts_with(mcap::MAGIC) {
            let cause = "it does not begin with MCAP's magic bytes".to_owned();
            return Err(RecorderError::NotMcap { path: path.to_owned(), cause });
        }
        Ok(LogReader { path: path.to_owned(), bytes })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file was closed: its last chunk and its summary are there. False after a crash or a full disk.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        matches!(mcap::Summary::read(&self.bytes), Ok(Some(_)))
    }

    /// The records in the order of writing, ending at the first damage.
    pub fn entries(&self) -> impl Iterator<Item = Entry> + '_ {
        MessageStream::new_with_options(&self.bytes, Options::IgnoreEndMagic | Options::ValidateChunkCrcs)
            .into_iter()
            .flatten()
            .map_while(Result::ok)
            .map(|message: Message<'_>| Entry {
                topic: message.channel.topic.clone(),
                time_ns: message.log_time,
                payload: message.data.into_owned(),
            })
    }
}
