//! The nearest depths of an image: as much of it as the planner is shown.

use crate::values::types::Vec3;
use nalgebra::Vector3;

/// Columns of [`Nearest`]: those of the network's image. What moves across is seen to move by its columns.
pub const COLUMNS: usize = 160;
/// Rows of [`Nearest`]: of 4 of the image's 96 each.
pub const ROWS: usize = 24;

/// The nearest depth in each column of each row, mm along the optical axis, row-major from the top left; 0: none measured.
pub type Nearest = [u16; COLUMNS * ROWS];

/// Columns of [`Coarse`], of 4 each.
pub const BLOCKS: usize = 40;

/// The nearest depth in each block of 4 columns: as fine as voxels need it.
pub type Coarse = [u16; BLOCKS * ROWS];

/// Of an image.
#[must_use]
pub fn coarse(nearest: &Nearest) -> Coarse {
    let (blocks, _) = nearest.as_chunks::<{ COLUMNS / BLOCKS }>();
    std::array::from_fn(|block| blocks[block].iter().copied().filter(|mm| *mm > 0).min().unwrap_or(0))
}

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
        let ray = |k: usize| Vector3::new(1.0, middle(k % BLOCKS, BLOCKS, half[0]), middle(k / BLOCKS, ROWS, half[1]));
        Self { rays: (0..BLOCKS * ROWS).map(ray).collect(), half }
    }

    /// A point of the camera's frame is between the image's left and right edge.
    pub(crate) fn is_abreast(&self, point_cam: &Vec3) -> bool {
        point_cam.x > 0.1 && point_cam.y.abs() < point_cam.x * self.half[0]
    }

    /// The depth measured toward a point of the camera's frame, m; none: it is out of the image, or none was.
    pub(crate) fn toward(&self, coarse: &Coarse, point_cam: &Vec3) -> Option<f64> {
        let index = |along: f64, half: f64, n: usize| {
            let share = (1.0 - along / point_cam.x / half) * 0.5 * n as f64;
            (point_cam.x > 0.1 && share >= 0.0 && share < n as f64).then_some(share as usize)
        };
        let column = index(point_cam.y, self.half[0], BLOCKS)?;
        let row = index(point_cam.z, self.half[1], ROWS)?;
        Some(coarse[row * BLOCKS + column]).filter(|mm| *mm > 0).map(|mm| f64::from(mm) * 1e-3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blocks_ray_finds_its_own_depth_and_what_is_out_of_the_image_none() {
        let blocks = Blocks::new(90_f64.to_radians(), 62_f64.to_radians());
        let mut coarse = [0; BLOCKS * ROWS];
        for (block, ray) in blocks.rays.iter().enumerate() {
            coarse[block] = 4000;
            let point = ray.map(f64::from) * 3.0;
            assert_eq!(blocks.toward(&coarse, &point), Some(4.0), "block {block}");
            coarse[block] = 0;
            assert_eq!(blocks.toward(&coarse, &point), None);
        }
        coarse.fill(4000);
        for out in [Vec3::new(2.0, 2.1, 0.0), Vec3::new(2.0, 0.0, -1.3), -Vec3::x(), Vec3::x() * f64::NAN] {
            assert_eq!(blocks.toward(&coarse, &out), None);
        }
    }

    #[test]
    fn a_block_has_the_nearest_of_its_columns_that_was_measured() {
        let mut nearest = [0; COLUMNS * ROWS];
        nearest[4..8].copy_from_slice(&[0, 700, 5000, 900]);
        assert_eq!(coarse(&nearest)[..3], [0, 700, 0]);
    }
}
