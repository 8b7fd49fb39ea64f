//! The nearest depths of an image, in blocks: as much of it as the planner remembers.

use crate::values::types::Vec3;
use nalgebra::Vector3;

/// Columns of [`Nearest`]: blocks of 4 of an image's 160.
pub const COLUMNS: usize = 40;
/// Rows of [`Nearest`]: blocks of 4 of an image's 96.
pub const ROWS: usize = 24;

/// The nearest depth in each block of an image, mm along the optical axis, row-major from the top left; 0: none measured.
pub type Nearest = [u16; COLUMNS * ROWS];

/// Where the blocks look.
#[derive(Clone, Debug)]
pub(crate) struct Blocks {
    /// Rays of their middles, camera frame, 1 along the optical axis.
    pub(crate) rays: Vec<Vector3<f32>>,
    /// Tangents of half the fields of view.
    half: [f64; 2],
}

impl Blocks {
    /// Of a camera of these fields of view, rad.
    pub(crate) fn new(hfov: f64, vfov: f64) -> Self {
        let half = [hfov, vfov].map(|fov| (fov / 2.0).tan());
        let middle = |k: usize, n: usize, half: f64| ((1.0 - (2 * k + 1) as f64 / n as f64) * half) as f32;
        let ray =
            |k: usize| Vector3::new(1.0, middle(k % COLUMNS, COLUMNS, half[0]), middle(k / COLUMNS, ROWS, half[1]));
        Self { rays: (0..COLUMNS * ROWS).map(ray).collect(), half }
    }

    /// The depth measured toward a point of the camera's frame, m; none: it is out of the image, or none was.
    pub(crate) fn toward(&self, nearest: &Nearest, point_cam: &Vec3) -> Option<f64> {
        let index = |along: f64, half: f64, n: usize| {
            let share = (1.0 - along / point_cam.x / half) * 0.5 * n as f64;
            (point_cam.x > 0.1 && share >= 0.0 && share < n as f64).then_some(share as usize)
        };
        let column = index(point_cam.y, self.half[0], COLUMNS)?;
        let row = index(point_cam.z, self.half[1], ROWS)?;
        Some(nearest[row * COLUMNS + column]).filter(|mm| *mm > 0).map(|mm| f64::from(mm) * 1e-3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blocks_ray_finds_its_own_depth_and_what_is_out_of_the_image_none() {
        let blocks = Blocks::new(90_f64.to_radians(), 62_f64.to_radians());
        let mut nearest = [0; COLUMNS * ROWS];
        for (block, ray) in blocks.rays.iter().enumerate() {
            nearest[block] = 4000;
            let point = ray.map(f64::from) * 3.0;
            assert_eq!(blocks.toward(&nearest, &point), Some(4.0), "block {block}");
            nearest[block] = 0;
            assert_eq!(blocks.toward(&nearest, &point), None);
        }
        nearest.fill(4000);
        for out in [Vec3::new(2.0, 2.1, 0.0), Vec3::new(2.0, 0.0, -1.3), -Vec3::x(), Vec3::x() * f64::NAN] {
            assert_eq!(blocks.toward(&nearest, &out), None);
        }
    }
}
