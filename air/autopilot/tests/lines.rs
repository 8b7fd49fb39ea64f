//! Serial ports and TCP, with real ones: a pseudo-terminal's two ends and the loopback's sockets.

#![allow(clippy::unwrap_used)] // a test's helpers too fail by panicking

use goshawk_autopilot::messages::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavType};
use goshawk_autopilot::wire::encode::Encoder;
use goshawk_autopilot::wire::packet::{Packet, for_each_packet};
use goshawk_autopilot::{Address, AutopilotError, AutopilotLink, LinkConfig, Peer};
use goshawk_core::{AttitudeThrust, NormalisedThrust, Rot, Time};
use rustix::fs::OFlags;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::tcgetattr;
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

fn open(address: &str) -> Result<AutopilotLink, AutopilotError> {
    let begun = Instant::now();
    let clock = move || Time::from_secs(100.0 + begun.elapsed().as_secs_f64());
    let address: Address = address.parse().unwrap();
    AutopilotLink::open(LinkConfig { address, ..LinkConfig::customary("127.0.0.1:0".parse().unwrap()) }, clock)
}

/// As [`open`], by a clock that another hand moves.
fn open_at(address: &str, clock: &Arc<AtomicU64>) -> AutopilotLink {
    let (address, clock): (Address, _) = (address.parse().unwrap(), Arc::clone(clock));
    let config = LinkConfig { address, ..LinkConfig::customary("127.0.0.1:0".parse().unwrap()) };
    AutopilotLink::open(config, move || Time(clock.load(Ordering::SeqCst))).unwrap()
}

fn connected(link: &AutopilotLink) -> bool {
    // The link's clock began at 100 s; a heartbeat that was heard is younger than any 3 s from its own stamp.
    link.status(Time::from_secs(100.0)).heartbeat_age_s.is_some()
}

fn received(link: &AutopilotLink) -> u64 {
    link.status(Time::from_secs(100.0)).counters.received
}

/// Waits for another thread, at most 20 s.
fn eventually(mut done: impl FnMut() -> bool) {
    let patience = Instant::now() + Duration::from_secs(20);
    while !done() {
        assert!(Instant::now() < patience, "it never happened");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn heartbeat(encoder: &Encoder) -> Vec<u8> {
    let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        ..HEARTBEAT_DATA::default()
    });
    encoder.encode(&message).raw_bytes().to_vec()
}

fn level() -> AttitudeThrust {
    AttitudeThrust { world_from_body: Rot::identity(), thrust: NormalisedThrust(0.5) }
}

/// Reads from `port` until a packet is `wanted`; every byte must belong to a good packet.
fn until_packet(port: &mut impl Read, wanted: impl Fn(&MavMessage) -> bool) {
    let mut held = Vec::new();
    let mut found = false;
    eventually(|| {
        let mut buffer = [0; 512];
        match port.read(&mut buffer) {
            Ok(length) => held.extend_from_slice(&buffer[..length]),
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Err(error) => panic!("{error}"),
        }
        for_each_packet(&held, |packet| found |= packet.is_ok_and(|Packet { message, .. }| wanted(&message)));
        found
    });
}

/// An autopilot's end of a serial cable whose other end is the device at `device`.
fn plug_in(device: &Path) -> File {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    rustix::fs::fcntl_setfl(&master, OFlags::NONBLOCK).unwrap();
    let slave = ptsname(&master, Vec::new()).unwrap();
    let _ = std::fs::remove_file(device);
    symlink(slave.to_str().unwrap(), device).unwrap();
    File::from(master)
}

#[test]
fn a_serial_port_carries_packets_both_ways_at_the_asked_speed() {
    let folder = tempfile::tempdir().unwrap();
    let device = folder.path().join("ttyACM0");
    let mut autopilot = plug_in(&device);
    let link = open(&format!("serial:{}:921600", device.display())).unwrap();
    eventually(|| link.line_problem().is_none());
    assert_eq!(tcgetattr(&autopilot).unwrap().output_speed(), 921_600);
    let encoder = Encoder::new(1, 1);
    // Byte by byte, with noise before: what a serial line does.
    for byte in [&b"boot: \xFD\x0Anoise\r\n"[..], &heartbeat(&encoder), &heartbeat(&encoder)].concat() {
        autopilot.write_all(&[byte]).unwrap();
    }
    eventually(|| received(&link) == 2);
    assert_eq!(link.peer(), Some(Peer::Line));
    eventually(|| link.send_setpoint(&level()).is_ok()); // it waits for no other thread
    until_packet(&mut autopilot, |message| matches!(message, MavMessage::SET_ATTITUDE_TARGET(_)));
}

#[test]
fn a_serial_port_that_is_unplugged_is_told_and_found_again() {
    let folder = tempfile::tempdir().unwrap();
    let device = folder.path().join("ttyACM0");
    let address = format!("serial:{}:115200", device.display());
    let link = open(&address).unwrap();
    eventually(|| link.line_problem().is_some_and(|why| why.contains("No such file")));
    assert!(matches!(link.send_setpoint(&level()), Err(AutopilotError::NoPeer)));
    let mut sent = 0;
    for plugged in 1..=3 {
        let mut autopilot = plug_in(&device);
        eventually(|| link.line_problem().is_none() && link.peer() == Some(Peer::Line));
        autopilot.write_all(&heartbeat(&Encoder::new(1, 1))).unwrap();
        eventually(|| received(&link) == plugged);
        eventually(|| link.send_setpoint(&level()).is_ok());
        sent += 1;
        until_packet(&mut autopilot, |message| matches!(message, MavMessage::COMMAND_LONG(_)));
        drop(autopilot);
        std::fs::remove_file(&device).unwrap();
        eventually(|| link.peer().is_none() && link.line_problem().is_some_and(|why| why.contains(&address)));
    }
    assert!(connected(&link) && sent == 3);
}

#[test]
fn what_is_no_serial_port_is_called_so() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("notes.txt");
    std::fs::write(&file, "no port").unwrap();
    let link = open(&format!("serial:{}:115200", file.display())).unwrap();
    eventually(|| link.line_problem().is_some_and(|why| why.contains("it is no serial port")));
}

#[test]
fn a_line_that_nobody_reads_never_holds_a_setpoint_up() {
    let folder = tempfile::tempdir().unwrap();
    let device = folder.path().join("ttyACM0");
    let mut autopilot = plug_in(&device);
    let link = open(&format!("serial:{}:115200", device.display())).unwrap();
    eventually(|| link.line_problem().is_none() && link.peer().is_some());
    eventually(|| link.send_setpoint(&level()).is_ok()); // the other thread may hold the line for a moment
    let refused = (0..4000).filter(|_| link.send_setpoint(&level()).is_err()).count();
    assert!(refused > 1000, "a full line refuses: {refused}");
    // Now it reads: what went out are whole packets, and the next ones go out again.
    until_packet(&mut autopilot, |message| matches!(message, MavMessage::SET_ATTITUDE_TARGET(_)));
    eventually(|| link.send_setpoint(&level()).is_ok());
}

#[test]
fn a_tcp_connection_cut_in_the_middle_of_a_packet_is_made_anew() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = open(&format!("tcpout:{}", server.local_addr().unwrap())).unwrap();
    let encoder = Encoder::new(1, 1);
    let (mut first, _) = server.accept().unwrap();
    let whole = heartbeat(&encoder);
    first.write_all(&whole).unwrap();
    first.write_all(&whole[..11]).unwrap();
    eventually(|| received(&link) == 1);
    until_packet(&mut first, |message| matches!(message, MavMessage::COMMAND_LONG(_)));
    drop(first);
    let (mut second, _) = server.accept().unwrap();
    // The rest of the old packet is not waited for: the first bytes of the new connection begin a packet.
    second.write_all(&heartbeat(&encoder)).unwrap();
    eventually(|| received(&link) == 2);
    assert_eq!(link.status(Time::from_secs(100.0)).counters.checksum, 0);
    // Another connection may be another port of the autopilot: it is asked for its streams again.
    until_packet(&mut second, |message| matches!(message, MavMessage::COMMAND_LONG(_)));
    eventually(|| link.send_setpoint(&level()).is_ok()); // it waits for no other thread
    until_packet(&mut second, |message| matches!(message, MavMessage::SET_ATTITUDE_TARGET(_)));
}

#[test]
fn a_tcp_peer_that_is_not_there_yet_is_called_until_it_is() {
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let link = open(&format!("tcpout:{address}")).unwrap();
    eventually(|| link.line_problem().is_some_and(|why| why.contains("refused") && why.contains("tcpout:")));
    let server = TcpListener::bind(address).unwrap();
    let (mut stream, _) = server.accept().unwrap();
    stream.write_all(&heartbeat(&Encoder::new(1, 1))).unwrap();
    eventually(|| connected(&link) && link.line_problem().is_none());
}

#[test]
fn a_tcp_connection_that_falls_silent_is_made_anew() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let clock = Arc::new(AtomicU64::new(Time::from_secs(100.0).0));
    let link = open_at(&format!("tcpout:{}", server.local_addr().unwrap()), &clock);
    let (mut first, _) = server.accept().unwrap();
    first.write_all(&heartbeat(&Encoder::new(1, 1))).unwrap();
    eventually(|| received(&link) == 1);
    // As behind a pulled cable: no end of the connection is ever told.
    clock.store(Time::from_secs(105.5).0, Ordering::SeqCst);
    eventually(|| link.line_problem().is_some_and(|why| why.contains("nothing came for 5 s")));
    clock.store(Time::from_secs(108.0).0, Ordering::SeqCst);
    let (mut second, _) = server.accept().unwrap();
    second.write_all(&heartbeat(&Encoder::new(1, 1))).unwrap();
    eventually(|| received(&link) == 2 && link.line_problem().is_none());
}

#[test]
fn one_tcp_caller_at_a_time_is_the_autopilot() {
    let link = open("tcpin:127.0.0.1:0").unwrap();
    let there = link.local_address().unwrap();
    eventually(|| link.line_problem().is_some_and(|why| why.contains("nobody has called")));
    let mut first = TcpStream::connect(there).unwrap();
    first.write_all(&heartbeat(&Encoder::new(1, 1))).unwrap();
    eventually(|| received(&link) == 1);
    let mut second = TcpStream::connect(there).unwrap();
    second.write_all(&heartbeat(&Encoder::new(1, 1))).unwrap();
    first.write_all(&heartbeat(&Encoder::new(1, 1))).unwrap();
    eventually(|| received(&link) == 2);
    drop(first);
    eventually(|| received(&link) == 3); // the one that waited
    until_packet(&mut second, |message| matches!(message, MavMessage::HEARTBEAT(_)));
}

#[test]
fn a_tcp_port_in_use_is_named() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcpin:{}", taken.local_addr().unwrap());
    let error = open(&address).err().unwrap();
    assert!(matches!(error, AutopilotError::PortInUse(_)) && error.to_string().contains(&address), "{error}");
}

#[test]
fn any_bytes_on_a_line_are_survived() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = open(&format!("tcpout:{}", server.local_addr().unwrap())).unwrap();
    let (mut stream, _) = server.accept().unwrap();
    let mut noise = 1_u32;
    let bytes: Vec<u8> = std::iter::repeat_with(|| {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        // Many frame starts, so that lengths are read from noise too.
        if noise.is_multiple_of(7) { 0xFD } else { (noise >> 24) as u8 }
    })
    .take(200_000)
    .collect();
    stream.write_all(&bytes).unwrap();
    // A frame start in the noise may wait for 280 bytes; then it is found out.
    let encoder = Encoder::new(1, 1);
    eventually(|| {
        stream.write_all(&heartbeat(&encoder)).unwrap();
        connected(&link)
    });
}
