//! What the stand-in says and when, against what the real one was measured to say.

use super::bench::{Bench, arm, command, flying, offboard};
use super::{OdometryFault, Px4Config, VehicleState};
use goshawk_autopilot::messages::*;
use goshawk_core::Vec3;
use mavlink::{Message, MessageData};
use std::collections::BTreeMap;

fn count(bench: &Bench) -> BTreeMap<&'static str, usize> {
    let mut counts = BTreeMap::new();
    for (_, message) in &bench.heard {
        *counts.entry(message.message_name()).or_default() += 1;
    }
    counts
}

#[test]
fn unasked_streams_come_at_the_measured_rates() {
    let mut bench = Bench::new(Px4Config::default());
    bench.run(20.0);
    let counts = count(&bench);
    for (name, hz) in [
        ("ATTITUDE", 100.0),
        ("ATTITUDE_QUATERNION", 50.0),
        ("HIGHRES_IMU", 50.0),
        ("LOCAL_POSITION_NED", 30.0),
        ("ODOMETRY", 30.0),
        ("TIMESYNC", 10.0),
        ("ATTITUDE_TARGET", 10.0),
        ("SYS_STATUS", 5.0),
        ("EXTENDED_SYS_STATE", 5.0),
        ("HEARTBEAT", 1.0),
        ("BATTERY_STATUS", 0.5),
        ("CURRENT_MODE", 0.5),
    ] {
        let expected = hz * 20.0;
        assert!((counts[name] as f64 - expected).abs() <= 1.0, "{name}: {} in 20 s", counts[name]);
    }
}

#[test]
fn a_stream_is_raised_switched_off_and_reset_on_request() {
    let mut bench = Bench::new(Px4Config::default());
    let interval = |us: f32| command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [ODOMETRY_DATA::ID as f32, us, 0.0], 1);
    for (us, expected) in [(8_000.0, 125), (-1.0, 0), (0.0, 30)] {
        assert_eq!(bench.ask(interval(us)), Some(MavResult::MAV_RESULT_ACCEPTED));
        bench.heard.clear();
        bench.run(1.0);
        let counted = count(&bench).get("ODOMETRY").copied().unwrap_or(0);
        assert!(counted.abs_diff(expected) <= 1, "{us}: {counted}");
    }
    let unknown = command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [12_345.0, 8_000.0, 0.0], 1);
    assert_eq!(bench.ask(unknown), Some(MavResult::MAV_RESULT_FAILED));
}

#[test]
fn acks_take_1_to_15_ms_and_name_who_asked() {
    let mut bench = Bench::new(Px4Config::default());
    for _ in 0..10 {
        bench.heard.clear();
        let asked = bench.seconds();
        bench.step(Some(offboard()));
        bench.run(0.1);
        let acks: Vec<_> = bench
            .heard
            .iter()
            .filter_map(|(stamp, message)| match message {
                MavMessage::COMMAND_ACK(ack) => Some((stamp - asked, ack.target_system, ack.target_component)),
                _ => None,
            })
            .collect();
        assert_eq!(acks.len(), 1);
        assert!((0.0005..0.0165).contains(&acks[0].0), "{acks:?}");
        assert_eq!((acks[0].1, acks[0].2), (1, 191));
    }
}

#[test]
fn odometry_names_ned_for_both_frames_and_stamps_are_since_boot() {
    let mut bench = Bench::new(Px4Config::default());
    bench.vehicle = VehicleState {
        pos_world: Vec3::new(1.0, 2.0, 3.0),
        vel_world: Vec3::new(4.0, 5.0, 6.0),
        reset_counter: 9,
        ..flying()
    };
    bench.run(1.0);
    let (stamp, last) = bench.heard.iter().rfind(|(_, message)| matches!(message, MavMessage::ODOMETRY(_))).unwrap();
    let MavMessage::ODOMETRY(odometry) = last else { unreachable!() };
    assert_eq!((odometry.frame_id as u8, odometry.child_frame_id as u8), (1, 1));
    assert_eq!([odometry.x, odometry.y, odometry.z], [2.0, 1.0, -3.0]);
    assert_eq!([odometry.vx, odometry.vy, odometry.vz], [5.0, 4.0, -6.0]);
    assert_eq!(odometry.reset_counter, 9);
    assert!((odometry.time_usec as f64 * 1e-6 - stamp).abs() < 1e-3);
}

#[test]
fn timesync_is_answered_in_boot_nanoseconds() {
    let mut bench = Bench::new(Px4Config::default());
    bench.run(2.0);
    bench.heard.clear();
    bench.step(Some(MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: 77, ..TIMESYNC_DATA::default() })));
    let answers: Vec<_> = bench
        .heard
        .iter()
        .filter_map(|(_, message)| match message {
            MavMessage::TIMESYNC(sync) if sync.ts1 == 77 => Some(sync.tc1),
            _ => None,
        })
        .collect();
    assert_eq!(answers.len(), 1);
    assert!((answers[0] as f64 * 1e-9 - 2.0).abs() < 0.002, "{answers:?}");
}

#[test]
fn texts_come_only_to_a_ground_station() {
    let mut bench = Bench::new(Px4Config::default());
    assert_eq!(bench.ask(offboard()), Some(MavResult::MAV_RESULT_ACCEPTED));
    let texts = |bench: &Bench| count(bench).get("STATUSTEXT").copied().unwrap_or(0);
    let heartbeat = |mavtype| MavMessage::HEARTBEAT(HEARTBEAT_DATA { mavtype, ..HEARTBEAT_DATA::default() });
    bench.step(Some(heartbeat(MavType::MAV_TYPE_ONBOARD_CONTROLLER)));
    bench.ask(arm());
    assert_eq!(texts(&bench), 0);
    bench.step(Some(heartbeat(MavType::MAV_TYPE_GCS)));
    bench.ask(arm());
    assert_eq!(texts(&bench), 1);
}

#[test]
fn the_battery_is_reported_as_the_vehicle_has_it() {
    let mut bench = Bench::new(Px4Config::default());
    bench.vehicle.battery_fraction = 0.42;
    bench.run(1.0);
    let told = bench.heard.iter().find_map(|(_, message)| match message {
        MavMessage::SYS_STATUS(status) => Some((status.battery_remaining, status.voltage_battery)),
        _ => None,
    });
    let (percent, millivolts) = told.unwrap();
    assert_eq!(percent, 42);
    assert!((14_000..16_800).contains(&millivolts));
}

#[test]
fn a_faulty_estimator_is_silent_or_not_a_number() {
    let mut bench = Bench::new(Px4Config::default());
    bench.px4.set_odometry_fault(Some(OdometryFault::Silent));
    bench.run(1.0);
    assert_eq!(count(&bench).get("ODOMETRY"), None);
    bench.px4.set_odometry_fault(Some(OdometryFault::NotFinite));
    bench.run(1.0);
    let told = bench.heard.iter().find_map(|(_, message)| match message {
        MavMessage::ODOMETRY(odometry) => Some(odometry.x.is_nan()),
        _ => None,
    });
    assert_eq!(told, Some(true));
}
