//! Why a log could not be written or read.

use std::path::PathBuf;

/// A failure of the recorder or the reader.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// A log of that name exists; it is never overwritten.
    #[error("the log {0} exists already and is never overwritten: name another")]
    Exists(PathBuf),
    /// The file or its folder cannot be made.
    #[error("cannot create the log {path}: {source}; choose a folder that can be written to")]
    Create {
        /// The file.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// The recorder's thread could not be started.
    #[error("cannot start the recorder's thread: {0}")]
    Thread(std::io::Error),
    /// The file cannot be read.
    #[error("cannot read the log {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// The file is not a log at all.
    #[error("{path} is not an MCAP file: {cause}")]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        cause: String,
    },
    /// An image cannot be compressed.
    #[error("an image of {width} x {height} cannot be compressed: {cause}")]
    Image {
        /// px.
        width: u32,
        /// px.
        height: u32,
        /// What is wrong.
        cause: String,
    },
}
