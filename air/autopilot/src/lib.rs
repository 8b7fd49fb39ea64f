//! The autopilot's edge: MAVLink 2 over UDP, TCP or a serial port, and the only crate that knows MAVLink, NED and FRD.
//!
//! Outside this crate everything is ENU and FLU. Inside, [`frames`] is the one place that converts, and [`firmware`]
//! the one that knows how PX4 and ArduPilot differ. The parts are pure ([`wire`] bytes to packets, [`View`] packets to
//! state, `commands` what is asked and answered) and [`AutopilotLink`] is the line, the clock and the thread around
//! them.

pub mod address;
mod arming;
pub mod clock;
pub mod commands;
pub mod config;
mod contradiction;
pub mod copter;
mod endpoint;
pub mod error;
mod estimate;
pub mod events;
pub mod firmware;
pub mod frames;
mod inertial;
mod line;
pub mod link;
pub mod mode;
pub mod parameters;
pub mod peers;
mod pose;
mod receive;
pub mod signing;
pub mod status;
mod transport;
mod validity;
pub mod view;
pub mod wire;

pub use address::{Address, AddressError, Peer};
pub use commands::{Ack, Command, Outcome};
pub use config::{HeartbeatKind, LinkConfig, StreamRates};
pub use copter::CopterMode;
pub use error::AutopilotError;
pub use events::AutopilotEvent;
pub use firmware::{Firmware, Guided, Identity};
pub use link::{AutopilotLink, Glance};
pub use mode::{FlightMode, Px4Mode};
pub use parameters::Parameter;
pub use peers::{PeerEvent, Pin};
pub use signing::{SigningConfig, SigningKey};
pub use status::{Counters, Imu, Status, StatusText};
pub use validity::PositionFault;
pub use view::View;

/// The generated MAVLink messages that the link and the stand-in speak: the common ones and ArduPilot's own.
pub use mavlink::dialects::ardupilotmega as messages;
