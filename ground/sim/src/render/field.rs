//! The height field in single precision, for many places at once.

use crate::render::lanes::{each, floor, least, most};
use crate::world::Ground;

/// Single-precision access; positions in metres from node (0, 0).
pub(super) struct Field<'a> {
    heights: &'a [f32],
    nx: usize,
    max: [f32; 2],
    inv_cell: f32,
}

impl<'a> Field<'a> {
    pub(super) fn new(ground: &'a Ground) -> Self {
        let (ny, nx) = ground.shape();
        // A little inside, so that the last cell holds its far border.
        let inside = |n: usize| (n - 1) as f32 - 1e-3;
        let inv_cell = (1.0 / ground.cell_m()) as f32;
        Self { heights: ground.heights(), nx, max: [inside(nx), inside(ny)], inv_cell }
    }

    /// Heights, and slopes along x and y, m and without unit.
    #[inline(always)]
    pub(super) fn sample<const N: usize>(&self, x: &[f32; N], y: &[f32; N]) -> ([f32; N], [[f32; N]; 2]) {
        let cell = |at: f32, axis: usize| least(most(at * self.inv_cell, 0.0), self.max[axis]);
        let first: [u32; N] = each(|i| floor(cell(y[i], 1)) as u32 * self.nx as u32 + floor(cell(x[i], 0)) as u32);
        let mut corners = [[0.0; N]; 4];
        for i in 0..N {
            let near = first[i] as usize;
            let far = near + self.nx;
            let (near, far) = (&self.heights[near..near + 2], &self.heights[far..far + 2]);
            (corners[0][i], corners[1][i], corners[2][i], corners[3][i]) = (near[0], near[1], far[0], far[1]);
        }
        let (mut height, mut along_x, mut along_y) = ([0.0; N], [0.0; N], [0.0; N]);
        for i in 0..N {
            let (cx, cy) = (cell(x[i], 0), cell(y[i], 1));
            let (fx, fy) = (cx - floor(cx) as f32, cy - floor(cy) as f32);
            let [a, b, c, d] = [corners[0][i], corners[1][i], corners[2][i], corners[3][i]];
            let (low, high) = (a + (b - a) * fx, c + (d - c) * fx);
            height[i] = low + (high - low) * fy;
            // Beyond the border the height goes on level.
            let (slope_x, slope_y) = ((b - a) + ((d - c) - (b - a)) * fy, high - low);
            along_x[i] = if cx == x[i] * self.inv_cell { slope_x * self.inv_cell } else { 0.0 };
            along_y[i] = if cy == y[i] * self.inv_cell { slope_y * self.inv_cell } else { 0.0 };
        }
        (height, [along_x, along_y])
    }
}
