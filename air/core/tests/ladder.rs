//! The fallback ladder and the faults, in a closed loop.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{Frames, Loop, navigate, track};
use goshawk_core::*;

fn navigating() -> Loop {
    let mut sim = Loop::new();
    sim.frames = Frames::Goal;
    sim.start(navigate(Vec3::new(80.0, 0.0, 2.0)));
    sim.until(12.0, |s| s.mode() == Mode::Navigate);
    sim.run(3.0);
    assert!(sim.vel.norm() > 3.0 && sim.out().fallback == Fallback::None);
    sim
}

fn level(output: &ControllerOutput) -> bool {
    let up = output.setpoint.unwrap().world_from_body * Vec3::z();
    (up - Vec3::z()).norm() < 1e-9
}

#[test]
fn an_expired_plan_brakes_then_holds_then_lands() {
    let mut sim = navigating();
    sim.frames = Frames::None;
    sim.run(0.2);
    assert_eq!(sim.out().fallback, Fallback::None);
    sim.run(0.2);
    assert_eq!(sim.out().fallback, Fallback::PlanExpiredBrake);
    let height = sim.pos.z;
    sim.until(4.0, |s| s.out().fallback == Fallback::HoldPosition);
    sim.run(3.0);
    assert!(sim.vel.norm() < 0.05 && (sim.pos.z - height).abs() < 0.3);
    sim.until(20.0, |s| s.mode() == Mode::Stopping);
    assert_eq!(sim.last_cause(), Cause::NoPlan);
    sim.until(20.0, |s| s.mode() == Mode::Landed);
}

#[test]
fn every_rung_takes_over_within_two_steps_of_its_deadline() {
    let ladder = common::config().ladder;
    let late = |sim: &mut Loop, deadline: f64, since: f64, there: &dyn Fn(&Loop) -> bool| {
        sim.until(30.0, |s| there(s));
        let late = sim.seconds() - since - deadline;
        assert!((-0.03..=0.011).contains(&late), "{late} s after its deadline of {deadline} s");
    };
    // Of odometry each sample is 10 ms from the next, of frames 30 ms.
    let mut sim = navigating();
    sim.odometry_works = false;
    let since = sim.seconds();
    late(&mut sim, ladder.odometry_stale_s, since, &|s| s.out().fallback == Fallback::OdometryStaleDescend);
    late(&mut sim, ladder.odometry_stale_s + ladder.hand_back_s, since, &|s| s.out().fallback == Fallback::HandBack);
    let mut sim = navigating();
    sim.frames = Frames::None;
    let since = sim.seconds();
    late(&mut sim, ladder.plan_stale_s, since, &|s| s.out().fallback == Fallback::PlanExpiredBrake);
    late(&mut sim, ladder.no_plan_land_s, since, &|s| s.mode() == Mode::Stopping);
}

#[test]
fn a_chase_brakes_sooner_when_frames_stop_than_when_they_miss() {
    for (frames, braking) in [(Frames::None, true), (Frames::Blank, false)] {
        let mut sim = Loop::new();
        sim.frames = Frames::Target(Vec3::new(30.0, 0.0, 1.5));
        sim.start(track());
        sim.until(12.0, |s| s.mode() == Mode::Track);
        sim.run(1.0);
        sim.frames = frames;
        sim.run(0.4);
        assert_eq!(sim.out().fallback == Fallback::PlanExpiredBrake, braking);
    }
}

#[test]
fn a_plan_that_comes_back_is_flown_again() {
    let mut sim = navigating();
    sim.frames = Frames::None;
    sim.run(1.0);
    sim.frames = Frames::Goal;
    sim.run(0.1);
    assert!(sim.out().fallback == Fallback::None && sim.out().plan_seq.is_some());
}

#[test]
fn frames_of_nan_brake() {
    let mut sim = navigating();
    sim.frames = Frames::Blank;
    sim.until(0.5, |s| s.out().fallback == Fallback::PlanExpiredBrake);
    assert_eq!(sim.mode(), Mode::Navigate);
}

#[test]
fn stale_odometry_levels_and_descends_then_hands_back() {
    let mut sim = navigating();
    let height = sim.pos.z;
    sim.odometry_works = false;
    sim.run(0.15);
    assert_eq!(sim.out().fallback, Fallback::None);
    sim.run(0.1);
    assert_eq!(sim.out().fallback, Fallback::OdometryStaleDescend);
    sim.run(1.2);
    assert!(level(sim.out()) && sim.out().fallback == Fallback::OdometryStaleDescend);
    assert!(sim.vel.z < 0.0 && sim.vel.z > -1.0, "descends gently: {}", sim.vel.z);
    assert!(sim.pos.z < height + 0.5);
    sim.until(1.0, |s| s.mode() == Mode::Fault);
    assert_eq!((sim.last_cause(), sim.out().setpoint), (Cause::OdometryLost, None));
    assert!(sim.requests.iter().any(|r| r.1 == Request::HandBack));
}

#[test]
fn odometry_that_comes_back_in_time_is_flown_on() {
    let mut sim = navigating();
    sim.odometry_works = false;
    sim.run(0.8);
    sim.odometry_works = true;
    sim.run(0.1);
    assert_eq!((sim.mode(), sim.out().fallback), (Mode::Navigate, Fallback::None));
}

#[test]
fn odometry_that_ends_before_lift_off_stops_the_motors_and_disarms() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.start(track());
    sim.until(5.0, |s| s.out().setpoint.is_some_and(|setpoint| setpoint.thrust.0 > 0.05));
    sim.odometry_works = false;
    sim.run(0.3);
    assert_eq!(sim.out().setpoint.unwrap().thrust.0, 0.0);
    sim.until(3.0, |s| s.mode() == Mode::Fault);
    assert!(sim.pos.z == 0.0 && sim.last_cause() == Cause::OdometryLost);
    sim.until(6.0, |s| !s.autopilot.armed);
}

#[test]
fn odometry_of_nan_counts_as_stale() {
    let mut sim = navigating();
    sim.odometry_offset = Vec3::new(f64::NAN, 0.0, 0.0);
    sim.frames = Frames::None;
    sim.run(0.3);
    assert_eq!(sim.out().fallback, Fallback::OdometryStaleDescend);
    assert!(level(sim.out()));
}

#[test]
fn an_odometry_jump_moves_the_hold_point_not_the_vehicle() {
    for announced in [0, 1] {
        let mut sim = Loop::new();
        sim.frames = Frames::Blank;
        sim.start(track());
        sim.until(10.0, |s| s.mode() == Mode::Search);
        sim.run(2.0);
        let held = sim.pos;
        sim.odometry_offset = Vec3::new(8.0, -5.0, 2.0);
        sim.reset_counter += announced;
        for _ in 0..600 {
            sim.tick(None);
            assert!((sim.pos - held).norm() < 0.15, "moved to {}", sim.pos);
        }
        sim.stop();
        sim.until(20.0, |s| s.mode() == Mode::Landed);
    }
}

#[test]
fn a_jump_of_the_heading_does_not_turn_the_vehicle() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.start(navigate(Vec3::new(40.0, 0.0, 1.5)));
    sim.until(10.0, |s| s.mode() == Mode::Navigate);
    sim.stop();
    sim.run(0.5);
    let (held, nose) = (sim.pos, sim.attitude * Vec3::x());
    sim.odometry_turn = 0.8;
    sim.reset_counter += 1;
    for _ in 0..100 {
        sim.tick(None);
        assert!((sim.attitude * Vec3::x()).dot(&nose) > 0.999 && (sim.pos - held).xy().norm() < 0.1);
    }
    sim.until(20.0, |s| s.mode() == Mode::Landed);
}

#[test]
fn an_odometry_jump_moves_the_goal_along() {
    let mut sim = navigating();
    let goal = sim.out().planning.unwrap().goal_world.unwrap();
    sim.odometry_offset = Vec3::new(0.0, 12.0, 1.0);
    sim.reset_counter += 1;
    sim.run(0.1);
    let moved = sim.out().planning.unwrap().goal_world.unwrap() - goal;
    assert!((moved - sim.odometry_offset).norm() < 0.05, "{moved}");
}

#[test]
fn odometry_that_ends_after_touch_down_does_not_keep_the_vehicle_from_disarming() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.stop();
    sim.until(20.0, |s| s.out().setpoint.is_some_and(|setpoint| setpoint.thrust.0 == 0.0));
    sim.odometry_works = false;
    sim.until(5.0, |s| s.mode() == Mode::Landed);
    assert!(sim.requests.iter().all(|r| r.1 != Request::HandBack));
}

#[test]
fn the_pilot_taking_the_mode_ends_authority_at_once_and_for_good() {
    let mut sim = navigating();
    let asked = sim.requests.len();
    sim.autopilot.offboard = false;
    let output = sim.tick(None);
    assert_eq!((output.mode, output.setpoint, output.request), (Mode::Fault, None, None));
    assert_eq!(output.transition.unwrap().cause, Cause::ModeTakenAway);
    for _ in 0..2000 {
        let output = sim.tick(None);
        assert!(output.setpoint.is_none() && output.request.is_none());
    }
    assert_eq!((sim.mode(), sim.requests.len()), (Mode::Fault, asked));
    assert_eq!(sim.tick(Some(Command::Start(track()))).reply, Some(Err(Refusal::Faulted)));
    sim.autopilot.armed = false;
    sim.until(2.0, |s| s.mode() == Mode::Ready);
}

#[test]
fn the_pilot_can_take_over_in_every_airborne_mode() {
    for seconds in [1.8, 3.0, 6.0, 10.0] {
        let mut sim = Loop::new();
        sim.frames = Frames::Target(Vec3::new(20.0, 5.0, 1.5));
        sim.start(track());
        sim.run(seconds);
        assert!(sim.mode().has_authority());
        sim.autopilot.offboard = false;
        assert_eq!(sim.tick(None).setpoint, None);
        assert_eq!(sim.mode(), Mode::Fault);
    }
}

#[test]
fn disarmed_in_flight_is_a_fault() {
    let mut sim = navigating();
    sim.autopilot.armed = false;
    sim.tick(None);
    assert_eq!((sim.mode(), sim.last_cause()), (Mode::Fault, Cause::Disarmed));
}

#[test]
fn a_steady_wind_is_found_and_leaned_against() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.wind = Vec3::new(2.0, -1.0, 0.5);
    sim.run(1.0);
    assert!((sim.out().acc_disturbance_world - sim.wind).norm() < 0.15, "{}", sim.out().acc_disturbance_world);
    sim.run(20.0);
    // What is steady along the thrust has become part of the hover thrust.
    let found = sim.out().acc_disturbance_world;
    assert!((found - sim.wind).xy().norm() < 0.15 && found.z.abs() < 0.2, "{found}");
    assert!(sim.out().hover_thrust < 0.245, "{}", sim.out().hover_thrust);
    assert!((sim.pos - Vec3::new(3.0, -2.0, 1.5)).norm() < 0.1, "{}", sim.pos);
}

#[test]
fn a_step_after_a_long_pause_or_backwards_in_time_is_survived() {
    let mut sim = navigating();
    sim.now = sim.now.plus(0.15);
    sim.tick(None);
    sim.now = sim.now.plus(-0.1);
    for _ in 0..10 {
        let output = sim.tick(None);
        assert!(output.setpoint.unwrap().thrust.0.is_finite());
    }
}

#[test]
fn a_position_that_the_autopilot_calls_invalid_levels_and_descends_then_hands_back() {
    let mut sim = navigating();
    let (lost, height) = (sim.seconds(), sim.pos.z);
    sim.autopilot.position = Some(false);
    sim.run(0.02);
    assert!(level(sim.out()) && sim.out().fallback == Fallback::OdometryStaleDescend);
    sim.run(1.0);
    assert!(level(sim.out()) && sim.mode() == Mode::Navigate && sim.pos.z < height + 0.5);
    sim.until(1.0, |s| s.mode() == Mode::Fault);
    assert!((sim.seconds() - lost - common::config().ladder.hand_back_s).abs() < 0.02);
    assert_eq!((sim.last_cause(), sim.out().setpoint), (Cause::PositionLost, None));
    assert!(sim.requests.iter().any(|r| r.1 == Request::HandBack));
}

#[test]
fn a_position_that_comes_back_in_time_is_flown_on() {
    let mut sim = navigating();
    sim.autopilot.position = Some(false);
    sim.run(0.8);
    sim.autopilot.position = Some(true);
    sim.run(0.1);
    assert_eq!((sim.mode(), sim.out().fallback), (Mode::Navigate, Fallback::None));
}
