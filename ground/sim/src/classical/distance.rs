//! The local distance field: from each voxel about the vehicle to the nearest occupied one, Euclidean, cut at 2 m.
//!
//! Cut, the exact transform is a short min-plus window along each axis in turn, of squared distances that fit a byte:
//! the compiler makes vectors of them.

use goshawk_core::Vec3;

use super::map::{self, Map, PER_M, Voxel};

/// Distances are exact up to this, m; larger ones are this.
pub const CAP_M: f64 = 2.0;

/// Voxels along x, y, z: 20 × 20 × 4 m.
const SIZE: [usize; 3] = [100, 100, 20];
/// `CAP_M` in voxels, and its square.
const REACH: usize = 10;
const FAR: u8 = (REACH * REACH) as u8;

/// Distances in a box about the vehicle; outside it everything is far from anything.
#[derive(Clone, Debug)]
pub struct DistanceField {
    low: Voxel,
    /// Squared distance in voxels: along x, along x and y, along all.
    along_x: Vec<u8>,
    along_xy: Vec<u8>,
    along_all: Vec<u8>,
    /// Rows of x with nothing in them.
    bare: Vec<bool>,
    /// Distance of a squared one, m.
    metres: [f64; FAR as usize + 1],
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
            along_all: vec![FAR; voxels],
            bare: vec![true; SIZE[1] * SIZE[2]],
            metres: std::array::from_fn(|squared| (squared as f64).sqrt() / PER_M),
        }
    }

    /// Measures the middle of the map.
    pub fn update(&mut self, map: &Map) {
        let Some(low) = map.low() else { return };
        self.low = low + Voxel::from_fn(|axis, _| (map::SIZE[axis] - SIZE[axis] as i32) / 2);
        self.sweep_x(map);
        self.sweep_y();
        self.sweep_z();
    }

    fn sweep_x(&mut self, map: &Map) {
        for (row, out) in self.along_x.chunks_exact_mut(SIZE[0]).enumerate() {
            let first = self.low + Voxel::new(0, (row % SIZE[1]) as i32, (row / SIZE[1]) as i32);
            // Distance to the last obstacle seen when coming from the left, then from the right.
            let mut since = REACH;
            for (out, occupied) in out.iter_mut().zip(map.row(&first)) {
                since = if occupied { 0 } else { (since + 1).min(REACH) };
                *out = since as u8;
            }
            self.bare[row] = since == REACH && !out.contains(&0);
            since = REACH;
            for out in out.iter_mut().rev() {
                since = if *out == 0 { 0 } else { (since + 1).min(REACH) };
                *out = (*out).min(since as u8).pow(2);
            }
        }
    }

    fn sweep_y(&mut self) {
        let [nx, ny, nz] = SIZE;
        for z in 0..nz {
            for y in 0..ny {
                let out = &mut self.along_xy[(z * ny + y) * nx..][..nx];
                out.fill(FAR);
                for from in y.saturating_sub(REACH)..(y + REACH + 1).min(ny) {
                    if !self.bare[z * ny + from] {
                        least(out, &self.along_x[(z * ny + from) * nx..][..nx], y.abs_diff(from));
                    }
                }
            }
        }
    }

    fn sweep_z(&mut self) {
        let (layer, nz) = (SIZE[0] * SIZE[1], SIZE[2]);
        for z in 0..nz {
            let out = &mut self.along_all[z * layer..(z + 1) * layer];
            out.fill(FAR);
            for from in z.saturating_sub(REACH)..(z + REACH + 1).min(nz) {
                least(out, &self.along_xy[from * layer..(from + 1) * layer], z.abs_diff(from));
            }
        }
    }

    fn at(&self, from_low: [usize; 3]) -> f64 {
        let squared = self.along_all[(from_low[2] * SIZE[1] + from_low[1]) * SIZE[0] + from_low[0]];
        self.metres[usize::from(squared)]
    }

    /// From the voxel that holds `pos_world` to the nearest occupied one, centre to centre, m.
    #[must_use]
    pub fn coarse(&self, pos_world: &Vec3) -> f64 {
        let from = pos_world * PER_M - self.low.map(f64::from);
        let inside = (0..3).all(|axis| from[axis] >= 0.0 && from[axis] < SIZE[axis] as f64);
        if inside { self.at([from.x as usize, from.y as usize, from.z as usize]) } else { CAP_M }
    }

    /// The distance between voxels' centres interpolated at `pos_world`, m, and its gradient.
    #[must_use]
    pub fn sample(&self, pos_world: &Vec3) -> (f64, Vec3) {
        let place = pos_world * PER_M - self.low.map(f64::from) - Vec3::repeat(0.5);
        let inside = (0..3).all(|axis| place[axis] >= 0.0 && place[axis] < (SIZE[axis] - 1) as f64);
        if !inside {
            return (CAP_M, Vec3::zeros());
        }
        let low = place.map(|x| x as usize);
        let part = place - low.map(|i| i as f64);
        let (mut value, mut gradient) = (0.0, Vec3::zeros());
        for corner in 0..8 {
            let step = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
            let distance = self.at([low.x + step[0], low.y + step[1], low.z + step[2]]);
            let w = Vec3::from_fn(|axis, _| if step[axis] == 1 { part[axis] } else { 1.0 - part[axis] });
            let slope = Vec3::from_fn(|axis, _| if step[axis] == 1 { PER_M } else { -PER_M });
            value += distance * w.product();
            gradient += slope.component_mul(&Vec3::new(w.y * w.z, w.x * w.z, w.x * w.y)) * distance;
        }
        (value, gradient)
    }
}

/// out ← min(out, from + offset²), at most `2 · FAR`.
fn least(out: &mut [u8], from: &[u8], offset: usize) {
    let squared = (offset * offset) as u8;
    for (out, from) in out.iter_mut().zip(from) {
        *out = (*out).min(from + squared);
    }
}
