//! What it costs to meet what is remembered: a trajectory that meets something costs more, the sooner the more. None is
//! forbidden, since one must be flown.

use super::{Ignored, Obstacles, SIZE, Voxel, bit_of, in_voxels, is_inside, row_of};
use crate::values::quintic::Quintic;
use crate::values::types::Vec3;
use nalgebra::{Vector2, Vector3};

/// A trajectory is looked at in so many instants. Chosen by eye.
const LOOKS: u32 = 20;
/// Meeting something matters the less the later, and not at all after this time, s: till then there is another way.
/// Chosen by eye.
const HORIZON: f64 = 2.5;

impl Obstacles {
    /// How bad it is what a trajectory would meet: 0 nothing, 1 something at once.
    #[must_use]
    pub fn meeting(&self, trajectory: &Quintic, ignored: Option<&Ignored>) -> f64 {
        self.meeting_on(&|time| trajectory.at(time).pos, trajectory.duration(), ignored)
    }

    /// As [`Obstacles::meeting`], of a `way` that gives the place (m) at a time, s, up to `horizon`, s.
    pub(crate) fn meeting_on(&self, way: &impl Fn(f64) -> Vec3, horizon: f64, ignored: Option<&Ignored>) -> f64 {
        let Some(low) = self.low else { return 0.0 };
        let horizon = horizon.min(HORIZON);
        let gap = |time: f64| {
            let pos = way(time);
            let expected = ignored.is_some_and(|c| (pos.xy() - c.at_world.xy()).norm() < c.radius);
            if expected { f32::INFINITY } else { self.gap(&low, &in_voxels(&pos, &low)) }
        };
        // Beside something already, it is as bad as much of what is left is lost; not at all if one leaves.
        let mut left = gap(0.0);
        let mut worst = 0.0_f64;
        for time in (1..=LOOKS).map(|k| horizon * f64::from(k) / f64::from(LOOKS)) {
            let gap = gap(time);
            let lost =
                if left.is_infinite() { f32::from(u8::from(gap.is_finite())) } else { (1.0 - gap / left).max(0.0) };
            worst = worst.max((1.0 - time / HORIZON).powi(2) * f64::from(lost));
            if gap.is_infinite() {
                left = gap;
            } else if left.is_infinite() {
                break;
            }
        }
        worst
    }

    /// How far the nearest thing is in the point's voxel and those about it, which reach 0.2 to 0.4 m, in voxels;
    /// infinite: there is none.
    fn gap(&self, low: &Voxel, at: &Vector3<f32>) -> f32 {
        if !is_inside(at) {
            return f32::INFINITY;
        }
        let inner = at.map(|x| x as i32);
        // The voxel's neighbours along x, but for those beyond the grid, where the rows wrap.
        let (first, last) = ((inner.x - 1).max(0), (inner.x + 1).min(SIZE[0] - 1));
        let about = (first..=last).fold(0_u128, |bits, x| bits | 1 << bit_of(low.x + x));
        let rows = |axis: usize| (inner[axis] - 1).max(0)..=(inner[axis] + 1).min(SIZE[axis] - 1);
        let mut least = f32::INFINITY;
        for (y, z) in rows(2).flat_map(|z| rows(1).map(move |y| (y, z))) {
            let things = self.occupied[row_of(&(low + Voxel::new(0, y, z)))] & about;
            if things != 0 {
                let beside = Vector2::new(y as f32 + 0.5 - at.y, z as f32 + 0.5 - at.z).norm_squared();
                for x in (first..=last).filter(|x| things & 1 << bit_of(low.x + x) != 0) {
                    least = least.min((x as f32 + 0.5 - at.x).powi(2) + beside);
                }
            }
        }
        least.sqrt()
    }
}
