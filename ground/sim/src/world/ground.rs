//! Uneven ground: a height field on a square grid, bilinear between the nodes.

use goshawk_core::Vec3;
use rand::{Rng, RngExt};

/// Heights on a grid of nodes. Beyond the grid the border's height goes on.
#[derive(Clone, Debug, PartialEq)]
pub struct Ground {
    min_xy: [f64; 2],
    cell_m: f64,
    nx: usize,
    ny: usize,
    heights: Vec<f32>,
    range: (f64, f64),
    slope_bound: f64,
}

impl Ground {
    /// Smooth hills of about ± `amplitude_m`: a sum of random plane waves of 7 to 28 m, on nodes `cell_m` apart.
    pub fn hills<R: Rng>(min_xy: [f64; 2], max_xy: [f64; 2], cell_m: f64, amplitude_m: f64, rng: &mut R) -> Self {
        const WAVES: usize = 7;
        let waves: [[f64; 4]; WAVES] = std::array::from_fn(|_| {
            let wavelength = rng.random_range(7.0..28.0);
            let direction = rng.random_range(0.0..std::f64::consts::TAU);
            let number = std::f64::consts::TAU / wavelength;
            // Longer waves are higher, so that slopes stay gentle.
            [number * direction.cos(), number * direction.sin(), rng.random_range(0.0..6.3), wavelength]
        });
        let total = waves.iter().map(|w| w[3] * w[3]).sum::<f64>().sqrt();
        Self::from_fn(min_xy, max_xy, cell_m, |x, y| {
            waves.iter().map(|w| (w[0] * x + w[1] * y + w[2]).sin() * w[3]).sum::<f64>() / total * amplitude_m
        })
    }

    /// Samples `height(x, y)` at nodes `cell_m` apart that cover the rectangle.
    pub fn from_fn(min_xy: [f64; 2], max_xy: [f64; 2], cell_m: f64, height: impl Fn(f64, f64) -> f64) -> Self {
        let count = |axis: usize| ((max_xy[axis] - min_xy[axis]) / cell_m - 1e-9).ceil() as usize + 1;
        let (nx, ny) = (count(0).max(2), count(1).max(2));
        let node = |i: usize, axis: usize| min_xy[axis] + i as f64 * cell_m;
        let heights: Vec<f32> = (0..nx * ny).map(|i| height(node(i % nx, 0), node(i / nx, 1)) as f32).collect();
        let low = heights.iter().copied().fold(f32::INFINITY, f32::min);
        let high = heights.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let step = |a: usize, b: usize| f64::from((heights[a] - heights[b]).abs()) / cell_m;
        let mut steepest = [0.0f64; 2];
        for i in 0..nx * ny {
            if i % nx + 1 < nx {
                steepest[0] = steepest[0].max(step(i, i + 1));
            }
            if i / nx + 1 < ny {
                steepest[1] = steepest[1].max(step(i, i + nx));
            }
        }
        let slope_bound = steepest[0].hypot(steepest[1]);
        Self { min_xy, cell_m, nx, ny, heights, range: (f64::from(low), f64::from(high)), slope_bound }
    }

    /// Position of node (0, 0), m.
    #[must_use]
    pub fn min_xy(&self) -> [f64; 2] {
        self.min_xy
    }

    /// Distance between nodes, m.
    #[must_use]
    pub fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// (rows along y, columns along x).
    #[must_use]
    pub fn shape(&self) -> (usize, usize) {
        (self.ny, self.nx)
    }

    /// Heights, row-major with x fastest, m.
    #[must_use]
    pub fn heights(&self) -> &[f32] {
        &self.heights
    }

    /// (lowest, highest), m.
    #[must_use]
    pub fn range(&self) -> (f64, f64) {
        self.range
    }

    /// No slope anywhere exceeds this (rise over run).
    #[must_use]
    pub fn slope_bound(&self) -> f64 {
        self.slope_bound
    }

    /// Height at (x, y), m.
    #[must_use]
    pub fn height(&self, x: f64, y: f64) -> f64 {
        let place = |v: f64, axis: usize, n: usize| {
            let f = ((v - self.min_xy[axis]) / self.cell_m).clamp(0.0, (n - 1) as f64);
            let i = (f as usize).min(n - 2);
            (i, f - i as f64)
        };
        let ((ix, fx), (iy, fy)) = (place(x, 0, self.nx), place(y, 1, self.ny));
        let at = |dy: usize, dx: usize| f64::from(self.heights[(iy + dy) * self.nx + ix + dx]);
        let low = at(0, 0) + (at(0, 1) - at(0, 0)) * fx;
        let high = at(1, 0) + (at(1, 1) - at(1, 0)) * fx;
        low + (high - low) * fy
    }

    /// Distance along the unit vector `dir` to the ground, if nearer than `max_m`. An origin below the ground is on it.
    ///
    /// Walks no further than the slope bound proves free, then brackets the crossing by bisection.
    #[must_use]
    pub fn ray_cast(&self, origin: &Vec3, dir: &Vec3, max_m: f64) -> Option<f64> {
        let gap = |t: f64| origin.z + t * dir.z - self.height(origin.x + t * dir.x, origin.y + t * dir.y);
        let closing = (-dir.z + self.slope_bound * dir.x.hypot(dir.y)).max(0.0) + 1e-12;
        let (mut free, mut t) = (0.0, 0.0);
        loop {
            let here = gap(t);
            if here <= 0.0 {
                break;
            }
            free = t;
            t += here / closing + 1e-3;
            if t > max_m {
                return None;
            }
        }
        for _ in 0..40 {
            let middle = 0.5 * (free + t);
            if gap(middle) > 0.0 {
                free = middle;
            } else {
                t = middle;
            }
        }
        Some(t).filter(|t| *t < max_m)
    }
}
