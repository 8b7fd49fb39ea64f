//! ODOMETRY against LOCAL_POSITION_NED in the bytes of a real PX4: they agree, and what is falsified does not.

#![allow(clippy::unwrap_used)] // a test's helpers too fail by panicking

use goshawk_autopilot::messages::{MavMessage, ODOMETRY_DATA};
use goshawk_autopilot::wire::encode::Encoder;
use goshawk_autopilot::wire::packet::{for_each_packet, frame_length};
use goshawk_autopilot::{Firmware, PositionFault, View};
use goshawk_core::Time;

/// Six seconds: arming and the climb.
const CUT: &[u8] = include_bytes!("data/px4-offboard-takeoff.tlog");
/// From so long on it is falsified, s.
const FROM: f64 = 2.0;

/// Plays the recording, its ODOMETRY and LOCAL_POSITION_NED changed by `change`, which is told the time, and encoded
/// anew. What the position lacked, and after how many seconds of falsehood; and what it lacks at the end.
fn play(change: impl Fn(f64, &mut MavMessage) -> bool) -> (Option<(PositionFault, f64)>, Option<PositionFault>) {
    let (mut view, encoder, mut rest) = (View::new(1, 1, Firmware::Px4), Encoder::new(1, 1), CUT);
    let (mut begin, mut first, mut end) = (None, None, Time::from_secs(100.0));
    while let Some((stamp, tail)) = rest.split_first_chunk::<8>() {
        let (frame, tail) = tail.split_at(frame_length(tail).unwrap());
        rest = tail;
        let stamp_s = u64::from_be_bytes(*stamp) as f64 * 1e-6;
        let at = stamp_s - *begin.get_or_insert(stamp_s);
        let mut bytes = frame.to_vec();
        let mut kept = true;
        for_each_packet(frame, |packet| {
            let packet = packet.unwrap();
            let mut message = packet.message.clone();
            kept = !view.is_target(&packet) || change(at, &mut message);
            if kept && message != packet.message {
                bytes = encoder.encode(&message).raw_bytes().to_vec();
            }
        });
        end = Time::from_secs(100.0 + at);
        if kept {
            for_each_packet(&bytes, |packet| {
                view.accept(end, &packet.unwrap());
            });
        }
        first = first.or(view.status(end).position_fault.map(|fault| (fault, at - FROM)));
    }
    (first, view.status(end).position_fault)
}

/// ODOMETRY, falsified from [`FROM`] on; its argument is for how long already, s.
fn odometry(falsify: impl Fn(f64, &mut ODOMETRY_DATA)) -> impl Fn(f64, &mut MavMessage) -> bool {
    move |at, message| {
        if let (MavMessage::ODOMETRY(odometry), true) = (message, at >= FROM) {
            falsify(at - FROM, odometry);
        }
        true
    }
}

#[test]
fn what_a_real_px4_says_twice_is_one_motion() {
    assert_eq!(play(|_, _| true), (None, None));
}

#[test]
fn a_velocity_3_mps_off_in_any_direction_is_named_within_a_second() {
    type Change = fn(&mut ODOMETRY_DATA);
    let changes: [Change; 4] = [|o| o.vx += 3.0, |o| o.vy -= 3.0, |o| o.vz += 3.0, |o| o.vz -= 3.0];
    for change in changes {
        let (first, last) = play(odometry(|_, o| change(o)));
        let (fault, after) = first.unwrap();
        // The accelerometer is the first to tell of a step, and the local position tells of it for good.
        assert!(fault == PositionFault::Unfelt && after < 0.1, "{fault} after {after} s");
        assert_eq!(last, Some(PositionFault::Contradiction));
    }
}

#[test]
fn a_drift_of_1_mps_is_named_within_two_seconds_whichever_of_the_two_drifts() {
    let (first, _) = play(odometry(|since, o| o.x += since as f32));
    assert!(first.is_some_and(|(fault, after)| fault == PositionFault::Contradiction && after < 2.0), "{first:?}");
    let (first, _) = play(|at, message| {
        if let MavMessage::LOCAL_POSITION_NED(local) = message {
            local.y += (at - FROM).max(0.0) as f32;
        }
        true
    });
    assert!(first.is_some_and(|(fault, after)| fault == PositionFault::Contradiction && after < 2.0), "{first:?}");
}

#[test]
fn another_origin_and_a_jump_are_no_contradiction() {
    let elsewhere = |at: f64, message: &mut MavMessage| {
        if let MavMessage::LOCAL_POSITION_NED(local) = message {
            (local.x, local.y, local.z) = (local.x + 300.0, local.y - 80.0, local.z + 20.0);
            local.x += if at >= FROM { 5.0 } else { 0.0 };
        }
        true
    };
    assert_eq!(play(elsewhere), (None, None));
    assert_eq!(play(odometry(|_, o| o.y += 5.0)), (None, None), "the controller names and bears it");
}

#[test]
fn one_of_them_alone_is_no_contradiction() {
    let falsified = odometry(|since, o| o.x += since as f32);
    let alone = |at: f64, message: &mut MavMessage| {
        falsified(at, message) && !matches!(message, MavMessage::LOCAL_POSITION_NED(_))
    };
    assert_eq!(play(alone), (None, None));
    let without = |_: f64, message: &mut MavMessage| !matches!(message, MavMessage::ODOMETRY(_));
    assert_eq!(play(without), (None, None));
}

#[test]
fn a_velocity_that_was_not_felt_is_named_without_a_local_position() {
    let falsified = odometry(|since, o| o.vy += 4.0 * (since as f32).min(1.0));
    let alone = |at: f64, message: &mut MavMessage| {
        falsified(at, message) && !matches!(message, MavMessage::LOCAL_POSITION_NED(_))
    };
    let (first, _) = play(alone);
    assert!(first.is_some_and(|(fault, after)| fault == PositionFault::Unfelt && after < 1.0), "{first:?}");
}

#[test]
fn a_local_position_at_a_third_of_the_rate_shows_it_as_well() {
    let falsified = odometry(|since, o| o.vy += 2.5 * (0.6 * since as f32).min(1.0));
    let count = std::cell::Cell::new(0_u32);
    let (first, _) = play(|at, message| {
        let local = matches!(message, MavMessage::LOCAL_POSITION_NED(_));
        count.set(count.get() + u32::from(local));
        falsified(at, message) && (!local || count.get().is_multiple_of(3))
    });
    assert!(first.is_some_and(|(fault, after)| fault == PositionFault::Contradiction && after < 2.0), "{first:?}");
}
