//! The height field into the depth buffer.

use super::ID_GROUND;
use super::camera::CameraPose;
use super::raster::Canvas;
use crate::world::Ground;

/// Rays that have not met the ground by here take the mean level, m of depth.
const FAR_M: f32 = 60.0;
const STEPS: usize = 40;

/// Heights in single precision, positions in cells from node (0, 0).
struct Field<'a> {
    heights: &'a [f32],
    nx: usize,
    max_ix: f32,
    max_iy: f32,
}

impl Field<'_> {
    fn height(&self, x: f32, y: f32) -> f32 {
        // Minus a little, so that the last cell holds its far border.
        let (x, y) = (x.clamp(0.0, self.max_ix), y.clamp(0.0, self.max_iy));
        let (ix, iy) = (x as usize, y as usize);
        let (fx, fy) = (x - ix as f32, y - iy as f32);
        let first = iy * self.nx + ix;
        let near = &self.heights[first..first + 2];
        let far = &self.heights[first + self.nx..first + self.nx + 2];
        let low = near[0] + (near[1] - near[0]) * fx;
        let high = far[0] + (far[1] - far[0]) * fx;
        low + (high - low) * fy
    }
}

/// Draws the ground wherever nothing nearer is drawn already.
pub(super) fn draw(ground: &Ground, pose: &CameraPose, canvas: &mut Canvas) {
    let (ny, nx) = ground.shape();
    let inv_cell = (1.0 / ground.cell_m()) as f32;
    let inside = |n: usize| (n - 1) as f32 * (1.0 - f32::EPSILON) - 1e-4;
    let field = Field { heights: ground.heights(), nx, max_ix: inside(nx), max_iy: inside(ny) };
    let (low, high) = ground.range();
    let (low, high, slope) = (low as f32, high as f32, ground.slope_bound() as f32);
    let [min_x, min_y] = ground.min_xy();
    let ox = (pose.pos_world.x - min_x) as f32 * inv_cell;
    let oy = (pose.pos_world.y - min_y) as f32 * inv_cell;
    let oz = pose.pos_world.z as f32;
    let rotation = pose.rotation();

    for v in 0..canvas.rays.height {
        let row_dir = rotation.column(0) + rotation.column(2) * canvas.rays.dz[v];
        let row = v * canvas.rays.width;
        for u in 0..canvas.rays.width {
            let dir = row_dir + rotation.column(1) * canvas.rays.dy[u];
            // The ray enters the layer of the hills at `t`.
            let mut t = if oz > high {
                if dir.z >= 0.0 {
                    continue;
                }
                (high - oz) / dir.z
            } else {
                0.0
            };
            let limit = canvas.depth[row + u];
            if t >= limit {
                continue;
            }
            let (dx, dy) = (dir.x * inv_cell, dir.y * inv_cell);
            // The gap closes no faster than this for each metre of depth.
            let closing = slope * (dir.x * dir.x + dir.y * dir.y).sqrt() - dir.z;
            if closing <= 0.0 {
                continue;
            }
            let inv_closing = 1.0 / closing;
            let (mut before, mut gap_before) = (t, f32::INFINITY);
            let mut open = true;
            for _ in 0..STEPS {
                let gap = oz + t * dir.z - field.height(ox + t * dx, oy + t * dy);
                if gap < 4e-3 {
                    // One secant step from the last two gaps; the surface is smooth at this scale.
                    let rate =
                        if gap_before.is_finite() && t > before { (gap_before - gap) / (t - before) } else { closing };
                    t += gap / rate.clamp(0.02 * closing, closing);
                    open = false;
                    break;
                }
                (before, gap_before) = (t, gap);
                t += gap * inv_closing;
                if t > limit.min(FAR_M) {
                    break;
                }
            }
            if open {
                // Far grazing rays: the mean level stands for the hills.
                if dir.z >= -1e-4 || limit.is_finite() && t < limit.min(FAR_M) {
                    continue;
                }
                t = t.max((0.5 * (low + high) - oz) / dir.z);
            }
            if t < limit && t > 0.0 {
                canvas.depth[row + u] = t;
                canvas.ids[row + u] = ID_GROUND;
            }
        }
    }
}
