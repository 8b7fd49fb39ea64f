//! The stand-in's state machine against what the real one was measured to do.

use super::bench::{Bench, arm, command, offboard, setpoint, standing};
use super::{LossAction, Px4Config};
use goshawk_autopilot::messages::*;
use goshawk_autopilot::{AutopilotEvent, Px4Mode};
use goshawk_core::Vec3;
use mavlink::MessageData;

#[test]
fn offboard_is_accepted_disarmed_without_a_stream_but_arming_then_is_not() {
    let mut bench = Bench::new(Px4Config::default());
    assert_eq!(bench.ask(offboard()), Some(MavResult::MAV_RESULT_ACCEPTED));
    assert_eq!(bench.mode(), Px4Mode::Offboard);
    assert_eq!(bench.ask(arm()), Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
    assert!(!bench.armed());
    bench.thrust = Some(0.0);
    bench.run(0.1);
    assert_eq!(bench.ask(arm()), Some(MavResult::MAV_RESULT_ACCEPTED));
    assert!(bench.armed());
}

#[test]
fn offboard_without_a_stream_is_refused_when_armed() {
    let mut bench = Bench::new(Px4Config::default());
    assert_eq!(bench.ask(arm()), Some(MavResult::MAV_RESULT_ACCEPTED));
    assert_eq!(bench.ask(offboard()), Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
    assert_eq!(bench.mode(), Px4Mode::Hold);
    bench.thrust = Some(0.0);
    bench.run(0.1);
    assert_eq!(bench.ask(offboard()), Some(MavResult::MAV_RESULT_ACCEPTED));
}

#[test]
fn a_wrong_component_gets_no_ack_and_its_setpoints_count_for_nothing() {
    let mut bench = Bench::new(Px4Config::default());
    assert_eq!(bench.ask(command(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 6.0, 0.0], 7)), None);
    assert_eq!(bench.mode(), Px4Mode::Hold);
    assert_eq!(bench.ask(offboard()), Some(MavResult::MAV_RESULT_ACCEPTED));
    for _ in 0..50 {
        bench.step(Some(setpoint(0.3, 7)));
    }
    assert_eq!(bench.ask(arm()), Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
}

#[test]
fn lost_setpoints_fail_safe_after_the_loss_time() {
    for loss_s in [0.2, 0.5, 1.0] {
        let mut bench = Bench::airborne(Px4Config { loss_s, ..Px4Config::default() });
        bench.until(|bench| bench.steps % 20 == 1); // right after a setpoint
        bench.thrust = None;
        bench.heard.clear();
        let took = bench.until(|bench| bench.mode() != Px4Mode::Offboard);
        assert!((took - loss_s - 0.05).abs() < 0.005, "{took} for {loss_s}");
        assert_eq!(bench.mode(), Px4Mode::Land);
        assert!(bench.heard_event(AutopilotEvent::FailsafeEntered), "the event comes at once");
        let shown = bench.until(|bench| {
            bench.heard.iter().any(|(_, message)| match message {
                MavMessage::HEARTBEAT(heartbeat) => heartbeat.custom_mode == Px4Mode::Land.custom_mode(),
                _ => false,
            })
        });
        assert!(shown <= 1.0, "the heartbeat is late by up to its interval: {shown}");
    }
}

#[test]
fn the_failsafes_mode_is_shown_as_not_intended() {
    let mut bench = Bench::airborne(Px4Config { loss_action: LossAction::Hold, ..Px4Config::default() });
    let raise = command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [CURRENT_MODE_DATA::ID as f32, 100_000.0, 0.0], 1);
    assert_eq!(bench.ask(raise), Some(MavResult::MAV_RESULT_ACCEPTED));
    bench.thrust = None;
    bench.until(|bench| bench.mode() == Px4Mode::Hold);
    bench.heard.clear();
    let shown = bench.until(|bench| {
        bench.heard.iter().any(|(_, message)| {
            matches!(message, MavMessage::CURRENT_MODE(mode)
                if mode.custom_mode == Px4Mode::Hold.custom_mode()
                    && mode.intended_custom_mode == Px4Mode::Offboard.custom_mode())
        })
    });
    assert!(shown <= 0.1, "{shown}");
}

#[test]
fn a_resumed_stream_returns_to_offboard_within_40_ms() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.thrust = None;
    bench.until(|bench| bench.mode() == Px4Mode::Land);
    bench.run(2.0);
    bench.until(|bench| bench.steps.is_multiple_of(20)); // the next step sends one
    bench.thrust = Some(0.5);
    let took = bench.until(|bench| bench.mode() == Px4Mode::Offboard);
    assert!(took <= 0.04, "{took}");
}

#[test]
fn a_normal_disarm_in_the_air_is_refused_and_a_forced_one_is_not() {
    let mut bench = Bench::airborne(Px4Config::default());
    let disarm = |magic: f32| command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, magic, 0.0], 1);
    assert_eq!(bench.ask(disarm(0.0)), Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
    assert!(bench.armed());
    assert_eq!(bench.ask(disarm(21196.0)), Some(MavResult::MAV_RESULT_ACCEPTED));
    assert!(!bench.armed());
    assert_eq!(bench.output.unwrap().demand, None);
}

#[test]
fn no_thrust_on_the_ground_is_landed_after_2_to_2_6_s_and_disarmed_2_s_later() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.vehicle = standing();
    bench.thrust = Some(0.0);
    bench.heard.clear();
    let landed = bench.until(|bench| bench.px4.landed());
    assert!((2.0..2.6).contains(&landed), "{landed}");
    let disarmed = bench.until(|bench| !bench.armed());
    assert!((disarmed - 2.0).abs() < 0.01, "{disarmed}");
    let events: Vec<AutopilotEvent> = bench.events().into_iter().map(|(_, event)| event).collect();
    assert_eq!(events, [AutopilotEvent::LandingDetected, AutopilotEvent::Disarmed]);
}

#[test]
fn a_quarter_of_thrust_on_the_ground_is_believed_to_be_flight() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.vehicle = standing();
    bench.thrust = Some(0.25);
    bench.run(10.0);
    assert!(bench.armed() && !bench.px4.landed());
}

#[test]
fn armed_without_a_flight_it_disarms_after_10_s() {
    let mut bench = Bench::new(Px4Config::default());
    assert_eq!(bench.ask(arm()), Some(MavResult::MAV_RESULT_ACCEPTED));
    let took = bench.until(|bench| !bench.armed());
    assert!((took - 9.0).abs() < 0.01, "a second passed while asking: {took}");
}

#[test]
fn a_pilot_takes_over_and_setpoints_do_not_take_it_back() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.px4.pilot_takes_over(Px4Mode::Position);
    bench.heard.clear();
    bench.run(3.0);
    assert_eq!(bench.mode(), Px4Mode::Position);
    assert!(!bench.heard_event(AutopilotEvent::FailsafeEntered));
    let told = bench.heard.iter().filter_map(|(_, message)| match message {
        MavMessage::CURRENT_MODE(mode) => Some(mode.custom_mode == mode.intended_custom_mode),
        _ => None,
    });
    let told: Vec<bool> = told.collect();
    assert!(!told.is_empty() && told.iter().all(|same| *same), "{told:?}");
}

#[test]
fn the_demand_is_the_setpoint_in_enu_and_flu() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.step(None);
    let demand = bench.output.unwrap().demand.unwrap();
    // The wire's identity faces north: ENU yaw 90 degrees.
    let forward = demand.world_from_body * Vec3::x();
    assert!((forward - Vec3::y()).norm() < 1e-6, "{forward:?}");
    assert!((demand.thrust.0 - 0.5).abs() < 1e-6);
}
