//! The planner: frames in, plans out.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use goshawk_core::planning::nearest::{COLUMNS, ROWS};
use goshawk_core::*;
use proptest::prelude::*;

fn planner(task: Task) -> Planner {
    Planner::new(common::planner_config(task)).unwrap()
}

fn odometry(stamp: f64) -> Odometry {
    Odometry { stamp: Time::from_secs(stamp), ..common::odometry() }
}

/// All cells empty but those of `held`, whose costs are given.
fn network(held: &[(usize, f32)]) -> NetworkOutput {
    let mut values = [0.0; MAX_CHANNELS * ANCHORS];
    for index in 0..ANCHORS {
        values[9 * ANCHORS + index] = 5.0;
        values[10 * ANCHORS + index] = -4.0;
    }
    for (index, cost) in held {
        values[9 * ANCHORS + index] = *cost;
        values[10 * ANCHORS + index] = 4.0;
    }
    NetworkOutput { values }
}

fn frames(planner: &mut Planner, from: u64, count: u64, network: &NetworkOutput) -> Plan {
    let mut plan = None;
    for seq in from..from + count {
        let odometry = odometry(seq as f64 / 30.0);
        plan = Some(planner.see(&common::frame(seq, odometry)).answer(network));
    }
    plan.unwrap()
}

#[test]
fn a_target_is_chased_once_confirmed_in_the_cheapest_cell_of_all() {
    let mut planner = planner(Task::Track);
    let mut seen = network(&[(7, 6.0)]);
    let early = frames(&mut planner, 0, 3, &seen);
    assert_eq!((early.chosen, early.candidates[7].rejection), (None, Some(Rejection::Gate)));
    assert_eq!(early.candidates[0].rejection, Some(Rejection::Objectness));
    seen.values[9 * ANCHORS + 4] = 1.0;
    let plan = frames(&mut planner, 3, 1, &seen);
    assert_eq!((plan.chosen, plan.candidates[4].rejection), (Some(4), None));
    assert_eq!(plan.candidates[7].rejection, Some(Rejection::Cost));
    assert!(plan.target.unwrap().confirmed);
    assert_eq!(plan.start.pos, odometry(0.0).pos_world);
}

#[test]
fn a_detection_elsewhere_does_not_move_the_target() {
    let mut planner = planner(Task::Track);
    let before = frames(&mut planner, 0, 6, &network(&[(7, 1.0)])).target.unwrap();
    let after = frames(&mut planner, 6, 1, &network(&[(7, 1.0), (10, 0.0)])).target.unwrap();
    assert!((after.pos_world - before.pos_world).norm() < 0.3, "{before:?} {after:?}");
}

#[test]
fn what_was_taken_for_the_target_gives_way_to_what_is_seen_more_clearly() {
    let place = |plan: &Plan| plan.target.unwrap().pos_world;
    let mut planner = planner(Task::Track);
    // A post is taken for the target, and then seen with half a doubt when the target itself appears.
    let wrong = place(&frames(&mut planner, 0, 8, &network(&[(7, 1.0)])));
    let mut both = network(&[(7, 1.0), (10, 1.0)]);
    both.values[10 * ANCHORS + 7] = 0.2;
    let right = frames(&mut planner, 8, 20, &both);
    assert!((place(&right) - wrong).norm() > 2.0 && right.target.unwrap().confirmed, "{right:?}");
}

#[test]
fn what_is_never_believed_does_not_hide_the_target() {
    let mut planner = planner(Task::Track);
    let mut post = network(&[(7, 1.0)]);
    post.values[10 * ANCHORS + 7] = 1.5; // 0.82
    assert!(!frames(&mut planner, 0, 20, &post).target.unwrap().confirmed);
    let mut both = network(&[(7, 1.0), (10, 1.0)]);
    both.values[10 * ANCHORS + 7] = 1.5;
    let right = frames(&mut planner, 20, 6, &both);
    assert!(right.target.unwrap().confirmed && right.chosen.is_some());
}

#[test]
fn a_target_that_is_seen_gives_way_to_nothing_and_a_hidden_one_to_nothing_doubtful() {
    let place = |plan: &Plan| plan.target.unwrap().pos_world;
    let mut planner = planner(Task::Track);
    let before = place(&frames(&mut planner, 0, 8, &network(&[(7, 1.0)])));
    let seen = frames(&mut planner, 8, 60, &network(&[(7, 1.0), (10, 0.0)]));
    assert!((place(&seen) - before).norm() < 0.3, "equally clear");
    let mut hidden = network(&[(10, 0.0)]);
    hidden.values[10 * ANCHORS + 10] = -0.2;
    let lost = frames(&mut planner, 68, 12, &hidden);
    assert!((place(&lost) - before).norm() < 0.3, "0.45");
}

#[test]
fn a_hidden_target_is_pursued_to_where_it_should_be_and_not_for_ever() {
    let mut planner = planner(Task::Track);
    let at = |planner: &mut Planner, seq: u64| {
        let frame = common::frame(seq, odometry(seq as f64 / 30.0));
        let state = *planner.see(&frame).state();
        Vec3::new(state[9].into(), state[10].into(), state[11].into())
    };
    assert_eq!(at(&mut planner, 0), Vec3::zeros(), "nobody is known");
    frames(&mut planner, 0, 6, &network(&[(7, 1.0)]));
    let aim = at(&mut planner, 6);
    assert!(aim.x > 0.1 && aim.norm() <= 1.0, "the target of the middle cell is ahead: {aim}");
    assert!(frames(&mut planner, 6, 60, &network(&[])).chosen.is_some());
    assert!(at(&mut planner, 66).x > 0.1);
    assert_eq!(frames(&mut planner, 66, 30, &network(&[])).chosen, None);
    assert_eq!(at(&mut planner, 96), Vec3::zeros());
}

#[test]
fn a_missed_frame_keeps_the_target() {
    let mut planner = planner(Task::Track);
    frames(&mut planner, 0, 6, &network(&[(7, 1.0)]));
    let plan = frames(&mut planner, 6, 1, &network(&[]));
    assert!(plan.chosen.is_some() && plan.target.unwrap().confirmed);
}

/// Shows the planner, which looks along x, something 2.5 m ahead.
fn show_a_thing_ahead(planner: &mut Planner, odometry: Odometry) {
    let mut nearest = [9000; COLUMNS * ROWS];
    for row in 0..ROWS {
        nearest[row * COLUMNS + COLUMNS / 2 - 1..][..2].fill(2500);
    }
    let frame = FrameInput { nearest, ..common::frame(0, odometry) };
    for _ in 0..3 {
        let _ = planner.see(&frame);
    }
}

#[test]
fn what_would_meet_something_that_was_seen_is_not_flown() {
    let mut planner = planner(Task::Navigate);
    let output = network(&[(5, 2.0), (7, 0.2)]);
    show_a_thing_ahead(&mut planner, odometry(0.0));
    let plan = frames(&mut planner, 0, 1, &output);
    assert_eq!((plan.chosen, plan.candidates[7].rejection), (Some(5), Some(Rejection::Blocked)));
    assert_eq!(plan.candidates[0].rejection, Some(Rejection::Cost));
}

#[test]
fn what_was_seen_before_a_jump_of_the_odometry_or_a_flight_is_forgotten() {
    let output = network(&[(7, 0.2)]);
    let mut jumped = planner(Task::Navigate);
    show_a_thing_ahead(&mut jumped, Odometry { reset_counter: 1, ..odometry(0.0) });
    assert_eq!(frames(&mut jumped, 1, 1, &output).chosen, Some(7));
    let mut begun = planner(Task::Navigate);
    show_a_thing_ahead(&mut begun, odometry(0.0));
    let next = FrameInput { flight: 1, ..common::frame(1, odometry(1.0 / 30.0)) };
    assert_eq!(begun.see(&next).answer(&output).chosen, Some(7));
}

#[test]
fn navigation_flies_the_cheapest_valid_candidate() {
    let mut planner = planner(Task::Navigate);
    let mut output = network(&[(3, 0.5), (4, 0.2)]);
    assert_eq!(frames(&mut planner, 0, 1, &output).chosen, Some(4));
    output.values[4] = f32::NAN;
    let plan = frames(&mut planner, 1, 1, &output);
    assert_eq!((plan.chosen, plan.candidates[4].rejection), (Some(3), Some(Rejection::Invalid)));
    assert_eq!(plan.candidates[3].objectness, 1.0);
}

#[test]
fn navigation_does_not_climb_over_the_roof_under_which_its_goal_lies() {
    let step = |output: &NetworkOutput, goal_world| {
        let frame = FrameInput { goal_world: Some(goal_world), ..common::frame(0, odometry(0.0)) };
        planner(Task::Navigate).see(&frame).answer(output)
    };
    let level = odometry(0.0).pos_world + Vec3::new(40.0, 0.0, 0.0);
    let high = |index: usize| step(&network(&[]), level).candidates[index].end.pos.z - level.z;
    let (upper, lower) = if high(2) > high(12) { (2, 12) } else { (12, 2) };
    assert!(high(upper) > 1.5 && high(lower) < 0.5, "{} and {}", high(upper), high(lower));
    let output = network(&[(upper, 0.2), (lower, 2.0)]);
    assert_eq!(step(&output, level + Vec3::new(0.0, 0.0, 2.0)).chosen, Some(upper));
    let plan = step(&output, level);
    assert_eq!((plan.chosen, plan.candidates[upper].rejection), (Some(lower), Some(Rejection::Blocked)));
}

#[test]
fn a_network_of_nan_chooses_nothing() {
    for task in [Task::Track, Task::Navigate] {
        let nan = NetworkOutput { values: [f32::NAN; MAX_CHANNELS * ANCHORS] };
        assert_eq!(frames(&mut planner(task), 0, 3, &nan).chosen, None);
    }
}

#[test]
fn the_state_is_seen_from_the_tilted_camera() {
    let frame = FrameInput {
        acc_world: Vec3::new(0.0, 0.0, 1.5),
        speed: 3.0,
        goal_world: Some(Vec3::new(1.0, 7.0, 3.0)),
        ..common::frame(0, odometry(0.0))
    };
    let config = common::planner_config(Task::Navigate);
    let extensions = Extensions { pace: false, ..config.extensions };
    let state = *Planner::new(PlannerConfig { extensions, ..config }).unwrap().see(&frame).state();
    let (sin, cos) = (0.17_f32.sin(), 0.17_f32.cos());
    // alpha 0.5: velocity 2 / 3, acceleration 1.5 / (0.25 * 6) = 1; a camera looking up sees them below and ahead.
    let want = [2.0 / 3.0 * cos, 0.0, -2.0 / 3.0 * sin, sin, 0.0, cos, sin, 0.0, cos, 0.0, 0.5, 0.0, 1.0];
    assert_eq!(state.len(), want.len());
    for (got, want) in state.iter().zip(want) {
        assert!((got - want).abs() < 1e-6, "{state:?}");
    }
}

#[test]
fn the_faster_it_shall_fly_the_less_agile_it_is() {
    let frame = |speed| FrameInput { speed, ..common::frame(0, odometry(0.0)) };
    let agility = |speed| planner(Task::Track).see(&frame(speed)).state()[12];
    assert_eq!(agility(6.0), 1.0);
    // alpha 2: 8 m/s² of 4 * 6.
    assert!((agility(12.0) - 1.0 / 3.0).abs() < 1e-6, "{}", agility(12.0));
}

#[test]
fn an_odometry_jump_does_not_lose_the_target() {
    let mut planner = planner(Task::Track);
    let seen = network(&[(7, 1.0)]);
    frames(&mut planner, 0, 6, &seen);
    let mut jumped = odometry(0.2);
    jumped.pos_world += jumped.vel_world / 30.0 + Vec3::new(0.0, 50.0, 0.0);
    jumped.reset_counter = 1;
    let plan = planner.see(&common::frame(6, jumped)).answer(&seen);
    assert!(plan.chosen.is_some() && plan.target.unwrap().last_seen == plan.stamp);
}

#[test]
fn a_turn_of_the_odometrys_frame_turns_the_target_about_the_vehicle() {
    for announced in [0.4, 0.8, -1.5] {
        let mut planner = planner(Task::Track);
        let seen = network(&[(7, 1.0)]);
        let before = frames(&mut planner, 0, 6, &seen).target.unwrap();
        let mut turned = odometry(0.2);
        turned.world_from_body = Rot::from_axis_angle(&Vec3::z_axis(), announced);
        turned.pos_world += (turned.vel_world + turned.world_from_body * turned.vel_world) / 60.0;
        turned.vel_world = turned.world_from_body * turned.vel_world;
        turned.reset_counter = 1;
        let plan = planner.see(&common::frame(6, turned)).answer(&seen);
        let target = plan.target.unwrap();
        assert_eq!(target.last_seen, plan.stamp, "turned by {announced}");
        let away = |target: &TargetEstimate, from: &Odometry| (target.pos_world - from.pos_world).norm();
        assert!((away(&target, &turned) - away(&before, &odometry(5.0 / 30.0))).abs() < 0.5);
    }
}

proptest! {
    #[test]
    fn no_input_makes_it_panic(
        values in prop::collection::vec(prop::num::f32::ANY, MAX_CHANNELS * ANCHORS),
        pos in prop::array::uniform3(prop::num::f64::ANY), speed in prop::num::f64::ANY, stamp in prop::num::u64::ANY
    ) {
        let mut planner = planner(Task::Track);
        let network = NetworkOutput { values: values.try_into().unwrap() };
        let odometry = Odometry { stamp: Time(stamp), pos_world: Vec3::from(pos), ..odometry(0.0) };
        for seq in 0..8 {
            let frame = FrameInput { acc_world: Vec3::from(pos), speed, ..common::frame(seq, odometry) };
            let plan = planner.see(&frame).answer(&network);
            prop_assert!(plan.duration.is_finite() && plan.duration > 0.0);
        }
    }
}
