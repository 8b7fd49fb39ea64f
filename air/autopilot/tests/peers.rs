//! Who may be the autopilot on a UDP port: real sockets, real MAVLink, a clock of the test's own.

#![allow(clippy::unwrap_used)] // a test's helpers too fail by panicking

use goshawk_autopilot::messages::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavType};
use goshawk_autopilot::wire::encode::Encoder;
use goshawk_autopilot::{AutopilotLink, LinkConfig, Peer, PeerEvent};
use goshawk_core::Time;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// A link that listens on all of loopback's addresses, and its clock.
struct Rig {
    link: AutopilotLink,
    port: u16,
    now: Arc<AtomicU64>,
}

impl Rig {
    fn new(peer: Option<&str>) -> Self {
        let now = Arc::new(AtomicU64::new(5_000_000_000));
        let clock = Arc::clone(&now);
        let config = LinkConfig {
            peer: peer.map(|peer| peer.parse().unwrap()),
            ..LinkConfig::customary("0.0.0.0:0".parse().unwrap())
        };
        let link = AutopilotLink::open(config, move || Time(clock.load(Ordering::Relaxed))).unwrap();
        let port = link.local_address().unwrap().port();
        Self { link, port, now }
    }

    fn pass(&self, seconds: f64) {
        self.now.fetch_add((seconds * 1e9) as u64, Ordering::Relaxed);
    }

    fn received(&self) -> u64 {
        let counters = self.link.status(Time(self.now.load(Ordering::Relaxed))).counters;
        counters.received + counters.strangers + counters.foreign
    }

    /// Sends a heartbeat from `socket` and waits until it was judged.
    fn heartbeat(&self, socket: &UdpSocket, system: u8, armed: bool) {
        let base_mode = if armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
        let heartbeat = HEARTBEAT_DATA {
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            base_mode,
            ..HEARTBEAT_DATA::default()
        };
        let frame = Encoder::new(system, 1).encode(&MavMessage::HEARTBEAT(heartbeat));
        let before = self.received();
        socket.send_to(frame.raw_bytes(), ("127.0.0.1", self.port)).unwrap();
        let patience = Instant::now() + Duration::from_secs(10);
        while self.received() == before {
            assert!(Instant::now() < patience, "it was never judged");
            std::thread::yield_now();
        }
    }

    fn peer(&self) -> Option<SocketAddr> {
        match self.link.peer() {
            Some(Peer::Udp(address)) => Some(address),
            _ => None,
        }
    }

    fn armed(&self) -> bool {
        self.link.status(Time(self.now.load(Ordering::Relaxed))).armed
    }
}

/// A computer of its own: all of 127.0.0.0/8 is this one's.
fn host(last: u8) -> (UdpSocket, SocketAddr) {
    let socket = UdpSocket::bind((Ipv4Addr::new(127, 0, 0, last), 0)).unwrap();
    let address = socket.local_addr().unwrap();
    (socket, address)
}

#[test]
fn who_speaks_first_is_not_the_peer_where_another_is_pinned() {
    let rig = Rig::new(Some("127.0.0.5"));
    let (intruder, whence) = host(66);
    rig.heartbeat(&intruder, 1, true);
    assert_eq!((rig.peer(), rig.armed()), (None, false));
    let events = rig.link.take_peer_events();
    assert_eq!(events, [PeerEvent::Other { from: whence, system: 1, component: 1, peer: None }]);
    let (autopilot, address) = host(5);
    rig.heartbeat(&autopilot, 1, false);
    assert_eq!(rig.peer(), Some(address));
    rig.pass(100.0);
    rig.heartbeat(&intruder, 1, true);
    assert_eq!((rig.peer(), rig.armed()), (Some(address), false), "nor after silence");
}

#[test]
fn a_pinned_port_is_the_only_one_that_is_believed() {
    let (autopilot, address) = host(5);
    let (other, _) = host(5);
    let rig = Rig::new(Some(&address.to_string()));
    rig.heartbeat(&other, 1, true);
    assert_eq!(rig.peer(), None);
    rig.heartbeat(&autopilot, 1, false);
    assert_eq!((rig.peer(), rig.armed()), (Some(address), false));
}

#[test]
fn a_second_sender_is_named_once_and_changes_nothing_while_the_peer_is_heard() {
    let rig = Rig::new(None);
    let ((autopilot, address), (intruder, whence)) = (host(5), host(66));
    rig.heartbeat(&autopilot, 1, false);
    for _ in 0..20 {
        rig.pass(0.5);
        rig.heartbeat(&autopilot, 1, false);
        rig.heartbeat(&intruder, 1, true);
        assert_eq!((rig.peer(), rig.armed()), (Some(address), false));
    }
    let events = rig.link.take_peer_events();
    assert_eq!(events, [PeerEvent::Other { from: whence, system: 1, component: 1, peer: Some(address) }]);
    let text = events[0].to_string();
    assert!(text.contains("127.0.0.66") && text.contains("127.0.0.5") && text.contains("not believed"), "{text}");
}

#[test]
fn other_ids_at_the_peers_address_are_named_once_and_not_believed() {
    let rig = Rig::new(Some("127.0.0.5"));
    let (autopilot, address) = host(5);
    rig.heartbeat(&autopilot, 1, false);
    for _ in 0..3 {
        rig.heartbeat(&autopilot, 9, true);
    }
    assert!(!rig.armed());
    let events = rig.link.take_peer_events();
    assert_eq!(events, [PeerEvent::Other { from: address, system: 9, component: 1, peer: Some(address) }]);
    assert!(events[0].is_through_the_peer() && events[0].to_string().contains("heard through the autopilot"));
}

#[test]
fn in_flight_another_host_never_takes_a_silent_peers_place() {
    let rig = Rig::new(None);
    let ((autopilot, address), (intruder, _), (again, anew)) = (host(5), host(66), host(5));
    rig.heartbeat(&autopilot, 1, true);
    rig.pass(60.0);
    rig.heartbeat(&intruder, 1, false);
    assert_eq!((rig.peer(), rig.armed()), (Some(address), true));
    rig.heartbeat(&again, 1, true);
    assert_eq!(rig.peer(), Some(anew), "its own host's new port may");
    let events = rig.link.take_peer_events();
    assert_eq!(events.last(), Some(&PeerEvent::Moved { from: address, to: anew }));
}

#[test]
fn on_the_ground_another_host_takes_a_silent_peers_place_and_is_named() {
    let rig = Rig::new(None);
    let ((autopilot, address), (other, elsewhere)) = (host(5), host(7));
    rig.heartbeat(&autopilot, 1, false);
    rig.pass(2.0);
    rig.heartbeat(&other, 1, false);
    assert_eq!(rig.peer(), Some(address), "not silent for long enough");
    rig.pass(2.0);
    rig.heartbeat(&other, 1, false);
    assert_eq!(rig.peer(), Some(elsewhere));
    let events = rig.link.take_peer_events();
    assert_eq!(events.last(), Some(&PeerEvent::Moved { from: address, to: elsewhere }));
}

#[test]
fn a_crowd_of_senders_does_not_flood_the_events() {
    let rig = Rig::new(None);
    let (autopilot, address) = host(5);
    rig.heartbeat(&autopilot, 1, false);
    for last in 10..=250 {
        rig.heartbeat(&host(last).0, 1, true);
    }
    assert_eq!((rig.peer(), rig.armed()), (Some(address), false));
    let events = rig.link.take_peer_events();
    assert_eq!(events.len(), goshawk_autopilot::wire::peers::NAMED + 1);
    assert_eq!(events.last(), Some(&PeerEvent::Crowd));
}
