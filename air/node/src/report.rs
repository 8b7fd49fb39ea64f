//! What happened, for whoever watches, for the log, and for the vehicle's own readiness.

pub mod flightlog;
pub mod health;
pub mod preview;
pub mod telemetry;
