//! Why the link could not do what it was asked.

use crate::wire::address::{Address, Peer};
use std::path::PathBuf;

/// A failure of the autopilot link.
#[derive(Debug, thiserror::Error)]
pub enum AutopilotError {
    /// Another process listens there.
    #[error("{0} is in use: another onboard process or a ground tool is listening there; stop it or change `link`")]
    PortInUse(Address),
    /// The local address cannot be bound for another reason.
    #[error("cannot listen at {address}: {source}")]
    Bind {
        /// The configured line.
        address: Address,
        /// What the system said.
        source: std::io::Error,
    },
    /// The peer's name has no address.
    #[error("{address}: the host is not known ({source}); write its numeric address or mend the name service")]
    Host {
        /// The configured line.
        address: Address,
        /// What the system said.
        source: std::io::Error,
    },
    /// A value of the configuration cannot be used.
    #[error("autopilot link configuration: {0}")]
    Config(String),
    /// The key file cannot be used.
    #[error("the signing key file {path} cannot be used: {why}")]
    SigningKey {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// The receiving thread or its socket could not be set up.
    #[error("cannot start the autopilot link's receiver: {0}")]
    Receiver(std::io::Error),
    /// Nothing was heard yet and no peer is configured, or the line is not open.
    #[error("the autopilot cannot be reached: nothing was heard from it yet, or the line to it is not open")]
    NoPeer,
    /// The message was not sent; the next one may be.
    #[error("sending to the autopilot at {peer} failed: {source}")]
    Send {
        /// Where to.
        peer: Peer,
        /// What the system said.
        source: std::io::Error,
    },
    /// A setpoint with a value that is not a number, or a thrust outside 0..=1.
    #[error("the setpoint was not sent: its attitude or thrust is not finite, or the thrust is outside 0..=1")]
    BadSetpoint,
}
