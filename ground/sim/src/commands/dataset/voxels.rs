//! Obstacles as points: the centres of a voxel grid that lie in or near a solid.

use crate::world::World;
use goshawk_core::Vec3;

/// Edge of a voxel, m. Centres are at odd multiples of half of it in each world coordinate.
pub const VOXEL_M: f64 = 0.2;

/// Centres no further than this outside an obstacle count, m.
const REACH_M: f64 = 0.1;

/// All voxel centres of the world's box that are inside or within 0.1 m of an obstacle (not the ground), ordered by
/// z, y, x.
#[must_use]
pub fn obstacle_voxels(world: &World) -> Vec<[f32; 3]> {
    let cell = |x: f64| (x / VOXEL_M).floor() as i64;
    let (min, max) = (world.min_world(), world.max_world());
    let low = [cell(min.x), cell(min.y), cell(min.z)];
    let size: [usize; 3] = std::array::from_fn(|i| (cell(max[i]) - low[i] + 1) as usize);
    let centre = |index: i64| (index as f64 + 0.5) * VOXEL_M;
    let mut solid = vec![false; size[0] * size[1] * size[2]];
    for part in world.parts() {
        let (from, to) = part.shape.aabb();
        let range = |axis: usize| {
            let first = cell(from[axis] - REACH_M).max(low[axis]);
            let last = cell(to[axis] + REACH_M).min(low[axis] + size[axis] as i64 - 1);
            first..=last
        };
        for iz in range(2) {
            for iy in range(1) {
                let row = ((iz - low[2]) as usize * size[1] + (iy - low[1]) as usize) * size[0];
                for ix in range(0) {
                    let at = row + (ix - low[0]) as usize;
                    let point = Vec3::new(centre(ix), centre(iy), centre(iz));
                    solid[at] = solid[at] || part.shape.signed_distance(&point) <= REACH_M;
                }
            }
        }
    }
    let mut points = Vec::new();
    for (index, _) in solid.iter().enumerate().filter(|(_, solid)| **solid) {
        let (ix, iy, iz) = (index % size[0], index / size[0] % size[1], index / (size[0] * size[1]));
        let at = |i: usize, axis: usize| centre(low[axis] + i as i64) as f32;
        points.push([at(ix, 0), at(iy, 1), at(iz, 2)]);
    }
    points
}
