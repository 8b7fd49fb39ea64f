//! Every limit of a flight, reached in a closed loop.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{Frames, Loop, navigate, track};
use goshawk_core::*;

fn limited(change: impl FnOnce(&mut ControllerConfig)) -> Loop {
    let mut config = common::config();
    change(&mut config);
    let mut sim = Loop::with(config);
    sim.frames = Frames::Blank;
    sim
}

/// Lands from where it is, for `cause`.
fn lands(sim: &mut Loop, cause: Cause) {
    sim.until(30.0, |s| s.mode() == Mode::Stopping);
    assert_eq!(sim.last_cause(), cause);
    sim.until(30.0, |s| s.mode() == Mode::Landed);
}

#[test]
fn a_chase_that_leads_out_of_the_fence_ends_inside_it() {
    let mut sim = limited(|c| c.limits.fence_radius_m = 25.0);
    sim.start(Profile { speed: 10.0, ..track() });
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.frames = Frames::Target(Vec3::new(80.0, 10.0, 1.5));
    let (start, mut farthest, mut fastest) = (Vec3::new(3.0, -2.0, 0.0), 0.0_f64, 0.0_f64);
    while sim.mode() != Mode::Landed {
        sim.tick(None);
        farthest = farthest.max((sim.pos - start).xy().norm());
        fastest = fastest.max(sim.vel.norm());
        assert!(sim.seconds() < 160.0);
    }
    assert!(sim.transitions.iter().any(|t| t.cause == Cause::FenceReached));
    assert!(farthest > 20.0 && farthest <= 25.0, "{farthest} m at up to {fastest} m/s");
}

#[test]
fn a_climb_to_the_ceiling_ends_below_it() {
    let mut sim = limited(|c| c.limits.ceiling_m = 6.0);
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.frames = Frames::Target(Vec3::new(8.0, -2.0, 40.0));
    let mut highest = 0.0_f64;
    while sim.mode() != Mode::Landed {
        sim.tick(None);
        highest = highest.max(sim.pos.z);
        assert!(sim.seconds() < 160.0);
    }
    assert!(sim.transitions.iter().any(|t| t.cause == Cause::CeilingReached));
    assert!(highest > 3.0 && highest <= 6.0, "{highest} m");
}

#[test]
fn no_plan_flies_faster_than_the_limit() {
    let fastest = |limit: f64| {
        let mut sim = limited(|c| {
            c.limits.max_speed_mps = limit;
            c.limits.fence_radius_m = 1e4;
        });
        sim.start(Profile { speed: 6.0, ..navigate(Vec3::new(400.0, 0.0, 1.5)) });
        sim.until(12.0, |s| s.mode() == Mode::Navigate);
        sim.frames = Frames::Goal;
        let mut fastest = 0.0_f64;
        for _ in 0..3000 {
            // Plans that always want more than they have.
            sim.haste = 3.0;
            sim.tick(None);
            fastest = fastest.max(sim.vel.norm());
        }
        fastest
    };
    assert!(fastest(20.0) > 10.0, "{}", fastest(20.0));
    assert!(fastest(7.0) < 7.5, "{}", fastest(7.0));
}

/// How far above its nose the chasing vehicle ever has the target, rad, with the image's upper edge at `top`.
fn highest_sight(top: f64) -> f64 {
    let mut sim = limited(|c| {
        c.view.top = top;
        c.limits.fence_radius_m = 1e4;
    });
    sim.start(Profile { speed: 10.0, ..track() });
    sim.until(12.0, |s| s.mode() == Mode::Search);
    let mut highest = 0.0_f64;
    for _ in 0..800 {
        sim.haste = 3.0;
        let target = sim.pos + Vec3::new(14.0, 0.0, 0.0);
        sim.frames = Frames::Target(target);
        sim.tick(None);
        let line = sim.attitude.inverse() * (target - sim.pos);
        highest = highest.max(line.z.atan2(line.x));
    }
    highest
}

#[test]
fn a_chase_speeds_up_no_harder_than_leaves_the_target_in_the_image() {
    assert!(highest_sight(3.0) > 0.63, "{}: these plans would lose it", highest_sight(3.0));
    let highest = highest_sight(0.63);
    assert!(highest > 0.3 && highest < 0.63, "{highest}");
}

#[test]
fn the_vehicle_never_tilts_beyond_its_limit() {
    let mut sim = limited(|c| {
        c.airframe.max_tilt_deg = 30.0;
        c.limits.fence_radius_m = 1e4;
    });
    sim.wind = Vec3::new(3.0, 0.0, 0.0);
    sim.start(Profile { speed: 10.0, ..track() });
    sim.until(12.0, |s| s.mode() == Mode::Search);
    for k in 0..20 {
        let side = if k % 2 == 0 { 9.0 } else { -9.0 };
        sim.frames = Frames::Target(sim.pos + Vec3::new(-4.0, side, 0.0));
        for _ in 0..80 {
            sim.tick(None);
            let tilt = (sim.attitude * Vec3::z()).z.acos().to_degrees();
            assert!(tilt < 30.0 + 1e-6, "{tilt} degrees");
        }
    }
}

#[test]
fn a_flight_ends_when_its_time_is_up() {
    let mut sim = limited(|c| c.limits.max_time_s = 15.0);
    sim.start(track());
    let begun = sim.seconds();
    sim.until(30.0, |s| s.mode() == Mode::Stopping);
    assert!((sim.seconds() - begun - 15.0).abs() < 0.02);
    lands(&mut sim, Cause::TimeUp);
}

#[test]
fn a_low_battery_refuses_start_and_ends_a_flight_but_one_wrong_report_does_not() {
    let mut sim = limited(|_| {});
    sim.autopilot.battery = Some(0.25);
    sim.run(0.5);
    assert_eq!(sim.tick(Some(Command::Start(track()))).reply, Some(Err(Refusal::BatteryLow)));
    sim.autopilot.battery = Some(0.8);
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.autopilot.battery = Some(0.0);
    sim.run(0.5);
    sim.autopilot.battery = Some(0.2);
    sim.run(3.0);
    assert_eq!(sim.mode(), Mode::Search);
    sim.autopilot.battery = Some(0.14);
    lands(&mut sim, Cause::BatteryLow);
}

#[test]
fn a_silent_autopilot_is_still_sent_setpoints_and_the_vehicle_lands() {
    let mut sim = limited(|_| {});
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.autopilot.connected = false;
    sim.tick(None);
    assert_eq!((sim.mode(), sim.last_cause()), (Mode::Stopping, Cause::AutopilotLost));
    for _ in 0..4000 {
        assert!(sim.mode() == Mode::Landed || sim.out().setpoint.is_some());
        sim.tick(None);
    }
    assert_eq!(sim.pos.z, 0.0);
}

#[test]
fn a_silent_autopilot_before_arming_ends_the_take_off() {
    let mut sim = limited(|_| {});
    sim.start(track());
    sim.run(0.5);
    sim.autopilot.connected = false;
    sim.tick(None);
    assert_eq!((sim.mode(), sim.last_cause()), (Mode::Idle, Cause::AutopilotLost));
    assert_eq!(sim.out().setpoint, None);
}

#[test]
fn a_profile_beyond_the_limits_is_refused() {
    let mut sim = limited(|_| {});
    sim.run(0.5);
    for profile in
        [Profile { speed: 12.5, ..track() }, Profile { height: 21.0, ..track() }, navigate(Vec3::new(101.0, 0.0, 1.0))]
    {
        assert_eq!(sim.tick(Some(Command::Start(profile))).reply, Some(Err(Refusal::BeyondLimits)));
    }
    assert_eq!(sim.mode(), Mode::Ready);
}

#[test]
fn stop_hovers_where_the_vehicle_file_says_so_and_a_second_stop_lands() {
    let mut sim = limited(|c| {
        c.mission.on_stop = StopAction::Hover;
        c.ladder.no_plan_land_s = 3.0;
    });
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.frames = Frames::Target(Vec3::new(30.0, 0.0, 1.5));
    sim.until(1.0, |s| s.mode() == Mode::Track);
    sim.run(2.0);
    sim.stop();
    assert_eq!(sim.mode(), Mode::Hold);
    sim.run(8.0);
    assert_eq!(sim.mode(), Mode::Hold, "neither the target nor missing plans end it");
    assert!(sim.vel.norm() < 0.1 && sim.out().planning.is_none());
    sim.stop();
    lands(&mut sim, Cause::StopCommand);
}

#[test]
fn stop_in_a_hold_hovers_on_and_the_target_is_not_followed_any_more() {
    let mut sim = limited(|c| c.mission.on_stop = StopAction::Hover);
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.frames = Frames::Target(sim.pos + Vec3::new(1.0, 0.0, 0.0));
    sim.target_vel = Vec3::new(-1.0, 0.0, 0.0);
    sim.until(3.0, |s| s.mode() == Mode::Hold);
    sim.stop();
    sim.frames = Frames::Target(Vec3::new(30.0, 0.0, 1.5));
    sim.run(3.0);
    assert_eq!(sim.mode(), Mode::Hold);
}

#[test]
fn the_pilots_hold_stays_whatever_stop_does_until_it_goes_on_or_is_stopped() {
    let mut sim = limited(|c| {
        c.mission.on_stop = StopAction::Land;
        c.ladder.no_plan_land_s = 3.0;
    });
    let chases = |sim: &mut Loop| {
        sim.frames = Frames::Target(sim.pos + Vec3::new(12.0, 0.0, 0.0));
        sim.until(3.0, |s| s.mode() == Mode::Track);
    };
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    chases(&mut sim);
    assert_eq!(sim.tick(Some(Command::Resume)).reply, Some(Err(Refusal::NotHeld)));
    assert_eq!(sim.tick(Some(Command::Hold)).reply, Some(Ok(())));
    assert_eq!((sim.mode(), sim.last_cause()), (Mode::Hold, Cause::HoldCommand));
    sim.run(8.0);
    assert_eq!(sim.mode(), Mode::Hold, "neither the target nor missing plans end it");
    assert!(sim.vel.norm() < 0.1 && sim.out().planning.is_none());
    assert_eq!(sim.tick(Some(Command::Hold)).reply, Some(Ok(())));
    assert_eq!(sim.mode(), Mode::Hold, "held once more, it stays");
    assert_eq!(sim.tick(Some(Command::Start(track()))).reply, Some(Err(Refusal::Flying)));
    assert_eq!(sim.tick(Some(Command::Resume)).reply, Some(Ok(())));
    assert_eq!((sim.mode(), sim.last_cause()), (Mode::Search, Cause::ResumeCommand));
    chases(&mut sim);
    sim.tick(Some(Command::Hold));
    sim.run(2.0);
    sim.stop();
    lands(&mut sim, Cause::StopCommand);
}

#[test]
fn the_pilots_hold_lands_from_the_climb_and_does_nothing_on_the_ground() {
    let mut sim = limited(|_| {});
    sim.run(0.5);
    assert_eq!(sim.tick(Some(Command::Hold)).reply, Some(Ok(())));
    assert_eq!(sim.mode(), Mode::Ready);
    sim.start(track());
    sim.until(5.0, |s| s.mode() == Mode::Takeoff && s.pos.z > 0.5);
    sim.tick(Some(Command::Hold));
    lands(&mut sim, Cause::HoldCommand);
}

#[test]
fn stop_hands_over_where_the_vehicle_file_says_so() {
    let mut sim = limited(|c| c.mission.on_stop = StopAction::HandOver);
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.stop();
    assert_eq!((sim.mode(), sim.last_cause()), (Mode::Fault, Cause::StopCommand));
    assert_eq!(sim.out().setpoint, None);
    assert!(sim.requests.iter().any(|r| r.1 == Request::HandBack) && !sim.autopilot.offboard);
    sim.run(2.0);
    assert_eq!(sim.requests.iter().filter(|r| r.1 == Request::HandBack).count(), 1, "asked until it follows");
}
