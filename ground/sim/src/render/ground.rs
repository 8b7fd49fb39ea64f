//! The height field into the depth buffer.
//!
//! The tangent plane that a pixel found is a good guess for its neighbour above. So a stretch of a row is first solved
//! as a whole, by one step of Newton's method from there; only pixels for which that does not do are followed one by
//! one.

use super::ID_GROUND;
use super::camera::View;
use super::field::Field;
use super::raster::Canvas;
use crate::render::lanes::{LANES, Lanes, any, each, lanes, least, mask, most, pick, some, three};
use crate::world::Ground;
use goshawk_core::Vec3;
use nalgebra::Vector3;

type V3 = Vector3<f32>;

/// Rays that have not met the ground by here take the mean level, m of depth.
const FAR_M: f32 = 60.0;

/// Evaluations of the field for a ray that is followed.
const STEPS: usize = 40;

/// A gap of this size, or one that a step of this length along the ray closes, is closed by one last linear step, m.
const CLOSED_M: f32 = 1e-3;
const LAST_STEP_M: f32 = 0.08;

/// From here on a crest that hides ground is lower than a pixel, m.
const CRESTS_M: f32 = 12.0;

/// Of the last step, over the depth: an error that far away is less than the camera's.
const LAST_STEP: f32 = 0.02;

/// What the pixels of a row found, for the next row: in each column the ground's tangent plane and how far the ray ran
/// free.
#[derive(Clone, Debug)]
pub(super) struct RowBelow {
    /// The plane's height at the camera over the camera's, its slopes along x and along y.
    planes: [Vec<f32>; 3],
    /// With one column more on either side.
    free: Vec<f32>,
    before: Vec<f32>,
}

impl RowBelow {
    pub(super) fn new(width: usize) -> Self {
        let row = || vec![0.0; width.next_multiple_of(LANES)];
        let wide = || vec![0.0; width.next_multiple_of(LANES) + 2];
        Self { planes: [row(), row(), row()], free: wide(), before: wide() }
    }

    fn begin(&mut self, level: f32) {
        let [rise, along_x, along_y] = &mut self.planes;
        rise.fill(level);
        along_x.fill(0.0);
        along_y.fill(0.0);
        self.free.fill(0.0);
    }

    /// Takes what a stretch of a row that begins at column `first` has found.
    fn learn(&mut self, first: usize, proven: &Lanes, found: Option<&Found<LANES>>) {
        let stretch = first..first + LANES;
        let free = &mut self.free[first + 1..first + 1 + LANES];
        free.copy_from_slice(proven);
        let Some(found) = found else { return };
        let [rise, along_x, along_y] = self.planes.each_mut().map(|p| &mut p[stretch.clone()]);
        for i in 0..LANES {
            let met = found.met[i];
            free[i] = pick(met, 0.98 * found.t[i], free[i]);
            rise[i] = pick(met, found.rise[i], rise[i]);
            along_x[i] = pick(met, found.slopes[0][i], along_x[i]);
            along_y[i] = pick(met, found.slopes[1][i], along_y[i]);
        }
    }
}

/// Where a ray meets the ground, m of depth, and the tangent plane there as in [`RowBelow`].
struct Hit {
    t: f32,
    rise: f32,
    slopes: [f32; 2],
}

/// What one evaluation of the field shows of some rays.
struct Found<const N: usize> {
    /// All bits set where the ground is met.
    met: [u32; N],
    /// On the ground if it is met, otherwise where to look next.
    t: [f32; N],
    rise: [f32; N],
    slopes: [[f32; N]; 2],
}

impl<const N: usize> Found<N> {
    fn hit(&self, i: usize) -> Hit {
        Hit { t: self.t[i], rise: self.rise[i], slopes: self.slopes.map(|s| s[i]) }
    }

    fn set(&mut self, i: usize, hit: &Hit) {
        (self.t[i], self.rise[i]) = (hit.t, hit.rise);
        (self.slopes[0][i], self.slopes[1][i]) = (hit.slopes[0], hit.slopes[1]);
    }
}

struct Seeker<'a> {
    field: Field<'a>,
    /// The camera, from node (0, 0).
    eye: V3,
    /// Heights of the lowest and the highest hill over the camera.
    range: (f32, f32),
    /// No hill is steeper.
    slope: f32,
}

impl<'a> Seeker<'a> {
    fn new(ground: &'a Ground, view: &View) -> Self {
        let (low, high) = ground.range();
        let [min_x, min_y] = ground.min_xy();
        let eye = (view.pos_world - Vec3::new(min_x, min_y, 0.0)).cast::<f32>();
        let range = (low as f32 - eye.z, high as f32 - eye.z);
        Self { field: Field::new(ground), eye, range, slope: ground.slope_bound() as f32 }
    }

    /// A plane in the middle of the hills, over the camera.
    fn level(&self) -> f32 {
        0.5 * (self.range.0 + self.range.1)
    }

    fn above(&self) -> bool {
        self.range.1 < 0.0
    }

    /// How far hills can rise along a ray, over its depth.
    #[inline(always)]
    fn run(&self, dx: f32, dy: f32) -> f32 {
        self.slope * (dx * dx + dy * dy).sqrt()
    }

    /// A ray steeper than any hill meets the ground once.
    #[inline(always)]
    fn steep(run: f32, dz: f32) -> bool {
        -dz > 1.3 * run
    }

    /// One step of Newton's method where that is safe: anywhere on a steep ray. A flatter one walks; hills as steep as
    /// the bound everywhere are rare enough to allow longer steps than it proves.
    #[inline(always)]
    fn look<const N: usize>(&self, [dx, dy, dz]: &[[f32; N]; 3], t: &[f32; N]) -> Found<N> {
        let x: [f32; N] = each(|i| self.eye.x + t[i] * dx[i]);
        let y: [f32; N] = each(|i| self.eye.y + t[i] * dy[i]);
        let (height, slopes) = self.field.sample(&x, &y);
        let mut found = Found { met: [0; N], t: [0.0; N], rise: [0.0; N], slopes };
        for i in 0..N {
            let uphill = found.slopes[0][i] * dx[i] + found.slopes[1][i] * dy[i];
            let (gap, rate) = (self.eye.z + t[i] * dz[i] - height[i], uphill - dz[i]);
            let newton = gap / rate;
            let smooth = rate > 0.02;
            let met = (gap.abs() < CLOSED_M) | (smooth & (newton.abs() < most(LAST_STEP_M, LAST_STEP * t[i])));
            let run = self.run(dx[i], dy[i]);
            let near_step = if Self::steep(run, dz[i]) { f32::INFINITY } else { 0.8 };
            let walk = gap / most(0.6 * run - dz[i], 1e-3);
            let step = if (rate > 0.0) && (newton < near_step) { newton } else { walk };
            let last = if smooth { newton } else { 0.0 };
            found.met[i] = mask(met);
            found.t[i] = most(t[i] + if met { last } else { step }, 0.0);
            found.rise[i] = height[i] - self.eye.z - t[i] * uphill;
        }
        found
    }

    /// Goes on from `t` along one ray up to `limit`, m of depth; if it meets nothing, how far it got.
    fn follow(&self, dir: V3, mut t: f32, limit: f32) -> Result<Hit, f32> {
        let rays = [[dir.x], [dir.y], [dir.z]];
        let steep = Self::steep(self.run(dir.x, dir.y), dir.z);
        for _ in 0..STEPS {
            if t > limit.min(FAR_M) && !steep {
                break;
            }
            let found = self.look(&rays, &[t]);
            if found.met[0] != 0 {
                return Ok(found.hit(0));
            }
            t = found.t[0];
        }
        // Far and flat: the mean level stands for the hills.
        let (far, rise) = (dir.z < -1e-4 && t > FAR_M, self.level());
        if far { Ok(Hit { t: t.max(rise / dir.z), rise, slopes: [0.0; 2] }) } else { Err(t) }
    }

    /// Solves the rays of a stretch of a row at once; those for which that does not do, one by one. `limit`: depth of
    /// what is drawn already. `proven`: how far the rays are free, before and after. None: no ray meets anything.
    fn stretch(
        &self,
        dir: &[Lanes; 3],
        limit: &Lanes,
        proven: &mut Lanes,
        planes: [&Lanes; 3],
    ) -> Option<Found<LANES>> {
        let ([dx, dy, dz], [rise, along_x, along_y]) = (dir, planes);
        let (above, top) = (self.above(), self.range.1);
        let (mut open, mut t) = ([0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let run = self.run(dx[i], dy[i]);
            // The ray enters the layer of the hills here.
            let enter = most(if above { top / dz[i] } else { 0.0 }, proven[i]);
            open[i] = mask(!above || (dz[i] < 0.0) && (enter < limit[i]) && (run > dz[i]));
            let guess = rise[i] / (dz[i] - along_x[i] * dx[i] - along_y[i] * dy[i]);
            // Beyond what is proven free, but not so far that a crest could hide between.
            let near = (guess > 0.9 * enter) && (guess < 1.4 * proven[i] + 0.3) || (proven[i] > CRESTS_M);
            let good = (guess > 0.0) & (Self::steep(run, dz[i]) | near);
            t[i] = least(if good { guess } else { enter }, 2.0 * FAR_M);
        }
        if any(&open) == 0 {
            return None;
        }
        let mut found = self.look(dir, &t);
        if any(&lanes(|i| open[i] & !found.met[i])) != 0 {
            found = self.look(dir, &found.t);
        }
        let left: [u32; LANES] = lanes(|i| open[i] & !found.met[i]);
        for i in (0..LANES).filter(|i| left[*i] != 0) {
            match self.follow(V3::new(dx[i], dy[i], dz[i]), found.t[i], limit[i]) {
                Ok(hit) => found.set(i, &hit),
                Err(t) => (open[i], proven[i]) = (0, t.min(limit[i])),
            }
        }
        found.met = open;
        Some(found)
    }
}

/// Draws the ground wherever nothing nearer is drawn already; fills in the ground's slopes there.
pub(super) fn draw(
    ground: &Ground,
    view: &View,
    canvas: &mut Canvas,
    slopes: &mut [Vec<f32>; 2],
    below: &mut RowBelow,
) {
    let seeker = Seeker::new(ground, view);
    let [ahead, left, up]: [V3; 3] = std::array::from_fn(|i| view.world_from_cam.column(i).into_owned());
    // Rows are drawn upward in the world. From a ray to the ray a row up and at most a column aside one rises faster
    // than any hill, so that this one runs free at least as far; unless the camera lies on its side.
    let upright = up.z.abs() - left.z.abs() > seeker.slope * std::f32::consts::SQRT_2;
    let (width, height) = (canvas.rays.width, canvas.rays.height);
    below.begin(seeker.level());
    for step in 0..height {
        let v = if up.z > 0.0 { height - 1 - step } else { step };
        let row_dir = ahead + up * canvas.rays.dz[v];
        std::mem::swap(&mut below.before, &mut below.free);
        for first in (0..width).step_by(LANES) {
            let columns = &canvas.rays.dy[first..first + LANES];
            let dir = three(|axis| lanes(|i| row_dir[axis] + left[axis] * columns[i]));
            let before = &below.before[first..first + LANES + 2];
            let mut proven =
                if upright { lanes(|i| most(most(before[i], before[i + 1]), before[i + 2])) } else { [0.0; LANES] };
            let row = v * width + first;
            let inside = LANES.min(width - first);
            let mut limit = [0.0; LANES];
            limit[..inside].copy_from_slice(&canvas.depth[row..row + inside]);
            let planes = [0, 1, 2].map(|k| some(&below.planes[k], first));
            let found = seeker.stretch(&dir, &limit, &mut proven, planes);
            below.learn(first, &proven, found.as_ref());
            let Some(found) = found else { continue };
            let nearer: [u32; LANES] = lanes(|i| found.met[i] & mask((found.t[i] < limit[i]) && (found.t[i] > 0.0)));
            let depth: Lanes = lanes(|i| pick(nearer[i], found.t[i], limit[i]));
            canvas.depth[row..row + inside].copy_from_slice(&depth[..inside]);
            for (id, nearer) in canvas.ids[row..row + inside].iter_mut().zip(nearer) {
                *id = (ID_GROUND & nearer) | (*id & !nearer);
            }
            for (slopes, found) in slopes.iter_mut().zip(&found.slopes) {
                slopes[row..row + inside].copy_from_slice(&found[..inside]);
            }
        }
    }
}
