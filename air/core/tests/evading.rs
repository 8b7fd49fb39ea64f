//! What moves in the way of a flight, in a closed loop with the controller.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{Frames, Loop, track};
use goshawk_core::planning::evade::Evasion;
use goshawk_core::*;

fn level(vel_world: Vec3) -> Option<Evasion> {
    Some(Evasion { vel_world, height: None, from_target: false })
}

/// Holds beside a target; no vehicle may fly faster than `max_speed`, m/s.
fn holding(max_speed: f64) -> Loop {
    holding_below(max_speed, common::config().limits.ceiling_m)
}

/// And none higher than the ceiling, m.
fn holding_below(max_speed: f64, ceiling: f64) -> Loop {
    let mut config = common::config();
    (config.limits.max_speed_mps, config.limits.ceiling_m) = (max_speed, ceiling);
    holding_with(config)
}

fn holding_with(config: ControllerConfig) -> Loop {
    let speed = config.limits.max_speed_mps.min(4.0);
    let mut sim = Loop::with(config);
    sim.frames = Frames::Blank;
    sim.start(Profile { speed, ..track() });
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
    sim.evades = level(Vec3::y() * 2.5);
    sim.run(0.9);
    assert!((sim.pos - held).y > 1.2, "{}", sim.pos - held);
    sim.evades = None;
    sim.run(3.0);
    assert!(sim.vel.norm() < 0.2, "{}", sim.vel);
}

#[test]
fn out_of_the_way_it_flies_no_faster_than_the_limit() {
    let fastest = |max_speed: f64| {
        let mut sim = holding(max_speed);
        sim.evades = level(Vec3::y() * 9.0);
        let speed = |sim: &mut Loop| {
            sim.tick(None);
            sim.vel.norm()
        };
        (0..300).map(|_| speed(&mut sim)).fold(0.0, f64::max)
    };
    assert!(fastest(20.0) > 5.0, "{}", fastest(20.0));
    assert!(fastest(3.0) < 3.5, "{}", fastest(3.0));
}

#[test]
fn it_steps_over_a_target_within_a_second_and_never_to_the_ceiling() {
    let over = Some(Evasion { vel_world: Vec3::zeros(), height: Some(4.0), from_target: true });
    let mut sim = holding(8.0);
    let before = sim.pos.z;
    sim.evades = over;
    sim.run(0.8);
    assert!(sim.pos.z - before > 1.2, "{} from {before}", sim.pos.z);
    for ceiling in [3.5, 4.0, 4.6, 5.5] {
        let mut low = holding_below(8.0, ceiling);
        low.evades = over;
        let highest = |low: &mut Loop| {
            low.tick(None);
            low.pos.z
        };
        let most = (0..600).map(|_| highest(&mut low)).fold(0.0, f64::max);
        assert!(low.mode() == Mode::Hold && most < ceiling, "{:?} {most} below {ceiling}", low.mode());
    }
}

#[test]
fn a_hover_that_was_asked_for_and_a_landing_keep_away_from_who_comes_near() {
    let nearest = |command: Command, on_stop: StopAction| {
        let mut config = common::config();
        config.mission.on_stop = on_stop;
        let mut sim = holding_with(config);
        assert_eq!(sim.tick(Some(command)).reply, Some(Ok(())));
        sim.run(if command == Command::Hold { 6.0 } else { 0.5 });
        // Somebody walks up to it, and stands there.
        let (from, mut gap_m) = (sim.pos + Vec3::new(6.0, 0.0, 0.0), f64::INFINITY);
        for tick in 0..600 {
            let walked = Vec3::new(-1.0, 0.0, 0.0) * (f64::from(tick) * 0.005 * 2.0).min(5.0);
            sim.frames = Frames::Target(from + walked);
            sim.target_vel = if walked.x > -5.0 { Vec3::new(-2.0, 0.0, 0.0) } else { Vec3::zeros() };
            sim.tick(None);
            gap_m = gap_m.min((sim.pos - from - walked).xy().norm());
        }
        gap_m
    };
    let least_m = common::config().separation.min_distance;
    for (command, on_stop) in
        [(Command::Hold, StopAction::Land), (Command::Stop, StopAction::Hover), (Command::Stop, StopAction::Land)]
    {
        let gap_m = nearest(command, on_stop);
        assert!(gap_m > 0.8 * least_m, "{command:?} {on_stop:?}: {gap_m}");
    }
}

#[test]
fn the_next_plan_begins_with_what_the_least_distance_leaves_of_this_one() {
    let mut sim = Loop::new();
    let target = Vec3::new(30.0, -2.0, 1.5);
    sim.frames = Frames::Target(target);
    sim.start(track());
    let (mut free, mut held_back) = (0, 0);
    for _ in 0..3000 {
        sim.tick(None);
        let out = sim.out();
        if out.plan_seq.is_none() {
            continue;
        }
        let toward = (target - sim.pos).xy().normalize();
        let commanded = out.acc_att_world + out.acc_disturbance_world;
        let [asked, kept, commanded] =
            [out.acc_des_world, out.acc_kept_world, commanded].map(|acc| acc.xy().dot(&toward));
        assert!(kept <= asked + 1e-9, "{kept} of {asked}");
        free += u32::from(out.acc_kept_world == out.acc_des_world);
        if kept < asked - 1.0 {
            held_back += 1;
            assert!((kept - commanded - 3.0).abs() < 0.3, "{kept}, and {commanded} is commanded");
        }
    }
    assert!(free > 100 && held_back > 10, "{free} {held_back}");
}

#[test]
fn out_of_a_movers_way_the_least_distance_to_the_target_is_kept() {
    let nearest = |from_target: bool| {
        let mut sim = holding(8.0);
        let target = Vec3::new(12.0, 0.0, 1.5);
        sim.evades = Some(Evasion { vel_world: (target - sim.pos).normalize() * 2.5, height: None, from_target });
        let gap = |sim: &mut Loop| {
            sim.tick(None);
            (sim.pos - target).norm()
        };
        (0..300).map(|_| gap(&mut sim)).fold(f64::INFINITY, f64::min)
    };
    assert!(nearest(true) < 1.0, "nothing else keeps it off: {}", nearest(true));
    assert!(nearest(false) > 1.5, "{}", nearest(false));
}
