//! The room about the vehicle: how far its body could go to each side (beyond the paper).

use nalgebra::Vector2;
use std::f32::consts::TAU;

/// Headings of [`Room`], from the world's x axis counterclockwise. Chosen by eye.
pub const HEADINGS: usize = 16;

/// For each heading, how far the vehicle's body could go at its height before it meets something, m; at most
/// [`FARTHEST_ROOM`].
pub type Room = [f32; HEADINGS];

/// Room is not looked for farther than this, m. Chosen by eye.
pub const FARTHEST_ROOM: f32 = 4.0;

/// The room for a `body` of this radius (m) among `things`, which stand so far from the vehicle, m, level, world axes.
#[must_use]
pub fn among(body: f32, things: impl Iterator<Item = Vector2<f32>>) -> Room {
    let ways: [Vector2<f32>; HEADINGS] = std::array::from_fn(|heading| {
        let (sin, cos) = (heading as f32 * TAU / HEADINGS as f32).sin_cos();
        Vector2::new(cos, sin)
    });
    let mut room = [FARTHEST_ROOM; HEADINGS];
    for thing in things {
        for (free, way) in room.iter_mut().zip(&ways) {
            let along = thing.dot(way);
            let beside = thing.norm_squared() - along * along;
            if along > 0.0 && beside < body * body {
                *free = free.min((along - (body * body - beside).sqrt()).max(0.0));
            }
        }
    }
    room
}

/// The room in the direction `way`, m.
pub(crate) fn toward(room: &Room, way: &Vector2<f64>) -> f64 {
    let turn = way.y.atan2(way.x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
    f64::from(room[(turn * HEADINGS as f64).round() as usize % HEADINGS])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_room_up_to_a_thing_however_near_it_is_and_all_beside_and_behind() {
        let room = |x: f32, y: f32| among(0.3, std::iter::once(Vector2::new(x, y)));
        for (x, left) in [(9.0, FARTHEST_ROOM), (3.0, 2.7), (0.5, 0.2), (0.1, 0.0)] {
            let room = room(x, 0.0);
            assert!((room[0] - left).abs() < 1e-6, "{x} {room:?}");
            assert_eq!([room[HEADINGS / 4], room[HEADINGS / 2]], [FARTHEST_ROOM; 2], "{x}");
        }
        assert_eq!(room(3.0, 0.31)[0], FARTHEST_ROOM, "the body passes");
        assert_eq!(among(0.3, std::iter::empty()), [FARTHEST_ROOM; HEADINGS]);
        assert_eq!(toward(&room(0.0, 3.0), &Vector2::new(0.1, 5.0)), f64::from(room(0.0, 3.0)[HEADINGS / 4]));
    }
}
