//! The forest: trees by a homogeneous Poisson process on uneven ground, clear around the vehicle's start.
//!
//! Each tree draws from its own random stream, so a world depends on its seed and configuration alone.

use crate::world::{Ground, Kind, Look, Part, RoundCone, Shape, Spheroid, Tree, World, WorldError, WorldParts};
use goshawk_core::Vec3;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Poisson};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;

/// Distance between the ground's nodes, m.
pub const GROUND_CELL_M: f64 = 0.5;

/// Above the start disc nothing hangs lower than this over the ground, m.
pub const START_CLEAR_HEIGHT_M: f64 = 4.0;

/// Mean spacings that a forest can have, m.
pub const SPACING_M: RangeInclusive<f64> = 1.0..=1000.0;

/// Trunks reach this far below the ground, m, so that none floats on a slope.
const ROOT_M: f64 = 0.4;

/// Where the forest stands and how dense it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForestConfig {
    /// South-west corner of the rectangle, m.
    pub min_xy: [f64; 2],
    /// North-east corner, m.
    pub max_xy: [f64; 2],
    /// Mean spacing, m: the intensity is 1/spacing² trees per m².
    pub spacing_m: f64,
    /// Centre of the clear disc, m.
    pub start_xy: [f64; 2],
    /// Radius of the clear disc, m.
    pub start_clear_m: f64,
    /// Height of the ground's hills, m.
    pub hills_m: f64,
}

impl Default for ForestConfig {
    fn default() -> Self {
        Self {
            min_xy: [0.0, -25.0],
            max_xy: [70.0, 25.0],
            spacing_m: 4.0,
            start_xy: [6.0, 0.0],
            start_clear_m: 3.0,
            hills_m: 0.3,
        }
    }
}

/// Grows a forest.
///
/// # Errors
/// If the rectangle is empty or the spacing outside [`SPACING_M`].
pub fn forest(config: &ForestConfig, seed: u64) -> Result<World, WorldError> {
    let (min, max) = (config.min_xy, config.max_xy);
    if !(max[0] > min[0] && max[1] > min[1]) {
        return Err(WorldError::EmptyRectangle { min, max });
    }
    if !SPACING_M.contains(&config.spacing_m) {
        return Err(WorldError::Spacing(config.spacing_m));
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let ground = Ground::hills(min, max, GROUND_CELL_M, config.hills_m, &mut rng);
    let look = Look::random(&mut rng);
    let species = Species::random(&mut rng);
    let mean = (max[0] - min[0]) * (max[1] - min[1]) / (config.spacing_m * config.spacing_m);
    let count = Poisson::new(mean).expect("the mean is positive and finite").sample(&mut rng) as u64;
    let mut grown = Grown { parts: Vec::new(), trees: Vec::new() };
    for index in 0..count {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(index + 1);
        grown.tree(config, &ground, &species, &mut rng);
    }
    Ok(World::new(WorldParts {
        seed,
        spacing_m: config.spacing_m,
        min_xy: min,
        max_xy: max,
        start_xy: config.start_xy,
        start_heading_rad: 0.0,
        ground,
        parts: grown.parts,
        trees: grown.trees,
        look,
    }))
}

/// Colours that a forest's trees share.
struct Species {
    bark: [f32; 3],
    leaf: [f32; 3],
}

impl Species {
    fn random<R: Rng>(rng: &mut R) -> Self {
        let barks = [[0.16, 0.11, 0.07], [0.10, 0.08, 0.065], [0.24, 0.22, 0.19], [0.20, 0.12, 0.08]];
        let leaves =
            [[0.07, 0.16, 0.03], [0.04, 0.10, 0.03], [0.14, 0.18, 0.03], [0.28, 0.15, 0.03], [0.22, 0.07, 0.03]];
        // Green far more often than autumn.
        let leaf = [0, 0, 0, 1, 1, 2, 2, 3, 4][rng.random_range(0..9)];
        Self { bark: barks[rng.random_range(0..barks.len())], leaf: leaves[leaf] }
    }
}

fn vary<R: Rng>(tint: [f32; 3], amount: f32, rng: &mut R) -> [f32; 3] {
    let gain = 1.0 + rng.random_range(-amount..amount);
    tint.map(|c| (c * gain * (1.0 + rng.random_range(-amount..amount) * 0.4)).clamp(0.0, 1.0))
}

struct Grown {
    parts: Vec<Part>,
    trees: Vec<Tree>,
}

impl Grown {
    fn tree<R: Rng>(&mut self, config: &ForestConfig, ground: &Ground, species: &Species, rng: &mut R) {
        let x = rng.random_range(config.min_xy[0]..config.max_xy[0]);
        let y = rng.random_range(config.min_xy[1]..config.max_xy[1]);
        let radius = rng.random_range(0.1..0.35);
        let height = rng.random_range(4.0..9.0);
        let lean = rng.random_range(0.0..10f64.to_radians());
        let azimuth = rng.random_range(0.0..TAU);
        let axis = Vec3::new(lean.sin() * azimuth.cos(), lean.sin() * azimuth.sin(), lean.cos());
        let base = Vec3::new(x, y, ground.height(x, y));
        let root = base - axis * (ROOT_M / axis.z);
        let top = base + axis * (height / axis.z);
        let trunk = RoundCone { a: root, b: top, radius_a: radius, radius_b: radius * rng.random_range(0.35..0.7) };
        if intrudes(&Shape::Cone(trunk), config, ground) {
            return;
        }
        let bark = vary(species.bark, 0.35, rng);
        let leaf = vary(species.leaf, 0.35, rng);
        self.parts.push(Part { shape: Shape::Cone(trunk), kind: Kind::Trunk, tint: bark });

        let mut limbs = Limbs { config, ground, base, axis, height, bark, leaf, parts: &mut self.parts };
        limbs.low_branches(rng);
        if rng.random_bool(0.35) {
            limbs.low_foliage(rng);
        }
        if rng.random_bool(0.12) {
            limbs.bush(rng);
        }
        let canopy = if rng.random_bool(0.9) { limbs.canopy(rng) } else { 0.0 };
        self.trees.push(Tree { base_world: base, top_world: top, radius_m: radius, foliage_radius_m: canopy });
    }
}

/// Adds limbs and leaves to one trunk.
struct Limbs<'a> {
    config: &'a ForestConfig,
    ground: &'a Ground,
    base: Vec3,
    axis: Vec3,
    height: f64,
    bark: [f32; 3],
    leaf: [f32; 3],
    parts: &'a mut Vec<Part>,
}

impl Limbs<'_> {
    /// Point on the trunk's axis at a height above its base.
    fn at(&self, height: f64) -> Vec3 {
        self.base + self.axis * (height / self.axis.z)
    }

    fn push(&mut self, shape: Shape, kind: Kind, tint: [f32; 3]) {
        if !intrudes(&shape, self.config, self.ground) {
            self.parts.push(Part { shape, kind, tint });
        }
    }

    fn low_branches<R: Rng>(&mut self, rng: &mut R) {
        for _ in 0..rng.random_range(1..=5) {
            let a = self.at(rng.random_range(0.9..4.0f64).min(self.height * 0.8));
            let azimuth = rng.random_range(0.0..TAU);
            let rise = rng.random_range(-0.1..0.8f64);
            let length = rng.random_range(0.5..1.9);
            let along = Vec3::new(rise.cos() * azimuth.cos(), rise.cos() * azimuth.sin(), rise.sin());
            let radius = rng.random_range(0.02..0.05);
            let b = a + along * length;
            let cone = RoundCone { a, b, radius_a: radius, radius_b: radius * 0.5 };
            self.push(Shape::Cone(cone), Kind::Branch, self.bark);
            if rng.random_bool(0.35) {
                // A fork.
                let fork = a + along * (length * 0.55);
                let aside =
                    Vec3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), rng.random_range(-0.2..0.6));
                let tip = fork + (along + aside).normalize() * length * 0.45;
                let cone = RoundCone { a: fork, b: tip, radius_a: radius * 0.7, radius_b: radius * 0.4 };
                self.push(Shape::Cone(cone), Kind::Branch, self.bark);
            }
        }
    }

    fn low_foliage<R: Rng>(&mut self, rng: &mut R) {
        for _ in 0..rng.random_range(1..=3) {
            let on_trunk = self.at(rng.random_range(1.0..3.5));
            let azimuth = rng.random_range(0.0..TAU);
            let out = rng.random_range(0.2..1.2);
            let centre = on_trunk + Vec3::new(out * azimuth.cos(), out * azimuth.sin(), 0.0);
            self.cluster(centre, rng.random_range(0.22..0.55), rng);
        }
    }

    fn bush<R: Rng>(&mut self, rng: &mut R) {
        let azimuth = rng.random_range(0.0..TAU);
        let out = rng.random_range(0.4..1.6);
        let (x, y) = (self.base.x + out * azimuth.cos(), self.base.y + out * azimuth.sin());
        let radius = rng.random_range(0.3..0.7);
        self.cluster(Vec3::new(x, y, self.ground.height(x, y) + 0.4 * radius), radius, rng);
    }

    /// A few overlapping spheroids about `centre`.
    fn cluster<R: Rng>(&mut self, centre: Vec3, radius: f64, rng: &mut R) {
        let tint = vary(self.leaf, 0.2, rng);
        for index in 0..rng.random_range(1..=3) {
            let spread = if index == 0 { 0.0 } else { radius };
            let shift = Vec3::from_fn(|_, _| rng.random_range(-0.8..0.8)) * spread;
            let radius_xy = radius * rng.random_range(0.65..1.0);
            let spheroid =
                Spheroid { centre: centre + shift, radius_xy, radius_z: radius_xy * rng.random_range(0.6..0.95) };
            self.push(Shape::Spheroid(spheroid), Kind::Foliage, vary(tint, 0.12, rng));
        }
    }

    /// Returns the canopy's horizontal radius about the trunk's top, m.
    fn canopy<R: Rng>(&mut self, rng: &mut R) -> f64 {
        let size = rng.random_range(0.8..1.5);
        for _ in 0..rng.random_range(3..=5) {
            let height = rng.random_range(self.height * 0.72..self.height * 1.02).max(3.4 + 0.7 * size);
            let azimuth = rng.random_range(0.0..TAU);
            let out = rng.random_range(0.0..0.8) * size;
            let centre = self.at(height) + Vec3::new(out * azimuth.cos(), out * azimuth.sin(), 0.0);
            let radius_xy = size * rng.random_range(0.45..1.0);
            let spheroid = Spheroid { centre, radius_xy, radius_z: radius_xy * rng.random_range(0.55..0.85) };
            self.push(Shape::Spheroid(spheroid), Kind::Foliage, vary(self.leaf, 0.15, rng));
        }
        1.8 * size
    }
}

/// Whether a shape reaches into the clear cylinder over the start disc.
fn intrudes(shape: &Shape, config: &ForestConfig, ground: &Ground) -> bool {
    let [sx, sy] = config.start_xy;
    let top = ground.height(sx, sy) + START_CLEAR_HEIGHT_M + ground.slope_bound() * config.start_clear_m;
    let nearest = match shape {
        Shape::Cone(cone) => {
            // The part of the axis below the cylinder's top, seen from above; radius bounded by the thicker end.
            let (rise, radius) = (cone.b.z - cone.a.z, cone.radius_a.max(cone.radius_b));
            let keep = |z: f64| if rise.abs() < 1e-9 { 1.0 } else { ((z - cone.a.z) / rise).clamp(0.0, 1.0) };
            let (a, b) = if rise >= 0.0 { (0.0, keep(top + radius)) } else { (keep(top + radius), 1.0) };
            if cone.a.z.min(cone.b.z) - radius > top {
                return false;
            }
            let (p, q) = (cone.a.lerp(&cone.b, a), cone.a.lerp(&cone.b, b));
            let (px, py, dx, dy) = (p.x - sx, p.y - sy, q.x - p.x, q.y - p.y);
            let s = (-(px * dx + py * dy) / (dx * dx + dy * dy).max(1e-12)).clamp(0.0, 1.0);
            (px + s * dx).hypot(py + s * dy) - radius
        }
        Shape::Spheroid(s) => {
            if s.centre.z - s.radius_z > top {
                return false;
            }
            (s.centre.x - sx).hypot(s.centre.y - sy) - s.radius_xy
        }
        Shape::Cuboid(c) => (c.centre.x - sx).hypot(c.centre.y - sy) - c.half.xy().norm(),
    };
    nearest < config.start_clear_m
}
