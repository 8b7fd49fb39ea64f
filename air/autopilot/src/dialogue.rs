//! What is asked of the autopilot and what it answers, in PX4's words or ArduPilot's.

pub(crate) mod arming;
pub mod commands;
pub mod copter;
pub mod events;
pub mod firmware;
pub mod mode;
pub mod parameters;
pub mod rates;
