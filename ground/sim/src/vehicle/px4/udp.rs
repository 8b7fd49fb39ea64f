//! The stand-in on a UDP socket: one `poll` for each step of whatever simulates the vehicle.

use super::{Px4Config, Px4Logic, Px4Output, VehicleState};
use goshawk_autopilot::messages::MavMessage;
use goshawk_autopilot::wire::encode::Encoder;
use goshawk_autopilot::wire::packet::{Packet, for_each_packet};
use goshawk_core::Time;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};

/// A message id that no dialect has.
const UNKNOWN_ID: [u8; 3] = [0x11, 0x22, 0x33];

/// Why the stand-in has no socket.
#[derive(Debug, thiserror::Error)]
pub enum Px4UdpError {
    /// Another process listens there.
    #[error(
        "UDP {0} is in use: another simulator or a real PX4 simulation is listening there; stop it or change the port"
    )]
    PortInUse(SocketAddr),
    /// The socket cannot be made for another reason.
    #[error("the autopilot stand-in cannot use UDP {address}: {source}")]
    Socket {
        /// The local address.
        address: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
}

/// A [`Px4Logic`] that talks over UDP. Datagrams that cannot be sent are lost, as on any link.
pub struct Px4Udp {
    /// The state machine; its hooks are for whoever runs the simulation.
    pub logic: Px4Logic,
    encoder: Encoder,
    socket: UdpSocket,
    remote: Option<SocketAddr>,
    /// After so many messages it sends one that nobody knows; none: never.
    pub unknown_after: Option<u64>,
    sent: u64,
    packets: Vec<Packet>,
    pub(super) outgoing: Vec<MavMessage>,
}

impl Px4Udp {
    /// Listens at `bind`, streams to `remote`; none: to whoever is heard from first. PX4's own simulation has 14580
    /// and 14540 for a companion computer.
    ///
    /// # Errors
    /// The port is in use or cannot be bound.
    pub fn open(config: Px4Config, bind: SocketAddr, remote: Option<SocketAddr>) -> Result<Self, Px4UdpError> {
        let socket = UdpSocket::bind(bind).map_err(|source| match source.kind() {
            ErrorKind::AddrInUse => Px4UdpError::PortInUse(bind),
            _ => Px4UdpError::Socket { address: bind, source },
        })?;
        socket.set_nonblocking(true).map_err(|source| Px4UdpError::Socket { address: bind, source })?;
        Ok(Self {
            logic: Px4Logic::new(config),
            encoder: Encoder::new(config.system_id, config.component_id),
            socket,
            remote,
            unknown_after: None,
            sent: 0,
            packets: Vec::new(),
            outgoing: Vec::new(),
        })
    }

    /// The address that it listens at, with the port that the system chose if `bind` said 0.
    ///
    /// # Errors
    /// The socket does not say.
    pub fn local_address(&self) -> std::io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Receives, steps to `now` and sends. Never blocks. Call it once for each physics step.
    pub fn poll(&mut self, now: Time, vehicle: &VehicleState) -> Px4Output {
        self.packets.clear();
        self.receive();
        self.outgoing.clear();
        let output = self.logic.step(now, &self.packets, vehicle, &mut self.outgoing);
        if let Some(remote) = self.remote {
            for message in &self.outgoing {
                let _ = self.socket.send_to(self.encoder.encode(message).raw_bytes(), remote);
                self.sent += 1;
                if self.unknown_after.is_some_and(|every| self.sent.is_multiple_of(every)) {
                    let mut frame = self.encoder.encode(message).raw_bytes().to_vec();
                    frame[7..10].copy_from_slice(&UNKNOWN_ID);
                    let _ = self.socket.send_to(&frame, remote);
                }
            }
        }
        output
    }

    fn receive(&mut self) {
        let mut buffer = [0_u8; 2048]; // larger than any frame; a client sends one a datagram
        while let Ok((length, from)) = self.socket.recv_from(&mut buffer) {
            let before = self.packets.len();
            for_each_packet(&buffer[..length], |packet| self.packets.extend(packet));
            if self.remote.is_none() && self.packets.len() > before {
                self.remote = Some(from);
            }
        }
    }
}
