//! The line, the clock and the thread around them.

pub mod config;
pub(crate) mod endpoint;
pub mod link;
pub(crate) mod receive;
pub mod vision;
