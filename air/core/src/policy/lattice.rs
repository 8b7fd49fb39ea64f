//! The anchors: 3 rows × 5 columns over the camera's field of view (eq. 3).

use crate::values::types::{ANCHORS, Vec3};

/// Rows of the grid, row 0 at the image's top.
pub const ROWS: usize = 3;
/// Columns of the grid, column 0 at the image's left.
pub const COLUMNS: usize = 5;

/// One primitive: a direction in the camera frame. Its cell's frame has x along it, and y level in the camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchor {
    /// phi, rad; positive to the left.
    pub azimuth: f64,
    /// theta, rad; positive upward.
    pub elevation: f64,
}

/// All anchors, row-major from the image's top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    /// Index is row · 5 + column.
    pub anchors: [Anchor; ANCHORS],
    /// r, m.
    pub radius: f64,
}

/// The point at `radius` in the direction (`elevation`, `azimuth`), camera frame (eq. 3-4).
#[must_use]
pub fn end_position(radius: f64, elevation: f64, azimuth: f64) -> Vec3 {
    let (sin_el, cos_el) = elevation.sin_cos();
    let (sin_az, cos_az) = azimuth.sin_cos();
    radius * Vec3::new(cos_el * cos_az, cos_el * sin_az, sin_el)
}

impl Lattice {
    /// Cell centres at equal angles over the fields of view (rad) on a sphere of `radius` (m).
    #[must_use]
    pub fn new(hfov: f64, vfov: f64, radius: f64) -> Self {
        let anchors = std::array::from_fn(|index| {
            let (row, column) = (index / COLUMNS, index % COLUMNS);
            let azimuth = hfov * (0.5 - (column as f64 + 0.5) / COLUMNS as f64);
            let elevation = vfov * (0.5 - (row as f64 + 0.5) / ROWS as f64);
            Anchor { azimuth, elevation }
        });
        Self { anchors, radius }
    }

    /// The primitive's end position, camera frame, m (eq. 3).
    #[must_use]
    pub fn primitive(&self, index: usize) -> Vec3 {
        let anchor = &self.anchors[index];
        end_position(self.radius, anchor.elevation, anchor.azimuth)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_anchor_is_up_and_left_and_the_middle_one_looks_ahead() {
        let lattice = Lattice::new(90_f64.to_radians(), 62_f64.to_radians(), 5.0);
        let first = lattice.primitive(0);
        assert!(first.x > 0.0 && first.y > 0.0 && first.z > 0.0);
        let last = lattice.primitive(ANCHORS - 1);
        assert!(last.x > 0.0 && last.y < 0.0 && last.z < 0.0);
        assert!((lattice.primitive(7) - Vec3::new(5.0, 0.0, 0.0)).norm() < 1e-12);
    }
}
