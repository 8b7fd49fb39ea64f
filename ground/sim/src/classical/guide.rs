//! How far it is to the goal around what is known: Dijkstra's distances in coarse cells. As the search's heuristic it
//! leads out of pockets, which a straight distance makes it fill with states first.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use goshawk_core::Vec3;

use super::distance::DistanceField;

/// Edge of a cell, m, and cells along x, y, z about the start: 20.8 × 20.8 × 3.2 m.
const CELL_M: f64 = 0.4;
const SIZE: [i32; 3] = [52, 52, 8];
/// A cell is passed if its centre is at least this far from an occupied voxel, m: less than the search demands, because
/// a way may pass beside the centre.
const PASS_M: f64 = 0.3;
/// Steps to neighbours, and their length in tenths of a cell.
const STEPS: [([i32; 3], u32); 10] = [
    ([1, 0, 0], 10),
    ([-1, 0, 0], 10),
    ([0, 1, 0], 10),
    ([0, -1, 0], 10),
    ([1, 1, 0], 14),
    ([1, -1, 0], 14),
    ([-1, 1, 0], 14),
    ([-1, -1, 0], 14),
    ([0, 0, 1], 10),
    ([0, 0, -1], 10),
];
/// Ways longer than that from the start by more than this are of no interest, tenths of a cell.
const MARGIN: u32 = 80;

/// Distances to one goal.
#[derive(Clone, Debug)]
pub struct Guide {
    low: Vec3,
    /// Tenths of a cell to the goal; `u32::MAX`: not reached.
    tenths: Vec<u32>,
}

impl Guide {
    /// Measures from `goal` back to `start` and a little farther.
    #[must_use]
    pub fn new(field: &DistanceField, start: &Vec3, goal: &Vec3) -> Self {
        let middle = Vec3::new(start.x, start.y, 0.5 * (start.z + goal.z));
        let low = middle - Vec3::from_fn(|axis, _| 0.5 * CELL_M * f64::from(SIZE[axis]));
        let cells = SIZE.iter().map(|n| *n as usize).product();
        let mut guide = Self { low, tenths: vec![u32::MAX; cells] };
        let (Some(from), to) = (guide.cell(goal), guide.cell(start).map(|cell| index(&cell))) else { return guide };
        let mut open = BinaryHeap::from([Reverse((0, from))]);
        guide.tenths[index(&from)] = 0;
        let mut end = u32::MAX;
        while let Some(Reverse((tenths, cell))) = open.pop() {
            if tenths > guide.tenths[index(&cell)] {
                continue;
            }
            if tenths > end {
                break;
            }
            if Some(index(&cell)) == to {
                end = tenths + MARGIN;
            }
            for (step, length) in STEPS {
                let next: [i32; 3] = std::array::from_fn(|axis| cell[axis] + step[axis]);
                let inside = (0..3).all(|axis| (0..SIZE[axis]).contains(&next[axis]));
                if !inside || guide.tenths[index(&next)] <= tenths + length {
                    continue;
                }
                // The vehicle may stand too near to something already.
                if Some(index(&next)) == to || field.coarse(&guide.centre(&next)) >= PASS_M {
                    guide.tenths[index(&next)] = tenths + length;
                    open.push(Reverse((tenths + length, next)));
                }
            }
        }
        guide
    }

    /// How far it is from a point to the goal, m; none: no way is known.
    #[must_use]
    pub fn remaining_m(&self, from: &Vec3) -> Option<f64> {
        let tenths = self.tenths[index(&self.cell(from)?)];
        (tenths < u32::MAX).then(|| 0.1 * CELL_M * f64::from(tenths))
    }

    fn cell(&self, at: &Vec3) -> Option<[i32; 3]> {
        let from = (at - self.low) / CELL_M;
        let cell = std::array::from_fn(|axis| from[axis].floor() as i32);
        (0..3).all(|axis| (0..SIZE[axis]).contains(&cell[axis])).then_some(cell)
    }

    fn centre(&self, cell: &[i32; 3]) -> Vec3 {
        self.low + Vec3::from_fn(|axis, _| f64::from(cell[axis]) + 0.5) * CELL_M
    }
}

fn index(cell: &[i32; 3]) -> usize {
    ((cell[2] * SIZE[1] + cell[1]) * SIZE[0] + cell[0]) as usize
}
