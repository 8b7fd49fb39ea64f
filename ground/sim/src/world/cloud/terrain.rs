//! The ground under a cloud: its lowest points, without strays, and without those that stand higher over others than
//! ground can climb.

use std::collections::BTreeMap;

use super::{VOXEL_M, Voxels};
use crate::world::Ground;

/// Distance between the ground's nodes, m.
const CELL_M: f64 = 0.5;
/// No ground is steeper than this (rise over run): what is higher over a lower point is a crown, a roof, a table.
const SLOPE: f64 = 0.5;

/// A voxel with no other so near is a stray, such as a reflection below the ground, voxels: 1 m.
const ALONE: i64 = 5;

/// How many voxels there are in each cube with edges of [`ALONE`] voxels.
struct Crowd(BTreeMap<[i64; 3], usize>);

impl Crowd {
    fn of(voxels: &Voxels) -> Self {
        let mut cubes = BTreeMap::new();
        for index in voxels.keys() {
            *cubes.entry(index.map(|i| i.div_euclid(ALONE))).or_insert(0) += 1;
        }
        Self(cubes)
    }

    /// In its cube and those about it there is no other voxel.
    fn is_alone(&self, index: &[i64; 3]) -> bool {
        let [x, y, z] = index.map(|i| i.div_euclid(ALONE));
        let about =
            (-1..=1).flat_map(|dx| (-1..=1).flat_map(move |dy| (-1..=1).map(move |dz| [x + dx, y + dy, z + dz])));
        about.filter_map(|cube| self.0.get(&cube)).sum::<usize>() <= 1
    }
}

/// Heights by node, row-major with x fastest; infinite where nothing is known.
struct Heights {
    nx: usize,
    ny: usize,
    values: Vec<f64>,
}

impl Heights {
    fn new(nx: usize, ny: usize) -> Self {
        Self { nx, ny, values: vec![f64::INFINITY; nx * ny] }
    }

    /// The nearest node's height, beyond the grid the border's.
    fn at(&self, x: i64, y: i64) -> f64 {
        let within = |index: i64, count: usize| index.clamp(0, count as i64 - 1) as usize;
        self.values[within(y, self.ny) * self.nx + within(x, self.nx)]
    }

    /// The highest surface below these heights that is nowhere steeper than [`SLOPE`]: one sweep down the grid and one
    /// back up, each node against the four neighbours before it.
    fn envelope(&self) -> Self {
        let mut low = Self { values: self.values.clone(), ..*self };
        for back in [false, true] {
            let sign = if back { -1 } else { 1 };
            for i in 0..low.values.len() {
                let i = if back { low.values.len() - 1 - i } else { i };
                let (x, y) = ((i % low.nx) as i64, (i / low.nx) as i64);
                for (dx, dy) in [(-1, 0), (-1, -1), (0, -1), (1, -1)] {
                    let run_m = CELL_M * f64::from(dx * dx + dy * dy).sqrt();
                    let climbed = low.at(x + i64::from(sign * dx), y + i64::from(sign * dy)) + SLOPE * run_m;
                    low.values[i] = low.values[i].min(climbed);
                }
            }
        }
        low
    }

    /// Gives unknown nodes heights between those of the known ones: means of fours on ever coarser grids until all is
    /// known, then back, bilinear.
    fn fill(&mut self) {
        if self.values.iter().all(|v| v.is_finite()) || self.values.len() == 1 {
            return;
        }
        let mut coarse = Self::new(self.nx.div_ceil(2), self.ny.div_ceil(2));
        for y in 0..coarse.ny {
            for x in 0..coarse.nx {
                let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| (2 * x + dx, 2 * y + dy));
                let known = four.iter().filter(|(x, y)| *x < self.nx && *y < self.ny);
                let known = known.map(|(x, y)| self.values[y * self.nx + x]).filter(|v| v.is_finite());
                let (sum, count) = known.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
                coarse.values[y * coarse.nx + x] = if count > 0.0 { sum / count } else { f64::INFINITY };
            }
        }
        coarse.fill();
        for i in 0..self.values.len() {
            if self.values[i].is_infinite() {
                let place = |index: usize| {
                    let at = 0.5 * index as f64 - 0.25;
                    (at.floor() as i64, at - at.floor())
                };
                let ((x, fx), (y, fy)) = (place(i % self.nx), place(i / self.nx));
                let row = |y: i64| coarse.at(x, y) * (1.0 - fx) + coarse.at(x + 1, y) * fx;
                self.values[i] = row(y) * (1.0 - fy) + row(y + 1) * fy;
            }
        }
    }

    /// Means over each node and its eight neighbours.
    fn smooth(&mut self) {
        let mean = |i: usize| {
            let (x, y) = ((i % self.nx) as i64, (i / self.nx) as i64);
            (-1..=1)
                .flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)))
                .map(|(dx, dy)| self.at(x + dx, y + dy))
                .sum::<f64>()
                / 9.0
        };
        self.values = (0..self.values.len()).map(mean).collect();
    }
}

/// The height field under the voxels, over the rectangle from `low` to `high`.
pub(super) fn ground(voxels: &Voxels, low: [f64; 2], high: [f64; 2]) -> Ground {
    let count = |axis: usize| ((high[axis] - low[axis]) / CELL_M).ceil() as usize + 1;
    let mut heights = Heights::new(count(0).max(2), count(1).max(2));
    let node = |metres: f64, axis: usize, count: usize| {
        (((metres - low[axis]) / CELL_M).round().max(0.0) as usize).min(count - 1)
    };
    let crowd = Crowd::of(voxels);
    for index in voxels.keys() {
        let [x, y, z] = index.map(|i| (i as f64 + 0.5) * VOXEL_M);
        let cell = node(y, 1, heights.ny) * heights.nx + node(x, 0, heights.nx);
        if z < heights.values[cell] && !crowd.is_alone(index) {
            heights.values[cell] = z;
        }
    }
    let envelope = heights.envelope();
    for (height, below) in heights.values.iter_mut().zip(envelope.values) {
        if *height > below {
            *height = f64::INFINITY;
        }
    }
    heights.fill();
    heights.smooth();
    Ground::from_fn(low, high, CELL_M, |x, y| {
        heights.values[node(y, 1, heights.ny) * heights.nx + node(x, 0, heights.nx)]
    })
}
