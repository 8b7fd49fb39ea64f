//! Six seconds of a real PX4's traffic, from the setpoints' beginning over arming into the climb, both directions:
//! parsed without a warning, as datagrams and as a stream of bytes.

#![allow(clippy::unwrap_used)] // a test's helpers too fail by panicking

use goshawk_autopilot::messages::MavMessage;
use goshawk_autopilot::wire::packet::{Packet, for_each_packet, frame_length};
use goshawk_autopilot::{Firmware, View};
use goshawk_core::Time;
use mavlink::Message;
use std::collections::BTreeMap;

const CUT: &[u8] = include_bytes!("data/px4-offboard-takeoff.tlog");
/// As pymavlink counts them, by its dialect `development`; 18 packets of four messages it knows only by their numbers.
const COUNTS: &str = "\
    ALTITUDE 59, ATTITUDE 593, ATTITUDE_QUATERNION 297, ATTITUDE_TARGET 59, BATTERY_STATUS 3, COMMAND_ACK 2, \
    COMMAND_LONG 2, CURRENT_EVENT_SEQUENCE 2, CURRENT_MODE 3, DISTANCE_SENSOR 59, ESTIMATOR_STATUS 6, \
    EVENT 7, EXTENDED_SYS_STATE 30, GLOBAL_POSITION_INT 297, GPS_RAW_INT 47, HEARTBEAT 12, HIGHRES_IMU 297, \
    HOME_POSITION 3, LINK_NODE_STATUS 6, LOCAL_POSITION_NED 178, MISSION_CURRENT 6, ODOMETRY 178, \
    OPEN_DRONE_ID_LOCATION 6, OPEN_DRONE_ID_SYSTEM 6, PING 6, POSITION_TARGET_LOCAL_NED 11, \
    SCALED_PRESSURE 6, SERVO_OUTPUT_RAW 59, SET_ATTITUDE_TARGET 300, SYSTEM_TIME 6, SYS_STATUS 30, \
    TIMESYNC 118, TIME_ESTIMATE_TO_TARGET 3, VFR_HUD 59, VIBRATION 3";

/// Each frame with its stamp, s.
fn frames() -> Vec<(f64, &'static [u8])> {
    let (mut frames, mut rest) = (Vec::new(), CUT);
    while let Some((stamp, tail)) = rest.split_first_chunk::<8>() {
        let (frame, tail) = tail.split_at(frame_length(tail).unwrap());
        frames.push((u64::from_be_bytes(*stamp) as f64 * 1e-6, frame));
        rest = tail;
    }
    frames
}

#[test]
fn every_frame_is_the_packet_that_pymavlink_reads() {
    let mut counts: BTreeMap<&str, u32> = BTreeMap::new();
    for (_, frame) in frames() {
        for_each_packet(frame, |packet| *counts.entry(packet.unwrap().message.message_name()).or_default() += 1);
    }
    let told: Vec<String> = counts.iter().map(|(name, count)| format!("{name} {count}")).collect();
    assert_eq!(told.join(", "), COUNTS);
}

#[test]
fn the_same_bytes_as_one_stream_are_the_same_packets() {
    let packets = |bytes: &[u8]| {
        let mut packets = Vec::new();
        for_each_packet(bytes, |packet| packets.push(format!("{:?}", packet.unwrap())));
        packets
    };
    let each: Vec<String> = frames().iter().flat_map(|(_, frame)| packets(frame)).collect();
    let stream: Vec<u8> = frames().iter().flat_map(|(_, frame)| frame.iter().copied()).collect();
    assert_eq!(packets(&stream), each);
}

#[test]
fn the_view_takes_it_all_without_a_reproach() {
    let mut view = View::new(1, 1, Firmware::Px4);
    let mut seen = Vec::new();
    let begin = frames()[0].0;
    for (stamp, frame) in frames() {
        let now = Time::from_secs(100.0 + stamp - begin);
        for_each_packet(frame, |packet: Result<Packet, _>| {
            let packet = packet.unwrap();
            view.accept(now, &packet);
            assert_eq!(view.status(now).position_fault, None);
            if matches!(packet.message, MavMessage::HEARTBEAT(_)) && view.is_target(&packet) {
                let status = view.status(now);
                seen.push((status.mode.unwrap().to_string(), status.armed));
            }
        });
    }
    let counters = view.status(Time::from_secs(106.0)).counters;
    assert_eq!((counters.garbage, counters.truncated, counters.checksum, counters.unknown), (0, 0, 0, 0));
    assert_eq!((counters.not_finite, counters.odometry_frame, counters.lost), (0, 0, 0));
    assert_eq!(view.status(Time::from_secs(106.0)).problem(), None);
    seen.dedup();
    let modes: Vec<(&str, bool)> = seen.iter().map(|(mode, armed)| (mode.as_str(), *armed)).collect();
    assert_eq!(modes, [("AUTO.LOITER", false), ("OFFBOARD", false), ("OFFBOARD", true)]);
    assert!(view.odometry().unwrap().vel_world.z > 0.1, "it climbs");
}
