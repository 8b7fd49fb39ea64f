//! The ground under a cloud: its lowest points, opened by a window wider than what stands on it.

use super::{VOXEL_M, Voxels};
use crate::world::Ground;

/// Distance between the ground's nodes, m.
const CELL_M: f64 = 0.5;
/// Things narrower than twice this do not become hills, m.
const WINDOW_M: f64 = 4.5;

/// Heights by node, row-major with x fastest.
struct Heights {
    nx: usize,
    ny: usize,
    values: Vec<f64>,
}

impl Heights {
    /// Each node becomes `pick` over the square of nodes within `reach`, axis by axis.
    fn filter(&mut self, reach: usize, pick: fn(f64, f64) -> f64) {
        for (count, stride, lines, line_stride) in [(self.nx, 1, self.ny, self.nx), (self.ny, self.nx, self.nx, 1)] {
            for line in 0..lines {
                let at = |i: usize| line * line_stride + i * stride;
                let row: Vec<f64> = (0..count).map(|i| self.values[at(i)]).collect();
                for i in 0..count {
                    let window = &row[i.saturating_sub(reach)..(i + reach + 1).min(count)];
                    self.values[at(i)] = window.iter().copied().reduce(pick).unwrap_or(row[i]);
                }
            }
        }
    }

    /// Means over the square of nodes within `reach`.
    fn smooth(&mut self, reach: usize) {
        let ones = Self { nx: self.nx, ny: self.ny, values: vec![1.0; self.values.len()] };
        let mut weights = ones;
        self.filter(reach, |a, b| a + b);
        weights.filter(reach, |a, b| a + b);
        for (value, weight) in self.values.iter_mut().zip(weights.values) {
            *value /= weight;
        }
    }
}

/// The height field under the voxels, over the rectangle from `low` to `high`.
pub(super) fn ground(voxels: &Voxels, low: [f64; 2], high: [f64; 2]) -> Ground {
    let count = |axis: usize| ((high[axis] - low[axis]) / CELL_M).ceil() as usize + 1;
    let (nx, ny) = (count(0).max(2), count(1).max(2));
    let mut lowest = Heights { nx, ny, values: vec![f64::INFINITY; nx * ny] };
    for [x, y, z] in voxels.keys() {
        let node = |index: i64, axis: usize| (((index as f64 + 0.5) * VOXEL_M - low[axis]) / CELL_M).round() as usize;
        let cell = node(*y, 1).min(ny - 1) * nx + node(*x, 0).min(nx - 1);
        lowest.values[cell] = lowest.values[cell].min((*z as f64 + 0.5) * VOXEL_M);
    }
    // Where nothing was seen the nearest heights go on.
    while lowest.values.iter().any(|v| v.is_infinite()) {
        let mut spread = Heights { nx, ny, values: lowest.values.clone() };
        spread.filter(1, f64::min);
        for (value, near) in lowest.values.iter_mut().zip(spread.values) {
            if value.is_infinite() {
                *value = near;
            }
        }
    }
    let reach = (WINDOW_M / CELL_M).round() as usize;
    lowest.filter(reach, f64::min);
    lowest.filter(reach, f64::max);
    lowest.smooth(1);
    Ground::from_fn(low, high, CELL_M, |x, y| {
        let (ix, iy) = (((x - low[0]) / CELL_M).round() as usize, ((y - low[1]) / CELL_M).round() as usize);
        lowest.values[iy.min(ny - 1) * nx + ix.min(nx - 1)]
    })
}
