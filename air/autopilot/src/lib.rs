//! The autopilot's edge: MAVLink 2 over UDP, and the only crate that knows MAVLink, NED and FRD.
//!
//! Outside this crate everything is ENU and FLU. Inside, [`frames`] is the one place that converts. The parts are
//! pure ([`wire`] bytes to packets, [`View`] packets to state, `commands` what is asked and answered) and
//! [`AutopilotLink`] is the socket, the clock and the thread around them.

pub mod clock;
pub mod commands;
pub mod config;
mod endpoint;
pub mod error;
pub mod events;
pub mod frames;
pub mod link;
pub mod mode;
pub mod parameters;
mod pose;
pub mod status;
pub mod view;
pub mod wire;

pub use commands::{Ack, Command, Outcome};
pub use config::{HeartbeatKind, LinkConfig, StreamRates};
pub use error::AutopilotError;
pub use events::AutopilotEvent;
pub use link::{AutopilotLink, Glance};
pub use mode::Px4Mode;
pub use parameters::Parameter;
pub use status::{Counters, Imu, Status, StatusText};
pub use view::View;

/// The generated MAVLink messages that the link and the stand-in speak.
pub use mavlink::dialects::common as messages;
