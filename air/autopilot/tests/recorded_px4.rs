//! 56 s of a real PX4's traffic through the same parsing as in flight (`tests/data/README.md` tells of the recording).

#![allow(clippy::unwrap_used)] // a test's helpers too fail by panicking

use goshawk_autopilot::dialogue::events::AutopilotEvent;
use goshawk_autopilot::messages::MavMessage;
use goshawk_autopilot::wire::packet::{Packet, for_each_packet, frame_length};
use goshawk_autopilot::{Firmware, Px4Mode, View};
use goshawk_core::{Odometry, Time, Vec3};
use mavlink::Message;
use serde_json::Value;
use std::collections::BTreeMap;

const LOG: &[u8] = include_bytes!("../../../tests/data/px4-sih-offboard.tlog");
const FACTS: &str = include_str!("../../../tests/data/px4-sih-offboard.rates.json");

struct Recording {
    /// Arrival since the first packet, and the packet.
    packets: Vec<(f64, Packet)>,
    facts: Value,
    /// Add to an arrival to get the time base of `facts`.
    offset_s: f64,
}

fn recording() -> Recording {
    let facts: Value = serde_json::from_str(FACTS).unwrap();
    let mut packets = Vec::new();
    let mut rest = LOG;
    let mut start_us = None;
    while !rest.is_empty() {
        // A record: big-endian microseconds, then one frame.
        let (stamp, tail) = rest.split_at(8);
        let stamp_us = u64::from_be_bytes(stamp.try_into().unwrap());
        let start_us = *start_us.get_or_insert(stamp_us);
        let (frame, tail) = tail.split_at(frame_length(tail).expect("a frame follows each stamp"));
        for_each_packet(frame, |packet| {
            let packet = packet.unwrap_or_else(|reject| panic!("{reject:?} in {frame:02x?}"));
            packets.push(((stamp_us - start_us) as f64 * 1e-6, packet));
        });
        rest = tail;
    }
    let acked = packets.iter().find(|(_, packet)| matches!(packet.message, MavMessage::COMMAND_ACK(_))).unwrap().0;
    let noted = event_time(&facts, |event| event[1] == "COMMAND_ACK");
    Recording { packets, facts, offset_s: noted - acked }
}

fn event_time(facts: &Value, matches: impl Fn(&Value) -> bool) -> f64 {
    let events = facts["events"].as_array().unwrap();
    events.iter().find(|event| matches(event)).unwrap()[0].as_f64().unwrap()
}

fn from_px4(packet: &Packet) -> bool {
    packet.header.component_id == 1
}

#[test]
fn every_packet_parses_and_the_counts_are_the_noted_ones() {
    let recording = recording();
    assert_eq!(recording.packets.len(), 25_192);
    let mut received: BTreeMap<&str, u64> = BTreeMap::new();
    let mut sent: BTreeMap<&str, u64> = BTreeMap::new();
    for (_, packet) in &recording.packets {
        let counts = if from_px4(packet) { &mut received } else { &mut sent };
        *counts.entry(packet.message.message_name()).or_default() += 1;
    }
    let noted =
        |key: &str| -> BTreeMap<String, u64> { serde_json::from_value(recording.facts["R"][key].clone()).unwrap() };
    let plain = |counts: BTreeMap<&str, u64>| -> BTreeMap<String, u64> {
        counts.into_iter().map(|(name, count)| (name.to_owned(), count)).collect()
    };
    assert_eq!(plain(received), noted("rx_counts"));
    assert_eq!(plain(sent), noted("tx_counts"));
}

#[test]
fn the_rates_are_the_noted_ones() {
    let recording = recording();
    let (first, last) = (recording.packets[0].0, recording.packets[recording.packets.len() - 1].0);
    let noted = recording.facts["R"]["rx_rates_whole_log"].as_object().unwrap();
    for (name, rate) in noted {
        let count = recording
            .packets
            .iter()
            .filter(|(_, packet)| from_px4(packet) && packet.message.message_name() == name.as_str())
            .count();
        let measured = count as f64 / (last - first);
        let rate = rate.as_f64().unwrap();
        assert!((measured - rate).abs() <= 0.01 * rate + 0.006, "{name}: {measured:.2} is not {rate:.2} Hz");
    }
}

#[test]
fn the_view_lives_through_the_flight_as_noted() {
    let recording = recording();
    let facts = &recording.facts;
    let mut view = View::new(1, 1, Firmware::Px4);
    let mut changes: Vec<(f64, String)> = Vec::new();
    let mut last = String::new();
    for (arrival, packet) in &recording.packets {
        let now = Time::from_secs(100.0 + arrival);
        view.accept(now, packet);
        let status = view.status(now);
        let text = format!(
            "{} {} {}",
            status.mode.map_or_else(|| "?".to_owned(), |mode| mode.to_string()),
            if status.armed { "armed" } else { "disarmed" },
            if status.offboard { "ours" } else { "not ours" }
        );
        if text != last {
            changes.push((arrival + recording.offset_s, text.clone()));
            last = text;
        }
    }
    let named = |name: &str| event_time(facts, |event| event[1] == "EVENT" && event[2] == name);
    let beat = |mode: &str, after: f64| {
        event_time(facts, |event| event[1] == "HEARTBEAT" && event[2] == mode && event[0].as_f64().unwrap() > after)
    };
    let failsafe = named("commander_failsafe_enter_generic");
    let expected = [
        (None, "? disarmed not ours"),
        (None, "AUTO.LOITER disarmed not ours"),
        (Some(beat("OFFBOARD", 0.0)), "OFFBOARD disarmed ours"),
        (Some(named("commander_armed_by")), "OFFBOARD armed ours"),
        (Some(failsafe), "OFFBOARD armed not ours"),
        (Some(beat("POSCTL", 0.0)), "POSCTL armed not ours"),
        (Some(beat("OFFBOARD", failsafe)), "OFFBOARD armed ours"),
        (Some(named("commander_disarmed_by")), "OFFBOARD disarmed ours"),
    ];
    let texts: Vec<&str> = changes.iter().map(|(_, text)| text.as_str()).collect();
    assert_eq!(texts, expected.map(|(_, text)| text));
    for ((when, text), (noted, _)) in changes.iter().zip(expected) {
        if let Some(noted) = noted {
            assert!((when - noted).abs() < 0.005, "{text}: at {when:.3}, noted {noted:.3}");
        }
    }
    let counters = view.status(Time::from_secs(160.0)).counters;
    assert_eq!((counters.lost, counters.not_finite, counters.odometry_frame), (0, 0, 0));
    assert_eq!(counters.received + counters.foreign, 25_192);
}

#[test]
fn takeoff_and_landing_are_seen_when_they_were_noted() {
    let recording = recording();
    let mut view = View::new(1, 1, Firmware::Px4);
    let mut seen: Vec<(f64, Option<bool>)> = Vec::new();
    for (arrival, packet) in &recording.packets {
        let now = Time::from_secs(100.0 + arrival);
        view.accept(now, packet);
        let landed = view.status(now).landed;
        if seen.last().is_none_or(|(_, last)| *last != landed) {
            seen.push((arrival + recording.offset_s, landed));
        }
    }
    assert_eq!(seen.iter().map(|(_, landed)| *landed).collect::<Vec<_>>(), [None, Some(true), Some(false), Some(true)]);
    for (name, index) in [("commander_takeoff_detected", 2), ("commander_landing_detected", 3)] {
        let noted = event_time(&recording.facts, |event| event[1] == "EVENT" && event[2] == name);
        assert!((seen[index].0 - noted).abs() < 0.005, "{name}: {:.3} is not {noted:.3}", seen[index].0);
    }
    let events: Vec<AutopilotEvent> = view.take_events().into_iter().map(|(_, event)| event).collect();
    assert!(events.contains(&AutopilotEvent::NoOffboardSignal), "{events:?}");
}

#[test]
fn a_recorded_flight_with_gps_never_lacks_a_position_nor_a_reason_to_arm() {
    let recording = recording();
    let mut view = View::new(1, 1, Firmware::Px4);
    for (arrival, packet) in &recording.packets {
        let now = Time::from_secs(100.0 + arrival);
        view.accept(now, packet);
        let status = view.status(now);
        assert_ne!(status.position, Some(false), "{:?} at {arrival:.2}", status.position_fault);
        assert_ne!(status.would_arm, Some(false), "{:?} at {arrival:.2}", view.refusal(now));
        assert_eq!(status.counters.restarts, 0);
    }
    assert_eq!(view.status(Time::from_secs(156.0)).position, Some(true));
}

#[test]
fn the_recorded_odometry_is_consistent_in_our_frames() {
    let recording = recording();
    let mut view = View::new(1, 1, Firmware::Px4);
    let mut all: Vec<(f64, Odometry)> = Vec::new();
    let mut up_force = Vec::new();
    for (arrival, packet) in &recording.packets {
        let now = Time::from_secs(100.0 + arrival);
        view.accept(now, packet);
        match packet.message {
            MavMessage::ODOMETRY(_) => all.push((100.0 + arrival, view.odometry().unwrap())),
            MavMessage::HIGHRES_IMU(_) if view.odometry().is_some() => {
                up_force.push((view.odometry().unwrap().world_from_body * view.imu().unwrap().specific_force_body).z);
            }
            _ => {}
        }
    }
    assert_eq!(all.len(), 1651);
    // It flew: up, in ENU.
    let highest = all.iter().map(|(_, odometry)| odometry.pos_world.z).fold(f64::MIN, f64::max);
    assert!(highest > 2.0, "{highest}");
    // On average the rotors carry the weight, upwards.
    let mean_up = up_force.iter().sum::<f64>() / up_force.len() as f64;
    assert!((mean_up - 9.8).abs() < 0.15, "{mean_up}");
    // Position's slope is the velocity, along each axis, except where the estimator jumped.
    let mut error = Vec3::zeros();
    let mut count = 0.0;
    for pair in all.windows(2) {
        let ((_, a), (_, b)) = (&pair[0], &pair[1]);
        let dt = b.stamp.since(a.stamp);
        if a.reset_counter == b.reset_counter && dt > 0.01 {
            let slope = (b.pos_world - a.pos_world) / dt;
            error +=
                (slope - (a.vel_world + b.vel_world) / 2.0).component_mul(&(slope - (a.vel_world + b.vel_world) / 2.0));
            count += 1.0;
        }
    }
    let rms = (error / count).map(f64::sqrt);
    assert!(rms.max() < 0.3, "slope against velocity, m/s: {rms:?}");
    // Nobody asked this PX4 for its clock, so stamps come from the fastest arrival. Never ahead; behind by what its
    // simulated clock loses in stalls of up to 0.1 s (1.8 % over the flight, 1 s at its end if it were not followed).
    let mut ages: Vec<f64> = all.iter().map(|(arrival, odometry)| arrival - odometry.stamp.0 as f64 * 1e-9).collect();
    ages.sort_by(f64::total_cmp);
    let (median, late) = (ages[ages.len() / 2], ages[ages.len() * 99 / 100]);
    println!(
        "age of odometry: median {:.1} ms, p99 {:.1} ms; slope against velocity {rms:?} m/s",
        median * 1e3,
        late * 1e3
    );
    assert!(ages[0] > -1e-6 && late < 0.1, "{} {late}", ages[0]);
    let resets: Vec<u32> =
        all.windows(2).filter(|w| w[0].1.reset_counter != w[1].1.reset_counter).map(|w| w[1].1.reset_counter).collect();
    assert_eq!(resets, [16], "the estimator was reset once in this flight");
}

#[test]
fn modes_of_the_recording_are_known() {
    let recording = recording();
    let told = recording.packets.iter().filter(|(_, packet)| from_px4(packet)).filter_map(|(_, packet)| {
        let MavMessage::CURRENT_MODE(mode) = &packet.message else { return None };
        Some(Px4Mode::from_custom_mode(mode.custom_mode))
    });
    let told: Vec<Px4Mode> = told.collect();
    assert!(told.len() > 20, "{}", told.len());
    assert!(told.iter().all(|mode| !matches!(mode, Px4Mode::Other(_))), "{told:?}");
}
