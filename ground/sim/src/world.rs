//! The world: obstacles on uneven ground, and what can be asked of it.
//!
//! A world is plain data, however it was made (see [`crate::world::forest`]): solid parts in the world frame (ENU, metres), a
//! height field, and a look for the renderer. It never changes after construction, so queries take `&self` from any
//! number of threads.

pub mod buildings;
mod cast;
pub mod cloud;
pub mod forest;
mod grid;
mod ground;
mod look;
mod shape;
mod wire;

pub use cast::{Hit, Surface};
pub use ground::Ground;
pub use look::Look;
pub use shape::{Cuboid, RoundCone, Shape, Spheroid};
pub use wire::{MOST_BOXES, page};

use goshawk_core::Vec3;
use grid::Grid;
use thiserror::Error;

/// Clearances are exact up to this distance; a larger one is reported as this, m.
pub const CLEARANCE_CAP_M: f64 = 10.0;

/// Why a world cannot be made.
#[derive(Debug, Error)]
pub enum WorldError {
    /// The rectangle has no area, or its corners are swapped.
    #[error("the world's rectangle from {min:?} to {max:?} m is empty: each maximum must exceed its minimum")]
    EmptyRectangle {
        /// South-west corner, m.
        min: [f64; 2],
        /// North-east corner, m.
        max: [f64; 2],
    },
    /// The spacing cannot be used.
    #[error("a tree spacing of {0} m is not usable: give 1 to 1000 m")]
    Spacing(f64),
}

/// What a part is made of; decides its texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A tree's stem.
    Trunk,
    /// A thin limb.
    Branch,
    /// Leaves: canopy, low foliage, bushes.
    Foliage,
    /// Walls, ceilings, furniture.
    Building,
    /// A voxel of a scanned point cloud.
    Scan,
    /// A moving obstacle (see [`crate::actors::moving`]); no world holds one.
    Moving,
}

/// One solid part of the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Its geometry, world frame.
    pub shape: Shape,
    /// What it is made of.
    pub kind: Kind,
    /// Base colour, linear light, 0..1.
    pub tint: [f32; 3],
}

/// A tree in outline, for pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tree {
    /// Centre of the trunk at the ground.
    pub base_world: Vec3,
    /// Upper end of the trunk's axis.
    pub top_world: Vec3,
    /// Trunk radius at the base, m.
    pub radius_m: f64,
    /// Horizontal radius of the canopy about the top, m; 0 where it has none.
    pub foliage_radius_m: f64,
}

/// What a world is made from.
#[derive(Clone, Debug)]
pub struct WorldParts {
    /// Where the world came from; recorded, never used to draw numbers.
    pub seed: u64,
    /// Mean spacing of the trees, m; recorded.
    pub spacing_m: f64,
    /// South-west corner of the populated rectangle, m.
    pub min_xy: [f64; 2],
    /// North-east corner, m.
    pub max_xy: [f64; 2],
    /// Where the vehicle starts, m.
    pub start_xy: [f64; 2],
    /// What it looks along at first, from east to north, rad.
    pub start_heading_rad: f64,
    /// The height field.
    pub ground: Ground,
    /// All solid parts.
    pub parts: Vec<Part>,
    /// The trees in outline.
    pub trees: Vec<Tree>,
    /// Light and colours.
    pub look: Look,
}

/// Obstacles, ground and light. Immutable.
#[derive(Clone, Debug)]
pub struct World {
    from: WorldParts,
    grid: Grid,
    min_world: Vec3,
    max_world: Vec3,
}

impl World {
    /// Builds the index over `from`.
    #[must_use]
    pub fn new(from: WorldParts) -> Self {
        let grid = Grid::new(from.min_xy, from.max_xy, &from.parts);
        let (ground_low, ground_high) = from.ground.range();
        let top = from.parts.iter().map(|p| p.shape.aabb().1.z).fold(ground_high, f64::max);
        Self {
            min_world: Vec3::new(from.min_xy[0], from.min_xy[1], ground_low - 0.2),
            max_world: Vec3::new(from.max_xy[0], from.max_xy[1], top + 0.2),
            grid,
            from,
        }
    }

    /// The seed that it was made from.
    #[must_use]
    pub fn seed(&self) -> u64 {
        self.from.seed
    }

    /// Mean spacing of the trees, m.
    #[must_use]
    pub fn spacing_m(&self) -> f64 {
        self.from.spacing_m
    }

    /// Lower corner of the box around the populated rectangle, its ground and its parts.
    #[must_use]
    pub fn min_world(&self) -> Vec3 {
        self.min_world
    }

    /// Upper corner of that box.
    #[must_use]
    pub fn max_world(&self) -> Vec3 {
        self.max_world
    }

    /// The vehicle's start, on the ground.
    #[must_use]
    pub fn start_world(&self) -> Vec3 {
        let [x, y] = self.from.start_xy;
        Vec3::new(x, y, self.ground_height(x, y))
    }

    /// What the vehicle looks along at its start, from east to north, rad.
    #[must_use]
    pub fn start_heading_rad(&self) -> f64 {
        self.from.start_heading_rad
    }

    /// The same world with another start.
    #[must_use]
    pub fn started_at(mut self, start_xy: [f64; 2], start_heading_rad: f64) -> Self {
        (self.from.start_xy, self.from.start_heading_rad) = (start_xy, start_heading_rad);
        self
    }

    /// The same world with more in it.
    #[must_use]
    pub fn with_more(mut self, parts: Vec<Part>) -> Self {
        self.from.parts.extend(parts);
        Self::new(self.from)
    }

    /// The height field.
    #[must_use]
    pub fn ground(&self) -> &Ground {
        &self.from.ground
    }

    /// Height of the ground at (x, y), m; beyond the rectangle the border's height goes on.
    #[must_use]
    pub fn ground_height(&self, x: f64, y: f64) -> f64 {
        self.from.ground.height(x, y)
    }

    /// All solid parts; [`Surface::Part`] indexes them.
    #[must_use]
    pub fn parts(&self) -> &[Part] {
        &self.from.parts
    }

    /// Centre and radius of a sphere around each part.
    #[must_use]
    pub fn bounding_spheres(&self) -> &[(Vec3, f64)] {
        self.grid.spheres()
    }

    /// The trees in outline.
    #[must_use]
    pub fn trees(&self) -> &[Tree] {
        &self.from.trees
    }

    /// Light and colours.
    #[must_use]
    pub fn look(&self) -> &Look {
        &self.from.look
    }

    /// Whether (x, y) lies in the populated rectangle shrunk by `margin` m on each side.
    #[must_use]
    pub fn contains_xy(&self, x: f64, y: f64, margin: f64) -> bool {
        let (min, max) = (self.from.min_xy, self.from.max_xy);
        x >= min[0] + margin && x <= max[0] - margin && y >= min[1] + margin && y <= max[1] - margin
    }

    /// Signed distance from a point to the surface of the nearest obstacle, the ground not among them, m.
    ///
    /// Exact outside, up to [`CLEARANCE_CAP_M`]; inside an obstacle it is negative and, for cones and where parts
    /// overlap, a bound on the depth.
    #[must_use]
    pub fn clearance(&self, point_world: &Vec3) -> f64 {
        self.grid.clearance(point_world, &self.from.parts, CLEARANCE_CAP_M)
    }

    /// As [`World::clearance`], the ground included (its distance a lower bound, exact where it is level).
    #[must_use]
    pub fn clearance_with_ground(&self, point_world: &Vec3) -> f64 {
        let gap = point_world.z - self.ground_height(point_world.x, point_world.y);
        let slope = self.from.ground.slope_bound();
        self.clearance(point_world).min(gap / (1.0 + slope * slope).sqrt())
    }

    /// The first thing on the ray from `origin_world` along the unit vector `dir_world`, within `max_m`.
    #[must_use]
    pub fn ray_cast(&self, origin_world: &Vec3, dir_world: &Vec3, max_m: f64) -> Option<Hit> {
        let part = self.grid.ray_cast(origin_world, dir_world, max_m, &self.from.parts);
        let limit = part.as_ref().map_or(max_m, |hit| hit.distance_m);
        self.from
            .ground
            .ray_cast(origin_world, dir_world, limit)
            .map(|distance_m| Hit { distance_m, surface: Surface::Ground })
            .or(part)
    }

    /// Whether an obstacle or the ground lies between two points.
    #[must_use]
    pub fn occluded(&self, from_world: &Vec3, to_world: &Vec3) -> bool {
        let along = to_world - from_world;
        let length = along.norm();
        length > 1e-9 && self.ray_cast(from_world, &(along / length), length).is_some()
    }
}
