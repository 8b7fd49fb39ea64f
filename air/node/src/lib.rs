//! The onboard process: sensors in, attitude and thrust out, telemetry and log beside it. The flight logic is
//! goshawk-core's; this crate gives it threads, a clock, a network and files.

pub mod check;
pub mod flight;
pub mod network;
pub mod report;
pub mod run;
