//! Bytes and packets: addresses, lines, framing, signatures, and who is heard.

pub mod address;
pub mod encode;
pub mod error;
pub(crate) mod line;
pub mod packet;
pub mod peers;
pub mod signing;
pub(crate) mod transport;
