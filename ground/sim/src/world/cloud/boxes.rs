//! Voxels merged into boxes, greedily: along x, then y, then z.

use super::{VOXEL_M, Voxels, centre};
use crate::world::Cuboid;
use std::collections::BTreeSet;

/// A box has at most so many voxels along an axis: large ones would have loose bounds.
const LENGTH_MAX: i64 = 12;

/// Colour of what has none, linear light.
const GREY: [f32; 3] = [0.25, 0.24, 0.22];

/// Some voxels as one box.
pub(super) struct Merged {
    pub(super) cuboid: Cuboid,
    /// Mean colour, linear light.
    pub(super) tint: [f32; 3],
}

/// Boxes that together fill exactly the voxels.
pub(super) fn merge(voxels: &Voxels) -> Vec<Merged> {
    let mut left: BTreeSet<[i64; 3]> = voxels.keys().copied().collect();
    let mut merged = Vec::new();
    while let Some(first) = left.first().copied() {
        let mut last = first;
        for axis in 0..3 {
            while last[axis] - first[axis] + 1 < LENGTH_MAX {
                let mut next = last;
                next[axis] += 1;
                let mut low = first;
                low[axis] = next[axis];
                if !cells(low, next).all(|cell| left.contains(&cell)) {
                    break;
                }
                last = next;
            }
        }
        let (mut colour, mut coloured) = ([0.0f32; 3], 0u32);
        for cell in cells(first, last) {
            left.remove(&cell);
            let voxel = voxels[&cell];
            coloured += voxel.coloured;
            for (sum, part) in colour.iter_mut().zip(voxel.colour) {
                *sum += part;
            }
        }
        let half = [0, 1, 2].map(|axis| 0.5 * VOXEL_M * (last[axis] - first[axis] + 1) as f64);
        merged.push(Merged {
            cuboid: Cuboid { centre: (centre(first) + centre(last)) * 0.5, half: half.into(), yaw_rad: 0.0 },
            tint: if coloured == 0 { GREY } else { colour.map(|sum| sum / coloured as f32) },
        });
    }
    merged
}

/// All cells from `first` to `last`, both included.
fn cells(first: [i64; 3], last: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    (first[2]..=last[2])
        .flat_map(move |z| (first[1]..=last[1]).flat_map(move |y| (first[0]..=last[0]).map(move |x| [x, y, z])))
}
