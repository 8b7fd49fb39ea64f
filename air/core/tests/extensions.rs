//! What goes beyond the paper can be switched off, each part alone, and each switch does something.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{Frames, Loop, navigate, track};
use goshawk_core::planning::nearest::{COLUMNS, ROWS};
use goshawk_core::*;

const ALL: Extensions = Extensions::ALL;

/// Objectness logits, and costs, of some cells; the others are empty and dear.
fn network(held: &[(usize, f32, f32)]) -> NetworkOutput {
    let mut values = [0.0; MAX_CHANNELS * ANCHORS];
    for index in 0..ANCHORS {
        values[9 * ANCHORS + index] = 5.0;
        values[10 * ANCHORS + index] = -4.0;
    }
    for (index, logit, cost) in held {
        values[9 * ANCHORS + index] = *cost;
        values[10 * ANCHORS + index] = *logit;
    }
    NetworkOutput { values }
}

fn planner(task: Task, extensions: Extensions) -> Planner {
    Planner::new(PlannerConfig { extensions, ..common::planner_config(task) }).unwrap()
}

fn odometry(seq: u64) -> Odometry {
    Odometry { stamp: Time::from_secs(seq as f64 / 30.0), ..common::odometry() }
}

/// Frames `from..to` with one answer; the last plan.
fn plan(planner: &mut Planner, from: u64, to: u64, network: &NetworkOutput) -> Plan {
    (from..to).map(|seq| planner.see(&common::frame(seq, odometry(seq))).answer(network)).last().unwrap()
}

/// What a chase does with and without a part, after six frames that show the target in the middle cell.
fn chased<T>(off: Extensions, then: impl Fn(&mut Planner) -> T) -> [T; 2] {
    [ALL, off].map(|extensions| {
        let mut planner = planner(Task::Track, extensions);
        plan(&mut planner, 0, 6, &network(&[(7, 4.0, 1.0)]));
        then(&mut planner)
    })
}

#[test]
fn the_cheapest_of_all_is_flown_or_of_those_that_show_the_target() {
    let output = network(&[(7, 4.0, 3.0), (4, -4.0, 1.0)]);
    let off = Extensions { choice_among_all: false, ..ALL };
    let [all, seen] = chased(off, |planner| plan(planner, 6, 7, &output));
    assert_eq!((all.chosen, seen.chosen), (Some(4), Some(7)));
    assert_eq!(seen.candidates[4].rejection, Some(Rejection::Objectness));
}

#[test]
fn a_doubtful_detection_moves_the_target_less_or_as_much_as_any() {
    let shift = |extensions: Extensions| {
        let mut planner = planner(Task::Track, extensions);
        let before = plan(&mut planner, 0, 6, &network(&[(7, 4.0, 1.0)])).target.unwrap();
        let mut nearer = network(&[(7, 0.2, 1.0)]);
        nearer.values[13 * ANCHORS + 7] = -0.3;
        (plan(&mut planner, 6, 7, &nearer).target.unwrap().pos_world - before.pos_world).norm()
    };
    let (weighted, alike) = (shift(ALL), shift(Extensions { weighted_detections: false, ..ALL }));
    assert!(alike > 1.5 * weighted, "{weighted} {alike}");
}

#[test]
fn an_outlier_weighs_less_or_as_much_as_any() {
    let shift = |extensions: Extensions| {
        let mut planner = planner(Task::Track, extensions);
        let before = plan(&mut planner, 0, 12, &network(&[(7, 6.0, 1.0)])).target.unwrap();
        let mut nearer = network(&[(7, 6.0, 1.0)]);
        nearer.values[13 * ANCHORS + 7] = -0.45;
        (plan(&mut planner, 12, 13, &nearer).target.unwrap().pos_world - before.pos_world).norm()
    };
    let (less, alike) = (shift(ALL), shift(Extensions { outliers: false, ..ALL }));
    assert!(alike > 1.1 * less, "{less} {alike}");
}

#[test]
fn what_is_seen_more_clearly_takes_the_tracks_place_or_does_not() {
    let both = network(&[(7, 0.2, 1.0), (10, 4.0, 1.0)]);
    let at = |planner: &mut Planner| plan(planner, 6, 26, &both).target.unwrap().pos_world;
    let [gives_way, stays] = chased(Extensions { rivals: false, ..ALL }, at);
    assert!((gives_way - stays).norm() > 2.0, "{gives_way} {stays}");
}

#[test]
fn a_hidden_target_is_pursued_or_is_not() {
    let off = Extensions { pursuit: false, ..ALL };
    let [pursued, let_go] = chased(off, |planner| plan(planner, 6, 21, &network(&[])).chosen);
    assert!(pursued.is_some() && let_go.is_none(), "{pursued:?} {let_go:?}");
}

#[test]
fn a_chase_aims_aside_where_a_pole_would_hide_the_target_or_aims_straight_on() {
    let aims = |pole: bool| {
        let off = Extensions { line_of_sight: false, ..ALL };
        chased(off, |planner| {
            let mut nearest = [9000; COLUMNS * ROWS];
            if pole {
                (0..ROWS).for_each(|row| nearest[row * COLUMNS + COLUMNS / 2 - 1..][..2].fill(2500));
            }
            let frames = (6..10).map(|seq| FrameInput { nearest, ..common::frame(seq, odometry(seq)) });
            frames.map(|frame| *planner.see(&frame).state()).last().unwrap()
        })
    };
    let [open, straight_on] = aims(false);
    assert_eq!(open, straight_on, "nothing hides it");
    let [aside, into_it] = aims(true);
    assert!(aside != into_it && into_it == open);
}

#[test]
fn what_was_seen_is_remembered_or_is_not() {
    let chosen = |extensions: Extensions| {
        let mut planner = planner(Task::Navigate, extensions);
        let mut nearest = [9000; COLUMNS * ROWS];
        (0..ROWS).for_each(|row| nearest[row * COLUMNS + COLUMNS / 2 - 1..][..2].fill(2500));
        let frame = FrameInput { nearest, ..common::frame(0, odometry(0)) };
        (0..3).for_each(|_| drop(planner.see(&frame)));
        let plan = plan(&mut planner, 0, 1, &network(&[(5, 0.0, 2.0), (7, 0.0, 0.2)]));
        (plan.chosen, plan.candidates[7].added.obstacle > 0.0)
    };
    assert_eq!(chosen(ALL), (Some(5), true));
    assert_eq!(chosen(Extensions { obstacle_memory: false, ..ALL }), (Some(7), false));
}

#[test]
fn a_way_over_the_goal_costs_more_or_does_not() {
    let level = odometry(0).pos_world + Vec3::new(40.0, 0.0, 0.0);
    let chosen = |extensions: Extensions| {
        let frame = FrameInput { goal_world: Some(level), ..common::frame(0, odometry(0)) };
        let output = network(&[(2, 0.0, 0.2), (12, 0.0, 2.0)]);
        planner(Task::Navigate, extensions).see(&frame).answer(&output).chosen
    };
    assert_eq!(chosen(ALL), Some(12));
    assert_eq!(chosen(Extensions { no_climbing: false, ..ALL }), Some(2));
}

#[test]
fn the_network_is_told_of_less_acceleration_or_of_all() {
    let agility = |task: Task, speed: f64, extensions: Extensions| {
        let config = common::planner_config(task);
        let mut planning = PlanningConfig { max_agility: 0.7, ..config.planning };
        planning.navigation.max_agility = 3.0;
        let mut planner = Planner::new(PlannerConfig { planning, extensions, ..config }).unwrap();
        let frame = FrameInput { speed, ..common::frame(0, odometry(0)) };
        let state = *planner.see(&frame).state();
        state[12]
    };
    let off = Extensions { agility_limit: false, ..ALL };
    for task in [Task::Track, Task::Navigate] {
        assert!(agility(task, 12.0, ALL) < 0.7);
        assert_eq!(agility(task, 12.0, off), 1.0);
        assert_eq!(agility(task, 2.0, off), 1.0);
    }
    // Who is slow has acceleration to spare. A chase does not use it.
    assert_eq!([Task::Track, Task::Navigate].map(|task| agility(task, 2.0, ALL)), [0.7, 3.0]);
}

#[test]
fn a_navigation_is_asked_for_more_than_the_asked_speed_or_for_that() {
    let planned = |task: Task, extensions: Extensions| {
        let frame = FrameInput { speed: 4.0, ..common::frame(0, odometry(0)) };
        planner(task, extensions).see(&frame).answer(&network(&[])).alpha * 6.0
    };
    assert!(planned(Task::Navigate, ALL) > 4.4);
    for (task, extensions) in [(Task::Navigate, Extensions { pace: false, ..ALL }), (Task::Track, ALL)] {
        assert!((planned(task, extensions) - 4.0).abs() < 1e-9);
    }
}

/// A flight of the closed loop, flown with all and with a part switched off; `what` is told of it.
fn flown<T>(off: Extensions, fly: impl Fn(&mut Loop) -> T) -> [T; 2] {
    [ALL, off].map(|extensions| {
        let mut config = common::config();
        config.extensions = extensions;
        if !extensions.attitude_lead {
            config.lead.limit_mps2 = 0.0;
        }
        fly(&mut Loop::with(config))
    })
}

fn chase(sim: &mut Loop, ahead: f64) {
    sim.frames = Frames::Target(Vec3::new(3.0 + ahead, -2.0, 1.5));
    sim.start(track());
    sim.until(15.0, |sim| sim.mode() == Mode::Track);
}

#[test]
fn hover_thrust_and_lag_are_learnt_or_stay_as_the_vehicle_file_says() {
    let off = Extensions { learnt_hover_thrust: false, learnt_attitude_lag: false, ..ALL };
    let [learnt, file] = flown(off, |sim| {
        (sim.heaviness, sim.lag) = (1.2, 0.2);
        chase(sim, 40.0);
        sim.run(6.0);
        (sim.out().hover_thrust, sim.out().attitude_lag)
    });
    assert!((learnt.0 - 0.3).abs() < 0.02 && learnt.1 > 0.13, "{learnt:?}");
    assert_eq!(file, (0.25, 0.1));
}

#[test]
fn the_lead_and_the_thrusts_projection_change_what_is_commanded() {
    for off in [Extensions { attitude_lead: false, ..ALL }, Extensions { thrust_along_body: false, ..ALL }] {
        let [with, without] = flown(off, |sim| {
            chase(sim, 40.0);
            sim.run(0.3);
            sim.out().setpoint.unwrap()
        });
        assert_ne!(with, without, "{off:?}");
    }
}

#[test]
fn a_target_that_runs_at_the_vehicle_is_backed_from_or_is_not() {
    let [kept, met] = flown(Extensions { least_distance: false, ..ALL }, |sim| {
        chase(sim, 4.5);
        let mut at = Vec3::new(7.5, -2.0, 1.5);
        sim.target_vel = Vec3::new(-2.0, 0.0, 0.0);
        let mut least = f64::INFINITY;
        for _ in 0..400 {
            at += sim.target_vel * common::DT;
            sim.frames = Frames::Target(at);
            sim.tick(None);
            least = least.min((sim.pos - at).norm());
        }
        least
    });
    assert!(kept > met + 0.3, "{kept} {met}");
}

#[test]
fn who_stands_on_the_way_to_where_the_target_is_believed_is_kept_away_from_or_is_not() {
    let [kept, met] = flown(Extensions { least_distance: false, ..ALL }, |sim| {
        chase(sim, 60.0);
        let believed = Vec3::new(63.0, -2.0, 1.5);
        sim.run(3.0);
        let stands = sim.pos + Vec3::new(9.0, 0.1, 0.0);
        sim.frames = Frames::Astray(believed, stands);
        let mut least = f64::INFINITY;
        for _ in 0..800 {
            sim.tick(None);
            least = least.min((sim.pos - stands).norm());
        }
        least
    });
    assert!(kept > 1.5 && met < 0.5, "{kept} {met}");
}

#[test]
fn a_way_aside_is_flown_only_if_the_planner_may_step_aside() {
    // The planner's switch; that a plan's way aside is flown is shown elsewhere.
    let moving = |extensions: Extensions| {
        let mut planner = planner(Task::Track, extensions);
        // The target comes at 3 m/s.
        let evasions = (0..40_u64).map(|seq| {
            let mut output = network(&[(7, 4.0, 1.0)]);
            output.values[13 * ANCHORS + 7] = 0.9 - 0.075 * seq as f32;
            planner.see(&common::frame(seq, odometry(seq))).answer(&output).evasion.is_some()
        });
        evasions.filter(|evades| *evades).count()
    };
    assert!(moving(ALL) > 0);
    assert_eq!(moving(Extensions { stepping_aside: false, ..ALL }), 0);
    assert_eq!(moving(Extensions { least_distance: false, ..ALL }), 0, "nothing is kept from the target");
}

#[test]
fn acceleration_is_limited_to_what_keeps_the_target_in_the_image_or_is_not() {
    let [limited, free] = flown(Extensions { view_limit: false, ..ALL }, |sim| {
        sim.haste = 3.0;
        chase(sim, 9.0);
        (0..200).map(|_| sim.tick(None).acc_att_world.xy().norm()).fold(0.0, f64::max)
    });
    assert!(free > limited + 0.2, "{limited} {free}");
}

#[test]
fn a_navigation_that_is_stuck_flies_aside_or_hangs_there() {
    let goal = Vec3::new(12.0, 0.0, 0.0);
    let [goes, hangs] = flown(Extensions { detours: false, ..ALL }, |sim| {
        sim.start(navigate(goal));
        // Plans that lead nowhere: it hovers.
        sim.frames = Frames::Blank;
        sim.until(15.0, |sim| sim.mode() == Mode::Navigate);
        let first = sim.out().planning.unwrap().goal_world;
        (0..2000).any(|_| sim.tick(None).planning.is_some_and(|demand| demand.goal_world != first))
    });
    assert_eq!((goes, hangs), (true, false));
}
