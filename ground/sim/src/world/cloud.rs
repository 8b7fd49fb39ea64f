//! Any point cloud as a world: `.ply` (ASCII or binary) and `.pcd` (all kinds), metres, z up.
//!
//! Points are gathered in voxels; the ground is found under them; what stands on it is merged into boxes, so that a
//! scanned world is asked and drawn like any other.

mod boxes;
mod read;
mod scan;
mod terrain;
mod write;

pub use scan::scan;
pub use write::write_ply;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::world::{Kind, Look, Part, Shape, World, WorldParts};
use goshawk_core::Vec3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use thiserror::Error;

/// Edge of a voxel, m: the map's resolution in training and in the public data sets.
pub const VOXEL_M: f64 = 0.2;
/// What is lower than this over the ground belongs to it, m.
const GROUND_LAYER_M: f64 = 0.25;
/// The world's rectangle reaches this far beyond the points, m.
const BORDER_M: f64 = 1.0;
/// Clouds wider than this are refused, m: a few stray points would make the grid enormous.
const EXTENT_MAX_M: f64 = 2000.0;

/// Points farther from the origin are refused, m: colours are computed with seven digits.
const FARTHEST_M: f64 = 100_000.0;

/// Why a file is no world.
#[derive(Debug, Error)]
pub enum CloudError {
    /// Neither name is known.
    #[error("{0}: worlds are .ply or .pcd files (or forest, buildings)")]
    Kind(PathBuf),
    /// It cannot be read, or not as what its name says.
    #[error("{path}: {cause}")]
    Read {
        /// The file.
        path: PathBuf,
        /// In one line.
        cause: String,
    },
    /// There is nothing in it to fly around.
    #[error("{path}: {count} usable points are too few for a world; are x, y and z in metres?")]
    Empty {
        /// The file.
        path: PathBuf,
        /// How many there are.
        count: usize,
    },
    /// It spans more than can be held.
    #[error("{path}: the points span {extent:.0} m; crop it to {EXTENT_MAX_M} m, or is it in millimetres?")]
    Extent {
        /// The file.
        path: PathBuf,
        /// Its longer horizontal side, m.
        extent: f64,
    },
    /// It lies where nothing can be drawn.
    #[error(
        "{path}: the points lie {far:.0} m from the origin, as on a map; subtract whole metres from their coordinates"
    )]
    Far {
        /// The file.
        path: PathBuf,
        /// Of its farthest side, m.
        far: f64,
    },
}

/// One point of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// World frame, m.
    pub at: [f64; 3],
    /// Its colour as displayed; none: the file has none.
    pub rgb: Option<[u8; 3]>,
}

/// Voxels by their indices.
type Voxels = BTreeMap<[i64; 3], Voxel>;

/// What a voxel holds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Voxel {
    coloured: u32,
    /// Sum of linear-light colours.
    colour: [f32; 3],
}

/// Reads a cloud as a world. It starts in its middle, looking east; [`World::started_at`] moves that.
///
/// # Errors
/// See [`CloudError`].
pub fn load(path: &Path) -> Result<World, CloudError> {
    world(&read::points(path)?, path)
}

/// Makes a world of points that were read from `path`.
///
/// # Errors
/// See [`CloudError`].
pub fn world(points: &[Point], path: &Path) -> Result<World, CloudError> {
    let usable: Vec<&Point> = points.iter().filter(|p| p.at.iter().all(|c| c.is_finite())).collect();
    if usable.len() < 100 {
        return Err(CloudError::Empty { path: path.to_owned(), count: usable.len() });
    }
    let fold = |axis: usize, from: f64, pick: fn(f64, f64) -> f64| usable.iter().map(|p| p.at[axis]).fold(from, pick);
    let low: [f64; 2] = [0, 1].map(|axis| fold(axis, f64::INFINITY, f64::min) - BORDER_M);
    let high: [f64; 2] = [0, 1].map(|axis| fold(axis, f64::NEG_INFINITY, f64::max) + BORDER_M);
    let extent = (high[0] - low[0]).max(high[1] - low[1]);
    if extent > EXTENT_MAX_M {
        return Err(CloudError::Extent { path: path.to_owned(), extent });
    }
    let heights = [fold(2, f64::INFINITY, f64::min), fold(2, f64::NEG_INFINITY, f64::max)];
    let far = low.iter().chain(&high).chain(&heights).fold(0.0_f64, |far, side| far.max(side.abs()));
    if far > FARTHEST_M {
        return Err(CloudError::Far { path: path.to_owned(), far });
    }
    let mut voxels = Voxels::new();
    for point in usable {
        let voxel = voxels.entry(point.at.map(|c| (c / VOXEL_M).floor() as i64)).or_default();
        if let Some(rgb) = point.rgb {
            voxel.coloured += 1;
            for (sum, level) in voxel.colour.iter_mut().zip(rgb) {
                *sum += (f32::from(level) / 255.0).powi(2);
            }
        }
    }
    let ground = terrain::ground(&voxels, low, high);
    let standing: Voxels = voxels
        .into_iter()
        .filter(|(index, _)| {
            let [x, y, z] = index.map(|i| (i as f64 + 0.5) * VOXEL_M);
            z - ground.height(x, y) > GROUND_LAYER_M
        })
        .collect();
    let parts = boxes::merge(&standing)
        .into_iter()
        .map(|b| Part { shape: Shape::Cuboid(b.cuboid), kind: Kind::Scan, tint: b.tint })
        .collect();
    Ok(World::new(WorldParts {
        seed: 0,
        spacing_m: 0.0,
        min_xy: low,
        max_xy: high,
        start_xy: [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])],
        start_heading_rad: 0.0,
        ground,
        parts,
        trees: Vec::new(),
        look: Look::random(&mut ChaCha8Rng::seed_from_u64(0)),
    }))
}

/// A voxel's centre, world frame.
fn centre(index: [i64; 3]) -> Vec3 {
    Vec3::from(index.map(|i| (i as f64 + 0.5) * VOXEL_M))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor of 20 × 20 m with a wall of 0.2 × 4 × 2 m on it at x = 5.
    fn room() -> Vec<Point> {
        let step = |n: i32| (0..n).map(|i| 0.1 * f64::from(i) + 0.05);
        let floor = step(200).flat_map(|x| step(200).map(move |y| [x - 10.0, y - 10.0, 1.0]));
        let wall = step(40).flat_map(|y| step(20).map(move |z| [5.05, y - 2.0, 1.0 + z]));
        floor.chain(wall).map(|at| Point { at, rgb: Some([200, 40, 40]) }).collect()
    }

    #[test]
    fn the_floor_becomes_ground_and_the_wall_a_red_obstacle_where_it_is() {
        let world = world(&room(), Path::new("room.ply")).unwrap();
        assert!((world.ground_height(0.0, 0.0) - 1.0).abs() < 0.15, "{}", world.ground_height(0.0, 0.0));
        let clearance = world.clearance(&Vec3::new(0.0, 0.0, 2.0));
        assert!((clearance - 5.0).abs() < 0.11, "{clearance}");
        assert!(world.clearance(&Vec3::new(5.1, 0.0, 2.0)) < 0.0);
        assert!(world.clearance(&Vec3::new(5.1, 0.0, 3.4)) > 0.2);
        assert!(world.parts().len() < 40, "merged: {}", world.parts().len());
        assert!(world.parts().iter().all(|p| p.tint[0] > 4.0 * p.tint[1] && p.kind == Kind::Scan));
    }

    #[test]
    fn a_stray_point_below_the_floor_digs_no_pit() {
        let mut cloud = room();
        cloud.extend([[0.0, 0.0, -9.0], [3.0, 2.0, -29.0]].map(|at| Point { at, rgb: None }));
        let world = world(&cloud, Path::new("room.ply")).unwrap();
        for (x, y) in [(0.0, 0.0), (3.0, 2.0), (-8.0, 4.0)] {
            assert!((world.ground_height(x, y) - 1.0).abs() < 0.15, "{} at {x}, {y}", world.ground_height(x, y));
        }
    }

    #[test]
    fn crowns_and_roofs_are_no_hills_even_without_a_point_of_the_ground_below_them() {
        // Stems 4 m apart on a slope of 0.1, and over all of it leaves at 3 m; no other point of the ground.
        let step = |n: i32, m: f64| (0..n).map(move |i| m * f64::from(i) + 0.05);
        let slope = |x: f64| 0.1 * x;
        let stems = step(6, 4.0).flat_map(|x| step(6, 4.0).flat_map(move |y| step(20, 0.1).map(move |z| [x, y, z])));
        let leaves = step(200, 0.1).flat_map(|x| step(200, 0.1).map(move |y| [x, y, 3.0]));
        let cloud = stems.chain(leaves).map(|[x, y, z]| Point { at: [x, y, z + slope(x)], rgb: None });
        let world = world(&cloud.collect::<Vec<_>>(), Path::new("grove.ply")).unwrap();
        for (x, y) in [(4.0, 4.0), (6.0, 6.0), (10.0, 2.0), (14.0, 17.0)] {
            let off = world.ground_height(x, y) - slope(x);
            assert!(off.abs() < 0.3, "{off} at {x}, {y}");
        }
        assert!(world.clearance(&Vec3::new(6.0, 6.0, 2.0)) > 0.8);
    }

    #[test]
    fn nothing_millimetres_and_other_files_are_refused_in_one_line() {
        let few = world(&room()[..50], Path::new("few.ply")).unwrap_err().to_string();
        assert!(few.contains("few.ply") && few.contains("50"), "{few}");
        let mut wide = room();
        wide[0].at[0] = 1e5;
        let wide = world(&wide, Path::new("wide.ply")).unwrap_err().to_string();
        assert!(wide.contains("millimetres"), "{wide}");
        let mut on_a_map = room();
        on_a_map.iter_mut().for_each(|point| point.at[1] += 5.2e6);
        let mut high = room();
        high[0].at[2] = 1e30;
        for far in [on_a_map, high] {
            let far = world(&far, Path::new("map.ply")).unwrap_err().to_string();
            assert!(far.contains("subtract whole metres") && far.lines().count() == 1, "{far}");
        }
        let other = load(Path::new("world.obj")).unwrap_err().to_string();
        assert!(other.contains(".ply or .pcd"), "{other}");
        let missing = load(Path::new("no/such.pcd")).unwrap_err().to_string();
        assert!(missing.contains("no/such.pcd") && missing.lines().count() == 1, "{missing}");
    }
}
