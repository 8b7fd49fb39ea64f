//! What people put between trees: walls with and without a doorway, boxes, posts. A share of the scenes has it, so that
//! a policy also learns what is wide, what is flat, and that not all that stands upright in a bright colour is a person.
//!
//! Decoys stand in half of the scenes, so many that most images there show some: posts and crates of a person's size, as
//! the obstacles that move. A policy that never saw any takes them for the target.

use crate::world::{Cuboid, Kind, Part, RoundCone, Shape, World};
use goshawk_core::Vec3;
use rand::{Rng, RngExt};
use std::f64::consts::TAU;

/// Share of the scenes with clutter.
pub(super) const CLUTTERED: f64 = 0.25;
/// Its trees stand so much wider, m: there must be room for it.
pub(super) const WIDER_M: f64 = 2.0;

/// Share of the scenes with decoys.
pub(super) const WITH_DECOYS: f64 = 0.5;
/// Their number in a scene, from and to.
const DECOYS: std::ops::RangeInclusive<usize> = 20..=120;

/// Numbers of walls, boxes and posts in a scene, from and to.
const WALLS: std::ops::RangeInclusive<usize> = 10..=40;
const BOXES: std::ops::RangeInclusive<usize> = 10..=50;
const POSTS: std::ops::RangeInclusive<usize> = 0..=40;
/// Things reach this far below the ground, m, so that none floats on a slope.
const ROOT_M: f64 = 0.4;

/// The world with walls, boxes and posts in it.
pub(super) fn cluttered<R: Rng>(world: World, rng: &mut R) -> World {
    let mut parts = Vec::new();
    for _ in 0..rng.random_range(WALLS) {
        wall(&world, &mut parts, rng);
    }
    for _ in 0..rng.random_range(BOXES) {
        let half = [rng.random_range(0.15..0.8), rng.random_range(0.15..0.8)];
        let (at, yaw_rad, tint) = (place(&world, rng), rng.random_range(0.0..TAU), tint(rng));
        parts.push(upright(&world, at, half, rng.random_range(0.4..2.6), yaw_rad, tint));
    }
    for _ in 0..rng.random_range(POSTS) {
        let (at, height_m) = (place(&world, rng), rng.random_range(1.2..3.0));
        parts.push(post(&world, at, rng.random_range(0.05..0.3), height_m, tint(rng)));
    }
    world.with_more(parts)
}

/// The world with decoys in it; half of them are painted as walls and boxes are, half in bands.
pub(super) fn with_decoys<R: Rng>(world: World, rng: &mut R) -> World {
    let parts = (0..rng.random_range(DECOYS)).map(|_| {
        let (at, height_m, tint) = (place(&world, rng), rng.random_range(1.2..2.9), tint(rng));
        let kind = if rng.random_bool(0.5) { Kind::Building } else { Kind::Moving };
        let part = if rng.random_bool(0.5) {
            post(&world, at, rng.random_range(0.08..0.3), height_m, tint)
        } else {
            let half = [rng.random_range(0.15..0.5), rng.random_range(0.15..0.5)];
            upright(&world, at, half, height_m, rng.random_range(0.0..TAU), tint)
        };
        Part { kind, ..part }
    });
    let parts = parts.collect();
    world.with_more(parts)
}

/// A straight wall; half of them have a doorway with or without a lintel.
fn wall<R: Rng>(world: &World, parts: &mut Vec<Part>, rng: &mut R) {
    let (middle, yaw_rad, tint) = (place(world, rng), rng.random_range(0.0..TAU), tint(rng));
    let (half_m, half_thick_m) = (rng.random_range(1.0..5.0), rng.random_range(0.05..0.2));
    let height_m = rng.random_range(1.0..4.5);
    let at = |along: f64| [middle[0] + along * yaw_rad.cos(), middle[1] + along * yaw_rad.sin()];
    let mut piece = |from: f64, to: f64| {
        let half = [(to - from) / 2.0, half_thick_m];
        parts.push(upright(world, at(f64::midpoint(from, to)), half, height_m, yaw_rad, tint));
    };
    let door_m = rng.random_range(0.9..2.0);
    if half_m < 1.5 || rng.random_bool(0.5) {
        piece(-half_m, half_m);
        return;
    }
    let left = rng.random_range(-half_m + 0.2..half_m - door_m - 0.2);
    piece(-half_m, left);
    piece(left + door_m, half_m);
    if height_m > 2.6 && rng.random_bool(0.7) {
        let at = at(left + door_m / 2.0);
        let half_height = (height_m - 2.1) / 2.0;
        let centre = Vec3::new(at[0], at[1], world.ground_height(at[0], at[1]) + 2.1 + half_height);
        let cuboid = Cuboid { centre, half: Vec3::new(door_m / 2.0, half_thick_m, half_height), yaw_rad };
        parts.push(Part { shape: Shape::Cuboid(cuboid), kind: Kind::Building, tint });
    }
}

/// A post; its round top rises by a radius above `height_m`.
fn post(world: &World, [x, y]: [f64; 2], radius_m: f64, height_m: f64, tint: [f32; 3]) -> Part {
    let foot = world.ground_height(x, y);
    let (a, b) = (Vec3::new(x, y, foot - ROOT_M), Vec3::new(x, y, foot + height_m));
    let shape = Shape::Cone(RoundCone { a, b, radius_a: radius_m, radius_b: radius_m });
    Part { shape, kind: Kind::Building, tint }
}

/// A box on the ground; `half` its horizontal half edges, m.
fn upright(world: &World, at: [f64; 2], half: [f64; 2], height_m: f64, yaw_rad: f64, tint: [f32; 3]) -> Part {
    let foot = world.ground_height(at[0], at[1]);
    let half = Vec3::new(half[0], half[1], f64::midpoint(height_m, ROOT_M));
    let centre = Vec3::new(at[0], at[1], foot - ROOT_M + half.z);
    Part { shape: Shape::Cuboid(Cuboid { centre, half, yaw_rad }), kind: Kind::Building, tint }
}

fn place<R: Rng>(world: &World, rng: &mut R) -> [f64; 2] {
    let (min, max) = (world.min_world(), world.max_world());
    [rng.random_range(min.x..max.x), rng.random_range(min.y..max.y)]
}

/// Any colour: half of them grey as plaster and concrete are, half as bright as clothes.
fn tint<R: Rng>(rng: &mut R) -> [f32; 3] {
    let value: f32 = rng.random_range(0.06..0.7);
    let vivid: f32 = if rng.random_bool(0.5) { 0.15 } else { 0.95 };
    std::array::from_fn(|_| value * (1.0 - vivid * rng.random_range(0.0f32..1.0)))
}
