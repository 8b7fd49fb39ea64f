//! The local distance field: from each voxel about the vehicle to the nearest occupied one, Euclidean, cut at 2 m.
//!
//! Cut, the exact transform is a short min-plus window along each axis in turn, which the compiler vectorises.

use goshawk_core::types::Vec3;

use super::map::{Knowledge, Map, VOXEL_M, Voxel, voxel_of};

/// Distances are exact up to this, m; larger ones are this.
pub const CAP_M: f64 = 2.0;

/// Voxels along x, y, z: 20 × 20 × 4 m.
const SIZE: [usize; 3] = [100, 100, 20];
/// `CAP_M` in voxels.
const REACH: usize = 10;
const FAR: f32 = (REACH * REACH) as f32;

/// Distances in a box about the vehicle; outside it everything is far from anything.
#[derive(Clone, Debug)]
pub struct DistanceField {
    low: Voxel,
    /// Squared distance in voxels along x, then along x and y.
    along_x: Vec<f32>,
    along_xy: Vec<f32>,
    /// Rows of x, and layers, with nothing near.
    bare_row: Vec<bool>,
    bare_layer: Vec<bool>,
    /// The distance, m.
    metres: Vec<f32>,
}

impl Default for DistanceField {
    fn default() -> Self {
        Self::new()
    }
}

impl DistanceField {
    /// A field far from anything.
    #[must_use]
    pub fn new() -> Self {
        let voxels = SIZE.iter().product();
        Self {
            low: Voxel::zeros(),
            along_x: vec![FAR; voxels],
            along_xy: vec![FAR; voxels],
            bare_row: vec![true; SIZE[1] * SIZE[2]],
            bare_layer: vec![true; SIZE[2]],
            metres: vec![CAP_M as f32; voxels],
        }
    }

    /// Measures the map about `centre_world`.
    pub fn update(&mut self, map: &Map, centre_world: &Vec3) {
        self.low = voxel_of(centre_world) - Voxel::new(SIZE[0] as i32, SIZE[1] as i32, SIZE[2] as i32) / 2;
        self.sweep_x(map);
        self.sweep_y();
        self.sweep_z();
    }

    fn sweep_x(&mut self, map: &Map) {
        for (row, out) in self.along_x.chunks_exact_mut(SIZE[0]).enumerate() {
            let (y, z) = (row % SIZE[1], row / SIZE[1]);
            // Distance to the last obstacle seen when coming from the left, then from the right.
            let mut since = REACH;
            let mut bare = true;
            for (x, out) in out.iter_mut().enumerate() {
                let occupied =
                    map.knowledge(&(self.low + Voxel::new(x as i32, y as i32, z as i32))) == Knowledge::Occupied;
                bare &= !occupied;
                since = if occupied { 0 } else { (since + 1).min(REACH) };
                *out = since as f32;
            }
            since = REACH;
            for out in out.iter_mut().rev() {
                since = if *out == 0.0 { 0 } else { (since + 1).min(REACH) };
                *out = out.min(since as f32).powi(2);
            }
            self.bare_row[row] = bare;
        }
    }

    fn sweep_y(&mut self) {
        let [nx, ny, nz] = SIZE;
        for z in 0..nz {
            let bare = &self.bare_row[z * ny..(z + 1) * ny];
            self.bare_layer[z] = bare.iter().all(|bare| *bare);
            for y in 0..ny {
                let out = &mut self.along_xy[(z * ny + y) * nx..][..nx];
                out.fill(FAR);
                for from in y.saturating_sub(REACH)..(y + REACH + 1).min(ny) {
                    if !bare[from] {
                        least(out, &self.along_x[(z * ny + from) * nx..][..nx], y.abs_diff(from));
                    }
                }
            }
        }
    }

    fn sweep_z(&mut self) {
        let [nx, ny, nz] = SIZE;
        let layer = nx * ny;
        for z in 0..nz {
            let out = &mut self.metres[z * layer..(z + 1) * layer];
            out.fill(FAR);
            for from in z.saturating_sub(REACH)..(z + REACH + 1).min(nz) {
                if !self.bare_layer[from] {
                    least(out, &self.along_xy[from * layer..(from + 1) * layer], z.abs_diff(from));
                }
            }
            for squared in out.iter_mut() {
                *squared = squared.sqrt() * VOXEL_M as f32;
            }
        }
    }

    fn at(&self, voxel: &Voxel) -> f64 {
        let from = voxel - self.low;
        let inside = (0..3).all(|axis| (0..SIZE[axis] as i32).contains(&from[axis]));
        if !inside {
            return CAP_M;
        }
        f64::from(self.metres[(from.z as usize * SIZE[1] + from.y as usize) * SIZE[0] + from.x as usize])
    }

    /// From the voxel that holds `pos_world` to the nearest occupied one, centre to centre, m.
    #[must_use]
    pub fn coarse(&self, pos_world: &Vec3) -> f64 {
        self.at(&voxel_of(pos_world))
    }

    /// The distance between voxels' centres interpolated at `pos_world`, m, and its gradient.
    #[must_use]
    pub fn sample(&self, pos_world: &Vec3) -> (f64, Vec3) {
        let place = pos_world / VOXEL_M - Vec3::repeat(0.5);
        let low = place.map(|x| x.floor() as i32);
        let part = place - low.map(f64::from);
        let (mut value, mut gradient) = (0.0, Vec3::zeros());
        for corner in 0..8 {
            let step = Voxel::new(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
            let distance = self.at(&(low + step));
            let weight = Vec3::from_fn(|axis, _| if step[axis] == 1 { part[axis] } else { 1.0 - part[axis] });
            let slope = step.map(|s| if s == 1 { 1.0 / VOXEL_M } else { -1.0 / VOXEL_M });
            value += distance * weight.product();
            gradient += distance
                * Vec3::new(
                    slope.x * weight.y * weight.z,
                    weight.x * slope.y * weight.z,
                    weight.x * weight.y * slope.z,
                );
        }
        (value, gradient)
    }
}

/// out ← min(out, from + offset²).
fn least(out: &mut [f32], from: &[f32], offset: usize) {
    let squared = (offset * offset) as f32;
    for (out, from) in out.iter_mut().zip(from) {
        *out = out.min(from + squared);
    }
}
