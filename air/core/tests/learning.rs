//! What the vehicle file has wrong and flight puts right, in a closed loop: hover thrust and the attitude loop's lag.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{Frames, Loop, track};
use goshawk_core::*;

/// The hover thrust that the loop's vehicle has at `heaviness` 1, and that the configuration says.
const HOVER: f64 = 0.25;

#[test]
fn a_hover_thrust_40_percent_wrong_either_way_climbs_neither_into_the_sky_nor_into_the_ground() {
    for heaviness in [0.6, 0.8, 1.0, 1.25, 1.4] {
        let mut sim = Loop::new();
        (sim.heaviness, sim.frames) = (heaviness, Frames::Blank);
        sim.start(track());
        let mut highest = 0.0_f64;
        while sim.mode() != Mode::Search {
            sim.tick(None);
            highest = highest.max(sim.pos.z);
            assert!(sim.vel.z > -0.3 && sim.vel.z < 1.8, "{heaviness}: {} m/s", sim.vel.z);
            assert!(sim.seconds() < 112.0, "{heaviness}: never up");
        }
        assert!(highest < 1.8, "{heaviness}: {highest} m");
        sim.run(5.0);
        let off = sim.out().hover_thrust / (HOVER * heaviness) - 1.0;
        assert!(off.abs() < 0.03, "{heaviness}: {off}");
        assert!(sim.out().acc_disturbance_world.norm() < 0.3, "the observer has nothing left to take");
        assert!((sim.pos.z - 1.5).abs() < 0.05, "{heaviness}: {}", sim.pos.z);
    }
}

#[test]
fn a_load_taken_up_in_flight_is_carried_by_the_observer_at_once_and_by_the_hover_thrust_later() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.run(5.0);
    sim.heaviness = 1.3;
    sim.run(1.0);
    let (early, push) = (sim.out().hover_thrust, sim.out().acc_disturbance_world.z);
    assert!(early < 1.15 * HOVER && push < -1.0, "{early}, {push}");
    assert!(sim.pos.z > 1.1, "{}", sim.pos.z);
    sim.run(20.0);
    let (late, push) = (sim.out().hover_thrust, sim.out().acc_disturbance_world.z);
    assert!((late / (1.3 * HOVER) - 1.0).abs() < 0.03 && push.abs() < 0.3, "{late}, {push}");
}

#[test]
fn without_odometry_the_learnt_hover_thrust_descends_gently() {
    for heaviness in [0.6, 1.4] {
        let mut sim = Loop::new();
        (sim.heaviness, sim.frames) = (heaviness, Frames::Blank);
        sim.start(track());
        sim.until(12.0, |s| s.mode() == Mode::Search);
        sim.run(8.0);
        sim.odometry_works = false;
        sim.run(1.5);
        assert_eq!(sim.out().fallback, Fallback::OdometryStaleDescend);
        assert!(sim.vel.z < 0.0 && sim.vel.z > -0.8, "{heaviness}: {}", sim.vel.z);
    }
}

#[test]
fn nothing_is_learnt_on_the_ground_or_in_a_landing() {
    let mut sim = Loop::new();
    sim.frames = Frames::Blank;
    sim.start(track());
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.run(5.0);
    sim.stop();
    sim.run(0.5);
    let learnt = (sim.out().hover_thrust, sim.out().attitude_lag);
    sim.until(20.0, |s| s.mode() == Mode::Landed);
    sim.run(5.0);
    assert_eq!((sim.out().hover_thrust, sim.out().attitude_lag), learnt);
}

/// Chases a target that jumps from side to side, so that the vehicle weaves.
fn weave(sim: &mut Loop, seconds: f64) {
    for k in 0..(seconds / 0.6) as u32 {
        let side = if k % 2 == 0 { 6.0 } else { -6.0 };
        sim.frames = Frames::Target(sim.pos + Vec3::new(8.0, side, 0.0));
        sim.run(0.6);
    }
}

#[test]
fn lags_of_50_to_300_ms_are_learnt_in_the_chase_from_a_file_that_says_100() {
    for lag in [0.05, 0.1, 0.2, 0.3] {
        let mut config = common::config();
        config.limits.fence_radius_m = 1000.0;
        let mut sim = Loop::with(config);
        (sim.lag, sim.frames) = (lag, Frames::Blank);
        sim.start(track());
        sim.until(12.0, |s| s.mode() == Mode::Search);
        weave(&mut sim, 8.0);
        assert_eq!(sim.mode(), Mode::Track);
        let learnt = sim.out().attitude_lag;
        assert!((learnt / lag - 1.0).abs() < 0.15, "{lag}: {learnt}");
        sim.frames = Frames::None;
        sim.until(5.0, |s| s.out().fallback == Fallback::HoldPosition);
        sim.run(4.0);
        assert!(sim.vel.norm() < 0.1, "{lag}: it stops");
    }
}

#[test]
fn a_steady_wind_changes_neither_the_lag_nor_the_hover_thrust() {
    let mut sim = Loop::new();
    (sim.frames, sim.wind) = (Frames::Blank, Vec3::new(2.5, -1.0, 0.0));
    sim.start(track());
    sim.until(12.0, |s| s.mode() == Mode::Search);
    sim.run(15.0);
    assert!((sim.out().hover_thrust / HOVER - 1.0).abs() < 0.01, "{}", sim.out().hover_thrust);
    assert!((sim.out().attitude_lag - 0.1).abs() < 0.02, "{}", sim.out().attitude_lag);
}
