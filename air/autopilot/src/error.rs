//! Why the link could not do what it was asked.

use std::net::SocketAddr;

/// A failure of the autopilot link.
#[derive(Debug, thiserror::Error)]
pub enum AutopilotError {
    /// Another process listens there.
    #[error("UDP {0} is in use: another onboard process or a ground tool is listening there; stop it or change `bind`")]
    PortInUse(SocketAddr),
    /// The local address cannot be bound for another reason.
    #[error("cannot listen on UDP {address}: {source}")]
    Bind {
        /// The configured local address.
        address: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
    /// A value of the configuration cannot be used.
    #[error("autopilot link configuration: {0}")]
    Config(String),
    /// The receiving thread or its socket could not be set up.
    #[error("cannot start the autopilot link's receiver: {0}")]
    Receiver(std::io::Error),
    /// Nothing was heard yet and no peer is configured.
    #[error("the autopilot's address is unknown: nothing was heard from it yet and no `peer` is configured")]
    NoPeer,
    /// The datagram was not sent; the next one may be.
    #[error("sending to the autopilot at {peer} failed: {source}")]
    Send {
        /// Where to.
        peer: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
    /// A setpoint with a value that is not a number, or a thrust outside 0..=1.
    #[error("the setpoint was not sent: its attitude or thrust is not finite, or the thrust is outside 0..=1")]
    BadSetpoint,
}
