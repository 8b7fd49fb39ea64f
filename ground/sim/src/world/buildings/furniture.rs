//! What stands and hangs in a room: tables, shelves, pillars, lamps. Nothing stands in the way of a doorway.

use super::plan::{FloorPlan, Room};
use super::{Built, WALL_M};
use goshawk_core::Vec3;
use rand::{Rng, RngExt};

/// Furniture keeps this far from a doorway's middle, m.
const DOOR_CLEAR_M: f64 = 1.9;
/// And this far from other furniture, so that a person passes, m.
const PASSAGE_M: f64 = 1.4;

/// Furnishes a room with up to one piece for 12 m².
pub(super) fn furnish<R: Rng>(plan: &FloorPlan, room: &Room, built: &mut Built, rng: &mut R) {
    let (rect, storey) = (room.rect, built.storey_m);
    let lamp = [rect.min[0] + 0.5 * rect.size(0), rect.min[1] + 0.5 * rect.size(1)];
    if rng.random_bool(0.6) {
        let low = rng.random_range(2.2..2.5f64).min(storey - 0.3);
        let half = Vec3::new(0.2, 0.2, 0.5 * (storey - low));
        built.turned(Vec3::new(lamp[0], lamp[1], low + half.z), half, 0.0, built.tint[2], rng);
    }
    if room.corridor {
        return;
    }
    let mut taken: Vec<([f64; 2], f64)> = plan.doorways().map(|at| (at, DOOR_CLEAR_M)).collect();
    for _ in 0..(rect.size(0) * rect.size(1) / 12.0) as usize {
        let kind = rng.random_range(0..3);
        let half = match kind {
            0 => Vec3::new(rng.random_range(0.5..0.9), rng.random_range(0.35..0.5), 0.38),
            1 => Vec3::new(rng.random_range(0.5..1.0), 0.2, rng.random_range(0.6..1.05)),
            _ => Vec3::new(0.2, 0.2, 0.5 * storey),
        };
        let reach = half.xy().norm();
        let margin = if kind == 1 { 0.5 * WALL_M + half.y + 0.05 } else { 0.5 * WALL_M + reach + 0.05 };
        if rect.size(0).min(rect.size(1)) <= 2.0 * (margin + reach) {
            continue;
        }
        let mut at = [0, 1].map(|axis| rng.random_range(rect.min[axis] + margin..rect.max[axis] - margin));
        let mut yaw = rng.random_range(0.0..std::f64::consts::PI);
        if kind == 1 {
            // A shelf stands against a wall.
            let axis = rng.random_range(0..2);
            at[axis] = if rng.random_bool(0.5) { rect.min[axis] + margin } else { rect.max[axis] - margin };
            at[1 - axis] = rng.random_range(rect.min[1 - axis] + reach + 0.2..rect.max[1 - axis] - reach - 0.2);
            yaw = if axis == 0 { std::f64::consts::FRAC_PI_2 } else { 0.0 };
        }
        let free = |(other, keep): &([f64; 2], f64)| (at[0] - other[0]).hypot(at[1] - other[1]) > keep + reach;
        if taken.iter().all(free) {
            let tint = built.tint[usize::from(kind != 2)];
            built.turned(Vec3::new(at[0], at[1], half.z), half, yaw, tint, rng);
            taken.push((at, PASSAGE_M + reach));
        }
    }
}
