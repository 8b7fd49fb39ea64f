//! The target filter: detections in, one estimate out.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use goshawk_core::planning::target::{Detection, TargetFilter};
use goshawk_core::values::jump::Jump;
use goshawk_core::*;
use proptest::prelude::*;

fn config() -> TargetConfig {
    common::planner_config(Task::Track).planning.target
}

fn seen(pos_world: Vec3) -> [Option<Detection>; 2] {
    seen_as(pos_world, 0.9)
}

fn seen_as(pos_world: Vec3, objectness: f64) -> [Option<Detection>; 2] {
    [Some(Detection { pos_world, sight_world: pos_world, objectness }), None]
}

/// Frames at 30 Hz; `what(t)` is the detection.
fn watch(filter: &mut TargetFilter, from: f64, frames: u32, what: impl Fn(f64) -> [Option<Detection>; 2]) -> [bool; 2] {
    let mut consistent = [false; 2];
    for k in 0..frames {
        let t = from + f64::from(k) / 30.0;
        filter.step(Time::from_secs(t), &what(t), &mut consistent);
    }
    consistent
}

fn confirmed_at(pos: Vec3) -> TargetFilter {
    let mut filter = TargetFilter::new(config(), Extensions::ALL);
    watch(&mut filter, 0.0, 30, |_| seen(pos));
    assert!(filter.estimate().unwrap().confirmed);
    filter
}

#[test]
fn four_of_six_frames_confirm_and_three_do_not() {
    let mut filter = TargetFilter::new(config(), Extensions::ALL);
    let here = Vec3::new(5.0, 0.0, 1.0);
    assert_eq!(watch(&mut filter, 0.0, 3, |_| seen(here)), [false, false]);
    assert!(!filter.estimate().unwrap().confirmed);
    assert_eq!(watch(&mut filter, 0.1, 1, |_| seen(here)), [true, false]);
    assert!(filter.estimate().unwrap().confirmed);
}

#[test]
fn a_target_is_lost_in_a_gap_between_frames_as_in_blank_ones() {
    let mut filter = confirmed_at(Vec3::new(5.0, 0.0, 1.0));
    let branch = Vec3::new(8.0, 6.0, 1.0);
    assert_eq!(watch(&mut filter, 2.5, 1, |_| seen_as(branch, 0.6)), [false, false]);
    assert!(!filter.estimate().unwrap().confirmed);
    let back = Vec3::new(6.0, 1.0, 1.0);
    watch(&mut filter, 2.6, 12, |_| seen_as(back, 0.99));
    let found = filter.estimate().unwrap();
    assert!(found.confirmed && (found.pos_world - back).norm() < 0.3, "{found:?}");
}

#[test]
fn a_constant_velocity_is_learned() {
    let mut filter = TargetFilter::new(config(), Extensions::ALL);
    let path = |t: f64| Vec3::new(5.0 + 4.0 * t, -2.0 * t, 1.0);
    watch(&mut filter, 0.0, 60, |t| seen(path(t)));
    let estimate = filter.estimate().unwrap();
    assert!((estimate.vel_world - Vec3::new(4.0, -2.0, 0.0)).norm() < 0.05);
    assert!((estimate.pos_world - path(59.0 / 30.0)).norm() < 0.02);
}

#[test]
fn a_false_positive_far_away_is_not_consistent() {
    let mut filter = confirmed_at(Vec3::new(5.0, 0.0, 1.0));
    assert_eq!(watch(&mut filter, 1.0, 1, |_| seen(Vec3::new(8.0, 4.0, 1.0))), [false, false]);
    assert!((filter.estimate().unwrap().pos_world - Vec3::new(5.0, 0.0, 1.0)).norm() < 0.1);
}

#[test]
fn short_blindness_keeps_the_target_and_long_blindness_loses_it() {
    let mut filter = confirmed_at(Vec3::new(5.0, 0.0, 1.0));
    watch(&mut filter, 1.0, 13, |_| [None; 2]);
    assert!(filter.estimate().unwrap().confirmed);
    watch(&mut filter, 1.0 + 13.0 / 30.0, 5, |_| [None; 2]);
    let lost = filter.estimate().unwrap();
    assert!(!lost.confirmed);
    assert!((lost.pos_world - Vec3::new(5.0, 0.0, 1.0)).norm() < 0.2);
}

#[test]
fn a_lost_target_is_taken_again_only_where_it_can_have_run() {
    let mut filter = confirmed_at(Vec3::new(5.0, 0.0, 1.0));
    watch(&mut filter, 1.0, 24, |_| [None; 2]); // lost at about 1.5 s, now 1.8 s
    watch(&mut filter, 1.8, 6, |_| seen(Vec3::new(0.0, 19.0, 1.0)));
    assert!(!filter.estimate().unwrap().confirmed, "20 m in 0.8 s");
    watch(&mut filter, 2.0, 6, |_| seen(Vec3::new(8.0, 2.0, 1.0)));
    assert!(filter.estimate().unwrap().confirmed);
}

#[test]
fn what_looks_little_like_the_target_is_never_believed() {
    let mut filter = TargetFilter::new(config(), Extensions::ALL);
    watch(&mut filter, 0.0, 60, |_| seen_as(Vec3::new(5.0, 0.0, 1.0), 0.85));
    assert!(!filter.estimate().unwrap().confirmed);
}

#[test]
fn a_track_that_went_astray_gives_way_to_what_can_only_be_the_target() {
    let truth = Vec3::new(8.0, 4.0, 1.0);
    for (objectness, taken) in [(1.0, true), (0.95, false)] {
        let mut filter = confirmed_at(Vec3::new(5.0, 0.0, 1.0));
        watch(&mut filter, 1.0, 10, |_| seen_as(truth, objectness));
        let held = filter.estimate().unwrap();
        assert!(held.confirmed, "a third of a second");
        assert_eq!((held.pos_world - truth).norm() < 0.5, taken, "{held:?}");
    }
}

#[test]
fn beyond_its_reach_a_lost_target_is_taken_again_only_if_it_is_sure() {
    for (objectness, taken) in [(1.0, true), (0.95, false)] {
        let mut filter = confirmed_at(Vec3::new(5.0, 0.0, 1.0));
        watch(&mut filter, 1.0, 20, |_| [None; 2]);
        watch(&mut filter, 1.67, 6, |_| seen_as(Vec3::new(-5.0, 8.0, 1.0), objectness));
        assert_eq!(filter.estimate().unwrap().confirmed, taken);
    }
}

/// How far a target, seen for a second at 5 m, has moved after it was seen for two frames `off` of there.
fn moved(off: Vec3, objectness: f64, doubt: f64) -> f64 {
    let here = Vec3::new(5.0, 0.0, 0.0);
    let mut filter = TargetFilter::new(TargetConfig { doubt, ..config() }, Extensions::ALL);
    watch(&mut filter, 0.0, 30, |_| seen(here));
    assert_eq!(watch(&mut filter, 1.0, 2, |_| seen_as(here + off, objectness)), [true, false], "inside the gate");
    (filter.estimate().unwrap().pos_world - here).norm()
}

#[test]
fn a_doubtful_detection_moves_the_target_less_and_its_range_less_than_its_bearing() {
    let (along, aside) = (Vec3::new(0.5, 0.0, 0.0), Vec3::new(0.0, 0.5, 0.0));
    assert!(moved(along, 0.6, 16.0) < 0.5 * moved(along, 1.0, 16.0));
    assert_eq!(moved(along, 0.6, 0.0), moved(along, 1.0, 0.0), "the doubt is what tells them apart");
    assert!(moved(aside, 0.6, 16.0) > 1.3 * moved(along, 0.6, 16.0));
}

#[test]
fn an_outlier_moves_the_target_less_than_its_share() {
    let moved = |x: f64| moved(Vec3::new(x, 0.0, 0.0), 1.0, 16.0);
    assert!(moved(0.4) > 1.9 * moved(0.2), "no outliers: in proportion");
    assert!(moved(1.6) < 6.0 * moved(0.2), "not eight times as far");
}

#[test]
fn what_is_doubtful_must_be_where_the_target_is_as_what_is_sure() {
    for objectness in [1.0, 0.3] {
        let mut filter = confirmed_at(Vec3::new(5.0, 0.0, 1.0));
        let branch = Vec3::new(2.0, 0.0, 0.6);
        assert_eq!(watch(&mut filter, 1.0, 1, |_| seen_as(branch, objectness)), [false, false]);
    }
}

#[test]
fn of_two_cells_that_see_the_target_the_surer_is_taken() {
    let (here, aside) = (Vec3::new(5.0, 0.0, 1.0), Vec3::new(5.0, 0.3, 1.0));
    for (first, y) in [(0.99, 0.0..0.05), (0.6, 0.05..0.3)] {
        let mut filter = confirmed_at(here);
        let both = [seen_as(here, first)[0], seen_as(aside, 0.8)[0]];
        assert_eq!(watch(&mut filter, 1.0, 3, |_| both), [true, true]);
        assert!(y.contains(&filter.estimate().unwrap().pos_world.y.max(0.0)), "{:?}", filter.estimate());
    }
}

#[test]
fn an_odometry_jump_moves_the_target_along() {
    let mut filter = confirmed_at(Vec3::new(5.0, 0.0, 1.0));
    let moved = |y: f64| Jump { pos_world: Vec3::new(0.0, y, 0.0), ..Jump::default() };
    filter.shift(&moved(30.0));
    assert!(!watch(&mut filter, 1.0, 1, |_| seen(Vec3::new(5.0, 30.0, 1.0)))[0], "beyond max_distance");
    filter.shift(&moved(-20.0));
    assert_eq!(watch(&mut filter, 1.1, 1, |_| seen(Vec3::new(5.0, 10.0, 1.0))), [true, false]);
}

proptest! {
    #[test]
    fn any_detections_keep_the_estimate_finite_slow_and_certain(
        points in prop::collection::vec(prop::array::uniform3(prop::num::f64::ANY), 1..40),
        near in prop::collection::vec(prop::array::uniform3(-3.0..3.0), 40), step in 0.0..2.0
    ) {
        let mut filter = TargetFilter::new(config(), Extensions::ALL);
        let mut consistent = [false; 2];
        for (k, point) in points.iter().enumerate() {
            let (wild, tame) = (Vec3::from(*point), Vec3::from(near[k]));
            let detections = [
                Some(Detection { pos_world: wild, sight_world: wild, objectness: 0.9 }),
                Some(Detection { pos_world: tame, sight_world: tame, objectness: 0.6 + tame.x }),
            ];
            filter.step(Time::from_secs(step * k as f64), &detections, &mut consistent);
            if let Some(e) = filter.estimate() {
                prop_assert!(e.pos_world.iter().all(|x| x.is_finite()));
                prop_assert!(e.vel_world.norm() <= config().max_speed_mps + 1e-9);
                prop_assert!(e.covariance.diagonal().iter().all(|v| *v > 0.0 && v.is_finite()));
            }
        }
    }
}

#[test]
fn a_look_tells_what_was_taken_how_far_off_it_is_and_what_the_rival_lacks() {
    let here = Vec3::new(5.0, 0.0, 1.0);
    let mut filter = confirmed_at(here);
    let off = Vec3::new(0.0, 0.2, 0.0);
    let beside = here + Vec3::new(1.0, 4.0, 0.0);
    let both = |sure: f64| [seen(here + off)[0], seen_as(beside, sure)[0]];
    watch(&mut filter, 1.0, 1, |_| both(0.5));
    let look = filter.look().unwrap();
    assert_eq!((look.detections, look.passed), (2, 1));
    let taken = look.taken.unwrap();
    assert!((taken.innovation_world - off).norm() < 0.05 && taken.objectness == 0.9);
    assert!(taken.sigmas > 0.0 && taken.sigmas < look.gate_sigmas);
    // What is surer by far takes the place as soon as its mean reaches what was told, and not before.
    let mut rival = look.rival.unwrap();
    assert!((rival.pos_world - beside).norm() < 1e-9 && rival.objectness == 0.5);
    for k in 0..60 {
        let before = rival;
        watch(&mut filter, 1.1 + f64::from(k) / 30.0, 1, |_| [seen_as(here, 0.3)[0], seen_as(beside, 1.0)[0]]);
        let Some(now) = filter.look().unwrap().rival else {
            assert!(before.objectness < before.needed && (filter.estimate().unwrap().pos_world - beside).norm() < 0.5);
            return;
        };
        rival = now;
        assert!(rival.objectness < rival.needed, "{rival:?}");
    }
    panic!("it never took the place: {rival:?}");
}

#[test]
fn before_the_first_detection_there_is_no_look() {
    let mut filter = TargetFilter::new(config(), Extensions::ALL);
    watch(&mut filter, 0.0, 1, |_| seen(Vec3::new(5.0, 0.0, 1.0)));
    assert_eq!(filter.look(), None);
}
