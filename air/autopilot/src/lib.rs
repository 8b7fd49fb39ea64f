//! The autopilot's edge: MAVLink 2 over UDP, TCP or a serial port, and the only crate that knows MAVLink, NED and FRD.
//!
//! Outside this crate everything is ENU and FLU. Inside, [`frames`] is the one place that converts, and
//! [`dialogue::firmware`] the one that knows how PX4 and ArduPilot differ. Three rooms are pure: [`wire`] turns bytes
//! into packets, [`state`] packets into what is known, [`dialogue`] holds what is asked and answered. [`session`] is
//! the line, the clock and the thread around them; [`AutopilotLink`] is its door.

pub mod dialogue;
pub mod frames;
pub mod session;
pub mod state;
pub mod wire;

pub use dialogue::commands::{Ack, Command, Outcome};
pub use dialogue::copter::CopterMode;
pub use dialogue::events::AutopilotEvent;
pub use dialogue::firmware::{Firmware, Guided, Identity};
pub use dialogue::mode::{FlightMode, Px4Mode};
pub use dialogue::parameters::Parameter;
pub use dialogue::rates::StreamRates;
pub use session::config::{HeartbeatKind, LinkConfig};
pub use session::link::{AutopilotLink, Glance};
pub use session::vision::VisionMessage;
pub use state::radio::{CHANNELS, Radio};
pub use state::status::{Counters, Status, StatusText};
pub use state::validity::PositionFault;
pub use state::view::View;
pub use wire::address::{Address, AddressError, Peer};
pub use wire::error::AutopilotError;
pub use wire::peers::{PeerEvent, Pin};
pub use wire::signing::{SigningConfig, SigningKey};

/// The generated MAVLink messages that the link and the stand-in speak: the common ones and ArduPilot's own.
pub use mavlink::dialects::ardupilotmega as messages;
