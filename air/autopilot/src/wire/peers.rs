//! Who may be the peer on a UDP port where it is not the line's other end, and who else speaks there.
//!
//! Anybody who reaches the port can write the autopilot's ids into a packet. So ids alone make nobody the peer:
//! - a pinned address is the only one that may ever be it;
//! - while the peer is heard, nobody takes its place;
//! - when it has fallen silent in flight, only its own host may (a router that started again has another port), or
//!   whoever signs with our key;
//! - when it has fallen silent on the ground, another host may, which is told as an event.
//!
//! Whoever else speaks is named once, and only so many are: a flood of addresses does not flood the log.

use std::collections::{BTreeSet, VecDeque};
use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;

/// Others that are named; one more line then says that the rest is not.
pub const NAMED: usize = 16;
/// Events kept for whoever takes them; older ones go first.
const KEPT: usize = 64;

/// The only address that may be the peer: a host, with or without a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    ip: IpAddr,
    port: Option<u16>,
}

/// A text that is no address.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no numeric address; write the autopilot's, such as 192.168.1.5 or 192.168.1.5:14550")]
pub struct PinError(String);

impl FromStr for Pin {
    type Err = PinError;

    fn from_str(text: &str) -> Result<Self, PinError> {
        let with_port = || text.parse::<SocketAddr>().ok().filter(|a| a.port() != 0).map(|a| (a.ip(), Some(a.port())));
        let (ip, port) =
            text.parse().ok().map(|ip: IpAddr| (ip, None)).or_else(with_port).ok_or(PinError(text.into()))?;
        if ip.is_unspecified() || ip.is_multicast() {
            return Err(PinError(text.into()));
        }
        Ok(Self { ip: ip.to_canonical(), port })
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.port {
            Some(port) => SocketAddr::new(self.ip, port).fmt(f),
            None => self.ip.fmt(f),
        }
    }
}

impl Pin {
    /// It is this computer.
    #[must_use]
    pub fn is_loopback(&self) -> bool {
        self.ip.is_loopback()
    }

    /// `address` is the pinned one.
    #[must_use]
    pub fn allows(&self, address: SocketAddr) -> bool {
        self.ip == address.ip().to_canonical() && self.port.is_none_or(|port| port == address.port())
    }
}

/// What is known when somebody who is not the peer sends the target's heartbeat.
#[derive(Clone, Copy, Debug)]
pub struct Circumstances {
    /// The peer so far; none: nobody yet.
    pub peer: Option<SocketAddr>,
    /// The peer's heartbeat, or anything else of it, is young.
    pub heard: bool,
    /// By what was last told, motors may turn or it is in the air.
    pub in_flight: bool,
    /// The heartbeat is rightly signed, with a time that is not past.
    pub signed: bool,
}

/// What is told of the peer and of others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PeerEvent {
    /// Somebody who is not the peer claims to be the autopilot, or speaks with other ids from the peer's address.
    Other {
        /// Its address.
        from: SocketAddr,
        /// Its system id, as it says.
        system: u8,
        /// Its component id, as it says.
        component: u8,
        /// Who is believed; none: nobody yet.
        peer: Option<SocketAddr>,
    },
    /// Too many others: no more are named.
    Crowd,
    /// After silence another address is the peer.
    Moved {
        /// Who it was.
        from: SocketAddr,
        /// Who it is.
        to: SocketAddr,
    },
}

impl PeerEvent {
    /// Who speaks is heard by way of the autopilot itself, which passes on what ground stations say.
    #[must_use]
    pub fn is_through_the_peer(&self) -> bool {
        matches!(self, Self::Other { from, peer, .. } if *peer == Some(*from))
    }
}

impl fmt::Display for PeerEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Other { from, system, component, .. } if self.is_through_the_peer() => write!(
                f,
                "system {system} and component {component} are heard through the autopilot, at {from}: \
                 a ground station, or a part of the vehicle; what they say is not believed"
            ),
            Self::Other { from, system, component, peer } => {
                write!(f, "{from} speaks too, as system {system} and component {component}, and is not believed: ")?;
                match peer {
                    Some(peer) => write!(f, "the autopilot is at {peer}; find out who that is"),
                    None => f.write_str("it is not the `peer` of the vehicle file; find out who that is"),
                }
            }
            Self::Crowd => write!(f, "more than {NAMED} others speak on the autopilot's port: the rest is not named"),
            Self::Moved { from, to } => {
                write!(f, "the autopilot was silent at {from} and is now at {to}: see that this is yours")
            }
        }
    }
}

/// Judges who may be the peer, and names others.
#[derive(Clone, Debug, Default)]
pub struct Peers {
    pin: Option<Pin>,
    named: BTreeSet<(IpAddr, u8, u8)>,
    crowd: bool,
    events: VecDeque<PeerEvent>,
}

impl Peers {
    /// `pin`: the only address that may be the peer; none: see the module.
    #[must_use]
    pub fn new(pin: Option<Pin>) -> Self {
        Self { pin, ..Self::default() }
    }

    /// Whether `from`, who is not the peer, is worth listening to at all.
    #[must_use]
    pub fn allows(&self, from: SocketAddr) -> bool {
        self.pin.is_none_or(|pin| pin.allows(from))
    }

    /// Whether `from` becomes the peer by the target's heartbeat.
    pub fn admit(&mut self, from: SocketAddr, now: Circumstances) -> bool {
        if !self.allows(from) || now.heard {
            return false;
        }
        let Some(peer) = now.peer else { return true };
        let same_host = peer.ip().to_canonical() == from.ip().to_canonical();
        if now.in_flight && !same_host && !now.signed {
            return false;
        }
        self.tell(PeerEvent::Moved { from: peer, to: from });
        true
    }

    /// Names a sender that is not believed, once.
    pub fn name(&mut self, from: SocketAddr, system: u8, component: u8, peer: Option<SocketAddr>) {
        let sender = (from.ip().to_canonical(), system, component);
        if self.crowd || self.named.contains(&sender) {
            return;
        }
        if self.named.len() == NAMED {
            self.crowd = true;
            return self.tell(PeerEvent::Crowd);
        }
        self.named.insert(sender);
        self.tell(PeerEvent::Other { from, system, component, peer });
    }

    /// Takes what happened since the last call, oldest first.
    pub fn take_events(&mut self) -> Vec<PeerEvent> {
        self.events.drain(..).collect()
    }

    fn tell(&mut self, event: PeerEvent) {
        if self.events.len() == KEPT {
            self.events.pop_front();
        }
        self.events.push_back(event);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> SocketAddr {
        text.parse().unwrap()
    }

    const SILENT: Circumstances = Circumstances { peer: None, heard: false, in_flight: false, signed: false };

    fn after(in_flight: bool) -> Circumstances {
        Circumstances { peer: Some(at("10.0.0.5:14550")), in_flight, ..SILENT }
    }

    #[test]
    fn a_pin_is_an_address_with_or_without_a_port() {
        for (text, good, bad) in [
            ("10.0.0.5", "10.0.0.5:1", "10.0.0.6:1"),
            ("10.0.0.5:14550", "10.0.0.5:14550", "10.0.0.5:14551"),
            ("10.0.0.5", "[::ffff:10.0.0.5]:7", "[::1]:7"),
            ("fe80::1", "[fe80::1]:9", "10.0.0.5:9"),
            ("[fe80::1]:9", "[fe80::1]:9", "[fe80::1]:8"),
        ] {
            let pin: Pin = text.parse().unwrap();
            assert_eq!(pin.to_string(), text);
            assert!(pin.allows(at(good)) && !pin.allows(at(bad)), "{text}");
        }
        for text in ["", "px4.local", "10.0.0.5:", "10.0.0.5:0", "0.0.0.0", "10.0.0.5:99999", "224.0.0.1"] {
            let error = text.parse::<Pin>().unwrap_err().to_string();
            assert!(error.contains("192.168.1.5:14550"), "{text}: {error}");
        }
    }

    #[test]
    fn only_the_pinned_address_is_ever_the_peer() {
        let mut peers = Peers::new(Some("10.0.0.5".parse().unwrap()));
        assert!(!peers.admit(at("10.0.0.6:14550"), SILENT), "not by speaking first");
        assert!(!peers.admit(at("10.0.0.6:14550"), after(false)), "not after silence");
        assert!(!peers.admit(at("10.0.0.6:14550"), Circumstances { signed: true, ..after(true) }));
        assert!(peers.admit(at("10.0.0.5:14550"), SILENT));
    }

    #[test]
    fn nobody_takes_the_place_of_a_peer_that_is_heard() {
        let mut peers = Peers::default();
        let heard = Circumstances { heard: true, signed: true, ..after(false) };
        assert!(!peers.admit(at("10.0.0.5:14551"), heard));
        assert!(!peers.admit(at("10.0.0.6:14550"), heard));
        assert_eq!(peers.take_events(), []);
    }

    #[test]
    fn in_flight_only_its_own_host_follows_a_silent_peer() {
        let mut peers = Peers::default();
        assert!(!peers.admit(at("10.0.0.6:14550"), after(true)));
        assert!(peers.admit(at("10.0.0.5:40000"), after(true)), "its router has started again");
        assert_eq!(peers.take_events().len(), 1);
        let signed = Circumstances { signed: true, ..after(true) };
        assert!(peers.admit(at("10.0.0.6:14550"), signed), "the key says who it is");
    }

    #[test]
    fn on_the_ground_another_host_follows_a_silent_peer_and_is_named() {
        let mut peers = Peers::default();
        assert!(peers.admit(at("10.0.0.6:14550"), after(false)));
        let events = peers.take_events();
        assert_eq!(events, [PeerEvent::Moved { from: at("10.0.0.5:14550"), to: at("10.0.0.6:14550") }]);
        assert!(events[0].to_string().contains("10.0.0.6:14550"));
    }

    #[test]
    fn others_are_named_once_each_and_a_crowd_in_one_line() {
        let mut peers = Peers::default();
        for _ in 0..3 {
            for host in 0..=255 {
                peers.name(SocketAddr::new([10, 0, 1, host].into(), 14_550), 1, 1, None);
            }
        }
        let events = peers.take_events();
        assert_eq!(events.len(), NAMED + 1);
        assert_eq!(events[NAMED], PeerEvent::Crowd);
        assert!(events[0].to_string().contains("10.0.1.0:14550"), "{}", events[0]);
    }
}
