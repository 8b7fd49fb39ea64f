//! The world answers exactly: against brute force, against the Poisson law, and around the start.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use goshawk_core::Vec3;
use goshawk_sim::world::buildings::{BuildingsConfig, buildings};
use goshawk_sim::world::forest::{ForestConfig, START_CLEAR_HEIGHT_M, forest};
use goshawk_sim::world::{
    CLEARANCE_CAP_M, Cuboid, Ground, Kind, MOST_BOXES, Part, Shape, Surface, World, WorldError, WorldParts,
};
use prost::Message;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A forest of a spacing, and buildings.
fn worlds(spacing_m: f64, seed: u64) -> [World; 2] {
    [
        forest(&ForestConfig { spacing_m, ..ForestConfig::default() }, seed).unwrap(),
        buildings(&BuildingsConfig::default(), seed).unwrap(),
    ]
}

fn place(rng: &mut ChaCha8Rng) -> Vec3 {
    Vec3::new(rng.random_range(-3.0..73.0), rng.random_range(-28.0..28.0), rng.random_range(-0.5..11.0))
}

fn brute_clearance(world: &World, p: &Vec3) -> f64 {
    world.parts().iter().map(|part| part.shape.signed_distance(p)).fold(CLEARANCE_CAP_M, f64::min)
}

#[test]
fn clearance_is_the_smallest_distance_to_any_part() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for (seed, spacing_m) in [(1, 4.0), (2, 12.0)] {
        for world in worlds(spacing_m, seed) {
            for _ in 0..3000 {
                let p = place(&mut rng);
                let (fast, brute) = (world.clearance(&p), brute_clearance(&world, &p));
                assert!((fast - brute).abs() < 1e-9, "{p:?}: {fast} against {brute}");
            }
        }
    }
}

/// Distances are true distances: no surface within the clearance ball, one on its boundary.
#[test]
fn a_step_of_the_clearance_reaches_a_surface_and_no_less_does() {
    let world = forest(&ForestConfig::default(), 3).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut checked, mut straight) = (0, 0);
    while checked < 300 {
        let p = place(&mut rng);
        let d = world.clearance(&p);
        if !(0.05..5.0).contains(&d) {
            continue;
        }
        checked += 1;
        for _ in 0..64 {
            let dir = Vec3::from_fn(|_, _| rng.random_range(-1.0..1.0)).normalize();
            assert!(world.clearance(&(p + dir * (d * 0.999))) > 0.0, "a surface inside the ball about {p:?}");
        }
        let step = 1e-5;
        let slope = Vec3::from_fn(|i, _| {
            let e = Vec3::from_fn(|j, _| if i == j { step } else { 0.0 });
            (world.clearance(&(p + e)) - world.clearance(&(p - e))) / (2.0 * step)
        });
        // Where two parts are equally near the slope is a mixture; elsewhere the nearest point is straight down it.
        if (slope.norm() - 1.0).abs() < 1e-6 {
            straight += 1;
            assert!(world.clearance(&(p - slope * d)).abs() < 1e-3);
        }
    }
    assert!(straight > 200, "{straight} of {checked}");
}

#[test]
fn a_ray_stops_where_marching_by_clearance_stops() {
    let [trees, walls] = worlds(4.0, 4);
    ray_stops_where_marching_stops(&trees, [200, 100, 50]);
    ray_stops_where_marching_stops(&walls, [200, 50, 50]);
}

/// Also checks that at least so many rays end on parts, on the ground and on nothing.
fn ray_stops_where_marching_stops(world: &World, least: [usize; 3]) {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut on_parts, mut on_ground, mut on_nothing) = (0, 0, 0);
    for _ in 0..1500 {
        let p = place(&mut rng);
        if world.clearance_with_ground(&p) < 0.05 {
            continue;
        }
        let mut dir = Vec3::from_fn(|_, _| rng.random_range(-1.0..1.0));
        dir.z *= 0.3;
        dir.normalize_mut();
        let (mut t, max_m) = (0.0, 25.0);
        let gap = |t: f64| world.clearance_with_ground(&(p + dir * t));
        while t < max_m && gap(t) > 1e-6 {
            t += gap(t);
        }
        if let Some(hit) = world.ray_cast(&p, &dir, max_m) {
            // A ray that only grazes may be stopped early by the march.
            assert!(hit.distance_m > t - 1e-4, "{hit:?} before the march's {t}");
            if hit.distance_m > t + 1e-3 {
                assert!(gap(t) < 2e-6);
            }
            match hit.surface {
                Surface::Ground => on_ground += 1,
                Surface::Part(_) => on_parts += 1,
            }
            assert!(world.occluded(&p, &(p + dir * (hit.distance_m + 0.01))));
            assert!(!world.occluded(&p, &(p + dir * (hit.distance_m - 0.01).max(0.0))));
        } else {
            assert!(t >= max_m || gap(t) < 2e-6);
            on_nothing += 1;
        }
    }
    let counts = [on_parts, on_ground, on_nothing];
    assert!(counts.iter().zip(least).all(|(count, least)| *count >= least), "{counts:?}");
}

#[test]
fn the_number_of_trees_follows_the_poisson_law() {
    // A small disc, so that what it removes does not matter: 3500 m² / 16 m² = 218.75 trees on average.
    let config = ForestConfig { start_clear_m: 0.0, ..ForestConfig::default() };
    let counts: Vec<f64> = (0..200).map(|seed| forest(&config, seed).unwrap().trees().len() as f64).collect();
    let n = counts.len() as f64;
    let mean = counts.iter().sum::<f64>() / n;
    let variance = counts.iter().map(|c| (c - mean) * (c - mean)).sum::<f64>() / (n - 1.0);
    let expected = 70.0 * 50.0 / 16.0;
    // Four standard errors of the mean and of the variance of a Poisson variable. A radius of 0 still removes the
    // trunks that stand on the very point, far less than that.
    assert!((mean - expected).abs() < 4.0 * (expected / n).sqrt(), "mean {mean}");
    assert!((variance / expected - 1.0).abs() < 4.0 * (2.0 / n).sqrt(), "variance {variance}");
}

#[test]
fn trees_stand_uniformly_over_the_rectangle() {
    let config = ForestConfig { start_clear_m: 0.0, ..ForestConfig::default() };
    let mut counts = [0.0f64; 20];
    for seed in 0..100 {
        for tree in forest(&config, seed).unwrap().trees() {
            let (ix, iy) = ((tree.base_world.x / 14.0) as usize, ((tree.base_world.y + 25.0) / 12.5) as usize);
            counts[iy * 5 + ix] += 1.0;
        }
    }
    let expected = counts.iter().sum::<f64>() / 20.0;
    let chi2: f64 = counts.iter().map(|c| (c - expected).powi(2) / expected).sum();
    // 19 degrees of freedom: 43.8 is exceeded once in a thousand.
    assert!(chi2 < 43.8, "chi² {chi2}");
}

#[test]
fn trunks_keep_to_their_measures() {
    let world = forest(&ForestConfig::default(), 11).unwrap();
    for tree in world.trees() {
        let axis = tree.top_world - tree.base_world;
        let lean = (axis.z / axis.norm()).acos().to_degrees();
        assert!((0.1..=0.35).contains(&tree.radius_m) && lean <= 10.0 + 1e-9 && (4.0..=9.0).contains(&axis.z));
        let ground = world.ground_height(tree.base_world.x, tree.base_world.y);
        assert!((tree.base_world.z - ground).abs() < 1e-9);
    }
}

#[test]
fn the_start_disc_is_clear() {
    for seed in 0..40 {
        let config = ForestConfig { spacing_m: 3.0, ..ForestConfig::default() };
        let world = forest(&config, seed).unwrap();
        let start = world.start_world();
        for step in 0..=40 {
            let height = START_CLEAR_HEIGHT_M * f64::from(step) / 40.0;
            for turn in 0..36 {
                let (sin, cos) = (f64::from(turn) * 0.1745).sin_cos();
                for radius in [0.0, 1.0, 2.0, 2.98] {
                    let p = start + Vec3::new(radius * cos, radius * sin, height);
                    assert!(world.clearance(&p) > 0.0, "seed {seed}: {p:?} is inside an obstacle");
                }
            }
        }
    }
}

#[test]
fn same_seed_same_world_and_another_seed_another() {
    let grow = |seed| forest(&ForestConfig::default(), seed).unwrap();
    let (a, b, c) = (grow(5), grow(5), grow(6));
    assert_eq!(a.parts(), b.parts());
    assert_eq!(a.ground(), b.ground());
    assert_ne!(a.parts(), c.parts());
    assert_ne!(a.ground(), c.ground());
}

#[test]
fn worlds_without_area_or_with_no_room_are_refused() {
    let empty = ForestConfig { max_xy: [0.0, 25.0], ..ForestConfig::default() };
    assert!(matches!(forest(&empty, 1), Err(WorldError::EmptyRectangle { .. })));
    for spacing_m in [0.5, f64::NAN, -4.0] {
        let dense = ForestConfig { spacing_m, ..ForestConfig::default() };
        assert!(matches!(forest(&dense, 1), Err(WorldError::Spacing(_))));
    }
}

#[test]
fn the_wire_gets_every_tree() {
    let world = forest(&ForestConfig::default(), 7).unwrap();
    let wire = world.to_proto();
    assert_eq!(wire.trees.len(), world.trees().len());
    let (sent, tree) = (&wire.trees[3], world.trees()[3]);
    assert_eq!(sent.top_world.unwrap().z, tree.top_world.z as f32);
    assert_eq!(sent.radius_m, tree.radius_m as f32);
    assert_eq!((wire.seed, wire.spacing_m), (7, 4.0));
}

#[test]
fn the_wire_gets_every_wall_as_it_stands_and_lamp_posts_as_boxes() {
    let world = buildings(&BuildingsConfig::default(), 2).unwrap();
    let wire = world.to_proto();
    assert_eq!((wire.boxes.len(), wire.trees.len()), (world.parts().len(), 0));
    for (sent, part) in wire.boxes.iter().zip(world.parts()) {
        let (centre, size) = (sent.centre_world.unwrap(), sent.size_m.unwrap());
        let (low, high) = part.shape.aabb();
        assert!((f64::from(centre.x) - 0.5 * (low.x + high.x)).abs() < 1e-5);
        assert!((f64::from(size.z) - (high.z - low.z)).abs() < 1e-5);
        if let Shape::Cuboid(cuboid) = part.shape {
            assert_eq!((sent.yaw_rad, size.x), (cuboid.yaw_rad as f32, 2.0 * cuboid.half.x as f32));
        }
    }
    assert!(forest(&ForestConfig::default(), 7).unwrap().to_proto().boxes.is_empty());
}

#[test]
fn of_a_large_scan_the_wire_gets_the_largest_boxes_in_less_than_a_megabyte() {
    let cube = |index: usize| {
        let (x, y) = ((index % 200) as f64, (index / 200) as f64);
        let half = Vec3::repeat(if index.is_multiple_of(4) { 0.1 } else { 0.3 });
        let shape = Shape::Cuboid(Cuboid { centre: Vec3::new(x, y, 1.0), half, yaw_rad: 0.1 });
        Part { shape, kind: Kind::Scan, tint: [0.2; 3] }
    };
    let small = buildings(&BuildingsConfig::default(), 2).unwrap();
    let world = World::new(WorldParts {
        seed: 0,
        spacing_m: 0.0,
        min_xy: [0.0; 2],
        max_xy: [200.0; 2],
        start_xy: [0.0; 2],
        start_heading_rad: 0.0,
        ground: Ground::from_fn([0.0; 2], [200.0; 2], 0.5, |_, _| 0.0),
        parts: (0..26_000).map(cube).collect(),
        trees: Vec::new(),
        look: *small.look(),
    });
    let wire = world.to_proto();
    assert_eq!(wire.boxes.len(), MOST_BOXES);
    // 19 500 are large.
    assert_eq!(wire.boxes.iter().filter(|b| b.size_m.unwrap().x > 0.5).count(), 19_500);
    assert!(wire.encoded_len() < 1_000_000, "{} bytes", wire.encoded_len());
}
