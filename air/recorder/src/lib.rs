//! The flight recorder and the log reader: the only Rust crate that knows MCAP.

pub mod channel;
pub mod error;
pub mod image;
pub mod reader;
pub mod recorder;
pub mod room;
pub mod rotate;
mod scan;
pub mod writer;

pub use channel::Channel;
pub use error::RecorderError;
pub use reader::{Entry, LogReader};
pub use recorder::{Payload, Recorder};
pub use room::has_room;
pub use rotate::rotate;
pub use scan::Damage;
pub use writer::LogWriter;
