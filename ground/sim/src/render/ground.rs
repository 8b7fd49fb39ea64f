//! The height field into the depth buffer.

use super::ID_GROUND;
use super::camera::CameraPose;
use super::raster::Canvas;
use crate::world::Ground;

/// Rays that have not met the ground by here take the mean level, m of depth.
const FAR_M: f32 = 60.0;

/// Evaluations of the field for a ray; almost all need two or three.
const STEPS: usize = 40;

/// A gap of this size, or one that a step of this length along the ray closes, is closed by one last linear step, m.
const CLOSED_M: f32 = 1e-3;
const LAST_STEP_M: f32 = 0.08;

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

    /// Height and its slopes along x and y.
    #[inline]
    pub(super) fn sample(&self, x: f32, y: f32) -> (f32, f32, f32) {
        let (x, y) = (x * self.inv_cell, y * self.inv_cell);
        let (cx, cy) = (x.max(0.0).min(self.max[0]), y.max(0.0).min(self.max[1]));
        let (ix, iy) = (cx as i32, cy as i32);
        let (fx, fy) = (cx - ix as f32, cy - iy as f32);
        let first = iy as usize * self.nx + ix as usize;
        let near = &self.heights[first..first + 2];
        let far = &self.heights[first + self.nx..first + self.nx + 2];
        let (rise_near, rise_far) = (near[1] - near[0], far[1] - far[0]);
        let low = near[0] + rise_near * fx;
        let high = far[0] + rise_far * fx;
        // Beyond the border the height goes on level.
        let along_x = if cx == x { (rise_near + (rise_far - rise_near) * fy) * self.inv_cell } else { 0.0 };
        let along_y = if cy == y { (high - low) * self.inv_cell } else { 0.0 };
        (low + (high - low) * fy, along_x, along_y)
    }
}

/// Draws the ground wherever nothing nearer is drawn already.
pub(super) fn draw(ground: &Ground, pose: &CameraPose, canvas: &mut Canvas) {
    let field = Field::new(ground);
    let (low, high) = ground.range();
    let (low, high, slope) = (low as f32, high as f32, ground.slope_bound() as f32);
    let [min_x, min_y] = ground.min_xy();
    let (ox, oy) = ((pose.pos_world.x - min_x) as f32, (pose.pos_world.y - min_y) as f32);
    let oz = pose.pos_world.z as f32;
    let rotation = pose.rotation();
    let axis = |i: usize| rotation.column(i).into_owned();
    let (ahead, left, up) = (axis(0), axis(1), axis(2));

    for v in 0..canvas.rays.height {
        let row_dir = ahead + up * canvas.rays.dz[v];
        let row = v * canvas.rays.width;
        // The height that the last ray of this row met: a good guess for the next.
        let mut last = 0.5 * (low + high);
        for u in 0..canvas.rays.width {
            let dir = row_dir + left * canvas.rays.dy[u];
            let above = oz > high;
            if above && dir.z >= 0.0 {
                continue;
            }
            let limit = canvas.depth[row + u];
            // The ray enters the layer of the hills here.
            let enter = if above { (high - oz) / dir.z } else { 0.0 };
            let run = slope * (dir.x * dir.x + dir.y * dir.y).sqrt();
            if enter >= limit || run - dir.z <= 0.0 {
                continue;
            }
            // A ray steeper than any hill meets the ground once: Newton's method from any start finds it. A flatter
            // one walks from where it enters; hills as steep as the bound everywhere are rare enough to allow
            // longer steps than it proves.
            let steep = -dir.z > 1.3 * run;
            let mut t = if steep && oz > last { (last - oz) / dir.z } else { enter };
            let inv_closing = 1.0 / (0.6 * run - dir.z).max(1e-3);
            let near_step = if steep { f32::INFINITY } else { 0.8 };
            let furthest = limit.min(FAR_M);
            let mut met = None;
            for _ in 0..STEPS {
                let (height, along_x, along_y) = field.sample(ox + t * dir.x, oy + t * dir.y);
                let gap = oz + t * dir.z - height;
                let rate = along_x * dir.x + along_y * dir.y - dir.z;
                let newton = gap / rate;
                let smooth = rate > 0.02;
                if gap.abs() < CLOSED_M || (smooth && newton.abs() < LAST_STEP_M) {
                    met = Some((t + if smooth { newton } else { 0.0 }, height));
                    break;
                }
                if rate > 0.0 && newton < near_step {
                    t = (t + newton).max(0.0);
                } else {
                    t += gap * inv_closing;
                }
                if t > furthest && !steep {
                    break;
                }
            }
            let t = match met {
                Some((t, height)) => {
                    last = height;
                    t
                }
                // Far and flat: the mean level stands for the hills.
                None if dir.z < -1e-4 && t > FAR_M => t.max((0.5 * (low + high) - oz) / dir.z),
                None => continue,
            };
            if t < limit && t > 0.0 {
                canvas.depth[row + u] = t;
                canvas.ids[row + u] = ID_GROUND;
            }
        }
    }
}
