//! Facts about the evader, over many forests.

use super::*;
use crate::world::forest::{ForestConfig, forest};

const SEEDS: u64 = 50;

fn woods(seed: u64, spacing_m: f64) -> World {
    forest(&ForestConfig { spacing_m, ..ForestConfig::default() }, seed).unwrap()
}

fn plan(world: &World, speed_mps: f64, seed: u64) -> Evader {
    Evader::plan(world, &EvaderConfig::at_speed(speed_mps), world.start_world(), 0.0, seed).unwrap()
}

#[test]
fn it_never_comes_closer_to_an_obstacle_than_the_margin() {
    for seed in 0..SEEDS {
        let world = woods(seed, 4.0);
        let evader = plan(&world, [3.0, 5.0, 7.0][seed as usize % 3], seed + 100);
        for i in 0..=(evader.duration_s() / 0.05) as usize {
            let foot = evader.at(&world, i as f64 * 0.05).pose.foot_world;
            for height in 3..=17 {
                let clearance = world.clearance(&(foot + Vec3::new(0.0, 0.0, f64::from(height) * 0.1)));
                assert!(clearance >= 0.45, "seed {seed}: {clearance}");
            }
        }
    }
}

#[test]
fn its_acceleration_stays_below_the_limit_and_its_path_matches_its_velocity() {
    for seed in 0..SEEDS {
        let world = woods(seed, 4.0);
        let evader = plan(&world, [3.0, 5.0, 7.0][seed as usize % 3], seed);
        let dt = 0.01;
        for i in 1..(evader.duration_s() / dt) as usize {
            let t = i as f64 * dt;
            let (before, after) = (evader.at(&world, t - dt), evader.at(&world, t));
            let acc = (after.vel_world - before.vel_world).norm() / dt;
            assert!(acc <= 5.0, "seed {seed} at {t}: {acc}");
            let moved = (after.pose.foot_world - before.pose.foot_world).xy();
            let mean = 0.5 * (after.vel_world + before.vel_world).xy() * dt;
            assert!((moved - mean).norm() < 1e-3, "seed {seed} at {t}: {moved} {mean}");
        }
    }
}

#[test]
fn it_reaches_the_asked_speed_and_its_goal() {
    for seed in 0..20 {
        let world = woods(seed, 5.0);
        for speed in [3.0, 5.0, 7.0] {
            let evader = plan(&world, speed, seed);
            let fastest = (0..(evader.duration_s() / 0.05) as usize)
                .map(|i| evader.at(&world, i as f64 * 0.05).vel_world.norm())
                .fold(0.0, f64::max);
            assert!((0.95 * speed..=speed + 1e-9).contains(&fastest), "seed {seed}: {fastest} of {speed}");
            let (end, far) = (evader.at(&world, evader.duration_s()), evader.at(&world, 1e3));
            assert!(end.arrived && end.vel_world == Vec3::zeros());
            assert_eq!(end.pose.foot_world, far.pose.foot_world);
            assert!((20.0..60.0).contains(&evader.length_m()), "{}", evader.length_m());
            assert!((far.pose.foot_world - world.start_world()).norm() > 20.0);
        }
    }
}

#[test]
fn before_its_start_it_stands_in_view_ahead_of_the_vehicle() {
    for seed in 0..SEEDS {
        let world = woods(seed, 4.0);
        let evader = plan(&world, 5.0, seed);
        let standing = evader.at(&world, -3.0);
        assert_eq!((standing.vel_world, standing.path_m, standing.pose.stride), (Vec3::zeros(), 0.0, 0.0));
        let from_vehicle = standing.pose.foot_world - world.start_world();
        assert!((3.9..6.1).contains(&from_vehicle.xy().norm()));
        assert!(from_vehicle.y.atan2(from_vehicle.x).abs() < 0.7);
        let eye = world.start_world() + Vec3::new(0.0, 0.0, 1.2);
        assert!(!world.occluded(&eye, &standing.centre_world()));
    }
}

#[test]
fn the_goal_change_turns_it_without_a_jump() {
    for seed in 0..20 {
        let world = woods(seed, 4.0);
        let evader = plan(&world, 5.0, seed);
        let (before, after) = (evader.at(&world, evader.switch_s() - 1e-6), evader.at(&world, evader.switch_s()));
        assert!((before.pose.foot_world - after.pose.foot_world).norm() < 1e-3);
        assert!((before.vel_world - after.vel_world).norm() < 1e-2);
        let old_end = place(&evader.before.knots, 1e3);
        let old_goal = evader.before.path.at(old_end.parameter).0;
        let new_goal = evader.at(&world, 1e3).pose.foot_world.xy();
        assert!((old_goal - new_goal).norm() > 2.0, "seed {seed}");
    }
}

#[test]
fn the_same_seed_runs_the_same_run() {
    let world = woods(3, 4.0);
    let (a, b) = (plan(&world, 5.0, 9), plan(&world, 5.0, 9));
    assert_eq!(a.at(&world, 4.321), b.at(&world, 4.321));
    assert_ne!(a.at(&world, 4.321), plan(&world, 5.0, 10).at(&world, 4.321));
}

#[test]
fn a_files_waypoint_that_cannot_be_reached_is_an_error_that_names_it_and_a_figures_is_left_out() {
    const POINTS: [[f64; 3]; 3] = [[10.0, 0.0, 0.0], [500.0, 0.0, 0.0], [20.0, 3.0, 0.0]];
    let world = woods(3, 5.0);
    let run = |course| {
        let config = EvaderConfig { course, ..EvaderConfig::at_speed(4.0) };
        Evader::plan(&world, &config, world.start_world(), 0.0, 9)
    };
    let file = |points: &[[f64; 3]]| Course::Waypoints("mine".to_owned(), points.to_vec());
    let error = run(file(&POINTS)).unwrap_err();
    assert_eq!(error, EvaderError::NoRoomAt { course: "mine".to_owned(), number: 2 });
    assert!(error.to_string().contains("course mine: waypoint 2 lies in an obstacle or outside the world"));
    let figure = run(Course::Figure("mine".to_owned(), &POINTS)).unwrap();
    assert_eq!(figure.at(&world, 5.0), run(file(&[POINTS[0], POINTS[2]])).unwrap().at(&world, 5.0));
}

/// Runs `seed`'s reactive evader at `speed_mps` for up to a minute, chased by whom `chaser` moves: the states every 10 ms.
fn reactive(
    world: &World,
    speed_mps: f64,
    seed: u64,
    mut chaser: impl FnMut(&EvaderState) -> Vec3,
) -> Vec<EvaderState> {
    let config = EvaderConfig::at_speed(speed_mps);
    let mut evader = Reactive::new(world, &config, &plan(world, speed_mps, seed), 80.0, seed);
    let mut states = vec![evader.advance(-1.0, &Vec3::zeros())];
    while !states[states.len() - 1].arrived && states.len() < 12_000 {
        let last = states[states.len() - 1];
        states.push(evader.advance(states.len() as f64 * 0.01, &chaser(&last)));
    }
    states
}

/// Who follows at 3 m behind, 1.5 m up, at up to `speed_mps`.
fn follower(world: &World, speed_mps: f64) -> impl FnMut(&EvaderState) -> Vec3 {
    let mut at = world.start_world() + Vec3::new(0.0, 0.0, 1.5);
    move |target| {
        let way = target.centre_world() + Vec3::new(0.0, 0.0, 0.6) - at;
        at += way.cap_magnitude((way.norm() - 3.0).clamp(0.0, 0.01 * speed_mps));
        at
    }
}

#[test]
fn a_reactive_evader_touches_nothing_and_keeps_its_limits_whoever_chases_it() {
    for seed in 0..24 {
        let speed = [3.0, 5.0, 7.0][seed as usize % 3];
        let world = woods(seed, [3.0, 4.0, 5.0][seed as usize / 3 % 3]);
        let states = reactive(&world, speed, seed, follower(&world, 8.0));
        assert!(states[states.len() - 1].arrived, "seed {seed}");
        for pair in states.windows(2) {
            let foot = pair[1].pose.foot_world;
            let clearance = column_clearance(&world, &foot.xy());
            assert!(clearance >= 0.45, "seed {seed}: {clearance}");
            assert!(pair[1].vel_world.norm() <= speed + 1e-9, "seed {seed}: {}", pair[1].vel_world);
            let acc = (pair[1].vel_world - pair[0].vel_world).norm() / 0.01;
            assert!(acc <= 5.0 + 1e-6, "seed {seed}: {acc}");
            let moved =
                (foot - pair[0].pose.foot_world).xy() - 0.5 * (pair[0].vel_world + pair[1].vel_world).xy() * 0.01;
            assert!(moved.norm() < 1e-3, "seed {seed}: {moved}");
        }
    }
}

#[test]
fn a_reactive_evader_doubles_back_before_a_chaser_and_runs_on_before_nobody() {
    let turns = |states: &[EvaderState]| {
        states.windows(200).any(|w| {
            let (a, b) = (w[0].vel_world, w[199].vel_world);
            a.norm() > 2.0 && b.norm() > 2.0 && a.dot(&b) < -0.7 * a.norm() * b.norm()
        })
    };
    let (mut chased, mut alone) = (0, 0);
    for seed in 0..12 {
        let world = woods(seed, 4.0);
        chased += u32::from(turns(&reactive(&world, 5.0, seed, follower(&world, 8.0))));
        alone += u32::from(turns(&reactive(&world, 5.0, seed, |_| Vec3::new(0.0, 0.0, 1000.0))));
    }
    assert!(chased >= 9 && alone <= 3, "of 12, {chased} doubled back before a chaser and {alone} before nobody");
}

#[test]
fn a_reactive_evader_stands_hidden_from_a_chaser() {
    let mut hid = 0;
    for seed in 0..12 {
        let world = woods(seed, 4.0);
        let (mut places, mut chase) = (Vec::new(), follower(&world, 3.0));
        let states = reactive(&world, 5.0, seed, |state| {
            places.push(chase(state));
            places[places.len() - 1]
        });
        let hidden: Vec<bool> = (0..places.len())
            .map(|i| {
                let state = &states[i + 1];
                !state.arrived && state.vel_world.norm() < 0.5 && world.occluded(&places[i], &state.centre_world())
            })
            .collect();
        hid += u32::from(hidden.windows(30).any(|w| w.iter().all(|h| *h)));
    }
    assert!(hid >= 6, "{hid} of 12 stood hidden for 0.3 s");
}

#[test]
fn a_reactive_evader_runs_the_same_way_from_the_same_chaser_and_another_from_another() {
    let world = woods(3, 4.0);
    let run = |seed, ahead_m: f64| {
        let mut chase = follower(&world, 8.0);
        reactive(&world, 5.0, seed, move |state| chase(state) + Vec3::new(ahead_m, 0.0, 0.0))
    };
    assert_eq!(run(9, 0.0), run(9, 0.0));
    assert_ne!(run(9, 0.0), run(9, 4.0));
    assert_ne!(run(9, 0.0), run(10, 0.0));
}
