//! What the onboard process and the simulator share, so that both fly the same vehicle: the vehicle file, the messages
//! of the wire and the log as the core's values, the clock, statistics.

pub mod clock;
pub mod config;
pub mod convert;
pub mod errors;
pub mod inputs;
pub mod sensors;
pub mod stats;
