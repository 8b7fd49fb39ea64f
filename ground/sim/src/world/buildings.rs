//! Buildings: a plaza, blocks with streets between them, and a garden behind broad stairs. Most blocks are houses of
//! rooms, corridors and courtyards, the others yards.
//!
//! A house is a rectangle that is split again and again; every wall gets a doorway, so every room can be reached.

mod furniture;
mod plan;

use crate::world::{Cuboid, Ground, Kind, Look, Part, RoundCone, Shape, World, WorldError, WorldParts};
use goshawk_core::Vec3;
use plan::{FloorPlan, Rect, Wall};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Where the buildings stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BuildingsConfig {
    /// South-west corner of the world, m.
    pub min_xy: [f64; 2],
    /// North-east corner, m.
    pub max_xy: [f64; 2],
    /// The vehicle's start on the plaza, m; it looks east, at the house.
    pub start_xy: [f64; 2],
}

impl Default for BuildingsConfig {
    fn default() -> Self {
        Self { min_xy: [0.0, -25.0], max_xy: [70.0, 25.0], start_xy: [6.0, 0.0] }
    }
}

/// Distance between the ground's nodes, m: a step of a stair is one.
const GROUND_CELL_M: f64 = 0.25;
/// Rise and tread of a stair, m.
const RISE_M: f64 = 0.16;
const TREAD_M: f64 = 0.5;
/// From the start to the first block, m.
const PLAZA_M: f64 = 8.5;
/// Streets, at the least and the most, m.
const STREET_M: [f64; 2] = [3.2, 6.0];
/// Blocks larger than this are divided by a street, m.
const BLOCK_MAX_M: f64 = 17.0;
const BLOCK_MIN_M: f64 = 7.0;
const WALL_M: f64 = 0.2;
const SLAB_M: f64 = 0.16;
/// The middle of what stands between houses is no nearer to the start than this, m.
const START_CLEAR_M: f64 = 4.5;

/// Draws buildings.
///
/// # Errors
/// If the rectangle is too small to hold blocks of 16 m beside plaza and garden.
pub fn buildings(config: &BuildingsConfig, seed: u64) -> Result<World, WorldError> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (min, max) = (config.min_xy, config.max_xy);
    let front = config.start_xy[0] + PLAZA_M + rng.random_range(0.0..2.0);
    let site = Rect {
        min: [front, min[1] + STREET_M[0]],
        max: [(max[0] - rng.random_range(12.0..22.0)).max(front + 16.0), max[1] - STREET_M[0]],
    };
    if site.max[0] + 4.0 > max[0] || site.size(1) < 16.0 {
        return Err(WorldError::EmptyRectangle { min, max });
    }
    let steps = f64::from(rng.random_range(0..=6));
    let stairs = site.max[0] + rng.random_range(2.0..4.0);
    let height = move |x: f64, _: f64| RISE_M * ((x - stairs) / TREAD_M).ceil().clamp(0.0, steps);
    let ground = Ground::from_fn(min, max, GROUND_CELL_M, height);
    let mut built = Built { parts: Vec::new(), storey_m: rng.random_range(2.9..3.6), tint: tints(&mut rng) };
    let mut houses = Vec::new();
    blocks(site, &mut rng, &mut |block, rng| {
        if rng.random_bool(0.7) {
            houses.push(block);
        }
    });
    for house in &houses {
        built.house(&FloorPlan::draw(*house, &mut rng), &mut rng);
    }
    built.outdoors(config, &houses, &ground, &mut rng);
    let look = Look { ground_rgb: paving(&mut rng), ..Look::random(&mut rng) };
    Ok(World::new(WorldParts {
        seed,
        spacing_m: 0.0,
        min_xy: min,
        max_xy: max,
        start_xy: config.start_xy,
        start_heading_rad: 0.0,
        ground,
        parts: built.parts,
        trees: Vec::new(),
        look,
    }))
}

/// Divides a site by streets until its blocks are small enough.
fn blocks<R: Rng>(site: Rect, rng: &mut R, take: &mut dyn FnMut(Rect, &mut R)) {
    let axis = usize::from(site.size(1) > site.size(0));
    let street = rng.random_range(STREET_M[0]..STREET_M[1]);
    if site.size(axis) < BLOCK_MAX_M.max(2.0 * BLOCK_MIN_M + street + 1.0) {
        take(site, rng);
        return;
    }
    let at = rng.random_range(site.min[axis] + BLOCK_MIN_M..site.max[axis] - BLOCK_MIN_M - street);
    let (low, rest) = site.cut(axis, at);
    blocks(low, rng, take);
    blocks(rest.cut(axis, at + street).1, rng, take);
}

/// Colours of walls, of furniture, of metal.
fn tints<R: Rng>(rng: &mut R) -> [[f32; 3]; 3] {
    let walls = [[0.55, 0.52, 0.46], [0.40, 0.22, 0.16], [0.62, 0.60, 0.56], [0.34, 0.34, 0.33], [0.58, 0.48, 0.32]];
    let woods = [[0.26, 0.16, 0.08], [0.12, 0.09, 0.07], [0.45, 0.33, 0.20], [0.18, 0.22, 0.27]];
    [walls[rng.random_range(0..walls.len())], woods[rng.random_range(0..woods.len())], [0.16, 0.17, 0.18]]
}

fn paving<R: Rng>(rng: &mut R) -> [[f32; 3]; 2] {
    let grey = rng.random_range(0.12f32..0.3);
    [[grey, grey * 0.97, grey * 0.92], [grey * 1.3, grey * 1.25, grey * 1.15]]
}

/// What has been built so far.
struct Built {
    parts: Vec<Part>,
    storey_m: f64,
    /// Walls, furniture, metal.
    tint: [[f32; 3]; 3],
}

impl Built {
    /// A box between two corners, standing on the house's floor (z = 0).
    fn slab<R: Rng>(&mut self, low: Vec3, high: Vec3, tint: [f32; 3], rng: &mut R) {
        self.turned((low + high) * 0.5, (high - low) * 0.5, 0.0, tint, rng);
    }

    fn turned<R: Rng>(&mut self, centre: Vec3, half: Vec3, yaw_rad: f64, tint: [f32; 3], rng: &mut R) {
        let gain = rng.random_range(0.85f32..1.15);
        let shape = Shape::Cuboid(Cuboid { centre, half, yaw_rad });
        self.parts.push(Part { shape, kind: Kind::Building, tint: tint.map(|c| (c * gain).min(1.0)) });
    }

    /// Walls, and over three rooms of four a ceiling, with furniture below.
    fn house<R: Rng>(&mut self, plan: &FloorPlan, rng: &mut R) {
        for wall in &plan.walls {
            self.wall(wall, rng);
        }
        for room in &plan.rooms {
            if rng.random_bool(0.75) {
                self.ceiling(&room.rect);
                furniture::furnish(plan, room, self, rng);
            }
        }
    }

    /// A wall with its openings: boxes between them, lintels above, sills below.
    fn wall<R: Rng>(&mut self, wall: &Wall, rng: &mut R) {
        let tint = self.tint[0];
        let mut openings = wall.openings.clone();
        openings.sort_by(|a, b| a.at.total_cmp(&b.at));
        let mut from = wall.from;
        let stretch = |a: f64, b: f64, low: f64, high: f64| {
            let (along, across) = (wall.axis, 1 - wall.axis);
            let (mut p, mut q) = (Vec3::new(0.0, 0.0, low), Vec3::new(0.0, 0.0, high));
            (p[along], q[along]) = (a, b);
            (p[across], q[across]) = (wall.line - 0.5 * WALL_M, wall.line + 0.5 * WALL_M);
            (p, q)
        };
        let mut build = |built: &mut Self, a: f64, b: f64, low: f64, high: f64| {
            if b - a > 0.02 && high - low > 0.02 {
                let (p, q) = stretch(a, b, low, high);
                built.slab(p, q, tint, rng);
            }
        };
        for opening in &openings {
            let (a, b) = (opening.at - opening.half_m, opening.at + opening.half_m);
            build(self, from, a, -0.1, self.storey_m);
            build(self, a, b, -0.1, opening.sill_m);
            build(self, a, b, opening.head_m.min(self.storey_m), self.storey_m);
            from = b;
        }
        build(self, from, wall.to, -0.1, self.storey_m);
    }

    fn ceiling(&mut self, rect: &Rect) {
        let low = Vec3::new(rect.min[0], rect.min[1], self.storey_m);
        let high = Vec3::new(rect.max[0], rect.max[1], self.storey_m + SLAB_M);
        let shape = Shape::Cuboid(Cuboid { centre: (low + high) * 0.5, half: (high - low) * 0.5, yaw_rad: 0.0 });
        self.parts.push(Part { shape, kind: Kind::Building, tint: [0.6, 0.6, 0.58] });
    }

    /// Crates, low walls and lamp posts on the plaza, in streets and yards, and in the garden.
    fn outdoors<R: Rng>(&mut self, config: &BuildingsConfig, houses: &[Rect], ground: &Ground, rng: &mut R) {
        let area = (config.max_xy[0] - config.min_xy[0]) * (config.max_xy[1] - config.min_xy[1]);
        for _ in 0..(area / 60.0) as usize {
            let x = rng.random_range(config.min_xy[0]..config.max_xy[0]);
            let y = rng.random_range(config.min_xy[1]..config.max_xy[1]);
            let from_start = (x - config.start_xy[0]).hypot(y - config.start_xy[1]);
            if houses.iter().any(|h| h.grown(1.9).contains(x, y)) || from_start < START_CLEAR_M {
                continue;
            }
            let floor = ground.height(x, y);
            let stand = |half: Vec3| Vec3::new(x, y, floor + half.z - 0.1);
            let yaw = rng.random_range(0.0..std::f64::consts::PI);
            match rng.random_range(0..4) {
                0 => {
                    let half = Vec3::from_fn(|_, _| rng.random_range(0.3..0.75));
                    self.turned(stand(half), half, yaw, self.tint[1], rng);
                }
                1 => {
                    let half = Vec3::new(rng.random_range(0.8..1.6), 0.12, rng.random_range(0.4..1.3));
                    self.turned(stand(half), half, yaw, self.tint[0], rng);
                }
                2 => {
                    let half = Vec3::new(0.2, 0.2, rng.random_range(1.3..2.0));
                    self.turned(stand(half), half, yaw, self.tint[0], rng);
                }
                _ => {
                    let foot = Vec3::new(x, y, floor - 0.1);
                    let top = foot + Vec3::new(0.0, 0.0, rng.random_range(3.0..4.5));
                    let shape = Shape::Cone(RoundCone { a: foot, b: top, radius_a: 0.09, radius_b: 0.05 });
                    self.parts.push(Part { shape, kind: Kind::Building, tint: self.tint[2] });
                }
            }
        }
    }
}
