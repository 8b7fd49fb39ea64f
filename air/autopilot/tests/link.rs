//! The link's socket: what it refuses, and what it survives.

#![allow(clippy::unwrap_used)] // a test's helpers too fail by panicking

use goshawk_autopilot::messages::{HEARTBEAT_DATA, MavMessage};
use goshawk_autopilot::wire::encode::Encoder;
use goshawk_autopilot::{
    Address, AutopilotError, AutopilotLink, LinkConfig, Peer, SigningConfig, SigningKey, StreamRates,
};
use goshawk_core::{AttitudeThrust, NormalisedThrust, Rot, Time};
use proptest::prelude::*;
use std::collections::HashMap;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

fn anywhere() -> SocketAddr {
    "127.0.0.1:0".parse().unwrap()
}

fn open(config: LinkConfig) -> Result<AutopilotLink, AutopilotError> {
    AutopilotLink::open(config, || Time::from_secs(5.0))
}

fn towards(peer: SocketAddr) -> LinkConfig {
    LinkConfig { address: Address::UdpOut(peer.to_string()), ..LinkConfig::customary(anywhere()) }
}

fn level(thrust: f64) -> AttitudeThrust {
    AttitudeThrust { world_from_body: Rot::identity(), thrust: NormalisedThrust(thrust) }
}

/// Waits for the receiving thread, at most 10 s.
fn eventually(done: impl Fn() -> bool) {
    let patience = Instant::now() + Duration::from_secs(10);
    while !done() {
        assert!(Instant::now() < patience, "it never happened");
        std::thread::yield_now();
    }
}

#[test]
fn a_port_in_use_is_named_with_what_to_do() {
    let first = UdpSocket::bind(anywhere()).unwrap();
    let bind = first.local_addr().unwrap();
    let error = open(LinkConfig::customary(bind)).err().unwrap();
    assert!(matches!(error, AutopilotError::PortInUse(Address::UdpIn(address)) if address == bind));
    assert!(error.to_string().contains("stop it or change `link`"), "{error}");
}

#[test]
fn an_unusable_configuration_is_refused() {
    let good = LinkConfig::customary(anywhere());
    let rates = StreamRates { odometry_hz: f64::NAN, ..StreamRates::default() };
    for config in [LinkConfig { target_component: 0, ..good.clone() }, LinkConfig { rates, ..good }] {
        assert!(matches!(open(config.clone()).err(), Some(AutopilotError::Config(_))), "{config:?}");
    }
}

#[test]
fn a_host_that_nobody_knows_is_named() {
    let address: Address = "udpout:no-such-host.invalid:14580".parse().unwrap();
    let error = open(LinkConfig { address, ..LinkConfig::customary(anywhere()) }).err().unwrap();
    assert!(matches!(error, AutopilotError::Host { .. }) && error.to_string().contains("no-such-host"), "{error}");
}

#[test]
fn without_a_peer_nothing_is_sent_and_the_reason_is_given() {
    let link = open(LinkConfig::customary(anywhere())).unwrap();
    assert!(matches!(link.send_setpoint(&level(0.5)), Err(AutopilotError::NoPeer)));
    assert_eq!(link.status(Time::from_secs(5.0)).counters.sent, 0);
}

#[test]
fn a_setpoint_that_is_no_setpoint_is_not_sent() {
    let listener = UdpSocket::bind(anywhere()).unwrap();
    let link = open(towards(listener.local_addr().unwrap())).unwrap();
    let not_a_rotation = Rot::new_unchecked(nalgebra::Quaternion::new(f64::NAN, 0.0, 0.0, 0.0));
    for setpoint in
        [level(f64::NAN), level(1.01), level(-0.01), AttitudeThrust { world_from_body: not_a_rotation, ..level(0.5) }]
    {
        assert!(matches!(link.send_setpoint(&setpoint), Err(AutopilotError::BadSetpoint)), "{setpoint:?}");
    }
    assert!(link.send_setpoint(&level(0.5)).is_ok());
}

#[test]
fn the_peer_is_learned_from_the_targets_heartbeat_only() {
    let link = open(LinkConfig::customary(anywhere())).unwrap();
    let there = link.local_address().unwrap();
    let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    let other = UdpSocket::bind(anywhere()).unwrap();
    other.send_to(Encoder::new(9, 1).encode(&heartbeat).raw_bytes(), there).unwrap();
    let counters = || link.status(Time::from_secs(5.0)).counters;
    eventually(|| counters().foreign == 1);
    assert_eq!(link.peer(), None);
    let autopilot = UdpSocket::bind(anywhere()).unwrap();
    autopilot.send_to(Encoder::new(1, 1).encode(&heartbeat).raw_bytes(), there).unwrap();
    eventually(|| link.peer() == autopilot.local_addr().ok().map(Peer::Udp));
    assert!(link.status(Time::from_secs(5.0)).connected);
    assert!(!link.status(Time::from_secs(8.5)).connected, "3 s later it is silent");
}

#[test]
fn a_stuck_or_absent_peer_never_blocks_a_setpoint_for_long() {
    // Port 9 of loopback: nobody reads, each send may come back refused; the caller goes on.
    let link = open(towards("127.0.0.1:9".parse().unwrap())).unwrap();
    let mut refused = 0;
    for _ in 0..2000 {
        refused += u64::from(link.send_setpoint(&level(0.5)).is_err());
    }
    let counters = link.status(Time::from_secs(5.0)).counters;
    assert_eq!(counters.send_errors, refused);
    assert!(counters.sent >= 2000 - refused);
}

/// A signed frame's time stamp.
fn stamp_of(frame: &[u8]) -> u64 {
    assert_eq!((frame[0], frame[2]), (0xFD, 1), "signed");
    let stamp = &frame[frame.len() - 12..frame.len() - 6];
    stamp.iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte))
}

#[test]
fn the_stamps_of_each_stream_rise_however_many_threads_send() {
    let listener = UdpSocket::bind(anywhere()).unwrap();
    let signing = Some(SigningConfig { key: SigningKey::new([7; 32]), stamps: None });
    let link = open(LinkConfig { signing, ..towards(listener.local_addr().unwrap()) }).unwrap();
    let done = AtomicBool::new(false);
    let often = |send: &dyn Fn() -> Result<(), AutopilotError>| {
        while !done.load(Ordering::Relaxed) {
            let _ = send(); // what cannot go out is not this test's business
        }
    };
    let (mut frame, mut newest, mut overtaken) = ([0; 300], HashMap::<u8, u64>::new(), 0);
    std::thread::scope(|threads| {
        threads.spawn(|| often(&|| link.send_setpoint(&level(0.5))));
        for _ in 0..2 {
            threads.spawn(|| often(&|| link.request_parameter("COM_RC_LOSS_T")));
        }
        for _ in 0..20_000 {
            let length = listener.recv(&mut frame).unwrap();
            let (link_id, stamp) = (frame[length - 13], stamp_of(&frame[..length]));
            let last = newest.insert(link_id, stamp);
            overtaken += u32::from(last.is_some_and(|last| stamp <= last));
        }
        done.store(true, Ordering::Relaxed);
    });
    assert_eq!(overtaken, 0);
    assert_eq!(newest.len(), 2, "setpoints and all else");
}

#[test]
fn a_signed_link_keeps_its_newest_stamp_beside_the_key() {
    let folder = tempfile::tempdir().unwrap();
    let stamps = folder.path().join("key.stamp");
    let listener = UdpSocket::bind(anywhere()).unwrap();
    let signing = || Some(SigningConfig { key: SigningKey::new([7; 32]), stamps: Some(stamps.clone()) });
    let newest = || std::fs::read_to_string(&stamps).ok()?.trim().parse::<u64>().ok();
    let mut frame = [0; 300];
    let config = LinkConfig { signing: signing(), ..towards(listener.local_addr().unwrap()) };
    let link = open(config.clone()).unwrap();
    let length = listener.recv(&mut frame).unwrap();
    let first = stamp_of(&frame[..length]);
    eventually(|| newest().is_some_and(|saved| saved >= first));
    drop(link);
    // The wall clock went back by years: the next start goes on above all that was used.
    let ahead = newest().unwrap() + 1_000_000_000;
    std::fs::write(&stamps, ahead.to_string()).unwrap();
    let listener = UdpSocket::bind(anywhere()).unwrap();
    let _link = open(LinkConfig { signing: signing(), ..towards(listener.local_addr().unwrap()) }).unwrap();
    let length = listener.recv(&mut frame).unwrap();
    assert!(stamp_of(&frame[..length]) > ahead);
}

#[test]
fn a_disk_that_hangs_as_a_stamp_is_saved_does_not_silence_the_link() {
    let folder = tempfile::tempdir().unwrap();
    let stamps = folder.path().join("key.stamp");
    // Whoever opens a pipe to write waits for somebody who reads.
    let pipe = folder.path().join("key.stamp.new");
    assert!(std::process::Command::new("mkfifo").arg(pipe).status().unwrap().success());
    let listener = UdpSocket::bind(anywhere()).unwrap();
    listener.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    let signing = Some(SigningConfig { key: SigningKey::new([7; 32]), stamps: Some(stamps) });
    let (config, begun) = (LinkConfig { signing, ..towards(listener.local_addr().unwrap()) }, Instant::now());
    let link = AutopilotLink::open(config, move || Time::from_secs(5.0 + begun.elapsed().as_secs_f64())).unwrap();
    for _ in 0..30 {
        listener.recv(&mut [0; 300]).unwrap();
    }
    drop(link);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn any_datagrams_are_survived(datagrams in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..400), 1..20)) {
        let link = open(LinkConfig::customary(anywhere())).unwrap();
        let there = link.local_address().unwrap();
        let sender = UdpSocket::bind(anywhere()).unwrap();
        for datagram in &datagrams {
            sender.send_to(datagram, there).unwrap();
        }
        let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        sender.send_to(Encoder::new(1, 1).encode(&heartbeat).raw_bytes(), there).unwrap();
        eventually(|| link.status(Time::from_secs(5.0)).connected);
    }
}

#[test]
fn a_wrong_target_system_gets_the_advice_that_names_the_right_one() {
    let link = open(LinkConfig { target_system: 9, ..LinkConfig::customary(anywhere()) }).unwrap();
    let px4 = UdpSocket::bind(anywhere()).unwrap();
    let autopilot = goshawk_autopilot::messages::MavAutopilot::MAV_AUTOPILOT_PX4;
    let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA { autopilot, ..HEARTBEAT_DATA::default() });
    px4.send_to(Encoder::new(1, 1).encode(&heartbeat).raw_bytes(), link.local_address().unwrap()).unwrap();
    let advice = || link.status(Time::from_secs(5.0)).problem().unwrap();
    eventually(|| advice().contains("target_system = 1"));
    assert_eq!(link.peer(), None);
}
