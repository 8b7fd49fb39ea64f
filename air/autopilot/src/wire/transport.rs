//! What carries frames: a UDP socket or a [`Line`].

use crate::wire::address::{Address, Peer};
use crate::wire::error::AutopilotError;
use crate::wire::line::Line;
use rustix::net::{SendFlags, sendto};
use std::io::{Error, ErrorKind};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::time::Duration;

/// How long the receiver waits for a datagram before it looks at the clock.
const RECEIVE_WAIT: Duration = Duration::from_millis(5);
/// How long a send may wait for room in the socket's buffer, which is empty unless the network is stuck.
const SEND_WAIT: Duration = Duration::from_millis(1);

pub(crate) enum Transport {
    Udp {
        socket: UdpSocket,
        /// The peer that is configured; none: it is learned.
        peer: Option<SocketAddr>,
    },
    Line(Line),
}

impl Transport {
    /// Listens, or is ready to call. A line is opened by its reader.
    pub(crate) fn new(address: &Address) -> Result<Self, AutopilotError> {
        let (local, peer) = match address {
            Address::UdpIn(local) => (*local, None),
            Address::UdpOut(host) => {
                let peer = resolve(host).map_err(|source| AutopilotError::Host { address: address.clone(), source })?;
                (towards(peer), Some(peer))
            }
            _ => return Line::new(address).map(Self::Line),
        };
        let socket = UdpSocket::bind(local).map_err(|source| match source.kind() {
            ErrorKind::AddrInUse => AutopilotError::PortInUse(address.clone()),
            _ => AutopilotError::Bind { address: address.clone(), source },
        })?;
        socket.set_read_timeout(Some(RECEIVE_WAIT)).map_err(AutopilotError::Receiver)?;
        socket.set_write_timeout(Some(SEND_WAIT)).map_err(AutopilotError::Receiver)?;
        Ok(Self::Udp { socket, peer })
    }

    /// Where messages go before anything is heard; none: nowhere yet.
    pub(crate) fn first_peer(&self) -> Option<Peer> {
        match self {
            Self::Udp { peer, .. } => peer.map(Peer::Udp),
            Self::Line(_) => None,
        }
    }

    /// The peer is learned from the target's heartbeat.
    pub(crate) fn learns_peer(&self) -> bool {
        matches!(self, Self::Udp { peer: None, .. })
    }

    pub(crate) fn local_address(&self) -> Result<SocketAddr, AutopilotError> {
        match self {
            Self::Udp { socket, .. } => socket.local_addr().map_err(AutopilotError::Receiver),
            Self::Line(line) => {
                line.local_address().ok_or_else(|| AutopilotError::Config("this line has no local address".to_owned()))
            }
        }
    }

    /// Sends one frame; `hurried`: waits for no other thread and for no room, and rather does not send it.
    pub(crate) fn send(&self, peer: Peer, frame: &[u8], hurried: bool) -> std::io::Result<()> {
        match (self, peer) {
            (Self::Udp { socket, .. }, Peer::Udp(to)) => {
                let flags = if hurried { SendFlags::DONTWAIT } else { SendFlags::empty() };
                sendto(socket, frame, flags, &to).map(|_| ()).map_err(Error::from)
            }
            (Self::Line(line), Peer::Line) => line.send(frame, hurried),
            _ => Err(Error::new(ErrorKind::InvalidInput, "this peer is not on this line")),
        }
    }

    /// Why the line is not open; none: it is.
    pub(crate) fn problem(&self) -> Option<String> {
        match self {
            Self::Udp { .. } => None,
            Self::Line(line) => line.problem(),
        }
    }
}

fn resolve(host: &str) -> std::io::Result<SocketAddr> {
    host.to_socket_addrs()?.next().ok_or_else(|| Error::new(ErrorKind::NotFound, "it has no address"))
}

/// Any port that reaches `peer`.
fn towards(peer: SocketAddr) -> SocketAddr {
    match peer {
        SocketAddr::V4(peer) if peer.ip().is_loopback() => (Ipv4Addr::LOCALHOST, 0).into(),
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(peer) if peer.ip().is_loopback() => (Ipv6Addr::LOCALHOST, 0).into(),
        SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    }
}
