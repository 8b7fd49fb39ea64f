//! A uniform grid over the ground plane that finds the parts near a point or along a ray.

use super::{Hit, Part, Surface};
use goshawk_core::Vec3;

const CELL_M: f64 = 2.0;

/// Each cell lists the parts whose box touches it; parts beyond the rectangle widen the grid.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    min_xy: [f64; 2],
    nx: i64,
    ny: i64,
    /// `starts[cell]..starts[cell + 1]` indexes `members`.
    starts: Vec<u32>,
    members: Vec<u32>,
    /// Bounding sphere of each part, for a cheap rejection.
    spheres: Vec<(Vec3, f64)>,
}

impl Grid {
    pub(super) fn new(mut min_xy: [f64; 2], mut max_xy: [f64; 2], parts: &[Part]) -> Self {
        let boxes: Vec<_> = parts.iter().map(|p| p.shape.aabb()).collect();
        for (low, high) in &boxes {
            min_xy = [min_xy[0].min(low.x), min_xy[1].min(low.y)];
            max_xy = [max_xy[0].max(high.x), max_xy[1].max(high.y)];
        }
        let count = |axis: usize| ((max_xy[axis] - min_xy[axis]) / CELL_M).floor() as i64 + 1;
        let (nx, ny) = (count(0), count(1));
        let mut cells = vec![Vec::new(); (nx * ny) as usize];
        for (index, (low, high)) in boxes.iter().enumerate() {
            let cell = |x: f64, axis: usize| ((x - min_xy[axis]) / CELL_M).floor() as i64;
            for iy in cell(low.y, 1)..=cell(high.y, 1) {
                for ix in cell(low.x, 0)..=cell(high.x, 0) {
                    cells[(iy * nx + ix) as usize].push(index as u32);
                }
            }
        }
        let mut starts = vec![0u32];
        for cell in &cells {
            starts.push(starts[starts.len() - 1] + cell.len() as u32);
        }
        let spheres = parts.iter().map(|p| p.shape.bounding_sphere()).collect();
        Self { min_xy, nx, ny, starts, members: cells.concat(), spheres }
    }

    pub(super) fn spheres(&self) -> &[(Vec3, f64)] {
        &self.spheres
    }

    fn cell_of(&self, x: f64, y: f64) -> (i64, i64) {
        let cell = |v: f64, axis: usize| ((v - self.min_xy[axis]) / CELL_M).floor() as i64;
        (cell(x, 0), cell(y, 1))
    }

    fn members(&self, ix: i64, iy: i64) -> &[u32] {
        if ix < 0 || iy < 0 || ix >= self.nx || iy >= self.ny {
            return &[];
        }
        let cell = (iy * self.nx + ix) as usize;
        &self.members[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }

    /// Smallest signed distance to any part, or `cap` if none is nearer.
    pub(super) fn clearance(&self, p: &Vec3, parts: &[Part], cap: f64) -> f64 {
        let (cx, cy) = self.cell_of(p.x, p.y);
        let (fx, fy) = (p.x - self.min_xy[0] - cx as f64 * CELL_M, p.y - self.min_xy[1] - cy as f64 * CELL_M);
        let to_border = fx.min(CELL_M - fx).min(fy).min(CELL_M - fy);
        let mut best = cap;
        for ring in 0.. {
            // Every point of this ring's cells is at least this far away.
            let nearest = if ring == 0 { f64::NEG_INFINITY } else { (ring - 1) as f64 * CELL_M + to_border };
            if nearest >= best {
                break;
            }
            for iy in cy - ring..=cy + ring {
                let whole_row = (iy - cy).abs() == ring;
                let step = if whole_row || ring == 0 { 1 } else { 2 * ring };
                for ix in (cx - ring..=cx + ring).step_by(step as usize) {
                    for &index in self.members(ix, iy) {
                        let (centre, radius) = self.spheres[index as usize];
                        let reach = best + radius;
                        if reach > 0.0 && (p - centre).norm_squared() < reach * reach {
                            best = best.min(parts[index as usize].shape.signed_distance(p));
                        }
                    }
                }
            }
        }
        best
    }

    /// Nearest part on the ray, walking the cells in the order in which it crosses them.
    pub(super) fn ray_cast(&self, origin: &Vec3, dir: &Vec3, max_m: f64, parts: &[Part]) -> Option<Hit> {
        let (mut ix, mut iy) = self.cell_of(origin.x, origin.y);
        let axis = |o: f64, d: f64, cell: i64, min: f64| {
            if d.abs() < 1e-12 {
                return (0, f64::INFINITY, f64::INFINITY);
            }
            let border = min + CELL_M * (cell + i64::from(d > 0.0)) as f64;
            (if d > 0.0 { 1 } else { -1 }, (border - o) / d, CELL_M / d.abs())
        };
        let (step_x, mut next_x, delta_x) = axis(origin.x, dir.x, ix, self.min_xy[0]);
        let (step_y, mut next_y, delta_y) = axis(origin.y, dir.y, iy, self.min_xy[1]);
        let mut best: Option<Hit> = None;
        loop {
            for &index in self.members(ix, iy) {
                let limit = best.map_or(max_m, |hit| hit.distance_m);
                if let Some(distance_m) = parts[index as usize].shape.ray(origin, dir).filter(|t| *t < limit) {
                    best = Some(Hit { distance_m, surface: Surface::Part(index) });
                }
            }
            let leave = next_x.min(next_y);
            if leave >= best.map_or(max_m, |hit| hit.distance_m) {
                return best;
            }
            if next_x < next_y {
                ix += step_x;
                next_x += delta_x;
            } else {
                iy += step_y;
                next_y += delta_y;
            }
        }
    }
}
