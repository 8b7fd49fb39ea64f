//! The mission, flown in a closed loop.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{Frames, Loop, navigate, track};
use goshawk_core::*;

fn hovering_in_search() -> Loop {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim
}

fn chasing(target: Vec3) -> Loop {
    let mut sim = hovering_in_search();
    sim.frames = Frames::Target(target);
    sim.until(1.0, |s| s.mode() == Mode::Track);
    sim
}

#[test]
fn takeoff_streams_then_asks_for_offboard_then_arms_then_climbs_to_the_height() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.start(track());
    let begun = sim.seconds();
    assert_eq!(sim.mode(), Mode::Takeoff);
    assert_eq!(sim.out().setpoint.unwrap().thrust.0, 0.0);
    sim.run(1.1);
    assert!(sim.requests.is_empty() && sim.out().planning.is_none());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    assert_eq!(sim.last_cause(), Cause::HeightReached);
    let asked: Vec<_> = sim.requests.iter().map(|r| r.1).collect();
    assert_eq!(asked, [Request::Offboard, Request::Arm]);
    assert!(sim.requests[0].0 - begun >= 1.2);
    sim.run(2.0);
    assert!((sim.pos - Vec3::new(3.0, -2.0, 1.5)).norm() < 0.1, "{}", sim.pos);
    assert!(sim.out().planning.is_some());
}

#[test]
fn takeoff_succeeds_with_a_wrong_hover_thrust_and_wind() {
    for heaviness in [0.8, 1.25, 1.4] {
        let mut sim = Loop::new();
        (sim.heaviness, sim.wind) = (heaviness, Vec3::new(1.5, -1.0, 0.0));
        sim.frames = Frames::Blank;
        sim.start(track());
        sim.until(12.0, |s| s.mode() == Mode::Search);
        sim.run(4.0);
        assert!((sim.pos - Vec3::new(3.0, -2.0, 1.5)).norm() < 0.1, "{heaviness}: {}", sim.pos);
    }
}

#[test]
fn start_is_refused_with_the_reason() {
    let refusal = |change: fn(&mut Loop)| {
        let mut sim = Loop::new();
        change(&mut sim);
        sim.run(0.5);
        sim.tick(Some(Command::Start(track()))).reply.unwrap().unwrap_err()
    };
    assert_eq!(refusal(|s| s.autopilot.connected = false), Refusal::AutopilotSilent);
    assert_eq!(refusal(|s| s.autopilot.armed = true), Refusal::NotOnGround);
    assert_eq!(refusal(|s| s.odometry_works = false), Refusal::OdometryStale);
    assert_eq!(refusal(|s| s.autopilot.position = Some(false)), Refusal::NoPosition);
    assert_eq!(refusal(|s| s.ready = false), Refusal::ChecksFailed);
    let mut sim = Loop::new();
    sim.run(0.1);
    let slow = Profile { speed: 0.0, ..track() };
    assert_eq!(sim.tick(Some(Command::Start(slow))).reply, Some(Err(Refusal::BadProfile)));
    let nowhere = Profile { task: Task::Navigate, ..track() };
    assert_eq!(sim.tick(Some(Command::Start(nowhere))).reply, Some(Err(Refusal::BadProfile)));
    sim.start(track());
    assert_eq!(sim.tick(Some(Command::Start(track()))).reply, Some(Err(Refusal::Flying)));
}

#[test]
fn an_autopilot_that_refuses_offboard_or_arming_ends_in_a_fault_with_its_reason() {
    for (offboard, cause) in [(false, Cause::OffboardRefused), (true, Cause::ArmRefused)] {
        let mut sim = Loop::new();
        (sim.accepts_offboard, sim.accepts_arming) = (offboard, false);
        sim.start(track());
        sim.until(8.0, |s| s.mode() == Mode::Fault);
        assert_eq!(sim.last_cause(), cause);
        assert_eq!(sim.out().setpoint, None);
        let asked = if offboard { Request::Arm } else { Request::Offboard };
        assert!(sim.requests.iter().filter(|r| r.1 == asked).count() >= 5, "asked each second");
        sim.until(4.0, |s| s.mode() == Mode::Ready);
    }
}

/// A take-off that has asked for the motors and not got them yet.
fn asking_to_arm() -> Loop {
    let mut sim = Loop::new();
    sim.accepts_arming = false;
    sim.start(track());
    sim.until(5.0, |s| s.requests.iter().any(|r| r.1 == Request::Arm));
    sim
}

#[test]
fn whatever_ends_a_take_off_before_the_motors_start_stops_them_when_they_start_late() {
    type End = (fn(&mut Loop), Cause);
    let ends: [End; 4] = [
        (|s| s.odometry_works = false, Cause::OdometryLost),
        (|s| s.autopilot.offboard = false, Cause::ModeTakenAway),
        (|s| s.autopilot.battery = Some(0.01), Cause::BatteryLow),
        (|s| s.stop(), Cause::StopCommand),
    ];
    for (end, cause) in ends {
        let mut sim = asking_to_arm();
        end(&mut sim);
        sim.until(3.0, |s| !s.mode().has_authority());
        assert!(sim.transitions.iter().any(|t| t.cause == cause), "{:?}", sim.transitions);
        assert_eq!(sim.requests.last().unwrap().1, Request::Disarm, "in place of the request to arm");
        sim.run(0.8);
        sim.autopilot.armed = true;
        sim.until(1.1, |s| !s.autopilot.armed);
        assert!(!sim.requests.iter().any(|r| r.1 == Request::HandBack), "{cause:?}");
    }
}

#[test]
fn a_pilot_who_arms_after_a_given_up_take_off_keeps_the_motors() {
    let mut sim = asking_to_arm();
    sim.autopilot.offboard = false;
    sim.until(1.0, |s| s.mode() == Mode::Fault);
    sim.run(3.2);
    sim.autopilot.armed = true;
    let asked = sim.requests.len();
    sim.run(10.0);
    assert!(sim.autopilot.armed && sim.requests.len() == asked, "{:?}", sim.requests);
}

#[test]
fn a_pilot_who_flies_away_with_a_given_up_take_off_is_not_disarmed_when_he_lands() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.has_landed_detector = false;
    sim.start(track());
    sim.until(5.0, |s| s.out().setpoint.is_some_and(|setpoint| setpoint.thrust.0 > 0.05));
    (sim.autopilot.landed, sim.autopilot.offboard) = (Some(false), false);
    sim.until(1.0, |s| s.mode() == Mode::Fault);
    let asked = sim.requests.len();
    sim.run(5.0);
    assert!(sim.autopilot.armed && sim.requests.len() == asked, "{:?}", sim.requests);
}

#[test]
fn a_vehicle_too_heavy_to_lift_gives_up_and_disarms() {
    let mut sim = Loop::new();
    sim.heaviness = 5.0;
    sim.start(track());
    sim.until(20.0, |s| s.mode() == Mode::Stopping);
    assert_eq!(sim.last_cause(), Cause::TakeoffTimeout);
    sim.until(10.0, |s| s.mode() == Mode::Landed);
}

#[test]
fn the_target_is_chased_until_caught_up_and_chased_again_when_it_moves_off() {
    let mut sim = chasing(Vec3::new(15.0, 3.0, 1.5));
    assert_eq!(sim.last_cause(), Cause::TargetConfirmed);
    sim.run(1.0);
    assert!(sim.vel.norm() > 1.0 && sim.out().plan_seq.is_some() && sim.out().fallback == Fallback::None);
    sim.until(15.0, |s| s.mode() == Mode::Hold);
    assert_eq!(sim.last_cause(), Cause::CaughtUp);
    sim.run(3.0);
    let line = Vec3::new(15.0, 3.0, 1.5) - sim.pos;
    assert!(sim.vel.norm() < 0.1 && line.norm() > 0.5, "stands off the target");
    let nose = sim.attitude * Vec3::x();
    assert!(nose.dot(&line.normalize()) > 0.98, "faces the target");
    sim.frames = Frames::Target(Vec3::new(25.0, 0.0, 1.5));
    sim.until(1.0, |s| s.mode() == Mode::Track);
    assert_eq!(sim.last_cause(), Cause::TargetMovedOff);
}

#[test]
fn a_near_target_that_runs_away_is_chased_on() {
    let mut sim = chasing(Vec3::new(12.0, 0.0, 1.5));
    sim.target_vel = Vec3::new(9.0, 0.0, 0.0);
    sim.run(0.1);
    sim.frames = Frames::Target(sim.pos + Vec3::new(1.5, 0.0, 0.0));
    sim.run(0.3);
    assert_eq!(sim.mode(), Mode::Track);
    sim.target_vel = Vec3::new(-1.0, 0.0, 0.0);
    sim.until(0.2, |s| s.mode() == Mode::Hold);
}

#[test]
fn a_hold_pursues_a_target_that_ran_out_of_sight_and_looks_around_for_one_that_stood() {
    for (vel, then) in [(Vec3::new(0.0, 4.0, 0.0), Mode::Track), (Vec3::new(0.0, 0.5, 0.0), Mode::Search)] {
        let target = Vec3::new(8.0, 3.0, 1.5);
        let mut sim = chasing(target);
        sim.until(15.0, |s| s.mode() == Mode::Hold);
        sim.target_vel = vel;
        sim.run(0.1);
        sim.frames = Frames::Blank;
        sim.until(1.0, |s| s.mode() != Mode::Hold);
        assert_eq!(sim.mode(), then, "{vel}");
    }
}

#[test]
fn a_briefly_missed_target_does_not_interrupt_the_chase() {
    let mut sim = chasing(Vec3::new(20.0, 0.0, 1.5));
    sim.run(1.0);
    let seq = sim.out().plan_seq;
    sim.frames = Frames::Blank;
    sim.run(0.4);
    assert_eq!((sim.mode(), sim.out().fallback), (Mode::Track, Fallback::None));
    assert!(sim.out().plan_seq >= seq && sim.out().plan_age.unwrap() > 0.3, "flies the last tracked trajectory");
    sim.frames = Frames::Target(Vec3::new(20.0, 0.0, 1.5));
    sim.run(0.2);
    assert!(sim.out().plan_age.unwrap() < 0.1);
}

#[test]
fn a_lost_target_brakes_then_is_looked_for_where_it_was_lost_then_all_around() {
    let target = Vec3::new(3.0, 24.0, 1.5);
    let mut sim = chasing(target);
    sim.run(2.0);
    sim.frames = Frames::Blank;
    sim.until(1.0, |s| s.out().fallback == Fallback::PlanExpiredBrake);
    assert_eq!(sim.mode(), Mode::Track);
    sim.until(4.0, |s| s.mode() == Mode::Search);
    assert_eq!(sim.last_cause(), Cause::TargetLost);
    sim.run(1.4);
    let nose = sim.attitude * Vec3::x();
    assert!(nose.dot(&(target - sim.pos).normalize()) > 0.97, "looks where it was lost");
    let held = sim.pos;
    sim.run(2.0);
    let turned = sim.attitude * Vec3::x();
    assert!(turned.dot(&nose) < 0.5, "sweeps");
    assert!((sim.pos - held).norm() < 0.3 && sim.vel.norm() < 0.1, "holds its place");
    sim.frames = Frames::Target(target);
    sim.until(0.2, |s| s.mode() == Mode::Track);
}

#[test]
fn a_search_without_end_lands() {
    let mut config = common::config();
    config.mission.search_timeout_s = 5.0;
    let mut sim = Loop::with(config);
    sim.frames = Frames::Blank;
    sim.start(track());
    sim.until(20.0, |s| s.mode() == Mode::Stopping);
    assert_eq!(sim.last_cause(), Cause::SearchTimeout);
    sim.until(20.0, |s| s.mode() == Mode::Landed);
}

#[test]
fn the_goal_is_relative_to_the_start_and_is_held_once_reached() {
    let mut sim = Loop::new();
    sim.frames = Frames::Goal;
    sim.start(navigate(Vec3::new(20.0, 0.0, 1.5)));
    sim.until(12.0, |s| s.mode() == Mode::Navigate);
    let goal = Vec3::new(3.0 + 20.0 * 0.5_f64.cos(), -2.0 + 20.0 * 0.5_f64.sin(), 1.5);
    assert!((sim.out().planning.unwrap().goal_world.unwrap() - goal).norm() < 1e-6);
    sim.until(20.0, |s| s.mode() == Mode::Hold);
    assert_eq!(sim.last_cause(), Cause::GoalReached);
    assert!((sim.pos - goal).norm() <= 1.5);
    sim.run(5.0);
    assert!(sim.mode() == Mode::Hold && sim.vel.norm() < 0.1 && sim.out().planning.is_none());
}

#[test]
fn stop_brakes_lands_disarms_and_becomes_ready_again() {
    for detector in [true, false] {
        let mut sim = chasing(Vec3::new(30.0, 0.0, 2.0));
        sim.has_landed_detector = detector;
        sim.run(2.5);
        assert!(sim.vel.norm() > 2.0);
        sim.stop();
        let mut fastest = 0.0_f64;
        while sim.mode() == Mode::Stopping {
            fastest = fastest.max(-sim.vel.z);
            assert!(sim.pos.z > 0.6 || sim.vel.z > -0.45, "slow near the ground");
            sim.tick(None);
            assert!(sim.seconds() < 140.0, "landing never ends: {:?}", sim.out());
        }
        assert_eq!((sim.mode(), sim.last_cause()), (Mode::Landed, Cause::TouchedDown));
        assert!(fastest < 0.9, "descends at {fastest} m/s");
        assert!(sim.pos.z == 0.0 && !sim.autopilot.armed);
        sim.autopilot.landed = Some(true);
        sim.has_landed_detector = true;
        sim.until(1.0, |s| s.mode() == Mode::Ready);
        sim.autopilot.offboard = false;
        sim.start(track());
        sim.until(12.0, |s| s.mode() == Mode::Search || s.mode() == Mode::Track);
    }
}

#[test]
fn stop_works_in_every_airborne_mode() {
    type Reach = fn() -> Loop;
    let modes: [(Mode, Reach); 5] = [
        (Mode::Takeoff, || {
            let mut sim = Loop::new();
            sim.start(track());
            sim.until(5.0, |s| s.pos.z > 0.5);
            sim
        }),
        (Mode::Search, hovering_in_search),
        (Mode::Track, || chasing(Vec3::new(20.0, 0.0, 1.5))),
        (Mode::Hold, || {
            let mut sim = chasing(Vec3::new(12.0, 0.0, 1.5));
            sim.until(15.0, |s| s.mode() == Mode::Hold);
            sim
        }),
        (Mode::Navigate, || {
            let mut sim = Loop::new();
            sim.frames = Frames::Goal;
            sim.start(navigate(Vec3::new(40.0, 0.0, 1.5)));
            sim.until(12.0, |s| s.mode() == Mode::Navigate);
            sim
        }),
    ];
    for (mode, reach) in modes {
        let mut sim = reach();
        assert_eq!(sim.mode(), mode);
        sim.stop();
        sim.until(20.0, |s| s.mode() == Mode::Landed);
        assert!(sim.pos.z == 0.0);
    }
}

#[test]
fn stop_on_the_ground_is_harmless_and_stops_a_take_off_before_arming() {
    let mut sim = Loop::new();
    sim.run(0.1);
    sim.stop();
    assert_eq!(sim.mode(), Mode::Ready);
    sim.start(track());
    sim.run(0.5);
    sim.stop();
    assert_eq!(sim.mode(), Mode::Idle);
    sim.run(3.0);
    assert!(sim.requests.is_empty() && sim.out().setpoint.is_none());
}

#[test]
fn landing_on_ground_higher_or_lower_than_the_start_is_noticed() {
    for ground in [-2.5, 0.8] {
        let mut sim = hovering_in_search();
        sim.ground = ground;
        sim.has_landed_detector = false;
        sim.stop();
        sim.until(30.0, |s| s.mode() == Mode::Landed);
        assert!((sim.pos.z - ground).abs() < 1e-6);
    }
}

#[test]
fn an_updraught_is_not_taken_for_the_ground() {
    let mut sim = hovering_in_search();
    sim.stop();
    sim.until(5.0, |s| s.vel.z < -0.3);
    sim.wind = Vec3::new(0.0, 0.0, 3.0);
    while sim.pos.z > 0.05 {
        let thrust = sim.tick(None).setpoint.unwrap().thrust.0;
        assert!(thrust > 0.0, "motors cut at {} m", sim.pos.z);
    }
    sim.until(10.0, |s| s.mode() == Mode::Landed);
}

/// A chase whose target, heading left (1) or right (-1), has just hidden.
fn hiding_target(side: f64) -> Loop {
    let mut sim = hovering_in_search();
    sim.target_vel = Vec3::new(0.0, 3.0 * side, 0.0);
    sim.frames = Frames::Target(Vec3::new(20.0, -2.0, 1.5));
    sim.until(1.0, |s| s.mode() == Mode::Track);
    sim.run(1.0);
    sim.frames = Frames::Blank;
    sim
}

#[test]
fn the_sweep_turns_the_way_the_target_was_heading() {
    for side in [-1.0, 1.0] {
        let mut sim = hiding_target(side);
        sim.until(5.0, |s| s.mode() == Mode::Search);
        sim.run(1.4);
        let before = sim.out().yaw_des;
        sim.run(1.0);
        let turned = goshawk_core::values::geometry::wrap(sim.out().yaw_des - before) * side;
        assert!(turned > 0.5 && turned < 1.1, "turned {turned}");
    }
}

#[test]
fn navigation_looks_at_the_goal_when_slow_and_along_the_velocity_when_fast() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.start(navigate(Vec3::new(0.0, 40.0, 1.5)));
    sim.until(12.0, |s| s.mode() == Mode::Navigate);
    // Not so long that it thinks itself stuck.
    sim.run(1.5);
    let left = 0.5 + std::f64::consts::FRAC_PI_2;
    assert!(goshawk_core::values::geometry::wrap(sim.out().yaw_des - left).abs() < 0.02, "{}", sim.out().yaw_des);
    sim.frames = Frames::Goal;
    // Sideways it looks along, on the way back to the goal.
    for (off, looks) in [(0.8_f64, 0.8), (2.6, 0.0)] {
        for _ in 0..400 {
            let way = left - off;
            sim.vel = Vec3::new(4.0 * way.cos(), 4.0 * way.sin(), 0.0);
            // No vehicle does that by itself: unannounced it would not be believed.
            sim.reset_counter += 1;
            sim.tick(None);
        }
        let line = sim.out().planning.unwrap().goal_world.unwrap() - sim.pos;
        let back = if looks == 0.0 { line.y.atan2(line.x) } else { left - looks };
        let off_by = goshawk_core::values::geometry::wrap(back - sim.out().yaw_des);
        assert!(off_by.abs() < 0.05, "{off}: {off_by}");
    }
}

#[test]
fn a_navigation_that_is_stuck_is_led_aside_and_looks_there() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.start(navigate(Vec3::new(40.0, 0.0, 1.5)));
    sim.until(12.0, |s| s.mode() == Mode::Navigate);
    let aims = |sim: &Loop| sim.out().planning.unwrap().goal_world.unwrap() - sim.pos;
    let goal = aims(&sim);
    sim.run(3.0);
    let aside = aims(&sim);
    let turned = goshawk_core::values::geometry::wrap(aside.y.atan2(aside.x) - goal.y.atan2(goal.x));
    assert!((turned - 1.0).abs() < 0.1, "{turned}");
    assert!(
        goshawk_core::values::geometry::wrap(sim.out().yaw_des - aside.y.atan2(aside.x)).abs() < 0.1,
        "{}",
        sim.out().yaw_des
    );
}

#[test]
fn a_navigation_that_finds_no_way_holds_until_it_is_told_to_go_on_or_to_stop() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.start(navigate(Vec3::new(40.0, 0.0, 1.5)));
    sim.until(12.0, |s| s.mode() == Mode::Navigate);
    sim.until(90.0, |s| s.mode() == Mode::Hold);
    assert_eq!(sim.last_cause(), Cause::NoWay);
    sim.run(5.0);
    assert_eq!(sim.mode(), Mode::Hold);
    sim.tick(Some(Command::Resume));
    sim.until(0.1, |s| s.mode() == Mode::Navigate);
    let goal = sim.out().planning.unwrap().goal_world;
    sim.until(2.5, |s| s.out().planning.unwrap().goal_world != goal);
    sim.stop();
    sim.until(20.0, |s| s.mode() == Mode::Landed);
}

#[test]
fn a_plan_of_the_last_flight_is_not_flown_in_the_next() {
    let mut sim = chasing(Vec3::new(20.0, 0.0, 1.5));
    sim.run(0.5);
    sim.stop();
    sim.until(20.0, |s| s.mode() == Mode::Ready);
    sim.autopilot.offboard = false;
    sim.frames = Frames::None;
    sim.start(track());
    sim.until(12.0, |s| s.mode() == Mode::Search);
    sim.run(3.0);
    assert_eq!(sim.mode(), Mode::Search);
    assert!(sim.out().plan_seq.is_none());
}

#[test]
fn the_command_leads_the_trajectory_by_its_jerk() {
    // What the lead adds, with a trajectory gentle enough for the tilt limit.
    let ahead = |tau: f64| {
        let mut config = common::config();
        config.airframe.attitude_lag_s = tau;
        config.airframe.attitude_lag_range_s = [tau, 1.001 * tau];
        let mut sim = Loop::with(config);
        sim.frames = Frames::Target(Vec3::new(15.0, 0.0, 1.5));
        sim.start(Profile { speed: 3.0, ..track() });
        sim.until(12.0, |s| s.out().plan_seq.is_some());
        let out = sim.out();
        out.acc_att_world + out.acc_disturbance_world - out.acc_des_world
    };
    let unled = common::config().lead.chase_lag_s;
    let [once, twice] = [0.1, 0.2].map(|tau| ahead(unled + tau));
    assert!(once.norm() > 0.1 && (once * 2.0 - twice).norm() < 1e-6);
}
