use super::*;
use crate::dialogue::copter::CopterMode;
use crate::dialogue::firmware::Guided;
use crate::messages::{ATTITUDE_QUATERNION_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavParamType, MavType};
use goshawk_core::Vec3;
use mavlink::MavHeader;

fn packet(message: MavMessage) -> Packet {
    Packet { header: MavHeader { system_id: 1, component_id: 1, sequence: 0 }, message }
}

fn at(seconds: f64) -> Time {
    Time::from_secs(seconds)
}

const ARDUPILOT: Firmware = Firmware::ArduPilot(Guided::Guided);

fn copter(mode: CopterMode) -> Packet {
    packet(MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: mode.0,
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
        base_mode: MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED,
        system_status: MavState::MAV_STATE_ACTIVE,
        ..HEARTBEAT_DATA::default()
    }))
}

fn guided_options(value: f32) -> Packet {
    packet(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
        param_id: GUIDED_OPTIONS.into(),
        param_value: value,
        param_type: MavParamType::MAV_PARAM_TYPE_INT32,
        ..PARAM_VALUE_DATA::default()
    }))
}

#[test]
fn ardupilot_follows_us_only_once_its_thrust_is_known_to_be_thrust() {
    let mut view = View::new(1, 1, ARDUPILOT);
    view.accept(at(1.0), &copter(CopterMode::GUIDED));
    let status = |view: &View| view.status(at(1.5));
    assert!(!status(&view).offboard && status(&view).problem().unwrap().contains("GUID_OPTIONS is not read yet"));
    for climb_rate in [0.0, 1.0, 7.0, 16.0] {
        view.accept(at(1.1), &guided_options(climb_rate));
        let problem = status(&view).problem().unwrap();
        assert!(!status(&view).offboard && problem.contains("climb rate"), "{problem}");
        assert!(problem.contains(&format!("set it to {}", climb_rate as i32 | 8)), "{problem}");
    }
    for thrust in [8.0, 9.0, 12.0, 255.0] {
        view.accept(at(1.2), &guided_options(thrust));
        assert_eq!((status(&view).offboard, status(&view).problem()), (true, None), "{thrust}");
    }
    view.accept(at(1.3), &guided_options(0.0));
    assert!(!status(&view).offboard, "changed in flight, it ends our authority");
}

#[test]
fn who_has_all_parameters_told_to_him_keeps_none_of_ours_away() {
    let mut view = View::new(1, 1, ARDUPILOT);
    view.accept(at(1.0), &copter(CopterMode::GUIDED));
    for number in 0..1000 {
        let param_id = format!("RC{number}_MIN").as_str().into();
        let told = PARAM_VALUE_DATA { param_id, param_type: MavParamType::MAV_PARAM_TYPE_REAL32, ..Default::default() };
        view.accept(at(1.1), &packet(MavMessage::PARAM_VALUE(told)));
    }
    view.accept(at(1.2), &guided_options(8.0));
    assert!(view.status(at(1.3)).offboard);
    assert!(view.parameters.len() <= parameters::KEPT + ARDUPILOT.parameters().len());
}

#[test]
fn a_restarted_ardupilot_is_asked_for_its_options_again() {
    let mut view = View::new(1, 1, ARDUPILOT);
    view.accept(at(1.0), &copter(CopterMode::GUIDED));
    view.accept(at(1.1), &guided_options(8.0));
    assert!(view.accept(at(9.0), &copter(CopterMode::GUIDED)).greet);
    assert!(view.status(at(9.0)).problem().is_some());
}

#[test]
fn ardupilots_other_modes_end_authority_and_the_other_guided_mode_too() {
    for (guided, ours, other) in [
        (Guided::Guided, CopterMode::GUIDED, CopterMode::GUIDED_NOGPS),
        (Guided::NoGps, CopterMode::GUIDED_NOGPS, CopterMode::GUIDED),
    ] {
        let mut view = View::new(1, 1, Firmware::ArduPilot(guided));
        view.accept(at(1.0), &copter(ours));
        view.accept(at(1.0), &guided_options(8.0));
        assert!(view.status(at(1.0)).offboard);
        for taken in [other, CopterMode(0), CopterMode(5), CopterMode::LAND] {
            view.accept(at(1.1), &copter(taken));
            assert!(!view.status(at(1.1)).offboard, "{taken}");
            assert_eq!(view.status(at(1.1)).mode, Some(FlightMode::Copter(taken)));
        }
    }
}

#[test]
fn the_wrong_firmware_is_no_autopilot_to_start_with() {
    let mut view = View::new(1, 1, Firmware::Px4);
    view.accept(at(1.0), &copter(CopterMode::GUIDED));
    let problem = view.status(at(1.0)).problem().unwrap();
    assert!(problem.contains("firmware = \"ardupilot\"") && problem.lines().count() == 1, "{problem}");
}

#[test]
fn what_is_heard_without_a_heartbeat_tells_what_is_wrong() {
    let heard = |change: fn(&mut Counters)| {
        let mut view = View::new(1, 1, Firmware::Px4);
        change(&mut view.counters);
        view.status(at(1.0)).problem().unwrap()
    };
    assert!(heard(|_| {}).contains("no autopilot has been heard"));
    assert!(heard(|counters| counters.garbage = 9).contains("baud rate"));
    assert!(heard(|counters| counters.foreign = 9).contains("target_system"));
    assert!(heard(|counters| counters.unsigned = 9).contains("not signed"));
    assert!(heard(|counters| counters.bad_signature = 9).contains("another key"));
    assert!(heard(|counters| counters.stale_signature = 9).contains("time"));
}

/// Position and attitude `dt` s apart, at `north` m and `yaw` rad, flying north at 2 m/s.
fn joined(view: &mut View, seconds: f64, north: f32, yaw: f32) -> Odometry {
    let time_boot_ms = (seconds * 1e3) as u32;
    view.accept(
        at(seconds),
        &packet(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms,
            x: north,
            vx: 2.0,
            ..LOCAL_POSITION_NED_DATA::default()
        })),
    );
    view.accept(
        at(seconds),
        &packet(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms,
            q1: (yaw / 2.0).cos(),
            q4: (yaw / 2.0).sin(),
            ..ATTITUDE_QUATERNION_DATA::default()
        })),
    );
    view.odometry().unwrap()
}

#[test]
fn where_messages_have_no_reset_counter_a_jump_counts_as_a_reset() {
    let mut view = View::new(1, 1, ARDUPILOT);
    assert_eq!(joined(&mut view, 10.0, 0.0, 0.0).reset_counter, 0);
    let flown = joined(&mut view, 10.1, 0.2, 0.0);
    assert_eq!(flown.reset_counter, 0, "that far it flew");
    assert!((flown.vel_world - Vec3::new(0.0, 2.0, 0.0)).norm() < 1e-6);
    assert_eq!(joined(&mut view, 10.2, 3.4, 0.0).reset_counter, 1, "3 m it did not");
    assert_eq!(joined(&mut view, 10.3, 3.6, 0.0).reset_counter, 1);
    assert_eq!(joined(&mut view, 10.4, 3.8, 1.0).reset_counter, 2, "a heading that jumps is one too");
    assert_eq!(joined(&mut view, 10.5, 4.0, 1.0).reset_counter, 2);
}
