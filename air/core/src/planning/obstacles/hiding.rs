//! Whether what is remembered hides somebody.

use super::{Obstacles, VOXEL, in_voxels, is_inside, place};
use crate::values::types::Vec3;

/// Somebody is looked for at these places across the line of sight, m: the middle and the shoulders.
const ACROSS: [f64; 3] = [-0.2, 0.0, 0.2];
/// Between the points of a line, m: none steps over a voxel's middle.
const STEP: f64 = 0.75 * VOXEL;
/// So far from the lens nothing hides, m: it would be the vehicle. Chosen by eye.
const OWN: f64 = 0.3;

impl Obstacles {
    /// How much of somebody at `to` (m) is hidden from `from` (m), 0 to 1. What is nearer to them than `own` (m, level) is
    /// taken for themselves.
    #[must_use]
    pub fn hiding(&self, from: &Vec3, to: &Vec3, own: f64) -> f64 {
        let line = to - from;
        let flat = line.xy().norm();
        let across = Vec3::new(-line.y, line.x, 0.0) / flat;
        let Some(low) = self.low.filter(|_| flat > own && line.iter().all(|x| x.is_finite())) else { return 0.0 };
        let steps = ((flat - own).min(f64::from(self.range)) / STEP) as u32;
        let hidden = ACROSS.iter().filter(|aside| {
            let end = line + across * **aside;
            ((OWN / STEP) as u32..steps).any(|k| {
                let at = in_voxels(&(from + end * (f64::from(k) * STEP / flat)), &low);
                is_inside(&at) && {
                    let (row, bit) = place(&low, &at);
                    self.occupied[row] & bit != 0
                }
            })
        });
        hidden.count() as f64 / ACROSS.len() as f64
    }
}
