//! The onboard process: sensors in, attitude and thrust out, telemetry and log beside it. The flight logic is
//! goshawk-core's; this crate gives it threads, a clock, a network and files.

pub mod access;
pub mod bus;
pub mod camera;
pub mod check;
pub mod clock;
pub mod commands;
pub mod config;
pub mod control;
pub mod convert;
pub mod errors;
pub mod flightlog;
pub mod health;
pub mod inputs;
pub mod planning;
pub mod realtime;
pub mod replay;
pub mod run;
pub mod sensors;
pub mod shared;
pub mod slot;
pub mod stats;
pub mod telemetry;
pub mod visitors;
