use super::*;
use crate::dialogue::mode::Px4Mode;
use crate::messages::{
    ATTITUDE_QUATERNION_DATA, EVENT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavFrame, ODOMETRY_DATA,
    SYS_STATUS_DATA,
};
use mavlink::MavHeader;

fn packet(message: MavMessage) -> Packet {
    Packet { header: MavHeader { system_id: 1, component_id: 1, sequence: 0 }, message }
}

fn heartbeat(mode: Px4Mode, armed: bool) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: mode.custom_mode(),
        base_mode: if armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() },
        system_status: MavState::MAV_STATE_ACTIVE,
        ..HEARTBEAT_DATA::default()
    })
}

fn at(seconds: f64) -> Time {
    Time::from_secs(seconds)
}

#[test]
fn connected_is_a_function_of_the_heartbeats_age() {
    let mut view = View::new(1, 1, Firmware::Px4);
    assert!(!view.status(at(1.0)).connected);
    assert!(view.accept(at(1.0), &packet(heartbeat(Px4Mode::Hold, false))).greet);
    assert!(view.status(at(3.9)).connected);
    assert!(!view.status(at(4.0)).connected);
    assert!(!view.accept(at(3.0), &packet(heartbeat(Px4Mode::Hold, false))).greet, "still in contact");
    assert!(view.accept(at(7.0), &packet(heartbeat(Px4Mode::Hold, false))).greet, "contact again");
}

#[test]
fn other_systems_are_counted_and_change_nothing() {
    let mut view = View::new(1, 1, Firmware::Px4);
    for (system_id, component_id) in [(2, 1), (1, 2), (255, 190)] {
        let header = MavHeader { system_id, component_id, sequence: 0 };
        view.accept(at(1.0), &Packet { header, message: heartbeat(Px4Mode::Offboard, true) });
    }
    let status = view.status(at(1.0));
    assert_eq!(status.counters.foreign, 3);
    assert_eq!((status.connected, status.armed, status.mode), (false, false, None));
}

#[test]
fn lost_packets_are_counted_by_their_sequence() {
    let mut view = View::new(1, 1, Firmware::Px4);
    for sequence in [253, 254, 1, 0, 2] {
        let header = MavHeader { system_id: 1, component_id: 1, sequence };
        view.accept(at(1.0), &Packet { header, message: heartbeat(Px4Mode::Hold, false) });
    }
    // 255 and 0 are missing at 1; the 0 that then comes late is not counted back; after it, 1 seems missing at 2.
    assert_eq!(view.status(at(1.0)).counters.lost, 3);
}

#[test]
fn a_failsafe_is_not_a_pilots_choice() {
    let mut view = View::new(1, 1, Firmware::Px4);
    let mode = |custom: Px4Mode, intended: Px4Mode| {
        packet(MavMessage::CURRENT_MODE(CURRENT_MODE_DATA {
            custom_mode: custom.custom_mode(),
            intended_custom_mode: intended.custom_mode(),
            ..CURRENT_MODE_DATA::default()
        }))
    };
    view.accept(at(1.0), &mode(Px4Mode::Offboard, Px4Mode::Offboard));
    assert!(view.status(at(1.0)).offboard && !view.status(at(1.0)).failsafe);
    view.accept(at(2.0), &mode(Px4Mode::Land, Px4Mode::Offboard));
    assert!(!view.status(at(2.0)).offboard && view.status(at(2.0)).failsafe);
    view.accept(at(3.0), &mode(Px4Mode::Position, Px4Mode::Position));
    assert!(!view.status(at(3.0)).offboard && !view.status(at(3.0)).failsafe);
}

#[test]
fn events_tell_at_once_what_the_heartbeat_tells_late() {
    let mut view = View::new(1, 1, Firmware::Px4);
    view.accept(at(1.0), &packet(heartbeat(Px4Mode::Offboard, false)));
    let failsafe = |sequence: u16, action: u8| {
        let mut arguments = [0; 40];
        arguments[4] = action;
        let id = AutopilotEvent::FailsafeEntered.id();
        packet(MavMessage::EVENT(EVENT_DATA { id, sequence, arguments, ..EVENT_DATA::default() }))
    };
    view.accept(at(1.1), &event(1, AutopilotEvent::Armed));
    view.accept(at(1.2), &event(2, AutopilotEvent::TakeoffDetected));
    let status = view.status(at(1.2));
    assert_eq!((status.armed, status.landed, status.offboard), (true, Some(false), true));
    view.accept(at(1.25), &failsafe(3, 1));
    assert!(!view.status(at(1.25)).failsafe && view.status(at(1.25)).offboard, "a warning takes nothing away");
    view.accept(at(1.3), &failsafe(4, 2));
    assert!(view.status(at(1.3)).failsafe && !view.status(at(1.3)).offboard);
    view.accept(at(1.4), &event(5, AutopilotEvent::LandingDetected));
    view.accept(at(1.5), &event(6, AutopilotEvent::Disarmed));
    assert_eq!((view.status(at(1.5)).armed, view.status(at(1.5)).landed), (false, Some(true)));
    assert_eq!(view.take_events().len(), 6);
}

fn event(sequence: u16, event: AutopilotEvent) -> Packet {
    packet(MavMessage::EVENT(EVENT_DATA { id: event.id(), sequence, ..EVENT_DATA::default() }))
}

#[test]
fn an_event_that_is_told_again_to_somebody_else_changes_nothing() {
    let mut view = View::new(1, 1, Firmware::Px4);
    view.accept(at(1.0), &packet(heartbeat(Px4Mode::Offboard, true)));
    view.accept(at(1.1), &event(101, AutopilotEvent::Armed));
    for (sequence, old) in [(100, AutopilotEvent::Disarmed), (99, AutopilotEvent::LandingDetected)] {
        view.accept(at(1.2), &event(sequence, old));
    }
    view.accept(at(1.3), &event(101, AutopilotEvent::Armed));
    assert_eq!((view.status(at(1.3)).armed, view.status(at(1.3)).landed), (true, None));
    assert_eq!(view.take_events().len(), 1);
}

#[test]
fn events_are_new_beyond_the_end_of_their_numbers_and_after_silence() {
    let mut view = View::new(1, 1, Firmware::Px4);
    view.accept(at(1.0), &packet(heartbeat(Px4Mode::Offboard, true)));
    view.accept(at(1.1), &event(65_535, AutopilotEvent::Armed));
    view.accept(at(1.2), &event(0, AutopilotEvent::Disarmed));
    assert!(!view.status(at(1.2)).armed);
    view.accept(at(1.3), &event(700, AutopilotEvent::Armed));
    view.accept(at(9.0), &packet(heartbeat(Px4Mode::Hold, false)));
    view.accept(at(9.1), &event(3, AutopilotEvent::Armed));
    assert!(view.status(at(9.1)).armed, "it may have started again");
}

fn odometry(time_us: u64, x: f32) -> Packet {
    packet(MavMessage::ODOMETRY(ODOMETRY_DATA {
        time_usec: time_us,
        frame_id: MavFrame::MAV_FRAME_LOCAL_NED,
        child_frame_id: MavFrame::MAV_FRAME_LOCAL_NED,
        x,
        q: [1.0, 0.0, 0.0, 0.0],
        ..ODOMETRY_DATA::default()
    }))
}

#[test]
fn without_odometry_messages_position_and_attitude_are_joined() {
    let mut view = View::new(1, 1, Firmware::Px4);
    let position = |ms: u32| {
        packet(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms: ms,
            x: 5.0,
            ..LOCAL_POSITION_NED_DATA::default()
        }))
    };
    let attitude = |ms: u32| {
        packet(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms: ms,
            q1: 1.0,
            ..ATTITUDE_QUATERNION_DATA::default()
        }))
    };
    view.accept(at(10.0), &attitude(1_000));
    assert_eq!(view.odometry(), None, "an attitude alone is no odometry");
    view.accept(at(10.01), &position(1_010));
    view.accept(at(10.02), &attitude(1_020));
    assert!((view.odometry().unwrap().pos_world.y - 5.0).abs() < 1e-9);
    view.accept(at(10.03), &odometry(1_030_000, 7.0));
    view.accept(at(10.04), &attitude(1_040));
    assert!((view.odometry().unwrap().pos_world.y - 7.0).abs() < 1e-9, "ODOMETRY is preferred while it streams");
    view.accept(at(10.59), &position(1_590));
    view.accept(at(10.60), &attitude(1_600));
    assert!((view.odometry().unwrap().pos_world.y - 5.0).abs() < 1e-9, "and replaced when it stops");
    view.accept(at(11.5), &attitude(2_500));
    assert_eq!(view.odometry().unwrap().stamp, at(10.6), "a stale position is not carried on");
}

#[test]
fn odometry_that_comes_late_does_not_replace_newer() {
    let mut view = View::new(1, 1, Firmware::Px4);
    view.accept(at(10.0), &odometry(1_000_000, 1.0));
    view.accept(at(10.03), &odometry(1_030_000, 2.0));
    view.accept(at(10.04), &odometry(1_010_000, 3.0));
    assert!((view.odometry().unwrap().pos_world.y - 2.0).abs() < 1e-9);
}

#[test]
fn unusable_odometry_is_counted_and_not_used() {
    let mut view = View::new(1, 1, Firmware::Px4);
    view.accept(at(1.0), &odometry(1, f32::NAN));
    let MavMessage::ODOMETRY(mut message) = odometry(2, 0.0).message else { unreachable!() };
    message.frame_id = MavFrame::MAV_FRAME_LOCAL_FLU;
    view.accept(at(1.0), &packet(MavMessage::ODOMETRY(message)));
    let counters = view.status(at(1.0)).counters;
    assert_eq!((counters.not_finite, counters.odometry_frame, view.odometry()), (1, 1, None));
}

#[test]
fn a_timesync_question_is_answered_with_our_clock() {
    let mut view = View::new(1, 1, Firmware::Px4);
    let question = TIMESYNC_DATA { tc1: 0, ts1: 77, ..TIMESYNC_DATA::default() };
    match view.accept(Time(123), &packet(MavMessage::TIMESYNC(question))).reply {
        Some(MavMessage::TIMESYNC(answer)) => assert_eq!((answer.tc1, answer.ts1), (123, 77)),
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_unknown_battery_is_none() {
    let mut view = View::new(1, 1, Firmware::Px4);
    let battery = |remaining: i8| {
        packet(MavMessage::SYS_STATUS(SYS_STATUS_DATA { battery_remaining: remaining, ..SYS_STATUS_DATA::default() }))
    };
    view.accept(at(1.0), &battery(42));
    assert_eq!(view.status(at(1.0)).battery_fraction, Some(0.42));
    view.accept(at(1.0), &battery(-1));
    assert_eq!(view.status(at(1.0)).battery_fraction, None);
}

#[test]
fn the_reset_counter_of_odometry_is_passed_on() {
    let mut view = View::new(1, 1, Firmware::Px4);
    for (time_us, counter) in [(1_000_000, 3), (1_030_000, 4), (1_060_000, 255), (1_090_000, 0)] {
        let MavMessage::ODOMETRY(mut message) = odometry(time_us, 0.0).message else { unreachable!() };
        message.reset_counter = counter;
        view.accept(at(1.0 + time_us as f64 * 1e-6), &packet(MavMessage::ODOMETRY(message)));
        assert_eq!(view.odometry().unwrap().reset_counter, u32::from(counter));
    }
}

fn attitude(boot_s: f64) -> Packet {
    let time_boot_ms = (boot_s * 1e3) as u32;
    packet(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA { time_boot_ms, q1: 1.0, ..Default::default() }))
}

#[test]
fn a_clock_that_goes_back_is_a_restart_after_which_nothing_of_before_holds() {
    let mut view = View::new(1, 1, Firmware::Px4);
    view.accept(at(100.0), &packet(heartbeat(Px4Mode::Offboard, true)));
    view.accept(at(100.1), &attitude(50.0));
    assert!(!view.accept(at(100.2), &attitude(49.95)).restarted, "one that came late");
    let accepted = view.accept(at(101.0), &attitude(0.4));
    let status = view.status(at(101.0));
    assert!(accepted.restarted && !status.connected && !status.armed && !status.offboard, "{status:?}");
    assert_eq!(status.counters.restarts, 1);
    assert!(view.accept(at(101.2), &packet(heartbeat(Px4Mode::Hold, false))).greet);
    assert!(view.status(at(101.2)).connected && !view.accept(at(101.3), &attitude(0.7)).restarted);
}

#[test]
fn after_a_silence_it_is_not_known_who_speaks_until_its_state_or_its_time_is_told() {
    let told = [attitude(9.0), packet(heartbeat(Px4Mode::Hold, false)), attitude(0.5)];
    for tells in told {
        let mut view = View::new(1, 1, Firmware::Px4);
        view.accept(at(1.0), &packet(heartbeat(Px4Mode::Offboard, true)));
        view.accept(at(1.4), &attitude(1.4));
        view.accept(at(2.0), &odometry(2_000_000, 1.0));
        assert!(!view.has_fallen_silent(at(2.1)));
        assert!(view.has_fallen_silent(at(4.0)));
        view.accept(at(4.0), &odometry(100_000, 1.0));
        assert!(view.has_fallen_silent(at(4.0)), "odometry may be a new one's");
        view.accept(at(4.1), &tells);
        assert!(!view.has_fallen_silent(at(4.1)));
        assert!(view.has_fallen_silent(at(5.7)));
    }
}

#[test]
fn where_nothing_is_streamed_its_answers_about_the_time_tell_of_a_restart() {
    let mut view = View::new(1, 1, Firmware::Px4);
    let answer = |boot_s: f64| {
        packet(MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: (boot_s * 1e9) as i64, ts1: 1, ..TIMESYNC_DATA::default() }))
    };
    view.accept(at(100.0), &packet(heartbeat(Px4Mode::Offboard, true)));
    view.accept(at(100.1), &attitude(50.0));
    // Its base may be another than the streams'.
    for boot_s in [7.0, 9.0, 8.95] {
        assert!(!view.accept(at(100.2), &answer(boot_s)).restarted, "{boot_s}");
    }
    assert!(!view.accept(at(100.3), &attitude(50.2)).restarted);
    assert!(view.accept(at(102.0), &answer(1.0)).restarted && !view.status(at(102.0)).connected);
    assert!(!view.accept(at(102.1), &attitude(1.1)).restarted);
    assert!(view.accept(at(102.2), &packet(heartbeat(Px4Mode::Hold, false))).greet);
    assert_eq!(view.status(at(102.2)).counters.restarts, 1);
}

#[test]
fn a_message_that_only_we_do_not_know_is_not_lost() {
    let mut view = View::new(1, 1, Firmware::Px4);
    for sequence in [1, 2, 4, 5] {
        if sequence == 4 {
            let unknown = MavHeader { system_id: 1, component_id: 1, sequence: 3 };
            view.reject(Reject::Unknown, Some(unknown));
            view.reject(Reject::Unknown, Some(MavHeader { component_id: 158, ..unknown }));
        }
        let header = MavHeader { system_id: 1, component_id: 1, sequence };
        view.accept(at(1.0), &Packet { header, message: heartbeat(Px4Mode::Hold, false) });
    }
    let counters = view.status(at(1.0)).counters;
    assert_eq!((counters.lost, counters.unknown), (0, 2));
}

#[test]
fn an_autopilot_of_other_ids_is_named_with_what_to_set() {
    let mut view = View::new(1, 1, Firmware::Px4);
    let px4 = HEARTBEAT_DATA { autopilot: MavAutopilot::MAV_AUTOPILOT_PX4, ..HEARTBEAT_DATA::default() };
    let header = MavHeader { system_id: 7, component_id: 1, sequence: 0 };
    view.accept(at(1.0), &Packet { header, message: MavMessage::HEARTBEAT(px4) });
    let advice = view.status(at(1.0)).problem().unwrap();
    assert!(advice.contains("set target_system = 7"), "{advice}");
}
