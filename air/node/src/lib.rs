//! The onboard process: sensors in, attitude and thrust out, telemetry and log beside it. The flight logic is
//! goshawk-core's; this crate gives it threads, a clock, a network and files.

pub mod bus;
pub mod clock;
pub mod config;
pub mod slot;
pub mod stats;
