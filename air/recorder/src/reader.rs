//! Reads a flight log back, also one whose writer was killed or whose file was damaged: everything that is whole, around
//! the damage.

use std::path::{Path, PathBuf};

use crate::channel::Channel;
use crate::error::RecorderError;
use crate::scan::{self, Contents, Damage};

/// A log in memory.
pub struct LogReader {
    path: PathBuf,
    bytes: Vec<u8>,
    contents: Contents,
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
        Self::of_bytes(path, bytes)
    }

    /// Reads what is in memory already; `path` is only its name.
    ///
    /// # Errors
    /// It does not begin as an MCAP file.
    pub fn of_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self, RecorderError> {
        if !bytes.starts_with(mcap::MAGIC) {
            let cause = "it does not begin with MCAP's magic bytes".to_owned();
            return Err(RecorderError::NotMcap { path: path.to_owned(), cause });
        }
        let contents = scan::scan(&bytes);
        Ok(LogReader { path: path.to_owned(), bytes, contents })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file was closed: its end is there. False after a crash or a full disk.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.contents.closed
    }

    /// What cannot be read, in the order of the file; empty: the file is whole, or was only cut off.
    #[must_use]
    pub fn damage(&self) -> &[Damage] {
        &self.contents.damage
    }

    /// The records in the order of writing, around what is damaged.
    pub fn entries(&self) -> impl Iterator<Item = Entry> + '_ {
        let chunks = self.contents.chunks.iter().filter_map(|chunk| scan::unpack(&self.bytes, chunk));
        chunks.flat_map(|data| {
            let entry = |(channel, time_ns, payload): (u16, u64, &[u8])| {
                let topic = self.contents.channels.get(&channel)?.clone();
                Some(Entry { topic, time_ns, payload: payload.to_vec() })
            };
            scan::messages(&data).filter_map(entry).collect::<Vec<_>>()
        })
    }
}
