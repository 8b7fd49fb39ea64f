//! What moves in the way of a flight, in a closed loop with the controller.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{Frames, Loop, track};
use goshawk_core::*;

/// Holds beside a target; no vehicle may fly faster than `max_speed`, m/s.
fn holding(max_speed: f64) -> Loop {
    let mut config = common::config();
    config.limits.max_speed = max_speed;
    let mut sim = Loop::with(config);
    sim.frames = Frames::Blank;
    sim.start(Profile { speed: max_speed.min(4.0), ..track() });
    sim.until(10.0, |s| s.mode() == Mode::Search);
    sim.frames = Frames::Target(Vec3::new(12.0, 0.0, 1.5));
    sim.until(20.0, |s| s.mode() == Mode::Hold);
    sim.run(3.0);
    sim
}

#[test]
fn who_holds_steps_out_of_the_way_and_stops_when_it_is_free_again() {
    let mut sim = holding(8.0);
    let held = sim.pos;
    sim.run(1.0);
    assert!((sim.pos - held).norm() < 0.1);
    sim.evades = Some(Vec3::y() * 2.5);
    sim.run(0.9);
    assert!((sim.pos - held).y > 0.4, "{}", sim.pos - held);
    sim.evades = None;
    sim.run(3.0);
    assert!(sim.vel.norm() < 0.2, "{}", sim.vel);
}

#[test]
fn out_of_the_way_it_flies_no_faster_than_the_limit() {
    let fastest = |max_speed: f64| {
        let mut sim = holding(max_speed);
        sim.evades = Some(Vec3::y() * 9.0);
        let speed = |sim: &mut Loop| {
            sim.tick(None);
            sim.vel.norm()
        };
        (0..300).map(|_| speed(&mut sim)).fold(0.0, f64::max)
    };
    assert!(fastest(20.0) > 5.0, "{}", fastest(20.0));
    assert!(fastest(3.0) < 3.5, "{}", fastest(3.0));
}
