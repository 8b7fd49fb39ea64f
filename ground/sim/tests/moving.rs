//! Facts about moving obstacles: where their ways are, what the camera makes of them, how many may be asked for.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use clap::Parser;
use common::{config, forgetful_vehicle, sectors, vehicle};
use goshawk_core::{Rot, Task, Vec3};
use goshawk_sim::actors::evader::Course;
use goshawk_sim::actors::moving::{Body, Flat, MOST, Mover, clearance};
use goshawk_sim::actors::person::{Person, PersonLook, PersonPose};
use goshawk_sim::commands::Cli;
use goshawk_sim::pilots::fly_trial;
use goshawk_sim::render::{Camera, CameraPose, Class, Frame, Renderer};
use goshawk_sim::trial::{Contact, Scene, SceneConfig, TrialConfig, Unwatched, WorldSource};
use goshawk_sim::world::{Ground, Look, World, WorldParts};
use goshawk_vehicle::config::Vehicle;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Forests and buildings, chases and navigations, with eight movers each.
fn scenes() -> impl Iterator<Item = Scene> {
    (0..24).map(|seed| {
        let task = if seed % 3 == 0 { Task::Navigate } else { Task::Track };
        let world = if seed % 2 == 0 { WorldSource::Forest { spacing_m: 4.0 } } else { WorldSource::Buildings };
        let plain = SceneConfig::of_task(task, 5.0, world, Course::Goal, seed);
        let scene = Scene::new(&SceneConfig { moving: 8, ..plain }).unwrap();
        assert_eq!(scene.movers.len(), 8, "seed {seed}");
        scene
    })
}

fn post(middle: Flat, reach: Flat) -> Mover {
    Mover { middle, reach, speed_mps: 1.5, body: Body::Post { radius_m: 0.2 }, height_m: 2.5, tint: [0.4; 3] }
}

#[test]
fn it_stands_at_one_end_until_the_task_begins_then_swings_between_both_no_faster_than_it_may() {
    for mover in scenes().flat_map(|scene| scene.movers) {
        let [first, last] = mover.ends();
        assert_eq!(mover.at(-3.0), mover.at(0.0));
        assert!((mover.at(0.0) - first).norm() < 1e-9 && (0.5..2.0).contains(&mover.speed_mps));
        let half_turn_s = std::f64::consts::PI * mover.reach.norm() / mover.speed_mps;
        assert!((mover.at(half_turn_s) - last).norm() < 1e-9);
        for i in 0..500 {
            let t = 0.1 * f64::from(i);
            let speed = (mover.at(t + 1e-4) - mover.at(t)).norm() / 1e-4;
            assert!(speed <= mover.speed_mps + 1e-9, "{speed} of {}", mover.speed_mps);
        }
    }
}

#[test]
fn nothing_fixed_nor_another_mover_stands_in_its_way() {
    for scene in scenes() {
        for (index, mover) in scene.movers.iter().enumerate() {
            let [first, last] = mover.ends();
            for share in 0..=200 {
                let at = first.lerp(&last, f64::from(share) / 200.0);
                let ground = scene.world.ground_height(at.x, at.y);
                for up in 1..=(10.0 * mover.height_m) as i32 {
                    let gap = scene.world.clearance(&Vec3::new(at.x, at.y, ground + 0.1 * f64::from(up)));
                    assert!(gap > mover.radius_m(), "seed {}: {gap}", scene.world.seed());
                }
            }
            for t in 0..600 {
                let (t, others) = (0.1 * f64::from(t), &scene.movers[index + 1..]);
                let near = others.iter().map(|o| (o.at(t) - mover.at(t)).norm() - o.radius_m() - mover.radius_m());
                assert!(near.fold(f64::INFINITY, f64::min) > 0.0);
            }
        }
    }
}

#[test]
fn the_evader_never_meets_one_and_none_comes_near_the_start() {
    let mut chases = 0;
    for scene in scenes() {
        chases += usize::from(scene.evader_at(0.0).is_some());
        let start = scene.world.start_world() + Vec3::z();
        for step in -20..3000 {
            let now = 0.02 * f64::from(step);
            let parts = scene.moving_at(now);
            assert!(clearance(&parts, &start) >= 1.9, "seed {}", scene.world.seed());
            if let Some(evader) = scene.evader_at(now) {
                let gap = clearance(&parts, &evader.centre_world());
                assert!(gap > 0.6, "seed {} at {now}: {gap}", scene.world.seed());
            }
        }
    }
    assert_eq!(chases, 16);
}

#[test]
fn fewer_are_the_first_of_more_and_the_world_and_the_run_stay_the_same() {
    let scene = |moving| {
        let plain = SceneConfig::of_task(Task::Track, 5.0, WorldSource::Forest { spacing_m: 4.0 }, Course::Goal, 7);
        Scene::new(&SceneConfig { moving, ..plain }).unwrap()
    };
    let (none, few, many) = (scene(0), scene(3), scene(MOST));
    assert!(none.movers.is_empty() && none.moving_at(4.0).is_empty());
    assert_eq!(few.movers, many.movers[..3]);
    assert_eq!(none.world.parts(), many.world.parts());
    assert_eq!(none.evader_at(4.0), many.evader_at(4.0));
}

#[test]
fn one_before_the_person_hides_it_and_one_behind_is_hidden_by_it() {
    let half = [[-40.0; 2], [40.0; 2]];
    let world = World::new(WorldParts {
        seed: 0,
        spacing_m: 4.0,
        min_xy: half[0],
        max_xy: half[1],
        start_xy: [0.0; 2],
        start_heading_rad: 0.0,
        ground: Ground::from_fn(half[0], half[1], 0.5, |_, _| 0.0),
        parts: Vec::new(),
        trees: Vec::new(),
        look: Look::random(&mut ChaCha8Rng::seed_from_u64(1)),
    });
    let look = PersonLook::random(&mut ChaCha8Rng::seed_from_u64(4));
    let stance = PersonPose { foot_world: Vec3::new(6.0, 0.0, 0.0), heading_rad: 0.0, phase_rad: 0.0, stride: 0.0 };
    let (person, pose) = (
        Person { look, pose: stance },
        CameraPose { pos_world: Vec3::new(0.0, 0.0, 1.2), world_from_cam: Rot::identity() },
    );
    let mut renderer = Renderer::new(Camera::default());
    let mut seen = |mover: &Mover, now: f64| {
        let mut frame = Frame::default();
        renderer.render_with(&world, &[mover.part(&world, now)], Some(&person), &pose, &mut frame);
        frame
    };
    let crate_at =
        |x: f64| Mover { body: Body::Crate { half_m: [0.4, 0.4] }, ..post(Flat::new(x, 0.0), Flat::new(0.0, 3.0)) };
    let middle_s = std::f64::consts::FRAC_PI_2 * 3.0 / 1.5;
    let centre = 48 * 160 + 80;

    let before = seen(&crate_at(3.0), middle_s);
    assert_eq!((before.person_pixels_visible, before.class[centre]), (0, Class::Moving as u8));
    assert!((before.depth_m[centre] - 2.6).abs() < 1e-3, "{}", before.depth_m[centre]);
    let aside = seen(&crate_at(3.0), 0.0);
    assert_eq!((aside.person_visible(), aside.class[centre]), (1.0, Class::Person as u8));
    let behind = seen(&crate_at(9.0), middle_s);
    assert_eq!((behind.person_visible(), behind.class[centre]), (1.0, Class::Person as u8));
    assert!(behind.class.contains(&(Class::Moving as u8)));
}

#[test]
fn a_count_that_cannot_be_is_refused_in_one_line() {
    for command in [&["fly", "--task", "track", "--speed", "3"][..], &["serve"], &["world"]] {
        let parse = |count: &str| Cli::try_parse_from([&["goshawk-sim"], command, &["--moving", count]].concat());
        for wrong in ["-1", "41", "1.5", "many", ""] {
            let said = parse(wrong).unwrap_err().to_string();
            let lines: Vec<&str> = said.lines().filter(|l| !l.is_empty() && !l.contains("--help")).collect();
            assert!(lines.len() == 1 && lines[0].contains("0 to 40"), "{wrong}: {said}");
        }
        assert!(parse("40").is_ok());
    }
    let dataset = Cli::try_parse_from(["goshawk-sim", "dataset", "--moving", "3"]);
    assert!(dataset.is_err(), "a data set's frames are single instants");
}

/// How many of eight navigations at 3 m/s among twelve moving obstacles and few trees hit one of these.
fn hits(vehicle: &Vehicle) -> usize {
    let hit = |seed: u64| {
        let config = TrialConfig { moving: 12, ..config(Task::Navigate, 3.0, 12.0, seed) };
        let flight = fly_trial(&config, vehicle, Some(&mut sectors(false)), &mut Unwatched).unwrap();
        usize::from(flight.contact == Some(Contact::Moving))
    };
    (1..=8).map(hit).sum()
}

#[test]
fn who_watches_what_moves_hits_less_of_it() {
    let (watching, forgetful) = (hits(&vehicle()), hits(&forgetful_vehicle()));
    println!("watching {watching}, forgetful {forgetful} of 8");
    assert!(2 * watching < forgetful, "{watching} of 8, without a memory {forgetful}");
}
