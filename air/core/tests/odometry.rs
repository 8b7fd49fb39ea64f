//! Odometry that is false, in a closed loop: it is named, and braked, levelled or handed back.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{DT, Frames, Loop, navigate, track};
use goshawk_core::*;
use proptest::prelude::*;

/// Flies at 5 m/s or so toward a goal.
fn navigating() -> Loop {
    let mut sim = Loop::new();
    sim.frames = Frames::Goal;
    sim.start(navigate(Vec3::new(80.0, 0.0, 2.0)));
    sim.until(12.0, |s| s.mode() == Mode::Navigate);
    sim.run(3.0);
    assert!(sim.vel.norm() > 3.0 && sim.out().odometry_fault.is_none());
    sim
}

/// Runs until something is named; which, and after how many seconds.
fn named(sim: &mut Loop, limit: f64) -> (OdometryFault, f64) {
    let since = sim.seconds();
    sim.until(limit, |s| s.out().odometry_fault.is_some());
    (sim.out().odometry_fault.unwrap(), sim.seconds() - since)
}

#[test]
fn a_velocity_that_steps_is_named_at_once_braked_by_dead_reckoning_and_handed_back() {
    for offset in [Vec3::x(), -Vec3::x(), Vec3::y(), -Vec3::y()] {
        let mut sim = navigating();
        sim.velocity_offset = offset * 3.0;
        let (fault, after) = named(&mut sim, 1.0);
        assert!(fault == OdometryFault::VelocityStepped && after < 0.03, "{fault} after {after} s");
        assert_eq!(sim.out().fallback, Fallback::OdometryFalseBrake);
        sim.until(1.6, |s| s.mode() == Mode::Fault);
        assert!(sim.vel.xy().norm() < 1.0, "it has stopped but for {}", sim.vel);
        assert_eq!((sim.last_cause(), sim.out().setpoint), (Cause::OdometryFalse, None));
        assert!(sim.requests.iter().any(|r| r.1 == Request::HandBack));
    }
}

#[test]
fn a_drift_of_1_mps_is_named_within_a_second_and_ends_like_it() {
    let mut sim = navigating();
    let since = sim.seconds();
    while sim.out().odometry_fault.is_none() {
        sim.odometry_offset += Vec3::y() * DT;
        sim.tick(None);
        assert!(sim.seconds() - since < 1.0);
    }
    assert_eq!(sim.out().odometry_fault, Some(OdometryFault::PositionDisagrees));
    while sim.mode() != Mode::Fault {
        sim.odometry_offset += Vec3::y() * DT;
        sim.tick(None);
    }
    assert!(sim.vel.xy().norm() < 1.0 && sim.last_cause() == Cause::OdometryFalse, "{}", sim.vel);
}

#[test]
fn a_jump_without_a_word_is_named_and_flown_on() {
    for offset in [Vec3::new(3.0, -4.0, 0.0), Vec3::z(), -Vec3::z()] {
        let mut sim = navigating();
        sim.odometry_offset = offset;
        let (fault, after) = named(&mut sim, 1.0);
        assert!(fault == OdometryFault::PositionJumped && after < 0.03, "{fault} after {after} s");
        let (height, vel) = (sim.pos.z, sim.vel);
        sim.run(0.1);
        assert_eq!((sim.mode(), sim.out().fallback, sim.out().odometry_fault), (Mode::Navigate, Fallback::None, None));
        assert!((sim.vel - vel).norm() < 0.5 && (sim.pos.z - height).abs() < 0.2);
    }
}

#[test]
fn a_jump_that_is_announced_is_no_fault() {
    let mut sim = navigating();
    (sim.odometry_offset, sim.odometry_turn, sim.velocity_offset) = (Vec3::new(3.0, -4.0, 1.0), 0.8, Vec3::y() * 2.0);
    sim.reset_counter += 1;
    sim.frames = Frames::Blank;
    for _ in 0..100 {
        sim.tick(None);
        assert_eq!(sim.out().odometry_fault, None);
        sim.velocity_offset = Vec3::zeros();
        sim.reset_counter = 2;
    }
}

#[test]
fn a_heading_that_turns_is_braked_by_the_rates_and_handed_back() {
    for error in [std::f64::consts::PI, 1.6, -1.6, -2.5, 0.6] {
        let mut sim = navigating();
        sim.heading_error = error;
        let (fault, after) = named(&mut sim, 1.0);
        assert!(fault == OdometryFault::AttitudeTurned && after < 0.03, "{fault} after {after} s");
        assert_eq!(sim.out().fallback, Fallback::OdometryFalseBrake);
        let (speed, height) = (sim.vel.norm(), sim.pos.z);
        while sim.mode() != Mode::Fault {
            sim.tick(None);
            assert!(sim.vel.norm() < speed + 0.5, "{error}: {}", sim.vel);
        }
        assert!(sim.vel.xy().norm() < 1.2 && sim.last_cause() == Cause::OdometryFalse, "{error}: {}", sim.vel);
        assert!((sim.pos.z - height).abs() < 1.0, "{error}: {} of {height}", sim.pos.z);
    }
}

#[test]
fn a_loop_that_flies_by_the_true_heading_gains_little_before_it_is_known_to() {
    let mut sim = navigating();
    (sim.heading_error, sim.loop_knows) = (std::f64::consts::PI, true);
    let (_, speed) = (named(&mut sim, 1.0), sim.vel.norm());
    while sim.mode() != Mode::Fault {
        sim.tick(None);
        assert!(sim.vel.norm() < speed + 3.0, "{}", sim.vel);
    }
    assert!(sim.vel.xy().norm() < speed, "{} of {speed}", sim.vel);
}

#[test]
fn an_estimate_that_stands_still_is_braked_by_what_is_commanded() {
    for wind in [Vec3::zeros(), Vec3::new(1.0, -0.7, 0.0)] {
        let mut sim = navigating();
        sim.wind = wind;
        sim.run(1.0);
        (sim.frozen, sim.lag) = (true, 0.1);
        let (fault, after) = named(&mut sim, 1.0);
        // At this speed a position that stands may show first.
        let names = [OdometryFault::Frozen, OdometryFault::PositionDisagrees];
        assert!(names.contains(&fault) && after < 0.15, "{fault} after {after} s");
        assert_eq!(sim.out().fallback, Fallback::OdometryFalseBrake);
        let height = sim.pos.z;
        sim.until(1.6, |s| s.mode() == Mode::Fault);
        assert!(sim.vel.xy().norm() < 1.7, "{}", sim.vel);
        assert!((sim.pos.z - height).abs() < 1.0, "{} of {height}", sim.pos.z);
    }
}

#[test]
fn a_heading_that_was_wrong_from_the_start_is_named_before_it_is_fast() {
    for error in [1.6, 2.4, std::f64::consts::PI, -1.6] {
        let mut sim = Loop::new();
        (sim.heading_error, sim.frames) = (error, Frames::Blank);
        sim.wind = Vec3::new(0.3, 0.2, 0.0);
        sim.start(track());
        let (fault, _) = named(&mut sim, 12.0);
        assert_eq!(fault, OdometryFault::HeadingDisagrees, "{error}");
        assert!(sim.vel.xy().norm() < 3.0, "{error}: {}", sim.vel);
        sim.until(2.0, |s| s.mode() == Mode::Fault);
        assert!(sim.last_cause() == Cause::OdometryFalse && sim.vel.xy().norm() < 1.2, "{error}: {}", sim.vel);
    }
}

#[test]
fn a_short_glitch_is_braked_and_then_flown_on() {
    let mut sim = navigating();
    sim.velocity_offset = Vec3::y() * 3.0;
    sim.run(0.1);
    sim.velocity_offset = Vec3::zeros();
    sim.run(0.1);
    assert_eq!(sim.out().fallback, Fallback::OdometryFalseBrake);
    sim.run(1.3);
    assert_eq!((sim.mode(), sim.out().fallback, sim.out().odometry_fault), (Mode::Navigate, Fallback::None, None));
}

#[test]
fn false_odometry_in_a_landing_hands_back_too() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    let mut high = track();
    high.height = 8.0;
    sim.start(high);
    sim.until(20.0, |s| s.mode() == Mode::Search);
    sim.stop();
    sim.run(2.0);
    assert_eq!(sim.mode(), Mode::Stopping);
    sim.odometry_offset = Vec3::zeros();
    while sim.mode() == Mode::Stopping {
        sim.odometry_offset += Vec3::x() * DT;
        sim.tick(None);
    }
    assert_eq!((sim.mode(), sim.last_cause()), (Mode::Fault, Cause::OdometryFalse));
}

#[test]
fn on_the_ground_an_estimate_may_settle_as_it_likes() {
    let mut sim = Loop::new();
    for k in 0..200 {
        sim.odometry_offset = Vec3::x() * (0.1 * f64::from(k));
        sim.velocity_offset = Vec3::y() * f64::from(k % 7);
        let output = sim.tick(None);
        assert_eq!(output.odometry_fault, None);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    /// Steps of 3 m/s² are what a gust of 5 m/s does at the most to a vehicle of this size.
    #[test]
    fn gusts_a_lag_of_300_ms_and_a_fifth_more_or_less_mass_are_no_fault(
        gusts in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, -1.0..1.0f64), 12), lag in 0.05..0.3f64,
        heaviness in 0.8..1.25f64
    ) {
        let mut config = common::config();
        config.limits.fence_radius_m = 1000.0;
        let mut sim = Loop::with(config);
        (sim.lag, sim.heaviness, sim.frames) = (lag, heaviness, Frames::Blank);
        sim.start(track());
        for (k, gust) in gusts.iter().enumerate() {
            sim.wind = Vec3::new(gust.0, gust.1, gust.2);
            if sim.mode() != Mode::Takeoff {
                let side = if k % 2 == 0 { 6.0 } else { -6.0 };
                sim.frames = Frames::Target(sim.pos + Vec3::new(8.0, side, 0.0));
            }
            for _ in 0..200 {
                let output = sim.tick(None);
                prop_assert_eq!(output.odometry_fault, None, "doubt {}", output.odometry_doubt);
            }
        }
    }
}
